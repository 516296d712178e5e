"""Movements to and fro at constant speed through the hanging position: the mean stroke of each direction.

A stroke back, mirrored, is one forth with gravity's phase negated. So a window of strokes, from before the teeth part
to where the load has rung out, is a turn that need not end where it begins.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.interpolate import CubicSpline
from scipy.linalg import toeplitz
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from backlash.answer import TORQUE_SIGNAL, Trace
from backlash.load_data import LoadData
from backlash.reading.samples import runs_of
from backlash.refusals import Reason, Refusal
from backlash.torque import problem
from backlash.torque.load import LOSS, PHASE, Accuracy, Comparison, Stroke, Window, compare
from backlash.torque.problem import Movement, Problem
from backlash.torque.search import Candidate
from backlash.torque.unknowns import TABLE
from backlash.turns import TURN, ComplexArray, Harmonics, round_to, sum_harmonics
from replication.records import Recording
from replication.signature import FloatArray


@dataclass(frozen=True)
class StrokeSettings:
    """Constants of strokes, each with its source."""

    smoothing_s: float = 0.02  # of speed and torque, by which strokes and gravity are found
    same_speed: float = 0.03  # as of turns
    least_strokes: int = 3  # of a direction, whose scatter is the noise
    settling_s: float = (
        0.06  # of a drive that has reached its speed, and half of it before it stops
    )
    pad_s: float = 0.05  # beside a window, where the motion is made smooth, and edges of a window
    # A window, from before the teeth part to after the hanging position; where strokes are short, no less.
    before_s: tuple[float, float] = (0.2, 0.05)
    after_s: tuple[float, float] = (0.8, 0.25)
    ring_damping: float = 0.01  # a ring of 20 Hz that grows for half a second
    most_harmonics: int = 100
    beyond_hz: float = 20.0  # one over the edges of a window
    # Of the gear ratio, by gravity's course over the angle, if another leaves so much more of the torque: right ones
    # are told as 0.9 to 1.35 of themselves.
    ratios: tuple[float, float] = (0.67, 1.5)
    clear_ratio: float = 1.3
    least_gravity: float = 3.0  # over what it leaves of the torque
    least_friction: float = 0.01  # over gravity, by which one that is none may be below
    gain_sd: float = 0.03  # of a gear's loss below zero


SETTINGS = StrokeSettings()
_NO_WEIGHT = 1e9  # of variances
# Beside what is compared, of x and x' of 1 mrad at a usual ring: bounds a start's steps where no tooth touches.
_START_WEIGHT = (1e6, 1e6 / (TURN * 22.0) ** 2)
_LEAST_WEIGHT = 1e-30  # of what is free, so that the far trials of a search have a solution


class MeanStroke(NamedTuple):
    """The mean stroke of a direction, mirrored if back, in its window."""

    sign: int
    speed: Harmonics  # [rad/s of the load]
    torque: Harmonics
    used: NDArray[np.bool_]
    mean_speed: float
    first_rad: float  # angle where the window begins, but for the speed's harmonics
    angle: FloatArray
    taper: FloatArray
    torques: FloatArray  # shape (strokes, samples)
    gravity: ComplexArray  # gravity's line of each stroke, over the mean one's


class Gravity(NamedTuple):
    """What the torque of all strokes tells."""

    torque: float  # in the log's unit
    phase: float  # where the log begins, and the angle is 0
    friction: float  # over gravity, of motor, gear and load


class MeasuredStrokes(NamedTuple):
    """Mean strokes forth and back, and what they tell beside."""

    means: list[MeanStroke]
    gravity: Gravity
    sample_s: float
    movement: Movement


def measure_strokes(recording: Recording, torque: FloatArray) -> MeasuredStrokes:
    """Mean strokes of both directions; Refusal where they cannot tell the backlash."""
    dt = float(round_to(recording.sample_s, 1e-5 * recording.sample_s))
    gear_ratio = recording.commanded_speed_rps * recording.turn_period_s
    speed = TURN / gear_ratio * recording.v
    smooth, low = gaussian_filter1d([speed, torque], SETTINGS.smoothing_s / dt, axis=1)
    angle = dt * np.cumsum(speed)
    strokes, level = find_strokes(smooth, dt)
    inside = np.concatenate([np.arange(each.start, each.stop) for each in strokes])
    acceleration = np.gradient(smooth, dt)
    gravity = _measure_gravity(np.array([low, angle, acceleration, smooth > 0])[:, inside])
    signals = CubicSpline(np.arange(angle.size), [angle, speed, torque], axis=1)
    means, ends_deg = [], []
    for sign in (1, -1):
        own = [each for each in strokes if sign * smooth[each.start] > 0]
        begin, end, hanging = _choose_window(own, sign * angle, sign, level, gravity)
        ends_deg += [*np.degrees(sign * (np.array([begin, end]) - hanging))]
        size = int((end - begin) / level / dt) + 2 * int(SETTINGS.pad_s / dt)
        middles = np.array([_place_of((begin + end) / 2, sign * angle, each) for each in own])
        places = middles[:, None] + np.arange(size) - size // 2
        rows = sign * signals(np.clip(places, 0, angle.size - 1))
        means.append(_average(rows, sign, sign * gravity.phase, dt))
    forth, back = (each.gravity for each in means)
    angles = f"{min(ends_deg):.0f} to {max(ends_deg):.0f} degrees of the hanging position"
    movement = Movement(
        gear_ratio=gear_ratio,
        change=max(forth.real.std(), forth.imag.std(), back.real.std(), back.imag.std()),
        odd_against_even=max(map(_odd_against_even, (forth, back))),
        scatter_s=max(forth.imag.std(), back.imag.std()) / level,
        friction=gravity.friction,
        strokes=f"strokes ({forth.size} forth, {back.size} back, from {angles})",
    )
    return MeasuredStrokes(means, gravity, dt, movement)


def _place_of(angle: float, course: FloatArray, stroke: slice) -> float:
    """Where in the samples a stroke passes an angle, to a sixteenth of one."""
    place = np.interp(angle, course[stroke], np.arange(stroke.start, stroke.stop))
    return float(np.round(16 * place) / 16)


def _odd_against_even(gravity: ComplexArray) -> float:
    pairs = gravity[gravity.size % 2 :].reshape(-1, 2)
    return float(abs(np.diff(pairs).mean()))


def _choose_window(
    strokes: list[slice], course: FloatArray, sign: int, level: float, gravity: Gravity
) -> tuple[float, float, float]:
    """The angles of a direction's window and of the hanging position in it; Refusal where they are too near."""
    s = SETTINGS
    lowest = max(course[each.start] for each in strokes)
    highest = min(course[each.stop - 1] for each in strokes)
    hanging = -sign * gravity.phase
    hanging += TURN * round(((lowest + highest) / 2 - hanging) / TURN)
    # Friction above gravity is refused for that.
    parting = hanging - (math.asin(gravity.friction) if gravity.friction < 1 else 0.0)
    begin = max(lowest, parting - s.before_s[0] * level)
    end = min(highest, hanging + s.after_s[0] * level)
    if parting - begin < s.before_s[1] * level or end - hanging < s.after_s[1] * level:
        way = "forth" if sign > 0 else "back"
        places = np.degrees(np.array([lowest, highest, parting]) - hanging)
        raise Refusal(
            f"strokes {way} keep their speed from {places[0]:.0f} to {places[1]:.0f} degrees of the hanging position, "
            f"the teeth may part from {places[2]:.0f} on: they have to begin before and go on beyond 0; move by "
            "60 degrees or more to either side, at 1 to 2 rad/s",
            Reason.NO_REVERSAL,
        )
    return begin, end, hanging


