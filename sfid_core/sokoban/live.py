"""A world as compact tables for batch learners: the states in which an episode can be, and one dead sink.

A level has many more positions than an episode meets: those that cannot be solved end it, and those that its
start does not lead to never come up.  What is left is a few per cent of a Boxoban level.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from sfid_core.chance import stream
from sfid_core.chance_array import streams
from sfid_core.mdp import StateOutcome, TabularMDP
from sfid_core.sokoban.actions import ACTIONS
from sfid_core.sokoban.board import Board, Level
from sfid_core.sokoban.solver import DEADLOCKED, Solution, StateIds
from sfid_core.sokoban.start_arrays import sampled_ids, start_indexes
from sfid_core.sokoban.starts import StartKind, StartOrder, Starts, WorldError, start_ids
from sfid_core.sokoban.tables import StateTable, count_states, spoken
from sfid_core.sokoban.world import World, WorldConfig

_CHUNK = 1 << 17
"""States looked at together: the temporaries of one chunk stay within a few megabytes."""
_UNSEEN = -1


@dataclass(frozen=True, eq=False)
class TableStarts:
    """The starts that one seed draws from a table.

    Attributes:
        ids: int32 [n_starts], states by the index of the start.
        order: which index each episode starts at.
    """

    ids: npt.NDArray[np.int32]
    order: StartOrder

    def start(self, episode: int) -> int:
        """Return the state in which an episode (0 or more) starts."""
        return int(self.ids[self.order.index(episode)])

    def starts(self, episodes: int) -> npt.NDArray[np.int32]:
        """Return int32 [episodes]: the states in which the first episodes start."""
        return self.ids[self.order.indexes(episodes)]


@dataclass(frozen=True, eq=False)
class WorldTables:
    """The live states of a world, numbered 0..n_states - 2, and one sink for all that is deadlocked.

    The tables depend on the level, the rewards and the kind of starts, and not on the seed: one serves every
    seed of an experiment.  With FIXED starts a state is live when the level's own start leads to it and it
    can be solved, with all others when it can be solved.  An episode's step cap is not in the tables.

    Attributes:
        level: the level.
        starts: the start distribution that `draw_starts` draws from.
        successor: int32 [n_states, 4]; a terminal state leads to itself.
        reward: float64 [n_states, 4], paid on the way out; 0 in a terminal state.
        outcome: uint8 [n_states], a StateOutcome; DEADLOCK for the sink alone.
        optimal_steps: int32 [n_states], fewest steps to solved; 0 when solved, -1 for the sink.
        optimal_mask: uint8 [n_states], bit a (value 1 << a) set when action a begins a shortest solution.
        placements: int16 [n_states - 1, 1 + n_boxes], the level's cell of the player, then of the boxes,
            ascending.

    All arrays are read-only.
    """

    level: Level
    starts: Starts
    successor: npt.NDArray[np.int32]
    reward: npt.NDArray[np.float64]
    outcome: npt.NDArray[np.uint8]
    optimal_steps: npt.NDArray[np.int32]
    optimal_mask: npt.NDArray[np.uint8]
    placements: npt.NDArray[np.int16]

    def __post_init__(self) -> None:
        for table in vars(self).values():
            if isinstance(table, np.ndarray):
                table.flags.writeable = False

    @property
    def n_states(self) -> int:
        """Return the number of states, solved ones and the sink included."""
        return len(self.successor)

    @property
    def sink(self) -> int:
        """Return the state that stands for every deadlocked position: the last."""
        return self.n_states - 1

    @cached_property
    def mdp(self) -> TabularMDP:
        """Return the same arrays as a checked TabularMDP."""
        return TabularMDP(self.successor, self.reward, self.outcome)

    def board(self, state: int) -> Board:
        """Return the position of a live state; ValueError for the sink, which is many."""
        if not 0 <= state < self.sink:
            message = f"state {state} is no live state; give 0 to {self.sink - 1}"
            raise ValueError(message)
        player, *boxes = self.placements[state].tolist()
        return Board(self.level, player, tuple(boxes))

    def state_key(self, state: int) -> bytes:
        """Return the 16 bytes of `Board.state_key` for a live state; ValueError for the sink."""
        return self.board(state).state_key()

    @cached_property
    def state_keys(self) -> tuple[bytes, ...]:
        """Return the key of every live state by its number; n_states - 1 of them, the sink has none."""
        return tuple(self.level.state_keys(self.placements.tolist()))

    def state_id(self, board: Board) -> int:
        """Return the number of a position; the sink for one that is not live."""
        return self._ids.get((board.player, *board.boxes), self.sink)

    def draw_starts(self, seed: int) -> TableStarts:
        """Return the starts of the world with this seed, as `World.begin` gives them; raises WorldError."""
        key = stream(seed, "starts")
        ids = self._drawn(key) if self.starts.kind is StartKind.SAMPLE else self._every_start
        return TableStarts(ids, StartOrder(len(ids), self.starts.kind, key))

    def starts_of(self, seeds: Sequence[int], episodes: int) -> npt.NDArray[np.int32]:
        """Return int32 [n_seeds, episodes]: `draw_starts(seed).starts(episodes)` of each seed, far sooner."""
        keys = streams(seeds, "starts").tolist()
        if self.starts.kind is StartKind.SAMPLE:
            ids = sampled_ids(keys, self._solvable, self._own_start, self.starts.count).astype(np.int32)
        else:
            ids = np.broadcast_to(self._every_start, (len(keys), len(self._every_start)))
        indexes = start_indexes(keys, self.starts.kind, ids.shape[1], episodes)
        return np.take_along_axis(ids, indexes, axis=1)

    def _drawn(self, key: int) -> npt.NDArray[np.int32]:
        ids = start_ids(self._solvable, self.optimal_steps, self._own_start, self.starts, key)
        return ids.astype(np.int32)

    @cached_property
    def _every_start(self) -> npt.NDArray[np.int32]:
        """Return the starts where no key chooses among them: the same for every seed."""
        return self._drawn(0)

    @cached_property
    def _own_start(self) -> int:
        return self.state_id(self.level.start)

    @cached_property
    def _solvable(self) -> StateIds:
        return np.flatnonzero(self.optimal_steps > 0)

    @cached_property
    def _ids(self) -> dict[tuple[int, ...], int]:
        return {tuple(placement): state for state, placement in enumerate(self.placements.tolist())}


def tabulate(world: World) -> WorldTables:
    """Return the compact tables of a world.

    Raises: WorldError when the level has too many states or no start that can be solved.
    """
    solution = world.solution
    if solution is None:
        message = (
            f"the level has {spoken(count_states(world.level))} states, more than the "
            f"{world.config.states_max:,} that are solved exactly; teach it live, or choose a smaller level"
        )
        raise WorldError(message)
    world.distribution.board(0)  # a level without a start is refused here, with its reason
    number = np.full(solution.table.n_states, _UNSEEN, dtype=np.int32)
    live = _live_states(world, solution, number)
    successor = _compact_successors(solution, live, number)
    steps = np.append(solution.steps[live].astype(np.int32), np.int32(DEADLOCKED))
    outcome = np.full(len(steps), StateOutcome.RUNNING, dtype=np.uint8)
    outcome[steps == 0] = StateOutcome.SOLVED
    outcome[steps == DEADLOCKED] = StateOutcome.DEADLOCK
    return WorldTables(
        level=world.level,
        starts=world.starts,
        successor=successor,
        reward=_rewards(world.config, successor, outcome),
        outcome=outcome,
        optimal_steps=steps,
        optimal_mask=_optimal_masks(successor, steps),
        placements=_placements(solution.table, live),
    )


def _chunks(count: int) -> Iterator[slice]:
    return (slice(first, min(first + _CHUNK, count)) for first in range(0, count, _CHUNK))


def _live_states(world: World, solution: Solution, number: npt.NDArray[np.int32]) -> StateIds:
    """Return, ascending, the ids of the states in which an episode can be, solved ones included.

    `number` comes as _UNSEEN all through and serves as the mark of what was seen; it is left in disorder.
    """
    table, steps = solution.table, solution.steps
    if world.starts.kind is not StartKind.FIXED:
        return np.flatnonzero(steps != DEADLOCKED)
    frontier = np.array([table.state_id(world.level.start)], dtype=np.int64)
    number[frontier] = 0
    while frontier.size:
        fresh = []
        for rows in _chunks(len(frontier)):
            after = table.successors(frontier[rows]).reshape(-1)
            after = after[(number[after] == _UNSEEN) & (steps[after] != DEADLOCKED)]
            # Of the mentions of one state the last leaves its mark: one is kept, without a sort.
            mentions = np.arange(len(after), dtype=np.int32)
            number[after] = mentions
            after = after[number[after] == mentions]
            fresh.append(after[steps[after] > 0])  # an episode ends where the level is solved
        frontier = np.concatenate(fresh)
    return np.flatnonzero(number != _UNSEEN)


def _compact_successors(
    solution: Solution, live: StateIds, number: npt.NDArray[np.int32]
) -> npt.NDArray[np.int32]:
    sink = len(live)
    number.fill(sink)
    number[live] = np.arange(sink, dtype=np.int32)
    successor = np.empty((sink + 1, len(ACTIONS)), dtype=np.int32)
    successor[sink] = sink
    for rows in _chunks(sink):
        successor[rows] = number[solution.table.successors(live[rows])]
    solved = np.flatnonzero(solution.steps[live] == 0)
    successor[solved] = solved[:, np.newaxis]
    return successor


def _rewards(
    config: WorldConfig, successor: npt.NDArray[np.int32], outcome: npt.NDArray[np.uint8]
) -> npt.NDArray[np.float64]:
    """Return float64 [n_states, 4] with the sums that `World.execute` forms, to the bit."""
    paid = config.step_reward + np.array([0.0, config.goal_reward, config.deadlock_reward])
    reward = np.empty(successor.shape, dtype=np.float64)
    for rows in _chunks(len(successor)):
        reward[rows] = paid[outcome[successor[rows]]]
    reward[outcome != StateOutcome.RUNNING] = 0.0
    return reward


def _optimal_masks(successor: npt.NDArray[np.int32], steps: npt.NDArray[np.int32]) -> npt.NDArray[np.uint8]:
    masks = np.empty(len(steps), dtype=np.uint8)
    for rows in _chunks(len(steps)):
        nearer = steps[successor[rows]] == steps[rows, np.newaxis] - 1
        masks[rows] = np.packbits(nearer, axis=1, bitorder="little")[:, 0]
    return masks


def _placements(table: StateTable, live: StateIds) -> npt.NDArray[np.int16]:
    still = np.array(table.still_boxes, dtype=np.int16)[:, np.newaxis]
    placements = np.empty((len(live), 1 + len(table.boxes) + len(still)), dtype=np.int16)
    for rows in _chunks(len(live)):
        rank, player = np.divmod(live[rows], table.n_cells)
        moving = table.cells[table.boxes.take(rank, axis=1)]
        boxes = np.concatenate((moving, still.repeat(len(rank), axis=1)))
        placements[rows, 0] = table.cells[player]
        placements[rows, 1:] = np.sort(boxes, axis=0).T
    return placements
