"""A run as text: one line for everything that happened, for a person who looks for a reason."""

from typing import Any

from protocol.codec import DecodeError, printable, unpack
from protocol.keys import Keys
from services.runtime.faults import Seen

_ROOT = Keys().root
_TOLD = ("decision", "phase", "episode", "step", "asked", "action", "reward", "h", "outcome", "kind", "code")
_TOLD_TOO = ("verb", "epoch", "sequence", "journal_seq", "reason")


def line(seen: Seen) -> str:
    """Return when, who to whom, what, on which key, and what the message says: one line."""
    way = (
        f"{seen.sender} -> {seen.receiver}" if seen.sender and seen.receiver else seen.sender or seen.receiver
    )
    key = seen.key.split("/session/")[-1].removeprefix(f"{_ROOT}/")
    number = f"#{seen.ask}" if seen.ask else ""
    text = f"{seen.at_ns / 1e9:12.6f}  {seen.what:<10} {way:<26} {number:<6} {key:<22} {_said(seen.payload)}"
    return text.rstrip()


def _said(payload: bytes) -> str:
    if not payload:
        return ""
    try:
        message = unpack(payload)
    except DecodeError:
        return printable(payload[:40].decode("latin-1"))
    if not isinstance(message, dict):
        return printable(payload[:40].decode("latin-1"))
    message |= message["decision"] if isinstance(message.get("decision"), dict) else {}
    told = [f"{name} {message[name]}" for name in (*_TOLD, *_TOLD_TOO) if message.get(name) not in (None, "")]
    return printable(" ".join([str(message.get("type", "?")), *_id(message), *told]), 240)


def _id(message: dict[str, Any]) -> list[str]:
    found = message.get("answer_id")
    return [found.hex()[:8]] if isinstance(found, bytes) else []
