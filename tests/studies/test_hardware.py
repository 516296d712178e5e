import numpy as np
import pandas as pd
import pytest

from replication.records import DataCorrupt, DataUnavailable
from studies import hardware

LOGS = hardware.list_logs()
T = np.arange(0, 40, 0.01) + 2e-4 * np.sin(np.arange(4000))
SPEED = 0.6 * np.tanh(4 * np.sin(T))
STROKES = hardware.JointLog(T, np.cumsum(SPEED) * 0.01, SPEED, np.zeros_like(T))


def test_every_log_is_registered_with_its_commit_hash_and_licence():
    assert LOGS["commit"].str.fullmatch("[0-9a-f]{40}").all()
    assert LOGS["sha256"].str.fullmatch("[0-9a-f]{64}").all()
    assert LOGS["licence"].notna().all()


def test_a_log_that_is_missing_or_was_changed_is_refused(tmp_path, monkeypatch):
    row = LOGS.iloc[0]
    monkeypatch.setenv("HARDWARE_LOGS", str(tmp_path))
    with pytest.raises(DataUnavailable, match="HARDWARE_LOGS"):
        hardware.load_log(row)
    file = tmp_path / row["repository"].replace("/", "+") / row["path"]
    file.parent.mkdir(parents=True)
    file.write_text("0,1\n")
    with pytest.raises(DataCorrupt, match="SHA-256"):
        hardware.load_log(row)


@pytest.mark.parametrize("make", LOGS["make"].unique())
def test_a_log_of_each_make_is_read_at_rising_times_in_si_units(make, hardware_logs):
    log = hardware.load_log(LOGS[LOGS["make"] == make].iloc[0])
    assert (np.diff(log.t) > 0).all()
    moved = np.append(0, np.cumsum(log.speed[1:] * np.diff(log.t)))
    assert np.polyfit(moved, log.angle, 1)[0] == pytest.approx(1, abs=0.02)


def test_a_twin_has_the_load_of_its_log_and_the_noise_that_the_load_leaves():
    row = pd.Series({"inertia_ratio": 2.0, "gravity_per_s2": 20.0})
    gravity = 20 * np.sin(STROKES.angle - 0.3)
    noise = 0.1 * np.random.default_rng(1).standard_normal(T.size)
    log = STROKES._replace(torque=3 * (gravity + 2 * np.tanh(SPEED / 0.02)) + noise)
    twin = hardware.find_twin(log, row)
    assert twin.unit == pytest.approx(3, rel=0.02)
    assert twin.load["vertical_rad"] == pytest.approx(-0.3, abs=0.02)
    assert twin.load["motor_friction"] == pytest.approx(2, rel=0.1)
    simulated = hardware.simulate_twin(log, row, 1e-3, np.random.default_rng(2))
    assert (simulated.t == T).all()
    assert np.corrcoef(simulated.torque, log.torque)[0, 1] > 0.99


def test_a_limit_is_the_least_backlash_that_nine_of_ten_twins_show():
    twins = pd.DataFrame(
        {"log": [*"aaabbb"], "delta_rad": [0, 1e-3, 2e-3] * 2, "draws": 10}
    ).assign(answered=[10, 8, 9, 0, 0, 0])
    found = hardware.detection_limits(twins)
    assert found["limit_rad"].tolist() == pytest.approx([2e-3, np.nan], nan_ok=True)
    assert found.loc["b", "high"] == pytest.approx(1 - 0.025**0.1)


def test_lost_motion_is_found_beside_the_wind_up():
    torque = 5 * np.sin(3 * T) + SPEED
    parted = 4e-4 * np.sign(torque) + 1e-4 * torque + 1e-3
    parted += 1e-5 * np.random.default_rng(3).standard_normal(T.size)
    log = STROKES._replace(torque=torque, load_angle=STROKES.angle - parted)
    found = hardware.lost_motion([log, log]).loc["sign of torque"]
    assert found["low_rad"] < 4e-4 < found["high_rad"]
    assert found["high_rad"] - found["low_rad"] < 1e-5
