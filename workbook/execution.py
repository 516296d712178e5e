"""Execution of one notebook in a fresh kernel; what it exports is kept only if all went well."""

import ast
import math
import os
import re
import shutil
import signal
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import jupytext
import nbformat
import psutil
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, DeadKernelError
from nbclient.util import run_sync
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell, new_markdown_cell
from tqdm import tqdm

from replication.files import ROOT, write_text
from replication.processors import pinned_environment
from replication.records import data_folder
from workbook.checkout import APART, NOTEBOOKS, OFFLINE

STALL_S = 900.0
WORKER_BYTES = 500 * 2**20  # of a process that computes, with the libraries that it loads


class NotebookFailed(RuntimeError):
    """A notebook did not run to its end."""

    exit_status = 1


class NotebookNotRun(RuntimeError):
    """A notebook needs data that are not to be had."""

    exit_status = 1


class _Client(NotebookClient):
    """Runs a notebook in a fresh kernel, shows its progress, and ends it if it makes none.

    A private name of nbclient is overridden; tests of stalled and killed kernels notice a change.
    """

    def __init__(self, notebook: NotebookNode, source: Path, stall_s: float):
        of_this_interpreter = KernelSpecManager(kernel_dirs=[])  # whatever kernels are registered
        self.kernel = AsyncKernelManager(
            kernel_name="python3", kernel_spec_manager=of_this_interpreter
        )
        super().__init__(
            notebook,
            km=self.kernel,
            coalesce_streams=True,  # in how many pieces a text arrives is a matter of time
            startup_timeout=math.ceil(stall_s),
            shutdown_kernel="immediate",
            record_timing=False,
            extra_arguments=_kernel_arguments(source),
            resources={"metadata": {"path": str(ROOT)}},
        )
        self.owns_km = True  # nbclient is to end the kernel
        self.stall_s = stall_s
        self.last_sign = time.monotonic()
        self.cell = 0
        self.bar = tqdm(
            total=len(notebook.cells),
            desc=source.stem,
            leave=False,
            disable=None,
            bar_format="{desc}: cell {n} of {total}{postfix}",
        )

    def run(self, environment: Mapping[str, str]) -> None:
        """Execute the cells."""
        with self.bar, self.setup_kernel(env=environment):
            # Both ends have read it, and a run that is killed would leave it behind.
            self.kernel.cleanup_connection_file()
            try:
                for position, cell in enumerate(self.nb.cells):
                    self.cell, self.last_sign = position, time.monotonic()
                    self.bar.update()
                    self.execute_cell(cell, position, execution_count=self.code_cells_executed + 1)
            finally:
                # And its workers, even if it is dead.
                run_sync(self.kernel.signal_kernel)(signal.SIGKILL)

    def process_message(self, msg, cell, cell_index):
        """Take in a message; standard error is progress, and does not belong to the notebook."""
        self.last_sign = time.monotonic()
        if msg["msg_type"] == "stream" and msg["content"]["name"] == "stderr":
            self.bar.set_postfix_str(count_and_time_left(msg["content"]["text"]))
            return None
        return super().process_message(msg, cell, cell_index)

    def has_stalled(self) -> bool:
        return time.monotonic() - self.last_sign > self.stall_s

    async def _async_check_alive(self):
        """End a cell whose kernel is dead or has stalled; called every second."""
        if self.has_stalled():
            raise DeadKernelError
        await super()._async_check_alive()


def _kernel_arguments(source: Path) -> list[str]:
    """Arguments with which a kernel starts the recorder.

    The recorder ends the kernel and its workers with the run; ipykernel would end the kernel alone.
    """
    recorder = str(Path(__file__).with_name("recorder.py"))
    started = (os.getpid(), str(ROOT), str(data_folder().absolute()), str(source.resolve()))
    start = f"__import__('runpy').run_path({recorder!r})['start']{started}"
    return [
        "--IPKernelApp.log_level=ERROR",
        "--IPKernelApp.parent_handle=1",
        f"--IPKernelApp.exec_lines={start}",
    ]


def count_and_time_left(text: str) -> str:
    """Count and time left of the last state of a progress bar in a text, if there is one."""
    found = re.findall(r"(\d+/\d+) \[[\d:]+<([\d:?]+)", text)
    return f"{found[-1][0]}, {found[-1][1]} left" if found else ""


FOLDED = {"plumbing", "solution"}  # tags of cells whose source JupyterLab and the pages fold


def read_notebook(source: Path) -> NotebookNode:
    """Read a notebook's py:percent source, with cell ids that do not change from run to run."""
    notebook = jupytext.read(source)
    for position, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{position:02d}"
        if tags := FOLDED.intersection(cell.metadata.get("tags", [])):
            cell.metadata["jupyter"] = {"source_hidden": True, "outputs_hidden": "solution" in tags}
    return notebook


