"""Virtual time: a clock that jumps from one appointment to the next, so that hours pass in milliseconds."""

import heapq
from collections.abc import Callable
from random import Random

from services.runtime.clock import ManualClock


class Timeline(ManualClock):
    """A clock with its appointments; what is due at one moment runs in the order in which it was set."""

    def __init__(self, wall_ns: int = 0) -> None:
        super().__init__(wall_ns=wall_ns)
        self.happened = 0
        """Appointments kept so far."""
        self._appointments: list[tuple[int, int, Callable[[], None]]] = []
        self._set = 0

    def jump(self, span_ns: int) -> None:
        """Set the time that is shown to people, as an administrator does; spans are measured as before."""
        self._wall_ns += span_ns

    def call_at(self, at_ns: int, call: Callable[[], None]) -> None:
        """Call `call()` at `at_ns`, or next of all when that has passed."""
        self._set += 1
        heapq.heappush(self._appointments, (at_ns, self._set, call))

    def call_in(self, span_ns: int, call: Callable[[], None]) -> None:
        """Call `call()` after `span_ns`."""
        self.call_at(self.now_ns() + span_ns, call)

    def step(self) -> bool:
        """Go to the next appointment and keep it; False when there is none."""
        if not self._appointments:
            return False
        at_ns, _, call = heapq.heappop(self._appointments)
        if at_ns > self._now_ns:  # `advance`, at every one of millions of appointments
            self._wall_ns += at_ns - self._now_ns
            self._now_ns = at_ns
        self.happened += 1
        call()
        return True


def dice(seed: int, *names: str) -> Random:
    """Return the stream of chance that belongs to these names: who draws from it disturbs nobody else."""
    return Random(f"{seed}/{'/'.join(names)}")  # noqa: S311 - repetition is wanted, not secrecy
