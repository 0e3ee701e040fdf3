"""Those beside the lesson: an operator, a viewer, and somebody who meddles."""

from collections import deque
from functools import partial
from random import Random

from protocol.codec import DecodeError, decode, encode
from protocol.messages import Answer, Control, CreateSession, Decision, SessionQuery
from services.runtime.bus import Received, Reply
from services.runtime.faulty_bus import FaultyHub
from services.simulate.nodes import ASK_MS, KEYS, RETRY_NS, Node
from services.simulate.scenario import SESSION


class OperatorNode(Node):
    """Creates the session, pauses and resumes it, and asks for the report at the end; asks until answered."""

    def __init__(self, hub: FaultyHub, seed: int, config: CreateSession) -> None:
        super().__init__(hub, "operator", seed)
        self.report: bytes | None = None
        self._config = config
        self._wishes: deque[tuple[str, bytes]] = deque([(KEYS.learner("create"), encode(config))])
        self._asking = False
        self._again_ns = 0
        """When to ask again after a refusal; what comes in meanwhile does not hurry it."""

    def begin(self) -> None:
        """See Node."""

    def pause(self, span_ns: int) -> None:
        """Pause the session for about so long."""
        self._control("pause")
        self.timeline.call_in(span_ns, partial(self._control, "resume"))

    def resume(self) -> None:
        """Resume the session: a pause that was repeated on its way may have come after its resume."""
        self._control("resume")

    def show(self) -> None:
        """Ask for the report, once the wishes before it are granted."""
        self._wishes.append((KEYS.learner("show"), encode(SessionQuery(session=SESSION))))
        self.wake()

    def _control(self, verb: str) -> None:
        message = Control(session=SESSION, teacher="operator", verb=verb)  # type: ignore[arg-type]
        self._wishes.append((KEYS.control(SESSION, "operator"), encode(message)))
        self.wake()

    def turn(self) -> None:
        """See Node."""
        if self._wishes and not self._asking and self.timeline.now_ns() >= self._again_ns:
            self._asking = True
            key, payload = self._wishes[0]
            self.bus.ask(key, payload, self._on_reply, ASK_MS)

    def _on_reply(self, reply: Reply | None) -> None:
        self._asking = False
        if reply is None or not reply.ok:
            self._again_ns = self.timeline.now_ns() + RETRY_NS
            self.timeline.call_at(self._again_ns, self.wake)
            return
        key, _ = self._wishes.popleft()
        if key == KEYS.learner("show"):
            self.report = reply.payload


class ViewerNode(Node):
    """Watches everything and asks for reports at odd moments; whatever it does must change nothing."""

    def begin(self) -> None:
        """See Node."""
        self.bus.subscribe(KEYS.decision(), self._hear)
        self.bus.subscribe(KEYS.measures(), self._hear)

    def _hear(self, _received: Received) -> None:
        if self.chance.random() < 0.1:
            self.bus.ask(
                KEYS.learner("show"), encode(SessionQuery(session=SESSION)), lambda _reply: None, ASK_MS
            )

    def turn(self) -> None:
        """See Node."""


class MeddlerNode(Node):
    """A second client under the teachers' names that does what a broken or hostile one would.

    It repeats what they sent, sends other contents under the same ids, answers decisions that are over or
    not open, for states that they were not asked about, and sends bytes that are no messages. None of this
    may change what is learnt. Unless it is `faithful` it also has second thoughts about open decisions.
    """

    def __init__(self, hub: FaultyHub, seed: int, *, faithful: bool) -> None:
        super().__init__(hub, "meddler", seed)
        self._faithful = faithful
        self.acknowledged: list[tuple[str, bytes]] = []
        """(key, payload) of answers that were acknowledged."""
        self._decision: Decision | None = None

    def begin(self) -> None:
        """See Node."""
        self.bus.subscribe(KEYS.decision(), self._hear)

    def _hear(self, received: Received) -> None:
        try:
            self._decision = decode(received.payload, Decision)
        except DecodeError:
            return
        if self.acknowledged and self.chance.random() < 0.25:
            key, payload = self.chance.choice(self.acknowledged)
            self.bus.ask(key, self._meddled(self.chance, payload), lambda _reply: None, ASK_MS)

    def _meddled(self, chance: Random, payload: bytes) -> bytes:
        before, decision = decode(payload, Answer), self._decision
        deed = chance.randrange(6 if self._faithful else 8)
        if deed == 0 or decision is None:
            return payload
        if deed == 1:
            return _with(
                before, action=chance.choice(decision.actions), response_ms=chance.randrange(1 << 30)
            )
        fresh = {"answer_id": chance.randbytes(16)}
        if deed == 2:
            return _with(before, **fresh)
        if deed == 3:
            return _with(before, **fresh, decision=decision.decision + chance.randint(2, 9))
        if deed == 4:
            other = bytes(byte ^ 0x55 for byte in decision.state) or b"elsewhere"
            return _with(before, **fresh, decision=decision.decision, step=decision.step, state=other)
        if deed == 5:
            return payload[: chance.randrange(len(payload))] + chance.randbytes(3)
        return _with(before, **fresh, **_second_thoughts(chance, before, decision))

    def turn(self) -> None:
        """See Node."""


def _second_thoughts(chance: Random, before: Answer, decision: Decision) -> dict[str, object]:
    """Return what turns an answer into another one to the open decision."""
    place = {"decision": decision.decision, "episode": decision.episode, "step": decision.step}
    judges = before.kind == "reward"
    said = {
        "action": decision.action if judges else chance.choice(decision.actions),
        "reward": chance.choice((-1.0, 1.0)) if judges else None,
    }
    return (
        place
        | {"epoch": decision.epoch, "state": decision.state}
        | (said if before.kind != "abstain" else {})
    )


def _with(answer: Answer, **changes: object) -> bytes:
    fields = {name: getattr(answer, name) for name in answer.__struct_fields__} | changes
    return encode(Answer(**fields))
