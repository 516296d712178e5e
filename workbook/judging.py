"""Verdicts: does a printed number lie in our interval, how far might it have moved, where does ours come from.

1. A notebook exports one number for a printed number; for a mean or an SD of Table 2, realisations by setting.
2. The interval of one number is ours plus and minus the tolerance of `cells.csv`; of a printed upper bound, whatever
   is not below ours. The interval of realisations is the 95 % prediction interval of all of them together, by order
   statistics, and ours is their median.
3. `agrees`: the printed number lies in the interval. `differs`: it does not. `not tested`: ours is a stand-in's or
   was taken over, no notebook computed it, or too few realisations give an interval.
4. `resolution`: how far below and above ours the printed number might have been, and agreed.
"""

import math
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from replication import published
from replication.records import records_are_simulated, write_csv
from workbook.outcomes import (
    OUTPUT_FOLDER,
    RESULTS,
    Cells,
    Claims,
    Numbers,
    Sentence,
    cell_rows,
    claim_rows,
    load_outcomes,
    source_of,
)

VERDICT_COLUMNS = ["id", "printed", "published", "reproduced", "low", "high", "agreement"]
VERDICT_COLUMNS += ["source", "resolution", "reason", "notebook"]
AGREEMENTS = ("agrees", "differs", "not tested")
SOURCES = {
    "recomputed": "our search, on the authors' clean records with uniform noise of Table 2's amplitudes",
    "authors' files": "read or measured from them",
    "simulated joint": "the joint that we identified from the authors' records",
    "the paper's own numbers": "arithmetic between printed numbers, which shows consistency alone",
    "stand-in": "simulated in place of unpublished logs; not tested",
    "taken over": "assumed as printed; not tested",
}
NOT_TESTED = ("stand-in", "taken over")
CLAIM_VERDICTS = {True: "holds", False: "does not hold", None: "undecided"}


def interval(cell: str, numbers: Numbers) -> tuple[float, float]:
    """Rule 2: the numbers that agree with ours."""
    if isinstance(numbers, Mapping):
        from replication.table2 import prediction_interval  # with the search, slow to import

        return prediction_interval([*chain(*numbers.values())])
    tolerance = published.tolerance(cell)
    is_bound = published.cells().loc[cell, "kind"] == "bound"
    return numbers - tolerance, math.inf if is_bound else numbers + tolerance


def resolution(cell: str, ours: float, low: float, high: float) -> str:
    """Rule 4, in words: "-4.3 % to +2.4 %"; of an SD factors: "1/4.3 to 21 times"; of a number about zero, its ends."""
    if not math.isfinite(low) or not math.isfinite(ours):
        return ""
    if math.isinf(high):
        return "anything above"
    if cell.endswith(".sd"):
        return f"1/{ours / low:.2g} to {high / ours:.2g} times"
    if low <= 0 <= high:
        return f"{low - ours:+.2g} to {high - ours:+.2g}"
    ends = sorted((100 * (low / ours - 1), 100 * (high / ours - 1)))
    return f"{ends[0]:+.2g} % to {ends[1]:+.2g} %"


def judge_rows(ours: pd.DataFrame) -> pd.DataFrame:
    """Compare rows of `id, source, numbers, notebook` with the printed numbers: `VERDICT_COLUMNS`."""
    rows = ours.to_dict("records")
    judged = [row | _judge(row["id"], row["source"], row["numbers"]) for row in rows]
    return pd.DataFrame(judged, columns=VERDICT_COLUMNS)


def _judge(cell: str, source: str, numbers: Numbers) -> dict[str, Any]:
    row = published.cells().loc[cell]
    source = row["source"] if row["source"] in NOT_TESTED else source
    value, reason = float(row["value"]), row["reason"]
    pooled = [*chain(*numbers.values())] if isinstance(numbers, Mapping) else [numbers]
    ours, (low, high) = float(np.median(pooled)), interval(cell, numbers)
    if isinstance(numbers, Mapping):
        alone = [interval(cell, {name: each}) for name, each in numbers.items()]
        if np.isfinite(alone).all():
            agreeing = sum(start <= value <= end for start, end in alone)
            reason += f"; agrees under {agreeing} of {len(alone)} settings alone"
        below = sum(number < value for number in pooled)
        reason += f"; {below} of {len(pooled)} realisations lie below the printed number"
    agreement = "not tested"
    if source in NOT_TESTED:
        pass
    elif not math.isfinite(ours):
        reason = "no notebook computed it"
    elif not math.isfinite(low):
        reason = "too few realisations for an interval"
    elif low <= value <= high:
        agreement = "agrees"
    else:
        agreement = "differs"
        reason = f"{row['known_difference'] or 'no explanation known'}; {reason}"
    return {
        "printed": row["printed"],
        "published": value,
        "reproduced": ours,
        "low": low,
        "high": high,
        "agreement": agreement,
        "source": source,
        "resolution": "" if agreement == "not tested" else resolution(cell, ours, low, high),
        "reason": reason,
    }


