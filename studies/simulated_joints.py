"""Logs of joints that turn, or move to and fro, under gravity, drawn apart from the sensor's model of them.

Both sides rub by Coulomb, viscous and Stribeck friction, the gear loses a share of the torque that it carries,
contacts damp, the motor cogs, the drive is a P-PI cascade with a current loop on a quantised encoder, whose torque
comes a period late. What a joint may have besides is a `Fault`.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from pandas import Series

from replication.compilation import njit
from replication.signature import FloatArray

TURN = 2 * math.pi
GRAVITY_MS2 = 9.81
_STEP_S = 2e-5
CONTROL_S = 5e-4
_RUBBING_FROM = 2e-3  # rad/s of the load, at which friction is at three quarters
_STRIBECK_RAD_PER_S = 0.3  # of the load, at which a third of what friction at rest has more is left
_TURNS = 12
_TURNS_BEFORE = 2
_LARGEST = 0.1  # of the speed, that a tuned joint strays from it by
_SETTLING_S = 0.2  # after which a stroke has its speed
_STROKE_RAD_PER_S = (1.0, 2.0)


class Fault(NamedTuple):
    """What the sensor's model of a joint lacks."""

    second_axis: float = 0.0  # share of gravity that another axis adds and takes
    second_axis_turns: float = 0.37  # its movement's periods in a load turn
    transmission_rad: float = 0.0  # amplitude of the gear's error, of the load's angle
    transmission_order: float = 1.0  # its periods in a load turn
    late_torque_s: float = 0.0
    torque_filter_s: float = 1e-9  # time constant of a low-pass of the logged torque
    soft_share: float = 1.0  # of the stiffness that is left within `soft_rad` beyond the gap
    soft_rad: float = 0.0
    drag: float = 0.0  # share of the damping that acts in the gap, too
    held: int = 1  # samples over which each logged value stands
    torque_mean: int = 1  # periods of the control over which the log's torque is a running mean
    speed_mean: int = 1


class DrivenJoint(NamedTuple):
    """A joint and its drive; torques over the load's inertia, angles and speeds those of the load."""

    delta_rad: float
    stiffness: float
    damping: float
    gravity: float
    inertia_ratio: float
    speed: float
    vertical_rad: float  # of the load, from where it hangs, at which turns begin
    gear_loss: float  # share of the contact's torque that rubs in the gear
    load_friction: float
    load_viscous: float
    load_stribeck: float  # share of the Coulomb friction that friction at rest has more
    motor_friction: float
    motor_viscous: float
    motor_stribeck: float
    cogging: float  # six times in a turn of the motor
    gear_ratio: float
    position_gain: float
    speed_gain: float
    integral_gain: float
    current_lag_s: float
    speed_filter_s: float
    resolution_rad: float


class Ranges(NamedTuple):
    """What the turn, the gear and the ring of a joint are drawn from."""

    turns_s: tuple[float, ...] = (0.5, 2.5)  # none: strokes
    gear_ratios: tuple[float, ...] = (50, 80, 100, 101, 121, 160)
    rings_hz: tuple[float, float] = (12.0, 50.0)


ORDINARY = Ranges()
TO_AND_FRO = Ranges(())


class JointLog(NamedTuple):
    """Time [s], motor speed [rps] and torque in an own unit; a joint's gear ratio, J_l / (N^2 J_m) and m g r / J_l."""

    t: FloatArray
    v: FloatArray
    torque: FloatArray
    gear_ratio: float
    inertia_ratio: float
    gravity_per_s2: float
    true: dict[str, float]  # what the sensor tells beside the backlash, under its names


def true_quantities(joint: DrivenJoint, fault: Fault) -> dict[str, float]:
    """Find the joint's quantities as the sensor means them: stiffness up to gravity's torque, friction at its speed."""
    gravity, stiffness = joint.gravity, joint.stiffness
    rate = joint.speed / _STRIBECK_RAD_PER_S
    soft = (1 - fault.soft_share) * fault.soft_rad
    wind_up = min(gravity / (fault.soft_share * stiffness), gravity / stiffness + soft)
    friction = joint.load_friction * (1 + joint.load_stribeck * math.exp(-(rate**2)))
    return {
        "stiffness_per_s2": gravity / wind_up,
        "damping_ratio": joint.damping / (2 * math.sqrt(stiffness)),
        "friction_share": (friction + joint.load_viscous * joint.speed) / gravity,
        "loss": joint.gear_loss,
    }


@njit
def _rubbing(speed, coulomb, viscous, stribeck):
    at_rest = 1 + stribeck * np.exp(-((speed / _STRIBECK_RAD_PER_S) ** 2))
    return coulomb * at_rest * np.tanh(speed / _RUBBING_FROM) + viscous * speed


