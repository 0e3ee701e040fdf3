"""What the monitor needs to know; free of rerun, so that a command line can read it at once."""

import shlex
import shutil
import socket
import sys
from dataclasses import dataclass
from pathlib import Path

LOOPBACK = "127.0.0.1"
EVERYWHERE = "0.0.0.0"  # noqa: S104 - only by `insecure_bind`, said in so many words
RERUN_OWN_PORT = 9876
"""A viewer on this machine takes this port for itself, and would write what it reads back into our server."""

TEACH = "`sfid teach keyboard --session {session}`"
"""How a session at the usual place is taught."""


class MonitorError(Exception):
    """The monitor cannot start; the message is one line: what is wrong, where, and the mend."""


@dataclass(frozen=True, slots=True)
class MonitorConfig:
    """What the monitor service needs to know."""

    deployment: str = "local"
    """Deployment whose sessions are watched."""

    session: str | None = None
    """The one session to watch; None watches all of the deployment."""

    recording_dir: Path | None = None
    """Folder for `<session>.rrd`, after a restart `<session>.2.rrd` and so on; None keeps no recording."""

    viewer: bool = True
    """Serve viewers on this machine; False opens no port and only writes the recordings."""

    scene_port: int = 19876
    """Port for the pictures, on loopback; 0 takes a free one."""

    curves_port: int = 19877
    """Port for the curves and the layout, on loopback; 0 takes a free one."""

    web_port: int | None = 19090
    """Port of the web page, on loopback; 0 takes a free one, None serves no page."""

    insecure_bind: bool = False
    """Serve on every address of this machine or container, although whoever reaches the streams can also
    write into them: for a container whose ports are published on the host's loopback."""

    teach: str = TEACH
    """How a session of this deployment is taught, with `{session}` where its name goes: it is told to viewers
    of a session that waits for its teachers."""

    sessions_max: int = 16
    """Sessions shown at a time; the one that has been quiet longest gives way, its recording well ended."""

    gives_way_s: float = 30.0
    """How long it must have been quiet: sessions that took turns would all be shown in shreds."""


@dataclass(frozen=True, slots=True)
class Addresses:
    """Where to watch."""

    scene_port: int
    curves_port: int
    web_port: int | None
    bind: str = LOOPBACK
    """Address that the servers listen on."""

    @property
    def scene_url(self) -> str:
        """The pictures, as viewers write it."""
        return f"rerun+http://{LOOPBACK}:{self.scene_port}/proxy"

    @property
    def curves_url(self) -> str:
        """The curves and the layout, as viewers write it."""
        return f"rerun+http://{LOOPBACK}:{self.curves_port}/proxy"

    @property
    def web_url(self) -> str | None:
        """The page to open in a browser on this machine."""
        if self.web_port is None:
            return None
        urls = "&".join(
            f"url=rerun%2Bhttp://{LOOPBACK}:{port}/proxy" for port in (self.curves_port, self.scene_port)
        )
        return f"http://{LOOPBACK}:{self.web_port}/?{urls}&hide_welcome_screen&theme=dark"

    @property
    def native_command(self) -> str:
        """The command that opens the native viewer on this machine."""
        return (
            f"{viewer_command(Path(sys.executable), Path.cwd())} --connect {self.curves_url} {self.scene_url}"
        )


def viewer_command(python: Path, here: Path) -> str:
    """Return this Python's viewer as a shell in `here` finds it: by name where PATH leads to that very one.

    Another one in PATH may be of another version, which does not read what we send.
    """
    beside = python.with_name("rerun")
    in_path = shutil.which("rerun")
    if not beside.is_file() or (in_path is not None and beside.samefile(in_path)):
        return "rerun"
    # A name without a slash would be looked for in PATH alone.
    near = beside.is_relative_to(here) and beside.parent != here
    return shlex.quote(str(beside.relative_to(here) if near else beside))


def chosen_ports(config: MonitorConfig) -> Addresses:
    """Return the ports to use, free ones in the place of 0. Raises MonitorError when one cannot be used."""
    taken: set[int] = set()
    scene = _port(config.scene_port, "scene_port", taken)
    curves = _port(config.curves_port, "curves_port", taken)
    web = None if config.web_port is None else _port(config.web_port, "web_port", taken)
    return Addresses(scene, curves, web, EVERYWHERE if config.insecure_bind else LOOPBACK)


def _port(port: int, field: str, taken: set[int]) -> int:
    if port == RERUN_OWN_PORT:
        message = (
            f"{field} = {port} is the port viewers take for themselves: choose another, for example 19876"
        )
        raise MonitorError(message)
    if port in taken:
        raise MonitorError(f"{field} = {port} is used twice: give each server a port of its own")
    port = port or free_port(taken)
    taken.add(port)
    with socket.socket() as probe:
        # As servers bind: a port whose last connections are still fading away is free.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, port))
        except (OSError, OverflowError):
            raise port_error(field, port) from None
    return port


def port_error(field: str, port: int) -> MonitorError:
    """Return the error for a port that cannot be served."""
    message = (
        f"cannot serve viewers at {LOOPBACK}:{port} ({field}): another program has the port, "
        f"stop that one or choose another port, 0 for any free one"
    )
    return MonitorError(message)


def free_port(taken: set[int]) -> int:
    """Return a port of loopback that nothing listens at now, none of `taken`."""
    while True:
        with socket.socket() as probe:
            probe.bind((LOOPBACK, 0))
            port: int = probe.getsockname()[1]
        if port not in taken and port != RERUN_OWN_PORT:
            return port
