"""Where a session's configuration comes from: flags, a recorded session, or an experiment's condition.

A flag that is given goes before what the session or the condition says, and that before our defaults.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from protocol.codec import DecodeError, decode
from protocol.journal import Kind, Record, events_of
from protocol.messages import CreateSession, GymWorld, World
from protocol.translate import config_of
from services.cli.shared.failure import CommandError
from services.cli.shared.level_files import check_starts, find_level
from services.cli.shared.options import given_parameters
from services.cli.shared.recorded import no_such_session
from sfid_core.learning.methods import METHODS
from sfid_core.learning.parameters import Value, as_written
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.session.events import TeacherJoined
from sfid_core.sokoban.starts import Starts
from sfid_core.sokoban.world import WorldConfig
from sfid_core.teaching.kernels import TeacherParameters
from sfid_core.teaching.personas import PERSONAS, persona_named

if TYPE_CHECKING:
    from sfid_core.experiments.condition import Condition

LevelFlag = Annotated[
    str | None, typer.Option(help="A packaged level's name, or FILE[:N]: the level N from 0. Default: room.")
]
MethodFlag = Annotated[
    str | None, typer.Option(help=f"Learning method: {', '.join(METHODS)}. Default: sfid.")
]
EpisodesFlag = Annotated[int | None, typer.Option(help="Number of episodes, 1 to 1,000,000. Default: 30.")]
StartsFlag = Annotated[
    str | None,
    typer.Option(
        help='Start states: "1" the level\'s own, a number N of drawn ones, "all", or "within:STEPS". '
        "Default: 4."
    ),
]
GoalReward = Annotated[
    float | None, typer.Option(help="What the environment pays for solving, in reward. Default: 10.")
]
StepReward = Annotated[float | None, typer.Option(help="What it pays for every step, in reward. Default: 0.")]
DeadlockReward = Annotated[
    float | None, typer.Option(help="What it pays for a deadlock, in reward. Default: -10.")
]
StepsMax = Annotated[
    int | None, typer.Option(help="Step cap of an episode, 1 to 1,000,000 steps. Default: 200.")
]
Like = Annotated[
    str | None,
    typer.Option(
        help="Begin from an experiment's condition, EXPERIMENT:METHOD+TEACHER as its table names them, such "
        "as figure2:sfid+expert or learners:isabl-held+rare; other flags go before it."
    ),
]
ROOM = "room"


@dataclass(frozen=True, slots=True)
class Flags:
    """What was given on the command line; None leaves it to the source."""

    level: str | None = None
    method: str | None = None
    episodes: int | None = None
    starts: str | None = None
    parameters: list[str] | None = None
    goal_reward: float | None = None
    step_reward: float | None = None
    deadlock_reward: float | None = None
    steps_max: int | None = None


@dataclass(frozen=True, slots=True)
class Recorded:
    """A session as a journal has it."""

    config: SessionConfig
    teachers: tuple[str, ...]
    """Who joined, in order."""


def chosen(base: SessionConfig | None, flags: Flags, seed: int) -> SessionConfig:
    """Return the configuration with the flags in place of what `base`, or our defaults, say.

    Parameters are added to those of the base; another method starts from its own defaults.
    Raises: CommandError, LevelError, WorldError, ParameterError, one line with the mend.
    """
    method = flags.method or (base.method if base else "sfid")
    if method not in METHODS:
        message = f"unknown method {method!r}: choose one of {', '.join(METHODS)}"
        raise CommandError(message)
    kept = base.parameters if base and base.method == method else {}
    given: dict[str, Value] = {**kept, **given_parameters(flags.parameters)}
    world = _world(base.world if base else None, flags, seed)
    episodes = flags.episodes if flags.episodes is not None else (base.episodes if base else 30)
    return SessionConfig(base.session if base else "demo", world, method, given, episodes, seed)


def _world(base: WorldSpec | None, flags: Flags, seed: int) -> WorldSpec:
    starts = flags.starts or (base.starts if base else "4")
    Starts.parse(starts)
    if base is None or flags.level is not None:
        title, level = find_level(flags.level or ROOM)
        check_starts(title, level, starts, seed)
        base = replace(base or WorldSpec(""), level=level.to_xsb(), level_name=title)
    numbers = {
        "goal_reward": flags.goal_reward,
        "step_reward": flags.step_reward,
        "deadlock_reward": flags.deadlock_reward,
        "steps_max": flags.steps_max,
    }
    told: dict[str, float] = {name: number for name, number in numbers.items() if number is not None}
    made = replace(base, starts=starts, **told)  # type: ignore[arg-type] # steps_max alone is an int
    WorldConfig(made.goal_reward, made.step_reward, made.deadlock_reward, made.steps_max)
    return made


def wire_world(spec: WorldSpec) -> World:
    """Return the world as a session is created with it."""
    return World(
        level=spec.level,
        level_name=spec.level_name,
        starts=spec.starts,
        goal_reward=spec.goal_reward,
        step_reward=spec.step_reward,
        deadlock_reward=spec.deadlock_reward,
        steps_max=spec.steps_max,
    )


def recorded(directory: Path, session: str | None) -> Recorded:
    """Return the session of a data directory by its name, or the only one there is.

    Raises: CommandError, JournalError.
    """
    from services.runtime.journal import read_rows

    rows = [row for row in read_rows(directory, session) if row.body is not None]
    created = [row for row in rows if row.kind == Kind.CREATED.value]
    if len(created) != 1:
        raise no_such_session(directory, session)
    try:
        message = decode(created[0].body or b"", CreateSession)
    except DecodeError as error:
        raise CommandError(
            f"{directory}: a row cannot be read ({error}): `sfid verify` tells where"
        ) from None
    if isinstance(message.world, GymWorld):
        raise CommandError(
            f"session {message.session} runs {message.world.environment}: experiments run Sokoban levels, "
            "name a session of one"
        )
    records = (Record(row.kind, row.at_ns, row.body or b"") for row in rows)
    joins = (record for record in records if record.kind == Kind.JOINED.value)
    events = (event for record in joins for _, event in events_of(record, {}))
    people = (event.teacher for event in events if isinstance(event, TeacherJoined))
    return Recorded(config_of(message), tuple(dict.fromkeys(people)))


def condition_named(text: str) -> "Condition":
    """Return the condition EXPERIMENT:METHOD+TEACHER; raises CommandError with the names there are."""
    experiment, _, arm = text.partition(":")
    known = _experiments()
    if experiment not in known:
        message = f"--like {text!r}: no experiment {experiment!r}: write figure2:sfid+expert, or one of "
        raise CommandError(message + ", ".join(known))
    arms = {f"{one.method}+{one.teacher}": one for one in known[experiment]}
    if arm not in arms:
        has_not = f"has no condition {arm!r}" if arm else f"has {len(arms)} conditions"
        choices = ", ".join(
            f'"{experiment}:{name}"' if " " in name else f"{experiment}:{name}" for name in arms
        )
        raise CommandError(f"--like {text!r}: {experiment} {has_not}: choose from {choices}")
    return arms[arm]


def experiment_words(condition: SessionConfig, config: SessionConfig) -> str:
    """Return how near a session made from a condition is to it: its teachers are those of the condition.

    The seed is no part of a condition.
    """
    like = replace(config, session=condition.session, seed=condition.seed, window=condition.window)
    if like == condition:
        return "as in the experiment"
    if config.method != condition.method:
        return f"taught as in the experiment, which has the method {condition.method}"
    return "taught as in the experiment, with what the flags change"


def _experiments() -> "dict[str, list[Condition]]":
    from sfid_core.experiments import circuits, figure2, guidance, learners

    title, level = find_level(ROOM)
    room = WorldSpec(level.to_xsb(), title)
    table = replace(
        room, starts="all", deadlock_reward=learners.DEADLOCK_REWARD, steps_max=learners.STEPS_MAX
    )
    return {
        "figure2": figure2.conditions(room),
        "learners": learners.conditions(table),
        "guidance": guidance.conditions("4"),
        "circuits": circuits.conditions(replace(room, starts="all")),
    }


def scripted_commands(teachers: Mapping[str, TeacherParameters], session: str) -> list[str]:
    """Return the commands, without `sfid`, that teach as an experiment's simulated teachers do."""
    return [
        f"teach scripted --session {session} --name {name} --persona {_persona(one)}"
        for name, one in teachers.items()
    ]


def _persona(parameters: TeacherParameters) -> str:
    """Return the persona, and its other faults as flags, that a teacher's parameters are."""
    own = as_written(parameters)
    differing = {
        name: {key: value for key, value in own.items() if as_written(persona_named(name))[key] != value}
        for name in PERSONAS
    }
    nearest = min(differing, key=lambda name: len(differing[name]))
    return nearest + "".join(f" -f {key}={value}" for key, value in differing[nearest].items())
