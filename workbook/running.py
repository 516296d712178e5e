"""Execution of many notebooks, two at a time, with nothing left behind."""

import contextlib
import json
import os
import platform
import shutil
import signal
import sys
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import psutil
from tqdm import tqdm

from replication.files import ROOT, write_json, write_text
from workbook import due, execution
from workbook.checkout import OFFLINE, RESULTS

INTERRUPTS = (signal.SIGINT, signal.SIGTERM)


@dataclass(frozen=True)
class Ending:
    """How a notebook ended, "done", "simulated" (on our records), "not run" or "failed", and after how long."""

    name: str
    how: str
    seconds: float


def run_notebooks(
    sources: Sequence[Path],
    destination: Path,
    quick: bool = False,
    stall_s: float = execution.STALL_S,
    watched: int | None = None,
) -> list[Ending]:
    """Execute notebooks, until the process `watched` is gone; one that fails stops no other."""
    for folder in (destination, _offline(destination)):
        for left_by_a_killed_run in folder.glob(".staging-*"):
            shutil.rmtree(left_by_a_killed_run, ignore_errors=True)
    # Noted, not raised: an exception in the middle of another line could leave a lock behind closed.
    interrupted = threading.Event()
    previous = {
        number: signal.signal(number, lambda *_: interrupted.set()) for number in INTERRUPTS
    }
    pool = ThreadPoolExecutor(max_workers=2)
    run_one = partial(_run_one, destination=destination, quick=quick, stall_s=stall_s)
    jobs = [pool.submit(run_one, source) for source in sources]
    try:
        while not all(job.done() for job in jobs):
            wait(jobs, timeout=0.5)
            ancestors = [process.pid for process in psutil.Process().parents()]
            if interrupted.is_set() or (watched and watched not in ancestors):
                raise KeyboardInterrupt
        return [job.result() for job in jobs]
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        while not all(job.done() for job in jobs):  # a kernel may be starting
            for process in psutil.Process().children(recursive=True):
                with contextlib.suppress(psutil.NoSuchProcess):
                    process.kill()
            wait(jobs, timeout=0.2)
        for number, handler in previous.items():
            signal.signal(number, handler)


def _offline(destination: Path) -> Path:
    """Where what is made on our simulated records goes."""
    return destination / OFFLINE.relative_to(ROOT)


def _run_one(source: Path, destination: Path, quick: bool, stall_s: float) -> Ending:
    """Execute a notebook, note that it has run, and say how it ended."""
    begun = time.time()
    try:
        try:
            execution.execute(source, destination, quick, stall_s=stall_s)
            write_text(due.marker(source.stem, destination), "")
            how, where = "done", ""
        except execution.NotebookNotRun:
            apart = destination if quick else _offline(destination)
            execution.execute(source, apart, quick, stall_s=stall_s, records="simulated")
            how, where = "simulated", " on our simulated records"
        line = f"{source.stem}: done{where} in {time.time() - begun:.0f} s"
    except execution.NotebookNotRun as missing:  # nothing takes the place of its data
        how, line = "not run", f"{missing}; its committed results stay"
    except (execution.NotebookFailed, ValueError, OSError) as error:
        how, line = "failed", f"{source.stem}: failed: {error}"
    tqdm.write(line, file=sys.stderr)
    return Ending(source.stem, how, time.time() - begun)


def note_run(endings: Sequence[Ending]) -> None:
    """Keep what differs from run to run in `results/run.json`, which git ignores."""
    path = RESULTS / "run.json"
    seconds = json.loads(path.read_text(encoding="utf-8"))["seconds"] if path.exists() else {}
    seconds |= {ending.name: round(ending.seconds, 1) for ending in endings if ending.how == "done"}
    write_json(path, {"machine": platform.machine(), "cores": os.cpu_count(), "seconds": seconds})
