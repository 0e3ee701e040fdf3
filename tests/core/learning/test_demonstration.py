"""Cloning, DAgger and labels as commands: who drives, and what the counts come to."""

import pytest

from sfid_core.learning.kernels import Evidence, Learned
from sfid_core.teaching.answers import Answer, AnswerKind
from sfid_core.teaching.merge import merge
from tests.core.learning.pupil import DOWN, LEFT, RIGHT, S0, S1, UP, Pupil, labels

SAID_UP = merge(labels(UP), 4, 0.0)


def driven(pupil: Pupil, decisions: int = 200) -> int:
    """Return how often the teacher's UP is taken where the agent would go LEFT."""
    taken = [pupil.settle(S0, LEFT, SAID_UP, decision) for decision in range(decisions)]
    assert set(taken) <= {UP, LEFT}
    return taken.count(UP)


@pytest.mark.parametrize("method", ["clone", "dagger", "guide"])
def test_in_silence_the_agent_goes_its_own_way(method: str) -> None:
    assert Pupil(method).settle(S0, LEFT, Evidence(), 0) == LEFT


def test_the_clone_counts_labels_while_the_teacher_drives() -> None:
    """Errors: belief in the action taken less its share. UP: 1 - 1/4; UP: 1 - 1/1; LEFT said UP: 0 - 0.

    Then the counts are UP 3; a belief of (0.5, 0, 0.5, 0): LEFT taken, 0.5 - 0/3; counts LEFT 0.5, UP 3.5.
    """
    pupil = Pupil("clone", demonstrations=1)
    assert pupil.do(S0, UP, 0.0, labels(UP), S1) == Learned(0.75, 0.75, 1.0)
    assert pupil.do(S0, UP, 0.0, labels(UP), S1) == Learned(0.0, 0.0, 1.0)
    assert pupil.do(S0, LEFT, 0.0, labels(UP), S1) == Learned(0.0, 0.0, -1.0)
    halves = Answer(AnswerKind.LABEL, action=UP, posterior=(0.5, 0.0, 0.5, 0.0))
    assert pupil.do(S0, LEFT, 0.0, [halves], S1) == Learned(0.5, 0.5, 0.0)
    assert pupil.do(S0, LEFT, 0.0, (), S1) == Learned(0.0, 0.0, 0.0)
    assert pupil.rounded(S0) == [0.5, 0, 3.5, 0]
    assert {pupil.choose(S0, decision) for decision in range(50)} == {UP}


def test_after_the_demonstrations_the_clone_drives_and_learns_no_more() -> None:
    pupil = Pupil("clone", demonstrations=2)
    pupil.begin(1)
    assert driven(pupil) == 200
    pupil.do(S0, UP, 0.0, labels(UP), S1)
    pupil.begin(2)
    assert driven(pupil) == 0
    assert pupil.do(S0, DOWN, 0.0, labels(DOWN), S1) == Learned(1.0, 1.0, 1.0)
    assert pupil.rounded(S0) == [0, 0, 1, 0]


def test_in_dagger_the_teacher_drives_ever_less_and_every_label_counts() -> None:
    """Linear over 4 rounds: beta = 1, 3/4, .., 0."""
    pupil = Pupil("dagger", rounds=4)
    assert driven(pupil) == 200
    pupil.begin(1)
    assert driven(pupil, 4000) == pytest.approx(3000, abs=150)
    pupil.begin(4)
    assert driven(pupil) == 0
    pupil.do(S0, RIGHT, 0.0, labels(DOWN), S1)
    pupil.do(S0, RIGHT, 0.0, labels(DOWN), S1)
    assert pupil.do(S0, RIGHT, 0.0, labels(RIGHT), S1) == Learned(1.0, 1.0, 1.0)
    assert pupil.rounded(S0) == [0, 1, 0, 2]


def test_beta_may_fall_by_a_factor() -> None:
    pupil = Pupil("dagger", schedule="power", base=0.5)
    assert driven(pupil) == 200
    pupil.begin(1)
    pupil.begin(2)
    assert driven(pupil, 4000) == pytest.approx(1000, abs=150)


def test_a_command_is_taken_and_rewarded() -> None:
    """alpha 0.5, gamma 0.5: label UP, UP taken, r = 0, to s1: Eq. 4: 0 + 1 = 1.  Q(s0, UP) = 0.5

    Silence, UP, r = 1, to s1: Eq. 4: 1 - 0.5 = 0.5.  Q(s0, UP) = 0.75
    """
    pupil = Pupil("guide", alpha=0.5, gamma=0.5)
    assert driven(pupil) == 200
    assert pupil.do(S0, UP, 0.0, labels(UP), S1) == Learned(0.0, 1.0, 1.0)
    assert pupil.do(S0, UP, 1.0, (), S1) == Learned(0.5, 0.5, 0.0)
    assert pupil.rounded(S0) == [0, 0, 0.75, 0]
