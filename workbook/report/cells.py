"""Printed numbers and claims beside ours, as pages, article and terminal show them."""

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

# A sign beside each word, so that colour is never the only difference; hollow where an agreement is weak.
SIGNS = {"agrees": "●", "differs": "✗", "not tested": "–"}
WEAK_SIGN = "○"
# What is wrong in print, by the kinds of `errata.csv`.
ERRATUM_KINDS = {
    "paper": "paper",
    "data": "against the public data",
    "repository": "public repository",
}


@dataclass(frozen=True)
class Cell:
    """A printed number, a row of `cells.csv`, with what we found: its row of `verdicts.csv`."""

    id: str
    element: str
    row: str
    column: str
    printed: str
    unit: str
    section: str
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
    errata: list[str]

    @property
    def name(self) -> str:
        """Its place in the paper: "Table 2, row 3, sd"."""
        row = f"row {self.row}" if self.row.isdigit() else self.row
        column = "" if self.column == "value" else f", {self.column.replace('_', ' ')}"
        return f"{self.element}, {row}{column}"

    @property
    def printed_with_unit(self) -> str:
        """As printed, with the unit where it has one that the print does not show."""
        bare = self.unit in ("1", "%", "count") or " of " in self.unit or " from " in self.unit
        return (
            self.printed
            if bare or self.printed.endswith(self.unit)
            else f"{self.printed} {self.unit}"
        )

    @property
    def ours(self) -> str:
        """Our number written like the printed one; a share with what it is of: "0.65 of v's range"."""
        text = minus(like_printed(self.reproduced, self.printed))
        if text and self.unit.startswith("range of "):
            return f"{text} of {self.unit.split()[2]}'s range"
        return text

    @property
    def difference(self) -> str:
        """Our number less the printed one; empty where there is no number."""
        if math.isnan(self.reproduced):
            return ""
        return minus(f"{self.reproduced - self.published:+.2g}")

    @property
    def percent(self) -> str:
        """The same relatively; empty for an SD and where nothing is printed to compare with."""
        if math.isnan(self.reproduced) or not self.published or self.is_sd:
            return ""
        return minus(f"{100 * (self.reproduced / self.published - 1):+.1f} %")

    @property
    def interval(self) -> str:
        """Where the printed number has to lie to agree."""
        if self.agreement == "not tested" or math.isnan(self.reproduced):
            return ""
        if math.isinf(self.high):
            return f"at least {like_printed(self.low, self.printed)}"
        low, high = (like_printed(end, self.printed) for end in (self.low, self.high))
        return "exact" if low == high else minus(f"{low} to {high}")

    @property
    def is_sd(self) -> bool:
        """Whether it is a standard deviation, whose resolution is a factor."""
        return self.id.endswith(".sd")

    @property
    def weak(self) -> bool:
        """Whether its agreement is weak: a large deviation would have agreed too."""
        return self.agreement == "agrees" and judging.is_weak(self.id, self.resolution)

    @property
    def sign(self) -> str:
        """The sign of its agreement."""
        return WEAK_SIGN if self.weak else SIGNS[self.agreement]

    @property
    def words(self) -> str:
        """Its agreement in words."""
        return "weakly agrees" if self.weak else self.agreement

    @property
    def resolved(self) -> str:
        """Its resolution: "±4.4 %", or for an SD "factor 5"."""
        if self.agreement == "not tested" or not math.isfinite(self.resolution):
            return ""
        if self.is_sd:
            return f"factor {self.resolution:.2g}"
        if self.resolution < 1e-4:
            return "exact"
        percent = 100 * self.resolution
        return f"±{percent:.0f} %" if percent >= 100 else f"±{percent:.2g} %"


def judged_cells(verdicts: pd.DataFrame) -> dict[str, Cell]:
    """Bring together each printed number with what the verdicts say of it, by its id."""
    about = published.cells()[["element", "row", "column", "unit", "section"]]
    rows = verdicts.astype(object).fillna({"settings": "", "reason": "", "notebook": ""})
    errata = corrected_cells()
    return {
        row["id"]: Cell(**row, errata=[each for each in errata if row["id"] in errata[each]])
        for row in rows.join(about, on="id").to_dict("records")
    }


def corrected_cells() -> dict[str, list[str]]:
    """Ids of the printed numbers that each erratum corrects."""
    corrected = published.table("errata")["cells"]
    return {
        erratum: [each.partition("=")[0] for each in cells.split()]
        for erratum, cells in corrected.items()
    }


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


def minus(text: str) -> str:
    """Write minus signs as such, but for those of exponents."""
    return " ".join(f"−{word[1:]}" if word.startswith("-") else word for word in text.split(" "))


def like_printed(value: float, printed: str) -> str:
    """Write our number with the digits of the printed one, or with more where that shows nothing."""
    if math.isnan(value):
        return ""
    try:
        digits = Decimal(printed.rstrip("%"))
    except InvalidOperation:
        return f"{value:.4g}"
    if "e" in printed.lower():
        return f"{value:.2e}"
    text = f"{value:.{max(0, -int(digits.as_tuple().exponent))}f}"
    return text if abs(float(text) - value) <= 0.02 * abs(value) else f"{value:.3g}"


TEMPLATES.globals.update(sources=judging.SOURCES, agreements=judging.AGREEMENTS)