@njit
def run_joint(joint, fault, path, angle, hanging):
    """Measured speed and torque of each control period of a path, whose rows are the motor's angle and speed.

    The load starts from rest at an angle, held by the torque `hanging`.
    """
    seen = np.empty_like(path)
    turn = joint.speed / TURN
    motor_angle = path[0, 0]
    motor = load = measured = 0.0
    integral = torque = command = pending = logged = hanging
    before = np.floor(motor_angle / joint.resolution_rad)
    for i in range(len(path)):
        count = np.floor(motor_angle / joint.resolution_rad)
        speed = (count - before) * joint.resolution_rad / CONTROL_S
        before = count
        measured += (speed - measured) * (1 - np.exp(-CONTROL_S / joint.speed_filter_s))
        off = path[i, 0] - count * joint.resolution_rad
        error = path[i, 1] + joint.position_gain * off - measured
        integral += joint.integral_gain * error * CONTROL_S
        command = pending
        pending = joint.speed_gain * error + integral
        seen[i, 0] = measured
        logged += (torque - logged) * (1 - np.exp(-CONTROL_S / fault.torque_filter_s))
        seen[i, 1] = logged
        for j in range(round(CONTROL_S / _STEP_S)):
            t = i * CONTROL_S + j * _STEP_S
            torque += (command - torque) * _STEP_S / joint.current_lag_s
            order = fault.transmission_order
            lead = fault.transmission_rad * np.sin(order * motor_angle)
            quick = fault.transmission_rad * order * motor * np.cos(order * motor_angle)
            twist = motor_angle + lead - angle
            bend = twist - min(max(twist, -joint.delta_rad), joint.delta_rad)
            rate = motor + quick - load
            soft = min(abs(bend), fault.soft_rad) * (1 - fault.soft_share) * np.sign(bend)
            damper = joint.damping * rate
            contact = joint.stiffness * (bend - soft) + (1 - fault.drag) * damper if bend else 0.0
            contact = contact if contact * bend > 0 else 0.0  # teeth do not pull
            contact += fault.drag * damper
            other = fault.second_axis * np.sin(TURN * fault.second_axis_turns * turn * t)
            gravity = joint.gravity * (1 + other) * np.sin(angle)
            cogging = joint.cogging * np.sin(6 * joint.gear_ratio * motor_angle)
            rubbing = _rubbing(
                motor, joint.motor_friction, joint.motor_viscous, joint.motor_stribeck
            )
            rubbing += joint.gear_loss * abs(contact) * np.tanh(motor / _RUBBING_FROM)
            motor += _STEP_S * joint.inertia_ratio * (torque - contact - rubbing - cogging)
            rubbing = _rubbing(load, joint.load_friction, joint.load_viscous, joint.load_stribeck)
            load += _STEP_S * (contact - gravity - rubbing)
            motor_angle += _STEP_S * motor
            angle += _STEP_S * load
    return seen


def draw_log_uniform(rng: Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform between limits."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw_joint(
    rng: Generator,
    delta_rad: float,
    speed: float,
    gear_ratio: float,
    friction: float,
    loss: float,
    rings_hz: tuple[float, float] = ORDINARY.rings_hz,
) -> DrivenJoint:
    """Draw a joint whose drive is tuned to it; friction is the load's, over gravity."""
    ring = TURN * draw_log_uniform(rng, *rings_hz)
    gravity = GRAVITY_MS2 / rng.uniform(0.15, 0.5)
    ratio = draw_log_uniform(rng, 0.5, 5.0)
    bandwidth = TURN * rng.uniform(12.0, 45.0)
    gain = bandwidth * (1 + 1 / ratio)
    return DrivenJoint(
        delta_rad=delta_rad,
        stiffness=ring**2,
        damping=2 * rng.uniform(0.01, 0.06) * ring,
        gravity=gravity,
        inertia_ratio=ratio,
        speed=speed,
        vertical_rad=rng.uniform(0.0, TURN),
        gear_loss=loss,
        load_friction=gravity * friction,
        load_viscous=gravity * rng.uniform(0.0, 0.03) / speed,
        load_stribeck=rng.uniform(0.0, 0.5),
        motor_friction=gravity * rng.uniform(0.02, 0.2),
        motor_viscous=gravity * rng.uniform(0.0, 0.1) / speed,
        motor_stribeck=rng.uniform(0.0, 0.5),
        cogging=gravity * rng.uniform(0.0, 0.03),
        gear_ratio=gear_ratio,
        position_gain=bandwidth * rng.uniform(0.05, 0.2),
        speed_gain=gain,
        integral_gain=gain * bandwidth / rng.uniform(4.0, 10.0),
        current_lag_s=rng.uniform(3e-4, 1e-3),
        speed_filter_s=rng.uniform(2e-4, 1.5e-3),
        resolution_rad=TURN / 2.0 ** rng.integers(17, 21) / gear_ratio,
    )


def path_from(start_rad: float, speed: FloatArray) -> FloatArray:
    """Angle and speed in each control period, from an angle."""
    return np.column_stack([np.cumsum([start_rad, *speed[:-1] * CONTROL_S]), speed])


def follow_path(
    joint: DrivenJoint, fault: Fault, start_rad: float, speed: FloatArray
) -> FloatArray:
    """Measured speed and torque of each control period, from rest; the load hangs down at the angle 0."""
    hanging = joint.gravity * math.sin(start_rad)
    motor_rad = start_rad + hanging / joint.stiffness + math.copysign(joint.delta_rad, hanging)
    path = path_from(motor_rad, speed)
    seen: FloatArray = run_joint(joint, fault, path, start_rad, hanging)
    return seen


