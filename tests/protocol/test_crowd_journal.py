"""Rows of an aggregator's journal: whatever the bytes, one error class; whatever is changed, a mismatch."""

from contextlib import suppress

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.codec import DecodeError, decode, encode, pack
from protocol.crowd_forget import corrected_answers
from protocol.crowd_journal import (
    AskedRow,
    ClosedRow,
    CrowdConfig,
    CrowdKind,
    ReliabilityRow,
    asked_event,
    config_body,
    fold_crowd,
    name_body,
    read_config,
    row_body,
)
from protocol.journal import Record, answer_body
from protocol.messages import Answer
from sfid_core.crowd.round import Asked, RoundSettings
from sfid_core.crowd.settings import CrowdMethod, CrowdSettings
from sfid_core.session.effects import AnswerCode
from sfid_core.teaching.answers import Answer as Said
from sfid_core.teaching.answers import AnswerKind

ACTIONS = ("LEFT", "RIGHT", "UP", "DOWN")
STATE = bytes(16)
CONFIG = CrowdConfig(
    "crowd", ACTIONS, RoundSettings(quorum=3), CrowdSettings(method=CrowdMethod.MAJORITY, influence_cap=1.0)
)
ASKED = AskedRow(
    1, 0, 0, 0, STATE, "#@#", "label", None, 900, full=False, held=False, optimal=(2,), gold=True
)


def answer(worker: str, action: str, code: AnswerCode = AnswerCode.ACCEPTED, **changes: object) -> Record:
    message = Answer(
        answer_id=worker.encode().ljust(16, b"-"), session="s1", teacher=worker, epoch=1, decision=0,
        episode=0, step=0, state=STATE, kind="label", action=action,
    )  # fmt: skip
    payload = encode(msgspec.structs.replace(message, **changes))
    return Record(CrowdKind.ANSWER.value, 5, answer_body(code, "", payload))


def handed(action: str = "UP", **posterior: float) -> bytes:
    return encode(
        Answer(
            answer_id=b"handed-on-------", session="s1", teacher="crowd", epoch=1, decision=0, episode=0,
            step=0, state=STATE, kind="label", action=action, posterior=posterior,
        )
    )  # fmt: skip


def rows(*answers: Record, closed: ClosedRow | None = None) -> list[Record]:
    names = ("ann", "bob", "cat")
    made = [Record(CrowdKind.CREATED.value, 0, config_body(CONFIG))]
    made += [Record(CrowdKind.JOINED.value, 1, name_body(name)) for name in names]
    made += [Record(CrowdKind.ASKED.value, 2, row_body(ASKED)), *answers]
    if closed is not None:
        made.append(Record(CrowdKind.CLOSED.value, 9, row_body(closed)))
    return made


THREE = (answer("ann", "UP"), answer("bob", "UP"), answer("cat", "UP"))
CLOSED = ClosedRow(0, "quorum", 3, (0.0, 0.0, 1.0, 0.0), handed(LEFT=0.0, RIGHT=0.0, UP=1.0, DOWN=0.0))


def test_a_configuration_comes_back_as_it_was() -> None:
    assert read_config(config_body(CONFIG)) == CONFIG


def test_what_was_put_to_the_crowd_comes_back_as_the_event_it_was() -> None:
    expected = Asked(0, STATE, AnswerKind.LABEL, None, 900, full=False, held=False, optimal=(2,), gold=True)
    assert asked_event(ASKED) == expected


def test_rows_that_hold_together_have_no_mismatch() -> None:
    folded = fold_crowd(rows(*THREE, closed=CLOSED))
    assert folded is not None
    assert (folded.mismatches, folded.known) == ([], {"ann", "bob", "cat"})
    assert folded.closings == [(CLOSED, Said(AnswerKind.LABEL, 2, posterior=(0.0, 0.0, 1.0, 0.0)))]
    assert [one.payload for one in folded.handed] == [CLOSED.handed]


