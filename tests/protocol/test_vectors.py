"""Golden bytes: what was published once is read and written the same for ever."""

import json
from typing import get_args

import pytest

from protocol import messages, world_messages
from protocol.codec import decode, encode, unpack
from protocol.messages import Wire
from tests.protocol.make_vectors import VECTORS, readable, type_name
from tests.protocol.samples import FULL


@pytest.mark.parametrize("message", FULL, ids=type_name)
def test_the_golden_bytes_decode_to_the_message_and_it_encodes_to_them(message: Wire) -> None:
    payload = (VECTORS / f"{type_name(message)}.bin").read_bytes()
    assert decode(payload, type(message)) == message
    assert encode(message) == payload


@pytest.mark.parametrize("message", FULL, ids=type_name)
def test_the_readable_twin_says_what_the_bytes_hold(message: Wire) -> None:
    payload = (VECTORS / f"{type_name(message)}.bin").read_bytes()
    twin = json.loads((VECTORS / f"{type_name(message)}.json").read_text(encoding="ascii"))
    assert readable(unpack(payload)) == twin


def test_every_message_has_one_vector_and_every_vector_one_message() -> None:
    types = {
        each
        for each in (*vars(messages).values(), *vars(world_messages).values())
        if isinstance(each, type) and issubclass(each, Wire) and each is not Wire
    }
    assert {type(message) for message in FULL} == types
    assert len(FULL) == len(types)
    names = {type_name(message) for message in FULL}
    assert {path.name for path in VECTORS.iterdir()} == {
        f"{name}.{ending}" for name in names for ending in ("bin", "json")
    }


def test_every_field_of_every_message_is_in_its_vector() -> None:
    """Optional fields too, but for the action of a decision that is still asked for."""
    missing = {
        f"{type_name(message)}.{field}"
        for message in FULL
        for field in message.__struct_fields__
        if getattr(message, field) is None
    }
    assert missing == {"decision.action"}
    assert get_args(messages.Schema) == (messages.SCHEMA,)
