"""What a notebook exports, and how it is read again: its tables and figures, and one outcome.

The outcome, `results/outcomes/<notebook>.json`, holds its numbers of printed cells ("cells"),
decisions on claims ("claims"), numbers for texts ("facts"), captions and axes of its "figures", a
sentence on each table of the "supplement", and the "files" that it wrote into the results. The
recorder adds what all of it was made from ("made_from").

Exports go into the folder that the environment variable `REPLICATION_OUT` names, which
`execution.execute` sets.
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
from replication.files import FLOAT_FORMAT, ROOT, write_csv, write_json
from replication.sources import records_are_simulated
from workbook.checkout import notebook_files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Numbers = float | Mapping[str, Sequence[float]]  # one, or realisations by setting
Cells = Mapping[str, Numbers]
Claims = Mapping[str, tuple[bool | None, str]]
Facts = Mapping[str, str | int | tuple[Any, str]]

# What an output's metadata names: the figure that it shows, or whose caption it is.
FIGURE = "figure"

# Of a notebook that exports nothing.
EMPTY: dict[str, Any] = {
    part: {} for part in ("cells", "claims", "facts", "figures", "supplement", "files")
}


class Sentence(str):
    """A text that a notebook shows as Markdown, and a terminal as it is."""

    __repr__ = str.__str__

    def _repr_markdown_(self) -> str:
        return str(self)


def output_folder() -> Path:
    """Folder that exports go to; a notebook run by hand writes to `results/lab`."""
    return Path(os.environ.get("REPLICATION_OUT", ROOT / "results" / "lab"))


def notebook_name() -> str:
    """Name of the notebook that runs; one that is run by hand in a server is known by its file."""
    by_hand = os.environ.get("JPY_SESSION_NAME", "by_hand")
    return os.environ.get("REPLICATION_NOTEBOOK", Path(by_hand).stem)


def export(
    tables: Mapping[str, pd.DataFrame] | None = None,
    cells: Cells | None = None,
    claims: Claims | None = None,
    facts: Facts | None = None,
    supplement: Mapping[str, tuple[pd.DataFrame, str]] | None = None,
    pages: Mapping[str, Mapping] | None = None,
) -> dict[str, Any]:
    """Write what a notebook found, without what differs between runs; called once, at its end; return the outcome.

    Parameters
    ----------
    tables : mapping of str to DataFrame
        Tables by name that a text, a page or another notebook reads.
    cells, claims : mappings
        Our numbers and decisions, as `workbook.judge` takes them.
    facts : mapping of str to str, int or (number or numbers, str)
        What texts name in braces: a text, a count, or a number with its format. Several numbers are
        two facts, the smallest, `<name>_low`, and the largest, `<name>_high`. A number that is not
        there (nan) is no fact.
    supplement : mapping of str to (DataFrame, str)
        Tables that only a reader may want, each with a sentence.
    pages : mapping of str to mapping
        What a page draws, such as `replay_explorer`, by the page's name.
    """
    results = output_folder() / "results"
    before = _noted()
    if "files" in before:
        raise RuntimeError("workbook.export is called again: one closing cell exports everything")
    supplement = supplement or {}
    written = {f"{name}.csv": table for name, table in (tables or {}).items()}
    written |= {f"supplement/{name}.csv": table for name, (table, _) in supplement.items()}
    for file, table in written.items():
        write_csv(results / file, table)
    drawn = {f"pages/{name}.json": dict(content) for name, content in (pages or {}).items()}
    for file, content in drawn.items():
        write_json(results / file, content)
    outcome = {
        "cells": cell_rows(cells or {}),
        "claims": [
            {"id": claim, "holds": None if holds is None else bool(holds), "measured": measured}
            for claim, (holds, measured) in (claims or {}).items()
        ],
        "facts": _fact_texts(facts or {}),
        "figures": before.get("figures", {}),
        "supplement": {name: sentence for name, (_, sentence) in supplement.items()},
        "files": [*written, *drawn],
    }
    write_json(_note(), outcome)
    return outcome


def show_figure(name: str, figure: "Figure", caption: str) -> None:
    """Show a figure with its caption, and write it for the report.

    A name such as `figure12_...` or `table2_...` says which element of the paper it belongs to. By
    hand nothing is written: that takes seconds.
    """
    from IPython.display import display
    from matplotlib import pyplot as plt

    from replication import figures

    plt.close(figure)  # so that the end of the cell does not show it again
    display(figure, metadata={FIGURE: name})
    display(Sentence(caption), metadata={FIGURE: name})
    if "REPLICATION_OUT" not in os.environ:
        return
    mark = "simulated records" if records_are_simulated() else ""
    if os.environ.get("REPLICATION_QUICK") == "1":
        mark = "quick run"
    figures.save(figure, output_folder() / "figures", name, mark)
    before = _noted()
    about = {name: {"caption": caption, "axes": figures.description(figure)}}
    write_json(_note(), before | {"figures": before.get("figures", {}) | about})


def _note() -> Path:
    """File of the outcome of the notebook that runs."""
    return output_folder() / "results" / "outcomes" / f"{notebook_name()}.json"


def _noted() -> dict[str, Any]:
    """What a run has noted of its outcome; one by hand begins anew."""
    if "REPLICATION_OUT" not in os.environ or not _note().exists():
        return {}
    return json.loads(_note().read_text(encoding="utf-8"))


def cell_rows(cells: Cells) -> list[dict[str, Any]]:
    """Our numbers by cell id as rows, with six digits."""
    return [
        {"id": cell, "source": source_of(cell), "numbers": _round_to_six_digits(numbers)}
        for cell, numbers in cells.items()
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
    texts = {}
    for name, fact in facts.items():
        if not isinstance(fact, tuple):
            texts[name] = str(fact)
            continue
        given, form = fact
        numbers = [number for number in np.ravel(given) if not math.isnan(number)]
        if numbers and np.ndim(given):
            texts[f"{name}_low"] = format(min(numbers), form)
            texts[f"{name}_high"] = format(max(numbers), form)
        elif numbers:
            texts[name] = format(numbers[0], form)
    return texts


def load_outcomes(results: Path) -> dict[str, dict[str, Any]]:
    """Load the outcome of each notebook that is there, by its name."""
    there = notebook_files("py")
    return {name: outcome for name, outcome in read_outcomes(results).items() if name in there}


def read_outcomes(results: Path) -> dict[str, dict[str, Any]]:
    """Load every outcome in a results folder, by the name of its run."""
    return {
        file.stem: EMPTY | json.loads(file.read_text(encoding="utf-8"))
        for file in sorted((results / "outcomes").glob("*.json"))
    }
