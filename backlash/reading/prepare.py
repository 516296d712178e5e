"""From the table of a log to a record of the test movement: columns, units, clock, and the constant-speed stretch."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from backlash.reading import UNITS
from backlash.reading.columns import PER_TURN, LogFormat, choose_columns, numbers, seconds, units_per_turn
from backlash.reading.tables import UnusableLog, read_table
from replication.arrays import FloatArray
from replication.datasets import Recording

_RING_HZ = 21.0  # of the oscillation that the signature models, in the paper's joint
_LEAST_RATE_HZ = 4 * _RING_HZ  # below, the shape of an oscillation is not sampled any more
_GOOD_RATE_HZ = 12 * _RING_HZ  # below, the samples may miss more than 3 % of a peak
_FASTEST_HZ = 2000.0  # above, neighbouring samples are averaged

_LEAST_SAMPLES = 8  # of a log, and of a load turn
_LEAST_TURNS = 4  # fewer half turns have too few orders of signs to tell a pattern from noise (see `detect`)
_MOST_TURNS = 60  # what is beyond adds nothing but time
_SPEED_TOLERANCE = 0.03  # of a constant speed; backlash disturbs it by some 1 %
_SMOOTHING_S = 0.1
_LONGEST_STEP = 3.5  # in sampling periods; a longer one is a gap
_SPIKE = 0.3


class CannotTell(Exception):
    """A log that can be read and still has no answer: the reason, what says more, and notes on what was done before."""

    def __init__(self, reason: str, detail: str, notes: tuple[str, ...] = ()):
        super().__init__(f"{reason}: {detail}")
        self.notes = notes


@dataclass(frozen=True)
class _Samples:
    """A log on its way to a record: arrays of shape (samples,), and a sentence for each thing done to it."""

    t: FloatArray  # [s]
    v: FloatArray  # motor speed [rps]
    rows: NDArray[np.int64]  # of the file
    notes: tuple[str, ...]

    def changed(self, note: str, **parts: NDArray) -> "_Samples":
        return replace(self, notes=(*self.notes, note), **parts)

    def part(self, kept: slice, note: str) -> "_Samples":
        return self.changed(note, t=self.t[kept], v=self.v[kept], rows=self.rows[kept])


def read_log(path: Path, form: LogFormat) -> tuple[Recording, tuple[str, ...]]:
    """Read a log's record of constant speed, and notes on what was changed or assumed."""
    try:
        return record_of(read_table(path), form, str(path))
    except UnusableLog as error:
        raise error.in_file(str(path)) from error


def record_of(table: pd.DataFrame, form: LogFormat, name: str) -> tuple[Recording, tuple[str, ...]]:
    """Prepare the record of a table; see `read_log`."""
    samples = _speed_samples(table, form)
    try:
        samples = _evenly_sampled(samples, form)
        samples = _at_constant_speed(samples, form)
        return _recording(samples, form, name)
    except CannotTell as refusal:
        refusal.notes = samples.notes
        raise


def _speed_samples(table: pd.DataFrame, form: LogFormat) -> _Samples:
    """Motor speed of a table at its time stamps."""
    time_column, column, is_position = choose_columns(table, form)
    t, notes = seconds(table, time_column)
    samples = _Samples(t, numbers(table, column), table.index.to_numpy(), notes)
    if t.size > 2 and t[1] == t[0]:
        samples = samples.part(slice(1, None), "dropped the first row: its time stamp is that of the second")
    _check_clock(samples)
    signal = samples.v
    if np.ptp(signal) == 0:
        raise UnusableLog(f"{column} never changes, it is {signal[0]:g} throughout; is it the right column?")
    per_turn, notes = units_per_turn(column, is_position, form)
    samples = replace(samples, v=signal / per_turn, notes=samples.notes + notes)
    return _differentiated(samples, form) if is_position else samples


def _check_clock(samples: _Samples) -> None:
    t = samples.t
    if t.size < 3:
        raise UnusableLog(f"{t.size} sample{'s' * (t.size != 1)}; a log of {_LEAST_TURNS} load turns is needed")
    wrong = np.flatnonzero(np.diff(t) <= 0)
    if wrong.size:
        k = wrong[0] + 1
        what = "repeats the one before" if t[k] == t[k - 1] else "goes backward"
        cure = "sort the log, drop doubled rows, and export stamps with all their digits"
        raise UnusableLog(f"its time stamp {what} ({wrong.size} such rows); {cure}", samples.rows[k])


