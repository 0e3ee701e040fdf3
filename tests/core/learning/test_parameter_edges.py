"""The edges of every parameter's range are as good as what is between them; what is no number is refused."""

import math

import pytest

from sfid_core.experiments.batch import Batch, world_of
from sfid_core.learning.methods import METHODS, method_parameters
from sfid_core.learning.parameters import Choice, ParameterError, Range, Value, limits
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.sokoban.levels import packaged
from sfid_core.sokoban.live import tabulate
from sfid_core.teaching.kernels import TeacherParameters

WORLD = WorldSpec(packaged("room")[0].to_xsb(), starts="all", steps_max=30)
TABLES = tabulate(world_of(SessionConfig("edges", WORLD)))
TEACHERS = {"ann": TeacherParameters(0.2, 0.2, 0.3), "bob": TeacherParameters(silence=0.2)}


def edges(allowed: Range | Choice) -> tuple[Value, ...]:
    """Return the outermost values that are allowed, or every word."""
    if isinstance(allowed, Choice):
        return allowed.words
    low = math.nextafter(allowed.low, math.inf) if allowed.above else allowed.low
    high = math.nextafter(allowed.high, -math.inf) if allowed.below else allowed.high
    return low, high


@pytest.mark.parametrize("method", METHODS)
def test_at_the_edges_of_its_ranges_a_method_learns_finite_numbers(method: str) -> None:
    for name, allowed in limits(METHODS[method].parameters).items():
        for value in edges(allowed):
            config = SessionConfig("edges", WORLD, method, {name: value}, 4)
            batch = Batch(config, TEACHERS, fast=False, tables=TABLES)
            rows = batch.run([1, 2])
            assert all(map(math.isfinite, rows.ravel().tolist())), (name, value)
            assert 0 <= batch.greedy_share(range(20), 5, 30) <= 1


@pytest.mark.parametrize("method", METHODS)
def test_beyond_the_edges_and_beside_the_numbers_a_value_is_refused_by_name(method: str) -> None:
    for name, allowed in limits(METHODS[method].parameters).items():
        wrong: list[Value] = [math.nan, math.inf, -math.inf, "", "nan", "0.5"]
        if isinstance(allowed, Range):
            wrong.append(allowed.low if allowed.above else math.nextafter(allowed.low, -math.inf))
            wrong.append(allowed.high if allowed.below else math.nextafter(allowed.high, math.inf))
        for value in wrong:
            with pytest.raises(ParameterError, match=f"^{name} [^\n]+$"):
                method_parameters(method, {name: value})


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("teachers", [0, 1, 10])
def test_one_episode_of_one_step_is_a_session_however_many_teach(method: str, teachers: int) -> None:
    world = WorldSpec(WORLD.level, starts="all", steps_max=1)
    many = {f"t{number}": TEACHERS["ann"] for number in range(teachers)}
    config = SessionConfig("edges", world, method, episodes=1)
    rows, success = Batch(config, many, fast=False, tables=TABLES, checkpoints=(1,)).run_checked([1, 2])
    assert rows[:, :, 0].tolist() == [[1.0], [1.0]]
    assert all(map(math.isfinite, rows.ravel().tolist()))
    assert success.shape == (2, 1)
