"""When samples were taken: time stamps as seconds, and the even grid behind them."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from backlash.reading.columns import numbers
from backlash.reading.tables import TIME_OF_DAY
from backlash.reading.units import SECONDS, split_unit
from backlash.refusals import Refusal
from replication.signature import FloatArray

_MOST_HZ = 1e6  # no logger samples faster; the stamps have another unit
# What misses more than both is a gap; less is filled, a fifth of the ring's period at most.
_LONGEST_STEP = 3.5  # in sampling periods
_LONGEST_FILLED_S = 0.010
_MOST_INVENTED = 0.1  # of the samples; above, the stamps are not those of the samples
_FEW_GAPS = 0.02  # of the steps; more are bursts or lost samples
_SMOOTHING_S = 0.1
# First stamps, as numbers, that only clocks of these units show: since 1970, 1601 and the year 1.
_SINCE = (
    ("ms", 1e12, 1e13),
    ("us", 1e15, 1e16),
    ("ns", 1e18, 1e19),
    ("100ns", 1.2e17, 1.6e17),
    ("100ns", 6e17, 6.7e17),
)
_SPREADSHEET_DAYS = (3e4, 7e4)  # since 1900, from 1982 on


def read_times(table: pd.DataFrame, column: str, given_unit: str | None) -> tuple[FloatArray, str]:
    """Time stamps [s] from the first one on, and the unit in which they were read."""
    values = table[column]
    if isinstance(values.dtype, pd.DatetimeTZDtype) or values.dtype.kind in "mM":
        return (values - values.iloc[0]).dt.total_seconds().to_numpy(dtype=float), "date-time"
    if not pd.api.types.is_numeric_dtype(values):
        parts = values.astype(str).str.extract(f"^{TIME_OF_DAY.pattern}$")
        if parts["hour"].notna().mean() > 0.5:
            return _since_midnight(parts, column), "time of day"
    stamps = numbers(table, column)
    unit = given_unit or split_unit(column)[1] or _unit_by_size(stamps)
    if unit not in SECONDS:
        raise Refusal(
            f"the unit {unit!r} of {column!r} is not known; there are {', '.join(SECONDS)}"
        )
    if pd.api.types.is_integer_dtype(values):  # nanoseconds since 1970 are more than a float holds
        stamps = (values - values.iloc[0]).to_numpy(dtype=float)
    return SECONDS[unit] * (stamps - stamps[:1]), unit


def _unit_by_size(stamps: FloatArray) -> str:
    """Unit of stamps that do not say it: of a clock that tells by its size, else seconds."""
    if stamps.size < 2:
        return "s"
    low, high = _SPREADSHEET_DAYS
    if low < stamps[0] < high and np.median(np.abs(np.diff(stamps))) < 1 / _MOST_HZ:
        return "d"
    return next((unit for unit, low, high in _SINCE if low <= stamps[0] < high), "s")


def _since_midnight(parts: pd.DataFrame, column: str) -> FloatArray:
    """Times of day [s] from the first one on, over midnight where the date, or without one the clock, goes on."""
    bad = np.flatnonzero(parts["hour"].isna())
    if bad.size:
        raise Refusal(
            f"{column} is no date-time; mend or cut the log there", row=parts.index[bad[0]]
        )
    hour = parts["hour"].astype(float)
    if parts["half"].notna().any():
        hour = hour % 12 + 12 * parts["half"].str.lower().eq("pm")
    second = parts["second"].str.replace(r"[,:]", ".", regex=True).astype(float)
    t = (3600 * hour + 60 * parts["minute"].astype(float) + second).to_numpy(copy=True)
    if parts["date"].notna().all():
        midnight = (parts["date"] != parts["date"].shift()).to_numpy()[1:]
    else:
        midnight = np.diff(t) < -43200.0
    t[1:] += 86400.0 * np.cumsum(midnight)
    return t - t[:1]


def refuse_backward(t: FloatArray, rows: NDArray[np.int64]) -> None:
    """Refuse time stamps that run backward."""
    wrong = np.flatnonzero(np.diff(t) < 0)
    if wrong.size:
        k = wrong[0] + 1
        where = f"{t[k]:.6g} s follow {t[k - 1]:.6g} s after the first"
        what = f"its time stamps start anew or run backward ({where}; {wrong.size} such rows)"
        raise Refusal(f"{what}; keep one run, sorted by time", row=rows[k])


def sampling_period(t: FloatArray, least_hz: float, ring_hz: float) -> float:
    """Mean sampling period [s] but for gaps, where that is short enough."""
    steps = np.diff(t)
    dt = float(steps[steps <= _LONGEST_STEP * np.median(steps)].mean())
    rate = 1.0 / max(dt, 1e-300)
    if rate > _MOST_HZ:
        raise Refusal(f"{rate:.3g} samples a second: are the stamps in s? then give --time-unit s")
    missing = np.maximum(np.rint(steps / dt) - 1, 0)
    if np.mean(missing > 0) > _FEW_GAPS:
        refuse_invented(int(missing.sum()), t)
    if rate < least_hz:
        what = f"sampled at {rate:.3g} Hz; a ring of {ring_hz:g} Hz after an impact needs {least_hz:g} Hz at least"
        cure = "--ring gives the joint's own; are the time stamps in s? if not, give --time-unit"
        raise Refusal(f"{what} ({cure})")
    return dt


def refuse_invented(missing: int, t: FloatArray) -> None:
    """Refuse samples between whose stamps more than a tenth would have to be invented."""
    share = missing / (missing + t.size)
    if share > _MOST_INVENTED:
        rate = (t.size - 1) / (t[-1] - t[0])
        what = f"its stamps come in bursts or samples are lost: on an even grid {share:.0%} would be invented"
        cure = f"--rate {rate:.6g}, if it was sampled evenly"
        raise Refusal(f"{what}; there are {rate:.6g} samples a second: give {cure}")


def longest_clean(t: FloatArray, first: int, last: int, dt: float) -> tuple[int, int]:
    """The longest part of some samples without a gap that is too long to be filled."""
    steps = np.diff(t[first:last])
    gaps = np.flatnonzero(steps > max(_LONGEST_STEP * dt, dt + _LONGEST_FILLED_S))
    ends = np.concatenate(([first], first + 1 + gaps, [last]))
    best = int((t[ends[1:] - 1] - t[ends[:-1]]).argmax())
    return int(ends[best]), int(ends[best + 1])


def grid_numbers(t: FloatArray, dt: float) -> NDArray[np.int64]:
    """Numbers of samples on the grid that they were taken on: an even one, or one whose clock drifts.

    Those of the fewest holes are taken.
    """
    steps = np.maximum(np.rint(np.diff(t) / dt), 1.0).astype(np.int64)
    drifting = np.concatenate(([0], np.cumsum(steps)))
    even = _even_numbers(t, dt)
    is_even = bool((np.diff(even) > 0).all()) and even[-1] <= drifting[-1]
    return even if is_even else drifting


def _even_numbers(t: FloatArray, dt: float) -> NDArray[np.int64]:
    """Numbers on an even grid, some twice if there is no such grid.

    Its period is what brings the stamps in phase, at first those of a short part, then of longer
    ones.
    """
    reach = 0.1
    size = 0
    start = t[0]
    while size < t.size:
        size = min(max(64, 4 * size), t.size)
        trials = dt * (1 + reach * np.linspace(-1, 1, 81))
        part = t[: size : max(1, size // 2048)] - t[0]
        phases = np.exp(2j * np.pi * part / trials[:, None]).sum(axis=1)
        best = int(np.abs(phases).argmax())
        dt = trials[best]
        start = t[0] + trials[best] * np.angle(phases[best]) / (2 * np.pi)
        reach = 1.5 / size
    k = np.rint((t - start) / dt).astype(np.int64)
    return k - k[0]


def _follows_stamps(v: FloatArray, stray: FloatArray) -> bool:
    """Whether samples tell that they were taken at the stamps, which stray from an even grid by shares of its period.

    Their deviations from the neighbours' course then are its slope times the stray, else they have
    nothing in common.
    """
    curve = np.convolve(v, np.array([1, -4, 6, -4, 1]) / 6, mode="valid")
    slope = np.convolve(v, np.array([2, 1, 0, -1, -2]) / 10, mode="valid")
    moved = slope * stray[2:-2]
    return float(moved @ curve) > 0.5 * float(moved @ moved)


def place_on_grid(
    t: FloatArray, v: FloatArray, dt: float
) -> tuple[FloatArray, FloatArray, float, tuple[str, ...]]:
    """Where on an even grid samples were taken, the grid, its period [s], and notes on both."""
    k = grid_numbers(t, dt)
    dt, start = np.polyfit(k, t, 1)
    stray = (t - start) / dt - k
    nominal = float(f"{1 / dt:.3g}")
    if abs(nominal * dt - 1) * k[-1] * np.sqrt(t.size) < 12 * stray.std() + 1e-6:
        dt = 1 / nominal
    places, even = k.astype(float), np.arange(k[-1] + 1)
    notes: tuple[str, ...] = ()
    most = float(np.abs(stray).max())
    if most > 0.01:
        places, how = _places(k, stray, v, round(_SMOOTHING_S / dt))
        notes = (f"time stamps up to {1e3 * dt * most:.2g} ms off an even {1 / dt:.6g} Hz: {how}",)
        # Within half a sample of the data: far beyond them a spline is anything.
        even = np.arange(np.rint(places[0]), np.rint(places[-1]) + 1)
    holes = int(k[-1]) + 1 - k.size
    refuse_invented(holes, t)
    if holes:
        notes += (f"missing samples filled from their neighbours: {holes}",)
    return places, even, dt, notes


def _places(
    k: NDArray[np.int64], stray: FloatArray, v: FloatArray, width: int
) -> tuple[FloatArray, str]:
    """Where on the grid samples were taken whose stamps stray from their numbers, and what that is called.

    A clock's drift is slow, and followed; what is fast is followed if the signal does.
    """
    drifts = bool(np.abs(stray).max() > 1)
    slow = uniform_filter1d(stray, max(width, 3), mode="nearest") if drifts else np.zeros(k.size)
    if (np.diff(k + slow) <= 0).any():
        return k + stray, "resampled"
    all_k = np.arange(k[-1] + 1)
    if _follows_stamps(np.interp(all_k, k, v), np.interp(all_k, k, stray - slow)):
        return k + stray, "resampled"
    return k + slow, "a clock that drifts, followed" if drifts else "taken as even"
