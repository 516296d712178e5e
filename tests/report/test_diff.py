"""What changed since the last commit, line by line."""

import json
import shutil
import subprocess

import pandas as pd
import pytest

from replication import published
from workbook.__main__ import main
from workbook.checkout import RESULTS
from workbook.report import diff

NOTEBOOK = "06_characteristic_figure12"
VERDICTS, CLAIMS = (pd.read_csv(RESULTS / f"{name}.csv") for name in ("verdicts", "claims"))
KEPT = VERDICTS.set_index("id").loc["equation10.A2", "reproduced"]


@pytest.fixture
def results(tmp_path):
    """A copy of the committed outcomes."""
    shutil.copytree(RESULTS / "outcomes", tmp_path / "outcomes")
    return tmp_path


def change(results, part, key, **values):
    """Change a cell or a claim of an outcome; take it out if no value is given."""
    file = results / "outcomes" / f"{NOTEBOOK}.json"
    outcome = json.loads(file.read_text("utf-8"))
    rows = [row | values if row["id"] == key else row for row in outcome[part]]
    outcome[part] = [row for row in rows if values or row["id"] != key]
    file.write_text(json.dumps(outcome), encoding="utf-8")


def test_nothing_has_moved_in_the_results_themselves(results):
    assert diff.list_changes(results, VERDICTS, CLAIMS) == []


def test_what_moves_is_listed_with_both_values_and_what_flips_comes_first(results):
    near = published.value("equation10.A1") + 1e-5
    change(results, "cells", "equation10.A2", numbers=2 * KEPT)
    change(results, "cells", "equation10.A1", numbers=near)
    change(results, "claims", "monotone", holds=False)
    change(results, "claims", "error_rad_small", measured="1.9e-05 rad at 3e-04 rad")
    before = VERDICTS.set_index("id").loc["equation10.A1", "reproduced"]
    said = CLAIMS.set_index("id")["measured"]
    assert diff.list_changes(results, VERDICTS, CLAIMS) == [
        f"FLIPS equation10.A2 (authors): consistent -> differs; {KEPT:.6g} -> {2 * KEPT:.6g}",
        f"FLIPS monotone (claim): holds -> does not hold; {said['monotone']}",
        f"moved equation10.A1 (authors): consistent; {before:.6g} -> {near:.6g}",
        f"moved error_rad_small (claim): holds; {said['error_rad_small']} -> 1.9e-05 rad at 3e-04 rad",
    ]


def test_a_change_beyond_the_sixth_digit_is_none(results):
    change(results, "cells", "equation10.A2", numbers=KEPT * (1 + 1e-8))
    assert diff.list_changes(results, VERDICTS, CLAIMS) == []


def test_what_a_notebook_no_longer_decides_and_what_it_decides_anew_are_listed(results):
    measured = CLAIMS.set_index("id")["measured"]["monotone"]
    fewer = CLAIMS[CLAIMS["id"] != "monotone"]
    (line,) = diff.list_changes(results, VERDICTS, fewer)
    assert line == f"FLIPS monotone (claim): not-run -> holds; (none) -> {measured}"
    change(results, "claims", "monotone")
    (line,) = diff.list_changes(results, VERDICTS, CLAIMS)
    assert line == f"FLIPS monotone (claim): holds -> not-run; {measured} -> (none)"


def test_what_was_not_run_here_is_not_listed(results):
    for file in (results / "outcomes").glob("0[2-9]*.json"):
        file.unlink()
    assert diff.list_changes(results, VERDICTS, CLAIMS) == []


@pytest.mark.parametrize(
    ("broken", "why"),
    [
        ("{", "cannot be read"),
        ('{"cells": [{"id": "no.such.cell"}]}', "cannot be read"),
        (None, "no notebook has been run there"),
    ],
)
def test_results_that_are_broken_or_not_there_are_refused_in_one_line(results, broken, why):
    if broken is None:
        shutil.rmtree(results / "outcomes")
    else:
        (results / "outcomes" / f"{NOTEBOOK}.json").write_text(broken, "utf-8")
    with pytest.raises(diff.NotComparable, match=why) as refusal:
        diff.list_changes(results, VERDICTS, CLAIMS)
    assert "\n" not in str(refusal.value)


def test_diff_compares_with_the_last_commit_and_says_in_one_line_where_there_is_none(tmp_path):
    with pytest.raises(diff.NotComparable, match=r"verdicts\.csv: no committed copy") as refusal:
        diff.committed_table("verdicts.csv", tmp_path)
    assert "\n" not in str(refusal.value)
    table = tmp_path / "results" / "verdicts.csv"
    table.parent.mkdir()
    table.write_text("id,verdict\na,reproduced\n", "utf-8")
    identity = ["-c", "user.name=n", "-c", "user.email=n@example.org"]
    for command in (
        ["init", "--quiet"],
        ["add", "."],
        [*identity, "commit", "--quiet", "--message", "results"],
    ):
        subprocess.run(["git", *command], cwd=tmp_path, check=True)
    table.write_text("id,verdict\na,differs\n", "utf-8")
    assert diff.committed_table("verdicts.csv", tmp_path)["verdict"].tolist() == ["reproduced"]


def test_the_command_asks_git_first_and_exits_with_1_and_one_line_where_nothing_is_committed(
    monkeypatch, capsys
):
    def refuse(name):
        raise diff.NotComparable(f"results/{name}: no committed copy")

    monkeypatch.setattr(diff, "committed_table", refuse)
    answers = ["no git", "## main\n M results/verdicts.csv", "## main"]
    monkeypatch.setattr(subprocess, "getoutput", lambda _: answers.pop())
    for ended in (0, 1, 1):
        assert main(["diff"]) == capsys.readouterr().err.count("\n") == ended
