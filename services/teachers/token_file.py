"""A teacher's own token, kept in a file: on a command line or in the environment others could read it."""

from pathlib import Path

from protocol.identity import TOKEN_CHARACTERS_MAX
from services.client import TeachingError

MARK = "#t="
"""Before the token in a link, as `sfid invite` prints it."""
_READ_MAX = 16_384
"""Characters: an invitation with its QR code has some 3,000."""


def read_token(path: Path) -> str:
    """Return the token in a file that holds it alone, or what `sfid invite --name` printed.

    Raises: TeachingError with the mend; its text never holds the token.
    """
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            text = file.read(_READ_MAX)
    except OSError as error:
        raise TeachingError(f"{path}: {error.strerror or error}: name a readable --token-file") from None
    words = text.split()
    linked = [word.partition(MARK)[2] for word in words if MARK in word]
    token = linked[0] if linked else words[0] if len(words) == 1 else ""
    if not 0 < len(token) <= TOKEN_CHARACTERS_MAX or not token.isascii() or token.count(".") != 1:
        message = f"{path}: no token in it: write there what `sfid invite --name NAME` prints"
        raise TeachingError(message)
    return token
