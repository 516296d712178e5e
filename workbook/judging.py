"""Verdicts: what the notebooks computed beside what the paper prints.

The rule of single numbers was fixed on 2026-11-22, when verdicts by tolerance had been seen
(`by_tolerance` keeps them). That of regions was fixed anew on 2026-11-23, before a number of the
study that it judges was seen; verdicts by regions of five realisations had been seen by then.

1. A notebook exports one number for a cell. For a mean or an SD of Table 2 it exports the numbers of
   N realisations of each candidate protocol that judges it (`studies/replay/protocols.py`).
2. The region of N numbers is where one more would lie with 95 %, by order statistics; ours is the
   median of the first candidate's. The region of one number is ours ± the cell's tolerance, whose
   reason stands in `cells.csv`.
3. `reproduced`: the printed number lies in the region, which is about ours, not too close to an end,
   and the region is not too wide.
4. Too wide, so `undecided`: the region also holds the next smaller or next larger printed number of
   the same column, or the number of the row's rival column in `basis.csv`: for a mean of Table 2,
   the theoretical A. It would have agreed with another number as well. An SD's region is too wide if
   its ends are more than a factor of `WIDEST_SD` apart: the printed ones span a factor of 30.
5. `differs`: the printed number lies outside the region, not too close to an end. Too close is
   nearer than other N numbers move that end (`statistics.end_margin`): `undecided`. Widths are those
   of logarithms, but where the sign counts.
6. Several candidates: the verdict that every one gives, else `undecided`.
7. `erratum`: as `differs`, and our number is the correction that `errata.csv` gives.
8. A printed limit is `reproduced` above its region, `undecided` inside it, and `differs` below it.
9. Where an agreement is no result of ours computed anew, it has the word of `basis.csv`: `traced` if
   the number is read from the authors' own files, else `consistent`, `given`, `undecided` or
   `stand-in`. Until 2026-11-23 what is `traced` counted as `reproduced`, and so did the theoretical
   A of our simulator, which is `consistent`.
10. A printed number has one verdict: by the authors' data where they judge it, else by our
   simulation, else a stand-in.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from replication import published
from replication.statistics import end_margin, predictive_region
from workbook.outcomes import (
    Cells,
    Claims,
    as_simulated,
    cell_rows,
    claim_rows,
    evidence_rule,
    evidence_rules,
    load_outcomes,
)

VERDICT_COLUMNS = ["id", "source", "printed", "published", "reproduced", "low", "high"]
VERDICT_COLUMNS += ["verdict", "by_tolerance", "reason", "notebook"]
SOURCES = ("authors", "simulated", "stand-in")  # the first that judges a cell decides it
# What is decided by evidence comes first; the headlines count it apart from what is traced.
EVIDENCE = ("reproduced", "erratum", "differs")
VERDICTS = (*EVIDENCE, "traced", "consistent", "given", "undecided", "stand-in", "not-run")
CLAIM_VERDICTS = {True: "holds", False: "does not hold", None: "undecided"}
# Rule 9: by what an agreement is worth, which results of a comparison are verdicts. In place of the
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
WIDEST_SD = 10.0
Region = tuple[float, float]
ByCandidate = Mapping[str, Sequence[float]]


def moved_ends(ends: Region, share: float, signed: bool) -> Region:
    """A region whose ends are moved outwards by a share of its width."""
    measured = np.array(ends if signed else np.log(ends))
    low, high = measured + share * np.ptp(measured) * np.array([-1, 1])
    return (low, high) if signed else (math.exp(low), math.exp(high))


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


def too_wide(cell: str, ends: Region) -> str:
    """Rule 4: what a region holds that it should not, or "" if it is narrow enough."""
    low, high = ends
    if cell.endswith(".sd"):
        return f"SDs a factor of {WIDEST_SD:g} apart" if high > WIDEST_SD * low else ""
    return ", ".join(f"{rival:.4g}" for rival in rivals(cell) if low <= rival <= high)


def compare(cell: str, ours: float, ends: Region, margin: float = 0.0) -> tuple[str, str, Region]:
    """Apply rules 3 to 5, 7 and 8 to a region: the verdict, its reason, and outside which numbers it is `differs`.

    `margin` is that of the region's ends, as a share of its width.
    """
    row = published.cells().loc[cell]
    value, is_limit, signed = float(row["value"]), row["kind"] == "bound", row["kind"] == "signed"
    inner, outer = (moved_ends(ends, k * margin, signed) if margin else ends for k in (-1, 1))
    if value < outer[0] or (value > outer[1] and not is_limit):
        return *outside(cell, ours), outer
    if not (value > outer[1] if is_limit else inner[0] <= value <= inner[1]):
        return "undecided", "the printed number is too close to an end of the region", outer
    if not is_limit and (also := too_wide(cell, ends)):
        return "undecided", f"the region is too wide: it also holds {also}", outer
    return "reproduced", "the printed number lies in the region", outer


def compare_candidates(cell: str, numbers: ByCandidate) -> tuple[str, str, Region]:
    """Rules 2 to 6 for realisations of several candidates: the verdict, its reason, the widest region.

    The reason ends with the verdict's power: from which printed numbers on it would be `differs`.
    """
    regions = [predictive_region(of_candidate) for of_candidate in numbers.values()]
    low, high = np.min(regions), np.max(regions)
    if math.isinf(high) or (low <= 0 and published.cells().loc[cell, "kind"] != "signed"):
        return "undecided", "the realisations give no region", (-math.inf, math.inf)
    judged = [
        compare(cell, float(np.median(of_candidate)), ends, end_margin(len(of_candidate)))
        for ends, of_candidate in zip(regions, numbers.values(), strict=True)
    ]
    verdicts, reasons, outermost = zip(*judged, strict=True)
    power = f"it would differ below {np.min(outermost):.4g} or above {np.max(outermost):.4g}"
    counts = "; ".join(f"{word} under {count}" for word, count in Counter(verdicts).items())
    if len({*verdicts}) > 1:
        return "undecided", f"depends on the protocol: {counts}; {power}", (low, high)
    return verdicts[0], f"{reasons[0]}; {power}", (low, high)


def outside(cell: str, ours: float) -> tuple[str, str]:
    """Verdict on a printed number that is not ours: rule 7, else rule 5."""
    for _, erratum in published.errata().iterrows():
        for corrected in erratum["cells"].split():
            name, _, number = corrected.partition("=")
            if name == cell and abs(ours - float(number)) <= published.half_last_digit(number):
                return "erratum", f"corrected: {erratum['corrected']}"
    return "differs", OUTSIDE


def judge_rows(found: pd.DataFrame) -> pd.DataFrame:
    """Compare what notebooks computed with the printed numbers: `VERDICT_COLUMNS`.

    The rows are `id, source, numbers, notebook`; `numbers` is one number, or realisations by
    candidate. `by_tolerance` is what the cell's tolerance alone would say, as before 2026-11-22.
    """
    rows = found.join(published.cells(), on="id").to_dict("records")
    return pd.DataFrame([row | _judge(row) for row in rows], columns=VERDICT_COLUMNS)


def judge_cells(cells: Mapping[str, float | ByCandidate], source: str) -> pd.DataFrame:
    """Judge our numbers from one source by cell id: one number, or realisations by candidate."""
    rows = {"id": list(cells), "source": source, "numbers": list(cells.values()), "notebook": ""}
    return judge_rows(pd.DataFrame(rows))


def _judge(row: dict) -> dict:
    """Columns that tell how our number and a printed one compare."""
    cell, numbers, value = row["id"], row["numbers"], row["value"]
    tolerance = published.tolerance(cell)
    by_candidate = numbers if isinstance(numbers, Mapping) else {}
    ours = float(np.median(next(iter(by_candidate.values()), numbers)))
    decisive = (ours - tolerance, ours + tolerance)
    if not math.isfinite(ours):
        compared, reason = "not-run", "no notebook computed it"
    elif by_candidate:
        compared, reason, decisive = compare_candidates(cell, by_candidate)
    else:
        compared, reason, _ = compare(cell, ours, decisive)
    by_tolerance = compared
    rule = evidence_rule(cell, row["source"])
    basis = rule["basis"]
    if compared != "not-run":
        agrees = ours <= value if row["kind"] == "bound" else abs(ours - value) <= tolerance
        by_tolerance = "reproduced" if agrees else outside(cell, ours)[0]
    if compared != "not-run" and not basis:
        missing = "basis.csv does not say what an agreement would be worth"
        raise ValueError(f"{cell} by {row['source']}: {missing}")
    if compared not in STANDS[basis]:
        compared, reason = basis, rule["fails_if"]
    if by_tolerance not in STANDS[basis]:
        by_tolerance = basis
    if compared == "differs":
        known = published.known_differences().set_index(["id", "source"])["reason"]
        reason = known.get((cell, row["source"]), f"no explanation known; {reason}")
    return {
        "published": float(value),
        "reproduced": ours,
        "low": decisive[0],
        "high": decisive[1],
        "verdict": compared,
        "by_tolerance": by_tolerance,
        "reason": reason,
    }


def judge(cells: Cells | None = None, claims: Claims | None = None) -> pd.DataFrame:
    """Judge our numbers by source and cell id, and decisions on claims with what was measured.

    A source is "authors", "simulated" or "stand-in"; several numbers are realisations by candidate. A
    claim whose truth value is None is undecided.
    """
    given = cell_rows(cells or {})
    judged = []
    if rows := as_simulated(given):
        judged = judge_rows(pd.DataFrame(rows).assign(notebook="")).to_dict("records")
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
