"""Every key expression of the system; nobody else writes one.

sfid/v1/<deployment>/session/<session>/decision                  put     learner -> teachers, monitor
sfid/v1/<deployment>/session/<session>/measures                  put     learner -> teachers, monitor
sfid/v1/<deployment>/session/<session>/join/<teacher>            query   teacher -> learner
sfid/v1/<deployment>/session/<session>/answer/<teacher>          query   teacher -> learner
sfid/v1/<deployment>/session/<session>/control/<teacher>         query   teacher -> learner
sfid/v1/<deployment>/session/<session>/present/<teacher>[/<run>] token   teacher -> learner
sfid/v1/<deployment>/session/<session>/crowd/<aggregator>        put     aggregator -> monitor
sfid/v1/<deployment>/learner/<verb>                              query   anybody  -> learner
sfid/v1/<deployment>/environment/<verb>                          query   learner -> environment
sfid/v1/<deployment>/service/<role>/<name>                       token   service -> everybody
sfid/v1/<deployment>/status/<role>/<name>                        query   operator, itself -> service
sfid/router/<id>                                                 query   router -> router
"""

import re
from dataclasses import dataclass
from functools import lru_cache

NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,47}")
"""Sessions, teachers, deployments: no wildcard, no `@`, no slash, nothing to escape in a path or a
terminal."""
NAME_MEND = "use 1 to 48 of a-z, 0-9, - and _, beginning with a letter or digit"


_OF_A_TEACHER = frozenset({"join", "answer", "control"})


class KeyNameError(ValueError):
    """A name cannot be part of a key; the text is one line."""


def checked(name: str, role: str) -> str:
    """Return `name` when it may stand in a key; raise KeyNameError with the mend otherwise."""
    if not NAME.fullmatch(name):
        message = f"{role} name {name[:60]!r} is not allowed: {NAME_MEND}"
        raise KeyNameError(message)
    return name


def router_key(zid: str = "*") -> str:
    """Return where a router answers to the routers that it is linked with; outside every deployment."""
    return f"sfid/router/{zid}"


@dataclass(frozen=True, slots=True)
class Keys:
    """The keys of one deployment."""

    deployment: str = "local"

    def __post_init__(self) -> None:
        checked(self.deployment, "deployment")

    @property
    def root(self) -> str:
        """The common beginning of all keys."""
        return f"sfid/v1/{self.deployment}"

    def decision(self, session: str = "*") -> str:
        """Where a learner publishes a session's decision as it stands."""
        return f"{self.root}/session/{session}/decision"

    def measures(self, session: str = "*") -> str:
        """Where a learner publishes learnt steps and finished episodes."""
        return f"{self.root}/session/{session}/measures"

    def join(self, session: str = "*", teacher: str = "*") -> str:
        """Where a teacher asks to take part."""
        return f"{self.root}/session/{session}/join/{teacher}"

    def answer(self, session: str = "*", teacher: str = "*") -> str:
        """Where a teacher hands in an answer."""
        return f"{self.root}/session/{session}/answer/{teacher}"

    def control(self, session: str = "*", teacher: str = "*") -> str:
        """Where a teacher changes the window, pauses, resumes or stops."""
        return f"{self.root}/session/{session}/control/{teacher}"

    def present(self, session: str, teacher: str, run: str = "") -> str:
        """A teacher's liveliness token, with what tells this start of their program from others."""
        key = f"{self.root}/session/{session}/present/{teacher}"
        return f"{key}/{run}" if run else key

    def presences(self, session: str = "*") -> str:
        """The tokens of all teachers."""
        return f"{self.root}/session/{session}/present/*/**"

    def crowd(self, session: str = "*", aggregator: str = "*") -> str:
        """Where an aggregator publishes what its crowd came to, and how reliable its workers are."""
        return f"{self.root}/session/{session}/crowd/{aggregator}"

    def learner(self, verb: str) -> str:
        """A request about sessions: create, list, show or rows."""
        return f"{self.root}/learner/{verb}"

    def environment(self, verb: str) -> str:
        """A request to the environment: begin, execute or restore."""
        return f"{self.root}/environment/{verb}"

    def service(self, role: str = "*", name: str = "*") -> str:
        """A service's liveliness token."""
        return f"{self.root}/service/{role}/{name}"

    def status(self, role: str = "*", name: str = "*") -> str:
        """Where a service is asked how it does."""
        return f"{self.root}/status/{role}/{name}"

    def role_and_name(self, key: str) -> tuple[str, str]:
        """Return (role, name) of a service's token; KeyNameError for any other key."""
        parts = key.removeprefix(self.root + "/").split("/")
        if len(parts) != 3 or parts[0] != "service":
            message = f"key {key[:120]!r} names no service"
            raise KeyNameError(message)
        return checked(parts[1], "role"), checked(parts[2], "service")

    def session_and_teacher(self, key: str) -> tuple[str, str]:
        """Return (session, teacher) of a join, answer or control key; KeyNameError for any other."""
        return _session_and_teacher(self.root, key)

    def presence(self, key: str) -> tuple[str, str, str]:
        """Return (session, teacher, run) of a teacher's token, run empty for none; KeyNameError otherwise."""
        parts = key.removeprefix(self.root + "/").split("/")
        if len(parts) not in {4, 5} or parts[0] != "session" or parts[2] != "present":
            message = f"key {key[:120]!r} names no teacher's token"
            raise KeyNameError(message)
        run = checked(parts[4], "run") if len(parts) == 5 else ""
        return checked(parts[1], "session"), checked(parts[3], "teacher"), run


@lru_cache(8192)  # a teacher answers on one key for ever
def _session_and_teacher(root: str, key: str) -> tuple[str, str]:
    parts = key.removeprefix(root + "/").split("/")
    if len(parts) != 4 or parts[0] != "session" or parts[2] not in _OF_A_TEACHER:
        message = f"key {key[:120]!r} names no session and teacher"
        raise KeyNameError(message)
    return checked(parts[1], "session"), checked(parts[3], "teacher")
