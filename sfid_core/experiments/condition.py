"""What an experiment compares: a session's configuration under simulated teachers, over seeds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from hashlib import sha256

import numpy as np
import numpy.typing as npt

from sfid_core.experiments.batch import Batch, runs_together, world_of
from sfid_core.experiments.lane_world import MEASURES, OUTCOMES
from sfid_core.experiments.summary import Arm, Measure
from sfid_core.learning.parameters import as_written
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.sokoban.live import WorldTables, tabulate
from sfid_core.teaching.kernels import TeacherParameters

Results = npt.NDArray[np.float64]
"""float64 [seeds, episodes, COLUMNS], columns as `lane_world.MEASURES`; of a condition with checkpoints
[seeds, checkpoints, 3], columns as `CHECKED`."""
CHECKED = ("success", "inputs", "steps")
"""At a checkpoint: the share of starts that the greedy policy solves, the answers and steps until then."""

SEEDS_AT_ONCE, SEEDS_COMPILED, SEEDS_AS_ARRAYS = 50, 250, 1000
"""So that an interrupted run has lost seconds, all cores have work, and calls cost little beside it."""


@dataclass(frozen=True, slots=True)
class Condition:
    """One arm of an experiment; the seed of `config` is replaced by each seed that is run."""

    teacher: str
    """How the teachers are called in results."""
    config: SessionConfig
    teachers: Mapping[str, TeacherParameters]
    checkpoints: tuple[int, ...] = ()
    """Episodes, ascending, after which the greedy policy is tried; none: all episodes' measures are kept."""
    label: str = ""
    """How the method is called in results, where it is not its name: a variant of it."""

    @property
    def method(self) -> str:
        """Return how the method is called in results."""
        return self.label or self.config.method

    @property
    def rows(self) -> int:
        """Return the number of rows a seed of its results."""
        return len(self.checkpoints) or self.config.episodes

    @property
    def digest(self) -> str:
        """Return the hex SHA-256 of everything but the seed that the results depend on."""
        teachers = {name: as_written(one) for name, one in sorted(self.teachers.items())}
        told = (
            replace(self.config, seed=0),
            as_written(self.config.method_parameters),
            teachers,
            self.checkpoints,
        )
        return sha256(repr(told).encode()).hexdigest()

    def seeds_at_once(self, *, fast: bool) -> int:
        """Return how many seeds are best run, kept and counted together; results do not depend on it."""
        if fast:
            return SEEDS_COMPILED
        tables = tables_of(replace(self.config.world, level_name=""))
        together = not self.checkpoints and runs_together(self.config, self.teachers, tables)
        return SEEDS_AS_ARRAYS if together else SEEDS_AT_ONCE

    def batch(self, *, fast: bool | None = None) -> Batch:
        """Return the condition, ready to run; raises ParameterError, LevelError, WorldError."""
        tables = tables_of(replace(self.config.world, level_name=""))
        return Batch(
            self.config,
            self.teachers,
            fast=fast,
            together=True,
            tables=tables,
            checkpoints=self.checkpoints,
        )

    def run(self, batch: Batch, seeds: Sequence[int]) -> Results:
        """Return the results of some seeds; `batch` is the condition's."""
        results, success = batch.run_checked(seeds)
        if not self.checkpoints:
            return results
        last = [episodes - 1 for episodes in self.checkpoints]
        sums = [np.cumsum(column(results, name), axis=1)[:, last] for name in CHECKED[1:]]
        return np.stack([success, *sums], axis=2)


@lru_cache(maxsize=8)
def tables_of(world: WorldSpec) -> WorldTables:
    """Return the tables of a world, which all its conditions share whatever their seeds."""
    return tabulate(world_of(SessionConfig("tables", world)))


def column(results: Results, name: str) -> npt.NDArray[np.float64]:
    """Return one of `lane_world.MEASURES` or "solved" (1 or 0): float64 [seeds, episodes]."""
    if name == "solved":
        outcomes: npt.NDArray[np.float64] = results[:, :, MEASURES.index("outcome")]
        return np.equal(outcomes, OUTCOMES.index("solved")).astype(np.float64)
    found: npt.NDArray[np.float64] = results[:, :, MEASURES.index(name)]
    return found


def arm_of(condition: Condition, results: Results) -> Arm:
    """Return the results of a condition for summaries and claims."""
    measures = {measure: column(results, measure.value) for measure in Measure}
    return Arm(condition.method, condition.teacher, measures)


def results_sha256(results: list[Results]) -> str:
    """Return the hex SHA-256 over all results: float64 little-endian, condition by condition."""
    digest = sha256()
    for table in results:
        digest.update(np.ascontiguousarray(table, dtype="<f8").tobytes())
    return digest.hexdigest()
