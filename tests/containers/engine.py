"""A container engine with compose, podman or docker: what the test of the whole stack asks of it."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[2]
BASE = "docker.io/library/python:3.11-slim"
COMMAND_MAX_S = 60.0
BUILD_MAX_S = 540.0
STOP_S = "15"


class EngineError(Exception):
    """A command of the engine failed; the text is the command and what it said."""


def run(
    command: Sequence[str],
    wait_s: float = COMMAND_MAX_S,
    env: Mapping[str, str] | None = None,
    *,
    both: bool = False,
) -> str:
    """Return what a command prints. Raises: EngineError when it fails or takes longer than `wait_s`.

    Args: both: with what it prints to stderr, where engines print the logs of a container's stderr.
    """
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=wait_s, cwd=ROOT, env=env
        )
    except subprocess.TimeoutExpired as error:
        raise EngineError(f"{' '.join(command)}: nothing within {wait_s:g} s") from error
    if done.returncode:
        raise EngineError(f"{' '.join(command)}: exit {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout + done.stderr if both else done.stdout


def succeeds(*command: str) -> bool:
    """Tell whether a command ends with exit code 0."""
    try:
        run(command)
    except (EngineError, FileNotFoundError):
        return False
    return True


def pip_settings(folder: Path) -> Path | None:
    """Return a pip.conf that names the index of this machine, None where it is the usual one."""
    for name in ("global.index-url", ":env:.index-url", "install.index-url"):
        asked = [sys.executable, "-m", "pip", "config", "get", name]
        found = subprocess.run(asked, capture_output=True, text=True, check=False).stdout.strip()
        if found:
            path = folder / "pip.conf"
            path.write_text(f"[global]\nindex-url = {found}\n", encoding="utf-8")
            return path
    return None


@dataclass(frozen=True, slots=True)
class Engine:
    """How to call it: `tool` alone, `compose` with compose.yaml."""

    tool: str
    compose: tuple[str, ...]

    def build(self, target: str, image: str, pip: Path | None = None) -> None:
        """Build a target of the Dockerfile; `pip`: a pip.conf that is shown to pip and kept nowhere."""
        shown = [] if pip is None else ["--secret", f"id=pip,src={pip}"]
        run(
            [self.tool, "build", "--network=host", *shown, "--target", target, "--tag", image, "."],
            BUILD_MAX_S,
        )

    def megabytes(self, image: str) -> float:
        """Return the size of an image in MB."""
        return int(run([self.tool, "image", "inspect", image, "--format", "{{.Size}}"])) / 1e6


def found_engine() -> Engine | str:
    """Return the engine of this machine, or in one line why there is none that could run the stack."""
    lacks = "no podman or docker here: `tests/containers/prepare` installs one on Debian"
    for tool, composes in (
        ("podman", (("podman-compose",), ("podman", "compose"))),
        ("docker", (("docker", "compose"),)),
    ):
        if shutil.which(tool) is None or not succeeds(tool, "info"):
            continue
        compose = next((one for one in composes if succeeds(*one, "version")), None)
        if compose is None:
            lacks = f"{tool} has no compose here"
        elif not succeeds(tool, "image", "inspect", BASE):
            lacks = f"{tool} has no image {BASE}: `tests/containers/prepare` gets it"
        else:
            return Engine(tool, compose)
    return lacks


@dataclass(slots=True)
class Stack:
    """One run of compose.yaml, under a project name of its own."""

    engine: Engine
    project: str
    variables: Mapping[str, str]
    ids: dict[str, str] = field(default_factory=dict)
    """Containers by service, as they are found."""

    def compose(self, *words: str, wait_s: float = COMMAND_MAX_S) -> str:
        """Run a compose command. Raises: EngineError."""
        command = [*self.engine.compose, "-p", self.project, *words]
        return run(command, wait_s, {**os.environ, **self.variables})

    def tool(self, *words: str, wait_s: float = COMMAND_MAX_S, both: bool = False) -> str:
        """Run a command of the engine. Raises: EngineError. Args: as those of `run`."""
        return run([self.engine.tool, *words], wait_s, both=both)

    def id_of(self, service: str) -> str:
        """Return the container of a service; both tools label it with the names of project and service."""
        if service not in self.ids:
            label = "label=com.docker.compose"
            wanted = [f"{label}.project={self.project}", f"{label}.service={service}"]
            filters = [word for one in wanted for word in ("--filter", one)]
            self.ids[service] = self.tool("ps", "--all", "--quiet", *filters).split()[0]
        return self.ids[service]

    def inspect(self, service: str) -> dict[str, Any]:
        """Return all that the engine knows of a service's container."""
        found: list[dict[str, Any]] = json.loads(self.tool("inspect", self.id_of(service)))
        return found[0]

    def exec(self, service: str, *words: str) -> str:
        """Run a command in a service's container."""
        return self.tool("exec", self.id_of(service), *words)

    def is_healthy(self, service: str) -> bool:
        """Run the health check of compose.yaml now, as a timer of the engine would."""
        if self.engine.tool == "podman":
            return succeeds("podman", "healthcheck", "run", self.id_of(service))
        return succeeds(
            "docker", "exec", self.id_of(service), *self.inspect(service)["Config"]["Healthcheck"]["Test"][1:]
        )

    @property
    def bus(self) -> str:
        """The internal network."""
        return f"{self.project}_bus"

    def operator(self, *words: str) -> str:
        """Run a command of the operator's, as `compose run --rm operator` does; return what it prints."""
        return self.tool("run", "--rm", *self._as("operator"), self.variables["SFID_IMAGE"], *words)

    def teacher(self, service: str, script: Path, *arguments: str) -> list[str]:
        """Return the command of a container as a service's, which runs a Python script instead."""
        return [
            *(self.engine.tool, "run", "--rm", "--name", f"{self.project}-{arguments[1]}"),
            *(*self._as(service), "--volume", f"{script}:/script.py:ro", "--entrypoint", "python"),
            *(self.variables["SFID_IMAGE"], "/script.py", *arguments),
        ]

    def _as(self, service: str) -> list[str]:
        """Return the options of a container that is like a service of compose.yaml."""
        like = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))["services"][service]
        options = [("--network", self.bus), ("--user", like["user"]), ("--read-only",), ("--tmpfs", "/tmp")]  # noqa: S108
        options += [("--volume", f"{self.project}_{volume}") for volume in like["volumes"]]
        options += [("--env", f"{name}={value}") for name, value in like["environment"].items()]
        options += [("--sysctl", value) for value in like["sysctls"]]
        options += [("--cap-drop", value) for value in like["cap_drop"]]
        options += [("--security-opt", value) for value in like["security_opt"]]
        return [word for option in options for word in option]

    def down(self) -> None:
        """Take away every container, network and volume of the project, whatever state it is in."""
        label = f"label=com.docker.compose.project={self.project}"
        ours = self.tool("ps", "--all", "--quiet", "--filter", label).split()
        ours += self.tool("ps", "--all", "--quiet", "--filter", f"name={self.project}").split()
        if ours:
            self.tool("rm", "--force", *dict.fromkeys(ours))
        if self.engine.tool == "podman":
            succeeds("podman", "pod", "rm", "--force", f"pod_{self.project}")
        for kind in ("network", "volume"):
            named = self.tool(
                kind, "ls", "--filter", f"name={self.project}_", "--format", "{{.Name}}"
            ).split()
            if named:
                self.tool(kind, "rm", *named)


