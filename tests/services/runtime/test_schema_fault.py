"""Faults of a file as a person reads them: never a type in backticks, never a path with a dollar."""

from typing import Any

import msgspec
import pytest

from protocol.messages import CreateSession
from services.runtime.schema_fault import in_words
from services.study.definition_file import _File

WHOLE: dict[str, Any] = {
    "name": "maze",
    "consent": {"version": "1", "text": "read this"},
    "conditions": [{"name": "labels", "method": "sfid"}],
}


@pytest.mark.parametrize(
    "changes, said",
    [
        ({"people": "many"}, "people: text in quotes where a whole number belongs: change it"),
        ({"people": 0}, "people: give a whole number >= 1"),
        ({"days": False}, "days: true or false where a number belongs: change it"),
        ({"days": 0}, "days: give a number > 0.0"),
        ({"effort": 1}, "effort: a whole number where true or false belongs: change it"),
        ({"title": "x" * 121}, "title: give text in quotes of length <= 120"),
        ({"name": "A"}, "name: give text in quotes like '^[a-z0-9][a-z0-9_-]{0,23}$'"),
        ({"practice": 3}, "practice: a whole number where a table belongs: change it"),
        ({"page": {"url": 3}}, "page, url: a whole number where text in quotes belongs: change it"),
        ({"wurst": 1}, "unknown key wurst: correct its name, or take it out"),
        ({"consent": {"version": "1"}}, "consent: the key text is missing: add it"),
        ({"conditions": 3}, "conditions: a whole number where a list belongs: change it"),
        (
            {"conditions": [{"name": "a", "method": "sfid"}, {"name": 1, "method": "sfid"}]},
            "conditions 2, name: a whole number where text in quotes belongs: change it",
        ),
        (
            {"conditions": [{"name": "a", "method": "sfid", "parameters": {"alpha": [1]}}]},
            "conditions 1, parameters: a list where a number or text in quotes belongs: change it",
        ),
    ],
)
def test_every_kind_of_fault_is_told_with_its_place_and_mend(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(msgspec.ValidationError) as caught:
        msgspec.convert(WHOLE | changes, _File)
    assert in_words(str(caught.value)) == said


def test_a_fault_at_the_top_and_one_that_is_not_known_are_told_as_well() -> None:
    with pytest.raises(msgspec.ValidationError) as caught:
        msgspec.convert(3, CreateSession)
    assert in_words(str(caught.value)) == "the file: a whole number where a table belongs: change it"
    assert in_words("Input is odd - at `$.a.b`") == "a, b: Input is odd"
    assert in_words("Input is odd") == "Input is odd"
