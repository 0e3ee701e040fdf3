"""A flood of one teacher holds up that teacher: others are served as before, and nothing goes uncounted."""

from collections import Counter
from pathlib import Path

from protocol.codec import decode, encode
from protocol.messages import Acknowledgement, Refusal
from services.runtime.bus import Reply
from services.runtime.turnstile import Turnstile
from tests.services.learner.classroom import KEYS, Classroom, Pupil, session, status

WAITING_MAX = 32
FLOOD = 500


def test_of_one_teacher_only_so_many_messages_wait_and_the_rest_is_told_to_come_again(tmp_path: Path) -> None:
    room = Classroom(tmp_path / "data")
    room.create(session(teachers_min=2))
    flooder, honest = Pupil(room, "flooder"), Pupil(room, "ann")
    flooder.join()
    honest.join()
    replies: list[Reply | None] = []
    for _ in range(FLOOD):
        message = flooder.message(room.decision, action="UP")
        flooder.bus.ask(KEYS.answer("s1", "flooder"), encode(message), replies.append, 1_000)
    answers: list[Reply | None] = []
    key, label = KEYS.answer("s1", "ann"), honest.message(room.decision, action="UP")
    honest.bus.ask(key, encode(label), answers.append, 1_000)
    room.settle()
    (told,) = answers
    assert told is not None
    assert decode(told.payload, Acknowledgement).code == "accepted"
    kinds = Counter(reply is not None and reply.ok for reply in replies)
    assert kinds == {True: WAITING_MAX, False: FLOOD - WAITING_MAX}
    refused = [decode(reply.payload, Refusal) for reply in replies if reply is not None and not reply.ok]
    assert {(refusal.code, refusal.reason) for refusal in refused} == {
        ("busy", "too many messages of yours wait: send it again")
    }
    told_of_all = status(room)
    assert told_of_all.refused == {"too-many-waiting": FLOOD - WAITING_MAX}
    assert (told_of_all.labels.submitted, told_of_all.backlog) == (WAITING_MAX + 1, 0)
    room.shard.close()


def test_whoever_has_been_served_may_come_again() -> None:
    turnstile = Turnstile(2)
    assert [turnstile.enter(name) for name in ("ann", "ann", "ann", "bob")] == [True, True, False, True]
    turnstile.leave("ann")
    assert (turnstile.enter("ann"), turnstile.enter("ann"), turnstile.refused) == (True, False, 2)
    for name in ("ann", "ann", "bob", "bob"):
        turnstile.leave(name)
    assert [turnstile.enter("bob") for _ in range(3)] == [True, True, False]
