import json
import shutil
import subprocess

import pandas as pd
import pytest

import workbook
from replication import published
from workbook.main import main
from workbook.report import diff

RESULTS = workbook.ROOT / "results"


@pytest.fixture
def results(tmp_path):
    """A copy of the committed outcomes."""
    shutil.copytree(RESULTS / "outcomes", tmp_path / "results" / "outcomes")
    return tmp_path / "results"


@pytest.fixture
def before():
    return pd.read_csv(RESULTS / "verdicts.csv"), pd.read_csv(RESULTS / "claims.csv")


def change(results, notebook, part, key, **values):
    file = results / "outcomes" / f"{notebook}.json"
    outcome = json.loads(file.read_text(encoding="utf-8"))
    next(row for row in outcome[part] if row["id"] == key).update(values)
    file.write_text(json.dumps(outcome), encoding="utf-8")


def test_nothing_has_moved_in_the_results_themselves(results, before):
    assert diff.list_changes(results, *before).empty


def test_what_moves_is_listed_and_what_flips_is_marked_and_comes_first(results, before):
    notebook = "06_characteristic_figure12"
    printed = published.value("equation10.A2")
    change(results, notebook, "cells", "equation10.A2", numbers=2 * printed)
    change(results, notebook, "cells", "equation10.A1", numbers=published.value("equation10.A1") + 1e-5)
    change(results, notebook, "claims", "monotone", holds=False)
    change(results, notebook, "claims", "error_rad_small", measured="1.9e-05 rad at 3e-04 rad")
    table = diff.list_changes(results, *before)
    listed = table[["flips", "id", "source", "verdict_before", "verdict_now"]].to_numpy().tolist()
    assert listed == [
        [True, "equation10.A2", "authors", "consistent", "differs"],
        [True, "monotone", "claim", "holds", "does not hold"],
        [False, "equation10.A1", "authors", "consistent", "consistent"],
        [False, "error_rad_small", "claim", "holds", "holds"],
    ]
    values = table.set_index("id")["value_now"]
    assert values["equation10.A2"] == f"{2 * printed:.6g}"
    assert values["error_rad_small"] == "1.9e-05 rad at 3e-04 rad"
    verdicts = before[0].set_index(["id", "source"])
    kept = verdicts.loc[("equation10.A2", "authors"), "reproduced"]
    assert table["value_before"].iloc[0] == f"{kept:.6g}"


def test_a_change_beyond_the_sixth_digit_is_none(results, before):
    kept = before[0].set_index(["id", "source"]).loc[("equation10.A2", "authors"), "reproduced"]
    change(results, "06_characteristic_figure12", "cells", "equation10.A2", numbers=kept * (1 + 1e-8))
    assert diff.list_changes(results, *before).empty


def test_what_a_notebook_no_longer_decides_is_listed(results, before):
    file = results / "outcomes" / "06_characteristic_figure12.json"
    outcome = json.loads(file.read_text(encoding="utf-8"))
    outcome["claims"] = [row for row in outcome["claims"] if row["id"] != "monotone"]
    file.write_text(json.dumps(outcome), encoding="utf-8")
    (row,) = diff.list_changes(results, *before).to_dict("records")
    assert (row["id"], row["verdict_before"], row["verdict_now"], row["value_now"]) == (
        "monotone",
        "holds",
        "not-run",
        "",
    )


def test_a_cell_that_was_not_decided_before_is_listed(results, before):
    verdicts, claims = before
    (row,) = diff.list_changes(results, verdicts, claims[claims["id"] != "monotone"]).to_dict("records")
    assert (row["id"], row["verdict_before"], row["value_before"], row["verdict_now"]) == (
        *("monotone", "not-run", ""),
        claims.set_index("id").loc["monotone", "verdict"],
    )


@pytest.mark.parametrize(
    ("flipped", "said"),
    [
        (True, "FLIPS a (authors): reproduced -> differs; 1 -> 2"),
        (False, "moved a (authors): reproduced; 1 -> 2"),
    ],
)
def test_a_line_tells_value_and_verdict_before_and_now(flipped, said):
    now = "differs" if flipped else "reproduced"
    row = {"flips": flipped, "id": "a", "source": "authors", "value_before": "1", "value_now": "2"}
    assert diff.describe_change(row | {"verdict_before": "reproduced", "verdict_now": now}) == said


def test_what_was_not_run_here_is_not_listed(results, before):
    for file in (results / "outcomes").glob("0[2-9]*.json"):
        file.unlink()
    assert diff.list_changes(results, *before).empty


def test_a_folder_without_results_is_refused_in_one_line(tmp_path, before):
    with pytest.raises(diff.NotComparable, match="no notebook has been run there") as refusal:
        diff.list_changes(tmp_path, *before)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("broken", ["{", '{"cells": []}', '{"cells": [{"id": "no.such.cell"}], "claims": []}'])
def test_a_broken_outcome_is_refused_in_one_line(results, before, broken):
    (results / "outcomes" / "06_characteristic_figure12.json").write_text(broken, encoding="utf-8")
    with pytest.raises(diff.NotComparable, match="cannot be read") as refusal:
        diff.list_changes(results, *before)
    assert "\n" not in str(refusal.value)


def test_without_a_repository_diff_says_so_in_one_line(tmp_path):
    with pytest.raises(diff.NotComparable, match=r"verdicts\.csv: no committed copy") as refusal:
        diff.committed_table("verdicts.csv", tmp_path)
    assert "\n" not in str(refusal.value)


def test_diff_compares_with_the_last_commit(tmp_path):
    subprocess.run(["git", "init", "--quiet"], cwd=tmp_path, check=True)
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "verdicts.csv").write_text("id,verdict\na,reproduced\n", encoding="utf-8")
    identity = ["-c", "user.name=n", "-c", "user.email=n@example.org"]
    subprocess.run(["git", "add", "."], cwd=tmp_path, check=True)
    subprocess.run(["git", *identity, "commit", "--quiet", "--message", "results"], cwd=tmp_path, check=True)
    (tmp_path / "results" / "verdicts.csv").write_text("id,verdict\na,differs\n", encoding="utf-8")
    assert diff.committed_table("verdicts.csv", tmp_path)["verdict"].tolist() == ["reproduced"]


def test_the_command_exits_with_1_and_one_line_where_nothing_is_committed(monkeypatch, capsys):
    def refuse(name):
        raise diff.NotComparable(f"results/{name}: no committed copy")

    monkeypatch.setattr(diff, "committed_table", refuse)
    assert main(["diff"]) == 1
    assert capsys.readouterr().err.count("\n") == 1
