"""What a notebook calls: to check its parameters, judge and export what it found, and draw with sliders.

Exports go into the folder that the environment variable `REPLICATION_OUT` names; `execution.execute` sets it.
"""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from replication.files import FLOAT_FORMAT, ROOT, write_csv, write_json
from workbook.judging import CLAIM_VERDICTS, judge_rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Cells = Mapping[str, Mapping[str, float | Sequence[float]]]
Claims = Mapping[str, tuple[bool | None, str]]

pd.set_option("display.max_colwidth", None, "display.max_columns", None, "display.max_rows", 200)  # tables in full


def output_folder() -> Path:
    """Folder that exports go to; a notebook run by hand writes to `results/lab`."""
    return Path(os.environ.get("REPLICATION_OUT", ROOT / "results" / "lab"))


def notebook_name() -> str:
    """Name of the notebook that runs; one that is run by hand in a server is known by its file."""
    by_hand = os.environ.get("JPY_SESSION_NAME", "by_hand")
    return os.environ.get("REPLICATION_NOTEBOOK", Path(by_hand).stem)


def export(
    tables: Mapping[str, pd.DataFrame] | None = None,
    figures: "Mapping[str, tuple[Figure, str]] | None" = None,
    cells: Cells | None = None,
    claims: Claims | None = None,
) -> None:
    """Write a notebook's tables, figures with captions, and what `judge` takes, without what differs between runs.

    The name of a figure, such as `figure12_...` or `table2_...`, says which element of the paper it belongs to.
    """
    results = output_folder() / "results"
    for name, table in (tables or {}).items():
        write_csv(results / f"{name}.csv", table)
    for name, (figure, caption) in (figures or {}).items():
        from replication.figures import style

        is_quick = os.environ.get("REPLICATION_QUICK") == "1"
        style.save(figure, output_folder() / "figures", name, mark="quick run" if is_quick else "")
        about = {"notebook": notebook_name(), "caption": caption, "axes": style.description(figure)}
        write_json(results / "figures" / f"{name}.json", about)
    if cells or claims:
        outcome = {"cells": _cell_rows(cells or {}), "claims": _claim_rows(claims or {})}
        write_json(results / "outcomes" / f"{notebook_name()}.json", outcome)


def judge(cells: Cells | None = None, claims: Claims | None = None) -> pd.DataFrame:
    """Judge our numbers by source and cell id, and decisions on claims with what was measured, by claim id.

    A source is "authors", "simulated" or "stand-in"; a sequence of numbers holds one for each noise realisation. A
    claim whose truth value is None is undecided.
    """
    rows = _cell_rows(cells or {})
    judged = judge_rows(pd.DataFrame(rows).assign(notebook=notebook_name())).to_dict("records") if rows else []
    judged += [
        {"id": row["id"], "reproduced": row["measured"], "verdict": CLAIM_VERDICTS[row["holds"]]}
        for row in _claim_rows(claims or {})
    ]
    shown = ["id", "source", "printed", "reproduced", "low", "high", "verdict"]
    return pd.DataFrame(judged, columns=shown).astype(object).fillna("")


def _cell_rows(cells: Cells) -> list[dict[str, Any]]:
    return [
        {"id": cell, "source": source, "numbers": _round_to_six_digits(numbers)}
        for source, of_source in cells.items()
        for cell, numbers in of_source.items()
    ]


def _claim_rows(claims: Claims) -> list[dict[str, Any]]:
    return [
        {"id": claim, "holds": None if holds is None else bool(holds), "measured": measured}
        for claim, (holds, measured) in claims.items()
    ]


def _round_to_six_digits(numbers: float | Sequence[float]) -> float | list[float]:
    """Numbers as the results keep them."""
    kept = [float(FLOAT_FORMAT % number) for number in np.ravel(numbers)]
    return kept if np.ndim(numbers) else kept[0]


@dataclass(frozen=True)
class Interval:
    """Numbers from `low` to `high`, as what a parameter may be."""

    low: float
    high: float = math.inf
    whole: bool = False

    def __contains__(self, value: object) -> bool:
        return isinstance(value, int if self.whole else int | float) and self.low <= value <= self.high

    def __str__(self) -> str:
        above = f" to {self.high:g}" if math.isfinite(self.high) else " on"
        return f"a {'whole ' if self.whole else ''}number from {self.low:g}{above}"


def check_parameters(**parameters: tuple[Any, Any]) -> None:
    """Refuse in one sentence a parameter whose value is not allowed; of a list each item, of a mapping each key.

    Each parameter comes with its value and what is allowed: an `Interval` or a collection. A list of one of these asks
    for a list.
    """
    for name, (value, allowed) in parameters.items():
        if is_list := isinstance(allowed, list):
            (allowed,) = allowed
        if isinstance(allowed, range) and len(allowed) > 20:
            allowed = Interval(allowed[0], allowed[-1], whole=True)
        choices = str(allowed) if isinstance(allowed, Interval) else "one of " + ", ".join(map(repr, allowed))
        if is_list != isinstance(value, list | tuple | range | Mapping):
            wanted = f"a list, each item {choices}" if is_list else choices
            raise ValueError(f"{name} = {value!r}: it should be {wanted}")
        wrong = [item for item in (value if is_list else [value]) if item not in allowed]
        if wrong:
            raise ValueError(f"{name} = {value!r}: {wrong[0]!r} should be {choices}")


def sliders(draw: Callable[..., None], **ranges: tuple[float, float, float]) -> None:
    """Draw a picture, and below it, by hand in JupyterLab, the same with a slider for each of its arguments.

    A range holds an argument's first value and its ends. The picture that is drawn without sliders stays in the saved
    notebook.
    """
    draw(**{name: first for name, (first, _, _) in ranges.items()})
    if "REPLICATION_OUT" in os.environ or not find_spec("ipywidgets"):
        return
    from ipywidgets import FloatSlider, interact

    made = {
        name: FloatSlider(first, min=low, max=high, step=(high - low) / 100, continuous_update=False)
        for name, (first, low, high) in ranges.items()
    }
    interact(draw, **made)
