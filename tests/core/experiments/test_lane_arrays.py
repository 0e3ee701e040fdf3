"""Lanes as arrays have the bits of the kernels: measures and what is learnt, for every choice they cover."""

from typing import Any

import pytest

from sfid_core.experiments.batch import Batch, runs_together, world_of
from sfid_core.experiments.lane_arrays import BLOCK, STATES_MAX
from sfid_core.learning.method import Method
from sfid_core.learning.methods import METHODS
from sfid_core.learning.parameters import Value
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.sokoban.levels import packaged
from sfid_core.sokoban.live import tabulate
from sfid_core.teaching.kernels import TeacherParameters
from sfid_core.teaching.personas import PERSONAS, persona_named

ROOM = packaged("room")[0].to_xsb()
# One push to the right solves it; every action is optimal nowhere, two are often.
CORRIDOR = "########\n#@ $ . #\n########"
SEEDS = (0, 3, 2**40, 11, 12)
COVERED = {"q-learning", "sfid", "reward"}
REMEMBERING = {"diminishing", "fatiguing", "drifting"}


def both(config: SessionConfig, teachers: dict[str, TeacherParameters]) -> list[tuple[Any, ...]]:
    tables = tabulate(world_of(config))
    found = []
    for together in (False, True):
        batch = Batch(config, teachers, fast=False, together=together, tables=tables)
        found.append((batch.run(SEEDS).tobytes(), batch.digest()))
    return found


def configured(
    method: str,
    parameters: dict[str, Value] | None = None,
    level: str = ROOM,
    world: dict[str, Any] | None = None,
) -> SessionConfig:
    spec = WorldSpec(level, **(world or {"starts": "all", "steps_max": 60}))
    return SessionConfig("arrays", spec, method, parameters or {}, episodes=7)


@pytest.mark.parametrize("teacher", sorted(set(PERSONAS) - REMEMBERING))
@pytest.mark.parametrize("method", ["sfid", "reward"])
def test_every_teacher_without_a_memory_teaches_the_same(method: str, teacher: str) -> None:
    plain, together = both(configured(method), {"ann": persona_named(teacher)})
    assert plain == together


@pytest.mark.parametrize(
    "method, parameters",
    [
        ("q-learning", {}),
        ("q-learning", {"explore": 0.3, "alpha": 0.7, "gamma": 0.5}),
        ("sfid", {"omega": "centred", "explore": 0.2}),
        ("sfid", {"omega": "penalty", "alpha": 1.0}),
        ("sfid", {"silence": "skip"}),
        ("sfid", {"silence": "skip", "explore": 1.0, "gamma": 0.99}),
        ("reward", {"explore": 0.1, "gamma": 0.0}),
    ],
)
def test_every_parameter_of_a_method_has_the_same_bits(method: str, parameters: dict[str, Value]) -> None:
    teacher = TeacherParameters(0.3, 0.2, 0.25, 0.2, 0.1, soften=0.4)
    plain, together = both(configured(method, parameters), {"ann": teacher})
    assert plain == together


@pytest.mark.parametrize("method", sorted(COVERED))
@pytest.mark.parametrize(
    "level, world",
    [
        (ROOM, {"starts": "4", "steps_max": 200}),
        (ROOM, {"starts": "1", "steps_max": 1}),
        (ROOM, {"starts": "all", "steps_max": BLOCK}),
        (CORRIDOR, {"starts": "1", "step_reward": -0.1, "deadlock_reward": -3.5}),
    ],
)
def test_every_world_has_the_same_bits(method: str, level: str, world: dict[str, Any]) -> None:
    plain, together = both(configured(method, level=level, world=world), {"ann": persona_named("naive")})
    assert plain == together


@pytest.mark.parametrize("method", ["sfid", "reward"])
def test_nobody_teaches_the_same_nothing(method: str) -> None:
    plain, together = both(configured(method), {})
    assert plain == together


def covered(method: Method, *teachers: TeacherParameters) -> bool:
    config = configured(method.name)
    named = {str(number): teacher for number, teacher in enumerate(teachers)}
    return runs_together(config, named, tabulate(world_of(config)))


def test_only_what_is_told_as_arrays_is_run_so() -> None:
    one, two = TeacherParameters(), TeacherParameters(label_error=0.1)
    assert {name for name, method in METHODS.items() if covered(method, one)} == COVERED
    assert not covered(METHODS["sfid"], one, two)
    assert not any(covered(METHODS["sfid"], persona_named(name)) for name in REMEMBERING)
    large = SessionConfig("arrays", WorldSpec(packaged("two-boxes")[0].to_xsb()), "sfid")
    tables = tabulate(world_of(large))
    assert runs_together(large, {}, tables) == (tables.n_states <= STATES_MAX)
