"""Logs of the joints of `strokes` that turn one way, with speed and torque."""

import math

import numpy as np
from numpy.random import Generator

from replication.arrays import FloatArray
from replication.simulator.parameters import TURN
from studies.odd_joints import draw_log_uniform
from studies.strokes import CONTROL_S, BenchLog, DrivenJoint, Fault, draw_joint, log_of, run_from

_TURNS = 12
_TURNS_BEFORE = 2
_NO_FAULT = Fault()
_LARGEST = 0.1  # of the speed, that a tuned joint strays from it by


def _turn(joint: DrivenJoint, fault: Fault) -> FloatArray:
    """Measured speed and torque of turns one way from rest, the first ones left out."""
    start_rad = joint.vertical_rad
    turn_s = TURN / joint.speed
    hanging = joint.gravity * math.sin(start_rad)
    motor_rad = start_rad + hanging / joint.stiffness + math.copysign(joint.delta_rad, hanging)
    periods = np.arange(round((_TURNS + _TURNS_BEFORE) * turn_s / CONTROL_S))
    speed = joint.speed * np.minimum(periods * CONTROL_S * (joint.speed / TURN), 1.0)
    wanted = np.cumsum([motor_rad, *speed[:-1] * CONTROL_S])
    path = np.column_stack([wanted, speed])
    seen = run_from(joint._replace(vertical_rad=0.0), fault, path, start_rad, hanging)
    return seen[round(_TURNS_BEFORE * turn_s / CONTROL_S) :]


def draw_turns(
    rng: Generator, delta_rad: float, friction: float = 0.03, fault: Fault = _NO_FAULT, gear_loss: float = 0.0
) -> BenchLog:
    """Draw a log of twelve turns with noise; a joint that its drive does not keep at its speed is drawn again."""
    while True:
        speed = TURN / draw_log_uniform(rng, 0.5, 2.5)
        gear_ratio = float(rng.choice([50, 80, 100, 101, 121, 160]))
        joint = draw_joint(rng, delta_rad, speed, gear_ratio, friction, gear_loss)
        seen = _turn(joint, fault)
        if np.abs(seen[:, 0] / joint.speed - 1).max() < _LARGEST:
            break
    every = int(rng.choice([2, 4, 6]))
    late = round(fault.late_torque_s / CONTROL_S)
    v = seen[late::every, 0]
    torque = seen[: len(seen) - late : every, 1]
    v_noise = rng.uniform(0, 0.002) * joint.speed
    torque_noise = rng.uniform(0.002, 0.01) * joint.gravity
    v = v + v_noise * rng.standard_normal(v.size)
    torque = torque + torque_noise * rng.standard_normal(torque.size)
    count = joint.gravity * 4 / 2.0 ** rng.integers(11, 15)
    return log_of(joint, gear_ratio, every * CONTROL_S, v, count * np.rint(torque / count))
