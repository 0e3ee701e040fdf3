"""`sfid session create|list|show|rewind|pause|resume|stop`."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from protocol.codec import DecodeError, decode, encode
from protocol.keys import KeyNameError, Keys, checked
from protocol.messages import CreateSession, GymWorld, SessionList, WindowSpec, World
from protocol.translate import config_of
from services.cli.session_rows import Match, StateFlag, counted, lacking, listed, state_of
from services.cli.session_source import (
    DeadlockReward,
    EpisodesFlag,
    Flags,
    GoalReward,
    LevelFlag,
    Like,
    MethodFlag,
    StartsFlag,
    StepReward,
    StepsMax,
    chosen,
    condition_named,
    experiment_words,
    scripted_commands,
    wire_world,
)
from services.cli.shared.failure import NOT_SO, CommandError
from services.cli.shared.gym_options import Gym, GymActions, GymOption, GymRender, RewardScale, gym_world
from services.cli.shared.level_files import check_starts, find_level
from services.cli.shared.next_command import suggested
from services.cli.shared.options import (
    CONNECT_TIMEOUT_MS,
    ENDPOINT,
    Access,
    Connect,
    Deployment,
    Json,
    Parameter,
    Seed,
    print_json,
)
from services.cli.shared.tables import labels_line, print_episodes, report_document
from services.cli.shared.waiting import connected_bus
from services.cli.shared.warnings import warn
from services.operator import Operator, OperatorError
from services.runtime.schema_fault import in_words
from services.topology import Role
from sfid_core.learning.methods import METHODS
from sfid_core.learning.parameters import Value
from sfid_core.session.config import WindowMode
from sfid_core.sokoban.starts import Starts as StartsSpec

session_app = typer.Typer(
    help="Create, watch and control teaching sessions.", no_args_is_help=True, rich_markup_mode=None
)
SessionName = Annotated[str, typer.Argument(help="Name of the session: a-z, 0-9, - and _.")]
TeachersMin = Annotated[
    int | None,
    typer.Option(
        help="Teachers who must join before the first decision. Default: 1, or 0 if the method asks nobody."
    ),
]
SEED_MAX = 2**53 - 1


def add_to(app: typer.Typer) -> None:
    """Add the session commands."""
    app.add_typer(session_app, name="session")


def session_config(  # noqa: PLR0917 - one argument a flag
    name: str,
    level: str,
    method: str,
    episodes: int,
    starts: str,
    seed: int,
    window: WindowSpec,
    teachers_min: int,
    parameters: dict[str, Value] | None = None,
    world: World | GymWorld | None = None,
) -> CreateSession:
    """Return a checked configuration; raise with one line and the mend when a value makes no sense.

    Args: parameters: None where the command has no flag for them, so that none is advised.
    """
    try:
        checked(name, "session")
    except KeyNameError as error:
        raise CommandError(str(error)) from None
    if method not in METHODS:
        message = f"unknown method {method!r}: choose one of {', '.join(METHODS)}"
        raise CommandError(message)
    if not 0 <= seed <= SEED_MAX:
        message = f"seed {seed} is outside 0 to 2^53-1: choose another"
        raise CommandError(message)
    config = CreateSession(
        session=name,
        world=world or _sokoban(level, starts, seed),
        method=method,
        parameters=parameters or {},
        episodes=episodes,
        seed=seed,
        window=window,
        teachers_min=teachers_min,
    )
    scale = config.world.reward_scale if isinstance(config.world, GymWorld) else None
    warn(config_of(config), scale=scale, sets_parameters=parameters is not None)
    try:
        return decode(encode(config), CreateSession)
    except DecodeError as error:
        message = f"the session cannot be created: {in_words(error.detail)}"
        raise CommandError(message) from None


def _sokoban(level: str, starts: str, seed: int) -> World:
    StartsSpec.parse(starts)
    title, found = find_level(level)
    check_starts(title, found, starts, seed)
    return World(level=found.to_xsb(), level_name=title, starts=starts)


def window_spec(mode: str, span_ms: int, quorum: int) -> WindowSpec:
    """Return the window of three flags; raise with the mend when the mode is unknown."""
    modes = [known.value for known in WindowMode]
    if mode not in modes:
        message = f"unknown window mode {mode!r}: choose one of {', '.join(modes)}"
        raise CommandError(message)
    return WindowSpec(mode=mode, span_ms=span_ms, quorum=quorum)  # type: ignore[arg-type]


@contextmanager
def operator(
    connect: str, deployment: str, session: str = "any", access: Path | None = None
) -> Iterator[Operator]:
    """Yield an operator of the deployment, for a session of that name; its refusals become one line."""
    try:
        checked(session, "session")
        keys = Keys(deployment)
    except KeyNameError as error:
        raise CommandError(str(error)) from None
    bus = connected_bus(connect, Role.OPERATOR, access, CONNECT_TIMEOUT_MS)
    try:
        yield Operator(bus, keys)
    except OperatorError as error:
        raise CommandError(str(error), NOT_SO) from None
    finally:
        bus.close()


@session_app.command()
def create(  # noqa: PLR0917 - one argument a flag
    name: SessionName,
    level: LevelFlag = None,
    method: MethodFlag = None,
    episodes: EpisodesFlag = None,
    starts: StartsFlag = None,
    seed: Seed = 0,
    like: Like = None,
    goal_reward: GoalReward = None,
    step_reward: StepReward = None,
    deadlock_reward: DeadlockReward = None,
    steps_max: StepsMax = None,
    window_mode: Annotated[str, typer.Option(help="early, full or until-answered.")] = "early",
    window_ms: Annotated[int, typer.Option(help="Window for an answer in ms, 1 to 3,600,000.")] = 5_000,
    quorum: Annotated[int, typer.Option(help="Answers that close the window; 0: everyone present.")] = 0,
    teachers_min: TeachersMin = None,
    parameter: Parameter = None,
    gym: Gym = None,
    gym_option: GymOption = None,
    gym_actions: GymActions = None,
    gym_render: GymRender = "text",
    reward_scale: RewardScale = 1.0,
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
) -> None:
    """Create a session; it begins when enough teachers have joined.

    The same session again is the same session; one of that name with another content is refused.
    """
    window = window_spec(window_mode, window_ms, quorum)
    flags = Flags(
        level, method, episodes, starts, parameter, goal_reward, step_reward, deadlock_reward, steps_max
    )
    if not 0 <= seed <= SEED_MAX:
        message = f"seed {seed} is outside 0 to 2^53-1: choose another"
        raise CommandError(message)
    condition = None if like is None else condition_named(like)
    config = chosen(None if condition is None else condition.config, flags, seed)
    played = gym_world(gym, gym_option, gym_actions, gym_render, reward_scale, config.world.starts)
    world = played or wire_world(config.world)
    given, lasting = dict(config.parameters), config.episodes
    least = min(1, len(METHODS[config.method].asks)) if teachers_min is None else teachers_min
    created = session_config(name, "", config.method, lasting, "", seed, window, least, given, world)
    with operator(connect, deployment, access=access) as asked:
        before = asked.sessions()
        asked.create(created)
    next_ = partial(suggested, connect=connect, deployment=deployment, access=access)
    print(_created_line(name, config.method, next_, _how_it_came(name, before, next_("status"))))
    if condition is not None and METHODS[config.method].asks:
        as_there = experiment_words(condition.config, config)
        for command in scripted_commands(condition.teachers, name):
            print(f"{as_there}: {next_(command)}")


def _how_it_came(name: str, before: SessionList, status: str) -> str:
    """Return whether a session is new; where not all was told of what there was, say so on stderr."""
    if any(row.session == name for row in before.sessions):
        return "was there already, just so"
    unsure = lacking(before, status)
    if unsure is None:
        return "created"
    print(unsure, file=sys.stderr)
    return "created, or was there already, just so"


def _created_line(name: str, method: str, next_: Callable[[str], str], said: str) -> str:
    if METHODS[method].asks:
        return f"session {name} {said}: {next_(f'teach keyboard --session {name}')} teaches it"
    watch = next_(f"session show {name}")
    return f"session {name} {said}: {method} asks nobody: {watch} shows how it does"


@session_app.command("list")
def list_sessions(
    match: Match = None,
    state: StateFlag = None,
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
    json: Json = False,
) -> None:
    """List the sessions of all learners by name, and count them.

    Shards whose learner does not answer to the end are named on stderr, since sessions of theirs are lacking.
    """
    with operator(connect, deployment, access=access) as asked:
        whole = asked.sessions()
    found = whole.sessions
    sessions = listed(found, match, state)
    absent = lacking(whole, suggested("status", connect, deployment, access))
    if absent is not None:
        print(absent, file=sys.stderr)
    if json:
        print_json([
            {"session": row.session, "method": row.method, "level": row.level_name, "phase": row.phase,
             "paused": row.paused, "episode": row.episode, "episodes": row.episodes,
             "teachers": list(row.teachers)}
            for row in sessions
        ])  # fmt: skip
        return
    for row in sessions:
        teachers = ", ".join(row.teachers) or "nobody"
        done = f"episode {row.episode}/{row.episodes}"
        print(f"{row.session}: {row.method} on {row.level_name}, {done}, {state_of(row)}, {teachers}")
    if found or absent is not None:
        print(counted(sessions, len(found)))
    else:
        create_one = suggested("session create NAME", connect, deployment, access)
        print(f"no sessions yet: {create_one} creates one")


@session_app.command()
def show(
    name: SessionName,
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
    json: Json = False,
) -> None:
    """Show a session's measures."""
    with operator(connect, deployment, name, access) as asked:
        report, episodes = asked.show(name)
    if json:
        document = report_document(report, episodes)
        print_json(
            document
            | {"phase": report.summary.phase, "malformed": report.malformed, "failure": report.failure}
        )
        return
    if episodes:
        print_episodes(Console(), episodes)
    else:
        print("no episode is finished yet")
    print(labels_line(report.labels))
    print(f"phase {state_of(report.summary)}, epoch {report.epoch}, q_sha256 {report.q_sha256}")


