"""What a key says depends on what is asked."""

import pytest

from protocol.fields import Asked
from protocol.messages import Decision, MistakeMark, WindowSpec
from services.teachers.spoken import ANSWERING, Spoken, spoken


def decision(asked: Asked, *, may_undo: bool = False) -> Decision:
    return Decision(
        session="s1", epoch=1, sequence=1, decision=4, episode=0, step=3, phase="asking", paused=False,
        asked=asked, state=b"s", view="", actions=("LEFT", "RIGHT", "UP", "DOWN"),
        action=None if asked in {"label", "guidance"} else "LEFT", may_undo=may_undo,
        window=WindowSpec(mode="early", span_ms=1000), method="sfid", episodes=1,
    )  # fmt: skip


STEP = MistakeMark(first_step=3, last_step=3)


@pytest.mark.parametrize(
    "asked, key, said",
    [
        ("label", "k", Spoken("↑ UP", "label", action="UP")),
        ("guidance", "left", Spoken("← LEFT", "guidance", guidance=("LEFT",))),
        ("mistake", "d", Spoken("should have gone → RIGHT", "mistake", action="RIGHT", mistake=STEP)),
        ("reward", "p", Spoken("praise", "reward", reward=1.0)),
        ("reward", "minus", Spoken("blame", "reward", reward=-1.0)),
        ("reward", "k", None),
        ("label", "p", None),
        ("guidance", "b", None),
        ("mistake", "p", None),
        ("reward", "u", None),
        ("label", "u", None),
    ],
)
def test_a_key_says_what_is_asked_or_nothing(asked: Asked, key: str, said: Spoken | None) -> None:
    assert spoken(decision(asked), key) == said


@pytest.mark.parametrize("asked", ["label", "reward", "guidance", "mistake"])
def test_there_is_always_nothing_to_say(asked: Asked) -> None:
    assert spoken(decision(asked), "space") == Spoken("nothing to say", "abstain")


def test_a_step_is_taken_back_where_that_can_be_done() -> None:
    assert spoken(decision("reward", may_undo=True), "u") == Spoken("take it back", "undo")
    assert spoken(decision("guidance", may_undo=True), "u") is None


def test_every_answering_key_has_words() -> None:
    assert all(ANSWERING.values())