def _unwrapped_steps(turns: FloatArray, dt: FloatArray, form: LogFormat) -> tuple[FloatArray, float]:
    """Steps of a position [turns] that starts anew after a turn or 2^n counts, and that modulus (0 if it does not)."""
    steps, span = np.diff(turns), float(np.ptp(turns))
    moduli = [1.0]
    if form.counts_per_turn:
        moduli += (2.0 ** np.arange(8, 33) / form.counts_per_turn).tolist()
    modulus = min((m for m in moduli if 0.5 * m < span <= m * (1 + 1e-9)), default=0.0)
    if modulus == 0:
        return steps, 0.0
    speed = form.expected_speed_rps or 0.0
    ways = [steps - modulus * np.round((steps - way * speed * dt) / modulus) for way in (1.0, -1.0)]
    best = min(ways, key=lambda way: abs(abs(float(np.median(way / dt))) - speed)) if speed else ways[0]
    return best, modulus


def _differentiated(samples: _Samples, form: LogFormat) -> _Samples:
    """Speed midway between the samples of a position [turns], unwrapped."""
    t, turns = samples.t, samples.v
    dt = np.diff(t)
    steps, modulus = _unwrapped_steps(turns, dt, form)
    jumps = int(np.count_nonzero(np.abs(steps - np.diff(turns)) > 1e-9))
    speed = steps / dt
    if np.count_nonzero(speed * np.median(speed) < 0) > 0.2 * speed.size:
        problem = "the position starts anew faster than it is sampled, or moves to and fro"
        raise UnusableLog(f"{problem}; give --commanded-speed, or sample faster")
    if jumps:
        samples = samples.changed(f"the position starts anew every {modulus:g} motor turns: unwrapped {jumps} times")
    note = "speed differentiated from the position, between neighbouring samples"
    return samples.changed(note, t=(t[1:] + t[:-1]) / 2, v=speed, rows=samples.rows[1:])


def _evenly_sampled(samples: _Samples, form: LogFormat) -> _Samples:
    """Check the sampling rate, and put the speed on an even grid that is not too fine."""
    steps = np.diff(samples.t)
    dt = float(steps[steps <= _LONGEST_STEP * np.median(steps)].mean())
    rate = 1.0 / dt
    if rate < _LEAST_RATE_HZ:
        needed = f"{_LEAST_RATE_HZ:g} Hz at least, {_GOOD_RATE_HZ:.0f} Hz to be measured well"
        what = f"sampled at {rate:.3g} Hz; the {_RING_HZ:g} Hz oscillation after an impact needs {needed}"
        raise UnusableLog(f"{what} (are the time stamps in s? if not, name the column like 'time [ms]')")
    if rate < _GOOD_RATE_HZ:
        note = f"sampled at {rate:.0f} Hz: below {_GOOD_RATE_HZ:.0f} Hz the peaks are read too low"
        samples = samples.changed(note)
    _refuse_gaps(samples, dt, form)
    return _averaged(_on_even_grid(samples, dt), rate)


def _refuse_gaps(samples: _Samples, dt: float, form: LogFormat) -> None:
    """Refuse a gap that cuts the constant speed in two; elsewhere gaps do no harm."""
    t, v = samples.t, samples.v
    gaps = np.flatnonzero(np.diff(t) > _LONGEST_STEP * dt)
    if gaps.size > 0.05 * t.size:
        raise UnusableLog(f"{gaps.size} gaps in {t.size} samples; log at an even rate")
    level = _level(v, form.expected_speed_rps)
    for k in gaps:
        around = v[max(k - 20, 0) : k + 1], v[k + 1 : k + 21]
        if all(abs(abs(part.mean()) / level - 1) < _SPEED_TOLERANCE for part in around):
            gap = f"a gap of {t[k + 1] - t[k]:.3g} s in the constant speed, at t = {t[k] - t[0]:.4g} s"
            raise UnusableLog(f"{gap}; log again, or cut the log to one side of it", samples.rows[k + 1])


