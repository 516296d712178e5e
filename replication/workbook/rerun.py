"""Make one result again: the notebooks that make it, executed apart from the results."""

import tempfile
from pathlib import Path

import pandas as pd

from replication import published
from replication.workbook import execution, judging
from replication.workbook.files import ROOT

COLUMNS = ["id", "source", "reproduced", "verdict", "notebook"]


class NotMade(ValueError):
    """No notebook makes this."""


def rerun(name: str, results: Path) -> pd.DataFrame:
    """Execute what makes a cell, an element's cells or a claim; return each number and verdict before and now."""
    before = _made_by_notebooks(results)
    element = published.cells()["element"].reindex(before["id"]).fillna("").str.lower().str.replace(" ", "").to_numpy()
    wanted = before[(before["id"].str.lower() == name.lower()) | (element == name.lower().replace(" ", ""))]
    if wanted.empty:
        raise NotMade(f"{name}: no notebook makes it")
    now = pd.concat([_executed(notebook) for notebook in sorted(set(wanted["notebook"]))])
    return wanted.merge(now.drop(columns="notebook"), on=["id", "source"], how="left", suffixes=("_before", "_now"))


def _executed(notebook: str) -> pd.DataFrame:
    with tempfile.TemporaryDirectory() as folder:
        execution.execute(ROOT / "notebooks" / f"{notebook}.py", destination=Path(folder))
        return _made_by_notebooks(Path(folder) / "results")


def _made_by_notebooks(results: Path) -> pd.DataFrame:
    """Cells and claims that notebooks made; what a claim measured is its number."""
    cells = judging.verdicts(results).reindex(columns=COLUMNS)
    claims = judging.decided_claims(results).rename(columns={"measured": "reproduced"}).assign(source="")
    return pd.concat([cells[cells["notebook"].notna() & cells["notebook"].ne("")], claims[COLUMNS]], ignore_index=True)
