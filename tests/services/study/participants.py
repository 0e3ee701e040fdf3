"""A running study, and participants who walk through it over the real gateway's websocket."""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from websockets.sync.client import connect
from websockets.typing import Origin

from services.teachers.scripted import optimal_names
from sfid_core.study.effort import SCALES
from tests.services.gateway.gateway_house import Browser

START_S = 60.0
AGAIN_S = 0.4
WAIT_S = 20.0
SETTLED = frozenset({"saved", "too_late", "rejected"})
STUDY = """
name = "{name}"
title = "Teach an agent"
design = "{design}"
seed = {seed}
recruiter = "{recruiter}"
completion_code = "{code}"
[consent]
version = "1"
text = "First.\\n\\nSecond."
[[conditions]]
name = "labels"
method = "sfid"
[[conditions]]
name = "rewards"
method = "reward"
[practice]
level = "classroom:0"
starts = "1"
episodes = 1
[teaching]
level = "classroom:0"
starts = "1"
episodes = {episodes}
{extra}
"""


def study_file(folder: Path, **changes: Any) -> Path:  # noqa: ANN401 - any key of the text
    """Write a small study and return its file."""
    fields: dict[str, Any] = {
        "name": "maze", "design": "between", "recruiter": "none", "code": "", "episodes": 3, "seed": 1,
        "extra": "",
    }  # fmt: skip
    path = folder / "maze.toml"
    path.write_text(STUDY.format(**(fields | changes)))
    return path


@dataclass
class Running:
    """A study that runs in processes of its own."""

    file: Path
    data: Path
    link: str
    stack: ExitStack

    def participant(self, number: int, **arrival: str) -> "Participant":
        """Return somebody with a browser of their own, who has opened the link."""
        return Participant(self, f"{number:032x}", arrival)


@contextmanager
def running(file: Path, data: Path, listen: str = "127.0.0.1:0") -> Iterator[Running]:
    """Yield the study as `sfid study run` starts it."""
    command = [sys.executable, "-P", "-m", "services.cli.main", "study", "run", str(file)]
    command += ["--data", str(data), "--listen", listen]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("participants of")
            with ExitStack() as stack:
                yield Running(file, data, process.stdout.readline().strip(), stack)
        finally:
            process.terminate()
            process.wait(START_S)


@dataclass
class Participant:
    """One person: what they see, and what they do about it."""

    study: Running
    nonce: str
    arrival: dict[str, str]
    token: str = ""
    pseudonym: str = ""
    screen: dict[str, Any] = field(default_factory=dict)
    browser: Browser | None = None
    answers: int = 0
    refusal: str = ""
    said: str = ""
    unsettled: str = ""
    """Id of the last answer until the page told what became of it."""
    before: tuple[int, str] = (-1, "")
    seen: list[str] = field(default_factory=list)
    asked: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.open()

    def open(self) -> str:
        """Open the page, for the first time or again, and return the screen's name."""
        self.unsettled = ""
        parts = urlsplit(self.study.link)
        arrival = self.arrival or dict(parse_qsl(parts.query))
        opened = connect(
            f"ws://{parts.netloc}/socket",
            origin=Origin(f"http://{parts.netloc}"),
            compression=None,
            proxy=None,
        )
        socket = self.study.stack.enter_context(opened)
        self.browser = Browser(socket).hello(self.token or parts.fragment[2:], self.nonce, **arrival)
        you = self.browser.next("you")
        self.token, self.pseudonym = you["token"], you["pseudonym"]
        self.next_of("screen", "refused")
        return str(self.screen.get("name", ""))

    def close(self) -> None:
        """Close the page."""
        assert self.browser is not None
        self.browser.socket.close()

    def next_of(self, *kinds: str) -> None:
        """Wait for a frame of one of these kinds: a screen is looked at, a refusal kept."""
        assert self.browser is not None
        while True:
            frame = json.loads(self.browser.socket.recv(timeout=WAIT_S))
            if frame["type"] in kinds:
                break
        if frame["type"] == "screen":
            self.screen = frame["screen"]
            self.seen.append(self.screen["name"])
        else:
            self.refusal = frame["text"]

    def look(self) -> str:
        """Wait for the next screen and return its name."""
        self.next_of("screen")
        return str(self.screen["name"])

    def press(self, button: str, /, **values: Any) -> str:  # noqa: ANN401 - any value of a field
        """Press a button of the screen and return the name of the next."""
        self.send(button, **values)
        return self.look()

    def send(self, button: str, /, screen: str | None = None, **values: Any) -> None:  # noqa: ANN401
        assert self.browser is not None
        self.browser.send("submit", screen=screen or self.screen["name"], button=button, values=values)

    def refused(self) -> str:
        """Return what was refused last, or is next."""
        if not self.refusal:
            self.next_of("refused")
        said, self.refusal = self.refusal, ""
        return said

    def agree(self) -> str:
        return self.press("agree", agreed=True)

    def rate(self, *ratings: int) -> str:
        return self.press(
            "send", **{scale.name: rating for scale, rating in zip(SCALES, ratings, strict=True)}
        )

    def teach(self, answers_max: int = 10_000) -> str:
        """Teach until the screen changes, or so many answers were saved; return the name of the screen."""
        assert self.browser is not None
        wanted = self.answers + answers_max
        while self.answers < wanted or self.unsettled:
            try:
                frame = dict(json.loads(self.browser.socket.recv(timeout=AGAIN_S)))
            except TimeoutError:  # the gateway takes 20 frames a second; the page sends again too
                self.browser.socket.send(self.said)
                continue
            if frame["type"] == "screen":
                self.screen = frame["screen"]
                self.seen.append(self.screen["name"])
                break
            if frame["type"] == "answer" and frame["id"] == self.unsettled and frame["state"] in SETTLED:
                self.unsettled = ""
            if frame["type"] == "decision":
                if frame["phase"] == "executing":
                    self.before = (frame["decision"], frame["view"])
                if frame["phase"] == "asking" and self.answers < wanted:
                    self._answer(frame)
                    self.before = (frame["decision"] + 1, frame["view"])
        return str(self.screen["name"])

    def _answer(self, decision: dict[str, Any]) -> None:
        """Say what an expert would; nothing about a move whose beginning was not seen."""
        assert self.browser is not None
        self.answers += 1
        self.asked.add(decision["asked"])
        said: dict[str, Any] = {
            "type": "answer",
            "id": f"{int(self.nonce, 16) * 100_000 + self.answers:032x}",
        }
        said |= {
            name: decision[name] for name in ("session", "epoch", "decision", "episode", "step", "state")
        }
        if decision["asked"] == "label":
            said |= {"kind": "label", "action": OPTIMAL(decision["view"])[0]}
        elif self.before[0] == decision["decision"]:
            reward = 1.0 if decision["action"] in OPTIMAL(self.before[1]) else -1.0
            said |= {"kind": "reward", "action": decision["action"], "reward": reward}
        else:
            said |= {"kind": "abstain"}
        self.unsettled = said["id"]
        self.said = json.dumps(said)
        self.browser.socket.send(self.said)


OPTIMAL = optimal_names()
