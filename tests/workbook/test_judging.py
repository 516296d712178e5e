import math

import pandas as pd
import pytest

from replication import published, workbook
from replication.workbook import judging


def judged(cell, reproduced, source="authors", **region):
    found = pd.DataFrame([{"id": cell, "source": source, "reproduced": reproduced, "notebook": "n"} | region])
    return judging.judge(found).iloc[0]


def test_a_value_within_its_tolerance_is_reproduced_and_one_beyond_differs():
    value, tolerance = published.value("table2.row03.noise"), published.tolerance("table2.row03.noise")
    assert judged("table2.row03.noise", value + 0.99 * tolerance)["verdict"] == "reproduced"
    assert judged("table2.row03.noise", value + 1.01 * tolerance)["verdict"] == "differs"
    assert judged("table2.row03.noise", value - 1.01 * tolerance)["verdict"] == "differs"


def test_a_bound_holds_below_and_differs_above():
    limit = published.value("text.error_limit_percent")
    assert judged("text.error_limit_percent", limit / 10)["verdict"] == "reproduced"
    assert judged("text.error_limit_percent", limit * 1.01)["verdict"] == "differs"


def test_a_cell_with_an_erratum_is_an_erratum_only_when_our_number_is_the_correction():
    assert judged("equation10.rmse", 5.93e-6)["verdict"] == "erratum"
    assert judged("equation10.rmse", 4.11e-7)["verdict"] == "differs"
    assert judged("equation10.rmse", published.value("equation10.rmse"))["verdict"] == "reproduced"
    assert judged("table1.T_d.max", 0.2)["verdict"] == "erratum"
    assert judged("table1.T_d.max", 0.21)["verdict"] == "differs"


def test_agreement_that_could_not_fail_is_no_reproduction():
    assert judged("equation10.A2", published.value("equation10.A2"))["verdict"] == "consistent"
    assert judged("equation10.A2", published.value("equation10.A2") + 1)["verdict"] == "differs"
    assert judged("text.load", published.value("text.load"))["verdict"] == "given"


def test_a_stand_in_never_counts_as_reproduced():
    assert judged("table4.row01.mean", published.value("table4.row01.mean"), "stand-in")["verdict"] == "stand-in"


def test_a_predictive_region_decides_in_place_of_the_tolerance_which_stays_visible():
    printed = published.value("table2.row02.sd")
    row = judged("table2.row02.sd", 10 * printed, low=0.5 * printed, high=12 * printed)
    assert (row["verdict"], row["by_tolerance"]) == ("reproduced", "differs")
    row = judged("table2.row02.sd", printed, low=2 * printed, high=12 * printed)
    assert (row["verdict"], row["by_tolerance"]) == ("differs", "reproduced")


def test_a_region_that_holds_most_of_its_columns_numbers_decides_nothing():
    printed = published.column("Table 2", "sd")
    row = judged("table2.row02.sd", 0.02, low=0.0, high=printed.max())
    assert row["verdict"] == "undecided"


def test_only_what_is_decided_by_evidence_says_what_would_have_made_it_fail():
    assert judged("table2.row03.noise", published.value("table2.row03.noise"))["fails_if"]
    assert not judged("text.load", published.value("text.load"))["fails_if"]


def test_without_a_region_the_tolerance_is_the_region():
    row = judged("table2.row03.noise", 0.1237)
    assert row["high"] - row["low"] == pytest.approx(2 * published.tolerance("table2.row03.noise"))
    assert judged("text.error_limit_percent", 5.0)["high"] == math.inf


def test_a_cell_that_no_notebook_computes_is_not_run(tmp_path):
    table = judging.verdicts(tmp_path)
    assert set(table["id"]) == set(published.cells().index)
    assert set(table["verdict"]) == {"not-run", "given"}


def test_an_undecided_claim_is_neither_true_nor_false(tmp_path, monkeypatch):
    monkeypatch.setenv("REPLICATION_OUT", str(tmp_path))
    monkeypatch.setenv("REPLICATION_NOTEBOOK", "01_signature_figure6")
    shown = workbook.verdict(claims={"monotone": (None, "no data"), "half_turn": (True, "yes")})
    assert shown["verdict"].tolist() == ["undecided", "holds"]
    claims = judging.decided_claims(tmp_path / "results").set_index("id")["verdict"]
    assert claims.to_dict() == {"monotone": "undecided", "half_turn": "holds"}


def test_the_outcome_of_a_notebook_that_is_gone_is_not_counted(tmp_path):
    (tmp_path / "outcomes").mkdir()
    outcome = '{"cells": [{"id": "text.runs", "source": "authors", "reproduced": 30}], "claims": []}'
    (tmp_path / "outcomes" / "00_renamed.json").write_text(outcome, encoding="utf-8")
    assert set(judging.verdicts(tmp_path)["verdict"]) == {"not-run", "given"}
