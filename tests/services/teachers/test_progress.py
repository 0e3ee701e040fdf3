from typing import Any

import msgspec
import pytest

from protocol.messages import Episode, SaidBy, Step, Welcome, WindowSpec
from services.client import (
    AnswerState,
    AnswerUpdate,
    Connection,
    Controlled,
    EpisodeOver,
    Learnt,
    Opened,
    Refused,
    Welcomed,
)
from services.teachers import panel
from services.teachers.progress import Note, Progress, next_window, stretched_window
from tests.services.teachers.fake_learner import decision

SECOND_NS = 1_000_000_000


def episode(number: int, steps: int, inputs: int = 5) -> Episode:
    return Episode(
        session="s1", epoch=1, decision=0, at_ns=0, episode=number, steps=steps, optimal_steps=4,
        abs_td_error=0.0, abs_td_error_shaped=0.0, discounted_return=0.0, discounted_env_return=0.0,
        inputs=inputs, agreements=1, outcome="solved",
    )  # fmt: skip


def step(number: int, h: float, *kinds: str) -> Learnt:
    said = tuple(SaidBy(teacher="ann", kind=kind) for kind in kinds)  # type: ignore[arg-type]
    return Learnt(
        Step(
            session="s1", epoch=1, decision=number, episode=0, step=number, at_ns=0, state=b"", view="",
            action="UP", said=said, h=h, reward=0.0, td_error=0.0, td_error_shaped=0.0, outcome="running",
            next_view="", values=(),
        )
    )  # fmt: skip


def joined(**changes: object) -> Progress:
    progress = Progress()
    asked = decision(**changes)
    progress.apply(Connection(connected=True, detail="connected"), 0)
    progress.apply(Welcomed(Welcome(session="s1", epoch=1, rights=("answer",), decision=asked)), 0)
    progress.apply(Opened(asked, 0), 0)
    return progress


@pytest.mark.parametrize("changes", [{"phase": "executing"}, {"paused": True}, {"phase": "finished"}])
def test_only_an_open_window_asks_for_an_answer(changes: dict[str, object]) -> None:
    assert joined().open_decision == decision()
    assert joined(**changes).open_decision is None


@pytest.mark.parametrize(
    "update", [Connection(connected=False, detail="gone"), Refused("denied", "no", final=True)]
)
def test_nothing_can_be_answered_while_the_learner_is_out_of_reach(update: Connection | Refused) -> None:
    progress = joined()
    progress.apply(update, 0)
    assert progress.open_decision is None
    assert progress.note.bad


