"""Verdicts: the notebooks' outcomes compared with what the paper prints."""

import json
from pathlib import Path

import pandas as pd

from replication import published
from replication.workbook.files import ROOT

VERDICT_COLUMNS = [
    *("id", "source", "printed", "published", "reproduced", "difference", "tolerance"),
    *("verdict", "reason", "notebook"),
]
VERDICTS = ("reproduced", "erratum", "stand-in", "differs", "not-run")


def judge(found: pd.DataFrame) -> pd.DataFrame:
    """Compare reproduced cells with the printed ones.

    Parameters
    ----------
    found : DataFrame
        Columns `id, source, reproduced, notebook`.

    Returns
    -------
    DataFrame
        Columns `id, source, printed, published, reproduced, difference, tolerance, verdict, reason, notebook`.
    """
    return pd.DataFrame([_judge_cell(**row) for row in found.to_dict("records")])


def _judge_cell(id: str, source: str, reproduced: float, notebook: str) -> dict:
    cell = published.cells().loc[id]
    value, tolerance = float(cell["value"]), published.tolerance(id)
    difference = reproduced - value
    close = difference <= tolerance if cell["kind"] == "bound" else abs(difference) <= tolerance
    erratum = _errata_by_cell().get(id)
    if source == "stand-in":
        verdict, reason = (
            "stand-in",
            "the original logs were never published; a simulated stand-in cannot reproduce them",
        )
    elif close:
        verdict, reason = "reproduced", cell["tol_reason"]
    elif erratum:
        verdict, reason = "erratum", erratum
    else:
        verdict, reason = "differs", _known_reasons().get((id, source), "no explanation known")
    return {
        "id": id,
        "source": source,
        "printed": cell["printed"],
        "published": value,
        "reproduced": reproduced,
        "difference": difference,
        "tolerance": tolerance,
        "verdict": verdict,
        "reason": reason,
        "notebook": notebook,
    }


def _errata_by_cell() -> dict[str, str]:
    """Correction of each cell that an erratum names."""
    errata = published.errata()
    return {cell: row["corrected"] for _, row in errata.iterrows() for cell in row["cells"].split()}


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
        columns=["id", "source", "reproduced", "notebook"],
    )
    judged = judge(found)
    cells = published.cells()
    missing = cells[~cells.index.isin(found["id"])]
    not_run = pd.DataFrame(
        {
            "id": missing.index,
            "source": [
                "stand-in" if element in ("Table 3", "Table 4") else "authors" for element in missing["element"]
            ],
            "printed": missing["printed"].to_numpy(),
            "published": missing["value"].to_numpy(),
            "tolerance": [published.tolerance(cell) for cell in missing.index],
            "verdict": "not-run",
            "reason": "taken from the paper or never published; no notebook measures it",
        }
    )
    table = pd.concat([part for part in (judged, not_run) if not part.empty], ignore_index=True)
    table = table.reindex(columns=VERDICT_COLUMNS)
    order = {cell: position for position, cell in enumerate(cells.index)}
    return table.sort_values(["id", "source"], key=lambda c: c.map(order) if c.name == "id" else c, ignore_index=True)


def decided_claims(results: Path) -> pd.DataFrame:
    """What the notebooks' outcomes say of the prose claims: `id, holds, measured, notebook`."""
    rows = [row | {"notebook": name} for name, outcome in outcomes(results).items() for row in outcome["claims"]]
    return pd.DataFrame(rows, columns=["id", "holds", "measured", "notebook"])


def verdict_counts(table: pd.DataFrame) -> pd.DataFrame:
    """Count the verdicts of each element and source."""
    element = published.cells()["element"].reindex(table["id"]).to_numpy()
    counts = pd.crosstab([element, table["source"]], table["verdict"], rownames=["element", "source"])
    counts = counts.reindex(columns=[name for name in VERDICTS if name in counts])
    elements = list(dict.fromkeys(published.cells()["element"]))
    return counts.sort_index(key=lambda level: level.map(elements.index) if level.name == "element" else level)


def verdict_text(table: pd.DataFrame) -> str:
    """Render the verdict table for a terminal: each cell, then the counts."""
    shown = table[["id", "source", "printed", "reproduced", "difference", "tolerance", "verdict"]]
    cells = shown.to_string(index=False, na_rep="-", float_format=lambda number: f"{number:.4g}")
    return f"{cells}\n\n{verdict_counts(table).to_string()}"
