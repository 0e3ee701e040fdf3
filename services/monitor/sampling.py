"""The rule by which rows are left out: by the session's own time, never by how fast somebody watches.

So a recording made live, one made again from the journal, and one made by a monitor that was restarted hold
the same rows, and a learner at 10,000 steps a second costs a watcher no more than one at 20.
"""

MS = 1_000_000
PICTURE_MS = 100
"""Steps nobody spoke to, closer than this to the last picture, have none."""
SPOKEN_PICTURE_MS = 50
"""The same for steps somebody spoke to: people cannot answer faster, scripts can."""
POLICY_MS = 500
AGREEMENT_MS = 100
LABELS_MS = 20
"""Of one teacher's lane."""
RELIABILITY_MS = 1_000
DOUBTS_MS = 5_000
EPISODE_LINE_MS = 200
"""Lines of the event log about episodes; the curves hold every episode."""
TABLE_MS = 2_000
"""The table of the latest episodes."""
LIVE_POINT_MS = 50
"""Points of a curve that are sent to viewers; recordings hold every episode."""


class Pace:
    """Of rows closer together than `gap_ms` the first is kept."""

    __slots__ = ("_gap_ns", "_last_ns")

    def __init__(self, gap_ms: int) -> None:
        self._gap_ns = gap_ms * MS
        self._last_ns: int | None = None

    def due(self, at_ns: int) -> bool:
        """Tell whether a row of this time is kept; one from before the last is, because a clock was set."""
        if self._last_ns is not None and 0 <= at_ns - self._last_ns < self._gap_ns:
            return False
        self._last_ns = at_ns
        return True
