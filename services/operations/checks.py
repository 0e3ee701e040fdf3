"""One question of a doctor and its answer."""

from dataclasses import dataclass
from enum import Enum


class State(Enum):
    """How a check came out."""

    OK = "ok"
    WARN = "warn"
    """It works, but not as well, or not as safely, as it could."""
    FAIL = "fail"
    """Something will not work until it is mended."""


@dataclass(frozen=True, slots=True)
class Check:
    """What was looked at, how it is, and how it is mended."""

    name: str
    state: State
    found: str
    mend: str = ""
    """Empty when all is well."""


def ok(name: str, found: str) -> Check:
    """Return a check that came out well."""
    return Check(name, State.OK, found)


def warn(name: str, found: str, mend: str) -> Check:
    """Return a check of something that could be better."""
    return Check(name, State.WARN, found, mend)


def fail(name: str, found: str, mend: str) -> Check:
    """Return a check of something that does not work."""
    return Check(name, State.FAIL, found, mend)
