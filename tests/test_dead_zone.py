import math

import numpy as np
import pytest

from replication.dead_zone import stiffness, transmitted_torque

DELTA = 15e-4


def test_the_stiffness_is_half_at_the_edge_and_whole_far_outside():
    assert stiffness(DELTA, DELTA, 2e4, 1e6) == pytest.approx(1e4, rel=1e-3)
    assert stiffness([-1.0, 1.0], DELTA, 2e4, 1e6) == pytest.approx([2e4, 2e4], rel=1e-6)


@pytest.mark.parametrize("alpha", [1e3, 1e4, 1e5, 1e6])
def test_the_stiffness_leaks_in_the_middle_of_the_gap(alpha):
    leak = stiffness(0.0, DELTA, 1.0, alpha)
    assert leak == pytest.approx(1 - 2 / math.pi * math.atan(alpha * DELTA), rel=1e-9)
    if alpha * DELTA > 10:
        assert leak == pytest.approx(2 / (math.pi * alpha * DELTA), rel=0.01)


def test_the_printed_torque_jumps_at_zero_displacement():
    jump = 2 * 2e4 / (math.pi * 1e6)
    left, right = transmitted_torque([-1e-12, 1e-12], 0.0, DELTA, 2e4)
    assert (left, right) == pytest.approx((jump, -jump), rel=1e-3)


def test_damping_makes_the_printed_torque_pull_on_separation_and_the_clamped_one_not():
    x, parting = DELTA + 1e-5, -1.0
    assert transmitted_torque(x, parting, DELTA, 2e4, 10.0) < 0
    assert transmitted_torque(x, parting, DELTA, 2e4, 10.0, clamped=True) == 0


def test_the_clamped_dead_zone_is_silent_inside_and_a_spring_outside():
    x = np.array([-2, -0.5, 0, 0.5, 2]) * DELTA
    torque = transmitted_torque(x, 0.0, DELTA, 2e4, clamped=True)
    assert torque == pytest.approx(2e4 * DELTA * np.array([-1, 0, 0, 0, 1]))
