"""Printed numbers and claims beside ours: a `Cell` for each number of the paper, with its verdict."""

import math
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

import pandas as pd

from replication import published
from replication.files import ROOT
from workbook import judging
from workbook.checkout import notebook_files
from workbook.report import TEMPLATES

# A sign beside each word, so that colour is never the only difference; a hollow one for a weak agreement.
SIGNS = {
    "agrees": "●",
    "agrees weakly": "○",
    "differs": "✗",
    "not tested": "–",
    "holds": "✓",
    "does not hold": "✗",
    "undecided": "?",
    "not decided": "–",
}


@dataclass(frozen=True)
class Cell:
    """A printed number, a row of `cells.csv`, with what the verdicts say of it."""

    id: str
    element: str
    row: str
    column: str
    printed: str
    value: float
    unit: str
    kind: str
    abs_tol: float
    rel_tol: float
    tol_reason: str
    section: str
    quote: str
    known_difference: str
    published: float
    reproduced: float
    low: float
    high: float
    agreement: str
    source: str
    resolution: float
    settings: str
    reason: str
    notebook: str

    @property
    def name(self) -> str:
        """Its place in the paper: "Table 2, row 3, sd"."""
        row = f"row {self.row}" if self.row.isdigit() else self.row
        column = "" if self.column == "value" else f", {self.column.replace('_', ' ')}"
        return f"{self.element}, {row}{column}"

    @property
    def weak(self) -> bool:
        """Whether the number agrees, but would also if it were quite another."""
        return self.agreement == "agrees" and judging.is_weak(self.id, self.resolution)

    @property
    def sign(self) -> str:
        """The sign of its agreement."""
        return SIGNS["agrees weakly" if self.weak else self.agreement]

    @property
    def difference(self) -> str:
        """What our number is off the printed one; empty where there is no number."""
        return "" if math.isnan(self.reproduced) else f"{self.reproduced - self.published:+.3g}"

    @property
    def interval(self) -> str:
        """Where the printed number should lie, in words; empty where there is no number."""
        if math.isnan(self.low):
            return ""
        if math.isinf(self.high):
            return f"at least {number(self.low)}"
        return f"{number(self.low)} to {number(self.high)}"

    @property
    def seen_from(self) -> str:
        """The resolution in words: a share of the printed number, of an SD a factor; empty where there is none."""
        if not math.isfinite(self.resolution):
            return ""
        if self.id.endswith(".sd"):
            return f"a factor of {self.resolution:.2g}"
        return f"{100 * self.resolution:.2g} %"

    @property
    def ours(self) -> str:
        """Our number like the printed one; a share with what it is of: "0.65 of v's range"."""
        text = like_printed(self.reproduced, self.printed)
        if text and self.unit.startswith("range of "):
            return f"{text} of {self.unit.split()[2]}'s range"
        return text


def judged_cells(verdicts: pd.DataFrame) -> dict[str, Cell]:
    """Bring together each printed number that has a verdict with what the verdict says of it."""
    printed = published.cells().drop(columns=["source", "reason"])
    texts = verdicts[["settings", "reason", "notebook"]].astype(object).fillna("")
    of_cells = verdicts.assign(**texts).drop(columns="printed").set_index("id")
    both = printed.join(of_cells, how="inner").reset_index()
    return {row["id"]: Cell(**row) for row in both.to_dict("records")}


def judged_claims(results: Path) -> list[dict]:
    """The claims with check and rule, decision, measured number and proof."""
    decided = judging.decided_claims(results).set_index("id")
    table = published.table("claims").join(decided).astype(object).reset_index()
    table = table.fillna({"verdict": "not decided"}).fillna("")
    table["check"] = [
        f"{row.check} Rule: {row.rule} {row.criterion:g}." for row in table.itertuples()
    ]
    return table.to_dict("records")


def notebook_source(name: str) -> str:
    """Path of a notebook's source within the project."""
    return notebook_files("py")[name].relative_to(ROOT).as_posix()


def number(value: float, digits: int = 5) -> str:
    """Write a number with so many significant digits; nothing for one that is missing."""
    return "" if math.isnan(value) else f"{value:.{digits}g}"


def like_printed(value: float, printed: str) -> str:
    """Write our number with the digits of the printed one, or with more where that shows nothing."""
    if math.isnan(value):
        return ""
    try:
        digits = Decimal(printed.rstrip("%"))
    except InvalidOperation:
        return number(value, 4)
    if "e" in printed.lower():
        return f"{value:.2e}"
    text = f"{value:.{max(0, -int(digits.as_tuple().exponent))}f}"
    return text if abs(float(text) - value) <= 0.02 * abs(value) else number(value, 3)


TEMPLATES.globals.update(signs=SIGNS, number=number, tolerance=published.tolerance)
