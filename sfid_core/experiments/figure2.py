"""The founding paper's experiment: SfID and interactive reward shaping, with an expert and a naive teacher.

The paper (Raza, Johnston & Williams 2016, Figure 2) had one person in each of the four conditions, and does
not state the level, the environment's rewards or the window; level, rewards and simulated teachers are ours.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from sfid_core.experiments.agreement import agreement_totals
from sfid_core.experiments.claims import Claim
from sfid_core.experiments.condition import Condition, Results, arm_of, column
from sfid_core.experiments.founding_claims import (
    ABS_TD_ERROR_SUM,
    EXPERT,
    LABELS,
    NAIVE,
    REWARD,
    founding_claims,
)
from sfid_core.experiments.intervals import Resampling
from sfid_core.experiments.summary import Arm
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.teaching.personas import persona_named

EPISODES = 30
ANSWER_S = 1.25
"""Simulated seconds to an answer: the mean of 0.5 to 2 s (ours)."""
WINDOW_S = 2.0
"""Simulated seconds that a step without an answer waits (ours; the paper states no value)."""
AGREEMENT = 0.9
"""The agent acts as the teacher prefers when it does so on at least this share of an episode's steps..."""
LASTING = 3
"""...for this many episodes in a row (the paper's stop rule; numbers ours)."""


def conditions(world: WorldSpec, episodes: int = EPISODES) -> list[Condition]:
    """Return the four conditions, the expert's first."""
    return [
        Condition(
            teacher,
            SessionConfig("figure2", world, method, episodes=episodes),
            {teacher: persona_named(teacher)},
        )
        for teacher in (EXPERT, NAIVE)
        for method in (LABELS, REWARD)
    ]


def arm(condition: Condition, results: Results) -> Arm:
    """Return a condition's results with the totals of teaching: effort, time, answers to agreement."""
    plain = arm_of(condition, results)
    return Arm(plain.method, plain.teacher, plain.measures, totals(results))


def totals(results: Results) -> dict[str, npt.NDArray[np.float64]]:
    """Return what each seed's teaching cost: float64 [seeds] each."""
    steps, inputs = column(results, "steps"), column(results, "inputs")
    seconds = ANSWER_S * inputs + WINDOW_S * (steps - inputs)
    return {
        ABS_TD_ERROR_SUM: (column(results, "abs_td_error") * steps).mean(axis=1),
        "inputs_total": inputs.sum(axis=1),
        "teaching_time_s": seconds.sum(axis=1),
        **agreement_totals(column(results, "preferred"), inputs, AGREEMENT, LASTING),
    }


def claims(arms: Sequence[Arm], resampling: Resampling) -> tuple[Claim, ...]:
    """Return what the paper says of its figure, each claim with its interval."""
    return founding_claims(arms, resampling)


def optimal_steps(results: Sequence[Results]) -> npt.NDArray[np.float64]:
    """Return the mean of the fewest steps from the starts, by episode: float64 [episodes]."""
    means: npt.NDArray[np.float64] = column(results[0], "optimal_steps").mean(axis=0)
    return means
