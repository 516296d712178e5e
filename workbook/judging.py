"""Verdicts: what the notebooks computed beside what the paper prints.

The rule, fixed on 2026-11-22, before any verdict was computed with it. Verdicts by tolerance and by kept pools of runs
had been seen by then, and so had the width of the regions of Table 2's means (`by_tolerance` keeps the former).

1. A notebook exports one number for a cell, or one for each noise realisation, all from runs of its own.
2. The region of several numbers is where the number of one more realisation would lie with 95 %: the mean of their
   logarithms ± t(n - 1) s sqrt(1 + 1/n), without logarithms where the sign counts; ours is its centre. The region of
   one number is ours ± the cell's tolerance, whose reason stands in `cells.csv`.
3. `reproduced`: the printed number lies in the region, which is about ours, and the region is not too wide.
4. Too wide, so `undecided`: the region also holds the next smaller or next larger printed number of the same column,
   or, for a mean of Table 2, the theoretical A of its row. It would have agreed with another number as well.
5. `differs`: the printed number lies outside the region, and outside every region with one realisation left out.
   Outside the first one only, the verdict would depend on one realisation: `undecided`.
6. `erratum`: as `differs`, and our number is the correction that `errata.csv` gives.
7. A printed limit is `reproduced` at or above its region, `undecided` inside it, and `differs` below it.
8. What is no evidence has the word of `basis.csv`: `consistent`, `given`, `undecided`, `stand-in`.
9. A printed number has one verdict: by the authors' data where they judge it, else by our simulation, else a stand-in.

Twenty regions of 95 % judge the means and SDs of Table 2's ten rows: by chance alone, one of them misses.
"""

import json
import math
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import pandas as pd

from replication import published
from replication.statistics import another_interval
from workbook.checkout import notebook_files

VERDICT_COLUMNS = ["id", "source", "printed", "published", "reproduced", "low", "high"]
VERDICT_COLUMNS += ["verdict", "by_tolerance", "reason", "notebook"]
SOURCES = ("authors", "simulated", "stand-in")  # the first that judges a cell decides it
# What is decided by evidence comes first; the headlines count it alone.
EVIDENCE = ("reproduced", "erratum", "differs")
VERDICTS = (*EVIDENCE, "consistent", "given", "undecided", "stand-in", "not-run")
CLAIM_VERDICTS = {True: "holds", False: "does not hold", None: "undecided"}
Interval = tuple[float, float]


def region(numbers: Sequence[float], signed: bool) -> Interval:
    """Where the number of one more realisation would lie with 95 %; anywhere, if the numbers cannot tell."""
    if len(numbers) < 2 or (min(numbers) <= 0 and not signed):
        return -math.inf, math.inf
    if signed:
        return another_interval(numbers)
    low, high = another_interval(np.log(numbers).tolist())
    return math.exp(low), math.exp(high)


def region_without_one(numbers: Sequence[float], signed: bool) -> Interval:
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
    found = [*others[others < own["value"]].nlargest(1), *others[others > own["value"]].nsmallest(1)]
    if own["element"] == "Table 2" and own["column"] == "mean":
        found.append(published.value(cell.replace(".mean", ".theoretical")))
    return found


def compare(cell: str, ours: float, decisive: Interval, without_one: Interval) -> tuple[str, str]:
    """Apply rules 3 to 7 to a cell: the verdict and its reason.

    `decisive` is the region, `without_one` holds every region with one realisation left out; the same for one number.
    """
    printed, (low, high) = published.cells().loc[cell], decisive
    value, is_limit = float(printed["value"]), printed["kind"] == "bound"
    if not math.isfinite(ours):
        return "not-run", "no notebook computed it"
    if is_limit and low <= value < high:
        return "undecided", f"the limit lies in the 95 % interval of our number, {low:.4g} to {high:.4g}"
    if not (value >= high if is_limit else low <= value <= high):
        if without_one[0] <= value <= without_one[1]:
            return "undecided", "the printed number lies outside the region, but inside with one realisation left out"
        return outside(cell, ours)
    held = [] if is_limit else [f"{rival:.4g}" for rival in rivals(cell) if low <= rival <= high]
    if held or math.isinf(high - low):
        return "undecided", f"the region is too wide: it also holds {', '.join(held) or 'every number'}"
    return "reproduced", "the printed number lies in the region"


def outside(cell: str, ours: float) -> tuple[str, str]:
    """Verdict on a printed number that is not ours: rule 6, else rule 5."""
    for _, erratum in published.errata().iterrows():
        for corrected in erratum["cells"].split():
            name, _, number = corrected.partition("=")
            if name == cell and abs(ours - float(number)) <= published.half_last_digit(number):
                return "erratum", f"corrected: {erratum['corrected']}"
    return "differs", "the printed number lies outside the region"


def evidence_rule(cell: str, source: str) -> dict[str, str]:
    """What an agreement with a cell would be worth: the first row of `basis.csv` about it; empty if there is none."""
    rules = published.basis().to_dict("records")
    about = (rule for rule in rules if fnmatchcase(cell, rule["cells"]) and rule["source"] in (source, "*"))
    return next(about, dict.fromkeys(rules[0], ""))


