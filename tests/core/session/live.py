"""A shell for the session machine in a test: world, teachers, a virtual clock, a journal in memory."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from random import Random

from sfid_core.experiments.batch import world_of
from sfid_core.outcome import Outcome
from sfid_core.session.config import SessionConfig
from sfid_core.session.effects import BeginEpisode, Effect, Execute
from sfid_core.session.events import (
    AnswerGiven,
    EpisodeBegan,
    Event,
    StepTaken,
    TeacherJoined,
    WindowElapsed,
)
from sfid_core.session.machine import advance
from sfid_core.session.state import Phase, Session, new_session
from sfid_core.sokoban.actions import ACTIONS
from sfid_core.sokoban.board import Board
from sfid_core.sokoban.world import Consequence, World
from sfid_core.teaching.answers import Answer, AnswerKind
from sfid_core.teaching.simulated import SimulatedTeacher

MS = 1_000_000


@dataclass(slots=True)
class Live:
    """A session played to its end, one event at a time; teachers answer in an order drawn by `order`."""

    config: SessionConfig
    teachers: Mapping[str, SimulatedTeacher]
    order: Random
    session: Session = field(init=False)
    world: World = field(init=False)
    board: Board = field(init=False)
    before: Board = field(init=False)
    """Where the agent stood when it took the action that is judged."""
    at_ns: int = 0
    answers_given: int = 0
    journal: list[tuple[int, Event]] = field(default_factory=list)
    waiting: list[Event] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.session = new_session(self.config)
        self.world = world_of(self.config)

    def play(self) -> Session:
        for name in self.teachers:
            self._happen(TeacherJoined(name))
        while self.session.phase is not Phase.FINISHED:
            if self.session.phase is Phase.ASKING:
                self._ask()
        return self.session

    def _happen(self, event: Event) -> None:
        """Advance through the event and all that the world answers to it."""
        self.waiting.append(event)
        while self.waiting:
            self.at_ns += MS
            happened = self.waiting.pop(0)
            self.journal.append((self.at_ns, happened))
            _, effects = advance(self.session, self.at_ns, happened)
            for effect in effects:
                self._perform(effect)

    def _perform(self, effect: Effect) -> None:
        if isinstance(effect, BeginEpisode):
            self.board = self.world.begin(effect.episode)
            optimal_steps = self.world.optimal_steps(self.board)
            state, view = self.board.state_key(), self.board.to_xsb()
            self.waiting.append(EpisodeBegan(effect.episode, state, view, optimal_steps))
        elif isinstance(effect, Execute):
            if effect.action == len(ACTIONS):
                capped = self.session.step + 1 >= self.config.world.steps_max
                done = Consequence(self.before, 0.0, Outcome.CAP if capped else Outcome.RUNNING)
            else:
                done = self.world.execute(self.board, ACTIONS[effect.action], self.session.step)
            self.before = self.board
            self.board = done.board
            state, view = self.board.state_key(), self.board.to_xsb()
            distance = self.world.optimal_steps(self.board)
            taken = StepTaken(
                effect.decision, done.reward, done.outcome, state, view, -1 if distance is None else distance
            )
            self.waiting.append(taken)

    def _ask(self) -> None:
        """Let every teacher answer the open decision, then let the window elapse if it is still open."""
        decision, asked = self.session.decision, self.session.asks
        judged = self.board if self.session.transition is None else self.before
        optimal = self.world.optimal_actions(judged)
        state, action = self.session.state, self.session.action
        assert state == judged.state_key()
        for name in self.order.sample(sorted(self.teachers), len(self.teachers)):
            answer = self._answer_of(self.teachers[name], decision, state, action, optimal)
            if answer is not None:
                self.answers_given += 1
                answer_id = self.answers_given.to_bytes(16, "big")
                self._happen(AnswerGiven(name, answer_id, decision, state, answer))
        if (self.session.decision, self.session.phase, self.session.asks) == (decision, Phase.ASKING, asked):
            self.at_ns = (self.session.deadline_ns or self.at_ns) - MS
            self._happen(WindowElapsed())

    def _answer_of(
        self, teacher: SimulatedTeacher, decision: int, state: bytes, action: int, optimal: tuple[int, ...]
    ) -> Answer | None:
        if self.session.asks is AnswerKind.LABEL:
            label = teacher.label(decision, state, optimal)
            return None if label is None else Answer(AnswerKind.LABEL, action=label)
        if self.session.asks is AnswerKind.GUIDANCE:
            guidance = teacher.guidance(decision, state, optimal)
            return Answer(AnswerKind.GUIDANCE, guidance=guidance) if guidance else None
        if self.session.asks is AnswerKind.MISTAKE:
            better, step = teacher.mark(decision, state, action, optimal), self.session.step
            return None if better is None else Answer(AnswerKind.MISTAKE, action=better, steps=(step, step))
        reward = teacher.reward(decision, state, action, optimal)
        return None if reward is None else Answer(AnswerKind.REWARD, reward=reward)
