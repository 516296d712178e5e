"""Verdicts: what the notebooks computed beside what the paper prints.

The rule, fixed on 2026-11-22, before any verdict was computed with it. Verdicts by tolerance and by kept pools of runs
had been seen by then, and so had the width of the regions of Table 2's means (`by_tolerance` keeps the former).

1. A notebook exports one number for a cell, or one for each noise realisation, all from runs of its own.
2. The region of several numbers is where the number of one more realisation would lie with 95 %: the mean of their
   logarithms ± t(n - 1) s sqrt(1 + 1/n), without logarithms where the sign counts; ours is its centre. The region of
   one number is ours ± the cell's tolerance, whose reason stands in `cells.csv`.
3. `reproduced`: the printed number and ours lie in the region, and the region is not too wide.
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
from scipy import stats

from replication import published
from replication.workbook.files import ROOT

VERDICT_COLUMNS = ["id", "source", "printed", "published", "reproduced", "low", "high"]
VERDICT_COLUMNS += ["verdict", "by_tolerance", "reason", "notebook"]
SOURCES = ("authors", "simulated", "stand-in")  # the first that judges a cell decides it
# What is decided by evidence comes first; the headlines count it alone.
EVIDENCE = ("reproduced", "erratum", "differs")
VERDICTS = (*EVIDENCE, "consistent", "given", "undecided", "stand-in", "not-run")
CLAIM_VERDICTS = {True: "holds", False: "does not hold", None: "undecided"}
LEVEL = 0.95  # of a region
Interval = tuple[float, float]


def region(numbers: Sequence[float], signed: bool) -> Interval:
    """Where the number of one more realisation would lie with 95 %; anywhere, if there is one realisation only."""
    if len(numbers) < 2:
        return -math.inf, math.inf
    values = np.asarray(numbers, dtype=float) if signed else np.log(numbers)
    half = stats.t.ppf((1 + LEVEL) / 2, values.size - 1) * values.std(ddof=1) * math.sqrt(1 + 1 / values.size)
    low, high = values.mean() - half, values.mean() + half
    return (float(low), float(high)) if signed else (math.exp(low), math.exp(high))


def region_without_one(numbers: Sequence[float], signed: bool) -> Interval:
    """The smallest interval that holds every region with one realisation left out."""
    regions = [region([*numbers[:i], *numbers[i + 1 :]], signed) for i in range(len(numbers))]
    return min(low for low, _ in regions), max(high for _, high in regions)


def centre(numbers: Sequence[float], signed: bool) -> float:
    """The one number that stands for several realisations: the middle of their region."""
    return float(np.mean(numbers)) if signed else float(np.exp(np.mean(np.log(numbers))))


def rivals(cell: str) -> list[float]:
    """Printed numbers that a region must not hold besides the cell's own: its column's neighbours, a mean's true A."""
    cells = published.cells()
    own = cells.loc[cell]
    alike = cells[(cells["element"] == own["element"]) & (cells["column"] == own["column"])]
    others = alike.loc[alike["unit"] == own["unit"], "value"].astype(float)
    smaller, larger = others[others < own["value"]], others[others > own["value"]]
    found = [*smaller.nlargest(1), *larger.nsmallest(1)]
    if own["element"] == "Table 2" and own["column"] == "mean":
        found.append(published.value(cell.replace(".mean", ".theoretical")))
    return found


def compare(cell: str, ours: float, decisive: Interval, without_one: Interval) -> tuple[str, str]:
    """Apply rules 3 to 7 to a cell: the verdict and its reason.

    `decisive` is the region, `without_one` holds every region with one realisation left out; the same for one number.
    """
    printed, (low, high) = published.cells().loc[cell], decisive
    value = float(printed["value"])
    if not math.isfinite(ours):
        return "not-run", "no number was computed"
    if printed["kind"] == "bound" and low <= value < high:
        return "undecided", f"the limit lies in the 95 % interval of our number, {low:.4g} to {high:.4g}"
    inside = value >= high if printed["kind"] == "bound" else low <= value <= high
    if inside and low <= ours <= high:
        held = [] if printed["kind"] == "bound" else [rival for rival in rivals(cell) if low <= rival <= high]
        if held or math.isinf(high - low):
            also = ", ".join(f"{rival:.4g}" for rival in held) or "every number"
            return "undecided", f"the region is too wide: it also holds {also}"
        return "reproduced", "the printed number and ours lie in the region"
    if not inside and without_one[0] <= value <= without_one[1]:
        return "undecided", "outside the region, but not with one of the realisations left out"
    return outside(cell, ours) if not inside else ("differs", "our number lies outside its own region")


