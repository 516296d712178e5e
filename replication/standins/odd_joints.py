"""Joints that the simulated joint is not: what a sensor built on it must refuse, or hold in its interval.

Two loads one behind the other, a second ring, a PI drive with a current loop, and a notch filter in the torque command.
Each is drawn around a bench of `joints.draw_bench`.
"""

from dataclasses import replace

import numba as nb
import numpy as np
from numpy.typing import NDArray

from replication.datasets import Recording
from replication.simulator.parameters import TURN, with_ratios
from replication.simulator.simulate import encoder_speed_rps
from replication.standins.joints import SAMPLE_S, Bench, draw_bench, encoder_log

FloatArray = NDArray[np.float64]

KINDS = ("two loads", "second ring", "PI with current loop", "notch filter")

_STEP_S = 5e-5
_TURNS = 12
_MOST_TRIES = 200
# No joint of this kind runs so far from its commanded speed.
_LARGEST_RPS = 10.0


def draw_odd_log(kind: str, delta_rad: float, rng: np.random.Generator) -> Recording:
    """Log twelve turns of a joint outside the model, as `joints.encoder_log` does; unstable draws are drawn again.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    delta_rad : float
        Its backlash [rad].
    rng : Generator
        Of the joint and its noise.

    Raises
    ------
    ValueError
        No such kind, or no stable draw.
    """
    if kind not in KINDS:
        raise ValueError(f"kind {kind!r}: there are {', '.join(KINDS)}")
    for _ in range(_MOST_TRIES):
        bench = draw_bench(rng)
        try:
            found = _pi_log(bench, delta_rad, rng) if kind == KINDS[2] else _other_log(kind, bench, delta_rad, rng)
        except (ValueError, ArithmeticError):
            continue
        if np.abs(found.v - found.commanded_speed_rps).max() < _LARGEST_RPS:
            return found
    raise ValueError(f"{kind}: no stable joint in {_MOST_TRIES} draws")


def _pi_log(bench: Bench, delta_rad: float, rng: np.random.Generator) -> Recording:
    """PI speed loop without derivative and leaky integral, a position loop around it, a faster current loop."""
    ratios = bench.joint.ratios
    joint = with_ratios(
        bench.joint,
        {
            "derivative_gain": 0.0,
            "leaky_gain_per_s2": 0.0,
            "speed_gain_per_s": ratios["speed_gain_per_s"] * rng.uniform(0.3, 0.8),
            "integral_gain_per_s2": ratios["integral_gain_per_s2"] * rng.uniform(0.05, 0.3),
            "torque_lag_s": rng.uniform(0.3e-3, 1e-3),
        },
    )
    return encoder_log(replace(bench, joint=joint), delta_rad, rng)


def _other_log(kind: str, bench: Bench, delta_rad: float, rng: np.random.Generator) -> Recording:
    joint = bench.joint
    second, notch = (0.0, 1.0, 0.0), np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    if kind == "two loads":
        second = (rng.uniform(0.2, 0.5), TURN * rng.uniform(8.0, 25.0), rng.uniform(0.02, 0.1))
    elif kind == "second ring":
        second = (rng.uniform(0.05, 0.15), TURN * rng.uniform(30.0, 80.0), rng.uniform(0.005, 0.03))
    else:
        notch = _notch(rng.uniform(40.0, 150.0), rng.uniform(0.5, 2.0), joint.control_period_s)
    ratios, n = joint.ratios, joint.gear_ratio
    jm = 1 / (n**2 * ratios["inertia_ratio"])
    friction = ratios["gravity_per_s2"] * joint.load_coulomb_nm / joint.gravity_torque_nm
    constants = np.array(
        [n, joint.commanded_speed_rad_per_s, jm, ratios["stiffness_per_s2"], delta_rad, ratios["gravity_per_s2"],
         friction, joint.torque_lag_s, rng.uniform(0, TURN), *second]
    )  # fmt: skip
    drive = np.array(
        [ratios["position_gain_per_s"], *(jm * ratios[name] for name in (
            "speed_gain_per_s", "integral_gain_per_s2", "derivative_gain", "leaky_gain_per_s2")),
         ratios["leaky_rate_per_s"], joint.control_period_s]
    )  # fmt: skip
    turns = _TURNS + 2
    steps = round(turns * joint.turn_period_s / _STEP_S)
    position = _run(constants, drive, notch, steps, _STEP_S, round(joint.control_period_s / _STEP_S))
    if not np.isfinite(position).all():
        raise ArithmeticError("diverged")
    every = round(SAMPLE_S / _STEP_S)
    skip = round(2 * joint.turn_period_s / _STEP_S)
    seen = position[skip::every]
    t = SAMPLE_S * np.arange(seen.size)
    speed = encoder_speed_rps(seen + joint.commanded_speed_rad_per_s * t, 19, SAMPLE_S)
    noisy = speed + rng.normal(0.0, bench.noise_rps, speed.size)
    return Recording(t[:-1], noisy, joint.commanded_speed_rps, joint.turn_period_s, f"simulated: {kind}")


