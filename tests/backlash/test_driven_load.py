"""The load that the motor's motion drives: its slopes, its gap and the gear's loss."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

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


def test_a_gap_that_is_held_stays_while_all_else_moves(problem):
    made, theta = problem
    held = torque.hold_delta(made, made.place(theta), 0.8).theta
    assert held[DELTA] == 0.8
    assert (np.delete(held, DELTA) != np.delete(theta, DELTA)).all()


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


# ------------------------------------------------------------------ by hand, and by SciPy


def a_comparison(step_s=1e-4, **others):
    """Three harmonics of which two are compared, of a turn of 0.5 s."""
    order = np.arange(1, 4)
    omega = turns.TURN / 0.5 * order
    speed = turns.Harmonics(order, omega, np.array([0.03 + 0.01j, 0.005j, 0.002]), np.full(3, 1e-3))
    force = turns.Harmonics(order, omega, np.array([2 - 1j, 0.5, 0.1j]), np.array([0.1, 0.2, 0.3]))
    given = {"model_error": 0.05, "smoothing": 0.01} | others
    return driven_load.compare(speed, force, np.array([1, 0, 1], bool), step_s=step_s, **given)


def some_unknowns(**others):
    values = {
        **{"delta_mrad": 1.5, "ln_stiffness": np.log(2e4), "ln_damping": np.log(0.03)},
        **{"friction": 0.1, "phase_rad": 0.4, "ln_gravity": np.log(30.0), "lag_ms": 0.8},
        **{"ln_inertia_ratio": np.log(2.0), "ln_drive": np.log(0.5), "delay_ms": 0.6, "loss": 0.1},
        **{"soft_mrad": 0.2, "filter_ms": 2.0},
    }
    return np.array([(values | others)[name] for name in UNKNOWNS])


def test_the_motion_is_that_of_the_speeds_harmonics_in_the_middle_of_each_step():
    made = a_comparison()
    steps = made.motion.shape[1]
    assert steps * made.step_s == pytest.approx(0.5, rel=1e-12)
    assert 0.97e-4 < made.step_s <= 1e-4
    assert a_comparison(0.1).motion.shape[1] >= 8
    t = (np.arange(steps) + 0.5) * made.step_s
    rates = [
        2 * sum((c * (1j * w) ** k * np.exp(1j * w * t)).real for c, w in lines)
        for lines in [
            list(zip([0.03 + 0.01j, 0.005j, 0.002], 4 * np.pi * np.arange(1, 4), strict=True))
        ]
        for k in (-1, 0, 1, 2)
    ]
    expected = [turns.TURN * t / 0.5 + rates[0], 1e-3 * rates[1], rates[2], 1e-3 * rates[3]]
    np.testing.assert_allclose(made.motion, expected, rtol=1e-9, atol=1e-9)
    power = np.array([0.25, 0.01])  # beyond the first, the mean over seven with the ends mirrored
    mean = [5.0, (4 * power[0] + 3 * power[1]) / 7]
    np.testing.assert_allclose(made.model_error, 0.05 * np.sqrt(np.array(mean) / 2), rtol=1e-9)


def test_torque_and_sd_are_those_of_the_harmonics_by_hand():
    made, theta = a_comparison(), some_unknowns(loss=0.0)
    t = (np.arange(made.motion.shape[1]) + 0.5) * made.step_s
    contact = 2 * (0.7 * np.exp(4j * np.pi * t) + 0.2j * np.exp(12j * np.pi * t)).real
    w, late = made.omega, np.exp(-6e-4j * made.omega) / (1 + 2e-3j * made.omega)
    inertial = 1j * w * (1 + 8e-4j * w) * np.array([0.03 + 0.01j, 0.002])
    expected = 0.5 * late * (inertial + 2 * np.array([0.7, 0.2j]))
    torque = driven_load.predict_torque(theta, made, contact)
    np.testing.assert_allclose(torque, expected, rtol=1e-9)
    spring = 2e4 + 2j * 0.03 * np.sqrt(2e4) * w
    by_speed = (
        0.5
        * np.abs(late)
        * w
        * np.abs(1 + 8e-4j * w)
        * np.abs(1 + 2 * spring / (spring - w**2))
        * 1e-3
    )
    sd = np.sqrt(by_speed**2 + np.array([0.1, 0.3]) ** 2 + made.model_error**2)
    np.testing.assert_allclose(driven_load.torque_sd(theta, made), sd, rtol=1e-9)
    orbit = driven_load.Orbit(np.zeros(2), contact, np.zeros(0))
    left = (expected - np.array([2 - 1j, 0.1j])) / sd
    np.testing.assert_allclose(
        driven_load.residuals(theta, made, orbit), np.ravel([left.real, left.imag], "F"), rtol=1e-9
    )


def test_the_orbit_is_the_one_that_scipy_integrates():
    made, theta = a_comparison(1e-4), some_unknowns()
    orbit = driven_load.find_orbit(theta, made, np.zeros(2))
    h, steps = made.step_s, made.motion.shape[1]
    angle, angle_by_lag, acceleration, acceleration_by_lag = made.motion
    q = angle + 0.8 * angle_by_lag + 0.4

    def contact(x, v):
        depth = max(abs(x) - 1.5e-3, 0)
        wound_up = 0.5 * depth + 0.5 * max(depth - 2e-4, 0)  # half as stiff over the first 0.2 mrad
        c = (2e4 * wound_up + 2 * 0.03 * np.sqrt(2e4) * v * np.sign(x)) * (depth > 0)
        return np.sign(x) * max(c, 0)

    def rates(t, y):
        i = min(int(t / h), steps - 1)
        force = acceleration[i] + 0.8 * acceleration_by_lag[i] + 30 * (np.sin(q[i]) + 0.1)
        return y[1], force - 30 * np.cos(q[i]) * y[0] - contact(*y)

    found = solve_ivp(rates, (0, 0.5), orbit.start, t_eval=(np.arange(steps) + 0.5) * h, max_step=h)
    expected = [contact(*y) for y in found.y.T]
    size = np.abs(expected).max()
    assert np.count_nonzero(orbit.contact == 0) > 0
    assert np.sqrt(np.mean((orbit.contact - expected) ** 2)) < 0.01 * size
    assert found.y[0, -1] == pytest.approx(orbit.start[0], abs=5e-5)
