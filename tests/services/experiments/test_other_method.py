"""A journal of several sessions under another method: who fits is told, who does not is named."""

from pathlib import Path

import pytest

from services.cli.journal import replay
from services.cli.shared.failure import CommandError
from services.experiments.other_method import Misfit, OtherMethod, replay_with
from sfid_core.learning.parameters import ParameterError
from tests.services.learner.classroom import Classroom, session


def recorded(folder: Path) -> Path:
    """Return a data directory with the sessions s1 (sfid) and s2 (reward)."""
    room = Classroom(folder)
    room.create()
    room.create(session(session="s2", method="reward"))
    room.shard.commit()
    room.shard.close()
    return folder


def test_sessions_that_another_method_cannot_learn_from_are_named_and_the_others_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = recorded(tmp_path / "data")
    fits, misfit = replay_with(data, "dagger", {})
    reason = (
        "method dagger asks for label, the session's reward asked for reward: choose a method that asks for "
        "no more, or record a session with it"
    )
    assert isinstance(fits, OtherMethod)
    assert (fits.session, fits.recorded.method, fits.other.method) == ("s1", "sfid", "dagger")
    assert misfit == Misfit("s2", reason)
    replay(data, method="dagger")
    assert capsys.readouterr().out.splitlines()[-1] == f"s2: left out: {reason}"


def test_where_no_session_fits_each_is_named_with_the_reason_and_the_mend(tmp_path: Path) -> None:
    data = recorded(tmp_path / "data")
    told = "session {}: method guidance asks for guidance and reward, the session's {} asked for {}: choose"
    with pytest.raises(CommandError) as refused:
        replay(data, method="guidance")
    first, second = str(refused.value).split("; ")
    assert first.startswith(told.format("s1", "sfid", "label"))
    assert second.startswith(told.format("s2", "reward", "reward"))


def test_parameters_are_refused_before_any_session_is_read(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"gamma 2\.0 is outside"):
        replay_with(tmp_path / "nowhere", "dagger", {"gamma": 2.0})
