"""Execution of one notebook in a fresh kernel; what it exports is put in place only if all went well."""

import ast
import atexit
import contextlib
import hashlib
import json
import math
import os
import signal
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import jupytext
import nbformat
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, DeadKernelError

from replication.data.authors import data_folder
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

STALL_S = 900.0
RECORDER = Path(__file__).with_name("recorder.py")


class NotebookFailed(RuntimeError):
    """A notebook did not run to its end."""


class NotebookNotRun(RuntimeError):
    """A notebook needs data that are not to be had."""


class _Client(NotebookClient):
    """Runs all cells in a fresh kernel of this interpreter, and notes every sign of progress.

    Private names of nbclient are overridden; the tests of stalled and killed kernels notice if they change.
    """

    def __init__(self, notebook, stall_s: float, progress: Callable[[int, int, str], None], kernels: set[int]):
        super().__init__(
            notebook,
            # Whatever kernels are registered.
            km=AsyncKernelManager(kernel_name="python3", kernel_spec_manager=KernelSpecManager(kernel_dirs=[])),
            timeout=None,
            coalesce_streams=True,  # in how many pieces a text arrives is a matter of time
            startup_timeout=math.ceil(stall_s),
            record_timing=False,
            # `recorder` ends the kernel and its workers with the run; ipykernel would end the kernel alone.
            extra_arguments=["--IPKernelApp.log_level=ERROR", "--IPKernelApp.parent_handle=0",
                             f"--IPKernelApp.exec_lines={_first_line()}"],
            resources={"metadata": {"path": str(ROOT)}},
        )  # fmt: skip
        self.stall_s, self.progress, self.kernels = stall_s, progress, kernels
        self.cells, self.cell, self.seconds, self.stalled = len(notebook.cells), 0, [], False

    async def async_start_new_kernel(self, **options):
        await super().async_start_new_kernel(**options)
        self.group, self.last_sign = self.km.provisioner.pgid, time.monotonic()
        self.kernels.add(self.group)

    async def async_execute_cell(self, cell, cell_index, **options):
        self.cell, begun = cell_index, time.monotonic()
        self._heard("")
        await super().async_execute_cell(cell, cell_index, **options)
        self.seconds.append(time.monotonic() - begun)
        return cell

    async def _async_check_alive(self):
        """End a cell whose kernel is dead or has stalled; called every second."""
        self.stalled = time.monotonic() - self.last_sign > self.stall_s
        if self.stalled:
            raise DeadKernelError("stalled")
        await super()._async_check_alive()

    def process_message(self, msg, cell, cell_index):
        """Take in a message; standard error is progress, and does not belong to the notebook."""
        is_error = msg["msg_type"] == "stream" and msg["content"]["name"] == "stderr"
        self._heard(msg["content"]["text"].strip() or None if is_error else None)
        return None if is_error else super().process_message(msg, cell, cell_index)

    def _heard(self, text: str | None) -> None:
        self.last_sign = time.monotonic()
        if text is not None:
            self.progress(min(self.cell + 1, self.cells), self.cells, text)

    def end(self) -> None:
        """Kill what is left of the kernel and its workers."""
        if group := getattr(self, "group", None):
            end_group(group)
            self.kernels.discard(group)
        atexit.unregister(self._cleanup_kernel)  # nbclient leaves it behind where a kernel did not start


