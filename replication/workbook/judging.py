"""Verdicts: the notebooks' outcomes compared with what the paper prints."""

import json
import math
from pathlib import Path

import pandas as pd

from replication import published
from replication.workbook import basis
from replication.workbook.files import ROOT

VERDICT_COLUMNS = [
    *("id", "source", "printed", "published", "reproduced", "difference", "tolerance", "low", "high"),
    *("verdict", "by_tolerance", "reason", "fails_if", "notebook"),
]
# What is decided by evidence comes first; the headlines count it alone.
EVIDENCE = ("reproduced", "erratum", "differs")
VERDICTS = (*EVIDENCE, "consistent", "given", "undecided", "stand-in", "not-run")
CLAIM_VERDICTS = {True: "holds", False: "does not hold", None: "undecided"}
# A region that holds so large a share of the same column's other printed numbers says nothing about its own.
WIDEST_SHARE = 0.5


def judge(found: pd.DataFrame) -> pd.DataFrame:
    """Compare reproduced cells with the printed ones.

    Parameters
    ----------
    found : DataFrame
        Columns `id, source, reproduced, notebook`; `low` and `high` where a predictive region says between which
        numbers the printed one should lie.

    Returns
    -------
    DataFrame
        Columns `VERDICT_COLUMNS`. `low` to `high` is the region that decides, `by_tolerance` what the cell's tolerance
        would decide, `fails_if` what would have made a cell fail that is decided by evidence.
    """
    return pd.DataFrame([_judge_cell(row) for row in found.to_dict("records")])


def _judge_cell(row: dict) -> dict:
    cell, worth = published.cells().loc[row["id"]], basis.of(row["id"], row["source"])
    value, tolerance, ours = float(cell["value"]), published.tolerance(row["id"]), row["reproduced"]
    by_tolerance = (ours - tolerance, math.inf if cell["kind"] == "bound" else ours + tolerance)
    predicted = not pd.isna(row.get("low", math.nan))
    region = (row["low"], row["high"]) if predicted else by_tolerance
    verdict, reason = _verdict(cell, worth, row, region)
    if verdict == "reproduced" and predicted:
        verdict, reason = _unless_too_wide(cell, region)
    return {
        "id": row["id"],
        "source": row["source"],
        "printed": cell["printed"],
        "published": value,
        "reproduced": ours,
        "difference": ours - value,
        "tolerance": tolerance,
        "low": region[0],
        "high": region[1],
        "verdict": verdict,
        "by_tolerance": _verdict(cell, worth, row, by_tolerance)[0] if predicted else verdict,
        "reason": reason,
        "fails_if": worth["fails_if"] if verdict in EVIDENCE else "",
        "notebook": row["notebook"],
    }


def _verdict(cell: pd.Series, worth: pd.Series, row: dict, region: tuple[float, float]) -> tuple[str, str]:
    """Verdict on a cell, and its reason."""
    if row["source"] == "stand-in":
        return "stand-in", "the original logs were never published; a simulated stand-in cannot reproduce them"
    if worth["basis"] == "undecided":
        return "undecided", worth["fails_if"]
    if region[0] <= float(cell["value"]) <= region[1]:
        word = {"evidence": "reproduced"}.get(worth["basis"], worth["basis"])
        return word, cell["tol_reason"] if worth["basis"] == "evidence" else worth["fails_if"]
    erratum = basis.correction(row["id"])
    if erratum is not None and abs(row["reproduced"] - erratum.value) <= erratum.tolerance:
        return "erratum", f"corrected: {erratum.corrected}"
    return "differs", _known_reasons().get((row["id"], row["source"]), "no explanation known")


def _unless_too_wide(cell: pd.Series, region: tuple[float, float]) -> tuple[str, str]:
    """`reproduced`, unless the region would hold most of the other printed numbers of its column as well."""
    others = published.column(cell["element"], cell["column"])
    others = others[others != cell["value"]]
    share = ((region[0] <= others) & (others <= region[1])).mean() if others.size else 0.0
    if share >= WIDEST_SHARE:
        return "undecided", f"the predictive region also holds {share:.0%} of the column's other printed numbers"
    return "reproduced", "inside the region that holds 95 % of the tables which this protocol would print"


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
    """Judge every printed cell from the notebooks' outcomes; cells that none has computed are `not-run`."""
    found = pd.DataFrame(
        [row | {"notebook": name} for name, outcome in outcomes(results).items() for row in outcome["cells"]],
        columns=["id", "source", "reproduced", "low", "high", "notebook"],
    )
    judged = judge(found)
    cells = published.cells()
    missing = cells[~cells.index.isin(found["id"])]
    rest = pd.DataFrame([_not_computed(cell) for _, cell in missing.reset_index().iterrows()])
    table = pd.concat([part for part in (judged, rest) if not part.empty], ignore_index=True)
    table = table.reindex(columns=VERDICT_COLUMNS)
    order = {cell: position for position, cell in enumerate(cells.index)}
    return table.sort_values(["id", "source"], key=lambda c: c.map(order) if c.name == "id" else c, ignore_index=True)


def _not_computed(cell: pd.Series) -> dict:
    """Verdict on a cell that no notebook computes: `given` where nothing could, else `not-run`."""
    source = "stand-in" if cell["element"] in ("Table 3", "Table 4") else "authors"
    try:
        worth = basis.of(cell["id"], source)
    except KeyError:
        worth = {"basis": "", "fails_if": ""}
    given = worth["basis"] == "given"
    return {
        "id": cell["id"],
        "source": source,
        "printed": cell["printed"],
        "published": cell["value"],
        "tolerance": published.tolerance(cell["id"]),
        "verdict": "given" if given else "not-run",
        "by_tolerance": "given" if given else "not-run",
        "reason": worth["fails_if"] if given else "no notebook computes it",
        "fails_if": "",
    }


def decided_claims(results: Path) -> pd.DataFrame:
    """What the notebooks' outcomes say of the prose claims: `id, verdict, measured, notebook`."""
    rows = [
        {"id": row["id"], "verdict": CLAIM_VERDICTS[row["holds"]], "measured": row["measured"], "notebook": name}
        for name, outcome in outcomes(results).items()
        for row in outcome["claims"]
    ]
    return pd.DataFrame(rows, columns=["id", "verdict", "measured", "notebook"])


def verdict_counts(table: pd.DataFrame) -> pd.DataFrame:
    """Count the verdicts of each element and source."""
    element = published.cells()["element"].reindex(table["id"]).to_numpy()
    counts = pd.crosstab([element, table["source"]], table["verdict"], rownames=["element", "source"])
    counts = counts.reindex(columns=[name for name in VERDICTS if name in counts])
    elements = list(dict.fromkeys(published.cells()["element"]))
    return counts.sort_index(key=lambda level: level.map(elements.index) if level.name == "element" else level)
