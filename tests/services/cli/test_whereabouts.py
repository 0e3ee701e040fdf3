"""What `sfid up` noted of its router is believed only where it can be so."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from protocol.keys import KeyNameError
from services.cli.shared.failure import CommandError
from services.cli.shared.whereabouts import NOTE, Whereabouts, note_whereabouts, whereabouts
from services.runtime.bus import BusError

LAB = "tls/192.0.2.7:7447"
DAMAGED: dict[str, bytes] = {
    "nothing": b"",
    "half of it": b'{"connect": "tls/192',
    "no text": b"\xff\xfe",
    "text that is no UTF-8": b'{"connect": "tcp/\xff:1", "deployment": "lab"}',
    "a list": b"[]",
    "nested": b"[" * 200_000,
    "nested within": b'{"connect": ' + b"[" * 200_000,
    "nothing said": b'{"connect": null, "deployment": null}',
    "a number": b'{"connect": 7447, "deployment": "lab"}',
    "half said": b'{"connect": "tls/192.0.2.7:7447"}',
    "another program's": b'{"connect": "tls/192.0.2.7:7447", "deployment": "lab", "image": "x"}',
    "no endpoint, and long": b'{"connect": "' + b"x" * 9_000 + b'", "deployment": "lab"}',
    "no endpoint": b'{"connect": "nonsense", "deployment": "lab"}',
    "empty": b'{"connect": "", "deployment": ""}',
    "no name": b'{"connect": "tls/192.0.2.7:7447", "deployment": "BAD name;rm"}',
}


def test_what_was_noted_is_told_and_what_is_given_goes_before_it(tmp_path: Path) -> None:
    assert whereabouts(tmp_path, None, None) == Whereabouts()
    assert whereabouts(tmp_path / "none", None, None) == Whereabouts()
    note_whereabouts(tmp_path, LAB, "lab")
    assert json.loads((tmp_path / NOTE).read_text("utf-8")) == {"connect": LAB, "deployment": "lab"}
    assert whereabouts(tmp_path, None, None) == Whereabouts(LAB, "lab")
    assert whereabouts(tmp_path, "tcp/192.0.2.9:1", None) == Whereabouts("tcp/192.0.2.9:1", "lab")
    assert whereabouts(tmp_path, None, "town") == Whereabouts(LAB, "town")


def refused(data: Path) -> str:
    with pytest.raises(CommandError) as failure:
        whereabouts(data, None, None)
    assert failure.value.exit_code == 2
    return str(failure.value)


@pytest.mark.parametrize("written", DAMAGED.values(), ids=DAMAGED.keys())
def test_a_damaged_note_is_one_line_that_names_the_file_and_the_mend_helps(
    tmp_path: Path, written: bytes
) -> None:
    path = tmp_path / NOTE
    path.write_bytes(written)
    said = refused(tmp_path)
    assert said.startswith(f"{path} does not say where the router is (")
    assert said.endswith("): remove it and start `sfid up` again, or give --connect and --deployment")
    assert said.isprintable()
    assert len(said) < len(str(path)) + 400
    assert whereabouts(tmp_path, LAB, "lab") == Whereabouts(LAB, "lab")
    note_whereabouts(tmp_path, LAB, "lab")
    assert whereabouts(tmp_path, None, None) == Whereabouts(LAB, "lab")


@pytest.mark.parametrize("made", [Path.mkdir, lambda path: path.symlink_to(path)], ids=["directory", "loop"])
def test_a_note_that_is_no_file_is_one_line_too(tmp_path: Path, made: Callable[[Path], None]) -> None:
    made(tmp_path / NOTE)
    assert refused(tmp_path).startswith(f"{tmp_path / NOTE} does not say where the router is (")


@pytest.mark.parametrize("name", ["NO good", "", "a/b", "*"])
def test_a_deployment_that_cannot_be_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(KeyNameError, match=r"^deployment name '"):
        whereabouts(tmp_path, None, name)


@pytest.mark.parametrize("endpoint", ["", "here", "udp/x:1"])
def test_an_endpoint_that_cannot_be_is_refused(tmp_path: Path, endpoint: str) -> None:
    with pytest.raises(BusError, match=r"^endpoint '"):
        whereabouts(tmp_path, endpoint, "local")
