"""Each role's login in a directory of its own."""

import stat
from pathlib import Path

import pytest

from services.runtime.access import make_access, read_access
from services.runtime.handed_logins import hand_out
from services.runtime.secret import SecretError

ROLES = ("learner", "teacher")


def test_a_role_that_has_a_directory_is_handed_its_login_and_no_other(tmp_path: Path) -> None:
    (tmp_path / "learner").mkdir()
    make_access(tmp_path, ROLES)
    hand_out(tmp_path, ROLES)
    copy = tmp_path / "learner" / "learner.login"
    assert sorted(path.name for path in (tmp_path / "learner").iterdir()) == ["learner.login"]
    assert stat.S_IMODE(copy.stat().st_mode) == 0o600
    assert read_access(tmp_path / "learner", "learner") == read_access(tmp_path, "learner")
    assert not (tmp_path / "teacher").exists()


def test_a_login_that_was_made_anew_replaces_the_copy_and_one_that_holds_is_left_alone(
    tmp_path: Path,
) -> None:
    (tmp_path / "learner").mkdir()
    make_access(tmp_path, ROLES)
    hand_out(tmp_path, ROLES)
    copy = tmp_path / "learner" / "learner.login"
    first, written = copy.read_bytes(), copy.stat().st_ino
    hand_out(tmp_path, ROLES)
    assert copy.stat().st_ino == written
    (tmp_path / "learner.login").unlink()
    make_access(tmp_path, ROLES)
    hand_out(tmp_path, ROLES)
    assert copy.read_bytes() == (tmp_path / "learner.login").read_bytes() != first


def test_a_directory_that_cannot_be_written_is_named_with_the_mend(tmp_path: Path) -> None:
    make_access(tmp_path, ROLES)
    (tmp_path / "learner" / "learner.login").mkdir(parents=True)
    with pytest.raises(
        SecretError, match=r"learner/learner\.login: .*: let the router write there, or remove"
    ):
        hand_out(tmp_path, ROLES)
