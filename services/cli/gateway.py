"""`sfid gateway`, `sfid invite`: teaching from a browser."""

import io
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import urlsplit

import typer

from protocol.keys import checked
from services.cli.shared.failure import NOT_SO, CommandError
from services.cli.shared.next_command import suggested
from services.cli.shared.options import (
    DATA,
    ENDPOINT,
    Access,
    Connect,
    Data,
    Deployment,
    Json,
    SupervisedFd,
    Verbose,
    print_json,
)
from services.cli.shared.waiting import service_bus
from services.cli.shared.whereabouts import ToldConnect, ToldDeployment, Whereabouts, whereabouts
from services.runtime.endpoint import is_loopback
from services.topology import CROWD
from services.topology import Role as BusRole

PEOPLE = 30
"""Who may use a link without a name, unless told otherwise: a class."""


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(gateway)
    app.command()(invite)


def gateway(  # noqa: PLR0917 - one argument a flag
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
    data: Data = DATA,
    listen: Annotated[
        str, typer.Option(help="HOST:PORT of the page; port 0 takes a free one.")
    ] = "127.0.0.1:7480",
    url: Annotated[
        str | None, typer.Option(help="Address that browsers use, where it is another (a proxy's, say).")
    ] = None,
    tls_cert: Annotated[Path | None, typer.Option(help="PEM file of the certificate chain.")] = None,
    tls_key: Annotated[Path | None, typer.Option(help="PEM file of its key.")] = None,
    insecure_bind: Annotated[
        bool, typer.Option(help="Listen where other machines reach it, although nothing is encrypted.")
    ] = False,
    status: Annotated[
        bool, typer.Option("--status", help="Start nothing: show what the gateway of --data counts.")
    ] = False,
    as_json: Json = False,
    verbose: Verbose = False,
    supervised_fd: SupervisedFd = None,
) -> None:
    """Serve the teaching page: anyone with an invitation teaches from a browser."""
    from services.gateway.config import GatewayConfig, GatewayError, place_of
    from services.gateway.service import run
    from services.runtime.process import ProcessConfig, ServiceProcess

    checked(deployment, "deployment")
    if status:
        _show_status(data, as_json=as_json)
        return
    config = GatewayConfig(
        data_dir=data,
        deployment=deployment,
        listen=listen,
        url=url,
        tls_cert=tls_cert,
        tls_key=tls_key,
        insecure_bind=insecure_bind,
    )
    try:
        place_of(config)  # what cannot be is said before a router is waited for
        process = ServiceProcess(ProcessConfig("gateway", supervised_fd, verbose))
        bus = service_bus(connect, process.stop, BusRole.GATEWAY, access)
        try:
            run(config, bus, process.ready, process.stop)
        finally:
            bus.close()
    except GatewayError as error:
        raise CommandError(str(error)) from None


def invite(  # noqa: PLR0917 - one argument a flag
    session: Annotated[str, typer.Option(help="Session to teach.")] = "",
    name: Annotated[str | None, typer.Option(help="Invite one person, under this name.")] = None,
    people: Annotated[
        int | None,
        typer.Option(help=f"How many people may use the one link, 1 to 100,000. Default: {PEOPLE}."),
    ] = None,
    hours: Annotated[float, typer.Option(help="How long the link is good for.")] = 24.0,
    qr: Annotated[bool, typer.Option(help="Draw the link as a QR code, to be scanned.")] = True,
    revoke: Annotated[
        str | None, typer.Option(help="Withdraw the link with this id, and all that was given for it.")
    ] = None,
    url: Annotated[
        str | None, typer.Option(help="Address of the page; default: the running gateway's.")
    ] = None,
    data: Data = DATA,
    connect: ToldConnect = None,
    deployment: ToldDeployment = None,
    as_json: Json = False,
) -> None:
    """Make a link to the teaching page: for one person with --name, else one for a whole class."""
    from services.gateway.config import GatewayError

    try:
        if revoke is not None:
            _revoke(data, revoke, as_json=as_json)
            return
        if not session:
            raise CommandError("no session: name the one to teach with --session")
        if name is not None and people not in {None, 1}:
            raise CommandError(
                f"--people {people} with --name {name}: a name is one person's; leave one of the two out, or "
                "invite each by their own name"
            )
        given = PEOPLE if people is None else people
        where = whereabouts(data, connect, deployment)
        made = _link(data, checked(session, "session"), name, given, hours, url)
    except GatewayError as error:
        raise CommandError(str(error)) from None
    page = made["url"].partition("/#")[0] if url is None else None
    for line in _notes(data, session, where, page):
        print(line, file=sys.stderr)
    if as_json:
        print_json(made)
        return
    _print_link(made, data, qr=qr)


