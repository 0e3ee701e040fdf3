"""Who has been told that an answer is kept, and when; what a fault did to that, as a table."""

import threading
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

TICK_S = 0.05


class Tally:
    """The acknowledged answers of one teacher, in the order in which they were told; for many threads."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._told: list[tuple[float, str]] = []
        self._changed = threading.Condition()

    def add(self, answer_id: str) -> None:
        """Note that an answer is acknowledged now."""
        with self._changed:
            self._told.append((time.monotonic(), answer_id))
            self._changed.notify_all()

    @property
    def ids(self) -> list[str]:
        """Every acknowledged answer by its id."""
        with self._changed:
            return [answer_id for _, answer_id in self._told]

    def between(self, since_s: float, until_s: float) -> int:
        """Return how many were told in a span of the monotonic clock."""
        with self._changed:
            return sum(since_s <= at_s < until_s for at_s, _ in self._told)

    def first_after(self, since_s: float) -> float:
        """Return when the first one after `since_s` was told; there must be one."""
        with self._changed:
            return next(at_s for at_s, _ in self._told if at_s >= since_s)

    def wait_for(self, count: int, since_s: float, wait_s: float) -> bool:
        """Wait until so many have been told after `since_s`; tell whether they have within `wait_s`."""
        with self._changed:
            return self._changed.wait_for(
                lambda: sum(at_s >= since_s for at_s, _ in self._told) >= count, wait_s
            )


@dataclass(frozen=True, slots=True)
class Row:
    """What one fault did: how long it lasted, how long after its mend everybody was heard again."""

    service: str
    fault: str
    lasted_s: float
    back_s: float
    counts: tuple[tuple[int, int, int], ...]
    """For each teacher: acknowledged before, during and after."""


def table(tallies: Sequence[Tally], rows: Iterable[Row]) -> str:
    """Return the counts as text."""
    width = 17
    heads = "".join(f"{tally.name:>{width}}" for tally in tallies)
    lines = [f"{'':<24}{'lasted':>8}{'back in':>9}{heads}"]
    lines.append(
        f"{'service and fault':<24}{'s':>8}{'s':>9}" + f"{'before/in/after':>{width}}" * len(tallies)
    )
    for row in rows:
        counts = "".join(f"{'/'.join(map(str, count)):>{width}}" for count in row.counts)
        lines.append(f"{row.service + ' ' + row.fault:<24}{row.lasted_s:>8.1f}{row.back_s:>9.2f}{counts}")
    return "\n".join(lines)
