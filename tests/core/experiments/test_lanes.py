"""Many seeds at once: the numbers of a seed do not depend on whom it is run beside, nor on the compiler."""

import numpy as np
import pytest

from sfid_core.chance import stream
from sfid_core.compiled import compiler_available
from sfid_core.experiments import figure2, learners
from sfid_core.experiments.batch import Batch
from sfid_core.experiments.condition import Condition, results_sha256
from sfid_core.learning.parameters import ParameterError
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.sokoban.levels import packaged
from sfid_core.teaching.personas import persona_named

ROOM = packaged("room")[0].to_xsb()
WORLD = WorldSpec(ROOM, "room", "all")
SEEDS = range(6)
GOLDEN = "092e9310fcff9865a38215d3aa096f15952194ef6c5236c6d6e84baebba95208"
"""Of figure 2 on the packaged room, seeds 0 to 249; another digest is another experiment."""


def checked(method: str = "sfid", teacher: str = "noisy") -> Condition:
    (condition,) = learners.conditions(WORLD, [method], [teacher])
    return condition


def conditions() -> tuple[Condition, ...]:
    return (*figure2.conditions(WORLD), checked())


@pytest.mark.parametrize("size", [1, 2, 5])
def test_a_seed_has_the_same_results_in_a_batch_of_any_size(size: int) -> None:
    for condition in conditions():
        batch = condition.batch(fast=False)
        whole = condition.run(batch, SEEDS)
        parts = [condition.run(batch, SEEDS[first : first + size]) for first in range(0, len(SEEDS), size)]
        assert results_sha256([whole]) == results_sha256([np.concatenate(parts)])


@pytest.mark.parametrize("method", ["coach", "tamer-rl", "isabl", "marks", "sfid-memory"])
def test_what_a_method_remembers_beside_its_table_is_blank_for_each_seed(method: str) -> None:
    config = SessionConfig("lanes", WORLD, method, episodes=6)
    teachers = {"teacher": persona_named("noisy")}
    together = Batch(config, teachers, fast=False).run(SEEDS)
    alone = np.concatenate([Batch(config, teachers, fast=False).run([seed]) for seed in SEEDS])
    assert together.tolist() == alone.tolist()


@pytest.mark.compiler
@pytest.mark.timeout(600)
@pytest.mark.skipif(not compiler_available(), reason="numba is not installed")
def test_compiled_runs_have_the_same_bits() -> None:
    for condition in conditions():
        plain, fast = (condition.run(condition.batch(fast=fast), SEEDS) for fast in (False, True))
        assert results_sha256([plain]) == results_sha256([fast])


def test_the_founding_experiment_keeps_its_bits_however_it_is_run() -> None:
    world = WorldSpec(ROOM, "room")
    results = [one.run(one.batch(fast=False), range(250)) for one in figure2.conditions(world)]
    assert results_sha256(results) == GOLDEN
    plain = [Batch(one.config, one.teachers, fast=False).run(range(3)) for one in figure2.conditions(world)]
    assert results_sha256(plain) == results_sha256([one[:3] for one in results])


def test_success_at_a_checkpoint_is_that_of_a_session_that_ends_there() -> None:
    condition = checked()
    found = condition.run(condition.batch(fast=False), SEEDS)
    for place, episodes in enumerate(learners.CHECKPOINTS[:2]):
        config = SessionConfig("learners", WORLD, "sfid", episodes=episodes)
        for seed in SEEDS:
            batch = Batch(config, {"teacher": persona_named("noisy")}, fast=False)
            rows = batch.run([seed])[0]
            states = np.flatnonzero(batch.tables.optimal_steps > 0).tolist()
            success = batch.greedy_share(states, stream(seed, "greedy", "learners"), WORLD.steps_max)
            assert found[seed, place].tolist() == [success, rows[:, 5].sum(), rows[:, 0].sum()]


@pytest.mark.parametrize("checkpoints", [(9,), (0, 4), (4, 4), (5, 3), (-1,)])
def test_a_checkpoint_that_no_episode_reaches_is_refused(checkpoints: tuple[int, ...]) -> None:
    config = SessionConfig("lanes", WORLD, "sfid", episodes=8)
    with pytest.raises(ParameterError, match=r"of 8 episodes: give episodes that there are, ascending$"):
        Batch(config, {}, fast=False, checkpoints=checkpoints)
    assert Batch(config, {}, fast=False, checkpoints=(1, 8)).run_checked([1])[1].shape == (1, 2)


def test_what_another_condition_is_called_does_not_change_what_is_kept_of_it() -> None:
    plain = checked()
    assert Condition("other", plain.config, plain.teachers, plain.checkpoints, "x").digest == plain.digest
    assert Condition("other", plain.config, plain.teachers).digest != plain.digest
