"""A notebook's verdict: this run's numbers beside the printed and the committed ones, and what the report gets."""

import json

import pandas as pd
import pytest

import workbook
from workbook import ROOT, outcomes, stamps
from workbook.project import RESULTS, notebook_sources

CELL = "equation10.A2"


def test_by_hand_a_changed_number_stands_beside_the_committed_one_and_loses_its_verdict():
    committed = pd.read_csv(RESULTS / "verdicts.csv", index_col="id")["reproduced"][CELL]
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
        claims={"monotone": (99.0, "it is")},
        facts={"rows": pd.Series([1 / 3, 2]), "of": {"count": pd.Series([True]).sum()}},
        tables={"small": pd.DataFrame({"x": [1 / 3]})},
    )
    made = {path.name: path.read_text("utf-8") for path in tmp_path.rglob("*.*")}
    outcome = json.loads(made["small.json"])
    assert outcome["cells"][0]["numbers"] == 0.333333
    assert outcome["claims"] == [{"id": "monotone", "holds": True, "measured": "it is"}]
    assert outcome["facts"] == {"rows": [0.333333, 2.0], "of": {"count": 1}}
    assert made["small.csv"] == "x\n0.333333\n"


def test_the_committed_files_are_those_that_the_notebooks_made_and_no_two_make_the_same():
    made = [file for name in notebook_sources() for file in stamps.list_made(name)]
    assert len(made) == len({*made})
    there = [*ROOT.glob("figures/*"), *ROOT.glob("notebooks/*.ipynb")]
    there += ROOT.glob("notebooks/beyond/*.ipynb")
    assert {file.relative_to(ROOT).as_posix() for file in there} <= {*made}
