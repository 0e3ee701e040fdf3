"""Circuits of praise: where an agent that is praised for walking round never has a reason to finish.

Two questions. What would the best policy for environment and teacher together do: exact, by value iteration.
And does a learning agent get there: greedy runs with a teacher who praises and seldom blames, with each cure.
Sources: Knox & Stone 2012 (positive circuits), 2015; the numbers are ours.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
import numpy.typing as npt

from sfid_core.experiments.claims import Claim, Direction, differs
from sfid_core.experiments.condition import Condition
from sfid_core.experiments.intervals import Resampling
from sfid_core.experiments.summary import Arm
from sfid_core.learning.parameters import Value
from sfid_core.mdp import StateOutcome
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.sokoban.live import WorldTables
from sfid_core.teaching.personas import persona_named

Floats = npt.NDArray[np.float64]

EPISODES = 300
GAMMAS = (0.9, 0.99)
OMEGAS = {"+1/-1": (1.0, -1.0), "+1/0": (1.0, 0.0), "0/-1": (0.0, -1.0)}
"""What the teacher's action and another one are paid."""
PRECISION = 0.05
SMALL_GOAL = 1.0
"""A goal reward as large as one answer's: what the shares of finishing are told for."""
_SETTLED = 1e-9


class Accepts(Enum):
    """What a perfect teacher holds right."""

    OPTIMAL = "any optimal action"
    NAMED = "the one they name"
    """The founding paper's Omega: the label is one action, and another one that is as good is not it."""


def answers(tables: WorldTables, praise: float, blame: float, accepts: Accepts = Accepts.OPTIMAL) -> Floats:
    """Return what a perfect teacher pays: float64 [n_states, 4], `praise` for what they hold right.

    Of several optimal actions the first is named; which one it is changes no number of the packaged room.
    """
    actions = np.arange(tables.successor.shape[1])
    mask = tables.optimal_mask.astype(np.int64)
    right = mask if accepts is Accepts.OPTIMAL else mask & -mask
    paid = np.where((right[:, np.newaxis] >> actions) & 1 == 1, praise, blame)
    paid[tables.outcome != StateOutcome.RUNNING] = 0.0
    return paid


def best_values(tables: WorldTables, rewards: Floats, gamma: float) -> Floats:
    """Return Q of the best policy for `rewards`, float64 [n_states, 4], by value iteration to 1e-9."""
    running = (tables.outcome == StateOutcome.RUNNING)[:, np.newaxis]
    values = np.zeros(tables.n_states)
    while True:
        q: Floats = np.where(running, rewards + gamma * values[tables.successor], 0.0)
        ahead = q.max(axis=1)
        if np.abs(ahead - values).max() < _SETTLED:
            return q
        values = ahead


def finishing_share(tables: WorldTables, q: Floats) -> float:
    """Return the share of solvable states from which the best actions lead to the goal.

    Of equal actions the first is taken; a way round in circles is not one to the goal.
    """
    best = (q >= q.max(axis=1, keepdims=True) - 1e-7).argmax(axis=1)
    onward = tables.successor[np.arange(tables.n_states), best]
    for _ in range(int(np.ceil(np.log2(tables.n_states))) + 1):
        onward = onward[onward]
    solvable = tables.optimal_steps > 0
    return float((tables.outcome[onward] == StateOutcome.SOLVED)[solvable].mean())


def share_with(
    tables: WorldTables,
    omega: tuple[float, float],
    gamma: float,
    goal_reward: float,
    accepts: Accepts = Accepts.OPTIMAL,
) -> float:
    """Return the share of solvable states from which the best policy finishes, at a goal reward.

    Args: tables: of a world whose step pays 0 and whose deadlocks pay nothing but the end.
    """
    solves = tables.outcome[tables.successor] == StateOutcome.SOLVED
    solves &= (tables.outcome == StateOutcome.RUNNING)[:, np.newaxis]
    paid = answers(tables, *omega, accepts)
    return finishing_share(tables, best_values(tables, paid + goal_reward * solves, gamma))


