"""`sfid keys new|list|revoke`: who may teach a deployment that requires tokens."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shlex import quote
from typing import Annotated, Any

import typer

from protocol.identity import Identity, Role, check_key, is_revoked, is_token_id, sign
from protocol.keys import checked
from services.cli.shared.failure import NOT_SO, CommandError
from services.cli.shared.next_command import suggested
from services.cli.shared.options import DATA, Data, Json, print_json
from services.cli.shared.whereabouts import ToldConnect, ToldDeployment, whereabouts
from services.operations.withdrawal import revoke_person
from services.runtime.register import Issued, Register, new_token_id
from services.runtime.secret import FOLDER, load_secrets
from services.teachers.token_file import KEY_MARK
from services.topology import teaching_role

HOUR_S = 3600
HOURS_MAX = 24 * 366
keys_app = typer.Typer(
    help="Hand out, list and withdraw the tokens of teachers.", no_args_is_help=True, rich_markup_mode=None
)
_FOLDER = Path("FOLDER")
"""What stands for the directory of a teacher's login where nobody has said it."""
Hours = Annotated[float, typer.Option(help="How long it is good for, in hours, at most a year.")]


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    app.add_typer(keys_app, name="keys")


@keys_app.command()
def new(  # noqa: PLR0917 - one argument a flag
    name: Annotated[str, typer.Argument(help="Pseudonym of the teacher: a-z, 0-9, - and _.")],
    session: Annotated[str, typer.Option(help="Session that they may teach.")],
    hours: Hours = 24.0,
    out: Annotated[
        Path | None,
        typer.Option(help="File for the token, which must not be there yet; default: NAME.token."),
    ] = None,
    data: Data = DATA,
    connect: ToldConnect = None,
    deployment: ToldDeployment = None,
    access: Annotated[
        Path | None,
        typer.Option(help="Directory of the teacher's login on their machine, for the printed command."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Make a token for one teacher, in a file that its owner alone can read."""
    identity = person(checked(name, "teacher"), checked(session, "session"), hours)
    path = out or Path(f"{name}.token")
    where = whereabouts(data, connect, deployment)
    words = f"teach keyboard --session {session} --name {name} --token-file {quote(str(path))}"
    teach = suggested(words, where.connect, where.deployment, access or (None if where.is_here else _FOLDER))
    secrets = load_secrets(data / FOLDER)
    key = check_key(session, name, tuple(secrets))
    with _private(path, f"{sign(identity, secrets)}\n{KEY_MARK} {key.hex()}\n"):
        note_issued(data, identity)  # once the file is whole: an id whose token is nowhere could be nobody's
    if as_json:
        print_json({
            "id": identity.token_id, "name": name, "session": session, "expires_s": identity.expires_s,
            "file": str(path), "teach": teach.strip("`"),
        })  # fmt: skip
        return
    print(f"{path}: {name} may teach {session} until {_moment(identity.expires_s)}; id {identity.token_id}")
    if where.is_here:
        print(f"they teach on this machine with {teach}, elsewhere also with their --connect and --access")
    else:
        role = teaching_role(where.deployment).value
        kept = f"; {_FOLDER} is where they keep {role}.login and, for tls/, ca.pem, {role}.pem, {role}.key"
        print(f"they teach with {teach}{'' if access else kept}")
    print(f"withdraw it: {suggested(f'keys revoke {identity.token_id}', data=data)}")


@keys_app.command("list")
def list_keys(data: Data = DATA, as_json: Json = False) -> None:
    """List what was handed out: for whom, for which session, until when, and whether it is still good."""
    register = Register(data / FOLDER)
    rows = [_row(one, register, data) for one in register.issued.values()]
    if as_json:
        print_json({"keys": rows})
        return
    if not rows:
        print("nothing was handed out yet: `sfid keys new NAME --session SESSION` makes a token")
        return
    for row in rows:
        until = _moment(row["expires_s"])
        print(f"{row['id']}: {row['for']} may teach {row['session']} until {until}, {row['state']}")


@keys_app.command()
def revoke(
    what: Annotated[
        str, typer.Argument(help="Id of a token or of an invitation, or a teacher's name: all of theirs.")
    ],
    data: Data = DATA,
    as_json: Json = False,
) -> None:
    """Withdraw a token: its bearer's next answer is refused, and no service is restarted."""
    revoke_key(data, what)
    if as_json:
        print_json({"revoked": what})
    else:
        print(f"withdrawn: {what}, and whatever was given for it")


def person(name: str, session: str, hours: float) -> Identity:
    """Return the identity of a token for one teacher."""
    return Identity(
        role=Role.TEACHER, session=session, pseudonym=name, expires_s=expiry_s(hours),
        token_id=new_token_id(),
    )  # fmt: skip


def expiry_s(hours: float) -> int:
    """Return when something made now ends, in seconds since 1970."""
    if not 0 < hours <= HOURS_MAX:
        raise CommandError(f"--hours {hours:g}: give more than 0 and at most a year")
    return int(time.time() + hours * HOUR_S)


def issued(data: Path, identity: Identity) -> str:
    """Return the token of an identity, noted as handed out."""
    token = sign(identity, load_secrets(data / FOLDER))
    note_issued(data, identity)
    return token


def note_issued(data: Path, identity: Identity) -> None:
    """Note that the token of an identity is handed out."""
    try:
        Register(data / FOLDER).issue(identity)
    except OSError as error:
        raise _not_writable(data, error) from None


def revoke_key(data: Path, what: str) -> None:
    """Make a token, an invitation, or all tokens of a name worthless."""
    try:
        if is_token_id(what):
            Register(data / FOLDER).revoke(what)
        elif not revoke_person(data, checked(what, "teacher")):
            raise CommandError(
                f"{data}: nobody was ever given a token there: name the --data directory", NOT_SO
            )
    except OSError as error:
        raise _not_writable(data, error) from None


def _not_writable(data: Path, error: OSError) -> CommandError:
    return CommandError(f"{data}: {error.strerror or error}: name the deployment's --data directory")


def _row(one: Issued, register: Register, data: Path) -> dict[str, Any]:
    identity = Identity(
        role=Role.TEACHER if one.pseudonym else Role.INVITATION, session=one.session,
        pseudonym=one.pseudonym, expires_s=one.expires_s, token_id=one.token_id, people=one.people,
    )  # fmt: skip
    revoked = is_revoked(identity, load_secrets(data / FOLDER), register.revoked)
    state = "revoked" if revoked else "expired" if one.expires_s <= time.time() else "valid"
    whom = one.pseudonym or f"{register.people(one.token_id)} of {one.people} people"
    return {
        "id": one.token_id, "for": whom, "session": one.session, "expires_s": one.expires_s, "state": state,
    }  # fmt: skip


def _moment(seconds: int) -> str:
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(seconds))


@contextmanager
def _private(path: Path, content: str) -> Iterator[None]:
    """Write a new file that its owner alone can read, durably; it is gone again where what follows fails."""
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except OSError as error:
        raise _not_there(path, error) from None
    try:
        try:
            with os.fdopen(handle, "w", encoding="ascii") as file:
                file.write(content)
                file.flush()
                os.fsync(handle)
        except OSError as error:
            raise _not_there(path, error) from None
        yield
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def _not_there(path: Path, error: OSError) -> CommandError:
    return CommandError(f"{path}: {error.strerror or error}: name another file with --out")
