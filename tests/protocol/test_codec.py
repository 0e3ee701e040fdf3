"""The decoder's promise: the message or DecodeError, whatever the bytes."""

from random import Random
from typing import Any

import msgspec
import pytest

from protocol.codec import (
    PAYLOAD_MAX,
    DecodeError,
    DecodeFault,
    decode,
    decode_strictly,
    encode,
    pack,
    printable,
    unpack,
)
from protocol.messages import Acknowledgement, Answer, Decision, Join, Wire
from tests.protocol.make_vectors import type_name
from tests.protocol.samples import ANSWER_ID, FULL, LABEL

FRAMES = 20_000
every_message = pytest.mark.parametrize("message", FULL, ids=type_name)


def survives(payload: bytes, expected: type[Wire]) -> bool:
    """Whether the payload decodes; any exception but a DecodeError of one printable line fails the test.

    So does a message that the strict way in reads as another, or refuses.
    """
    try:
        assert decode(payload, expected) == decode_strictly(payload, expected)
    except DecodeError as error:
        if not str(error).isprintable() or len(str(error)) > 300:
            pytest.fail(f"no line for a log: {error!r}")
        return False
    return True


def plain(message: Wire) -> dict[str, Any]:
    value = unpack(encode(message))
    assert isinstance(value, dict)
    return value


def fault_of(payload: bytes, expected: type[Wire]) -> DecodeFault:
    with pytest.raises(DecodeError) as caught:
        decode(payload, expected)
    return caught.value.fault


@every_message
def test_no_truncation_decodes(message: Wire) -> None:
    payload = encode(message)
    assert not any(survives(payload[:cut], type(message)) for cut in range(len(payload)))


@every_message
def test_nothing_may_follow_a_message(message: Wire) -> None:
    payload = encode(message)
    assert not any(survives(payload + bytes([byte]), type(message)) for byte in range(256))


@every_message
def test_mutated_frames_decode_or_are_refused(message: Wire) -> None:
    random, payload = Random(type_name(message)), encode(message)
    decoded = []
    for _ in range(FRAMES):
        mutant = bytearray(payload)
        for _ in range(random.randint(1, 6)):
            at = random.randrange(len(mutant))
            edit = random.randrange(4)
            if edit == 0:
                mutant[at] ^= 1 << random.randrange(8)
            elif edit == 1:
                mutant[at] = random.randrange(256)
            elif edit == 2:
                del mutant[at : at + random.randint(1, 8)]
                mutant = mutant or bytearray(b"\x80")
            else:
                mutant[at:at] = random.randbytes(random.randint(1, 8))
        decoded.append(survives(bytes(mutant), type(message)))
    assert (len(decoded), all(decoded)) == (FRAMES, False)


def test_random_frames_are_refused() -> None:
    random = Random(1)
    expected = [type(message) for message in FULL]
    for number in range(FRAMES):
        payload = random.randbytes(random.randint(0, 4096))
        assert not survives(payload, expected[number % len(expected)])


WRONG: dict[str, Any] = {
    "nothing": None,
    "bool": True,
    "int": 7,
    "negative": -1,
    "huge": 2**64 - 1,
    "least": -(2**63),
    "float": 0.5,
    "nan": float("nan"),
    "infinity": float("inf"),
    "minus infinity": float("-inf"),
    "text": "??",
    "empty text": "",
    "long text": "A" * 40_000,
    "bytes": b"?",
    "empty bytes": b"",
    "list": [[]],
    "map": {"?": {}},
}


@every_message
def test_a_value_of_another_kind_is_refused_in_every_field_or_reads_back_the_same(message: Wire) -> None:
    """What is let through must be a value that the field may hold: it encodes to what was sent."""
    for field, honest in plain(message).items():
        for wrong in WRONG.values():
            forged = plain(message) | {field: wrong}
            if not survives(pack(forged), type(message)):
                continue
            read = plain(decode(pack(forged), type(message)))[field]
            assert read == (float(wrong) if isinstance(honest, float) and wrong is not None else wrong)
            number = isinstance(wrong, float) and isinstance(honest, float)
            optional = wrong is None
            assert number or optional or _may_be(type(wrong), honest), (field, wrong)


def _may_be(kind: type, honest: object) -> bool:
    """An int may stand for a float; otherwise a let-through value is of the honest value's own type."""
    return kind is type(honest) or (kind is int and isinstance(honest, float))


