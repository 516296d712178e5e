"""Execution of one notebook in a fresh kernel; what it makes is put in place only if it ended well."""

import asyncio
import atexit
import fcntl
import hashlib
import json
import os
import shlex
import signal
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import joblib
import jupytext
import nbformat
import psutil
from nbclient import NotebookClient
from nbclient.exceptions import CellControlSignal, CellExecutionError, DeadKernelError
from nbformat import NotebookNode
from nbformat.v4 import new_markdown_cell

from replication.files import DataUnavailable, UserError, as_json, write_files, write_text
from workbook.kernel import READ, read_notes
from workbook.project import RESULTS, ROOT, SIMULATED, find_hook, notebook_sources
from workbook.stamps import (
    NOTHING,
    add_record,
    digest_code,
    drop_stale_caches,
    record_name,
    stamp_file,
    write_stamp,
)

CELL_TIMEOUT_S = 900
MEMORY_LIMIT = Path("/sys/fs/cgroup/memory.max")
WORKER_BYTES = 500 * 2**20  # of a process that computes, with the libraries that it loads
KERNEL = {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"}
# Its extension, and not ipykernel, ends a kernel with the process that started it: its workers, too.
KERNEL_ARGUMENTS = [
    "--IPKernelApp.extensions=workbook.kernel",
    "--IPKernelApp.parent_handle=0",
    "--IPKernelApp.log_level=50",  # else it advises on how to end it
]
HASH = "cells_sha256"  # in the metadata of an executed notebook, by which an edit is noticed
UNSET = ("JUPYTER_PATH", "JUPYTER_CONFIG_PATH", "PYTHONINSPECT", "PYTHONSTARTUP")
# Variables that name a folder of settings.
FOLDERS = ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "MATPLOTLIBRC", "MPLCONFIGDIR")


class NotebookFailed(UserError):
    """A notebook did not run to its end."""

    exit_status = 1


def run(source: Path) -> str:
    """Execute a notebook and put what it makes in place, in the project's folder; say how it ended.

    Where data can't be had it runs on simulated ones, if the project has such, into `results/offline`. Its outcome says
    what it was made from; a stamp, that it ran here. A second run of it waits for the first. This process gets the
    environment of its kernel.

    Raises
    ------
    NotebookFailed
        A cell failed or said something on stderr, or its kernel failed; what it got to lies in `.make`.
    UserError
        The source is none, or its `.ipynb` was edited.
    """
    source = find_source(source)
    refuse_edited(source, read_notebook(source, "correct it"))
    start, name = time.monotonic(), source.stem
    where = ""
    try:
        os.environ |= kernel_environment()
        drop_stale_caches()
        with stamp_file(name).with_suffix(".lock").open("wb") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            try:
                _execute_into(ROOT, source)
                write_stamp(name, time.monotonic() - start)
            except DataUnavailable:
                if not SIMULATED:
                    raise
                os.environ[SIMULATED["variable"]] = "simulated"
                _execute_into(RESULTS / "offline", source, SIMULATED["warning"])
                where = f" on {SIMULATED['mark']}"
    except DataUnavailable as missing:
        write_stamp(name, lacks=str(missing))
        return f"{name}: not run: {missing}; its committed results stay"
    return f"{name}: done{where} in {time.monotonic() - start:.0f} s"


def find_source(file: Path) -> Path:
    """Find a notebook of the project by the file of its source."""
    source = notebook_sources().get(file.stem)
    if source is None or source.resolve() != file.resolve():
        raise UserError(f"{file}: give the .py source of a notebook of {ROOT}")
    return source


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
    left = read_notebook(executed, "delete it, with any edits in it, and it is made again")
    there = cells_sha256(left)
    if there not in (left.metadata.get(HASH, there), cells_sha256(notebook)):
        raise UserError(
            f"{executed}: edited, and left as it is; .venv/bin/jupytext --to py:percent {shlex.quote(str(executed))} "
            "takes the edits over into the .py; or delete it, and the edits with it"
        )


def cells_sha256(notebook: NotebookNode) -> str:
    """SHA-256 of the cells' types and sources."""
    cells = [(cell.cell_type, cell.source.rstrip()) for cell in notebook.cells]
    return hashlib.sha256(repr(cells).encode()).hexdigest()


