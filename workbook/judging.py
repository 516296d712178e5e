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
import re
from collections.abc import Iterable, Mapping
from decimal import Decimal
from itertools import chain
from pathlib import Path
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


# ----------------------------------------------------------------------------------------------------------- numbers


def _pooled(numbers: Numbers) -> list[float]:
    """Realisations of all settings together; of one number, that."""
    return [*chain(*numbers.values())] if isinstance(numbers, Mapping) else [numbers]


def resolution(row: Any) -> str:
    """Rule 4, in words: "-4.3 % to +2.4 %"; of an SD factors: "1/4.3 to 21 times"; of a number about zero, its ends."""
    low, ours, high = row.low, row.reproduced, row.high
    if row.agreement == "not tested":
        return ""
    if math.isinf(high):
        return "anything above"
    if row.Index.endswith(".sd"):
        return f"1/{ours / low:.2g} to {high / ours:.2g} times"
    if low <= 0 <= high:
        return f"{low - ours:+.2g} to {high - ours:+.2g}"
    ends = sorted((100 * (low / ours - 1), 100 * (high / ours - 1)))
    return f"{ends[0]:+.2g} % to {ends[1]:+.2g} %"


def count_realisations(printed: float, numbers: Numbers) -> str:
    """Say under how many settings alone a printed number agrees, and how many realisations lie below it."""
    if not isinstance(numbers, Mapping):
        return ""
    pooled, alone = _pooled(numbers), [find_hook("interval")(each) for each in numbers.values()]
    words = f"; {sum(x < printed for x in pooled)} of {len(pooled)} realisations lie below the printed number"
    if np.isfinite(alone).all():
        agreeing = sum(low <= printed <= high for low, high in alone)
        words = f"; agrees under {agreeing} of {len(alone)} settings alone{words}"
    return words


