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
    theta[[driven_load.SOFT, driven_load.FILTER, driven_load.DELAY]] = 0.2, 2.0, 0.5
    return made, theta


@pytest.mark.parametrize("place", range(len(UNKNOWNS)), ids=UNKNOWNS)
def test_slopes_are_those_of_differences(problem, place):
    made, theta = problem

    def left(theta):
        orbit = driven_load.find_orbit(theta, made.compared, np.zeros(2))
        return made.residuals(theta, orbit), made.slopes(theta, orbit)

    step = np.zeros(theta.size)
    step[place] = 1e-5
    expected = (left(theta + step)[0] - left(theta - step)[0]) / 2e-5
    by = left(theta)[1][:, place]
    assert by == pytest.approx(expected, abs=2e-3 * np.abs(expected).max() + 1e-6)


def test_teeth_never_pull_and_carry_nothing_inside_the_gap(problem):
    made, theta = problem
    contact = driven_load.find_orbit(theta, made.compared, np.zeros(2)).contact
    inside = np.count_nonzero(contact == 0)
    assert 0 < inside < 0.2 * contact.size
    assert contact.min() < 0 < contact.max()


def test_half_of_the_spring_begins_where_the_soft_part_ends():
    pressed = [
        driven_load._contact_torque(depth + 1e-3, 0.0, 1e-9, 1e-3, 8e3, 0.0, 4e-4)[0]
        for depth in (2e-4, 4e-4, 6e-4)
    ]
    assert pressed == pytest.approx([0.8, 1.6, 3.2])


def test_a_low_pass_takes_the_fast_harmonics_and_delays_all(problem):
    made, theta = problem
    contact = driven_load.find_orbit(theta, made.compared, np.zeros(2)).contact
    plain, filtered = (
        driven_load.predict_torque(
            np.where(np.arange(theta.size) == driven_load.FILTER, tau, theta),
            made.compared,
            contact,
        )
        for tau in (0.0, 5.0)
    )
    lag = 5e-3 * made.compared.omega
    assert np.abs(filtered / plain) == pytest.approx(1 / np.hypot(1, lag))
    assert np.angle(filtered / plain) == pytest.approx(-np.arctan(lag))


def gain_by_loss(problem, contact, loss=0.1):
    """What a loss adds to the torque's harmonics."""
    made, theta = problem
    lossy, lossless = (
        driven_load.predict_torque(
            np.where(np.arange(theta.size) == LOSS, mu, theta), made.compared, contact
        )
        for mu in (loss, 0.0)
    )
    return lossy - lossless


def test_a_loss_is_a_share_of_the_torque_that_the_gear_carries_whichever_way(problem):
    made, theta = problem
    steps = made.compared.motion.shape[1]
    contact = 10 * np.cos(6 * np.pi * np.arange(steps) / steps)
    size = driven_load.predict_torque(theta, made.compared, np.abs(contact))
    rest = driven_load.predict_torque(theta, made.compared, 0 * contact)
    added = gain_by_loss(problem, contact) - gain_by_loss(problem, 0 * contact)
    assert added == pytest.approx(
        0.1 / 1.1 * (size - rest), rel=0.02, abs=0.02 * np.abs(added).max()
    )


def test_a_smooth_loss_has_no_kink_where_the_torque_crosses_zero(problem):
    made, _ = problem
    gains = []
    for near in (1e-4, 2e-4):
        contact = np.zeros(made.compared.motion.shape[1])
        rest = gain_by_loss(problem, contact)
        contact[7] = near * made.compared.smoothing
        gains.append(np.abs(gain_by_loss(problem, contact) - rest).max())
    assert gains[1] == pytest.approx(4 * gains[0], rel=0.1)  # quadratic at zero


def test_harmonics_of_a_turn_are_exact_and_their_noise_is_that_beside_them():
    t = 1e-3 * np.arange(12000)
    rng = np.random.default_rng(2)
    record = Recording(t, np.ones(t.size), 100.0, 0.7531, "made")
    signal = 3 * np.cos(turns.TURN * 5 * t / 0.7531) + 0.1 * rng.standard_normal(t.size)
    found = turns.harmonics(record, signal, 100.0)
    assert 2 * abs(found.coefficient[4]) == pytest.approx(3, rel=2e-3)
    # White noise of SD s in n samples: s / sqrt(2 n) in each part.
    assert np.median(found.sd) == pytest.approx(0.1 / np.sqrt(2 * 11250), rel=0.15)
