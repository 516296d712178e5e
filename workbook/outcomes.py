"""What a notebook reads and leaves: tables, figures, and one outcome, which the report is made from.

The outcome, `results/outcomes/NAME.json`, holds numbers of printed cells ("cells"), decisions on claims ("claims") and
values that the report's template reads ("facts"). `python -m workbook run` names the folder by the environment variable
REPLICATION_OUT; a notebook that is run by hand writes nothing.
"""

import io
import json
import os
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from replication.files import (
    FLOAT_FORMAT,
    UserError,
    check_kept,
    read_committed,
    write_csv,
    write_json,
)
from workbook.project import RESULTS, ROOT, SETTINGS, SIMULATED, notebook_sources
from workbook.stamps import record_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Numbers = float | Mapping[str, Sequence[float]]  # one, or realisations by setting
Cells = Mapping[str, Numbers]
Decisions = Mapping[str, tuple[bool | None, str]]

OUTPUT_FOLDER = os.environ.get("REPLICATION_OUT", "")


# -------------------------------------------------------------------------------------------------------------- read


def read_table(name: str) -> pd.DataFrame:
    """Read a table that the settings name: "cells", "claims", "errata", "deviations"; by id, if it has one."""
    if name not in SETTINGS:
        raise UserError(f"{ROOT / 'pyproject.toml'}: [tool.workbook] names no {name}")
    return _read_table(ROOT / SETTINGS[name]).copy()


@cache
def _read_table(file: Path) -> pd.DataFrame:
    table = read_committed(file, lambda text: pd.read_csv(io.StringIO(text), keep_default_na=False))
    return table.set_index("id") if "id" in table else table


def read_made(name: str) -> pd.DataFrame:
    """Read `results/NAME.csv`, a table that a notebook or the report makes."""
    return read_committed(RESULTS / f"{name}.csv", lambda text: pd.read_csv(io.StringIO(text)))


def read_kept(name: str) -> pd.DataFrame:
    """Read `results/NAME.csv`, a table that a study has made and `make all` does not make again."""
    table = read_made(name)
    check_kept(RESULTS / f"{name}.csv")
    return table


def data_are_simulated() -> bool:
    """Whether this run has simulated data in place of data that could not be had."""
    return os.environ.get(SIMULATED.get("variable", "")) == "simulated"


# -------------------------------------------------------------------------------------------------------------- show


def say(sentence: str) -> None:
    """Show a sentence in Markdown, made of this run's numbers."""
    from IPython.display import Markdown, display

    display(Markdown(sentence))


def show(figure: "Figure", finding: str) -> None:
    """Show a figure, and below it what is to be seen in it."""
    from IPython.display import display
    from matplotlib import pyplot as plt

    plt.close(figure)  # so that the end of the cell does not show it again
    display(figure)
    say(finding)


def show_figure(name: str, figure: "Figure", caption: str) -> None:
    """Show a figure with its caption, and write it to `figures/NAME.svg`; by hand nothing is written.

    A name such as `figure12_...` or `table2_...` says which element of the paper it belongs to.
    """
    from workbook.pictures import save

    show(figure, caption)
    if OUTPUT_FOLDER:
        mark = SIMULATED["mark"] if data_are_simulated() else ""
        save(figure, Path(OUTPUT_FOLDER) / "figures", name, mark)


# ------------------------------------------------------------------------------------------------------------- export


def cell_rows(cells: Cells) -> list[dict[str, Any]]:
    """Our numbers by cell id as rows `id, source, numbers`, with the six digits that results have.

    The source is the table's, or simulated data where these take the place of others.
    """
    sources = read_table("cells")["source"]
    if data_are_simulated():
        sources = sources.replace(SIMULATED["in_place_of"], SIMULATED["source"])
    return [
        {
            "id": cell,
            "source": sources[cell],
            "numbers": as_fact(numbers if isinstance(numbers, Mapping) else float(numbers)),
        }
        for cell, numbers in cells.items()
    ]


def as_fact(value: Any) -> Any:
    """A value as JSON has it, its numbers with the six digits that results have."""
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(name): as_fact(each) for name, each in value.items()}
    if hasattr(value, "tolist"):  # an array, or a number of one
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [*map(as_fact, value)]
    return float(FLOAT_FORMAT % value) if isinstance(value, float) else value


def save_outcome(
    cells: Cells, claims: Decisions, facts: Mapping[str, Any], tables: Mapping[str, pd.DataFrame]
) -> None:
    """Write what a notebook has computed, as `workbook.verdict` takes it; by hand nothing is written."""
    if not OUTPUT_FOLDER:
        return
    results = Path(OUTPUT_FOLDER) / "results"
    for name, table in tables.items():
        write_csv(results / f"{name}.csv", table)
    outcome = {
        "cells": cell_rows(cells),
        "claims": [
            {"id": claim, "holds": holds, "measured": words}
            for claim, (holds, words) in claims.items()
        ],
        "facts": as_fact(facts),
    }
    write_json(results / "outcomes" / f"{os.environ['REPLICATION_NOTEBOOK']}.json", outcome)


def load_outcomes() -> dict[str, dict[str, Any]]:
    """Load the outcome of each notebook that is there, by its name."""
    files = map(record_file, notebook_sources())
    return {file.stem: read_committed(file, json.loads) for file in files if file.exists()}
