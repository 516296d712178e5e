"""Joints that the simulated joint is not: what a sensor built on it must refuse, or hold in its interval.

Two loads one behind the other, a second ring, a PI drive with a current loop, and a notch filter in the torque command,
each drawn around a bench of `joints.draw_bench`. Also benches that make another movement, joints under a cascade of
loops that has nothing of the paper's, and logs with the motor's torque.
"""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from backlash.fitting import turns
from replication.arrays import FloatArray
from replication.compiled.cache import njit
from replication.recording import Recording
from replication.simulator import core
from replication.simulator.checks import check_stability, closed_loop_matrix
from replication.simulator.parameters import GRAVITY, TURN, with_ratios
from replication.simulator.simulate import encoder_speed_rps, simulate
from replication.standins.joints import SAMPLE_S, Bench, Spread, draw_bench, encoder_log

KINDS = ("two loads", "second ring", "PI with current loop", "notch filter")

_STEP_S, _TURNS, _MOST_TRIES = 5e-5, 12, 200
_LARGEST_RPS = 10.0  # no joint of this kind runs so far from its commanded speed

# Of other movements: motor turns in a load turn, the load turn [s], and the motor's speed that both give [rps].
_GEAR_RATIOS, _TURNS_S, _SPEEDS_RPS = (30.0, 160.0), (0.4, 3.2), (8.0, 110.0)
# A slower start than this is part of the log of no bench; who tunes a cascade leaves its ring this damping at least.
_LEAST_LEAD_S, _LEAST_DAMPING = 0.8, 0.02


def draw_movement(rng: np.random.Generator) -> tuple[float, float]:
    """Draw a gear ratio and a load turn [s] that a motor can make."""
    while True:
        gear_ratio, turn_s = (float(np.exp(rng.uniform(*np.log(ends)))) for ends in (_GEAR_RATIOS, _TURNS_S))
        if _SPEEDS_RPS[0] <= gear_ratio / turn_s <= _SPEEDS_RPS[1]:
            return gear_ratio, turn_s


def move_bench(bench: Bench, gear_ratio: float, turn_s: float) -> Bench:
    """Give a bench another gear and load turn; its ratios, and all torques over gravity's, stay."""
    joint, per_gear = bench.joint, bench.joint.gear_ratio / gear_ratio
    speed = gear_ratio / turn_s
    disturbances = tuple(
        replace(each, motor_torque_nm=per_gear * each.motor_torque_nm, order=each.order * (per_gear if slow else 1))
        for each in joint.disturbances
        for slow in [abs(each.order * joint.gear_ratio - 1) < 1e-9]
    )
    slower = joint.commanded_speed_rps / speed
    moved = replace(
        with_ratios(replace(joint, gear_ratio=gear_ratio), joint.ratios),
        commanded_speed_rps=speed,
        lead_s=1e-3 * np.ceil(1e3 * max(turn_s, _LEAST_LEAD_S)),
        motor_coulomb_nm=per_gear * joint.motor_coulomb_nm,
        motor_viscous_nms_per_rad=per_gear * slower * joint.motor_viscous_nms_per_rad,
        load_viscous_nms_per_rad=slower / per_gear * joint.load_viscous_nms_per_rad,
        disturbances=disturbances,
    )
    return replace(bench, joint=moved)


