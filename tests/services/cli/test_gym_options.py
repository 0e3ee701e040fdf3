"""The options that name an environment: what cannot be is said in one line, with the option that is wrong."""

from typing import Any

import gymnasium
import pytest

from services.cli.shared.failure import CommandError
from services.cli.shared.gym_options import gym_options, gym_world

LAKE = "FrozenLake-v1"


@pytest.mark.parametrize("text", ["=3", " = 3", "="])
def test_an_option_without_a_name_is_refused(text: str) -> None:
    with pytest.raises(CommandError) as failure:
        gym_options(["is_slippery=false", text])
    said = f"option {text!r} has no name: write NAME=VALUE, such as is_slippery=false"
    assert (str(failure.value), failure.value.exit_code) == (said, 2)


def test_options_are_read_as_truths_numbers_or_words() -> None:
    written = ["a=true", "b = None", "c=3", "d=0.5", "e=4x4", "f=", "g=x=y"]
    read = {"a": True, "b": None, "c": 3, "d": 0.5, "e": "4x4", "f": "", "g": "x=y"}
    assert gym_options(written) == read


@pytest.mark.parametrize("gym", ["", "  "])
def test_an_environment_without_a_name_is_refused(gym: str) -> None:
    with pytest.raises(CommandError, match=r"^--gym names no environment: give a registered one, such as "):
        gym_world(gym, None, None)


@pytest.mark.parametrize("actions", ["", " ", ",", "A,,B,C", "A,B,C,"])
def test_actions_without_a_name_are_refused(actions: str) -> None:
    with pytest.raises(CommandError) as failure:
        gym_world(LAKE, None, actions)
    assert str(failure.value) == (
        f"--gym-actions {actions!r} leaves a name empty: name each, such as LEFT,DOWN,RIGHT,UP"
    )


@pytest.mark.parametrize("options, actions", [(["a=1"], None), (None, "A,B"), (None, "")])
def test_options_of_no_environment_are_refused(options: list[str] | None, actions: str | None) -> None:
    with pytest.raises(CommandError, match=r"speak of an environment: name it with --gym$"):
        gym_world(None, options, actions)
    assert gym_world(None, None, None) is None


def test_an_option_that_there_is_not_is_told_those_there_are() -> None:
    with pytest.raises(CommandError) as failure:
        gym_world(LAKE, ["slippery=false"], None)
    assert str(failure.value).startswith(
        f"environment {LAKE}: there is no option slippery: choose of desc, is_slippery, map_name"
    )


def picky(size: int = 0, **_: Any) -> Any:  # noqa: ANN401 - as Gymnasium wants it
    raise ValueError(f"no board of {size}")


@pytest.mark.parametrize(
    "environment, options, reason",
    [
        (LAKE, ["map_name=99x99"], "it cannot be made with map_name=99x99 (KeyError '99x99')"),
        ("Picky-v0", ["size=9", "a=b"], "it cannot be made with a=b, size=9 (ValueError no board of 9)"),
    ],
)
def test_an_option_that_an_environment_refuses_is_named_with_its_value(
    environment: str, options: list[str], reason: str
) -> None:
    gymnasium.register("Picky-v0", picky)
    try:
        with pytest.raises(CommandError) as failure:
            gym_world(environment, options, None)
        assert (
            str(failure.value) == f"environment {environment}: {reason}: give what it knows, or leave it out"
        )
        with pytest.raises(CommandError, match=r"^environment Picky-v0: no board of 0$"):
            gym_world("Picky-v0", None, None)
    finally:
        del gymnasium.registry["Picky-v0"]


def test_options_of_what_tells_none_are_left_to_it() -> None:
    gymnasium.register("Opaque-v0", entry_point=type)  # type: ignore[arg-type]  # a class whose signature nobody can read
    try:
        with pytest.raises(CommandError, match=r"^environment Opaque-v0: ") as failure:
            gym_world("Opaque-v0", ["size=9"], None)
        assert "there is no option" not in str(failure.value)
        assert "signature" not in str(failure.value)
    finally:
        del gymnasium.registry["Opaque-v0"]
