"""A session in a running learner: the machine's state and what its shell keeps beside it."""

import sys
from dataclasses import dataclass, field
from functools import lru_cache

from msgspec.structs import replace

from protocol.journal import Folded
from protocol.keys import Keys
from protocol.messages import CreateSession, GymWorld, WindowSpec, World
from protocol.translate import action_names, config_of
from sfid_core.session.state import Session, new_session


@dataclass(slots=True)
class LiveSession:
    """One session of this process."""

    session: Session
    config: CreateSession
    decision_key: str
    measures_key: str
    actions: tuple[str, ...]
    numbers: dict[str, int]
    known: set[str] = field(default_factory=set)
    """Teachers who ever joined: one whose token comes back is present again without asking."""
    actions_taken: list[str] = field(default_factory=list)
    """Names of the actions executed in the running episode, to restore an environment from."""
    sequence: int = 0
    elapsed_at_ns: int | None = None
    """A closing by the clock that waits to be journaled with the step it leads to."""
    timer_ns: int | None = None
    """The deadline for which a timer was set last."""
    asked: int = 0
    """Number of the latest question to the environment; answers to earlier ones are ignored."""
    begin_timeout_ms: int = 1_000
    environment_lost: bool = False
    failure: str = ""
    """Why the session was stopped before its end, if it was."""

    @property
    def name(self) -> str:
        """The session's name."""
        return self.config.session


def created(config: CreateSession, keys: Keys) -> LiveSession:
    """Return a new session; raise ParameterError when its configuration is not sound."""
    config = _thrifty(config)
    session = new_session(config_of(config), len(action_names(config.world)))
    return _live(session, config, keys)


def _live(session: Session, config: CreateSession, keys: Keys) -> LiveSession:
    topics = keys.decision(config.session), keys.measures(config.session)
    return LiveSession(session, config, *topics, *_numbered(action_names(config.world)))


@lru_cache(256)  # shared by all sessions of a world
def _numbered(actions: tuple[str, ...]) -> tuple[tuple[str, ...], dict[str, int]]:
    return actions, {name: index for index, name in enumerate(actions)}


def recovered(folded: Folded, keys: Keys) -> LiveSession:
    """Return the session that a journal tells."""
    config = _thrifty(folded.config)
    folded.session.config = config_of(config)
    live = _live(folded.session, config, keys)
    live.known = folded.known
    live.actions_taken = folded.actions_taken
    return live


def _thrifty(config: CreateSession) -> CreateSession:
    """Return an equal configuration that shares its window and its world (up to 16 KB) with all of those."""
    world = config.world if isinstance(config.world, GymWorld) else _shared_world(config.world)
    return replace(config, world=world, window=_shared_window(config.window))


@lru_cache(256)
def _shared_world(world: World) -> World:
    return replace(world, level=sys.intern(world.level))  # also where more worlds than these are in use


@lru_cache(256)
def _shared_window(window: WindowSpec) -> WindowSpec:
    return window
