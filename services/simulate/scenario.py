"""What one seed stands for: a lesson, the faults of its network and disk, and its trials, all drawn."""

from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache
from random import Random

import msgspec

from protocol.messages import CreateSession, WindowSpec, World
from services.runtime.faults import Faults
from services.runtime.timeline import dice
from services.simulate.disk import DiskFaults
from sfid_core.teaching.kernels import TeacherParameters

SESSION = "s1"
LESSONS, SEEDS_A_SET = 24, 1_000
"""So many lessons are shared by so many seeds, so that each lesson is run without faults only once."""
TEACHERS = ("ann", "bob", "cyd")
LEVELS = (
    "#######\n#.  $@#\n#     #\n#######",
    "######\n#    #\n# $@ #\n#  . #\n######",
    "#######\n#  .  #\n# $$  #\n# .@  #\n#######",
)
STEPS_AN_EPISODE = 2
"""On the average they are more (3.1 in the shortest lesson seen): a long lesson is as long as asked."""
SHORT_DECISIONS = 30
"""The decisions of a short lesson among which its trials are drawn."""
TRIALS_MIN, DECISIONS_A_TRIAL = 20, 10
"""A long lesson meets so many trials, beside what becomes of its messages and its disk."""
MS = 1_000_000


@dataclass(frozen=True, slots=True)
class Lesson:
    """A session and those who teach it."""

    config: CreateSession
    teachers: tuple[str, ...]
    faults: TeacherParameters
    exact: bool
    """Whether faults must not change what is learnt: people are waited for, and all of them return."""
    crowd: bool
    """Whether the teachers are workers of an aggregator, which is the learner's only teacher."""


class What(Enum):
    """A trial."""

    KILL_LEARNER = "kill the learner"
    KILL_ENVIRONMENT = "kill the environment"
    KILL_TEACHER = "kill a teacher"
    KILL_AGGREGATOR = "kill the aggregator"
    LEAVE = "a teacher leaves for good"
    STALL = "stop a process and let it go on"
    CUT = "cut one direction between two processes"
    OFFLINE = "take a process off the network"
    PAUSE = "pause and resume"
    CLOCK = "set the clock an hour forward or back"


@dataclass(frozen=True, slots=True)
class Trial:
    """Something that happens when a decision is first published, or soon after."""

    decision: int
    after_ns: int
    what: What
    who: str
    span_ns: int
    other: str = ""


@dataclass(frozen=True, slots=True)
class Scenario:
    """Everything that a seed decides."""

    seed: int
    lesson: Lesson
    faults: Faults
    disk: DiskFaults
    trials: tuple[Trial, ...]
    viewer: bool = True
    meddler: bool = True

    def watched(self) -> "Scenario":
        """Return the same with a viewer."""
        return replace(self, viewer=True)

    def unwatched(self) -> "Scenario":
        """Return the same without a viewer."""
        return replace(self, viewer=False)


