"""`sfid keys`: a token for a teacher is made, listed and withdrawn, and seen by nobody but its bearer."""

import json
import stat
import subprocess
import sys
import time
from pathlib import Path
from shlex import quote
from typing import Any

import pytest

from protocol.identity import TokenFault, verify
from services.cli.shared.options import ENDPOINT
from services.cli.shared.whereabouts import note_whereabouts
from services.runtime.clock import SystemClock
from services.runtime.doorkeeper import DoorFault, Doorkeeper
from services.runtime.secret import load_secrets
from services.teachers.token_file import read_token
from tests.services.cli.command_line import Done, sfid


def keys(data: Path, *arguments: str) -> dict[str, Any]:
    done = sfid("keys", *arguments, "--data", str(data), "--json")
    assert done.code == 0, done.stderr
    return dict(json.loads(done.stdout))


def states(data: Path) -> dict[str, str]:
    return {row["for"]: row["state"] for row in keys(data, "list")["keys"]}


def test_a_token_is_a_private_file_and_is_told_nowhere_else(tmp_path: Path) -> None:
    data, file = tmp_path / "data", tmp_path / "ann.token"
    done = sfid("keys", "new", "ann", "--session", "s1", "--out", str(file), "--data", str(data))
    token = read_token(file)
    identity = verify(token, load_secrets(data / "gateway"), time.time(), ())
    assert (done.code, identity.pseudonym, identity.session) == (0, "ann", "s1")
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert token.partition(".")[0] not in done.stdout + done.stderr
    assert f"sfid keys revoke {identity.token_id}" in done.stdout
    assert (
        f"they teach on this machine with `sfid teach keyboard --session s1 --name ann --token-file {file}`, "
        "elsewhere also with their --connect and --access"
    ) in done.stdout
    for path in data.rglob("*"):
        assert not path.is_file() or token.encode() not in path.read_bytes()


LAB, TOWN = "tls/192.0.2.7:7447", "tls/198.51.100.9:7447"


@pytest.mark.parametrize("flags, where", [
    ((), f"--connect {LAB} --deployment lab --access FOLDER"),
    (("--connect", TOWN, "--access", "town"), f"--connect {TOWN} --deployment lab --access town"),
    (("--deployment", "local"), f"--connect {LAB} --access FOLDER"),
    (("--connect", ENDPOINT, "--deployment", "lab-crowd"), "--deployment lab-crowd"),
])  # fmt: skip
def test_the_teachers_command_says_where_the_router_of_the_deployment_is(
    tmp_path: Path, flags: tuple[str, ...], where: str
) -> None:
    note_whereabouts(tmp_path, LAB, "lab")
    new = ("keys", "new", "ann", "--session", "s1", "--data", str(tmp_path), *flags, "--out")
    for file, more in (("my token", ()), ("again", ("--json",))):
        done = sfid(*new, file, *more, cwd=tmp_path)
        command = f"sfid teach keyboard --session s1 --name ann --token-file {quote(file)} {where}"
        if more:
            assert json.loads(done.stdout)["teach"] == command
        else:
            assert f"`{command}`" in done.stdout
            assert ("FOLDER is where they keep teacher.login" in done.stdout) == ("FOLDER" in where)


def test_a_router_that_cannot_be_is_refused_before_a_token_is_made(tmp_path: Path) -> None:
    done = sfid("keys", "new", "ann", "--session", "s1", "--connect", "here", cwd=tmp_path)
    said = "sfid: endpoint 'here' is not of the form tcp/HOST:PORT, as in tcp/127.0.0.1:7447\n"
    assert (done, list(tmp_path.iterdir())) == (Done(2, "", said), [])


