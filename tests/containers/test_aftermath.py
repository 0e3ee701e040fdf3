"""What a failed phase tells of its containers, asked of an engine that answers from a table."""

import json
import stat
from pathlib import Path

import pytest

from tests.containers.aftermath import LINES, aftermath, told_when_failing, verdict
from tests.containers.engine import Engine, Stack

FAKE = """#!/usr/bin/env python3
import json, pathlib, sys
words = " ".join(sys.argv[1:])
for part, (out, err, code) in json.loads(pathlib.Path(__file__).with_suffix(".json").read_text()).items():
    if part in words:
        sys.stdout.write(out)
        sys.stderr.write(err)
        sys.exit(code)
sys.exit("not asked for: " + words)
"""


def inspected(*, running: bool = True, **addresses: str) -> tuple[str, str, int]:
    networks = {name: {"IPAddress": address} for name, address in addresses.items()}
    return json.dumps([{"State": {"Running": running}, "NetworkSettings": {"Networks": networks}}]), "", 0


def engine(folder: Path, answers: dict[str, tuple[str, str, int]]) -> Stack:
    """A stack whose engine answers the first entry that is in its command."""
    tool = folder / "engine"
    tool.write_text(FAKE)
    tool.chmod(tool.stat().st_mode | stat.S_IXUSR)
    tool.with_suffix(".json").write_text(json.dumps(answers))
    return Stack(Engine(str(tool), ()), "p", {})


ASKED = "nameserver 10.0.0.1 options timeout:1\n"
ANSWERS = {
    "ps --all --filter name=p ": ("p_router_1 p-bus-lesson p_gateway_1 p_demo_1\n", "", 0),
    "inspect p_router_1": inspected(bus="10.0.0.9"),
    "inspect p-bus-lesson": inspected(bus="10.0.0.3"),
    "inspect p_gateway_1": inspected(bus="10.0.0.4", pages="10.0.1.4"),
    "inspect p_demo_1": inspected(running=False, bus=""),
    "exec p_router_1 python": (f"{ASKED}10.0.0.9\n", "", 0),
    "exec p-bus-lesson python": (f"{ASKED}10.0.0.2\n", "", 0),
    "exec p_gateway_1 python": (ASKED, "Traceback\nsocket.gaierror: [Errno -2] not known\n", 1),
    f"logs --tail {LINES} p-bus-lesson": ("answered 1\n", "waiting for the router\n", 0),
    f"logs --tail {LINES}": ("", "ready\n", 0),
}


def test_the_aftermath_tells_state_addresses_lookups_and_the_end_of_every_log(tmp_path: Path) -> None:
    told = aftermath(engine(tmp_path, ANSWERS))
    head, *parts = told.split("---- ")
    assert head.strip() == "containers of p; the router is at 10.0.0.9"
    router, teacher, gateway, demo = (part.strip().splitlines() for part in parts)
    assert router == [
        "p_router_1: finds the router at 10.0.0.9: a link that is missing now is not the engine's fault",
        ASKED.strip(),
        "addresses bus 10.0.0.9",
        'state {"Running": true}',
        "ready",
    ]
    assert teacher[0] == "p-bus-lesson: the engine's names are stale here: the router is not at 10.0.0.2"
    assert teacher[-2:] == ["answered 1", "waiting for the router"]
    assert gateway[0] == "p_gateway_1: the engine's names fail here: socket.gaierror: [Errno -2] not known"
    assert "addresses bus 10.0.0.4, pages 10.0.1.4" in gateway
    assert demo == ["p_demo_1: does not run", "addresses none", 'state {"Running": false}', "ready"]


def test_an_engine_that_answers_nothing_is_told_and_raises_nothing(tmp_path: Path) -> None:
    assert "no container of p is known: " in aftermath(engine(tmp_path, {}))
    alone = aftermath(engine(tmp_path, {"ps --all": ("p_learner_1\n", "", 0)}))
    assert alone.startswith(
        "\ncontainers of p; the router is at no address\n---- p_learner_1: does not run\n"
    )


def test_it_is_told_when_something_fails_within_and_not_otherwise(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stack = engine(tmp_path, ANSWERS)
    with told_when_failing(stack):
        pass
    assert capsys.readouterr().out == ""
    with pytest.raises(pytest.fail.Exception, match="nothing acknowledged"), told_when_failing(stack):
        pytest.fail("nothing acknowledged")
    assert "---- p-bus-lesson: " in capsys.readouterr().out


def test_a_name_with_several_addresses_is_found_when_one_of_them_is_the_routers() -> None:
    assert verdict("10.0.0.1 10.0.0.2", "10.0.0.2 10.0.1.2").startswith("finds the router at ")
    assert verdict("10.0.0.1", "") == "the engine's names are stale here: the router is not at 10.0.0.1"
    assert verdict("", "10.0.0.1") == "the engine's names fail here: no answer"