def draw_cascade(rng: np.random.Generator) -> Bench:
    """Draw a joint under P position, PI speed and current loops tuned to it, its encoder of 17 to 20 bits."""
    for _ in range(_MOST_TRIES):
        bench = move_bench(draw_bench(rng, Spread(load_friction=0.02)), *draw_movement(rng))
        ring, bandwidth = TURN * np.exp(rng.uniform(*np.log([12.0, 50.0]))), TURN * rng.uniform(15.0, 60.0)
        inertia_ratio = float(np.exp(rng.uniform(*np.log([0.5, 5.0]))))
        gain = bandwidth * (1 + inertia_ratio)
        joint = with_ratios(
            bench.joint,
            bench.joint.ratios | dict.fromkeys(("derivative_gain", "leaky_gain_per_s2", "leaky_rate_per_s"), 0.0) | {
                "stiffness_per_s2": ring**2, "gravity_per_s2": GRAVITY / rng.uniform(0.15, 0.5),
                "inertia_ratio": inertia_ratio, "speed_gain_per_s": gain,
                "integral_gain_per_s2": gain * bandwidth / rng.uniform(4.0, 10.0),
                "position_gain_per_s": bandwidth * rng.uniform(0.03, 0.2), "torque_lag_s": rng.uniform(3e-4, 1e-3),
            },
        )  # fmt: skip
        damping = 2 * rng.uniform(0.01, 0.06) * ring * joint.load_inertia_kgm2
        joint = replace(joint, damping_nms_per_rad=damping, encoder_bits=int(rng.integers(17, 21)))
        with suppress(ValueError):
            check_stability(joint)
            modes = np.log(np.linalg.eigvals(closed_loop_matrix(joint)).astype(complex) + 1e-300)
            ringing = modes[(modes.imag > TURN * 2.0 * joint.control_period_s)]
            if (-ringing.real >= _LEAST_DAMPING * np.abs(ringing)).all():
                return replace(bench, joint=joint)
    raise ValueError(f"cascade: no stable joint in {_MOST_TRIES} draws")


def log_with_torque(
    bench: Bench, delta_rad: float, rng: np.random.Generator, sample_s: float = SAMPLE_S, torque_noise: float = 0.01
) -> tuple[Recording, FloatArray]:
    """Log a bench as `joints.encoder_log` does, with its torque [N m]; the torque's noise is over m g r / N."""
    joint = replace(bench.joint, start_angle_rad=float(rng.uniform(0, TURN)))
    samples = round(_TURNS * joint.turn_period_s / sample_s)
    run = simulate(joint, delta_rad, duration_s=samples * sample_s, sample_s=sample_s)
    speed = encoder_speed_rps(run.motor_position_rad, joint.encoder_bits or 52, sample_s)
    noisy = speed + rng.normal(0.0, bench.noise_rps, speed.size)
    torque_sd = torque_noise * joint.gravity_torque_nm / joint.gear_ratio
    torque = run.motor_torque_nm[:-1] + rng.normal(0.0, torque_sd, speed.size)
    name = f"simulated log with torque, {delta_rad:g} rad"
    return Recording(run.time_s[:-1], noisy, joint.commanded_speed_rps, joint.turn_period_s, name), torque


def draw_odd_log(kind: str, delta_rad: float, rng: np.random.Generator) -> Recording:
    """Log twelve turns of a joint outside the model, as `joints.encoder_log` does; unstable draws are drawn again."""
    for _ in range(_MOST_TRIES):
        bench = draw_bench(rng)
        with suppress(ValueError, ArithmeticError):
            found = _pi_log(bench, delta_rad, rng) if kind == KINDS[2] else _other_log(kind, bench, delta_rad, rng)
            if np.abs(found.v - found.commanded_speed_rps).max() < _LARGEST_RPS:
                return found
    raise ValueError(f"{kind}: no stable joint in {_MOST_TRIES} draws")


def _pi_log(bench: Bench, delta_rad: float, rng: np.random.Generator) -> Recording:
    """PI speed loop without derivative and leaky integral, a position loop around it, a faster current loop."""
    ratios = bench.joint.ratios | {"derivative_gain": 0.0, "leaky_gain_per_s2": 0.0}
    ratios["speed_gain_per_s"] *= rng.uniform(0.3, 0.8)
    ratios["integral_gain_per_s2"] *= rng.uniform(0.05, 0.3)
    ratios["torque_lag_s"] = rng.uniform(0.3e-3, 1e-3)
    return encoder_log(replace(bench, joint=with_ratios(bench.joint, ratios)), delta_rad, rng)


