"""What all tests share: kernels are compiled once for all processes of a run, and again when they change."""

import os

import pytest

from services.runtime.sources import core_digest


def pytest_configure(config: pytest.Config) -> None:
    cache: pytest.Cache | None = getattr(config, "cache", None)  # there is none with `-p no:cacheprovider`
    if cache is not None:
        os.environ.setdefault("NUMBA_CACHE_DIR", str(cache.mkdir(f"kernels-{core_digest()[:16]}")))
