"""The workbook: keeps what the notebooks export, and turns it into verdicts.

A notebook exports through `save_table`, `save_figure` and `save_outcome` into the folder that the environment
variable `REPLICATION_OUT` names; `execution.execute` sets it.
"""

import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from replication import published
from replication.figures import style

ROOT = Path(__file__).resolve().parents[2]
QUICK = ROOT / "results" / "quick"
FLOAT_FORMAT = "%.6g"

# What the results are made from; the outputs beside them are not.
SOURCES = (
    "replication/**/*.py",
    "replication/data/*",
    "replication/workbook/templates/*",
    "notebooks/*.py",
    "requirements.lock",
)

PACKAGES = ("cma", "joblib", "jupytext", "matplotlib", "nbclient", "numba", "numpy", "pandas", "scipy")

VERDICT_COLUMNS = [
    *("id", "source", "printed", "published", "reproduced", "difference", "tolerance"),
    *("verdict", "reason", "notebook"),
]
VERDICTS = ("reproduced", "erratum", "stand-in", "differs", "not-run")


# ---------------------------------------------------------------------------------------------------------------
# What a notebook calls


def output_folder() -> Path:
    """Folder that exports go to; a notebook run by hand writes to `results/lab`."""
    return Path(os.environ.get("REPLICATION_OUT", ROOT / "results" / "lab"))


def is_quick() -> bool:
    """Whether this is a quick run, whose figures say so."""
    return os.environ.get("REPLICATION_QUICK") == "1"


def save_table(table: pd.DataFrame, name: str) -> None:
    """Export a result table as `results/<name>.csv`."""
    write_csv(output_folder() / "results" / f"{name}.csv", table)


def save_figure(figure: Figure, name: str) -> None:
    """Export a figure as `figures/<name>.svg` and `.png`, without anything that differs from run to run."""
    style.save(figure, output_folder() / "figures", name, mark="quick run" if is_quick() else "")


def save_outcome(
    notebook: str,
    cells: Mapping[str, Mapping[str, float]] | None = None,
    claims: Mapping[str, tuple[bool, str]] | None = None,
    inputs: Mapping[str, str] | None = None,
    seeds: Iterable[int] = (),
) -> pd.DataFrame:
    """Export what a notebook found about printed cells and claims, and what it was made from.

    Parameters
    ----------
    notebook : str
        The notebook's name.
    cells : mapping of source to mapping of cell id to number
        Reproduced values in each cell's unit; a source is "authors", "simulated" or "stand-in".
    claims : mapping of claim id to (holds, what was measured)
        Decisions on prose claims.
    inputs : mapping of path to SHA-256
        Files of the authors' data that it read.
    seeds : iterable of int
        Seeds it used.

    Returns
    -------
    DataFrame
        The verdicts on these cells, to be shown.
    """
    rows = [
        {"id": cell, "source": source, "reproduced": float(FLOAT_FORMAT % number)}
        for source, numbers in (cells or {}).items()
        for cell, number in numbers.items()
    ]
    outcome = {
        "cells": rows,
        "claims": [{"id": key, "holds": bool(ok), "measured": text} for key, (ok, text) in (claims or {}).items()],
        "inputs": dict(sorted((inputs or {}).items())),
        "seeds": sorted(set(seeds)),
    }
    write_json(output_folder() / "results" / "outcomes" / f"{notebook}.json", outcome)
    return judge(pd.DataFrame(rows).assign(notebook=notebook)) if rows else pd.DataFrame()


# ---------------------------------------------------------------------------------------------------------------
# Verdicts


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


def _outcomes(results: Path) -> dict[str, dict]:
    files = sorted((results / "outcomes").glob("*.json"))
    return {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in files}


def verdicts(results: Path) -> pd.DataFrame:
    """Judge every printed cell from the notebooks' outcomes; cells that none has computed are `not-run`."""
    found = pd.DataFrame(
        [row | {"notebook": name} for name, outcome in _outcomes(results).items() for row in outcome["cells"]],
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
    rows = [row | {"notebook": name} for name, outcome in _outcomes(results).items() for row in outcome["claims"]]
    return pd.DataFrame(rows, columns=["id", "holds", "measured", "notebook"])


def collect(results: Path) -> pd.DataFrame:
    """Write `verdicts.csv`, `claims.csv` and `provenance.json` from the notebooks' outcomes.

    Returns
    -------
    DataFrame
        The verdicts.
    """
    table = verdicts(results)
    write_csv(results / "verdicts.csv", table)
    claims = published.claims().reset_index()[["id", "claim", "section"]]
    write_csv(results / "claims.csv", claims.merge(decided_claims(results), on="id", how="left"))
    path = results / "provenance.json"
    before = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    write_json(path, _provenance(_outcomes(results), before.get("sources", {})))
    return table


def _provenance(outcomes: dict[str, dict], sources_before: dict) -> dict:
    return {
        "sources": _sources(sources_before),
        "python": platform.python_version(),
        "packages": {name: version(name) for name in PACKAGES},
        "notebooks": {
            name: {"seeds": outcome["seeds"], "inputs": outcome["inputs"]} for name, outcome in outcomes.items()
        },
    }


def _sources(before: dict) -> dict:
    """Fingerprint of the sources, and the commit that they were first collected at.

    A page cannot name the commit that it is part of. So the commit is noted when the sources change, and kept while
    their fingerprint is the same: a second run, and a run after committing, give the same bytes.
    """
    files = sorted(path for pattern in SOURCES for path in ROOT.glob(pattern) if path.is_file())
    digests = (hashlib.sha256(path.read_bytes()).hexdigest() for path in files)
    lines = [f"{digest}  {path.relative_to(ROOT).as_posix()}\n" for digest, path in zip(digests, files, strict=True)]
    fingerprint = hashlib.sha256("".join(lines).encode()).hexdigest()
    if before.get("sha256") == fingerprint:
        return before
    commit, _, committed = _git("log", "-1", "--format=%H %cs").partition(" ")
    changed = bool(_git("status", "--porcelain", "--", *SOURCES)) if commit else False
    return {"sha256": fingerprint, "commit": commit, "committed": committed, "local_changes": changed}


def _git(*arguments: str) -> str:
    """What git says, or nothing where there is no git or no repository."""
    try:
        done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return done.stdout.strip()


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


# ---------------------------------------------------------------------------------------------------------------
# Files


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_bytes(content)
    os.replace(temporary, path)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all."""
    write_bytes(path, text.encode("utf-8"))


def write_csv(path: Path, table: pd.DataFrame) -> None:
    """Write a table whole or not at all, six significant digits."""
    write_text(path, table.to_csv(index=False, float_format=FLOAT_FORMAT, lineterminator="\n"))


def write_json(path: Path, content: dict) -> None:
    """Write a JSON file whole or not at all."""
    write_text(path, json.dumps(content, indent=1) + "\n")