@pytest.mark.parametrize("verb", [("keys", "new", "ann"), ("invite", "--url", "https://teach.example")])
def test_a_deployment_that_cannot_be_or_a_damaged_note_is_refused_before_anything_is_handed_out(
    tmp_path: Path, verb: tuple[str, ...]
) -> None:
    asked = (*verb, "--session", "s1", "--data", ".")
    done = sfid(*asked, "--deployment", "NO good", cwd=tmp_path)
    assert (done.code, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith("sfid: deployment name 'NO good' is not allowed: ")
    (tmp_path / "deployment.json").mkdir()
    done = sfid(*asked, cwd=tmp_path)
    assert (done.code, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith("sfid: deployment.json does not say where the router is (Is a directory): ")
    assert [path.name for path in tmp_path.iterdir()] == ["deployment.json"]


def test_a_token_that_cannot_be_written_down_is_not_handed_out(tmp_path: Path) -> None:
    data, file = tmp_path / "data", tmp_path / "ann.token"
    made = keys(data, "new", "ann", "--session", "s1", "--out", str(file))
    written = file.read_bytes()
    for out in (file, tmp_path / "none" / "ann.token", tmp_path):
        done = sfid("keys", "new", "ann", "--session", "s1", "--out", str(out), "--data", str(data))
        assert (done.code, done.stdout, done.stderr.count("\n")) == (2, "", 1)
        assert done.stderr.startswith(f"sfid: {out}: ")
        assert done.stderr.endswith(": name another file with --out\n")
    assert [row["id"] for row in keys(data, "list")["keys"]] == [made["id"]]
    assert file.read_bytes() == written


def test_where_no_token_can_be_handed_out_no_file_is_left(tmp_path: Path) -> None:
    data, file = tmp_path / "data", tmp_path / "ann.token"
    data.mkdir()
    (data / "gateway").touch()  # where a directory must be
    done = sfid("keys", "new", "ann", "--session", "s1", "--out", str(file), "--data", str(data))
    assert (done.code, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith("sfid: ")
    assert not file.exists()


LIMITED = """
import resource, sys
from services.cli.main import main
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.RLIM_INFINITY))
sys.argv = ["sfid", *sys.argv[2:]]
main()
"""
"""A command in a process whose files cannot grow further, as where a disk is full."""


def on_a_full_disk(free_bytes: int, *arguments: str) -> tuple[int, str]:
    command = [sys.executable, "-P", "-c", LIMITED, str(free_bytes), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


def test_on_a_full_disk_there_is_neither_a_token_without_an_id_nor_an_id_without_a_token(
    tmp_path: Path,
) -> None:
    data, file = tmp_path / "data", tmp_path / "bea.token"
    first = keys(data, "new", "ann", "--session", "s1", "--out", str(tmp_path / "ann.token"))
    register, token_bytes = data / "gateway" / "register.jsonl", (tmp_path / "ann.token").stat().st_size
    noted = register.stat().st_size
    new = ("keys", "new", "bea", "--session", "s1", "--out", str(file), "--data", str(data))
    assert noted < token_bytes - 1, "else the limit meets the wrong file"
    assert on_a_full_disk(token_bytes - 1, *new) == (
        2, f"sfid: {file}: File too large: name another file with --out\n",
    )  # fmt: skip
    assert (register.stat().st_size, file.exists()) == (noted, False)
    while register.stat().st_size < 2 * token_bytes:
        keys(data, "new", "cleo", "--session", "s1", "--out", str(tmp_path / f"{register.stat().st_size}"))
    code, said = on_a_full_disk(register.stat().st_size + 20, *new)
    assert (code, said.count("\n"), f"sfid: {data}: " in said, file.exists()) == (2, 1, True, False)
    second = keys(data, "new", "bea", "--session", "s1", "--out", str(file))
    listed = {row["id"]: row["for"] for row in keys(data, "list")["keys"]}
    assert (listed[first["id"]], listed[second["id"]]) == ("ann", "bea")
    assert list(listed.values()).count("bea") == 1


def test_what_is_withdrawn_by_id_or_by_name_is_refused_at_the_next_answer(tmp_path: Path) -> None:
    data = tmp_path / "data"
    made = {
        name: keys(data, "new", name, "--session", "s1", "--out", str(tmp_path / name))
        for name in ("ann", "bea", "cleo")
    }
    door = Doorkeeper(data, SystemClock().wall_ns)
    tokens = {name: read_token(tmp_path / name) for name in made}
    assert [door.fault("s1", name, tokens[name]) for name in made] == [None] * 3
    assert states(data) == {"ann": "valid", "bea": "valid", "cleo": "valid"}
    assert keys(data, "revoke", made["ann"]["id"]) == {"revoked": made["ann"]["id"]}
    assert keys(data, "revoke", "bea") == {"revoked": "bea"}
    assert [door.fault("s1", name, tokens[name]) for name in made] == [DoorFault.REVOKED] * 2 + [None]
    assert states(data) == {"ann": "revoked", "bea": "revoked", "cleo": "valid"}
    assert door.refused == {DoorFault(TokenFault.REVOKED.value): 2}


def test_what_cannot_be_is_said_in_a_line(tmp_path: Path) -> None:
    data, taken = tmp_path / "data", tmp_path / "taken"
    taken.touch()
    new = ("keys", "new", "ann", "--session", "s1", "--data", str(data), "--out")
    refused = {
        (*new, str(taken)): "File exists: name another file with --out",
        (*new, str(tmp_path / "x"), "--hours", "0"): "--hours 0: give more than 0 and at most a year",
        ("keys", "new", "Ann", "--session", "s1"): "teacher name 'Ann' is not allowed",
        ("keys", "revoke", "nobody", "--data", str(tmp_path / "none")): "nobody was ever given a token there",
    }
    for arguments, said in refused.items():
        done = sfid(*arguments)
        assert (done.code in {1, 2}, said in done.stderr, done.stderr.count("\n")) == (True, True, 1), done
