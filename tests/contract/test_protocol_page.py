"""protocol/README.md is enough: a client that was written from it alone teaches a real learner."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest

from services.router import free_endpoint
from tests.contract.plain_client import Map, PlainTeacher
from tests.contract.router_process import router_process
from tests.services.cli.command_line import running, sfid

ROOT = Path(__file__).parents[2]
VECTORS = ROOT / "protocol" / "vectors"
ONE_PUSH = "#####\n#@$.#\n#####"


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A router, an environment and a learner, each a process of its own."""
    found, data = free_endpoint(), tmp_path_factory.mktemp("data")
    with (
        router_process(found),
        running("environment", "--connect", found),
        running("learner", "--connect", found, "--data", str(data)),
    ):
        yield found


@pytest.fixture
def ann(endpoint: str) -> Iterator[PlainTeacher]:
    teacher = PlainTeacher(endpoint, "page", "ann")
    yield teacher
    teacher.close()


def plain(value: Any) -> Any:  # noqa: ANN401 - any value of MessagePack
    """The value as its readable twin has it."""
    if isinstance(value, bytes):
        return {"hex": value.hex()}
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items()}
    return [plain(each) for each in value] if isinstance(value, list) else value


@pytest.mark.parametrize("vector", sorted(VECTORS.glob("*.bin")), ids=lambda path: path.stem)
def test_any_messagepack_reads_the_golden_bytes(vector: Path) -> None:
    read = msgpack.unpackb(vector.read_bytes())
    assert plain(read) == json.loads(vector.with_suffix(".json").read_text(encoding="ascii"))
    assert (type(read["type"]), read["schema"]) == (str, 1)


@pytest.mark.real
def test_a_session_is_created_taught_to_its_end_and_reported_by_the_page_alone(ann: PlainTeacher) -> None:
    world = {"kind": "sokoban", "level": ONE_PUSH, "starts": "1"}
    window = {"mode": "until-answered", "span_ms": 1000}
    create = {"type": "create-session", "session": "page", "world": world, "window": window, "episodes": 3}
    ok, done = ann.ask("learner/create", create)
    assert (ok, done["ok"]) == (True, True)
    again, same = ann.ask("learner/create", create)
    assert (again, same["ok"]) == (True, True)
    clash, refusal = ann.ask("learner/create", create | {"episodes": 4})
    assert (clash, refusal["code"]) == (False, "conflict")

    assert "answer" in ann.join()["rights"]
    acknowledged = []
    while True:
        decision = ann.wait_for(lambda newest: newest.get("phase") in {"asking", "finished"})
        if decision["phase"] == "finished":
            break
        assert (decision["asked"], decision["view"]) == ("label", ONE_PUSH)
        ok, reply = ann.send(ann.label(decision, "RIGHT"))
        acknowledged.append((ok, reply["code"]))
        number = decision["decision"]
        ann.wait_for(_is_after(number))
    assert set(acknowledged) == {(True, "accepted")}

    ok, report = ann.ask("learner/show", {"type": "session-query", "session": "page"})
    assert (ok, report["labels"]["applied"]) == (True, len(acknowledged))
    assert sum(episode["inputs"] for episode in report["episodes"]) == len(acknowledged)
    assert {episode["outcome"] for episode in report["episodes"]} == {"solved"}


@pytest.mark.real
def test_answers_are_exactly_as_safe_as_the_page_says(endpoint: str) -> None:
    bob = PlainTeacher(endpoint, "safe", "bob")
    try:
        window = {"mode": "until-answered", "span_ms": 1000, "quorum": 2}
        world = {"kind": "sokoban", "level": ONE_PUSH}
        bob.ask("learner/create", {
            "type": "create-session", "session": "safe", "world": world | {"starts": "1"}, "window": window,
        })  # fmt: skip
        before, refusal = bob.send(bob.label(_some_decision(), "RIGHT"))
        assert (before, refusal["code"]) == (False, "denied")
        bob.join()
        decision = bob.wait_for(lambda newest: newest.get("phase") == "asking")
        payload = bob.label(decision, "RIGHT")
        first, second = bob.send(payload), bob.send(payload)
        assert first == second
        assert first[1]["code"] == "accepted"
        identity = msgpack.unpackb(payload)["answer_id"]
        assert bob.send(bob.label(decision, "LEFT", {"answer_id": identity}))[1]["code"] == "conflict"
        assert (
            bob.send(bob.label(decision, "RIGHT", {"kind": "reward", "reward": 1.0}))[1]["code"] == "rejected"
        )
        for wrong, code in (
            ({"colour": "red"}, "malformed"),
            ({"step": 1.0}, "malformed"),
            ({"action": "FLY"}, "invalid"),
        ):
            ok, refusal = bob.send(bob.label(decision, "RIGHT", wrong))
            assert (ok, refusal["code"]) == (False, code)
    finally:
        bob.close()


@pytest.mark.real
def test_all_sessions_are_listed_by_the_page_alone(ann: PlainTeacher) -> None:
    names = {f"many-{number}" for number in range(90)}
    world = {"kind": "sokoban", "level": ONE_PUSH, "level_name": "\N{SNOWMAN}" * 512, "starts": "1"}
    window = {"mode": "until-answered", "span_ms": 1000}
    for name in names:
        ok, _ = ann.ask(
            "learner/create", {"type": "create-session", "session": name, "world": world, "window": window}
        )
        assert ok
    ok, latest = ann.query("learner/list", b"")
    assert (ok, len(latest["sessions"]) < len(names), latest["older"]) == (
        True,
        True,
        len(latest["sessions"]),
    )
    listed, absent = ann.sessions()
    assert {one["session"] for one in listed if one["session"].startswith("many-")} == names
    assert absent == set()


def _is_after(number: int) -> Callable[[Map], bool]:
    return lambda newest: newest["decision"] > number or newest["phase"] == "finished"


def _some_decision() -> dict[str, Any]:
    return {"session": "safe", "epoch": 1, "decision": 0, "episode": 0, "step": 0, "state": bytes(16)}


@pytest.mark.real
def test_the_example_teaches_as_it_stands_in_the_page_about_clients(endpoint: str) -> None:
    page = (ROOT / "services" / "client" / "README.md").read_text(encoding="utf-8")
    source = (ROOT / "services" / "client" / "example.py").read_text(encoding="utf-8")
    assert f"<!-- example.py -->\n```python\n{source}```\n<!-- end -->" in page
    body = source.partition("def teach")[2].partition("\nif __name__")[0]
    assert len([line for line in body.splitlines() if line.strip()]) <= 20
    made = sfid(
        "session",
        "create",
        "lesson",
        "--episodes",
        "3",
        "--window-mode",
        "until-answered",
        "--connect",
        endpoint,
    )
    assert made.code == 0, made.stderr
    command = [sys.executable, "-m", "services.client.example", endpoint, "lesson"]
    taught = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    labels = int(taught.stdout.removesuffix(" labels given\n"))
    shown = json.loads(sfid("session", "show", "lesson", "--json", "--connect", endpoint).stdout)
    assert (shown["phase"], shown["labels"]["applied"]) == ("finished", labels)
    assert len(shown["episodes"]) == 3
