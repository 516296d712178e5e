"""Prepare: from a log to its table, and on to a record of turns at constant speed, in steps that each do one thing."""

import hashlib
import re
from dataclasses import dataclass, replace
from os import PathLike

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from backlash.reading import clock, limits, movement, values
from backlash.reading.columns import Columns, LogOptions, choose_columns, numeric_column
from backlash.reading.samples import Samples
from backlash.reading.sources import name_of, naming, read_bytes, unpacked
from backlash.reading.tables import Table, read_table
from backlash.reading.units import PER_TURN
from backlash.refusals import Reason, Refusal
from replication.records import Recording
from replication.signature import FloatArray

_STAMPS = (pd.DatetimeIndex, pd.TimedeltaIndex)


@dataclass(frozen=True, eq=False, kw_only=True)
class Log(Samples):
    """A log that was read, with its record of constant speed."""

    recording: Recording
    sha256: str | None  # of the file's bytes


def read_source(
    source: object, options: LogOptions, v: ArrayLike | None = None, torque: ArrayLike | None = None
) -> Table:
    """Read a log: a path ("-": standard input), a table, or time, speed and torque as arrays."""
    if isinstance(source, str | PathLike):
        with naming(str(source)):
            content = read_bytes(str(source))
            table = read_table(unpacked(content), 1 if options.rate_hz else 2)
        return replace(table, sha256=hashlib.sha256(content).hexdigest())
    if isinstance(source, pd.DataFrame):
        index = source.index
        named = index.name or ("time" if isinstance(index, _STAMPS) else None)
        frame = source.rename_axis(named).reset_index(drop=named is None).rename(columns=str)
        return Table(frame)
    if v is None:
        raise Refusal(
            f"one {type(source).__name__} is no log: give time and speed as arrays of one length, or a pandas table, "
            "as to_pandas() or to_dataframe() of other tables make it"
        )
    names = [options.time or "time", options.position or options.speed or "speed", options.torque]
    arrays = zip(names, (source, v, torque), strict=True)
    try:
        frame = pd.DataFrame({column: np.asanyarray(each) for column, each in arrays if column})
    except ValueError as error:
        raise Refusal(f"{error}; give time, speed and torque of one length") from error
    return Table(frame)


def open_log(
    source: object, options: LogOptions, v: ArrayLike | None = None, torque: ArrayLike | None = None
) -> Log:
    """Read and prepare a log; see `read_source`."""
    table = read_source(source, options, v, torque)
    logged = samples = Samples(np.empty(0), np.empty(0), pd.Index([]), options, Columns())
    try:
        samples = replace(samples, columns=choose_columns(table, options))
        samples = take_samples(table.frame, samples)
        for step in TO_LOGGED_VALUES:
            samples = step(samples)
        logged = samples
        for step in TO_CONSTANT_SPEED:
            samples = step(samples)
        values.refuse_unmeasured(logged, samples.t[0], samples.t[-1])
        recording = movement.make_recording(samples)
    except Refusal as refusal:
        error = _true_cause(refusal, logged, samples, table)
        if table.sha256 and error.is_unusable:
            error.file = name_of(source)
        error.columns = str(samples.columns)
        error.notes = samples.notes
        raise error from refusal
    return Log(**vars(samples), recording=recording, sha256=table.sha256)


def _true_cause(refusal: Refusal, logged: Samples, samples: Samples, table: Table) -> Refusal:
    """A refusal, or the cause that lies before it; with what else may be wrong."""
    try:
        values.refuse_unmeasured(replace(logged, signals=logged.signals[:1]), 0.0, np.inf)
    except Refusal as cause:
        return cause
    cell = table.doubtful.get(samples.columns.signal)
    if cell and refusal.reason in (Reason.NOT_CONSTANT_SPEED, Reason.TOO_SHORT):
        whole = re.sub("[.,]", "", cell)
        refusal.add(f"{cell} may be {whole}, with a mark of thousands")
    if refusal.is_unusable:
        refusal.add_sheet(table.sheet)
    return refusal


