import json
import math
import re

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import workbook
from replication import published
from replication.statistics import predictive_region
from workbook import judging


def judged(cell, numbers, source="authors"):
    return judging.judge_cells({cell: numbers}, source).iloc[0]


def verdict(cell, numbers, source="authors"):
    return judged(cell, numbers, source)["verdict"]


def forty(value, spread=0.01):
    """Forty realisations about a value, with a relative SD, of each of some candidates."""
    normal = stats.norm.ppf(np.arange(0.5, 40) / 40)
    return list(value * np.exp(spread * normal))


def by(*values, spread=0.01):
    return {f"candidate {k}": forty(value, spread) for k, value in enumerate(values)}


def test_too_few_realisations_give_no_region():
    assert verdict("table2.row02.mean", {"a": forty(0.387)[:38]}) == "undecided"
    assert verdict("table2.row02.mean", {"a": forty(0.387)[:39]}) == "reproduced"


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
    assert verdict("table2.row02.mean", by(printed)) == "reproduced"
    wide = judged("table2.row02.mean", by(printed, spread=0.06))
    assert wide["low"] <= theoretical <= wide["high"]
    assert wide["verdict"] == "undecided"


def test_a_region_with_a_neighbouring_printed_number_decides_nothing():
    printed, larger = (published.value(f"table2.row{row:02d}.mean") for row in (9, 10))
    assert verdict("table2.row09.mean", by(math.sqrt(printed * larger), spread=0.02)) == "undecided"


def test_an_sd_is_reproduced_only_by_a_region_of_less_than_a_factor_of_ten():
    printed = published.value("table2.row05.sd")
    for spread, expected in ((0.4, "reproduced"), (0.6, "undecided")):
        assert verdict("table2.row05.sd", by(printed, spread=spread)) == expected


def test_a_printed_number_too_close_to_an_end_is_undecided():
    printed = published.value("table2.row02.mean")
    low, high = predictive_region(forty(1.0))
    for share, expected in ((0.0, "undecided"), (0.3, "differs"), (-0.3, "reproduced")):
        place = low * (low / high) ** share  # of the printed number, if ours lay about 1
        assert verdict("table2.row02.mean", by(printed / place)) == expected


def test_every_candidate_has_to_agree():
    printed = published.value("table2.row02.mean")
    assert verdict("table2.row02.mean", by(printed, printed)) == "reproduced"
    split = judged("table2.row02.mean", by(printed, 1.2 * printed))
    assert split["verdict"] == "undecided"
    assert "reproduced under 1; differs under 1" in split["reason"]
    assert verdict("table2.row02.mean", by(1.2 * printed, 0.8 * printed)) == "differs"


def test_the_reason_says_from_where_on_a_verdict_would_differ():
    printed = published.value("table2.row02.mean")
    reason = judged("table2.row02.mean", by(printed))["reason"]
    below, above = map(float, re.findall(r"differ below (.*) or above (.*)$", reason)[0])
    for factor, expected in ((1 + 1e-3, "differs"), (1 - 1e-3, "undecided")):
        assert verdict("table2.row02.mean", by(printed * printed / below * factor)) == expected
        assert verdict("table2.row02.mean", by(printed * printed / above / factor)) == expected


def test_a_number_that_has_no_logarithm_decides_nothing():
    numbers = {"a": [0.0, 0.0, *forty(published.value("table2.row02.sd"))[2:]]}
    assert verdict("table2.row02.sd", numbers) == "undecided"


def test_a_cell_that_no_rule_is_about_is_not_judged():
    with pytest.raises(ValueError, match=r"table1\.tau\.max by simulated: basis\.csv does not say"):
        judging.judge_cells({"table1.tau.max": 30.0}, "simulated")


def test_a_limit_inside_the_interval_of_our_number_is_undecided():
    limit = published.value("text.error_limit_percent")
    for factor, expected in ((0.5, "reproduced"), (1.0, "undecided"), (2.0, "differs")):
        assert verdict("text.error_limit_percent", by(factor * limit, spread=0.05)) == expected


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
    row = judged("table2.row02.sd", by(10 * printed, spread=2.0))
    assert (row["verdict"], row["by_tolerance"]) == ("undecided", "differs")


def test_a_number_that_is_missing_is_not_run():
    assert verdict("table2.row02.sd", {"a": [math.nan] * 40}) == "not-run"


def test_a_cell_that_no_notebook_computes_is_not_run(tmp_path):
    table = judging.verdicts(tmp_path)
    assert set(table["id"]) == set(published.cells().index)
    assert set(table["verdict"]) == {"not-run", "given"}


def test_each_printed_number_counts_once_by_the_authors_data_first():
    found = [
        judging.judge_cells({"table2.row02.mean": by(factor * 0.387)}, source)
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
