"""Finished chunks of an experiment on disk."""

from collections.abc import Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

import numpy as np

from services.experiments.runnable import Runnable
from services.runtime.sources import core_digest
from sfid_core.experiments.condition import Results


class ChunkStore:
    """Results by what they depend on: the condition, its seeds and the sources of the core.

    Args: folder: where they are kept; None keeps nothing.
    A chunk is whole or not there: it is written beside its place and moved into it. One that cannot be read
    is run again.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)

    def load(self, condition: Runnable, seeds: Sequence[int]) -> Results | None:
        """Return the results of these seeds, or None when they were not kept."""
        if self._folder is None:
            return None
        with suppress(OSError, ValueError, EOFError):
            kept: Results = np.load(self._path(self._folder, condition, seeds), allow_pickle=False)
            if kept.shape[:2] == (len(seeds), condition.rows):
                return kept
        return None

    def save(self, condition: Runnable, seeds: Sequence[int], results: Results) -> None:
        """Keep the results of these seeds."""
        if self._folder is not None:
            path = self._path(self._folder, condition, seeds)
            beside = path.with_suffix(".part")
            with beside.open("wb") as file:
                np.save(file, results, allow_pickle=False)
            beside.replace(path)

    @staticmethod
    def _path(folder: Path, condition: Runnable, seeds: Sequence[int]) -> Path:
        named = f"{condition.digest} {list(seeds)} {core_digest()}"
        return folder / f"{sha256(named.encode()).hexdigest()[:32]}.npy"
