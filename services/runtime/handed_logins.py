"""Each role's login in a directory of its own, for machines or containers that get that one directory."""

from collections.abc import Iterable
from pathlib import Path

from services.runtime.secret import SecretError, written_anew


def hand_out(folder: Path, roles: Iterable[str]) -> None:
    """Copy the login of each role into `folder/ROLE/ROLE.login`, wherever there is a directory `folder/ROLE`.

    A copy that is no longer the login is replaced, whole. Raises: SecretError when one cannot be written.
    """
    for role in roles:
        name = f"{role}.login"
        copy = folder / role / name
        try:
            if copy.parent.is_dir():
                _write(copy, (folder / name).read_bytes())
        except OSError as error:
            reason = error.strerror or error
            message = f"{copy}: {reason}: let the router write there, or remove {copy.parent}"
            raise SecretError(message) from None


def _write(path: Path, content: bytes) -> None:
    if path.is_file() and path.read_bytes() == content:
        return
    written_anew(path, content)
