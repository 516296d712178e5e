import json
import shutil
import subprocess

import pandas as pd
import pytest

from replication import published, workbook
from replication.commands.main import main
from replication.report import flips

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


def test_nothing_has_flipped_in_the_results_themselves(results, before):
    assert flips.flips(results, *before).empty


def test_a_cell_and_a_claim_that_flip_are_listed_and_one_that_only_moves_is_not(results, before):
    notebook = "06_characteristic_figure12"
    printed = published.value("equation10.A2")
    change(results, notebook, "cells", "equation10.A2", reproduced=2 * printed)
    change(results, notebook, "cells", "equation10.A1", reproduced=published.value("equation10.A1") + 1e-5)
    change(results, notebook, "claims", "monotone", holds=False)
    table = flips.flips(results, *before)
    listed = table[["id", "source", "before", "after"]].to_numpy().tolist()
    assert listed == [
        ["equation10.A2", "authors", "consistent", "differs"],
        ["monotone", "claim", "holds", "does not hold"],
    ]
    assert table["value_after"].iloc[0] == 2 * printed


def test_what_was_not_run_here_is_not_listed(results, before):
    for file in (results / "outcomes").glob("0[2-9]*.json"):
        file.unlink()
    assert flips.flips(results, *before).empty


def test_without_a_repository_diff_says_so_in_one_line(tmp_path):
    with pytest.raises(flips.NoCommit, match=r"verdicts\.csv: no committed copy") as refusal:
        flips.committed("verdicts.csv", tmp_path)
    assert "\n" not in str(refusal.value)


def test_diff_compares_with_the_last_commit(tmp_path):
    subprocess.run(["git", "init", "--quiet"], cwd=tmp_path, check=True)
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "verdicts.csv").write_text("id,verdict\na,reproduced\n", encoding="utf-8")
    identity = ["-c", "user.name=n", "-c", "user.email=n@example.org"]
    subprocess.run(["git", "add", "."], cwd=tmp_path, check=True)
    subprocess.run(["git", *identity, "commit", "--quiet", "--message", "results"], cwd=tmp_path, check=True)
    (tmp_path / "results" / "verdicts.csv").write_text("id,verdict\na,differs\n", encoding="utf-8")
    assert flips.committed("verdicts.csv", tmp_path)["verdict"].tolist() == ["reproduced"]


def test_the_command_exits_with_1_and_one_line_where_nothing_is_committed(monkeypatch, capsys):
    def refuse(name):
        raise flips.NoCommit(f"results/{name}: no committed copy")

    monkeypatch.setattr(flips, "committed", refuse)
    assert main(["diff"]) == 1
    assert capsys.readouterr().err.count("\n") == 1
