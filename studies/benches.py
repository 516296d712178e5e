"""Logs of joints that turn one way under gravity, drawn apart from the sensor's model of them: speed and torque.

Both sides rub by Coulomb, viscous and Stribeck friction, the motor cogs, the drive is a P-PI cascade with a
current loop on a quantised encoder, and the current is quantised, too. What a bench may have besides is a `Fault`.
"""

from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from replication.arrays import FloatArray
from replication.compiling import njit
from replication.simulator.parameters import GRAVITY, TURN
from studies.odd_joints import draw_log_uniform

_STEP_S = 2e-5
_CONTROL_S = 5e-4
_RUBBING_FROM = 2e-3  # rad/s of the load, at which friction is at three quarters
_STRIBECK_RAD_PER_S = 0.3  # of the load, at which a third of what friction at rest has more is left
_TURNS_BEFORE, _TURNS = 2, 12
_LARGEST = 0.1  # of the speed, that a tuned joint strays from it by


class Fault(NamedTuple):
    """What the sensor's model of a joint lacks."""

    second_axis: float = 0.0  # share of gravity that another axis adds and takes
    second_axis_turns: float = 0.37  # its movement's periods in a load turn
    transmission_rad: float = 0.0  # amplitude of the gear's error, of the load's angle
    transmission_order: float = 1.0  # its periods in a load turn
    late_torque_s: float = 0.0


class TurningJoint(NamedTuple):
    """A joint and its drive; torques over the load's inertia, angles and speeds those of the load."""

    delta_rad: float
    stiffness: float
    damping: float
    gravity: float
    inertia_ratio: float
    speed: float
    start_rad: float
    load_friction: float
    load_viscous: float
    load_stribeck: float  # share of the Coulomb friction that friction at rest has more
    motor_friction: float
    motor_viscous: float
    motor_stribeck: float
    cogging: float
    cogging_order: float
    position_gain: float
    speed_gain: float
    integral_gain: float
    current_lag_s: float
    speed_filter_s: float
    resolution_rad: float


class TurnsLog(NamedTuple):
    """Time [s], motor speed [rps] and torque in an own unit; a joint's gear ratio, J_l / (N^2 J_m) and m g r / J_l."""

    t: FloatArray
    v: FloatArray
    torque: FloatArray
    gear_ratio: float
    inertia_ratio: float
    gravity_per_s2: float


@njit(inner=True)
def _rubbing(speed, coulomb, viscous, stribeck):
    at_rest = 1 + stribeck * np.exp(-((speed / _STRIBECK_RAD_PER_S) ** 2))
    return coulomb * at_rest * np.tanh(speed / _RUBBING_FROM) + viscous * speed


@njit(nogil=True)
def _run(joint, fault, seen):
    """Measured speed and torque of each control period of a joint that starts from rest."""
    turn = joint.speed / TURN
    angle = joint.start_rad
    hanging = joint.gravity * np.sin(angle)
    motor_angle = angle + hanging / joint.stiffness + np.sign(hanging) * joint.delta_rad
    wanted = motor_angle
    motor = load = measured = 0.0
    integral = torque = command = pending = hanging
    before = np.floor(motor_angle / joint.resolution_rad)
    for i in range(len(seen)):
        count = np.floor(motor_angle / joint.resolution_rad)
        speed = (count - before) * joint.resolution_rad / _CONTROL_S
        before = count
        measured += (speed - measured) * (1 - np.exp(-_CONTROL_S / joint.speed_filter_s))
        asked = joint.speed * min(i * _CONTROL_S * turn, 1.0)
        error = asked + joint.position_gain * (wanted - count * joint.resolution_rad) - measured
        integral += joint.integral_gain * error * _CONTROL_S
        command = pending
        pending = joint.speed_gain * error + integral
        wanted += asked * _CONTROL_S
        seen[i, 0] = measured
        seen[i, 1] = torque
        for j in range(round(_CONTROL_S / _STEP_S)):
            t = i * _CONTROL_S + j * _STEP_S
            torque += (command - torque) * _STEP_S / joint.current_lag_s
            order = fault.transmission_order
            lead = fault.transmission_rad * np.sin(order * motor_angle)
            quick = fault.transmission_rad * order * motor * np.cos(order * motor_angle)
            twist = motor_angle + lead - angle
            bend = twist - min(max(twist, -joint.delta_rad), joint.delta_rad)
            rate = motor + quick - load
            contact = joint.stiffness * bend + joint.damping * rate if bend else 0.0
            contact = contact if contact * bend > 0 else 0.0  # teeth do not pull
            other = fault.second_axis * np.sin(TURN * fault.second_axis_turns * turn * t)
            gravity = joint.gravity * (1 + other) * np.sin(angle)
            cogging = joint.cogging * np.sin(joint.cogging_order * motor_angle)
            rubbing = _rubbing(
                motor, joint.motor_friction, joint.motor_viscous, joint.motor_stribeck
            )
            motor += _STEP_S * joint.inertia_ratio * (torque - contact - rubbing - cogging)
            rubbing = _rubbing(load, joint.load_friction, joint.load_viscous, joint.load_stribeck)
            load += _STEP_S * (contact - gravity - rubbing)
            motor_angle += _STEP_S * motor
            angle += _STEP_S * load


