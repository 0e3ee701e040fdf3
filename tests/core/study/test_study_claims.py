"""What a study shows: intervals over people that cover, and no claim where there are too few of them."""

import numpy as np
import pytest

from sfid_core.experiments.intervals import Resampling, mean_interval
from sfid_core.experiments.summary import Measure
from sfid_core.outcome import Outcome
from sfid_core.session.measures import EpisodeMeasures
from sfid_core.study.assignment import order_of
from sfid_core.study.claims import claims_of, difference_claim, independent_interval
from sfid_core.study.definition import Study
from sfid_core.study.errors import StudyError
from sfid_core.study.findings import find
from sfid_core.study.flow import Standing
from sfid_core.study.results import Participant, Taught
from tests.core.study.studies import study, within

HOW = Resampling(seed=3)


def people(count: int, mean: float, first: int = 0) -> dict[str, float]:
    chance = np.random.default_rng(first)
    return {f"p{first + number}": mean + float(chance.normal()) for number in range(count)}


def test_a_plain_difference_between_many_people_is_shown_and_none_is_not() -> None:
    columns = {"a": people(20, 5.0), "b": people(20, 9.0, 100), "c": people(20, 5.0, 200)}
    shown = difference_claim("steps", ("a", "b"), columns, HOW, paired=False)
    assert (shown.holds, shown.verdict, shown.people) == (True, "shown", (20, 20))
    assert shown.difference == pytest.approx(-4.0, abs=1.0)
    assert shown.ci is not None
    assert shown.ci.below(0)
    assert shown.line().startswith("shown: a and b differ in steps: ")
    equal = difference_claim("steps", ("a", "c"), columns, HOW, paired=False)
    assert (equal.holds, equal.verdict) == (False, "not shown")


def test_below_ten_people_nothing_is_claimed_however_large_the_difference() -> None:
    columns = {"a": people(9, 0.0), "b": people(40, 100.0, 100)}
    claim = difference_claim("steps", ("a", "b"), columns, HOW, paired=False)
    assert (claim.holds, claim.verdict) == (False, "too few people to say")
    assert claim.ci is not None
    assert claim.ci.below(-90)
    assert claim.document()["verdict"] == "too few people to say"


@pytest.mark.parametrize("few", [0, 1])
def test_one_person_or_nobody_has_no_interval_and_the_line_says_how_many(few: int) -> None:
    columns = {"a": people(few, 0.0), "b": people(12, 1.0, 100)}
    claim = difference_claim("steps", ("a", "b"), columns, HOW, paired=False)
    assert (claim.ci, claim.difference, claim.means) == (None, None, None)
    assert claim.line() == f"too few people to say: a and b differ in steps ({few} and 12 people)"


def test_people_who_met_both_are_compared_with_themselves_and_those_who_missed_one_are_left_out() -> None:
    base = people(12, 50.0)
    columns = {"a": base, "b": {who: value + 0.1 for who, value in base.items()} | {"alone": 50.0}}
    paired = difference_claim("steps", ("a", "b"), columns, HOW, paired=True)
    assert paired.people == (12, 12)
    assert paired.difference == pytest.approx(-0.1)
    assert paired.holds
    apart = difference_claim("steps", ("a", "b"), columns, HOW, paired=False)
    assert (apart.people, apart.holds) == ((12, 13), False)


def test_the_interval_of_two_groups_covers_the_truth_as_often_as_it_says() -> None:
    chance = np.random.default_rng(0)
    quick = Resampling(seed=1, resamples=400)
    covered = 0
    for _ in range(400):
        a, b = chance.normal(3, 1, 12), chance.normal(1, 2, 12)
        interval = independent_interval(a, b, quick)
        covered += interval.lo <= 2 <= interval.hi
    assert 0.92 <= covered / 400 <= 0.99


def test_groups_of_different_people_are_not_resampled_in_pairs() -> None:
    chance = np.random.default_rng(0)
    a = chance.normal(0, 1, 30)
    interval = independent_interval(a, a, HOW)
    alone = mean_interval(a, HOW)
    assert interval.hi - interval.lo == pytest.approx(np.sqrt(2) * (alone.hi - alone.lo), rel=0.1)
    with pytest.raises(StudyError, match="groups of 1 and 30 people"):
        independent_interval(a[:1], a, HOW)


