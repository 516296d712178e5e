"""From the table of a log to a record of the test movement: columns, units, clock, and the constant-speed stretch.

Each step that changes or assumes something says so in one sentence, appended to the `notes` that are handed in.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from replication.datasets import FloatArray, Recording
from replication.sensor import UNITS
from replication.sensor.columns import PER_TURN, LogFormat, chosen_columns, numbers, seconds, units_per_turn
from replication.sensor.tables import UnusableLog, read_table

__all__ = ["LEAST_TURNS", "CannotTell", "LogFormat", "UnusableLog", "read_log", "record_of"]


# The ring that the signature models: 21 Hz in the paper's joint.
RING_HZ = 21.0
SAMPLES_A_RING = 4  # below, the shape of an oscillation is not sampled any more
GOOD_SAMPLES_A_RING = 12  # below, the samples may miss more than 3 % of a peak
_FASTEST_HZ = 2000.0  # above, neighbouring samples are averaged

_LEAST_SAMPLES = 8  # of a log, and of a load turn
LEAST_TURNS = 4  # fewer half turns have too few orders of signs to tell a pattern from noise (see `presence`)
MOST_TURNS = 60  # what is beyond adds nothing but time
_SPEED_TOLERANCE = 0.03  # of a constant speed; backlash disturbs it by some 1 %
_SMOOTHING_S = 0.1
_LONGEST_STEP = 3.5  # in sampling periods; a longer one is a gap
_SPIKE = 0.3


class CannotTell(Exception):
    """A log that can be read and still has no answer: one of the reasons, and what says more."""

    def __init__(self, reason: str, detail: str):
        super().__init__(f"{reason}: {detail}")


def read_log(path: Path, form: LogFormat, notes: list[str]) -> Recording:
    """Read a log and prepare its record; `notes` gets a sentence for each step that changed or assumed something."""
    return record_of(read_table(path), form, str(path), notes)


def record_of(table: pd.DataFrame, form: LogFormat, name: str, notes: list[str]) -> Recording:
    """Prepare the record of a table; see `read_log`."""
    time_column, column, is_position = chosen_columns(table, form, name)
    t = seconds(table, time_column, name, notes)
    signal = numbers(table, column, name)
    rows = table.index.to_numpy()
    if t.size > 2 and t[1] == t[0]:
        t, signal, rows = t[1:], signal[1:], rows[1:]
        notes.append("dropped the first row: its time stamp is that of the second")
    _check_clock(t, rows, name)
    if np.ptp(signal) == 0:
        raise UnusableLog(f"{name}: {column} never changes, it is {signal[0]:g} throughout; is it the right column?")
    per_turn = units_per_turn(column, is_position, form, name, notes)
    if is_position:
        t, v, rows = _differentiated(t, signal / per_turn, rows, form, name, notes)
    else:
        v = signal / per_turn
    t, v, rows = _evenly_sampled(t, v, rows, form, name, notes)
    return _constant_speed(t, v, rows, form, name, notes)


# ---------------------------------------------------------------------------------------------------------------
# Clock, position, sampling


def _check_clock(t: FloatArray, rows: NDArray, name: str) -> None:
    if t.size < 3:
        raise UnusableLog(f"{name}: {t.size} sample{'s' * (t.size != 1)}; a log of {LEAST_TURNS} load turns is needed")
    steps = np.diff(t)
    wrong = np.flatnonzero(steps <= 0)
    if wrong.size:
        k = wrong[0] + 1
        what = "repeats the one before" if t[k] == t[k - 1] else "goes backward"
        raise UnusableLog(
            f"{name}, row {rows[k]}: its time stamp {what} ({wrong.size} such rows); sort the log, drop doubled rows, "
            "and export stamps with all their digits"
        )


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


def _differentiated(t, turns, rows, form, name, notes) -> tuple[FloatArray, FloatArray, NDArray]:
    """Speed [rps] midway between the samples of a position [turns], unwrapped."""
    dt = np.diff(t)
    steps, modulus = _unwrapped_steps(turns, dt, form)
    jumps = int(np.count_nonzero(np.abs(steps - np.diff(turns)) > 1e-9))
    if jumps:
        notes.append(f"the position starts anew every {modulus:g} motor turns: unwrapped {jumps} times")
    speed = steps / dt
    if np.count_nonzero(speed * np.median(speed) < 0) > 0.2 * speed.size:
        raise UnusableLog(
            f"{name}: the position starts anew faster than it is sampled, or moves to and fro; give "
            "--commanded-speed, or sample faster"
        )
    notes.append("speed differentiated from the position, between neighbouring samples")
    return (t[1:] + t[:-1]) / 2, speed, rows[1:]


def _evenly_sampled(t, v, rows, form, name, notes) -> tuple[FloatArray, FloatArray, NDArray]:
    """Check the sampling rate, and put the speed on an even grid."""
    steps = np.diff(t)
    dt = float(steps[steps <= _LONGEST_STEP * np.median(steps)].mean())
    rate = 1.0 / dt
    if rate < SAMPLES_A_RING * RING_HZ:
        raise UnusableLog(
            f"{name}: sampled at {rate:.3g} Hz; the {RING_HZ:g} Hz oscillation after an impact needs "
            f"{SAMPLES_A_RING * RING_HZ:g} Hz at least, {GOOD_SAMPLES_A_RING * RING_HZ:.0f} Hz to be measured well "
            "(are the time stamps in s? if not, name the column like 'time [ms]')"
        )
    if rate < GOOD_SAMPLES_A_RING * RING_HZ:
        notes.append(
            f"sampled at {rate:.0f} Hz: below {GOOD_SAMPLES_A_RING * RING_HZ:.0f} Hz the peaks are read too low"
        )
    _refuse_gaps(t, v, rows, dt, form, name)
    even = t[0] + (t[-1] - t[0]) / (t.size - 1) * np.arange(t.size)
    stray = float(np.abs(t - even).max())
    if stray > 1e-6 * dt:
        digit = next((10.0**-k for k in range(10) if np.abs(t / 10.0**-k - np.rint(t / 10.0**-k)).max() < 1e-3), 0.0)
        if stray <= 1.01 * digit and digit <= dt:
            notes.append(f"time stamps rounded to {digit:g} s: taken as even, {1 / (even[1] - even[0]):.6g} Hz")
        else:
            even = t[0] + dt * np.arange(int((t[-1] - t[0]) / dt + 1e-6) + 1)
            nearest = np.clip(np.searchsorted(t, even - dt / 2), 0, t.size - 1)
            v, rows = np.interp(even, t, v), rows[nearest]
            notes.append(f"uneven time stamps: resampled at {rate:.6g} Hz by straight lines")
    together = int(rate // (_FASTEST_HZ / 2)) if rate > _FASTEST_HZ else 1
    if together > 1:
        whole = v.size // together * together
        v = v[:whole].reshape(-1, together).mean(axis=1)
        even, rows = even[:whole].reshape(-1, together).mean(axis=1), rows[:whole:together]
        notes.append(f"sampled at {rate:.6g} Hz: averaged over {together} samples each")
    if v.size < _LEAST_SAMPLES:
        raise CannotTell("too short", f"{t[-1] - t[0]:.3g} s in {t.size} samples; {LEAST_TURNS} load turns are needed")
    return even, v, rows


def _refuse_gaps(t, v, rows, dt, form, name) -> None:
    """Refuse a gap that cuts the constant speed in two; elsewhere gaps do no harm."""
    gaps = np.flatnonzero(np.diff(t) > _LONGEST_STEP * dt)
    if gaps.size > 0.05 * t.size:
        raise UnusableLog(f"{name}: {gaps.size} gaps in {t.size} samples; log at an even rate")
    level = _level(v, form.expected_speed_rps)
    for k in gaps:
        around = v[max(k - 20, 0) : k + 1], v[k + 1 : k + 21]
        if all(abs(abs(part.mean()) / level - 1) < _SPEED_TOLERANCE for part in around):
            raise UnusableLog(
                f"{name}, row {rows[k + 1]}: a gap of {t[k + 1] - t[k]:.3g} s in the constant speed, at "
                f"t = {t[k] - t[0]:.4g} s; log again, or cut the log to one side of it"
            )


# ---------------------------------------------------------------------------------------------------------------
# The test movement


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


def _constant_speed(t, v, rows, form, name, notes) -> Recording:
    """Cut a record out of the longest stretch at constant speed."""
    dt = (t[-1] - t[0]) / (t.size - 1)
    _refuse_spikes(v, rows, form, name)
    width = max(3, round(_SMOOTHING_S / dt))
    smooth = uniform_filter1d(v, width, mode="nearest")
    level = _level(smooth, form.expected_speed_rps)
    if level <= np.std(v) or level == 0:
        raise CannotTell("not constant speed", "the motor stands still, or turns both ways")
    _check_speed(level, form, name)
    first, last = _longest(np.abs(np.abs(smooth) / level - 1) < _SPEED_TOLERANCE, np.sign(smooth))
    settle = 2 * width
    first, last = (first + settle if first > 0 else 0), (last - settle if last < v.size else v.size)
    period = form.turn_period_s or form.gear_ratio / level
    turns = max(last - first, 0) * dt / period
    if period < _LEAST_SAMPLES * dt:
        raise CannotTell("too short", f"a load turn of {period:.3g} s is {period / dt:.1f} samples long")
    if turns < LEAST_TURNS - 1.5 * dt / period:
        lasts = f"{turns:.1f} load turns of {period:.4g} s at {level:.4g} rps; {LEAST_TURNS} are needed, 12 are good"
        whole = last - first > 0.9 * v.size
        raise CannotTell("too short" if whole else "not constant speed", lasts)
    if last - first < v.size:
        notes.append(
            f"used the constant speed from {t[first] - t[0]:.3f} to {t[last - 1] - t[0]:.3f} s of {t[-1] - t[0]:.3f} s"
        )
    if turns > MOST_TURNS:
        last = first + round(MOST_TURNS * period / dt) + 1
        notes.append(f"{turns:.0f} turns: used the first {MOST_TURNS}")
    t, v, rows = t[first:last] - t[first], v[first:last], rows[first:last]
    if v.mean() < 0:
        v = -v
        notes.append("the motor turns backward: the speed's sign is changed")
    _check_clipping(v, rows, name)
    return _recording(t, v, form, name, notes)


def _recording(t: FloatArray, v: FloatArray, form: LogFormat, name: str, notes: list[str]) -> Recording:
    """Check that the speed is constant, and give the record its speed and turn period."""
    mean, quarter = float(v.mean()), v.size // 4
    drift = float(v[-quarter:].mean() - v[:quarter].mean())
    if abs(drift) > _SPEED_TOLERANCE / 3 * mean:
        raise CannotTell("not constant speed", f"it drifts by {drift:+.3g} rps from {mean:.4g} rps")
    period = form.turn_period_s
    if period is None:
        period = form.gear_ratio / mean
        notes.append(f"a load turn takes {period:.6g} s: gear ratio {form.gear_ratio:g} at {mean:.6g} rps")
    elif form.gear_ratio is not None and abs(form.gear_ratio / mean / period - 1) > _SPEED_TOLERANCE:
        raise CannotTell(
            "wrong period",
            f"gear ratio {form.gear_ratio:g} at {mean:.5g} rps makes turns of {form.gear_ratio / mean:.4g} s, "
            f"not the {period:g} s given",
        )
    return Recording(t, v, form.commanded_speed_rps or mean, period, name)


def _longest(inside: NDArray[np.bool_], signs: FloatArray) -> tuple[int, int]:
    """First and past-the-end index of the longest run inside that has one sign; (0, 0) if there is none."""
    state = np.where(inside, signs, 0.0)
    starts = np.concatenate(([0], np.flatnonzero(np.diff(state)) + 1, [state.size]))
    lengths = np.where(state[starts[:-1]] != 0, np.diff(starts), 0)
    best = int(lengths.argmax())
    return (int(starts[best]), int(starts[best + 1])) if lengths[best] else (0, 0)


def _other_unit(ratio: float, form: LogFormat) -> str:
    """The unit that would explain a speed `ratio` times the expected one, as a question; empty if there is none."""
    unit = form.unit or "rps"
    if unit not in PER_TURN:
        return ""
    for other in UNITS[:3]:
        if other != unit and abs(ratio * PER_TURN[unit] / PER_TURN[other] - 1) < 0.05:
            return f"; is the speed in {other}? then give --unit {other}"
    return ""


def _check_speed(level: float, form: LogFormat, name: str) -> None:
    """Refuse a speed that is as far from the expected one as one unit from another; doubt one that is off otherwise."""
    expected, why = form.expected_speed_rps, "commanded" if form.commanded_speed_rps else "by gear ratio and turn"
    if expected is None:
        expected, why = form.usual_speed_rps, "in the calibration"
    if expected is None or abs(level / expected - 1) < _SPEED_TOLERANCE:
        return
    hint = _other_unit(level / expected, form)
    if hint:
        raise UnusableLog(f"{name}: the speed is {level:.4g} rps, {expected:.4g} rps {why}{hint}")
    if form.expected_speed_rps is not None:
        raise CannotTell("not constant speed", f"the log keeps {level:.4g} rps longest, not {expected:.4g} rps, {why}")


def _refuse_spikes(v: FloatArray, rows: NDArray, form: LogFormat, name: str) -> None:
    """Refuse single samples that no motor could follow."""
    level = _level(v, form.expected_speed_rps)
    before, after = np.abs(np.diff(v)[:-1]), np.abs(np.diff(v)[1:])
    away = np.flatnonzero(np.minimum(before, after) > _SPIKE * level)
    away = away[np.abs(v[away] - v[away + 2]) < 0.1 * level]
    if 0 < away.size <= 0.01 * v.size:
        k = away[0] + 1
        raise UnusableLog(
            f"{name}, row {rows[k]}: a spike, {v[k]:.4g} rps beside {v[k - 1]:.4g} ({away.size} such samples); "
            "mend or cut the log there"
        )


def _check_clipping(v: FloatArray, rows: NDArray, name: str) -> None:
    """Refuse a speed that stops at a limit; one of few different values is coarse, not clipped."""
    if np.unique(v[:5000]).size < 16:
        return
    for limit in (v.max(), v.min()):
        at = v == limit
        held = np.flatnonzero(at[2:] & at[1:-1] & at[:-2])
        if held.size > 0.005 * v.size:
            raise UnusableLog(
                f"{name}, row {rows[held[0]]}: the speed is clipped at {limit:.6g} rps in {np.count_nonzero(at)} "
                "samples; log it with a wider range"
            )
