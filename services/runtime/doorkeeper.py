"""Who may teach where tokens are required: whoever bears a good one for this session and this name."""

import logging
from collections import Counter
from collections.abc import Callable
from enum import Enum
from pathlib import Path

from protocol.identity import Identity, Role, TokenError, TokenFault, is_revoked, sign, verify
from services.runtime.register import Register, new_token_id
from services.runtime.secret import FOLDER, load_secrets

log = logging.getLogger("sfid.door")

_S = 1_000_000_000
OWN_S = 366 * 24 * 3600
"""How long a service may bear a token that it has given to itself."""


class DoorFault(Enum):
    """Why nobody is let in: a closed list, for counters."""

    MISSING = "missing-token"
    MALFORMED = TokenFault.MALFORMED.value
    FORGED = TokenFault.FORGED.value
    EXPIRED = TokenFault.EXPIRED.value
    REVOKED = TokenFault.REVOKED.value
    INVITATION = "invitation"
    """An invitation is exchanged at the page for a token of one's own; nobody teaches with it."""
    SESSION = "token-of-another-session"
    NAME = "token-of-another-name"


_ASK = "ask whoever runs the session for `sfid invite --name`"
MENDS = {
    DoorFault.MISSING: f"this deployment requires a token: {_ASK}, and give it as --token-file",
    DoorFault.MALFORMED: f"the token is not whole: {_ASK}",
    DoorFault.FORGED: f"the token is not of this deployment: {_ASK}",
    DoorFault.EXPIRED: f"the token has expired: {_ASK}",
    DoorFault.REVOKED: f"the token has been withdrawn: {_ASK}",
    DoorFault.INVITATION: f"an invitation is for the page: {_ASK}",
    DoorFault.SESSION: f"the token is for another session: {_ASK}",
    DoorFault.NAME: "the token is another person's: teach under the name that it was given for",
}


class Doorkeeper:
    """Verifies the tokens of requests, and counts what it refuses; no token reaches a log or a reply.

    Args: data_dir: of the deployment, where the gateway keeps its secret and its register; wall_ns: the time.
    Raises: SecretError.
    """

    def __init__(self, data_dir: Path, wall_ns: Callable[[], int]) -> None:
        folder = data_dir / FOLDER
        self.refused: Counter[DoorFault] = Counter()
        self._wall_ns = wall_ns
        self._secrets = load_secrets(folder)
        self._inside: dict[tuple[str, str], Identity] = {}
        self._register = Register(folder)

    def fault(self, session: str, teacher: str, token: str | None) -> DoorFault | None:
        """Return why `teacher` is not let into `session` with this token, counted; None where they are."""
        fault = self._fault(session, teacher, token)
        if fault is not None:
            self.refused[fault] += 1
            count = self.refused[fault]
            if count & (count - 1) == 0:  # 1, 2, 4, 8 ...
                log.warning("session %s: %s refused, %s (%d so far)", session, teacher, fault.value, count)
        return fault

    def own(self, session: str, name: str) -> str:
        """Return a token for a service of this deployment that teaches by itself."""
        now_s = self._wall_ns() // _S
        identity = Identity(
            role=Role.TEACHER, session=session, pseudonym=name, expires_s=now_s + OWN_S,
            token_id=new_token_id(),
        )  # fmt: skip
        return sign(identity, self._secrets)

    def _fault(self, session: str, teacher: str, token: str | None) -> DoorFault | None:
        if token is None:
            return DoorFault.MISSING
        self._register.refresh()  # what was revoked a moment ago is worth nothing now
        try:
            identity = verify(token, self._secrets, self._wall_ns() / _S, self._register.revoked)
        except TokenError as error:
            return DoorFault(error.fault.value)
        if identity.role is not Role.TEACHER:
            return DoorFault.INVITATION
        if identity.session != session:
            return DoorFault.SESSION
        if identity.pseudonym != teacher:
            return DoorFault.NAME
        self._inside[session, teacher] = identity
        return None

    def has_let_in(self, session: str, teacher: str) -> bool:
        """Tell whether the teacher has shown a good token in this life of the service."""
        return (session, teacher) in self._inside

    def no_longer(self) -> list[tuple[str, str]]:
        """Return, once each, who was let in (session, name) by a token that is no longer good."""
        self._register.refresh()
        now_s, revoked = self._wall_ns() / _S, self._register.revoked
        out = [
            place
            for place, identity in self._inside.items()
            if now_s >= identity.expires_s or is_revoked(identity, self._secrets, revoked)
        ]
        for place in out:
            del self._inside[place]
        return out


def reason_of(fault: DoorFault) -> str:
    """Return what a refusal says of it."""
    return f"{fault.value}: {MENDS[fault]}"