@every_message
def test_no_number_of_a_message_is_nan_or_infinite(message: Wire) -> None:
    for field, honest in plain(message).items():
        if isinstance(honest, float):
            for number in ("nan", "inf", "-inf"):
                payload = pack(plain(message) | {field: float(number)})
                assert fault_of(payload, type(message)) is DecodeFault.NOT_THE_SCHEMA
        if isinstance(honest, list) and honest and isinstance(honest[0], float):
            payload = pack(plain(message) | {field: [*honest, float("nan")]})
            assert fault_of(payload, type(message)) is DecodeFault.NOT_THE_SCHEMA


@every_message
def test_an_unknown_field_is_refused(message: Wire) -> None:
    payload = pack(plain(message) | {"colour": "red"})
    assert fault_of(payload, type(message)) is DecodeFault.NOT_THE_SCHEMA


@every_message
def test_a_missing_field_is_refused_unless_it_has_a_default(message: Wire) -> None:
    fields = msgspec.structs.fields(type(message))
    defaults = {field.name for field in fields if not field.required} - {"schema"}
    for field in plain(message):
        payload = pack({key: value for key, value in plain(message).items() if key != field})
        assert survives(payload, type(message)) is (field in defaults)


@every_message
@pytest.mark.parametrize("schema", [0, 2, "1", None, 1.5, True])
def test_another_schema_is_refused(message: Wire, schema: object) -> None:
    assert fault_of(pack(plain(message) | {"schema": schema}), type(message)) is DecodeFault.NOT_THE_SCHEMA


@every_message
def test_a_message_of_another_type_is_refused(message: Wire) -> None:
    for other in FULL:
        assert survives(encode(message), type(other)) is (type(other) is type(message))


def test_a_key_that_stands_twice_is_refused_wherever_it_stands() -> None:
    outer = encode(LABEL)
    assert outer[0] == 0xDE, "more than 15 fields: a map 16"
    pairs = int.from_bytes(outer[1:3], "big")
    twice = b"\xde" + (pairs + 1).to_bytes(2, "big") + outer[3:] + pack("epoch") + pack(1)
    assert fault_of(twice, Answer) is DecodeFault.NOT_MSGPACK
    value = plain(LABEL)
    posterior = b"\x82" + 2 * (pack("UP") + pack(0.5))
    inner = bytes([0xDE]) + len(value).to_bytes(2, "big")
    for key, each in value.items():
        inner += pack(key) + (posterior if key == "posterior" else pack(each))
    assert fault_of(inner, Answer) is DecodeFault.NOT_MSGPACK


@pytest.mark.parametrize(
    "payload",
    [
        pytest.param(b"", id="nothing"),
        pytest.param(b"\xc1", id="the byte that msgpack never uses"),
        pytest.param(b"\xc7\x01\x05x", id="an extension"),
        pytest.param(b"\xdf\xff\xff\xff\xff", id="a map that lies about its length"),
        pytest.param(b"\xdd\xff\xff\xff\xff", id="a list that lies about its length"),
        pytest.param(b"\xdb\xff\xff\xff\xffabc", id="a text that lies about its length"),
        pytest.param(b"\xc6\xff\xff\xff\xffabc", id="bytes that lie about their length"),
        pytest.param(b"\x81\xa1\xff\x01", id="a key that is not UTF-8"),
        pytest.param(b"\x81\xa1a\xa2\xc3\x28", id="a text that is not UTF-8"),
        pytest.param(b"\x81\xa1a\xa3\xed\xa0\x80", id="a lone surrogate"),
        pytest.param(b"\x81\xa1a\xa2\xc0\x80", id="an overlong zero"),
        pytest.param(b"\x81\x01\x01", id="a key that is a number"),
        pytest.param(b"\x81\xc0\x01", id="a key that is nothing"),
        pytest.param(b"\x81\x90\x01", id="a key that is a list"),
    ],
)
def test_bytes_that_are_no_msgpack_of_ours_are_named_so(payload: bytes) -> None:
    assert fault_of(payload, Join) is DecodeFault.NOT_MSGPACK


