"""Who is better than whom, told as data: a table of orderings becomes a list of claims."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sfid_core.experiments.claims import Claim, Direction, differs
from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.intervals import Floats, Resampling
from sfid_core.experiments.summary import Arm


@dataclass(frozen=True, slots=True)
class Ordering:
    """`better` has more of a total than `worse`, both under `teacher`."""

    better: str
    worse: str
    teacher: str
    total: str = "success"

    def claim(self, columns: "Columns", resampling: Resampling) -> Claim:
        """Return the ordering as a claim; raises ExperimentError where an arm is missing."""
        return differs(
            f"with the teacher {self.teacher}, {self.better} has more {self.total} than {self.worse}",
            columns[self.better, self.teacher, self.total],
            columns[self.worse, self.teacher, self.total],
            Direction.MORE,
            resampling,
        )


@dataclass(frozen=True, slots=True)
class Robustness:
    """`better` loses less of a total than `worse` does, when `teacher` takes the place of `reference`."""

    better: str
    worse: str
    teacher: str
    reference: str
    total: str = "success"

    def claim(self, columns: "Columns", resampling: Resampling) -> Claim:
        """Return the difference of the two losses as a claim; raises as `Ordering.claim`."""
        better, worse = (
            columns[method, self.reference, self.total] - columns[method, self.teacher, self.total]
            for method in (self.better, self.worse)
        )
        change = f"from {self.reference} to {self.teacher}"
        return differs(
            f"{change}, {self.better} loses less {self.total} than {self.worse}",
            better,
            worse,
            Direction.LESS,
            resampling,
        )


class Columns:
    """The totals of all arms by (method, teacher, total)."""

    def __init__(self, arms: Sequence[Arm]) -> None:
        self._arms: Mapping[tuple[str, str], Arm] = {(arm.method, arm.teacher): arm for arm in arms}

    def __getitem__(self, key: tuple[str, str, str]) -> Floats:
        method, teacher, total = key
        arm = self._arms.get((method, teacher))
        if arm is None or total not in arm.totals:
            raise ExperimentError(
                f"the claims need {total} of the arm {method}, {teacher}: add it to the experiment"
            )
        return arm.totals[total]


def ordering_claims(
    arms: Sequence[Arm],
    orderings: Sequence[Ordering | Robustness],
    resampling: Resampling,
    *,
    simultaneous: bool = True,
) -> tuple[Claim, ...]:
    """Return a claim for each ordering, over the seeds that the arms share.

    Args: simultaneous: widen the intervals so that all claims of the table hold at once at the level given
    (Bonferroni): the more is asked of one experiment, the less each answer may be left to luck.
    Raises: ExperimentError where an arm is missing.
    """
    how = resampling.simultaneous(len(orderings)) if simultaneous else resampling
    columns = Columns(arms)
    return tuple(ordering.claim(columns, how) for ordering in orderings)
