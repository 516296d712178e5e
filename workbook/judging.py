"""Verdicts: what the notebooks computed beside what the paper prints.

The rule, fixed on 2026-11-22, before any verdict was computed with it. Verdicts by tolerance and
by kept pools of runs had been seen by then, and so had the width of the regions of Table 2's means
(`by_tolerance` keeps the former).

1. A notebook exports one number for a cell, or one for each noise realisation, all from runs of
   its own.
2. The region of several numbers is where the number of one more realisation would lie with 95 %:
   the mean of their logarithms ± t(n - 1) s sqrt(1 + 1/n), without logarithms where the sign
   counts; ours is its centre. The region of one number is ours ± the cell's tolerance, whose reason
   stands in `cells.csv`.
3. `reproduced`: the printed number lies in the region, which is about ours, and the region is not
   too wide.
4. Too wide, so `undecided`: the region also holds the next smaller or next larger printed number of
   the same column, or the number of the row's rival column in `basis.csv`: for a mean of Table 2,
   the theoretical A. It would have agreed with another number as well.
5. `differs`: the printed number lies outside the region, and outside every region with one
   realisation left out. Outside the first one only, the verdict would depend on one realisation:
   `undecided`.
6. `erratum`: as `differs`, and our number is the correction that `errata.csv` gives.
7. A printed limit is `reproduced` at or above its region, `undecided` inside it, and `differs`
   below it.
8. Where an agreement is no result of ours computed anew, it has the word of `basis.csv`: `traced` if
   the number is read from the authors' own files, else `consistent`, `given`, `undecided` or
   `stand-in`. Until 2026-11-23 what is `traced` counted as `reproduced`, and so did the theoretical
   A of our simulator, which is `consistent`.
9. A printed number has one verdict: by the authors' data where they judge it, else by our
   simulation, else a stand-in.

Twenty regions of 95 % judge the means and SDs of Table 2's ten rows: by chance alone, one of them
misses.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from replication import published
from replication.statistics import another_interval
from workbook.outcomes import (
    Cells,
    Claims,
    as_simulated,
    cell_rows,
    claim_rows,
    evidence_rule,
    evidence_rules,
    load_outcomes,
    notebook_name,
)

VERDICT_COLUMNS = ["id", "source", "printed", "published", "reproduced", "low", "high"]
VERDICT_COLUMNS += ["verdict", "by_tolerance", "reason", "notebook"]
SOURCES = ("authors", "simulated", "stand-in")  # the first that judges a cell decides it
# What is decided by evidence comes first; the headlines count it apart from what is traced.
EVIDENCE = ("reproduced", "erratum", "differs")
VERDICTS = (*EVIDENCE, "traced", "consistent", "given", "undecided", "stand-in", "not-run")
CLAIM_VERDICTS = {True: "holds", False: "does not hold", None: "undecided"}
# Rule 8: by what an agreement is worth, which results of a comparison are verdicts. In place of the
# others stands that worth itself.
STANDS = {
    "evidence": (*EVIDENCE, "undecided", "not-run"),
    "traced": ("erratum", "differs", "undecided", "not-run"),
    "consistent": ("erratum", "differs", "undecided", "not-run"),
    "given": ("erratum", "differs", "undecided"),
    "undecided": ("not-run",),
    "stand-in": ("not-run",),
    "": ("not-run",),
}
OUTSIDE = "the printed number lies outside the region"
Region = tuple[float, float]


def region(numbers: Sequence[float], signed: bool) -> Region:
    """Where the number of one more realisation would lie with 95 %; anywhere, if that is not known."""
    if len(numbers) < 2 or (min(numbers) <= 0 and not signed):
        return -math.inf, math.inf
    if signed:
        return another_interval(numbers)
    low, high = another_interval(np.log(numbers).tolist())
    return math.exp(low), math.exp(high)


def region_without_one(numbers: Sequence[float], signed: bool) -> Region:
    """The smallest interval that holds every region with one realisation left out."""
    regions = [region([*numbers[:i], *numbers[i + 1 :]], signed) for i in range(len(numbers))]
    return min(low for low, _ in regions), max(high for _, high in regions)


def centre(numbers: Sequence[float], signed: bool) -> float:
    """The one number that stands for several realisations: the middle of their region."""
    with np.errstate(divide="ignore"):  # of 0
        return float(np.mean(numbers)) if signed else float(np.exp(np.mean(np.log(numbers))))


def rivals(cell: str) -> list[float]:
    """Printed numbers that a region must not hold besides the cell's own (rule 4)."""
    cells = published.cells()
    own = cells.loc[cell]
    alike = [cells[name] == own[name] for name in ("element", "column", "unit")]
    others = cells.loc[np.all(alike, axis=0), "value"].astype(float)
    smaller, larger = others[others < own["value"]], others[others > own["value"]]
    found = [*smaller.nlargest(1), *larger.nsmallest(1)]
    rival = evidence_rules(cell)[0]["rival"]
    return [*found, published.value(f"{cell.rpartition('.')[0]}.{rival}")] if rival else found


