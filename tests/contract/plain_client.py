"""A teacher written from protocol/README.md alone: Zenoh and MessagePack, nothing of this project.

Section titles of that page stand at what was written from them.
"""

import hashlib
import os
import queue
import time
from collections.abc import Callable
from typing import Any

import msgpack
import zenoh

Map = dict[str, Any]


class PlainTeacher:
    """One teacher of one session."""

    def __init__(self, endpoint: str, session: str, name: str) -> None:
        # Transport
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["{endpoint}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        self.zenoh = zenoh.open(config)
        self.session, self.name = session, name
        self.root = "sfid/v1/local"
        self.key: bytes | None = None
        self.heard: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self.newest: Map = {"epoch": -1, "sequence": -1}
        # A teacher's life: subscribe, declare the token, join
        self.subscriber = self.zenoh.declare_subscriber(
            f"{self.root}/session/{session}/decision", lambda sample: self.heard.put(bytes(sample.payload))
        )
        self.token = self.zenoh.liveliness().declare_token(f"{self.root}/session/{session}/present/{name}")

    def close(self) -> None:
        self.token.undeclare()
        self.subscriber.undeclare()
        self.zenoh.close()

    def query(self, key: str, payload: bytes) -> tuple[bool, Map]:
        """Ask until there is a reply; whether it is no error, and what it says."""
        while True:
            replies = self.zenoh.get(
                f"{self.root}/{key}", payload=payload, timeout=2.0, consolidation=zenoh.ConsolidationMode.NONE
            )
            for reply in replies:
                if reply.ok is not None:
                    return True, msgpack.unpackb(bytes(reply.ok.payload))
                if reply.err is not None and bytes(reply.err.payload):
                    refusal = msgpack.unpackb(bytes(reply.err.payload))
                    # Refusals: these three are sent again
                    if refusal["code"] not in {"busy", "not-durable", "unknown-session"}:
                        return False, refusal

    def ask(self, key: str, message: Map) -> tuple[bool, Map]:
        return self.query(key, msgpack.packb({"schema": 1, **message}))

    def sessions(self) -> tuple[list[Map], set[int]]:
        """All sessions, and the shards that no reply told of though a question was asked twice."""
        found: dict[str, Map] = {}
        absent: set[int] = set()
        leave_out: int | None = 0
        while leave_out is not None:
            lists = self.lists(leave_out)
            if lacking(lists):
                lists = self.lists(leave_out)
            absent |= lacking(lists)
            found |= {one["session"]: one for each in lists for one in each["sessions"]}
            leave_out = min((each["older"] for each in lists if each["older"] is not None), default=None)
        return list(found.values()), absent

    def lists(self, leave_out: int) -> list[Map]:
        """Several learners: consolidation NONE, and every reply is read."""
        query = msgpack.packb({"type": "session-query", "schema": 1, "leave_out": leave_out})
        replies = self.zenoh.get(
            f"{self.root}/learner/list",
            payload=query,
            timeout=2.0,
            consolidation=zenoh.ConsolidationMode.NONE,
        )
        return [msgpack.unpackb(bytes(reply.ok.payload)) for reply in replies if reply.ok is not None]

    def join(self) -> Map:
        ok, welcome = self.ask(
            f"session/{self.session}/join/{self.name}",
            {"type": "join", "session": self.session, "teacher": self.name},
        )
        assert ok, welcome
        self.key = welcome.get("check_key")
        self.see(welcome["decision"])
        return welcome

    def see(self, decision: Map) -> None:
        """Follow the decisions: the greatest (epoch, sequence) is the newest."""
        if (decision["epoch"], decision["sequence"]) > (self.newest["epoch"], self.newest["sequence"]):
            self.newest = decision

    def wait_for(self, wanted: Callable[[Map], bool], seconds: float = 20.0) -> Map:
        """Return the newest decision once it is wanted; joins again when nothing was heard for a while."""
        deadline = time.monotonic() + seconds
        while not wanted(self.newest):
            assert time.monotonic() < deadline, self.newest
            try:
                self.see(msgpack.unpackb(self.heard.get(timeout=1.0)))
            except queue.Empty:
                self.join()
        return self.newest

    def label(self, decision: Map, action: str, changes: Map | None = None) -> bytes:
        """The bytes of an answer, to be stored before they are sent, and sent as they are."""
        copied = ("session", "epoch", "decision", "episode", "step", "state")
        answer = {name: decision[name] for name in copied}
        answer |= {"type": "answer", "schema": 1, "answer_id": os.urandom(16), "teacher": self.name}
        return bytes(msgpack.packb(answer | {"kind": "label", "action": action} | (changes or {})))

    def send(self, payload: bytes) -> tuple[bool, Map]:
        """Never lose an answer: the acknowledgement is ours by its id and its check."""
        ok, reply = self.query(f"session/{self.session}/answer/{self.name}", payload)
        if ok:
            check = hashlib.blake2b(payload, digest_size=8, key=self.key or b"").digest()
            assert reply["check"] == check
            assert reply["answer_id"] == msgpack.unpackb(payload)["answer_id"]
        return ok, reply


def lacking(lists: list[Map]) -> set[int]:
    """All sessions: the shards that no list tells of; where there is no list at all, one is missed."""
    shards = max((each["shards"] for each in lists), default=1)
    return set(range(shards)) - {shard for each in lists for shard in each["told"]}
