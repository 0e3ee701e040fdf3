"""Compiles what the tests marked `compiler` need, beside all the others: with two cores nobody waits for it.

NUMBA_CACHE_DIR=DIR python -m tests.core.experiments.compile_ahead
"""

import os

from sfid_core.experiments.batch import Batch
from sfid_core.learning.methods import METHODS
from sfid_core.session.config import SessionConfig
from tests.core.experiments import test_compiled_methods as several
from tests.core.experiments import test_lanes as alone

LESS_URGENT_THAN_TESTS = 5


def main() -> None:
    """Run every batch once; numba keeps the machine code where `NUMBA_CACHE_DIR` says."""
    os.nice(LESS_URGENT_THAN_TESTS)
    for condition in alone.conditions():
        condition.run(condition.batch(fast=True), [0])
    for method in METHODS:
        config = SessionConfig("ahead", several.WORLD, method, {}, 1)
        batch = Batch(config, several.TEACHERS, fast=True, tables=several.TABLES)
        batch.run([0])
        batch.greedy_share(range(1), 0, 1)


if __name__ == "__main__":
    main()