def outside(cell: str, ours: float) -> tuple[str, str]:
    """Verdict on a printed number that is not ours: rule 6, else rule 5."""
    number, tolerance, text = corrections().get(cell, (math.nan, math.nan, ""))
    if abs(ours - number) <= tolerance:
        return "erratum", f"corrected: {text}"
    return "differs", "the printed number lies outside the region"


def corrections() -> dict[str, tuple[float, float, str]]:
    """Cells that an erratum corrects: the right number, what its last digit leaves open, and the erratum's words."""
    named = [
        (part.partition("="), row["corrected"])
        for _, row in published.errata().iterrows()
        for part in row["cells"].split()
    ]
    return {cell: (float(number), published.half_last_digit(number), text) for (cell, _, number), text in named}


def basis(cell: str, source: str) -> pd.Series:
    """What an agreement with a cell would be worth: the first row of `basis.csv` that is about it.

    Raises
    ------
    KeyError
        `basis.csv` says nothing of such a cell.
    """
    for _, row in published.basis().iterrows():
        if fnmatchcase(cell, row["cells"]) and row["source"] in (source, "*"):
            return row
    raise KeyError(f"{cell}, {source}: no row of basis.csv is about it")


def judge(found: pd.DataFrame) -> pd.DataFrame:
    """Compare what notebooks computed with the printed numbers.

    Parameters
    ----------
    found : DataFrame
        Columns `id, source, numbers, notebook`; `numbers` is one number, or a list with one for each realisation.

    Returns
    -------
    DataFrame
        Columns `VERDICT_COLUMNS`. `by_tolerance` is what the cell's tolerance alone would say, as before 2026-11-22.
    """
    return pd.DataFrame([_judge(row) for row in found.to_dict("records")], columns=VERDICT_COLUMNS)


def judge_cells(cells: Mapping[str, float | Sequence[float]], source: str, notebook: str = "") -> pd.DataFrame:
    """`judge` our numbers from one source by cell id: one number, or a sequence with one for each realisation."""
    rows = [
        {"id": cell, "source": source, "numbers": list(numbers) if np.ndim(numbers) else numbers, "notebook": notebook}
        for cell, numbers in cells.items()
    ]
    return judge(pd.DataFrame(rows))


def _judge(row: dict) -> dict:
    cell, source, numbers = published.cells().loc[row["id"]], row["source"], row["numbers"]
    tolerance, signed = published.tolerance(row["id"]), cell["kind"] == "signed"
    if isinstance(numbers, list):
        ours, decisive = centre(numbers, signed), region(numbers, signed)
        without_one = region_without_one(numbers, signed)
    else:
        ours = float(numbers)
        decisive = without_one = (ours - tolerance, ours + tolerance)
    worth = basis(row["id"], source)
    verdict, reason = _worded(worth, row["id"], source, compare(row["id"], ours, decisive, without_one))
    near = ours <= cell["value"] if cell["kind"] == "bound" else abs(ours - cell["value"]) <= tolerance
    old = ("reproduced", "") if near else outside(row["id"], ours)
    return {
        "id": row["id"],
        "source": source,
        "printed": cell["printed"],
        "published": float(cell["value"]),
        "reproduced": ours,
        "low": decisive[0],
        "high": decisive[1],
        "verdict": verdict,
        "by_tolerance": _worded(worth, row["id"], source, old)[0],
        "reason": reason,
        "notebook": row["notebook"],
    }


