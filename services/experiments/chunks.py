"""Finished chunks of an experiment on disk."""

import os
from collections.abc import Sequence
from contextlib import suppress
from hashlib import sha256
from io import BytesIO
from pathlib import Path

import numpy as np

from services.experiments.runnable import Runnable
from services.runtime.sources import core_digest
from sfid_core.experiments.condition import Results

_DIGEST_SIZE = 32


class ChunkStore:
    """Results by what they depend on: the condition, its seeds and the sources of the core.

    Args: folder: where they are kept; None keeps nothing.
    A chunk is whole or not there: it is written beside its place and moved into it, under a name of the
    process's own, for two may share a folder. Its SHA-256 stands behind it: one that is not what was kept is
    run again.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)

    def load(self, condition: Runnable, seeds: Sequence[int]) -> Results | None:
        """Return the results of these seeds, or None when they were not kept."""
        if self._folder is None:
            return None
        with suppress(OSError):
            kept = self._path(self._folder, condition, seeds).read_bytes()
            body, digest = kept[:-_DIGEST_SIZE], kept[-_DIGEST_SIZE:]
            if sha256(body).digest() == digest:
                results: Results = np.load(BytesIO(body), allow_pickle=False)
                return results
        return None

    def save(self, condition: Runnable, seeds: Sequence[int], results: Results) -> None:
        """Keep the results of these seeds."""
        if self._folder is not None:
            path = self._path(self._folder, condition, seeds)
            beside = path.with_suffix(f".{os.getpid()}.part")
            body = BytesIO()
            np.save(body, results, allow_pickle=False)
            beside.write_bytes(body.getvalue() + sha256(body.getvalue()).digest())
            beside.replace(path)

    @staticmethod
    def _path(folder: Path, condition: Runnable, seeds: Sequence[int]) -> Path:
        named = f"{condition.digest} {list(seeds)} {core_digest()}"
        return folder / f"{sha256(named.encode()).hexdigest()[:32]}.npy"
