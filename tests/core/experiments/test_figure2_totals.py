"""What teaching cost in the founding paper's experiment, by hand."""

import numpy as np

from sfid_core.experiments.figure2 import totals
from sfid_core.experiments.lane_world import COLUMNS, MEASURES


def test_what_a_seed_cost_is_counted_over_all_its_episodes() -> None:
    results = np.zeros((2, 4, COLUMNS))
    columns: dict[str, list[list[float]]] = {
        "steps": [[10, 8, 6, 5], [4, 4, 4, 4]],
        "abs_td_error": [[0.5, 0.25, 0.5, 0.0], [1.0, 1.0, 1.0, 1.0]],
        "inputs": [[8, 8, 3, 5], [0, 0, 0, 0]],
        "preferred": [[0.5, 0.9, 1.0, 1.0], [0.1, 0.1, 0.1, 0.1]],
    }
    for name, rows in columns.items():
        results[:, :, MEASURES.index(name)] = rows
    found = totals(results)
    # The sum of |TD error| of an episode is its mean times its steps: (5 + 2 + 3 + 0) / 4 and 4.
    assert found["abs_td_error_sum"].tolist() == [2.5, 4.0]
    assert found["inputs_total"].tolist() == [24.0, 0.0]
    # 24 answers of 1.25 s and 5 windows of 2 s that nobody used; 16 windows.
    assert found["teaching_time_s"].tolist() == [40.0, 32.0]
