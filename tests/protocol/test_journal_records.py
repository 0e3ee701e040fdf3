"""Journal records: every event there and back, and damage told as damage."""

from dataclasses import replace
from random import Random

import msgspec
import pytest

from protocol.codec import DecodeError, decode, encode
from protocol.journal import (
    Kind,
    Record,
    answer_body,
    digest_body,
    event_body,
    events_of,
    fold,
    read_answer_body,
    step_body,
    without_token,
)
from protocol.messages import Answer, CreateSession, WindowSpec, World
from protocol.translate import answer_given
from sfid_core.outcome import Outcome
from sfid_core.session.config import Window, WindowMode
from sfid_core.session.effects import AnswerCode
from sfid_core.session.events import (
    EpisodeBegan,
    Event,
    Paused,
    Restarted,
    Resumed,
    StepTaken,
    Stopped,
    TeacherJoined,
    TeacherLeft,
    WindowChanged,
    WindowElapsed,
)

NUMBERS = {"LEFT": 0, "RIGHT": 1, "UP": 2, "DOWN": 3}
STATE = bytes(range(16))
CONFIG = CreateSession(
    session="s1",
    world=World(level="#####\n#@$.#\n#####"),
    window=WindowSpec(mode="until-answered", span_ms=1_000),
    episodes=2,
)
STEP = StepTaken(0, -0.5, Outcome.DEADLOCK, STATE, "#####\n# @*#\n#####")


def answer(**changes: object) -> Answer:
    told = Answer(
        answer_id=bytes(16), session="s1", teacher="ann", epoch=1, decision=0, episode=0, step=0, state=STATE,
        kind="label", action="UP",
    )  # fmt: skip
    return msgspec.structs.replace(told, **changes)


@pytest.mark.parametrize(
    "event",
    [
        TeacherJoined("ann"),
        TeacherLeft("ann"),
        EpisodeBegan(3, STATE, "#@#", None),
        EpisodeBegan(0, STATE, "#@#", 11),
        WindowElapsed(),
        WindowChanged("ann", Window(WindowMode.FULL, 2_500, 3)),
        WindowChanged("ann", Window(WindowMode.FULL, 2_500, 3), afresh=True),
        Paused("operator"),
        Resumed("ann"),
        Stopped("operator"),
        Restarted(7),
    ],
    ids=lambda event: type(event).__name__,
)
def test_every_event_comes_back_from_its_row(event: Event) -> None:
    kind, body = event_body(event)
    assert list(events_of(Record(kind.value, 42, body), NUMBERS)) == [(42, event)]


def test_a_step_comes_back_with_the_closing_that_led_to_it() -> None:
    alone = Record(Kind.STEP.value, 42, step_body(STEP, None))
    closed = Record(Kind.STEP.value, 42, step_body(STEP, 40))
    assert list(events_of(alone, NUMBERS)) == [(42, STEP)]
    assert list(events_of(closed, NUMBERS)) == [(40, WindowElapsed()), (42, STEP)]


@pytest.mark.parametrize("action, undone", [(2, 0), (4, 1), (2, -1), (-1, 1)])
def test_a_step_comes_back_with_what_was_done_where_answers_were_erased(action: int, undone: int) -> None:
    followed = replace(STEP, action=action, undone=undone)
    row = Record(Kind.STEP.value, 42, step_body(followed, None))
    assert list(events_of(row, NUMBERS)) == [(42, followed)]


def test_an_answer_comes_back_as_it_was_sent_with_what_its_teacher_was_told() -> None:
    payload = encode(answer())
    body = answer_body(AnswerCode.LATE, "because", payload)
    assert read_answer_body(body) == (AnswerCode.LATE, "because", payload)
    expected = answer_given(answer(), NUMBERS)
    assert list(events_of(Record(Kind.ANSWER.value, 42, body), NUMBERS)) == [(42, expected)]


def test_a_token_is_taken_out_and_nothing_else() -> None:
    with_token = answer(token="canary")  # noqa: S106 - a canary, not a password
    kept = without_token(with_token, encode(with_token))
    assert decode(kept, Answer) == answer()
    plain = encode(answer())
    assert without_token(answer(), plain) is plain