def _on_even_grid(samples: _Samples, dt: float) -> _Samples:
    """Take stamps that are only rounded as even, and resample the speed where they are not even."""
    t = samples.t
    even = t[0] + (t[-1] - t[0]) / (t.size - 1) * np.arange(t.size)
    stray = float(np.abs(t - even).max())
    if stray <= 1e-6 * dt:
        return replace(samples, t=even)
    digit = next((10.0**-k for k in range(10) if np.abs(t / 10.0**-k - np.rint(t / 10.0**-k)).max() < 1e-3), 0.0)
    if stray <= 1.01 * digit and digit <= dt:
        note = f"time stamps rounded to {digit:g} s: taken as even, {1 / (even[1] - even[0]):.6g} Hz"
        return samples.changed(note, t=even)
    even = t[0] + dt * np.arange(int((t[-1] - t[0]) / dt + 1e-6) + 1)
    nearest = np.clip(np.searchsorted(t, even - dt / 2), 0, t.size - 1)
    note = f"uneven time stamps: resampled at {1.0 / dt:.6g} Hz by straight lines"
    return samples.changed(note, t=even, v=np.interp(even, t, samples.v), rows=samples.rows[nearest])


def _averaged(samples: _Samples, rate: float) -> _Samples:
    """Average neighbouring samples of a fast log."""
    if rate <= _FASTEST_HZ:
        return samples
    together = int(rate // (_FASTEST_HZ / 2))
    whole = samples.v.size // together * together
    t, v = (part[:whole].reshape(-1, together).mean(axis=1) for part in (samples.t, samples.v))
    note = f"sampled at {rate:.6g} Hz: averaged over {together} samples each"
    return samples.changed(note, t=t, v=v, rows=samples.rows[:whole:together])


def _level(v: FloatArray, expected: float | None) -> float:
    """The speed [rps], without sign, that a log keeps longest; near the expected one if that is among them."""
    speed = np.abs(v)
    if expected is not None and np.mean(np.abs(speed / expected - 1) < 2 * _SPEED_TOLERANCE) > 0.1:
        speed = speed[np.abs(speed / expected - 1) < 2 * _SPEED_TOLERANCE]
    moving = speed[speed > 0.05 * np.percentile(speed, 99)]
    if moving.size == 0:
        return float(speed.max())
    edges = np.linspace(0, moving.max() * 1.001 + 1e-300, 201)
    count = np.histogram(moving, edges)[0]
    best = int(np.convolve(count, np.ones(3), mode="same").argmax())
    near = moving[(moving >= edges[max(best - 1, 0)]) & (moving <= edges[min(best + 2, 200)])]
    return float(np.median(near))


def _at_constant_speed(samples: _Samples, form: LogFormat) -> _Samples:
    """Cut out the longest stretch at constant speed, turned forward."""
    t, v = samples.t, samples.v
    if v.size < _LEAST_SAMPLES:
        lasts = t[-1] - t[0] if t.size else 0.0  # averaging may leave none
        raise CannotTell("too short", f"{lasts:.3g} s in {t.size} samples; {_LEAST_TURNS} load turns are needed")
    _refuse_spikes(samples, form)
    dt = (t[-1] - t[0]) / (t.size - 1)
    width = max(3, round(_SMOOTHING_S / dt))
    smooth = uniform_filter1d(v, width, mode="nearest")
    level = _level(smooth, form.expected_speed_rps)
    if level <= np.std(v) or level == 0:
        raise CannotTell("not constant speed", "the motor stands still, or turns both ways")
    _check_speed(level, form)
    first, last = _longest_run(np.where(np.abs(np.abs(smooth) / level - 1) < _SPEED_TOLERANCE, np.sign(smooth), 0.0))
    settle = 2 * width
    first, last = (first + settle if first > 0 else 0), (last - settle if last < v.size else v.size)
    period = form.period_s(level)
    turns = max(last - first, 0) * dt / period
    if period < _LEAST_SAMPLES * dt:
        raise CannotTell("too short", f"a load turn of {period:.3g} s is {period / dt:.1f} samples long")
    if turns < _LEAST_TURNS - 1.5 * dt / period:
        lasts = f"{turns:.1f} load turns of {period:.4g} s at {level:.4g} rps; {_LEAST_TURNS} are needed, 12 are good"
        raise CannotTell("too short" if last - first > 0.9 * v.size else "not constant speed", lasts)
    if last - first < v.size:
        start, end = t[first] - t[0], t[last - 1] - t[0]
        note = f"used the constant speed from {start:.3f} to {end:.3f} s of {t[-1] - t[0]:.3f} s"
        samples = samples.part(slice(first, last), note)
    if turns > _MOST_TURNS:
        whole = slice(round(_MOST_TURNS * period / dt) + 1)
        samples = samples.part(whole, f"{turns:.0f} turns: used the first {_MOST_TURNS}")
    if samples.v.mean() < 0:
        samples = samples.changed("the motor turns backward: the speed's sign is changed", v=-samples.v)
    return replace(samples, t=samples.t - samples.t[0])


def _longest_run(state: FloatArray) -> tuple[int, int]:
    """First and past-the-end index of the longest run of one value that is not 0; (0, 0) if there is none."""
    starts = np.concatenate(([0], np.flatnonzero(np.diff(state)) + 1, [state.size]))
    lengths = np.where(state[starts[:-1]] != 0, np.diff(starts), 0)
    best = int(lengths.argmax())
    return (int(starts[best]), int(starts[best + 1])) if lengths[best] else (0, 0)


def _recording(samples: _Samples, form: LogFormat, name: str) -> tuple[Recording, tuple[str, ...]]:
    """Check that the speed is constant and not clipped, and give the record its speed and turn period."""
    _refuse_clipping(samples)
    v = samples.v
    mean, quarter = float(v.mean()), v.size // 4
    drift = float(v[-quarter:].mean() - v[:quarter].mean())
    if abs(drift) > _SPEED_TOLERANCE / 3 * mean:
        raise CannotTell("not constant speed", f"it drifts by {drift:+.3g} rps from {mean:.4g} rps")
    period, ratio = form.period_s(mean), form.gear_ratio
    if form.turn_period_s is None:
        samples = samples.changed(f"a load turn takes {period:.6g} s: gear ratio {ratio:g} at {mean:.6g} rps")
    elif ratio is not None and abs(ratio / mean / period - 1) > _SPEED_TOLERANCE:
        turn = f"gear ratio {ratio:g} at {mean:.5g} rps makes turns of {ratio / mean:.4g} s"
        raise CannotTell("wrong period", f"{turn}, not the {period:g} s given")
    return Recording(samples.t, v, form.commanded_speed_rps or mean, period, name), samples.notes


def _check_speed(level: float, form: LogFormat) -> None:
    """Refuse a speed that is as far from the expected one as one unit from another; doubt one that is off otherwise."""
    expected, why = form.expected_speed_rps, "commanded" if form.commanded_speed_rps else "by gear ratio and turn"
    if expected is None:
        expected, why = form.usual_speed_rps, "in the calibration"
    if expected is None or abs(level / expected - 1) < _SPEED_TOLERANCE:
        return
    unit = form.unit or "rps"
    for other in UNITS[:3] if unit in PER_TURN else ():
        if other != unit and abs(level / expected * PER_TURN[unit] / PER_TURN[other] - 1) < 0.05:
            hint = f"is the speed in {other}? then give --unit {other}"
            raise UnusableLog(f"the speed is {level:.4g} rps, {expected:.4g} rps {why}; {hint}")
    if form.expected_speed_rps is not None:
        raise CannotTell("not constant speed", f"the log keeps {level:.4g} rps longest, not {expected:.4g} rps, {why}")


def _refuse_spikes(samples: _Samples, form: LogFormat) -> None:
    """Refuse single samples that no motor could follow."""
    v = samples.v
    level = _level(v, form.expected_speed_rps)
    before, after = np.abs(np.diff(v)[:-1]), np.abs(np.diff(v)[1:])
    away = np.flatnonzero(np.minimum(before, after) > _SPIKE * level)
    away = away[np.abs(v[away] - v[away + 2]) < 0.1 * level]
    if 0 < away.size <= 0.01 * v.size:
        k = away[0] + 1
        spike = f"a spike, {v[k]:.4g} rps beside {v[k - 1]:.4g} ({away.size} such samples)"
        raise UnusableLog(f"{spike}; mend or cut the log there", samples.rows[k])


def _refuse_clipping(samples: _Samples) -> None:
    """Refuse a speed that stops at a limit; one of few different values is coarse, not clipped."""
    v = samples.v
    if np.unique(v[:5000]).size < 16:
        return
    for limit in (v.max(), v.min()):
        at = v == limit
        held = np.flatnonzero(at[2:] & at[1:-1] & at[:-2])
        if held.size > 0.005 * v.size:
            clipped = f"the speed is clipped at {limit:.6g} rps in {np.count_nonzero(at)} samples"
            raise UnusableLog(f"{clipped}; log it with a wider range", samples.rows[held[0]])