def test_a_timestamp_is_no_value_of_a_message() -> None:
    timestamp = b"\xd6\xff\x00\x00\x00\x00"
    assert not survives(timestamp, Join)
    assert not survives(b"\x84" + encode(Join(session="s1", teacher="ann"))[1:] + timestamp, Join)
    value = plain(LABEL)
    assert not survives(b"\x81" + pack("token") + timestamp, Answer)
    assert value["token"] is None


@pytest.mark.parametrize("depth", [100, 1000, 60_000])
@pytest.mark.parametrize("nest", [b"\x91", b"\x81\xa1a"])
def test_nesting_is_refused_at_any_depth(depth: int, nest: bytes) -> None:
    assert not survives((nest * depth)[:PAYLOAD_MAX], Join)


def test_a_payload_beyond_the_limit_is_refused_unread() -> None:
    assert fault_of(bytes(PAYLOAD_MAX + 1), Join) is DecodeFault.TOO_LONG
    assert fault_of(bytes(PAYLOAD_MAX), Join) is DecodeFault.NOT_MSGPACK


@pytest.mark.parametrize(
    "name",
    [
        "",
        "A",
        "ann\n",
        "\nann",
        " ann",
        "a/b",
        "a*",
        "**",
        "$*",
        "@",
        "a@b",
        "-a",
        "_a",
        "é",
        "a" * 49,
        "a\0",
    ],
)
def test_names_that_may_not_stand_in_a_key_may_not_stand_in_a_message(name: str) -> None:
    assert not survives(pack(plain(LABEL) | {"teacher": name}), Answer)
    assert not survives(pack(plain(LABEL) | {"session": name}), Answer)


@pytest.mark.parametrize("action", ["", "up", "UP\n", "U P", "1UP", "_UP", "A" * 33, "ÜP", 2])
def test_an_action_is_a_name_in_capitals(action: object) -> None:
    assert not survives(pack(plain(LABEL) | {"action": action}), Answer)


def test_text_is_never_read_as_bytes() -> None:
    assert not survives(pack(plain(LABEL) | {"state": "AAAA"}), Answer)
    assert not survives(pack(plain(LABEL) | {"answer_id": "AAECAwQFBgcICQoLDA0ODw=="}), Answer)


@pytest.mark.parametrize("length", [0, 8, 15, 17, 32])
def test_an_answer_id_has_sixteen_bytes(length: int) -> None:
    assert not survives(pack(plain(LABEL) | {"answer_id": bytes(length)}), Answer)


@pytest.mark.parametrize("number", [-1, 2**53, 2**63, 2**64 - 1])
def test_a_count_is_an_integer_that_every_language_holds(number: int) -> None:
    assert not survives(pack(plain(LABEL) | {"decision": number}), Answer)
    assert survives(pack(plain(LABEL) | {"decision": 2**53 - 1}), Answer)


@pytest.mark.parametrize("reward, allowed", [(-1.0, True), (1, True), (-0.0, True), (1.0000001, False)])
def test_a_reward_lies_between_minus_one_and_one(reward: float, allowed: bool) -> None:  # noqa: FBT001
    assert survives(pack(plain(LABEL) | {"reward": reward}), Answer) is allowed


def test_decode_reads_one_of_several_expected_types() -> None:
    expected: Any = Answer | Join
    join = Join(session="s1", teacher="ann")
    assert decode(encode(join), expected) == join
    assert decode(encode(LABEL), expected) == LABEL


def test_text_for_a_log_line_is_short_and_printable() -> None:
    assert printable("a\nb\x1b]52;c\x07é") == "a?b?]52;c?é"
    assert len(printable("x" * 1000)) == 200


def test_the_payload_of_an_answer_and_its_acknowledgement_are_small() -> None:
    """A crowd of a thousand at one answer a second stays below 0.5 MB/s."""
    acknowledgement = Acknowledgement(
        answer_id=ANSWER_ID, code="accepted", check=bytes(8), epoch=1, journal_seq=2**40
    )
    assert len(encode(LABEL)) <= 256
    assert len(encode(acknowledgement)) <= 128


def test_the_largest_decision_fits_into_a_payload() -> None:
    names = tuple(f"{number:048d}" for number in range(64))
    (decision,) = (message for message in FULL if isinstance(message, Decision))
    largest = msgspec.structs.replace(decision, view="#" * 32_768, teachers=names)
    assert decode(encode(largest), Decision) == largest
