"""The environment service: it owns the worlds and executes what learners decide.

It keeps nothing on disk. An episode is rebuilt from its seed and its actions, so a learner that meets an
environment without memory begins the episode again with the actions already taken (`Begin.actions`).
"""

import logging
import queue
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol
from weakref import WeakValueDictionary

from protocol.codec import DecodeError, decode, encode
from protocol.keys import Keys
from protocol.messages import GymWorld, Refusal, Wire
from protocol.messages import World as WorldSpec
from protocol.translate import action_names
from protocol.world_messages import UNDO, Begin, Begun, ExecuteAction, Executed
from services.gym.errors import GymError
from services.runtime.bus import Bus, Request
from services.runtime.clock import SystemClock
from services.runtime.status import StatusDesk
from sfid_core.outcome import Outcome
from sfid_core.sokoban.actions import Action
from sfid_core.sokoban.board import Board
from sfid_core.sokoban.levels import LevelError
from sfid_core.sokoban.solver import Solution
from sfid_core.sokoban.world import Consequence, World, WorldConfig, WorldError, make_world

log = logging.getLogger("sfid.environment")

INBOX_MAX = 4096
"""Requests waiting: one for each session of a large learner; more is answered with "busy"."""
WORLDS_MAX = 64
"""Worlds kept ready. The largest solved level takes about 250 MB, a usual one less than 2 MB."""
EPISODES_MAX = 10_000
"""Episodes kept, as many as a learner has sessions; the one begun longest ago goes, to be begun again."""


@dataclass(frozen=True, slots=True)
class EnvironmentConfig:
    """Configuration of an environment service."""

    deployment: str = "local"
    name: str = "environment"


class Course(Protocol):
    """An episode as it stands."""

    state: bytes
    """The key of its state."""
    view: str
    start_steps: int | None
    """Fewest steps from where it began; None where there is no way or nobody knows."""

    @property
    def optimal_steps(self) -> int | None:
        """Fewest steps from here; None where there is no way or nobody knows."""

    def act(self, name: str, steps_done: int) -> tuple[float, Outcome]:
        """Take an action, or UNDO; return (reward, outcome)."""

    def close(self) -> None:
        """Give back what the episode holds."""


class Ground(Protocol):
    """A world of which episodes are begun."""

    def begin(self, episode: int) -> Course:
        """Return the episode of that number at its start."""


@dataclass(slots=True)
class _Episode:
    """A running episode of one session."""

    epoch: int
    episode: int
    world: Course | None
    """None once the episode is over: the last reply stays, the tables go."""
    state: bytes
    """The key of the state."""
    steps: int = 0
    action: str = ""
    answered: Executed | None = None
    """The last reply and the action it answers: a repeat gets it again."""

    def close(self) -> None:
        if self.world is not None:
            self.world.close()
        self.world = None


class Environment:
    """All episodes of this process: requests in, replies out, no bus and no clock."""

    def __init__(self) -> None:
        self._episodes: dict[str, _Episode] = {}
        self._worlds: dict[bytes, Ground] = {}
        self._solutions: WeakValueDictionary[str, Solution] = WeakValueDictionary()
        """By level: sessions of other seeds share the tables of the first, as long as one of them lives."""
        self.refused: Counter[str] = Counter()

    @property
    def sessions(self) -> int:
        """How many sessions have an episode here."""
        return len(self._episodes)

    def handle(self, verb: str, payload: bytes) -> Wire:
        """Return the reply to a request; a Refusal says in one line what is wrong."""
        try:
            reply = (
                self._begin(decode(payload, Begin))
                if verb == "begin"
                else self._execute(decode(payload, ExecuteAction))
            )
        except DecodeError as error:
            reply = Refusal(code="malformed", reason=str(error))
        except (LevelError, WorldError, GymError, _UnknownAction) as error:
            reply = Refusal(code="invalid", reason=str(error)[:512])
        if isinstance(reply, Refusal):
            self.refused[reply.code] += 1
        return reply

    def _begin(self, request: Begin) -> Wire:
        running = self._episodes.get(request.session)
        if running is not None and request.epoch < running.epoch:
            return _stale(request.epoch, running.epoch)
        course = self._world(request).begin(request.episode)
        for steps_done, name in enumerate(request.actions):
            course.act(name, steps_done)
        self._forget(request.session)
        self._episodes[request.session] = _Episode(
            request.epoch, request.episode, course, course.state, len(request.actions)
        )
        if len(self._episodes) > EPISODES_MAX:
            self._forget(next(iter(self._episodes)))
        if request.actions:
            log.info(
                "session %s: episode %d restored from its seed and %d actions",
                request.session, request.episode, len(request.actions),
            )  # fmt: skip
        return Begun(
            episode=request.episode,
            step=len(request.actions),
            state=course.state,
            view=course.view,
            optimal_steps=course.start_steps,
            actions=action_names(request.world),
        )

    def _forget(self, session: str) -> None:
        gone = self._episodes.pop(session, None)
        if gone is not None:
            gone.close()

    def _world(self, request: Begin) -> Ground:
        key = encode(Begin(session="any", epoch=0, episode=0, seed=request.seed, world=request.world))
        world = self._worlds.pop(key, None)
        if world is None:
            world = self._ground(request.world, request.seed)
        self._worlds[key] = world
        if len(self._worlds) > WORLDS_MAX:
            del self._worlds[next(iter(self._worlds))]
        return world

    def _ground(self, spec: WorldSpec | GymWorld, seed: int) -> Ground:
        if isinstance(spec, GymWorld):
            from services.gym.world import GymGround  # noqa: PLC0415 - an extra that few deployments have

            return GymGround(spec, seed)
        rules = WorldConfig(spec.goal_reward, spec.step_reward, spec.deadlock_reward, spec.steps_max)
        solution = self._solutions.get(spec.level)
        if solution is not None:
            return _SokobanGround(World(solution.table.level, rules, spec.starts, seed, solution))
        world = make_world(spec.level, rules, spec.starts, seed)
        if world.solution is not None:
            self._solutions[spec.level] = world.solution
        return _SokobanGround(world)

    def _execute(self, request: ExecuteAction) -> Wire:
        running = self._episodes.get(request.session)
        if running is None:
            return Refusal(
                code="unknown-session", reason=f"no episode of session {request.session} runs here: begin it"
            )
        if request.epoch < running.epoch:
            return _stale(request.epoch, running.epoch)
        running.epoch = request.epoch
        answered = running.answered
        if answered is not None and (request.decision, request.action) == (answered.decision, running.action):
            return answered
        world, stands = running.world, (running.episode, running.steps, running.state)
        if world is None or (request.episode, request.step, request.state) != stands:
            return Refusal(
                code="unknown-session", reason="the episode stands elsewhere: begin it with the actions taken"
            )
        reward, outcome = world.act(request.action, running.steps)
        running.state, running.steps = world.state, running.steps + 1
        running.action = request.action
        running.answered = Executed(
            decision=request.decision,
            reward=reward,
            outcome=outcome.value,
            state=world.state,
            view=world.view,
            optimal_steps=world.optimal_steps,
        )
        if outcome is not Outcome.RUNNING:
            running.close()
        return running.answered


