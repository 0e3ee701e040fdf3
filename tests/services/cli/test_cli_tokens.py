"""`sfid up --require-tokens`: an invitation in a file lets a teacher at a terminal in; a name does not."""

import json
from pathlib import Path

from services.router import free_endpoint
from tests.services.cli.command_line import running, sfid


def test_only_who_was_invited_teaches_a_deployment_that_requires_tokens(tmp_path: Path) -> None:
    where, data, config = free_endpoint(), tmp_path / "data", tmp_path / "sfid.toml"
    config.write_text(f'listen = "{where}"\ndata = "{data}"\n[monitor]\nenabled = false\n')
    connect = ("--connect", where)
    teach = ("teach", "scripted", "--session", "maze", "--name", "ann", *connect)
    log = tmp_path / "up.log"
    with running("up", "--config", str(config), "--require-tokens", stderr=log) as up:
        assert up.stdout is not None
        assert up.stdout.readline() == f"router at {where}, data in {data}\n"
        assert sfid("session", "create", "maze", "--episodes", "2", *connect).code == 0
        uninvited = sfid(*teach)
        assert uninvited.code == 2
        assert "missing-token: this deployment requires a token" in uninvited.stderr
        invited = sfid("invite", "--session", "maze", "--name", "ann", "--data", str(data),
                       "--url", "http://127.0.0.1:7480")  # fmt: skip
        kept = tmp_path / "ann.txt"
        kept.write_text(invited.stdout, encoding="utf-8")
        done = sfid(*teach, "--token-file", str(kept))
        assert done.code == 0, done.stderr
        # The data directory knows its router: the command for somebody else needs no word of it.
        handed = sfid("keys", "new", "bea", "--session", "maze", "--data", str(data),
                      "--out", str(tmp_path / "bea"), "--json")  # fmt: skip
        assert json.loads(handed.stdout)["teach"].endswith(
            f" --token-file {tmp_path / 'bea'} --connect {where}"
        )
    token = invited.stdout.partition("#t=")[2].split()[0]
    assert token not in log.read_text() + done.stderr + uninvited.stderr
    for path in data.rglob("*"):
        assert not path.is_file() or token.encode() not in path.read_bytes()
