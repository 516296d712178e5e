import numpy as np
import pandas as pd
import pytest

from studies import hardware

LOGS = hardware.list_logs()
T = np.arange(0, 40, 0.01)
SPEED = 0.6 * np.tanh(4 * np.sin(T))
STROKES = hardware.JointLog(T, np.cumsum(SPEED) * 0.01, SPEED, np.zeros_like(T))


def test_every_log_is_registered_with_its_commit_hash_and_licence():
    assert (LOGS["commit"] + LOGS["sha256"]).str.fullmatch("[0-9a-f]{104}").all()
    assert LOGS["licence"].notna().all()


@pytest.mark.parametrize("make", LOGS["make"].unique())
def test_a_log_of_each_make_is_read_at_rising_times_in_si_units(make, hardware_logs):
    log = hardware.load_log(LOGS[LOGS["make"] == make].iloc[0])
    assert (np.diff(log.t) > 0).all()
    moved = np.append(0, np.cumsum(log.speed[1:] * np.diff(log.t)))
    assert np.polyfit(moved, log.angle, 1)[0] == pytest.approx(1, abs=0.02)


def test_a_loss_in_the_gear_is_found_beside_friction():
    carried = 20 * np.sin(STROKES.angle - 0.3)
    moving = np.tanh(SPEED / 0.02)
    torque = 3 * (carried + (2 + 0.08 * np.abs(carried)) * moving)
    fitted = hardware.fit_rigid_load(STROKES._replace(torque=torque))
    assert fitted["gravity"] == pytest.approx(60, rel=0.05)
    assert fitted["loss"] == pytest.approx(0.08, abs=0.01)
    assert fitted["left"] < 0.8 * fitted["left_lossless"]


def test_strokes_beside_the_hanging_position_are_refused_for_that():
    row = pd.Series({"inertia_ratio": 2.0, "gravity_per_s2": 20.0, "gear_ratio": 100})
    log = STROKES._replace(torque=20 * np.sin(STROKES.angle))
    told = hardware.answer(log, row)
    assert (told.verdict, told.reason) == ("cannot tell", "no load reversal seen")


def test_lost_motion_is_found_beside_the_wind_up():
    torque = 5 * np.sin(3 * T) + SPEED
    parted = 4e-4 * np.sign(torque) + 1e-4 * torque + 1e-3
    parted += 1e-5 * np.random.default_rng(3).standard_normal(T.size)
    log = STROKES._replace(torque=torque, load_angle=STROKES.angle - parted)
    found = hardware.lost_motion([log, log]).loc["sign of torque"]
    assert found["low_rad"] < 4e-4 < found["high_rad"]
    assert found["high_rad"] - found["low_rad"] < 1e-5
