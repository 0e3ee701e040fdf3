"""The keyboard teacher: one person at a terminal, over SSH too.

Which key press becomes an answer is the rule of services/teachers/key_gate.py: a press counts only for the
decision that was on screen when it was pressed, once; a press while nothing is asked is dropped; a held key
counts once.
"""

import sys
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal
from textual.events import Key, Resize
from textual.message import Message
from textual.screen import ModalScreen
from textual.widgets import Static

from protocol.keys import Keys
from protocol.messages import Decision, WindowSpec
from services.client import Client, Controlled, TeachingError, Update
from services.outbox import Outbox, OutboxError
from services.runtime.bus import Bus
from services.runtime.clock import Clock, SystemClock
from services.teachers import panel
from services.teachers.grid import legend, shown
from services.teachers.key_gate import CONFIRM_MS, KeyGate, Verdict
from services.teachers.progress import Note, Progress, next_window, stretched_window
from services.teachers.spoken import ANSWERING, ASKED, HELP, spoken

SIDE_COLUMNS = 44
NARROW_COLUMNS = 72
"""Below this the panel stands under the grid instead of beside it."""
_FRAME_LINES = 6
"""Title and the blank line below it, legend, note, two lines of keys."""
_PANEL_LINES = 9
"""What the panel needs at least when it stands under the grid."""
_TICK_S = 0.2
_LISTEN_S = 0.25
_HINT_NS = 1_500_000_000
_DRAIN_S = 2.0
_SHOWN = {"equals_sign": "=", "plus": "+", "minus": "-", "full_stop": ".", "comma": ","}


class KeyboardError(TeachingError):
    """The keyboard teacher cannot run here; the message is one line, with the mend."""


@dataclass(frozen=True, slots=True)
class KeyboardConfig:
    """One person at one terminal."""

    session: str
    teacher: str = "me"
    deployment: str = "local"
    outbox: Path | None = None
    """File that keeps answers until they are acknowledged; None: one a teacher, below the home directory."""
    token: str | None = None
    check_key: bytes | None = field(default=None, repr=False)


@dataclass(frozen=True, slots=True)
class OnScreen:
    """A decision as the gate knows it: by its number."""

    number: tuple[int, int, str]
    decision: Decision = field(compare=False)


class Help(ModalScreen[None]):
    """The keys, explained; any key closes it and counts for nothing else."""

    def compose(self) -> ComposeResult:
        """See Screen."""
        yield Static(HELP, id="help")

    def on_key(self, event: Key) -> None:
        """Close."""
        event.stop()
        self.dismiss()


