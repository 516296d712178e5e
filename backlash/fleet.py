"""Many logs on all cores: resumable, and no bad file stops the rest."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

import pandas as pd

from backlash.estimation import Estimate, Settings, estimate, prepared_record
from backlash.fitting.self_calibration import fit_joint
from backlash.fitting.shared_joint import share_joint
from backlash.reading.tables import UnusableLog

SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".log", ".parquet", ".xlsx")
UNUSABLE = "unusable log: "
_DIED = "the process that read it died; is it too large for the memory?"
_WORTH_PROCESSES = 30  # fewer quick estimates take less time than starting processes
_COLUMNS = [
    "file", "verdict", "reason", "amplitude_rps", "amplitude_low_rps", "amplitude_high_rps", "backlash_rad",
    "backlash_low_rad", "backlash_high_rad", "rmse_rps", "method", "turn_period_s", "samples", "ring_hz",
    "damping_ratio", "friction_share", "warnings",
]  # fmt: skip


def find_logs(paths: Sequence[Path]) -> list[Path]:
    """Logs that files and folders stand for, folders with all below them, each once; an empty folder is refused."""
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
    return list(found.values())


def run_fleet(paths: Sequence[Path], settings: Settings, jobs: int = -1, kept: Path | None = None) -> list[Estimate]:
    """Estimate many logs, answers in their order; of a log that cannot be used the first warning says why.

    Parameters
    ----------
    paths : sequence of Path
        The logs.
    settings : Settings
        From `settings_for`, for all of them.
    jobs : int
        Processes; -1 for all cores where that is worth it.
    kept : Path, optional
        Folder of answers, for a run that goes on where another was interrupted.
    """
    from tqdm import tqdm

    if jobs < 0 and len(paths) < _WORTH_PROCESSES and settings.calibration.method != "paper":
        jobs = 1
    answers = tqdm(_in_processes(paths, settings, jobs, kept), total=len(paths), unit="log", disable=None)
    found = {answer.file: answer for answer in answers}
    return [found[str(path)] for path in paths]


def _in_processes(paths: Sequence[Path], settings: Settings, jobs: int, kept: Path | None) -> Iterator[Estimate]:
    """Answer for each log, in any order.

    A process that dies takes the others with it and does not say on which log: what is left is tried again in halves.
    """
    from joblib import Parallel, delayed

    left = {str(path): path for path in paths}
    try:
        tasks = (delayed(_kept_answer)(path, settings, kept) for path in paths)
        for answer in Parallel(n_jobs=jobs, return_as="generator_unordered")(tasks):
            left.pop(answer.file, None)
            yield answer
    except BrokenProcessPool:
        again = list(left.values())
        if len(again) == 1:
            yield _failed(again[0], settings, f"{again[0]}: {_DIED}")
            return
        for half in (again[::2], again[1::2]):
            yield from _in_processes(half, settings, jobs, kept)


def _kept_answer(path: Path, settings: Settings, kept: Path | None) -> Estimate:
    """Answer for a log in its present state under these settings, kept under a name made of both."""
    import joblib

    status = path.stat() if os.path.exists(path) else None
    state = (status.st_size, status.st_mtime_ns) if status else None
    how = vars(settings) | {"calibration": settings.calibration.to_json()}
    key = joblib.hash(repr((path.resolve(), state, how)))
    answer = joblib.Memory(kept, verbose=0).cache(_answer, ignore=["path", "settings"])(path, settings, key)
    return replace(answer, file=str(path))


def _answer(path: Path, settings: Settings, key: str) -> Estimate:
    """Estimate one log; say why where that fails, in whatever way; `key` is what it is kept under."""
    try:
        return estimate(path, settings)
    except UnusableLog as error:
        return _failed(path, settings, str(error))
    except Exception as error:  # one log must not stop a thousand others
        return _failed(path, settings, f"{path}: {type(error).__name__}: {error}")


def _failed(path: Path, settings: Settings, why: str) -> Estimate:
    return Estimate(str(path), method=settings.calibration.method, warnings=(UNUSABLE + " ".join(why.split()),))


def as_table(answers: Sequence[Estimate]) -> pd.DataFrame:
    """Answers as a tidy table: intervals in two columns each, the first warning of "cannot tell" as the reason."""
    table = pd.DataFrame([vars(answer) for answer in answers])
    refused = table["verdict"] == "cannot tell"
    reason = table["warnings"].str[0].where(refused, "")
    notes = table["warnings"].where(~refused, table["warnings"].str[1:]).str.join("; ")
    for name, unit in (("amplitude", "rps"), ("backlash", "rad")):
        for k, end in enumerate(("low", "high")):
            table[f"{name}_{end}_{unit}"] = table[f"{name}_interval_{unit}"].str[k]
    table = table.assign(reason=reason, warnings=notes)[_COLUMNS]
    numbers = [name for name in table if name.endswith(("_rps", "_rad", "_s", "_hz", "_ratio", "_share"))]
    return table.astype(dict.fromkeys(numbers, float))


def with_shared_joint(logs: Sequence[Path], answers: Sequence[Estimate], settings: Settings) -> list[Estimate]:
    """Correct estimates by method self by what all logs tell of their joint; those without a backlash stay."""
    answered = [k for k, answer in enumerate(answers) if answer.verdict == "backlash"]
    fits = [fit_joint(prepared_record(logs[k], settings.form, settings.seed)) for k in answered]
    corrected = list(answers)
    for k, (delta, interval) in zip(answered, share_joint(fits) if fits else [], strict=True):
        corrected[k] = replace(answers[k], backlash_rad=delta, backlash_interval_rad=interval)
    return corrected
