"""Joints that the simulated joint is not: what a sensor built on it must refuse, or hold in its interval.

Two loads one behind the other, a second ring, a PI drive with a current loop, and a notch filter in
the torque command, each drawn around a bench of `standins.draw_bench`. Also benches that make
another movement, and logs with the motor's torque.
"""

from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from backlash.fitting import turns
from replication.arrays import FloatArray
from replication.compiling import njit
from replication.records import Recording, add_normal_noise
from replication.simulator import core
from replication.simulator.parameters import TURN, Disturbance, with_ratios
from replication.simulator.recordings import read_encoder
from replication.standins import SAMPLE_S, TURNS, Bench, draw_bench, encoder_log, run_and_log

KINDS = ("two loads", "second ring", "PI with current loop", "notch filter")

_LARGEST_RPS = 10.0  # no joint of this kind runs so far from its commanded speed

# Of a load behind the load: share of the inertia, ring [Hz] and damping ratio.
_SECOND_LOADS = {
    "two loads": ((0.2, 0.5), (8.0, 25.0), (0.02, 0.1)),
    "second ring": ((0.05, 0.15), (30.0, 80.0), (0.005, 0.03)),
}
# Of a joint outside the model: the step, the turns before its log, and its encoder.
_STEP_S = 5e-5
_TURNS_BEFORE = 2
_ENCODER_BITS = 19

# Of other movements: motor turns in a load turn, the load turn [s], and the motor's speed that both give [rps].
_GEAR_RATIOS = (30.0, 160.0)
_TURNS_S = (0.4, 3.2)
_SPEEDS_RPS = (8.0, 110.0)
_LEAST_LEAD_S = 0.8  # a slower start than this is part of the log of no bench


class SecondLoad(NamedTuple):
    """A load behind the load: its share of the inertia, its ring [rad/s] and damping ratio."""

    share: float = 0.0
    omega: float = 1.0
    damping: float = 0.0


class Notch(NamedTuple):
    """Coefficients of a filter of the torque command."""

    b0: float = 1.0
    b1: float = 0.0
    b2: float = 0.0
    a1: float = 0.0
    a2: float = 0.0


