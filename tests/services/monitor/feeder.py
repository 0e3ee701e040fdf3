"""A taught Q-learner on a small room, told in the messages a learner publishes; for tests of the monitor."""

import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType

from protocol.messages import Decision, Episode, SaidBy, Step, WindowSpec
from sfid_core.sokoban.actions import ACTIONS
from sfid_core.sokoban.board import Board
from sfid_core.sokoban.levels import parse_levels
from sfid_core.sokoban.rules import step as taken

ROOM = """
##########
#   ##   #
# .  @ # #
#  $##   #
##     . #
#   $#   #
#        #
##########
"""
SOLUTION_ROOM = "#####\n#@$.#\n#####"
GAMMA = 0.9
RATE = 0.3
WALL_NS = 1_790_000_000 * 10**9
ACTION_NAMES = tuple(action.name for action in ACTIONS)


@dataclass
class Tally:
    """An episode as far as it has come."""

    outcome: str = "running"
    steps: int = 0
    env_error: float = 0.0
    shaped_error: float = 0.0
    env_return: float = 0.0
    shaped_return: float = 0.0
    inputs: int = 0
    agreements: int = 0

    def add(self, step: Step) -> None:
        self.env_error += abs(step.td_error)
        self.shaped_error += abs(step.td_error_shaped)
        self.env_return += GAMMA**self.steps * step.reward
        self.shaped_return += GAMMA**self.steps * (step.reward + step.h)
        self.inputs += len(step.said)
        self.agreements += step.h > 0
        self.steps += 1


