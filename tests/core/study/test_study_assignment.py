"""Who gets which condition: balanced at any time, in every order equally often, by the seed alone."""

from collections import Counter
from dataclasses import replace
from hashlib import sha256
from itertools import pairwise

import pytest

from sfid_core.study.assignment import latin_square, order_of, orders, world_seed
from sfid_core.study.definition import Recruiter
from sfid_core.study.effort import SCALES, raw_score
from sfid_core.study.errors import NotNow, StudyError
from tests.core.study.studies import CONSENT, LABELS, study, within


@pytest.mark.parametrize("conditions", [1, 2, 3, 4, 8])
def test_at_any_time_no_condition_is_ahead_of_another_by_more_than_one(conditions: int) -> None:
    of = study(conditions)
    counts: Counter[int] = Counter(dict.fromkeys(range(conditions), 0))
    for number in range(60):
        counts[order_of(of, number)[0]] += 1
        assert max(counts.values()) - min(counts.values()) <= 1


def test_the_seed_and_nothing_else_says_the_assignment() -> None:
    first = [order_of(study(seed=1), number) for number in range(40)]
    assert first == [order_of(study(seed=1), number) for number in reversed(range(40))][::-1]
    assert first != [order_of(study(seed=2), number) for number in range(40)]
    assert first != [order_of(study(seed=1, name="other"), number) for number in range(40)]
    assert set(first[::2]) == {(0,), (1,)}  # not simply in turn


def test_the_first_of_a_block_is_each_condition_about_equally_often() -> None:
    firsts = Counter(order_of(study(4), 4 * block)[0] for block in range(2000))
    assert all(abs(count - 500) < 80 for count in firsts.values())


def test_the_latin_square_of_four_is_that_of_williams() -> None:
    assert latin_square(1) == ((0,),)
    assert latin_square(2) == ((0, 1), (1, 0))
    assert latin_square(4) == ((0, 1, 3, 2), (1, 2, 0, 3), (2, 3, 1, 0), (3, 0, 2, 1))


@pytest.mark.parametrize("count", range(2, 9))
def test_each_condition_stands_in_each_place_and_follows_each_other_equally_often(count: int) -> None:
    rows = latin_square(count)
    assert len(rows) == count * (1 if count % 2 == 0 else 2)
    for place in range(count):
        assert set(Counter(row[place] for row in rows).values()) == {len(rows) // count}
    follows = Counter(pair for row in rows for pair in pairwise(row))
    assert len(follows) == count * (count - 1)
    assert len(set(follows.values())) == 1


@pytest.mark.parametrize("conditions", [2, 3, 4])
def test_within_people_each_block_holds_every_order_of_the_square_once(conditions: int) -> None:
    of = within(conditions)
    size = len(orders(of))
    for block in range(5):
        found = [order_of(of, block * size + place) for place in range(size)]
        assert sorted(found) == sorted(latin_square(conditions))


def test_people_of_a_block_meet_the_same_worlds_and_those_of_the_next_others() -> None:
    of = study(3)
    assert len({world_seed(of, number, 1) for number in range(3)}) == 1
    assert len({world_seed(of, number, period) for number in (0, 3, 6) for period in (0, 1)}) == 6
    assert all(0 <= world_seed(of, number, 1) < 2**53 for number in range(100))


def test_the_raw_score_is_the_mean_of_the_six() -> None:
    assert raw_score((60, 5, 40, 20, 55, 0)) == 30.0
    assert [scale.name for scale in SCALES] == [
        "mental", "physical", "temporal", "performance", "effort", "frustration",
    ]  # fmt: skip
    with pytest.raises(NotNow, match="Effort 52 is not on its scale"):
        raw_score((50, 50, 50, 50, 52, 50))


def test_studies_that_make_no_sense_are_refused_with_the_mend() -> None:
    with pytest.raises(StudyError, match="0 conditions: give 1 to 8"):
        study(conditions=0)
    with pytest.raises(StudyError, match="each a name of its own"):
        replace(study(), conditions=(LABELS, LABELS))
    with pytest.raises(StudyError, match="give the completion_code that Prolific shows"):
        study(recruiter=Recruiter.PROLIFIC)
    with pytest.raises(StudyError, match="number -1"):
        order_of(study(), -1)


def test_the_digest_of_the_consent_is_that_of_its_text() -> None:
    assert CONSENT.sha256 == sha256(CONSENT.text.encode()).hexdigest()
