"""An experiment's results as tables: every episode, every seed, the curves, and the claims."""

from collections.abc import Mapping, Sequence

import numpy as np

from services.exports.columns import CLAIM, DIFFERENCE_HI, DIFFERENCE_LO, EPISODE, MEASURE, METHOD
from services.exports.table import Column, ExportError, Kind, Table, Values
from sfid_core.experiments.claims import Claim
from sfid_core.experiments.summary import Arm, ArmSummary, Measure

_TEACHER = Column("teacher", Kind.TEXT, "Simulated teacher.")
_SEEDS = Column("seeds", Kind.WHOLE, "Number of seeds.")
_SEED = Column("seed", Kind.WHOLE, "Seed of the run; arms with the same seed are paired.")

MEASURES = {
    Measure.ABS_TD_ERROR: Column(
        "abs_td_error",
        Kind.NUMBER,
        "Mean over the episode's steps of |r + gamma max Q(s', .) - Q(s, a)|, the error without the teacher.",
        "reward",
    ),
    Measure.ABS_TD_ERROR_SHAPED: Column(
        "abs_td_error_shaped",
        Kind.NUMBER,
        "Mean over the episode's steps of the absolute error that was learnt from, the teacher's h included.",
        "reward",
    ),
    Measure.STEPS: Column("steps", Kind.WHOLE, "Actions executed in the episode.", "steps"),
    Measure.DISCOUNTED_RETURN: Column(
        "discounted_return", Kind.NUMBER, "Sum over the episode's steps t of gamma^t (r + h).", "reward"
    ),
    Measure.DISCOUNTED_ENV_RETURN: Column(
        "discounted_env_return", Kind.NUMBER, "Sum over the episode's steps t of gamma^t r.", "reward"
    ),
    Measure.INPUTS: Column("inputs", Kind.WHOLE, "Answers of the teacher applied in the episode.", "answers"),
    Measure.SOLVED: Column("solved", Kind.TRUTH, "Whether the episode ended with the level solved."),
}

TOTALS = {
    "abs_td_error_sum": Column(
        "abs_td_error_sum",
        Kind.NUMBER,
        "Sum over an episode's steps of the error without the teacher, in the mean over the episodes.",
        "reward",
    ),
    "inputs_total": Column("inputs_total", Kind.WHOLE, "Answers applied in the whole run.", "answers"),
    "teaching_time_s": Column(
        "teaching_time_s", Kind.NUMBER, "Simulated time that the teacher spent on the whole run.", "s"
    ),
    "labels_to_agreement": Column(
        "labels_to_agreement",
        Kind.WHOLE,
        "Answers given before the agent acted as the teacher prefers; all of them where it never did.",
        "answers",
    ),
    "episodes_to_agreement": Column(
        "episodes_to_agreement",
        Kind.WHOLE,
        "Episodes before the agent acted as the teacher prefers; all of them where it never did.",
        "episodes",
    ),
    "agreed": Column("agreed", Kind.TRUTH, "Whether the agent came to act as the teacher prefers."),
    "agreement": Column(
        "agreement",
        Kind.NUMBER,
        "Share of the last episode's steps on which the agent's action was one that the teacher prefers.",
    ),
    "success": Column(
        "success", Kind.NUMBER, "Share of start states from which the greedy agent solves the level."
    ),
}


def episode_table(arms: Sequence[Arm], seeds: Sequence[int]) -> Table:
    """Return one row an arm, seed and episode, with every measure that all arms have.

    Args: seeds: the runs' seeds in the order of the arms' rows.  Raises: ExportError.
    """
    shapes = {table.shape for arm in arms for table in arm.measures.values()}
    if len(shapes) != 1 or {shape[0] for shape in shapes} != {len(seeds)}:
        raise ExportError(
            f"results of shape {sorted(shapes)} and {len(seeds)} seeds give no table of episodes"
        )
    n_seeds, n_episodes = shapes.pop()
    shared = [measure for measure in MEASURES if all(measure in arm.measures for arm in arms)]
    cells: dict[str, Values] = {
        "method": _repeated([arm.method for arm in arms], n_seeds * n_episodes),
        "teacher": _repeated([arm.teacher for arm in arms], n_seeds * n_episodes),
        "seed": np.tile(np.repeat(np.asarray(seeds, dtype=np.int64), n_episodes), len(arms)),
        "episode": np.tile(np.arange(n_episodes), n_seeds * len(arms)),
    }
    for measure in shared:
        cells[measure.value] = np.concatenate([arm.measures[measure].reshape(-1) for arm in arms])
    columns = (METHOD, _TEACHER, _SEED, EPISODE, *(MEASURES[measure] for measure in shared))
    return Table("episodes", "Each row is one episode of one run.", columns, cells)


