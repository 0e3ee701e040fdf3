"""A journal as a long lesson leaves it, written without the lesson's processes: real rows, a real digest."""

import random
from pathlib import Path
from typing import NamedTuple

from protocol.codec import encode
from protocol.journal import Kind, answer_body, digest_body, event_body, step_body
from protocol.messages import Answer, CreateSession, WindowSpec, World
from protocol.translate import answer_given, config_of
from services.runtime.journal import Shard
from sfid_core.outcome import Outcome
from sfid_core.session.effects import Acknowledge, Execute
from sfid_core.session.events import AnswerGiven, EpisodeBegan, Event, StepTaken, TeacherJoined
from sfid_core.session.machine import advance
from sfid_core.session.state import new_session

SESSION, TEACHER = "s1", "ann"
LEVEL = "#######\n#.  $@#\n#     #\n#######"
ACTIONS = ("LEFT", "RIGHT", "UP", "DOWN")
NUMBERS = {name: index for index, name in enumerate(ACTIONS)}
STATES = tuple(random.Random(1).randbytes(16) for _ in range(60))
STEPS = 20
"""Of an episode."""
ROWS_A_COMMIT = 512
MS = 1_000_000


class Written(NamedTuple):
    """What stands in the journal."""

    labels: int
    rows: int
    q_sha256: str
    last: bytes
    """The last answer as it was sent: its acknowledgement must come again."""


class _Lesson:
    def __init__(self, shard: Shard, labels: int) -> None:
        world = World(level=LEVEL, level_name="long", starts="1", steps_max=STEPS)
        window = WindowSpec(mode="until-answered", span_ms=1_000, quorum=1)
        config = CreateSession(
            session=SESSION, world=world, seed=1, window=window, teachers_min=1, episodes=labels // STEPS + 2
        )
        self.shard, self.chance, self.at_ns, self.rows = shard, random.Random(2), 0, 0
        self.session = new_session(config_of(config), len(ACTIONS))
        self.last = b""
        self._append(Kind.CREATED, encode(config))
        self.happen(TeacherJoined(TEACHER))

    def _append(self, kind: Kind, body: bytes, unique: bytes | None = None) -> None:
        person = None if unique is None else TEACHER
        self.shard.append(SESSION, kind.value, body, at_ns=self.at_ns, unique=unique, person=person)
        self.rows += 1
        if self.rows % ROWS_A_COMMIT == 0:
            self.shard.commit()

    def happen(self, event: Event) -> None:
        """Journal an event and let it take effect, as the learner does."""
        self.at_ns += MS
        if isinstance(event, StepTaken):
            self._append(Kind.STEP, step_body(event, None))
        else:
            self._append(*event_body(event))
        advance(self.session, self.at_ns, event)

    def answer(self) -> None:
        """Let the teacher answer the open decision."""
        session = self.session
        message = Answer(
            answer_id=self.chance.randbytes(16), session=SESSION, teacher=TEACHER, epoch=session.epoch,
            decision=session.decision, episode=session.episode, step=session.step, state=session.state,
            kind="label", action=self.chance.choice(ACTIONS), response_ms=400,
        )  # fmt: skip
        self.at_ns += MS
        self.last = encode(message)
        event: AnswerGiven = answer_given(message, NUMBERS)
        _, effects = advance(session, self.at_ns, event)
        told, asked = effects[0], effects[1:]
        assert isinstance(told, Acknowledge)
        assert any(isinstance(effect, Execute) for effect in asked)
        self._append(Kind.ANSWER, answer_body(told.code, told.reason, self.last), message.answer_id)

    def step(self) -> None:
        """Let the environment execute what was decided."""
        session = self.session
        over = session.step == STEPS - 1
        state = self.chance.choice(STATES)
        outcome = Outcome.SOLVED if over else Outcome.RUNNING
        self.happen(StepTaken(session.decision, 10.0 if over else 0.0, outcome, state, LEVEL))

    def digest(self) -> str:
        """Note the digest."""
        found = self.session.learner.sha256()
        self._append(Kind.DIGEST, digest_body(self.session, found))
        return found


def write_lesson(data_dir: Path, labels: int) -> Written:
    """Write a session of so many labels, each with its step; the session is not finished."""
    with Shard.open(data_dir) as shard:
        lesson = _Lesson(shard, labels)
        for number in range(labels):
            if number % STEPS == 0:
                lesson.happen(EpisodeBegan(number // STEPS, lesson.chance.choice(STATES), LEVEL, 5))
            lesson.answer()
            lesson.step()
        digest = lesson.digest()
    return Written(labels, lesson.rows, digest, lesson.last)