def exported(results: Path, what: str, columns: list[str]) -> pd.DataFrame:
    """Rows of "cells" or "claims" that the notebooks exported, with the notebook's name."""
    outcomes = load_outcomes(results)
    rows = [row | {"notebook": name} for name, each in outcomes.items() for row in each[what]]
    return pd.DataFrame(rows, columns=[*columns, "notebook"], dtype=object)


def verdicts(results: Path) -> pd.DataFrame:
    """Judge every printed number in the paper's order, by the notebooks' outcomes and the paper's own numbers.

    Raises
    ------
    ValueError
        Two notebooks export the same number.
    """
    cells = published.cells().index
    ours = pd.DataFrame({"numbers": np.nan, "notebook": ""}, cells, dtype=object)
    ours["source"] = [source_of(cell) for cell in cells]
    made = exported(results, "cells", ["id", "source", "numbers"]).set_index("id")
    if not made.index.is_unique:
        twice = made.index[made.index.duplicated()]
        raise ValueError(f"{', '.join(twice)}: exported by two notebooks")
    ours.update(made)
    ours.update(pd.Series(published.derived_numbers(), name="numbers", dtype=object))
    return judge_rows(ours.reset_index())


def decide(claims: pd.DataFrame) -> pd.DataFrame:
    """Decisions on claims, of rows with `holds`, as verdicts in words."""
    verdict = [CLAIM_VERDICTS[holds] for holds in claims.get("holds", [])]
    decided = claims.drop(columns="holds", errors="ignore")
    return decided.assign(verdict=np.array(verdict, dtype=object))


def decided_claims(results: Path) -> pd.DataFrame:
    """The paper's claims in words with their verdicts: `id, claim, section, verdict, measured, notebook`.

    Of a claim that no notebook can decide, `claims.csv` says why: it is undecided.
    """
    claims = published.table("claims").reset_index()[["id", "claim", "section", "untested"]]
    decisions = decide(exported(results, "claims", ["id", "holds", "measured"]))
    table = claims.merge(decisions, on="id", how="left")
    untested = table.pop("untested").replace("", "no notebook decided it")
    table["measured"] = table["measured"].fillna(untested)
    table = table.fillna({"verdict": CLAIM_VERDICTS[None], "notebook": ""})
    return table[["id", "claim", "section", "verdict", "measured", "notebook"]]


def collect(results: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Write `verdicts.csv` and `claims.csv` from the outcomes; return both."""
    judged, claims = verdicts(results), decided_claims(results)
    write_csv(results / "verdicts.csv", judged)
    write_csv(results / "claims.csv", claims)
    return judged, claims


def judge(cells: Cells | None = None, claims: Claims | None = None) -> pd.DataFrame:
    """Compare our numbers and decisions, as `workbook.export` takes them, with the printed ones.

    Returns
    -------
    DataFrame
        A row a number or claim: id; the printed number; ours, of realisations their median; the
        interval that a printed number must lie in to agree; the committed number, which is ours
        where this run makes what is committed; and the verdict.
    """
    numbers = judge_rows(pd.DataFrame(cell_rows(cells or {})).assign(notebook=""))
    decisions = decide(pd.DataFrame(claim_rows(claims or {})))
    table = pd.concat(
        [
            numbers.rename(columns={"reproduced": "ours", "agreement": "verdict"}).astype(object),
            decisions.rename(columns={"measured": "ours"}).astype(object),
        ]
    )
    table["committed"] = table["ours"]
    if records_are_simulated() or not OUTPUT_FOLDER:
        kept = pd.read_csv(RESULTS / "verdicts.csv", index_col="id")["reproduced"]
        claimed = pd.read_csv(RESULTS / "claims.csv", index_col="id")["measured"]
        table["committed"] = table["id"].map(pd.concat([kept.astype(object), claimed]))
    shown = ["printed", "ours", "low", "high", "committed", "verdict"]
    table = table.set_index("id")[shown].fillna("")
    return table.map(lambda value: f"{value:.5g}" if isinstance(value, float) else str(value))


def verdict(text: str, cells: Cells | None = None, claims: Claims | None = None) -> None:
    """Show how this run's numbers compare, as `judge` does, and a sentence on them.

    Parameters
    ----------
    text : str
        A sentence in Markdown, made of this run's numbers alone.
    cells, claims : mappings
        As `workbook.export` takes them.
    """
    from IPython.display import display

    if cells or claims:
        display(judge(cells, claims))
    display(Sentence(text))
