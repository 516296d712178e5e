"""What a change did: line by line since the last commit, and as a notebook's verdict says it."""

import json
import shutil

import pandas as pd
import pytest

import workbook
from replication import published
from workbook import changes, outcomes
from workbook.checkout import RESULTS

NOTEBOOK = "06_characteristic_figure12"
VERDICTS, CLAIMS = (pd.read_csv(RESULTS / f"{name}.csv") for name in ("verdicts", "claims"))


@pytest.fixture
def results(tmp_path):
    """A copy of the committed outcomes."""
    shutil.copytree(RESULTS / "outcomes", tmp_path / "outcomes")
    return tmp_path


def change(results, part, key, **values):
    """Change a cell or a claim of an outcome."""
    file = results / "outcomes" / f"{NOTEBOOK}.json"
    outcome = json.loads(file.read_text("utf-8"))
    outcome[part] = [row | values if row["id"] == key else row for row in outcome[part]]
    file.write_text(json.dumps(outcome), encoding="utf-8")


def test_what_moves_beyond_rounding_is_listed_and_what_flips_comes_first(results):
    assert changes.list_changes(results, VERDICTS, CLAIMS) == []
    kept = VERDICTS.set_index("id").loc["equation10.A2", "reproduced"]
    change(results, "cells", "equation10.A2", numbers=kept * (1 + 1e-8))
    assert changes.list_changes(results, VERDICTS, CLAIMS) == []
    near = published.value("equation10.A1") + 1e-5
    change(results, "cells", "equation10.A2", numbers=2 * kept)
    change(results, "cells", "equation10.A1", numbers=near)
    change(results, "claims", "monotone", holds=False)
    flips, fails, moved = changes.list_changes(results, VERDICTS, CLAIMS)
    assert flips.startswith("FLIPS equation10.A2, ")
    assert flips.endswith(f"{kept:.6g} -> {2 * kept:.6g}")
    assert "FLIPS monotone" in fails
    assert "holds -> does not hold" in fails
    assert moved.startswith("moved equation10.A1")


@pytest.mark.parametrize(
    ("broken", "why"), [("{", "cannot be read"), (None, "no notebook has been run there")]
)
def test_results_that_are_broken_or_not_there_are_refused_in_one_line(results, broken, why):
    if broken is None:
        shutil.rmtree(results / "outcomes")
    else:
        (results / "outcomes" / f"{NOTEBOOK}.json").write_text(broken, "utf-8")
    with pytest.raises(changes.NotComparable, match=why) as refusal:
        changes.list_changes(results, VERDICTS, CLAIMS)
    assert "\n" not in str(refusal.value)


def test_a_run_of_unknown_name_is_named_and_compared_by_its_ids(results):
    kept = VERDICTS.set_index("id").loc["equation10.A2", "reproduced"]
    change(results, "cells", "equation10.A2", numbers=2 * kept)
    (results / "outcomes" / f"{NOTEBOOK}.json").rename(results / "outcomes" / "by_hand.json")
    flipped, named = changes.list_changes(results, VERDICTS, CLAIMS)
    assert flipped.startswith("FLIPS equation10.A2, by_hand: ")
    assert named.startswith("by_hand: run under a name that is no notebook's")


@pytest.mark.parametrize(("factor", "said"), [(1, "nothing"), (2, "FLIPS equation10.A2")])
def test_an_export_by_hand_says_what_changed_against_the_kept_results(
    factor, said, monkeypatch, tmp_path, capsys
):
    monkeypatch.delenv("REPLICATION_OUT", raising=False)
    monkeypatch.setenv("JPY_SESSION_NAME", "by_hand.ipynb")
    monkeypatch.setattr(outcomes, "output_folder", lambda: tmp_path)
    kept = VERDICTS.set_index("id").loc["equation10.A2", "reproduced"]
    workbook.export(cells={"equation10.A2": factor * kept})
    assert said in capsys.readouterr().out


def test_a_verdict_begins_with_the_parameters_that_were_changed(monkeypatch, capsys):
    monkeypatch.setenv("REPLICATION_NOTEBOOK", NOTEBOOK)
    monkeypatch.setattr(changes, "GIVEN", {"degree": 3, "factors": [2]})
    workbook.verdict("It holds.")
    assert capsys.readouterr().out == "It holds.\n"
    monkeypatch.setattr(changes, "GIVEN", {"degree": 5})
    workbook.verdict("It holds.", {"equation10.A2": 9.0})
    said = capsys.readouterr().out
    assert "**With `degree = 5` (3 in the committed run):** It holds." in said
    assert "differs" in said