def test_the_window_counts_down_from_when_the_decision_came() -> None:
    progress = joined(remaining_ms=1000)
    assert [progress.remaining_ms(at) for at in (0, SECOND_NS // 4, 2 * SECOND_NS)] == [1000, 750, 0]
    assert joined().remaining_ms(SECOND_NS) is None


def test_teaching_time_runs_while_a_decision_waits_and_stands_in_pauses() -> None:
    progress = joined()
    progress.apply(Opened(decision(sequence=2, paused=True), 0), 2 * SECOND_NS)
    progress.apply(Opened(decision(sequence=3), 0), 9 * SECOND_NS)
    assert progress.teaching_s(10 * SECOND_NS) == 3.0


def test_answers_are_counted_over_episodes_and_agreement_over_judged_steps() -> None:
    progress = joined()
    for update in (
        step(0, 1.0, "label"),
        step(0, 1.0, "label"),
        step(1, -1.0, "label", "abstain"),
        step(2, 0.0),
    ):
        progress.apply(update, 0)
    running = (progress.inputs, progress.agreement)
    for over in (episode(0, 9), episode(0, 9), episode(1, 7)):
        progress.apply(EpisodeOver(over), 0)
    assert running == (2, 0.5)
    assert (progress.inputs, progress.agreement, [one.steps for one in progress.episodes]) == (
        10,
        0.5,
        [9, 7],
    )


@pytest.mark.parametrize(
    "update,fate,bad",
    [
        (AnswerUpdate(b"a", AnswerState.SAVED), "saved", False),
        (AnswerUpdate(b"a", AnswerState.TOO_LATE), "too late: kept, not applied", False),
        (AnswerUpdate(b"a", AnswerState.RETRYING, None, 3, "busy"), "retrying 3: busy", True),
        (AnswerUpdate(b"a", AnswerState.REJECTED, None, 1, "no"), "rejected: no", True),
        (AnswerUpdate(b"another", AnswerState.SAVED), "sending…", False),
    ],
)
def test_the_fate_of_the_last_answer_is_told(update: AnswerUpdate, fate: str, bad: bool) -> None:  # noqa: FBT001
    progress = joined()
    progress.said(b"a", "↑ UP")
    progress.apply(update, 0)
    assert (progress.answer_text, progress.answer_fate, progress.answer_bad) == ("↑ UP", fate, bad)


@pytest.mark.parametrize(
    "changes, bar",
    [
        ({"remaining_ms": None}, "━" * 24),
        ({"remaining_ms": 250}, "━" * 6 + "·" * 18 + " 0.2 s"),
        ({"remaining_ms": None, "paused": True}, "·" * 24),
        ({"remaining_ms": None, "phase": "executing"}, "·" * 24),
    ],
)
def test_the_bar_is_what_is_left_of_a_window_that_runs(changes: dict[str, Any], bar: str) -> None:
    progress = joined(**changes)
    assert progress.decision is not None
    assert panel.window_line(progress, progress.decision, 0).plain.splitlines()[0] == bar


def test_a_wish_that_was_not_granted_is_told() -> None:
    progress = joined()
    progress.apply(Controlled("pause", ok=False, reason="already paused"), 0)
    assert progress.note == Note("pause: already paused", bad=True)


def test_the_window_goes_through_its_modes_and_its_span_in_quarters_of_a_second() -> None:
    window = WindowSpec(mode="early", span_ms=1000, quorum=2)
    modes = [window.mode]
    for _ in range(3):
        window = next_window(window)
        modes.append(window.mode)
    spans = [stretched_window(WindowSpec(mode="full", span_ms=ms), by).span_ms for ms, by in
             [(1000, 1), (1000, -1), (1100, 1), (1100, -1), (250, -1), (3_600_000, 1)]]  # fmt: skip
    assert modes == ["early", "full", "until-answered", "early"]
    assert (window.span_ms, window.quorum) == (1000, 2)
    assert spans == [1250, 750, 1250, 1000, 250, 3_600_000]


def test_the_panel_says_what_is_asked_and_how_things_stand() -> None:
    progress = joined(remaining_ms=500, teachers=("ann", "bob"), teachers_present=9, episode=1, step=2)
    progress.apply(EpisodeOver(episode(0, 12)), 0)
    progress.said(b"a", "↑ UP")
    assert panel.situation(progress, 0).plain == (
        "Episode 2 of 30   step 3 (shortest 1)\n\n"
        "Which way would you go?\n"
        "━━━━━━━━━━━━············ 0.5 s\n"
        "window: early, 1 s\n\n"
        "you: ↑ UP sending…\n\n"
        "steps █\n"
        "last episode: solved in 12 (shortest 4)\n"
        "answers of all 5\n"
        "teaching time 0:00, 0 of yours saved\n"
        "teachers: ann, bob and 7 more"
    )


@pytest.mark.parametrize("moved, said", [(True, "it went ↑ UP"), (False, "it went ↑ UP, and nothing moved")])
def test_the_panel_says_what_the_agent_did_at_the_step_before(*, moved: bool, said: str) -> None:
    progress = joined(decision=4)
    last = msgspec.structs.replace(step(3, 1.0).step, view="@ ", next_view=" @" if moved else "@ ")
    progress.apply(Learnt(last), 0)
    assert panel.situation(progress, 0).plain.splitlines()[1] == said
    for later in (
        {"decision": 5},
        {"decision": 3},
        {"decision": 4, "episode": 1},
        {"decision": 4, "asked": "reward", "action": "UP"},
    ):
        progress.apply(Opened(decision(**later), 0), 0)
        assert panel.situation(progress, 0).plain.splitlines()[1] == ""


@pytest.mark.parametrize(
    "label, kind, said",
    [
        (None, "label", "it went ↑ UP; the labels were tied"),
        ("UP", "label", "it went ↑ UP"),
        (None, "mistake", "it went ↑ UP"),
    ],
)
def test_the_panel_says_that_teachers_disagreed(label: str | None, kind: Any, said: str) -> None:  # noqa: ANN401
    progress = joined(decision=4)
    words = tuple(SaidBy(teacher=action, kind=kind, action=action) for action in ("UP", "DOWN", "UP"))
    last = msgspec.structs.replace(step(3, 1.0).step, view="@ ", next_view=" @", said=words, label=label)
    progress.apply(Learnt(last), 0)
    assert panel.situation(progress, 0).plain.splitlines()[1] == said


@pytest.mark.parametrize(
    "kind, present, said",
    [
        ("label", 1, "answers 2, 50% agreed"),
        ("label", 2, "answers of all 2, 50% agreed"),
        ("reward", 1, "answers 2, 50% praised"),
    ],
)
def test_the_panel_says_whose_answers_it_counts_and_what_they_came_to(
    kind: Any,  # noqa: ANN401 - a literal
    present: int,
    said: str,
) -> None:
    progress = joined(teachers_present=present)
    for judged in (step(0, 1.0, kind), step(1, -1.0, kind), step(2, 0.0)):
        progress.apply(judged, 0)
    for answer_id in (b"a", b"b", b"c"):
        progress.apply(AnswerUpdate(answer_id, AnswerState.SAVED), 0)
    lines = panel.situation(progress, 0).plain.splitlines()
    assert said in lines
    assert "teaching time 0:00, 3 of yours saved" in lines


@pytest.mark.parametrize(
    "changes,said",
    [
        ({"teachers": (), "teachers_present": 1}, "teachers: 1"),
        ({"teachers": ("ann",), "teachers_present": 1}, "teachers: ann"),
        ({"teachers": tuple("abcdefgh"), "teachers_present": 9}, "teachers: a, b, c, d, e, f and 3 more"),
    ],
)
def test_company_is_named_where_names_are_told_and_counted_where_not(
    changes: dict[str, Any], said: str
) -> None:
    assert panel.situation(joined(**changes), 0).plain.splitlines()[-1] == said


@pytest.mark.parametrize(
    "changes,question",
    [
        ({"asked": "reward", "action": "LEFT"}, "The agent went ← LEFT: + or - ?"),
        ({"paused": True}, "paused: z goes on"),
        ({"phase": "gathering"}, "waits for teachers"),
        ({"asked": "guidance"}, "Which way is worth trying?"),
        ({"asked": "mistake", "action": "UP"}, "It went ↑ UP. A mistake? Which way instead?"),
        ({"asked": "nothing"}, "asks for nothing: watch, or abstain"),
    ],
)
def test_the_question_fits_the_decision(changes: dict[str, object], question: str) -> None:
    assert panel.question(decision(**changes)).plain == question


def test_a_sparkline_is_scaled_to_its_highest_bar_and_keeps_the_latest() -> None:
    assert panel.sparkline([0, 50, 100]) == "▁▄█"
    assert panel.sparkline(list(range(100)), 3) == "███"
    assert panel.sparkline([]) == ""
