"""Does guidance help more in larger worlds, as Suay & Chernova 2011 found on a robot?

Square rooms with one box, the goal in the middle, from 4 x 4 to 7 x 7 cells; a perfect teacher who rewards,
who also points at two actions, and who also takes blamed steps back. The measure and the rooms are ours.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sfid_core.experiments.agreement import CENSORED, onset
from sfid_core.experiments.claims import Claim, Direction, differs, reaches
from sfid_core.experiments.condition import Condition, Results, column
from sfid_core.experiments.intervals import Floats, Interval, Resampling, exact_means, mean_interval
from sfid_core.experiments.summary import Arm
from sfid_core.learning.parameters import Value
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.teaching.personas import persona_named

SIZES = (4, 5, 6, 7)
EPISODES = 100
NEAR = 1.2
"""An episode counts as learnt when it is solved within this many times the fewest steps..."""
LASTING = 5
"""...in so many episodes in a row (both ours)."""
REWARD, GUIDED, UNDOING = "reward", "guidance", "guidance and undo"
ARMS: dict[str, tuple[str, dict[str, Value]]] = {
    REWARD: ("reward", {}),
    GUIDED: ("guidance", {"undo": "never"}),
    UNDOING: ("guidance", {"undo": "blamed"}),
}
STEPS, INPUTS, CONVERGED = "steps_to_converge", "inputs_to_converge", "converged"


def room(size: int) -> str:
    """Return a room of size x size cells, 4 or more, in XSB."""
    rows = [[" "] * size for _ in range(size)]
    rows[size // 2][size // 2] = "."
    rows[1][1] = "$"
    rows[size - 1][size - 1] = "@"
    wall = "#" * (size + 2)
    return "\n".join([wall, *(f"#{''.join(row)}#" for row in rows), wall])


def room_name(size: int) -> str:
    """Return how a room is called in results."""
    return f"{size}x{size}"


def conditions(starts: str, sizes: Sequence[int] = SIZES) -> list[Condition]:
    """Return a condition for every room and way of teaching; the room stands in the teacher's place."""
    return [
        Condition(
            room_name(size),
            SessionConfig(
                "guidance", WorldSpec(room(size), room_name(size), starts), method, given, EPISODES
            ),
            {"oracle": persona_named("oracle")},
            label=label,
        )
        for size in sizes
        for label, (method, given) in ARMS.items()
    ]


def arm(condition: Condition, results: Results) -> Arm:
    """Return what each seed needed until its episodes stayed near the fewest steps, that episode included.

    A seed that never got there counts with its whole run, a lower bound.
    """
    steps, inputs = column(results, "steps"), column(results, "inputs")
    near = (column(results, "solved") == 1) & (steps <= NEAR * column(results, "optimal_steps"))
    found = onset(near.astype(np.float64), 1.0, LASTING, Resampling(resamples=100)).episodes
    last = np.where(found == CENSORED, steps.shape[1] - 1, found)
    rows = np.arange(len(last))
    totals = {
        STEPS: np.cumsum(steps, axis=1)[rows, last],
        INPUTS: np.cumsum(inputs, axis=1)[rows, last],
        CONVERGED: (found != CENSORED).astype(np.float64),
    }
    return Arm(condition.method, condition.teacher, {}, totals)


@dataclass(frozen=True, slots=True)
class Benefit:
    """How many times fewer steps one way of teaching needs than rewards alone, in one room."""

    room: str
    method: str
    ratio: float
    """Geometric mean over seeds."""
    ci: Interval


def benefits(arms: Sequence[Arm], resampling: Resampling) -> list[Benefit]:
    """Return the benefit of each way but rewards alone in every room, in the order of the arms."""
    by_name = _by_name(arms)
    found = []
    for method, place in by_name:
        if method != REWARD:
            logs = _log_ratio(by_name, method, place)
            lo, hi = mean_interval(logs, resampling)
            ratio = float(np.exp(exact_means(logs)))
            found.append(Benefit(place, method, ratio, Interval(float(np.exp(lo)), float(np.exp(hi)))))
    return found


def claims(arms: Sequence[Arm], resampling: Resampling, sizes: Sequence[int] = SIZES) -> tuple[Claim, ...]:
    """Return whether guidance helps in every room, and whether it helps more the larger the room.

    The trend is the slope of log(benefit) over log(cells of the room), a line through each seed's rooms.
    """
    by_name, places = _by_name(arms), [room_name(size) for size in sizes]
    how = resampling.simultaneous(len(places) + 2)
    helps = [
        differs(
            f"in the room {place}, reward with guidance needs fewer steps to converge than reward",
            by_name[GUIDED, place].totals[STEPS],
            by_name[REWARD, place].totals[STEPS],
            Direction.LESS,
            how,
        ).measured_in("steps")
        for place in places
    ]
    return (*helps, *(_trend(by_name, method, sizes, how) for method in (GUIDED, UNDOING)))


def _trend(
    by_name: Mapping[tuple[str, str], Arm], method: str, sizes: Sequence[int], resampling: Resampling
) -> Claim:
    cells = np.log([float(size * size) for size in sizes])
    weights = (cells - cells.mean()) / ((cells - cells.mean()) ** 2).sum()
    logs = np.stack([_log_ratio(by_name, method, room_name(size)) for size in sizes], axis=1)
    slopes: Floats = (logs * weights).sum(axis=1)
    claim = f"the benefit of {method} grows with the room (slope of its logarithm over that of the cells)"
    return reaches(claim, slopes, 0.0, resampling)


def _by_name(arms: Sequence[Arm]) -> dict[tuple[str, str], Arm]:
    return {(one.method, one.teacher): one for one in arms}


def _log_ratio(by_name: Mapping[tuple[str, str], Arm], method: str, place: str) -> Floats:
    alone, helped = (by_name[name, place].totals[STEPS] for name in (REWARD, method))
    ratio: Floats = np.log(alone) - np.log(helped)
    return ratio
