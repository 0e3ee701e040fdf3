"""All lanes of a batch at once, as array arithmetic: the founding paper's conditions where nothing compiles.

The kernels are what the methods and teachers are; here `q-learning`, `sfid` and `reward` with one teacher are
told once more, because arrays do without a compiler what Python's calls cannot. Every number of a lane comes
of the kernels' operations in the kernels' order, so that the bits are theirs; tests hold this to the kernels.
Lanes keep step by the number of the decision, which names every draw, and so draws are made many at a time.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sfid_core.chance_array import Words, draws
from sfid_core.experiments.lane_world import CAP, COLUMNS, N_ACTIONS, Lanes, LaneWorld
from sfid_core.learning.method import Method, Numbers
from sfid_core.learning.sfid import SKIP, omega
from sfid_core.teaching.kernels import TeacherParameters, count_actions, nth_action

STATES_MAX = 2048
"""Every lane has a table of its own; a larger one would not stay in the cache, and kernels are as fast."""
BLOCK = 64
"""Decisions whose draws are made together, and after which finished lanes are left out."""
_PREFERENCE, _SILENCE, _ERROR, _CHOICE, _HABIT, _SOFTEN = range(6)
"""Streams of a teacher, as `teaching.kernels` names them."""
_CODES = 1 << N_ACTIONS
_COUNT = np.array([count_actions(code, N_ACTIONS) for code in range(_CODES)])
_NTH = np.array([nth_action(code, place, N_ACTIONS) for place in range(N_ACTIONS) for code in range(_CODES)])
"""The place-th action whose bit is set in a code, at place * _CODES + code."""

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


def covers(method: Method, teachers: tuple[TeacherParameters, ...], n_states: int) -> bool:
    """Tell whether `run_together` runs such sessions: one teacher at most, who remembers nothing."""
    return (
        method.name in {"q-learning", "sfid", "reward"}
        and len(teachers) <= 1
        and n_states <= STATES_MAX
        and not any(one.fatigue or one.diminishing or one.drift_after for one in teachers)
    )


class Together(NamedTuple):
    """A batch of sessions as arrays; `world` and `streams` are of arrays too."""

    world: LaneWorld
    method: str
    parameters: Numbers
    teacher: TeacherParameters | None
    streams: Lanes
    episodes: int


class _Drawn(NamedTuple):
    """Draws of a block of decisions: [BLOCK, lanes] each."""

    ties: Ints
    """32 bits, as those of `choice`."""
    explored: Flags
    silent: Flags
    mistaken: Flags
    choice: Ints
    spared_right: Flags
    spared_wrong: Flags
    softened: Flags


class _Said(NamedTuple):
    """What the teacher says of one decision, by lane."""

    h: Floats
    given: Flags


def run_together(batch: Together, out: Floats) -> Floats:
    """Run all lanes and write their measures to `out`, lane by lane, as `run_lanes` does.

    Returns: float64 [n_states * (N_ACTIONS + 1)], what the last lane has learnt, as `Memory.values` has it.
    """
    run = _Run(batch, out.reshape(-1, COLUMNS))
    decision = 0
    while len(run.lane):
        drawn = run.draw(decision)
        for place in range(BLOCK):
            run.step(_Drawn(*[each[place] for each in drawn]))
        decision += BLOCK
        run.leave_out_finished()
    return run.last_table()


class _Run:
    """The lanes that are still running, and the tables of all."""

    def __init__(self, batch: Together, out: Floats) -> None:
        world = batch.world
        self.batch, self.p, self.steps_max, self.out = batch, batch.parameters, world.steps_max, out
        self.successor, self.reward, self.outcome, self.distance, self.optimal = map(
            np.asarray, (world.successor, world.reward, world.outcome, world.distance, world.optimal)
        )
        lanes, self.n_states = batch.streams.lanes, len(self.outcome)
        self.starts = np.asarray(batch.streams.starts).reshape(lanes, batch.episodes)
        self.values = np.zeros(lanes * self.n_states * N_ACTIONS)
        self.updates = np.zeros(self.n_states)
        keys = np.asarray(batch.streams.teachers, dtype=np.uint64).reshape(lanes, -1)[:, 0]
        self.keys = [draws(keys, stream) for stream in range(6)]
        self.preferred = _preferred(self.keys[_PREFERENCE], np.asarray(world.word), self.optimal)
        self.lane = np.arange(lanes)
        self.state = self.starts[:, 0].astype(np.int64)
        self.episode = np.zeros(lanes, dtype=np.int64)
        self.taken = np.zeros(lanes, dtype=np.int64)
        self.discount = np.ones(lanes)
        self.sums = np.zeros((7, lanes))
        """|TD error|, shaped, return, environment's return, inputs, agreements, as preferred."""

    def draw(self, first: int) -> _Drawn:
        """Return the draws of the block that begins with a decision."""
        at = np.arange(first, first + BLOCK)[:, np.newaxis]
        t = self.batch.teacher or TeacherParameters(silence=1.0)
        never = np.zeros((BLOCK, len(self.lane)), dtype=np.bool_)

        def less(stream: int, rate: float) -> Flags:
            """Tell where a uniform draw of the teacher is less than a rate."""
            if rate <= 0.0:
                return never
            found: Flags = _units(draws(self.keys[stream][self.lane], at)) < rate
            return found

        streams = self.batch.streams
        explored = never
        if self.p.explore > 0.0:
            explored = _units(draws(np.asarray(streams.explore)[self.lane], at)) < self.p.explore
        return _Drawn(
            _upper(draws(np.asarray(streams.ties)[self.lane], at)),
            explored,
            less(_SILENCE, t.silence),
            less(_ERROR, t.label_error if self.batch.method == "sfid" else t.reward_error),
            _upper(draws(self.keys[_CHOICE][self.lane], at)),
            less(_HABIT, t.silence_right),
            less(_HABIT, t.silence_wrong),
            less(_SOFTEN, t.soften),
        )

    def step(self, drawn: _Drawn) -> None:
        """Decide, act and learn once in every lane."""
        p, sums = self.p, self.sums
        row = self.lane * self.n_states + self.state
        action = self._chosen(row, drawn)
        there = self.state * N_ACTIONS + action
        next_state = self.successor.take(there).astype(np.int64)
        reward, outcome = self.reward.take(there), self.outcome.take(next_state)
        named = self.preferred.take(row)
        h, given = self._said(drawn, action, named)
        ahead = self._best(self.lane * self.n_states + next_state)
        ahead[outcome > 0] = 0.0
        place = row * N_ACTIONS + action
        value = self.values.take(place)
        environment = reward + p.gamma * ahead - value
        shaped = environment + h
        self._learn(place, value + p.alpha * shaped, given)
        sums[0] += np.abs(environment)
        sums[1] += np.abs(shaped)
        sums[2] += self.discount * (reward + h)
        sums[3] += self.discount * reward
        sums[4] += given
        sums[5] += h > 0.0
        sums[6] += action == named
        self.discount *= p.gamma
        self.taken += 1
        self.state = next_state
        ended = np.flatnonzero((outcome > 0) | (self.taken >= self.steps_max))
        if len(ended):
            self._end(ended, outcome)

    def leave_out_finished(self) -> None:
        """Go on with the lanes that have episodes left."""
        left = self.episode < self.batch.episodes
        if not left.all():
            self.lane, self.state, self.episode = self.lane[left], self.state[left], self.episode[left]
            self.taken, self.discount = self.taken[left], self.discount[left]
            self.sums = self.sums.compress(left, axis=1)

    def last_table(self) -> Floats:
        """Return the table of the last lane, with the number of updates of each state."""
        last = self.values[-self.n_states * N_ACTIONS :].reshape(self.n_states, N_ACTIONS)
        return np.column_stack((last, self.updates)).reshape(-1)

    def _chosen(self, row: Ints, drawn: _Drawn) -> Ints:
        """Return an action with the largest value, ties as `choose_first_block` breaks them."""
        values = [self.values.take(row * N_ACTIONS + action) for action in range(N_ACTIONS)]
        largest = values[0]
        for value in values[1:]:
            largest = np.maximum(largest, value)
        code = np.zeros(len(row), dtype=np.uint8)
        for action, value in enumerate(values):
            code |= np.equal(value, largest).view(np.uint8) << np.uint8(action)
        action_of: Ints = _picked(code, drawn.ties)
        if self.p.explore > 0.0:
            action_of = np.where(drawn.explored, (drawn.ties * N_ACTIONS) >> 32, action_of)
        return action_of

    def _best(self, row: Ints) -> Floats:
        place = row * N_ACTIONS
        largest = self.values.take(place)
        for action in range(1, N_ACTIONS):
            largest = np.maximum(largest, self.values.take(place + action))
        return largest

    def _said(self, drawn: _Drawn, action: Ints, named: Ints) -> _Said:
        """Return the teacher's part of the reward, and where they said something."""
        if self.batch.teacher is None or self.batch.method == "q-learning":
            return _Said(np.zeros(len(action)), np.zeros(len(action), dtype=np.bool_))
        if self.batch.method == "sfid":
            return self._labels(drawn, action, named)
        right = action == named
        if self.batch.teacher.praises == 0:
            right = (self.optimal.take(self.state) >> action) & 1 == 1
        right = right != drawn.mistaken
        given = ~(drawn.silent | np.where(right, drawn.spared_right, drawn.spared_wrong))
        right |= drawn.softened
        return _Said(np.where(given, np.where(right, 1.0, -1.0), 0.0), given)

    def _labels(self, drawn: _Drawn, action: Ints, named: Ints) -> _Said:
        optimal = self.optimal.take(self.state)
        among = (_CODES - 1) & ~optimal
        among = np.where(among == 0, optimal & ~(1 << named), among)
        label = np.where(drawn.mistaken, _picked(among, drawn.choice), named)
        given = ~drawn.silent & (label >= 0)
        agrees, differs = (omega(self.p.omega, belief, N_ACTIONS) for belief in (1.0, 0.0))
        return _Said(np.where(given, np.where(label == action, agrees, differs), 0.0), given)

    def _learn(self, place: Ints, learnt: Floats, given: Flags) -> None:
        """Write the new values; a lane that has finished learns no more, nor one that skips silence."""
        running = self.episode < self.batch.episodes
        if self.batch.method == "sfid" and self.p.silence == SKIP:
            running &= given
        if running.all():
            self.values[place] = learnt
        else:
            self.values[place[running]] = learnt[running]
        if self.lane[-1] == self.batch.streams.lanes - 1 and running[-1]:
            self.updates[self.state[-1]] += 1.0

    def _end(self, ended: Ints, outcome: npt.NDArray[np.uint8]) -> None:
        """Write the measures of episodes that ended and begin the lanes' next ones."""
        counted = ended[self.episode[ended] < self.batch.episodes]
        lane, episode, steps = self.lane[counted], self.episode[counted], self.taken[counted]
        sums, row = self.sums[:, counted], self.out[lane * self.batch.episodes + episode]
        row[:, 0], row[:, 1], row[:, 2] = steps, sums[0] / steps, sums[1] / steps
        row[:, 3:7] = sums[2:6].T
        row[:, 7] = np.where(outcome[counted] > 0, outcome[counted], CAP)
        row[:, 8] = self.distance[self.starts[lane, episode]]
        row[:, 9] = sums[6] / steps
        self.out[lane * self.batch.episodes + episode] = row
        self.episode[counted] += 1
        next_episode = np.minimum(self.episode[ended], self.batch.episodes - 1)
        self.state[ended] = self.starts[self.lane[ended], next_episode]
        self.sums[:, ended], self.taken[ended], self.discount[ended] = 0.0, 0, 1.0


def _picked(code: npt.NDArray[np.integer], words: Ints) -> Ints:
    """Return an action whose bit is set in the code, drawn by the upper bits of a word; -1 where none is."""
    place = (words * _COUNT.take(code)) >> 32
    picked: Ints = _NTH.take(place * _CODES + code)
    return picked


def _preferred(keys: Words, words: Words, optimal: Ints) -> Ints:
    """Return what each lane's teacher would name in each state: int64 [lanes * n_states]."""
    places = _upper(draws(keys[:, np.newaxis], words))
    return _picked(np.broadcast_to(optimal, places.shape), places).reshape(-1)


def _upper(words: Words) -> Ints:
    return (words >> np.uint64(32)).astype(np.int64)


def _units(words: Words) -> Floats:
    units: Floats = (words >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return units
