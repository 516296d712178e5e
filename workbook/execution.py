"""Execution of one notebook in a fresh kernel; what it makes is put in place only if it ended well."""

import asyncio
import atexit
import fcntl
import hashlib
import os
import shlex
import shutil
import signal
import subprocess
import time
from pathlib import Path

import joblib
import jupytext
import nbformat
import psutil
from nbclient import NotebookClient
from nbclient.exceptions import CellControlSignal, CellExecutionError
from nbformat import NotebookNode
from nbformat.v4 import new_markdown_cell

from replication.compilation import pinned_environment
from replication.files import ROOT, DataUnavailable, UserError, write_bytes, write_files, write_text
from workbook.sources import listed_exports
from workbook.stamps import new_stamp

CELL_TIMEOUT_S = 900
WORKER_BYTES = 500 * 2**20  # of a process that computes, with the libraries that it loads
KERNEL = {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"}
HASH = "cells_sha256"  # in the metadata of an executed notebook, by which an edit is noticed
SIMULATED = """**On our simulated records in place of the authors', whose files could not be had. The \
committed results, from the authors' data, are untouched; `make data` fetches them.**"""


class NotebookFailed(UserError):
    """A notebook did not run to its end."""

    exit_status = 1


def run(source: Path) -> str:
    """Execute a notebook and put what it makes in place, beside its folder `notebooks`; say how it ended.

    Where the authors' files can't be had it runs on our simulated records, into `results/offline`. A
    stamp, `.make/NAME.ran`, says that it ran on what it asks for, and what it made. A second run of it waits for the
    first. This process gets the environment of its kernel.

    Raises
    ------
    NotebookFailed
        A cell failed, or its kernel or the disk did; what it got to lies in `.make`.
    UserError
        The source is none, or its `.ipynb` was edited.
    """
    project, name = find_project(source), source.stem
    notebook = read_notebook(source, "correct it")
    refuse_edited(source, notebook)
    start = time.monotonic()
    where = ""
    try:
        os.environ |= kernel_environment(project)
        stamp = project / ".make" / f"{name}.ran"
        with stamp.with_suffix(".lock").open("wb") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            try:
                made = _execute_into(project, source, project)
                write_bytes(stamp, new_stamp(project, made, time.monotonic() - start))
            except DataUnavailable:
                os.environ["BACKLASH_RECORDS"] = "simulated"
                _execute_into(project / "results" / "offline", source, project, SIMULATED)
                where = " on our simulated records"
    except DataUnavailable as missing:
        return f"{name}: not run: {missing}; its committed results stay"
    except OSError as error:
        raise NotebookFailed(
            f"{source.name}: {error}, while working in {project / '.make'}"
        ) from error
    return f"{name}: done{where} in {time.monotonic() - start:.0f} s"


def find_project(source: Path) -> Path:
    """Find the folder that holds `notebooks`, with a notebook's source in it."""
    folders = [path.parent for path in source.resolve().parents if path.name == "notebooks"]
    if source.suffix != ".py" or not source.is_file() or not folders:
        example = "such as notebooks/08_noise_table2.py"
        raise UserError(f"{source}: give the .py source of a notebook, {example}")
    return folders[0]


def read_notebook(file: Path, advice: str) -> NotebookNode:
    """Read a notebook, or the source of one; UserError, with an advice, where a file holds none."""
    try:
        notebook = jupytext.read(file)
        nbformat.validate(notebook)
        return notebook
    except Exception as error:  # of whatever a parser meets in a damaged file
        why = str(error).strip().partition("\n")[0]
        raise UserError(f"{file}: no notebook can be read from it ({why}); {advice}") from error


def refuse_edited(source: Path, notebook: NotebookNode) -> None:
    """Refuse to overwrite an `.ipynb` whose cells are neither those that it was executed with nor the source's."""
    executed = source.with_suffix(".ipynb")
    if not executed.exists():
        return
    left = read_notebook(executed, "delete it, and it is made again")
    there = cells_sha256(left)
    if there not in (left.metadata.get(HASH, there), cells_sha256(notebook)):
        raise UserError(
            f"{executed}: edited, and left as it is; .venv/bin/jupytext --to py:percent {shlex.quote(str(executed))} "
            "takes the edits over into the .py, or delete it"
        )


def cells_sha256(notebook: NotebookNode) -> str:
    """SHA-256 of the cells' types and sources."""
    cells = [(cell.cell_type, cell.source.rstrip()) for cell in notebook.cells]
    return hashlib.sha256(repr(cells).encode()).hexdigest()


def kernel_environment(project: Path) -> dict[str, str]:
    """A kernel's variables: arithmetic and workers are pinned, the user's own settings shut out."""
    settings = project / ".make" / "settings"  # kept, for the list of fonts takes seconds to make
    folders = ("MPLCONFIGDIR", "IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR")
    for name in folders:
        (settings / name).mkdir(parents=True, exist_ok=True)
    return {
        **pinned_environment(),
        **{name: str(settings / name) for name in folders},
        **dict.fromkeys(("JUPYTER_PATH", "JUPYTER_CONFIG_PATH", "PYTHONSTARTUP"), ""),
        "MATPLOTLIBRC": str(settings / "none"),
        "MPLBACKEND": "module://matplotlib_inline.backend_inline",
        "BACKLASH_RECORDS": "",
        "PYTHONHASHSEED": "0",
        "PYTHONPATH": str(ROOT),
        "LOKY_MAX_CPU_COUNT": str(count_workers(joblib.cpu_count(), available_memory())),
    }


def count_workers(cores: int, memory: int) -> int:
    """Processes in which each of two notebooks computes at a time, given all cores and the memory [bytes]."""
    return max(1, min(cores // 2, memory // (2 * WORKER_BYTES)))


def available_memory() -> int:
    """Memory that this machine has left, or its container may take [bytes]."""
    limit = Path("/sys/fs/cgroup/memory.max")
    text = limit.read_text().strip() if limit.exists() else "max"
    available = psutil.virtual_memory().available
    return available if text == "max" else min(available, int(text))


def _execute_into(destination: Path, source: Path, project: Path, warning: str = "") -> list[Path]:
    """Execute a source; put what it makes, which has to be what it lists, where it belongs, all or none."""
    notebook = jupytext.read(source)
    for position, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{position:02d}"  # the same from run to run
    notebook.metadata = {"kernelspec": KERNEL, HASH: cells_sha256(notebook)}
    if warning:
        notebook.cells.insert(0, new_markdown_cell(warning, id="records"))
    staging = project / ".make" / f"{source.stem}.staging"
    shutil.rmtree(staging, ignore_errors=True)  # of a run that was killed
    staging.mkdir()
    try:
        os.environ |= {"REPLICATION_OUT": str(staging), "REPLICATION_NOTEBOOK": source.stem}
        execute(notebook, source, project / ".make" / f"{source.stem}.failed.ipynb")
        executed = staging / source.resolve().relative_to(project).with_suffix(".ipynb")
        executed.parent.mkdir(parents=True)
        nbformat.write(notebook, executed)
        made = {
            destination / file.relative_to(staging): file.read_bytes()
            for file in staging.rglob("*")
            if file.is_file()
        }
        listed = {destination / name for name in listed_exports(source)}
        for file in sorted(listed ^ {*made}):
            what = "not made" if file in listed else "made, and named in no call of the source"
            raise NotebookFailed(f"{source.name}: {file.relative_to(destination)}: {what}")
        write_files(made)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return [*made]


def execute(notebook: NotebookNode, source: Path, partial: Path) -> None:
    """Execute a notebook's cells in place, in the source's folder; progress bars leave no trace in it.

    What one that fails got to is written to `partial`.
    """
    client = NotebookClient(
        notebook,
        kernel_name="python3",
        timeout=CELL_TIMEOUT_S,
        coalesce_streams=True,  # in how many pieces a text arrives is a matter of time
        record_timing=False,
        shutdown_kernel="immediate",
        resources={"metadata": {"path": str(source.parent)}},
    )
    client.on_notebook_start = lambda notebook: _end_together(client)
    log = partial.with_suffix(".log")  # what the kernel itself says, and not a cell
    try:
        with log.open("wb") as file:
            client.execute(stderr=file)
        log.unlink()
    except (CellControlSignal, RuntimeError) as error:  # a cell, its time, or the kernel
        atexit.unregister(client._cleanup_kernel)  # of a kernel that never was
        why = " ".join([str(error).partition("\n")[0], *log.read_text().splitlines()[-1:]])
        if isinstance(error, CellExecutionError):
            if error.ename == "DataUnavailable":
                raise DataUnavailable(error.evalue) from error
            why = f"{error.ename}: {error.evalue}".partition("\n")[0]
        write_text(partial, nbformat.writes(notebook))
        raise NotebookFailed(
            f"{source.name}, code cell {client.code_cells_executed}: {why}; "
            f"what it got to is in {partial}"
        ) from error
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = [each for each in cell.outputs if each.get("name") != "stderr"]
    # To the third number, which results don't depend on.
    del notebook.metadata["language_info"]["version"]


def _end_together(client: NotebookClient) -> None:
    """Kill a kernel and its workers when this process ends, however it does: then the pipe closes.

    A signal ends it, in place of what nbclient does at one.
    """
    for each in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().remove_signal_handler(each)
    atexit.unregister(client._cleanup_kernel)
    assert client.km is not None
    group = client.km.provisioner.pgid  # type: ignore[union-attr]
    subprocess.Popen(
        ["sh", "-c", f"read -r line; kill -s KILL -- -{group}"],
        stdin=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