def compare(cell: str, ours: float, decisive: Region, without_one: Region) -> tuple[str, str]:
    """Apply rules 3 to 7 to a cell: the verdict and its reason.

    `decisive` is the region, `without_one` holds every region with one realisation left out; the
    same for one number.
    """
    printed, (low, high) = published.cells().loc[cell], decisive
    value, is_limit = float(printed["value"]), printed["kind"] == "bound"
    if not math.isfinite(ours):
        return "not-run", "no notebook computed it"
    if is_limit and low <= value < high:
        interval = f"{low:.4g} to {high:.4g}"
        return "undecided", f"the limit lies in the 95 % interval of our number, {interval}"
    if not (value >= high if is_limit else low <= value <= high):
        if without_one[0] <= value <= without_one[1]:
            return "undecided", f"{OUTSIDE}, but inside with one realisation left out"
        return outside(cell, ours)
    held = [] if is_limit else [f"{rival:.4g}" for rival in rivals(cell) if low <= rival <= high]
    if held or math.isinf(high - low):
        also = ", ".join(held) or "every number"
        return "undecided", f"the region is too wide: it also holds {also}"
    return "reproduced", "the printed number lies in the region"


def outside(cell: str, ours: float) -> tuple[str, str]:
    """Verdict on a printed number that is not ours: rule 6, else rule 5."""
    for _, erratum in published.errata().iterrows():
        for corrected in erratum["cells"].split():
            name, _, number = corrected.partition("=")
            if name == cell and abs(ours - float(number)) <= published.half_last_digit(number):
                return "erratum", f"corrected: {erratum['corrected']}"
    return "differs", OUTSIDE


def judge_rows(found: pd.DataFrame) -> pd.DataFrame:
    """Compare what notebooks computed with the printed numbers: `VERDICT_COLUMNS`.

    The rows are `id, source, numbers, notebook`; `numbers` is one number, or a list with one for
    each realisation. `by_tolerance` is what the cell's tolerance alone would say, as before
    2026-11-22.
    """
    rows = found.join(published.cells(), on="id").to_dict("records")
    return pd.DataFrame([row | _judge(row) for row in rows], columns=VERDICT_COLUMNS)


def judge_cells(cells: Mapping[str, float | Sequence[float]], source: str) -> pd.DataFrame:
    """Judge our numbers from one source by cell id: one number, or one for each realisation."""
    numbers = [np.asarray(each, dtype=float).tolist() for each in cells.values()]
    rows = {"id": list(cells), "source": source, "numbers": numbers, "notebook": ""}
    return judge_rows(pd.DataFrame(rows))


def _judge(row: dict) -> dict:
    """Columns that tell how our number and a printed one compare."""
    cell, numbers, value = row["id"], row["numbers"], row["value"]
    signed, tolerance = row["kind"] == "signed", published.tolerance(cell)
    if isinstance(numbers, list):
        ours, decisive = centre(numbers, signed), region(numbers, signed)
        without_one = region_without_one(numbers, signed)
    else:
        ours = float(numbers)
        decisive = without_one = (ours - tolerance, ours + tolerance)
    compared, reason = compare(cell, ours, decisive, without_one)
    by_tolerance = compared
    if math.isfinite(ours):
        agrees = ours <= value if row["kind"] == "bound" else abs(ours - value) <= tolerance
        by_tolerance = "reproduced" if agrees else outside(cell, ours)[0]
    rule = evidence_rule(cell, row["source"])
    basis = rule["basis"]
    if math.isfinite(ours) and not basis:
        missing = "basis.csv does not say what an agreement would be worth"
        raise ValueError(f"{cell} by {row['source']}: {missing}")
    if compared not in STANDS[basis]:
        compared, reason = basis, rule["fails_if"]
    if by_tolerance not in STANDS[basis]:
        by_tolerance = basis
    if compared == "differs":
        known = published.known_differences().set_index(["id", "source"])["reason"]
        reason = known.get((cell, row["source"]), "no explanation known")
    columns = {
        "published": float(value),
        "reproduced": ours,
        "low": decisive[0],
        "high": decisive[1],
    }
    return columns | {"verdict": compared, "by_tolerance": by_tolerance, "reason": reason}


