"""Execution of one notebook in a fresh kernel; what it exports is put in place only if all went well."""

import ast
import hashlib
import json
import os
import tempfile
import threading
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
from replication.workbook import guard
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
    """A client that notes every sign of progress, and keeps a cell's standard error out of the notebook."""

    def __init__(self, notebook, heard: Callable[[str], None], started: Callable[[int], None], **options):
        super().__init__(notebook, **options)
        self.heard, self.started = heard, started

    async def async_start_new_kernel(self, **options):
        await super().async_start_new_kernel(**options)
        self.started(self.km.provisioner.pgid)

    def process_message(self, msg, cell, cell_index):
        is_error = msg["msg_type"] == "stream" and msg["content"]["name"] == "stderr"
        self.heard(msg["content"]["text"] if is_error else "")
        return None if is_error else super().process_message(msg, cell, cell_index)


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
    keeper: guard.Guard | None = None,
    progress: Callable[[int, int, str], None] = lambda cell, cells, text: None,
) -> list[float]:
    """Execute a notebook; put what it exports and the executed copy in place if it ends well; return seconds by cell.

    Everything goes to a staging folder first, so that a failing notebook leaves the last good results alone.
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
        run = _Run(notebook, source, record, stall_s, progress, keeper)
        variables = os.environ | PINNED_ENVIRONMENT | dict(environment or {})
        variables |= {"REPLICATION_OUT": folder, "REPLICATION_QUICK": str(int(quick))}
        variables |= {"REPLICATION_NOTEBOOK": source.stem}
        variables["PYTHONPATH"] = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
        run.to_the_end(variables)
        _strip(notebook)
        _complete_outcome(staging / "results" / "outcomes" / f"{source.stem}.json", record, source)
        executed = staging / "notebooks" / f"{source.stem}.ipynb"
        executed.parent.mkdir(exist_ok=True)
        nbformat.write(notebook, executed)
        _move_into(staging, destination)
    return run.seconds


class _Run:
    """One run of a notebook: its kernel's processes, its progress, and how it ended."""

    def __init__(self, notebook, source, record, stall_s, progress, keeper):
        self.notebook, self.source, self.record, self.stall_s = notebook, source, record, stall_s
        self.progress, self.keeper = progress, keeper
        self.cells = len(notebook.cells)
        self.cell, self.begun, self.seconds = 0, time.monotonic(), [0.0] * self.cells
        self.last_sign, self.group = time.monotonic(), None
        self.ended, self.stalled = threading.Event(), False

    def to_the_end(self, environment: dict[str, str]) -> None:
        """Run all cells in a fresh kernel of this interpreter, whatever kernels are registered."""
        ending = f"__import__('sys').modules['notebook_recorder'].write({str(self.record)!r}, globals())"
        self.notebook.cells.append(nbformat.v4.new_code_cell(ending, id="recorder"))
        client = _Client(
            self.notebook,
            self._heard,
            self._started,
            km=AsyncKernelManager(kernel_name="python3", kernel_spec_manager=KernelSpecManager(kernel_dirs=[])),
            timeout=None,
            coalesce_streams=True,  # in how many pieces a text arrives is a matter of time
            startup_timeout=2**31,  # [s]; a kernel that never starts is a stall
            record_timing=False,
            extra_arguments=["--IPKernelApp.log_level=ERROR", f"--IPKernelApp.exec_lines={_watch_files()}"],
            resources={"metadata": {"path": str(ROOT)}},
            on_cell_start=self._cell_started,
            on_cell_executed=self._cell_ended,
        )
        watchdog = threading.Thread(target=self._end_when_stalled, daemon=True)
        watchdog.start()
        try:
            client.execute(env=environment)
        except CellExecutionError as error:
            if error.ename == "DataUnavailable":
                raise NotebookNotRun(f"{self.source.stem}: not run: {error.evalue}") from error
            self._fail(f"{error.ename}: {error.evalue}", error)
        except (DeadKernelError, RuntimeError) as error:  # the latter if it dies while it starts
            stall = f"no progress for {self.stall_s / 60:.3g} minutes (STALL_MINUTES=... allows more)"
            self._fail(stall if self.stalled else "the kernel died", error)
        finally:
            self.ended.set()
            if self.group is not None:
                self.keeper.end(self.group) if self.keeper else guard.kill(self.group)
            self.notebook.cells.pop()

    def _started(self, group: int) -> None:
        self.group, self.last_sign = group, time.monotonic()
        if self.keeper:
            self.keeper.add(group)

    def _heard(self, text: str) -> None:
        self.last_sign = time.monotonic()
        if text.strip():
            self.progress(min(self.cell + 1, self.cells), self.cells, text)

    def _cell_started(self, cell, cell_index) -> None:
        self.cell, self.begun, self.last_sign = cell_index, time.monotonic(), time.monotonic()
        self.progress(min(cell_index + 1, self.cells), self.cells, "")

    def _cell_ended(self, cell, cell_index, execute_reply) -> None:
        if cell_index < self.cells:
            self.seconds[cell_index] = time.monotonic() - self.begun

    def _end_when_stalled(self) -> None:
        """Kill the kernel after `stall_s` without a message from it."""
        while not self.ended.wait(min(1.0, self.stall_s / 4)):
            if self.group is not None and time.monotonic() - self.last_sign > self.stall_s:
                self.stalled = True
                guard.kill(self.group)
                return

    def _fail(self, why: str, error: Exception) -> None:
        """Keep the partial notebook and raise `NotebookFailed`."""
        partial = self.source.parent / "partial" / f"{self.source.stem}.ipynb"
        try:
            partial.parent.mkdir(exist_ok=True)
            nbformat.write(self.notebook, partial)
            kept = f"what it got to is in {partial}"
        except OSError as full:
            kept = f"what it got to could not be kept ({full.strerror})"
        raise NotebookFailed(f"{self.source.name}, cell {self.cell + 1}: {why}; {kept}") from error


def _watch_files() -> str:
    """Line of code that makes a kernel note the files that it reads."""
    folders = {"sources": str(ROOT), "inputs": str(data_folder().absolute())}
    return f"__import__('runpy').run_path({str(RECORDER)!r})['start']({folders!r})"


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
