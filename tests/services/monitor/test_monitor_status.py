"""The monitor's sentences about the window and what changed: of this moment and this window."""

from typing import Any

import msgspec
import pytest

from protocol.messages import Decision, WindowSpec
from services.monitor.status import events_between, open_markdown
from tests.services.monitor.feeder import Lesson

OPENED = next(message for message in Lesson(episodes=3).messages() if isinstance(message, Decision))
EARLY = WindowSpec(mode="early", span_ms=2_500)
FULL = WindowSpec(mode="full", span_ms=4_000)
ENDLESS = WindowSpec(mode="until-answered", span_ms=2_500)


def decision(**changes: Any) -> Decision:  # noqa: ANN401 - any field
    return msgspec.structs.replace(OPENED, **{"phase": "asking", "window": EARLY} | changes)


@pytest.mark.parametrize(
    "window, said",
    [
        (EARLY, "window 2.5 s, closes early"),
        (FULL, "window 4 s, full span"),
        (ENDLESS, "window until answered"),
    ],
)
def test_a_window_is_told_with_its_length_where_it_has_one(window: WindowSpec, said: str) -> None:
    assert open_markdown(decision(window=window), None, 1.0, 0.0).endswith(said)


def test_the_change_of_a_window_tells_the_new_one() -> None:
    assert events_between(decision(), decision(window=FULL)) == [
        "the window for answers is now 4 s, full span"
    ]
    assert events_between(decision(window=FULL), decision(window=FULL)) == []


@pytest.mark.parametrize(
    "left_s, changes, said",
    [
        (2.5, {}, "**asking the teachers** ■■■■■■■■■■ 2.5 s left"),
        (0.5, {}, "**asking the teachers** ■■□□□□□□□□ 0.5 s left"),
        (1.0, {"window": FULL}, "**asking the teachers** ■■□□□□□□□□ 1.0 s left"),
        (None, {"window": ENDLESS}, "**asking the teachers** · no deadline, open for 7 s"),
        (1.0, {"paused": True}, "**paused**"),
        (1.0, {"phase": "executing"}, "**acting**"),
    ],
)
def test_what_is_left_of_the_window_is_told_while_it_is_open(
    left_s: float | None, changes: dict[str, Any], said: str
) -> None:
    assert open_markdown(decision(**changes), None, left_s, 7.0).split("\n\n")[1] == said


def test_what_changed_between_two_decisions_is_a_line_each() -> None:
    before = decision(teachers=("ann", "bob"))
    after = decision(teachers=("ann", "cyd"), paused=True, epoch=before.epoch + 1)
    assert events_between(before, after) == [
        "paused",
        f"the learner was restarted or replaced (epoch {after.epoch})",
        "cyd joined",
        "bob left",
    ]
    assert events_between(after, decision(teachers=("ann", "cyd"), epoch=after.epoch)) == ["resumed"]
    over = decision(phase="finished", teachers=("ann", "bob"))
    assert events_between(before, over) == ["session finished"]
    assert events_between(over, over) == []
