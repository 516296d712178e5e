"""Verdicts: does a printed number lie in our interval, how far might it have moved, where does ours come from.

1. A notebook exports one number for a printed number; or realisations of it, by setting.
2. The interval of one number is ours plus and minus the tolerance of its row in the table of cells; of a printed upper
   bound, whatever is not below ours. The interval of realisations is what the settings' `interval` makes of all of
   them together, and ours is their median.
3. `agrees`: the printed number lies in the interval. `differs`: it does not. `not tested`: ours is a stand-in's or
   was taken over, no notebook computed it, or too few realisations give an interval.
4. `resolution`: how far below and above ours the printed number might have been, and agreed. `weak`: a number a third
   larger or smaller than the printed one would have agreed, too.
5. A claim holds, or does not, or is undecided, by the rule and the limit of its row in the table of claims.
"""

import math
from collections.abc import Iterator, Mapping
from decimal import Decimal, InvalidOperation
from itertools import chain
from typing import Any

import numpy as np
import pandas as pd

from replication.files import UserError
from workbook.outcomes import (
    OUTPUT_FOLDER,
    Cells,
    cell_rows,
    data_are_simulated,
    load_outcomes,
    read_made,
    read_table,
    save_outcome,
)
from workbook.project import find_hook

CONSISTENT = "the paper's own numbers"  # a source, whose numbers show that the paper is consistent with itself
NOT_TESTED = ("stand-in", "taken over")
GRADES = ("agrees", "agrees weakly", "consistent", "differs", "not tested")
CLAIM_VERDICTS = {True: "holds", False: "does not hold", None: "undecided"}

Criteria = Mapping[str, float] | None  # limits to try in place of those of the table, by claim
Measured = Mapping[str, tuple[Any, str]]  # by claim what its rule compares, and in words


def collect(what: str, columns: list[str]) -> pd.DataFrame:
    """Collect the "cells" or "claims" of all outcomes, by id, with their notebooks; UserError where two export one."""
    outcomes = load_outcomes().items()
    rows = [row | {"notebook": name} for name, outcome in outcomes for row in outcome[what]]
    table = pd.DataFrame(rows, columns=["id", *columns, "notebook"]).set_index("id")
    for name in table.index[table.index.duplicated()]:
        both = f"{name}: exported by two notebooks, {' and '.join(table.loc[name, 'notebook'])}"
        raise UserError(f"{both}: one of their outcomes is another's; make all runs them")
    return table


# ----------------------------------------------------------------------------------------------------------- numbers


def like_printed(value: float, printed: str, more: int = 0) -> str:
    """Write our number with the digits of the printed one, or with more: as asked, or where that shows nothing."""
    if math.isnan(value):
        return ""
    try:
        digits = Decimal(printed.rstrip("%"))
    except InvalidOperation:
        return f"{value:.4g}"
    if "e" in printed.lower():
        return f"{value:.2e}"
    text = f"{value:.{max(0, -int(digits.as_tuple().exponent)) + more}f}"
    return text if abs(float(text) - value) <= 0.02 * abs(value) else f"{value:.3g}"


def _resolution(cell: str, low: float, ours: float, high: float) -> str:
    """Rule 4, in words: "-4.3 % to +2.4 %"; of an SD factors: "1/4.3 to 21 times"; of a number about zero, its ends."""
    if math.isinf(high):
        return "anything above"
    if cell.endswith(".sd"):
        return f"1/{ours / low:.2g} to {high / ours:.2g} times"
    if low <= 0 <= high:
        return f"{low - ours:+.2g} to {high - ours:+.2g}"
    ends = sorted(100 * (end / ours - 1) for end in (low, high))
    return f"{ends[0]:+.2g} % to {ends[1]:+.2g} %"


