"""What all tests share: kernels are compiled once for all processes of a run, and again when they change."""

import os

import pytest

from services.runtime.sources import core_digest


def pytest_configure(config: pytest.Config) -> None:
    kept = config.cache.mkdir(f"kernels-{core_digest()[:16]}") if config.cache else None
    if kept is not None:
        os.environ.setdefault("NUMBA_CACHE_DIR", str(kept))
