"""Execution of the notebooks, each in a fresh kernel; what they export is put in place only if all went well."""

import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import jupytext
import nbformat
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError

from replication.workbook.files import QUICK, ROOT, write_json

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


class NotebookFailed(RuntimeError):
    """A notebook did not run to its end."""


class NotebookNotRun(RuntimeError):
    """A notebook needs data that are not to be had."""


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


def _parameters_cell(notebook: nbformat.NotebookNode) -> int:
    for position, cell in enumerate(notebook.cells):
        if "parameters" in cell.metadata.get("tags", []):
            return position
    raise ValueError("the notebook has no cell tagged 'parameters'")


def settable(notebook: nbformat.NotebookNode) -> list[str]:
    """Names that a notebook's tagged parameters cell sets."""
    source = notebook.cells[_parameters_cell(notebook)].source
    return [line.split("=")[0].strip() for line in source.splitlines() if "=" in line]


def with_parameters(notebook: nbformat.NotebookNode, values: Mapping[str, object]) -> nbformat.NotebookNode:
    """Override values of a notebook's tagged parameters cell, by a cell inserted after it.

    Raises
    ------
    ValueError
        The notebook has no cell tagged `parameters`, or the cell does not set one of the names.
    """
    position = _parameters_cell(notebook)
    unknown = set(values) - set(settable(notebook))
    if unknown:
        there = ", ".join(sorted(settable(notebook)))
        raise ValueError(f"no such parameter: {', '.join(sorted(unknown))}; there are {there}")
    source = "\n".join(f"{name} = {value!r}" for name, value in values.items())
    cell = nbformat.v4.new_code_cell(source, id="injected-parameters", metadata={"tags": ["injected-parameters"]})
    notebook.cells.insert(position + 1, cell)
    return notebook


def quick_parameters(notebook: nbformat.NotebookNode) -> dict[str, object]:
    """Values that a notebook's metadata give for a quick run."""
    return dict(notebook.metadata.get("replication", {}).get("quick", {}))


def execute(
    source: Path,
    quick: bool = False,
    timeout: int = 600,
    destination: Path | None = None,
    parameters: Mapping[str, object] | None = None,
) -> None:
    """Execute a notebook; put what it exports and the executed copy in place if it ends well.

    Everything goes to a staging folder first, so that a failing notebook leaves the last good results alone.

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
    parameters : mapping, optional
        Values of its parameters, over the quick ones.

    Raises
    ------
    NotebookFailed
        A cell failed or timed out, or the kernel died; the partial notebook is in `notebooks/partial`.
    NotebookNotRun
        The data that it needs are not to be had.
    ValueError
        It has no such parameter.
    """
    destination = destination or (QUICK if quick else ROOT)
    notebook = read_notebook(source)
    values = (quick_parameters(notebook) if quick else {}) | dict(parameters or {})
    if values:
        notebook = with_parameters(notebook, values)
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
    write_json(path, noted)


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
