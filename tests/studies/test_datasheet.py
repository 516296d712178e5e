"""The datasheet counts what it says it counts."""

import re

import numpy as np
import pandas as pd

from replication.files import ROOT
from studies import datasheet


def rows(population: str) -> pd.DataFrame:
    """Of ten joints 1 covered, 2 answered otherwise, 3 all clear, 4 refused; of healthy ones 5 called, 6 cleared."""
    kinds = pd.DataFrame(
        {
            "population": population,
            "delta_rad": [1e-3] * 4 + [0.0] * 2,
            "verdict": ["backlash"] * 2 + ["no backlash", "cannot tell", "backlash", "no backlash"],
            "reason": ["", "", "", "too noisy", "", ""],
            "low_rad": [9e-4, 1.1e-3, 0, np.nan, 4e-4, 0],
            "high_rad": [1.2e-3, 1.3e-3, 4e-5, np.nan, 6e-4, 4e-5],
            "loss": [-1.9, 2.0, np.nan, np.nan, 0.1, np.nan],
            "friction_share": [-1.9, 1.9, np.nan, np.nan, 0.1, np.nan],
        }
    )
    return kinds.loc[kinds.index.repeat([1, 2, 3, 4, 5, 6])].reset_index(drop=True)


def test_answers_covers_and_errors_are_counted():
    row = datasheet.summarise(rows("one")).iloc[0]
    assert row["joints":"wrong"].tolist() == [10, 3, 1, 3, 11, 5, 6, 7, 0, 10]
    assert row[["reasons", "loss", "friction_share"]].tolist() == ["too noisy 4", 1, 3]


def test_a_fault_s_refusal_is_true_or_not():
    refused = rows(datasheet.DOUBLED).assign(verdict="cannot tell", reason="wrong period")
    refused.loc[0, "reason"] = "too noisy"
    row = datasheet.summarise(refused).iloc[0]
    assert row[["right", "true_reason", "wrong"]].tolist() == [0, 20, 0]


def test_the_page_is_made_of_the_kept_tables_and_has_at_most_300_words():
    page = (ROOT / "notebooks" / "datasheet.md").read_text("utf-8")
    sheet, engine = (
        pd.read_csv(ROOT / "results" / f"{name}.csv") for name in ("datasheet", "engine")
    )
    assert page == datasheet.write_page(sheet, datasheet.summarise_engine(engine))
    shown = set(datasheet.POPULATIONS) - set(datasheet.WIDE) | {"MuJoCo, turns", "MuJoCo, strokes"}
    assert all(f"| {name} |" in page for name in shown)
    assert len([word for word in page.split() if re.search("[A-Za-z]", word)]) <= 300


def test_nine_of_ten_quantities_are_within_their_intervals():
    turns = pd.read_csv(ROOT / "results" / "datasheet.csv").iloc[: len(datasheet.TURNS)]
    counts = turns.sum(numeric_only=True)
    for name in datasheet.TOLD:
        assert counts[name] >= 0.9 * counts[f"{name}_told"] > 40
