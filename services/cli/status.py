"""`sfid status` and `sfid health`: how the services of a deployment do."""

from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer

from protocol.keys import Keys, checked
from services.cli.shared.failure import NOT_SO, CommandError
from services.cli.shared.options import ENDPOINT, Access, Connect, Deployment, Json, print_json
from services.cli.shared.waiting import connected_bus
from services.operations.status import USUAL_NAMES, Found, ask, survey
from services.runtime.bus import Bus, BusError
from services.runtime.secret import SecretError
from services.runtime.zenoh_config import split_endpoint
from services.topology import CROWD, Role

TIMEOUT_MS = 2_000
NEEDED = ("environment", "learner")
ROUTER = "router"


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(status)
    app.command()(health)


def status(
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
    json: Json = False,
) -> None:
    """List the services: role, uptime, sessions, backlog, last commit; exit 1 when one is not well."""
    checked(deployment, "deployment")
    bus = _bus(connect, Role.OPERATOR, access)
    try:
        found = survey(bus, (Keys(deployment), Keys(f"{deployment}{CROWD}")), NEEDED)
    finally:
        bus.close()
    if json:
        print_json({"ready": all(one.ready for one in found), "services": [_row(one) for one in found]})
    else:
        _print_table(found)
    faults = [f"{one.role} {one.name}: {one.fault}" for one in found if not one.ready]
    if faults:
        message = f"{'; '.join(faults)}: look at its log, or start it with `sfid up`"
        raise CommandError(message, NOT_SO)


def health(
    role: Annotated[str, typer.Argument(help=f"{ROUTER}, {', '.join(USUAL_NAMES)}.")],
    name: Annotated[
        str | None, typer.Option(help="Name of the service, such as shard-1 of a learner.")
    ] = None,
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
    json: Json = False,
) -> None:
    """Tell whether one service answers and can be used: exit 0 or 1, for health checks of containers."""
    if role != ROUTER and role not in USUAL_NAMES:
        message = f"no role {role!r}: name one of {ROUTER}, {', '.join(USUAL_NAMES)}"
        raise CommandError(message)
    checked(deployment, "deployment")
    try:
        bus = _bus(connect, Role.OPERATOR if role == ROUTER else Role(role), access)
    except CommandError as error:
        if json:
            print_json({"role": role, "ready": False, "fault": str(error)})
        raise
    try:
        if role == ROUTER:
            found = Found(deployment, ROUTER, ROUTER, None)
            well = True
        else:
            found = ask(bus, Keys(deployment), role, name or USUAL_NAMES[role], TIMEOUT_MS)
            well = found.ready
    finally:
        bus.close()
    if json:
        print_json(_row(found) | {"ready": well})
    elif well:
        print(f"{role} is well")
    if not well:
        raise CommandError(f"{role} {found.name}: {found.fault}", NOT_SO)


def _bus(connect: str, role: Role, access: Path | None) -> Bus:
    split_endpoint(connect)
    try:
        return connected_bus(connect, role, access, TIMEOUT_MS)
    except (BusError, SecretError) as error:
        raise CommandError(str(error), NOT_SO) from None


def _row(one: Found) -> dict[str, Any]:
    said = {} if one.status is None else msgspec.to_builtins(one.status)
    for tag in ("type", "schema"):
        said.pop(tag, None)
    return {
        "deployment": one.deployment, "role": one.role, "name": one.name, "ready": one.ready,
        "fault": one.fault, **{key: value for key, value in said.items() if key not in {"ready", "reason"}},
    }  # fmt: skip


def _print_table(found: list[Found]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from services.cli.shared.tables import print_whole

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for heading in ("role", "name", "ready", "up for", "running", "people", "backlog", "last commit"):
        table.add_column(heading, no_wrap=True)
    for one in found:
        said = one.status
        if said is None:
            table.add_row(one.role, one.name, "no")
            continue
        ago = "" if said.last_commit_ms is None else f"{said.last_commit_ms / 1000:.1f} s ago"
        table.add_row(
            one.role, one.name, "yes" if said.ready else "no", f"{said.uptime_ms / 1000:.0f} s",
            f"{said.running} of {said.sessions}", str(said.teachers), str(said.backlog), ago,
        )  # fmt: skip
    print_whole(table)
