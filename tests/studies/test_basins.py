from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from replication.table2 import SearchSettings
from studies import basins
from studies.timings import plain_misfits
from studies.todays_cma import fit_with_todays_cma


def made_runs(seed, runs, rows=(1, 2, 3), shift=0.0):
    generator = np.random.default_rng(seed)
    A = generator.choice([0.5, 0.55], (len(rows), runs), p=[0.6, 0.4]) * (1 + shift)
    parts = [
        pd.DataFrame(
            {"row": row, "A_rps": a, "rmse_rps": np.where(a < 0.525 * (1 + shift), 0.05, 0.06)}
        )
        for row, a in zip(rows, A, strict=True)
    ]
    return pd.concat(parts, ignore_index=True)


def test_sets_of_one_search_lie_apart_by_no_more_than_chance_and_a_shifted_set_by_more():
    sets = {
        "first": made_runs(1, 30),
        "same": made_runs(2, 30),
        "shifted": made_runs(3, 30, shift=0.1),
    }
    table = basins.compare_searches(sets).set_index("search")
    assert np.isnan(table.loc["first", "shift_percent"])
    same, shifted = table.loc["same"], table.loc["shifted"]
    assert same["shift_low_percent"] < 0 < same["shift_high_percent"]
    assert same["chance_low_percent"] < same["apart_percent"] < same["chance_high_percent"]
    assert shifted["shift_low_percent"] < 10 < shifted["shift_high_percent"]
    assert shifted["shift_low_percent"] > 5
    assert shifted["apart_percent"] > shifted["chance_high_percent"]
    assert shifted["best_shift_percent"] == pytest.approx(10)
    assert (table["runs"] == 90).all()


def test_the_authors_loop_samples_like_the_fast_search(made_record):
    short = replace(SearchSettings(), population=20, iterations=3)
    fast = fit_with_todays_cma(made_record, short, seed=2).rmse
    slow = fit_with_todays_cma(made_record, short, 2, plain_misfits(made_record)).rmse
    assert slow == pytest.approx(fast, rel=1e-9)