def judge_numbers(rows: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """Compare ours with printed numbers: rows `id, source, numbers, notebook` become those of `verdicts.csv`, by id."""
    columns = ["id", "source", "numbers", "notebook"]
    ours = pd.DataFrame([{"notebook": ""} | dict(row) for row in rows], columns=columns)
    ours = ours.set_index("id")
    table = ours.join(read_table("cells").rename(columns={"source": "expected"}))
    value, pooled = table["value"].astype(float), table["numbers"].map(_pooled)
    table["published"], table["reproduced"] = value, pooled.map(np.median).astype(float)
    tolerance = table["abs_tol"] + table["rel_tol"] * value.abs()
    many = pooled[table["numbers"].map(lambda each: isinstance(each, Mapping))]
    ends = pd.DataFrame(
        [find_hook("interval")(each) for each in many], many.index, ["low", "high"], dtype=float
    )
    high = (table["reproduced"] + tolerance).mask(table["kind"] == "bound", np.inf)
    table["low"] = ends["low"].reindex(table.index).fillna(table["reproduced"] - tolerance)
    table["high"] = ends["high"].reindex(table.index).fillna(high)

    def holds(factor: float) -> pd.Series:
        return (factor * value).between(table["low"], table["high"])

    is_absent = ~np.isfinite(table["reproduced"])
    is_open = is_absent | ~np.isfinite(table["low"])
    is_tested = ~is_open & ~table["expected"].isin(NOT_TESTED)  # whatever an outcome says
    table["agreement"] = np.where(is_tested, np.where(holds(1), "agrees", "differs"), "not tested")
    table["weak"] = np.where(
        (table["agreement"] == "agrees") & (holds(2 / 3) | holds(4 / 3)), "yes", ""
    )
    why = table["known_difference"].replace("", "no explanation known") + "; "
    said = [*map(count_realisations, value, table["numbers"])]
    reason = why.where(table["agreement"] == "differs", "") + table["reason"] + said
    of_tested = ~table["expected"].isin(NOT_TESTED)
    reason = reason.mask(is_open & of_tested, "too few realisations for an interval")
    table["reason"] = reason.mask(is_absent & of_tested, "no notebook computed it")
    table["resolution"] = [resolution(row) for row in table.itertuples()]
    columns = ["printed", "published", "reproduced", "low", "high", "agreement", "weak", "source"]
    return table[[*columns, "resolution", "reason", "notebook"]]


def verdicts(results: Path) -> pd.DataFrame:
    """Judge every printed number in the paper's order, by the notebooks' outcomes; a row each, by id.

    Raises
    ------
    UserError
        No notebook exports a number that is not taken over, or two do.
    """
    outcomes = load_outcomes(results)
    made = [row | {"notebook": name} for name, each in outcomes.items() for row in each["cells"]]
    refuse_twice(made)
    expected = read_table("cells")["source"]
    left = expected.drop([row["id"] for row in made])
    for row in made:
        if expected[row["id"]] != "taken over" and not np.isfinite(_pooled(row["numbers"])).all():
            raise _lacking(row["id"])
    for cell in left.index[left != "taken over"]:
        raise _lacking(cell)
    made += [{"id": cell, "source": source, "numbers": math.nan} for cell, source in left.items()]
    return judge_numbers(made).reindex(expected.index)


def _lacking(cell: str) -> UserError:
    return UserError(f"{cell}: no notebook has computed it; make all runs them")


def refuse_twice(rows: list[dict[str, Any]]) -> None:
    """Refuse what two notebooks export: one of their outcomes is another's."""
    by_id: dict[str, str] = {}
    for row in rows:
        if other := by_id.get(row["id"]):
            both = f"{row['id']}: exported by two notebooks, {other} and {row['notebook']}"
            raise UserError(f"{both}: one of their outcomes is another's; make all runs them")
        by_id[row["id"]] = row["notebook"]


def grade(verdicts: pd.DataFrame) -> pd.Series:
    """Say how much each verdict says: an agreement is weak, or the paper's consistency alone."""
    grades = verdicts["agreement"].mask(verdicts["source"] == CONSISTENT, "consistent")
    grades = grades.mask(verdicts["weak"] == "yes", "agrees weakly")
    return grades.where(verdicts["agreement"] == "agrees", verdicts["agreement"])


# ------------------------------------------------------------------------------------------------------------ claims


def decide(claim: str, measured: Any, criteria: Criteria = None) -> bool | None:
    """Decide a claim by its rule in the table of claims; None is undecided, as is whatever was not measured (nan).

    `measured` is what the rule compares with the limit: one number; the two ends of an interval
    where the rule's name begins with "interval"; p of the claim and p of its opposite for "p
    below". A number within 1e-9 of the limit, relatively, is the limit: the last bits do not
    decide. `criteria` are limits to try in place of the table's.
    """
    claims = read_table("claims")
    if unknown := {claim, *(criteria or {})} - {*claims.index}:
        known = ", ".join(claims.index)
        raise KeyError(f"{', '.join(sorted(unknown))}: no such claim; there are {known}")
    rule = claims.at[claim, "rule"]
    limit = float((criteria or {}).get(claim, claims.at[claim, "criterion"]))
    if np.size(measured) != (2 if rule.startswith(("interval", "p ")) else 1):
        raise ValueError(f"{claim}: the rule {rule!r} does not take {measured}")
    low, high = (
        limit if math.isclose(x, limit, rel_tol=1e-9) else x
        for x in np.ravel(measured)[[0, -1]].astype(float)
    )
    half_digit = 0.5 * 10.0 ** int(Decimal(str(limit)).as_tuple().exponent) * (1 + 1e-9)
    holds, fails = {
        "below": (low < limit, low >= limit),
        "at most": (low <= limit, low > limit),
        "above": (low > limit, low <= limit),
        "at least": (low >= limit, low < limit),
        "rounds to": (abs(low - limit) <= half_digit, abs(low - limit) > half_digit),
        "rounds to, or a bound": (abs(low - limit) <= half_digit, low > limit + half_digit),
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


def claims(results: Path) -> pd.DataFrame:
    """The paper's sentences with their verdicts: `id, of, quote, reading, section, verdict, measured, notebook`.

    Of a claim that no notebook can decide, the table says why: it is undecided. UserError where no notebook decides
    another one, or two do.
    """
    claimed = read_table("claims")
    outcomes = load_outcomes(results)
    made = [row | {"notebook": name} for name, each in outcomes.items() for row in each["claims"]]
    refuse_twice(made)
    ours = pd.DataFrame(made, columns=["id", "holds", "measured", "notebook"]).set_index("id")
    ours["verdict"] = ours["holds"].map(lambda holds: CLAIM_VERDICTS[holds])
    table = claimed[["of", "quote", "reading", "section"]]
    table = table.join(ours[["verdict", "measured", "notebook"]])
    table["measured"] = table["measured"].fillna(claimed["untested"])
    for claim in table.index[table["measured"] == ""]:
        raise UserError(f"{claim}: no notebook has decided it; make all runs them")
    return table.fillna({"verdict": CLAIM_VERDICTS[None], "notebook": ""}).reset_index()


# ------------------------------------------------------------------------------------------------ beside a notebook


def judge(
    cells: Cells | None = None, claims: Measured | None = None, criteria: Criteria = None
) -> pd.DataFrame:
    """Compare our numbers, and what we measured of claims, with the paper, as `workbook.verdict` takes them.

    Returns
    -------
    DataFrame
        A row a number or claim: id; the printed number; ours, of realisations their median; the
        interval that a printed number must lie in to agree; the committed number, which is ours
        where this run makes what is committed; and the verdict.
    """
    names = {"reproduced": "ours", "agreement": "verdict"}
    numbers = judge_numbers(cell_rows(cells)).rename(columns=names) if cells else pd.DataFrame()
    decided = {
        claim: {"ours": words, "verdict": CLAIM_VERDICTS[holds]}
        for claim, (holds, words) in decide_all(claims or {}, criteria).items()
    }
    shown = ["printed", "ours", "low", "high", "committed", "verdict"]
    sentences = pd.DataFrame.from_dict(decided, orient="index", columns=["ours", "verdict"])
    table = pd.concat([numbers.astype(object), sentences]).reindex(columns=shown)
    table["committed"] = table["ours"]
    if data_are_simulated() or not OUTPUT_FOLDER:
        kept = read_made("verdicts").set_index("id")["reproduced"]
        claimed = read_made("claims").set_index("id")["measured"]
        table["committed"] = table.index.map(pd.concat([kept.astype(object), claimed]))
    table = table.rename_axis("id").astype(object).fillna("")
    return table.map(lambda x: f"{x:.5g}" if isinstance(x, float) else str(x))


def split_table(table: pd.DataFrame) -> list[pd.DataFrame]:
    """The rows of `judge` as a reader sees them: numbers, with one digit more than printed, and then sentences."""
    of_numbers = table["printed"] != ""
    numbers, sentences = table[of_numbers], table[~of_numbers]
    numbers = numbers.apply(_round_row, axis=1).rename(index=_name_cell)
    sentences = sentences[["ours", "committed", "verdict"]]
    if (sentences["committed"] == sentences["ours"]).all():
        sentences = sentences.drop(columns="committed")
    sentences = sentences.rename(
        index=lambda claim: claim.replace("_", " "), columns={"ours": "measured"}
    )
    named = numbers.rename_axis("number"), sentences.rename_axis("the paper's sentence")
    return [each for each in named if len(each)]


def _name_cell(cell: str) -> str:
    """Name of a printed number: "Table 2, row 1, mean" of `table2.row01.mean`."""
    words = re.sub(r"([a-z])0*(\d)", r"\1 \2", cell).replace(".", ", ").replace("_", " ")
    return words[0].upper() + words[1:]


def _round_row(row: pd.Series) -> pd.Series:
    decimals = re.fullmatch(r"-?\d+(?:\.(\d+))?", row["printed"])
    if decimals is None:  # with a power of ten
        return row
    form = f".{len(decimals[1] or '') + 1}f"
    row = row.copy()
    for column in ("ours", "low", "high", "committed"):
        row[column] = row[column] and f"{float(row[column]):{form}}"
    return row


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
