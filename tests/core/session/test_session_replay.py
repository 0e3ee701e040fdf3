"""One truth three times: live session, replay of its journal, and batch run agree bit for bit."""

from collections.abc import Sequence
from dataclasses import replace
from random import Random

import pytest

from sfid_core.experiments.batch import run_batch
from sfid_core.learning.methods import METHODS
from sfid_core.session.config import SessionConfig, Window, WindowMode, WorldSpec
from sfid_core.session.machine import replay
from sfid_core.session.state import new_session
from sfid_core.sokoban.levels import packaged
from sfid_core.teaching.kernels import TeacherParameters
from sfid_core.teaching.simulated import SimulatedTeacher
from tests.core.session.live import Live
from tests.core.session.script import snapshot

WORLD = WorldSpec(packaged("room")[0].to_xsb(), starts="4")
EARLY = Window(WindowMode.EARLY, 1000)


def configured(method: str, seed: int, teachers: int, window: Window = EARLY) -> SessionConfig:
    return SessionConfig("lab", WORLD, method, episodes=12, seed=seed, window=window, teachers_min=teachers)


def simulated(seed: int, names: Sequence[str], error: float, silence: float) -> dict[str, SimulatedTeacher]:
    faults = TeacherParameters(error, error, silence)
    return {name: SimulatedTeacher(seed, name, "lab", faults) for name in names}


def parameters(names: Sequence[str], error: float, silence: float) -> dict[str, TeacherParameters]:
    return {name: TeacherParameters(error, error, silence) for name in names}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("names", [("ann",), ("ann", "bob"), ("ann", "bob", "cid")], ids=len)
@pytest.mark.parametrize("error, silence", [(0.0, 0.0), (0.2, 0.0), (0.2, 0.3)])
def test_a_live_session_learns_exactly_what_the_batch_run_learns(
    method: str, names: tuple[str, ...], error: float, silence: float
) -> None:
    for seed in range(2):
        config = configured(method, seed, len(names))
        live = Live(config, simulated(seed, names, error, silence), Random(seed))
        session = live.play()
        batch = run_batch(config, parameters(names, error, silence), fast=False)
        assert session.learner.sha256() == batch.q_sha256
        assert tuple(session.episodes) == batch.episodes
        assert session.counts == batch.counts
        assert len(session.learner) > 0


@pytest.mark.parametrize("steps_max", range(2, 8))
def test_a_step_taken_back_at_the_cap_ends_the_episode_live_and_in_the_batch_run(steps_max: int) -> None:
    """Whoever blames half of what is done, and sees it taken back, fills every count of steps to the cap."""
    world = replace(WORLD, steps_max=steps_max)
    for seed in range(3):
        config = replace(configured("guidance", seed, 1), world=world)
        session = Live(config, simulated(seed, ("ann",), 0.5, 0.0), Random(seed)).play()
        batch = run_batch(config, parameters(("ann",), 0.5, 0.0), fast=False)
        assert tuple(session.episodes) == batch.episodes
        assert max(episode.steps for episode in batch.episodes) == steps_max


@pytest.mark.parametrize("window", [Window(WindowMode.FULL, 50), Window(WindowMode.EARLY, 50)])
def test_neither_the_window_nor_the_order_of_answers_changes_what_is_learnt(window: Window) -> None:
    digests = {
        Live(configured("sfid", 3, 2, window), simulated(3, ("ann", "bob"), 0.2, 0.2), Random(order))
        .play()
        .learner.sha256()
        for order in range(3)
    }
    assert digests == {run_batch(configured("sfid", 3, 2), parameters(("ann", "bob"), 0.2, 0.2)).q_sha256}


@pytest.mark.parametrize("method", METHODS)
def test_the_replay_of_a_journal_is_the_live_session(method: str) -> None:
    config = configured(method, 5, 2)
    live = Live(config, simulated(5, ("ann", "bob"), 0.2, 0.3), Random(5))
    session = live.play()
    rebuilt = replay(new_session(config), live.journal)
    assert snapshot(rebuilt) == snapshot(session)
    assert rebuilt.learner.sha256() == session.learner.sha256()


def test_every_prefix_of_a_journal_replays_to_the_session_at_that_point() -> None:
    config = configured("sfid", 6, 1)
    live = Live(config, simulated(6, ("ann",), 0.1, 0.1), Random(6))
    live.play()
    session = new_session(config)
    for cut in range(0, len(live.journal), 37):
        session = replay(new_session(config), live.journal[:cut])
        again = replay(session, live.journal[cut:])
        assert again.learner.sha256() == live.session.learner.sha256()


def test_another_seed_or_another_session_name_learns_something_else() -> None:
    config = configured("sfid", 1, 1)
    other_seed = configured("sfid", 2, 1)
    other_name = SessionConfig("other", WORLD, "sfid", episodes=12, seed=1)
    digests = {
        run_batch(each, parameters(("ann",), 0.0, 0.0)).q_sha256 for each in (config, other_seed, other_name)
    }
    assert len(digests) == 3
