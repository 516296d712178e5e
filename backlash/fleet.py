"""Many logs on all cores: resumable, and no bad file stops the rest."""

import json
import os
import re
import signal
import threading
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from backlash import __version__
from backlash.answers import Estimate
from backlash.examine import Examined, examine
from backlash.fitting import SELF
from backlash.reading.batch import escape
from backlash.reading.sources import name_of
from backlash.refusals import Refusal, one_line
from backlash.settings import Settings

SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".log", ".gz", ".parquet", ".xlsx")
UNUSABLE = "unusable log: "
_DIED = "the process that read it died; is it too large for the memory?"
_KEPT = '{"kept by": "backlash estimate, to go on from"}\n'
_WORTH_PROCESSES = 30  # fewer quick estimates take less time than starting processes

_NOT_SAID = (np.nan, np.nan)

# Logs by their numbers, each with its settings, or why what is said of it cannot be.
Calls = Mapping[int, tuple[object, Settings | Refusal]]


def find_logs(paths: Sequence[Path], left_out: Path | None = None) -> list[Path]:
    """Logs that files and folders stand for, folders with all below them, each once; an empty folder is refused.

    A table of earlier answers, `left_out`, is no log.
    """
    found: dict[str, Path] = {}
    for path in paths:
        inside = [path]
        if path.is_dir():
            inside = sorted(file for file in path.rglob("*") if _is_log(file))
            if not inside:
                raise Refusal(f"{path}: no logs in this folder; they end in {', '.join(SUFFIXES)}")
        for file in inside:
            found.setdefault(os.path.realpath(file), file)
    if left_out:
        found.pop(os.path.realpath(left_out), None)
    if not found:
        raise Refusal(f"{left_out}: no log, a table of answers")
    return list(found.values())


def _is_log(file: Path) -> bool:
    return file.suffix.lower() in SUFFIXES and not file.name.startswith(".") and file.is_file()


def run_fleet(
    logs: Sequence[object],
    settings: Sequence[Settings | Refusal],
    jobs: int = -1,
    kept: Path | None = None,
    plots: Path | None = None,
) -> Iterator[tuple[int, Estimate]]:
    """Examine many logs; their numbers and answers come in any order.

    Of a log that cannot be used the first warning says why. Answers are kept in a file, for a run
    that goes on where another was interrupted. By itself it takes all cores (-1 jobs) where that is
    worth it. Into the folder `plots` goes a figure of each log with a fit.
    """
    calls = dict(enumerate(zip(logs, settings, strict=True)))
    known = read_kept(kept) if kept else {}
    keys = {number: _key(*call) for number, call in calls.items() if kept}
    for number, key in keys.items():
        if key in known:
            yield number, replace(known[key], file=name_of(calls.pop(number)[0]))
    with kept.open("a", encoding="utf-8") if kept else nullcontext() as file:
        for number, answer in _in_any_order(calls, jobs, plots):
            # Handed over first: where the disk is full, the answer is not lost.
            yield number, answer
            if file:
                file.write("\n" if file.tell() else _KEPT)
                file.write(json.dumps({"key": keys[number], **vars(answer)}))
                file.flush()


def _key(log: object, settings: Settings | Refusal) -> str:
    """What the answer on a log in its present state is kept under."""
    import joblib

    path = Path(os.path.realpath(name_of(log)))
    state = (path.stat().st_size, path.stat().st_mtime_ns) if path.exists() else None
    how: object = str(settings)
    if isinstance(settings, Settings):
        how = vars(settings) | {"calibration": settings.calibration.to_json()}
    return joblib.hash(repr((__version__, path, state, how)))


def read_kept(kept: Path) -> dict[str, Estimate]:
    """Answers that an interrupted run kept, by their keys; a last line may be torn."""
    text = kept.read_text("utf-8", "replace") if kept.exists() else ""
    if kept.is_symlink() or not (text or _KEPT).startswith(_KEPT):
        raise Refusal(f"{kept}: holds no answers of a run before; name another --out")
    found = {}
    for line in text.splitlines()[1:]:
        with suppress(ValueError, TypeError, KeyError):
            row = {name: _as_tuple(value) for name, value in json.loads(line).items()}
            key = row.pop("key")
            found[key] = Estimate(**row)
    return found


