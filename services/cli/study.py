"""`sfid study new|run|status|report`: from one file to a running study, and from its data to a report."""

import logging
from contextlib import suppress
from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from services.cli.shared import launch
from services.cli.shared.failure import NOT_SO, CommandError
from services.cli.shared.level_files import check_starts, find_level
from services.cli.shared.next_command import suggested
from services.cli.shared.options import (
    ENDPOINT,
    Access,
    Connect,
    Deployment,
    Json,
    SupervisedFd,
    Verbose,
    print_json,
)
from services.cli.shared.waiting import service_bus, stoppable
from services.router import free_endpoint
from services.runtime.signals import Stop
from services.study.definition_file import StudyFile, read_study, template
from services.supervisor import Service
from services.topology import Role
from sfid_core.sokoban.levels import parse_levels
from sfid_core.study.errors import StudyError

study_app = typer.Typer(
    help="Run a study with people, and report it.", no_args_is_help=True, rich_markup_mode=None
)
DEPLOYMENT = "study"
CHECK_S = 0.2
ROOMS_MIN = 1000
File = Annotated[Path, typer.Argument(help="TOML file of the study.")]
Data = Annotated[Path | None, typer.Option(help="Data directory; overrides the file.")]


def add_to(app: typer.Typer) -> None:
    """Add the study commands."""
    app.add_typer(study_app, name="study")


def load(file: Path) -> StudyFile:
    """Return the study in a file, checked as far as it can be before anything is started."""
    try:
        found = read_study(file, find_level)
    except StudyError as error:
        raise CommandError(str(error)) from None
    except CommandError as error:  # a level that is not there
        raise CommandError(f"{file}: {error}") from None
    for lesson in (found.study.practice, found.study.teaching):
        if lesson is not None:
            check_starts(lesson.level_name, parse_levels(lesson.level)[0], lesson.starts, found.study.seed)
    return found


@study_app.command()
def new(file: File, as_json: Json = False) -> None:
    """Write a commented file to begin with."""
    if file.exists():
        raise CommandError(f"{file} exists: name another, or remove it")
    name = "".join(letter if letter.isalnum() else "-" for letter in file.stem.lower())[:24].strip("-")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(template(name or "study"), encoding="utf-8")
    except OSError as error:
        raise CommandError(f"{file}: {error.strerror or error}: name a file that can be written") from None
    if as_json:
        print_json({"file": str(file)})
        return
    print(f"{file} written: edit it, above all the consent, then `sfid study run {file}`")


