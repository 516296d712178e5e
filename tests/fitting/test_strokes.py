"""The backlash of a joint that makes strokes to and fro, by the motor's torque."""

import math

import numpy as np
import pytest

from backlash.fitting.strokes import fit_strokes
from backlash.fitting.torque import LoadData
from replication.arrays import FloatArray

SAMPLE_S = 1e-3
GEAR_RATIO = 100.0
RATIO, GRAVITY, STIFFNESS, DAMPING = 2.0, 30.0, 2e4, 10.0
GIVEN = LoadData(1.1 * RATIO, 0.97 * GRAVITY)


def log_strokes(delta: float) -> tuple[FloatArray, FloatArray]:
    """Motor speed, and torque over J_m, of strokes of 1.2 s under a PI drive, with noise of 0.1 and 0.5 %."""
    h = 2.5e-4
    motor_angle = load_angle = -0.8
    load_angle += delta + GRAVITY * math.sin(0.8) / STIFFNESS
    motor = load = 0.0
    integral = -RATIO * GRAVITY * math.sin(0.8)
    rows = []
    for i in range(38400):
        error = 1.5 * min(max(8 * math.sin(2 * math.pi * i * h / 2.4), -1), 1) - motor
        integral += 6e3 * error * h
        torque = 240 * error + integral
        wind_up = motor_angle - load_angle
        bend = wind_up - min(max(wind_up, -delta), delta)
        contact = STIFFNESS * bend + DAMPING * (motor - load) if bend else 0.0
        motor += h * (torque - RATIO * contact)
        load += h * (contact - GRAVITY * math.sin(load_angle) - 0.6 * math.tanh(50 * load))
        motor_angle += h * motor
        load_angle += h * load
        rows.append((motor, torque))
    noise = np.random.default_rng(1).standard_normal((9600, 2)) * (1.5e-3, 0.3)
    speed, torque = GEAR_RATIO * (np.array(rows[::4]) + noise).T
    return speed, torque


@pytest.mark.parametrize("delta", [3e-4, 1e-3])
def test_strokes_tell_the_backlash(delta):
    found = fit_strokes(*log_strokes(delta), SAMPLE_S, GEAR_RATIO, GIVEN)
    assert not found.refusal_reason
    assert found.interval_rad[0] < delta < found.interval_rad[1]


def test_strokes_of_a_healthy_joint_are_no_answer():
    found = fit_strokes(*log_strokes(0.0), SAMPLE_S, GEAR_RATIO, GIVEN)
    assert "SD" in found.refusal_reason
    assert found.interval_rad[0] == 0


def test_few_strokes_and_a_torque_of_the_wrong_sign_are_refused():
    speed, torque = log_strokes(1e-3)
    with pytest.raises(ValueError, match="6 or more"):
        fit_strokes(speed[:4800], torque[:4800], SAMPLE_S, GEAR_RATIO, GIVEN)
    with pytest.raises(ValueError, match="sign"):
        fit_strokes(speed, -torque, SAMPLE_S, GEAR_RATIO, GIVEN)
