"""Many logs on all cores: resumable, and no bad file stops the rest."""

import os
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from operator import itemgetter
from pathlib import Path

import pandas as pd

from backlash.answers import Estimate
from backlash.examine import Examined, examine
from backlash.fitting.shared_joint import share_joint
from backlash.reading.refusals import UnusableLog
from backlash.reading.sources import name_of
from backlash.settings import Settings

SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".log", ".gz", ".parquet", ".xlsx")
UNUSABLE = "unusable log: "
_DIED = "the process that read it died; is it too large for the memory?"
_WORTH_PROCESSES = 30  # fewer quick estimates take less time than starting processes


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
                raise UnusableLog(
                    f"{path}: no logs in this folder; they end in {', '.join(SUFFIXES)}"
                )
        for file in inside:
            found.setdefault(os.path.realpath(file), file)
    if left_out is not None:
        found.pop(os.path.realpath(left_out), None)
    if not found:
        raise UnusableLog(f"{left_out}: no log, a table of answers")
    return list(found.values())


def _is_log(file: Path) -> bool:
    return file.suffix.lower() in SUFFIXES and not file.name.startswith(".") and file.is_file()


def run_fleet(
    logs: Sequence[object],
    settings: Settings | Sequence[Settings],
    jobs: int = -1,
    kept: Path | None = None,
) -> list[Estimate]:
    """Estimate many logs, answers in their order; of a log that cannot be used the first warning says why.

    Settings are those of all logs, or one for each; answers are kept in a folder, for a run that
    goes on where another was interrupted. By itself it takes all cores (-1 jobs) where that is
    worth it.
    """
    each = [settings] * len(logs) if isinstance(settings, Settings) else settings
    return [
        examined.estimate
        for examined in examine_fleet(logs, each, jobs, partial(_answer, kept=kept))
    ]


