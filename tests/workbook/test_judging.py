import json
import math

import numpy as np
import pandas as pd
import pytest

import workbook
from replication import published
from workbook import judging


def judged(cell, numbers, source="authors"):
    return judging.judge_cells({cell: numbers}, source).iloc[0]


def verdict(cell, numbers, source="authors"):
    return judged(cell, numbers, source)["verdict"]


def five(value, spread=0.01):
    """Five realisations about a value, with a relative SD."""
    return list(value * np.exp(spread * np.array([-1.26, -0.63, 0.0, 0.63, 1.26])))


def test_the_region_holds_the_next_realisation_as_often_as_it_says():
    rng = np.random.default_rng(1)
    draws = np.exp(rng.normal(0.3, 0.2, size=(4000, 6)))
    inside = [
        low <= last <= high
        for *seen, last in draws
        for low, high in [judging.region(seen, signed=False)]
    ]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)


def test_the_region_of_signed_numbers_is_taken_without_logarithms():
    low, high = judging.region([-0.01, 0.0, 0.02], signed=True)
    assert low < -0.01
    assert low + high == pytest.approx(2 * judging.centre([-0.01, 0.0, 0.02], signed=True))


def test_one_realisation_gives_no_region():
    assert verdict("table2.row02.mean", [0.387]) == "undecided"


def test_a_value_within_its_tolerance_agrees_and_one_beyond_differs():
    value, tolerance = (
        published.value("table2.row03.noise"),
        published.tolerance("table2.row03.noise"),
    )
    assert verdict("table2.row03.noise", value + 0.99 * tolerance) == "traced"
    assert verdict("table2.row03.noise", value + 1.01 * tolerance) == "differs"
    assert verdict("table2.row03.noise", value - 1.01 * tolerance) == "differs"


def test_a_mean_is_reproduced_only_where_the_region_holds_no_other_printed_number():
    printed, theoretical = (
        published.value("table2.row02.mean"),
        published.value("table2.row02.theoretical"),
    )
    assert verdict("table2.row02.mean", five(printed)) == "reproduced"
    wide = judged("table2.row02.mean", five(printed, spread=0.05))
    assert wide["low"] <= theoretical <= wide["high"]
    assert wide["verdict"] == "undecided"


def test_a_region_with_a_neighbouring_printed_number_decides_nothing():
    printed, larger = (published.value(f"table2.row{row:02d}.mean") for row in (9, 10))
    assert verdict("table2.row09.mean", five(math.sqrt(printed * larger), 0.015)) == "undecided"


def test_a_difference_that_depends_on_one_realisation_is_undecided():
    printed = published.value("table2.row02.mean")
    apart = five(1.03 * printed, spread=0.005)
    assert verdict("table2.row02.mean", apart) == "differs"
    narrow = [1.0, 1.001, 0.999, 1.0005]
    hanging = [printed * (1.012 + 0.01 * (x - 1)) for x in narrow] + [printed * 1.003]
    low, high = judging.region(hanging, signed=False)
    without = judging.region_without_one(hanging, signed=False)
    assert without[0] < low
    assert without[1] > high
    moved = [
        x * printed / (0.999 * low) for x in hanging
    ]  # the printed number just below the region
    assert verdict("table2.row02.mean", moved) == "undecided"


def test_a_number_that_has_no_logarithm_decides_nothing():
    assert (
        verdict("table2.row02.sd", [0.0, *five(published.value("table2.row02.sd"), 0.05)[1:]])
        == "undecided"
    )


def test_a_cell_that_no_rule_is_about_is_not_judged():
    with pytest.raises(ValueError, match=r"table1\.tau\.max by simulated: basis\.csv does not say"):
        judging.judge_cells({"table1.tau.max": 30.0}, "simulated")


def test_a_limit_inside_the_interval_of_our_number_is_undecided():
    limit = published.value("text.error_limit_percent")
    for factor, expected in ((0.5, "reproduced"), (1.0, "undecided"), (2.0, "differs")):
        assert verdict("text.error_limit_percent", five(factor * limit, 0.05)) == expected


def test_a_cell_with_an_erratum_is_an_erratum_only_when_our_number_is_the_correction():
    assert verdict("equation10.rmse", 5.93e-6) == "erratum"
    assert verdict("equation10.rmse", 4.11e-7) == "differs"
    assert verdict("equation10.rmse", published.value("equation10.rmse")) == "reproduced"


@pytest.mark.parametrize(
    ("cell", "source", "agreeing", "differing"),
    [
        ("table2.row03.noise", "authors", "traced", "differs"),
        ("equation10.A2", "authors", "consistent", "differs"),
        ("text.load", "authors", "given", "differs"),
        ("text.turns", "authors", "undecided", "undecided"),
        ("table4.row01.mean", "stand-in", "stand-in", "stand-in"),
    ],
)
def test_what_an_agreement_and_a_difference_count_for_depends_on_what_they_are_worth(
    cell, source, agreeing, differing
):
    printed = published.value(cell)
    assert verdict(cell, printed, source) == agreeing
    assert verdict(cell, 2 * printed + 1, source) == differing
    assert verdict(cell, math.nan, source) == ("given" if agreeing == "given" else "not-run")


def test_the_old_tolerance_stays_visible_beside_the_region():
    printed = published.value("table2.row02.sd")
    row = judged("table2.row02.sd", five(10 * printed, 2.0))
    assert (row["verdict"], row["by_tolerance"]) == ("undecided", "differs")


def test_a_number_that_is_missing_is_not_run():
    assert verdict("table2.row02.sd", [math.nan] * 5) == "not-run"


def test_a_cell_that_no_notebook_computes_is_not_run(tmp_path):
    table = judging.verdicts(tmp_path)
    assert set(table["id"]) == set(published.cells().index)
    assert set(table["verdict"]) == {"not-run", "given"}


def test_each_printed_number_counts_once_by_the_authors_data_first():
    found = [
        judging.judge_cells({"table2.row02.mean": five(factor * 0.387)}, source)
        for source, factor in (("simulated", 1.0), ("authors", 2.0))
    ]
    decided = judging.deciding(pd.concat(found, ignore_index=True))
    assert decided[["source", "verdict"]].to_numpy().tolist() == [["authors", "differs"]]


def test_an_undecided_claim_is_neither_true_nor_false(tmp_path, monkeypatch):
    monkeypatch.setenv("REPLICATION_OUT", str(tmp_path))
    monkeypatch.setenv("REPLICATION_NOTEBOOK", "01_signature_figure6")
    claims = {"monotone": (None, "no data"), "half_turn": (True, "yes")}
    workbook.export(claims=claims)
    shown = workbook.judge(claims=claims)
    assert shown["verdict"].tolist() == ["undecided", "holds"]
    claims = judging.decided_claims(tmp_path / "results").set_index("id")["verdict"]
    assert claims.to_dict() == {"monotone": "undecided", "half_turn": "holds"}


def test_the_outcome_of_a_notebook_that_is_gone_is_not_counted(tmp_path):
    (tmp_path / "outcomes").mkdir()
    outcome = {"cells": [{"id": "text.runs", "source": "authors", "numbers": 30}], "claims": []}
    (tmp_path / "outcomes" / "00_renamed.json").write_text(json.dumps(outcome), encoding="utf-8")
    assert set(judging.verdicts(tmp_path)["verdict"]) == {"not-run", "given"}
