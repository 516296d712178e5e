"""What an agreement with a printed number is worth, and what it should be where it is wrong."""

from dataclasses import dataclass
from fnmatch import fnmatchcase

import pandas as pd

from replication import published


def of(cell: str, source: str) -> pd.Series:
    """What an agreement with a cell would be worth.

    Parameters
    ----------
    cell, source : str
        Cell id, and where our number comes from: "authors", "chosen", "simulated" or "stand-in".

    Returns
    -------
    Series
        `basis` is "evidence", "consistent" (follows from other printed numbers), "given" (taken over from the paper)
        or "undecided" (only unpublished data could tell). `fails_if` says what would have made the cell fail, or why
        nothing could.

    Raises
    ------
    KeyError
        `basis.csv` says nothing of such a cell.
    """
    for _, row in published.basis().iterrows():
        if fnmatchcase(cell, row["cells"]) and row["source"] in (source, "*"):
            return row
    raise KeyError(f"{cell}, {source}: no row of basis.csv is about it")


@dataclass(frozen=True)
class Correction:
    """What a cell should print: the number, what its last digit leaves open, and the erratum's words."""

    value: float
    tolerance: float
    corrected: str


def correction(cell: str) -> Correction | None:
    """Corrected value of a cell that an erratum names, if one does."""
    for _, row in published.errata().iterrows():
        for part in row["cells"].split():
            name, _, number = part.partition("=")
            if name == cell:
                return Correction(float(number), published.half_last_digit(number), row["corrected"])
    return None
