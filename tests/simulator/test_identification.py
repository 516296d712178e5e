import json
from pathlib import Path

import numpy as np
import pytest

from replication.simulator.identification import (
    VALIDATION_COLUMNS,
    identify_joint,
    identify_lead,
    joint_record,
    profile_ratio,
    validation_table,
)
from replication.simulator.simulate import identified_joint, joint_from_ratios, simulate, with_ratios

LEVELS = (5e-4, 17e-4)


@pytest.fixture(scope="module")
def joint():
    return identified_joint()


@pytest.fixture(scope="module")
def recordings(joint):
    runs = {delta: simulate(joint, delta, duration_s=1.6, step_s=5e-5) for delta in LEVELS}
    return {delta: (run.time_s, run.motor_speed_rps) for delta, run in runs.items()}


@pytest.fixture(scope="module")
def fit(joint, recordings):
    moved = {
        "stiffness_per_s2": 1.02,
        "gravity_per_s2": 0.99,
        "speed_gain_per_s": 1.02,
        "inertia_ratio": 0.98,
    }
    return identify_joint(recordings, with_ratios(joint, {k: joint.ratios[k] * f for k, f in moved.items()}))


def test_the_ratios_of_a_simulated_joint_are_found_again(joint, fit):
    assert fit.parameters.ratios == pytest.approx(joint.ratios, rel=1e-3)
    assert fit.mean_square < 1e-9


def test_every_free_ratio_has_an_interval_around_its_estimate(joint, fit):
    assert set(fit.confidence) == set(joint.ratios) - {"lead_s"}
    for name, (low, high) in fit.confidence.items():
        assert low < fit.parameters.ratios[name] < high
    assert np.diag(fit.correlation) == pytest.approx(np.ones(len(fit.confidence)))


def test_the_lead_is_found_from_the_first_turn(joint, recordings):
    assert identify_lead(recordings, joint, [0.03, joint.lead_s, 0.06]) == joint.lead_s


def test_a_profile_rises_away_from_the_best_value(joint, recordings):
    profile = profile_ratio("inertia_ratio", (0.9, 1.0), recordings, joint)
    assert profile.nrmse[0] > 10 * profile.nrmse[1]


def test_the_validation_table_compares_what_it_is_given_and_leaves_the_rest_open(joint, recordings):
    names = {3e-4: "small", 5e-4: "fitted", 17e-4: "other"}
    table = validation_table(joint, recordings, names, used_in_fit=[5e-4], printed_a_rps={17e-4: 1.0})
    assert list(table.columns) == VALIDATION_COLUMNS
    assert list(table.used_in_fit) == [False, True, False]
    assert table.nrmse.isna().tolist() == [True, False, False]
    assert table.nrmse.max() < 1e-6
    assert table.peak_error_percent[2] == pytest.approx(100 * (table.peak_rps[2] - 1))
    assert table.peak_error_percent[:2].isna().all()


def test_an_uneven_or_short_recording_is_refused(joint, recordings):
    time, speed = recordings[5e-4]
    with pytest.raises(ValueError, match="evenly"):
        identify_joint({5e-4: (np.delete(time, 7), np.delete(speed, 7))}, joint)
    with pytest.raises(ValueError, match="three turns"):
        identify_joint({5e-4: (time[:300], speed[:300])}, joint)


def test_the_record_of_a_fit_makes_the_same_joint_and_names_its_sources(fit, tmp_path: Path):
    source = tmp_path / "record.xlsx"
    source.write_bytes(b"abc")
    data = json.loads(joint_record(fit, [source], {"numpy": "2"}))
    assert joint_from_ratios(data["ratios"]).ratios == pytest.approx(fit.parameters.ratios, rel=1e-6)
    assert data["sources"]["record.xlsx"].startswith("ba7816bf")
