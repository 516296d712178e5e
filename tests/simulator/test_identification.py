import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from replication.simulator.identification import identify_joint, identify_lead
from replication.simulator.parameters import identified_joint, joint_from_ratios, with_ratios
from replication.simulator.recordings import simulate_recordings
from studies.reidentify import joint_text

LEVELS = (5e-4, 17e-4)


@pytest.fixture(scope="module")
def joint():
    return identified_joint()


@pytest.fixture(scope="module")
def recordings(joint):
    return dict(zip(LEVELS, simulate_recordings(joint, LEVELS, turns=4), strict=True))


@pytest.fixture(scope="module")
def fit(joint, recordings):
    moved = {
        "stiffness_per_s2": 1.02,
        "gravity_per_s2": 0.99,
        "speed_gain_per_s": 1.02,
        "inertia_ratio": 0.98,
    }
    return identify_joint(
        recordings, with_ratios(joint, {k: joint.ratios[k] * f for k, f in moved.items()})
    )


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


def test_an_uneven_or_short_recording_is_refused(joint, recordings):
    record = recordings[5e-4]
    uneven = replace(record, t=np.delete(record.t, 7), v=np.delete(record.v, 7))
    with pytest.raises(ValueError, match="evenly"):
        identify_joint({5e-4: uneven}, joint)
    short = replace(record, t=record.t[:300], v=record.v[:300])
    with pytest.raises(ValueError, match="three turns"):
        identify_joint({5e-4: short}, joint)


def test_the_record_of_a_fit_makes_the_same_joint_and_names_its_sources(fit, tmp_path: Path):
    source = tmp_path / "record.xlsx"
    source.write_bytes(b"abc")
    data = json.loads(joint_text(fit, [source], {"numpy": "2"}))
    assert joint_from_ratios(data["ratios"]).ratios == pytest.approx(
        fit.parameters.ratios, rel=1e-6
    )
    assert data["sources"]["record.xlsx"].startswith("ba7816bf")
