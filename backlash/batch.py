"""Many logs on all cores: of a list or a table of them, resumable, no bad file stops the rest."""

import csv
import io
import json
import os
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import replace
from difflib import get_close_matches
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

import joblib
import numpy as np
import pandas as pd
from tqdm import tqdm

from backlash import __version__, estimates
from backlash.answer import Estimate
from backlash.estimates import GIVEN, check_names, request_for
from backlash.reading import limits
from backlash.reading.columns import listed
from backlash.reading.sources import PARQUET, check_size, name_of, naming, read_bytes, read_parquet
from backlash.reading.tables import text_of
from backlash.refusals import Refusal
from replication.files import DISK_IS_FULL

KEYS = ["joint", "date"]
# Columns of a batch: what of a row cannot be used.
BEYOND, NO_DATE = "beyond the header", "no date"
SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".log", ".gz", ".parquet", ".xlsx")
_TEXTS = {"time", "speed", "position", "torque", "unit", "time_unit"}
_TRUTHS = dict.fromkeys(("yes", "true", "y", "1"), True)
_TRUTHS |= dict.fromkeys(("no", "false", "n", "0"), False)
_FORMULA = re.compile(r"(^|[,;\t\r\n])(?=\s*[=+@\t\r-])")
_QUOTED = re.compile(r"""(?<![\w.])(['"]).*?\1(?!\w)""")
_WORTH_PROCESSES = 8  # a log takes a second, a process one to start
Logs: TypeAlias = Sequence[object] | pd.DataFrame | str | PathLike[str]
Row: TypeAlias = Mapping[Any, Any]
Numbered: TypeAlias = tuple[int, Estimate]


def estimate_many(logs: Logs, *, jobs: int = -1, **given: Any) -> pd.DataFrame:
    """Estimate the backlashes of many logs, also of different joints.

    Parameters
    ----------
    logs : sequence of logs, DataFrame, or path of a CSV table
        Logs as `estimate` takes them, or a table of their files with what is given of each: column `file` (in a file
        relative to it), and `joint`, `date`, and keywords of `estimate`, like `gear_ratio`, `torque`, `inertia_ratio`,
        `gravity_per_s2`. What a row leaves empty is taken from `given`.
    jobs : int
        Processes; -1 for all cores where that is worth it.
    **given
        As in `estimate`.

    Returns
    -------
    DataFrame
        A row for each log, in their order, by joint and date if the table has them. Columns are the attributes of
        `Estimate`, intervals and quantities of the joint in two each; `reason` says why there is no answer.

    Raises
    ------
    Refusal
        The table cannot be used. A log that cannot, or what its row says, only has no answer.

    Examples
    --------
    >>> import backlash
    >>> plant = pd.DataFrame({"file": files, "joint": ["A1", "A2"], "date": "2024-03-17"})
    >>> found = backlash.estimate_many(plant, gear_ratio=100, torque="torque", inertia_ratio=2, gravity_per_s2=30)
    >>> print(found.loc["A2"]["verdict"].tolist())
    ['backlash']
    """
    batch = read_batch(logs, given)
    answers = dict(run_batch(batch, given, jobs))
    table = as_table([answers[number] for number in sorted(answers)], batch)
    keys = [*batch.filter(KEYS)]
    return table.set_index(keys) if keys else table


def read_batch(source: Logs, given: Mapping[str, Any]) -> pd.DataFrame:
    """A row for each log: `file`, and what a table says of it; in the table of a file that is text, or missing."""
    if isinstance(source, Sequence) and not isinstance(source, str):
        request_for(given)
        return pd.DataFrame({"file": pd.Series([*source], dtype=object)})
    if not isinstance(source, pd.DataFrame | str | PathLike):
        raise Refusal(
            f"one {type(source).__name__} of logs; give a list of them, or a pandas table with the column file"
        )
    check_names(given)
    is_frame = isinstance(source, pd.DataFrame)
    with naming("the table" if is_frame else str(source)):
        table = source if isinstance(source, pd.DataFrame) else _read_file(str(source))
        table = table.reset_index(drop=table.index.names == [None])
        _check_table(table)
    if not is_frame:
        # Relative to the table; not only the user may have named a log there, which a refusal does not quote.
        logs = [Path(source).parent / _text(cell).replace("\0", "?") for cell in table["file"]]
        table = table.assign(file=logs, is_quoted=False)
    if "date" in table:
        dates = pd.to_datetime(table["date"], format="ISO8601", utc=True, errors="coerce")
        no_date = table["date"].where(dates.isna())
        table = table.assign(date=dates.dt.tz_localize(None), **{NO_DATE: no_date})
    return table