def find_strokes(smooth: FloatArray, dt: float) -> tuple[list[slice], float]:
    """Stretches of one speed, and the speed; Refusal if they are few."""
    s = SETTINGS
    fast = 0.5 * np.percentile(np.abs(smooth), 95)
    runs = runs_of(np.where(np.abs(smooth) > fast, np.sign(smooth), 0.0))
    found = []
    for start, length, sign in zip(*runs, strict=True):
        part = sign * smooth[start : start + length]
        flat = start + np.flatnonzero(part > 0.85 * np.median(part))
        if sign and flat[-1] - flat[0] > 5 * s.settling_s / dt:
            ends = flat[0] + int(s.settling_s / dt), flat[-1] - int(0.5 * s.settling_s / dt)
            found.append((slice(*ends), float(np.median(part))))
    level = float(np.median([speed for _, speed in found])) if found else 0.0
    chosen = [each for each, speed in found if abs(speed - level) < s.same_speed * level]
    forth = sum(smooth[each.start] > 0 for each in chosen)
    if min(forth, len(chosen) - forth) < s.least_strokes:
        raise Refusal(
            f"of {len(found)} strokes {forth} forth and {len(chosen) - forth} back have one speed; "
            f"{s.least_strokes} of each are needed, 4 to 6 are good",
            Reason.NOT_CONSTANT_SPEED,
        )
    return chosen, level


