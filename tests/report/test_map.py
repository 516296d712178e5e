"""The map of the paper: every figure, table and equation has its place."""

import importlib
import re

import pytest

import workbook
from replication import published
from workbook.checkout import notebook_files


def test_the_map_covers_every_figure_table_and_numbered_equation_of_the_paper():
    elements = published.table("map")["element"].tolist()
    expected = [f"Figure {k}" for k in range(1, 14)] + [f"Table {k}" for k in range(1, 5)]
    assert elements == expected + [f"Equation {k}" for k in range(1, 20)]


@pytest.mark.parametrize(
    "row", published.table("map").to_dict("records"), ids=lambda row: row["element"]
)
def test_what_the_map_names_exists(row):
    for name in row["notebooks"].split():
        source = notebook_files("py")[name].read_text("utf-8")
        assert name in notebook_files("ipynb")
        number = re.search(r"\d+", row["element"])[0]
        if row["element"].startswith(("Figure", "Table")):
            kind = row["element"].split()[0].lower()
            assert re.search(rf"{kind}s?[^.]*\b{number}\b|{kind}0?{number}_", source, re.IGNORECASE)
    for name in row["functions"].split():
        module, _, function = name.rpartition(".")
        module = module if module.startswith("studies.") else f"replication.{module}"
        assert callable(getattr(importlib.import_module(module), function))
    if row["test"]:
        file, _, test = row["test"].partition("::")
        assert f"def {test}(" in (workbook.ROOT / file).read_text("utf-8")
    assert row["test"] or row["note"], "not reproduced, and no reason given"
    for erratum in re.findall(r"\bE\d+\b", row["note"]):
        assert erratum in published.table("errata").index
