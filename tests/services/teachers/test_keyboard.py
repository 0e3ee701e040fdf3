import asyncio
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from textual.pilot import Pilot
from textual.widgets import Static

from protocol.keys import Keys
from protocol.messages import Control, Refusal, WindowSpec
from services.client import Client
from services.outbox import Outbox
from services.runtime.clock import ManualClock
from services.runtime.memory_bus import MemoryBus, MemoryHub
from services.teachers.keyboard import (
    KeyboardApp,
    KeyboardConfig,
    KeyboardError,
    _farewell,
    default_outbox,
    run,
)
from tests.services.teachers.fake_learner import FakeLearner, decision, drop

SECOND_NS = 1_000_000_000
DEADLINE_S = 10


class Terminal:
    """The keyboard teacher in a terminal without a screen, and its learner. Key times are moved by hand."""

    def __init__(self, pilot: Pilot[int], app: KeyboardApp, learner: FakeLearner, clock: ManualClock) -> None:
        self.pilot, self.app, self.learner, self.clock = pilot, app, learner, clock

    def line(self, name: str) -> str:
        return str(self.app.screen_stack[0].query_one(f"#{name}", Static).content)

    async def until(self, condition: Callable[[], object]) -> None:
        """Let the app work until the condition holds."""
        deadline_s = time.monotonic() + DEADLINE_S
        while not condition():
            shown = "\n".join(self.line(name) for name in ("title", "side", "note"))
            assert time.monotonic() < deadline_s, f"not so after {DEADLINE_S} s, the screen says:\n{shown}"
            await self.pilot.pause(0.005)

    async def sees(self, name: str, words: str) -> None:
        await self.until(lambda: words in self.line(name))

    async def asked(self, **changes: object) -> None:
        """Publish the decision with these changes and wait until it is on screen."""
        published = self.learner.go_on(**changes)
        await self.until(lambda: self.app.progress.decision == published)
        await self.pilot.pause()

    async def press(self, *keys: str, after_ms: int = 2000) -> None:
        for key in keys:
            self.clock.advance(after_ms * 1_000_000)
            await self.pilot.press(key)

    def said(self) -> list[tuple[int, str, str | None, float | None]]:
        return [(one.decision, one.kind, one.action, one.reward) for one in self.learner.answers]


def at_terminal(
    play: Callable[[Terminal], Awaitable[None]],
    *,
    size: tuple[int, int] = (80, 24),
    prepare: Callable[[FakeLearner], None] = lambda _learner: None,
    **changes: object,
) -> KeyboardApp:
    """Run the app, joined to a fake learner, and play a scene with it."""
    clock = ManualClock(SECOND_NS)
    hub = MemoryHub(inline=True)
    learner = FakeLearner(MemoryBus(hub), decision(**changes))
    prepare(learner)
    client = Client(MemoryBus(hub), Keys("local"), "s1", "ann", outbox=Outbox(), clock=clock)
    app = KeyboardApp(client, clock)

    async def scene() -> None:
        async with app.run_test(size=size) as pilot:
            terminal = Terminal(pilot, app, learner, clock)
            if learner.join_refusal is None:
                await terminal.until(lambda: app.progress.decision == learner.decision)
                await pilot.pause()
            await play(terminal)

    with client:
        asyncio.run(scene())
        assert app.stop_listening()
    return app


@pytest.mark.parametrize(
    "keys,action",
    [
        (("left", "h", "a"), "LEFT"),
        (("down", "j", "s"), "DOWN"),
        (("up", "k", "w"), "UP"),
        (("right", "l", "d"), "RIGHT"),
    ],
)
def test_arrows_and_letters_say_which_way_to_go(keys: tuple[str, ...], action: str) -> None:
    async def play(terminal: Terminal) -> None:
        for number, key in enumerate(keys):
            await terminal.asked(decision=number)
            await terminal.press(key)
            await terminal.sees("side", f"{action} saved")
        assert terminal.said() == [(number, "label", action, None) for number in range(3)]

    at_terminal(play)


def test_the_cells_are_explained_beside_a_board_and_not_beside_another_world() -> None:
    async def play(terminal: Terminal) -> None:
        await terminal.asked()
        await terminal.sees("legend", "[] box")
        await terminal.asked(decision=1, view="[S] F  F\n F  H  G")
        await terminal.sees("grid", "[S] F  F")
        assert terminal.line("legend") == ""

    at_terminal(play)


def test_praise_blame_and_nothing_to_say_where_a_reward_is_asked() -> None:
    keys = ("plus", "equals_sign", "p", "minus", "b", "space")

    async def play(terminal: Terminal) -> None:
        assert "The agent went ↓ DOWN: + or - ?" in terminal.line("side")
        for number, key in enumerate(keys):
            await terminal.asked(decision=number)
            await terminal.press(key)
            await terminal.sees("side", " saved")
        rewards = [(number, "reward", "DOWN", 1.0 if number < 3 else -1.0) for number in range(5)]
        assert terminal.said() == [*rewards, (5, "abstain", None, None)]

    at_terminal(play, asked="reward", action="DOWN")