class KeyboardApp(App[int]):
    """Shows a Progress and turns keys into answers. The client is pumped by a thread of the app."""

    ENABLE_COMMAND_PALETTE = False
    BINDINGS = [Binding("ctrl+c", "leave", show=False, priority=True)]  # noqa: RUF012 - as Textual declares it
    CSS = f"""
    Screen {{ layout: vertical; }}
    #title, #legend {{ height: 1; }}
    #title {{ margin-bottom: 1; }}
    #middle {{ height: 1fr; }}
    #grid {{ width: 1fr; height: 1fr; padding: 0 2; text-wrap: nowrap; }}
    #side {{ width: {SIDE_COLUMNS}; height: 1fr; }}
    #legend {{ color: $text-muted; padding: 0 2; }}
    #note {{ height: auto; min-height: 1; max-height: 3; padding: 0 1; }}
    #keys {{ height: auto; color: $text-muted; padding: 0 1; }}
    .narrow #middle {{ layout: vertical; }}
    .narrow #grid {{ height: auto; margin-bottom: 1; }}
    .narrow #side {{ width: 1fr; padding: 0 2; }}
    .narrow #legend {{ display: none; }}
    Help {{ align: center middle; }}
    #help {{ width: auto; max-width: 100%; height: auto; padding: 0 1; border: round $primary; }}
    """

    class Wake(Message):
        """There is something in the queue of updates."""

    def __init__(self, client: Client, clock: Clock) -> None:
        super().__init__()
        self.progress = Progress()
        self.gate: KeyGate[OnScreen] = KeyGate()
        self._client, self._clock = client, clock
        self._updates: deque[Update | Note] = deque()
        self._woken = False
        self._leaving = threading.Event()
        self._pump = threading.Thread(target=self._listen, name="client", daemon=True)
        # Held here instead of looked up: a timer may still fire when the screen is gone already.
        self._title, self._grid, self._side, self._legend, self._note, self._keys = (
            Static(id=name) for name in ("title", "grid", "side", "legend", "note", "keys")
        )
        self._on_screen: OnScreen | None = None
        self._hint = Note("")
        self._hint_until_ns = 0
        self._wanted: WindowSpec | None = None
        self._window_wishes = 0
        """Changes of the window without an answer yet: until then keys change what was wanted last."""

    def compose(self) -> ComposeResult:
        """See App."""
        yield self._title
        with Horizontal(id="middle"):
            yield self._grid
            yield self._side
        yield self._legend
        yield self._note
        yield self._keys

    def on_mount(self) -> None:
        """Begin to listen."""
        self.title = "SfID"
        self._pump.start()
        self.set_interval(_TICK_S, self._draw_time)
        self._draw()

    # ------------------------------------------------------------ a thread fetches updates, the app applies

    def _listen(self) -> None:
        while not self._leaving.is_set():
            try:
                update: Update | Note | None = self._client.next(_LISTEN_S)
            except OutboxError as error:
                update = Note(str(error), bad=True)
            if update is not None:
                self._updates.append(update)
                # One message for a whole batch: fast fellow teachers must not flood the terminal.
                if not self._woken:
                    self._woken = True
                    self.post_message(self.Wake())

    def stop_listening(self) -> bool:
        """End the thread that calls `Client.next`; returns whether it ended, so that another may call it."""
        self._leaving.set()
        if self._pump.ident is not None:
            self._pump.join(4 * _LISTEN_S)
        return not self._pump.is_alive()

    def on_keyboard_app_wake(self) -> None:
        """Apply what has come and draw once."""
        self._woken = False
        now_ns = self._clock.now_ns()
        while self._updates:
            update = self._updates.popleft()
            if isinstance(update, Note):
                self.progress.note = update
            else:
                self.progress.apply(update, now_ns)
                if isinstance(update, Controlled) and update.verb == "window":
                    self._window_wishes -= 1
        self._draw()

    # ---------------------------------------------------------------- drawing

    def on_resize(self, event: Resize) -> None:
        """Fit the new size."""
        self.screen.set_class(event.size.width < NARROW_COLUMNS, "narrow")
        self.call_after_refresh(self._draw)

    def _draw(self) -> None:
        progress = self.progress
        self._title.update(panel.title(progress, self._client.session, self._client.teacher))
        if progress.decision is not None:
            self._grid.update(shown(progress.decision.view, *self._grid_cells()))
            self._legend.update(legend(progress.decision.view))
        self._keys.update(panel.key_line(progress.decision))
        self._draw_time()
        decision = progress.open_decision
        number = (
            None
            if decision is None
            else OnScreen((decision.epoch, decision.decision, decision.asked), decision)
        )
        # A decision is shown once it is painted: a key pressed before that still means the one before.
        self.call_after_refresh(self._painted, number)

    def _grid_cells(self) -> tuple[int, int]:
        """Return how many cells fit side by side, and one above the other."""
        width, height = self.size
        free = height - _FRAME_LINES
        if width < NARROW_COLUMNS:
            return (width - 4) // 2, max(3, free - _PANEL_LINES)
        return (width - 4 - SIDE_COLUMNS) // 2, free

    def _draw_time(self) -> None:
        """Draw what changes by itself: the window running out, hints fading."""
        now_ns = self._clock.now_ns()
        note = self._hint if now_ns < self._hint_until_ns else self.progress.note
        for widget, text, may_grow in (
            (self._side, panel.situation(self.progress, now_ns), False),
            (self._note, panel.note_line(note), True),
        ):
            if widget.content != text:  # five looks a second, and mostly there is nothing to draw
                widget.update(text, layout=may_grow)

    def _painted(self, on_screen: OnScreen | None) -> None:
        self._on_screen = on_screen
        if on_screen is not None and self._client.has_answered(on_screen.decision):
            self.gate.answered(on_screen)
        self.gate.show(on_screen)

    def _tell(self, text: str, *, bad: bool = False) -> None:
        self._hint, self._hint_until_ns = Note(text, bad), self._clock.now_ns() + _HINT_NS
        self._draw_time()

    # ---------------------------------------------------------------- keys

    def on_key(self, event: Key) -> None:
        """Answer, or do what the key stands for."""
        key = event.key
        if key in ANSWERING:
            self._press(key)
        elif key == "m":
            self._change_window(next_window)
        elif key in {"comma", "full_stop"}:
            self._change_window(lambda window: stretched_window(window, 1 if key == "full_stop" else -1))
        elif key == "z":
            self._pause()
        elif key == "question_mark":
            self.gate.show(None)
            self.push_screen(Help(), lambda _closed: self._draw())
        elif key == "q":
            self.action_leave()
        else:
            self._tell(f"{_name(event)} does nothing here: ? shows the keys")

    def action_leave(self) -> None:
        """Leave the session; answers are saved."""
        self.exit(0)

    def _press(self, key: str) -> None:
        asked = self._on_screen.decision.asked if self._on_screen is not None else None
        if self._on_screen is not None and spoken(self._on_screen.decision, key) is None:
            self._tell(f"this session asks for {ASKED.get(asked or '', asked)}: ? shows the keys")
            return
        now_ns = self._clock.now_ns()
        verdict = self.gate.press(key, now_ns)
        if verdict is Verdict.COUNTS and self._on_screen is not None:
            self._say(self._on_screen.decision, key, now_ns)
        elif verdict is Verdict.WAITS:
            self._confirm_later()
        elif verdict is Verdict.HELD:
            self._tell("held key ignored")
        elif verdict is Verdict.ALREADY:
            self._tell("this decision has your answer")
        else:
            paused = self.progress.decision is not None and self.progress.decision.paused
            why = "paused, z goes on" if paused else "nothing was asked"
            self._tell(f"{ANSWERING[key]} dropped: {why}")

    def _confirm_later(self) -> None:
        self.set_timer(CONFIRM_MS / 1000, self._confirm)

    def _confirm(self) -> None:
        press = self.gate.confirmed(self._clock.now_ns())
        if press is not None:
            self._say(press.decision.decision, press.key, press.pressed_ns)
        elif self.gate.waits:  # the timer's clock is not ours
            self._confirm_later()

    def _say(self, decision: Decision, key: str, pressed_ns: int) -> None:
        said = spoken(decision, key)
        if said is None:
            return
        try:
            answer_id = self._client.answer(
                decision,
                kind=said.kind,
                action=said.action,
                reward=said.reward,
                guidance=said.guidance,
                mistake=said.mistake,
                at_ns=pressed_ns,
            )
        except (ValueError, OutboxError) as error:
            self._tell(str(error), bad=True)
        else:
            self._hint_until_ns = 0
            self.progress.said(answer_id, said.text)
            self._draw_time()

    # ---------------------------------------------------------------- wishes

    def _change_window(self, change: Callable[[WindowSpec], WindowSpec]) -> None:
        decision = self.progress.decision
        if decision is None or not self._allowed("window"):
            return
        window = self._wanted if self._wanted is not None and self._window_wishes else decision.window
        wanted = change(window)
        if wanted.mode == window.mode == "until-answered":
            self._tell("a window until answered has no length: m gives it another mode")
            return
        self._window_wishes += 1
        self._wanted = wanted
        self._client.control("window", self._wanted)
        self._tell(f"window: {self._wanted.mode}, {self._wanted.span_ms / 1000:g} s …")

    def _pause(self) -> None:
        if self.progress.decision is not None and self._allowed("pause"):
            self._client.control("resume" if self.progress.decision.paused else "pause")

    def _allowed(self, right: str) -> bool:
        if right not in self.progress.rights:
            self._tell(f"you may not change that here: the session gives you no {right!r}", bad=True)
        return right in self.progress.rights


