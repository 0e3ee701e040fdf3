"""What a lane of a batch works on: the world as tables, the teachers, what is asked, what comes out."""

from collections.abc import MutableSequence, Sequence
from typing import NamedTuple

from sfid_core.sokoban.actions import ACTIONS
from sfid_core.teaching.kernels import TeacherMemory, TeacherParameters

MEASURES = (
    "steps",
    "abs_td_error",
    "abs_td_error_shaped",
    "discounted_return",
    "discounted_env_return",
    "inputs",
    "agreements",
    "outcome",
    "optimal_steps",
    "preferred",
)
"""Columns of the results, one row an episode: the founding paper's measures, the code of the outcome
(`OUTCOMES`), and the share of steps on which the agent did what its first teacher prefers."""
COLUMNS = len(MEASURES)
N_ACTIONS = len(ACTIONS)
"""A constant of the kernels, so that loops over actions are unrolled where they are compiled."""
OUTCOMES = ("running", "solved", "deadlock", "cap")
SOLVED, DEADLOCK, CAP = 1, 2, 3


class LaneWorld(NamedTuple):
    """The world as flat tables; state s and action a are at s * actions + a."""

    successor: Sequence[int]
    reward: Sequence[float]
    outcome: Sequence[int]
    """0 running, 1 solved, 2 deadlock, by state."""
    distance: Sequence[int]
    """Fewest steps to solved by state; -1 where there is no way."""
    optimal: Sequence[int]
    """Bit a set where action a begins a shortest solution, by state."""
    word: Sequence[int]
    """64 bits of each state's key."""
    steps_max: int


class LaneTeacher(NamedTuple):
    """One simulated teacher."""

    parameters: TeacherParameters
    memory: TeacherMemory


class LanePlan(NamedTuple):
    """What a lane does."""

    episodes: int
    checkpoints: Sequence[int]
    """Episodes after which the greedy policy is tried, ascending; may be none."""


class Lanes(NamedTuple):
    """What tells the lanes apart: their chance and their starts."""

    lanes: int
    ties: Sequence[int]
    """By lane, as `Draws`."""
    explore: Sequence[int]
    teachers: Sequence[int]
    """Keys of the teachers, lane by lane."""
    starts: Sequence[int]
    """States in which the episodes start, lane by lane."""
    greedy: Sequence[int]
    """By lane: the stream that breaks the ties of the greedy policy."""
    trials: Sequence[int]
    """States from which the greedy policy is tried, lane by lane, equally many each."""


class Scratch(NamedTuple):
    """Room for one decision."""

    votes: MutableSequence[float]
    one_hot: Sequence[Sequence[float]]
    """Belief in each action by label, and in none behind the last."""
