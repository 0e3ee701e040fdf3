"""What a history says, decoded once for all checkers: messages by kind, the journal's rows as they lie."""

import sqlite3
from collections import defaultdict
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from protocol.codec import DecodeError, decode, encode, unpack
from protocol.messages import Acknowledgement, Answer, Episode, SessionReport, Step, Wire
from protocol.world_messages import ExecuteAction, Executed
from services.simulate.nodes import KEYS
from services.simulate.scenario import SESSION
from services.simulate.stage import History

M = TypeVar("M", bound=Wire)
_MEASURES = KEYS.measures(SESSION)


@dataclass(frozen=True, slots=True)
class Row:
    """A row of the journal."""

    seq: int
    kind: str
    answer_id: bytes | None
    body: bytes


@dataclass(frozen=True, slots=True)
class Kept:
    """An answer in the journal."""

    seq: int
    code: str
    payload: bytes
    answer: Answer

    @property
    def counted(self) -> bool:
        """Whether it says anything: abstentions are not counted."""
        return self.answer.kind != "abstain"


@dataclass(frozen=True, slots=True)
class Told:
    """An acknowledgement that the learner sent, and the payload that it answers."""

    payload: bytes
    reply: Acknowledgement
    content: bytes
    """The payload without a token, which is no part of what was said: a damaged one may read as one."""


@dataclass(frozen=True, slots=True)
class Taken:
    """A step of the journal."""

    decision: int
    reward: float
    outcome: str
    state: bytes
    view: str


@dataclass(slots=True)
class Evidence:
    """Everything that the checkers look at."""

    history: History
    rows: list[Row] = field(default_factory=list)
    kept: list[Kept] = field(default_factory=list)
    told: list[Told] = field(default_factory=list)
    crowd_told: list[Told] = field(default_factory=list)
    """Acknowledgements of the aggregator."""
    crowd_rows: list[Row] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    """As published, repeats after a restart included."""
    executed: dict[tuple[int, int, int, bytes, str], set[bytes]] = field(
        default_factory=lambda: defaultdict(set)
    )
    """Replies of the environment by (episode, step, decision, state, action)."""
    actions: dict[int, str] = field(default_factory=dict)
    """The action that was last asked to be executed for a decision."""
    reports: list[SessionReport] = field(default_factory=list)
    report: SessionReport | None = None

    @property
    def last_steps(self) -> dict[int, Step]:
        """The last published step of each decision: an earlier one may not have survived a crash."""
        return {step.decision: step for step in self.steps}

    def accepted(self) -> dict[tuple[int, str], list[Kept]]:
        """Return the accepted answers by (decision, teacher), in the order of the journal."""
        found: dict[tuple[int, str], list[Kept]] = defaultdict(list)
        for one in self.kept:
            if one.code == "accepted":
                found[one.answer.decision, one.answer.teacher].append(one)
        return found

    def transitions(self) -> list[tuple[bytes, Taken]]:
        """Return (state before, step) of the journal, in order."""
        state = b""
        found = []
        for row in self.rows:
            if row.kind == "began":
                state = _fields(row.body)[1]
            elif row.kind == "step":
                taken = Taken(*_fields(row.body)[:5])
                found.append((state, taken))
                state = taken.state
        return found


def gather(history: History) -> Evidence:
    """Return the evidence of a history."""
    evidence = Evidence(history)
    asked: dict[int, bytes] = {}
    for seen in history.seen:
        if seen.what == "ask":
            asked[seen.ask] = seen.payload
        elif seen.what == "reply":
            _reply(evidence, seen.key, asked[seen.ask], seen.payload)
        elif seen.what == "publish" and seen.key == _MEASURES:
            step = _read(seen.payload, Step) or _read(seen.payload, Episode)
            if isinstance(step, Step):
                evidence.steps.append(step)
        if seen.what == "ask" and seen.key.endswith("/execute"):
            request = _read(seen.payload, ExecuteAction)
            if request is not None:
                evidence.actions[request.decision] = request.action
    if history.report is not None:
        evidence.report = _read(history.report, SessionReport)
    _rows(evidence)
    return evidence


def _reply(evidence: Evidence, key: str, asked: bytes, payload: bytes) -> None:
    if "/answer/" in key:
        told = _read(payload, Acknowledgement)
        if told is not None:
            ours = evidence.told if key.startswith(f"{KEYS.root}/") else evidence.crowd_told
            ours.append(Told(asked, told, _content(asked)))
    elif key.endswith("/execute"):
        request, done = _read(asked, ExecuteAction), _read(payload, Executed)
        if request is not None and done is not None:
            at = (request.episode, request.step, request.decision, request.state, request.action)
            evidence.executed[at].add(payload)
    elif key.endswith("/show"):
        report = _read(payload, SessionReport)
        if report is not None:
            evidence.reports.append(report)


def _content(payload: bytes) -> bytes:
    answer = _read(payload, Answer)
    if answer is None or answer.token is None:
        return payload
    fields = {name: getattr(answer, name) for name in answer.__struct_fields__}
    return encode(Answer(**fields | {"token": None}))


def _rows_in(directory: Path) -> list[Row]:
    path = directory / "shard-0" / "journal.sqlite"
    if not path.exists():
        return []
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as file:
        select = "SELECT seq, kind, answer_id, body FROM rows WHERE session = ? ORDER BY seq"
        return [Row(*row) for row in file.execute(select, (SESSION,))]


def _rows(evidence: Evidence) -> None:
    evidence.rows = _rows_in(evidence.history.data_dir)
    if evidence.history.crowd_dir is not None:
        evidence.crowd_rows = _rows_in(evidence.history.crowd_dir)
    for row in evidence.rows:
        if row.kind == "answer":
            code, _, payload = _fields(row.body)
            answer = _read(payload, Answer)
            if answer is not None:
                evidence.kept.append(Kept(row.seq, code, payload, answer))


def _fields(body: bytes) -> Any:  # noqa: ANN401 - a list of the row's kind
    return unpack(body)


def _read(payload: bytes, expected: type[M]) -> M | None:
    try:
        return decode(payload, expected)
    except DecodeError:
        return None
