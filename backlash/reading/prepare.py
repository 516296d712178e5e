"""Prepare: from the table of a log to a record of turns at constant speed, evenly sampled."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.ndimage import median_filter, uniform_filter1d

from backlash.reading import clock
from backlash.reading.columns import Columns, LogFormat, choose_columns, numbers
from backlash.reading.sources import read_source
from backlash.reading.units import PER_TURN
from backlash.refusals import Reason, Refusal
from replication.records import Recording
from replication.signature import FloatArray

_LEAST_RATE = 4  # samples in its period; with half as many, two of 17 simulated joints were wrong
_GOOD_RATE = 12  # with fewer, the samples may miss more than 3 % of a peak
_FASTEST_HZ = 2000.0  # above, neighbouring samples are averaged

_FASTEST_RPS = 500.0  # of a motor, 30000 rpm; above, the unit is another one
_LEAST_SAMPLES = 8  # of a log, and of a load turn
# Fewer half turns have too few orders of signs to tell a pattern from noise (see `pattern`).
_LEAST_TURNS = 4
_MOST_TURNS = 60  # what is beyond adds nothing but time
_TOLERANCE = 0.03  # of a speed beside the one that was said, and of turns alike; backlash disturbs it by some 1 %
_MOST_DRIFT = 0.01  # of the mean of whole turns
_SMOOTHING_S = 0.1  # two periods of the ring, a fraction of a turn
_SPIKE = 0.3  # of the speed, within a sample: no motor's torque does that
_LEAST_VALUES = 16  # of a signal that is not merely coarse


@dataclass(frozen=True, eq=False, kw_only=True)
class Log:
    """A log that was read: its record of constant speed, and what was said and assumed of it.

    Its recording's t [s] and v [rps] are the samples that an estimate uses.
    """

    file: str  # what it is called in its answer
    sha256: str | None = None  # of the file's bytes
    recording: Recording
    notes: tuple[str, ...] = ()
    form: LogFormat
    torque: FloatArray | None = None  # of the motor at the recording's samples, in the log's unit
    columns: str = ""  # that were read, with their units, the sheet and the side of the gear
    is_links_side: bool = False  # of the gear; else the motor's


def open_log(
    source: object, form: LogFormat, v: ArrayLike | None = None, torque: ArrayLike | None = None
) -> Log:
    """Read and prepare a log, unless that was done before; see `read_source`."""
    if isinstance(source, Log):
        return source
    table = read_source(source, form, v, torque)
    columns = Columns()
    notes: list[str] = []
    try:
        columns = choose_columns(table, form)
        t, signals, columns = _read_signals(table.frame, columns, form, notes)
        t, signals = _evenly_sampled(t, signals, columns.is_position, form, notes)
        stretch = _constant_speed(t, signals[0], form, notes)
        t, signals = t[stretch], signals[:, stretch]
        if signals[0].mean() < 0:
            notes.append("the motor turns backward: the speed's sign is changed")
            signals = -signals
        _refuse_clipping(t, signals)
        recording = _recording(t, signals[0], table.file, form, notes)
    except Refusal as refusal:
        error = refusal
        if table.sha256 and refusal.is_unusable:
            error = refusal.in_file(table.file)
        error.columns = columns.describe()
        error.notes += tuple(notes)
        raise error from refusal
    return Log(
        file=table.file,
        sha256=table.sha256,
        recording=recording,
        notes=tuple(notes),
        form=form,
        torque=signals[1] if columns.torque else None,
        columns=columns.describe(),
        is_links_side=columns.is_links,
    )


def _read_signals(
    frame: pd.DataFrame, columns: Columns, form: LogFormat, notes: list[str]
) -> tuple[FloatArray, FloatArray, Columns]:
    """Time stamps [s], a row each of speed [rps] or position [turns] and torque, and the unit of the stamps."""
    needed = [name for name in (columns.time, columns.signal, columns.torque) if name]
    missing = frame[needed].isna().any(axis=1)
    table = frame[~missing]
    if len(table) < 3:
        counted = f"{len(table)} sample{'s' * (len(table) != 1)} with {' and '.join(needed)}"
        raise Refusal(f"{counted}; a log of {_LEAST_TURNS} load turns is needed")
    if form.rate_hz:
        t = np.flatnonzero(~missing) / form.rate_hz
    else:
        t, unit = clock.read_times(table, columns.time, form.time_unit)
        columns = replace(columns, time_unit=unit)
    lacking = frame.loc[missing, needed].dropna(how="all")
    if len(lacking):
        names = " or ".join(lacking.columns[lacking.isna().any()])
        notes.append(f"left out {len(lacking)} rows without {names}")
    clock.refuse_backward(t, table.index)
    chosen = (t >= form.start_s) & (t <= form.end_s)
    if np.count_nonzero(chosen) < 3:
        raise Refusal(f"no samples between --from and --to; the log lasts {t[-1]:.6g} s")
    if not chosen.all():
        notes.append(f"used {chosen.sum()} of {t.size} samples, by --from and --to")
    table = table[chosen]
    signals = np.array([numbers(table, name) for name in needed if name != columns.time])
    if np.ptp(signals[0]) == 0:
        raise Refusal(
            f"{columns.signal} never changes, it is {signals[0, 0]:g} throughout; "
            "is it the right column?"
        )
    signals[0] /= {**PER_TURN, "counts": form.counts_per_turn or 1.0}[columns.unit]
    return *_merged(t[chosen], signals, table.index, notes), columns


def _merged(
    t: FloatArray, signals: FloatArray, rows: pd.Index, notes: list[str]
) -> tuple[FloatArray, FloatArray]:
    """Samples without those that repeat the one before, as a logger writes that polls faster than the drive answers."""
    goes_on = np.append(np.diff(t) > 0, True)
    others = ~goes_on[:-1] & (np.diff(signals) != 0).any(axis=0)
    others[0] = False  # loggers may begin with a row that is none
    if others.any():
        raise Refusal(
            f"its time stamp repeats the one before with other values ({others.sum()} such rows); "
            "drop doubled rows, and export stamps with all their digits",
            row=rows[1 + others.argmax()],
        )
    if not goes_on.all():
        notes.append(f"merged {np.sum(~goes_on)} rows with the time stamp of the next")
    return t[goes_on], signals[:, goes_on]


def _evenly_sampled(
    t: FloatArray, signals: FloatArray, is_position: bool, form: LogFormat, notes: list[str]
) -> tuple[FloatArray, FloatArray]:
    """Samples on the even grid that they were taken on, between gaps; of a position the speed, of a fast log means."""
    dt = clock.sampling_period(t, _LEAST_RATE * form.ring_hz, form.ring_hz)
    if is_position:
        signals[0] = _unwrapped(t, signals[0], form, notes)
    course = signals[0] if is_position else np.cumsum(signals[0])
    farthest = max(clock.parts_without_gaps(t, dt), key=lambda part: np.ptp(course[part]))
    if farthest != slice(0, t.size):
        notes.append(f"used what is between two gaps, {_from_to(t[farthest])}")
    t, signals = t[farthest], signals[:, farthest]
    if t.size < _LEAST_SAMPLES:
        what = f"{t[-1] - t[0]:.3g} s in {t.size} samples; {_LEAST_TURNS} load turns are needed"
        raise Refusal(what, Reason.TOO_SHORT)
    places, even, t = clock.place_on_grid(t, signals[0], dt, notes)
    if not np.array_equal(places, even):
        signals = CubicSpline(places, signals, axis=1)(even)
    if is_position:
        # The torque's mean between samples, as the speed's, is by its integral.
        signals[1:] = CubicSpline(t, signals[1:], axis=1).antiderivative()(t)
        signals, t = np.diff(signals) / np.diff(t), t[1:]
    return _averaged(t, signals, form.ring_hz, notes)


def _averaged(
    t: FloatArray, signals: FloatArray, ring_hz: float, notes: list[str]
) -> tuple[FloatArray, FloatArray]:
    """Means of neighbouring samples of a fast log; of a slow one it is noted what it is good for."""
    rate = (t.size - 1) / (t[-1] - t[0])
    good_hz = _GOOD_RATE * ring_hz
    if rate < good_hz:
        notes.append(
            f"sampled at {rate:.0f} Hz: below {good_hz:.0f} Hz the peaks of a ring of {ring_hz:g} Hz are read too low"
        )
    if rate <= _FASTEST_HZ:
        return t, signals
    together = int(rate // (_FASTEST_HZ / 2))
    notes.append(f"sampled at {rate:.6g} Hz: averaged over {together} samples each")
    whole = t.size // together * together
    means = np.vstack([t, signals])[:, :whole].reshape(-1, whole // together, together).mean(axis=2)
    return means[0], means[1:]


def _unwrapped(t: FloatArray, turns: FloatArray, form: LogFormat, notes: list[str]) -> FloatArray:
    """A position [turns] that goes on where it started anew after a turn or 2^n counts."""
    moduli = [1.0]
    if form.counts_per_turn:
        moduli += (2.0 ** np.arange(8, 33) / form.counts_per_turn).tolist()
    span = float(np.ptp(turns))
    modulus = min((m for m in moduli if 0.5 * m < span <= m * (1 + 1e-9)), default=0.0)
    if modulus == 0:
        return turns
    # By the nearest multiple to a uniform motion, at the speed of most steps or the one expected,
    # either way; so that samples may be far apart.
    steps = np.diff(turns)
    steps -= modulus * np.round(steps / modulus)
    speed = form.expected_speed_rps or abs(float(np.median(steps / np.diff(t))))
    motions = (way * speed * t for way in (1.0, -1.0))
    ways = [np.unwrap(turns - motion, period=modulus) + motion for motion in motions]
    best = min(ways, key=lambda way: np.abs(np.abs(np.diff(way) / np.diff(t)) - speed).mean())
    starts = np.rint((best - turns) / modulus)
    if jumps := np.count_nonzero(np.diff(starts)):
        notes.append(
            f"the position starts anew every {modulus:g} motor turns: unwrapped {jumps} times"
        )
    return turns + modulus * starts


def _constant_speed(t: FloatArray, v: FloatArray, form: LogFormat, notes: list[str]) -> slice:
    """The longest stretch of turns that repeat at one mean speed, of the first turns of a long one."""
    dt = float(t[1] - t[0])
    _refuse_spikes(t, v, form)
    width = max(3, round(_SMOOTHING_S / dt))
    smooth = uniform_filter1d(v, width, mode="nearest")
    level = _level(smooth, form.expected_speed_rps)
    if level <= np.std(v - smooth):
        raise Refusal("the motor stands still, or turns both ways", Reason.NOT_CONSTANT_SPEED)
    level, first, last = _repeating_turns(v, smooth, level, dt, form)
    _check_speed(level, form)
    period = form.period_s(level)
    if period < _LEAST_SAMPLES * dt:
        what = f"a load turn of {period:.3g} s is {period / dt:.1f} samples long"
        raise Refusal(what, Reason.TOO_SHORT)
    first += 2 * width * (first > 0)
    last -= 2 * width * (last < v.size)
    turns = (last - first) * dt / period
    if turns < _LEAST_TURNS - dt / period:
        if smooth.min() < -0.5 * smooth.max() and smooth.max() > -0.5 * smooth.min():
            raise Refusal(
                "the motor moves to and fro; the joint has to turn round in one direction, "
                f"{_LEAST_TURNS} turns or more",
                Reason.NOT_CONSTANT_SPEED,
            )
        is_short = last - first > 0.9 * v.size
        raise Refusal(
            f"{max(turns, 0):.1f} load turns of {period:.4g} s at {level:.4g} rps; {_LEAST_TURNS} alike are needed, "
            "12 are good (a log of the joint's side needs --gear-ratio 1)",
            Reason.TOO_SHORT if is_short else Reason.NOT_CONSTANT_SPEED,
        )
    if last - first < v.size:
        notes.append(f"used the constant speed {_from_to(t[first:last])}")
    if turns > _MOST_TURNS:
        last = first + round(_MOST_TURNS * period / dt) + 1
        notes.append(f"{turns:.0f} turns: used the first {_MOST_TURNS}")
    return slice(first, last)


def _from_to(t: FloatArray) -> str:
    return f"from {t[0]:.3f} to {t[-1]:.3f} s after the log's first sample"


def _repeating_turns(
    v: FloatArray, smooth: FloatArray, level: float, dt: float, form: LogFormat
) -> tuple[float, int, int]:
    """Speed [rps] of the longest stretch of turns alike, and its first and past-the-end sample.

    Within a turn the speed may do what the drive lets it: asked is that its mean over a turn stays,
    and that it comes back a turn later.
    """
    for _ in range(10):  # by a gear ratio the turn goes by the level, and the level by the turn
        n = round(form.period_s(level) / dt)
        if not 0 < n < v.size:
            return level, 0, v.size
        means = uniform_filter1d(v, n, mode="nearest", origin=-(n // 2))[: v.size - n]
        level = _level(means, form.expected_speed_rps)
    tolerance = _TOLERANCE * level
    is_alike = np.abs(smooth[n:] - smooth[:-n]) < tolerance
    is_level = np.abs(np.abs(means) - level) < tolerance
    first, last = _longest_run(np.where(is_alike & is_level, np.sign(means), 0.0))
    return level, first, last + n if last > first else first


def _level(v: FloatArray, expected: float | None) -> float:
    """The speed [rps], without sign, that a log keeps longest; near the expected one if that is among them."""
    speed = np.abs(v)
    if expected is not None:
        is_near = np.abs(speed / expected - 1) < 2 * _TOLERANCE
        if np.mean(is_near) > 0.1:
            return float(np.median(speed[is_near]))
    rising = np.sort(speed[speed > 0.05 * speed.max()])  # not standing still
    alike = np.searchsorted(rising, rising + 0.5 * _TOLERANCE * speed.max())
    count = alike - np.arange(rising.size)
    most = count.argmax()
    return float(np.median(rising[most : alike[most]]))


def _longest_run(state: FloatArray) -> tuple[int, int]:
    """First and past-the-end index of the longest run of one value that is not 0; twice the same if there is none."""
    starts = np.flatnonzero(np.diff(state, prepend=np.nan))
    lengths = np.diff(starts, append=state.size) * (state[starts] != 0)
    best = lengths.argmax()
    return int(starts[best]), int(starts[best] + lengths[best])


def _recording(
    t: FloatArray, v: FloatArray, name: str, form: LogFormat, notes: list[str]
) -> Recording:
    """The record with its speed and turn period, and of a speed that does not drift."""
    mean = float(v.mean())
    period = form.period_s(mean)
    # Gravity's part repeats in the first whole turns and the last.
    n = period / (t[1] - t[0])
    some = round(max(v.size / n // 4, 1) * n)
    drift = float(v[-some:].mean() - v[:some].mean())
    if abs(drift) > _MOST_DRIFT * mean:
        what = f"it drifts by {drift:+.3g} rps from {mean:.4g} rps"
        raise Refusal(what, Reason.NOT_CONSTANT_SPEED)
    ratio = form.gear_ratio
    if form.turn_period_s and ratio and abs(ratio / mean / period - 1) > _TOLERANCE:
        raise Refusal(
            f"gear ratio {ratio:g} at {mean:.5g} rps makes turns of {ratio / mean:.4g} s, "
            f"not the {period:g} s given",
            Reason.WRONG_PERIOD,
        )
    return Recording(t - t[0], v, form.commanded_speed_rps or mean, period, name)


def _check_speed(level: float, form: LogFormat) -> None:
    """Refuse a speed that is not the expected one, or none of a motor."""
    expected = form.expected_speed_rps
    if expected is None and level > _FASTEST_RPS:
        raise Refusal(
            f"the speed is {level:.4g} rps, more than motors turn; is it in rpm, rad/s or deg/s? "
            "then give --unit, else --commanded-speed"
        )
    if expected is not None and abs(level / expected - 1) > _TOLERANCE:
        source = "commanded" if form.commanded_speed_rps else "by gear ratio and turn"
        raise Refusal(
            f"the log keeps {level:.4g} rps longest, not {expected:.4g} rps, {source}; "
            "is --unit right?",
            Reason.NOT_CONSTANT_SPEED,
        )


def _refuse_spikes(t: FloatArray, v: FloatArray, form: LogFormat) -> None:
    """Refuse single samples that no motor could follow."""
    usual = median_filter(v, 5, mode="nearest")
    away = np.flatnonzero(np.abs(v - usual) > _SPIKE * _level(v, form.expected_speed_rps))
    if 0 < away.size <= 0.01 * v.size:
        k = away[0]
        cure = "mend or cut the log; of a speed differentiated by uneven stamps log the position"
        raise Refusal(
            f"{away.size} single samples stray from their neighbours, {v[k]:.4g} rps beside {usual[k]:.4g}, "
            f"{t[k]:.6g} s after the first; {cure}"
        )


def _refuse_clipping(t: FloatArray, signals: FloatArray) -> None:
    """Refuse a speed or torque that stops at a limit; one of few different values is coarse, not clipped."""
    for name, signal in zip(("speed", "torque"), signals, strict=False):
        if np.unique(signal[:5000]).size < _LEAST_VALUES:
            continue
        for limit in (signal.max(), signal.min()):
            at = signal == limit
            held = np.flatnonzero(at[2:] & at[1:-1] & at[:-2])
            if held.size > 0.005 * signal.size:
                cure = "log it with a wider range, or move slower"
                raise Refusal(
                    f"the {name} is clipped at {limit:.6g}{' rps' * (name == 'speed')} in {at.sum()} samples, "
                    f"first {t[held[0]]:.6g} s after the first sample; {cure}"
                )
