"""Read: from wherever a log comes to its table."""

import hashlib
import shutil
import sys
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from tempfile import NamedTemporaryFile

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from backlash.reading.columns import LogFormat
from backlash.reading.refusals import UnusableLog
from backlash.reading.tables import read_table

STDIN = "-"
_STAMPS = (pd.DatetimeIndex, pd.TimedeltaIndex)


@dataclass(frozen=True, eq=False, kw_only=True)
class Source:
    """What a log is called in its answer, and the SHA-256 of its file's bytes."""

    file: str
    sha256: str | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Table(Source):
    """A log's columns by name; the index holds the file's rows."""

    frame: pd.DataFrame


def name_of(source: object) -> str:
    """What a log is called in its answer: its path, or what it is."""
    return str(source) if isinstance(source, str | PathLike) else getattr(source, "file", "log")


def read_source(
    source: object, form: LogFormat, v: ArrayLike | None = None, torque: ArrayLike | None = None
) -> Table:
    """Read a log: a path ("-": standard input), a table, or time, speed and torque as arrays."""
    name = name_of(source)
    if name == STDIN:
        return _read_stdin()
    if isinstance(source, str | PathLike):
        return _read_file(Path(source), name)
    if isinstance(source, pd.DataFrame):
        index = source.index
        named = index.name or ("time" if isinstance(index, _STAMPS) else None)
        frame = source.rename_axis(named).reset_index(drop=named is None).rename(columns=str)
        return Table(file=name, frame=frame)
    if v is None:
        raise UnusableLog(
            f"one {type(source).__name__} is no log: give time and speed as arrays of one length, or a pandas table, "
            "as to_pandas() or to_dataframe() of other tables make it"
        )
    names = [form.time or "time", form.position or form.speed or "speed", form.torque]
    arrays = {
        column: np.asanyarray(each)
        for column, each in zip(names, (source, v, torque), strict=True)
        if column
    }
    shapes = [each.shape for each in arrays.values()]
    if len(shapes[0]) != 1 or len(set(shapes)) > 1:
        raise UnusableLog(
            f"arrays of shapes {' and '.join(map(str, shapes))}; give time and speed of one length, or a pandas table"
        )
    return Table(file=name, frame=pd.DataFrame(arrays))


def _read_file(path: Path, name: str) -> Table:
    try:
        frame = read_table(path)
    except UnusableLog as error:
        raise error.in_file(name) from error
    with path.open("rb") as file:
        return Table(file=name, sha256=hashlib.file_digest(file, "sha256").hexdigest(), frame=frame)


def _read_stdin() -> Table:
    """Read the standard input by way of a file, because a log's kind is told by its first bytes."""
    if sys.stdin is None:
        raise UnusableLog(f"{STDIN}: the standard input is closed")
    with NamedTemporaryFile() as file:
        shutil.copyfileobj(sys.stdin.buffer, file)
        file.flush()
        return _read_file(Path(file.name), STDIN)