def _control(verb: str, name: str, connect: str, deployment: str, access: Path | None) -> None:
    with operator(connect, deployment, name, access) as asked:
        asked.control(name, verb)
    print(f"session {name}: {verb} is done and journaled")


@session_app.command()
def rewind(
    name: SessionName,
    episode: Annotated[
        int, typer.Option(help="The episode to go back to, from 0; those before it are kept.")
    ],
    as_: Annotated[
        str | None, typer.Option("--as", help="Name of the branch; NAME-fromEPISODE if not given.")
    ] = None,
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
) -> None:
    """Go back to an episode and teach on from there, as a branch; the session itself stays as it is.

    The branch begins paused, so that its teachers can join it first.
    """
    branch = as_ or f"{name}-from{episode}"
    try:
        checked(branch, "session")
    except KeyNameError as error:
        raise CommandError(str(error)) from None
    if episode < 0:
        raise CommandError(f"episode {episode} is negative: count from 0")
    with operator(connect, deployment, name, access) as asked:
        asked.branch(name, episode, branch)
    resume = suggested(f"session resume {branch}", connect, deployment, access)
    print(f"session {branch} stands before episode {episode} of {name}: {resume} goes on")


@session_app.command()
def pause(
    name: SessionName, connect: Connect = ENDPOINT, access: Access = None, deployment: Deployment = "local"
) -> None:
    """Hold the count-down and the next decision."""
    _control("pause", name, connect, deployment, access)


@session_app.command()
def resume(
    name: SessionName, connect: Connect = ENDPOINT, access: Access = None, deployment: Deployment = "local"
) -> None:
    """Go on from a pause."""
    _control("resume", name, connect, deployment, access)


@session_app.command()
def stop(
    name: SessionName, connect: Connect = ENDPOINT, access: Access = None, deployment: Deployment = "local"
) -> None:
    """End a session where it is; what was learnt is kept."""
    _control("stop", name, connect, deployment, access)
