"""Read: from wherever a log comes to its table."""

import csv
import gzip
import hashlib
import io
import os
import select
import stat
import sys
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from backlash.reading.columns import LogFormat
from backlash.reading.tables import CUT, MOST_BYTES, Sheet, read_table
from backlash.refusals import Refusal

STDIN = "-"
MOST_TABLE_BYTES = 16 * 2**20  # of a table of logs or a calibration
PATIENCE_S = 60.0  # with a pipe
_UNREADABLE = {
    FileNotFoundError: "no such file in {}; check the name",
    PermissionError: "no permission to read it; ask its owner for it",
    IsADirectoryError: "a folder where a file is needed; name a file in it",
    MemoryError: "too large for this machine's memory; cut it to the test movement",
}
_STAMPS = (pd.DatetimeIndex, pd.TimedeltaIndex)


@dataclass(frozen=True, eq=False, kw_only=True)
class Source:
    """What a log is called in its answer, and the SHA-256 of its file's bytes."""

    file: str
    sha256: str | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Table(Source):
    """A log's columns."""

    sheet: Sheet


def name_of(source: object) -> str:
    """What a log is called in its answer: its path, or what it is."""
    return str(source) if isinstance(source, str | PathLike) else getattr(source, "file", "log")


def read_source(
    source: object, form: LogFormat, v: ArrayLike | None = None, torque: ArrayLike | None = None
) -> Table:
    """Read a log: a path ("-": standard input), a table, or time, speed and torque as arrays."""
    name = name_of(source)
    if isinstance(source, str | PathLike):
        return _read_file(name, least=1 if form.rate_hz else 2)
    if isinstance(source, pd.DataFrame):
        index = source.index
        named = index.name or ("time" if isinstance(index, _STAMPS) else None)
        frame = source.rename_axis(named).reset_index(drop=named is None).rename(columns=str)
        return Table(file=name, sheet=Sheet(frame))
    if v is None:
        raise Refusal(
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
        raise Refusal(
            f"arrays of shapes {' and '.join(map(str, shapes))}; give time and speed of one length, or a pandas table"
        )
    return Table(file=name, sheet=Sheet(pd.DataFrame(arrays)))


def _read_file(name: str, least: int) -> Table:
    with naming(name):
        content = read_bytes(name)
        sha256 = hashlib.sha256(content).hexdigest()
        return Table(file=name, sha256=sha256, sheet=read_table(unpacked(content), least))


@contextmanager
def naming(name: str) -> Iterator[None]:
    """Refuse a file that cannot be read by its name, in one line."""
    try:
        yield
    except Refusal as error:
        raise error.in_file(name) from error
    except (EOFError, OSError, zlib.error, csv.Error, ValueError, MemoryError) as error:
        other = f"cannot be read ({error}); check its name, or export it again"
        why = _UNREADABLE.get(type(error), other)
        raise Refusal(f"{name}: {why.replace('{}', str(Path(name).absolute().parent))}") from error


def read_bytes(name: str, most: int = MOST_BYTES) -> bytes:
    """Content of a file, of a pipe like `<(command)`, or of the standard input ("-"), never more than `most`."""
    if name == STDIN:
        if sys.stdin is None:
            raise Refusal("the standard input is closed")
        return _take(sys.stdin.buffer, most)
    with open(name, "rb", buffering=0, opener=_open_at_once) as file:
        is_file = stat.S_ISREG(os.fstat(file.fileno()).st_mode)
        return _take(file, most, None if is_file else PATIENCE_S)


def _open_at_once(path: str, flags: int) -> int:
    """Open without waiting for who writes into a pipe."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _take(file: Any, most: int, patience_s: float | None = None) -> bytes:
    """Read all of a file that has an end, and is not too large; not for ever where nothing comes."""
    content = bytearray()
    while True:
        if patience_s and not select.select([file], [], [], patience_s)[0]:
            raise Refusal(f"nothing came out of it for {patience_s:g} s; is it a file?")
        chunk = file.read(2**20)
        content += chunk or b""
        if chunk == b"":
            return bytes(content)
        if len(content) > most:
            raise Refusal(f"more than the {most // 2**20} MiB that are read; {CUT}")


def unpacked(content: bytes) -> bytes:
    """Content of a gzip file, bounded; other content as it is."""
    if not content.startswith(b"\x1f\x8b"):
        return content
    with gzip.open(io.BytesIO(content)) as file:
        return _take(file, MOST_BYTES)