def test_a_key_pressed_before_the_decision_opened_is_dropped_and_never_answers_the_next() -> None:
    async def play(terminal: Terminal) -> None:
        await terminal.press("up")
        await terminal.sees("note", "↑ UP dropped: nothing was asked")
        await terminal.asked(phase="asking", decision=1)
        await terminal.press("left")
        await terminal.sees("side", "LEFT saved")
        assert terminal.said() == [(1, "label", "LEFT", None)]

    at_terminal(play, phase="executing")


def test_a_second_press_does_not_change_the_answer_of_a_decision() -> None:
    async def play(terminal: Terminal) -> None:
        await terminal.press("up", "left")
        await terminal.sees("note", "this decision has your answer")
        assert terminal.said() == [(0, "label", "UP", None)]

    at_terminal(play)


def test_a_held_key_answers_one_decision_only() -> None:
    async def play(terminal: Terminal) -> None:
        await terminal.press("up")
        await terminal.asked(decision=1)
        await terminal.press("up", after_ms=500)
        for number in range(2, 8):
            await terminal.asked(decision=number)
            await terminal.press("up", after_ms=30)
        await terminal.sees("note", "held key ignored")
        assert terminal.said() == [(0, "label", "UP", None)]

    at_terminal(play)


def test_the_same_key_tapped_twice_answers_both_decisions_with_its_own_time() -> None:
    async def play(terminal: Terminal) -> None:
        await terminal.press("up")
        await terminal.asked(decision=1)
        await terminal.press("up", after_ms=600)
        terminal.clock.advance(400 * 1_000_000)
        await terminal.until(lambda: len(terminal.learner.answers) == 2)
        assert terminal.said() == [(0, "label", "UP", None), (1, "label", "UP", None)]
        assert terminal.learner.answers[1].response_ms == 600

    at_terminal(play)


def test_a_press_that_is_looked_at_too_early_is_looked_at_again() -> None:
    async def play(terminal: Terminal) -> None:
        await terminal.press("up")
        await terminal.asked(decision=1)
        await terminal.press("up", after_ms=600)
        await terminal.pilot.pause(0.4)
        assert len(terminal.learner.answers) == 1
        terminal.clock.advance(400 * 1_000_000)
        await terminal.until(lambda: len(terminal.learner.answers) == 2)
        assert terminal.learner.answers[1].response_ms == 600

    at_terminal(play)


def test_keys_of_the_other_kind_of_answer_are_explained_and_send_nothing() -> None:
    async def play(terminal: Terminal) -> None:
        await terminal.press("p")
        await terminal.sees("note", "this session asks for the way you would go: ? shows the keys")
        await terminal.press("X")
        await terminal.sees("note", "X does nothing here: ? shows the keys")
        assert terminal.said() == []

    at_terminal(play)


def test_a_window_that_waits_for_answers_has_no_length_to_change() -> None:
    async def play(terminal: Terminal) -> None:
        await terminal.press("m", "m", "full_stop", "comma")
        await terminal.sees("note", "a window until answered has no length: m gives it another mode")
        assert [one.window and one.window.mode for one in wishes(terminal)] == ["full", "until-answered"]
        await terminal.press("m")
        assert [one.window and one.window.mode for one in wishes(terminal)][2:] == ["early"]

    at_terminal(play)


def test_the_window_is_changed_and_the_session_paused_and_resumed() -> None:
    async def play(terminal: Terminal) -> None:
        await terminal.press("m", "full_stop", "full_stop", "comma")
        await terminal.sees("note", "window: full, 1.25 s")
        await terminal.press("z")
        await terminal.asked(paused=True)
        assert "paused: z goes on" in terminal.line("side")
        await terminal.press("up", "z")
        assert [
            (one.verb, one.window and (one.window.mode, one.window.span_ms)) for one in wishes(terminal)
        ] == [
            ("window", ("full", 1000)),
            ("window", ("full", 1250)),
            ("window", ("full", 1500)),
            ("window", ("full", 1250)),
            ("pause", None),
            ("resume", None),
        ]
        assert terminal.said() == []

    at_terminal(play, window=WindowSpec(mode="early", span_ms=1000, quorum=1))


def wishes(terminal: Terminal) -> list[Control]:
    return terminal.learner.controls


def test_a_key_that_closes_the_help_answers_nothing() -> None:
    async def play(terminal: Terminal) -> None:
        await terminal.press("question_mark")
        await terminal.until(lambda: len(terminal.app.screen_stack) == 2)
        await terminal.press("up")
        await terminal.until(lambda: len(terminal.app.screen_stack) == 1)
        before = terminal.said()
        await terminal.press("left")
        await terminal.sees("side", "LEFT saved")
        assert (before, terminal.said()) == ([], [(0, "label", "LEFT", None)])

    at_terminal(play)


