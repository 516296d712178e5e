"""What a notebook calls to export its tables, its figures and what it found.

Exports go into the folder that the environment variable `REPLICATION_OUT` names; `execution.execute` sets it.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from replication.workbook.files import FLOAT_FORMAT, ROOT, write_csv, write_json
from replication.workbook.judging import CLAIM_VERDICTS, judge

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


def save_figure(figure: "Figure", name: str, caption: str) -> None:
    """Export a figure as `figures/<name>.svg` and `.png`, without anything that differs from run to run.

    Parameters
    ----------
    figure : Figure
        What to export.
    name : str
        File name without its ending; `figure12_...` and `table2_...` say which element of the paper it belongs to.
    caption : str
        A sentence or two that say what to see; kept with the axes in `results/figures/<name>.json`.
    """
    from replication.figures import style  # Matplotlib takes a second that only a figure should cost

    style.save(figure, output_folder() / "figures", name, mark="quick run" if is_quick() else "")
    about = {"notebook": notebook_name(), "caption": caption}
    about["axes"] = style.description(figure)
    write_json(output_folder() / "results" / "figures" / f"{name}.json", about)


def notebook_name() -> str:
    """Name of the notebook that runs; one that is run by hand in a server is known by its file."""
    by_hand = os.environ.get("JPY_SESSION_NAME", "by_hand")
    return os.environ.get("REPLICATION_NOTEBOOK", Path(by_hand).stem)


def verdict(
    cells: Mapping[str, Mapping[str, float | Sequence[float]]] | None = None,
    claims: Mapping[str, tuple[bool | None, str]] | None = None,
) -> pd.DataFrame:
    """Export what a notebook found about printed cells and claims, and return the verdicts on them.

    Parameters
    ----------
    cells : mapping of source to mapping of cell id to number
        Our numbers in each cell's unit; a source is "authors", "simulated" or "stand-in". A sequence holds one number
        for each noise realisation.
    claims : mapping of claim id to (holds, what was measured)
        Decisions on prose claims; None in place of a truth value is "undecided".
    """
    rows = [
        {"id": cell, "source": source, "numbers": _kept(numbers)}
        for source, of_source in (cells or {}).items()
        for cell, numbers in of_source.items()
    ]
    decided = [
        {"id": key, "holds": None if holds is None else bool(holds), "measured": text}
        for key, (holds, text) in (claims or {}).items()
    ]
    name = notebook_name()
    write_json(output_folder() / "results" / "outcomes" / f"{name}.json", {"cells": rows, "claims": decided})
    judged = judge(pd.DataFrame(rows).assign(notebook=name)) if rows else pd.DataFrame()
    said = pd.DataFrame(
        [{"id": row["id"], "reproduced": row["measured"], "verdict": CLAIM_VERDICTS[row["holds"]]} for row in decided]
    )
    table = pd.concat([part for part in (judged, said) if not part.empty], ignore_index=True)
    shown = ["id", "source", "printed", "reproduced", "low", "high", "verdict"]
    return table.reindex(columns=shown).astype(object).where(lambda t: t.notna(), "")


def _kept(numbers: float | Sequence[float]) -> float | list[float]:
    """Numbers as the results keep them, to six digits."""
    if np.ndim(numbers):
        return [float(FLOAT_FORMAT % number) for number in numbers]
    return float(FLOAT_FORMAT % numbers)
