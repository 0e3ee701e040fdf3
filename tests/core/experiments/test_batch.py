"""Batch runs: what they count, and that they are a function of their arguments."""

import pytest

from sfid_core.experiments.batch import run_batch, world_of
from sfid_core.outcome import Outcome
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.session.measures import LabelCounts
from sfid_core.sokoban.levels import packaged
from sfid_core.sokoban.world import WorldError
from sfid_core.teaching.kernels import TeacherParameters

ROOM = packaged("room")[0].to_xsb()


def configured(method: str = "sfid", starts: str = "4", steps_max: int = 200, seed: int = 3) -> SessionConfig:
    return SessionConfig(
        "lab", WorldSpec(ROOM, starts=starts, steps_max=steps_max), method, episodes=8, seed=seed
    )


def experts(*names: str) -> dict[str, TeacherParameters]:
    return {name: TeacherParameters() for name in names}


def test_the_same_arguments_give_the_same_result() -> None:
    assert run_batch(configured(), experts("ann")) == run_batch(configured(), experts("ann"))


def test_every_step_of_an_expert_is_an_answer_submitted_and_applied() -> None:
    result = run_batch(configured(), experts("ann", "bob"))
    steps = sum(episode.steps for episode in result.episodes)
    assert len(result.episodes) == 8
    assert result.counts == LabelCounts(submitted=2 * steps, applied=2 * steps)
    assert sum(episode.inputs for episode in result.episodes) == 2 * steps


def test_without_teachers_sfid_learns_what_q_learning_learns() -> None:
    alone = run_batch(configured("sfid"), {})
    assert alone.q_sha256 == run_batch(configured("q-learning"), experts("ann")).q_sha256
    assert alone.counts.submitted == 0


def test_an_episode_is_cut_off_at_the_cap() -> None:
    result = run_batch(configured(steps_max=5), {})
    assert {episode.outcome for episode in result.episodes} <= set(Outcome) - {Outcome.RUNNING}
    assert max(episode.steps for episode in result.episodes) == 5
    assert Outcome.CAP in {episode.outcome for episode in result.episodes}


def test_sessions_of_one_seed_meet_the_same_starts_whatever_they_compare() -> None:
    starts = [
        [episode.optimal_steps for episode in run_batch(configured(method, "all"), experts("ann")).episodes]
        for method in ("sfid", "reward", "q-learning")
    ]
    assert starts[0] == starts[1] == starts[2]
    assert len(set(starts[0])) > 1


def test_starts_that_a_level_does_not_have_are_refused() -> None:
    with pytest.raises(WorldError):
        world_of(configured(starts="some"))
