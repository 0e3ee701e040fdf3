"""The commands of SECURITY.md as they stand: a deployment over TLS, taught from another directory."""

import shutil
import subprocess
from pathlib import Path

import pytest

from services.router import free_endpoint
from tests.services.cli.command_line import running, sfid

pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed"),
]
PAGE = Path(__file__).parents[3] / "SECURITY.md"


def recipe() -> str:
    """The commands that make certificates, for this machine's loopback instead of the page's address."""
    part = PAGE.read_text(encoding="utf-8").partition("## Certificates")[2]
    block = part.partition("\n\n    ")[2].partition("\n\n")[0]
    return block.replace("192.0.2.7", "127.0.0.1")


def test_a_teacher_with_four_files_and_a_token_teaches_over_tls_and_one_without_does_not(
    tmp_path: Path,
) -> None:
    data, carried = tmp_path / "data", tmp_path / "carried"
    access = data / "access"
    access.mkdir(parents=True)
    subprocess.run(["bash", "-ec", recipe()], cwd=access, check=True, capture_output=True)
    where = free_endpoint().replace("tcp/", "tls/")
    settings = tmp_path / "sfid.toml"
    settings.write_text(
        f'listen = "{where}"\ndata = "{data}"\nrequire_tokens = true\n[monitor]\nenabled = false\n'
    )
    with running("up", "--config", str(settings), stderr=tmp_path / "up.log") as up:
        assert up.stdout is not None
        assert up.stdout.readline() == f"router at {where}, data in {data}\n"
        carried.mkdir()
        for name in ("ca.pem", "teacher.login", "teacher.pem", "teacher.key"):
            shutil.copy(access / name, carried)
        created = sfid("session", "create", "maze", "--episodes", "1", "--connect", where)
        assert created.code == 0, created.stderr
        token = str(tmp_path / "ann.token")
        made = sfid("keys", "new", "ann", "--session", "maze", "--out", token, "--data", str(data))
        assert made.code == 0, made.stderr
        teach = ("teach", "scripted", "--session", "maze", "--name", "ann", "--connect", where)
        without = sfid(*teach, "--access", str(carried))
        assert (without.code, "missing-token" in without.stderr) == (2, True), without.stderr
        done = sfid(*teach, "--access", str(carried), "--token-file", token)
        assert done.code == 0, done.stderr
        shown = sfid("session", "show", "maze", "--connect", where, "--json")
        assert '"phase": "finished"' in shown.stdout
