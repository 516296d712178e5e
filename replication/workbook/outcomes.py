"""What a notebook calls: to export its tables, its figures and what it found, and to draw with sliders.

Exports go into the folder that the environment variable `REPLICATION_OUT` names; `execution.execute` sets it.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from replication.files import FLOAT_FORMAT, ROOT, write_csv, write_json
from replication.workbook.judging import CLAIM_VERDICTS, judge

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def output_folder() -> Path:
    """Folder that exports go to; a notebook run by hand writes to `results/lab`."""
    return Path(os.environ.get("REPLICATION_OUT", ROOT / "results" / "lab"))


def notebook_name() -> str:
    """Name of the notebook that runs; one that is run by hand in a server is known by its file."""
    by_hand = os.environ.get("JPY_SESSION_NAME", "by_hand")
    return os.environ.get("REPLICATION_NOTEBOOK", Path(by_hand).stem)


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

    is_quick = os.environ.get("REPLICATION_QUICK") == "1"
    style.save(figure, output_folder() / "figures", name, mark="quick run" if is_quick else "")
    about = {"notebook": notebook_name(), "caption": caption, "axes": style.description(figure)}
    write_json(output_folder() / "results" / "figures" / f"{name}.json", about)


def record_verdicts(
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
        {"id": cell, "source": source, "numbers": _round_to_six_digits(numbers)}
        for source, of_source in (cells or {}).items()
        for cell, numbers in of_source.items()
    ]
    decided: list[dict[str, Any]] = [
        {"id": claim, "holds": None if holds is None else bool(holds), "measured": measured}
        for claim, (holds, measured) in (claims or {}).items()
    ]
    name = notebook_name()
    write_json(output_folder() / "results" / "outcomes" / f"{name}.json", {"cells": rows, "claims": decided})
    judged = judge(pd.DataFrame(rows).assign(notebook=name)).to_dict("records") if rows else []
    judged += [
        {"id": row["id"], "reproduced": row["measured"], "verdict": CLAIM_VERDICTS[row["holds"]]} for row in decided
    ]
    shown = ["id", "source", "printed", "reproduced", "low", "high", "verdict"]
    return pd.DataFrame(judged, columns=shown).astype(object).fillna("")


def _round_to_six_digits(numbers: float | Sequence[float]) -> float | list[float]:
    """Numbers as the results keep them."""
    kept = [float(FLOAT_FORMAT % number) for number in np.ravel(numbers)]
    return kept if np.ndim(numbers) else kept[0]


def sliders(draw: Callable[..., None], **ranges: tuple[float, float, float]) -> None:
    """Draw a picture with a slider for each of its arguments, from the argument's first value, its ends after it.

    Without `ipywidgets` (in the extra `lab`), or in a run that makes the results, the picture is drawn once.
    """
    if "REPLICATION_OUT" in os.environ or not find_spec("ipywidgets"):
        draw(**{name: first for name, (first, _, _) in ranges.items()})
        return
    from ipywidgets import FloatSlider, interact

    made = {
        name: FloatSlider(first, min=low, max=high, step=(high - low) / 100, continuous_update=False)
        for name, (first, low, high) in ranges.items()
    }
    interact(draw, **made)
