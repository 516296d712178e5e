"""A notebook's verdict: this run's numbers beside the printed and the committed ones, and what the report gets."""

import json

import pandas as pd
import pytest

import workbook
from replication.files import UserError
from workbook import outcomes
from workbook.outcomes import RESULTS

CELL = "equation10.A2"


@pytest.fixture
def committed():
    return pd.read_csv(RESULTS / "verdicts.csv", index_col="id")["reproduced"][CELL]


def test_by_hand_a_changed_number_stands_beside_the_committed_one_and_loses_its_verdict(committed):
    table = workbook.judge({CELL: 1.3 * committed})
    assert float(table["ours"][CELL]) == pytest.approx(1.3 * committed, rel=1e-4)
    assert float(table["committed"][CELL]) == pytest.approx(committed, rel=1e-4)
    assert table["verdict"][CELL] == "differs"
    assert workbook.judge({CELL: committed})["verdict"][CELL] == "agrees"


def test_the_outcome_holds_numbers_decisions_and_facts(tmp_path, monkeypatch):
    monkeypatch.setattr(outcomes, "OUTPUT_FOLDER", str(tmp_path))
    monkeypatch.setenv("REPLICATION_NOTEBOOK", "small")
    workbook.verdict(
        "A sentence.",
        cells={CELL: 1 / 3},
        claims={"monotone": (True, "it is")},
        facts={"count": 3, "error": f"{float('nan'):+.1f}"},
        tables={"small": pd.DataFrame({"x": [1 / 3]})},
    )
    made = {path.name: path.read_text("utf-8") for path in tmp_path.rglob("*.*")}
    outcome = json.loads(made["small.json"])
    assert outcome["cells"][0]["numbers"] == 0.333333
    assert outcome["claims"] == [{"id": "monotone", "holds": True, "measured": "it is"}]
    assert outcome["facts"] == {"count": "3"}
    assert made["small.csv"] == "x\n0.333333\n"


def test_a_broken_outcome_is_named_with_what_makes_it_again(tmp_path):
    file = tmp_path / "outcomes" / "06_characteristic_figure12.json"
    file.parent.mkdir()
    file.write_text('{"cells": [', "utf-8")
    with pytest.raises(UserError, match=r"run notebooks/06_\w+\.py makes it again") as refused:
        outcomes.load_outcomes(tmp_path)
    assert str(file) in str(refused.value)
