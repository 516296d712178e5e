"""Printed numbers and claims beside ours: a `Cell` for each number of the paper, with its judgements."""

import math
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from functools import cached_property
from pathlib import Path

import pandas as pd

from replication import published
from replication.files import ROOT
from workbook import judging
from workbook.checkout import notebook_files
from workbook.report import TEMPLATES

# A sign beside each word, so that colour is never the only difference.
WORDS = published.verdict_words()
SIGNS = WORDS["sign"].to_dict()
MEANINGS = WORDS.loc[WORDS["meaning"] != "", "meaning"].to_dict()
SOURCES = {"authors": "authors' data", "simulated": "our simulation", "stand-in": "stand-in"}


@dataclass(frozen=True)
class Judgement:
    """What one source says of a printed number: a row of the verdicts."""

    id: str
    source: str
    printed: str
    published: float
    reproduced: float
    low: float
    high: float
    verdict: str
    by_tolerance: str
    reason: str
    notebook: str

    @property
    def difference(self) -> str:
        """What our number is off the printed one; empty where there is no number."""
        return "" if math.isnan(self.reproduced) else f"{self.reproduced - self.published:+.3g}"

    @property
    def region(self) -> str:
        """Where the printed number should lie, in words; empty where there is no region."""
        if not math.isfinite(self.low):
            return ""
        return f"{number(self.low)} to {number(self.high)}"

    @property
    def predicted(self) -> bool:
        """Whether the region comes from several realisations, and is not our number's tolerance."""
        width = 2 * published.tolerance(self.id)
        return abs(self.high - self.low - width) > 1e-3 * width + 1e-9

    @cached_property
    def fails_if(self) -> str:
        """What would have given another verdict; empty for what is no evidence."""
        evidence = self.verdict in judging.EVIDENCE
        return judging.evidence_rule(self.id, self.source)["fails_if"] if evidence else ""

    @property
    def disagreement(self) -> float:
        """How far printed and our number are apart, in half-widths of the region; nan without one."""
        half = (self.high - self.low) / 2
        if not 0 < half < math.inf:
            return math.nan
        return abs(self.reproduced - self.published) / half


@dataclass(frozen=True)
class Cell:
    """A printed number, a row of `cells.csv`, with its judgements, the deciding one first."""

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
    judgements: tuple[Judgement, ...]

    @property
    def name(self) -> str:
        """Its place in the paper: "Table 2, row 3, sd"."""
        row = f"row {self.row}" if self.row.isdigit() else self.row
        column = "" if self.column == "value" else f", {self.column.replace('_', ' ')}"
        return f"{self.element}, {row}{column}"

    @property
    def tolerance(self) -> float:
        """Largest difference from the printed number that is none."""
        return published.tolerance(self.id)

    @property
    def deciding(self) -> Judgement:
        """The judgement that counts: that of the first source (rule 9 of `judging`)."""
        return self.judgements[0]

    def ours(self, judgement: Judgement) -> str:
        """Write our number like the printed one; a share with what it is of: "0.65 of v's range"."""
        text = like_printed(judgement.reproduced, self.printed)
        if text and self.unit.startswith("range of "):
            return f"{text} of {self.unit.split()[2]}'s range"
        return text


def judged_cells(verdicts: pd.DataFrame) -> dict[str, Cell]:
    """Bring together each printed number that has a verdict with what the verdicts say of it."""
    texts = verdicts[["reason", "notebook"]].astype(object).fillna("")
    judged: dict[str, list[Judgement]] = {}
    for row in judging.by_source(verdicts.assign(**texts)).to_dict("records"):
        judged.setdefault(row["id"], []).append(Judgement(**row))
    return {
        row["id"]: Cell(**row, judgements=tuple(judged[row["id"]]))
        for row in published.cells().reset_index().to_dict("records")
        if row["id"] in judged
    }


def judged_claims(results: Path) -> list[dict]:
    """The claims with check and rule, decision, measured number and proof."""
    decided = judging.decided_claims(results).set_index("id")
    table = published.claims().join(decided).astype(object).reset_index()
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


TEMPLATES.globals.update(
    signs=SIGNS, meanings=MEANINGS, sources=SOURCES, evidence=judging.EVIDENCE, number=number
)
