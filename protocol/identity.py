"""Who a person is: signed, expiring, revocable tokens. Pure: secrets, time and revocations are arguments.

A token is `BODY.SIGNATURE`, both in base64url without padding. BODY is a MessagePack array (README.md of this
folder has its fields), SIGNATURE is HMAC-SHA-256 over the text of BODY. One spelling of a token is valid, so
a token with any character changed is refused.
"""

import hashlib
import hmac
import re
from collections.abc import Container, Sequence
from enum import Enum
from functools import lru_cache
from typing import Annotated, Literal

import msgspec
from itsdangerous import BadData, BadSignature, Signer
from itsdangerous.encoding import base64_decode, base64_encode
from msgspec import Meta

from protocol.codec import DecodeError, pack, unpack
from protocol.fields import Count, Name

TOKEN_CHARACTERS_MAX = 512
"""The longest honest token has about 260."""
SECRET_BYTES_MIN = 32
_SALT = b"sfid.identity.1"
"""Keeps these signatures apart from any other use of the same secret."""

_SIXTEEN_HEX = "[0-9a-f]{16}"
TokenId = Annotated[str, Meta(pattern=rf"^{_SIXTEEN_HEX}\Z")]
TokenIdOrNone = Annotated[str, Meta(pattern=rf"^({_SIXTEEN_HEX})?\Z")]
NameOrNone = Annotated[str, Meta(pattern=r"^([a-z0-9][a-z0-9_-]{0,47})?\Z")]


class Role(Enum):
    """What a token lets its bearer do."""

    TEACHER = "teacher"
    """Teach a session under one pseudonym."""
    INVITATION = "invitation"
    """Be given a TEACHER token of one's own; several people may bear the same invitation."""


class Identity(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True, kw_only=True):
    """What a token says about its bearer.

    pseudonym: empty for an invitation.  expires_s: seconds since 1970, valid before it.  invitation: the id
    of the invitation it was given for, empty when given in person; revoking one revokes the other.
    people: for how many an invitation is good, 0 for a teacher.
    """

    version: Literal[1] = 1
    role: Role
    session: Name
    pseudonym: NameOrNone = ""
    expires_s: Count
    token_id: TokenId
    invitation: TokenIdOrNone = ""
    people: Annotated[int, Meta(ge=0, le=100_000)] = 0


class TokenFault(Enum):
    """Why a token is not accepted: a closed list, for counters."""

    MALFORMED = "malformed-token"
    """Not a token at all, or signed content of another version."""
    FORGED = "forged-token"
    """The signature is not ours: altered, guessed, or of another deployment."""
    EXPIRED = "expired-token"
    REVOKED = "revoked-token"


class TokenError(ValueError):
    """A token is not accepted; nothing else escapes `verify`. The text never holds the token."""

    def __init__(self, fault: TokenFault) -> None:
        super().__init__(fault.value)
        self.fault = fault


def sign(identity: Identity, secrets: Sequence[bytes]) -> str:
    """Return the token that says `identity`, signed with the newest secret.

    Args: secrets: oldest first, each of 32 bytes or more; all of them verify, so that a secret can be
    replaced while tokens are out.  Raises: ValueError for a short or missing secret.
    """
    body = base64_encode(pack(msgspec.to_builtins(identity)))
    return _signer(secrets).sign(body).decode("ascii")


def verify(token: str, secrets: Sequence[bytes], now_s: float, revoked: Container[str]) -> Identity:
    """Return whom a token speaks of, when it is ours, of this version, in time and not revoked.

    Args: secrets: as for `sign`.  now_s: seconds since 1970.  revoked: ids of tokens and invitations.
    Raises: TokenError, and nothing else, whatever the token; ValueError for a short or missing secret.
    """
    identity = _read(_signed_body(token, secrets))
    if now_s >= identity.expires_s:
        raise TokenError(TokenFault.EXPIRED)
    if is_revoked(identity, secrets, revoked):
        raise TokenError(TokenFault.REVOKED)
    return identity


def is_revoked(identity: Identity, secrets: Sequence[bytes], revoked: Container[str]) -> bool:
    """Tell whether a token, the invitation it was given for, or its bearer is among the revoked."""
    if identity.token_id in revoked or (identity.invitation and identity.invitation in revoked):
        return True
    marks = (
        withdrawal_mark(identity.pseudonym, session, tuple(secrets)) for session in ("", identity.session)
    )
    return bool(identity.pseudonym) and any(mark in revoked for several in marks for mark in several)


@lru_cache(8192)  # whoever teaches brings the same token with every answer
def withdrawal_mark(pseudonym: str, session: str, secrets: tuple[bytes, ...]) -> tuple[str, ...]:
    """Return what stands in a list of revoked ids for a person who has withdrawn, by secret.

    It has the form of a token's id and does not give the pseudonym away to who has not the secret, so that a
    person can be forgotten and their tokens stay worthless. The oldest secret's mark is the one to note.

    Args: session: only from this one; empty for all.
    """
    said = f"withdrawn {session}/{pseudonym}".encode()
    return tuple(hmac.digest(secret, said, "sha256")[:8].hex() for secret in secrets)


@lru_cache(8192)  # asked with every answer
def check_key(session: str, teacher: str, secrets: tuple[bytes, ...]) -> bytes:
    """Return the 32 bytes that key the checks of a teacher's acknowledgements, the same after every restart.

    The oldest secret makes it, so that it stays while a newer one signs.
    """
    return hmac.digest(secrets[0], f"acknowledges {session}/{teacher}".encode(), "sha256")


def check_of(payload: bytes, key: bytes | None) -> bytes:
    """Return the 8 bytes by which a teacher knows that an answer was acknowledged as it was sent.

    Args: key: of `check_key`; None: anybody who sees the answer can make the check.
    """
    return hashlib.blake2b(payload, digest_size=8, key=key or b"").digest()


def is_token_id(text: str) -> bool:
    """Tell whether a text has the form of a token's id."""
    return re.fullmatch(_SIXTEEN_HEX, text) is not None


def _signed_body(token: str, secrets: Sequence[bytes]) -> bytes:
    if len(token) > TOKEN_CHARACTERS_MAX or not token.isascii() or token.count(".") != 1:
        raise TokenError(TokenFault.MALFORMED)
    signer = _signer(secrets)
    try:
        body = signer.unsign(token)
    except BadSignature:
        raise TokenError(TokenFault.FORGED) from None
    # Base64 spells 32 bytes in four ways; only the one that we write is a token.
    spelt = token.encode("ascii").rpartition(b".")[2]
    if not hmac.compare_digest(base64_encode(base64_decode(spelt)), spelt):
        raise TokenError(TokenFault.FORGED)
    return body


def _read(body: bytes) -> Identity:
    try:
        identity = msgspec.convert(unpack(base64_decode(body)), Identity)
    except (BadData, DecodeError, msgspec.ValidationError):
        raise TokenError(TokenFault.MALFORMED) from None
    if (identity.role is Role.TEACHER) != bool(identity.pseudonym):
        raise TokenError(TokenFault.MALFORMED)
    return identity


def _signer(secrets: Sequence[bytes]) -> Signer:
    if not secrets or any(len(secret) < SECRET_BYTES_MIN for secret in secrets):
        message = f"a secret has {SECRET_BYTES_MIN} bytes or more, and there is at least one"
        raise ValueError(message)
    return Signer(list(secrets), salt=_SALT, sep=".", key_derivation="hmac", digest_method=hashlib.sha256)
