"""What a teacher at the terminal knows of the session: fed with updates, read by the panel."""

from collections import deque
from dataclasses import dataclass
from typing import Literal

from protocol.messages import Decision, Episode, Step, WindowSpec
from services.client import (
    AnswerState,
    AnswerUpdate,
    Connection,
    Controlled,
    EpisodeOver,
    Learnt,
    Opened,
    Refused,
    Update,
    Welcomed,
)

EPISODES_SHOWN = 200
_NEXT_MODE: dict[str, Literal["early", "full", "until-answered"]] = {
    "early": "full",
    "full": "until-answered",
    "until-answered": "early",
}
_SAID = {
    AnswerState.SENDING: "sending…",
    AnswerState.SAVED: "saved",
    AnswerState.TOO_LATE: "too late: kept, not applied",
    AnswerState.REJECTED: "rejected",
}


@dataclass(frozen=True, slots=True)
class Note:
    """One line for the teacher; `bad` when something is wrong."""

    text: str
    bad: bool = False


class Progress:
    """The session as seen from here. Times are ns on the client's clock."""

    def __init__(self) -> None:
        self.decision: Decision | None = None
        self.received_ns = 0
        self.connected = False
        self.welcomed = False
        self.rights: tuple[str, ...] = ()
        self.note = Note("joining…")
        self.step: Step | None = None
        self.episodes: deque[Episode] = deque(maxlen=EPISODES_SHOWN)
        self.answers_saved = 0
        self.answer_text = ""
        self.answer_fate = ""
        self.answer_bad = False
        self.answer_before = False
        """Whether that answer was to an earlier decision than the one shown."""
        self._answer_id = b""
        self.by_rewards = False
        """Whether rewards judged the last judged step: then the agreement is praise."""
        self._inputs = self._judged = self._agreements = 0
        self._teaching_ns = 0
        self._asked_since_ns: int | None = None

    @property
    def open_decision(self) -> Decision | None:
        """The decision that waits for an answer, None when none does."""
        decision = self.decision
        usable = decision is not None and decision.phase == "asking" and not decision.paused
        return decision if usable and self.welcomed and self.connected else None

    @property
    def finished(self) -> bool:
        """Whether the session is over."""
        return self.decision is not None and self.decision.phase == "finished"

    @property
    def inputs(self) -> int:
        """Answers applied in the episodes seen, the running one included."""
        return sum(episode.inputs for episode in self.episodes) + self._inputs

    @property
    def agreement(self) -> float | None:
        """Share of the judged steps seen here in which the agent was told yes; None without one."""
        return self._agreements / self._judged if self._judged else None

    def teaching_s(self, now_ns: int) -> float:
        """Return how long decisions have waited for an answer while this teacher watched."""
        since_ns = self._asked_since_ns
        return (self._teaching_ns + (now_ns - since_ns if since_ns is not None else 0)) / 1e9

    def remaining_ms(self, now_ns: int) -> int | None:
        """Return what is left of the window, None without a deadline."""
        if self.decision is None or self.decision.remaining_ms is None:
            return None
        return max(0, self.decision.remaining_ms - (now_ns - self.received_ns) // 1_000_000)

    def said(self, answer_id: bytes, text: str) -> None:
        """Note what the teacher has just said."""
        self._answer_id, self.answer_text = answer_id, text
        self.answer_fate, self.answer_bad = _SAID[AnswerState.SENDING], False
        self.answer_before = False

    def apply(self, update: Update, now_ns: int) -> None:
        """Take in one update."""
        match update:
            case Opened():
                self._open(update, now_ns)
            case Learnt(step):
                self._learnt(step)
            case EpisodeOver(episode):
                self._episode_over(episode)
            case AnswerUpdate():
                self._answer(update)
            case Connection(connected, detail):
                self.connected = connected
                self.note = Note(detail, bad=not connected)
            case Welcomed(welcome):
                self._welcomed(welcome.rights, welcome.episodes)
            case Refused(_, reason):
                self.welcomed = False
                self.note = Note(f"not admitted: {reason}", bad=True)
            case Controlled(verb, ok, reason):
                self.note = Note(f"{verb}: {reason or 'done'}", bad=not ok)

    def _welcomed(self, rights: tuple[str, ...], episodes: tuple[Episode, ...]) -> None:
        if not self.welcomed or not self.connected:
            self.note = Note("joined: your keys count")
        self.connected = self.welcomed = True
        self.rights = rights
        for episode in episodes:
            self._episode_over(episode)

    def _open(self, opened: Opened, now_ns: int) -> None:
        before, self.decision, self.received_ns = self.decision, opened.decision, opened.received_ns
        asking = opened.decision.phase == "asking" and not opened.decision.paused
        if self._asked_since_ns is not None and not asking:
            self._teaching_ns += now_ns - self._asked_since_ns
            self._asked_since_ns = None
        elif self._asked_since_ns is None and asking:
            self._asked_since_ns = now_ns
        if before is None or before.decision != opened.decision.decision:
            self.answer_before = True
        if self.finished:
            self.note = Note("the session is finished: thank you. q leaves")

    def _learnt(self, step: Step) -> None:
        last = self.step
        if last is not None and (step.epoch, step.decision) <= (last.epoch, last.decision):
            return
        self.step = step
        self._inputs += sum(said.kind != "abstain" for said in step.said)
        if step.h:
            self._judged += 1
            self._agreements += step.h > 0
            self.by_rewards = any(said.kind == "reward" for said in step.said)

    def _episode_over(self, episode: Episode) -> None:
        if self.episodes and episode.episode <= self.episodes[-1].episode:
            return
        self.episodes.append(episode)
        self._inputs = 0

    def _answer(self, update: AnswerUpdate) -> None:
        self.answers_saved += update.state is AnswerState.SAVED
        if update.answer_id == self._answer_id:
            fate = _SAID.get(update.state, f"retrying {update.attempts}")
            self.answer_fate = f"{fate}: {update.reason}" if _explained(update) else fate
            self.answer_bad = update.state in {AnswerState.RETRYING, AnswerState.REJECTED}


def _explained(update: AnswerUpdate) -> bool:
    return bool(update.reason) and update.state in {AnswerState.RETRYING, AnswerState.REJECTED}


def next_window(window: WindowSpec) -> WindowSpec:
    """Return the window with the next mode: early, full, until-answered, early."""
    return WindowSpec(mode=_NEXT_MODE[window.mode], span_ms=window.span_ms, quorum=window.quorum)


SPAN_STEP_MS = 250
SPAN_MS_MIN, SPAN_MS_MAX = 250, 3_600_000


def stretched_window(window: WindowSpec, steps: int) -> WindowSpec:
    """Return the window longer by so many steps of 250 ms, within 250 ms and an hour."""
    whole = window.span_ms // SPAN_STEP_MS + steps + (steps < 0 and window.span_ms % SPAN_STEP_MS > 0)
    span_ms = min(SPAN_MS_MAX, max(SPAN_MS_MIN, whole * SPAN_STEP_MS))
    return WindowSpec(mode=window.mode, span_ms=span_ms, quorum=window.quorum)
