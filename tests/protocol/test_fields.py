"""How long a name may be, and how many of them are remembered."""

import msgspec
import pytest

from protocol.codec import DecodeError, decode, encode
from protocol.fields import MET_MAX, is_action_name, is_name
from protocol.messages import Answer
from tests.protocol.samples import LABEL


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


@pytest.mark.parametrize("field", ["session", "teacher", "action"])
def test_what_is_too_long_for_a_name_is_not_remembered(field: str) -> None:
    long = msgspec.msgpack.decode(encode(LABEL)) | {field: "a" * 30_000}
    met = is_name.cache_info(), is_action_name.cache_info()
    with pytest.raises(DecodeError, match=f"length.*{field}"):
        decode(msgspec.msgpack.encode(long), Answer)
    assert (is_name.cache_info(), is_action_name.cache_info()) == met


@pytest.mark.parametrize("field", ["session", "teacher", "action"])
def test_the_field_that_holds_no_name_is_told(field: str) -> None:
    wrong = msgspec.msgpack.decode(encode(LABEL)) | {field: "not a name"}
    with pytest.raises(DecodeError, match=f"`{field}` is "):
        decode(msgspec.msgpack.encode(wrong), Answer)