def test_an_answer_that_is_not_acknowledged_is_seen_to_be_retried_until_it_is_saved() -> None:
    async def play(terminal: Terminal) -> None:
        terminal.learner.answer_replies = [drop]
        await terminal.press("up")
        await terminal.sees("side", "↑ UP retrying 1: no acknowledgement")
        terminal.clock.advance(SECOND_NS)
        await terminal.sees("side", "↑ UP saved")
        assert terminal.learner.payloads == [terminal.learner.payloads[0]] * 2

    at_terminal(play)


def test_a_late_answer_is_told_to_be_late() -> None:
    async def play(terminal: Terminal) -> None:
        terminal.learner.code = "late"
        await terminal.press("up")
        await terminal.sees("side", "↑ UP too late: kept, not applied")
        assert terminal.said() == [(0, "label", "UP", None)]

    at_terminal(play)


def test_an_unknown_session_is_one_line_with_the_mend() -> None:
    def prepare(learner: FakeLearner) -> None:
        learner.join_refusal = Refusal(code="unknown-session", reason="no session s1 here: create it")

    async def play(terminal: Terminal) -> None:
        await terminal.sees("note", "not admitted: no session s1 here: create it")
        await terminal.sees("side", "not admitted: no session s1 here: create it")
        assert "○ not connected" in terminal.line("title")
        await terminal.press("up")
        assert terminal.said() == []

    at_terminal(play, prepare=prepare)


@pytest.mark.parametrize("words, lines", [("short", 1), ("somebody teaches " + "on and on " * 10, 2)])
def test_what_is_too_long_for_a_line_stands_on_two(words: str, lines: int) -> None:
    def prepare(learner: FakeLearner) -> None:
        learner.join_refusal = Refusal(code="conflict", reason=words)

    async def play(terminal: Terminal) -> None:
        await terminal.sees("note", words.strip())
        await terminal.pilot.pause()
        assert terminal.app.query_one("#note").size.height == lines

    at_terminal(play, prepare=prepare)


def test_q_leaves_with_exit_code_0_and_the_answers_are_counted() -> None:
    async def play(terminal: Terminal) -> None:
        await terminal.press("up")
        await terminal.sees("side", "UP saved")
        await terminal.press("q")

    app = at_terminal(play)
    assert (app.return_code, app.return_value, app.progress.answers_saved) == (0, 0, 1)


@pytest.mark.parametrize("size", [(80, 24), (50, 24), (200, 60), (20, 8)])
def test_every_size_of_terminal_shows_the_grid_around_the_agent(size: tuple[int, int]) -> None:
    async def play(terminal: Terminal) -> None:
        assert "@@" in terminal.line("grid")
        if size == (80, 24):
            assert terminal.line("grid") == "██████████\n██()[]@@██\n██████████"
            regions = [terminal.app.query_one(f"#{name}").region for name in ("grid", "side", "note", "keys")]
            assert all(region.bottom <= 24 and region.right <= 80 and region.area for region in regions)
        await terminal.pilot.resize_terminal(100, 30)
        await terminal.until(lambda: "()[]@@" in terminal.line("grid"))

    at_terminal(play, size=size)


def test_without_a_terminal_the_teacher_says_so_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(KeyboardError, match=r"^the keyboard teacher needs a terminal: run it in one, or use"):
        run(KeyboardConfig("s1", outbox=tmp_path / "box"), MemoryBus())
    assert not (tmp_path / "box").exists()


def test_teachers_of_one_machine_keep_their_answers_apart() -> None:
    paths = {
        default_outbox(KeyboardConfig(session, teacher)) for session in ("s1", "s2") for teacher in ("a", "b")
    }
    assert len(paths) == 4


def test_a_person_who_leaves_is_told_how_many_answers_were_saved_and_which_wait() -> None:
    assert _farewell("s1", 1, 0, Path("o")) == "left session s1: 1 answer saved\n"
    assert _farewell("s1", 0, 2, Path("o")) == (
        "left session s1: 0 answers saved; 2 not acknowledged yet, kept in o for your next visit\n"
    )


def test_a_screen_on_which_nothing_changes_is_not_drawn_again_and_the_count_down_moves() -> None:
    async def play(terminal: Terminal) -> None:
        looks: list[None] = []
        terminal.app.set_interval(0.2, lambda: looks.append(None))
        side, note = (terminal.app.query_one(name, Static) for name in ("#side", "#note"))
        await terminal.sees("side", "5.0 s")
        drawn = (side.content, note.content)
        await terminal.until(lambda: len(looks) >= 4)
        assert (side.content is drawn[0], note.content is drawn[1]) == (True, True)
        terminal.clock.advance(SECOND_NS)
        await terminal.sees("side", "4.0 s")

    at_terminal(play, window=WindowSpec(mode="early", span_ms=5_000), remaining_ms=5_000)
