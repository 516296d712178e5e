"""The datasheet counts what it says it counts."""

import re

import numpy as np
import pandas as pd
import pytest

from replication.files import ROOT
from studies import datasheet


def rows(population: str) -> pd.DataFrame:
    """Of six joints: two answered, one covered, a false all-clear, a refusal; healthy ones called and cleared."""
    verdicts = ["backlash", "backlash", "no backlash", "cannot tell", "backlash", "no backlash"]
    return pd.DataFrame(
        {
            "population": population,
            "delta_rad": [1e-3, 1e-3, 1e-3, 1e-3, 0.0, 0.0],
            "verdict": verdicts,
            "reason": ["", "", "", "too noisy", "", ""],
            "low_rad": [9e-4, 1.1e-3, 0, np.nan, 4e-4, 0],
            "high_rad": [1.2e-3, 1.3e-3, 4e-5, np.nan, 6e-4, 4e-5],
            "loss": [-1.9, 2.0, np.nan, np.nan, 0.1, np.nan],
            "friction_share": [-1.9, 1.9, np.nan, np.nan, 0.1, np.nan],
        }
    )


def test_answers_covers_and_errors_are_counted():
    row = datasheet.summarise(rows("one")).iloc[0]
    counts = {"joints": 4, "answered": 2, "covered": 1, "false_all_clears": 1}
    counts |= {"healthy": 2, "healthy_called": 1, "healthy_cleared": 1}
    counts |= {"right": 2, "true_reason": 0, "wrong": 3, "reasons": "too noisy 1", "loss": 1}
    counts |= {"friction_share": 2}
    assert row[[*counts]].to_dict() == counts


def test_a_fault_s_refusal_is_true_or_not():
    refused = rows("gear ratio doubled").assign(verdict="cannot tell", reason="wrong period")
    refused.loc[0, "reason"] = "too noisy"
    row = datasheet.summarise(refused).iloc[0]
    assert row[["right", "true_reason", "wrong"]].tolist() == [0, 5, 0]


def test_the_engine_s_healthy_joints_stand_beside_its_others():
    twin = pd.DataFrame({"population": ["twin"], "nrmse": [1e-3]})
    table = pd.concat([twin, rows("turns"), rows("turns, healthy"), rows("arm")])
    sheet = datasheet.summarise_engine(table)
    assert sheet["population"].tolist() == ["MuJoCo, turns", "MuJoCo, arm"]
    assert sheet["answered"].tolist() == [4, 2]


def test_the_page_has_every_population_and_at_most_300_words():
    names = [*datasheet.POPULATIONS]
    sheet = datasheet.summarise(pd.concat([rows(name) for name in names]))
    engines = ["MuJoCo, turns", "MuJoCo, drag in the gap", "MuJoCo, arm"]
    engine = datasheet.summarise(pd.concat([rows(name) for name in engines]))
    names += engines
    page = datasheet.write_page(sheet, engine)
    assert all(name in page for name in names if name not in datasheet.WIDE)
    assert "| 25-50 Hz | 1 / 2 / 4 | 1 / 2 / 4 | 1 / 2 / 4 |" in page
    assert len([word for word in page.split() if re.search("[A-Za-z]", word)]) <= 300


@pytest.mark.parametrize("quantity", datasheet.TOLD)
def test_nine_of_ten_quantities_are_within_their_intervals(quantity):
    turns = pd.read_csv(ROOT / "results" / "datasheet.csv").iloc[: len(datasheet.TURNS)]
    assert turns[quantity].sum() >= 0.9 * turns["answered"].sum() > 40
