"""`sfid demo`: everything on this machine, with scripted teachers, and a table at the end."""

import logging
import queue
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.logging import RichHandler
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from protocol.codec import decode
from protocol.keys import Keys
from protocol.messages import CreateSession, Episode, GymWorld, SessionReport, Step, WindowSpec
from protocol.session_union import untold
from services.cli.session import session_config
from services.cli.shared import launch
from services.cli.shared.failure import NOT_SO, CommandError
from services.cli.shared.gym_options import (
    Gym,
    GymActions,
    GymOption,
    GymRender,
    RewardScale,
    best_actions,
    gym_flags,
    gym_world,
)
from services.cli.shared.options import Episodes, Json, Level, Method, Seed, Starts, print_json
from services.cli.shared.tables import labels_line, print_episodes, report_document
from services.cli.shared.waiting import stoppable
from services.operator import Operator, OperatorError
from services.router import free_endpoint
from services.runtime.bus import Received
from services.runtime.signals import Stop
from services.runtime.zenoh_bus import ZenohBus
from services.supervisor import Supervisor
from services.topology import Role
from sfid_core.teaching.personas import PERSONAS

VIEWER_PACE_MS = 30
"""Thinking time of the demo's teachers while somebody can watch: about 25 decisions a second."""
POLL_S = 2.0
"""A lost message delays the end of the demo by this much at most: the report is asked for as well."""


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(demo)


@dataclass(frozen=True, slots=True)
class _Plan:
    """One demo."""

    config: CreateSession
    teachers: tuple[str, ...]
    pace_ms: int
    viewer: bool
    console: Console
    deployed: launch.Deployed


def demo(  # noqa: PLR0917 - one argument a flag
    level: Level = "room",
    method: Method = "sfid",
    teacher: Annotated[
        str,
        typer.Option(
            help="Simulated teachers (`sfid teachers` lists them), one or several by comma; or none."
        ),
    ] = "oracle",
    episodes: Episodes = 30,
    starts: Starts = "4",
    seed: Seed = 0,
    data: Annotated[
        Path | None, typer.Option(help="Data directory; a new one under sfid-data/ if not given.")
    ] = None,
    viewer: Annotated[
        bool, typer.Option(help="Run the Rerun monitor, at a pace that can be watched.")
    ] = True,
    pace_ms: Annotated[int | None, typer.Option(help="Thinking time of the teachers in ms.")] = None,
    gym: Gym = None,
    gym_option: GymOption = None,
    gym_actions: GymActions = None,
    gym_render: GymRender = "text",
    reward_scale: RewardScale = 1.0,
    json: Json = False,
) -> None:
    """Run router, environment, learner, scripted teacher and monitor; teach; print the measures."""
    teachers = _teachers(teacher)
    waits = (
        WindowSpec(mode="until-answered", span_ms=2_000) if teachers else WindowSpec(mode="early", span_ms=1)
    )
    world = gym_world(gym, gym_option, gym_actions, gym_render, reward_scale, starts)
    config = session_config("demo", level, method, episodes, starts, seed, waits, len(teachers), world=world)
    if world is not None and teachers:
        best_actions(world)  # what nobody can teach is said before anything is started
    pace = (VIEWER_PACE_MS if viewer else 0) if pace_ms is None else pace_ms
    deployed = launch.Deployed(data or _new_directory(), free_endpoint(), "demo")
    plan = _Plan(config, teachers, pace, viewer, Console(stderr=True), deployed)
    with stoppable() as stop:
        report, rows, processes = _run(plan, stop)
    _print_result(plan, report, rows, processes, as_json=json)


def _teachers(text: str) -> tuple[str, ...]:
    names = () if text == "none" else tuple(text.split(","))
    for name in names:
        if name not in PERSONAS:
            message = (
                f"unknown teacher {name!r}: choose from {', '.join(PERSONAS)}, several by comma, or none"
            )
            raise CommandError(message)
    return names


def _new_directory() -> Path:
    try:
        Path("sfid-data").mkdir(exist_ok=True)
        return Path(tempfile.mkdtemp(prefix=time.strftime("demo-%Y%m%d-%H%M%S-"), dir="sfid-data"))
    except OSError as error:
        message = f"sfid-data: {error.strerror or error}: name a --data directory that can be written"
        raise CommandError(message) from None


def _run(plan: _Plan, stop: Stop) -> tuple[SessionReport, list[Episode], list[tuple[str, int]]]:
    """Start everything, wait for the end of the session, take everything down."""
    try:
        logs = launch.make_directories(plan.deployed.data)
    except OSError as error:
        message = (
            f"{plan.deployed.data}: {error.strerror or error}: name a --data directory that can be written"
        )
        raise CommandError(message) from None
    logging.basicConfig(
        level=logging.INFO,
        format="%(message)s",
        handlers=[RichHandler(console=plan.console, show_path=False)],
    )
    supervisor = launch.supervise(plan.deployed.data, logs, stop)
    bus: ZenohBus | None = None
    try:
        supervisor.start(launch.router(plan.deployed))
        services = [launch.environment(plan.deployed), launch.learner(plan.deployed)]
        if plan.viewer:
            services.append(launch.monitor(plan.deployed, viewer=True, ports=(0, 0, 0)))
        details = supervisor.start(*services)
        _say_where(plan, details.get("monitor", ""))
        bus = launch.bus(plan.deployed, Role.OPERATOR)
        report, rows = _teach(plan, supervisor, bus, stop)
        return report, rows, supervisor.processes()
    finally:
        if bus is not None:
            bus.close()
        supervisor.stop()


