"""The services of a deployment as processes to supervise."""

from dataclasses import dataclass, replace
from pathlib import Path

from services.cli.shared.options import CONNECT_TIMEOUT_MS
from services.cli.shared.waiting import connected_bus
from services.runtime.access import FOLDER
from services.runtime.config import AggregatorSection, GatewaySection
from services.runtime.endpoint import reached_at
from services.runtime.signals import Stop
from services.runtime.zenoh_bus import ZenohBus
from services.supervisor import Service, Supervisor, write_processes
from services.topology import CROWD, Role


@dataclass(frozen=True, slots=True)
class Deployed:
    """What the processes of one deployment have in common."""

    data: Path
    endpoint: str
    deployment: str
    require_tokens: bool = False
    access: Path | None = None
    """Directory of the logins; None: `access` in the data directory."""
    guarded: bool = True
    """Whether the router asks for logins, and lets each role do what it is for."""

    @property
    def logins(self) -> Path:
        """Directory of the logins."""
        return self.access or self.data / FOLDER

    @property
    def at_the_door(self) -> tuple[str, ...]:
        """Flags of those whom teachers come to."""
        return ("--require-tokens",) if self.require_tokens else ()

    @property
    def common(self) -> tuple[str, ...]:
        """Flags of every client of the router."""
        common = ("--connect", reached_at(self.endpoint), "--deployment", self.deployment)
        return (*common, "--access", str(self.logins)) if self.guarded else common

    @property
    def of_the_crowd(self) -> "Deployed":
        """The same for members of the crowd, who meet the aggregator instead of the learner."""
        return replace(self, deployment=f"{self.deployment}{CROWD}")


def make_directories(data: Path) -> Path:
    """Create the data directory and the one for logs in it; return the latter."""
    logs = data / "logs"
    data.mkdir(mode=0o700, parents=True, exist_ok=True)
    logs.mkdir(exist_ok=True)
    return logs


def supervise(data: Path, logs: Path | None, stop: Stop) -> Supervisor:
    """Return a supervisor that keeps `processes.json` there; after `stop` it waits for nothing."""
    return Supervisor(logs, lambda processes: write_processes(data / "processes.json", processes), stop)


def router(deployed: Deployed) -> Service:
    """Return the router."""
    arguments = ("router", "--listen", deployed.endpoint, "--deployment", deployed.deployment)
    guard = ("--access", str(deployed.logins)) if deployed.guarded else ("--open-to-all",)
    return Service("router", (*arguments, *guard))


def bus(deployed: Deployed, role: Role, timeout_ms: int = CONNECT_TIMEOUT_MS) -> ZenohBus:
    """Return this process's own bus, as one of that role."""
    return connected_bus(
        reached_at(deployed.endpoint), role, deployed.logins if deployed.guarded else None, timeout_ms
    )


def environment(deployed: Deployed) -> Service:
    """Return the environment."""
    return Service("environment", ("environment", *deployed.common))


def learner(deployed: Deployed) -> Service:
    """Return the learner, which owns the journal of the data directory."""
    arguments = ("learner", *deployed.common, "--data", str(deployed.data))
    return Service("learner", (*arguments, *deployed.at_the_door))


def learners(deployed: Deployed, shards: int) -> tuple[Service, ...]:
    """Return the learners that share the sessions of the data directory out, one for each shard."""
    if shards == 1:
        return (learner(deployed),)
    flags = learner(deployed).arguments
    return tuple(
        Service(f"learner-{shard}", (*flags, "--shards", str(shards), "--shard", str(shard)))
        for shard in range(shards)
    )


def monitor(deployed: Deployed, *, viewer: bool, ports: tuple[int, int, int], crowd: bool = False) -> Service:
    """Return the monitor.

    Args: ports: those of the scene, the curves and the web page, 0 for free ones; crowd: whether one teaches.
    """
    scene, curves, web = ports
    arguments = ("monitor", *deployed.common, "--recordings", str(deployed.data / "recordings"))
    arguments += ("--scene-port", str(scene), "--curves-port", str(curves), "--web-port", str(web))
    arguments += ("--viewer" if viewer else "--no-viewer", *(("--crowd",) if crowd else ()))
    return Service("monitor", arguments)


def aggregator(deployed: Deployed, section: AggregatorSection) -> Service:
    """Return the aggregator, which keeps its journal in the data directory."""
    arguments = ("aggregate", *deployed.common, "--data", str(deployed.data), "--name", section.name)
    for name in ("method", "quorum", "margin_ms", "patience_ms", "abstain_below", "gold_share"):
        arguments += (f"--{name.replace('_', '-')}", str(getattr(section, name)))
    return Service("aggregator", (*arguments, *deployed.at_the_door))


def gateway(deployed: Deployed, section: GatewaySection) -> Service:
    """Return the gateway, which serves the teaching page and keeps its files in the data directory."""
    common = deployed.of_the_crowd.common if section.crowd else deployed.common
    arguments = ("gateway", *common, "--data", str(deployed.data), "--listen", section.listen)
    for flag, value in (
        ("--url", section.url),
        ("--tls-cert", section.tls_cert),
        ("--tls-key", section.tls_key),
    ):
        arguments += () if value is None else (flag, value)
    return Service("gateway", (*arguments, "--insecure-bind") if section.insecure_bind else arguments)


def scripted_teacher(deployed: Deployed, session: str, name: str, flags: tuple[str, ...]) -> Service:
    """Return a simulated teacher of a session."""
    arguments = ("teach", "scripted", *deployed.common, "--session", session, "--name", name)
    return Service(f"teacher-{name}", (*arguments, *flags), lasting=False)
