"""The load that the motor's motion drives: its slopes, its gap and the gear's loss."""

import numpy as np
import pytest

from backlash import driven_load, torque, turns
from backlash.driven_load import DELTA, LOSS, UNKNOWNS
from backlash.load_data import LoadData
from replication.records import Recording
from studies.benches import draw_turns

SETTINGS = torque.SETTINGS


@pytest.fixture(scope="module")
def problem():
    """What is compared of a drawn joint, and unknowns near it."""
    log = draw_turns(np.random.default_rng(4), 9e-4, 0.2, 0.1)
    record = Recording(
        log.t, log.v, float(log.v.mean()), log.gear_ratio / float(log.v.mean()), "bench"
    )
    turn = torque.measure_turn(record, log.torque)
    load = LoadData(log.inertia_ratio, log.gravity_per_s2)
    made = torque.state_problem(turn, load, SETTINGS.model_error, 40, SETTINGS.step_s)
    theta = made.mean.copy()
    theta[[DELTA, driven_load.FRICTION, LOSS]] = 0.9, 0.2, 0.1
    return made, theta


@pytest.mark.parametrize("place", range(len(UNKNOWNS)), ids=UNKNOWNS)
def test_slopes_are_those_of_differences(problem, place):
    made, theta = problem
    step = np.zeros(theta.size)
    step[place] = 1e-5
    _, by = driven_load.residuals(theta, made.compared, np.zeros(2), True)
    ends = [
        driven_load.residuals(theta + way * step, made.compared, np.zeros(2), False)[0]
        for way in (1, -1)
    ]
    expected = (ends[0] - ends[1]) / 2e-5
    assert by[:, place] == pytest.approx(expected, abs=2e-3 * np.abs(expected).max() + 1e-6)


def test_teeth_never_pull_and_carry_nothing_inside_the_gap(problem):
    made, theta = problem
    contact, slopes = np.empty(made.compared.angle.size), np.empty((9, made.compared.angle.size))
    assert driven_load.find_periodic_orbit(theta, made.compared, np.zeros(2), contact, slopes)
    inside = np.count_nonzero(contact == 0)
    assert 0 < inside < 0.2 * contact.size
    assert contact.min() < 0 < contact.max()


def test_a_loss_adds_to_the_torque_by_which_the_motor_drives_and_takes_from_that_which_drives_it(
    problem,
):
    made, theta = problem
    contact = np.array([10.0, -10.0] * (made.compared.angle.size // 2))
    plain, lossy = (
        driven_load.predict_torque(
            np.where(np.arange(theta.size) == LOSS, mu, theta),
            made.compared,
            sign * np.abs(contact),
            np.empty((0, 0)),
        ).torque
        for mu, sign in ((0.0, 1.0), (0.1, 1.0))
    )
    rest = driven_load.predict_torque(theta, made.compared, 0 * contact, np.empty((0, 0))).torque
    assert np.abs(lossy - rest).sum() == pytest.approx(1.1 * np.abs(plain - rest).sum(), rel=1e-2)


def test_a_smooth_loss_has_no_kink_where_the_torque_crosses_zero(problem):
    made, theta = problem
    gains = []
    for near in (1e-4, 2e-4):
        contact = np.full(made.compared.angle.size, 0.0)
        contact[7] = near * made.compared.smoothing
        with_, without = (
            driven_load.predict_torque(
                np.where(np.arange(theta.size) == LOSS, mu, theta),
                made.compared,
                contact,
                np.empty((0, 0)),
            ).torque
            for mu in (0.1, 0.0)
        )
        gains.append(np.abs(with_ - without).max())
    assert gains[1] == pytest.approx(4 * gains[0], rel=0.1)  # quadratic at zero: no kink


def test_harmonics_of_a_turn_are_exact_and_their_noise_is_that_beside_them():
    t = 1e-3 * np.arange(12000)
    rng = np.random.default_rng(2)
    record = Recording(t, np.ones(t.size), 100.0, 0.7531, "made")
    signal = 3 * np.cos(turns.TURN * 5 * t / 0.7531) + 0.1 * rng.standard_normal(t.size)
    found = turns.harmonics(record, signal, 100.0)
    assert 2 * abs(found.coefficient[4]) == pytest.approx(3, rel=2e-3)
    # White noise of SD s in n samples: s / sqrt(2 n) in each part.
    assert np.median(found.sd) == pytest.approx(0.1 / np.sqrt(2 * 11250), rel=0.15)
