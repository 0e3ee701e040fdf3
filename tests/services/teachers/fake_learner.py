"""A small honest learner on a bus: welcomes, publishes decisions, acknowledges answers; it learns nothing."""

from collections.abc import Callable
from hashlib import blake2b
from typing import Any, Literal

import msgspec

from protocol.codec import decode, encode
from protocol.keys import Keys
from protocol.messages import (
    Acknowledgement,
    Answer,
    Control,
    Decision,
    Done,
    Join,
    Refusal,
    Welcome,
    WindowSpec,
    Wire,
)
from services.runtime.bus import Bus, Request

ROOM = "#####\n#.$@#\n#####"
EARLY = WindowSpec(mode="early", span_ms=1000)
KEYS = Keys("local")
Code = Literal["accepted", "superseded", "late", "rejected", "conflict"]


def decision(**changes: Any) -> Decision:  # noqa: ANN401 - any field
    """A decision that asks for a label in ROOM."""
    fields: dict[str, Any] = {
        "session": "s1",
        "epoch": 1,
        "sequence": 1,
        "decision": 0,
        "episode": 0,
        "step": 0,
        "phase": "asking",
        "paused": False,
        "asked": "label",
        "state": b"room",
        "view": ROOM,
        "actions": ("LEFT", "RIGHT", "UP", "DOWN"),
        "window": EARLY,
        "method": "sfid",
        "episodes": 30,
        "optimal_steps": 1,
    }
    return Decision(**(fields | changes))


class FakeLearner:
    """Serves one session; what arrived is kept, what is replied is set by the test."""

    def __init__(self, bus: Bus, first: Decision | None = None, *, session: str = "s1") -> None:
        self.bus = bus
        self.decision = first or decision(session=session)
        self.joins: list[Join] = []
        self.answers: list[Answer] = []
        self.payloads: list[bytes] = []
        self.controls: list[Control] = []
        self.code: Code = "accepted"
        self.check_key: bytes | None = None
        self.join_refusal: Refusal | None = None
        self.answer_replies: list[Callable[[Request], None]] = []
        """Replies to the next answers, one each, in the place of an acknowledgement."""
        self.on_answer: Callable[[Answer], None] = _nothing
        self.on_join: Callable[[int], None] = _nothing
        """Called with the number of joins so far, before the reply."""
        bus.serve(KEYS.join(session), self._on_join)
        bus.serve(KEYS.answer(session), self._on_answer)
        bus.serve(KEYS.control(session), self._on_control)

    def publish(self, message: Wire) -> None:
        """Publish a decision, a step or an episode."""
        if isinstance(message, Decision):
            self.decision = message
            self.bus.publish(KEYS.decision(message.session), encode(message))
        else:
            self.bus.publish(KEYS.measures(self.decision.session), encode(message))

    def go_on(self, **changes: Any) -> Decision:  # noqa: ANN401 - any field
        """Publish the decision with the next sequence number and these changes."""
        self.publish(msgspec.structs.replace(self.decision, sequence=self.decision.sequence + 1, **changes))
        return self.decision

    def acknowledgement(self, payload: bytes) -> bytes:
        """The reply to an answer with this payload."""
        return encode(
            Acknowledgement(
                answer_id=decode(payload, Answer).answer_id,
                code=self.code,
                check=blake2b(payload, digest_size=8, key=self.check_key or b"").digest(),
                epoch=self.decision.epoch,
                journal_seq=len(self.payloads),
            )
        )

    def _on_join(self, request: Request) -> None:
        self.joins.append(decode(request.payload, Join))
        self.on_join(len(self.joins))
        if self.join_refusal is not None:
            request.reply_error(encode(self.join_refusal))
            return
        welcome = Welcome(
            session=self.decision.session,
            epoch=self.decision.epoch,
            rights=("answer", "window", "pause"),
            decision=self.decision,
            check_key=self.check_key,
        )
        request.reply(encode(welcome))

    def _on_answer(self, request: Request) -> None:
        self.payloads.append(request.payload)
        self.answers.append(answer := decode(request.payload, Answer))
        if self.answer_replies:
            self.answer_replies.pop(0)(request)
        else:
            request.reply(self.acknowledgement(request.payload))
            self.on_answer(answer)

    def _on_control(self, request: Request) -> None:
        self.controls.append(wish := decode(request.payload, Control))
        if wish.window is not None:
            self.go_on(window=wish.window)
        request.reply(encode(Done(ok=True)))


def refuse(code: Any, reason: str = "because") -> Callable[[Request], None]:  # noqa: ANN401 - a Refusal's code
    """Reply with this refusal."""
    return lambda request: request.reply_error(encode(Refusal(code=code, reason=reason)))


def drop(_request: Request) -> None:
    """Let the request fall: the asker gets no answer."""


def _nothing(_argument: object) -> None:
    pass
