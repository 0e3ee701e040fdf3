"""Keys: what may be part of one, and back from a key to the session and the teacher."""

import pytest

from protocol.keys import KeyNameError, Keys, checked, router_key

REFUSED = [
    "",
    "*",
    "**",
    "$*",
    "a*",
    "a$*b",
    "@",
    "@admin",
    "a@b",
    "a/b",
    "/a",
    "a/",
    "a//b",
    "A",
    "-a",
    "_a",
    "a b",
    "a\n",
    "a\x00",
    "a?b",
    "a#b",
    "é",
    "а",  # noqa: RUF001 - the Cyrillic letter is the case
    "ａ",  # noqa: RUF001 - the full-width letter is the case
    "a" * 49,
    "a" * 10_240,
    "..",
    ".",
    "%2f",
]
KEYS = Keys("lab-2")
TEACHER_KEYS = [KEYS.join, KEYS.answer, KEYS.control]


@pytest.mark.parametrize("name", REFUSED)
def test_a_name_that_cannot_be_part_of_a_key_is_refused_in_one_line_with_the_mend(name: str) -> None:
    with pytest.raises(KeyNameError) as caught:
        checked(name, "teacher")
    text = str(caught.value)
    assert text.startswith("teacher name ")
    assert text.endswith("use 1 to 48 of a-z, 0-9, - and _, beginning with a letter or digit")
    assert "\n" not in text
    assert len(text) < 250
    with pytest.raises(KeyNameError):
        Keys(name)


@pytest.mark.parametrize("name", ["a", "0", "ann", "s-1_b", "9" * 48])
def test_a_name_of_lower_case_letters_digits_and_dashes_is_allowed(name: str) -> None:
    assert checked(name, "session") == name


@pytest.mark.parametrize("key_of", TEACHER_KEYS, ids=lambda key_of: key_of.__name__)
def test_session_and_teacher_come_back_from_every_key_that_names_them(key_of: object) -> None:
    assert callable(key_of)
    assert KEYS.session_and_teacher(key_of("s1", "ann")) == ("s1", "ann")


@pytest.mark.parametrize(
    "key",
    [
        "",
        "s1",
        KEYS.decision("s1"),
        KEYS.measures("s1"),
        KEYS.learner("create"),
        KEYS.environment("begin"),
        KEYS.present("s1", "ann"),
        KEYS.service("learner", "shard-0"),
        KEYS.answer("s1", "*"),
        KEYS.answer("*", "ann"),
        KEYS.answer("s1", "ann") + "/more",
        KEYS.answer("S1", "ann"),
        KEYS.answer("s1", ""),
        Keys("other").answer("s1", "ann"),
        "x/" + KEYS.answer("s1", "ann"),
    ],
)
def test_any_other_key_names_no_session_and_teacher(key: str) -> None:
    with pytest.raises(KeyNameError):
        KEYS.session_and_teacher(key)


@pytest.mark.parametrize("run", ["", "8f0a51c2"])
def test_who_is_present_comes_back_from_their_token(run: str) -> None:
    assert KEYS.presence(KEYS.present("s1", "ann", run)) == ("s1", "ann", run)


@pytest.mark.parametrize(
    "key",
    [
        KEYS.answer("s1", "ann"),
        KEYS.present("s1", "ann", "Run"),
        KEYS.present("s1", "ann", "a" * 49),
        KEYS.present("s1", "ann", "1/2"),
        KEYS.present("s1", "ann") + "/",
        KEYS.present("s1", "Ann"),
        KEYS.present("S1", "ann", "1"),
        KEYS.presences(),
        Keys("other").present("s1", "ann"),
    ],
)
def test_any_other_key_is_nobodys_token(key: str) -> None:
    with pytest.raises(KeyNameError):
        KEYS.presence(key)


def test_the_keys_of_a_deployment() -> None:
    root = "sfid/v1/lab-2"
    assert [
        KEYS.decision("s1"),
        KEYS.measures("s1"),
        KEYS.join("s1", "ann"),
        KEYS.answer("s1", "ann"),
        KEYS.control("s1", "ann"),
        KEYS.present("s1", "ann"),
        KEYS.present("s1", "ann", "8f0a51c2"),
        KEYS.learner("create"),
        KEYS.environment("begin"),
        KEYS.service("learner", "shard-0"),
    ] == [
        f"{root}/session/s1/decision",
        f"{root}/session/s1/measures",
        f"{root}/session/s1/join/ann",
        f"{root}/session/s1/answer/ann",
        f"{root}/session/s1/control/ann",
        f"{root}/session/s1/present/ann",
        f"{root}/session/s1/present/ann/8f0a51c2",
        f"{root}/learner/create",
        f"{root}/environment/begin",
        f"{root}/service/learner/shard-0",
    ]


def test_without_names_a_key_matches_all_sessions_and_teachers() -> None:
    assert KEYS.answer() == "sfid/v1/lab-2/session/*/answer/*"
    assert KEYS.decision() == "sfid/v1/lab-2/session/*/decision"
    assert KEYS.service() == "sfid/v1/lab-2/service/*/*"
    assert KEYS.presences() == "sfid/v1/lab-2/session/*/present/*/**"


def test_two_deployments_share_no_key() -> None:
    assert Keys("lab-1").answer("s1", "ann") != Keys("lab-2").answer("s1", "ann")


def test_routers_answer_each_other_outside_every_deployment() -> None:
    assert router_key() == "sfid/router/*"
    assert router_key("1f") == "sfid/router/1f"
    assert not router_key().startswith("sfid/v1/")
