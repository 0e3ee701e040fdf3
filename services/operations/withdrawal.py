"""Withdrawal: from now on a person's tokens are worth nothing, wherever services of the deployment run."""

from pathlib import Path

from protocol.identity import withdrawal_mark
from services.runtime.register import Register
from services.runtime.secret import FOLDER, NAME, load_secrets


def revoke_person(data: Path, person: str, session: str | None = None) -> bool:
    """Make every token of a person worthless, also those that are out; tell whether there can be any.

    Services that run notice within a second. What is noted does not name the person.

    Args: session: only in this one; None for all.
    Raises: SecretError.
    """
    folder = data / FOLDER
    if not (folder / NAME).exists():  # nobody was ever given a token
        return False
    register = Register(folder)
    mark = withdrawal_mark(person, session or "", tuple(load_secrets(folder)))[0]
    if mark not in register.revoked:
        register.revoke(mark)
    return True