def _judge_number(row: Any) -> dict[str, Any]:
    """Rules 2 to 4, of one number beside the printed one."""
    place = f"row {row.row}" if row.row.isdigit() else row.row
    column = "" if row.column == "value" else f", {row.column.replace('_', ' ')}"
    settings = row.numbers if isinstance(row.numbers, Mapping) else {}
    pooled = [*chain(*settings.values())] if settings else [row.numbers]
    ours = float(np.median(pooled))
    tolerance = row.abs_tol + row.rel_tol * abs(row.published)
    low, high = ours - tolerance, math.inf if row.kind == "bound" else ours + tolerance
    reason = row.reason
    if settings:
        interval = find_hook("interval")
        low, high = interval(pooled)
        alone = [interval(each) for each in settings.values()]
        if np.isfinite(alone).all():
            agreeing = sum(start <= row.published <= end for start, end in alone)
            reason += f"; agrees under {agreeing} of {len(alone)} settings alone"
        below = sum(x < row.published for x in pooled)
        reason += f"; {below} of {len(pooled)} realisations lie below the printed number"
    agrees, *others = (low <= each * row.published <= high for each in (1, 2 / 3, 4 / 3))
    grade = agreement = "agrees" if agrees else "differs"
    why = row.known_difference or "no explanation known"
    shown, start, end = (like_printed(x, row.printed) for x in (ours, low, high))
    words = f"at least {start}" if math.isinf(high) else f"{start} to {end}"
    resolution = _resolution(row.Index, low, ours, high)
    if row.expected in NOT_TESTED or not math.isfinite(low):  # whatever an outcome says
        grade = agreement = "not tested"
        words = resolution = ""
        if row.expected not in NOT_TESTED:
            reason = "too few realisations for an interval"
    elif not agrees:
        reason = f"{why}; {reason}"
    elif any(others):
        grade = "agrees weakly"
    elif row.source == CONSISTENT:
        grade = "consistent"
    return {
        "name": f"{row.element}, {place}{column}",
        "reproduced": ours,
        "low": low,
        "high": high,
        "ours": shown,
        "interval": words,
        "resolution": resolution,
        "agreement": agreement,
        "grade": grade,  # how much an agreement says
        "why": why,
        "reason": reason,
    }


def judge_numbers(ours: pd.DataFrame) -> pd.DataFrame:
    """Compare ours, `source, numbers` by id, with printed numbers: those of the table of cells, with their verdicts."""
    cells = read_table("cells").rename(columns={"source": "expected", "value": "published"})
    table = ours.join(cells.astype({"published": float}))
    verdicts = [_judge_number(row) for row in table.itertuples()]
    return table.assign(**pd.DataFrame(verdicts, table.index))


def verdicts() -> pd.DataFrame:
    """Judge every printed number in the paper's order, by the notebooks' outcomes, as `judge_numbers` does.

    Raises
    ------
    UserError
        No notebook exports a number that is not taken over, or two do.
    """
    cells = read_table("cells")
    ours = collect("cells", ["source", "numbers"]).reindex(cells.index)
    table = judge_numbers(ours.fillna({"source": cells["source"], "notebook": ""}))
    is_lacking = ~np.isfinite(table["reproduced"]) & (table["expected"] != "taken over")
    for cell in table.index[is_lacking]:
        raise UserError(f"{cell}: no notebook has computed it; make all runs them")
    return table


# ------------------------------------------------------------------------------------------------------------ claims


def decide(claim: str, measured: Any, criteria: Criteria = None) -> bool | None:
    """Decide a claim by its rule in the table of claims; None is undecided, as is whatever was not measured (nan).

    `measured` is what the rule compares with the limit: one number; the two ends of an interval
    where the rule's name begins with "interval"; p of the claim and p of its opposite for "p
    below". A number within 1e-9 of the limit, relatively, is the limit: the last bits do not
    decide. `criteria` are limits to try in place of the table's.
    """
    claims = read_table("claims")
    rule = claims.at[claim, "rule"]
    limit = float((criteria or {}).get(claim, claims.at[claim, "criterion"]))
    if np.size(measured) != (2 if rule.startswith(("interval", "p ")) else 1):
        raise ValueError(f"{claim}: the rule {rule!r} does not take {measured}")
    ends = np.ravel(measured)[[0, -1]].astype(float)
    if np.isnan(ends).any():
        return None
    low, high = np.where(np.isclose(ends, limit, rtol=1e-9, atol=0), limit, ends)
    half_digit = 0.5 * 10.0 ** int(Decimal(str(limit)).as_tuple().exponent) * (1 + 1e-9)
    holds = {
        "below": low < limit,
        "at most": low <= limit,
        "above": low > limit,
        "at least": low >= limit,
        "rounds to": abs(low - limit) <= half_digit,
        "rounds to, or a bound": abs(low - limit) <= half_digit,
        "p below": low < limit,
        "interval below": high < limit,
        "interval above": low > limit,
    }
    fails = {
        "rounds to, or a bound": low > limit,
        "p below": high < limit,
        "interval below": low > limit,
        "interval above": high < limit,
    }
    return True if holds[rule] else False if fails.get(rule, True) else None


