"""Compiled, every method has the bits that it has as Python: measures, what is learnt, the greedy policy."""

import pytest

from sfid_core.compiled import compiler_available
from sfid_core.experiments.batch import Batch, world_of
from sfid_core.learning.methods import METHODS
from sfid_core.learning.parameters import Value
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.sokoban.levels import packaged
from sfid_core.sokoban.live import tabulate
from sfid_core.teaching.kernels import TeacherParameters

EPISODES = 8
WORLD = WorldSpec(packaged("room")[0].to_xsb(), starts="all", steps_max=100)
TABLES = tabulate(world_of(SessionConfig("lab", WORLD)))
TEACHERS = {
    "ann": TeacherParameters(label_error=0.2, reward_error=0.2, silence=0.3),
    "bob": TeacherParameters(silence=0.2),
}
VARIANTS: dict[str, list[dict[str, Value]]] = {
    "advise": [{}, {"optima": "several", "temperature": 0.2}, {"estimate": "online"}],
    "advise-labels": [{}, {"estimate": "online", "prior_answers": 1.0}],
    "coach": [{}, {"trace": 0.0}, {"trace": 0.9, "delay_steps": 2.0}],
    "clone": [{"demonstrations": 4.0}],
    "dagger": [{"rounds": 6.0}, {"schedule": "power"}],
    "dpba": [{}, {"acts": "shaped"}],
    "isabl": [{}, {"error": 0.35}, {"update": "episode"}],
    "pies": [{"episodes": 6.0}, {"gamma_advice": 0.9}],
    "potential": [{}, {"form": "distance"}],
    "sfid": [{}, {"silence": "skip", "explore": 0.1}, {"omega": "centred"}],
    "sfid-memory": [{}, {"policy": "shaped", "keep": 0.7}],
    "tamer": [{"silence": "zero"}, {"silence": "decay", "credit": "previous"}, {"credit": "aggregate"}],
    "tamer-rl": [
        {},
        {"technique": "control-sharing", "explore": 0.2},
        {"technique": "control-sharing", "alone": "in-control", "anneal": 0.8},
        {"technique": "q-augmentation"},
        {"technique": "reward-shaping"},
        {"influence": "eligibility"},
    ],
}


@pytest.mark.compiler
@pytest.mark.timeout(600)  # a compilation takes ten seconds, on a busy machine a minute
@pytest.mark.skipif(not compiler_available(), reason="numba is not installed")
@pytest.mark.parametrize("method", METHODS)
def test_a_compiled_batch_has_the_bits_of_an_uncompiled_one(method: str) -> None:
    for parameters in VARIANTS.get(method, [{}]):
        config = SessionConfig("lab", WORLD, method, parameters, EPISODES)
        results = []
        for fast in (True, False):
            batch = Batch(config, TEACHERS, fast=fast, tables=TABLES)
            rows = batch.run([3, 4])
            results.append((rows.tobytes(), batch.digest(), batch.greedy_share(range(60), 5, 50)))
        assert results[0] == results[1]
