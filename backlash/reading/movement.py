"""The movement: the stretch of turns at one speed, and what no motor or logger of one does."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from backlash.reading import limits
from backlash.reading.columns import LogOptions
from backlash.reading.samples import Samples, runs_of
from backlash.refusals import Reason, Refusal
from backlash.turns import is_to_and_fro
from replication.records import Recording
from replication.signature import FloatArray


def keep_constant_speed(samples: Samples) -> Samples:
    """Keep the longest stretch of turns that repeat at one mean speed, of the first turns of a long one; or strokes."""
    v, dt = samples.v, samples.dt
    options = samples.options
    width = max(3, round(limits.SMOOTHING_S / dt))
    smooth = uniform_filter1d(v, width, mode="nearest")
    level = usual_speed(smooth, options.expected_speed_rps)
    if level <= np.std(v - smooth):
        raise Refusal("the motor stands still, or turns both ways", Reason.NOT_CONSTANT_SPEED)
    longest_s = dt * runs_of(np.sign(smooth))[1].max()
    if is_to_and_fro(smooth) and longest_s < limits.LEAST_TURNS * options.period_s(level):
        if samples.torque is None:
            raise Refusal(
                "the motor moves to and fro: log the torque, too, by which strokes tell the backlash",
                Reason.NOT_CONSTANT_SPEED,
            )
        _check_speed(level, options)
        return samples
    level, first, last = _repeating_turns(v, smooth, level, dt, options)
    _check_speed(level, options)
    period = options.period_s(level)
    if period < limits.LEAST_SAMPLES * dt:
        raise Refusal(
            f"a load turn of {period:.3g} s is {period / dt:.1f} samples long", Reason.TOO_SHORT
        )
    first += 2 * width * (first > 0)
    last -= 2 * width * (last < v.size)
    turns = (last - first) * dt / period
    if turns < limits.LEAST_TURNS - dt / period:
        is_short = last - first > 0.9 * v.size
        raise Refusal(
            f"{max(turns, 0):.1f} load turns of {period:.4g} s at {level:.4g} rps; {limits.LEAST_TURNS} alike are "
            "needed, 12 are good (a log of the joint's side needs --gear-ratio 1)",
            Reason.TOO_SHORT if is_short else Reason.NOT_CONSTANT_SPEED,
        )
    if last - first < v.size:
        samples = samples.noting(f"used the constant speed {samples.when(slice(first, last))}")
    if turns > limits.MOST_TURNS:
        last = first + round(limits.MOST_TURNS * period / dt) + 1
        samples = samples.noting(f"{turns:.0f} turns: used the first {limits.MOST_TURNS}")
    return samples.at(slice(first, last))


def _repeating_turns(
    v: FloatArray, smooth: FloatArray, level: float, dt: float, options: LogOptions
) -> tuple[float, int, int]:
    """Speed [rps] of the longest stretch of turns alike, and its first and past-the-end sample.

    Within a turn the speed may do what the drive lets it: asked is that its mean over a turn stays,
    and that it comes back a turn later.
    """
    for _ in range(10):  # by a gear ratio the turn goes by the level, and the level by the turn
        n = round(options.period_s(level) / dt)
        if not 0 < n < v.size:
            return level, 0, v.size
        means = uniform_filter1d(v, n, mode="nearest", origin=-(n // 2))[: v.size - n]
        level = usual_speed(means, options.expected_speed_rps)
    tolerance = limits.TOLERANCE * level
    is_alike = np.abs(smooth[n:] - smooth[:-n]) < tolerance
    is_level = np.abs(np.abs(means) - level) < tolerance
    starts, lengths, states = runs_of(np.where(is_alike & is_level, np.sign(means), 0.0))
    lengths *= states != 0
    first, length = int(starts[lengths.argmax()]), int(lengths.max())
    return level, first, first + length + n * (length > 0)


def usual_speed(v: FloatArray, expected: float | None) -> float:
    """The speed [rps], without sign, that a log keeps longest; near the expected one if that is among them."""
    speed = np.abs(v)
    most = speed.max()
    if expected is not None:
        is_near = np.abs(speed / expected - 1) < 2 * limits.TOLERANCE
        if np.mean(is_near) > 0.1:
            speed = speed[is_near]
    rising = np.sort(speed[speed > 0.05 * most])  # not standing still
    alike = np.searchsorted(rising, rising + 0.5 * limits.TOLERANCE * most)
    count = alike - np.arange(rising.size)
    best = count.argmax()
    return float(np.median(rising[best : alike[best]]))


def _check_speed(level: float, options: LogOptions) -> None:
    """Refuse a speed that is not the expected one, or none of a motor."""
    expected = options.expected_speed_rps
    if expected is None and level > limits.FASTEST_RPS:
        raise Refusal(
            f"the speed is {level:.4g} rps, more than motors turn; is it in rpm, rad/s, deg/s or counts? "
            "then give --unit, else --commanded-speed"
        )
    if expected is not None and abs(level / expected - 1) > limits.TOLERANCE:
        is_by_turn = options.gear_ratio and options.turn_period_s
        source = "by gear ratio and turn" if is_by_turn else "commanded"
        raise Refusal(
            f"the log keeps {level:.4g} rps longest, not {expected:.4g} rps, {source}; "
            "is --unit right?",
            Reason.NOT_CONSTANT_SPEED,
        )


def turn_forward(samples: Samples) -> Samples:
    """Change the signs of a motor that turns backward."""
    if samples.v.mean() >= 0 or is_to_and_fro(samples.v):
        return samples
    note = "the motor turns backward: the speed's sign is changed"
    return replace(samples, signals=-samples.signals).noting(note)


def make_recording(samples: Samples) -> Recording:
    """The record with its speed and turn period, of a speed that does not drift."""
    t, v = samples.t, samples.v
    options = samples.options
    if is_to_and_fro(v):
        level = usual_speed(v, options.expected_speed_rps)
        return Recording(t - t[0], v, level, options.period_s(level), "log")
    mean = float(v.mean())
    period = options.period_s(mean)
    # Gravity's part repeats in the first whole turns and the last.
    n = period / samples.dt
    some = round(max(v.size / n // 4, 1) * n)
    drift = float(v[-some:].mean() - v[:some].mean())
    if abs(drift) > limits.MOST_DRIFT * mean:
        raise Refusal(
            f"it drifts by {drift:+.3g} rps from {mean:.4g} rps", Reason.NOT_CONSTANT_SPEED
        )
    if mean * period < limits.LEAST_RATIO:
        raise Refusal(
            f"at {mean:.3g} rps the motor makes {mean * period:.2g} turns in a load turn of {period:.4g} s; is the "
            "unit or the turn another one?"
        )
    return Recording(t - t[0], v, mean, period, "log")
