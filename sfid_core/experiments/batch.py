"""Sessions as batch runs: no window, no events, no wire, and the same bits as live sessions.

The lane kernel shares the method, the world and the teachers with a live session and nothing of the session
machine, so that equal digests say that the machine adds and drops nothing.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from sfid_core.chance import draw
from sfid_core.chance_array import Words, draws, streams
from sfid_core.compiled import compiled, compiler_available, linked
from sfid_core.experiments.greedy import greedy_share
from sfid_core.experiments.lane import key_of_one, keys_of, run_lanes
from sfid_core.experiments.lane_answers import (
    guidance_before,
    label_before,
    labels_before,
    mark_after,
    nothing_after,
    nothing_before,
    reward_after,
    rewards_after,
)
from sfid_core.experiments.lane_arrays import Together, covers, run_together
from sfid_core.experiments.lane_world import (
    COLUMNS,
    OUTCOMES,
    LanePlan,
    Lanes,
    LaneTeacher,
    LaneWorld,
    Scratch,
)
from sfid_core.learning.kernels import Memory
from sfid_core.learning.learner import table_sha256
from sfid_core.learning.method import Method
from sfid_core.learning.methods import method_named
from sfid_core.learning.parameters import ParameterError
from sfid_core.outcome import Outcome
from sfid_core.session.config import SessionConfig
from sfid_core.session.measures import EpisodeMeasures, LabelCounts
from sfid_core.sokoban.actions import ACTIONS
from sfid_core.sokoban.live import WorldTables, tabulate
from sfid_core.sokoban.world import World, WorldConfig, make_world
from sfid_core.teaching.answers import AnswerKind
from sfid_core.teaching.kernels import (
    TEACHER_SCALARS,
    TeacherMemory,
    TeacherParameters,
    preferred_of,
)
from sfid_core.teaching.merge import NOWHERE, ONE_HOT
from sfid_core.teaching.simulated import state_word

TRIALS_MAX = 1000
"""Starts from which the greedy policy is tried; of more, evenly spaced ones."""
_BEFORE: dict[AnswerKind | None, tuple[Callable[..., Any], ...]] = {
    None: (nothing_before,) * 3,
    AnswerKind.LABEL: (nothing_before, label_before, labels_before),
    AnswerKind.GUIDANCE: (nothing_before, guidance_before, guidance_before),
}
"""By what is asked before the action: what no teacher says, one, several."""
_AFTER: dict[AnswerKind | None, tuple[Callable[..., Any], ...]] = {
    None: (nothing_after,) * 3,
    AnswerKind.REWARD: (nothing_after, reward_after, rewards_after),
    AnswerKind.MISTAKE: (nothing_after, mark_after, mark_after),
}


@dataclass(frozen=True, slots=True)
class BatchResult:
    """What a batch run of one session comes to."""

    q_sha256: str
    """The digest of what was learnt, as `Learner.sha256` gives it."""
    episodes: tuple[EpisodeMeasures, ...]
    counts: LabelCounts


def world_of(config: SessionConfig) -> World:
    """Return the world that an environment runs for this session.

    Its seed is the session's own, without the session's name: sessions of one seed meet the same starts
    whatever they compare. Raises: LevelError, WorldError.
    """
    spec = config.world
    rules = WorldConfig(spec.goal_reward, spec.step_reward, spec.deadlock_reward, spec.steps_max)
    return make_world(spec.level, rules, spec.starts, config.seed)


def runs_together(
    config: SessionConfig, teachers: Mapping[str, TeacherParameters], tables: WorldTables
) -> bool:
    """Tell whether sessions can be run as arrays, all seeds at once; the greedy policy is not tried there."""
    return covers(method_named(config.method), tuple(teachers.values()), tables.n_states)


def _check(checkpoints: Sequence[int], episodes: int) -> None:
    ascending = all(first < then for first, then in pairwise((0, *checkpoints, episodes + 1)))
    if not ascending:
        told = ", ".join(map(str, checkpoints))
        raise ParameterError(
            f"checkpoints {told} of {episodes} episodes: give episodes that there are, ascending"
        )


class Batch:
    """Sessions that differ in their seed alone, run one after the other.

    Args: config: the session; its seed is replaced by those that are run; teachers: by the name under which
    they would join; fast: compile the kernels (the default where numba is installed); together: run all seeds
    at once as arrays where nothing is compiled and `runs_together` says so; tables: those of the session's
    world, where they have been made before; checkpoints: episodes, ascending, after which the greedy policy
    is tried from the starts of the seed, `TRIALS_MAX` at most.
    Raises: ParameterError, LevelError, WorldError.
    """

    def __init__(
        self,
        config: SessionConfig,
        teachers: Mapping[str, TeacherParameters],
        *,
        fast: bool | None = None,
        together: bool = False,
        tables: WorldTables | None = None,
        checkpoints: Sequence[int] = (),
    ) -> None:
        self._config = config
        self._names = sorted(teachers)
        self._fast = compiler_available() if fast is None else fast
        self._method = method_named(config.method)
        self._parameters = config.method_parameters
        self.tables = tabulate(world_of(config)) if tables is None else tables
        _check(checkpoints, config.episodes)
        covered = not checkpoints and runs_together(config, teachers, self.tables)
        self._together = together and not self._fast and covered
        self._arrays = self._fast or self._together
        self._world = lane_world(self.tables, config.world.steps_max, arrays=self._arrays)
        nobody = [TeacherParameters(silence=1.0)]
        parameters = [teachers[name] for name in self._names] or nobody
        self._teachers = tuple(LaneTeacher(one, self._teacher_memory(one)) for one in parameters)
        self._checkpoints = tuple(checkpoints)
        self._plan = LanePlan(
            config.episodes,
            self._column(np.array(self._checkpoints, dtype=np.int64)),
        )
        self._memory = blank_memory(
            self._method, self.tables.n_states, len(ACTIONS), config.world.steps_max, self._zeros
        )
        beliefs = (*ONE_HOT[len(ACTIONS)], NOWHERE[len(ACTIONS)])
        one_hot: Any = np.array(beliefs) if self._arrays else beliefs
        self._scratch = Scratch(self._zeros(len(ACTIONS)), one_hot)
        self._run, self._greedy = _kernels(self._method, len(self._names), fast=self._fast)

    def run(self, seeds: Sequence[int]) -> npt.NDArray[np.float64]:
        """Run one session a seed; return float64 [seeds, episodes, COLUMNS] (`lane_world.MEASURES`)."""
        return self.run_checked(seeds)[0]

    def run_checked(self, seeds: Sequence[int]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Run one session a seed; return what `run` does, and the success at the checkpoints.

        Returns also: float64 [seeds, checkpoints], the share of a seed's trials from which the policy alone
        solves the level within the step cap.
        """
        config = self._config
        shape = (len(seeds), config.episodes, COLUMNS)
        checked = (len(seeds), len(self._checkpoints))
        out, success = self._room(math.prod(shape)), self._room(math.prod(checked))
        if self._together:
            self._run_together(seeds, out)
            return out.reshape(shape), success.reshape(checked)
        self._run(
            self._world,
            self._plan,
            self._memory,
            self._parameters,
            self._teachers,
            self._lanes(seeds),
            self._scratch,
            self._parameters.gamma,
            out,
            success,
        )
        return np.asarray(out, dtype=np.float64).reshape(shape), np.asarray(success).reshape(checked)

    def _run_together(self, seeds: Sequence[int], out: npt.NDArray[np.float64]) -> None:
        teacher = self._teachers[0].parameters if self._names else None
        lanes, episodes = self._lanes(seeds), self._config.episodes
        batch = Together(self._world, self._method.name, self._parameters, teacher, lanes, episodes)
        self._memory.values[:] = run_together(batch, out)

    def _teacher_memory(self, parameters: TeacherParameters) -> TeacherMemory:
        praised = self.tables.n_states * len(ACTIONS) if parameters.diminishing else 0
        return TeacherMemory(self._zeros(TEACHER_SCALARS), self._zeros(praised))

    def _lanes(self, seeds: Sequence[int]) -> Lanes:
        session, column, told = self._config.session, self._column, tuple(seeds)
        ties, explore = _draws_of(told, session)
        return Lanes(
            len(seeds),
            column(ties),
            column(explore),
            column(_teacher_keys(told, tuple(self._names or ("",)), session)),
            column(_starts_of(self.tables, told, self._config.episodes).astype(np.uint32)),
            column(_greedy_keys(told if self._checkpoints else (), session)),
            column(self._trials(seeds)),
        )

    def _trials(self, seeds: Sequence[int]) -> npt.NDArray[np.int32]:
        if not self._checkpoints:
            return np.zeros(0, dtype=np.int32)
        drawn = [self.tables.draw_starts(seed).ids for seed in seeds]
        return np.concatenate([ids[:: -(-len(ids) // TRIALS_MAX)] for ids in drawn])

    def _room(self, count: int) -> Any:  # noqa: ANN401 - a list or an array, written all over
        return np.empty(count) if self._arrays else [0.0] * count

    def _zeros(self, count: int) -> Any:  # noqa: ANN401 - a list or an array
        return np.zeros(count) if self._arrays else [0.0] * count

    def _column(self, numbers: npt.NDArray[Any]) -> Any:  # noqa: ANN401 - a list or an array
        return numbers if self._arrays else numbers.tolist()

    def digest(self) -> str:
        """Return the digest of what the latest session learnt."""
        numbers = {key: number for number, key in enumerate(self.tables.state_keys)}
        return table_sha256(numbers, list(self._memory.values), self._memory.width)

    def greedy_share(self, states: Sequence[int], key: int, steps_max: int) -> float:
        """Return the share of states from which the latest session's policy alone solves the level."""
        key_word = np.uint64(key) if self._fast else key
        share: float = self._greedy(
            self._world,
            self._memory,
            self._parameters,
            self._column(np.array(states, dtype=np.int32)),
            key_word,
            steps_max,
        )
        return share


# Conditions of one experiment share their seeds, and naming a stream costs as much as thirty steps. The names
# are those of `learner_draws` and `teacher_key`, here for many seeds at once.


@lru_cache(maxsize=512)
def _draws_of(seeds: tuple[int, ...], session: str) -> tuple[Words, Words]:
    keys = streams(seeds, "learner", session)
    return draws(keys, 0), draws(keys, 1)


@lru_cache(maxsize=512)
def _teacher_keys(seeds: tuple[int, ...], names: tuple[str, ...], session: str) -> Words:
    return np.stack([streams(seeds, "teacher", name, session) for name in names], axis=1).reshape(-1)


@lru_cache(maxsize=512)
def _greedy_keys(seeds: tuple[int, ...], session: str) -> Words:
    return streams(seeds, "greedy", session)


@lru_cache(maxsize=512)
def _starts_of(tables: WorldTables, seeds: tuple[int, ...], episodes: int) -> npt.NDArray[np.int32]:
    return tables.starts_of(seeds, episodes).reshape(-1)


def run_batch(
    config: SessionConfig, teachers: Mapping[str, TeacherParameters], *, fast: bool | None = None
) -> BatchResult:
    """Run the session from its first episode to its last and return what was learnt.

    Args: as of `Batch`; the window and `teachers_min` of the configuration do not matter here, for nobody is
    waited for.
    Raises: ParameterError, LevelError, WorldError.
    """
    batch = Batch(config, teachers, fast=fast)
    rows = batch.run([config.seed])[0].tolist()
    inputs = sum(int(row[5]) for row in rows)
    counts = LabelCounts(submitted=inputs, applied=inputs)
    episodes = tuple(episode_measures(number, row) for number, row in enumerate(rows))
    return BatchResult(batch.digest(), episodes, counts)


def episode_measures(episode: int, row: Sequence[float]) -> EpisodeMeasures:
    """Return one row of a lane's results as the measures of an episode."""
    steps, td, td_shaped, total, env_total, inputs, agreements, outcome, optimal, _ = row
    return EpisodeMeasures(
        episode,
        int(steps),
        int(optimal) if optimal >= 0 else None,
        td,
        td_shaped,
        total,
        env_total,
        int(inputs),
        int(agreements),
        Outcome(OUTCOMES[int(outcome)]),
    )


def blank_memory(
    method: Method, states: int, actions: int, steps_max: int, zeros: Callable[[int], Any]
) -> Memory:
    """Return a learner's memory of a table world before its first step."""
    return Memory(
        zeros(states * method.width(actions)),
        zeros(method.scalars),
        zeros(steps_max * method.trail),
        actions,
        method.width(actions),
    )


@lru_cache(maxsize=64)
def _kernels(method: Method, teachers: int, *, fast: bool) -> tuple[Callable[..., int], Callable[..., float]]:
    asked = min(teachers, 2)
    parts: dict[str, Any] = {
        "choose": method.choose,
        "settle": method.settle,
        "learn": method.learn,
        "begin": method.begin,
        "undo": method.undo,
        "prefer": method.prefer,
        "said_before": _BEFORE[method.asks_before][asked],
        "said_after": _AFTER[method.asks_after][asked],
        "keys_of": keys_of if asked > 1 else key_of_one,
        "WIDTH": method.width(len(ACTIONS)),
    }
    policy = {"prefer": method.prefer}
    if not fast:
        # Python pays for every call: what a teacher always draws and answers alike is remembered.
        same = {"draw": lru_cache(1 << 16)(draw), "preferred_of": lru_cache(1 << 16)(preferred_of)}
        return linked(run_lanes, parts | same), linked(greedy_share, policy)
    name = f"{method.name}_{('alone', 'one', 'several')[asked]}"
    return compiled(run_lanes, parts, name), compiled(greedy_share, policy, method.name)


@lru_cache(maxsize=8)
def lane_world(tables: WorldTables, steps_max: int, *, arrays: bool) -> LaneWorld:
    """Return the tables as kernels read them: arrays where they are compiled, lists where not.

    States are unsigned, for then an index costs no look whether it counts from the end.
    """
    words = [state_word(key) for key in tables.state_keys]
    words += [0] * (tables.n_states - len(words))

    def column(numbers: npt.NDArray[Any]) -> Any:  # noqa: ANN401 - a list or an array
        return numbers if arrays else numbers.tolist()

    return LaneWorld(
        column(tables.successor.reshape(-1).astype(np.uint32)),
        column(tables.reward.reshape(-1)),
        column(tables.outcome),
        column(tables.optimal_steps),
        column(tables.optimal_mask.astype(np.int64)),
        column(np.array(words, dtype=np.uint64)),
        steps_max,
    )
