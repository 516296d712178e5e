"""A settled turn and its slopes."""

from dataclasses import replace

import numpy as np
import pytest

from backlash.fitting.harmonics import turn_harmonics
from backlash.fitting.joint_posterior import NAMES, SIZE, Problem
from backlash.fitting.turns import COLUMNS, Movement, simulate_turns, turn_and_slopes
from replication.simulator.parameters import identified_joint
from replication.simulator.simulate import simulate
from tests.logs import silent

MOVEMENT = Movement(40.0, 0.4)
SETTLED = 1e-7
STEP = {"delta_rad": 1e-6, "friction": 1e-3}


def row(delta_rad: float, **others: float) -> np.ndarray:
    values = identified_joint().ratios | {"delta_rad": delta_rad} | others
    return np.array([values.get(name, 0.0) for name in COLUMNS])


@pytest.mark.parametrize(("differencing", "delta_rad"), [(True, 1e-3), (True, 4e-4), (False, 2e-3)])
def test_slopes_are_those_of_differences_of_settled_turns(differencing, delta_rad):
    here = row(delta_rad, friction=0.01)
    turn, slopes, _ = turn_and_slopes(here, MOVEMENT, differencing, SETTLED)
    assert turn == pytest.approx(simulate_turns(here[None], MOVEMENT, 8, differencing)[0], abs=2e-5)
    for k, name in enumerate(COLUMNS):
        step = STEP.get(name, 1e-3 * here[k])
        batch = np.repeat(here[None], 2, axis=0)
        batch[:, k] += [step, -step]
        up, down = simulate_turns(batch, MOVEMENT, 8, differencing)
        difference = (up - down) / (2 * step)
        # Where the teeth meet, a step moves the turn's corners by more than its slope tells: the difference errs there.
        assert np.std(slopes[k] - difference) < 0.02 * np.std(difference), name


def test_a_joint_that_runs_away_has_no_turn_and_no_slopes():
    wild = row(1e-3, friction=0.01)
    wild[COLUMNS.index("integral_gain_per_s2")] *= 1e3
    assert np.isnan(simulate_turns(wild[None], MOVEMENT)).all()
    turn = turn_and_slopes(wild, MOVEMENT, True, SETTLED)
    for part in (turn.motor_rps, turn.slopes):
        assert np.isnan(part).all()


@pytest.mark.parametrize("delta_rad", [3e-4, 2e-3])
def test_a_settled_turn_is_that_of_the_simulated_joint(delta_rad):
    joint = replace(identified_joint(), start_angle_rad=0.0, lead_s=0.8, speed_by_differencing=True)
    run = simulate(joint, delta_rad, duration_s=0.4, sample_s=5e-4, step_s=5e-5)
    turn = simulate_turns(row(delta_rad)[None], MOVEMENT)[0]
    assert np.abs(turn - (run.motor_speed_rps[:-1] - 100)).max() < 2e-3


def test_a_weakly_damped_joint_is_simulated_until_it_rings_no_more():
    weak = row(1e-3)[None]
    weak[0, COLUMNS.index("speed_gain_per_s")] *= 0.7
    z = np.zeros(SIZE)
    z[0], z[NAMES.index("speed_gain_per_s")] = 10.0, np.log(0.7)
    problem = Problem(turn_harmonics(silent()), MOVEMENT, 2e-3)
    usual = problem.lead
    problem.slopes(z)
    last = simulate_turns(weak, MOVEMENT, lead=14)[0]
    early, late = (simulate_turns(weak, MOVEMENT, lead=lead)[0] for lead in (usual, problem.lead))
    assert np.abs(late - last).max() < 0.1 * np.abs(early - last).max()
