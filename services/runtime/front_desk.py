"""What every service that people answer does at its door: who they are, what cannot be read, what is saved.

Learner and aggregator have one each; what an answer means is their own.
"""

import logging
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from protocol.codec import encode
from protocol.identity import check_key, check_of
from protocol.keys import KeyNameError, Keys
from protocol.messages import Acknowledgement, Answer, Control, Join, Refusal
from protocol.translate import UnknownAction
from services.runtime.bus import Request
from services.runtime.doorkeeper import Doorkeeper, reason_of
from services.runtime.durable_loop import DurableLoop
from services.runtime.roll import Place, Roll, run_of
from sfid_core.session.effects import AnswerCode

NOBODY = ("-", "-")
"""Session and sender where the key names none, or there are too many to count each."""
SENDERS_MAX = 10_000
"""Senders whose unreadable messages are counted one by one: names cost an attacker nothing."""
LET_GO_MS = 1_000
"""How soon nobody waits any longer for whoever was sent away."""
RefusalCode = Literal["malformed", "unknown-session", "denied", "busy", "not-durable", "conflict", "invalid"]


class Refused(Exception):  # noqa: N818 - not a fault of the program
    """The request cannot be served; carries the reply."""

    def __init__(self, code: RefusalCode, reason: str) -> None:
        super().__init__(reason)
        self.reply = Refusal(code=code, reason=reason[:512])


@dataclass(frozen=True, slots=True)
class DeskSettings:
    """Whose desk it is, and how it knows people."""

    service: str
    """Name of the service, in its log."""
    data_dir: Path
    """The deployment's directory, where its secrets and its register are."""
    require_tokens: bool
    """Whether people are let in only with a token that the deployment's secret has signed."""
    check_secrets: tuple[bytes, ...]
    """What keys the checks of acknowledgements; empty: they have no key."""


class FrontDesk:
    """Knows people, counts what is unreadable, acknowledges; on the loop's thread. Raises: SecretError."""

    def __init__(self, loop: DurableLoop, keys: Keys, settings: DeskSettings) -> None:
        self._loop, self._keys = loop, keys
        self._check_secrets = settings.check_secrets
        self._log = logging.getLogger(f"sfid.{settings.service}")
        self.door = Doorkeeper(settings.data_dir, loop.at_ns) if settings.require_tokens else None
        self.malformed: Counter[tuple[str, str]] = Counter()
        """Unreadable messages by (session, sender)."""
        self.invalid: Counter[tuple[str, str]] = Counter()
        """Messages that can be read and say nothing possible, such as an action that there is not."""
        self.roll = Roll(one_each=self.door is None)
        """Whoever comes with a token has proved to be the same person, who may sit at two screens."""

    def admit(self, key: str, message: Join | Answer | Control, *, unproved: bool = False) -> None:
        """Let a message in whose key names its session and sender, who is proved where tokens are required.

        Args: unproved: the sender needs no token. Raises: Refused, KeyNameError.
        """
        if self._keys.session_and_teacher(key) != (message.session, message.teacher):
            raise Refused("denied", "the key names another session or teacher than the message")
        if self.door is None or unproved:
            return
        fault = self.door.fault(message.session, message.teacher, message.token)
        if fault is not None:
            raise Refused("denied", reason_of(fault))

    def check_alone(self, message: Join) -> None:
        """Refuse a second one of a name that is here; raises Refused."""
        if self.roll.has_let_in_another((message.session, message.teacher), run_of(message.client)):
            raise Refused(
                "conflict",
                f"somebody teaches {message.session} as {message.teacher} already: choose another --name, "
                "or wait until they have left",
            )

    def has_joined(self, message: Join) -> None:
        """Remember by which run of a program somebody teaches."""
        self.roll.let_in((message.session, message.teacher), run_of(message.client))

    def let_go(self, leave: Callable[[str, str], None]) -> None:
        """Call `leave` with session and name of everybody whose token is no longer good, from now on.

        Whoever was sent away and holds still would be waited for otherwise.
        """
        if self.door is not None:
            for session, name in self.door.no_longer():
                leave(session, name)
            self._loop.call_later(LET_GO_MS, self.let_go, leave)

    def is_here(self, place: Place) -> bool:
        """Tell whether somebody counts as present: anybody may announce anybody."""
        return self.roll.is_here(place) and (self.door is None or self.door.has_let_in(*place))

    def check_key(self, message: Join | Answer) -> bytes | None:
        """Return what keys the checks for this person; None where checks have no key."""
        secrets = self._check_secrets
        return check_key(message.session, message.teacher, secrets) if secrets else None

    def acknowledge(
        self, request: Request, message: Answer, code: AnswerCode, reason: str, journal_seq: int
    ) -> None:
        """Tell what became of an answer, after the next commit."""
        reply = Acknowledgement(
            answer_id=message.answer_id,
            code=code.word,
            reason=reason,
            check=check_of(request.payload, self.check_key(message)),
            epoch=self._loop.shard.epoch,
            journal_seq=journal_seq,
        )
        self._loop.reply_durably(request, reply)

    def refuse(self, request: Request, error: Exception) -> None:
        """Answer with an error; what cannot be used is counted by sender and logged at 1, 2, 4, 8 ..."""
        if isinstance(error, Refused):
            request.reply_error(encode(error.reply))
            return
        readable = isinstance(error, UnknownAction)
        code: RefusalCode = "invalid" if readable else "malformed"
        request.reply_error(encode(Refusal(code=code, reason=str(error)[:512])))
        counts = self.invalid if readable else self.malformed
        sender = self._sender(request.key)
        if len(counts) >= SENDERS_MAX and sender not in counts:
            sender = NOBODY
        counts[sender] += 1
        count = counts[sender]
        if count & (count - 1) == 0:
            text = "session %s: %s message %d from %s: %s"
            what = "invalid" if readable else "unreadable"
            self._log.warning(text, sender[0], what, count, sender[1], error)

    def refusals(self) -> dict[str, int]:
        """Return how many requests were refused, by reason."""
        found = {
            "malformed": self.malformed.total(),
            "invalid": self.invalid.total(),
            "too-many-waiting": self._loop.turnstile.refused,
        }
        if self.door is not None:
            found |= {fault.value: count for fault, count in self.door.refused.items()}
        return {reason: count for reason, count in found.items() if count}

    def _sender(self, key: str) -> tuple[str, str]:
        try:
            return self._keys.session_and_teacher(key)
        except KeyNameError:
            return NOBODY
