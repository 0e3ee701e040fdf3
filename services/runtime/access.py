"""Who a process is for the router: one directory a deployment with a login, and a certificate, for each role.

    <folder>/users            what the router compares with: every role's `role:password`
    <folder>/<role>.login     what a process of that role brings; copy it, alone, to another machine
    <folder>/ca.pem           who signs certificates, where the endpoint is tls/...
    <folder>/<role>.pem, .key the role's certificate (its common name is the role) and its key

Secrets stand in files that their owner alone can read, never on a command line, in the environment or in a
log.
"""

import json
import os
import secrets
import stat
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from services.runtime.bus import BusError
from services.runtime.endpoint import is_loopback, split_endpoint
from services.runtime.machine_config import INSECURE, network_is_trusted, state_folder
from services.runtime.secret import SecretError, written_anew, written_once

FOLDER = "access"
"""Below the data directory."""
USERS = "users"
_PASSWORD_BYTES = 32
_LOGIN_MAX = 256


@dataclass(frozen=True, slots=True)
class Certificates:
    """Files of TLS: who signs, and what this role shows."""

    authority: Path
    certificate: Path
    key: Path


@dataclass(frozen=True, slots=True)
class Access:
    """What a client of the router brings: a login, and where the endpoint is tls/..., certificates."""

    user: str
    password: str = field(repr=False)
    certificates: Certificates | None = None


@dataclass(frozen=True, slots=True)
class Guard:
    """What a router lets in: the users of a file, by rules; certificates where it speaks TLS."""

    users: Path
    rules: dict[str, object] = field(repr=False)
    certificates: Certificates | None = None
    login: Access | None = None
    """What it brings to the routers that it connects to."""


class CleartextError(BusError):
    """What passes could be read and changed on its way."""


class CertificateError(SecretError):
    """A file of TLS is missing, or others can read it: nobody starting side by side will mend that."""


def access_for(endpoint: str, role: str, folder: Path | None) -> Access | None:
    """Return what `role` brings to the router at `endpoint`; None where nothing is known of a login.

    Args: folder: of the logins; None: where a router of this person on this machine has told.
    Raises: BusError when the endpoint is malformed; CleartextError when it is on another machine and not
    tls/..., unless the environment says SFID_INSECURE_NETWORK=1; SecretError.
    """
    protocol, _, _ = split_endpoint(endpoint)
    if protocol != "tls" and not is_loopback(endpoint) and not network_is_trusted():
        message = (
            f"{endpoint} is on another machine and nothing on the way is encrypted: connect to tls/HOST:PORT "
            f"(SECURITY.md), or, trusting everybody on the way, set {INSECURE}=1"
        )
        raise CleartextError(message)
    folder = folder or noted_folder(endpoint)
    if folder is None and protocol == "tls":
        raise SecretError(f"{endpoint}: TLS takes certificates: name their directory with --access")
    return None if folder is None else read_access(folder, role, tls=protocol == "tls")


def make_access(folder: Path, roles: Iterable[str]) -> Path:
    """Make a login for each role that has none, and return the router's file of all of them.

    Raises: SecretError when the folder cannot be written, or others can read it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        logins = []
        for role in roles:
            path = folder / f"{role}.login"
            written_once(path, f"{role}:{secrets.token_hex(_PASSWORD_BYTES)}\n".encode())
            logins.append(":".join(_login(path)))
        users = folder / USERS
        written_anew(users, "".join(f"{login}\n" for login in logins).encode())
    except OSError as error:
        message = f"{folder}: {error.strerror or error}: name an --access directory that can be written"
        raise SecretError(message) from None
    return users


def read_access(folder: Path, role: str, *, tls: bool = False) -> Access:
    """Return what a role brings from a folder. Raises: SecretError, whose text never holds the password."""
    shown = certificates(folder, role) if tls else None  # first: a login may still come, these do not
    path = folder / f"{role}.login"
    try:
        user, password = _login(path)
    except OSError as error:
        message = f"{path}: {error.strerror or error}: `sfid router --access {folder}` makes it; copy it here"
        raise SecretError(message) from None
    return Access(user, password, shown)


def certificates(folder: Path, role: str) -> Certificates:
    """Return the files of TLS of a role. Raises: CertificateError naming one that is missing or readable."""
    found = Certificates(folder / "ca.pem", folder / f"{role}.pem", folder / f"{role}.key")
    for path in (found.authority, found.certificate, found.key):
        if not path.is_file():
            message = f"{path}: there is no such file: TLS takes it, SECURITY.md says how it is made"
            raise CertificateError(message)
    try:
        _refuse_readable(found.key)
    except SecretError as error:
        raise CertificateError(str(error)) from None
    return found


def note_router(endpoint: str, folder: Path | None) -> None:
    """Leave word for this person's programs where the logins of the router at `endpoint` are; None: no more.

    Raises: OSError when the home directory cannot be written: then they are told by --access.
    """
    path = _note(endpoint)
    if folder is None:
        path.unlink(missing_ok=True)
        return
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    part.write_text(json.dumps({"access": str(folder.resolve()), "pid": os.getpid()}), encoding="utf-8")
    part.replace(path)


def noted_folder(endpoint: str) -> Path | None:
    """Return where a router at `endpoint` that runs on this machine keeps its logins, if it has left word."""
    try:
        note = json.loads(_note(endpoint).read_text(encoding="utf-8"))
        alive = Path(f"/proc/{int(note['pid'])}").exists() or not Path("/proc/self").exists()
        return Path(note["access"]) if alive else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _note(endpoint: str) -> Path:
    name = "".join(letter if letter.isalnum() or letter in ".-" else "_" for letter in endpoint)
    return state_folder() / "routers" / f"{name}.json"


def _login(path: Path) -> tuple[str, str]:
    _refuse_readable(path)
    user, colon, password = path.read_text("utf-8", errors="replace")[:_LOGIN_MAX].strip().partition(":")
    if not (user and colon and password):
        raise SecretError(f"{path}: no login in it: delete it, and start the router for a new one")
    return user, password


def _refuse_readable(path: Path) -> None:
    if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise SecretError(f"{path}: others can read it: `chmod 600 {path}`, or delete it for a new one")
