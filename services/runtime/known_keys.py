"""Which keys a bus has made known to its router, so that it need not look their way up with each message."""

from collections.abc import Callable
from typing import Generic, TypeVar

K = TypeVar("K")

KNOWN_KEYS_MAX = 32_768
"""Keys that are counted and made known; the router remembers them as long as the connection lasts."""
USES_TO_KNOW = 8
"""Uses after which a key is made known: to route what comes by name, Zenoh looks at all keys it knows, so it
had better not know those of sessions that nobody teaches."""


class KnownKeys(Generic[K]):
    """Keys by name and, once they are in use, as what `declare` makes of them.

    For Zenoh that is a number on the wire. Under a declared key the ways are found once, else anew for each
    message, here and in the router: a put that nobody hears takes 50 us instead of 2, a query 110 instead of
    35, with 1,000 sessions.
    """

    def __init__(self, declare: Callable[[str], K]) -> None:
        self._declare = declare
        self._declared: dict[str, K] = {}
        self._uses: dict[str, int] = {}

    def use(self, key: str) -> str | K:
        """Return what to send a message to that key under."""
        declared = self._declared.get(key)
        if declared is not None:
            return declared
        uses = self._uses.get(key, 0)
        if uses == USES_TO_KNOW:
            made = self._declared[key] = self._declare(key)
            return made
        if uses or len(self._uses) < KNOWN_KEYS_MAX:
            self._uses[key] = uses + 1
        return key