def draw_log_uniform(rng: Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform between limits."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw_movement(rng: Generator) -> tuple[float, float]:
    """Draw a gear ratio and a load turn [s] that a motor can make."""
    while True:
        gear_ratio, turn_s = draw_log_uniform(rng, *_GEAR_RATIOS), draw_log_uniform(rng, *_TURNS_S)
        if _SPEEDS_RPS[0] <= gear_ratio / turn_s <= _SPEEDS_RPS[1]:
            return gear_ratio, turn_s


def move_bench(bench: Bench, gear_ratio: float, turn_s: float) -> Bench:
    """Give a bench another gear and load turn; its ratios, and all torques over gravity's, stay."""
    joint = bench.joint
    per_gear = joint.gear_ratio / gear_ratio
    speed = gear_ratio / turn_s
    slower = joint.commanded_speed_rps / speed
    moved = replace(
        with_ratios(replace(joint, gear_ratio=gear_ratio), joint.ratios),
        commanded_speed_rps=speed,
        lead_s=1e-3 * np.ceil(1e3 * max(turn_s, _LEAST_LEAD_S)),
        motor_coulomb_nm=per_gear * joint.motor_coulomb_nm,
        motor_viscous_nms_per_rad=per_gear * slower * joint.motor_viscous_nms_per_rad,
        load_viscous_nms_per_rad=slower / per_gear * joint.load_viscous_nms_per_rad,
        disturbances=tuple(
            _moved_wave(wave, joint.gear_ratio, per_gear) for wave in joint.disturbances
        ),
    )
    return replace(bench, joint=moved)


def _moved_wave(wave: Disturbance, gear_ratio: float, per_gear: float) -> Disturbance:
    """A disturbance behind another gear: that of the load's turn stays with the load's turn."""
    of_load_turn = abs(wave.order * gear_ratio - 1) < 1e-9
    order = wave.order * (per_gear if of_load_turn else 1)
    return replace(wave, motor_torque_nm=per_gear * wave.motor_torque_nm, order=order)


def log_with_torque(
    bench: Bench,
    delta_rad: float,
    rng: Generator,
    sample_s: float = SAMPLE_S,
    torque_noise: float = 0.01,
) -> tuple[Recording, FloatArray]:
    """Log a bench as `standins.run_and_log` does, with its torque [N m], whose noise is over m g r / N."""
    run, log = run_and_log(bench, delta_rad, rng, sample_s)
    sd = torque_noise * bench.joint.gravity_torque_nm / bench.joint.gear_ratio
    return log, run.motor_torque_nm[:-1] + rng.normal(0.0, sd, log.v.size)


def draw_odd_log(kind: str, delta_rad: float, rng: Generator) -> Recording:
    """Log twelve turns of a joint outside the model, as `standins.encoder_log` does; unstable ones are drawn again."""
    while True:
        bench = draw_bench(rng)
        with suppress(ValueError, ArithmeticError):
            if kind == "PI with current loop":
                recording = encoder_log(_with_pi_drive(bench, rng), delta_rad, rng)
            else:
                recording = _other_log(kind, bench, delta_rad, rng)
            if np.abs(recording.v - recording.commanded_speed_rps).max() < _LARGEST_RPS:
                return recording


def _with_pi_drive(bench: Bench, rng: Generator) -> Bench:
    """PI speed loop without derivative and leaky integral, position loop, faster current loop."""
    ratios = bench.joint.ratios | {"derivative_gain": 0.0, "leaky_gain_per_s2": 0.0}
    ratios["speed_gain_per_s"] *= rng.uniform(0.3, 0.8)
    ratios["integral_gain_per_s2"] *= rng.uniform(0.05, 0.3)
    ratios["torque_lag_s"] = rng.uniform(0.3e-3, 1e-3)
    return replace(bench, joint=with_ratios(bench.joint, ratios))


def _other_log(kind: str, bench: Bench, delta_rad: float, rng: Generator) -> Recording:
    joint = bench.joint
    second, notch = SecondLoad(), Notch()
    if kind in _SECOND_LOADS:
        share, frequency_hz, damping = (rng.uniform(*limits) for limits in _SECOND_LOADS[kind])
        second = SecondLoad(share, TURN * frequency_hz, damping)
    else:
        notch = _notch(rng.uniform(40.0, 150.0), rng.uniform(0.5, 2.0), joint.control_period_s)
    values = joint.ratios | {
        "delta_rad": delta_rad,
        "friction": joint.load_coulomb_nm / joint.gravity_torque_nm,
    }
    row = np.array([values.get(name, 0.0) for name in turns.COLUMNS])
    turn_s = joint.turn_period_s
    per_period = round(joint.control_period_s / _STEP_S)
    movement = turns.Movement(joint.gear_ratio, turn_s)
    driven = turns.joint_of(row, movement, rng.uniform(0, TURN), True)
    c = core.constants_of(driven, delta_rad)
    drive = core.drive_of(driven)._replace(period=per_period * _STEP_S)
    position = np.full(round((TURNS + _TURNS_BEFORE) * turn_s / _STEP_S) + 1, np.nan)
    _run(c, drive, values["friction"], second, notch, per_period, position)
    if not np.isfinite(position).all():
        raise ArithmeticError("diverged")
    seen = position[round(_TURNS_BEFORE * turn_s / _STEP_S) :: round(SAMPLE_S / _STEP_S)]
    t = SAMPLE_S * np.arange(seen.size, dtype=float)
    turned = seen + joint.commanded_speed_rad_per_s * t
    log = read_encoder(joint, t, turned, _ENCODER_BITS, f"simulated: {kind}")
    return add_normal_noise(log, bench.noise_rps, rng)


def _notch(frequency_hz: float, quality: float, period_s: float) -> Notch:
    """A notch of -20 dB."""
    w = TURN * frequency_hz * period_s
    alpha, depth = np.sin(w) / (2 * quality), 0.1
    a0 = 1 + alpha
    a1 = -2 * np.cos(w)
    return Notch(
        (1 + depth * alpha) / a0, a1 / a0, (1 - depth * alpha) / a0, a1 / a0, (1 - alpha) / a0
    )


@njit
def _rates(t, y, command, c, friction, second):
    """Rates of motor, load, second load and torque; the load's whole inertia is 1."""
    share, omega, damping = second
    x = y[0] / c.gear_ratio - y[2]
    tau = c.ks * (x - c.delta) if x > c.delta else (c.ks * (x + c.delta) if x < -c.delta else 0.0)
    turn = c.start_angle + c.omega / c.gear_ratio * t
    inner = share * omega * (omega * (y[2] - y[4]) + 2 * damping * (y[3] - y[5]))
    first = (tau - friction - inner - (1 - share) * c.gravity * np.sin(turn + y[2])) / (1 - share)
    far = inner / max(share, 1e-9) - c.gravity * np.sin(turn + y[4]) if share > 0 else 0.0
    motor = (y[6] - tau / c.gear_ratio) / c.motor_inertia
    return np.array([y[1], motor, y[3], first, y[5], far, (command - y[6]) / c.torque_lag])


@njit(nogil=True)
def _run(c, drive, friction_share, second, notch, per_period, position):
    """Fill in the motor's position, less the commanded one, at every step until the joint diverges."""
    step = _STEP_S
    friction = c.gravity * friction_share
    torque = (c.gravity * np.sin(c.start_angle) + friction) / c.gear_ratio
    twist = -torque * c.gear_ratio / c.ks - np.sign(torque) * c.delta
    y = np.array([0.0, 0.0, twist, 0.0, twist, 0.0, torque])
    memory = np.array([torque, 0.0, 0.0, 0.0])
    ring = np.empty(1)
    command = pending = torque
    # Torques that the drive wants, and that the filter passes, the newest first.
    wanted = np.full(3, torque)
    passed = np.full(3, torque)
    for i in range(position.size):
        t = i * step
        if not abs(y[1]) < 1e3:
            break
        position[i] = y[0]
        if i % per_period == 0:
            # Loops compile in a tenth of the time of array expressions.
            for k in (2, 1):
                wanted[k] = wanted[k - 1]
                passed[k] = passed[k - 1]
            wanted[0] = core.control(
                t, (y[0], y[1], y[2], y[3], y[6]), memory, ring, i // per_period, drive, c
            )
            fresh = notch.b0 * wanted[0] + notch.b1 * wanted[1] + notch.b2 * wanted[2]
            passed[0] = fresh - notch.a1 * passed[1] - notch.a2 * passed[2]
            command, pending = pending, passed[0]
        # A Runge-Kutta step.
        slope, total = np.zeros(7), np.zeros(7)
        at = np.empty(7)
        for late, weight in ((0.0, 1.0), (step / 2, 2.0), (step / 2, 2.0), (step, 1.0)):
            for k in range(7):
                at[k] = y[k] + late * slope[k]
            slope = _rates(t + late, at, command, c, friction, second)
            for k in range(7):
                total[k] += weight * slope[k]
        for k in range(7):
            y[k] += step / 6 * total[k]
