"""How long a name may be, and how many of them are remembered."""

import pytest

from protocol.fields import MET_MAX, is_action_name, is_name


@pytest.mark.parametrize("length,well", [(1, True), (48, True), (49, False)])
def test_a_name_has_48_characters_at_most(length: int, *, well: bool) -> None:
    assert is_name("a" * length) is well


@pytest.mark.parametrize("length,well", [(1, True), (32, True), (33, False)])
def test_the_name_of_an_action_has_32_characters_at_most(length: int, *, well: bool) -> None:
    assert is_action_name("A" * length) is well


def test_only_so_many_names_are_remembered() -> None:
    for number in range(MET_MAX + 100):
        is_name(f"n{number}")
    assert is_name.cache_info().currsize == is_name.cache_info().maxsize == MET_MAX
