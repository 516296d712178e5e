"""Verdicts: does a printed number agree with ours, how well would we have noticed, and where does ours come from.

1. A notebook exports one number for a printed number, or realisations by setting: for a mean or an SD of
   Table 2, the first 40 realisations of each setting that `protocols.POOLED` names.
2. The interval of one number is ours ± the tolerance of `cells.csv`, whose reason stands there; of a
   printed upper bound, whatever is not below ours. The interval of realisations is the 95 % prediction
   interval of all of them together, by order statistics, and ours is their median.
3. `agrees`: the printed number lies in the interval. `differs`: it does not. `not tested`: the number is
   a stand-in's or was taken over, no notebook computed it, or too few realisations give an interval.
4. `resolution`: half of the interval's width over the printed number, for an SD the factor by which its
   ends lie from their middle. Above 10 % or a factor of 3 an agreement is weak.
5. `settings`: under how many of the settings alone the printed number agrees.

"The original lies in the replication's 95 % prediction interval" is the criterion of Patil, Peng and Leek
(2016). It was chosen after the numbers were known (`results/pages/history.html`).
"""

import math
from collections import defaultdict
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from replication import published
from replication.files import write_csv, write_json
from replication.table2 import predictive_region
from workbook.outcomes import Numbers, load_outcomes, source_of

Outcomes = Mapping[str, Mapping[str, Any]]  # by notebook
VERDICT_COLUMNS = ["id", "printed", "published", "reproduced", "low", "high", "agreement"]
VERDICT_COLUMNS += ["source", "resolution", "settings", "reason", "notebook"]
AGREEMENTS = ("agrees", "differs", "not tested")
SOURCES = {
    "recomputed": "our search on the authors' clean records with noise of the printed law, or on their noisy ones",
    "authors' files": "read or measured from them",
    "simulated joint": "the joint that we identified from the authors' records",
    "the paper's own numbers": "arithmetic between printed numbers",
    "stand-in": "simulated in place of unpublished logs; not tested",
    "taken over": "assumed as printed; not tested",
}
NOT_TESTED = ("stand-in", "taken over")
CLAIM_VERDICTS = {True: "holds", False: "does not hold", None: "undecided"}
WEAK_SHARE, WEAK_FACTOR = 0.1, 3.0


def interval(cell: str, numbers: Numbers) -> tuple[float, float]:
    """Rule 2: the numbers that agree with ours."""
    if isinstance(numbers, Mapping):
        return predictive_region([*chain(*numbers.values())])
    tolerance = published.tolerance(cell)
    is_bound = published.cells().loc[cell, "kind"] == "bound"
    return numbers - tolerance, math.inf if is_bound else numbers + tolerance


def agrees(cell: str, numbers: Numbers) -> bool:
    """Rule 3: whether a printed number lies in the interval."""
    low, high = interval(cell, numbers)
    return low <= published.value(cell) <= high


def resolution(cell: str, low: float, high: float) -> float:
    """Rule 4: what a deviation must exceed to be seen; nan for a count and for a printed zero."""
    if cell.endswith(".sd"):
        return math.sqrt(high / low) if low > 0 else math.inf
    value = abs(published.value(cell))
    is_count = published.cells().loc[cell, "kind"] == "count"
    return math.nan if is_count or not value else (high - low) / 2 / value


def is_weak(cell: str, seen_from: float) -> bool:
    """Rule 4: whether a resolution makes an agreement weak."""
    return seen_from > (WEAK_FACTOR if cell.endswith(".sd") else WEAK_SHARE)


def judge_rows(found: pd.DataFrame, facts: Mapping[str, str] | None = None) -> pd.DataFrame:
    """Compare `id, source, numbers, notebook` with the printed numbers: `VERDICT_COLUMNS`.

    `facts` are the numbers that reasons name in braces.
    """
    rows = found.to_dict("records")
    known = defaultdict(lambda: "?", facts or {})
    judged = [row | _judge(row["id"], row["source"], row["numbers"], known) for row in rows]
    return pd.DataFrame(judged, columns=VERDICT_COLUMNS)


def _judge(cell: str, source: str, numbers: Numbers, facts: Mapping[str, str]) -> dict[str, Any]:
    """Columns that tell how our number and a printed one compare."""
    row = published.cells().loc[cell]
    value, reason = float(row["value"]), row["reason"].format_map(facts)
    by_setting = numbers if isinstance(numbers, Mapping) else {"": [numbers]}
    pooled = [*chain(*by_setting.values())]
    ours, (low, high) = float(np.median(pooled)), interval(cell, numbers)
    settings = ""
    if isinstance(numbers, Mapping):
        alone = sum(agrees(cell, {name: each}) for name, each in by_setting.items())
        settings = f"{alone} of {len(by_setting)}"
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
        "resolution": resolution(cell, low, high),
        "settings": settings,
        "reason": reason,
    }


def exported_cells(outcomes: Outcomes) -> pd.DataFrame:
    """Our numbers, as `judge_rows` takes them."""
    rows = [row | {"notebook": name} for name, each in outcomes.items() for row in each["cells"]]
    return pd.DataFrame(rows, columns=["id", "source", "numbers", "notebook"], dtype=object)


def decide_claims(outcomes: Outcomes) -> pd.DataFrame:
    """Decisions on the claims: `id, verdict, measured, notebook`."""
    rows = [
        {**row, "verdict": CLAIM_VERDICTS[row["holds"]], "notebook": name}
        for name, each in outcomes.items()
        for row in each["claims"]
    ]
    return pd.DataFrame(rows, columns=["id", "verdict", "measured", "notebook"])


def verdicts(results: Path) -> pd.DataFrame:
    """Judge every printed number from the notebooks' outcomes, in the paper's order."""
    outcomes = load_outcomes(results)
    found = exported_cells(outcomes)
    if found["id"].duplicated().any():
        twice = found.loc[found["id"].duplicated(), "id"].unique()
        raise ValueError(f"{', '.join(twice)}: exported by two notebooks")
    found = found.set_index("id").reindex(published.cells().index)
    missing = found["source"].isna()
    found.loc[missing, "source"] = [source_of(cell) for cell in found.index[missing]]
    found.loc[missing, "notebook"] = ""
    facts: dict[str, str] = {}
    for outcome in outcomes.values():
        facts |= outcome["facts"]
    return judge_rows(found.reset_index(), facts)


def decided_claims(results: Path) -> pd.DataFrame:
    """What the notebooks' outcomes say of the claims."""
    return decide_claims(load_outcomes(results))


def collect(results: Path) -> pd.DataFrame:
    """Write `verdicts.csv`, `claims.csv` and `provenance.json` from the outcomes; return the verdicts."""
    judged = verdicts(results)
    write_csv(results / "verdicts.csv", judged)
    claims = published.table("claims").reset_index()[["id", "claim", "section"]]
    write_csv(results / "claims.csv", claims.merge(decided_claims(results), on="id", how="left"))
    made_from = {name: outcome["made_from"] for name, outcome in load_outcomes(results).items()}
    write_json(results / "provenance.json", made_from)
    return judged


def count_by(table: pd.DataFrame, by: str) -> pd.DataFrame:
    """Count printed numbers by their agreement, and by "element" or "source"."""
    elements = published.cells()["element"]
    key = table["source"] if by == "source" else elements.loc[table["id"]].to_numpy()
    counts = pd.crosstab(key, table["agreement"]).rename_axis(index=by, columns="agreement")
    order = SOURCES if by == "source" else elements.unique()
    named = [name for name in order if name in counts.index]
    return counts.reindex(index=named, columns=AGREEMENTS, fill_value=0)
