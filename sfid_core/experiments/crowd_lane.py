"""A session that a simulated crowd teaches, as a batch run: no window, no events, no wire.

Every member answers every decision; the answers become one as a live aggregator makes them one, and the agent
learns from that and its probability. All chance is named by seed, session and worker, so crowds of one seed
meet the same starts, and a worker who is in two crowds errs in both alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from sfid_core.chance import stream
from sfid_core.compiled import linked
from sfid_core.crowd.online import OnlineAggregate
from sfid_core.crowd.settings import CrowdSettings
from sfid_core.experiments.batch import TRIALS_MAX, lane_world
from sfid_core.experiments.condition import tables_of
from sfid_core.experiments.greedy import greedy_share
from sfid_core.experiments.lane_world import CAP, SOLVED
from sfid_core.learning.kernels import Evidence
from sfid_core.learning.learner import Learner, learner_draws
from sfid_core.learning.methods import method_named
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.sokoban.actions import ACTIONS
from sfid_core.sokoban.live import WorldTables
from sfid_core.teaching.crowd_mix import Blind, Looking, WorkerSpec, mind_of
from sfid_core.teaching.merge import SILENCE

LAST = 5
"""Episodes at the end whose share of solved ones is told."""
MEASURED = ("success", "solved", "inputs", "labels", "accuracy", "spoken")
"""What a session comes to: the share of starts that the learnt policy alone solves; the share of the last
episodes that were solved; answers that the agent learnt from; labels that members gave; the share of the
aggregate's answers that name an optimal action, 0 where it gave none; the share of the decisions on which it
gave one."""

Minds = Sequence[tuple[str, Looking | Blind]]
"""Workers by name, and how each of them thinks."""


class _Table(NamedTuple):
    """A world as plain lists, for a loop of Python."""

    tables: WorldTables
    keys: tuple[bytes, ...]
    """Of every state; the sink's is empty."""
    optimal: list[frozenset[int]]
    successor: list[list[int]]
    reward: list[list[float]]
    outcome: list[int]
    distance: list[int]


@lru_cache(maxsize=4)
def _table(world: WorldSpec) -> _Table:
    tables = tables_of(world)
    kinds = [frozenset(a for a in range(len(ACTIONS)) if bits >> a & 1) for bits in range(1 << len(ACTIONS))]
    return _Table(
        tables,
        (*tables.state_keys, b""),
        [kinds[bits] for bits in tables.optimal_mask.tolist()],
        tables.successor.tolist(),
        tables.reward.tolist(),
        tables.outcome.tolist(),
        tables.optimal_steps.tolist(),
    )


@dataclass(slots=True)
class _Count:
    """What one session comes to."""

    decisions: int = 0
    inputs: int = 0
    labels: int = 0
    right: int = 0
    solved: int = 0


class CrowdBatch:
    """Sessions of one crowd that differ in their seed alone.

    Args: config: the session; its seed is replaced by those that are run; workers: who answers; weighing: how
    their answers become one; solver: whether naming another optimal action costs no reliability.
    Raises: ParameterError, LevelError, WorldError.
    """

    def __init__(
        self, config: SessionConfig, workers: Sequence[WorkerSpec], weighing: CrowdSettings, *, solver: bool
    ) -> None:
        self._config, self._workers, self._weighing, self._solver = config, workers, weighing, solver
        self._table = _table(config.world)

    def run(self, seed: int) -> list[float]:
        """Return `MEASURED` of the session with this seed."""
        config, table = self._config, self._table
        method, draws = method_named(config.method), learner_draws(seed, config.session)
        learner = Learner(method, config.method_parameters, len(ACTIONS), draws, config.world.steps_max)
        for key in table.keys:  # states get the numbers that the tables have
            learner.values(key)
        minds = [(worker.name, mind_of(worker, seed, config.session)) for worker in self._workers]
        aggregate = OnlineAggregate(len(ACTIONS), self._weighing)
        starts = table.tables.starts_of([seed], config.episodes)[0].tolist()
        count = _Count()
        for episode, start in enumerate(starts):
            learner.begin(episode)
            solved = self._episode(learner, aggregate, minds, start, count)
            count.solved += solved and episode >= config.episodes - LAST
        return [
            self._success(learner, seed),
            count.solved / min(LAST, config.episodes),
            count.inputs,
            count.labels,
            count.right / count.inputs if count.inputs else 0.0,
            count.inputs / count.decisions,
        ]

    def _episode(
        self, learner: Learner, aggregate: OnlineAggregate, minds: Minds, start: int, count: _Count
    ) -> bool:
        """Run an episode from state `start`; tell whether it ended with the level solved."""
        table, steps_max = self._table, self._config.world.steps_max
        state, outcome, step = start, 0, 0
        while outcome == 0:
            key, decision = table.keys[state], count.decisions
            action = learner.choose(key, decision)
            evidence = self._ask(aggregate, minds, state, count)
            count.decisions += 1
            following = table.successor[state][action]
            outcome = table.outcome[following]
            learner.learn(
                key, action, table.reward[state][action], evidence, table.keys[following],
                terminal=outcome > 0, step=step, distances=(table.distance[state], table.distance[following]),
            )  # fmt: skip
            state, step = following, step + 1
            if outcome == 0 and step >= steps_max:
                outcome = CAP
        return outcome == SOLVED

    def _ask(self, aggregate: OnlineAggregate, minds: Minds, state: int, count: _Count) -> Evidence:
        """Return what the crowd comes to, and let the aggregate learn from it whom to believe."""
        key, optimal = self._table.keys[state], self._table.optimal[state]
        labels = {name: mind.label(count.decisions, key, optimal) for name, mind in minds}
        concluded = aggregate.conclude(labels)
        aggregate.learn(labels, optimal if self._solver else None)
        count.labels += sum(label is not None for label in labels.values())
        if concluded.action is None:
            return SILENCE
        count.inputs += 1
        count.right += concluded.action in optimal
        return Evidence(given=1, label=concluded.action, belief=concluded.posterior)

    def _success(self, learner: Learner, seed: int) -> float:
        """Return the share of the seed's starts that the learnt policy alone solves."""
        steps_max = self._config.world.steps_max
        ids = self._table.tables.draw_starts(seed).ids
        trials = ids[:: -(-len(ids) // TRIALS_MAX)].tolist()
        world = lane_world(self._table.tables, steps_max, arrays=False)
        tried = linked(greedy_share, {"prefer": learner.method.prefer})
        key = stream(seed, "greedy", self._config.session)
        return tried(world, learner.memory, learner.parameters, trials, key, steps_max)
