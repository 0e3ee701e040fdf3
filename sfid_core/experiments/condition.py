"""What an experiment compares: a session's configuration under simulated teachers, over seeds."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from hashlib import sha256

import numpy as np
import numpy.typing as npt

from sfid_core.experiments.batch import Batch
from sfid_core.experiments.lane_world import MEASURES, OUTCOMES
from sfid_core.experiments.summary import Arm, Measure
from sfid_core.learning.parameters import as_written
from sfid_core.session.config import SessionConfig
from sfid_core.teaching.kernels import TeacherParameters

Results = npt.NDArray[np.float64]
"""float64 [seeds, episodes, COLUMNS]; columns as `lane_world.MEASURES`."""


@dataclass(frozen=True, slots=True)
class Condition:
    """One arm of an experiment; the seed of `config` is replaced by each seed that is run."""

    teacher: str
    """How the teachers are called in results."""
    config: SessionConfig
    teachers: Mapping[str, TeacherParameters]

    @property
    def method(self) -> str:
        """Return the method's name."""
        return self.config.method

    @property
    def digest(self) -> str:
        """Return the hex SHA-256 of everything but the seed that the results depend on."""
        teachers = {name: as_written(one) for name, one in sorted(self.teachers.items())}
        told = (replace(self.config, seed=0), as_written(self.config.method_parameters), teachers)
        return sha256(repr(told).encode()).hexdigest()

    def batch(self, *, fast: bool | None = None) -> Batch:
        """Return the condition, ready to run; raises ParameterError, LevelError, WorldError."""
        return Batch(self.config, self.teachers, fast=fast)


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
