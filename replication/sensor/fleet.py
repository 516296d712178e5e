"""Many logs: on all cores or on a Dask cluster, resumable, and no bad file stops the rest."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path

import pandas as pd
from joblib import Memory, Parallel, delayed
from tqdm import tqdm

from replication.methods.self_calibration import fit_joint
from replication.methods.shared_joint import share_joint
from replication.sensor.tables import UnusableLog
from replication.sensor.verdict import Estimate, Settings, as_row, estimate, prepared

SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".log", ".parquet", ".xlsx")
UNUSABLE = "unusable log: "
_DIED = "the process that read it died; is it too large for the memory?"
_WORTH_PROCESSES = 30  # fewer quick estimates take less time than starting processes

Row = dict[str, object]
Logs = dict[int, Path]


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


def estimate_or_reason(path: Path, settings: Settings) -> Row:
    """Estimate one log; a row that says why where that fails, in whatever way."""
    try:
        return as_row(estimate(path, settings))
    except UnusableLog as error:
        return _failed(path, settings, str(error))
    except Exception as error:  # one log must not stop a thousand others
        return _failed(path, settings, f"{path}: {type(error).__name__}: {error}")


def _failed(path: Path, settings: Settings, why: str) -> Row:
    line = " ".join(why.split())
    return as_row(Estimate(str(path), method=settings.calibration.method, warnings=(f"{UNUSABLE}{line}",)))


def run_fleet(
    paths: Sequence[Path],
    settings: Settings,
    jobs: int = -1,
    kept: Path | None = None,
    dask: str | None = None,
    quiet: bool | None = None,
) -> list[Row]:
    """Estimate many logs.

    Parameters
    ----------
    paths, settings : sequence of Path, Settings
        The logs, and how all of them are read and measured.
    jobs : int
        Processes; -1 for all cores where that is worth it.
    kept : Path, optional
        Folder in which answers are kept; those kept there of unchanged logs are not made again.
    dask : str, optional
        Address of a Dask scheduler whose workers see the logs, and that folder, under the same paths.
    quiet : bool, optional
        No progress bar; by default there is one if a person watches.

    Returns
    -------
    list of dict
        One row for each log, in their order: see `verdict.as_row`.
    """
    if jobs < 0 and len(paths) < _WORTH_PROCESSES and settings.calibration.method != "paper":
        jobs = 1
    answer = partial(_kept_answer, settings=settings, kept=kept)
    logs = dict(enumerate(paths))
    answers = _on_dask(logs, answer, dask) if dask else _on_this_machine(logs, answer, jobs)
    rows: dict[int, Row] = {}
    with tqdm(total=len(logs), unit="log", disable=quiet) as bar:
        for number, row in answers:
            rows[number] = row or _failed(paths[number], settings, f"{paths[number]}: {_DIED}")
            bar.update()
    return [rows[number] for number in logs]


def from_row(row: Row) -> Estimate:
    """Make the estimate of a row again."""
    return Estimate(**{name: tuple(value) if isinstance(value, list) else value for name, value in row.items()})


def as_table(rows: Sequence[Row]) -> pd.DataFrame:
    """Rows as a tidy table: intervals in two columns each, the first warning of "cannot tell" as the reason."""
    flat = []
    for row in rows:
        warnings = list(row["warnings"])
        reason = warnings.pop(0) if row["verdict"] == "cannot tell" else ""
        part: Row = {"file": row["file"], "verdict": row["verdict"], "reason": reason}
        for name, unit in (("amplitude", "rps"), ("backlash", "rad")):
            low, high = row[f"{name}_interval_{unit}"] or (None, None)
            part |= {f"{name}_{unit}": row[f"{name}_{unit}"], f"{name}_low_{unit}": low, f"{name}_high_{unit}": high}
        part |= {name: row[name] for name in ("rmse_rps", "method", "turn_period_s", "samples")}
        part |= {name: row[name] for name in ("ring_hz", "damping_ratio", "friction_share")}
        flat.append(part | {"warnings": "; ".join(warnings)})
    table = pd.DataFrame(flat)
    numbers = [name for name in table if name.endswith(("_rps", "_rad", "_s", "_hz", "_ratio", "_share"))]
    return table.astype(dict.fromkeys(numbers, float))


def with_shared_joint(logs: Sequence[Path], rows: Sequence[Row], settings: Settings) -> list[Row]:
    """Correct estimates by method self by what all logs tell of their joint; rows without a backlash stay."""
    answered = [k for k, row in enumerate(rows) if row["verdict"] == "backlash"]
    fits = [fit_joint(prepared(logs[k], settings.form, settings.seed, [])[0]) for k in answered]
    corrected = list(rows)
    for k, (delta, interval) in zip(answered, share_joint(fits) if fits else [], strict=True):
        corrected[k] = rows[k] | {"backlash_rad": delta, "backlash_interval_rad": list(interval)}
    return corrected


# ---------------------------------------------------------------------------------------------------------------
# Answers that are kept


def _kept_answer(path: Path, settings: Settings, kept: Path | None) -> Row:
    return Memory(kept, verbose=0).cache(_answer, ignore=["path", "settings"])(path, settings, _key(path, settings))


def _answer(path: Path, settings: Settings, key: str) -> Row:
    """Answer for the log in the state, and with the settings, that the key stands for."""
    return estimate_or_reason(path, settings)


def _key(path: Path, settings: Settings) -> str:
    """Name of one log in its present state under these settings."""
    try:
        status = path.stat()
        state = f"{status.st_size} {status.st_mtime_ns}"
    except OSError:
        state = "missing"
    whole = "\n".join(
        [str(path.resolve()), state, repr(settings.form), settings.calibration.to_json(), str(settings.is_own),
         f"{settings.repeats} {settings.seed}"]
    )  # fmt: skip
    return hashlib.sha256(whole.encode()).hexdigest()


# ---------------------------------------------------------------------------------------------------------------
# Where the work is done; a log on which a process dies has no row


def _on_this_machine(logs: Logs, answer: Callable[[Path], Row], jobs: int) -> Iterator[tuple[int, Row | None]]:
    """Run on processes of this machine.

    One that dies takes the others with it and does not say on which log: what is left is tried again in halves.
    """
    left = dict(logs)
    try:
        numbered = (delayed(_numbered)(number, path, answer) for number, path in logs.items())
        for number, row in Parallel(n_jobs=jobs, return_as="generator_unordered")(numbered):
            del left[number]
            yield number, row
    except BrokenProcessPool:
        numbers = list(left)
        if len(numbers) == 1:
            yield numbers[0], None
            return
        for half in (numbers[::2], numbers[1::2]):
            yield from _on_this_machine({number: left[number] for number in half}, answer, jobs)


def _numbered(number: int, path: Path, answer: Callable[[Path], Row]) -> tuple[int, Row]:
    return number, answer(path)


def _on_dask(logs: Logs, answer: Callable[[Path], Row], address: str) -> Iterator[tuple[int, Row | None]]:
    """Run on a Dask cluster, which runs the tasks of a worker that dies again elsewhere.

    Not as joblib's backend: joblib 1.6 waits for ever for a task that Dask has given up.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise UnusableLog("--dask needs Dask: pip install 'backlash-replication[fleet]'") from error
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError, TypeError) as error:
        raise UnusableLog(f"--dask {address}: no scheduler answers there ({type(error).__name__})") from error
    with client:
        numbers = dict(zip(client.map(answer, list(logs.values()), pure=False), logs, strict=True))
        for future in as_completed(numbers):
            yield numbers[future], None if future.exception() else future.result()
