"""Configurations go both ways: a condition becomes a session, a recorded session an experiment."""

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from protocol.messages import CreateSession
from protocol.translate import config_of
from services.cli.session_source import (
    Flags,
    Recorded,
    _experiments,
    chosen,
    condition_named,
    experiment_words,
    recorded,
    scripted_commands,
    wire_world,
)
from services.cli.shared.failure import CommandError
from sfid_core.sokoban.world import WorldError
from sfid_core.teaching.personas import persona_named
from tests.services.learner.classroom import UNTIL_ANSWERED, Classroom, Pupil, session


@pytest.mark.parametrize("experiment", ["figure2", "learners", "guidance", "circuits"])
def test_every_condition_of_an_experiment_is_a_session_with_the_same_configuration(experiment: str) -> None:
    for condition in _experiments()[experiment]:
        config = chosen(condition.config, Flags(), 0)
        message = CreateSession(
            session=config.session, world=wire_world(config.world), method=config.method,
            parameters=dict(config.parameters), episodes=config.episodes, seed=0, window=UNTIL_ANSWERED,
        )  # fmt: skip
        sent = config_of(msgspec.convert(msgspec.to_builtins(message), CreateSession))
        again = replace(condition, config=replace(sent, window=condition.config.window))
        assert again.digest == condition.digest
        assert condition_named(f"{experiment}:{condition.method}+{condition.teacher}").digest == again.digest


def test_flags_go_before_the_condition_and_another_method_starts_from_its_defaults() -> None:
    base = condition_named("learners:isabl-held+rare").config
    kept = chosen(base, Flags(parameters=["error=0.3"], starts="1", step_reward=-1.0, steps_max=50), 3)
    assert dict(kept.parameters) == {"explore": 0.0, "update": "episode", "error": 0.3}
    assert kept.world == replace(base.world, starts="1", step_reward=-1.0, steps_max=50)
    assert (kept.method, kept.episodes, kept.seed) == ("isabl", 300, 3)
    other = chosen(base, Flags(method="sfid", episodes=7, level="classroom:1"), 0)
    assert (other.method, dict(other.parameters), other.episodes) == ("sfid", {}, 7)
    assert (other.world.level_name != base.world.level_name, other.world.deadlock_reward) == (True, 0.0)


@pytest.mark.parametrize(
    "flags,words",
    [
        (Flags(goal_reward=float("nan")), "goal_reward is nan; give a finite number"),
        (Flags(step_reward=float("inf")), "step_reward is inf; give a finite number"),
        (Flags(steps_max=0), "steps_max is 0; give at least 1"),
        (Flags(starts="999"), "only 192 that can be solved"),
        (Flags(method="sorcery"), "unknown method 'sorcery': choose one of sfid"),
    ],
)
def test_a_world_or_method_that_cannot_be_is_refused_in_one_line(flags: Flags, words: str) -> None:
    with pytest.raises((CommandError, WorldError)) as caught:
        chosen(None, flags, 0)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    "flags,words",
    [
        (Flags(), "as in the experiment"),
        (Flags(method="tamer"), "taught as in the experiment, which has the method isabl"),
        (Flags(episodes=7), "taught as in the experiment, with what the flags change"),
    ],
)
def test_only_a_session_like_its_condition_is_called_as_in_the_experiment(flags: Flags, words: str) -> None:
    base = condition_named("learners:isabl-held+rare").config
    assert experiment_words(base, replace(chosen(base, flags, 9), session="mine")) == words


def test_a_condition_tells_how_its_teachers_are_run() -> None:
    judged = condition_named("learners:guide-judged+very-noisy")
    assert scripted_commands(judged.teachers, "s1") == [
        "teach scripted --session s1 --name teacher --persona very-noisy -f guidance_width=1.0"
    ]
    naive = condition_named("figure2:sfid+naive")
    assert scripted_commands(naive.teachers, "s1") == [
        "teach scripted --session s1 --name naive --persona naive"
    ]
    assert persona_named("very-noisy", {"guidance_width": 1}) == judged.teachers["teacher"]


@pytest.mark.parametrize(
    "like,words",
    [
        (
            "figure3:sfid+expert",
            "no experiment 'figure3': write figure2:sfid+expert, or one of figure2, learn",
        ),
        ("figure2:sfid", "no condition 'sfid': choose from figure2:sfid+expert, figure2:reward+expert"),
        (
            "figure2",
            (
                "--like 'figure2': figure2 has 4 conditions: choose from figure2:sfid+expert, "
                "figure2:reward+expert, figure2:sfid+naive, figure2:reward+naive"
            ),
        ),
    ],
)
def test_a_condition_that_is_none_is_refused_with_the_names(like: str, words: str) -> None:
    with pytest.raises(CommandError) as caught:
        condition_named(like)
    assert words in str(caught.value)


def test_a_recorded_session_is_read_back_with_who_joined(tmp_path: Path) -> None:
    room = Classroom(tmp_path / "data")
    first = room.create()
    Pupil(room, "oracle").join()
    room.create(session(session="s2", method="reward", parameters={"alpha": 0.3}))
    room.shard.commit()
    room.shard.close()
    assert recorded(tmp_path / "data", "s1") == Recorded(config_of(first), ("oracle",))
    second = recorded(tmp_path / "data", "s2")
    assert (second.config.method, dict(second.config.parameters)) == ("reward", {"alpha": 0.3})
    assert second.teachers == ()
    with pytest.raises(CommandError, match=r"holds 2 sessions: choose one with --session: s1, s2$"):
        recorded(tmp_path / "data", None)
    with pytest.raises(CommandError, match=r"no session s9: choose one with --session: s1, s2$"):
        recorded(tmp_path / "data", "s9")
