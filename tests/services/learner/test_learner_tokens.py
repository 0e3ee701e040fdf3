"""A deployment that requires tokens lets in whoever bears their own, and nobody else."""

import logging
from collections.abc import Iterator
from pathlib import Path

import pytest

from protocol.codec import decode
from protocol.identity import Role, sign
from protocol.journal import read_answer_body
from protocol.messages import Acknowledgement, Answer, Join, Refusal
from services.runtime.doorkeeper import MENDS, DoorFault
from services.runtime.register import Register, for_session
from services.runtime.secret import load_secrets
from tests.services.learner.classroom import KEYS, MS, Classroom, Pupil
from tests.services.learner.guarded_room import HOUR_S, ID, GuardedRoom

OTHER_ID, INVITATION_ID = "00000000000000b1", "00000000000000c1"


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[GuardedRoom]:
    made = GuardedRoom(tmp_path / "data")
    made.create()
    yield made
    made.shard.discard_pending()
    made.shard.close()


def why_not(room: GuardedRoom, token: str | None, name: str = "ann") -> str:
    """Return why a join and an answer with this token are denied, which leaves nothing in the journal."""
    pupil, before = Pupil(room, name), len(room.rows())
    join = Join(session="s1", teacher=name, token=token)
    answer = pupil.message(room.decision, action="UP", token=token)
    asked = ((KEYS.join("s1", name), join), (KEYS.answer("s1", name), answer))
    refusal, same = (room.refused(key, message) for key, message in asked)
    assert (refusal.code, refusal, len(room.rows())) == ("denied", same, before)
    assert token is None or token not in refusal.reason
    return refusal.reason.partition(":")[0]


def test_who_bears_their_own_token_teaches_and_the_token_is_neither_journaled_nor_logged(
    guarded: GuardedRoom, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    token = guarded.token()
    ann = Pupil(guarded, "ann")
    assert ann.join(token=token).rights == ("answer", "window", "pause")
    answer = ann.message(guarded.decision, action="UP", token=token)
    assert decode(ann.send(answer).payload, Acknowledgement).code == "accepted"
    (row,) = guarded.rows("answer")
    assert decode(read_answer_body(row.body or b"")[2], Answer).token is None
    assert why_not(guarded, token + "x") == "forged-token"
    for path in guarded.data_dir.rglob("*"):
        assert not path.is_file() or token.encode() not in path.read_bytes()
    assert token.partition(".")[0] not in caplog.text
    assert "forged-token" in caplog.text


def test_every_kind_of_wrong_token_is_refused_and_counted_by_its_kind(guarded: GuardedRoom) -> None:
    token = guarded.token()
    others = sign(guarded.identity(), [b"of another deployment, 32 bytes!"])
    now_s = guarded.clock.wall_ns() // 1_000_000_000
    wrong = {
        None: "missing-token",
        "no token": "malformed-token",
        ("A" if token[0] != "A" else "B") + token[1:]: "forged-token",
        others: "forged-token",
        guarded.token(expires_s=now_s): "expired-token",
        guarded.token("", role=Role.INVITATION, people=30): "invitation",
        guarded.token(session="s2"): "token-of-another-session",
        guarded.token("bea"): "token-of-another-name",
    }
    assert {one: why_not(guarded, one) for one in wrong} == wrong
    # A join and an answer each.
    assert guarded.refused_by == {
        "missing-token": 2, "malformed-token": 2, "forged-token": 4, "expired-token": 2, "invitation": 2,
        "token-of-another-session": 2, "token-of-another-name": 2,
    }  # fmt: skip
    assert guarded.rows("answer") == []


def test_a_token_that_is_revoked_is_worth_nothing_at_its_next_answer_and_so_is_its_invitation(
    guarded: GuardedRoom,
) -> None:
    invited = guarded.token("bea", token_id=OTHER_ID, invitation=INVITATION_ID)
    teachers = {"ann": guarded.token(), "bea": invited}
    for name, token in teachers.items():
        Pupil(guarded, name).join(token=token)
    for token_id in (ID, INVITATION_ID):
        Register(guarded.data_dir / "gateway").revoke(token_id)
    assert [why_not(guarded, token, name) for name, token in teachers.items()] == ["revoked-token"] * 2


def test_a_token_expires_while_its_bearer_teaches(guarded: GuardedRoom) -> None:
    token = guarded.token()
    ann = Pupil(guarded, "ann")
    ann.join(token=token)
    guarded.clock.advance(HOUR_S * 1_000 * MS)
    reply = ann.send(ann.message(guarded.decision, action="UP", token=token))
    assert decode(reply.payload, Refusal).reason.startswith("expired-token")


def test_a_study_gives_a_person_a_token_for_each_session_and_revoking_one_revokes_all(
    guarded: GuardedRoom,
) -> None:
    secrets = load_secrets(guarded.data_dir / "gateway")
    token = for_session(guarded.identity(session="study"), "s1", secrets)
    assert Pupil(guarded, "ann").join(token=token).session == "s1"
    Register(guarded.data_dir / "gateway").revoke(ID)
    assert why_not(guarded, token) == "revoked-token"


def test_the_operator_needs_no_token_and_nobody_else_controls_without_one(guarded: GuardedRoom) -> None:
    ann = Pupil(guarded, "ann")
    ann.join(token=guarded.token())
    assert decode(ann.control("pause").payload, Refusal).reason.startswith("missing-token")
    assert guarded.operate("stop").ok


def test_a_learner_that_requires_nothing_asks_for_no_secret(room: Classroom) -> None:
    room.create()
    assert Pupil(room, "ann").join(token=ID).session == "s1"
    assert not (room.data_dir / "gateway").exists()
    assert room.learner.reception.desk.door is None


def test_every_reason_has_its_mend() -> None:
    assert set(MENDS) == set(DoorFault)
