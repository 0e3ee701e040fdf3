"""When several teachers answer, the first one's delay counts: the slowest only closes the window."""

import pytest

from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.session.events import TeacherJoined
from sfid_core.session.state import Phase, Session, new_session
from tests.core.session.script import EARLY, MS, began, play, praise, taken


def judged(teachers: str, acted_ms: int = 0) -> Session:
    """A lesson by real-time credit whose first step, open since 0 ms, waits for praise since it was taken."""
    config = SessionConfig(
        "lab", WorldSpec(""), "tamer", {"credit": "individual"}, 2, 7, EARLY, len(teachers)
    )
    session = new_session(config)
    play(session, [*((0, TeacherJoined(name)) for name in teachers), (0, began())])
    play(session, [(acted_ms, taken())])
    assert session.phase is Phase.ASKING
    return session


def learnt(*at_ms: int, acted_ms: int = 0) -> str:
    """The digest of what a step teaches that is praised at these times, and those after it without a word."""
    teachers = "abc"[: len(at_ms)]
    session = judged(teachers, acted_ms)
    play(session, [(ms, praise(name, 1.0, number=ms)) for name, ms in zip(teachers, at_ms, strict=True)])
    assert session.decision == 1
    play(session, [(acted_ms + 2_000, taken(1, number=2)), (acted_ms + 4_000, taken(2, number=3))])
    return session.learner.sha256()


def test_the_answers_of_a_window_stand_by_name_since_the_first_of_them() -> None:
    session = judged("abc")
    assert session.standing_answers() == ((), 0)
    play(session, [(100, praise("b", 1.0, number=1))])
    assert session.standing_answers() == ((("b", praise("b", 1.0).answer),), 100 * MS)
    play(session, [(900, praise("a", -1.0, number=2))])
    both = (("a", praise("a", -1.0).answer), ("b", praise("b", 1.0).answer))
    assert session.standing_answers() == (both, 100 * MS)


@pytest.mark.parametrize("at_ms", [(100, 900), (100, 400, 900)])
def test_the_first_answer_says_how_long_after_its_cause_the_praise_came(at_ms: tuple[int, ...]) -> None:
    assert learnt(*at_ms) == learnt(100)
    assert learnt(*at_ms) != learnt(900)


def test_the_delay_is_from_what_was_seen_and_not_from_the_opening_of_the_decision() -> None:
    assert learnt(600, acted_ms=500) == learnt(100)
