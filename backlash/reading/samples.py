"""Samples of a log on their way to a record; each step of `prepare` takes them and hands them on."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from backlash.reading.columns import Columns, LogOptions
from replication.signature import FloatArray


def runs_of(signal: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """First indices, lengths and values of the runs of equal values."""
    starts = np.flatnonzero(np.diff(signal, prepend=np.nan) != 0)
    return starts, np.diff(starts, append=signal.size), signal[starts]


@dataclass(frozen=True, eq=False)
class Samples:
    """Time [s] and signals, a row each: speed [rps] or position [turns], and the torque if there is one."""

    t: FloatArray
    signals: FloatArray  # shape (signals, samples)
    rows: pd.Index  # of the file, until samples are put on a grid
    options: LogOptions
    columns: Columns
    notes: tuple[str, ...] = ()

    @property
    def dt(self) -> float:
        """Sampling period of even samples [s]."""
        return float(self.t[1] - self.t[0])

    @property
    def rate_hz(self) -> float:
        """Samples a second, in the mean."""
        return float((self.t.size - 1) / (self.t[-1] - self.t[0]))

    @property
    def v(self) -> FloatArray:
        """The speed [rps], or position [turns] until it is differentiated."""
        return self.signals[0]

    @property
    def torque(self) -> FloatArray | None:
        """Of the motor, in the log's unit."""
        return self.signals[1] if self.columns.torque else None

    def named_signals(self) -> Iterator[tuple[str, FloatArray]]:
        """The signals with what they are called."""
        names = ("position" if self.columns.is_position else "speed", "torque")
        return zip(names, self.signals, strict=False)

    def noting(self, note: str) -> Self:
        """The same samples with a note on what was done to them."""
        return replace(self, notes=(*self.notes, note))

    def at(self, chosen: slice | NDArray[Any]) -> Self:
        """A part of the samples."""
        signals = self.signals[:, chosen]
        return replace(self, t=self.t[chosen], signals=signals, rows=self.rows[chosen])

    def when(self, chosen: slice | NDArray[Any]) -> str:
        """From when to when a part lasts, in words."""
        t = self.t[chosen]
        return f"from {t[0]:.3f} to {t[-1]:.3f} s after the log's first sample"
