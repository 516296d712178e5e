"""The workbook: executes the notebooks, keeps what they export, and turns it into verdicts.

A notebook exports through `save_table`, `save_figure` and `save_outcome` into the folder that the environment
variable `REPLICATION_OUT` names. `execute` points that at a staging folder and moves everything into place only
after the last cell has run, so that a failing notebook leaves the last good results alone.
"""

import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path

import jupytext
import nbformat
import pandas as pd
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from matplotlib.figure import Figure
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError

from replication import figure_style, published

ROOT = Path(__file__).resolve().parent.parent
QUICK = ROOT / "results" / "quick"
FLOAT_FORMAT = "%.6g"

# The same machine code on every x86-64 processor with AVX2, as far as libraries let themselves be pinned: CMA-ES
# is chaotic in the last bit.
PINNED_ENVIRONMENT = {
    "OPENBLAS_CORETYPE": "Haswell",
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "+sse,+sse2,+sse3,+ssse3,+sse4.1,+sse4.2,+popcnt,+avx,+avx2,+fma,+bmi,+bmi2,+lzcnt",
    "PYTHONHASHSEED": "0",
    "PYTHONWARNINGS": "ignore:IProgress not found",
    "MPLBACKEND": "module://matplotlib_inline.backend_inline",
}

PACKAGES = ("cma", "joblib", "jupytext", "matplotlib", "nbclient", "numba", "numpy", "pandas", "scipy")

VERDICTS = ("reproduced", "erratum", "stand-in", "differs", "not-run")


class NotebookFailed(RuntimeError):
    """A notebook did not run to its end."""


class NotebookNotRun(RuntimeError):
    """A notebook needs data that are not to be had."""


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
    figure_style.save(figure, output_folder() / "figures", name, mark="quick run" if is_quick() else "")


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
    _write_json(output_folder() / "results" / "outcomes" / f"{notebook}.json", outcome)
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
        verdict, reason = "stand-in", "the original data are not public; a simulated stand-in cannot reproduce them"
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
    order = {cell: position for position, cell in enumerate(cells.index)}
    return table.sort_values(["id", "source"], key=lambda c: c.map(order) if c.name == "id" else c, ignore_index=True)


def collect(results: Path) -> pd.DataFrame:
    """Write `verdicts.csv`, `claims.csv` and `provenance.json` from the notebooks' outcomes.

    Returns
    -------
    DataFrame
        The verdicts.
    """
    table = verdicts(results)
    write_csv(results / "verdicts.csv", table)
    outcomes = _outcomes(results)
    decided = [row | {"notebook": name} for name, outcome in outcomes.items() for row in outcome["claims"]]
    decided = pd.DataFrame(decided, columns=["id", "holds", "measured", "notebook"])
    claims = published.claims().reset_index()[["id", "claim", "section"]]
    write_csv(results / "claims.csv", claims.merge(decided, on="id", how="left"))
    _write_json(results / "provenance.json", _provenance(outcomes))
    return table


def _provenance(outcomes: dict[str, dict]) -> dict:
    return {
        "python": platform.python_version(),
        "packages": {name: version(name) for name in PACKAGES},
        "notebooks": {
            name: {"seeds": outcome["seeds"], "inputs": outcome["inputs"]} for name, outcome in outcomes.items()
        },
    }


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
# Execution


class _Client(NotebookClient):
    """A client that shows a cell's standard error on the terminal and keeps it out of the notebook."""

    def output(self, outs, msg, display_id, cell_index):
        if msg["msg_type"] == "stream" and msg["content"]["name"] == "stderr":
            sys.stderr.write(msg["content"]["text"])
            sys.stderr.flush()
            return None
        return super().output(outs, msg, display_id, cell_index)


def read_notebook(source: Path) -> nbformat.NotebookNode:
    """Read a notebook's py:percent source, with cell ids that do not change from run to run."""
    notebook = jupytext.read(source)
    for position, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{position:02d}"
    return notebook


def with_parameters(notebook: nbformat.NotebookNode, values: Mapping[str, object]) -> nbformat.NotebookNode:
    """Override values of a notebook's tagged parameters cell, by a cell inserted after it.

    Raises
    ------
    ValueError
        The notebook has no cell tagged `parameters`, or the cell does not set one of the names.
    """
    position = next((i for i, cell in enumerate(notebook.cells) if "parameters" in cell.metadata.get("tags", [])), None)
    if position is None:
        raise ValueError("the notebook has no cell tagged 'parameters'")
    settable = {line.split("=")[0].strip() for line in notebook.cells[position].source.splitlines() if "=" in line}
    unknown = set(values) - settable
    if unknown:
        raise ValueError(f"no such parameter: {', '.join(sorted(unknown))}; there are {', '.join(sorted(settable))}")
    source = "\n".join(f"{name} = {value!r}" for name, value in values.items())
    cell = nbformat.v4.new_code_cell(source, id="injected-parameters", metadata={"tags": ["injected-parameters"]})
    notebook.cells.insert(position + 1, cell)
    return notebook