def test_the_more_is_asked_of_the_same_people_the_wider_each_interval() -> None:
    columns = {"a": people(20, 5.0), "b": people(20, 6.0, 100)}
    (one,) = claims_of(["a", "b"], {"steps": columns}, HOW, paired=False)
    five = claims_of(["a", "b"], dict.fromkeys("vwxyz", columns), HOW, paired=False)
    assert one.ci is not None
    assert all(claim.ci is not None and claim.ci.lo < one.ci.lo and claim.ci.hi > one.ci.hi for claim in five)
    assert one.level == 0.95
    assert five[0].level == pytest.approx(0.99)


# ---------------------------------------------------------------- from people to findings


def taught(steps: int, *, is_whole: bool = True) -> Taught:
    episodes = tuple(
        EpisodeMeasures(number, steps - number, 2, 0.5, 0.4, 1.0, 0.9, steps, 3, Outcome.SOLVED)
        for number in range(2)
    )
    return Taught(episodes, 10.0 * steps, 2 * steps, is_whole)


def participant(of: Study, number: int, steps: dict[str, int], **changes: object) -> Participant:
    order = tuple(of.conditions[place].name for place in order_of(of, number))
    lessons = {period: taught(steps[name]) for period, name in enumerate(order, 1)}
    ratings = {period: (steps[name] * 5,) * 6 for period, name in enumerate(order, 1)}
    fields: dict[str, object] = {"lessons": lessons, "ratings": ratings, "standing": Standing.COMPLETED}
    return Participant(
        pseudonym=f"p-{number}", number=number, at=6, conditions=order, consent=("1", "x"), code="c",
        began_s=0.0, seconds=60.0, **(fields | changes),  # type: ignore[arg-type]
    )  # fmt: skip


def test_people_become_the_arms_of_the_figure_and_their_effort_is_told_by_condition() -> None:
    of = study()
    found = find(of, [participant(of, number, {"labels": 4, "rewards": 8}) for number in range(24)], HOW)
    assert found.people == {"labels": 12, "rewards": 12}
    assert [(arm.method, arm.teacher, arm.n_seeds) for arm in found.summaries] == [
        ("sfid", "people", 12), ("reward", "people", 12),
    ]  # fmt: skip
    assert found.summaries[0].means[Measure.STEPS].tolist() == [4.0, 3.0]
    assert [(one.condition, one.people, one.means[-1]) for one in found.effort] == [
        ("labels", 12, 20.0), ("rewards", 12, 40.0),
    ]  # fmt: skip
    verdicts = {claim.what: claim.verdict for claim in found.claims}
    assert verdicts == {
        "steps an episode": "shown", "answers an episode": "shown", "|TD error|": "not shown",
        "discounted return": "not shown", "teaching time (s)": "shown", "effort (raw score)": "shown",
    }  # fmt: skip


def test_unfinished_lessons_and_lonely_people_are_in_no_curve() -> None:
    of = study()
    cut = {1: taught(4, is_whole=False)}
    crowd = [participant(of, number, {"labels": 4, "rewards": 8}) for number in range(3)]
    crowd += [
        participant(of, number, {"labels": 4, "rewards": 8}, lessons=cut, ratings={}) for number in (3, 4, 5)
    ]
    found = find(of, crowd, HOW)
    assert sum(found.people.values()) == 3
    assert len(found.summaries) == 1
    assert {claim.verdict for claim in found.claims} == {"too few people to say"}
    assert find(of, [], HOW).summaries == ()


def test_within_people_all_claims_are_paired() -> None:
    of = within(3)
    steps = {"labels": 4, "rewards": 8, "more-2": 4}
    found = find(of, [participant(of, number, steps) for number in range(12)], HOW)
    assert found.people == {"labels": 12, "rewards": 12, "more-2": 12}
    assert all(claim.paired for claim in found.claims)
    assert [arm.teacher for arm in found.summaries] == ["labels", "people", "more-2"]
