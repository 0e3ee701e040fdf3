"""The secret that signs tokens: one file of the data directory, readable by its owner alone."""

import os
import secrets
import stat
from pathlib import Path

from protocol.identity import SECRET_BYTES_MIN

NAME = "secret"
FOLDER = "gateway"
"""Below the data directory: the gateway hands tokens out, everybody else only verifies them."""


class SecretError(Exception):
    """There is no secret to be had; the text is one line: what is wrong, where, and the mend."""


def load_secrets(folder: Path) -> list[bytes]:
    """Return the secrets of a deployment, oldest first; the first call makes one.

    The file has one secret a line, in hex. A line added at the end signs from the next start on, while the
    lines before it still verify. Raises: SecretError when others can read the file, or it holds no secret.
    """
    path = folder / NAME
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        written_once(path, secrets.token_hex(SECRET_BYTES_MIN).encode() + b"\n")
        mode = path.stat().st_mode
        lines = path.read_text("ascii").split()
        found = [bytes.fromhex(line) for line in lines]
    except OSError as error:
        raise SecretError(
            f"{path}: {error.strerror or error}: name a --data directory that can be written"
        ) from None
    except ValueError:
        found, mode = [], 0
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise SecretError(
            f"{path}: others can read the secret: `chmod 600 {path}`, or delete it for a new one"
        )
    if not found or any(len(secret) < SECRET_BYTES_MIN for secret in found):
        raise SecretError(f"{path}: no secret of {SECRET_BYTES_MIN} bytes in hex: delete it for a new one")
    return found


def written_once(path: Path, content: bytes) -> None:
    """Write a file that its owner alone can read, whole or not at all; whoever comes second uses the first.

    Raises: OSError.
    """
    if path.exists():
        return
    part = _part(path, content)
    try:
        os.link(part, path)
    except FileExistsError:
        pass
    finally:
        part.unlink()


def written_anew(path: Path, content: bytes) -> None:
    """Write a file that its owner alone can read, whole or not at all, in the place of what is there.

    A symbolic link there is replaced, and what it leads to is left alone.  Raises: OSError.
    """
    part = _part(path, content)
    try:
        part.replace(path)
    except OSError:
        part.unlink()
        raise


def _part(path: Path, content: bytes) -> Path:
    """Return a new file beside `path` that holds all of the content, durably."""
    # Not by process number alone: containers on one volume have the same ones, and nobody foresees the name.
    part = path.with_name(f"{path.name}.{os.getpid()}-{secrets.token_hex(4)}.part")
    handle = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(handle)
    except OSError:
        part.unlink()
        raise
    return part
