"""How many messages of one sender may wait for a loop: whoever floods holds up mostly themselves."""

import threading


class Turnstile:
    """Counts what waits, by sender; `enter` on any thread, `leave` wherever the message is taken.

    Without it a loop that serves in order of arrival would serve a flood first, and everybody behind it.
    """

    def __init__(self, each_max: int) -> None:
        self._each_max = each_max
        self._waiting: dict[str, int] = {}
        self._lock = threading.Lock()
        self.refused = 0
        """Messages that were sent away since the start."""

    def enter(self, sender: str) -> bool:
        """Tell whether one more message of this sender may wait; if so, it is counted until `leave`."""
        with self._lock:
            waiting = self._waiting.get(sender, 0)
            if waiting >= self._each_max:
                self.refused += 1
                return False
            self._waiting[sender] = waiting + 1
            return True

    def leave(self, sender: str) -> None:
        """Take one message of this sender off the count."""
        with self._lock:
            waiting = self._waiting.get(sender, 0)
            if waiting > 1:
                self._waiting[sender] = waiting - 1
            else:
                self._waiting.pop(sender, None)