def judge(cells: Cells | None = None, claims: Claims | None = None) -> pd.DataFrame:
    """Judge our numbers by source and cell id, and decisions on claims with what was measured.

    A source is "authors", "simulated" or "stand-in"; a sequence of numbers holds one for each noise
    realisation. A claim whose truth value is None is undecided.
    """
    given = cell_rows(cells or {})
    judged = []
    if rows := as_simulated(given):
        judged = judge_rows(pd.DataFrame(rows).assign(notebook=notebook_name())).to_dict("records")
    if rows != given:
        by_id = {row["id"]: row for row in judged}
        judged = [by_id.get(row["id"], {"verdict": "not-run"}) | row for row in given]
    for row in claim_rows(claims or {}):
        verdict = CLAIM_VERDICTS[row["holds"]]
        judged.append({"id": row["id"], "reproduced": row["measured"], "verdict": verdict})
    shown = ["id", "source", "printed", "reproduced", "low", "high", "verdict"]
    return pd.DataFrame(judged, columns=shown).astype(object).fillna("")


def _exported(results: Path, kind: str, columns: list[str]) -> pd.DataFrame:
    """The notebooks' "cells" or "claims"."""
    rows: list[dict[str, Any]] = []
    for name, outcome in load_outcomes(results).items():
        rows += [row | {"notebook": name} for row in outcome[kind]]
    return pd.DataFrame(rows, columns=[*columns, "notebook"])


def verdicts(results: Path) -> pd.DataFrame:
    """Judge every printed cell from the notebooks' outcomes; others are `given` or `not-run`."""
    cells = published.cells()
    found = _exported(results, "cells", ["id", "source", "numbers"])
    missing = cells.index[~cells.index.isin(found["id"])]
    by_whom = [evidence_rules(cell)[0]["source"].replace("*", "authors") for cell in missing]
    not_computed = pd.DataFrame({"id": missing, "source": by_whom, "numbers": math.nan})
    table = judge_rows(pd.concat([found.astype(object), not_computed]))
    by_id = table.sort_values("source", kind="stable").set_index("id")
    return by_id.loc[cells.index].reset_index()


def decided_claims(results: Path) -> pd.DataFrame:
    """What the notebooks' outcomes say of the claims: `id, verdict, measured, notebook`."""
    claims = _exported(results, "claims", ["id", "holds", "measured"])
    claims.insert(1, "verdict", [CLAIM_VERDICTS[holds] for holds in claims.pop("holds")])
    return claims


def squeeze(name: str) -> str:
    """An element's name without capitals and spaces, such as "table2"."""
    return name.lower().replace(" ", "")


def by_source(table: pd.DataFrame) -> pd.DataFrame:
    """Sort verdicts by their source, the one that decides first (rule 9)."""
    return table.sort_values("source", key=lambda source: source.map(SOURCES.index), kind="stable")


def deciding(table: pd.DataFrame) -> pd.DataFrame:
    """One verdict for each printed number: the row of the first source that judges it."""
    return by_source(table).drop_duplicates("id").sort_index()


def verdict_counts(table: pd.DataFrame) -> pd.DataFrame:
    """Count the printed numbers of each element by their verdict."""
    decided, elements = deciding(table), published.cells()["element"]
    counts = pd.crosstab(elements[decided["id"]].to_numpy(), decided["verdict"].to_numpy())
    counts = counts.rename_axis(index="element", columns="verdict")
    there = [name for name in VERDICTS if name in counts]
    return counts.reindex(index=elements.unique(), columns=there)