def quick_parameters(notebook: NotebookNode) -> dict[str, object]:
    """Values that a notebook's metadata give for a quick run."""
    return dict(notebook.metadata.get("replication", {}).get("quick", {}))


def with_parameters(notebook: NotebookNode, values: Mapping[str, object]) -> NotebookNode:
    """Override values of a notebook's tagged parameters cell, by a cell inserted after it."""
    tags = [cell.metadata.get("tags", []) for cell in notebook.cells]
    position = next(k for k, own in enumerate(tags) if "parameters" in own)
    nodes = ast.walk(ast.parse(notebook.cells[position].source))
    names = {
        node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }
    if unknown := ", ".join(sorted(set(values) - names)):
        raise ValueError(f"no such parameter: {unknown}; there are {', '.join(sorted(names))}")
    source = "\n".join(f"{name} = {value!r}" for name, value in values.items())
    tag = "injected-parameters"
    notebook.cells.insert(position + 1, new_code_cell(source, id=tag, metadata={"tags": [tag]}))
    return notebook


def execute(
    source: Path,
    destination: Path,
    quick: bool = False,
    stall_s: float = STALL_S,
    records: str = "",
) -> None:
    """Execute a notebook; put what it exports and the executed copy in place if it ends well.

    Everything goes to a staging folder first, so that a failing notebook leaves the last good
    results alone. Records are the authors', or "simulated".
    """
    notebook = read_notebook(source)
    if records:
        notebook.cells.insert(0, new_markdown_cell(f"**{APART[OFFLINE]}**", id="records"))
    if quick and (values := quick_parameters(notebook)):
        notebook = with_parameters(notebook, values)
    destination.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=destination, prefix=".staging-") as folder:
        staging = Path(folder)
        outcome = staging / "results" / "outcomes" / f"{source.stem}.json"
        write = f"__import__('sys').modules['notebook_recorder'].write({str(outcome)!r}, globals())"
        notebook.cells.append(new_code_cell(write, id="recorder"))
        paths = [str(ROOT), os.environ.get("PYTHONPATH")]
        variables = {
            "REPLICATION_OUT": folder,
            "REPLICATION_QUICK": str(int(quick)),
            "REPLICATION_NOTEBOOK": source.stem,
            "BACKLASH_RECORDS": records,
            "LOKY_MAX_CPU_COUNT": str(count_workers()),
            "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        }
        environment = os.environ | pinned_environment() | variables
        _run_to_the_end(_Client(notebook, source, stall_s), source, environment)
        notebook.cells.pop()
        inside = "beyond" if source.resolve().parent == NOTEBOOKS / "beyond" else ""
        executed = staging / "notebooks" / inside / f"{source.stem}.ipynb"
        executed.parent.mkdir(parents=True)
        nbformat.write(notebook, executed)
        for made in staging.iterdir():
            into = destination / made.name
            shutil.copytree(made, into, copy_function=os.replace, dirs_exist_ok=True)


def count_workers(memory: int = 0, cores: int = 0) -> int:
    """Processes that a notebook may start: no more than there are cores, and than the memory [bytes] holds."""
    memory = memory or psutil.virtual_memory().available
    return max(1, min(cores or os.cpu_count() or 1, memory // WORKER_BYTES))


def _run_to_the_end(client: _Client, source: Path, environment: Mapping[str, str]) -> None:
    """Run a notebook; where that fails, keep the partial notebook and say what went wrong."""
    try:
        client.run(environment)
    except (CellExecutionError, RuntimeError) as error:
        client.nb.cells.pop()
        if isinstance(error, CellExecutionError) and error.ename == "DataUnavailable":
            raise NotebookNotRun(f"{source.stem}: not run: {error.evalue}") from error
        if isinstance(error, CellExecutionError):
            why = f"{error.ename}: {error.evalue}"
        elif client.has_stalled():
            minutes = f"{client.stall_s / 60:.3g} minutes"
            why = f"no progress for {minutes} (STALL_MINUTES=... allows more)"
        else:
            why = "the kernel died"
        where = f"{source.name}, cell {client.cell + 1}: {why}"
        partial = source.parent / "partial" / f"{source.stem}.ipynb"
        try:
            partial.parent.mkdir(exist_ok=True)
            write_text(partial, nbformat.writes(client.nb))
        except OSError as full:
            raise NotebookFailed(f"{where}; {full.strerror}: {partial}") from error
        raise NotebookFailed(f"{where}; what it got to is in {partial}") from error
