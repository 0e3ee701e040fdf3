"""What a learner tells of its table: states learnt about, and a digest of them alone."""

import struct
from hashlib import sha256

from tests.core.learning.pupil import LEFT, S0, S1, UP, Pupil, labels


def test_looking_at_a_state_teaches_nothing() -> None:
    pupil = Pupil("q-learning")
    assert pupil.values(S0) == (0.0, 0.0, 0.0, 0.0)
    pupil.choose(S1, 0)
    assert len(pupil) == 0
    assert pupil.sha256() == sha256().hexdigest()


def test_the_digest_is_over_keys_and_little_endian_float64_by_ascending_key() -> None:
    pupil = Pupil("q-learning", actions=2, alpha=1.0)
    pupil.do(b"bb", 0, 1.5)
    pupil.do(b"bb", 1, -2.0)
    pupil.do(b"aa", 1, 1e-300)
    expected = sha256(b"aa" + struct.pack("<2d", 0.0, 1e-300) + b"bb" + struct.pack("<2d", 1.5, -2.0))
    assert pupil.sha256() == expected.hexdigest()
    assert len(pupil) == 2


def test_the_digest_does_not_depend_on_the_order_of_learning_and_notices_the_last_bit() -> None:
    one, other = Pupil("q-learning", alpha=1.0), Pupil("q-learning", alpha=1.0)
    for pupil, states in ((one, (S0, S1)), (other, (S1, S0))):
        for state in states:
            pupil.do(state, 0, 1.0)
    assert one.sha256() == other.sha256()
    other.do(S0, 0, 1.0 + 2.0**-52)
    assert one.sha256() != other.sha256()


def test_the_digest_covers_every_block_of_a_state() -> None:
    """Label UP, LEFT taken, alpha 0.5: Q(s0, LEFT) = 0.5 * -1, then the agreement with each action."""
    pupil = Pupil("sfid-memory", alpha=0.5, policy="shaped")
    pupil.do(S0, LEFT, 0.0, labels(UP))
    expected = sha256(S0 + struct.pack("<8d", -0.5, 0.0, 0.0, 0.0, -1.0, -1.0, 1.0, -1.0))
    assert pupil.sha256() == expected.hexdigest()