def test_rows_that_are_no_events_yield_nothing() -> None:
    for kind in (Kind.CREATED, Kind.DIGEST, Kind.CONFLICT):
        assert list(events_of(Record(kind.value, 1, b"anything"), NUMBERS)) == []


def rows() -> list[Record]:
    """One decision of a session, from its creation to the digest after its step."""
    told = answer_body(AnswerCode.ACCEPTED, "", encode(answer()))
    began = EpisodeBegan(0, STATE, "#####\n#@$.#\n#####", 1)
    records = [Record(Kind.CREATED.value, 0, encode(CONFIG))]
    events: tuple[Event, ...] = (Restarted(1), TeacherJoined("ann"), began)
    for at_ns, event in enumerate(events, 1):
        kind, body = event_body(event)
        records.append(Record(kind.value, at_ns, body))
    records.append(Record(Kind.ANSWER.value, 5, told))
    records.append(Record(Kind.STEP.value, 6, step_body(STEP, None)))
    folded = fold(records)
    assert folded is not None
    body = digest_body(folded.session, folded.session.learner.sha256())
    return [*records, Record(Kind.DIGEST.value, 7, body)]


def test_rows_fold_to_the_session_they_tell() -> None:
    folded = fold(rows())
    assert folded is not None
    assert (folded.config, folded.known, folded.events, folded.digests) == (CONFIG, {"ann"}, 5, 1)
    assert (folded.mismatches, len(folded.actions_taken), folded.session.decision) == ([], 1, 1)
    assert [(at_ns, decision) for at_ns, decision, _ in folded.session.episodes.ended(0, 9)] == [(6, 1)]


def test_no_rows_are_no_session() -> None:
    assert fold([]) is None


def test_an_answer_told_otherwise_than_it_folds_is_a_mismatch() -> None:
    records = rows()
    assert records[4].kind == "answer"
    records[4] = records[4]._replace(body=answer_body(AnswerCode.LATE, "", encode(answer())))
    folded = fold(records)
    assert folded is not None
    assert folded.mismatches == [0]


def test_a_digest_of_another_table_is_a_mismatch() -> None:
    folded = fold(rows())
    assert folded is not None
    wrong = Record(Kind.DIGEST.value, 7, digest_body(folded.session, "0" * 64))
    again = fold([*rows()[:-1], wrong])
    assert again is not None
    assert (again.mismatches, again.digests) == ([1], 1)


@pytest.mark.parametrize(
    "body",
    [b"", b"\xc1", msgspec.msgpack.encode({}), msgspec.msgpack.encode([]), msgspec.msgpack.encode([1] * 6),
     msgspec.msgpack.encode(["x"] * 4), msgspec.msgpack.encode([[], [], [], []]), msgspec.msgpack.encode(-1),
     msgspec.msgpack.encode([0, [], "", None]), msgspec.msgpack.encode("Not A Name")],
)  # fmt: skip
def test_a_body_of_the_wrong_form_is_a_decode_error_in_every_kind_of_row(body: bytes) -> None:
    for place, record in enumerate(rows()):
        if record.kind != Kind.ELAPSED.value:
            damaged = rows()
            damaged[place] = record._replace(body=body)
            with pytest.raises(DecodeError):
                fold(damaged)


def test_an_unknown_kind_of_row_is_a_decode_error() -> None:
    with pytest.raises(DecodeError):
        fold([*rows(), Record("sorcery", 8, b"\xc0")])


def test_whatever_is_damaged_only_a_decode_error_comes_out() -> None:
    chance = Random(1)
    refused = 0
    for _ in range(3_000):
        records = rows_once[:]
        place = chance.randrange(1, len(records))
        body = bytearray(records[place].body)
        body[chance.randrange(len(body))] = chance.randrange(256)
        records[place] = records[place]._replace(body=bytes(body))
        try:
            fold(records)
        except DecodeError:
            refused += 1
    assert refused > 100


rows_once = rows()
