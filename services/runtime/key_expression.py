"""Zenoh key expressions as pure functions: what is well formed, and which expression matches which key."""

import re
from functools import lru_cache

# The characters that Zenoh gives a meaning in a key expression or a selector.
_NOT_IN_A_KEY = re.compile(r"[*$?#]")
_CHUNK = re.compile(r"\*\*|\*|(?:\$\*)?(?:[^*$?#/]+(?:\$\*)?)+")
_NOT_CANONICAL = re.compile(r"(?:^|/)\*\*/\*\*?(?:/|$)")


@lru_cache(maxsize=4096)
def checked_key(key: str) -> str:
    """Return `key` when it is concrete and well formed; ValueError says why not."""
    if _NOT_IN_A_KEY.search(key):
        message = f"key {key!r} holds one of * $ ? #: messages go to concrete keys"
        raise ValueError(message)
    return checked_key_expression(key)


@lru_cache(maxsize=4096)
def checked_key_expression(key_expression: str) -> str:
    """Return `key_expression` when it is well formed; ValueError says why not."""
    for chunk in key_expression.split("/"):
        if not chunk:
            message = (
                f"key {key_expression!r} has an empty chunk: write a/b/c without a leading or trailing slash"
            )
            raise ValueError(message)
        if not _CHUNK.fullmatch(chunk):
            message = (
                f"key {key_expression!r}: chunk {chunk!r} may be *, ** or text with $*, and no other * $ ? #"
            )
            raise ValueError(message)
    if _NOT_CANONICAL.search(key_expression):
        message = f"key {key_expression!r}: write */** for **/* and ** for **/**"
        raise ValueError(message)
    return key_expression


@lru_cache(maxsize=4096)
def matches(key_expression: str, key: str) -> bool:
    """Whether the concrete `key` is one of those that `key_expression` stands for."""
    return _pattern(key_expression).fullmatch(f"/{key}") is not None


@lru_cache(maxsize=4096)
def _pattern(key_expression: str) -> re.Pattern[str]:
    return re.compile("".join(_chunk_pattern(chunk) for chunk in key_expression.split("/")))


def _chunk_pattern(chunk: str) -> str:
    # The key is matched with a slash before every chunk, so that `**` may stand for no chunk at all.
    if chunk == "**":
        return r"(?:/(?!@)[^/]+)*"
    if chunk == "*":
        return r"/(?!@)[^/]+"
    if chunk.startswith("@"):
        return f"/{re.escape(chunk)}"
    parts = "[^/]*".join(re.escape(part) for part in chunk.split("$*"))
    return f"/(?!@){parts}" if chunk.startswith("$*") else f"/{parts}"


class KeyIndex:
    """Key expressions, found by the concrete keys that they stand for; each may be in it several times."""

    def __init__(self) -> None:
        self._by_beginning: dict[str, tuple[str, ...]] = {}

    def add(self, key_expression: str) -> None:
        """Put it in."""
        beginning = _beginning(key_expression)
        self._by_beginning[beginning] = (*self._by_beginning.get(beginning, ()), key_expression)

    def remove(self, key_expression: str) -> None:
        """Take it out once; ValueError where it is not in it."""
        beginning = _beginning(key_expression)
        left = list(self._by_beginning.get(beginning, ()))
        left.remove(key_expression)
        if left:
            self._by_beginning[beginning] = tuple(left)
        else:
            del self._by_beginning[beginning]

    def __contains__(self, key: str) -> bool:
        """Whether some expression stands for the concrete `key`."""
        if not self._by_beginning:
            return False
        chunks = key.split("/")
        return any(
            matches(key_expression, key)
            for length in range(len(chunks) + 1)
            for key_expression in self._by_beginning.get("/".join(chunks[:length]), ())
        )


def _beginning(key_expression: str) -> str:
    chunks = key_expression.split("/")
    fixed = next((at for at, chunk in enumerate(chunks) if "*" in chunk), len(chunks))
    return "/".join(chunks[:fixed])
