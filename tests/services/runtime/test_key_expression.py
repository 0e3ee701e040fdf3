"""Which keys a key expression stands for; the expected values are those of Zenoh 1.10."""

import pytest

from services.runtime.key_expression import KeyIndex, matches

KEYS = ["a", "a/b", "a/@b", "@a", "a/b/c", "ab/c", "abc", "b/a", "a/@b/c", "a/ab"]


@pytest.mark.parametrize(
    "key_expression,matched",
    [
        ("a/b", ["a/b"]),
        ("*", ["a", "abc"]),
        ("**", ["a", "a/b", "a/b/c", "ab/c", "abc", "b/a", "a/ab"]),
        ("a/**", ["a", "a/b", "a/b/c", "a/ab"]),
        ("*/b", ["a/b"]),
        ("a/*", ["a/b", "a/ab"]),
        ("**/c", ["a/b/c", "ab/c"]),
        ("a/**/c", ["a/b/c"]),
        ("**/b/**", ["a/b", "a/b/c", "b/a"]),
        ("a$*", ["a", "abc"]),
        ("$*c", ["abc"]),
        ("a/$*b", ["a/b", "a/ab"]),
        ("a$*c", ["abc"]),
        ("@a", ["@a"]),
        ("a/@b", ["a/@b"]),
        ("**/@b", ["a/@b"]),
        ("**/@b/**", ["a/@b", "a/@b/c"]),
    ],
)
def test_a_key_expression_matches_as_zenoh_does(key_expression: str, matched: list[str]) -> None:
    assert [key for key in KEYS if matches(key_expression, key)] == matched


def test_letters_that_regular_expressions_know_are_plain_letters_in_keys() -> None:
    keys = ["a.b", "axb", "a+b", "(a)", "a\\b"]
    assert [[other for other in keys if matches(key, other)] for key in keys] == [[key] for key in keys]


@pytest.mark.parametrize("key_expression", ["a/b", "*", "**", "a/*", "a/**", "**/c", "a$*", "a/@b", "@a"])
def test_an_index_knows_the_keys_that_its_expressions_stand_for(key_expression: str) -> None:
    index = KeyIndex()
    assert not any(key in index for key in KEYS)
    index.add("x/y")
    index.add(key_expression)
    index.add(key_expression)
    index.remove(key_expression)
    assert [key for key in KEYS if key in index] == [key for key in KEYS if matches(key_expression, key)]
    index.remove(key_expression)
    assert not any(key in index for key in KEYS)
    assert "x/y" in index
    with pytest.raises(ValueError, match="not in list"):
        index.remove(key_expression)
