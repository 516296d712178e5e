"""Execution of one notebook in a fresh kernel; what it makes is put in place only if it ended well."""

import fcntl
import os
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import joblib
import jupytext
import nbformat
import psutil
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError
from nbformat import NotebookNode
from nbformat.v4 import new_markdown_cell

from replication import pinned_environment
from replication.records import ROOT, UserError, write_text
from workbook.checkout import OFFLINE

CELL_TIMEOUT_S = 900
WORKER_BYTES = 500 * 2**20  # of a process that computes, with the libraries that it loads
KERNEL = {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"}
SIMULATED = """**On our simulated records in place of the authors', whose files could not be had. The \
committed results, from the authors' data, are untouched; `make data` fetches them.**"""


class NotebookFailed(UserError):
    """A notebook did not run to its end."""

    exit_status = 1


class DataMissing(UserError):
    """A notebook needs data that are not to be had."""


def run(source: Path) -> str:
    """Execute a notebook and put what it makes in place, beside its folder `notebooks`; say how it ended.

    Where the authors' files can't be had it runs on our simulated records, into `results/offline`. A
    stamp, `.make/NAME.ran`, says that it ran on what it asks for.

    Raises
    ------
    NotebookFailed
        A cell failed, or its kernel did; what it got to lies in `.make`.
    UserError
        The source is none, its `.ipynb` was edited, or another process runs it.
    """
    project = find_project(source)
    name, start = source.stem, time.monotonic()
    with _lock(project, name):
        _check_pair(source)
        try:
            _execute_into(project, source, project)
            where = ""
            write_text(project / ".make" / f"{name}.ran", f"{time.monotonic() - start:.0f}\n")
        except DataMissing as missing:
            try:
                apart = project / OFFLINE.relative_to(ROOT)
                _execute_into(apart, source, project, records="simulated")
                where = " on our simulated records"
            except DataMissing:
                return f"{name}: not run: {missing}; its committed results stay"
    return f"{name}: done{where} in {time.monotonic() - start:.0f} s"


def find_project(source: Path) -> Path:
    """Find the folder that holds `notebooks`, with a notebook's source in it."""
    folders = [path.parent for path in source.resolve().parents if path.name == "notebooks"]
    if source.suffix != ".py" or not source.is_file() or not folders:
        example = "such as notebooks/08_noise_table2.py"
        raise UserError(f"{source}: give the .py source of a notebook, {example}")
    return folders[0]


@contextmanager
def _lock(project: Path, name: str) -> Iterator[None]:
    """Keep other processes from running the same notebook, until this one ends, in whatever way."""
    (project / ".make").mkdir(exist_ok=True)
    with (project / ".make" / f"{name}.lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise UserError(f"{name}: another process runs it; wait until it has ended") from error
        yield


def _check_pair(source: Path) -> None:
    """Refuse to overwrite an `.ipynb` that was edited after its source."""
    executed = source.with_suffix(".ipynb")
    if not executed.exists() or executed.stat().st_mtime_ns < source.stat().st_mtime_ns:
        return
    here, there = (
        [(cell.cell_type, cell.source.rstrip()) for cell in notebook.cells]
        for notebook in (jupytext.read(source), nbformat.read(executed, as_version=4))
    )
    if here != there:
        raise UserError(
            f"{executed}: edited after {source.name}, and left as it is; take the edits over by "
            f"jupytext --sync {source}, or delete it"
        )


def _execute_into(destination: Path, source: Path, project: Path, records: str = "") -> None:
    """Execute a notebook in a staging folder, then rename each file into a destination."""
    staging = project / ".make" / "staging" / source.stem
    shutil.rmtree(staging, ignore_errors=True)  # what a killed run has left
    staging.mkdir(parents=True)
    notebook = read_notebook(source)
    if records:
        notebook.cells.insert(0, new_markdown_cell(SIMULATED, id="records"))
    variables = {
        "REPLICATION_OUT": str(staging),
        "REPLICATION_NOTEBOOK": source.stem,
        "BACKLASH_RECORDS": records,
        "MPLBACKEND": "module://matplotlib_inline.backend_inline",
        "PYTHONHASHSEED": "0",
        "LOKY_MAX_CPU_COUNT": str(count_workers(joblib.cpu_count(), available_memory())),
        "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])),
    }
    execute(
        notebook, source, os.environ | pinned_environment() | isolated_environment() | variables
    )
    executed = staging / source.resolve().relative_to(project).with_suffix(".ipynb")
    executed.parent.mkdir(parents=True)
    nbformat.write(notebook, executed)
    for made in staging.iterdir():
        into = destination / made.name
        shutil.copytree(made, into, copy_function=os.replace, dirs_exist_ok=True)
    shutil.rmtree(staging)


def read_notebook(source: Path) -> NotebookNode:
    """Read a notebook's py:percent source, with cell ids that do not change from run to run."""
    notebook = jupytext.read(source)
    for position, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{position:02d}"
    notebook.metadata = nbformat.from_dict({"kernelspec": KERNEL})
    return notebook


def isolated_environment() -> dict[str, str]:
    """Environment variables that shut out a user's own settings of matplotlib, IPython and Jupyter."""
    settings = ROOT / ".make" / "settings"  # kept, for the list of fonts takes seconds to make
    settings.mkdir(parents=True, exist_ok=True)
    names = ("MPLCONFIGDIR", "IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR")
    nowhere = dict.fromkeys(("JUPYTER_PATH", "JUPYTER_CONFIG_PATH", "PYTHONSTARTUP"), "")
    rc_file = {"MATPLOTLIBRC": str(settings / "none")}
    return {name: str(settings / name.lower()) for name in names} | nowhere | rc_file


def count_workers(cores: int, memory: int) -> int:
    """Processes that each of two notebooks may start at a time, given all cores and the memory [bytes]."""
    return max(1, min(cores, max(2, cores // 2), memory // (2 * WORKER_BYTES)))


def available_memory() -> int:
    """Memory that this machine has left, or its container may take [bytes]."""
    limit = Path("/sys/fs/cgroup/memory.max")
    text = limit.read_text().strip() if limit.exists() else "max"
    available = psutil.virtual_memory().available
    return available if text == "max" else min(available, int(text))


def execute(notebook: NotebookNode, source: Path, environment: dict[str, str]) -> None:
    """Execute a notebook's cells in place, in its own folder; progress bars leave no trace in it."""
    client = NotebookClient(
        notebook,
        kernel_name="python3",
        timeout=CELL_TIMEOUT_S,
        coalesce_streams=True,  # in how many pieces a text arrives is a matter of time
        record_timing=False,
        shutdown_kernel="immediate",
        extra_arguments=["--IPKernelApp.log_level=ERROR"],
        resources={"metadata": {"path": str(source.parent)}},
    )
    started = [0]
    client.on_cell_start = lambda cell, cell_index: started.append(cell_index)
    client.on_notebook_start = lambda notebook: _kill_with_this_process(client)
    try:
        client.execute(env=environment)
    except (CellExecutionError, CellTimeoutError, DeadKernelError) as error:
        _report_failure(notebook, source, started[-1], error)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = [each for each in cell.outputs if each.get("name") != "stderr"]
    del notebook.metadata["language_info"][
        "version"
    ]  # to the third number, which results don't depend on


def _kill_with_this_process(client: NotebookClient) -> None:
    """Kill a kernel and its workers when this process ends, however it does: then the pipe closes."""
    kernel: Any = client.km
    group = kernel.provisioner.pgid
    subprocess.Popen(
        ["sh", "-c", f"read -r line; kill -s KILL -- -{group}"],
        stdin=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def _report_failure(notebook: NotebookNode, source: Path, cell: int, error: Exception) -> None:
    """Raise in one line what ended a notebook, and where."""
    if isinstance(error, CellExecutionError) and error.ename == "DataUnavailable":
        raise DataMissing(error.evalue) from error
    if isinstance(error, CellExecutionError):
        why = f"{error.ename}: {error.evalue}".partition("\n")[0]
    elif isinstance(error, CellTimeoutError):
        why = f"no end after {CELL_TIMEOUT_S / 60:.3g} minutes"
    else:
        why = "the kernel died"
    partial = find_project(source) / ".make" / f"{source.stem}.failed.ipynb"
    write_text(partial, nbformat.writes(notebook))
    raise NotebookFailed(
        f"{source.name}, cell {cell + 1}: {why}; what it got to is in {partial}"
    ) from error


def end_with(process: int) -> None:
    """End this process when another, make, has ended without waiting for it."""

    def watch() -> None:
        with suppress(psutil.NoSuchProcess):
            psutil.Process(process).wait()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
