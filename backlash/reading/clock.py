"""When samples were taken: time stamps as seconds, and the even grid behind them."""

from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from backlash.reading import limits
from backlash.reading.columns import numeric_column
from backlash.reading.samples import Samples
from backlash.reading.tables import TIME_OF_DAY
from backlash.reading.units import SECONDS, split_unit
from backlash.refusals import Refusal
from replication.signature import FloatArray


def read_times(table: pd.DataFrame, column: str, given_unit: str | None) -> tuple[FloatArray, str]:
    """Time stamps [s] from the first one on, and the unit in which they were read."""
    values = table[column]
    if values.dtype.kind in "mM":
        return (values - values.iloc[0]).dt.total_seconds().to_numpy(dtype=float), "date-time"
    if not pd.api.types.is_numeric_dtype(values):
        parts = values.astype(str).str.extract(f"^{TIME_OF_DAY.pattern}$")
        if parts["clock"].notna().mean() > 0.5:
            return _times_of_day(parts, column), "time of day"
    stamps = numeric_column(table, column)
    # Stamps that do not say it are those of a clock since 1970, else seconds.
    low, high = limits.SINCE_1970_S
    since_1970 = (unit for unit in ("ms", "us", "ns") if low < SECONDS[unit] * stamps[0] < high)
    unit = given_unit or split_unit(column)[1] or next(since_1970, "s")
    if unit not in SECONDS:
        raise Refusal(
            f"the unit {unit!r} of {column!r} is not known; there are {', '.join(SECONDS)}"
        )
    # Nanoseconds since 1970 are more than a float holds.
    values = pd.to_numeric(values)
    return SECONDS[unit] * (values - values.iloc[0]).to_numpy(dtype=float), unit


def _times_of_day(parts: pd.DataFrame, column: str) -> FloatArray:
    """Times of day [s] from the first one on; as no log lacks half a day, midnight is told without the date."""
    clock = parts["clock"] + "." + parts["fraction"].fillna("0")
    seconds = pd.to_timedelta(clock, errors="coerce").dt.total_seconds()
    if seconds.isna().any():
        row = seconds.index[seconds.isna()][0]
        raise Refusal(f"{column} is no date-time; mend or cut the log there", row=row)
    hours = 12 if parts["half"].notna().any() else 24
    return np.unwrap((seconds - seconds.iloc[0]).to_numpy(), period=3600.0 * hours)


def refuse_backward(t: FloatArray, rows: pd.Index) -> None:
    """Refuse time stamps that run backward."""
    wrong = np.flatnonzero(np.diff(t) < 0)
    if wrong.size:
        k = wrong[0] + 1
        raise Refusal(
            f"its time stamps start anew or run backward ({t[k]:.6g} s follow {t[k - 1]:.6g} s after the first; "
            f"{wrong.size} such rows); keep one run, sorted by time",
            row=rows[k],
        )


def sampling_period(samples: Samples) -> float:
    """Mean sampling period [s] but for gaps, where that is short enough."""
    t, ring_hz = samples.t, samples.options.ring_hz
    steps = np.diff(t)
    dt = float(steps[steps <= limits.LONGEST_STEP * np.median(steps)].mean())
    rate = 1.0 / max(dt, 1e-300)
    # Of stamps in whole milliseconds a step of 2 ms may be read as 3.
    missing = np.maximum(np.ceil(steps / dt - 1.6), 0)
    if np.mean(missing > 0) > limits.FEW_GAPS:
        _refuse_invented(int(missing.sum()), samples)
    least_hz = limits.LEAST_RATE * ring_hz
    if not least_hz <= rate <= limits.MOST_HZ:
        raise Refusal(
            f"sampled at {rate:.3g} Hz by its time stamps; a ring of {ring_hz:g} Hz after an impact needs {least_hz:g} "
            "Hz at least (--ring gives the joint's own); are the stamps in s? if not, give --time-unit; if they count "
            "samples, --rate"
        )
    return dt


def _refuse_invented(missing: int, samples: Samples) -> None:
    """Refuse samples between whose stamps more than a tenth would have to be invented."""
    t, v = samples.t, samples.v
    share = missing / (missing + t.size)
    if share <= limits.MOST_INVENTED:
        return
    # Values that came in any order would repeat.
    if t.size > limits.LEAST_VALUES * np.unique(v).size and (np.diff(v) != 0).all():
        raise Refusal(
            f"its rows stand only where {samples.columns.signal} changed ({missing:,} are missing between, no value "
            "repeats); log at a fixed rate"
        )
    rate = f"{samples.rate_hz:.6g}"
    raise Refusal(
        f"its stamps come in bursts or samples are lost: on an even grid {share:.0%} would be invented; "
        f"there are {rate} samples a second: give --rate {rate}, if it was sampled evenly"
    )


def _even_clock(t: FloatArray, dt: float) -> tuple[FloatArray, float, float]:
    """Numbers of samples on the grid that they were taken on, its period and its start [s].

    None is missing, or those that long steps tell of: taken is what an even clock explains better, for steps are long
    also where stamps are late.
    """
    steps = np.maximum(np.rint(np.diff(t) / dt), 1.0)
    numbered = np.arange(float(t.size)), np.concatenate(([0.0], np.cumsum(steps)))
    clocks = [(k, *np.polyfit(k, t, 1)) for k in numbered]
    return min(clocks, key=lambda clock: np.std(t - clock[1] * clock[0]) / clock[1])


def _follows_stamps(k: FloatArray, v: FloatArray, stray: FloatArray) -> bool:
    """Whether samples tell that they were taken at the stamps, which stray from an even grid by shares of its period.

    Their deviations from the neighbours' course then are its slope times the stray, else they have
    nothing in common.
    """
    v, stray = (np.interp(np.arange(k[-1] + 1), k, each) for each in (v, stray))
    curve = np.convolve(v, np.array([1, -4, 6, -4, 1]) / 6, mode="valid")
    slope = np.convolve(v, np.array([2, 1, 0, -1, -2]) / 10, mode="valid")
    moved = slope * stray[2:-2]
    return float(moved @ curve) > 0.5 * float(moved @ moved)


def place_on_grid(samples: Samples) -> Samples:
    """Put samples on the even grid that they were taken on.

    What strays by more than a period is a clock's drift, and followed; what is fast is if the signal
    follows it.
    """
    t, signals = samples.t, samples.signals
    k, dt, start = _even_clock(t, sampling_period(samples))
    holes = int(k[-1]) + 1 - k.size
    _refuse_invented(holes, samples)
    places, stray = k, (t - start) / dt - k
    nominal = float(f"{1 / dt:.3g}")
    if abs(nominal * dt - 1) * k[-1] * np.sqrt(t.size) < 12 * stray.std() + 1e-6:
        dt = 1 / nominal
    most = float(np.abs(stray).max())
    if most > 0.01:
        how = "taken as even"
        if most > 1 or _follows_stamps(k, samples.v, stray):
            how = "resampled"
            places = k + stray
        off = f"time stamps up to {1e3 * dt * most:.2g} ms off an even {1 / dt:.6g} Hz"
        samples = samples.noting(f"{off}: {how}")
    if holes:
        samples = samples.noting(f"missing samples filled from their neighbours: {holes}")
    # Within half a sample of the data: far beyond them a spline is anything.
    even = np.arange(np.rint(places[0]), np.rint(places[-1]) + 1)
    if not np.array_equal(places, even):
        signals = CubicSpline(places, signals, axis=1)(even)
    return replace(samples, t=start + dt * even, signals=signals)