def lesson_of(seed: int) -> int:
    """Return the number of the lesson that a seed teaches."""
    return seed % LESSONS + LESSONS * (seed // SEEDS_A_SET)


@lru_cache(LESSONS)
def lesson(number: int, decisions: int = 0) -> Lesson:
    """Return one of the lessons, a long one on demand."""
    chance = dice(number, "lesson")
    kind = chance.choice(
        ("exact", "exact", "exact", "present", "early", "full", "reward", "q-learning", "crowd")
    )
    if decisions and kind == "q-learning":  # a long lesson has three teachers, who are asked
        kind = "exact"
    teachers = TEACHERS[: max(3 if decisions else 0, chance.randint(1, 3))] if kind != "q-learning" else ()
    mode = "until-answered" if kind in {"exact", "present", "reward", "crowd"} else "early"
    window = WindowSpec(
        mode="full" if kind == "full" else mode,  # type: ignore[arg-type]
        span_ms=chance.randint(20, 400),
        quorum=len(teachers) if kind == "exact" else 0,
    )
    world = World(
        level=chance.choice(LEVELS),
        level_name="simulated",
        starts=chance.choice(("1", "4")),
        steps_max=chance.randint(4, 12),
    )
    config = CreateSession(
        session=SESSION,
        world=world,
        method=kind if kind in {"reward", "q-learning"} else "sfid",
        episodes=max(chance.randint(3, 5), decisions // STEPS_AN_EPISODE),
        seed=chance.randrange(2**32),
        window=window,
        teachers_min=1 if kind == "crowd" else len(teachers),
    )
    faults = TeacherParameters(
        chance.choice((0.0, 0.2)), chance.choice((0.0, 0.2)), chance.choice((0.0, 0.1))
    )
    return Lesson(config, teachers, faults, kind in {"exact", "q-learning"}, kind == "crowd")


def shortened(taught: Lesson, episodes: int) -> Lesson:
    """Return a lesson with so many episodes, and no more than it had."""
    kept = min(episodes, taught.config.episodes)
    return replace(taught, config=msgspec.structs.replace(taught.config, episodes=kept))


def undisturbed(taught: Lesson) -> Scenario:
    """Return a lesson with nothing in its way, and nobody watching."""
    return Scenario(0, taught, Faults(), DiskFaults(), (), viewer=False, meddler=False)


def scenario(seed: int, decisions: int = 0) -> Scenario:
    """Return what a seed stands for; with `decisions`, three teachers for about so many decisions or more."""
    chance = dice(seed, "scenario")
    taught = lesson(lesson_of(seed), decisions)
    faults = Faults(
        drop=chance.choice((0.0, 0.02, 0.1)),
        duplicate=chance.choice((0.0, 0.05, 0.3)),
        reorder=chance.choice((0.0, 0.3)),
        slow=chance.choice((0.0, 0.02, 0.05)),
        delay_ms=chance.choice((0.2, 3.0, 30.0)),
        presence_ms=chance.choice((2.0, 300.0)),
    )
    last = max(SHORT_DECISIONS, decisions)
    rarer = SHORT_DECISIONS / last  # a disk fails about as often in a long lesson as in a short one
    disk = DiskFaults(fails=rarer * chance.choice((0.0, 0.05)), cut=rarer * chance.choice((0.0, 0.0, 0.04)))
    trials = chance.randint(2, 8) if not decisions else max(TRIALS_MIN, decisions // DECISIONS_A_TRIAL)
    drawn = tuple(_trial(chance, taught, last) for _ in range(trials))
    return Scenario(seed, taught, faults, disk, _one_leaver(drawn, killed=bool(decisions)))


def _one_leaver(trials: tuple[Trial, ...], *, killed: bool) -> tuple[Trial, ...]:
    """Let one teacher leave at most; the others stay untouched, or are `killed` and come back."""
    leaves = [trial for trial in trials if trial.what is What.LEAVE][1:]
    if killed:
        return tuple(replace(one, what=What.KILL_TEACHER) if one in leaves else one for one in trials)
    return tuple(one for one in trials if one not in leaves)


def _trial(chance: Random, taught: Lesson, last: int) -> Trial:
    kinds = [
        What.KILL_LEARNER,
        What.KILL_ENVIRONMENT,
        What.STALL,
        What.CUT,
        What.OFFLINE,
        What.PAUSE,
        What.CLOCK,
    ]
    if taught.teachers:
        kinds += [What.KILL_TEACHER, What.KILL_TEACHER]
    if len(taught.teachers) > 1 and not taught.exact:
        kinds += [What.LEAVE, What.LEAVE]
    if taught.crowd:
        kinds += [What.KILL_AGGREGATOR, What.KILL_AGGREGATOR]
    what = chance.choice(kinds)
    everybody = ("learner", "environment", *taught.teachers, *(("aggregator",) if taught.crowd else ()))
    who, other = chance.choice(everybody), chance.choice(everybody)
    if what is What.KILL_LEARNER:
        who = "learner"
    elif what is What.KILL_ENVIRONMENT:
        who = "environment"
    elif what is What.KILL_AGGREGATOR:
        who = "aggregator"
    elif what in {What.KILL_TEACHER, What.LEAVE}:
        who = chance.choice(taught.teachers)
    return Trial(
        decision=chance.randint(1 if what is What.LEAVE else 0, last),
        after_ns=int(chance.random() * chance.choice((1, 20)) * MS),
        what=what,
        who=who,
        span_ns=int(chance.choice((5, 300, 8_000)) * chance.random() * MS),
        other=other,
    )
