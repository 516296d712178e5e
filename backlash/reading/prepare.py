"""Prepare: from the table of a log to a record of turns at constant speed, evenly sampled."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import uniform_filter1d

from backlash.reading import UNITS, clock
from backlash.reading.columns import Columns, LogFormat, choose_columns, numbers, with_whole_stamps
from backlash.reading.sources import Source, Table, read_source
from backlash.reading.units import PER_TURN
from backlash.refusals import Reason, Refusal
from replication.records import Recording
from replication.signature import FloatArray

_RING_HZ = 21.0  # of the oscillation that the signature models, in the paper's joint
_LEAST_RATE = 4  # samples in its period; with half as many, two of 17 simulated joints were wrong
_GOOD_RATE = 12  # with fewer, the samples may miss more than 3 % of a peak
_FASTEST_HZ = 2000.0  # above, neighbouring samples are averaged

_FASTEST_RPS = 500.0  # of a motor, 30000 rpm; above, the unit is another one
_LEAST_SAMPLES = 8  # of a log, and of a load turn
# Fewer half turns have too few orders of signs to tell a pattern from noise (see `pattern`).
_LEAST_TURNS = 4
_MOST_TURNS = 60  # what is beyond adds nothing but time
_SLOWEST_RPS = 1e-6  # of a motor that is not said to stand still
_UNIT_TOLERANCE = 0.03  # of a speed beside the one that was said
_MOST_DRIFT = 0.01  # of the mean of whole turns
_SMOOTHING_S = 0.1
_SPIKE = 0.3
_LEAST_VALUES = 16  # of a signal that is not merely coarse


@dataclass(frozen=True, eq=False, kw_only=True)
class Log(Source):
    """A log that was read: its record of constant speed, and what was said and assumed of it.

    Its recording's t [s] and v [rps] are the samples that an estimate uses.
    """

    recording: Recording
    notes: tuple[str, ...] = ()
    form: LogFormat
    torque: FloatArray | None = None  # of the motor at the recording's samples, in the log's unit
    columns: str = ""  # that were read, with their units, the sheet and the side of the gear
    is_links_side: bool = False  # of the gear; else the motor's


@dataclass(frozen=True)
class _Samples:
    """A log on its way to a record, and a sentence for each thing done to it."""

    t: FloatArray  # [s], shape (samples,)
    # Motor speed [rps], at first perhaps position [turns]; then the torque, if there is one. Shape
    # (1 or 2, samples).
    signals: FloatArray
    rows: NDArray[np.int64]  # of the file
    notes: tuple[str, ...] = ()

    @property
    def v(self) -> FloatArray:
        """The speed, at first perhaps the position."""
        return self.signals[0]

    def noted(self, *notes: str, **changed: NDArray) -> "_Samples":
        """These samples with a change, and what it was."""
        return replace(self, notes=self.notes + notes, **changed)

    def part(self, chosen: slice | NDArray, note: str) -> "_Samples":
        """Some of these samples."""
        return self.noted(
            note, t=self.t[chosen], signals=self.signals[:, chosen], rows=self.rows[chosen]
        )


def open_log(
    source: object, form: LogFormat, v: ArrayLike | None = None, torque: ArrayLike | None = None
) -> Log:
    """Read and prepare a log, unless that was done before; see `read_source`."""
    if isinstance(source, Log):
        return source
    return prepare(read_source(source, form, v, torque), form)


def prepare(table: Table, form: LogFormat) -> Log:
    """Prepare the record of a table."""
    columns = Columns()
    notes: tuple[str, ...] = ()
    try:
        sheet = with_whole_stamps(table.sheet)
        columns = choose_columns(sheet, form)
        samples, columns = _read_samples(sheet.frame, columns, form)
        notes = samples.notes
        ring_hz = form.ring_hz or _RING_HZ
        dt = clock.sampling_period(samples.t, _LEAST_RATE * ring_hz, ring_hz)
        if columns.is_position:
            samples = _unwrapped(samples, form)
        samples = _at_constant_speed(samples, columns.is_position, dt, form)
        notes = samples.notes
        samples = _on_even_grid(samples, dt)
        if columns.is_position:
            samples = _differentiated(samples)
        samples = _averaged(samples, ring_hz)
        _refuse_clipping(samples)
        notes = samples.notes
        return _log_of(samples, table, columns, form)
    except Refusal as refusal:
        error = refusal
        if table.sha256 and refusal.is_unusable:
            error = refusal.in_file(table.file)
        error.columns = columns.describe()
        error.notes += notes
        raise error from refusal


def _read_samples(
    frame: pd.DataFrame, columns: Columns, form: LogFormat
) -> tuple[_Samples, Columns]:
    """The signals of a table at its time stamps, or at an even rate; and the unit of these stamps."""
    needed = [name for name in (columns.time, columns.signal, columns.torque) if name]
    missing = frame[needed].isna().any(axis=1).to_numpy()
    incomplete = frame[missing & ~frame.isna().all(axis=1).to_numpy()]
    table = frame[~missing]
    rows = table.index.to_numpy()
    notes: tuple[str, ...] = ()
    if len(table) < 3:
        counted = f"{len(table)} sample{'s' * (len(table) != 1)} with {' and '.join(needed)}"
        raise Refusal(f"{counted}; a log of {_LEAST_TURNS} load turns is needed")
    if form.rate_hz:
        t = np.flatnonzero(~missing) / form.rate_hz
        notes += (f"taken as even, {form.rate_hz:g} Hz, as said",)
    else:
        t, unit = clock.read_times(table, columns.time, form.time_unit)
        columns = replace(columns, time_unit=unit)
    if len(incomplete):
        lacking = " or ".join(name for name in needed if incomplete[name].isna().any())
        notes += (f"left out {len(incomplete)} rows without {lacking}",)
    clock.refuse_backward(t, rows)
    chosen = (t >= (form.start_s or 0.0)) & (t <= (np.inf if form.end_s is None else form.end_s))
    if np.count_nonzero(chosen) < 3:
        raise Refusal(f"no samples between --from and --to; the log lasts {t[-1]:.6g} s")
    if not chosen.all():
        notes += (f"used {chosen.sum()} of {t.size} samples, by --from and --to",)
    per_turn = {**PER_TURN, "counts": form.counts_per_turn or 1.0}[columns.unit]
    signals = [numbers(table[chosen], columns.signal) / per_turn]
    if np.ptp(signals[0]) == 0:
        level = signals[0][0] * per_turn
        what = f"{columns.signal} never changes, it is {level:g} throughout"
        raise Refusal(f"{what}; is it the right column?")
    if columns.torque:
        signals.append(numbers(table[chosen], columns.torque))
    return _merged(_Samples(t[chosen], np.array(signals), rows[chosen], notes)), columns


def _merged(samples: _Samples) -> _Samples:
    """Samples without those that repeat the one before, as a logger writes that polls faster than the drive answers."""
    if samples.t[1] == samples.t[0]:
        note = "dropped the first row: its time stamp is that of the second"
        samples = samples.part(slice(1, None), note)
    repeats = np.append(False, np.diff(samples.t) == 0)
    if not repeats.any():
        return samples
    others = repeats & np.append(False, (np.diff(samples.signals) != 0).any(axis=0))
    if others.any():
        what = f"its time stamp repeats the one before with other values ({others.sum()} such rows)"
        cure = "drop doubled rows, and export stamps with all their digits"
        raise Refusal(f"{what}; {cure}", row=samples.rows[others.argmax()])
    return samples.part(~repeats, f"merged {repeats.sum()} rows that repeat the one before")


def _unwrapped(samples: _Samples, form: LogFormat) -> _Samples:
    """A position [turns] that goes on where it started anew after a turn or 2^n counts."""
    t, turns = samples.t, samples.v
    span = float(np.ptp(turns))
    moduli = [1.0]
    if form.counts_per_turn:
        moduli += (2.0 ** np.arange(8, 33) / form.counts_per_turn).tolist()
    modulus = min((m for m in moduli if 0.5 * m < span <= m * (1 + 1e-9)), default=0.0)
    if modulus == 0:
        return samples
    # By the nearest multiple to a uniform motion, at the speed of most steps or the one expected,
    # either way; so that a gap may hold several turns.
    steps = np.diff(turns)
    steps -= modulus * np.round(steps / modulus)
    speed = form.expected_speed_rps or abs(float(np.median(steps / np.diff(t))))
    motions = (way * speed * (t - t[0]) for way in (1.0, -1.0))
    ways = [np.unwrap(turns - motion, period=modulus) + motion for motion in motions]
    best = min(
        ways, key=lambda way: float(np.abs(np.abs(np.diff(way) / np.diff(t)) - speed).mean())
    )
    best = turns + modulus * np.rint((best - turns) / modulus)  # to the last digit
    jumps = int(np.count_nonzero(np.abs(np.diff(best) - np.diff(turns)) > 1e-9))
    if jumps and np.mean(np.diff(best) * (best[-1] - best[0]) < 0) > 0.2:
        problem = "the position starts anew faster than it is sampled, or moves to and fro"
        raise Refusal(f"{problem}; give --commanded-speed, or sample faster")
    note = f"the position starts anew every {modulus:g} motor turns: unwrapped {jumps} times"
    signals = np.vstack([best, samples.signals[1:]])
    return samples.noted(note, signals=signals) if jumps else samples


def _at_constant_speed(
    samples: _Samples, is_position: bool, dt: float, form: LogFormat
) -> _Samples:
    """Cut out the longest stretch of turns that repeat at one mean speed, turned forward."""
    t, v = samples.t, samples.v
    if v.size < _LEAST_SAMPLES:
        what = f"{t[-1] - t[0]:.3g} s in {t.size} samples; {_LEAST_TURNS} load turns are needed"
        raise Refusal(what, Reason.TOO_SHORT)
    if is_position:
        k = clock.grid_numbers(t, dt)  # smoother than by the stamps, which stray
        v = np.gradient(v, np.polyval(np.polyfit(k, t, 1), k))
    if 1 / dt > _FASTEST_HZ:
        v = uniform_filter1d(v, int(2 / _FASTEST_HZ / dt), mode="nearest")
    _refuse_spikes(v, samples.rows, form)
    width = max(3, round(_SMOOTHING_S / dt))
    smooth = uniform_filter1d(v, width, mode="nearest")
    level = _level(smooth, form.expected_speed_rps)
    if level <= max(float(np.std(v - smooth)), _SLOWEST_RPS):
        raise Refusal("the motor stands still, or turns both ways", Reason.NOT_CONSTANT_SPEED)
    level, first, last = _repeating_turns(v, smooth, level, dt, form)
    _check_speed(level, form)
    period = form.period_s(level)
    if period < _LEAST_SAMPLES * dt:
        what = f"a load turn of {period:.3g} s is {period / dt:.1f} samples long"
        raise Refusal(what, Reason.TOO_SHORT)
    first = min(first + 2 * width, v.size - 1) if first > 0 else 0
    last = max(last - 2 * width if last < v.size else last, first + 1)
    whole = first, last
    first, last = clock.longest_clean(t, *whole, dt)
    turns, needed = (t[last - 1] - t[first]) / period, _LEAST_TURNS - 1.5 * dt / period
    if turns < needed:
        if smooth.min() < -0.5 * smooth.max() and smooth.max() > -0.5 * smooth.min():
            what = "the motor moves to and fro; the joint has to turn round in one direction"
            raise Refusal(f"{what}, {_LEAST_TURNS} turns or more", Reason.NOT_CONSTANT_SPEED)
        if (t[whole[1] - 1] - t[whole[0]]) / period >= needed:
            steps = np.diff(t[slice(*whole)])
            at = whole[0] + int(steps.argmax())
            gap = f"a gap of {steps.max():.3g} s in the constant speed, at t = {t[at]:.4g} s"
            cure = "no part without one is long enough; log again"
            raise Refusal(f"{gap}; {cure}", row=samples.rows[at + 1])
        is_short = last - first > 0.9 * v.size
        reason = Reason.TOO_SHORT if is_short else Reason.NOT_CONSTANT_SPEED
        raise Refusal(_too_few(turns, period, level, form), reason)
    samples = _cut(samples, first, last)
    if turns > _MOST_TURNS:
        kept = slice(round(_MOST_TURNS * period / dt) + 1)
        samples = samples.part(kept, f"{turns:.0f} turns: used the first {_MOST_TURNS}")
    if smooth[first] < 0:
        note = "the motor turns backward: the speed's sign is changed"
        samples = samples.noted(note, signals=-samples.signals)
    return samples


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
            return level, 0, v.size if np.ptp(np.sign(smooth)) == 0 else 0
        means = uniform_filter1d(v, n, mode="nearest", origin=-(n // 2))[: v.size - n]
        level = _level(means, form.expected_speed_rps)
    tolerance = form.speed_tolerance * level
    is_alike = np.abs(smooth[n:] - smooth[:-n]) < tolerance
    is_level = np.abs(np.abs(means) - level) < tolerance
    state = np.where(is_alike[: means.size] & is_level, np.sign(means), 0.0)
    first, last = _longest_run(state)
    return level, first, last + n if last > first else first


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


def _cut(samples: _Samples, first: int, last: int) -> _Samples:
    t = samples.t
    if last - first == t.size:
        return samples
    part = f"from {t[first] - t[0]:.3f} to {t[last - 1] - t[0]:.3f} s of {t[-1] - t[0]:.3f} s"
    return samples.part(slice(first, last), f"used the constant speed {part}")


def _too_few(turns: float, period: float, level: float, form: LogFormat) -> str:
    """What is missing in a log of too few turns, and what may be wrong with what is said of it."""
    what = f"{turns:.1f} load turns of {period:.4g} s at {level:.4g} rps"
    needed = f"{_LEAST_TURNS} alike are needed, 12 are good"
    ratio = form.gear_ratio or 1.0
    if form.turn_period_s is None and ratio > 1 and turns * ratio > _LEAST_TURNS:
        needed += "; is this the joint's side? then --gear-ratio 1"
    return f"{what}; {needed}"


def _longest_run(state: FloatArray) -> tuple[int, int]:
    """First and past-the-end index of the longest run of one value that is not 0; (0, 0) if there is none."""
    starts = np.concatenate(([0], np.flatnonzero(np.diff(state)) + 1, [state.size]))
    lengths = np.where(state[starts[:-1]] != 0, np.diff(starts), 0)
    best = int(lengths.argmax())
    return (int(starts[best]), int(starts[best + 1])) if lengths[best] else (0, 0)


def _on_even_grid(samples: _Samples, dt: float) -> _Samples:
    """Put the samples on the even grid that they were taken on, and fill its holes; resample what has no such grid."""
    places, even, dt, notes = clock.place_on_grid(samples.t, samples.v, dt)
    signals = samples.signals
    if not np.array_equal(places, even):
        from scipy.interpolate import CubicSpline  # slow to import

        signals = CubicSpline(places, signals, axis=1)(even)
    rows = samples.rows[np.minimum(np.searchsorted(places, even), places.size - 1)]
    return samples.noted(*notes, t=dt * even, signals=signals, rows=rows)


def _differentiated(samples: _Samples) -> _Samples:
    """Speed from a position on an even grid; the torque's mean between samples, as the speed's, is by its integral."""
    from scipy.interpolate import CubicSpline  # slow to import

    signals, t = samples.signals.copy(), samples.t
    signals[1:] = CubicSpline(t, signals[1:], axis=1).antiderivative()(t)
    signals = np.diff(signals) / np.diff(t)
    note = "speed differentiated from the position, between neighbouring samples"
    return samples.noted(note, t=t[1:], signals=signals, rows=samples.rows[1:])


def _averaged(samples: _Samples, ring_hz: float) -> _Samples:
    """Average neighbouring samples of a fast log; say of a slow one what it is good for."""
    rate = 1.0 / (samples.t[1] - samples.t[0])
    good_hz = _GOOD_RATE * ring_hz
    if rate < good_hz:
        what = f"below {good_hz:.0f} Hz the peaks of a ring of {ring_hz:g} Hz are read too low"
        return samples.noted(f"sampled at {rate:.0f} Hz: {what}")
    if rate <= _FASTEST_HZ:
        return samples
    together = int(rate // (_FASTEST_HZ / 2))
    whole = samples.t.size // together * together
    return samples.noted(
        f"sampled at {rate:.6g} Hz: averaged over {together} samples each",
        t=samples.t[:whole].reshape(-1, together).mean(axis=1),
        signals=samples.signals[:, :whole].reshape(len(samples.signals), -1, together).mean(axis=2),
        rows=samples.rows[:whole:together],
    )


def _log_of(samples: _Samples, table: Table, columns: Columns, form: LogFormat) -> Log:
    """Check that the speed does not drift, and give the record its speed and turn period."""
    v = samples.v
    mean = float(v.mean())
    period = form.period_s(mean)
    _refuse_drift(samples, period, mean)
    notes = samples.notes
    if form.turn_period_s is None:
        ratio = f"gear ratio {form.gear_ratio:g} at {mean:.6g} rps"
        notes += (f"a load turn takes {period:.6g} s: {ratio}",)
    elif form.gear_ratio and abs(form.gear_ratio / mean / period - 1) > _UNIT_TOLERANCE:
        turn = f"gear ratio {form.gear_ratio:g} at {mean:.5g} rps makes turns of {form.gear_ratio / mean:.4g} s"
        raise Refusal(f"{turn}, not the {period:g} s given", Reason.WRONG_PERIOD)
    speed_rps = form.commanded_speed_rps or mean
    recording = Recording(samples.t - samples.t[0], v, speed_rps, period, table.file)
    return Log(
        file=table.file,
        sha256=table.sha256,
        recording=recording,
        notes=notes,
        form=form,
        torque=samples.signals[1] if columns.torque else None,
        columns=columns.describe(),
        is_links_side=columns.is_links,
    )


def _refuse_drift(samples: _Samples, period: float, mean: float) -> None:
    """Refuse a speed whose mean changes from the first whole turns to the last; gravity's part repeats in both."""
    dt = samples.t[1] - samples.t[0]
    turns = max(int(samples.v.size * dt / period) // 4, 1)
    some = round(turns * period / dt)
    drift = float(samples.v[-some:].mean() - samples.v[:some].mean())
    if abs(drift) > _MOST_DRIFT * mean:
        what = f"it drifts by {drift:+.3g} rps from {mean:.4g} rps"
        raise Refusal(what, Reason.NOT_CONSTANT_SPEED)


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
        what = f"{away.size} single samples stray from their neighbours, {v[k]:.4g} rps beside {v[k - 1]:.4g}"
        cure = "mend or cut the log; of a speed differentiated by uneven stamps log the position"
        raise Refusal(f"{what}; {cure}", row=rows[k])


def _refuse_clipping(samples: _Samples) -> None:
    """Refuse a speed or torque that stops at a limit; one of few different values is coarse, not clipped."""
    for name, signal in zip(("speed", "torque"), samples.signals, strict=False):
        if np.unique(signal[:5000]).size < _LEAST_VALUES:
            continue
        for limit in (signal.max(), signal.min()):
            at = signal == limit
            held = np.flatnonzero(at[2:] & at[1:-1] & at[:-2])
            if held.size > 0.005 * signal.size:
                what = f"the {name} is clipped at {limit:.6g}{' rps' * (name == 'speed')} in {at.sum()} samples"
                raise Refusal(
                    f"{what}; log it with a wider range, or move slower", row=samples.rows[held[0]]
                )
