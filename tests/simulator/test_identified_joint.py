from dataclasses import replace

import numpy as np
import pytest

from replication import table2
from replication.records import CLEAN_LEVELS, TURN_PERIOD_S, level_delta_rad
from replication.simulator.parameters import (
    changeable,
    changed_joint,
    identified_joint,
    with_ratios,
)
from replication.simulator.recordings import simulate_recordings
from replication.records import load_clean_records
from tests.reference import simulate_amplitudes

# The first turn is not fitted but for when the joint started, to a period of the drive.
FIRST_TURN_BAR = 0.085


@pytest.fixture(scope="module")
def joint():
    return identified_joint()


def test_a_simulated_record_has_the_time_stamps_of_the_authors(joint, record_12):
    (simulated,) = simulate_recordings(joint, [level_delta_rad(12)])
    assert simulated.t.size == record_12.t.size
    np.testing.assert_allclose(simulated.t, record_12.t, rtol=0, atol=1e-9)


def first_turn_nrmse(joint, records):
    """Misfit to the first turns over their SD: the start-up transient tells when the joint started."""
    misfits = []
    for record, simulated in zip(
        records.values(), simulate_recordings(joint, list(records)), strict=True
    ):
        v = record.v[record.t < record.turn_period_s - 1e-9]
        misfits.append(np.sqrt(np.mean((v - simulated.v[: v.size]) ** 2)) / v.std())
    return np.array(misfits)


@pytest.fixture(scope="module")
def records(authors_data):
    return load_clean_records(CLEAN_LEVELS)


def test_the_first_turn_of_the_simulated_joint_is_that_of_the_records(joint, records):
    assert first_turn_nrmse(joint, records).max() < FIRST_TURN_BAR
    later = with_ratios(joint, {"lead_s": joint.lead_s + joint.control_period_s})
    assert first_turn_nrmse(later, records).max() > FIRST_TURN_BAR


def test_the_simulated_joint_repeats_every_record_and_every_printed_peak(joint, records):
    for record, simulated in zip(
        records.values(), simulate_recordings(joint, list(records)), strict=True
    ):
        settled = record.t >= TURN_PERIOD_S - 1e-9
        assert simulated.v.size == record.v.size
        assert (
            np.sqrt(np.mean((simulated.v - record.v)[settled] ** 2))
            < 0.03 * record.v[settled].std()
        )
    printed = list(table2.theoretical_amplitudes().values())
    np.testing.assert_allclose(simulate_amplitudes(joint), printed, rtol=0.01)


def test_a_changed_ratio_keeps_the_other_ratios(joint):
    changed = changed_joint(joint, {"inertia_ratio": 0.5})
    expected = joint.ratios | {"inertia_ratio": 0.5 * joint.ratios["inertia_ratio"]}
    assert changed.ratios == pytest.approx(expected)
    assert changed.speed_gain_nms_per_rad == pytest.approx(2 * joint.speed_gain_nms_per_rad)


def test_a_changed_quantity_leaves_all_others_alone(joint):
    changed = changed_joint(joint, {"motor_inertia_kgm2": 2.0, "gear_ratio": 1.25})
    assert changed == replace(
        joint, motor_inertia_kgm2=2 * joint.motor_inertia_kgm2, gear_ratio=50.0
    )
    assert changed_joint(joint, {}) == joint


def test_what_cannot_be_changed_is_refused_with_what_can(joint):
    assert {"inertia_ratio", "motor_inertia_kgm2", "commanded_speed_rps"} < set(changeable(joint))
    for name in ("speed", "load_coulomb_nm"):  # a factor of nothing changes nothing
        with pytest.raises(
            ValueError, match=f"cannot change {name}; there are .*motor_inertia_kgm2"
        ):
            changed_joint(joint, {name: 2.0})