def end_group(group: int) -> None:
    """Kill every process of a group, if any is left."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(group, signal.SIGKILL)


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
    body = ast.parse(notebook.cells[_parameters_cell(notebook)].source).body
    targets = [target for node in body if isinstance(node, ast.Assign) for target in node.targets]
    return [target.id for target in targets if isinstance(target, ast.Name)]


def with_parameters(notebook: nbformat.NotebookNode, values: Mapping[str, object]) -> nbformat.NotebookNode:
    """Override values of a notebook's tagged parameters cell, by a cell inserted after it."""
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
    destination: Path | None = None,
    parameters: Mapping[str, object] | None = None,
    *,
    stall_s: float = STALL_S,
    environment: Mapping[str, str] | None = None,
    kernels: set[int] | None = None,
    progress: Callable[[int, int, str], None] = lambda cell, cells, text: None,
) -> list[float]:
    """Execute a notebook; put what it exports and the executed copy in place if it ends well; return seconds by cell.

    Everything goes to a staging folder first, so that a failing notebook leaves the last good results alone. While it
    runs, `kernels` holds its kernel's process group.
    """
    destination = destination or (QUICK if quick else ROOT)
    notebook = read_notebook(source)
    values = (quick_parameters(notebook) if quick else {}) | dict(parameters or {})
    if values:
        notebook = with_parameters(notebook, values)
    destination.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=destination, prefix=".staging-") as folder:
        staging = Path(folder)
        record = staging / "made_from.json"
        variables = os.environ | PINNED_ENVIRONMENT | dict(environment or {})
        variables |= {"REPLICATION_OUT": folder, "REPLICATION_QUICK": str(int(quick))}
        variables |= {"REPLICATION_NOTEBOOK": source.stem}
        variables["PYTHONPATH"] = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
        client = _Client(notebook, stall_s, progress, set() if kernels is None else kernels)
        _run_to_the_end(client, variables, source, record)
        _strip(notebook)
        _complete_outcome(staging / "results" / "outcomes" / f"{source.stem}.json", record, source)
        executed = staging / "notebooks" / f"{source.stem}.ipynb"
        executed.parent.mkdir(exist_ok=True)
        nbformat.write(notebook, executed)
        _move_into(staging, destination)
    return client.seconds[: client.cells]


def _run_to_the_end(client: _Client, environment: dict[str, str], source: Path, record: Path) -> None:
    """Run a notebook's cells and then the recorder's; say what went wrong in the workbook's words."""
    ending = f"__import__('sys').modules['notebook_recorder'].write({str(record)!r}, globals())"
    client.nb.cells.append(nbformat.v4.new_code_cell(ending, id="recorder"))
    try:
        client.execute(env=environment)
    except CellExecutionError as error:
        if error.ename == "DataUnavailable":
            raise NotebookNotRun(f"{source.stem}: not run: {error.evalue}") from error
        raise _failure(client, source, f"{error.ename}: {error.evalue}") from error
    except (DeadKernelError, RuntimeError) as error:  # the latter if it dies or stalls while it starts
        stall = f"no progress for {client.stall_s / 60:.3g} minutes (STALL_MINUTES=... allows more)"
        has_stalled = client.stalled or "didn't respond" in str(error)
        raise _failure(client, source, stall if has_stalled else "the kernel died") from error
    finally:
        client.end()
        client.nb.cells.pop()


def _failure(client: _Client, source: Path, why: str) -> NotebookFailed:
    """Keep the partial notebook; return the exception that says where it is."""
    partial = source.parent / "partial" / f"{source.stem}.ipynb"
    try:
        partial.parent.mkdir(exist_ok=True)
        nbformat.write(client.nb, partial)
        kept = f"what it got to is in {partial}"
    except OSError as full:
        kept = f"what it got to could not be kept ({full.strerror})"
    return NotebookFailed(f"{source.name}, cell {client.cell + 1}: {why}; {kept}")


def _first_line() -> str:
    """Line of code that makes a kernel note the files that it reads, and end when this process is gone."""
    folders = {"sources": str(ROOT), "inputs": str(data_folder().absolute())}
    return f"__import__('runpy').run_path({str(RECORDER)!r})['start']({folders!r}, {os.getpid()})"


def _complete_outcome(path: Path, record: Path, source: Path) -> None:
    """Add to a notebook's outcome what it was made from: the kernel's record, the notebook and the locked versions."""
    outcome = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"cells": [], "claims": []}
    made_from = json.loads(record.read_text(encoding="utf-8"))
    record.unlink()
    for file in (source.resolve(), ROOT / "requirements.lock"):
        name = file.relative_to(ROOT).as_posix() if file.is_relative_to(ROOT) else file.name
        made_from["sources"][name] = hashlib.sha256(file.read_bytes()).hexdigest()
    made_from["sources"] = dict(sorted(made_from["sources"].items()))
    write_json(path, outcome | {"made_from": made_from})


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
