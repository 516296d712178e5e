"""What changed since the last commit, line by line."""

import json
import shutil

import pandas as pd
import pytest

from replication import published
from workbook.checkout import RESULTS
from workbook.report import diff

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
    assert diff.list_changes(results, VERDICTS, CLAIMS) == []
    kept = VERDICTS.set_index("id").loc["equation10.A2", "reproduced"]
    change(results, "cells", "equation10.A2", numbers=kept * (1 + 1e-8))
    assert diff.list_changes(results, VERDICTS, CLAIMS) == []
    near = published.value("equation10.A1") + 1e-5
    change(results, "cells", "equation10.A2", numbers=2 * kept)
    change(results, "cells", "equation10.A1", numbers=near)
    change(results, "claims", "monotone", holds=False)
    flips, fails, moved = diff.list_changes(results, VERDICTS, CLAIMS)
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
    with pytest.raises(diff.NotComparable, match=why) as refusal:
        diff.list_changes(results, VERDICTS, CLAIMS)
    assert "\n" not in str(refusal.value)
