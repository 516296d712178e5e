"""What a notebook calls to export its tables, its figures and what it found.

Exports go into the folder that the environment variable `REPLICATION_OUT` names; `execution.execute` sets it.
"""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from replication.workbook.files import FLOAT_FORMAT, ROOT, write_csv, write_json
from replication.workbook.judging import judge

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def output_folder() -> Path:
    """Folder that exports go to; a notebook run by hand writes to `results/lab`."""
    return Path(os.environ.get("REPLICATION_OUT", ROOT / "results" / "lab"))


def is_quick() -> bool:
    """Whether this is a quick run, whose figures say so."""
    return os.environ.get("REPLICATION_QUICK") == "1"


def save_table(table: pd.DataFrame, name: str) -> None:
    """Export a result table as `results/<name>.csv`."""
    write_csv(output_folder() / "results" / f"{name}.csv", table)


def save_figure(figure: "Figure", name: str) -> None:
    """Export a figure as `figures/<name>.svg` and `.png`, without anything that differs from run to run."""
    from replication.figures import style  # Matplotlib takes a second that only a figure should cost

    style.save(figure, output_folder() / "figures", name, mark="quick run" if is_quick() else "")


def save_outcome(
    notebook: str,
    cells: Mapping[str, Mapping[str, float]] | None = None,
    claims: Mapping[str, tuple[bool, str]] | None = None,
    inputs: Mapping[str, str] | None = None,
    seeds: Iterable[int] = (),
) -> pd.DataFrame:
    """Export what a notebook found about printed cells and claims, and what it was made from.

    Parameters
    ----------
    notebook : str
        The notebook's name.
    cells : mapping of source to mapping of cell id to number
        Reproduced values in each cell's unit; a source is "authors", "simulated" or "stand-in".
    claims : mapping of claim id to (holds, what was measured)
        Decisions on prose claims.
    inputs : mapping of path to SHA-256
        Files of the authors' data that it read.
    seeds : iterable of int
        Seeds it used.

    Returns
    -------
    DataFrame
        The verdicts on these cells, to be shown.
    """
    rows = [
        {"id": cell, "source": source, "reproduced": float(FLOAT_FORMAT % number)}
        for source, numbers in (cells or {}).items()
        for cell, number in numbers.items()
    ]
    outcome = {
        "cells": rows,
        "claims": [{"id": key, "holds": bool(ok), "measured": text} for key, (ok, text) in (claims or {}).items()],
        "inputs": dict(sorted((inputs or {}).items())),
        "seeds": sorted(set(seeds)),
    }
    write_json(output_folder() / "results" / "outcomes" / f"{notebook}.json", outcome)
    return judge(pd.DataFrame(rows).assign(notebook=notebook)) if rows else pd.DataFrame()
