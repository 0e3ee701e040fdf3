"""`sfid teach keyboard|scripted|crowd`: one teacher, or a simulated crowd of them."""

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from protocol.keys import KeyNameError, Keys, checked
from services.cli.session_hint import session_hint
from services.cli.shared.failure import CommandError
from services.cli.shared.gym_options import Gym, GymActions, GymOption, best_of
from services.cli.shared.options import (
    CONNECT_TIMEOUT_MS,
    ENDPOINT,
    Access,
    Connect,
    Deployment,
    Json,
    Seed,
    SupervisedFd,
    Verbose,
    given_parameters,
    print_json,
)
from services.cli.shared.waiting import connected_bus, service_bus
from services.runtime.process import ProcessConfig, ServiceProcess
from services.topology import teaching_role
from sfid_core.teaching.personas import PERSONAS, persona_named

teach_app = typer.Typer(
    help="Teach a session, in person or by script.", no_args_is_help=True, rich_markup_mode=None
)
SessionOption = Annotated[str, typer.Option(help="Session to teach.")]
TokenFile = Annotated[
    Path | None,
    typer.Option(
        help="File of `sfid keys new`, or with what `sfid invite --name` printed, where one is required."
    ),
]
Mix = Annotated[
    str,
    typer.Option(
        help="Who is in it: KIND:COUNT or KIND@ACCURACY:COUNT, several parted by commas. Kinds: expert, "
        "good (0.8), careless (0.6), random, constant, adversary (0)."
    ),
]
HowMany = Annotated[int | None, typer.Option(help="How many they are together; checked against the mix.")]
DEFAULT_PERSONA, DEFAULT_NAME = "oracle", "expert"
NameOption = Annotated[str, typer.Option(help="Pseudonym of the teacher: a-z, 0-9, - and _.")]


def add_to(app: typer.Typer) -> None:
    """Add the teaching commands."""
    app.add_typer(teach_app, name="teach")


def _names(session: str, name: str, deployment: str) -> Keys:
    try:
        checked(session, "session")
        checked(name, "teacher")
        return Keys(deployment)
    except KeyNameError as error:
        raise CommandError(str(error)) from None


def _token(path: Path | None) -> dict[str, Any]:
    """Return the token, and the key that proves the learner, as fields of a teacher's configuration."""
    from services.teachers.token_file import read_check_key, read_token

    return {} if path is None else {"token": read_token(path), "check_key": read_check_key(path)}


@teach_app.command()
def scripted(  # noqa: PLR0917 - one argument a flag
    session: SessionOption,
    name: Annotated[
        str | None,
        typer.Option(help="Pseudonym of the teacher: a-z, 0-9, - and _. Default: the persona's, or expert."),
    ] = None,
    persona: Annotated[str, typer.Option(help=f"Who it is: {', '.join(PERSONAS)}.")] = DEFAULT_PERSONA,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            "--fault",
            "-f",
            help="A parameter of the teacher, NAME=VALUE; may be repeated; see `sfid teachers PERSONA`.",
        ),
    ] = None,
    delay_ms: Annotated[int, typer.Option(help="Thinking time before each answer, in ms.")] = 0,
    seed: Seed = 0,
    gym: Gym = None,
    gym_option: GymOption = None,
    gym_actions: GymActions = None,
    token_file: TokenFile = None,
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
    verbose: Verbose = False,
    supervised_fd: SupervisedFd = None,
) -> None:
    """Teach by the exact oracle, with the faults and habits of a persona."""
    from services.teachers.scripted import ScriptedConfig, run

    name = name or (DEFAULT_NAME if persona == DEFAULT_PERSONA else persona)
    keys = _names(session, name, deployment)
    faults = persona_named(persona, given_parameters(fault))
    best = best_of(gym, gym_option, gym_actions)
    process = ServiceProcess(ProcessConfig(f"teacher-{name}", supervised_fd, verbose))
    config = ScriptedConfig(
        session=session, teacher=name, seed=seed, parameters=faults, delay_ms=delay_ms,
        deployment=keys.deployment, **_token(token_file),
    )  # fmt: skip
    bus = service_bus(connect, process.stop, teaching_role(deployment), access)
    hint = partial(session_hint, session, connect, deployment, access)
    try:
        run(config, bus, process.ready, process.stop, best=best, hint=hint)
    finally:
        bus.close()


@teach_app.command()
def keyboard(
    session: SessionOption,
    name: NameOption = "me",
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
    outbox: Annotated[
        Path | None, typer.Option(help="File that keeps unsent answers; one per teacher by default.")
    ] = None,
    token_file: TokenFile = None,
) -> None:
    """Teach with the keyboard, in this terminal."""
    from services.teachers.keyboard import KeyboardConfig, run

    keys, token = _names(session, name, deployment), _token(token_file)
    bus = connected_bus(connect, teaching_role(deployment), access, CONNECT_TIMEOUT_MS)
    try:
        config = KeyboardConfig(
            session=session, teacher=name, deployment=keys.deployment, outbox=outbox, **token
        )
        raise typer.Exit(run(config, bus))
    finally:
        bus.close()


@teach_app.command()
def crowd(  # noqa: PLR0917 - one argument a flag
    session: SessionOption,
    mix: Mix = "good:12,random:5,adversary:3",
    workers: HowMany = None,
    name: Annotated[str, typer.Option(help="How the workers' pseudonyms begin.")] = "w",
    delay_ms: Annotated[
        int, typer.Option(help="Mean thinking time in ms; each worker has one of their own.")
    ] = 0,
    dropout_rate: Annotated[
        float, typer.Option(help="Probability that a worker leaves at a decision, 0 to 1.")
    ] = 0.0,
    away_ms: Annotated[int, typer.Option(help="How long one who left stays away, in ms; 0: for good.")] = 0,
    seed: Seed = 0,
    gym: Gym = None,
    gym_option: GymOption = None,
    gym_actions: GymActions = None,
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Annotated[
        str, typer.Option(help="Deployment of the crowd: the aggregator's, not the learner's.")
    ] = "local-crowd",
    as_json: Json = False,
    verbose: Verbose = False,
    supervised_fd: SupervisedFd = None,
) -> None:
    """Teach by a simulated crowd: many workers in one process, each with faults and a pace of their own."""
    from services.teachers.crowd import CrowdConfig, run
    from sfid_core.teaching.crowd_mix import parse_mix

    keys = _names(session, name, deployment)
    specs = parse_mix(mix, name)
    if workers not in {None, len(specs)}:
        message = (
            f"the mix has {len(specs)} workers, --workers says {workers}: leave --workers out or mend one"
        )
        raise CommandError(message)
    best = best_of(gym, gym_option, gym_actions)
    config = CrowdConfig(session, specs, seed, delay_ms, dropout_rate, away_ms, keys.deployment)
    process = ServiceProcess(ProcessConfig(f"crowd-{name}", supervised_fd, verbose))
    bus = service_bus(connect, process.stop, teaching_role(deployment), access)
    hint = partial(session_hint, session, connect, deployment, access)
    try:
        results = run(config, bus, process.ready, process.stop, hint=hint, best=best)
    finally:
        bus.close()
    if as_json:
        print_json({"workers": [asdict(result) for result in results]})
