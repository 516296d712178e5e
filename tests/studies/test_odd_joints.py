"""Joints under other drives and movements: what is drawn is what is said."""

from dataclasses import replace

import numpy as np
import pytest

from backlash.detection.pattern import find_pattern
from replication.standins import draw_bench
from studies.odd_joints import draw_movement, log_with_torque, move_bench
from tests.cascades import draw_cascade


def test_a_moved_bench_keeps_its_ratios_and_its_friction_over_gravity():
    bench = draw_bench(np.random.default_rng(1))
    before, after = bench.joint, move_bench(bench, 100.0, 2.5).joint
    assert after.turn_period_s == pytest.approx(2.5)
    told = [before.ratios, after.ratios]
    assert {name: told[1][name] for name in told[0] if name != "lead_s"} == pytest.approx(
        {name: value for name, value in told[0].items() if name != "lead_s"}
    )
    rubbing = [
        (
            (
                joint.motor_coulomb_nm
                + joint.motor_viscous_nms_per_rad * joint.commanded_speed_rad_per_s
            )
            * joint.gear_ratio,
            joint.load_viscous_nms_per_rad * joint.commanded_speed_rad_per_s / joint.gear_ratio,
        )
        for joint in (before, after)
    ]
    assert rubbing[1] == pytest.approx(rubbing[0])
    assert after.disturbances[-1].order == pytest.approx(1 / 100)
    assert after.disturbances[0].order == before.disturbances[0].order


def test_the_first_harmonic_of_a_logged_torque_is_gravity():
    rng = np.random.default_rng(2)
    bench = move_bench(draw_bench(rng), *draw_movement(rng))
    log, torque = log_with_torque(bench, 1e-3, rng)
    first = 2 * np.mean(torque * np.exp(-2j * np.pi * log.t / log.turn_period_s))
    assert abs(first) == pytest.approx(
        bench.joint.gravity_torque_nm / bench.joint.gear_ratio, rel=0.05
    )


def test_half_turns_under_a_cascade_share_a_pattern_with_backlash_and_only_then():
    for number in range(3):
        bench = draw_cascade(np.random.default_rng((3, number)))
        bench = replace(
            bench, joint=replace(bench.joint, disturbances=())
        )  # a motor's ripple may be a pattern too
        found = [
            find_pattern(log_with_torque(bench, delta, np.random.default_rng(4))[0]).p_value
            for delta in (0.0, 2e-3)
        ]
        assert found[0] > 0.01
        assert found[1] < 0.01