@pytest.mark.parametrize(
    "changed",
    [
        rows(answer("ann", "UP"), answer("bob", "UP"), answer("cat", "LEFT"), closed=CLOSED),
        rows(*THREE, closed=ClosedRow(0, "quorum", 3, (), handed("LEFT"))),
        rows(*THREE, closed=ClosedRow(0, "quorum", 3, (), b"")),
        rows(*THREE, closed=ClosedRow(0, "overtaken", 3, (), CLOSED.handed)),
        rows(answer("ann", "UP", AnswerCode.LATE), *THREE[1:], closed=CLOSED),
        rows(answer("ann", "UP", state=b"other"), *THREE[1:], closed=CLOSED),
        [
            *rows(*THREE, closed=CLOSED),
            Record("reliability", 9, row_body(ReliabilityRow("label", "ann", 0.5, 0.1, 7))),
        ],
    ],
)
def test_whatever_was_changed_is_a_mismatch(changed: list[Record]) -> None:
    folded = fold_crowd(changed)
    assert folded is not None
    assert folded.mismatches


def test_an_erased_answer_leaves_the_rest_to_be_folded() -> None:
    whole, erased = fold_crowd(rows(*THREE, closed=CLOSED)), fold_crowd(rows(*THREE[1:], closed=CLOSED))
    without = fold_crowd(rows(*THREE, closed=CLOSED), {"ann"})
    assert whole is not None
    assert erased is not None
    assert without is not None
    assert [answer for _, answer in erased.closings] == [answer for _, answer in without.closings]


def test_forgetting_a_worker_corrects_what_was_handed_on_under_the_same_id() -> None:
    said = (answer("ann", "UP"), answer("bob", "DOWN"), answer("cat", "UP"))
    shares = {"LEFT": 0.0, "RIGHT": 0.0, "UP": 2 / 3, "DOWN": 1 / 3}
    journal = rows(*said, closed=ClosedRow(0, "quorum", 3, tuple(shares.values()), handed("UP", **shares)))
    (corrected,) = corrected_answers(journal, {"cat"})
    tie = {"LEFT": 0.0, "RIGHT": 0.0, "UP": 0.5, "DOWN": 0.5}
    assert corrected.before == decode(handed("UP", **shares), Answer)
    assert corrected.after == msgspec.structs.replace(
        corrected.before, kind="abstain", action=None, posterior=tie
    )


def test_forgetting_everybody_takes_back_what_was_handed_on() -> None:
    journal = rows(*THREE, closed=CLOSED)
    assert [one.after for one in corrected_answers(journal, {"ann", "bob", "cat"})] == [None]


def test_forgetting_nobody_corrects_nothing() -> None:
    assert list(corrected_answers(rows(*THREE, closed=CLOSED), ())) == []


def test_no_rows_are_no_crowd() -> None:
    assert fold_crowd([]) is None


@pytest.mark.parametrize("kind", [*(kind.value for kind in CrowdKind), "nonsense"])
@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"\xc1",
        pack(None),
        pack([]),
        pack(["a", 1]),
        pack({"a": 1}),
        pack("S 1"),
        pack([0, "x", 1, [], b""]),
    ],
)
def test_a_row_that_cannot_be_read_is_one_error(kind: str, body: bytes) -> None:
    harmless = {"conflict", "finished"}
    first = [Record(CrowdKind.CREATED.value, 0, config_body(CONFIG))]
    for records in ([Record(kind, 0, body)], [*first, Record(kind, 0, body)]):
        if kind in harmless and len(records) == 2:
            assert fold_crowd(records) is not None
        else:
            with pytest.raises(DecodeError):
                fold_crowd(records)


@given(st.sampled_from([kind.value for kind in CrowdKind]), st.binary(max_size=200))
def test_random_bytes_are_one_error_or_a_crowd(kind: str, body: bytes) -> None:
    with suppress(DecodeError):  # and nothing else
        assert fold_crowd([*rows(*THREE), Record(kind, 0, body)]) is not None
