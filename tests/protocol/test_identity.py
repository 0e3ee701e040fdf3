"""Tokens: what they say, and everything that is not accepted as one."""

import hashlib
import random
import string
from collections import Counter

import pytest
from itsdangerous import Signer
from itsdangerous.encoding import base64_encode

from protocol.codec import pack
from protocol.identity import (
    TOKEN_CHARACTERS_MAX,
    Identity,
    Role,
    TokenError,
    TokenFault,
    is_token_id,
    sign,
    verify,
)

SECRET, OTHER = b"s" * 32, b"o" * 32
NOW_S = 1_000.0
ANN = Identity(role=Role.TEACHER, session="s1", pseudonym="ann", expires_s=2_000, token_id="a" * 16)
CLASS = Identity(role=Role.INVITATION, session="s1", expires_s=2_000, token_id="b" * 16, people=30)
SPELLING = string.ascii_letters + string.digits + "-_"


def fault(token: str, now_s: float = NOW_S, revoked: tuple[str, ...] = ()) -> TokenFault | None:
    try:
        verify(token, [SECRET], now_s, revoked)
    except TokenError as error:
        return error.fault
    return None


@pytest.mark.parametrize("identity", [ANN, CLASS])
def test_a_token_says_what_was_signed(identity: Identity) -> None:
    token = sign(identity, [SECRET])
    assert verify(token, [SECRET], NOW_S, ()) == identity
    assert len(token) <= TOKEN_CHARACTERS_MAX


def test_the_longest_names_make_a_token_that_is_short_enough() -> None:
    longest = Identity(
        role=Role.INVITATION, session="s" * 48, expires_s=2**53 - 1, token_id="a" * 16, people=100_000
    )
    person = Identity(
        role=Role.TEACHER, session="s" * 48, pseudonym="p" * 48, expires_s=2**53 - 1,
        token_id="a" * 16, invitation="b" * 16,
    )  # fmt: skip
    for identity in (longest, person):
        token = sign(identity, [SECRET])
        assert len(token) <= TOKEN_CHARACTERS_MAX
        assert verify(token, [SECRET], NOW_S, ()) == identity


def test_a_token_is_good_until_the_second_it_expires() -> None:
    token = sign(ANN, [SECRET])
    assert [fault(token, now_s) for now_s in (0.0, 1_999.9, 2_000.0, 1e12)] == [
        None, None, TokenFault.EXPIRED, TokenFault.EXPIRED,
    ]  # fmt: skip


def test_revoking_an_invitation_revokes_what_was_given_for_it() -> None:
    given = Identity(
        role=Role.TEACHER, session="s1", pseudonym="p-1", expires_s=2_000,
        token_id="c" * 16, invitation=CLASS.token_id,
    )  # fmt: skip
    tokens = [sign(identity, [SECRET]) for identity in (ANN, CLASS, given)]
    assert [fault(token, revoked=(CLASS.token_id,)) for token in tokens] == [
        None, TokenFault.REVOKED, TokenFault.REVOKED,
    ]  # fmt: skip
    assert fault(tokens[2], revoked=("c" * 16,)) is TokenFault.REVOKED
    assert fault(tokens[0], revoked=("",)) is None


def test_a_new_secret_signs_while_the_old_one_still_verifies() -> None:
    old, new = sign(ANN, [SECRET]), sign(ANN, [SECRET, OTHER])
    assert verify(old, [SECRET, OTHER], NOW_S, ()) == ANN
    assert verify(new, [OTHER], NOW_S, ()) == ANN
    assert fault(new) is TokenFault.FORGED


@pytest.mark.parametrize("secrets", [[], [b"short"], [SECRET, b""]])
def test_a_short_secret_is_no_secret(secrets: list[bytes]) -> None:
    with pytest.raises(ValueError, match="32 bytes"):
        sign(ANN, secrets)


def test_of_100_000_altered_and_guessed_tokens_none_is_accepted() -> None:
    chance = random.Random(4)
    token = sign(ANN, [SECRET])
    found: Counter[TokenFault | None] = Counter()
    for number in range(100_000):
        attempt = (_changed, _cut, _swapped, _signed_by_another, _guessed)[number % 5](token, chance)
        found[fault(attempt) if attempt != token else TokenFault.FORGED] += 1
    assert found[None] == 0
    assert found.total() == 100_000


def test_a_refusal_does_not_repeat_the_token() -> None:
    token = sign(ANN, [OTHER])
    with pytest.raises(TokenError) as refused:
        verify(token, [SECRET], NOW_S, ())
    assert str(refused.value) == "forged-token"


def test_every_single_character_of_a_token_matters() -> None:
    token = sign(ANN, [SECRET])
    for place, character in enumerate(token):
        for other in SPELLING + "=.+/ \n":
            if other != character:
                assert fault(token[:place] + other + token[place + 1 :]) is not None
    for more in ("=", ".", "A", " ", "\n"):
        assert fault(token + more) is not None
        assert fault(more + token) is not None


@pytest.mark.parametrize(
    "token", ["", ".", "..", "a.b.c", "\x00", "ä.b", "a" * 600, "." * 600, "null", '{"role":"teacher"}']
)
def test_what_is_no_token_is_refused_as_such(token: str) -> None:
    assert fault(token) in {TokenFault.MALFORMED, TokenFault.FORGED}


@pytest.mark.parametrize(
    "body",
    [
        [],
        [2, "teacher", "s1", "ann", 2_000, "a" * 16, "", 0],
        [1, "operator", "s1", "ann", 2_000, "a" * 16, "", 0],
        [1, "teacher", "s1", "", 2_000, "a" * 16, "", 0],
        [1, "invitation", "s1", "ann", 2_000, "a" * 16, "", 5],
        [1, "teacher", "s1/../s2", "ann", 2_000, "a" * 16, "", 0],
        [1, "teacher", "s1", "ann\n", 2_000, "a" * 16, "", 0],
        [1, "teacher", "s1", "ann", -1, "a" * 16, "", 0],
        [1, "teacher", "s1", "ann", 2_000, "short", "", 0],
        {"role": "teacher"},
        7,
    ],
)
def test_signed_content_of_another_kind_is_refused(body: object) -> None:
    # Only the holder of the secret can make these: an older or newer program, or a mistake of ours.
    signer = Signer(
        SECRET, salt=b"sfid.identity.1", sep=".", key_derivation="hmac", digest_method=hashlib.sha256
    )
    token = signer.sign(base64_encode(pack(body))).decode()
    assert fault(token) is TokenFault.MALFORMED


def test_an_id_has_sixteen_hexadecimal_digits() -> None:
    assert [is_token_id(text) for text in ("0123456789abcdef", "0123", "g" * 16, "a" * 16 + "\n")] == [
        True, False, False, False,
    ]  # fmt: skip


def _changed(token: str, chance: random.Random) -> str:
    place = chance.randrange(len(token))
    return token[:place] + chance.choice(SPELLING) + token[place + 1 :]


def _cut(token: str, chance: random.Random) -> str:
    return token[: chance.randrange(len(token))]


def _swapped(token: str, chance: random.Random) -> str:
    one, other = sorted(chance.sample(range(len(token)), 2))
    return token[:one] + token[other] + token[one + 1 : other] + token[one] + token[other + 1 :]


def _signed_by_another(_token: str, chance: random.Random) -> str:
    return sign(ANN, [chance.randbytes(32)])


def _guessed(token: str, chance: random.Random) -> str:
    body = token.partition(".")[0]
    return f"{body}.{''.join(chance.choices(SPELLING, k=43))}"