def _other_log(kind: str, bench: Bench, delta_rad: float, rng: np.random.Generator) -> Recording:
    joint = bench.joint
    second, notch = (0.0, 1.0, 0.0), np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    if kind == "two loads":
        second = (rng.uniform(0.2, 0.5), TURN * rng.uniform(8.0, 25.0), rng.uniform(0.02, 0.1))
    elif kind == "second ring":
        second = (rng.uniform(0.05, 0.15), TURN * rng.uniform(30.0, 80.0), rng.uniform(0.005, 0.03))
    else:
        notch = _notch(rng.uniform(40.0, 150.0), rng.uniform(0.5, 2.0), joint.control_period_s)
    row = np.array([joint.ratios.get(name, 0.0) for name in turns.COLUMNS])
    row[0], row[1] = delta_rad, joint.load_coulomb_nm / joint.gravity_torque_nm
    turn_s, angle = joint.turn_period_s, rng.uniform(0, TURN)
    steps, per_period = round((_TURNS + 2) * turn_s / _STEP_S), round(joint.control_period_s / _STEP_S)
    movement = turns.Movement(joint.gear_ratio, turn_s)
    c, drive = turns.constants(row, movement, angle), turns.drive(row, movement, per_period * _STEP_S, True)
    position = _run(c, drive, row[1], second, notch, steps, _STEP_S, per_period)
    if not np.isfinite(position).all():
        raise ArithmeticError("diverged")
    seen = position[round(2 * turn_s / _STEP_S) :: round(SAMPLE_S / _STEP_S)]
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


@njit
def _rates(t, y, command, c, friction, second):
    """Rates of motor, load, second load and torque; the load's whole inertia is 1."""
    share, frequency, damping = second
    x = y[0] / c.gear_ratio - y[2]
    tau = c.ks * (x - c.delta) if x > c.delta else (c.ks * (x + c.delta) if x < -c.delta else 0.0)
    turn = c.start_angle + c.omega / c.gear_ratio * t
    inner = share * frequency * (frequency * (y[2] - y[4]) + 2 * damping * (y[3] - y[5]))
    first = (tau - friction - inner - (1 - share) * c.gravity * np.sin(turn + y[2])) / (1 - share)
    far = inner / max(share, 1e-9) - c.gravity * np.sin(turn + y[4]) if share > 0 else 0.0
    motor = (y[6] - tau / c.gear_ratio) / c.motor_inertia
    return np.array([y[1], motor, y[3], first, y[5], far, (command - y[6]) / c.torque_lag])


@njit(nogil=True)
def _run(c, drive, friction_share, second, notch, steps, step, per_period):
    """Motor position as deviation from the commanded motion, a row a step."""
    friction = c.gravity * friction_share
    torque = (c.gravity * np.sin(c.start_angle) + friction) / c.gear_ratio
    twist = -torque * c.gear_ratio / c.ks - np.sign(torque) * c.delta
    y = np.array([0.0, 0.0, twist, 0.0, twist, 0.0, torque])
    memory, now = np.array([y[6], 0.0, 0.0, 0.0]), np.empty(1)
    pending, command, past = y[6], y[6], np.full(4, y[6])
    out = np.empty(steps + 1)
    for i in range(steps + 1):
        t = i * step
        out[i] = y[0]
        if not abs(y[1]) < 1e3:
            out[i:] = np.nan
            break
        if i % per_period == 0:
            wanted = core.control(t, (y[0], y[1], y[2], y[3], y[6]), memory, now, i // per_period, drive, c)
            b0, b1, b2, a1, a2 = notch
            passed = b0 * wanted + b1 * past[0] + b2 * past[1] - a1 * past[2] - a2 * past[3]
            past[1], past[0], past[3], past[2] = past[0], wanted, past[2], passed
            command, pending = pending, passed
        k1 = _rates(t, y, command, c, friction, second)
        k2 = _rates(t + step / 2, y + step / 2 * k1, command, c, friction, second)
        k3 = _rates(t + step / 2, y + step / 2 * k2, command, c, friction, second)
        k4 = _rates(t + step, y + step * k3, command, c, friction, second)
        y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return out