def _measure_gravity(signals: FloatArray) -> Gravity:
    """Gravity by smooth torque, angle, acceleration and direction, 1 forth and 0 back, shape (4, samples).

    Refusal where there is none, or its course is no sine's.
    """
    size = signals.shape[1]
    (sine, cosine, _, forth, back), left = _regress(signals)
    gravity, friction = math.hypot(sine, cosine), (forth - back) / 2
    rest = math.sqrt(left / size)
    if gravity < SETTINGS.least_gravity * rest or friction < -SETTINGS.least_friction * gravity:
        raise Refusal(
            f"gravity moves the torque by {gravity:.3g} in the log's unit, friction by {friction:.3g}, all else by "
            f"{rest:.3g}; is it this motor's torque, positive where it drives forward, and the axis horizontal?",
            Reason.NO_GRAVITY,
        )
    ratios = np.geomspace(0.25, 4, 49)
    some = signals[:, :: 1 + size // 4000].copy()
    some[1] -= signals[1].mean()
    lefts = [_regress(some * [[1], [ratio], [1], [1]])[1] for ratio in ratios]
    ratio = ratios[np.argmin(lefts)]
    low, high = SETTINGS.ratios
    if not low < ratio < high and lefts[ratios.size // 2] > SETTINGS.clear_ratio * min(lefts):
        raise Refusal(
            f"gravity goes by {ratio:.2g} times the load's angle; is the gear ratio right?",
            Reason.WRONG_PERIOD,
        )
    numbers = gravity, math.atan2(cosine, sine), max(friction / gravity, 0.0)
    return Gravity(*round_to(numbers, 1e-3 * np.array([gravity, 1.0, 1.0])).tolist())


def _regress(signals: FloatArray) -> tuple[FloatArray, float]:
    """Gravity's sine and cosine, inertia, friction forth and back by a torque, and the squares that they leave."""
    torque, angle, acceleration, forth = signals
    terms = np.array([np.sin(angle), np.cos(angle), acceleration, forth, 1 - forth]).T
    found = np.linalg.lstsq(terms, torque, rcond=None)[0]
    return found, float(np.square(torque - terms @ found).sum())


def _ramps(size: int, outside: float, ramp: float) -> FloatArray:
    """0 at both ends, 1 in between, and a cosine where it rises."""
    place = np.arange(size) + 0.5
    rise = np.clip((np.minimum(place, size - place) - outside) / ramp, 0, 1)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * rise))


def _average(signals: FloatArray, sign: int, phase: float, dt: float) -> MeanStroke:
    """The mean of some strokes' angle, speed and torque, shape (signals, strokes, samples)."""
    _, count, n = signals.shape
    pad = SETTINGS.pad_s / dt
    pads, taper = _ramps(n, 0, pad), _ramps(n, pad, pad)
    angle, speed, torque = signals.mean(axis=1)
    mean_speed = float(round_to(taper @ speed / taper.sum(), 1e-4))
    order = np.arange(1, int(min(problem.SETTINGS.driven_hz, 0.45 / dt) * n * dt) + 1)
    omega = TURN / (n * dt) * order
    lines = np.fft.rfft([pads * (speed - mean_speed), taper * torque])[:, order] / n
    strays = (
        np.fft.rfft(taper * (signals[1:] - signals[1:].mean(axis=1, keepdims=True)))[..., order] / n
    )
    power = np.square(np.abs(strays)).sum(axis=1) / (2 * count * (count - 1))
    # Numbers within a taper have something in common: each counts for less than one.
    sd = np.sqrt(uniform_filter1d(power, 7, mode="nearest") / np.square(taper).mean())
    of_speed, of_torque = (
        problem.round_below_noise(Harmonics(order, omega, *each))
        for each in zip(lines, sd, strict=True)
    )
    moved = of_speed.coefficient / (1j * omega)
    wave = sum_harmonics(moved, order, n) + mean_speed * dt * np.arange(n)
    first = float(round_to(taper @ (angle - wave) / taper.sum(), 1e-4))
    used = omega < TURN * 0.4 / dt
    terms = taper * [np.sin(angle + phase), np.cos(angle + phase)]
    real, imaginary = np.linalg.lstsq(terms.T, (taper * signals[2]).T, rcond=None)[0]
    gravity = (real + 1j * (imaginary - imaginary.mean())) / real.mean()
    return MeanStroke(
        *(sign, of_speed, of_torque, used, mean_speed, first, first + wave, taper, signals[2]),
        gravity,
    )


