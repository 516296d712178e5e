import pandas as pd

from replication import published
from replication.workbook import judging


def judged(cell, reproduced, source="authors"):
    found = pd.DataFrame([{"id": cell, "source": source, "reproduced": reproduced, "notebook": "n"}])
    return judging.judge(found).iloc[0]


def test_a_value_within_its_tolerance_is_reproduced_and_one_beyond_differs():
    value, tolerance = published.value("table2.row03.noise"), published.tolerance("table2.row03.noise")
    assert judged("table2.row03.noise", value + 0.99 * tolerance)["verdict"] == "reproduced"
    assert judged("table2.row03.noise", value + 1.01 * tolerance)["verdict"] == "differs"
    assert judged("table2.row03.noise", value - 1.01 * tolerance)["verdict"] == "differs"


def test_a_bound_holds_below_and_differs_above():
    limit = published.value("text.error_rad_large")
    assert judged("text.error_rad_large", limit / 10)["verdict"] == "reproduced"
    assert judged("text.error_rad_large", limit * 1.01)["verdict"] == "differs"


def test_a_cell_with_an_erratum_is_an_erratum_only_when_it_is_off():
    assert judged("equation10.rmse", 5.9e-6)["verdict"] == "erratum"
    assert judged("equation10.rmse", published.value("equation10.rmse"))["verdict"] == "reproduced"


def test_a_stand_in_never_counts_as_reproduced():
    assert judged("table4.row01.mean", published.value("table4.row01.mean"), "stand-in")["verdict"] == "stand-in"


def test_a_cell_that_no_notebook_computes_is_not_run(tmp_path):
    table = judging.verdicts(tmp_path)
    assert set(table["id"]) == set(published.cells().index)
    assert set(table["verdict"]) == {"not-run"}