def _read_file(name: str) -> pd.DataFrame:
    content = read_bytes(name)
    if content.startswith(PARQUET):
        return read_parquet(content)
    text, _ = text_of(content)
    first = text.partition("\n")[0]
    check_size(text.count("\n"), len(first))
    delimiter = next((mark for mark in ",;\t" if mark in first), ",")
    rows = csv.DictReader(io.StringIO(text), delimiter=delimiter, restkey=BEYOND)
    table = pd.DataFrame([*rows], columns=[*filter(None, rows.fieldnames or ()), BEYOND])
    return table.replace("", None).dropna(how="all")


def _check_table(table: pd.DataFrame) -> None:
    """Refuse a table that lists no logs, or has a column that is nearly one that is read; others may stand in it."""
    if "file" not in table:
        raise Refusal(f"no column 'file'; there are {listed(table.columns)}")
    if table.empty or not table.columns.is_unique:
        raise Refusal("no rows" if table.empty else "two of its columns have one name; rename one")
    if len(table) > limits.MOST_LOGS:
        raise Refusal(f"{len(table):,} logs, more than {limits.MOST_LOGS:,}; split the table")
    names = ("file", *KEYS, *GIVEN)
    for column in sorted({*map(str, table)}.difference(names)):
        if meant := get_close_matches(column.lower().replace(" ", "_"), names, 1, 0.8):
            raise Refusal(f"column {column!r} is not read; is it {meant[0]!r}?")


def options_of(row: Row) -> dict[str, Any]:
    """What a table says of a log, as `estimate` takes it; an empty cell says nothing.

    Raises
    ------
    Refusal
        A cell is not what its column holds.
    """
    if isinstance(beyond := row.get(BEYOND), list) and any(beyond):
        raise Refusal(f"{beyond[0][:40]!r} stands beyond the header's columns; a decimal comma?")
    if not pd.isna(date := row.get(NO_DATE)):
        raise Refusal(f"date is {str(date)[:40]!r}, no date like 2024-03-17")
    return {
        name: _value(name, cell)
        for name, cell in row.items()
        if name in GIVEN and not pd.isna(cell)
    }


def _text(cell: Any) -> str:
    return "" if pd.isna(cell) else str(cell).strip()


def _value(name: str, cell: Any) -> Any:
    """A cell as text, number, or yes and no, by its column's name."""
    if name in _TEXTS:
        return _text(cell)
    wanted = "no number"
    try:
        if name == "trust_period":
            wanted = "neither yes nor no"
            return _TRUTHS[_text(cell).lower()]
        return float(cell)
    except (ValueError, TypeError, KeyError) as error:
        raise Refusal(f"{name} is {str(cell)[:40]!r}, {wanted}") from error


def find_logs(paths: Sequence[Path], out: Path | None = None) -> list[Path]:
    """Logs that files and folders stand for, each once: of a folder all below it but the table of answers."""
    answers = os.path.realpath(out) if out else ""
    logs: dict[str, Path] = {}
    for path in paths:
        inside = [path]
        if path.is_dir():
            inside = [
                file
                for file in sorted(path.rglob("*"))
                if file.suffix.lower() in SUFFIXES and file.name[0] != "." and file.is_file()
            ]
        files = {os.path.realpath(file): file for file in inside}
        files.pop(answers, None)
        if not files:
            raise Refusal(f"{path}: no logs in this folder; they end in {', '.join(SUFFIXES)}")
        logs |= files
    return list(logs.values())


def run_batch(
    batch: pd.DataFrame,
    given: Mapping[str, Any],
    jobs: int = -1,
    journal: Path | None = None,
    figures: Path | None = None,
    held: type[Exception] = Exception,
) -> Iterator[Numbered]:
    """Examine the logs of `read_batch`; their numbers and answers come in any order.

    Answers are written into a journal, by which a run goes on where another was interrupted. Of each answer that has a
    fit a figure is written into a folder, or as the file that is named. An error that is held makes an answer.
    """
    if jobs == 0 or jobs < -1:
        raise Refusal(f"--jobs {jobs}: give -1 or a number above 0")
    rows = dict(enumerate(batch.to_dict("records")))
    keys = {number: _key(row, given) for number, row in rows.items()} if journal else {}
    earlier = read_journal(journal) if journal else {}
    for number, key in keys.items():
        if key in earlier:
            yield number, replace(earlier[key], file=name_of(rows.pop(number)["file"]))
    if len(rows) < (_WORTH_PROCESSES if jobs < 0 else 2):
        jobs = 1
    each = _examine_each(rows, jobs, partial(_examine_one, given, figures, held))
    for number, answer in tqdm(each, total=len(rows), unit="log", disable=None, leave=False):
        yield number, answer
        if journal:
            with journal.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"key": keys[number]} | vars(answer)) + "\n")