# ---------------------------------------------------------------- faults: each returns its mend


def stop(stack: Stack, service: str) -> Callable[[], None]:
    """Stop a container as an operator does; the mend starts it."""
    stack.tool("stop", "--time", STOP_S, stack.id_of(service))
    return lambda: void(stack.tool("start", stack.id_of(service)))


def kill(stack: Stack, service: str) -> Callable[[], None]:
    """Let the process die by SIGKILL. Compose restarts it by itself, so that nothing is left to mend."""
    pid = int(stack.inspect(service)["State"]["Pid"])
    try:
        os.kill(pid, signal.SIGKILL)
    except (PermissionError, ProcessLookupError):  # an engine in another machine, or under another account
        stack.tool("kill", "--signal", "KILL", stack.id_of(service))
        return lambda: void(stack.tool("start", stack.id_of(service)))
    return lambda: None


def pause(stack: Stack, service: str) -> Callable[[], None]:
    """Freeze a container; the mend thaws it."""
    stack.tool("pause", stack.id_of(service))
    return lambda: void(stack.tool("unpause", stack.id_of(service)))


def disconnect(stack: Stack, service: str) -> Callable[[], None]:
    """Take a container off the network of the services; the mend brings it back, with another address."""
    stack.tool("network", "disconnect", stack.bus, stack.id_of(service))
    return lambda: void(stack.tool("network", "connect", "--alias", service, stack.bus, stack.id_of(service)))


def void(_: str) -> None:
    """Take what was printed, and say nothing."""
