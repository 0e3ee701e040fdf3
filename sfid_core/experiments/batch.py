"""A session as a plain loop: no window, no events, no wire, and the same table as the live session.

The loop shares the method, the world and the teachers with a live session and nothing of the session
machine, so that equal digests say that the machine adds and drops nothing.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from sfid_core.learning.method import Method
from sfid_core.learning.methods import make_method
from sfid_core.outcome import Outcome
from sfid_core.session.config import SessionConfig
from sfid_core.session.measures import EpisodeMeasures, EpisodeTally, LabelCounts
from sfid_core.sokoban.actions import ACTIONS
from sfid_core.sokoban.board import Board
from sfid_core.sokoban.world import World, WorldConfig, make_world
from sfid_core.teaching.answers import Answer, AnswerKind
from sfid_core.teaching.simulated import SimulatedTeacher


@dataclass(frozen=True, slots=True)
class BatchResult:
    """What a batch run comes to."""

    q_sha256: str
    """The digest of the table, as `QTable.sha256` gives it."""
    episodes: tuple[EpisodeMeasures, ...]
    counts: LabelCounts


def run_batch(config: SessionConfig, teachers: Mapping[str, SimulatedTeacher]) -> BatchResult:
    """Run the session from its first episode to its last and return what was learnt.

    Args: teachers: by the name under which they would join; the window and `teachers_min` of the
    configuration do not matter here, for nobody is waited for.
    Raises: ParameterError, LevelError, WorldError.
    """
    method = make_method(config.method, len(ACTIONS), config.parameters, config.seed, config.session)
    run = _Run(config, world_of(config), method, teachers, LabelCounts())
    episodes = tuple(run.episodes())
    return BatchResult(method.table.sha256(), episodes, run.counts)


def world_of(config: SessionConfig) -> World:
    """Return the world that an environment runs for this session.

    Its seed is the session's own, without the session's name: sessions of one seed meet the same starts
    whatever they compare. Raises: LevelError, WorldError.
    """
    spec = config.world
    rules = WorldConfig(spec.goal_reward, spec.step_reward, spec.deadlock_reward, spec.steps_max)
    return make_world(spec.level, rules, spec.starts, config.seed)


@dataclass(slots=True)
class _Run:
    """The loop's variables: `decision` runs over the whole session, as in a live one."""

    config: SessionConfig
    world: World
    method: Method
    teachers: Mapping[str, SimulatedTeacher]
    counts: LabelCounts
    decision: int = 0

    def episodes(self) -> Iterator[EpisodeMeasures]:
        for episode in range(self.config.episodes):
            yield self._episode(episode)

    def _episode(self, episode: int) -> EpisodeMeasures:
        tally = EpisodeTally()
        board = self.world.begin(episode)
        optimal_steps = self.world.optimal_steps(board)
        steps_done = 0
        while True:
            state = board.state_key()
            action = self.method.choose(state, self.decision)
            taken = self.world.execute(board, ACTIONS[action], steps_done)
            answers = self._answers(board, state, action)
            h = self.method.judge(action, answers).h
            next_state = None if taken.terminal else taken.board.state_key()
            errors = self.method.learn(state, action, taken.reward, h, next_state)
            tally.add(taken.reward, h, errors, len(answers), self.config.parameters.gamma)
            board = taken.board
            self.decision += 1
            steps_done += 1
            if taken.outcome is not Outcome.RUNNING:
                return tally.measures(episode, optimal_steps, taken.outcome)

    def _answers(self, board: Board, state: bytes, action: int) -> Sequence[Answer]:
        """Return what the teachers say, by name; a silent teacher gives none."""
        asks = self.method.asks
        if asks is None or not self.teachers:
            return ()
        optimal = self.world.optimal_actions(board)
        answers: list[Answer] = []
        for name in sorted(self.teachers):
            teacher = self.teachers[name]
            if asks is AnswerKind.LABEL:
                label = teacher.label(self.decision, state, optimal)
                given = None if label is None else Answer(asks, action=label)
            else:
                reward = teacher.reward(self.decision, state, action, optimal)
                given = None if reward is None else Answer(asks, reward=reward)
            if given is not None:
                answers.append(given)
        self.counts.submitted += len(answers)
        self.counts.acknowledged += len(answers)
        self.counts.applied += len(answers)
        return answers
