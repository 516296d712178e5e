"""Runs become a table."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from replication import published, table2
from replication.files import ROOT
from replication.records import add_noise, constant_speed
from tests.made import TRUE, make_record


def test_records_fitted_with_one_seed_are_fitted_as_each_alone():
    records = [make_record(), make_record(TRUE._replace(A=-0.3))]
    settings = replace(table2.NOTEBOOK, population=20, iterations=30)
    together = table2.fit_each(records, settings, 7)
    assert together == [table2.fit(record, settings, 7) for record in records]
    runs = table2.repeated_fits(
        [({"row": 1}, records[0]), ({"row": 2}, records[1])], settings, [7, 8]
    )
    assert runs["A_rps"].tolist()[::2] == [fit.X.A for fit in together]
    assert runs[["row", "seed"]].to_numpy().tolist() == [[1, 7], [1, 8], [2, 7], [2, 8]]


def test_a_basin_begins_where_misfits_jump_by_more_than_the_gap():
    labels = table2.basin_labels(np.array([0.2, 0.1, 0.10019, 0.10038, 0.1008, 0.2003]))
    np.testing.assert_array_equal(labels, [3, 1, 1, 1, 2, 3])


def test_runs_are_summarised_by_their_amplitudes_and_noise_keeps_its_sign():
    runs = pd.DataFrame(
        {
            "record": ["a"] * 3 + ["noise"] * 2,
            "theoretical_A_rps": [1.0] * 3 + [0.0] * 2,
            "A_rps": [0.9, -1.0, 1.4, 0.1, -0.1],
            "rmse_rps": [0.1, 0.1, 0.3, 0.1, 0.1],
        }
    )
    with_backlash, noise = table2.summarise_runs(runs, ["record"]).to_dict("records")
    expected = {"mean_A_rps": 1.1, "relative_error_percent": 10, "best_A_rps": 0.95}
    expected |= {"sd_A_rps": np.std([0.9, 1.0, 1.4], ddof=1), "best_basin_runs": 2}
    expected |= {"best_sd_A_rps": np.std([0.9, 1.0], ddof=1), "best_rmse_rps": 0.1}
    expected |= {"basins": 2, "runs": 3, "theoretical_A_rps": 1.0}
    assert {name: with_backlash[name] for name in expected} == pytest.approx(expected)
    assert noise["mean_A_rps"] == pytest.approx(0)


def test_table_2_is_made_of_ten_rows_for_each_realisation(monkeypatch):
    monkeypatch.setattr(table2, "load_noisy", lambda level, R: (level, R))
    keys, records = zip(*table2.table2_records(range(1, 6)), strict=True)
    assert records == tuple((level, R) for R in range(1, 6) for level in range(2, 12))
    kept = pd.read_csv(ROOT / "results" / "table2.csv")
    runs = pd.DataFrame(keys).assign(A_rps=-kept["mean_A_rps"], rmse_rps=0.1)
    made = table2.table2(runs)
    of_one_run = [*keys[0], "theoretical_A_rps", "mean_A_rps", "relative_error_percent"]
    pd.testing.assert_frame_equal(made[of_one_run], kept[of_one_run], rtol=1e-3)


def test_the_last_printed_sd_cannot_be_a_variance():
    noise, runs = published.value("table2.row11.noise"), published.value("text.runs")
    record = add_noise(constant_speed(), noise, np.random.default_rng(1))
    widest = table2.search_box(record, table2.NOTEBOOK).upper[0]  # of A, the wider of the two boxes
    assert 0.99 < widest / (table2.NOTEBOOK.amplitude_factor * noise) <= 1
    largest_sd = widest * np.sqrt(runs / (runs - 1))  # half of the runs at either end
    smallest = published.value("table2.row11.sd") - published.half_last_digit("0.0178")
    assert np.sqrt(smallest) > largest_sd
    assert smallest < 0.2 * largest_sd
    sds, effect = published.column("Table 2", "sd"), published.table("errata")["effect"]["E11"]
    assert f"{np.sqrt(sds.min()):.2f} to {np.sqrt(sds.max()):.2f} rps" in effect
    assert f"{np.sqrt(published.value('table2.row11.sd')):.3f} in row 11" in effect
    assert f"at most {widest:.2f} rps" in effect
