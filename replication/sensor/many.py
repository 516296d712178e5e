"""Many logs: on all cores or on a Dask cluster, resumable, and no bad file stops the rest.

Each finished log is a line of a journal beside the table, so that what was done is kept whatever happens; the table
itself is written whole at the end, and the journal removed.
"""

import hashlib
import json
import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pandas as pd
from joblib import Parallel, delayed, effective_n_jobs
from tqdm import tqdm

from replication.sensor.tables import UnusableLog
from replication.sensor.verdict import Estimate, Settings, as_row, estimate

SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".log", ".parquet", ".xlsx")
UNUSABLE = "unusable log: "
_WORTH_PROCESSES = 30  # fewer quick estimates take less time than starting processes

Row = dict[str, object]
Task = tuple[int, Path]


def find_logs(paths: Sequence[Path]) -> list[Path]:
    """List the logs that files and folders stand for, folders with all that is below them, each log once.

    Raises
    ------
    UnusableLog
        A folder holds none.
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


def _task(index: int, path: Path, settings: Settings) -> tuple[int, Row]:
    return index, estimate_or_reason(path, settings)


def run_fleet(
    paths: Sequence[Path],
    settings: Settings,
    jobs: int = -1,
    journal: Path | None = None,
    dask: str | None = None,
    quiet: bool | None = None,
) -> list[Row]:
    """Estimate many logs.

    Parameters
    ----------
    paths : sequence of Path
        The logs.
    settings : Settings
        How all of them are read and measured.
    jobs : int
        Processes; -1 for all cores where that is worth it.
    journal : Path, optional
        Where finished rows are kept until all are done; rows found there of unchanged logs are not made again.
    dask : str, optional
        Address of a Dask scheduler whose workers see the logs under the same paths.
    quiet : bool, optional
        No progress bar; by default there is one if a person watches.

    Returns
    -------
    list of dict
        A row for each log, in their order: see `estimate.as_row`.

    Raises
    ------
    UnusableLog
        The Dask scheduler does not answer, or Dask is not installed.
    """
    keys = [_key(path, settings) for path in paths]
    known = _journalled(journal)
    rows: dict[int, Row] = {k: known[key] for k, key in enumerate(keys) if key in known}
    tasks = [(k, path) for k, path in enumerate(paths) if k not in rows]
    source = _on_dask(tasks, settings, dask) if dask else _on_this_machine(tasks, settings, jobs)
    with tqdm(total=len(paths), initial=len(rows), unit="log", disable=quiet) as bar:
        for index, row in source:
            if index not in rows:
                rows[index] = row
                _note(journal, keys[index], row)
                bar.update()
    return [rows[k] for k in range(len(paths))]


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
        flat.append(part | {"warnings": "; ".join(warnings)})
    table = pd.DataFrame(flat)
    numbers = [name for name in table if name.endswith(("_rps", "_rad", "_s"))]
    return table.astype(dict.fromkeys(numbers, float))


# ---------------------------------------------------------------------------------------------------------------
# The journal


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


def _journalled(journal: Path | None) -> dict[str, Row]:
    """Rows of a journal by key; a line that was being written when the run ended is left out."""
    rows: dict[str, Row] = {}
    if journal is None or not journal.exists():
        return rows
    for line in journal.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            entry = json.loads(line)
            rows[entry["key"]] = entry["row"]
        except (ValueError, KeyError, TypeError):
            continue
    return rows


def _note(journal: Path | None, key: str, row: Row) -> None:
    if journal is not None:
        with journal.open("a", encoding="utf-8") as file:
            file.write("\n" + json.dumps({"key": key, "row": row}, allow_nan=False))


# ---------------------------------------------------------------------------------------------------------------
# Where the work is done


def _on_this_machine(tasks: Sequence[Task], settings: Settings, jobs: int) -> Iterator[tuple[int, Row]]:
    """Run on processes of this machine; logs on which a process dies are found out one by one."""
    left = dict(tasks)
    if jobs < 0 and len(left) < _WORTH_PROCESSES and settings.calibration.method != "paper":
        jobs = 1
    while left:
        pool = Parallel(n_jobs=jobs, return_as="generator_unordered")
        try:
            for index, row in pool(delayed(_task)(index, path, settings) for index, path in list(left.items())):
                del left[index]
                yield index, row
        except BrokenProcessPool:
            in_flight = list(left.items())[: 2 * effective_n_jobs(jobs)]
            for index, row in _one_by_one(in_flight, settings):
                del left[index]
                yield index, row


def _one_by_one(tasks: Sequence[Task], settings: Settings) -> Iterator[tuple[int, Row]]:
    """Estimate logs in a process of their own, a new one after each that dies."""
    context, pool = multiprocessing.get_context("spawn"), None
    for index, path in tasks:
        pool = pool or ProcessPoolExecutor(1, mp_context=context)
        try:
            yield pool.submit(_task, index, path, settings).result()
        except BrokenProcessPool:
            pool.shutdown()
            pool = None
            why = f"{path}: the process that read it died; is it too large for the memory?"
            yield index, _failed(path, settings, why)
    if pool:
        pool.shutdown()


def _itself(settings: Settings) -> Settings:
    return settings


def _on_dask(tasks: Sequence[Task], settings: Settings, address: str) -> Iterator[tuple[int, Row]]:
    """Run on a Dask cluster, which runs the tasks of a worker that dies again elsewhere."""
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise UnusableLog("--dask needs Dask: pip install 'backlash-replication[fleet]'") from error
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError, TypeError) as error:
        raise UnusableLog(f"--dask {address}: no scheduler answers there ({type(error).__name__})") from error
    with client:
        # As the result of a task the settings travel once to each worker, and can be made again if one dies.
        shared = client.submit(_itself, settings, pure=False)
        futures = {client.submit(_task, k, path, shared, pure=False): (k, path) for k, path in tasks}
        for future in as_completed(list(futures)):
            index, path = futures.pop(future)
            try:
                yield future.result()
            except Exception as error:  # what a cluster may say of a task that it gave up
                yield index, _failed(path, settings, f"{path}: the cluster gave it up ({type(error).__name__})")
            future.release()
