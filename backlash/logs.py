"""A log from wherever it comes: a file, the standard input, a table or arrays."""

import hashlib
import shutil
import sys
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from tempfile import NamedTemporaryFile

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from backlash import __version__
from backlash.reading.columns import LogFormat
from backlash.reading.prepare import read_log, record_of
from backlash.refusals import UnusableLog
from replication.recording import Recording

STDIN = "-"


@dataclass(frozen=True, eq=False)
class Log:
    """A log that was read: its record of constant speed, and what was said and assumed of it.

    Its recording's t [s] and v [rps] are the samples that an estimate uses.
    """

    file: str
    recording: Recording
    notes: tuple[str, ...]
    form: LogFormat
    sha256: str | None = None  # of the file's bytes

    def to_dict(self) -> dict[str, object]:
        """What was read, ready for JSON; the samples themselves are in `recording`."""
        return {
            "file": self.file, "samples": self.recording.t.size, "sample_s": self.recording.sample_s,
            "mean_speed_rps": float(self.recording.v.mean()), "turn_period_s": self.recording.turn_period_s,
            "notes": list(self.notes), "sha256": self.sha256, "version": __version__,
        }  # fmt: skip


def open_log(source: object, form: LogFormat, v: ArrayLike | None = None, torque: ArrayLike | None = None) -> Log:
    """Read a log: a path ("-": standard input), a table, time, speed and torque as arrays, or one that was read."""
    if isinstance(source, Log):
        return source
    name = name_of(source)
    if name == STDIN:
        return _open_stdin(form)
    if isinstance(source, str | PathLike):
        return Log(name, *read_log(Path(source), form), form, hash_file(source))
    if isinstance(source, pd.DataFrame):
        table = source.reset_index(drop=source.index.name is None).rename(columns=str)
    else:
        names = [form.time or "time", form.position or form.speed or "speed", form.torque]
        arrays = {name: np.asarray(each) for name, each in zip(names, (source, v, torque), strict=True) if name}
        shapes = [each.shape for each in arrays.values()]
        if len(shapes[0]) != 1 or len(set(shapes)) > 1:
            raise UnusableLog(f"arrays of shapes {' and '.join(map(str, shapes))}; give time and speed, of one length")
        table = pd.DataFrame(arrays)
    return Log(name, *record_of(table, form, name), form)


def _open_stdin(form: LogFormat) -> Log:
    """Read the standard input by way of a file, because a log's kind is told by its first bytes."""
    if sys.stdin is None:
        raise UnusableLog(f"{STDIN}: the standard input is closed")
    with NamedTemporaryFile() as file:
        shutil.copyfileobj(sys.stdin.buffer, file)
        file.flush()
        try:
            log = open_log(file.name, form)
        except UnusableLog as error:
            raise UnusableLog(str(error).replace(file.name, STDIN)) from error
    return replace(log, file=STDIN, recording=replace(log.recording, source=STDIN))


def name_of(source: object) -> str:
    """What a log is called in its answer: its path, or what it is."""
    return str(source) if isinstance(source, str | PathLike) else getattr(source, "file", "log")


def hash_file(source: object) -> str | None:
    """SHA-256 of a file's bytes; None where there is none."""
    if not isinstance(source, str | PathLike) or not Path(source).is_file():
        return None
    with Path(source).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
