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
from collections.abc import Mapping
from decimal import Decimal, InvalidOperation
from itertools import chain
from typing import Any

import numpy as np
import pandas as pd

from replication.files import UserError
from workbook.outcomes import (
    OUTPUT_FOLDER,
    Cells,
    Numbers,
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


def _pool(numbers: Numbers) -> list[float]:
    """Realisations of all settings together; of one number, that."""
    return [*chain(*numbers.values())] if isinstance(numbers, Mapping) else [numbers]


def _interval(row: Any) -> tuple[float, float]:
    """Rule 2."""
    if isinstance(row.numbers, Mapping):
        return find_hook("interval")(_pool(row.numbers))
    tolerance = row.abs_tol + row.rel_tol * abs(row.published)
    high = math.inf if row.kind == "bound" else row.reproduced + tolerance
    return row.reproduced - tolerance, high


def _resolution(row: Any) -> str:
    """Rule 4, in words: "-4.3 % to +2.4 %"; of an SD factors: "1/4.3 to 21 times"; of a number about zero, its ends."""
    low, ours = row.low, row.reproduced
    if row.agreement == "not tested":
        return ""
    if math.isinf(row.high):
        return "anything above"
    if row.Index.endswith(".sd"):
        return f"1/{ours / low:.2g} to {row.high / ours:.2g} times"
    if low <= 0 <= row.high:
        return f"{low - ours:+.2g} to {row.high - ours:+.2g}"
    ends = sorted((100 * (low / ours - 1), 100 * (row.high / ours - 1)))
    return f"{ends[0]:+.2g} % to {ends[1]:+.2g} %"


def _reason(row: Any) -> str:
    """Why a number agrees, differs or is not tested; and of realisations, how many lie below the printed one."""
    if row.agreement == "not tested" and row.expected not in NOT_TESTED:
        is_there = math.isfinite(row.reproduced)
        return "too few realisations for an interval" if is_there else "no notebook computed it"
    words = f"{row.why}; {row.reason}" if row.agreement == "differs" else row.reason
    if not isinstance(row.numbers, Mapping):
        return words
    alone = [find_hook("interval")(each) for each in row.numbers.values()]
    if np.isfinite(alone).all():
        agreeing = sum(low <= row.published <= high for low, high in alone)
        words += f"; agrees under {agreeing} of {len(alone)} settings alone"
    pooled = _pool(row.numbers)
    below = sum(x < row.published for x in pooled)
    return f"{words}; {below} of {len(pooled)} realisations lie below the printed number"


def judge_numbers(ours: pd.DataFrame) -> pd.DataFrame:
    """Compare ours, `source, numbers` by id, with printed numbers: those of the table of cells, with their verdicts."""
    cells = read_table("cells").rename(columns={"source": "expected", "value": "published"})
    table = ours.join(cells.astype({"published": float}))
    table["reproduced"] = [float(np.median(_pool(each))) for each in table["numbers"]]
    table[["low", "high"]] = [_interval(row) for row in table.itertuples()]

    def holds(factor: float) -> pd.Series:
        return (factor * table["published"]).between(table["low"], table["high"])

    is_tested = np.isfinite(table["reproduced"]) & np.isfinite(table["low"])
    is_tested &= ~table["expected"].isin(NOT_TESTED)  # whatever an outcome says
    agreement = np.where(is_tested, np.where(holds(1), "agrees", "differs"), "not tested")
    table["agreement"] = agreement
    agrees = agreement == "agrees"
    is_weak = agrees & (holds(2 / 3) | holds(4 / 3))
    table["weak"] = np.where(is_weak, "yes", "")
    grade = table["agreement"].mask(agrees & (table["source"] == CONSISTENT), "consistent")
    table["grade"] = grade.mask(is_weak, "agrees weakly")  # how much an agreement says
    table["name"] = name_cells(table)
    table["why"] = table["known_difference"].replace("", "no explanation known")
    table["reason"] = [_reason(row) for row in table.itertuples()]
    table["resolution"] = [_resolution(row) for row in table.itertuples()]
    return table


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
    low, high = (
        limit if math.isclose(x, limit, rel_tol=1e-9) else x
        for x in np.ravel(measured)[[0, -1]].astype(float)
    )
    if math.isnan(low) or math.isnan(high):
        return None
    half_digit = 0.5 * 10.0 ** int(Decimal(str(limit)).as_tuple().exponent) * (1 + 1e-9)
    holds, fails = {
        "below": (low < limit, True),
        "at most": (low <= limit, True),
        "above": (low > limit, True),
        "at least": (low >= limit, True),
        "rounds to": (abs(low - limit) <= half_digit, True),
        "rounds to, or a bound": (abs(low - limit) <= half_digit, low > limit),
        "p below": (low < limit, high < limit),
        "interval below": (high < limit, low > limit),
        "interval above": (low > limit, high < limit),
    }[rule]
    return True if holds else False if fails else None


def decide_all(measured: Measured, criteria: Criteria = None) -> dict[str, tuple[bool | None, str]]:
    """Decide claims by what was measured of each, as `decide` does; the words stay beside it."""
    return {
        claim: (decide(claim, numbers, criteria), words)
        for claim, (numbers, words) in measured.items()
    }


def claims() -> pd.DataFrame:
    """The table of claims with `verdict, measured, notebook`.

    Of a claim that no notebook can decide, the table says why: it is undecided. UserError where no notebook decides
    another one, or two do.
    """
    table = read_table("claims").join(collect("claims", ["holds", "measured"]))
    table["verdict"] = [CLAIM_VERDICTS[None if pd.isna(each) else each] for each in table["holds"]]
    table["measured"] = table["measured"].fillna(table["untested"])
    for claim in table.index[table["measured"] == ""]:
        raise UserError(f"{claim}: no notebook has decided it; make all runs them")
    return table.fillna({"notebook": ""})


# ------------------------------------------------------------------------------------------------ beside a notebook


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


def name_cells(cells: pd.DataFrame) -> list[str]:
    """Names of printed numbers: "Table 2, row 1, mean"."""
    rows = cells["row"].where(~cells["row"].str.isdigit(), "row " + cells["row"])
    columns = (", " + cells["column"].str.replace("_", " ")).mask(cells["column"] == "value", "")
    return [*(cells["element"] + ", " + rows + columns)]


def judge(
    cells: Cells | None = None, claims: Measured | None = None, criteria: Criteria = None
) -> pd.DataFrame:
    """Compare our numbers, and what we measured of claims, with the paper, as `workbook.verdict` takes them.

    Returns
    -------
    DataFrame
        A row a number or claim, by id, as text: its name; the printed number; ours, of realisations their median, or
        what was measured; the interval that a printed number must lie in to agree; what is committed, which is ours
        where this run makes it; and the verdict.
    """
    rows = [
        (claim, claim.replace("_", " "), words, CLAIM_VERDICTS[holds])
        for claim, (holds, words) in decide_all(claims or {}, criteria).items()
    ]
    sentences = pd.DataFrame(rows, columns=["id", "name", "ours", "verdict"]).set_index("id")
    numbers = sentences[:0]
    if cells:
        numbers = judge_numbers(pd.DataFrame(cell_rows(cells)).set_index("id"))
        numbers = numbers.rename(columns={"reproduced": "ours", "agreement": "verdict"})
    table = pd.concat([numbers.astype(object), sentences])
    table["committed"] = table["ours"]
    if data_are_simulated() or not OUTPUT_FOLDER:
        kept = read_made("verdicts").set_index("id")["reproduced"]
        claimed = read_made("claims").set_index("id")["measured"]
        table["committed"] = table.index.map(pd.concat([kept.astype(object), claimed]))
    shown = ["name", "printed", "ours", "low", "high", "committed", "verdict"]
    table = table.reindex(columns=shown).astype(object).fillna("")
    for column in ("ours", "low", "high", "committed"):
        table[column] = [
            x if isinstance(x, str) else like_printed(x, printed, 1)
            for x, printed in zip(table[column], table["printed"], strict=True)
        ]
    return table


def split_table(table: pd.DataFrame) -> list[pd.DataFrame]:
    """The rows of `judge` as a reader sees them: numbers, and then sentences."""
    of_numbers = table["printed"] != ""
    numbers = table[of_numbers].set_index("name").rename_axis("number")
    sentences = table[~of_numbers].set_index("name").rename_axis("the paper's sentence")
    sentences = sentences.rename(columns={"ours": "measured"})
    is_committed = (sentences["committed"] == sentences["measured"]).all()
    shown = ["measured", "verdict"] if is_committed else ["measured", "committed", "verdict"]
    return [each for each in (numbers, sentences[shown]) if len(each)]


def verdict(
    text: str,
    cells: Cells | None = None,
    claims: Measured | None = None,
    facts: Mapping[str, Any] | None = None,
    tables: Mapping[str, pd.DataFrame] | None = None,
    criteria: Criteria = None,
) -> None:
    """Show how this run's numbers compare, as `judge` does, and a sentence on them; export them for the report.

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

    if cells or claims:
        for table in split_table(judge(cells, claims, criteria)):
            display(table)
    display(Markdown(text))
    save_outcome(cells or {}, decide_all(claims or {}, criteria), facts or {}, tables or {})
