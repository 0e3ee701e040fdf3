"""Running callbacks of others: a raise is counted, logged once for each kind, and goes no further."""

import logging
import threading
from collections.abc import Callable
from typing import TypeVar

_LOGGER = logging.getLogger(__name__)
T = TypeVar("T")


class CallbackGuard:
    """Calls callbacks and counts the ones that raised; safe from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._errors = 0
        self._logged: set[tuple[str, type[Exception]]] = set()

    @property
    def errors(self) -> int:
        """How many calls have raised."""
        return self._errors

    def call(self, what: str, receive: Callable[[T], None], argument: T) -> bool:
        """Call `receive(argument)` and return whether it did not raise; `what` names it in the log."""
        try:
            receive(argument)
        except Exception as error:  # noqa: BLE001 - a bus thread must outlive whatever a callback raises
            self._count(what, error)
            return False
        return True

    def _count(self, what: str, error: Exception) -> None:
        kind = (what, type(error))
        with self._lock:
            self._errors += 1
            first = kind not in self._logged
            self._logged.add(kind)
        if first:
            _LOGGER.error(
                "callback of %s raised (further ones of this kind are only counted)", what, exc_info=error
            )
