"""A teacher's own token, kept in a file: on a command line or in the environment others could read it.

The file holds the token alone, what `sfid invite --name` printed, or what `sfid keys new` wrote: the token,
and in a second line `acknowledgements` with the key that proves the learner.
"""

import re
from pathlib import Path

from protocol.identity import TOKEN_CHARACTERS_MAX
from services.client import TeachingError

MARK = "#t="
"""Before the token in a link, as `sfid invite` prints it."""
KEY_MARK = "acknowledgements"
"""Before the key that proves the learner's acknowledgements, in 64 hex digits."""
_KEY = re.compile(rf"^{KEY_MARK} ([0-9a-f]{{64}})$", re.MULTILINE)
_READ_MAX = 16_384
"""Characters: an invitation with its QR code has some 3,000."""


def read_token(path: Path) -> str:
    """Return the token in a file that holds it alone, or what `sfid invite --name` printed.

    Raises: TeachingError with the mend; its text never holds the token.
    """
    words = _KEY.sub("", _text(path)).split()
    linked = [word.partition(MARK)[2] for word in words if MARK in word]
    token = linked[0] if linked else words[0] if len(words) == 1 else ""
    if not 0 < len(token) <= TOKEN_CHARACTERS_MAX or not token.isascii() or token.count(".") != 1:
        message = f"{path}: no token in it: write there what `sfid invite --name NAME` prints"
        raise TeachingError(message)
    return token


def read_check_key(path: Path) -> bytes | None:
    """Return the key that came with the token, by which the learner proves itself; None where none did."""
    found = _KEY.search(_text(path))
    return None if found is None else bytes.fromhex(found[1])


def _text(path: Path) -> str:
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            return file.read(_READ_MAX)
    except OSError as error:
        raise TeachingError(f"{path}: {error.strerror or error}: name a readable --token-file") from None
