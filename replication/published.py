"""Every number the paper prints, once, from the data files beside this module."""

from decimal import Decimal
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable

import numpy as np
import pandas as pd

DATA: Traversable = files("replication") / "data"


def _table(name: str) -> pd.DataFrame:
    with (DATA / name).open(encoding="utf-8") as file:
        return pd.read_csv(file, keep_default_na=False)


@cache
def _cells() -> pd.DataFrame:
    return _table("cells.csv").set_index("id")


def cells(element: str | None = None) -> pd.DataFrame:
    """Load the printed numbers, indexed by cell id.

    Parameters
    ----------
    element : str, optional
        Only this element, such as "Table 2".

    Returns
    -------
    DataFrame
        Columns `element, row, column, printed, value, unit, kind, abs_tol, rel_tol, tol_reason, section`.

    Raises
    ------
    KeyError
        There is no such element.
    """
    table = _cells()
    if element is None:
        return table.copy()
    chosen = table[table["element"] == element]
    if chosen.empty:
        raise KeyError(f"{element}: no such element; there are {', '.join(table['element'].unique())}")
    return chosen.copy()


def value(cell: str) -> float:
    """Printed value of a cell, in the cell's unit.

    Raises
    ------
    KeyError
        There is no such cell.
    """
    return float(_cells().loc[cell, "value"])


def tolerance(cell: str) -> float:
    """Largest difference from the printed value that still reproduces a cell, in the cell's unit."""
    row = _cells().loc[cell]
    return float(row["abs_tol"] + row["rel_tol"] * abs(row["value"]))


def half_last_digit(printed: str) -> float:
    """Half a unit of a printed number's last digit, which is what rounding leaves open."""
    number = Decimal(printed.rstrip("%"))
    return 0.5 * 10.0 ** number.as_tuple().exponent


def column(element: str, name: str) -> np.ndarray:
    """Printed values of one column of a table, in the order of its rows."""
    table = cells(element)
    return table.loc[table["column"] == name, "value"].to_numpy(float)


def claims() -> pd.DataFrame:
    """Prose claims, indexed by id: `claim, section, check, criterion, reason, alternative`."""
    return _table("claims.csv").set_index("id")


def criterion(claim: str) -> float:
    """The number that decides a prose claim, fixed before its result was seen; `check` says what it is compared with.

    Raises
    ------
    KeyError
        There is no such claim.
    """
    return float(claims().loc[claim, "criterion"])


def errata() -> pd.DataFrame:
    """Errata, indexed by id: `location, as_printed, corrected, evidence, effect`."""
    return _table("errata.csv").set_index("id")


def paper_map() -> pd.DataFrame:
    """Where each figure, table and numbered equation is: `element, what, notebooks, functions, test, note`."""
    return _table("map.csv")


def findings() -> pd.DataFrame:
    """What the report begins with: `kind` ("finding" or "open"), `text` with names of numbers in braces, `proof`."""
    return _table("findings.csv")


def paper_figures() -> pd.DataFrame:
    """What the paper's figures show, in our words, and what can be compared, indexed by figure: `shows, compare`."""
    return _table("paper_figures.csv").set_index("figure")


def basis() -> pd.DataFrame:
    """What agreements are worth: `cells` (a pattern), `source`, `basis`, `fails_if`, `test`."""
    return _table("basis.csv")


def known_differences() -> pd.DataFrame:
    """Cells known not to reproduce, with the reason: `id, source, reason`."""
    return _table("differences.csv")


def authors_notebook_runs() -> pd.DataFrame:
    """Load the 30 runs that the authors' notebook stores, on their record 12 (one row a run)."""
    return _table("authors_notebook_runs.csv")


def authors_notebook_generations() -> pd.DataFrame:
    """Load what the authors' notebook prints of runs 1 to 20: one row per printed generation, some 17 of each run."""
    return _table("authors_notebook_generations.csv")
