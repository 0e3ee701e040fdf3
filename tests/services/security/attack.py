"""Somebody with a login and a token of their own tries to speak as others do.

    .venv/bin/python -m tests.services.security.attack --attempts 10000

The continuous integration runs fewer attempts by the same code (test_spoofing.py).
"""

import argparse
import itertools
import json
import sys
import tempfile
import threading
from base64 import urlsafe_b64decode, urlsafe_b64encode
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import zenoh
from zenoh.handlers import Callback

from protocol.codec import decode, encode
from protocol.identity import check_of
from protocol.journal import read_answer_body
from protocol.messages import (
    Acknowledgement,
    Answer,
    Control,
    Decision,
    Join,
    RowsQuery,
    SessionQuery,
    Welcome,
    Wire,
)
from protocol.world_messages import ExecuteAction
from services.cli.shared import launch
from services.runtime.bus import Received
from services.runtime.journal import read_rows
from services.topology import Role
from tests.services.security.lesson import KEYS, SESSION, Lesson, Teacher, lesson

VICTIM, ATTACKER = "ann", "mallory"
MARK = "FORGED"
OPEN_MAX = 64
"""Queries under way at once."""
PATIENCE_S = 30.0


@dataclass
class Result:
    """What came of the attempts."""

    attempts: int = 0
    tried: dict[str, int] = field(default_factory=dict)
    answered_well: dict[str, int] = field(default_factory=dict)
    """Queries that were granted, by what was tried."""
    overheard: int = 0
    """Queries of others that reached the attacker's servers."""
    injected: int = 0
    """The attacker's decisions, steps or deletions that reached a teacher or the monitor."""
    labels_in_anothers_name: int = 0
    labels_of_the_attacker: int = 0
    acknowledgements_disbelieved: int = 0
    """Acknowledgements that reached the honest teacher without the learner's key."""
    honest_acknowledged: int = 0
    honest_lost: int = 0
    """Answers whose acknowledgement the honest teacher believed, and that are not in the journal."""
    paused: bool = False


class Attacker:
    """Mallory, with everything that her login and her token let her do, and more."""

    def __init__(self, house: Lesson, result: Result) -> None:
        self.result = result
        self._token = house.token(ATTACKER)
        self._session = house.raw("teacher")
        self._free = threading.Semaphore(OPEN_MAX)
        self._decision: Decision | None = None
        self._ids = itertools.count(1)
        self._declared: list[object] = []
        self._kind = ""

    def close(self) -> None:
        """Wait for every reply, and go."""
        for _ in range(OPEN_MAX):
            assert self._free.acquire(timeout=PATIENCE_S)
        self._session.close()

    def stand(self) -> None:
        """Serve what others ask, listen to everything, be present as another: as long as the attack lasts."""
        for key in (
            KEYS.answer(SESSION, VICTIM), KEYS.answer(), KEYS.join(SESSION, VICTIM), KEYS.control(),
            KEYS.environment("*"), KEYS.learner("*"), "sfid/**", "**",
        ):  # fmt: skip
            serve = Callback(self._overhear, indirect=False)
            self._declared.append(self._session.declare_queryable(key, serve, complete=True))
        self._declared.append(self._session.liveliness().declare_token(KEYS.service("learner", "shard-0")))

    def _overhear(self, query: zenoh.Query) -> None:
        self.result.overheard += 1
        payload = query.payload.to_bytes() if query.payload is not None else b""
        with suppress(Exception):
            answer = decode(payload, Answer)
            forged = Acknowledgement(
                answer_id=answer.answer_id, code="accepted", check=check_of(payload, None), epoch=1,
                journal_seq=1,
            )  # fmt: skip
            query.reply(query.key_expr, encode(forged))

    def join(self) -> None:
        """Take part under her own name, as she may; what she learns so helps her attempts."""
        replies: list[bytes] = []
        done = threading.Event()

        def on_reply(reply: zenoh.Reply) -> None:
            assert reply.ok is not None
            replies.append(reply.ok.payload.to_bytes())

        message = Join(session=SESSION, teacher=ATTACKER, token=self._token)
        self._session.get(
            KEYS.join(SESSION, ATTACKER),
            Callback(on_reply, done.set, indirect=False),
            payload=encode(message), timeout=5.0, allowed_destination=zenoh.Locality.REMOTE,
        )  # fmt: skip
        assert done.wait(PATIENCE_S)
        self._decision = decode(replies[0], Welcome).decision

    def tries(self) -> Iterator[tuple[str, Callable[[], None]]]:
        """Yield the kinds of attempts, again and again."""
        kinds: dict[str, Callable[[], None]] = {
            "answer as another, by her key": lambda: self._answer(VICTIM, VICTIM),
            "answer on another's key, as herself": lambda: self._answer(VICTIM, ATTACKER),
            "answer on her key, as another": lambda: self._answer(ATTACKER, VICTIM),
            "answer as another, without a token": lambda: self._answer(VICTIM, VICTIM, token=None),
            "answer as another, token rewritten": lambda: self._answer(
                VICTIM, VICTIM, token=self._rewritten()
            ),
            "answer to every key at once": lambda: self._answer("*", VICTIM),
            "join as another": lambda: self._join_as(VICTIM),
            "stop as the operator": lambda: self._control("operator", "stop"),
            "stop as the operator, to every key": lambda: self._control("*", "stop", "operator"),
            "pause as another": lambda: self._control(VICTIM, "pause"),
            "read the journal": lambda: self._ask(KEYS.learner("rows"), RowsQuery(session=SESSION)),
            "list sessions": lambda: self._ask(KEYS.learner("list"), SessionQuery()),
            "execute an action": self._execute,
            "publish a decision": lambda: self._put(KEYS.decision(SESSION), self._fake()),
            "publish a decision to every key": lambda: self._put(f"{KEYS.root}/**", self._fake()),
            "publish a step's key": lambda: self._put(KEYS.measures(SESSION), self._fake()),
            "delete a decision": lambda: self._session.delete(KEYS.decision(SESSION)),
        }
        yield from itertools.cycle(kinds.items())

    def _answer(self, key: str, name: str, **changes: Any) -> None:  # noqa: ANN401 - any field
        decision = self._decision
        assert decision is not None
        fields: dict[str, Any] = {"token": self._token, **changes}
        answer = Answer(
            answer_id=next(self._ids).to_bytes(16, "big"), session=SESSION, teacher=name,
            epoch=decision.epoch, decision=decision.decision, episode=decision.episode, step=decision.step,
            state=decision.state, kind="label", action="UP", **fields,
        )  # fmt: skip
        self._ask(KEYS.answer(SESSION, key), answer)

    def _join_as(self, name: str) -> None:
        self._ask(KEYS.join(SESSION, name), Join(session=SESSION, teacher=name, token=self._token))

    def _control(self, key: str, verb: Any, name: str | None = None) -> None:  # noqa: ANN401 - a literal
        message = Control(session=SESSION, teacher=name or key, verb=verb, token=self._token)
        self._ask(KEYS.control(SESSION, key), message)

    def _execute(self) -> None:
        decision = self._decision
        assert decision is not None
        message = ExecuteAction(
            session=SESSION, epoch=decision.epoch, decision=decision.decision, episode=decision.episode,
            step=decision.step, state=decision.state, action="UP",
        )  # fmt: skip
        self._ask(KEYS.environment("execute"), message)

    def _rewritten(self) -> str:
        body, _, signature = self._token.partition(".")
        said = urlsafe_b64decode(body + "=" * (-len(body) % 4))
        # In MessagePack a short text's first byte is 0xa0 + its length.
        mine, theirs = (bytes([0xA0 + len(name)]) + name.encode() for name in (ATTACKER, VICTIM))
        assert mine in said
        return urlsafe_b64encode(said.replace(mine, theirs)).rstrip(b"=").decode() + "." + signature

    def _fake(self) -> bytes:
        assert self._decision is not None
        return encode(msgspec.structs.replace(self._decision, sequence=2**40, epoch=2**40, view=MARK))

    def _put(self, key: str, payload: bytes) -> None:
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)

    def _ask(self, key: str, message: Wire) -> None:
        assert self._free.acquire(timeout=PATIENCE_S)
        kind = self._kind

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                self.result.answered_well[kind] = self.result.answered_well.get(kind, 0) + 1

        self._session.get(
            key, Callback(on_reply, self._free.release, indirect=False), payload=encode(message), timeout=5.0,
            # Not to the servers that she declared herself.
            allowed_destination=zenoh.Locality.REMOTE,
        )  # fmt: skip

    def attack(self, attempts: int) -> None:
        """Try so often, each kind in turn."""
        tried: Counter[str] = Counter()
        for kind, attempt in itertools.islice(self.tries(), attempts):
            self._kind = kind
            attempt()
            tried[kind] += 1
        self.result.attempts, self.result.tried = tried.total(), dict(tried)