def quick_parameters(notebook: nbformat.NotebookNode) -> dict[str, object]:
    """Values that a notebook's metadata give for a quick run."""
    return dict(notebook.metadata.get("replication", {}).get("quick", {}))


def execute(source: Path, quick: bool = False, timeout: int = 600, destination: Path | None = None) -> None:
    """Execute a notebook; put what it exports and the executed copy in place if it ends well.

    Parameters
    ----------
    source : Path
        The `.py` source.
    quick : bool
        Run with the notebook's quick parameters, into `results/quick`.
    timeout : int
        Longest time of a cell [s].
    destination : Path, optional
        Root of the folders `results`, `figures` and `notebooks` that are written; the project's own by default.

    Raises
    ------
    NotebookFailed
        A cell failed or timed out, or the kernel died; the partial notebook is in `notebooks/partial`.
    NotebookNotRun
        The data that it needs are not to be had.
    """
    destination = destination or (QUICK if quick else ROOT)
    notebook = read_notebook(source)
    if quick and quick_parameters(notebook):
        notebook = with_parameters(notebook, quick_parameters(notebook))
    destination.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=destination, prefix=".staging-") as staging:
        _run_cells(notebook, source, Path(staging), quick, timeout)
        _strip(notebook)
        executed = Path(staging) / "notebooks" / f"{source.stem}.ipynb"
        executed.parent.mkdir()
        nbformat.write(notebook, executed)
        _move_into(Path(staging), destination)


def note_duration(name: str, seconds: float) -> None:
    """Keep how long a notebook took in `results/run.json`, with what else differs from run to run."""
    path = ROOT / "results" / "run.json"
    noted = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    commit = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False)
    noted |= {"machine": platform.platform(), "cores": os.cpu_count(), "commit": commit.stdout.strip()}
    noted["seconds"] = noted.get("seconds", {}) | {name: round(seconds, 1)}
    _write_json(path, noted)


def _run_cells(notebook: nbformat.NotebookNode, source: Path, staging: Path, quick: bool, timeout: int) -> None:
    """Run all cells in a fresh kernel of this interpreter, whatever kernels are registered."""
    last = {"cell": 0}

    def on_start(cell, cell_index):
        last["cell"] = cell_index
        print(f"\r{source.stem}: cell {cell_index + 1} of {len(notebook.cells)} ", end="", file=sys.stderr, flush=True)

    manager = AsyncKernelManager(kernel_name="python3", kernel_spec_manager=KernelSpecManager(kernel_dirs=[]))
    client = _Client(
        notebook,
        km=manager,
        timeout=timeout,
        record_timing=False,
        extra_arguments=["--IPKernelApp.log_level=ERROR"],
        resources={"metadata": {"path": str(ROOT)}},
        on_cell_start=on_start,
    )
    environment = os.environ | PINNED_ENVIRONMENT | {"REPLICATION_OUT": str(staging)}
    environment["REPLICATION_QUICK"] = "1" if quick else "0"
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    try:
        client.execute(env=environment)
    except CellExecutionError as error:
        if error.ename == "DataUnavailable":
            raise NotebookNotRun(f"{source.stem}: not run: {error.evalue}") from error
        _fail(notebook, source, last["cell"], f"{error.ename}: {error.evalue}", error)
    except CellTimeoutError as error:
        _fail(notebook, source, last["cell"], f"took longer than {timeout} s", error)
    except DeadKernelError as error:
        _fail(notebook, source, last["cell"], "the kernel died", error)
    finally:
        print(file=sys.stderr)


def _fail(notebook: nbformat.NotebookNode, source: Path, cell: int, why: str, error: Exception) -> None:
    """Keep the partial notebook and raise `NotebookFailed`."""
    partial = source.parent / "partial" / f"{source.stem}.ipynb"
    partial.parent.mkdir(exist_ok=True)
    nbformat.write(notebook, partial)
    raise NotebookFailed(f"{source.name}, cell {cell + 1}: {why}; what it got to is in {partial}") from error


def _strip(notebook: nbformat.NotebookNode) -> None:
    """Remove from an executed notebook what does not belong to its content."""
    notebook.metadata.pop("language_info", None)
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)


def _move_into(staging: Path, destination: Path) -> None:
    """Move every staged file to its place, each by one rename."""
    for file in sorted(path for path in staging.rglob("*") if path.is_file()):
        target = destination / file.relative_to(staging)
        target.parent.mkdir(parents=True, exist_ok=True)
        os.replace(file, target)


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_suffix(".tmp")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)


def write_csv(path: Path, table: pd.DataFrame) -> None:
    """Write a table whole or not at all, six significant digits."""
    write_text(path, table.to_csv(index=False, float_format=FLOAT_FORMAT, lineterminator="\n"))


def _write_json(path: Path, content: dict) -> None:
    write_text(path, json.dumps(content, indent=1) + "\n")
