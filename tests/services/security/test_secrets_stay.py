"""Secrets stand in their own files, and nowhere else: no log, no command line, no journal, no recording."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from protocol.identity import check_key
from services.cli.shared import launch
from services.cli.up import asks_for_tokens
from services.runtime.access import read_access
from services.runtime.config import Config, GatewaySection
from services.teachers.token_file import read_token
from services.topology import Role
from tests.services.cli.command_line import running, sfid, wait_for
from tests.services.security.lesson import SESSION, Lesson, lesson

pytestmark = pytest.mark.real
OWN_FILES = {"secret", "users"} | {f"{role.value}.login" for role in Role}
NAME = "p-canary-7x"


@pytest.fixture(scope="module")
def taught(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Lesson, Path]]:
    """A deployment with everybody in it, and the file of a teacher's token, while that teacher teaches."""
    folder = tmp_path_factory.mktemp("secrets")
    with lesson(folder / "data") as house:
        deployed, supervisor = house.deployed, house.supervisor
        supervisor.start(
            launch.monitor(deployed, viewer=False, ports=(0, 0, 0)),
            launch.gateway(deployed, GatewaySection(enabled=True, listen="127.0.0.1:0")),
        )
        file = folder / "canary.token"
        made = sfid("keys", "new", NAME, "--session", SESSION, "--out", str(file), "--data", str(house.data))
        assert made.code == 0, made.stderr
        yield house, file


def teach(house: Lesson, file: Path) -> tuple[str, ...]:
    return (
        "teach", "scripted", "--session", SESSION, "--name", NAME, "--token-file", str(file), "--verbose",
        "--connect", house.deployed.endpoint,
    )  # fmt: skip


def canaries(house: Lesson, file: Path) -> set[bytes]:
    """What must not be seen: passwords, the signing secret, the token, the key of acknowledgements."""
    logins = house.deployed.logins
    passwords = {read_access(logins, role.value).password for role in Role if role is not Role.ROUTER}
    secrets, key = house.secrets(), check_key(SESSION, NAME, house.secrets())
    token = read_token(file)
    return {
        *(password.encode() for password in passwords), *secrets, *(one.hex().encode() for one in secrets),
        key, key.hex().encode(), token.encode(), token.partition(".")[0].encode(),
    }  # fmt: skip


def test_a_teacher_of_this_machine_needs_no_more_than_a_token_and_no_secret_is_seen_outside_its_file(
    taught: tuple[Lesson, Path], tmp_path: Path
) -> None:
    house, file = taught
    hidden = canaries(house, file)
    log = tmp_path / "teacher.log"
    with running(*teach(house, file), stderr=log):
        wait_for("answers", lambda: answers(house) > 30)
        seen = {}
        for process in Path("/proc").glob("[0-9]*"):
            for what in ("cmdline", "environ"):
                try:
                    seen[f"{process.name} {what}"] = (process / what).read_bytes()
                except OSError:
                    continue
    files = [path for path in house.data.rglob("*") if path.is_file() and path.name not in OWN_FILES]
    assert {"router.log", "learner.log", "journal.sqlite", "register.jsonl"} <= {path.name for path in files}
    assert list((house.data / "recordings").iterdir())
    seen |= {str(path): path.read_bytes() for path in [*files, log]}
    assert [name for name, content in seen.items() for one in hidden if one in content] == []


def test_a_token_that_is_withdrawn_is_refused_at_the_next_answer_and_no_process_is_started_again(
    taught: tuple[Lesson, Path], tmp_path: Path
) -> None:
    house, file = taught
    before = house.supervisor.processes()
    with running(*teach(house, file), stderr=tmp_path / "teacher.log") as teacher:
        begun = answers(house)
        wait_for("answers", lambda: answers(house) > begun + 10)
        assert sfid("keys", "revoke", NAME, "--data", str(house.data)).code == 0
        after = answers(house)
        assert teacher.wait(30) == 2
        # One answer may have been on its way while the token was withdrawn.
        assert answers(house) - after <= 1
    assert "revoked-token: the token has been withdrawn" in (tmp_path / "teacher.log").read_text()
    assert house.supervisor.processes() == before
    listed = sfid("keys", "list", "--data", str(house.data), "--json")
    states = {row["for"]: row["state"] for row in json.loads(listed.stdout)["keys"]}
    assert states == {NAME: "revoked"}


def answers(house: Lesson) -> int:
    return house.operator.show(SESSION)[0].labels.submitted


@pytest.mark.parametrize(
    "listen,said,asks",
    [
        ("tcp/127.0.0.1:1", None, False),
        ("tls/0.0.0.0:1", None, True),
        ("tls/192.0.2.1:1", None, True),
        ("tcp/127.0.0.1:1", True, True),
        ("tls/0.0.0.0:1", False, False),
    ],
)
def test_tokens_are_asked_for_where_other_machines_reach_the_router(
    listen: str, *, said: bool | None, asks: bool
) -> None:
    assert asks_for_tokens(Config(listen=listen), None, said) is asks
    assert asks_for_tokens(Config(require_tokens=said), listen, None) is asks
