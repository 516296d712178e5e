"""Many logs on all cores: a table of them, resumable, no bad file stops the rest."""

import json
import os
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import joblib
import numpy as np
import pandas as pd
from tqdm import tqdm

from backlash import __version__, estimates
from backlash.answer import Estimate
from backlash.estimates import request_for
from backlash.log_list import Batch, TableOfLogs, options_of, read_batch
from backlash.reading.sources import name_of, naming
from backlash.refusals import Refusal
from replication.files import DISK_IS_FULL

_FORMULA = re.compile(r"(^|[,;\t\r\n])(?=\s*[=+@\t\r-])")
_WORTH_PROCESSES = 8  # a log takes a second, a process one to start
_QUOTED = re.compile(r"""(?<![\w.])(['"]).*?\1(?!\w)""")
Numbered: TypeAlias = tuple[int, Estimate]


def estimate_many(
    logs: Sequence[object] | TableOfLogs, *, jobs: int = -1, **given: Any
) -> pd.DataFrame:
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
    answers = dict(run_batch(batch, jobs))
    table = as_table([answers[number] for number in sorted(answers)], batch.keys)
    return table.set_index([*batch.keys]) if len(batch.keys.columns) else table


def run_batch(
    batch: Batch, jobs: int = -1, journal: Path | None = None, figures: Path | None = None
) -> Iterator[tuple[int, Estimate]]:
    """Examine many logs; their numbers and answers come in any order.

    Answers are written into a journal, by which a run goes on where another was interrupted. Of each answer that has a
    fit a figure is written into a folder, or as the file that is named.
    """
    if jobs == 0 or jobs < -1:
        raise Refusal(f"--jobs {jobs}: give -1 or a number above 0")
    calls = dict(enumerate(zip(batch.logs, batch.rows, strict=True)))
    keys = {number: _key(*call, batch.given) for number, call in calls.items()} if journal else {}
    earlier = read_journal(journal) if journal else {}
    for number, key in keys.items():
        if key in earlier:
            yield number, replace(earlier[key], file=name_of(calls.pop(number)[0]))
    if len(calls) < (_WORTH_PROCESSES if jobs < 0 else 2):
        jobs = 1
    # Defects of one log alone are told as such.
    held = Exception if len(batch.logs) > 1 else Refusal
    each = _examine_each(calls, jobs, partial(_examine_one, batch.given, figures, held))
    for number, answer in tqdm(each, total=len(calls), unit="log", disable=None, leave=False):
        yield number, answer
        if journal:
            with journal.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"key": keys[number]} | vars(answer)) + "\n")


def _key(log: object, *given: Mapping[Any, Any]) -> str:
    """What the answer on a log in its present state is kept under."""
    path = Path(os.path.realpath(name_of(log)))
    state = (path.stat().st_size, path.stat().st_mtime_ns) if path.exists() else None
    return str(joblib.hash((__version__, path, state, given)))


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
    calls: Mapping[int, tuple[object, Mapping[Any, Any]]],
    jobs: int,
    examine: Callable[..., Numbered],
) -> Iterator[Numbered]:
    """Examine each numbered log.

    A process that dies takes others with it and does not say on which log: what is left is tried again in halves.
    """
    remaining = dict(calls)
    tasks = (joblib.delayed(examine)(number, *call) for number, call in calls.items())
    with suppress(BrokenProcessPool):
        for number, answer in joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(tasks):
            del remaining[number]
            yield number, answer
    if len(remaining) == 1:
        [(number, (log, _))] = remaining.items()
        yield number, refused(log, f"{name_of(log)}: the process that read it died; too large?")
    elif remaining:
        again = list(remaining.items())
        for half in (again[::2], again[1::2]):
            yield from _examine_each(dict(half), jobs, examine)


def _examine_one(
    given: Mapping[str, Any],
    figures: Path | None,
    held: type[Exception],
    number: int,
    log: object,
    row: Mapping[Any, Any],
) -> Numbered:
    """Examine one log; say why where that fails, in the ways that must not stop a thousand others."""
    name = name_of(log)
    with warnings.catch_warnings(action="ignore"):  # of libraries, in a process of its own
        try:
            with naming(name):
                request = request_for({**given, **options_of(row)})
            answer = estimates.examine(log, request)
        except held as error:
            if isinstance(error, OSError) and error.errno in DISK_IS_FULL:  # for compiled code, too
                raise
            kind = "" if isinstance(error, Refusal) else f"{name}: {type(error).__name__}: "
            why = f"{kind}{error}"
            if not row.get("is_quoted", True):
                asked = repr((given, row))
                why = _QUOTED.sub(lambda text: text[0] if text[0] in asked else "'...'", why)
            answer = refused(log, why)
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


def as_table(answers: Sequence[Estimate], keys: pd.DataFrame) -> pd.DataFrame:
    """Answers as a tidy table: intervals, and quantities with their SDs, in two columns each; no cell is a formula."""
    return keys.join(pd.DataFrame([_row(answer) for answer in answers])).map(_escape)


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