def take_samples(frame: pd.DataFrame, samples: Samples) -> Samples:
    """Time stamps [s] of the rows that have all numbers, the unit of the stamps, and the part that is asked for."""
    columns, options = samples.columns, samples.options
    names = [name for name in (columns.signal, columns.torque) if name]
    needed = [columns.time, *names] if columns.time else names
    is_whole = frame[needed].notna().all(axis=1)
    table = frame[is_whole]
    if len(table) < 3:
        counts = [f"{name} (in {frame[name].count():,} rows)" for name in needed]
        raise Refusal(
            f"{' and '.join(counts)} stand in {len(table)} rows together; log all at the same instants, for "
            f"{limits.LEAST_TURNS} load turns"
        )
    if options.rate_hz:
        t = np.flatnonzero(is_whole) / options.rate_hz
    else:
        t, unit = clock.read_times(table, columns.time, options.time_unit)
        columns = replace(columns, time_unit=unit)
    incomplete = frame.loc[~is_whole, needed].dropna(how="all")
    if len(incomplete):
        lacking = " or ".join(incomplete.columns[incomplete.isna().any()])
        samples = samples.noting(f"left out {len(incomplete)} rows without {lacking}")
    clock.refuse_backward(t, table.index)
    chosen = (t >= options.start_s) & (t <= options.end_s)
    used = chosen.sum()
    if used < 3:
        raise Refusal(f"no samples between --from and --to; the log lasts {t[-1]:.6g} s")
    if used < t.size:
        samples = samples.noting(f"used {used} of {t.size} samples, by --from and --to")
    table = table[chosen]
    signals = np.array([numeric_column(table, name) for name in names])
    if np.ptp(signals[0]) == 0:
        raise Refusal(
            f"{columns.signal} never changes, it is {signals[0, 0]:g} throughout; "
            "is it the right column?"
        )
    signals[0] /= {**PER_TURN, "counts": options.counts_per_turn or 1.0}[columns.unit]
    return replace(samples, t=t[chosen], signals=signals, rows=table.index, columns=columns)


def merge_repeated(samples: Samples) -> Samples:
    """Leave out what repeats the sample before, as a logger writes that polls faster than the drive answers."""
    goes_on = np.append(np.diff(samples.t) > 0, True)
    others = ~goes_on[:-1] & (np.diff(samples.signals) != 0).any(axis=0)
    others[0] = False  # loggers may begin with a row that is none
    if others.any():
        raise Refusal(
            f"its time stamp repeats the one before with other values ({others.sum()} such rows); "
            "drop doubled rows, and export stamps with all their digits",
            row=samples.rows[1 + others.argmax()],
        )
    if goes_on.all():
        return samples
    note = f"merged {np.sum(~goes_on)} rows with the time stamp of the next"
    return samples.at(goes_on).noting(note)


def unwrap_position(samples: Samples) -> Samples:
    """Make a position [turns] go on where it started anew after a turn or 2^n counts."""
    if not samples.columns.is_position:
        return samples
    t, turns = samples.t, samples.v
    options = samples.options
    modulus = _modulus(turns, options.counts_per_turn)
    if modulus == 0:
        return samples
    # By the nearest multiple to a uniform motion, at the speed of most steps or the one expected,
    # either way; so that samples may be far apart.
    steps = np.diff(turns)
    steps -= modulus * np.round(steps / modulus)
    speed = options.expected_speed_rps or abs(float(np.median(steps / np.diff(t))))
    motions = (way * speed * t for way in (1.0, -1.0))
    ways = [np.unwrap(turns - motion, period=modulus) + motion for motion in motions]
    best = min(ways, key=lambda way: np.abs(np.abs(np.diff(way) / np.diff(t)) - speed).mean())
    starts = np.rint((best - turns) / modulus)
    if jumps := np.count_nonzero(np.diff(starts)):
        samples = samples.noting(
            f"the position starts anew every {modulus:g} motor turns: unwrapped {jumps} times"
        )
    return replace(samples, signals=np.vstack([turns + modulus * starts, samples.signals[1:]]))


