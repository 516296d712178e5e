"""Many logs on all cores: resumable, and no bad file stops the rest."""

import signal
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from operator import itemgetter
from pathlib import Path

import pandas as pd

from backlash.estimation import Estimate, Settings, examine
from backlash.fitting.self_calibration import fit_joint
from backlash.fitting.shared_joint import share_joint
from backlash.logs import Log, name_of, open_log
from backlash.reading.columns import LogFormat
from backlash.reading.detect import detect_pattern
from backlash.refusals import UnusableLog

SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".log", ".gz", ".parquet", ".xlsx")
UNUSABLE = "unusable log: "
_DIED = "the process that read it died; is it too large for the memory?"
_WORTH_PROCESSES = 30  # fewer quick estimates take less time than starting processes


def find_logs(paths: Sequence[Path], left_out: Path | None = None) -> list[Path]:
    """Logs that files and folders stand for, folders with all below them, each once; an empty folder is refused.

    A table of earlier answers, `left_out`, is no log.
    """
    found: dict[Path, Path] = {}
    for path in paths:
        inside = [path]
        if path.is_dir():
            inside = sorted(
                file for file in path.rglob("*")
                if file.suffix.lower() in SUFFIXES and not file.name.startswith(".") and file.is_file()
            )  # fmt: skip
            if not inside:
                raise UnusableLog(f"{path}: no logs in this folder; they end in {', '.join(SUFFIXES)}")
        for file in inside:
            found.setdefault(file.resolve(), file)
    if left_out is not None:
        found.pop(left_out.resolve(), None)
    if not found:
        raise UnusableLog(f"{left_out}: no log, a table of answers")
    return list(found.values())


def run_fleet(
    logs: Sequence[object], settings: Settings | Sequence[Settings], jobs: int = -1, kept: Path | None = None
) -> list[Estimate]:
    """Estimate many logs, answers in their order; of a log that cannot be used the first warning says why.

    Settings are those of all logs, or one for each; answers are kept in a folder, for a run that goes on where another
    was interrupted. By itself it takes all cores (-1 jobs) where that is worth it.
    """
    from tqdm import tqdm

    if jobs == 0 or jobs < -1:
        raise UnusableLog(f"--jobs {jobs}: give -1 or a number above 0")
    each = [settings] * len(logs) if isinstance(settings, Settings) else settings
    quick = len(logs) < _WORTH_PROCESSES and all(how.calibration.method != "paper" for how in each)
    tasks = dict(enumerate(zip(logs, each, strict=True)))
    found = _in_processes(tasks, 1 if jobs < 0 and quick else jobs, kept)
    answers = tqdm(found, total=len(tasks), unit="log", disable=None)
    return [answer for _, answer in sorted(answers, key=itemgetter(0))]


def _in_processes(
    tasks: Mapping[int, tuple[object, Settings]], jobs: int, kept: Path | None
) -> Iterator[tuple[int, Estimate]]:
    """Answer for each numbered log, in any order.

    A process that dies takes the others with it and does not say on which log: what is left is tried again in halves.
    """
    from multiprocessing import resource_tracker

    from joblib import Parallel, delayed

    left = dict(tasks)
    try:
        calls = (delayed(_kept_answer)(number, *task, kept) for number, task in tasks.items())
        # Processes inherit that Ctrl-C is held back: this one ends them. To start the tracker would let it go.
        resource_tracker.ensure_running()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            answers = Parallel(n_jobs=jobs, return_as="generator_unordered")(calls)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for number, answer in answers:
            del left[number]
            yield number, answer
    except BrokenProcessPool:
        if len(left) == 1:
            [(number, (path, settings))] = left.items()
            yield number, _failed(path, settings, f"{path}: {_DIED}")
            return
        again = list(left.items())
        for half in (again[::2], again[1::2]):
            yield from _in_processes(dict(half), jobs, kept)


def _kept_answer(number: int, log: object, settings: Settings, kept: Path | None) -> tuple[int, Estimate]:
    """Answer for a log in its present state under these settings, kept under a name made of both."""
    if kept is None:
        return number, answer_or_refusal(log, settings)
    import joblib

    path = Path(name_of(log))
    status = path.stat() if path.exists() else None
    state = (status.st_size, status.st_mtime_ns) if status else None
    how = vars(settings) | {"calibration": settings.calibration.to_json()}
    key = joblib.hash(repr((path.resolve(), state, how)))
    remembered = joblib.Memory(kept, verbose=0).cache(answer_or_refusal, ignore=["log", "settings"])
    return number, replace(remembered(path, settings, key), file=str(path))


def answer_or_refusal(log: object, settings: Settings, key: str = "") -> Estimate:
    """Estimate one log; say why where that fails, in whatever way; `key` is what it is kept under."""
    try:
        return examine(log, settings).estimate
    except UnusableLog as error:
        return _failed(log, settings, str(error))
    except Exception as error:  # one log must not stop a thousand others
        if isinstance(error.__cause__ or error.__context__, KeyboardInterrupt):  # what compiled code makes of Ctrl-C
            raise KeyboardInterrupt from error
        return _failed(log, settings, f"{name_of(log)}: {type(error).__name__}: {error}")


def _failed(log: object, settings: Settings, why: str) -> Estimate:
    return Estimate(name_of(log), method=settings.calibration.method, warnings=(UNUSABLE + " ".join(why.split()),))


def as_table(answers: Sequence[Estimate]) -> pd.DataFrame:
    """Answers as a tidy table: intervals in two columns each, the first warning of "cannot tell" as the reason."""
    table = pd.DataFrame([answer.to_dict() for answer in answers])
    table.pop("backlash_intervals_rad")  # a warning names them
    refused = table["verdict"] == "cannot tell"
    table.insert(2, "reason", table["warnings"].str[0].where(refused, ""))
    table["warnings"] = table["warnings"].where(~refused, table["warnings"].str[1:]).str.join("; ")
    for place, name in reversed([*enumerate(table)]):
        if "_interval_" in name:
            ends = table.pop(name)
            for k, end in ((1, "high"), (0, "low")):
                table.insert(place, name.replace("interval", end), ends.str[k])
    numbers = [name for name in table if name.endswith(("_rps", "_rad", "_s", "_hz", "_ratio", "_share"))]
    return table.astype(dict.fromkeys(numbers, float))


def with_shared_joint(
    logs: Sequence[object], answers: Sequence[Estimate], settings: Sequence[Settings]
) -> list[Estimate]:
    """Correct estimates by method self by what all logs tell of their joint.

    Those without a backlash stay, and those with separate intervals: one log alone cannot choose between them.
    """
    answered = [
        k for k, answer in enumerate(answers) if answer.verdict == "backlash" and not answer.backlash_intervals_rad
    ]
    fits = [fit_joint(prepare_log(logs[k], settings[k].form, settings[k].seed).recording) for k in answered]
    corrected = list(answers)
    for k, (delta, interval) in zip(answered, share_joint(fits) if fits else [], strict=True):
        corrected[k] = replace(answers[k], backlash_rad=delta, backlash_interval_rad=interval)
    return corrected


def prepare_log(source: object, form: LogFormat, seed: int) -> Log:
    """Read a log as `examine` does, up to the pattern that must be found in it."""
    log = open_log(source, form)
    return replace(log, recording=detect_pattern(log.recording, log.form, seed)[0])