def state_strokes(
    measured: MeasuredStrokes, load: LoadData, accuracy: Accuracy = problem.FINE
) -> Problem:
    """Priors by the table of unknowns, the load's data and gravity's course."""
    inertia = measured.gravity.torque / (load.inertia_ratio * load.gravity_per_s2)
    prior = problem.state_prior(load, measured.gravity.phase, inertia, measured.gravity.friction)
    # Else chi squared falls where a gear gains torque, and a large inertia makes much noise of the speed's.
    prior.weight_below_zero[LOSS] = SETTINGS.gain_sd**-2
    windows = tuple(_state_window(each, measured, load, accuracy) for each in measured.means)
    size = sum(w.stroke.size for w in windows if w.stroke)
    return Problem(Comparison(windows, size), prior, problem.OF_STROKES)


def _state_window(
    mean: MeanStroke, measured: MeasuredStrokes, load: LoadData, accuracy: Accuracy
) -> Window:
    c, n = problem.SETTINGS, mean.taper.size
    lasts_s, hz = n * measured.sample_s, accuracy.fitted_hz
    # What lies beyond what is compared reaches it through the window's edges.
    last = min(hz, SETTINGS.most_harmonics / lasts_s)
    used = mean.used & (mean.speed.omega < TURN * (last + SETTINGS.beyond_hz))
    smoothing = c.loss_smoothing * load.gravity_per_s2
    course = np.exp(1j * mean.first_rad), mean.mean_speed * lasts_s
    window = compare(mean.speed, mean.torque, used, accuracy, smoothing, *course)
    grid = 4 * next_fast_len(int(window.order[-1]) + 1, real=True)
    taper = np.interp(np.arange(grid) * n / grid, np.arange(n), mean.taper)
    signs = np.ones(len(TABLE))
    signs[PHASE] = mean.sign
    pads = _ramps(window.direction.size, 0, SETTINGS.pad_s / window.step_s)
    is_compared = window.omega < TURN * last
    own_variance = np.where(is_compared, 1.0, _NO_WEIGHT) * window.own_variance
    # The level of the motor's friction, and its orders.
    gear_ratio = measured.movement.gear_ratio
    added = [np.ones(n)]
    for k in c.motor_orders if gear_ratio > 1.5 else ():
        if k * gear_ratio * measured.means[0].mean_speed < TURN * hz:
            added += [f(k * gear_ratio * mean.angle) for f in (np.sin, np.cos)]
    free = np.fft.rfft(mean.taper * added)[:, window.order] / n
    size = 2 * is_compared.sum() * np.square(taper).mean() - 2 - len(free)
    power = np.square(np.abs(np.fft.fft(mean.taper)[: window.order.size]))
    spread = toeplitz(power) / (2 * power.sum() - power[0])
    least = np.diag([*_START_WEIGHT, *[_LEAST_WEIGHT] * len(free)])
    stroke = Stroke(signs, pads, taper, free, least, spread, size)
    return window._replace(
        own_variance=own_variance, stroke=stroke, ring_damping=SETTINGS.ring_damping
    )


def trace_strokes(measured: MeasuredStrokes, stated: Problem, best: Candidate) -> Trace:
    """The torque of the mean strokes, forth and then back, and the model's, with the same mean."""
    parts = []
    for mean, window, each in zip(
        measured.means, stated.compared.windows, best.orbit.each, strict=True
    ):
        inside = mean.taper == 1
        torque = mean.torques.mean(axis=0)[inside]
        model = sum_harmonics(each.torque, window.order, mean.taper.size)[inside]
        parts.append([torque, model + (torque - model).mean()])
    torque, model = np.concatenate(parts, axis=1)
    return Trace(measured.sample_s * np.arange(torque.size), torque, model, TORQUE_SIGNAL)