def _name(event: Key) -> str:
    return event.character if event.character and event.is_printable else event.key


def run(config: KeyboardConfig, bus: Bus) -> int:
    """Let a person teach until they leave; returns the exit code 0. The bus stays open.

    Raises: KeyboardError without a terminal or when answers cannot be kept, KeyNameError.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise KeyboardError("the keyboard teacher needs a terminal: run it in one, or use a scripted teacher")
    path = config.outbox or default_outbox(config)
    try:
        with Outbox(path) as outbox:
            return _teach(config, bus, outbox, path)
    except OutboxError as error:
        raise KeyboardError(str(error)) from error


def _teach(config: KeyboardConfig, bus: Bus, outbox: Outbox, path: Path) -> int:
    clock, keys = SystemClock(), Keys(config.deployment)
    with Client(
        bus,
        keys,
        config.session,
        config.teacher,
        outbox=outbox,
        clock=clock,
        token=config.token,
        check_key=config.check_key,
    ) as client:
        app = KeyboardApp(client, clock)
        code = app.run() or 0
        stopped, before = app.stop_listening(), client.unacknowledged
        waiting = client.drain(_DRAIN_S) if stopped else before
        saved = app.progress.answers_saved + before - waiting
        sys.stderr.write(_farewell(config.session, saved, waiting, path))
    return code


def default_outbox(config: KeyboardConfig) -> Path:
    """Where a teacher's answers are kept unless told otherwise: one file for each teacher of each session."""
    name = f"{config.deployment}.{config.session}.{config.teacher}.sqlite"
    return Path.home() / ".local" / "state" / "sfid" / "outbox" / name


def _farewell(session: str, saved: int, waiting: int, path: Path) -> str:
    kept = f"; {waiting} not acknowledged yet, kept in {path} for your next visit" if waiting else ""
    answers = "1 answer" if saved == 1 else f"{saved} answers"
    return f"left session {session}: {answers} saved{kept}\n"