@study_app.command()
def run(
    file: File,
    data: Data = None,
    listen: Annotated[str | None, typer.Option(help="HOST:PORT of the page; overrides the file.")] = None,
    rehearsal: Annotated[
        bool, typer.Option("--rehearsal", help="Run although the consent is not finished: for yourselves.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Start router, environment, learner and page; print the participants' link; serve until stopped."""
    found = load(file)
    if found.unfinished and not rehearsal:
        raise CommandError(
            f"{file}: the consent still says {found.unfinished!r}: say whom participants can ask, "
            "or try it among yourselves with --rehearsal"
        )
    where = data or found.data
    deployed = launch.Deployed(where, free_endpoint(), DEPLOYMENT)
    try:
        logs = launch.make_directories(where)
    except OSError as error:
        message = f"{where}: {error.strerror or error}: name a --data directory that can be written"
        raise CommandError(message) from None
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)-7s study %(message)s")
    with suppress(KeyboardInterrupt), stoppable() as stop:  # being stopped is how it ends well
        _run(found, file, deployed, logs, stop, listen=listen or found.page.listen, as_json=as_json)


def _run(
    found: StudyFile,
    file: Path,
    deployed: launch.Deployed,
    logs: Path,
    stop: Stop,
    *,
    listen: str,
    as_json: bool,
) -> None:
    from services.cli.study_link import participants_link

    supervisor = launch.supervise(deployed.data, logs, stop)
    try:
        supervisor.start(launch.router(deployed))
        serving = ("study", "serve", str(file), *deployed.common, "--data", str(deployed.data))
        services = [launch.environment(deployed), launch.learner(deployed)]
        supervisor.start(*services, Service("gateway", (*serving, "--listen", listen)))
        link = participants_link(found, deployed.data)
        if as_json:
            print_json({"url": link, "study": found.study.name, "data_dir": str(deployed.data)})
        else:
            print(f"participants of {found.study.name} take part at\n{link}", flush=True)
            status_of = suggested(
                f"study status {quote(str(file))}", data=deployed.data, usual_data=found.data
            )
            print(f"data in {deployed.data}; {status_of} shows how far people are", flush=True)
        while True:
            supervisor.check()
            stop.pause(CHECK_S)
    finally:
        supervisor.stop()


@study_app.command(hidden=True)
def serve(
    file: File,
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = DEPLOYMENT,
    data: Data = None,
    listen: Annotated[str | None, typer.Option(help="HOST:PORT of the page; overrides the file.")] = None,
    verbose: Verbose = False,
    supervised_fd: SupervisedFd = None,
) -> None:
    """Serve the page of a study beside a router that is there already (`run` starts this)."""
    from protocol.keys import Keys
    from services.gateway.config import GatewayConfig, GatewayError, Limits, place_of
    from services.gateway.service import run as run_gateway
    from services.operator import Operator
    from services.runtime.clock import SystemClock
    from services.runtime.process import ProcessConfig, ServiceProcess
    from services.study.book import Book
    from services.study.flow import StudyFlow
    from services.study.sessions import Sessions

    found = load(file)
    page = found.page
    config = GatewayConfig(
        data_dir=data or found.data,
        deployment=deployment,
        listen=listen or page.listen,
        url=page.url,
        tls_cert=None if page.tls_cert is None else Path(page.tls_cert),
        tls_key=None if page.tls_key is None else Path(page.tls_key),
        insecure_bind=page.insecure_bind,
        # A room stays open as long as its gateway lives, and everybody has one a lesson.
        limits=Limits(rooms_max=max(ROOMS_MIN, found.people * (found.study.periods + 1))),
    )
    try:
        place_of(config)  # what cannot be is said before a router is waited for
        process = ServiceProcess(ProcessConfig("gateway", supervised_fd, verbose))
        book = Book.open(found.study, config.data_dir, SystemClock())
        bus = service_bus(connect, process.stop, Role.STUDY, access)
        sessions = Sessions(Operator(bus, Keys(deployment), patience_s=1.0))
        try:
            run_gateway(config, bus, process.ready, process.stop, StudyFlow(book, sessions))
        finally:
            sessions.close()
            bus.close()
            book.close()
    except (GatewayError, StudyError) as error:
        raise CommandError(str(error)) from None


@study_app.command()
def status(file: File, data: Data = None, as_json: Json = False) -> None:
    """Show how many people are at which step, in which condition."""
    from services.study.reading import NoDataError, read_courses
    from services.study.tally import tally

    found = load(file)
    try:
        study, people = read_courses(data or found.data, found.study.name)
    except NoDataError as error:
        raise CommandError(str(error), NOT_SO) from None
    counted = tally(study, people)
    if as_json:
        print_json(counted.document())
        return
    for line in counted.lines():
        print(line)


@study_app.command()
def report(
    file: File,
    data: Data = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the report; default: DATA/study-NAME/report.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write the paper's figure for people, effort, tables with a codebook, and claims with intervals."""
    from services.cli.study_files import check_figures, write_report
    from services.study.book import study_folder
    from services.study.reading import NoDataError, read_courses, read_participants
    from services.study.tally import tally
    from sfid_core.experiments.intervals import Resampling
    from sfid_core.study.findings import find

    found = load(file)
    where = data or found.data
    check_figures()
    try:
        study, people = read_courses(where, found.study.name)
        _, participants = read_participants(where, found.study.name)
    except NoDataError as error:
        raise CommandError(str(error), NOT_SO) from None
    findings = find(study, participants, Resampling(seed=study.seed))
    files = write_report(out or study_folder(where, study.name) / "report", findings, tally(study, people))
    if as_json:
        print_json(
            {
                "study": study.name,
                "people": dict(findings.people),
                "claims": [claim.document() for claim in findings.claims],
                "conditions": [summary.document() for summary in findings.summaries],
                "files": [str(path) for path in files],
            }
        )
        return
    for claim in findings.claims:
        print(claim.line())
    print(f"report: {files[-1]}, tables and figures beside it")