def kernel_environment() -> dict[str, str]:
    """A kernel's variables: arithmetic and workers are pinned, the user's own settings shut out."""
    settings = ROOT / ".make" / "settings"  # kept, for the list of fonts takes seconds to make
    settings.mkdir(parents=True, exist_ok=True)
    return {
        **find_hook("environment", dict)(),
        **dict.fromkeys(FOLDERS, str(settings)),
        **dict.fromkeys(UNSET, ""),
        "MPLBACKEND": "module://matplotlib_inline.backend_inline",
        SIMULATED.get("variable", "SIMULATED"): "",
        "PYTHONHASHSEED": "0",
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(Path(__file__).parents[1])]),
        "TQDM_DISABLE": "1",  # a bar of progress is text on stderr
        "LOKY_MAX_CPU_COUNT": str(count_workers()),
    }


def count_workers() -> int:
    """Processes in which each of two notebooks computes at a time, by the cores and the memory that are there."""
    memory = [psutil.virtual_memory().available]
    if MEMORY_LIMIT.exists() and MEMORY_LIMIT.read_text().strip() != "max":
        memory.append(int(MEMORY_LIMIT.read_text()))
    return max(1, min(joblib.cpu_count() // 2, min(memory) // (2 * WORKER_BYTES)))


def _execute_into(destination: Path, source: Path, warning: str = "") -> None:
    """Execute a source; put what it makes, and the record of what it was made from, where it belongs, all or none."""
    code = digest_code(source)
    notebook = jupytext.read(source)
    for position, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{position:02d}"  # the same from run to run
    notebook.metadata = {"kernelspec": KERNEL, HASH: cells_sha256(notebook)}
    if warning:
        notebook.cells.insert(0, new_markdown_cell(warning, id="records"))
    with TemporaryDirectory(dir=ROOT / ".make", ignore_cleanup_errors=True) as folder:
        staging = Path(folder)
        os.environ |= {"REPLICATION_OUT": folder, "REPLICATION_NOTEBOOK": source.stem}
        execute(notebook, source, ROOT / ".make" / f"{source.stem}.failed.ipynb")
        executed = staging / source.relative_to(ROOT).with_suffix(".ipynb")
        executed.parent.mkdir(parents=True)
        nbformat.write(notebook, executed)
        read = read_notes(staging / READ)
        made = {
            file.relative_to(staging).as_posix(): file.read_bytes()
            for file in staging.rglob("[!.]*")
            if file.is_file()
        }
    record = record_name(source.stem)
    said = NOTHING | json.loads(made.pop(record, b"{}"))
    made[record] = as_json(add_record(said, code, read, made))
    write_files({destination / name: content for name, content in made.items()})


def execute(notebook: NotebookNode, source: Path, partial: Path) -> None:
    """Execute a notebook's cells in place, in the source's folder.

    What one that fails got to is written to `partial`.
    """
    client = NotebookClient(
        notebook,
        kernel_name="python3",
        timeout=CELL_TIMEOUT_S,
        record_timing=False,
        shutdown_kernel="immediate",
        coalesce_streams=True,  # in how many pieces a text arrives is a matter of time
        extra_arguments=KERNEL_ARGUMENTS,
        resources={"metadata": {"path": str(source.parent)}},
        on_notebook_start=_leave_signals,
    )
    log = partial.with_suffix(".log")  # what the kernel itself says, and not a cell
    try:
        with log.open("wb") as file:
            client.execute(stderr=file)
        log.unlink()
        # Its third number, on which nothing depends.
        del notebook.metadata["language_info"]["version"]
        why = find_stderr(notebook)
    except (CellControlSignal, RuntimeError) as error:  # a cell, its time, or the kernel
        if isinstance(error, CellExecutionError) and error.ename == "DataUnavailable":
            raise DataUnavailable(error.evalue) from error
        why = f"code cell {client.code_cells_executed}: {explain_failure(error)}"
    finally:
        atexit.unregister(client._cleanup_kernel)  # for a kernel ends by itself with this process
    if why:
        write_text(partial, nbformat.writes(notebook))
        raise NotebookFailed(f"{source.name}, {why}; what it got to is in {partial}")


def _leave_signals(notebook: NotebookNode) -> None:
    """Let a signal end this process, in place of what nbclient does at one."""
    for each in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().remove_signal_handler(each)


def find_stderr(notebook: NotebookNode) -> str:
    """Say what a cell says on stderr, where a student would see it; "" where none does."""
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    for number, cell in enumerate(code, 1):
        for output in cell.outputs:
            if output.get("name") == "stderr":
                line = output.text.strip().partition("\n")[0]
                return f"code cell {number}: it says on stderr: {line:.300}"
    return ""


def explain_failure(error: Exception) -> str:
    """Say in a line why a cell, or the kernel, did not end well."""
    if isinstance(error, DeadKernelError):
        return "the kernel died: killed, out of memory, or a crash in compiled code?"
    words = str(error)
    if isinstance(error, CellExecutionError):
        words = f"{error.ename}: {error.evalue}"
    return words.partition("\n")[0]
