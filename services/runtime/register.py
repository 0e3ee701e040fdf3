"""What is kept about those who are given tokens: what was issued, taken up and revoked; never a token.

A file of JSON lines that is only appended to, by the gateway, `sfid keys` and `sfid invite`, and read by all
who verify tokens; each line is one write of less than a page, so writers do not mix, and it is synced before
anybody is told.
"""

import errno
import hashlib
import json
import os
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from protocol.fields import Count
from protocol.identity import Identity, NameOrNone, Role, TokenId, sign

NAME = "register.jsonl"
_LETTERS = "abcdefghjkmnpqrstuvwxyz23456789"
"""No i, l, o, 0 or 1: pseudonyms are read aloud in a class."""
_PSEUDONYM_LETTERS = 8


class _Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    event: Literal["issued", "taken-up", "revoked"]
    token: TokenId
    nonce: Annotated[str, Meta(max_length=64)] = ""
    pseudonym: NameOrNone = ""
    session: NameOrNone = ""
    expires_s: Count = 0
    people: Count = 0


@dataclass(frozen=True, slots=True)
class Issued:
    """A token or an invitation that was handed out: to `pseudonym`, or good for so many `people`."""

    token_id: str
    session: str
    pseudonym: str
    expires_s: int
    people: int


class Full(Exception):  # noqa: N818 - not a fault of the program
    """As many people as the invitation is good for have taken it up."""


class Register:
    """Tokens issued, invitations taken up, tokens revoked; `refresh` reads what others have added."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / NAME
        self._offset = 0
        self._inode = 0
        self._seen = (0, 0)
        self.issued: dict[str, Issued] = {}
        self._people: dict[str, dict[str, str]] = {}
        self.revoked: set[str] = set()
        self.unreadable = 0
        self.refresh()

    def refresh(self) -> bool:
        """Read what was added since; tell whether there was anything."""
        try:
            found = self._path.stat()
            if (found.st_ino, found.st_size) == self._seen:  # two microseconds: asked with every answer
                return False
            with self._path.open("rb") as file:
                inode = os.fstat(file.fileno()).st_ino
                if inode != self._inode:  # somebody was forgotten: the file was written anew without them
                    self._inode, self._offset, self._people, self.issued = inode, 0, {}, {}
                file.seek(self._offset)
                added = file.read()
        except FileNotFoundError:
            return False
        whole = added[: added.rfind(b"\n") + 1]
        self._offset += len(whole)
        self._seen = (self._inode, self._offset)
        for line in whole.splitlines():
            self._take(line)
        return bool(whole)

    def take_up(self, invitation: Identity, nonce: str) -> str:
        """Return the pseudonym of whoever brings this invitation and nonce, the same each time.

        Args: nonce: made and kept by the browser, so that a lost reply does not cost a second place.
        Raises: Full.
        """
        self.refresh()
        key = hashlib.sha256(nonce.encode()).hexdigest()[:32]
        people = self._people.get(invitation.token_id, {})
        if key in people:
            return people[key]
        if len(people) >= invitation.people:
            raise Full
        pseudonym = draw_pseudonym()
        self._append(_Entry("taken-up", invitation.token_id, key, pseudonym))
        return pseudonym

    def issue(self, identity: Identity) -> None:
        """Note what was handed out, so that it can be listed."""
        self._append(
            _Entry(
                "issued", identity.token_id, pseudonym=identity.pseudonym, session=identity.session,
                expires_s=identity.expires_s, people=identity.people,
            )
        )  # fmt: skip

    def revoke(self, token_id: str) -> None:
        """Make a token, or an invitation with all that was given for it, worthless."""
        self._append(_Entry("revoked", token_id))

    def people(self, invitation: str) -> int:
        """Return how many people have taken up an invitation."""
        return len(self._people.get(invitation, {}))

    def _append(self, entry: _Entry) -> None:
        self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        line = json.dumps(msgspec.to_builtins(entry)).encode() + b"\n"
        handle = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o600)
        try:
            if _is_torn(handle):  # a line that a full disk cut off spoils no other
                line = b"\n" + line
            if os.write(handle, line) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._path))
            os.fsync(handle)
        finally:
            os.close(handle)
        self.refresh()

    def _take(self, line: bytes) -> None:
        try:
            entry = msgspec.json.decode(line, type=_Entry)
        except msgspec.DecodeError:
            self.unreadable += 1
            return
        if entry.event == "revoked":
            self.revoked.add(entry.token)
        elif entry.event == "issued":
            self.issued[entry.token] = Issued(
                entry.token, entry.session, entry.pseudonym, entry.expires_s, entry.people
            )
        else:
            self._people.setdefault(entry.token, {})[entry.nonce] = entry.pseudonym


def _is_torn(handle: int) -> bool:
    size = os.fstat(handle).st_size
    return size > 0 and os.pread(handle, 1, size - 1) != b"\n"


def draw_pseudonym() -> str:
    """Return a name that says nothing about its bearer."""
    return "p-" + "".join(secrets.choice(_LETTERS) for _ in range(_PSEUDONYM_LETTERS))


def new_token_id() -> str:
    """Return an id that no other token has."""
    return secrets.token_hex(8)


def given_for(invitation: Identity, pseudonym: str, keys: list[bytes]) -> tuple[Identity, str]:
    """Return the identity, and its token, that a person is given for an invitation."""
    identity = Identity(
        role=Role.TEACHER,
        session=invitation.session,
        pseudonym=pseudonym,
        expires_s=invitation.expires_s,
        token_id=new_token_id(),
        invitation=invitation.token_id,
    )
    return identity, sign(identity, keys)


def for_session(identity: Identity, session: str, keys: list[bytes]) -> str:
    """Return a token of the same person for another session; revoking either revokes both."""
    return sign(msgspec.structs.replace(identity, session=session), keys)
