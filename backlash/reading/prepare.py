"""Prepare: from the table of a log to a record of the test movement at constant speed, evenly sampled."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from backlash.reading import UNITS
from backlash.reading.columns import (
    PER_TURN,
    LogFormat,
    choose_columns,
    given_column,
    numbers,
    seconds,
    unit_of,
    with_whole_stamps,
)
from backlash.reading.sources import Source, Table, read_source
from backlash.refusals import Reason, Refusal
from replication.arrays import FloatArray
from replication.records import Recording

_RING_HZ = 21.0  # of the oscillation that the signature models, in the paper's joint
_LEAST_RATE_HZ = 4 * _RING_HZ  # below, the shape of an oscillation is not sampled any more
_GOOD_RATE_HZ = 12 * _RING_HZ  # below, the samples may miss more than 3 % of a peak
_FASTEST_HZ = 2000.0  # above, neighbouring samples are averaged
_MOST_HZ = 1e6  # no logger samples faster; the stamps have another unit

_FASTEST_RPS = 500.0  # of a motor, 30000 rpm; above, the unit is another one
_LEAST_SAMPLES = 8  # of a log, and of a load turn
# Fewer half turns have too few orders of signs to tell a pattern from noise (see `pattern`).
_LEAST_TURNS = 4
_MOST_TURNS = 60  # what is beyond adds nothing but time
_SLOWEST_RPS = 1e-6  # of a motor that is not said to stand still
_UNIT_TOLERANCE = 0.03  # of a speed beside the one that was said
_MOST_DRIFT = 0.01  # of a speed that is said to be constant
_SMOOTHING_S = 0.1
# What misses more than both is a gap; less is filled, a fifth of the ring's period at most.
_LONGEST_STEP = 3.5  # in sampling periods
_LONGEST_FILLED_S = 0.010
_SPIKE = 0.3
_MOST_SPIKES = 5  # in a log that is mended by hand
_LEAST_VALUES = 16  # of a speed that is not merely coarse


@dataclass(frozen=True, eq=False, kw_only=True)
class Log(Source):
    """A log that was read: its record of constant speed, and what was said and assumed of it.

    Its recording's t [s] and v [rps] are the samples that an estimate uses.
    """

    recording: Recording
    notes: tuple[str, ...] = ()
    form: LogFormat
    torque: FloatArray | None = None  # of the motor at the recording's samples, in the log's unit

    @property
    def makes_strokes(self) -> bool:
        """Whether the motor turns to and fro."""
        return _reverses(self.recording.v)


@dataclass(frozen=True)
class _Samples:
    """A log on its way to a record: arrays of shape (samples,), and a sentence for each thing done to it."""

    t: FloatArray  # [s]
    v: FloatArray  # motor speed [rps], at first perhaps position [turns]
    rows: NDArray[np.int64]  # of the file
    notes: tuple[str, ...]
    torque: FloatArray | None = None  # of the motor

    def changed(self, note: str, **parts: NDArray) -> "_Samples":
        return replace(self, notes=(*self.notes, note), **parts)

    def part(self, kept: slice, note: str) -> "_Samples":
        return self.both(lambda signal: signal[kept]).changed(
            note, t=self.t[kept], rows=self.rows[kept]
        )

    def both(self, change: Callable[[FloatArray], FloatArray]) -> "_Samples":
        """Change speed and torque alike."""
        return replace(
            self, v=change(self.v), torque=None if self.torque is None else change(self.torque)
        )


def open_log(
    source: object, form: LogFormat, v: ArrayLike | None = None, torque: ArrayLike | None = None
) -> Log:
    """Read and prepare a log, unless that was done before; see `read_source`."""
    return (
        source if isinstance(source, Log) else prepare(read_source(source, form, v, torque), form)
    )


def prepare(table: Table, form: LogFormat) -> Log:
    """Prepare the record of a table."""
    try:
        return _prepare(table, form)
    except Refusal as error:
        is_told_elsewhere = table.sha256 is None or not error.is_unusable
        raise error if is_told_elsewhere else error.in_file(table.file) from error


def _prepare(table: Table, form: LogFormat) -> Log:
    frame = with_whole_stamps(table.frame)
    if form.torque:
        form = replace(form, torque=given_column(list(frame.columns), form.torque))
    time, column, is_position = choose_columns(frame, form)
    time = None if form.rate_hz else time
    unit, guess = unit_of(column, is_position, form)
    samples = _read_samples(frame, time, column, form)
    per_turn = {**PER_TURN, "counts": form.counts_per_turn or 1.0}[unit]
    samples = replace(samples, v=samples.v / per_turn, notes=samples.notes + guess)
    try:
        dt = _sampling_period(samples)
        if is_position:
            samples = _unwrapped(samples, form)
        samples = _at_constant_speed(samples, is_position, dt, form)
        samples = _on_even_grid(samples, dt)
        if is_position:
            samples = _differentiated(samples)
        samples = _averaged(samples)
        _refuse_clipping(samples)
        return _log_of(samples, table, form)
    except Refusal as refusal:
        refusal.notes = samples.notes
        raise


def _read_samples(table: pd.DataFrame, time: str | None, column: str, form: LogFormat) -> _Samples:
    """The signal of a table, in its own unit, at its time stamps, or at an even rate."""
    needed = [time, column] if time else [column]
    missing = table[needed].isna().any(axis=1).to_numpy()
    if time:
        t, notes = seconds(table[~missing], time, form.time_unit)
    else:
        t = np.flatnonzero(~missing) / (form.rate_hz or np.nan)
        notes = (f"taken as even, {form.rate_hz:g} Hz, as said",)
    table = table[~missing]
    if missing.any():
        notes += (f"left out {missing.sum()} rows without {' or '.join(needed)}",)
    kept = (t >= (form.start_s or 0.0)) & (t <= (np.inf if form.end_s is None else form.end_s))
    if not kept.all():
        notes += (f"used {kept.sum()} of {t.size} samples, by --from and --to",)
        if not kept.any():
            raise Refusal(f"no samples between --from and --to; the log lasts {t[-1]:.6g} s")
    torque = None if form.torque is None else numbers(table[kept], form.torque)
    samples = _Samples(
        t[kept], numbers(table[kept], column), table.index.to_numpy()[kept], notes, torque
    )
    if samples.t.size > 2 and samples.t[1] == samples.t[0]:
        samples = samples.part(
            slice(1, None), "dropped the first row: its time stamp is that of the second"
        )
    _check_clock(samples)
    if np.ptp(samples.v) == 0:
        raise Refusal(
            f"{column} never changes, it is {samples.v[0]:g} throughout; is it the right column?"
        )
    return samples


def _check_clock(samples: _Samples) -> None:
    t = samples.t
    if t.size < 3:
        raise Refusal(
            f"{t.size} sample{'s' * (t.size != 1)}; a log of {_LEAST_TURNS} load turns is needed"
        )
    wrong = np.flatnonzero(np.diff(t) <= 0)
    if wrong.size:
        k = wrong[0] + 1
        what = "repeats the one before" if t[k] == t[k - 1] else "goes backward"
        cure = "sort the log, drop doubled rows, and export stamps with all their digits"
        raise Refusal(
            f"its time stamp {what} ({wrong.size} such rows); {cure}", row=samples.rows[k]
        )


def _differentiated(samples: _Samples) -> _Samples:
    """Speed from a position on an even grid; the torque's mean between samples, as the speed's, is by its integral."""
    if samples.torque is not None:
        from scipy.interpolate import CubicSpline  # slow to import

        samples = replace(
            samples, torque=CubicSpline(samples.t, samples.torque).antiderivative()(samples.t)
        )
    samples = samples.both(lambda signal: np.diff(signal) / np.diff(samples.t))
    note = "speed differentiated from the position, between neighbouring samples"
    return samples.changed(note, t=samples.t[1:], rows=samples.rows[1:])


def _unwrapped(samples: _Samples, form: LogFormat) -> _Samples:
    """A position [turns] that goes on where it started anew after a turn or 2^n counts."""
    turns, dt = samples.v, np.diff(samples.t)
    steps, span = np.diff(turns), float(np.ptp(turns))
    moduli = [1.0]
    if form.counts_per_turn:
        moduli += (2.0 ** np.arange(8, 33) / form.counts_per_turn).tolist()
    modulus = min((m for m in moduli if 0.5 * m < span <= m * (1 + 1e-9)), default=0.0)
    if modulus == 0:
        return samples
    speed = form.expected_speed_rps or 0.0
    ways = [steps - modulus * np.round((steps - way * speed * dt) / modulus) for way in (1.0, -1.0)]
    best = min(ways, key=lambda way: abs(abs(float(np.median(way / dt))) - speed))
    short = dt <= 1.5 * np.median(
        dt
    )  # where samples are missing, the speed is that of the neighbours
    near = np.interp(np.arange(dt.size), np.flatnonzero(short), best[short] / dt[short])
    best = np.where(short, best, steps - modulus * np.round((steps - near * dt) / modulus))
    jumps = int(np.count_nonzero(np.abs(best - steps) > 1e-9))
    if jumps and np.count_nonzero(best * np.median(best) < 0) > 0.2 * best.size:
        problem = "the position starts anew faster than it is sampled, or moves to and fro"
        raise Refusal(f"{problem}; give --commanded-speed, or sample faster")
    note = f"the position starts anew every {modulus:g} motor turns: unwrapped {jumps} times"
    turns = turns[0] + np.concatenate([[0.0], np.cumsum(best)])
    return samples.changed(note, v=turns) if jumps else samples


def _sampling_period(samples: _Samples) -> float:
    """Mean sampling period [s] but for gaps, where that is short enough."""
    steps = np.diff(samples.t)
    dt = float(steps[steps <= _LONGEST_STEP * np.median(steps)].mean())
    rate = 1.0 / max(dt, 1e-300)
    if rate > _MOST_HZ:
        raise Refusal(f"{rate:.3g} samples a second: are the stamps in s? then give --time-unit s")
    if rate < _LEAST_RATE_HZ:
        needed = f"{_LEAST_RATE_HZ:g} Hz at least, {_GOOD_RATE_HZ:.0f} Hz to be measured well"
        what = f"sampled at {rate:.3g} Hz; the {_RING_HZ:g} Hz oscillation after an impact needs {needed}"
        raise Refusal(f"{what} (are the time stamps in s? if not, give --time-unit)")
    return dt


def _longest_clean(t: FloatArray, first: int, last: int, dt: float) -> tuple[int, int]:
    """The longest part of some samples without a gap that is too long to be filled."""
    steps = np.diff(t[first:last])
    gaps = np.flatnonzero(steps > max(_LONGEST_STEP * dt, dt + _LONGEST_FILLED_S))
    ends = np.concatenate(([first], first + 1 + gaps, [last]))
    best = int((t[ends[1:] - 1] - t[ends[:-1]]).argmax())
    return int(ends[best]), int(ends[best + 1])


def _describe_gap(samples: _Samples, first: int, last: int) -> Refusal:
    """The refusal of samples for their longest gap."""
    steps = np.diff(samples.t[first:last])
    k = first + int(steps.argmax())
    gap = f"a gap of {steps.max():.3g} s in the constant speed, at t = {samples.t[k]:.4g} s"
    cure = "no part without one is long enough; log again"
    return Refusal(f"{gap}; {cure}", row=samples.rows[k + 1])


def _grid_numbers(t: FloatArray, dt: float) -> NDArray[np.int64]:
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
        phases = np.exp(
            2j * np.pi * (t[: size : max(1, size // 2048)] - t[0]) / trials[:, None]
        ).sum(axis=1)
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


def _on_even_grid(samples: _Samples, dt: float) -> _Samples:
    """Put the samples on the even grid that they were taken on, and fill its holes; resample what has no such grid."""
    t = samples.t
    k = _grid_numbers(t, dt)
    dt, start = np.polyfit(k, t, 1)
    stray = (t - start) / dt - k
    nominal = float(f"{1 / dt:.3g}")
    if abs(nominal * dt - 1) * k[-1] * np.sqrt(t.size) < 12 * stray.std() + 1e-6:
        dt = 1 / nominal
    places, even = k.astype(float), np.arange(k[-1] + 1)
    most = float(np.abs(stray).max())
    if most > 0.01:
        places, how = _places(k, stray, samples.v, round(_SMOOTHING_S / dt))
        off = f"time stamps up to {1e3 * dt * most:.2g} ms off an even {1 / dt:.6g} Hz"
        samples = samples.changed(f"{off}: {how}")
        # Within half a sample of the data: far beyond them a spline is anything.
        even = np.arange(np.rint(places[0]), np.rint(places[-1]) + 1)
    holes = int(k[-1]) + 1 - k.size
    if holes:
        samples = samples.changed(f"missing samples filled from their neighbours: {holes}")
    if not np.array_equal(places, even):
        from scipy.interpolate import CubicSpline  # slow to import

        samples = samples.both(lambda signal: CubicSpline(places, signal)(even))
    rows = samples.rows[np.minimum(np.searchsorted(places, even), k.size - 1)]
    return replace(samples, t=dt * even, rows=rows)


def _places(
    k: NDArray[np.int64], stray: FloatArray, v: FloatArray, width: int
) -> tuple[FloatArray, str]:
    """Where on the grid samples were taken whose stamps stray from their numbers, and what that is called.

    A clock's drift is slow, and followed; what is fast is followed if the signal does.
    """
    drifts = bool(np.abs(stray).max() > 1)
    slow = moving_mean(stray, max(width, 3)) if drifts else np.zeros(k.size)
    if (np.diff(k + slow) <= 0).any():
        return k + stray, "resampled"
    all_k = np.arange(k[-1] + 1)
    if _follows_stamps(np.interp(all_k, k, v), np.interp(all_k, k, stray - slow)):
        return k + stray, "resampled"
    return k + slow, "a clock that drifts, followed" if drifts else "taken as even"


def _averaged(samples: _Samples) -> _Samples:
    """Average neighbouring samples of a fast log."""
    rate = 1.0 / (samples.t[1] - samples.t[0])
    if rate < _GOOD_RATE_HZ:
        return samples.changed(
            f"sampled at {rate:.0f} Hz: below {_GOOD_RATE_HZ:.0f} Hz the peaks are read too low"
        )
    if rate <= _FASTEST_HZ:
        return samples
    together = int(rate // (_FASTEST_HZ / 2))
    whole = samples.v.size // together * together
    t = samples.t[:whole].reshape(-1, together).mean(axis=1)
    samples = samples.both(lambda signal: signal[:whole].reshape(-1, together).mean(axis=1))
    note = f"sampled at {rate:.6g} Hz: averaged over {together} samples each"
    return samples.changed(note, t=t, rows=samples.rows[:whole:together])


def _level(v: FloatArray, expected: float | None) -> float:
    """The speed [rps], without sign, that a log keeps longest; near the expected one if that is among them."""
    speed = np.abs(v)
    if expected is not None and np.mean(np.abs(speed / expected - 1) < 2 * _UNIT_TOLERANCE) > 0.1:
        speed = speed[np.abs(speed / expected - 1) < 2 * _UNIT_TOLERANCE]
    moving = speed[speed > 0.05 * np.percentile(speed, 99)]
    if moving.size == 0:
        return float(speed.max())
    edges = np.linspace(0, moving.max() * 1.001 + 1e-300, 201)
    count = np.histogram(moving, edges)[0]
    best = int(np.convolve(count, np.ones(3), mode="same").argmax())
    near = moving[(moving >= edges[max(best - 1, 0)]) & (moving <= edges[min(best + 2, 200)])]
    return float(np.median(near))


def _at_constant_speed(
    samples: _Samples, is_position: bool, dt: float, form: LogFormat
) -> _Samples:
    """Cut out the longest stretch at constant speed, turned forward."""
    t, v = samples.t, samples.v
    if v.size < _LEAST_SAMPLES:
        found = f"{t[-1] - t[0]:.3g} s in {t.size} samples"
        raise Refusal(f"{found}; {_LEAST_TURNS} load turns are needed", Reason.TOO_SHORT)
    if is_position:
        v = _rough_speed(v, t, dt)
    if 1 / dt > _FASTEST_HZ:
        v = moving_mean(v, int(2 / _FASTEST_HZ / dt))
    _refuse_spikes(v, samples.rows, form)
    width = max(3, round(_SMOOTHING_S / dt))
    smooth = moving_mean(v, width)
    level = _level(smooth, form.expected_speed_rps)
    if level <= max(float(np.std(v - smooth)), _SLOWEST_RPS):
        raise Refusal("the motor stands still, or turns both ways", Reason.NOT_CONSTANT_SPEED)
    _check_speed(level, form)
    period = form.period_s(level)
    if period < _LEAST_SAMPLES * dt:
        raise Refusal(
            f"a load turn of {period:.3g} s is {period / dt:.1f} samples long", Reason.TOO_SHORT
        )
    is_level = np.abs(np.abs(smooth) / level - 1) < form.speed_tolerance
    first, last = _longest_run(np.where(is_level, np.sign(smooth), 0.0))
    first = min(first + 2 * width, v.size - 1) if first > 0 else 0
    last -= 2 * width if last < v.size else 0
    last = max(last, first + 1)
    whole = first, last
    first, last = _longest_clean(t, *whole, dt)
    turns, needed = (t[last - 1] - t[first]) / period, _LEAST_TURNS - 1.5 * dt / period
    if turns < needed:
        if _reverses(smooth) and form.torque and form.gear_ratio:
            return _cut(samples, *_longest_clean(t, 0, v.size, dt))
        if (t[whole[1] - 1] - t[whole[0]]) / period >= needed:
            raise _describe_gap(samples, *whole)
        reason = Reason.TOO_SHORT if last - first > 0.9 * v.size else Reason.NOT_CONSTANT_SPEED
        raise Refusal(_too_few(turns, period, level, form), reason)
    samples = _cut(samples, first, last)
    if turns > _MOST_TURNS:
        kept = slice(round(_MOST_TURNS * period / dt) + 1)
        samples = samples.part(kept, f"{turns:.0f} turns: used the first {_MOST_TURNS}")
    if smooth[first] < 0:
        samples = samples.both(np.negative).changed(
            "the motor turns backward: the speed's sign is changed"
        )
    return samples


def moving_mean(values: FloatArray, width: int) -> FloatArray:
    """Means of so many neighbours; beyond the ends the values stay. `scipy.ndimage` is slow to import."""
    padded = np.pad(values - values[0], (width // 2 + 1, (width - 1) // 2), mode="edge")
    sums = np.cumsum(padded)
    return values[0] + (sums[width:] - sums[:-width]) / width


def _cut(samples: _Samples, first: int, last: int) -> _Samples:
    t = samples.t
    if last - first == t.size:
        return samples
    part = f"from {t[first] - t[0]:.3f} to {t[last - 1] - t[0]:.3f} s of {t[-1] - t[0]:.3f} s"
    return samples.part(slice(first, last), f"used the constant speed {part}")


def _too_few(turns: float, period: float, level: float, form: LogFormat) -> str:
    """What is missing in a log of too few turns, and what may be wrong with what is said of it."""
    found = f"{turns:.1f} load turns of {period:.4g} s at {level:.4g} rps"
    needed = (
        f"{_LEAST_TURNS} are needed, 12 are good; strokes to and fro need --torque and --gear-ratio"
    )
    ratio = form.gear_ratio or 1.0
    if form.turn_period_s is None and ratio > 1 and turns * ratio > _LEAST_TURNS:
        needed += "; is this the joint's side? then --gear-ratio 1"
    return f"{found}; {needed}"


def _rough_speed(turns: FloatArray, t: FloatArray, dt: float) -> FloatArray:
    """Speed [rps] of a position, by its stamps or by the grid that they stray from, whichever is smoother."""
    k = _grid_numbers(t, dt)
    speeds = [np.gradient(turns, clock) for clock in (t, np.polyval(np.polyfit(k, t, 1), k))]
    return min(speeds, key=lambda v: float(np.abs(np.diff(v, 2)).mean()))


def _reverses(v: FloatArray) -> bool:
    """Whether a speed of strokes to and fro, both ways about as fast."""
    return bool(v.min() < -0.5 * v.max() and v.max() > -0.5 * v.min())


def _longest_run(state: FloatArray) -> tuple[int, int]:
    """First and past-the-end index of the longest run of one value that is not 0; (0, 0) if there is none."""
    starts = np.concatenate(([0], np.flatnonzero(np.diff(state)) + 1, [state.size]))
    lengths = np.where(state[starts[:-1]] != 0, np.diff(starts), 0)
    best = int(lengths.argmax())
    return (int(starts[best]), int(starts[best + 1])) if lengths[best] else (0, 0)


def _log_of(samples: _Samples, table: Table, form: LogFormat) -> Log:
    """Check that the speed does not drift, and give the record its speed and turn period."""
    v = samples.v
    strokes = _reverses(v)
    mean = _level(v, form.expected_speed_rps) if strokes else float(v.mean())
    quarter = v.size // 4
    drift = float(v[-quarter:].mean() - v[:quarter].mean())
    if not strokes and abs(drift) > _MOST_DRIFT * mean:
        raise Refusal(
            f"it drifts by {drift:+.3g} rps from {mean:.4g} rps", Reason.NOT_CONSTANT_SPEED
        )
    period = form.period_s(mean)
    ratio = form.gear_ratio
    if form.turn_period_s is None:
        samples = samples.changed(
            f"a load turn takes {period:.6g} s: gear ratio {ratio:g} at {mean:.6g} rps"
        )
    elif ratio is not None and abs(ratio / mean / period - 1) > _UNIT_TOLERANCE:
        turn = f"gear ratio {ratio:g} at {mean:.5g} rps makes turns of {ratio / mean:.4g} s"
        raise Refusal(f"{turn}, not the {period:g} s given", Reason.WRONG_PERIOD)
    recording = Recording(
        samples.t - samples.t[0], v, form.commanded_speed_rps or mean, period, table.file
    )
    return Log(
        file=table.file,
        sha256=table.sha256,
        recording=recording,
        notes=samples.notes,
        form=form,
        torque=samples.torque,
    )


def _check_speed(level: float, form: LogFormat) -> None:
    """Refuse a speed that is as far from the expected one as one unit from another; doubt one that is off otherwise."""
    expected, why = (
        form.expected_speed_rps,
        "commanded" if form.commanded_speed_rps else "by gear ratio and turn",
    )
    if expected is None and level > _FASTEST_RPS:
        hint = "is it in rpm, rad/s or deg/s? then give --unit, else --commanded-speed"
        raise Refusal(f"the speed is {level:.4g} rps, more than motors turn; {hint}")
    if expected is None or abs(level / expected - 1) < _UNIT_TOLERANCE:
        return
    unit = form.unit or "rps"
    for other in UNITS[:-1] if unit in PER_TURN else ():
        if other != unit and abs(level / expected * PER_TURN[unit] / PER_TURN[other] - 1) < 0.05:
            hint = f"is the speed in {other}? then give --unit {other}"
            raise Refusal(f"the speed is {level:.4g} rps, {expected:.4g} rps {why}; {hint}")
    if form.expected_speed_rps is not None:
        raise Refusal(
            f"the log keeps {level:.4g} rps longest, not {expected:.4g} rps, {why}",
            Reason.NOT_CONSTANT_SPEED,
        )


def _refuse_spikes(v: FloatArray, rows: NDArray[np.int64], form: LogFormat) -> None:
    """Refuse single samples that no motor could follow."""
    level = _level(v, form.expected_speed_rps)
    before, after = np.abs(np.diff(v)[:-1]), np.abs(np.diff(v)[1:])
    away = np.flatnonzero(np.minimum(before, after) > _SPIKE * level)
    away = away[np.abs(v[away] - v[away + 2]) < 0.1 * level]
    if 0 < away.size <= 0.01 * v.size:
        k = away[0] + 1
        spike = f"{v[k]:.4g} rps beside {v[k - 1]:.4g}"
        if away.size > _MOST_SPIKES:
            what = f"{away.size} samples stray from their neighbours, {spike}: is the speed differentiated"
            raise Refusal(f"{what} by uneven stamps? log the position, or --rate", row=rows[k])
        raise Refusal(
            f"a spike, {spike} ({away.size} in all); mend or cut the log there", row=rows[k]
        )


def _refuse_clipping(samples: _Samples) -> None:
    """Refuse a speed that stops at a limit; one of few different values is coarse, not clipped."""
    v = samples.v
    if np.unique(v[:5000]).size < _LEAST_VALUES:
        return
    for limit in (v.max(), v.min()):
        at = v == limit
        held = np.flatnonzero(at[2:] & at[1:-1] & at[:-2])
        if held.size > 0.005 * v.size:
            clipped = f"the speed is clipped at {limit:.6g} rps in {np.count_nonzero(at)} samples"
            raise Refusal(f"{clipped}; log it with a wider range", row=samples.rows[held[0]])