def judge_rows(found: pd.DataFrame) -> pd.DataFrame:
    """Compare what notebooks computed, `id, source, numbers, notebook`, with the printed numbers: `VERDICT_COLUMNS`.

    `numbers` is one number, or a list with one for each realisation. `by_tolerance` is what the cell's tolerance alone
    would say, as before 2026-11-22.
    """
    table = found.join(published.cells(), on="id")
    return pd.DataFrame([row | _judge(row) for row in table.to_dict("records")], columns=VERDICT_COLUMNS)


def judge_cells(cells: Mapping[str, float | Sequence[float]], source: str) -> pd.DataFrame:
    """Judge our numbers from one source by cell id: one number, or a sequence with one for each realisation."""
    numbers = [np.asarray(each, dtype=float).tolist() for each in cells.values()]
    return judge_rows(pd.DataFrame({"id": list(cells), "source": source, "numbers": numbers, "notebook": ""}))


def _judge(row: dict) -> dict:
    """Columns that tell how our number and a printed one compare."""
    cell, numbers, value, signed = row["id"], row["numbers"], row["value"], row["kind"] == "signed"
    tolerance = published.tolerance(cell)
    if isinstance(numbers, list):
        ours, decisive = centre(numbers, signed), region(numbers, signed)
        without_one = region_without_one(numbers, signed)
    else:
        ours = float(numbers)
        decisive = without_one = (ours - tolerance, ours + tolerance)
    compared = by_tolerance = compare(cell, ours, decisive, without_one)
    if math.isfinite(ours):
        agrees = ours <= value if row["kind"] == "bound" else abs(ours - value) <= tolerance
        by_tolerance = ("reproduced", "") if agrees else outside(cell, ours)
    rule = evidence_rule(cell, row["source"])
    if math.isfinite(ours) and not rule["basis"]:
        raise ValueError(f"{cell} by {row['source']}: basis.csv does not say what an agreement would be worth")
    verdict, reason = _weigh(compared, rule)
    if verdict == "differs":
        known = published.known_differences().set_index(["id", "source"])["reason"]
        reason = known.get((cell, row["source"]), "no explanation known")
    columns = {"published": float(value), "reproduced": ours, "low": decisive[0], "high": decisive[1]}
    return columns | {"verdict": verdict, "by_tolerance": _weigh(by_tolerance, rule)[0], "reason": reason}


def _weigh(compared: tuple[str, str], rule: dict[str, str]) -> tuple[str, str]:
    """Verdict and reason, by rule 8 where an agreement is no evidence."""
    verdict, basis = compared[0], rule["basis"]
    if verdict == "not-run":
        is_evidence = basis != "given"
    else:
        is_evidence = basis == "evidence" or (verdict != "reproduced" and basis not in ("stand-in", "undecided"))
    return compared if is_evidence else (basis, rule["fails_if"])


def outcomes(results: Path) -> dict[str, dict]:
    """What each notebook that is there exported about cells and claims, and what it was made from, by its name."""
    there = notebook_files("py")
    files = sorted((results / "outcomes").glob("*.json"))
    return {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in files if file.stem in there}


def _exported(results: Path, kind: str, columns: list[str]) -> pd.DataFrame:
    """The notebooks' "cells" or "claims"."""
    rows = [row | {"notebook": name} for name, outcome in outcomes(results).items() for row in outcome[kind]]
    return pd.DataFrame(rows, columns=[*columns, "notebook"])


def verdicts(results: Path) -> pd.DataFrame:
    """Judge every printed cell from the notebooks' outcomes; what none has computed is `given` or `not-run`."""
    cells = published.cells()
    found = _exported(results, "cells", ["id", "source", "numbers"])
    missing = cells[~cells.index.isin(found["id"])]
    source = missing["element"].isin(["Table 3", "Table 4"]).map({True: "stand-in", False: "authors"})
    not_computed = pd.DataFrame({"id": missing.index, "source": source.to_numpy(), "numbers": math.nan})
    table = judge_rows(pd.concat([found.astype(object), not_computed]))
    order = {cell: position for position, cell in enumerate(cells.index)}
    return table.sort_values(["id", "source"], key=lambda c: c.map(order) if c.name == "id" else c, ignore_index=True)


def decided_claims(results: Path) -> pd.DataFrame:
    """What the notebooks' outcomes say of the prose claims: `id, verdict, measured, notebook`."""
    claims = _exported(results, "claims", ["id", "holds", "measured"])
    claims.insert(1, "verdict", [CLAIM_VERDICTS[holds] for holds in claims.pop("holds")])
    return claims


def deciding(table: pd.DataFrame) -> pd.DataFrame:
    """One verdict for each printed number (rule 9): the row of the first source that judges it."""
    first = table.sort_values("source", key=lambda source: source.map(SOURCES.index), kind="stable")
    return first.drop_duplicates("id").sort_index()


def verdict_counts(table: pd.DataFrame) -> pd.DataFrame:
    """Count the printed numbers of each element by their verdict."""
    decided, elements = deciding(table), published.cells()["element"]
    counts = pd.crosstab(elements[decided["id"]].to_numpy(), decided["verdict"].to_numpy())
    counts = counts.rename_axis(index="element", columns="verdict")
    return counts.reindex(index=elements.unique(), columns=[name for name in VERDICTS if name in counts])
