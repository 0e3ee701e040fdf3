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

from protocol.codec import DecodeError, decode, encode
from protocol.keys import Keys
from protocol.messages import Refusal, Wire
from protocol.messages import World as WorldSpec
from protocol.world_messages import UNDO, Begin, Begun, ExecuteAction, Executed
from services.runtime.bus import Bus, Request
from sfid_core.outcome import Outcome
from sfid_core.sokoban.actions import Action
from sfid_core.sokoban.board import Board
from sfid_core.sokoban.levels import LevelError
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


@dataclass(slots=True)
class _Episode:
    """A running episode of one session."""

    epoch: int
    episode: int
    world: World | None
    """None once the episode is over: the last reply stays, the tables go."""
    board: Board
    state: bytes
    """The board's key."""
    before: Board
    """Where the last action was taken: what undo goes back to."""
    steps: int = 0
    action: str = ""
    answered: Executed | None = None
    """The last reply and the action it answers: a repeat gets it again."""


class Environment:
    """All episodes of this process: requests in, replies out, no bus and no clock."""

    def __init__(self) -> None:
        self._episodes: dict[str, _Episode] = {}
        self._worlds: dict[bytes, World] = {}
        self.refused: Counter[str] = Counter()

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
        except (LevelError, WorldError, _UnknownAction) as error:
            reply = Refusal(code="invalid", reason=str(error)[:512])
        if isinstance(reply, Refusal):
            self.refused[reply.code] += 1
        return reply

    def _begin(self, request: Begin) -> Wire:
        running = self._episodes.get(request.session)
        if running is not None and request.epoch < running.epoch:
            return _stale(request.epoch, running.epoch)
        world = self._world(request)
        start = board = before = world.begin(request.episode)
        for steps_done, name in enumerate(request.actions):
            after = _done(world, board, before, name, steps_done).board
            board, before = after, board
        self._episodes.pop(request.session, None)
        self._episodes[request.session] = _Episode(
            request.epoch, request.episode, world, board, board.state_key(), before, len(request.actions)
        )
        if len(self._episodes) > EPISODES_MAX:
            del self._episodes[next(iter(self._episodes))]
        if request.actions:
            log.info(
                "session %s: episode %d restored from its seed and %d actions",
                request.session, request.episode, len(request.actions),
            )  # fmt: skip
        return Begun(
            episode=request.episode,
            step=len(request.actions),
            state=board.state_key(),
            view=board.to_xsb(),
            optimal_steps=world.optimal_steps(start),
            actions=tuple(action.name for action in Action),
        )

    def _world(self, request: Begin) -> World:
        key = encode(Begin(session="any", epoch=0, episode=0, seed=request.seed, world=request.world))
        world = self._worlds.pop(key, None)
        if world is None:
            world = make_world(request.world.level, _rules(request.world), request.world.starts, request.seed)
        self._worlds[key] = world
        if len(self._worlds) > WORLDS_MAX:
            del self._worlds[next(iter(self._worlds))]
        return world

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
        done = _done(world, running.board, running.before, request.action, running.steps)
        running.before = running.board
        running.board, running.state, running.steps = done.board, done.board.state_key(), running.steps + 1
        if done.outcome is not Outcome.RUNNING:
            running.world = None
        running.action = request.action
        running.answered = Executed(
            decision=request.decision,
            reward=done.reward,
            outcome=done.outcome.value,
            state=running.state,
            view=done.board.to_xsb(),
            optimal_steps=world.optimal_steps(done.board),
        )
        return running.answered


def _rules(spec: WorldSpec) -> WorldConfig:
    return WorldConfig(spec.goal_reward, spec.step_reward, spec.deadlock_reward, spec.steps_max)


class _UnknownAction(Exception):  # noqa: N818 - it names what is wrong
    """A request names an action that this world does not have."""


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
    bus.announce(keys.service("environment", config.name))
    ready()
    while not stop.is_set():
        try:
            item = inbox.get(timeout=0.2)
        except queue.Empty:
            continue
        if item is not None:
            _reply(item[1], environment.handle(item[0], item[1].payload))
    log.info("environment drained: %d requests refused", environment.refused.total())


def _reply(request: Request, reply: Wire) -> None:
    if isinstance(reply, Refusal):
        log.warning("refused %s: %s", request.key, reply.reason)
        request.reply_error(encode(reply))
    else:
        request.reply(encode(reply))