def run_turns(joint: DrivenJoint, fault: Fault) -> FloatArray:
    """Measured speed and torque of turns one way from rest, the first ones left out."""
    turn_s = TURN / joint.speed
    periods = np.arange(round((_TURNS + _TURNS_BEFORE) * turn_s / CONTROL_S))
    speed = joint.speed * np.minimum(periods * CONTROL_S * (joint.speed / TURN), 1.0)
    seen = follow_path(joint, fault, joint.vertical_rad, speed)
    return seen[round(_TURNS_BEFORE * turn_s / CONTROL_S) :]


def stroke_speeds(
    speed: float, ends_rad: FloatArray, strokes: int = 10, ramp_s: float = 0.3, rest_s: float = 0.3
) -> FloatArray:
    """Speed of each control period of strokes between two ends, from the first one, each with ramps and a rest."""
    ramp = np.arange(0.5, ramp_s / CONTROL_S) * CONTROL_S / ramp_s
    flat = np.ones(round((np.ptp(ends_rad) / speed - ramp_s) / CONTROL_S))
    rest = np.zeros(round(rest_s / CONTROL_S))
    stroke = np.concatenate([ramp, flat, ramp[::-1], rest])
    first = speed * np.sign(ends_rad[1] - ends_rad[0])
    return np.append(rest, np.outer(first * (-1) ** np.arange(strokes), stroke))


def draw_strokes(rng: Generator, speed: float) -> tuple[float, FloatArray]:
    """Draw 8 to 12 strokes through the hanging position: the angle of their start, and speeds of control periods."""
    ends = np.radians([-1, 1] * rng.uniform(60, 90, 2)) * rng.choice([-1, 1])
    ramp_s, rest_s = rng.uniform(0.15, 0.4), rng.uniform(0.1, 0.5)
    return ends[0], stroke_speeds(speed, ends, int(rng.integers(8, 13)), ramp_s, rest_s)


def keeps_speed(joint: DrivenJoint, seen: FloatArray, wanted: FloatArray) -> bool:
    """Whether the joint's drive keeps it at its speed wherever it is to have it."""
    has_speed = Series(np.abs(wanted) == joint.speed)
    is_settled = has_speed.rolling(round(_SETTLING_S / CONTROL_S), min_periods=1).min() > 0
    return bool(np.abs(seen[is_settled, 0] / wanted[is_settled] - 1).max() < _LARGEST)


def running_mean(signal: FloatArray, samples: int) -> FloatArray:
    """The mean of a signal over each sample and those before it."""
    padded = np.pad(signal, (samples - 1, 0), "edge")
    return np.convolve(padded, np.full(samples, 1 / samples), "valid")


def draw_log(
    rng: Generator,
    delta_rad: float,
    friction: float = 0.03,
    loss: float = 0.0,
    fault: Fault = Fault(),  # noqa: B008
    ranges: Ranges = ORDINARY,
) -> JointLog:
    """Draw a log of turns or strokes with noise; a joint that its drive does not keep at its speed is drawn again."""
    while True:
        turn_s = draw_log_uniform(rng, *ranges.turns_s) if ranges.turns_s else None
        gear_ratio = float(rng.choice(ranges.gear_ratios))
        speed = TURN / turn_s if turn_s else rng.uniform(*_STROKE_RAD_PER_S)
        joint = draw_joint(rng, delta_rad, speed, gear_ratio, friction, loss, ranges.rings_hz)
        if turn_s:
            seen = run_turns(joint, fault)
            wanted = np.full(len(seen), speed)
        else:
            start_rad, wanted = draw_strokes(rng, speed)
            seen = follow_path(joint, fault, start_rad, wanted)
        if keeps_speed(joint, seen, wanted):
            return log_joint(rng, joint, fault, seen)


def log_joint(rng: Generator, joint: DrivenJoint, fault: Fault, seen: FloatArray) -> JointLog:
    """A log, with noise and a count of the torque, of what was measured in each control period."""
    every = int(rng.choice([2, 4, 6]))
    late = round(fault.late_torque_s / CONTROL_S)
    v = running_mean(seen[:, 0], fault.speed_mean)[late::every]
    torque = running_mean(seen[:, 1], fault.torque_mean)[: len(seen) - late : every]
    noise = rng.uniform([0, 0.002], [0.002, 0.01]) * (joint.speed, joint.gravity)
    noisy = np.array([v, torque]) + noise[:, None] * rng.standard_normal((2, v.size))
    v, torque = noisy[:, np.arange(v.size) // fault.held * fault.held]
    count = joint.gravity * 4 / 2.0 ** rng.integers(11, 15)
    return JointLog(
        every * CONTROL_S * np.arange(v.size, dtype=float),
        v * joint.gear_ratio / TURN,
        count * np.rint(torque / count),
        joint.gear_ratio,
        joint.inertia_ratio,
        joint.gravity,
        true_quantities(joint, fault),
    )
