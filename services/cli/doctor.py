"""`sfid doctor`: whether this machine, this data directory and this deployment are well, and the mends."""

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from services.cli.shared.failure import NOT_SO, CommandError
from services.cli.shared.options import ENDPOINT, Access, Connect, Deployment, Json, print_json
from services.cli.shared.waiting import connected_bus
from services.operations.checks import Check, State
from services.operations.data_checks import data_checks
from services.operations.machine_checks import machine_checks
from services.operations.network_checks import network_checks
from services.topology import Role

TIMEOUT_MS = 1_000


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(doctor)


def doctor(
    data: Annotated[Path, typer.Option(help="Data directory of the deployment.")] = Path("sfid-data/up"),
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
    prove: Annotated[bool, typer.Option("--prove", help="Also prove every row of every journal.")] = False,
    json: Json = False,
) -> None:
    """Look at Python, packages, disk, journals, secrets, ports, router, clock; exit 1 if one fails."""
    checks = [
        *machine_checks(),
        *data_checks(data, prove=prove),
        *network_checks(
            connect, deployment, lambda: connected_bus(connect, Role.OPERATOR, access, TIMEOUT_MS)
        ),
    ]
    counts = Counter(check.state for check in checks)
    if json:
        print_json(
            {
                "well": not counts[State.FAIL],
                **{state.value: counts[state] for state in State},
                "checks": [
                    {"name": one.name, "state": one.state.value, "found": one.found, "mend": one.mend}
                    for one in checks
                ],
            }
        )
    else:
        for check in checks:
            _tell(check)
    if counts[State.FAIL]:
        names = ", ".join(check.name for check in checks if check.state is State.FAIL)
        raise CommandError(f"not well: {names}: the lines marked fail say the mend", NOT_SO)


def _tell(check: Check) -> None:
    mend = f"  ->  {check.mend}" if check.mend else ""
    print(f"{check.state.value:<5} {check.name}: {check.found}{mend}")
