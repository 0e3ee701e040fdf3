"""Another method looks on at a session: what it learns, what it may not ask for, what it does not disturb."""

from random import Random

import pytest

from sfid_core.experiments.batch import world_of
from sfid_core.experiments.onlooker import greedy_success, watched_session
from sfid_core.learning.parameters import ParameterError
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.session.machine import replay
from sfid_core.sokoban.levels import packaged
from sfid_core.sokoban.live import tabulate
from sfid_core.teaching.personas import persona_named
from sfid_core.teaching.simulated import SimulatedTeacher
from tests.core.session.live import Live

WORLD = WorldSpec(packaged("room")[0].to_xsb())


def recorded(method: str = "sfid") -> Live:
    config = SessionConfig("s1", WORLD, method, episodes=6, seed=5)
    live = Live(config, {"ann": SimulatedTeacher(5, "ann", "s1", persona_named("noisy"))}, Random(1))
    live.play()
    return live


def test_a_method_that_looks_on_at_itself_learns_the_same() -> None:
    live = recorded()
    watched = watched_session(live.config, "sfid", {})
    replay(watched.session, live.journal)
    assert watched.onlooker.sha256() == watched.session.learner.sha256() == live.session.learner.sha256()


@pytest.mark.parametrize("other", ["sfid-memory", "dagger", "q-learning"])
def test_another_method_learns_its_own_from_the_same_steps_and_disturbs_nothing(other: str) -> None:
    live = recorded()
    watched = watched_session(live.config, other, {})
    replay(watched.session, live.journal)
    assert watched.session.learner.sha256() == live.session.learner.sha256()
    assert watched.session.episodes == live.session.episodes
    assert len(watched.onlooker) == len(live.session.learner)
    assert watched.onlooker.sha256() != live.session.learner.sha256()


def test_what_looking_on_taught_can_be_tried() -> None:
    live = recorded()
    tables = tabulate(world_of(SessionConfig("s1", WorldSpec(WORLD.level, starts="all"))))
    shares = []
    for other in ("dagger", "q-learning"):
        watched = watched_session(live.config, other, {})
        replay(watched.session, live.journal)
        shares.append(greedy_success(watched.onlooker, tables, 5, WORLD.steps_max))
    assert 1 >= shares[0] > 2 * shares[1] >= 0


@pytest.mark.parametrize(
    "method,other,words",
    [
        ("sfid", "reward", "asks for reward, the session's sfid asked for label"),
        ("reward", "sfid", "asks for label, the session's reward asked for reward"),
        ("q-learning", "sfid", "asks for label, the session's q-learning asked for nothing"),
        ("reward", "guidance", "asks for guidance and reward, the session's reward asked for reward"),
    ],
)
def test_a_method_that_lives_on_other_answers_is_refused(method: str, other: str, words: str) -> None:
    with pytest.raises(ParameterError, match=f"method {other} {words}: choose a method"):
        watched_session(SessionConfig("s1", WORLD, method), other, {})