def _draw_joint(
    rng: Generator, delta_rad: float, friction: float, turn_s: float, gear_ratio: float
) -> TurningJoint:
    """Draw a joint whose drive is tuned to it; the load's friction is a share of gravity."""
    ring = TURN * draw_log_uniform(rng, 12.0, 50.0)
    gravity = GRAVITY / rng.uniform(0.15, 0.5)
    ratio = draw_log_uniform(rng, 0.5, 5.0)
    bandwidth = TURN * rng.uniform(12.0, 45.0)
    gain = bandwidth * (1 + 1 / ratio)
    speed = TURN / turn_s
    return TurningJoint(
        delta_rad=delta_rad,
        stiffness=ring**2,
        damping=2 * rng.uniform(0.01, 0.06) * ring,
        gravity=gravity,
        inertia_ratio=ratio,
        speed=speed,
        start_rad=rng.uniform(0.0, TURN),
        load_friction=gravity * friction,
        load_viscous=gravity * rng.uniform(0.0, 0.03) / speed,
        load_stribeck=rng.uniform(0.0, 0.5),
        motor_friction=gravity * rng.uniform(0.02, 0.2),
        motor_viscous=gravity * rng.uniform(0.0, 0.1) / speed,
        motor_stribeck=rng.uniform(0.0, 0.5),
        cogging=gravity * rng.uniform(0.0, 0.03),
        cogging_order=6 * gear_ratio,
        position_gain=bandwidth * rng.uniform(0.05, 0.2),
        speed_gain=gain,
        integral_gain=gain * bandwidth / rng.uniform(4.0, 10.0),
        current_lag_s=rng.uniform(3e-4, 1e-3),
        speed_filter_s=rng.uniform(2e-4, 1.5e-3),
        resolution_rad=TURN / 2.0 ** rng.integers(17, 21) / gear_ratio,
    )


def draw_turns(
    rng: Generator, delta_rad: float, friction: float = 0.03, fault: Fault | None = None
) -> TurnsLog:
    """Draw a log of twelve turns with noise; a joint that its drive does not keep at its speed is drawn again."""
    fault = fault or Fault()
    while True:
        turn_s = draw_log_uniform(rng, 0.5, 2.5)
        gear_ratio = float(rng.choice([50, 80, 100, 101, 121, 160]))
        joint = _draw_joint(rng, delta_rad, friction, turn_s, gear_ratio)
        seen = np.full((round((_TURNS + _TURNS_BEFORE) * turn_s / _CONTROL_S), 2), np.nan)
        _run(joint, fault, seen)
        seen = seen[round(_TURNS_BEFORE * turn_s / _CONTROL_S) :]
        if np.abs(seen[:, 0] / joint.speed - 1).max() < _LARGEST:
            break
    every = int(rng.choice([2, 4, 6]))
    late = round(fault.late_torque_s / _CONTROL_S)
    speed, torque = seen[late:, 0], seen[: len(seen) - late, 1]
    speed, torque = speed[::every], torque[::every]
    noise = rng.uniform(0, 0.002) * joint.speed, rng.uniform(0.002, 0.01) * joint.gravity
    speed, torque = (
        y + sd * rng.standard_normal(y.size) for y, sd in zip((speed, torque), noise, strict=True)
    )
    counts = joint.gravity * 4 / 2.0 ** rng.integers(11, 15)
    return TurnsLog(
        every * _CONTROL_S * np.arange(speed.size, dtype=float),
        speed * gear_ratio / TURN,
        counts * np.rint(torque / counts),
        gear_ratio,
        joint.inertia_ratio,
        joint.gravity,
    )
