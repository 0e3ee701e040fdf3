"""What another method would have learnt from the same steps and answers: off-policy, and honest about it."""

from collections.abc import Mapping
from dataclasses import dataclass

from sfid_core.chance import stream
from sfid_core.compiled import linked
from sfid_core.experiments.batch import TRIALS_MAX, lane_world
from sfid_core.experiments.greedy import greedy_share
from sfid_core.learning.kernels import Evidence, Learned, Memory, prefer
from sfid_core.learning.learner import Learner, learner_draws
from sfid_core.learning.method import Method
from sfid_core.learning.methods import method_named, method_parameters
from sfid_core.learning.parameters import ParameterError, Value
from sfid_core.session.config import SessionConfig
from sfid_core.session.state import Session, new_session
from sfid_core.sokoban.actions import ACTIONS
from sfid_core.sokoban.live import WorldTables


class WatchedLearner(Learner):
    """A learner whose every lesson is given to an onlooker too, who never acts."""

    def __init__(self, config: SessionConfig, onlooker: Learner, actions: int) -> None:
        method, draws = method_named(config.method), learner_draws(config.seed, config.session)
        super().__init__(method, config.method_parameters, actions, draws, config.world.steps_max)
        self._onlooker = onlooker

    def begin(self, episode: int) -> None:
        """Begin an episode for both."""
        super().begin(episode)
        self._onlooker.begin(episode)

    def learn(  # noqa: PLR0913 - as Learner.learn
        self,
        state: bytes,
        action: int,
        reward: float,
        evidence: Evidence,
        next_state: bytes,
        *,
        terminal: bool,
        step: int,
        distances: tuple[int, int] = (-1, -1),
        span_ms: float = 0.0,
    ) -> Learned:
        """Teach both the same; return what it came to for the one who acts."""
        lesson = (state, action, reward, evidence, next_state)
        self._onlooker.learn(*lesson, terminal=terminal, step=step, distances=distances, span_ms=span_ms)
        return super().learn(*lesson, terminal=terminal, step=step, distances=distances, span_ms=span_ms)


@dataclass(frozen=True, slots=True)
class Watched:
    """A session to be replayed, and the learner that looks on."""

    session: Session
    onlooker: Learner


def watched_session(
    config: SessionConfig, method: str, given: Mapping[str, Value], actions: int = len(ACTIONS)
) -> Watched:
    """Return the session before its first event, with an onlooker of another method.

    Raises: ParameterError for an unknown method or parameter, and for a method that asks teachers something
    that this session never asked.
    """
    parameters = method_parameters(method, given)
    check_same_answers(method_named(config.method), method_named(method))
    draws = learner_draws(config.seed, config.session)
    onlooker = Learner(method_named(method), parameters, actions, draws, config.world.steps_max)
    session = new_session(config, actions)
    session.learner = WatchedLearner(config, onlooker, actions)
    return Watched(session, onlooker)


def check_same_answers(recorded: Method, other: Method) -> None:
    """Refuse a method that lives on another kind of answers than were recorded; raises ParameterError."""
    had, wanted = ({kind.value for kind in one.asks} for one in (recorded, other))
    if wanted - had:
        answers = " and ".join(sorted(had)) or "nothing"
        message = (
            f"method {other.name} asks for {' and '.join(sorted(wanted))}, the session's {recorded.name} "
            f"asked for {answers}: choose a method that asks for no more, or record a session with it"
        )
        raise ParameterError(message)


def greedy_success(learner: Learner, tables: WorldTables, seed: int, steps_max: int) -> float:
    """Return the share of the level's solvable states that the learnt policy alone solves.

    Of more than `TRIALS_MAX` states, evenly spaced ones are tried; a tie is broken once for each state.
    """
    actions = len(ACTIONS)
    preferences = [value for key in tables.state_keys for value in learner.values(key)] + [0.0] * actions
    memory = Memory(preferences, [], [], actions, actions)
    starts = [state for state, steps in enumerate(tables.optimal_steps.tolist()) if steps > 0]
    tried = starts[:: -(-len(starts) // TRIALS_MAX)]
    share = linked(greedy_share, {"prefer": prefer})
    world = lane_world(tables, steps_max, arrays=False)
    return share(world, memory, (), tried, stream(seed, "greedy"), steps_max)
