"""`sfid aggregate`, `sfid said`: a crowd teaches as one teacher; who said what to whom."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from protocol.journal import Record
from protocol.who_said import Saying, said_to_a_crowd, said_to_a_learner
from services.cli.shared.failure import NOT_SO, CommandError
from services.cli.shared.options import (
    ENDPOINT,
    Access,
    Connect,
    Deployment,
    Json,
    RequireTokens,
    Seed,
    SupervisedFd,
    Verbose,
    print_json,
)
from services.cli.shared.recorded import no_such_session, session_names
from services.cli.shared.waiting import service_bus
from services.runtime.journal import read_rows
from services.runtime.process import ProcessConfig, ServiceProcess
from services.runtime.secret import FOLDER, load_secrets
from services.topology import Role
from sfid_core.crowd.round import RoundSettings
from sfid_core.crowd.settings import CrowdMethod, CrowdSettings, crowd_method

ROUNDS = RoundSettings()
WEIGHING = CrowdSettings()


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(aggregate)
    app.command()(said)


DataDirectory = Annotated[
    Path, typer.Option(help="Directory of the deployment; the journal is in crowd-NAME below.")
]
CrowdName = Annotated[str, typer.Option(help="Name under which the crowd teaches.")]
Sessions = Annotated[
    list[str] | None, typer.Option(help="Session that it may teach; may be repeated; default: any.")
]
CrowdDeployment = Annotated[
    str | None, typer.Option(help="Deployment that its members use; default: the learner's name with -crowd.")
]
CrowdMethodOption = Annotated[str, typer.Option(help=f"How answers are weighed: {', '.join(CrowdMethod)}.")]
Quorum = Annotated[int, typer.Option(help="Answers that close a decision; 0: everybody present.")]
Margin = Annotated[int, typer.Option(help="How long before the learner's deadline it closes, in ms.")]
Patience = Annotated[
    int, typer.Option(help="How long after the first answer it closes where there is no deadline, in ms.")
]
AbstainBelow = Annotated[
    float, typer.Option(help="Abstain when the best action is less probable than this, 0 to 1.")
]
Forgetting = Annotated[
    float, typer.Option(help="What earlier answers keep of their weight at each further one, 0.5 to 1.")
]
InfluenceCap = Annotated[
    float, typer.Option(help="Share of a decision that one worker may hold, above 0, up to 1.")
]
GoldShare = Annotated[
    float, typer.Option(help="Share of the states with one optimal action that measure the workers, 0 to 1.")
]
Solver = Annotated[
    bool, typer.Option(help="Let naming another optimal action cost nothing, where the solver knows.")
]


def aggregate(  # noqa: PLR0917 - one argument a flag
    data: DataDirectory,
    name: CrowdName = "crowd",
    session: Sessions = None,
    crowd_deployment: CrowdDeployment = None,
    method: CrowdMethodOption = WEIGHING.method.value,
    quorum: Quorum = ROUNDS.quorum,
    margin_ms: Margin = ROUNDS.margin_ms,
    patience_ms: Patience = ROUNDS.patience_ms,
    abstain_below: AbstainBelow = WEIGHING.abstain_below,
    forgetting: Forgetting = WEIGHING.forgetting,
    influence_cap: InfluenceCap = WEIGHING.influence_cap,
    gold_share: GoldShare = 0.0,
    solver: Solver = True,
    seed: Seed = 0,
    require_tokens: RequireTokens = False,
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
    verbose: Verbose = False,
    supervised_fd: SupervisedFd = None,
) -> None:
    """Run an aggregator: many unreliable people teach as one, and it learns whom to believe."""
    from services.aggregator.config import AggregatorConfig
    from services.aggregator.service import run
    from services.runtime.clock import SystemClock

    rounds = RoundSettings(quorum, margin_ms, patience_ms)
    weighing = replace(
        WEIGHING, method=crowd_method(method), abstain_below=abstain_below, forgetting=forgetting,
        influence_cap=influence_cap,
    )  # fmt: skip
    config = AggregatorConfig(
        data, name, deployment, crowd_deployment or f"{deployment}-crowd", tuple(session or ()), rounds,
        weighing, solver=solver, gold_share=gold_share, seed=seed, require_tokens=require_tokens,
        check_secrets=tuple(load_secrets(data / FOLDER)),
    )  # fmt: skip
    process = ServiceProcess(ProcessConfig(f"aggregator-{name}", supervised_fd, verbose))
    bus = service_bus(connect, process.stop, Role.AGGREGATOR, access)
    try:
        run(config, bus, SystemClock(), process.ready, process.stop)
    finally:
        bus.close()


def said(
    directory: Annotated[Path, typer.Argument(help="Data directory of a deployment.")],
    session: Annotated[str, typer.Option(help="Session to tell of.")],
    as_json: Json = False,
) -> None:
    """Tell who said what, when it was shown and when it was answered, to the learner and to its crowds."""
    # By decision: what members of a crowd said stands beside what came of it.
    rows = sorted(
        (_row(saying) for saying in _sayings(directory, session)),
        key=lambda row: (row["decision"], not row["via"]),
    )
    if not rows:
        if session not in session_names(directory):
            raise no_such_session(directory, session, NOT_SO)
        message = f"{directory}: nobody has said anything in session {session} yet: `sfid teach` teaches it"
        raise CommandError(message, NOT_SO)
    if as_json:
        print_json({"session": session, "said": rows})
        return
    for row in rows:
        what = row["action"] if row["reward"] is None else f"{row['reward']:+g}"
        via = f" (to {row['via']})" if row["via"] else ""
        took = "" if row["response_ms"] is None else f" after {row['response_ms']} ms"
        print(
            f"decision {row['decision']}: {row['teacher']}{via}: {what or row['kind']}{took}: {row['code']}"
        )


def _sayings(directory: Path, session: str) -> Iterator[Saying]:
    yield from said_to_a_learner(_records(directory, session))
    for crowd in sorted(directory.glob("crowd-*")):
        yield from said_to_a_crowd(_records(crowd, session), crowd.name.removeprefix("crowd-"))


def _records(directory: Path, session: str) -> list[Record]:
    rows = read_rows(directory, session)
    return [Record(row.kind, row.at_ns, row.body) for row in rows if row.body is not None]


def _row(saying: Saying) -> dict[str, Any]:
    """Return an answer as JSON: times in ns since 1970 on the clock of the journal, [earliest, latest]."""
    return {
        "answer_id": saying.answer_id.hex(),
        "teacher": saying.teacher,
        "via": saying.via,
        "decision": saying.decision,
        "episode": saying.episode,
        "step": saying.step,
        "kind": saying.kind,
        "action": saying.action,
        "reward": saying.reward,
        "code": saying.code,
        "asked_at_ns": saying.asked_at_ns,
        "shown_ns": saying.shown_ns,
        "answered_ns": saying.answered_ns,
        "arrived_at_ns": saying.arrived_at_ns,
        "response_ms": saying.response_ms,
        "handed_on_as": saying.handed.hex() or None,
    }