def _notes(data: Path, session: str, where: Whereabouts, page: str | None) -> Iterator[str]:
    """Yield what whoever invites should know: of the session, and of who can open the page.

    Args: page: its address; None where whoever invites has said it.
    """
    there = _is_there(data, session)
    if there is None:
        yield f"cannot see the learner's sessions in {data}, so the name {session} is not checked"
    elif not there:
        create = suggested(f"session create {session}", where.connect, where.deployment.removesuffix(CROWD))
        yield (
            f"no session {session} in {data} yet: whoever follows the link waits until there is one "
            f"({create} creates it)"
        )
    if page and not where.is_here and is_loopback(f"tcp/{urlsplit(page).hostname}:1"):
        yield f"{page} opens on its own machine only: where people have another address for it, pass --url"


def _is_there(data: Path, session: str) -> bool | None:
    """Tell whether the deployment's journal knows the session; None where there is no journal to see."""
    from services.runtime.journal import JournalError, read_rows

    try:
        return next(read_rows(data, session), None) is not None
    except JournalError:  # no learner has been here: it may keep its journal on another machine
        return None


def _address(data: Path) -> str:
    """Return where the page of the deployment is; raise with the mend where there is none."""
    from services.gateway.config import GatewayError
    from services.gateway.service import read_status

    try:
        return str(read_status(data)["url"])
    except GatewayError:
        message = (
            f"{data}: no gateway has run here: start one with {suggested('up --gateway', data=data)}, "
            "name its data directory with --data, or say with --url where the page is"
        )
        raise CommandError(message, NOT_SO) from None


def _link(
    data: Path, session: str, name: str | None, people: int, hours: float, url: str | None
) -> dict[str, Any]:
    from protocol.identity import Identity, Role
    from services.cli.keys import expiry_s, issued, person
    from services.runtime.register import new_token_id

    if not 1 <= people <= 100_000:
        raise CommandError(f"--people {people}: give 1 to 100000")
    if name is not None:
        one = person(checked(name, "teacher"), session, hours)
    else:
        one = Identity(
            role=Role.INVITATION, session=session, expires_s=expiry_s(hours), token_id=new_token_id(),
            people=people,
        )  # fmt: skip
    address = url or _address(data)  # before the token is handed out: nothing is, where there is no page
    token = issued(data, one)
    return {
        "url": f"{address.rstrip('/')}/#t={token}",
        "id": one.token_id,
        "session": session,
        "name": name,
        "people": one.people or 1,
        "expires_s": one.expires_s,
    }


def _print_link(made: dict[str, Any], data: Path, *, qr: bool) -> None:
    if qr:
        print(_qr_code(made["url"]))
    until = time.strftime("%Y-%m-%d %H:%M", time.localtime(made["expires_s"]))
    whom = f"{made['name']} alone" if made["name"] else f"up to {made['people']} people"
    print(made["url"])
    print(f"for {whom}, to teach {made['session']} until {until}; id {made['id']}")
    print(f"withdraw it: {suggested('invite --revoke ' + made['id'], data=data)}")


def _qr_code(text: str) -> str:
    """Return a QR code in half blocks; light on dark in so many words, whatever the terminal's colours."""
    import segno

    drawn = io.StringIO()
    segno.make(text, error="l", micro=False).terminal(drawn, compact=True, border=2)
    lines = drawn.getvalue().splitlines()
    return (
        "\n".join(f"\033[97;40m{line}\033[0m" for line in lines) if sys.stdout.isatty() else "\n".join(lines)
    )


def _revoke(data: Path, token_id: str, *, as_json: bool) -> None:
    from protocol.identity import is_token_id
    from services.cli.keys import revoke_key

    if not is_token_id(token_id):
        raise CommandError(
            f"--revoke {token_id[:40]!r} is no id: give the 16 digits that `sfid invite` printed"
        )
    revoke_key(data, token_id)
    if as_json:
        print_json({"revoked": token_id})
    else:
        print(f"withdrawn: {token_id}, and whatever was given for it")


def _show_status(data: Path, *, as_json: bool) -> None:
    from services.gateway.config import GatewayError
    from services.gateway.service import read_status

    try:
        found = read_status(data)
    except GatewayError as error:
        raise CommandError(str(error), NOT_SO) from None
    found["age_s"] = max(0, int(time.time()) - found["at_s"])
    if as_json:
        print_json(found)
        return
    print(f"{found['url']}, as of {found['age_s']} s ago")
    print(
        f"{found['people']} people in {found['rooms']} sessions, {found['answers_open']} answers on their way"
    )
    for title in ("done", "refused"):
        rows = [f"{name} {count}" for name, count in sorted(found[title].items())]
        print(f"{title}: {', '.join(rows) or 'nothing'}")
