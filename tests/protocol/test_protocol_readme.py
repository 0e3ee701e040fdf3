"""The contract in words says what the types say."""

import re

import msgspec

from protocol.codec import decode, encode
from protocol.keys import Keys
from protocol.messages import Acknowledgement, Answer, Refusal
from tests.protocol.make_readme_tables import MEANINGS, README, filled, types
from tests.protocol.samples import LABEL

TEXT = README.read_text(encoding="utf-8")


def test_the_tables_and_the_example_are_those_of_the_types() -> None:
    assert filled(TEXT) == TEXT, "run: python -m tests.protocol.make_readme_tables"


def test_every_field_has_a_meaning_and_every_meaning_a_field() -> None:
    fields = {(each.__name__, field.name) for each in types() for field in msgspec.structs.fields(each)}
    by_name = {field for _, field in fields}
    own = {f"{each}.{field}" for each, field in fields}
    assert set(MEANINGS) <= by_name | own
    assert all(field in MEANINGS or f"{each}.{field}" in MEANINGS for each, field in fields)


def test_the_keys_are_those_of_the_code() -> None:
    keys = Keys("d")
    made = {
        keys.decision("<session>"),
        keys.measures("<session>"),
        keys.join("<session>", "<teacher>"),
        keys.answer("<session>", "<teacher>"),
        keys.control("<session>", "<teacher>"),
        keys.present("<session>", "<teacher>") + "[/<run>]",
        keys.crowd("<session>", "<aggregator>"),
        *(keys.learner(verb) for verb in ("create", "branch", "list", "show", "rows")),
        *(keys.environment(verb) for verb in ("begin", "execute")),
        keys.service("<role>", "<name>"),
    }
    listed = re.findall(r"^\| `((?:session|learner|environment|service)/[^`]+)` \|", TEXT, re.MULTILINE)
    assert {f"{keys.root}/{key}" for key in listed} == made


def test_every_code_is_explained() -> None:
    for each in (Acknowledgement, Refusal):
        info = msgspec.inspect.type_info(each)
        assert isinstance(info, msgspec.inspect.StructType)
        codes = next(field.type for field in info.fields if field.name == "code")
        assert isinstance(codes, msgspec.inspect.LiteralType)
        assert all(f"\n| `{code}` |" in TEXT for code in codes.values)


def test_the_bytes_of_the_example_are_the_answer_it_speaks_of() -> None:
    block = TEXT.split("```")[1]
    payload = b"".join(
        bytes.fromhex(found[0])
        for line in block.splitlines()
        if (found := re.match(r"[0-9a-f]{2}(?: {1,2}[0-9a-f]{2})*(?= |$)", line))
    )
    assert payload == encode(LABEL)
    assert decode(payload, Answer) == LABEL