def _say_where(plan: _Plan, watch: str) -> None:
    plan.console.print(f"data in {plan.deployed.data}", highlight=False, soft_wrap=True)
    if watch:
        plan.console.print(watch, highlight=False, soft_wrap=True)


def _teach(
    plan: _Plan, supervisor: Supervisor, bus: ZenohBus, stop: Stop
) -> tuple[SessionReport, list[Episode]]:
    keys = Keys(plan.deployed.deployment)
    operator = Operator(bus, keys, patience_s=30.0, pause=stop.pause)
    try:
        config = named_afresh(operator, plan.config)
        news: queue.SimpleQueue[bytes] = queue.SimpleQueue()

        def receive(message: Received) -> None:
            news.put(message.payload)

        bus.subscribe(keys.measures(config.session), receive)
        operator.create(config)
        for number, name in enumerate(plan.teachers):
            flags = (
                *("--persona", name, "--delay-ms", str(plan.pace_ms), "--seed", str(config.seed)),
                *(gym_flags(config.world) if isinstance(config.world, GymWorld) else ()),
            )
            unique = name if plan.teachers.count(name) == 1 else f"{name}-{number + 1}"
            supervisor.start(launch.scripted_teacher(plan.deployed, config.session, unique, flags))
        return _await_end(plan, config, supervisor, operator, news, stop)
    except OperatorError as error:
        raise CommandError(str(error), NOT_SO) from None


def named_afresh(operator: Operator, config: CreateSession) -> CreateSession:
    """Return the configuration under a name that the data directory does not have yet.

    Raises: CommandError where the list of what it has is not whole, so that no name is known to be free.
    """
    import msgspec

    whole = operator.sessions()
    if untold(whole):
        raise CommandError(
            f"{config.session}: what sessions there are was not told to the end, so no free name is known: "
            "run the demo again, or with another --data directory", NOT_SO,
        )  # fmt: skip
    taken = {row.session for row in whole.sessions}
    number = 1
    name = config.session
    while name in taken:
        number += 1
        name = f"{config.session}-{number}"
    return msgspec.structs.replace(config, session=name)


def _await_end(
    plan: _Plan,
    config: CreateSession,
    supervisor: Supervisor,
    operator: Operator,
    news: queue.SimpleQueue[bytes],
    stop: Stop,
) -> tuple[SessionReport, list[Episode]]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=plan.console, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task("episodes", total=config.episodes)
        asked_at = time.monotonic()
        while True:
            stop.look()
            supervisor.check()
            done = _episodes_done(news)
            if done:
                progress.update(task, completed=done)
            if done == config.episodes or time.monotonic() - asked_at >= POLL_S:
                asked_at = time.monotonic()
                report, rows = operator.show(config.session)
                progress.update(task, completed=len(rows))
                if report.failure:
                    raise CommandError(f"session {config.session} stopped: {report.failure}", NOT_SO)
                if report.summary.phase == "finished":
                    return report, rows


def _episodes_done(news: queue.SimpleQueue[bytes]) -> int:
    """Return the number of episodes finished by the newest message, 0 when nothing came for a moment."""
    done = 0
    try:
        message = decode(news.get(timeout=0.1), Step | Episode)  # type: ignore[arg-type]
        while True:
            if isinstance(message, Episode):
                done = message.episode + 1
            message = decode(news.get_nowait(), Step | Episode)  # type: ignore[arg-type]
    except queue.Empty:
        return done


def _print_result(
    plan: _Plan,
    report: SessionReport,
    rows: list[Episode],
    processes: list[tuple[str, int]],
    *,
    as_json: bool,
) -> None:
    recordings = sorted((plan.deployed.data / "recordings").glob(f"{report.summary.session}*.rrd"))
    recording = str(recordings[-1]) if recordings else None
    if as_json:
        extra: dict[str, Any] = {
            "data_dir": str(plan.deployed.data),
            "recording": recording,
            "processes": [{"role": name, "pid": pid} for name, pid in processes],
        }
        print_json(report_document(report, rows) | extra)
        return
    console = Console()
    print_episodes(console, rows)
    console.print(labels_line(report.labels), highlight=False, soft_wrap=True)
    console.print(
        f"teaching time {report.teaching_ns / 1e9:.1f} s, q_sha256 {report.q_sha256}",
        highlight=False,
        soft_wrap=True,
    )
    console.print(
        f"check it: {sys.argv[0]} replay {plan.deployed.data} --verify", highlight=False, soft_wrap=True
    )
    if recording:
        console.print(
            f"watch it again: {Path(sys.argv[0]).with_name('rerun')} {recording}",
            highlight=False,
            soft_wrap=True,
        )