def _notch(frequency_hz: float, quality: float, period_s: float) -> FloatArray:
    """Coefficients b0, b1, b2, a1, a2 of a notch of -20 dB."""
    w = TURN * frequency_hz * period_s
    alpha, depth = np.sin(w) / (2 * quality), 0.1
    b = np.array([1 + depth * alpha, -2 * np.cos(w), 1 - depth * alpha])
    a = np.array([1 + alpha, -2 * np.cos(w), 1 - alpha])
    return np.concatenate([b, a[1:]]) / a[0]


@nb.njit(cache=True)
def _rates(t, y, command, c):
    """Rates of motor, load, second load and torque; the load's whole inertia is 1."""
    n, omega, jm, ks, delta, gravity, friction, lag, angle, share, frequency, damping = c
    x = y[0] / n - y[2]
    tau = ks * (x - delta) if x > delta else (ks * (x + delta) if x < -delta else 0.0)
    turn = angle + omega / n * t
    inner = share * frequency * (frequency * (y[2] - y[4]) + 2 * damping * (y[3] - y[5]))
    first = (tau - friction - inner - (1 - share) * gravity * np.sin(turn + y[2])) / (1 - share)
    second = inner / max(share, 1e-9) - gravity * np.sin(turn + y[4]) if share > 0 else 0.0
    return np.array([y[1], (y[6] - tau / n) / jm, y[3], first, y[5], second, (command - y[6]) / lag])


@nb.njit(cache=True, nogil=True)
def _run(c, drive, notch, steps, step, per_period):
    """Motor position as deviation from the commanded motion, a row a step."""
    kpos, kp, ki, kd, kw, rate, period = drive
    y = np.zeros(7)
    y[6] = (c[5] * np.sin(c[8]) + c[6]) / c[0]
    y[2] = -y[6] * c[0] / c[3] - np.sign(y[6]) * c[4]
    y[4] = y[2]
    integral, leaky, last_speed, last_position = y[6], 0.0, 0.0, 0.0
    pending, command, past = y[6], y[6], np.full(4, y[6])
    out = np.empty(steps + 1)
    for i in range(steps + 1):
        t = i * step
        out[i] = y[0]
        if not abs(y[1]) < 1e3:
            out[i:] = np.nan
            break
        if i % per_period == 0:
            speed = (y[0] - last_position) / period
            error = -kpos * y[0] - speed
            integral += ki * period * error
            leaky -= period * (speed + rate * leaky)
            wanted = kp * error + integral + kw * leaky - kd * (speed - last_speed) / period
            last_speed, last_position = speed, y[0]
            passed = (
                notch[0] * wanted + notch[1] * past[0] + notch[2] * past[1] - notch[3] * past[2] - notch[4] * past[3]
            )
            past[1], past[0], past[3], past[2] = past[0], wanted, past[2], passed
            command, pending = pending, passed
        k1 = _rates(t, y, command, c)
        k2 = _rates(t + step / 2, y + step / 2 * k1, command, c)
        k3 = _rates(t + step / 2, y + step / 2 * k2, command, c)
        k4 = _rates(t + step, y + step * k3, command, c)
        y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return out
