"""Verdicts: does a printed number lie in our interval, how far might it have moved, where does ours come from.

1. A notebook exports one number for a printed number; for a mean or an SD of Table 2, realisations by setting.
2. The interval of one number is ours plus and minus the tolerance of `cells.csv`; of a printed upper bound, whatever
   is not below ours. The interval of realisations is the 95 % prediction interval of all of them together, by order
   statistics, and ours is their median.
3. `agrees`: the printed number lies in the interval. `differs`: it does not. `not tested`: ours is a stand-in's or
   was taken over, no notebook computed it, or too few realisations give an interval.
4. `resolution`: how far below and above ours the printed number might have been, and agreed. `weak`: twice the
   printed number, or half of it, would have agreed, too.
"""

import math
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from replication import published
from replication.files import UserError
from replication.records import records_are_simulated
from workbook.outcomes import (
    OUTPUT_FOLDER,
    Cells,
    Claims,
    Numbers,
    cell_rows,
    claim_rows,
    load_outcomes,
    read_made,
    save_outcome,
    source_of,
)

AGREEMENTS = ("agrees", "differs", "not tested")
SOURCES = {
    "recomputed": "our search, on the authors' clean records with uniform noise of Table 2's amplitudes",
    "authors' files": "read or measured from them",
    "simulated joint": "the joint that we identified from the authors' records",
    "the paper's own numbers": "arithmetic between printed numbers, which shows consistency alone",
    "stand-in": "simulated in place of unpublished logs; not tested",
    "taken over": "assumed as printed; not tested",
}
CONSISTENT = "the paper's own numbers"  # a source, whose numbers show that the paper is consistent with itself
GRADES = ("agrees", "agrees weakly", "consistent", "differs", "not tested")
NOT_TESTED = ("stand-in", "taken over")
CLAIM_VERDICTS = {True: "holds", False: "does not hold", None: "undecided"}


def _pooled(numbers: Numbers) -> list[float]:
    """Realisations of all settings together; of one number, that."""
    return [*chain(*numbers.values())] if isinstance(numbers, Mapping) else [numbers]


def interval(cell: str, numbers: Numbers) -> tuple[float, float]:
    """Rule 2: the numbers that agree with ours."""
    if isinstance(numbers, Mapping):
        from studies.intervals import prediction_interval  # with SciPy, slow to import

        return prediction_interval(_pooled(numbers))
    tolerance = published.tolerance(cell)
    is_bound = published.cells().at[cell, "kind"] == "bound"
    return numbers - tolerance, math.inf if is_bound else numbers + tolerance


def resolution(cell: str, ours: float, low: float, high: float) -> str:
    """Rule 4, in words: "-4.3 % to +2.4 %"; of an SD factors: "1/4.3 to 21 times"; of a number about zero, its ends."""
    if math.isinf(high):
        return "anything above"
    if cell.endswith(".sd"):
        return f"1/{ours / low:.2g} to {high / ours:.2g} times"
    if low <= 0 <= high:
        return f"{low - ours:+.2g} to {high - ours:+.2g}"
    ends = sorted((100 * (low / ours - 1), 100 * (high / ours - 1)))
    return f"{ends[0]:+.2g} % to {ends[1]:+.2g} %"


def is_weak(printed: float, low: float, high: float) -> bool:
    """Rule 4: whether an interval would hold twice a printed number, or half of it."""
    return any(low <= factor * printed <= high for factor in (0.5, 2))


def judge_number(id: str, source: str, numbers: Numbers, notebook: str = "") -> dict[str, Any]:
    """Compare ours with one printed number: a row of `verdicts.csv`."""
    printed = published.cells().loc[id]
    value, reason = float(printed["value"]), printed["reason"]
    low, high = interval(id, numbers)
    ours = float(numbers) if not isinstance(numbers, Mapping) else math.nan
    if isinstance(numbers, Mapping):
        pooled = _pooled(numbers)
        ours = float(np.median(pooled))
        alone = [interval(id, {name: each}) for name, each in numbers.items()]
        if np.isfinite(alone).all():
            agreeing = sum(start <= value <= end for start, end in alone)
            reason += f"; agrees under {agreeing} of {len(alone)} settings alone"
        below = sum(number < value for number in pooled)
        reason += f"; {below} of {len(pooled)} realisations lie below the printed number"
    agreement = "not tested"
    if printed["source"] in NOT_TESTED:  # whatever an outcome says
        pass
    elif not math.isfinite(ours):
        reason = "no notebook computed it"
    elif not math.isfinite(low):
        reason = "too few realisations for an interval"
    elif low <= value <= high:
        agreement = "agrees"
    else:
        agreement = "differs"
        reason = f"{printed['known_difference'] or 'no explanation known'}; {reason}"
    return {
        "id": id,
        "printed": printed["printed"],
        "published": value,
        "reproduced": ours,
        "low": low,
        "high": high,
        "agreement": agreement,
        "weak": "yes" if agreement == "agrees" and is_weak(value, low, high) else "",
        "source": source,
        "resolution": "" if agreement == "not tested" else resolution(id, ours, low, high),
        "reason": reason,
        "notebook": notebook,
    }