@dataclass
class Lesson:
    """A session being taught; iterate over `messages`."""

    session: str = "lesson"
    room: str = ROOM
    episodes: int = 30
    teachers: Sequence[tuple[str, float]] = (("ada", 0.95), ("ben", 0.8), ("cyd", 0.6))
    steps_max: int = 120
    seed: int = 7
    epoch: int = 1
    decision: int = 0
    sequence: int = 0
    table: dict[bytes, list[float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.start, self.distance = _solved(self.room)
        self.rng = random.Random(self.seed)

    def messages(self) -> Iterator[Decision | Step | Episode]:
        """Yield decisions, steps and episodes in the order of a learner."""
        for episode in range(self.episodes):
            yield from self._episode(episode)
        yield self._decision(self.start, self.episodes, 0, "finished", None)

    def _episode(self, episode: int) -> Iterator[Decision | Step | Episode]:
        board, tally = self.start, Tally()
        while tally.outcome == "running":
            yield self._decision(board, episode, tally.steps, "asking", None)
            action = self._greedy(board)
            said = self._said(board)
            yield self._decision(board, episode, tally.steps, "executing", ACTION_NAMES[action])
            after = taken(board, ACTIONS[action]).board
            step = self._learnt(board, after, action, said, episode, tally)
            yield step
            self.decision += 1
            board = after
        yield self._ended(episode, tally)

    def _learnt(
        self, board: Board, after: Board, action: int, said: tuple[SaidBy, ...], episode: int, tally: "Tally"
    ) -> Step:
        agreed = sum(answer.action == ACTION_NAMES[action] for answer in said)
        h = 0.0 if not said else (1.0 if 2 * agreed > len(said) else -1.0)
        solved, stuck = after.solved, after.state_key() not in self.distance
        reward = 10.0 if solved else -10.0 if stuck else 0.0
        row = self._row(board)
        following = 0.0 if solved or stuck else GAMMA * max(self._row(after))
        env_error = reward + following - row[action]
        row[action] += RATE * (env_error + h)
        ended = "solved" if solved else "deadlock" if stuck else ""
        tally.outcome = ended or ("cap" if tally.steps + 1 == self.steps_max else "running")
        step = Step(
            session=self.session,
            epoch=self.epoch,
            decision=self.decision,
            episode=episode,
            step=tally.steps,
            at_ns=self._at_ns(),
            state=board.state_key(),
            view=board.to_xsb(),
            action=ACTION_NAMES[action],
            said=said,
            label=said[0].action if said else None,
            h=h,
            reward=reward,
            td_error=env_error,
            td_error_shaped=env_error + h,
            outcome=tally.outcome,  # type: ignore[arg-type]
            next_view=after.to_xsb(),
            values=tuple(row),
        )
        tally.add(step)
        return step

    def _ended(self, episode: int, tally: "Tally") -> Episode:
        return Episode(
            session=self.session,
            epoch=self.epoch,
            decision=self.decision,
            at_ns=self._at_ns(),
            episode=episode,
            steps=tally.steps,
            optimal_steps=self.distance.get(self.start.state_key()),
            abs_td_error=tally.env_error / tally.steps,
            abs_td_error_shaped=tally.shaped_error / tally.steps,
            discounted_return=tally.shaped_return,
            discounted_env_return=tally.env_return,
            inputs=tally.inputs,
            agreements=tally.agreements,
            outcome=tally.outcome,  # type: ignore[arg-type]
        )

    def _greedy(self, board: Board) -> int:
        row = self._row(board)
        return self.rng.choice([index for index, value in enumerate(row) if value == max(row)])

    def _decision(self, board: Board, episode: int, step: int, phase: str, action: str | None) -> Decision:
        self.sequence += 1
        return Decision(
            session=self.session,
            epoch=self.epoch,
            sequence=self.sequence,
            decision=self.decision,
            episode=episode,
            step=step,
            phase=phase,  # type: ignore[arg-type]
            paused=False,
            asked="label",
            state=board.state_key(),
            view=board.to_xsb(),
            actions=ACTION_NAMES,
            action=action,
            remaining_ms=1000,
            window=WindowSpec(mode="early", span_ms=1000),
            teachers=tuple(name for name, _ in self.teachers),
            teachers_present=len(self.teachers),
            method="sfid",
            episodes=self.episodes,
            optimal_steps=self.distance.get(self.start.state_key()),
        )

    def _said(self, board: Board) -> tuple[SaidBy, ...]:
        """Each teacher answers now and then, rightly with their own probability."""
        best = self._best(board)
        said = []
        for name, reliability in self.teachers:
            if best is None or self.rng.random() < 0.55:
                continue
            action = best if self.rng.random() < reliability else self.rng.choice(ACTION_NAMES)
            said.append(SaidBy(teacher=name, kind="label", action=action))
        return tuple(said)

    def _best(self, board: Board) -> str | None:
        reached = {action.name: taken(board, action).board.state_key() for action in ACTIONS}
        known = {name: self.distance[key] for name, key in reached.items() if key in self.distance}
        return min(known, key=lambda name: known[name]) if known else None

    def _row(self, board: Board) -> list[float]:
        return self.table.setdefault(board.state_key(), [0.0] * len(ACTIONS))

    def _at_ns(self) -> int:
        return WALL_NS + self.decision * 250_000_000


@cache  # two thirds of a second for a room, and a test may want sixty lessons in it
def _solved(room: str) -> tuple[Board, Mapping[bytes, int]]:
    start = parse_levels(room)[0].start
    return start, MappingProxyType(_distances(start))


def _distances(start: Board) -> dict[bytes, int]:
    """Steps to the nearest solved board from every board reachable from the start, by a search backwards."""
    boards = {start.state_key(): start}
    before: dict[bytes, list[bytes]] = {}
    open_boards = [start]
    for board in open_boards:
        for action in ACTIONS:
            after = taken(board, action).board
            before.setdefault(after.state_key(), []).append(board.state_key())
            if after.state_key() not in boards:
                boards[after.state_key()] = after
                open_boards.append(after)
    distance = {key: 0 for key, board in boards.items() if board.solved}
    border = list(distance)
    for key in border:
        for earlier in before.get(key, ()):
            if earlier not in distance:
                distance[earlier] = distance[key] + 1
                border.append(earlier)
    return distance