def attacked(data: Path, attempts: int, *, guarded: bool = True) -> Result:
    """Return what came of so many attempts at a session that an honest teacher teaches meanwhile.

    Args: guarded: whether the router has its access control.
    """
    result = Result()
    with lesson(data, guarded=guarded) as house:
        ann = Teacher(house, VICTIM)
        seen: list[bytes] = []

        def see(received: Received) -> None:
            seen.append(received.payload)

        monitor = launch.bus(house.deployed, Role.MONITOR)
        monitor.subscribe(KEYS.decision(), see)
        monitor.subscribe(KEYS.measures(), see)
        mallory = Attacker(house, result)
        mallory.stand()
        ann.start()
        assert ann.answering.wait(PATIENCE_S)
        mallory.join()
        mallory.attack(attempts)
        mallory.close()
        result.paused = house.operator.show(SESSION)[0].summary.paused
        ann.leave.set()
        ann.join(PATIENCE_S)
        monitor.close()
        result.injected = sum(MARK.encode() in payload for payload in seen) + (MARK in ann.views)
        result.acknowledgements_disbelieved = ann.disbelieved
    _read_journal(data, ann, result)
    return result


def _read_journal(data: Path, ann: Teacher, result: Result) -> None:
    kept: dict[bytes, str] = {}
    for row in read_rows(data, SESSION):
        if row.kind in {"answer", "conflict"} and row.body is not None:
            payload = row.body if row.kind == "conflict" else read_answer_body(row.body)[2]
            answer = decode(payload, Answer)
            kept[answer.answer_id] = answer.teacher
    mallorys = {number.to_bytes(16, "big") for number in range(1, result.attempts + 1)}
    result.labels_in_anothers_name = sum(kept.get(one) == VICTIM for one in mallorys)
    result.labels_of_the_attacker = sum(kept.get(one) == ATTACKER for one in mallorys)
    result.honest_acknowledged = len(ann.acknowledged)
    result.honest_lost = len(ann.acknowledged - kept.keys())


def main() -> None:
    """Attack and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--attempts", type=int, default=10_000)
    attempts = parser.parse_args().attempts
    with tempfile.TemporaryDirectory(prefix="sfid-attack-") as name:
        sys.stdout.write(json.dumps(asdict(attacked(Path(name) / "data", attempts)), indent=1) + "\n")


if __name__ == "__main__":
    main()
