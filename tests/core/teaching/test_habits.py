"""Habits of simulated teachers, each measured over many keyed draws against its stated rate."""

import math
from collections.abc import Sequence

import pytest

from sfid_core.learning.parameters import ParameterError, Value, as_written, parameters_of
from sfid_core.teaching.kernels import TeacherParameters
from sfid_core.teaching.personas import PERSONAS, persona_named
from sfid_core.teaching.simulated import SimulatedTeacher

DECISIONS = range(20_000)
STATE = bytes(range(16))


def teacher(**given: Value) -> SimulatedTeacher:
    return SimulatedTeacher(1, "ann", "lab", parameters_of(TeacherParameters, given, "teacher"))


def share(flags: Sequence[bool]) -> float:
    return sum(flags) / len(flags)


def judged(one: SimulatedTeacher, action: int) -> dict[float | None, float]:
    """Return the shares of praise, blame and silence for an action where 2 is the optimal one."""
    given = [one.reward(decision, STATE, action, (2,)) for decision in DECISIONS]
    return {value: share([each == value for each in given]) for value in (1.0, -1.0, None)}


def test_praise_and_blame_are_spared_at_their_own_rates() -> None:
    """mu+ = 0.2, mu- = 0.7, error 0.1: p(+|right) = 0.9 * 0.8, p(-|right) = 0.1 * 0.3, and so on."""
    one = teacher(silence_right=0.2, silence_wrong=0.7, reward_error=0.1)
    right, wrong = judged(one, 2), judged(one, 0)
    assert right == pytest.approx({1.0: 0.72, -1.0: 0.03, None: 0.25}, abs=0.012)
    assert wrong == pytest.approx({1.0: 0.08, -1.0: 0.27, None: 0.65}, abs=0.012)


def test_a_soft_teacher_turns_a_share_of_blame_into_praise() -> None:
    soft = teacher(soften=0.3)
    assert judged(soft, 0) == pytest.approx({1.0: 0.3, -1.0: 0.7, None: 0.0}, abs=0.012)
    assert judged(soft, 2)[1.0] == 1.0


def test_who_praises_what_they_would_do_blames_the_other_optimal_action() -> None:
    strict, open_minded = teacher(praises="preferred"), teacher()
    favourite = strict.label(0, STATE, (1, 3))
    other = 4 - (favourite or 0)
    assert [strict.reward(0, STATE, action, (1, 3)) for action in (favourite or 0, other)] == [1.0, -1.0]
    assert [open_minded.reward(0, STATE, action, (1, 3)) for action in (1, 3, 0)] == [1.0, 1.0, -1.0]


def test_praise_for_the_same_thing_diminishes_and_blame_does_not() -> None:
    """With n0 = 2 the k-th praise (from 0) is given with probability 1 / (1 + k / 2)."""
    first, fifth = [], []
    for seed in range(4000):
        one = SimulatedTeacher(seed, "ann", "lab", TeacherParameters(diminishing=2.0))
        praise = [one.reward(decision, STATE, 2, (2,)) for decision in range(5)]
        first.append(praise[0] == 1.0)
        fifth.append(praise[4] == 1.0)
        assert one.reward(5, STATE, 0, (2,)) == -1.0
    assert share(first) == 1.0
    assert share(fifth) == pytest.approx(1 / 3, abs=0.03)


def test_praise_diminishes_by_state_and_action() -> None:
    one = SimulatedTeacher(1, "ann", "lab", TeacherParameters(diminishing=1e-9))
    other = bytes(reversed(STATE))
    asked = [(STATE, 2), (STATE, 2), (other, 2), (other, 2), (STATE, 3)]
    given = [one.reward(decision, state, action, (2, 3)) for decision, (state, action) in enumerate(asked)]
    assert given == [1.0, None, 1.0, None, 1.0]


def test_a_tired_teacher_answers_ever_less() -> None:
    """After n answers the next is given with probability exp(-n / 50)."""
    given = []
    for seed in range(3000):
        tired = SimulatedTeacher(seed, "ann", "lab", TeacherParameters(fatigue=50.0))
        tired._memory.scalars[0] = 25.0  # noqa: SLF001 - 25 answers given, without giving them
        given.append(tired.label(0, STATE, (2,)) is not None)
    assert share(given) == pytest.approx(math.exp(-0.5), abs=0.025)
    fresh = teacher(fatigue=50.0)
    assert fresh.label(0, STATE, (2,)) == 2


def test_a_drift_changes_the_favourites_and_swaps_the_silences() -> None:
    drifting = teacher(drift_after=100, silence_right=0.0, silence_wrong=1.0)
    before = [drifting.reward(decision, STATE, action, (2,)) for decision in (0, 99) for action in (2, 0)]
    after = [drifting.reward(decision, STATE, action, (2,)) for decision in (100, 500) for action in (2, 0)]
    assert before == [1.0, None, 1.0, None]
    assert after == [None, -1.0, None, -1.0]
    states = [number.to_bytes(16, "big") for number in range(400)]
    kept = [drifting.label(0, state, (1, 3)) == drifting.label(100, state, (1, 3)) for state in states]
    assert share(kept) == pytest.approx(0.5, abs=0.1)


def test_delays_have_their_stated_form() -> None:
    uniform = [
        teacher(delay="uniform", delay_min_ms=500, delay_max_ms=2000).delay_ms(decision)
        for decision in range(4000)
    ]
    assert min(uniform) >= 500
    assert max(uniform) <= 2000
    assert sum(uniform) / len(uniform) == pytest.approx(1250, rel=0.02)
    gamma = [teacher(delay="gamma").delay_ms(decision) for decision in range(8000)]
    mean = sum(gamma) / len(gamma)
    variance = sum((one - mean) ** 2 for one in gamma) / len(gamma)
    assert mean == pytest.approx(560, rel=0.03)
    assert variance == pytest.approx(2 * 280**2, rel=0.08)
    assert {teacher().delay_ms(decision) for decision in range(10)} == {0.0}


def test_every_persona_is_known_by_name_and_can_be_changed() -> None:
    assert {name: persona_named(name) for name in PERSONAS} == {
        name: persona.parameters for name, persona in PERSONAS.items()
    }
    changed = as_written(persona_named("naive", {"silence": 0.5, "praises": "optimal"}))
    own = as_written(persona_named("naive"))
    assert changed == own | {"silence": 0.5, "praises": "optimal"}
    with pytest.raises(ParameterError, match=r"^unknown teacher 'guru': choose one of [^\n]*expert"):
        persona_named("guru")
    with pytest.raises(ParameterError, match=r"^silence 2 is outside"):
        persona_named("naive", {"silence": 2})