def _worded(worth: pd.Series, cell: str, source: str, compared: tuple[str, str]) -> tuple[str, str]:
    """The verdict's word and reason where an agreement is no evidence, and the known reason of a difference."""
    verdict, reason = compared
    if worth["basis"] in ("stand-in", "undecided"):
        return worth["basis"], worth["fails_if"]
    if verdict == "differs":
        return verdict, _known_reasons().get((cell, source), "no explanation known")
    if verdict == "reproduced" and worth["basis"] != "evidence":
        return worth["basis"], worth["fails_if"]
    return verdict, reason


def _known_reasons() -> dict[tuple[str, str], str]:
    known = published.known_differences()
    return {(row["id"], row["source"]): row["reason"] for _, row in known.iterrows()}


def outcomes(results: Path) -> dict[str, dict]:
    """What each notebook exported about cells and claims, and what it was made from, by the notebook's name.

    What a notebook left that is no longer there is not counted.
    """
    files = sorted((results / "outcomes").glob("*.json"))
    there = {source.stem for source in (ROOT / "notebooks").glob("*.py")}
    return {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in files if file.stem in there}


def verdicts(results: Path) -> pd.DataFrame:
    """Judge every printed cell from the notebooks' outcomes; what none has computed is `given` or `not-run`."""
    found = pd.DataFrame(
        [row | {"notebook": name} for name, outcome in outcomes(results).items() for row in outcome["cells"]],
        columns=["id", "source", "numbers", "notebook"],
    )
    cells = published.cells()
    missing = [_not_computed(cell) for cell in cells.index.difference(found["id"], sort=False)]
    parts = [part for part in (judge(found), pd.DataFrame(missing)) if not part.empty]
    table = pd.concat(parts, ignore_index=True).reindex(columns=VERDICT_COLUMNS)
    order = {cell: position for position, cell in enumerate(cells.index)}
    return table.sort_values(["id", "source"], key=lambda c: c.map(order) if c.name == "id" else c, ignore_index=True)


def _not_computed(cell: str) -> dict:
    printed = published.cells().loc[cell]
    source = "stand-in" if printed["element"] in ("Table 3", "Table 4") else "authors"
    try:
        worth = basis(cell, source)
    except KeyError:  # only our simulation or a stand-in could compute it
        worth = {"basis": "", "fails_if": ""}
    given = worth["basis"] == "given"
    verdict, reason = ("given", worth["fails_if"]) if given else ("not-run", "no notebook computed it")
    told = {"id": cell, "source": source, "printed": printed["printed"], "published": float(printed["value"])}
    return told | {"verdict": verdict, "by_tolerance": verdict, "reason": reason}


def deciding(table: pd.DataFrame) -> pd.DataFrame:
    """One verdict for each printed number (rule 9): the row of the first source that judges it."""
    first = table.assign(order=table["source"].map(SOURCES.index)).sort_values("order", kind="stable")
    return first.drop_duplicates("id").drop(columns="order").sort_index()


def decided_claims(results: Path) -> pd.DataFrame:
    """What the notebooks' outcomes say of the prose claims: `id, verdict, measured, notebook`."""
    rows = [
        {"id": row["id"], "verdict": CLAIM_VERDICTS[row["holds"]], "measured": row["measured"], "notebook": name}
        for name, outcome in outcomes(results).items()
        for row in outcome["claims"]
    ]
    return pd.DataFrame(rows, columns=["id", "verdict", "measured", "notebook"])


def verdict_counts(table: pd.DataFrame) -> pd.DataFrame:
    """Count the printed numbers of each element by their verdict."""
    decided = deciding(table)
    element = published.cells()["element"].reindex(decided["id"]).to_numpy()
    counts = pd.crosstab(element, decided["verdict"].to_numpy(), rownames=["element"], colnames=["verdict"])
    return counts.reindex(
        index=list(dict.fromkeys(published.cells()["element"])), columns=[name for name in VERDICTS if name in counts]
    )