class _UnknownAction(Exception):  # noqa: N818 - it names what is wrong
    """A request names an action that this world does not have."""


class _SokobanGround:
    """One level."""

    def __init__(self, world: World) -> None:
        self._world = world

    def begin(self, episode: int) -> Course:
        return _SokobanCourse(self._world, self._world.begin(episode))


class _SokobanCourse:
    """An episode on a level."""

    __slots__ = ("_before", "_board", "_world", "start_steps", "state", "view")

    def __init__(self, world: World, start: Board) -> None:
        self._world, self._board, self._before = world, start, start
        self.start_steps = world.optimal_steps(start)
        self.state, self.view = start.state_key(), start.to_xsb()

    @property
    def optimal_steps(self) -> int | None:
        return self._world.optimal_steps(self._board)

    def act(self, name: str, steps_done: int) -> tuple[float, Outcome]:
        done = _done(self._world, self._board, self._before, name, steps_done)
        self._before, self._board = self._board, done.board
        self.state, self.view = done.board.state_key(), done.board.to_xsb()
        return done.reward, done.outcome

    def close(self) -> None:
        """Nothing is held."""


def _done(world: World, board: Board, before: Board, name: str, steps_done: int) -> Consequence:
    """Return what an action brings, or UNDO, which goes back to where the action before it was taken.

    Taking back what was taken back puts the step into force again.
    """
    if name != UNDO:
        return world.execute(board, _action(name), steps_done)
    capped = steps_done + 1 >= world.config.steps_max
    return Consequence(before, 0.0, Outcome.CAP if capped else Outcome.RUNNING)


def _action(name: str) -> Action:
    """Return the action of that name."""
    if name not in Action.__members__:
        message = f"no action {name}: use one of {', '.join(Action.__members__)}"
        raise _UnknownAction(message)
    return Action[name]


def _stale(epoch: int, newest: int) -> Refusal:
    return Refusal(
        code="denied", reason=f"epoch {epoch} is over: a learner of epoch {newest} owns the session"
    )


def run(config: EnvironmentConfig, bus: Bus, ready: Callable[[], None], stop: threading.Event) -> None:
    """Serve requests until `stop` is set."""
    keys = Keys(config.deployment)
    inbox: queue.SimpleQueue[tuple[str, Request] | None] = queue.SimpleQueue()
    environment = Environment()

    def receive(verb: str) -> Callable[[Request], None]:
        def enqueue(request: Request) -> None:
            if inbox.qsize() < INBOX_MAX:
                inbox.put((verb, request))
            else:
                request.reply_error(
                    encode(Refusal(code="busy", reason="the environment's inbox is full: ask again"))
                )

        return enqueue

    for verb in ("begin", "execute"):
        bus.serve(keys.environment(verb), receive(verb))
    desk = StatusDesk(
        "environment", config.name, SystemClock(),
        lambda: {
            "backlog": inbox.qsize(), "sessions": environment.sessions, "running": environment.sessions,
            "refused": dict(environment.refused),
        },
    )  # fmt: skip
    bus.serve(keys.status("environment", config.name), receive("status"))
    bus.announce(keys.service("environment", config.name))
    ready()
    while not stop.is_set():
        try:
            item = inbox.get(timeout=0.2)
        except queue.Empty:
            continue
        if item is None:
            continue
        if item[0] == "status":
            desk.reply(item[1])
        else:
            _reply(item[1], environment.handle(item[0], item[1].payload))
    log.info("environment drained: %d requests refused", environment.refused.total())


def _reply(request: Request, reply: Wire) -> None:
    if isinstance(reply, Refusal):
        log.warning("refused %s: %s", request.key, reply.reason)
        request.reply_error(encode(reply))
    else:
        request.reply(encode(reply))
