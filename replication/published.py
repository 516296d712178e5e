"""Every number the paper prints, once, from the data files."""

import io
from collections.abc import Mapping
from decimal import Decimal
from functools import cache
from importlib.resources import files

import numpy as np
import pandas as pd

from replication.files import read_committed

DATA = files("replication") / "data"

Criteria = Mapping[str, float] | None  # limits to try in place of those of `claims.csv`, by claim
Measured = tuple[float | tuple[float, float], str]  # what a claim's rule compares, and in words

_INDEX = {"cells": "id", "claims": "id", "errata": "id"}


@cache
def read_data(name: str) -> pd.DataFrame:
    """Read a data file once."""

    def parse(text: str) -> pd.DataFrame:
        table = pd.read_csv(io.StringIO(text), keep_default_na=False, index_col=_INDEX.get(name))
        return table.copy()  # in few blocks, which are quicker to copy

    return read_committed(DATA / f"{name}.csv", parse)


def table(name: str) -> pd.DataFrame:
    """Load a data file by its name.

    "claims": the paper's sentences and what decides each. "errata": what is wrong in print, by kind, with its proof.
    "deviations": which rules were changed after a result, and what each change did to a verdict.
    "authors_notebook_runs", "authors_notebook_generations": what the authors' notebook stores.
    """
    return read_data(name).copy()


def cells(element: str | None = None) -> pd.DataFrame:
    """Load the printed numbers, indexed by cell id, of one element, such as "Table 2", or of all.

    Columns `element, row, column, printed, value, unit, kind, abs_tol, rel_tol, tol_reason, section, quote` (words of
    the paper, for the numbers of its text), `source` (where our number comes from), `reason` (how it is computed, or
    why it cannot be tested), `known_difference` (why it differs).
    """
    printed = table("cells")
    if element is None:
        return printed
    chosen = printed[printed["element"] == element]
    if chosen.empty:
        raise KeyError(
            f"{element}: no such element; there are {', '.join(printed['element'].unique())}"
        )
    return chosen


def value(cell: str) -> float:
    """Printed value of a cell, in the cell's unit; a KeyError if there is no such cell."""
    return float(cells().at[cell, "value"])


def half_last_digit(printed: str) -> float:
    """Half a unit of a printed number's last digit, which is what rounding leaves open."""
    return 0.5 * 10.0 ** int(Decimal(printed.rstrip("%")).as_tuple().exponent)


def column(element: str, name: str) -> np.ndarray:
    """Printed values of one column of a table, in the order of its rows."""
    printed = cells(element)
    values: np.ndarray = printed.loc[printed["column"] == name, "value"].to_numpy(float)
    return values


def criterion(claim: str, criteria: Criteria = None) -> float:
    """The limit that decides a claim: that of `claims.csv`, or the one that `criteria` tries in its place."""
    known = table("claims")["criterion"]
    if unknown := {claim, *(criteria or {})} - set(known.index):
        raise KeyError(
            f"{', '.join(sorted(unknown))}: no such claim; there are {', '.join(known.index)}"
        )
    return float((criteria or {}).get(claim, known[claim]))
