from dataclasses import replace

import pytest

from replication.records import level_delta_rad
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings
from replication.records import load_clean
from studies.joint_match import NUISANCES, add_nuisances, match_joint

JOINT = identified_joint()


@pytest.mark.parametrize("delta_rad", [1.7e-4, 8e-4, 21e-4])
def test_a_simulated_record_gives_its_backlash_back(delta_rad):
    found = match_joint(simulate_recordings(JOINT, [delta_rad])[0], JOINT)
    assert found["delta_rad"] == pytest.approx(delta_rad, abs=1e-7)


def test_friction_load_and_start_are_found_with_the_backlash():
    truth = {"start_angle": -1.1, "friction": 0.17, "load": 1.2}
    record = simulate_recordings(add_nuisances(JOINT, truth), [9e-4])[0]
    found = match_joint(record, JOINT, tuple(NUISANCES))
    # Started elsewhere, the third turn has settled to 3e-3 rps.
    assert found["delta_rad"] == pytest.approx(9e-4, abs=1e-6)
    for name, value in truth.items():
        assert found[name] == pytest.approx(value, abs=2e-3), name


def test_any_speed_and_sampling_are_matched_at_the_speed_that_was_commanded():
    fast = replace(JOINT, commanded_speed_rps=113.0)
    record = simulate_recordings(fast, [9e-4], sample_s=1e-3)[0]
    assert match_joint(record, fast)["delta_rad"] == pytest.approx(9e-4, abs=2e-7)


@pytest.mark.parametrize("level", [4, 8, 13])
def test_clean_records_that_the_joint_was_not_identified_from_are_matched_to_a_microradian(
    authors_data, level
):
    # The identified joint misses 1 % of their signal.
    assert match_joint(load_clean(level), JOINT)["delta_rad"] == pytest.approx(
        level_delta_rad(level), abs=1.5e-6
    )