def decide_all(measured: Measured, criteria: Criteria = None) -> dict[str, tuple[bool | None, str]]:
    """Decide claims by what was measured of each, as `decide` does; the words stay beside it."""
    return {
        claim: (decide(claim, numbers, criteria), words)
        for claim, (numbers, words) in measured.items()
    }


def claims() -> pd.DataFrame:
    """The table of claims with `verdict, measured, notebook`; and `claim`, the paper's words and how we read them.

    Of a claim that no notebook can decide, the table says why: it is undecided. UserError where no notebook decides
    another one, or two do.
    """
    table = read_table("claims").join(collect("claims", ["holds", "measured"]))
    table["verdict"] = table["holds"].map(CLAIM_VERDICTS).fillna(CLAIM_VERDICTS[None])
    table["measured"] = table["measured"].fillna(table["untested"])
    for claim in table.index[table["measured"] == ""]:
        raise UserError(f"{claim}: no notebook has decided it; make all runs them")
    readings = (" (" + table["reading"] + ")").mask(table["reading"] == "", "")
    table["claim"] = "“" + table["quote"] + "”" + readings
    return table.fillna({"notebook": ""})


# ------------------------------------------------------------------------------------------------ beside a notebook


def _committed(table: str, ours: pd.Series) -> pd.Series:
    """What is committed in a column of a table of the results, which is ours where this run makes it."""
    if OUTPUT_FOLDER and not data_are_simulated():
        return ours
    return read_made(table).set_index("id")[ours.name].reindex(ours.index)


def compare(
    cells: Cells | None = None, claims: Measured | None = None, criteria: Criteria = None
) -> Iterator[pd.DataFrame]:
    """Our numbers beside the printed ones, and what we measured of sentences, as `workbook.verdict` takes them.

    Yields
    ------
    DataFrame
        A row a number, by id, as text: its name; the printed number; ours, of realisations their median; the interval
        that a printed number must lie in to agree; what is committed, which is ours where this run makes it; and the
        verdict. Then a row a sentence: what was measured, what is committed where that is another, and the verdict.
    """
    if cells:
        table = judge_numbers(pd.DataFrame(cell_rows(cells)).set_index("id"))
        table["committed"] = _committed("verdicts", table["reproduced"])
        table["ours"] = table["reproduced"]
        for column in ("ours", "low", "high", "committed"):
            pairs = zip(table[column], table["printed"], strict=True)
            table[column] = [like_printed(x, printed, 1) for x, printed in pairs]
        table = table.rename(columns={"name": "number", "agreement": "verdict"})
        yield table[["number", "printed", "ours", "low", "high", "committed", "verdict"]]
    if claims:
        rows = [
            (claim, claim.replace("_", " "), words, CLAIM_VERDICTS[holds])
            for claim, (holds, words) in decide_all(claims, criteria).items()
        ]
        columns = ["id", "the paper's sentence", "measured", "verdict"]
        table = pd.DataFrame(rows, columns=columns).set_index("id")
        committed = _committed("claims", table["measured"]).fillna("")
        if (committed != table["measured"]).any():
            table.insert(2, "committed", committed)
        yield table


def judge(
    cells: Cells | None = None, claims: Measured | None = None, criteria: Criteria = None
) -> pd.DataFrame:
    """The tables of `compare` in one: a row a number or claim, by id, with its verdict."""
    return pd.concat(compare(cells, claims, criteria))


def verdict(
    text: str,
    cells: Cells | None = None,
    claims: Measured | None = None,
    facts: Mapping[str, Any] | None = None,
    tables: Mapping[str, pd.DataFrame] | None = None,
    criteria: Criteria = None,
) -> None:
    """Show how this run's numbers compare, as `compare` does, and a sentence on them; export them for the report.

    Parameters
    ----------
    text : str
        A sentence in Markdown, made of this run's numbers alone.
    cells : mapping of str to float, or to a mapping of str to floats
        Our number for each printed number, by its id in the table of cells; or its realisations by setting.
    claims : mapping of str to (float or two floats, str)
        What was measured of each claim, by its id in the table of claims, whose rule decides it; and in words.
    facts : mapping of str to any JSON value
        What the report's template reads, by the names that it has there.
    tables : mapping of str to DataFrame
        Written to `results/NAME.csv` with six significant digits.
    criteria : mapping of str to float, optional
        Limits to try in place of those of the table of claims.
    """
    from IPython.display import Markdown, display

    for table in compare(cells, claims, criteria):
        display(table.set_index(table.columns[0]))
    display(Markdown(text))
    save_outcome(cells or {}, decide_all(claims or {}, criteria), facts or {}, tables or {})