def _modulus(turns: FloatArray, counts_per_turn: float | None) -> float:
    """Turns after which a position starts anew; 0 if it does not."""
    span = float(np.ptp(turns))
    steps = np.diff(turns)
    usual = float(np.median(steps))
    # A saw: steps of one direction, and some back over nearly all of the span.
    is_back = (np.abs(steps) > 0.9 * span) & (np.sign(steps) == -np.sign(usual))
    is_saw = is_back.any() and not (steps * np.sign(usual) > 0.5 * span).any()
    rounds, most = [1.0], 2 * span
    if counts_per_turn:
        rounds += [*(2.0 ** np.arange(8, 33) / counts_per_turn)]
    if is_saw:
        size = float(np.median(np.abs(steps[is_back]))) + abs(usual)
        rounds.append(np.rint(size))
        most = size + 2 * abs(usual)
        if counts_per_turn:
            rounds += [*(10.0 ** np.arange(2, 10) / counts_per_turn)]
    modulus = min((m for m in rounds if span <= m * (1 + 1e-9) and m < most), default=0.0)
    if modulus or not is_saw:
        return modulus
    raise Refusal(
        f"the position starts anew every {size:.5g} turns, which are no whole ones; give --counts-per-turn of the "
        "encoder, or --unit"
    )


def between_gaps(samples: Samples) -> Samples:
    """Keep the part between two gaps, of more than can be filled, in which the motor goes farthest."""
    dt = clock.sampling_period(samples)
    longest = max(limits.LONGEST_STEP * dt, dt + limits.LONGEST_FILLED_S)
    gaps = np.flatnonzero(np.diff(samples.t) > longest)
    if gaps.size:
        course = samples.v if samples.columns.is_position else np.cumsum(samples.v)
        parts = np.split(np.arange(course.size), gaps + 1)
        farthest = max(parts, key=lambda part: np.ptp(course[part]))
        note = f"used what is between two gaps, {samples.when(farthest)}"
        samples = samples.noting(note).at(farthest)
    t = samples.t
    if t.size < limits.LEAST_SAMPLES:
        raise Refusal(
            f"{t[-1] - t[0]:.3g} s in {t.size} samples; {limits.LEAST_TURNS} load turns are needed",
            Reason.TOO_SHORT,
        )
    return samples


def differentiate_position(samples: Samples) -> Samples:
    """Speed of a position; the torque's mean between the same two samples, by its integral; the torque as logged."""
    if not samples.columns.is_position:
        return samples
    t, (turns, *torque) = samples.t, samples.signals
    integrals = [CubicSpline(t, each).antiderivative()(t) for each in torque]
    means = np.diff([turns, *integrals]) / np.diff(t)
    return replace(samples, t=t[1:], signals=np.vstack([means, *samples.signals[1:, 1:]]))


def average_fast(samples: Samples) -> Samples:
    """Means of neighbouring samples of a fast log; of a slow one it is noted what it is good for."""
    rate, ring_hz = samples.rate_hz, samples.options.ring_hz
    good_hz = limits.GOOD_RATE * ring_hz
    if rate < good_hz:
        samples = samples.noting(
            f"sampled at {rate:.0f} Hz: below {good_hz:.0f} Hz the peaks of a ring of {ring_hz:g} Hz are read too low"
        )
    if rate <= limits.FASTEST_HZ:
        return samples
    together = int(rate // (limits.FASTEST_HZ / 2))
    whole = samples.t.size // together * together
    both = np.vstack([samples.t, samples.signals])[:, :whole]
    means = both.reshape(len(both), -1, together).mean(axis=2)
    note = f"sampled at {rate:.6g} Hz: averaged over {together} samples each"
    return replace(samples.noting(note), t=means[0], signals=means[1:])


# In this order; each takes the samples and hands them on, or refuses them.
TO_LOGGED_VALUES = (merge_repeated, unwrap_position, between_gaps)
TO_CONSTANT_SPEED = (
    values.keep_new_values,
    clock.place_on_grid,
    differentiate_position,
    average_fast,
    values.refuse_speed_spikes,
    movement.keep_constant_speed,
    movement.turn_forward,
)
