"""A notebook's verdict: this run's numbers beside the printed and the committed ones, and what the report gets."""

import json
from pathlib import Path

import pandas as pd
import pytest

import workbook
from replication.files import ROOT, UserError
from workbook import outcomes, sources
from workbook.sources import RESULTS

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


GOOD = {
    "cells": [{"id": CELL, "source": "recomputed", "numbers": 1.0}],
    "claims": [{"id": "monotone", "holds": None, "measured": "it is"}],
    "facts": {},
}
WRONG = [
    "",
    '{"cells": [',
    "[]",
    "{}",
    json.dumps(GOOD | {"cells": [{"id": "none", "source": "recomputed", "numbers": 1.0}]}),
    json.dumps(GOOD | {"cells": [{"id": CELL, "source": "recomputed", "numbers": "1.0"}]}),
    json.dumps(GOOD | {"cells": [{"id": CELL, "source": "recomputed", "numbers": {"a": 1.0}}]}),
    json.dumps(GOOD | {"cells": [{"id": CELL, "numbers": 1.0}]}),
    json.dumps(GOOD | {"cells": [CELL]}),
    json.dumps(GOOD | {"claims": [{"id": "monotone", "holds": "yes", "measured": "it is"}]}),
    json.dumps(GOOD | {"facts": {"count": 3}}),
    "[" * 10**5,
]


@pytest.mark.parametrize("text", WRONG)
def test_a_broken_outcome_is_named_with_what_makes_it_again(tmp_path, text):
    source = next(iter(sources.notebook_sources().values()))
    file = tmp_path / "outcomes" / f"{source.stem}.json"
    file.parent.mkdir()
    file.write_text(json.dumps(GOOD), "utf-8")
    assert list(outcomes.load_outcomes(tmp_path)) == [source.stem]
    file.write_text(text, "utf-8")
    with pytest.raises(UserError, match=rf"run notebooks/{source.stem}\.py makes it$") as refused:
        outcomes.load_outcomes(tmp_path)
    assert str(file) in str(refused.value)
    assert "\n" not in str(refused.value)


# --------------------------------------------------------------------------------------- what a notebook makes


def test_the_committed_files_are_those_that_the_notebooks_name():
    named = [
        name
        for source in sources.notebook_sources().values()
        for name in sources.listed_exports(source)
    ]
    assert len(named) == len({*named})
    made = [*ROOT.glob("figures/*"), *ROOT.glob("results/outcomes/*")]
    made += [*ROOT.glob("notebooks/*.ipynb"), *ROOT.glob("notebooks/beyond/*.ipynb")]
    assert {file.relative_to(ROOT).as_posix() for file in made} <= {*named}
    sources.refuse_missing()


@pytest.fixture
def small_project(tmp_path, monkeypatch):
    """A project of one notebook, with everything that it makes."""
    source = tmp_path / "notebooks" / "01_small.py"
    source.parent.mkdir()
    source.write_text(
        'workbook.show_figure("one", figure, "A figure.")\n'
        'workbook.verdict("A sentence.", cells, tables={"small": table})\n'
    )
    for name in sources.listed_exports(source):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("made")
    for name, folder in (("ROOT", ""), ("NOTEBOOKS", "notebooks"), ("RESULTS", "results")):
        monkeypatch.setattr(sources, name, tmp_path / folder)
    monkeypatch.setattr(outcomes, "RESULTS", tmp_path / "results")
    return tmp_path


@pytest.mark.parametrize("damage", [Path.unlink, lambda file: file.write_bytes(b"")])
def test_each_missing_or_empty_file_is_named_with_the_notebook_that_makes_it(damage, small_project):
    sources.refuse_missing()
    files = [file for file in small_project.rglob("*.*") if file.suffix != ".py"]
    assert len(files) == 5
    for file in files:
        damage(file)
        says = rf"^{file.relative_to(small_project)} is missing or empty; .* run notebooks/01_small\.py"
        with pytest.raises(UserError, match=says):
            sources.refuse_missing()
        file.write_text("made again")


def test_an_outcome_that_no_notebook_makes_any_more_is_named(small_project):
    source = small_project / "notebooks" / "01_small.py"
    source.write_text(source.read_text().replace("cells, ", ""))
    with pytest.raises(UserError, match=r"01_small\.json: no notebook makes it; git checkout"):
        sources.refuse_missing()
    source.unlink()
    with pytest.raises(UserError, match=r"01_small\.json: no notebook makes it; git checkout"):
        sources.refuse_missing()


def test_a_kept_table_that_is_missing_is_named(small_project):
    with pytest.raises(UserError, match=r"peers\.csv is missing; git checkout"):
        outcomes.read_kept("peers")
