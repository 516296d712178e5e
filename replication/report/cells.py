"""Printed cells beside ours: one `Cell` for each number of the paper, with every judgement of it."""

from dataclasses import dataclass
from decimal import Decimal, InvalidOperation

import pandas as pd

from replication import published
from replication.workbook import judging
from replication.workbook.judging import EVIDENCE

# A sign beside each word, so that colour is never the only difference.
SIGNS = {
    "reproduced": "✓",
    "consistent": "=",
    "given": "→",
    "erratum": "‡",
    "undecided": "?",
    "stand-in": "≈",
    "differs": "✗",
    "not-run": "–",
    "holds": "✓",
    "does not hold": "✗",
    "not decided": "–",
}
MEANINGS = {
    "reproduced": "computed from data or simulation, could have failed, agrees within its region; the rule for regions "
    "was fixed on 2026-11-22, after verdicts by tolerance had been seen",
    "erratum": "printed wrong, and our computation gives the correction",
    "differs": "computed, and the printed number lies outside its region, whose rule was fixed on the same day",
    "consistent": "follows from other printed numbers",
    "given": "taken over from the paper; no evidence",
    "undecided": "its region holds other numbers too or depends on one realisation, or the data are not public",
    "stand-in": "the original data are not public; a simulated stand-in never counts as reproduced",
    "not-run": "nothing computes it",
}
SOURCES = {
    "authors": "authors' data",
    "simulated": "our simulation",
    "stand-in": "stand-in",
}


@dataclass(frozen=True)
class Judgement:
    """What one source says of a cell: our number, the region that should hold the printed one, the verdict and why.

    `predicted` says that the region is a predictive one; `by_tolerance` is the verdict by the cell's tolerance then.
    """

    source: str
    ours: float
    difference: float
    low: float
    high: float
    verdict: str
    by_tolerance: str
    predicted: bool
    reason: str
    notebook: str
    fails_if: str


@dataclass(frozen=True)
class Cell:
    """A printed number with its judgements, the one of the authors' own data first."""

    id: str
    element: str
    row: str
    column: str
    printed: str
    value: float
    unit: str
    kind: str
    tolerance: float
    tolerance_reason: str
    section: str
    judgements: tuple[Judgement, ...]

    @property
    def share_of(self) -> str:
        """What the number is a share of, such as "v's range" where the paper prints max v; empty for most."""
        return f"{self.unit.split()[2]}'s range" if self.unit.startswith("range of ") else ""

    @property
    def deciding(self) -> Judgement:
        """The judgement that counts: the authors' data if they judge it, else our simulation (rule 9 of `judging`)."""
        return self.judgements[0]


def cells(verdicts: pd.DataFrame) -> list[Cell]:
    """Bring together each printed number and what the verdicts say of it.

    Parameters
    ----------
    verdicts : DataFrame
        As from `judging.verdicts`.

    Returns
    -------
    list of Cell
        In the order of `data/cells.csv`; none for a cell without a verdict.
    """
    judged: dict[str, list[dict]] = {}
    for row in verdicts.to_dict("records"):
        judged.setdefault(row["id"], []).append(row)
    printed = published.cells()
    return [_cell(name, printed.loc[name], judged[name]) for name in printed.index if name in judged]


def _cell(name: str, printed: pd.Series, rows: list[dict]) -> Cell:
    order = list(SOURCES)
    rows = sorted(rows, key=lambda row: order.index(row["source"]) if row["source"] in order else len(order))
    return Cell(
        id=name,
        element=printed["element"],
        row=str(printed["row"]),
        column=printed["column"],
        printed=printed["printed"],
        value=float(printed["value"]),
        unit=printed["unit"],
        kind=printed["kind"],
        tolerance=published.tolerance(name),
        tolerance_reason=printed["tol_reason"],
        section=printed["section"],
        judgements=tuple(_judgement(name, row) for row in rows),
    )


def _judgement(cell: str, row: dict) -> Judgement:
    ours = _float(row["reproduced"])
    evidence = row["verdict"] in EVIDENCE
    return Judgement(
        source=row["source"],
        ours=ours,
        difference=ours - float(row["published"]),
        low=_float(row["low"]),
        high=_float(row["high"]),
        verdict=row["verdict"],
        by_tolerance=row["by_tolerance"],
        predicted=predicted(row),
        reason=_text(row["reason"]),
        notebook=_text(row["notebook"]),
        fails_if=judging.basis(cell, row["source"])["fails_if"] if evidence else "",
    )


def predicted(row: dict) -> bool:
    """Whether a verdict's region comes from several realisations, and is not our number's tolerance."""
    low, ours, tolerance = _float(row["low"]), _float(row["reproduced"]), published.tolerance(row["id"])
    return low == low and abs(ours - tolerance - low) > 1e-4 * max(abs(ours), abs(low), tolerance)


def _float(value: object) -> float:
    return float("nan") if value is None or value == "" else float(value)


def _text(value: object) -> str:
    return value if isinstance(value, str) else ""


def by_id(all_cells: list[Cell]) -> dict[str, Cell]:
    """Look cells up by their id."""
    return {cell.id: cell for cell in all_cells}


def number(value: float, digits: int = 5) -> str:
    """Write a number with so many significant digits; nothing for one that is missing."""
    return "" if value != value else f"{value:.{digits}g}"


def like_printed(value: float, printed: str) -> str:
    """Write our number with the digits of the printed one; with four significant digits where that shows nothing."""
    if value != value:
        return ""
    try:
        digits = Decimal(printed.rstrip("%"))
    except InvalidOperation:
        return number(value, 4)
    if "e" in printed.lower():
        return f"{value:.2e}"
    exponent = digits.as_tuple().exponent
    text = f"{value:.{max(0, -exponent)}f}"
    return text if abs(float(text) - value) <= 0.02 * abs(value) else number(value, 3)


def counts(all_cells: list[Cell]) -> dict[str, int]:
    """Count printed numbers by the verdict that decides each, those of evidence first."""
    order = [*EVIDENCE, *(name for name in MEANINGS if name not in EVIDENCE)]
    found = [cell.deciding.verdict for cell in all_cells]
    return {name: found.count(name) for name in order if name in found}
