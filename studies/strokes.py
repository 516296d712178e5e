"""Logs of joints that make strokes to and fro under loops of position, speed and current, drawn apart from the sensor.

Contacts damp, friction grows steeply from rest, the drive differences its encoder and filters that,
and its torque comes a period late: the sensor's model has none of these.
"""

from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from replication.arrays import FloatArray
from replication.compiling import njit
from replication.simulator.parameters import GRAVITY, TURN
from studies.odd_joints import draw_log_uniform

_STEP_S = 2e-5
CONTROL_S = 5e-4
_SETTLED = 0.02  # of the speed; a joint that moves more after its last stroke is not tuned
_RUBBING_FROM = 2e-3  # rad/s of the load, at which friction is at three quarters


class StrokingJoint(NamedTuple):
    """A joint and its drive; torques over the load's inertia, angles and speeds those of the load."""

    delta_rad: float
    stiffness: float
    damping: float
    gravity: float
    inertia_ratio: float
    vertical_rad: float
    load_friction: float
    load_viscous: float
    motor_friction: float
    motor_viscous: float
    position_gain: float
    speed_gain: float
    integral_gain: float
    current_lag_s: float
    speed_filter_s: float
    resolution_rad: float


class StrokesLog(NamedTuple):
    """Time [s], motor speed [rps] and torque in an own unit; a joint's gear ratio, J_l / (N^2 J_m) and m g r / J_l."""

    t: FloatArray
    v: FloatArray
    torque: FloatArray
    gear_ratio: float
    inertia_ratio: float
    gravity_per_s2: float


@njit(nogil=True)
def run_joint(joint, path, seen):
    """Measured speed and torque at each control period of a path, whose rows are angle and speed."""
    hanging = joint.gravity * np.sin(path[0, 0] + joint.vertical_rad)
    motor_angle = path[0, 0]
    angle = motor_angle - hanging / joint.stiffness - np.sign(hanging) * joint.delta_rad
    motor = load = measured = 0.0
    integral = torque = command = pending = hanging
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
        seen[i, 1] = torque
        for _ in range(round(CONTROL_S / _STEP_S)):
            torque += (command - torque) * _STEP_S / joint.current_lag_s
            twist = motor_angle - angle
            bend = twist - min(max(twist, -joint.delta_rad), joint.delta_rad)
            contact = joint.stiffness * bend + joint.damping * (motor - load) if bend else 0.0
            contact = contact if contact * bend > 0 else 0.0  # teeth do not pull
            rubbing = joint.motor_friction * np.tanh(motor / _RUBBING_FROM)
            rubbing += joint.motor_viscous * motor
            motor += _STEP_S * joint.inertia_ratio * (torque - contact - rubbing)
            rubbing = joint.load_friction * np.tanh(load / _RUBBING_FROM)
            rubbing += joint.load_viscous * load
            gravity = joint.gravity * np.sin(angle + joint.vertical_rad)
            load += _STEP_S * (contact - gravity - rubbing)
            motor_angle += _STEP_S * motor
            angle += _STEP_S * load


def draw_joint(rng: Generator, delta_rad: float, speed: float, gear_ratio: float) -> StrokingJoint:
    """Draw a joint whose drive is tuned to it."""
    ring = TURN * draw_log_uniform(rng, 12.0, 50.0)
    gravity = GRAVITY / rng.uniform(0.15, 0.5)
    ratio = draw_log_uniform(rng, 0.5, 5.0)
    bandwidth = TURN * rng.uniform(12.0, 45.0)
    gain = bandwidth * (1 + 1 / ratio)
    return StrokingJoint(
        delta_rad=delta_rad,
        stiffness=ring**2,
        damping=2 * rng.uniform(0.01, 0.06) * ring,
        gravity=gravity,
        inertia_ratio=ratio,
        vertical_rad=rng.uniform(-0.05, 0.05),
        load_friction=gravity * rng.uniform(0.0, 0.06),
        load_viscous=gravity * rng.uniform(0.0, 0.03) / speed,
        motor_friction=gravity * rng.uniform(0.02, 0.2),
        motor_viscous=gravity * rng.uniform(0.0, 0.1) / speed,
        position_gain=bandwidth * rng.uniform(0.05, 0.2),
        speed_gain=gain,
        integral_gain=gain * bandwidth / rng.uniform(4.0, 10.0),
        current_lag_s=rng.uniform(3e-4, 1e-3),
        speed_filter_s=rng.uniform(2e-4, 1.5e-3),
        resolution_rad=TURN / 2.0 ** rng.integers(17, 21) / gear_ratio,
    )


def _draw_path(rng: Generator, speed: float) -> FloatArray:
    """Draw strokes across the vertical, three to seven each way: angle [rad] and speed [rad/s], a row a period."""
    half, ramp_s = np.deg2rad(rng.uniform(30, 90)), rng.uniform(0.06, 0.3)
    stroke_s = 2 * half / speed + ramp_s
    ends = np.cumsum([0.4, ramp_s, stroke_s - 2 * ramp_s, ramp_s])
    corners = [0.0]
    shape = [0.0]
    for stroke in range(2 * int(rng.integers(3, 8))):
        direction = 1.0 if stroke % 2 == 0 else -1.0
        corners += list(stroke * (stroke_s + 1e-3) + ends)
        shape += [0.0, direction, direction, 0.0]
    t = np.arange(0.0, corners[-1] + 0.3, CONTROL_S)
    moved = speed * np.interp(t, corners, shape)
    start = rng.uniform(-0.1, 0.1) - half
    return np.column_stack([start + np.cumsum(moved) * CONTROL_S, moved])


def draw_strokes(rng: Generator, delta_rad: float) -> StrokesLog:
    """Draw a log of strokes, its speed and torque with noise; a joint that its drive does not settle is drawn again."""
    while True:
        speed, gear_ratio = rng.uniform(0.8, 2.5), float(rng.choice([50, 80, 100, 121, 160]))
        joint, path = draw_joint(rng, delta_rad, speed, gear_ratio), _draw_path(rng, speed)
        seen = np.full(path.shape, np.nan)
        run_joint(joint, path, seen)
        if np.std(seen[-round(0.15 / CONTROL_S) :, 0]) < _SETTLED * speed:
            break
    every = int(rng.choice([2, 4, 8, 10]))
    noise = np.array([rng.uniform(0, 0.003) * speed, rng.uniform(0.002, 0.01) * joint.gravity])
    v, torque = (seen[::every] + noise * rng.standard_normal(seen[::every].shape)).T
    t = every * CONTROL_S * np.arange(v.size)
    v = v * gear_ratio / TURN
    return StrokesLog(t, v, torque, gear_ratio, joint.inertia_ratio, joint.gravity)