def verdicts(results: Path) -> pd.DataFrame:
    """Judge every printed number in the paper's order, by the notebooks' outcomes.

    Raises
    ------
    UserError
        No notebook exports a number that is not taken over, or two do.
    """
    ours = {
        cell: {"id": cell, "source": source_of(cell), "numbers": math.nan}
        for cell in published.cells().index
    }
    for name, outcome in load_outcomes(results).items():
        for row in outcome["cells"]:
            if "notebook" in ours[row["id"]]:
                raise _exported_twice(row["id"], ours[row["id"]]["notebook"], name)
            ours[row["id"]] = row | {"notebook": name}
    is_ours = published.cells()["source"] != "taken over"
    for cell in published.cells().index[is_ours]:
        if not np.isfinite(_pooled(ours[cell]["numbers"])).all():
            raise UserError(f"{cell}: no notebook has computed it; make all runs them")
    return pd.DataFrame([judge_number(**row) for row in ours.values()])


def grade(verdicts: pd.DataFrame) -> pd.DataFrame:
    """Add to verdicts how much each says, `grade`; by id."""
    grades = verdicts["agreement"].mask(verdicts["source"].eq(CONSISTENT), "consistent")
    grades = grades.mask(verdicts["weak"] == "yes", "agrees weakly")
    grades = grades.where(verdicts["agreement"] == "agrees", verdicts["agreement"])
    return verdicts.assign(grade=grades).set_index("id")


def _exported_twice(id: str, *notebooks: str) -> UserError:
    why = "one of their outcomes is another's; make all runs them"
    return UserError(f"{id}: exported by two notebooks, {' and '.join(notebooks)}: {why}")


def claims(results: Path) -> pd.DataFrame:
    """The paper's sentences with their verdicts: `id, of, quote, reading, section, verdict, measured, notebook`.

    Of a claim that no notebook can decide, `claims.csv` says why: it is undecided. UserError where no notebook decides
    another one, or two do.
    """
    claimed = published.table("claims")
    table = claimed[["of", "quote", "reading", "section"]]
    table = table.assign(verdict=CLAIM_VERDICTS[None], measured=claimed["untested"], notebook="")
    for name, outcome in load_outcomes(results).items():
        for row in outcome["claims"]:
            if table.loc[row["id"], "notebook"]:
                raise _exported_twice(row["id"], table.loc[row["id"], "notebook"], name)
            decided = [CLAIM_VERDICTS[row["holds"]], row["measured"], name]
            table.loc[row["id"], ["verdict", "measured", "notebook"]] = decided
    for claim in table.index[table["measured"] == ""]:
        raise UserError(f"{claim}: no notebook has decided it; make all runs them")
    return table.reset_index()


def judge(cells: Cells | None = None, claims: Claims | None = None) -> pd.DataFrame:
    """Compare our numbers and decisions, as `workbook.verdict` takes them, with the printed ones.

    Returns
    -------
    DataFrame
        A row a number or claim: id; the printed number; ours, of realisations their median; the
        interval that a printed number must lie in to agree; the committed number, which is ours
        where this run makes what is committed; and the verdict.
    """
    numbers = [judge_number(**row) for row in cell_rows(cells or {})]
    rows = [each | {"ours": each["reproduced"], "verdict": each["agreement"]} for each in numbers]
    rows += [
        {"id": row["id"], "ours": row["measured"], "verdict": CLAIM_VERDICTS[row["holds"]]}
        for row in claim_rows(claims or {})
    ]
    shown = ["id", "printed", "ours", "low", "high", "committed", "verdict"]
    table = pd.DataFrame(rows, columns=shown, dtype=object).set_index("id")
    table["committed"] = table["ours"]
    if records_are_simulated() or not OUTPUT_FOLDER:
        kept = read_made("verdicts").set_index("id")["reproduced"]
        claimed = read_made("claims").set_index("id")["measured"]
        table["committed"] = table.index.map(pd.concat([kept.astype(object), claimed]))
    return table.fillna("").map(lambda x: f"{x:.5g}" if isinstance(x, float) else str(x))


def verdict(
    text: str,
    cells: Cells | None = None,
    claims: Claims | None = None,
    facts: Mapping[str, object] | None = None,
    tables: Mapping[str, pd.DataFrame] | None = None,
) -> None:
    """Show how this run's numbers compare, as `judge` does, and a sentence on them; export them for the report.

    Parameters
    ----------
    text : str
        A sentence in Markdown, made of this run's numbers alone.
    cells : mapping of str to float, or to a mapping of str to floats
        Our number for each printed number, by its id in `cells.csv`; or its realisations by setting.
    claims : mapping of str to (bool or None, str)
        Whether each claim of `claims.csv` holds, None if that is undecided, and what was measured.
    facts : mapping of str to str or int
        Numbers as the report's sentences write them, by the names that they have there. One that
        is not there (nan) is no fact.
    tables : mapping of str to DataFrame
        Written to `results/NAME.csv` with six significant digits.
    """
    from IPython.display import Markdown, display

    if cells or claims:
        display(judge(cells, claims))
    display(Markdown(text))
    save_outcome(cells or {}, claims or {}, facts or {}, tables or {})