def goal_reward_min(tables: WorldTables, omega: tuple[float, float], gamma: float) -> float:
    """Return the least goal reward with which the best policy finishes from every solvable state.

    Args: tables: of a world whose step pays 0 and whose deadlocks pay nothing but the end.
    Found by bisection to `PRECISION`; 0 where none is needed. At most praise * gamma / (1 - gamma) is.
    """

    def finishes(goal_reward: float) -> bool:
        return share_with(tables, omega, gamma, goal_reward) == 1.0

    lo, hi = 0.0, bound(omega[0], 0.0, gamma) + 2 * PRECISION
    if finishes(lo):
        return 0.0
    while hi - lo > PRECISION:
        middle = (lo + hi) / 2
        lo, hi = (lo, middle) if finishes(middle) else (middle, hi)
    return hi


def bound(praise: float, step_reward: float, gamma: float) -> float:
    """Return the goal reward from which on no circuit can pay: (h + c) gamma / (1 - gamma), 0 at least.

    Finishing pays the last praise too, so what a circuit adds to it begins one step later.
    """
    return max(0.0, (praise + step_reward) * gamma / (1.0 - gamma))


@dataclass(frozen=True, slots=True)
class Case:
    """A way to learn from a teacher who praises."""

    name: str
    method: str
    parameters: Mapping[str, Value] = field(default_factory=dict)
    goal_reward: float = 10.0
    step_reward: float = 0.0
    cures: bool = True


TRAPPED = "reward, goal 10"
CASES = (
    Case("reward, goal 1", "reward", goal_reward=1.0, cures=False),
    Case(TRAPPED, "reward", cures=False),
    Case("reward, goal 100", "reward", goal_reward=100.0),
    Case("reward, goal 1, exploring", "reward", {"explore": 0.3}, goal_reward=1.0, cures=False),
    Case("reward, goal 100, exploring", "reward", {"explore": 0.3}, goal_reward=100.0),
    Case("reward, step -1", "reward", step_reward=-1.0),
    Case("reward shaping", "tamer-rl", {"technique": "reward-shaping"}, cures=False),
    Case("tamer", "tamer"),
    Case("action biasing", "tamer-rl", {"technique": "action-biasing"}),
    Case("pies", "pies"),
    Case("sfid, graded", "sfid"),
    Case("sfid, penalty", "sfid", {"omega": "penalty"}),
    Case("sfid-memory", "sfid-memory"),
)
"""Without a cure, and with each: a larger goal reward, a step that costs what praise pays, the teacher's
model kept apart from the values, advice that fades, and answers that are asked for before the action."""
TEACHER = "reward-focused"


def conditions(world: WorldSpec) -> list[Condition]:
    """Return a condition for each case, with a teacher who praises and seldom blames."""
    return [
        Condition(
            TEACHER,
            SessionConfig("circuits", _world(world, case), case.method, case.parameters, EPISODES),
            {TEACHER: persona_named(TEACHER)},
            (EPISODES,),
            case.name,
        )
        for case in CASES
    ]


def _world(world: WorldSpec, case: Case) -> WorldSpec:
    return replace(world, goal_reward=case.goal_reward, step_reward=case.step_reward)


def claims(arms: Sequence[Arm], resampling: Resampling) -> tuple[Claim, ...]:
    """Return for every cure whether it solves more than the trapped agent, all intervals at once."""
    success = {arm.method: arm.totals[f"success_{EPISODES}"] for arm in arms}
    cures = [case.name for case in CASES if case.cures]
    how = resampling.simultaneous(len(cures))
    return tuple(
        differs(
            f"with a teacher who praises and seldom blames, {name} solves more than {TRAPPED}",
            success[name],
            success[TRAPPED],
            Direction.MORE,
            how,
        ).measured_in("of the starts")
        for name in cures
    )