def examine_or_refuse(log: object, settings: Settings) -> Examined:
    """Examine one log; say why where that fails, in whatever way."""
    try:
        return examine(log, settings)
    except UnusableLog as error:
        return _failed(log, settings, str(error))
    except Exception as error:  # one log must not stop a thousand others
        # What compiled code makes of Ctrl-C.
        if isinstance(error.__cause__ or error.__context__, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        return _failed(log, settings, f"{name_of(log)}: {type(error).__name__}: {error}")


def _failed(log: object, settings: Settings, why: str) -> Examined:
    line = UNUSABLE + " ".join(why.split())
    return Examined(Estimate(name_of(log), method=settings.calibration.method, warnings=(line,)))


def _answer(log: object, settings: Settings, kept: Path | None) -> Examined:
    """The answer alone for a log in its present state, kept under a name made of that and the settings."""
    if kept is None:
        return Examined(estimate_or_refuse(log, settings))
    import joblib

    path = Path(os.path.realpath(name_of(log)))
    status = path.stat() if path.exists() else None
    state = (status.st_size, status.st_mtime_ns) if status else None
    how = vars(settings) | {"calibration": settings.calibration.to_json()}
    key = joblib.hash(repr((path, state, how)))
    remembered = joblib.Memory(kept, verbose=0).cache(
        estimate_or_refuse, ignore=["log", "settings"]
    )
    return Examined(replace(remembered(path, settings, key), file=str(path)))


def estimate_or_refuse(log: object, settings: Settings, key: str = "") -> Estimate:
    """Estimate one log; `key` is what the answer is kept under."""
    return examine_or_refuse(log, settings).estimate


def examine_fleet(
    logs: Sequence[object],
    settings: Sequence[Settings],
    jobs: int,
    task: Callable[[object, Settings], Examined] = examine_or_refuse,
) -> list[Examined]:
    """Examine many logs, each with its settings."""
    from tqdm import tqdm

    if jobs == 0 or jobs < -1:
        raise UnusableLog(f"--jobs {jobs}: give -1 or a number above 0")
    searches = any(how.calibration.method == "paper" for how in settings)
    is_quick = len(logs) < _WORTH_PROCESSES and not searches
    calls = dict(enumerate(zip(logs, settings, strict=True)))
    found = _in_processes(task, calls, 1 if jobs < 0 and is_quick else jobs)
    in_any_order = tqdm(found, total=len(calls), unit="log", disable=None)
    return [examined for _, examined in sorted(in_any_order, key=itemgetter(0))]


def _in_processes(
    task: Callable[[object, Settings], Examined],
    calls: Mapping[int, tuple[object, Settings]],
    jobs: int,
) -> Iterator[tuple[int, Examined]]:
    """Examine each numbered log, in any order.

    A process that dies takes the others with it and does not say on which log: what is left is
    tried again in halves.
    """
    from multiprocessing import resource_tracker

    from joblib import Parallel, delayed

    left = dict(calls)
    try:
        numbered = (delayed(_numbered)(number, task, *call) for number, call in calls.items())
        # Processes inherit that Ctrl-C is held back: this one ends them. To start the tracker would
        # let it go.
        resource_tracker.ensure_running()
        with _ctrl_c_held_back():
            found = Parallel(n_jobs=jobs, return_as="generator_unordered")(numbered)
        for number, examined in found:
            del left[number]
            yield number, examined
    except BrokenProcessPool:
        if len(left) == 1:
            [(number, (log, settings))] = left.items()
            yield number, _failed(log, settings, f"{log}: {_DIED}")
            return
        again = list(left.items())
        for half in (again[::2], again[1::2]):
            yield from _in_processes(task, dict(half), jobs)


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


def _numbered(number: int, task: Callable[..., Examined], *call: object) -> tuple[int, Examined]:
    return number, task(*call)


def unusable(answer: Estimate) -> str:
    """Why a log cannot be used; empty if it can."""
    first = "".join(answer.warnings[:1])
    return first.removeprefix(UNUSABLE) if first.startswith(UNUSABLE) else ""


def as_table(answers: Sequence[Estimate]) -> pd.DataFrame:
    """Answers as a tidy table: intervals in two columns each, the first warning of "cannot tell" as the reason."""
    table = pd.DataFrame([answer.to_dict() for answer in answers])
    table["file"] = table["file"].str.replace(r"^(?=[=+@-])", "'", regex=True)  # no formula
    table.pop("backlash_intervals_rad")  # a warning names them
    refused = table["verdict"] == "cannot tell"
    table.insert(2, "reason", table["warnings"].str[0].where(refused, ""))
    table["warnings"] = table["warnings"].where(~refused, table["warnings"].str[1:]).str.join("; ")
    for place, name in reversed([*enumerate(table)]):
        if "_interval_" in name:
            ends = table.pop(name)
            for k, end in ((1, "high"), (0, "low")):
                table.insert(place, name.replace("interval", end), ends.str[k])
    numbers = [
        name for name in table if name.endswith(("_rps", "_rad", "_s", "_hz", "_ratio", "_share"))
    ]
    return table.astype(dict.fromkeys(numbers, float))


def with_shared_joint(examined: Sequence[Examined]) -> list[Estimate]:
    """Correct estimates by method self by what all logs tell of their joint.

    Those without a backlash stay, and those with separate intervals: one log alone cannot choose
    between them.
    """
    answers = [each.estimate for each in examined]
    joints = {
        k: each.fitted.joint
        for k, each in enumerate(examined)
        if each.estimate.verdict == "backlash"
        and not each.estimate.backlash_intervals_rad
        and each.fitted
    }
    fits = [joint for joint in joints.values() if joint is not None]
    corrected = share_joint(fits) if fits else []
    for k, (delta, interval) in zip(joints, corrected, strict=True):
        answers[k] = replace(answers[k], backlash_rad=delta, backlash_interval_rad=interval)
    return answers
