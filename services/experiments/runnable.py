"""What the runner asks of a condition."""

from collections.abc import Sequence
from typing import Any, Protocol

from sfid_core.experiments.condition import Results


class Runnable(Protocol):
    """One arm of an experiment, whoever teaches in it; it crosses processes where nothing is compiled."""

    @property
    def digest(self) -> str:
        """Return the hex SHA-256 of everything but the seeds that the results depend on."""

    @property
    def rows(self) -> int:
        """Return the number of rows a seed of its results."""

    def seeds_at_once(self, *, fast: bool) -> int:
        """Return how many seeds are best run, kept and counted together."""

    def batch(self, *, fast: bool | None = None) -> Any:  # noqa: ANN401 - each kind has its own
        """Return the condition, ready to run."""

    def run(self, batch: Any, seeds: Sequence[int]) -> Results:  # noqa: ANN401 - as above
        """Return the results of some seeds; `batch` is the condition's."""
