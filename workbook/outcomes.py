"""What a notebook shows and exports: figures, its verdict, its tables, and one outcome, which is read again here.

The outcome, `results/outcomes/NAME.json`, holds numbers of printed cells ("cells"), decisions on
claims ("claims") and numbers for texts ("facts"). `python -m workbook run`
names the folder by the environment variable REPLICATION_OUT; a notebook that is run by hand writes
nothing.
"""

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from replication import published
from replication.records import (
    FLOAT_FORMAT,
    ROOT,
    UserError,
    records_are_simulated,
    write_csv,
    write_json,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Numbers = float | Mapping[str, Sequence[float]]  # one, or realisations by setting
Cells = Mapping[str, Numbers]
Claims = Mapping[str, tuple[bool | None, str]]
Facts = Mapping[str, str | int | tuple[Any, str]]

NOTEBOOKS, RESULTS = ROOT / "notebooks", ROOT / "results"
OUTPUT_FOLDER = os.environ.get("REPLICATION_OUT", "")


def notebook_files(ending: str) -> dict[str, Path]:
    """Files of the paper's notebooks and of those beyond it by name, in the order of their numbers."""
    files = [*NOTEBOOKS.glob(f"[0-9]*.{ending}"), *NOTEBOOKS.glob(f"beyond/[0-9]*.{ending}")]
    return {path.stem: path for path in sorted(files, key=lambda path: path.name)}


class Sentence(str):
    """A text that a notebook shows as Markdown, and a terminal as it is."""

    __repr__ = str.__str__

    def _repr_markdown_(self) -> str:
        return str(self)


def export(
    cells: Cells | None = None,
    claims: Claims | None = None,
    facts: Facts | None = None,
    tables: Mapping[str, pd.DataFrame] | None = None,
) -> None:
    """Write what a notebook has computed; called once, in its last cell. By hand nothing is written.

    Parameters
    ----------
    cells : mapping of str to float, or to a mapping of str to floats
        Our number for each printed number, by its id in `cells.csv`; or its realisations by setting.
    claims : mapping of str to (bool or None, str)
        Whether each claim of `claims.csv` holds, None if that is undecided, and what was measured.
    facts : mapping of str to str, int or (number or numbers, str)
        Numbers that the report's sentences name in braces: a text, a count, or a number with its
        format. Several numbers are two facts, the smallest, `<name>_low`, and the largest,
        `<name>_high`. A number that is not there (nan) is no fact.
    tables : mapping of str to DataFrame
        Written to `results/NAME.csv` with six significant digits.
    """
    if not OUTPUT_FOLDER:
        return
    results = Path(OUTPUT_FOLDER) / "results"
    for name, table in (tables or {}).items():
        write_csv(results / f"{name}.csv", table)
    outcome = {
        "cells": cell_rows(cells or {}),
        "claims": claim_rows(claims or {}),
        "facts": _fact_texts(facts or {}),
    }
    write_json(results / "outcomes" / f"{os.environ['REPLICATION_NOTEBOOK']}.json", outcome)


def show_figure(name: str, figure: "Figure", caption: str) -> None:
    """Show a figure with its caption, and write it to `figures/NAME.svg`; by hand nothing is written.

    A name such as `figure12_...` or `table2_...` says which element of the paper it belongs to.
    """
    from IPython.display import display
    from matplotlib import pyplot as plt

    from replication import figures

    plt.close(figure)  # so that the end of the cell does not show it again
    display(figure)
    display(Sentence(caption))
    if OUTPUT_FOLDER:
        mark = "simulated records" if records_are_simulated() else ""
        figures.save(figure, Path(OUTPUT_FOLDER) / "figures", name, mark)


def cell_rows(cells: Cells) -> list[dict[str, Any]]:
    """Our numbers by cell id as rows, with six digits."""
    return [
        {"id": cell, "source": source_of(cell), "numbers": _round_to_six_digits(numbers)}
        for cell, numbers in cells.items()
    ]


def claim_rows(claims: Claims) -> list[dict[str, Any]]:
    """Decisions by claim as rows."""
    return [
        {"id": claim, "holds": None if holds is None else bool(holds), "measured": measured}
        for claim, (holds, measured) in claims.items()
    ]


def source_of(cell: str) -> str:
    """Where our number comes from: as `cells.csv` says, or our joint where its records take the authors' place."""
    source = published.cells().loc[cell, "source"]
    ours = source in ("recomputed", "authors' files") and records_are_simulated()
    return "simulated joint" if ours else source


def _round_to_six_digits(numbers: Numbers) -> float | dict[str, list[float]]:
    """Numbers as the results keep them."""
    if isinstance(numbers, Mapping):
        return {name: [float(FLOAT_FORMAT % x) for x in each] for name, each in numbers.items()}
    return float(FLOAT_FORMAT % numbers)


def _fact_texts(facts: Facts) -> dict[str, str]:
    """Facts as the report writes them."""
    texts = {}
    for name, fact in facts.items():
        given, form = fact if isinstance(fact, tuple) else (fact, "")
        if isinstance(given, str):
            texts[name] = given
            continue
        numbers = [number for number in np.ravel(given) if not math.isnan(number)]
        if numbers and np.ndim(given):
            texts[f"{name}_low"] = format(min(numbers), form)
            texts[f"{name}_high"] = format(max(numbers), form)
        elif numbers:
            texts[name] = format(numbers[0], form)
    return texts


def load_outcomes(results: Path) -> dict[str, dict[str, Any]]:
    """Load the outcome of each notebook that is there, by its name."""
    outcomes = {}
    for name, source in notebook_files("py").items():
        file = results / "outcomes" / f"{name}.json"
        if file.exists():
            try:
                outcomes[name] = json.loads(file.read_text(encoding="utf-8"))
            except ValueError as error:
                again = f"python -m workbook run {source.relative_to(ROOT)} makes it again"
                raise UserError(
                    f"{file}: not the outcome of a notebook ({error}); {again}"
                ) from error
    return outcomes
