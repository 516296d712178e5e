"""Read: from wherever a log comes to its table."""

import csv
import gzip
import hashlib
import io
import sys
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike
from typing import BinaryIO

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from backlash.reading.columns import LogFormat
from backlash.reading.tables import CUT, MOST_BYTES, Table, read_table
from backlash.refusals import Refusal

STDIN = "-"
MOST_TABLE_BYTES = 16 * 2**20  # of a table of logs or a calibration
_STAMPS = (pd.DatetimeIndex, pd.TimedeltaIndex)


def name_of(source: object) -> str:
    """What a log is called in its answer: its path, or what it is."""
    return str(source) if isinstance(source, str | PathLike) else getattr(source, "file", "log")


def read_source(
    source: object, form: LogFormat, v: ArrayLike | None = None, torque: ArrayLike | None = None
) -> Table:
    """Read a log: a path ("-": standard input), a table, or time, speed and torque as arrays."""
    name = name_of(source)
    if isinstance(source, str | PathLike):
        return _read_file(name, 1 if form.rate_hz else 2)
    if isinstance(source, pd.DataFrame):
        index = source.index
        named = index.name or ("time" if isinstance(index, _STAMPS) else None)
        frame = source.rename_axis(named).reset_index(drop=named is None).rename(columns=str)
        return Table(frame, file=name)
    if v is None:
        raise Refusal(
            f"one {type(source).__name__} is no log: give time and speed as arrays of one length, or a pandas table, "
            "as to_pandas() or to_dataframe() of other tables make it"
        )
    names = [form.time or "time", form.position or form.speed or "speed", form.torque]
    arrays = zip(names, (source, v, torque), strict=True)
    try:
        frame = pd.DataFrame({column: np.asanyarray(each) for column, each in arrays if column})
    except ValueError as error:
        raise Refusal(f"{error}; give time, speed and torque of one length") from error
    return Table(frame, file=name)


def _read_file(name: str, least: int) -> Table:
    with naming(name):
        content = read_bytes(name)
        sha256 = hashlib.sha256(content).hexdigest()
        return replace(read_table(unpacked(content), least), file=name, sha256=sha256)


@contextmanager
def naming(name: str) -> Iterator[None]:
    """Refuse a file that cannot be read by its name, in one line."""
    try:
        yield
    except Refusal as error:
        raise error.in_file(name) from error
    except (EOFError, OSError, zlib.error, csv.Error, ValueError, MemoryError) as error:
        why = getattr(error, "strerror", None) or repr(error)
        raise Refusal(f"{name}: {why}; check its name, or export it again") from error


def read_bytes(name: str, most: int = MOST_BYTES) -> bytes:
    """Content of a file, of a pipe like `<(command)`, or of the standard input ("-"), never more than `most`."""
    if name != STDIN:
        with open(name, "rb") as file:
            return _take(file, most)
    if sys.stdin is None:
        raise Refusal("the standard input is closed")
    return _take(sys.stdin.buffer, most)


def _take(file: BinaryIO | gzip.GzipFile, most: int) -> bytes:
    content = file.read(most + 1)
    if len(content) > most:
        raise Refusal(f"more than the {most // 2**20} MiB that are read; {CUT}")
    return content


def unpacked(content: bytes) -> bytes:
    """Content of a gzip file, bounded; other content as it is."""
    if not content.startswith(b"\x1f\x8b"):
        return content
    with gzip.open(io.BytesIO(content)) as file:
        return _take(file, MOST_BYTES)