def _key(row: Row, given: Mapping[str, Any]) -> str:
    """What the answer on a log in its present state is kept under."""
    path = Path(os.path.realpath(name_of(row["file"])))
    state = (path.stat().st_size, path.stat().st_mtime_ns) if path.exists() else None
    asked = [row.get(name) for name in (*GIVEN, BEYOND, NO_DATE)]
    return str(joblib.hash((__version__, path, state, asked, given)))


def read_journal(journal: Path) -> dict[str, Estimate]:
    """Answers of an interrupted run by their keys; a last line may be torn."""
    answers = {}
    text = journal.read_text("utf-8", "replace") if journal.exists() else ""
    if journal.is_symlink() or (text and not text.startswith('{"key": ')):
        raise Refusal(f"{journal}: holds no answers of a run before; name another --out")
    for line in text.splitlines():
        with suppress(ValueError, TypeError, KeyError):
            row = json.loads(line)
            key = row.pop("key")
            answers[key] = Estimate(**row)
    return answers


def _examine_each(
    rows: Mapping[int, Row], jobs: int, examine: Callable[[int, Row], Numbered]
) -> Iterator[Numbered]:
    """Examine each numbered log.

    A process that dies takes others with it and does not say on which log: what is left is tried again in halves.
    """
    remaining = dict(rows)
    tasks = (joblib.delayed(examine)(*each) for each in rows.items())
    with suppress(BrokenProcessPool):
        for number, answer in joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(tasks):
            del remaining[number]
            yield number, answer
    if len(remaining) == 1:
        [(number, row)] = remaining.items()
        why = f"{name_of(row['file'])}: the process that read it died; too large?"
        yield number, refused(row["file"], why)
    elif remaining:
        again = list(remaining.items())
        for half in (again[::2], again[1::2]):
            yield from _examine_each(dict(half), jobs, examine)


def _examine_one(
    given: Mapping[str, Any], figures: Path | None, held: type[Exception], number: int, row: Row
) -> Numbered:
    """Examine one log; say why where that fails, in the ways that must not stop a thousand others."""
    name = name_of(row["file"])
    with warnings.catch_warnings(action="ignore"):  # of libraries, in a process of its own
        try:
            with naming(f"the table of logs, {name}"):
                request = request_for({**given, **options_of(row)})
            answer = estimates.examine(row["file"], request)
        except held as error:
            if isinstance(error, OSError) and error.errno in DISK_IS_FULL:  # for compiled code, too
                raise
            kind = "" if isinstance(error, Refusal) else f"{name}: {type(error).__name__}: "
            why = f"{kind}{error}"
            if not row.get("is_quoted", True):
                asked = repr([*given.values(), *row.values()])
                why = _QUOTED.sub(lambda text: text[0] if text[0] in asked else "'...'", why)
            answer = refused(row["file"], why)
        if figures and answer.trace:
            from backlash import plots

            if figures.is_dir():
                stem = re.sub(r"\W", "_", Path(name).stem)[:100]
                figures /= f"{number + 1:05d}_{stem}.png"
            plots.save_figure(plots.estimate_figure(answer), figures)
    return number, replace(answer, trace=None)


def refused(log: object, why: str) -> Estimate:
    """The answer on a log that cannot be used."""
    return Estimate(name_of(log)).with_refusal(Refusal(why))


def as_table(answers: Sequence[Estimate], batch: pd.DataFrame) -> pd.DataFrame:
    """Answers as a tidy table, by joint and date if a batch has them; no cell is a formula.

    Intervals, and quantities with their SDs, have two columns each.
    """
    return batch.filter(KEYS).join(pd.DataFrame([_row(answer) for answer in answers])).map(_escape)


def _escape(cell: object) -> object:
    """A cell that a table can hold, and that is no formula for a spreadsheet, whatever separates its cells."""
    if not isinstance(cell, str):
        return cell
    return _FORMULA.sub(r"\1'", cell.encode(errors="replace").decode())


def _row(answer: Estimate) -> dict[str, object]:
    texts = {"reason": answer.reason or "", "notes": "; ".join(answer.notes)}
    row: dict[str, object] = {}
    for name, value in (answer.to_dict() | texts).items():
        if "_interval_" in name:
            ends = (name.replace("interval", end) for end in ("low", "high"))
            row |= zip(ends, value or (np.nan, np.nan), strict=True)
        elif name == "joint":
            for quantity, (each, sd) in (value or {}).items():
                row |= {quantity: each, f"{quantity}_sd": sd}
        else:
            row[name] = np.nan if value is None else value
    return row
