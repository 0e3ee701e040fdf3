"""Golden bytes: what was published once is read and written the same for ever."""

import json
from typing import get_args

import msgspec
import pytest

from protocol import crowd_message, messages, world_messages
from protocol.codec import DecodeError, decode, encode, unpack
from protocol.messages import Wire
from tests.protocol.make_vectors import NAMED, VECTORS, readable, type_name
from tests.protocol.samples import FULL, LAKE, OTHER_WORLDS

BEGIN_LAKE = OTHER_WORLDS["begin-gym"]


@pytest.mark.parametrize("name", NAMED)
def test_the_golden_bytes_decode_to_the_message_and_it_encodes_to_them(name: str) -> None:
    message, payload = NAMED[name], (VECTORS / f"{name}.bin").read_bytes()
    assert decode(payload, type(message)) == message
    assert encode(message) == payload


@pytest.mark.parametrize("name", NAMED)
def test_the_readable_twin_says_what_the_bytes_hold(name: str) -> None:
    payload = (VECTORS / f"{name}.bin").read_bytes()
    twin = json.loads((VECTORS / f"{name}.json").read_text(encoding="ascii"))
    assert readable(unpack(payload)) == twin


def test_every_message_has_one_vector_and_every_vector_one_message() -> None:
    types = {
        each
        for each in (*vars(messages).values(), *vars(crowd_message).values(), *vars(world_messages).values())
        if isinstance(each, type) and issubclass(each, Wire) and each is not Wire
    }
    assert {type(message) for message in FULL} == types
    assert len(FULL) == len(types)
    assert {path.name for path in VECTORS.iterdir()} == {
        f"{name}.{ending}" for name in NAMED for ending in ("bin", "json")
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


def test_a_world_of_a_kind_that_nobody_knows_is_refused() -> None:
    payload = encode(NAMED["begin-gym"]).replace(b"\xa4kind\xa3gym", b"\xa4kind\xa3gim")
    with pytest.raises(DecodeError, match="gim"):
        decode(payload, world_messages.Begin)


@pytest.mark.parametrize("environment", ["os:system", "../x y", "", "a" * 129, "Lake\n"])
def test_an_environment_is_named_by_a_registered_id_and_never_by_a_module(environment: str) -> None:
    with pytest.raises(DecodeError, match="environment"):
        decode(
            encode(
                msgspec.structs.replace(
                    BEGIN_LAKE, world=msgspec.structs.replace(LAKE, environment=environment)
                )
            ),
            world_messages.Begin,
        )
