"""The tables of an experiment: every number of every arm is found again under its own name."""

import time

import numpy as np
import pytest

from services.exports.csv_file import csv_bytes
from services.exports.experiment_tables import claim_table, curve_table, episode_table, seed_table
from services.exports.parquet_file import parquet_bytes
from services.exports.table import Column, ExportError, Kind
from sfid_core.experiments.claims import Claim
from sfid_core.experiments.intervals import Floats, Interval, Resampling
from sfid_core.experiments.summary import Arm, Measure, summarise


def arm(method: str, offset: float, **totals: list[float]) -> Arm:
    """Two seeds, three episodes; steps count up from the offset."""
    steps = np.arange(6, dtype=np.float64).reshape(2, 3) + offset
    solved = np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0]])
    tables = {Measure.STEPS: steps, Measure.ABS_TD_ERROR: steps / 8, Measure.SOLVED: solved}
    return Arm(method, "expert", tables, {name: np.array(column) for name, column in totals.items()})


def test_the_table_of_episodes_has_one_row_an_arm_seed_and_episode() -> None:
    table = episode_table([arm("sfid", 10), arm("reward", 20)], seeds=[7, 9])
    assert csv_bytes(table).decode().splitlines() == [
        "method,teacher,seed,episode,abs_td_error,steps,solved",
        "sfid,expert,7,0,1.25,10,false",
        "sfid,expert,7,1,1.375,11,true",
        "sfid,expert,7,2,1.5,12,true",
        "sfid,expert,9,0,1.625,13,true",
        "sfid,expert,9,1,1.75,14,false",
        "sfid,expert,9,2,1.875,15,true",
        "reward,expert,7,0,2.5,20,false",
        "reward,expert,7,1,2.625,21,true",
        "reward,expert,7,2,2.75,22,true",
        "reward,expert,9,0,2.875,23,true",
        "reward,expert,9,1,3.0,24,false",
        "reward,expert,9,2,3.125,25,true",
    ]


def test_the_table_of_seeds_has_the_totals() -> None:
    arms = [
        arm("sfid", 10, inputs_total=[4, 5], teaching_time_s=[1.5, 2]),
        arm("reward", 20, inputs_total=[6, 7], teaching_time_s=[3, 4]),
    ]
    assert csv_bytes(seed_table(arms, [7, 9])).decode().splitlines() == [
        "method,teacher,seed,inputs_total,teaching_time_s",
        "sfid,expert,7,4,1.5",
        "sfid,expert,9,5,2.0",
        "reward,expert,7,6,3.0",
        "reward,expert,9,7,4.0",
    ]


def test_a_total_that_nobody_explains_is_refused_and_an_explained_one_is_not() -> None:
    arms = [arm("sfid", 10, laughs=[1, 2])]
    with pytest.raises(ExportError, match="total laughs has no entry for the codebook"):
        seed_table(arms, [7, 9])
    laughs = Column("laughs", Kind.WHOLE, "Laughs heard.", "laughs")
    assert seed_table(arms, [7, 9], {"laughs": laughs}).columns[-1] == laughs


def test_the_table_of_curves_has_means_and_intervals() -> None:
    summaries = summarise([arm("sfid", 10)], Resampling())
    table = curve_table(summaries)
    assert table.n_rows == 9
    lines = csv_bytes(table).decode().splitlines()
    lo, hi = summaries[0].intervals[Measure.STEPS][1].tolist()
    assert lines[0] == "method,teacher,measure,episode,mean,lo,hi,seeds"
    assert lines[2] == f"sfid,expert,steps,1,12.5,{lo!r},{hi!r},2"


def test_the_table_of_claims_leaves_cells_empty_that_say_nothing() -> None:
    shown = Claim("fewer, by far", holds=True, difference=-2.5, ci=Interval(-3, -2), n_seeds=20, unit="steps")
    equal = Claim("equal", holds=False, difference=0.5, ci=Interval(-1, 2), level=0.9, n_seeds=20, margin=1)
    assert csv_bytes(claim_table([shown, equal])).decode().splitlines() == [
        "claim,holds,difference,lo,hi,level,margin,cohen_dz,superiority,seeds,unit",
        '"fewer, by far",true,-2.5,-3.0,-2.0,0.95,,,,20,steps',
        "equal,false,0.5,-1.0,2.0,0.9,1.0,,,20,",
    ]


def test_results_of_different_shapes_give_no_table_of_episodes() -> None:
    with pytest.raises(ExportError, match="and 3 seeds give no table of episodes"):
        episode_table([arm("sfid", 10)], seeds=[1, 2, 3])
    with pytest.raises(ExportError, match="give no table of episodes"):
        episode_table([], seeds=[])


def test_a_thousand_seeds_are_written_within_seconds() -> None:
    """4 arms x 1,000 seeds x 30 episodes, all measures: 120,000 rows."""
    values = np.random.default_rng(1)
    whole = {Measure.STEPS, Measure.INPUTS}

    def column(measure: Measure) -> Floats:
        if measure is Measure.SOLVED:
            return values.integers(0, 2, size=(1000, 30)).astype(np.float64)
        drawn = values.gamma(9, size=(1000, 30))
        return np.rint(drawn) if measure in whole else drawn

    arms = [Arm(name, "expert", {measure: column(measure) for measure in Measure}) for name in "abcd"]
    begin = time.perf_counter()
    table = episode_table(arms, range(1000))
    assert len(csv_bytes(table).splitlines()) == 120_001
    assert len(parquet_bytes(table)) > 1_000_000
    assert time.perf_counter() - begin < 10
