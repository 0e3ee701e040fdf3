"""Files that their owner alone can read, written whole or not at all."""

import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from services.runtime.secret import written_anew, written_once

Write = Callable[[Path, bytes], None]
WRITES = pytest.mark.parametrize("write", [written_once, written_anew])


@WRITES
def test_a_new_file_is_its_owners_alone_and_nothing_is_left_beside_it(tmp_path: Path, write: Write) -> None:
    path = tmp_path / "login"
    write(path, b"teacher:word")
    assert (path.read_bytes(), stat.S_IMODE(path.stat().st_mode)) == (b"teacher:word", 0o600)
    assert list(tmp_path.iterdir()) == [path]


def test_who_writes_once_leaves_what_is_there_and_who_writes_anew_replaces_it(tmp_path: Path) -> None:
    path = tmp_path / "login"
    path.write_bytes(b"first")
    path.chmod(0o644)
    written_once(path, b"second")
    assert path.read_bytes() == b"first"
    written_anew(path, b"third")
    assert (path.read_bytes(), stat.S_IMODE(path.stat().st_mode)) == (b"third", 0o600)
    assert list(tmp_path.iterdir()) == [path]


def test_a_symbolic_link_is_replaced_and_what_it_leads_to_left_alone(tmp_path: Path) -> None:
    path, elsewhere = tmp_path / "login", tmp_path / "elsewhere"
    elsewhere.write_bytes(b"somebody's")
    path.symlink_to(elsewhere)
    written_anew(path, b"teacher:word")
    assert (path.is_symlink(), path.read_bytes(), elsewhere.read_bytes()) == (
        False,
        b"teacher:word",
        b"somebody's",
    )


def test_what_cannot_be_put_in_its_place_leaves_nothing_behind(tmp_path: Path) -> None:
    path = tmp_path / "login"
    path.mkdir()
    with pytest.raises(OSError, match="directory"):
        written_anew(path, b"teacher:word")
    assert list(tmp_path.iterdir()) == [path]