def _as_tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def examine_or_refuse(log: object, settings: Settings | Refusal) -> Examined:
    """Examine one log; say why where that fails, in whatever way."""
    try:
        if isinstance(settings, Refusal):
            raise settings
        return examine(log, settings)
    except Refusal as error:
        return Examined(_failed(log, settings, str(error)))
    except Exception as error:  # one log must not stop a thousand others
        # What compiled code makes of Ctrl-C.
        if isinstance(error.__cause__ or error.__context__, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        why = f"{name_of(log)}: {type(error).__name__}: {error}"
        return Examined(_failed(log, settings, why))


def _failed(log: object, settings: Settings | Refusal, why: str) -> Estimate:
    method = settings.calibration.method if isinstance(settings, Settings) else SELF
    return Estimate(name_of(log), method=method, warnings=(UNUSABLE + " ".join(why.split()),))


def _in_any_order(calls: Calls, jobs: int, plots: Path | None) -> Iterator[tuple[int, Estimate]]:
    from tqdm import tqdm

    if jobs == 0 or jobs < -1:
        raise Refusal(f"--jobs {jobs}: give -1 or a number above 0")
    searches = any(
        isinstance(how, Settings) and how.calibration.method == "paper" for _, how in calls.values()
    )
    if jobs < 0 and len(calls) < _WORTH_PROCESSES and not searches:
        jobs = 1
    each = _examine_each(calls, jobs, plots)
    yield from tqdm(each, total=len(calls), unit="log", disable=None, leave=False)


def _examine_each(calls: Calls, jobs: int, plots: Path | None) -> Iterator[tuple[int, Estimate]]:
    """Examine each numbered log.

    A process that dies takes others with it and does not say on which log: what is left is tried
    again in halves.
    """
    left = dict(calls)
    for number, answer in _by_joblib(calls, jobs, plots):
        del left[number]
        yield number, answer
    if len(left) == 1:
        [(number, (log, settings))] = left.items()
        yield number, _failed(log, settings, f"{name_of(log)}: {_DIED}")
    elif left:
        again = list(left.items())
        for half in (again[::2], again[1::2]):
            yield from _examine_each(dict(half), jobs, plots)


def _by_joblib(calls: Calls, jobs: int, plots: Path | None) -> Iterator[tuple[int, Estimate]]:
    """Examine logs by joblib's backend, as far as no process of this machine dies."""
    from multiprocessing import resource_tracker

    from joblib import Parallel, delayed

    # Of a run that stops on a full disk; it says so itself.
    warnings.filterwarnings("ignore", r"\d+ tasks which were", UserWarning)
    numbered = (delayed(_numbered)(k, *call, plots) for k, call in calls.items())
    how = {"n_jobs": jobs, "initializer": _end_with, "initargs": (os.getpid(),)}
    try:
        parallel = Parallel(return_as="generator_unordered", **how)
    except ValueError:  # a backend that gives lists only, like Ray's
        parallel = Parallel(**how)
    # Processes inherit that Ctrl-C is held back: this one ends them. To start the tracker would let
    # it go.
    resource_tracker.ensure_running()
    with suppress(BrokenProcessPool):
        with _ctrl_c_held_back():
            found = parallel(numbered)
        yield from found


@contextmanager
def _ctrl_c_held_back() -> Iterator[None]:
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _numbered(
    number: int, log: object, settings: Settings | Refusal, plots: Path | None
) -> tuple[int, Estimate]:
    with warnings.catch_warnings(action="ignore"):  # of libraries, in a process of its own
        examined = examine_or_refuse(log, settings)
        if plots:
            name = re.sub(r"\W", "_", Path(name_of(log)).stem)[:100]
            plot(examined, plots / f"{number + 1:05d}_{name}.png")
    return number, examined.estimate


def plot(examined: Examined, path: Path) -> bool:
    """Write a figure of a log, if it has a fit."""
    fitted = examined.fitted
    if fitted is None:
        return False
    from backlash import plots

    name = one_line(examined.estimate.file)
    title = str(examined.estimate).splitlines()[0].removeprefix(f"{name}: ")
    plots.save_figure(plots.estimate_figure(fitted.recording, fitted.model_rps, title), path)
    return True


def _end_with(parent: int) -> None:
    """End this process soon after its parent, which may be killed without a word."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def unusable(answer: Estimate) -> str:
    """Why a log cannot be used; empty if it can."""
    first = "".join(answer.warnings[:1])
    return first.removeprefix(UNUSABLE) if first.startswith(UNUSABLE) else ""


def as_table(answers: Sequence[Estimate]) -> pd.DataFrame:
    """Answers as a tidy table: intervals in two columns each, the first warning of "cannot tell" as the reason."""
    return pd.DataFrame([_row(answer) for answer in answers])


def _row(answer: Estimate) -> dict[str, object]:
    refused = answer.verdict == "cannot tell"
    row: dict[str, object] = {
        "file": escape(answer.file),
        "verdict": answer.verdict,
        "reason": "".join(answer.warnings[:refused]),
    }
    whole: dict[str, Any] = answer.to_dict() | {"warnings": "; ".join(answer.warnings[refused:])}
    for name, value in whole.items():
        if "_interval_" in name:
            for end, each in zip(("low", "high"), value or _NOT_SAID, strict=True):
                row[name.replace("interval", end)] = each
        else:
            row.setdefault(name, np.nan if value is None else value)
    return row
