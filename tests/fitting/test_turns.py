"""A settled turn and its slopes."""

from dataclasses import replace

import numpy as np
import pytest

from backlash.fitting.harmonics import turn_harmonics
from backlash.fitting.joint_posterior import NAMES, SIZE, Problem
from backlash.fitting.turns import COLUMNS, SETTLING_S, Movement, simulate_turns
from replication.simulator.parameters import identified_joint
from replication.simulator.simulate import simulate
from tests.logs import noisy, silent

MOVEMENT = Movement(40.0, 0.4)


def row(delta_rad: float, **others: float) -> np.ndarray:
    values = identified_joint().ratios | {"delta_rad": delta_rad} | others
    return np.array([values.get(name, 0.0) for name in COLUMNS])


def test_a_joint_that_runs_away_has_no_turn():
    wild = row(1e-3, friction=0.01)
    wild[COLUMNS.index("integral_gain_per_s2")] *= 1e3
    assert np.isnan(simulate_turns(wild[None], MOVEMENT)).all()


@pytest.mark.parametrize("delta_rad", [3e-4, 2e-3])
def test_a_settled_turn_is_that_of_the_simulated_joint(delta_rad):
    joint = replace(identified_joint(), start_angle_rad=0.0, lead_s=0.8, speed_by_differencing=True)
    run = simulate(joint, delta_rad, duration_s=0.4, sample_s=5e-4, step_s=5e-5)
    turn = simulate_turns(row(delta_rad)[None], MOVEMENT)[0]
    assert np.abs(turn - (run.motor_speed_rps[:-1] - 100)).max() < 2e-3


def test_a_weakly_damped_joint_is_simulated_until_it_rings_no_more():
    z = np.zeros((1, SIZE))
    z[0, 0], z[0, NAMES.index("speed_gain_per_s")] = 10.0, np.log(0.7)
    problem = Problem(turn_harmonics(silent()), MOVEMENT, 2e-3)
    early, last = (problem.turns(z, settling_s) for settling_s in (SETTLING_S, 6.0))
    assert np.abs(problem.turns(z) - last).max() < 0.1 * np.abs(early - last).max()


@pytest.mark.parametrize("differencing", [True, False])
def test_slopes_tell_the_residuals_of_a_joint_beside(differencing):
    problem = Problem(turn_harmonics(noisy()), MOVEMENT, 2e-3)
    problem.differencing = differencing
    z = np.zeros(SIZE)
    z[0], z[2] = 10.0, 0.01
    _, slopes = problem.slopes(z)
    for k, name in enumerate(NAMES):
        step = 1e-3 * np.eye(SIZE)[k]
        moved = (problem.residual(z + step) - problem.residual(z - step)) / 2e-3
        assert np.abs(slopes[k] - moved).max() < 0.1 * np.abs(moved).max(), name
