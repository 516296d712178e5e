"""Execution of many notebooks, two at a time: one line of progress each, and nothing left behind."""

import json
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path

import psutil
from tqdm import tqdm

from replication.workbook import execution, provenance
from replication.workbook.files import QUICK, ROOT, write_json, write_text

SLOWEST = 5
AT_A_TIME = 2  # notebooks
INTERRUPTS = (signal.SIGINT, signal.SIGTERM)


@dataclass(frozen=True)
class Ending:
    """How a notebook ended: "done", "not run" (its data are not to be had) or "failed", and how long each cell took."""

    name: str
    how: str
    why: str = ""
    seconds: tuple[float, ...] = ()


def run(
    sources: Sequence[Path],
    quick: bool = False,
    stamps: Path | None = None,
    stall_s: float = execution.STALL_S,
    watched: int | None = None,
    destination: Path | None = None,
) -> list[Ending]:
    """Execute notebooks; one that fails does not keep the others from running."""
    destination = destination or (QUICK if quick else ROOT)
    _clear_staging(destination)
    # Noted, not raised: an exception in the middle of another line could leave a lock behind it closed.
    interrupted = threading.Event()
    previous = {number: signal.signal(number, lambda *_: interrupted.set()) for number in INTERRUPTS}
    pool, kernels, jobs = ThreadPoolExecutor(AT_A_TIME), set(), []
    try:
        for source in sources:
            jobs.append(pool.submit(_run_one, source, quick, destination, stamps, stall_s, kernels))
        left = set(jobs)
        while left:
            done, left = wait(left, timeout=0.5, return_when=FIRST_COMPLETED)
            for job in done:
                _say(job.result())
            if interrupted.is_set() or (watched and not _is_alive(watched)):
                raise KeyboardInterrupt
        return [job.result() for job in jobs]
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        while not all(job.done() for job in jobs):  # a kernel may be starting
            for group in tuple(kernels):
                execution.end_group(group)
            wait(jobs, timeout=0.2)
        for number, handler in previous.items():
            signal.signal(number, handler)


def _is_alive(process: int) -> bool:
    """Whether a process runs: a dead one that nobody has waited for does not."""
    try:
        return psutil.Process(process).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def _run_one(source, quick, destination, stamps, stall_s, kernels) -> Ending:
    """Execute a notebook, show its progress on a line of the terminal, and stamp it."""
    bar = tqdm(leave=False, disable=None, bar_format="{desc}")

    def progress(cell: int, cells: int, text: str) -> None:
        bar.set_description_str(f"{source.stem}: cell {cell} of {cells} {_counted(text)}")

    begun = time.time()
    try:
        seconds = execution.execute(source, quick, destination, stall_s=stall_s, kernels=kernels, progress=progress)
        if stamps:
            _stamp(stamps, source.stem, destination, begun)
        return Ending(source.stem, "done", seconds=tuple(seconds))
    except execution.NotebookNotRun as error:
        return Ending(source.stem, "not run", f"{error}; its last results stay as they are")
    except (execution.NotebookFailed, ValueError, OSError) as error:
        return Ending(source.stem, "failed", str(error))
    finally:
        bar.close()


def _counted(text: str) -> str:
    """Count and time left of a progress bar's last state."""
    found = re.findall(r"(\d+/\d+) \[[\d:]+<([\d:?]+)", text)
    return f"({found[-1][0]}, {found[-1][1]} left)" if found else ""


def _say(ending: Ending) -> None:
    said = {"done": f"{ending.name}: done in {sum(ending.seconds):.0f} s", "not run": ending.why}
    tqdm.write(said.get(ending.how, f"failed: {ending.why}"), file=sys.stderr)


def _stamp(stamps: Path, name: str, destination: Path, begun: float) -> None:
    """Leave what make needs: what the notebook depends on, and that it is done as of when it began."""
    outcome = json.loads((destination / "results" / "outcomes" / f"{name}.json").read_text(encoding="utf-8"))
    sources = list(outcome["made_from"]["sources"])
    write_text(stamps / f"{name}.d", provenance.dependencies(stamps.name, name, sources))
    write_text(stamps / f"{name}.done", "")
    os.utime(stamps / f"{name}.done", (begun, begun))  # a source that was changed meanwhile is newer


def _clear_staging(destination: Path) -> None:
    """Remove what a killed run left behind."""
    for folder in destination.glob(".staging-*"):
        shutil.rmtree(folder, ignore_errors=True)


def note_run(endings: Sequence[Ending]) -> None:
    """Keep what differs from run to run, times, machine and commit, in `results/run.json`, which git ignores."""
    commit = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False)
    seconds = {ending.name: round(sum(ending.seconds), 1) for ending in endings if ending.how == "done"}
    content = {"machine": platform.platform(), "cores": os.cpu_count(), "commit": commit.stdout.strip()}
    write_json(ROOT / "results" / "run.json", content | {"ended": time.strftime("%Y-%m-%d %H:%M"), "seconds": seconds})


def slowest_cells(endings: Sequence[Ending]) -> str:
    """Say which cells took longest."""
    cells = [(s, f"{e.name}, cell {k}") for e in endings for k, s in enumerate(e.seconds, start=1)]
    longest = sorted(cells, reverse=True)[:SLOWEST]
    return "slowest cells: " + "; ".join(f"{cell} ({seconds:.0f} s)" for seconds, cell in longest)
