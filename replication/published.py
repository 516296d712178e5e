"""Every number the paper prints, once, from the data files; and the rules that decide its claims."""

import json
import math
from collections.abc import Mapping
from decimal import Decimal
from functools import cache, partial
from importlib.resources import files
from importlib.resources.abc import Traversable

import numpy as np
import pandas as pd

DATA: Traversable = files("replication") / "data"

Criteria = Mapping[str, float] | None  # limits to try in place of those of `claims.csv`, by claim
Decision = tuple[bool | None, str]  # whether a claim holds (None: undecided), and what was measured


@cache
def _kept(name: str, index: str | None = None) -> pd.DataFrame:
    with (DATA / name).open(encoding="utf-8") as file:
        return pd.read_csv(file, keep_default_na=False, index_col=index)


def _read(name: str, index: str | None = None) -> pd.DataFrame:
    return _kept(name, index).copy()


# The paper's prose claims and what decides each: `claim, section, decided_in` (the notebook's
# number), `check, rule, criterion, reason, alternative`, the days on which rule and limit were
# `fixed` and the `first_result` was committed; the `earlier_answer`, if another rule or limit gave one.
claims = partial(_read, "claims.csv", "id")
# `kind, location, as_printed, corrected, evidence, effect, cells, computed` (numbers by name in
# braces), `figure`.
errata = partial(_read, "errata.csv", "id")
# Where each figure, table and numbered equation is: `element, what, notebooks, functions, test,
# note`.
paper_map = partial(_read, "map.csv")
# The rules: when each was `fixed`, its `first_result`, the commits of both, what was
# `known_before`, its `counts`.
trail = partial(_read, "trail.csv")
# What the report says: `kind` (of the answer, "finding" or "open"), `text` with names of numbers in
# braces, `proof`.
findings = partial(_read, "findings.csv")
# What the paper's figures show, in our words, and what can be compared: `shows, compare`.
paper_figures = partial(_read, "paper_figures.csv", "figure")
# What agreements are worth: `cells` (a pattern), `source, basis, fails_if, test`, and the `rival`, the column of the
# same row whose number would be another answer. Of what is "traced", `fails_if` says what agrees.
basis = partial(_read, "basis.csv")
# The words of verdicts on numbers and claims: `sign`, and what those on numbers mean.
verdict_words = partial(_read, "verdict_words.csv", "verdict")
# Protocols that may have printed Table 2, the leading one first: settings, number of `realisations`, `why`.
table2_candidates = partial(_read, "table2_candidates.csv", "protocol")
# Cells known not to reproduce: `id, source, reason`.
known_differences = partial(_read, "differences.csv")
# The 30 runs that the authors' notebook stores, on their clean record 12, and what it prints of
# runs 1 to 20: one row per printed generation, some 17 of each run.
authors_notebook_runs = partial(_read, "authors_notebook_runs.csv")
authors_notebook_generations = partial(_read, "authors_notebook_generations.csv")

_cells = partial(_kept, "cells.csv", "id")


def table_layouts() -> list[dict]:
    """Captions, headings and columns of Tables 1 to 4 as the paper has them."""
    return json.loads((DATA / "tables.json").read_text(encoding="utf-8"))


def cells(element: str | None = None) -> pd.DataFrame:
    """Load the printed numbers, indexed by cell id, of one element, such as "Table 2", or of all.

    Columns `element, row, column, printed, value, unit, kind, abs_tol, rel_tol, tol_reason,
    section, quote`; the last one, words of the paper, for the numbers of its text.
    """
    table = _cells()
    if element is None:
        return table.copy()
    chosen = table[table["element"] == element]
    if chosen.empty:
        raise KeyError(
            f"{element}: no such element; there are {', '.join(table['element'].unique())}"
        )
    return chosen.copy()


def value(cell: str) -> float:
    """Printed value of a cell, in the cell's unit; a KeyError if there is no such cell."""
    return float(_cells().loc[cell, "value"])


def tolerance(cell: str) -> float:
    """Largest difference from the printed value that still reproduces a cell, in its unit."""
    row = _cells().loc[cell]
    return float(row["abs_tol"] + row["rel_tol"] * abs(row["value"]))


def half_last_digit(printed: str) -> float:
    """Half a unit of a printed number's last digit, which is what rounding leaves open."""
    return 0.5 * 10.0 ** int(Decimal(printed.rstrip("%")).as_tuple().exponent)


def column(element: str, name: str) -> np.ndarray:
    """Printed values of one column of a table, in the order of its rows."""
    table = cells(element)
    return table.loc[table["column"] == name, "value"].to_numpy(float)


def criterion(claim: str, criteria: Criteria = None) -> float:
    """The limit that decides a claim: that of `claims.csv`, or the one that `criteria` tries in its place."""
    known = claims()["criterion"]
    if unknown := {claim, *(criteria or {})} - set(known.index):
        raise KeyError(
            f"{', '.join(sorted(unknown))}: no such claim; there are {', '.join(known.index)}"
        )
    return float((criteria or {}).get(claim, known[claim]))


def decide(
    claim: str, measured: float | tuple[float, float], criteria: Criteria = None
) -> bool | None:
    """Decide a claim by its rule in `claims.csv`; None is undecided, as is whatever was not measured (nan).

    `measured` is what the rule compares with the limit: one number; the two ends of an interval
    where the rule's name begins with "interval"; p of the claim and p of its opposite for "p
    below". A number within 1e-9 of the limit, relatively, is the limit: the last bits do not
    decide. `criteria` are limits to try, as in `criterion`.
    """
    limit, rule = criterion(claim, criteria), claims().loc[claim, "rule"]
    if np.size(measured) != (2 if rule.startswith(("interval", "p ")) else 1):
        raise ValueError(f"{claim}: the rule {rule!r} does not take {measured}")
    numbers = np.ravel(measured).astype(float)
    low, high = (
        limit if math.isclose(x, limit, rel_tol=1e-9) else x for x in (numbers[0], numbers[-1])
    )
    digit = half_last_digit(str(limit)) * (1 + 1e-9)
    holds, fails = {
        "below": (low < limit, low >= limit),
        "at most": (low <= limit, low > limit),
        "above": (low > limit, low <= limit),
        "at least": (low >= limit, low < limit),
        "rounds to": (abs(low - limit) <= digit, abs(low - limit) > digit),
        "p below": (low < limit, high < limit),
        "interval below": (high < limit, low > limit),
        "interval above": (low > limit, high < limit),
    }[rule]
    return True if holds else False if fails else None