def seed_table(
    arms: Sequence[Arm], seeds: Sequence[int], explained: Mapping[str, Column] | None = None
) -> Table:
    """Return one row an arm and seed, with every total that all arms have.

    Args: seeds: as in `episode_table`; explained: columns of totals that `TOTALS` does not explain.
    Raises: ExportError where a total is explained nowhere.
    """
    known = TOTALS | dict(explained or {})
    names = [name for name in arms[0].totals if all(name in arm.totals for arm in arms)] if arms else []
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ExportError(f"total {unknown[0]} has no entry for the codebook: explain it as a Column")
    cells: dict[str, Values] = {
        "method": _repeated([arm.method for arm in arms], len(seeds)),
        "teacher": _repeated([arm.teacher for arm in arms], len(seeds)),
        "seed": np.tile(np.asarray(seeds, dtype=np.int64), len(arms)),
    }
    for name in names:
        cells[name] = np.concatenate([arm.totals[name] for arm in arms])
    columns = (METHOD, _TEACHER, _SEED, *(known[name] for name in names))
    return Table("seeds", "Each row is one run.", columns, cells)


def curve_table(summaries: Sequence[ArmSummary]) -> Table:
    """Return one row an arm, measure and episode: the mean over seeds with its interval."""
    columns = (
        METHOD,
        _TEACHER,
        MEASURE,
        EPISODE,
        Column("mean", Kind.NUMBER, "Mean over the seeds.", "that of the measure"),
        Column("lo", Kind.NUMBER, "Lower end of the mean's interval.", "that of the measure"),
        Column("hi", Kind.NUMBER, "Upper end of the mean's interval.", "that of the measure"),
        _SEEDS,
    )
    rows = [
        (arm.method, arm.teacher, measure.value, episode, mean, lo, hi, arm.n_seeds)
        for arm in summaries
        for measure, means in arm.means.items()
        for episode, (mean, (lo, hi)) in enumerate(
            zip(means.tolist(), arm.intervals[measure].tolist(), strict=True)
        )
    ]
    return Table.of_rows("curves", "Each row is one measure of one episode over all seeds.", columns, rows)


def claim_table(claims: Sequence[Claim]) -> Table:
    """Return one row a claim."""
    columns = (
        CLAIM,
        Column("holds", Kind.TRUTH, "Whether its interval supports it; otherwise it is not shown."),
        Column(
            "difference",
            Kind.NUMBER,
            "Mean over seeds of the paired difference.",
        ),
        DIFFERENCE_LO,
        DIFFERENCE_HI,
        Column("level", Kind.NUMBER, "Coverage of the interval: 0.9 for two one-sided tests at 5 %."),
        Column("margin", Kind.NUMBER, "Largest difference that counts as equivalent."),
        Column("cohen_dz", Kind.NUMBER, "Mean of the paired differences over their standard deviation."),
        Column("superiority", Kind.NUMBER, "Share of seeds in which the first arm is larger, ties half."),
        _SEEDS,
        Column("unit", Kind.TEXT, "Unit of difference, lo, hi and margin; empty for a number without one."),
    )
    rows = [
        (
            *(claim.claim, claim.holds, claim.difference, claim.ci.lo, claim.ci.hi, claim.level),
            *(claim.margin, claim.cohen_dz, claim.superiority, claim.n_seeds, claim.unit or None),
        )
        for claim in claims
    ]
    return Table.of_rows("claims", "Each row is one claim.", columns, rows)


def _repeated(texts: Sequence[str], times: int) -> list[str]:
    return [text for text in texts for _ in range(times)]
