"""What the founding paper says of its Figure 2, as claims with intervals.

Source: Raza, Johnston & Williams 2016. The paper says it in words and gives no numbers; "equal" is read as
equivalent within a tenth of reward shaping's mean, "better" as a difference whose interval excludes 0.
"""

from collections.abc import Mapping, Sequence

from sfid_core.experiments.claims import Claim, Direction, differs, is_equivalent, is_extreme
from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.intervals import Resampling
from sfid_core.experiments.summary import FOUNDING_MEASURES, Arm, Measure

LABELS, REWARD = "sfid", "reward"
EXPERT, NAIVE = "expert", "naive"
TIME = "teaching_time_s"
ABS_TD_ERROR_SUM = "abs_td_error_sum"
"""Total: the |TD error| summed over an episode's steps, in the mean over episodes. The mean over steps alone
flatters an agent that seldom reaches the goal: where nothing is reached, nothing surprises."""

WORDS = {
    Measure.ABS_TD_ERROR: "|TD error|",
    Measure.STEPS: "steps",
    Measure.DISCOUNTED_RETURN: "discounted return",
    Measure.INPUTS: "inputs",
}
UNITS = {
    Measure.ABS_TD_ERROR: "of reward, mean of a step",
    Measure.STEPS: "steps an episode",
    Measure.DISCOUNTED_RETURN: "of reward an episode",
    Measure.INPUTS: "inputs an episode",
}
_SUM_UNIT = "of reward, summed over an episode"
_WORSE = {
    Measure.ABS_TD_ERROR: Direction.MORE,
    Measure.STEPS: Direction.MORE,
    Measure.DISCOUNTED_RETURN: Direction.LESS,
    Measure.INPUTS: Direction.MORE,
}


def founding_claims(
    arms: Sequence[Arm], resampling: Resampling, margin_share: float = 0.1
) -> tuple[Claim, ...]:
    """Return the paper's claims on four arms: sfid and reward, each with the teachers expert and naive.

    Each claim is on the mean over a seed's episodes. Where all four arms have the total `teaching_time_s`,
    the paper's word on it is claimed too: equal with the expert, less with the naive teacher. The paper does
    not say whether its |TD error| is a mean over steps or a sum: with the total `abs_td_error_sum` both are
    claimed.
    Raises: ExperimentError where an arm is missing.
    """
    by_name = {(arm.method, arm.teacher): arm for arm in arms}
    wanted = [(method, teacher) for teacher in (EXPERT, NAIVE) for method in (LABELS, REWARD)]
    missing = [", ".join(name) for name in wanted if name not in by_name]
    if missing:
        raise ExperimentError(f"the paper's claims need the arm {missing[0]}: add it to the experiment")
    four = {name: by_name[name] for name in wanted}
    claims: tuple[Claim, ...] = (
        *_equal(four, margin_share),
        *_better(four, resampling),
        *_worst(four, resampling),
    )
    if all(ABS_TD_ERROR_SUM in arm.totals for arm in four.values()):
        claims = (*claims, *_summed(four, resampling, margin_share))
    if all(TIME in arm.totals for arm in four.values()):
        claims = (*claims, *_time(four, resampling, margin_share))
    return claims


def _equal(four: Mapping[tuple[str, str], Arm], margin_share: float) -> list[Claim]:
    labels, reward = four[LABELS, EXPERT], four[REWARD, EXPERT]
    return [
        is_equivalent(
            f"with the expert, sfid and reward are equivalent in {WORDS[measure]}",
            labels.per_seed(measure),
            reward.per_seed(measure),
            margin_share,
        ).measured_in(UNITS[measure])
        for measure in FOUNDING_MEASURES
    ]


def _better(four: Mapping[tuple[str, str], Arm], resampling: Resampling) -> list[Claim]:
    labels, reward = four[LABELS, NAIVE], four[REWARD, NAIVE]
    return [
        differs(
            f"with the naive teacher, sfid needs fewer {WORDS[measure]} than reward",
            labels.per_seed(measure),
            reward.per_seed(measure),
            Direction.LESS,
            resampling,
        ).measured_in(UNITS[measure])
        for measure in (Measure.STEPS, Measure.INPUTS)
    ]


def _worst(four: Mapping[tuple[str, str], Arm], resampling: Resampling) -> list[Claim]:
    worst = four[REWARD, NAIVE]
    others = {name: arm for name, arm in four.items() if name != (REWARD, NAIVE)}
    return [
        is_extreme(
            f"reward with the naive teacher is the worst of the four in {WORDS[measure]}",
            worst.per_seed(measure),
            {arm.name: arm.per_seed(measure) for arm in others.values()},
            direction,
            resampling,
        ).measured_in(UNITS[measure])
        for measure, direction in _WORSE.items()
    ]


def _summed(four: Mapping[tuple[str, str], Arm], resampling: Resampling, margin_share: float) -> list[Claim]:
    sums = {name: arm.totals[ABS_TD_ERROR_SUM] for name, arm in four.items()}
    others = {", ".join(name): column for name, column in sums.items() if name != (REWARD, NAIVE)}
    return [
        is_equivalent(
            "with the expert, sfid and reward are equivalent in |TD error| summed over an episode",
            sums[LABELS, EXPERT],
            sums[REWARD, EXPERT],
            margin_share,
        ).measured_in(_SUM_UNIT),
        is_extreme(
            "reward with the naive teacher is the worst of the four in |TD error| summed over an episode",
            sums[REWARD, NAIVE],
            others,
            Direction.MORE,
            resampling,
        ).measured_in(_SUM_UNIT),
    ]


def _time(four: Mapping[tuple[str, str], Arm], resampling: Resampling, margin_share: float) -> list[Claim]:
    times = {name: arm.totals[TIME] for name, arm in four.items()}
    return [
        is_equivalent(
            "with the expert, sfid and reward are equivalent in teaching time",
            times[LABELS, EXPERT],
            times[REWARD, EXPERT],
            margin_share,
        ).measured_in("s"),
        differs(
            "with the naive teacher, sfid needs less teaching time than reward",
            times[LABELS, NAIVE],
            times[REWARD, NAIVE],
            Direction.LESS,
            resampling,
        ).measured_in("s"),
    ]
