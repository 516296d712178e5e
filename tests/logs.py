"""Logs of the simulated joint, and ways to write and read them, for the tests of the sensor."""

import shlex
import zipfile
from contextlib import nullcontext
from functools import lru_cache
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from backlash.cli import main
from backlash.reading.columns import LogOptions
from backlash.reading.prepare import Log, open_log
from backlash.refusals import Refusal
from replication.joint import identified_joint, simulate
from replication.records import Recording


@lru_cache
def noisy(delta_rad: float = 9e-4) -> Recording:
    """Twelve turns of the paper's joint."""
    run = simulate(identified_joint(), delta_rad)
    noise = np.random.default_rng(1).uniform(-0.1, 0.1, run.v.size)
    return Recording(run.t, run.v + noise, 100.0, 0.4, "simulated")


def text(header="time [s],speed [rps]", row="{t:.6f},{v:.5f}", record=None) -> str:
    record = record or noisy()
    rows = [
        row.format(t=t, v=v, ns=round(1e9 * t), rpm=60 * v, rad=2 * np.pi * v)
        for t, v in zip(record.t, record.v, strict=True)
    ]
    return "\n".join([*([header] if header else []), *rows, ""])


def file(folder: Path, content: str | bytes, name: str = "log.csv") -> Path:
    """Write a file; returns its path."""
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def write(recording: Recording, path: Path) -> Path:
    """Write a log with a header; returns its path."""
    return file(path.parent, text(row="{t:.6f},{v:.6f}", record=recording), path.name)


def refused_for(words: str | None):
    """A context in which something is refused with these words, or, of None, nothing is."""
    return pytest.raises(Refusal, match=words) if words else nullcontext()


def rewritten(path, change: dict[str, bytes]):
    """A workbook with members changed or added, by name; returns its path."""
    plain = BytesIO()
    frame().iloc[:50].to_excel(plain, index=False)
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        for name, content in ({name: old.read(name) for name in old.namelist()} | change).items():
            new.writestr(name, content)
    return path


T, V = noisy().t, noisy().v


def frame(v=V, t=None, name="speed [rps]", **others) -> pd.DataFrame:
    """A log as a table, each 2 ms; the speed goes on from its start where there are more stamps."""
    t = 2e-3 * np.arange(len(v)) if t is None else t
    return pd.DataFrame({"time": t, name: np.resize(v, len(t)), **others})


def asked(**given) -> LogOptions:
    """Options by which a log is read, of a load that turns in 0.4 s."""
    return LogOptions(**{"turn_period_s": 0.4} | given)


def read(source, **given) -> Log:
    return open_log(source, asked(**given))


def refusal(source, **given) -> str:
    """The one line with which a log is refused."""
    with pytest.raises(Refusal) as caught:
        read(source, **given)
    line = str(caught.value)
    assert "\n" not in line
    assert len(line) < 600
    return line


def command(*words) -> int:
    """Exit status of a command; a text may hold several words."""
    return main(shlex.split(" ".join(map(str, words))))
