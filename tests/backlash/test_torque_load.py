"""The load that the motor's motion drives: its slopes, its gap and the gear's loss."""

import ast
import importlib
import inspect

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backlash import turns
from backlash.torque import load as driven_load
from backlash.torque.load import (
    DELAY,
    DELTA,
    DRAG,
    FILTER,
    FRICTION,
    LOSS,
    OF_CONTACT,
    SOFT,
    STIFFNESS,
    predict,
)
from backlash.torque.search import descend, evaluate, hold_delta
from backlash.torque.unknowns import FIRST_STEP, NAMES
from tests.backlash.test_torque_answer import draw_plain, state


@pytest.fixture(scope="module")
def problem():
    """What is compared of a drawn joint, and unknowns near it."""
    made = state(draw_plain())
    theta = made.prior.mean.copy()
    theta[[DELTA, FRICTION, LOSS, DRAG]] = 0.9, 0.2, 0.1, 0.3
    theta[[SOFT, FILTER, DELAY]] = 0.2, 2.0, 0.5
    return made, theta


@pytest.fixture(scope="module")
def turn(problem):
    """The only window, unknowns, and what they predict there."""
    made, theta = problem
    [window] = made.compared.windows
    return window, theta, predict(theta, window)


@pytest.mark.parametrize("place", range(len(NAMES)), ids=NAMES)
def test_slopes_are_those_of_differences(turn, place):
    window, theta, here = turn
    step = 1e-5 * (np.arange(theta.size) == place)
    ahead, back = (
        driven_load.torque_residuals(predict(theta + each, window)) for each in (step, -step)
    )
    expected = (ahead - back) / 2e-5
    slopes = driven_load.differentiate(here, window)[0][:, place]
    assert slopes == pytest.approx(expected, abs=1e-4 * np.abs(expected).max() + 1e-6)


def test_the_orbits_start_moves_as_its_slopes_say(turn):
    window, theta, here = turn
    step = 1e-6 * (np.arange(theta.size) < OF_CONTACT)
    ahead, back = (predict(theta + each, window).start for each in (step, -step))
    slopes = driven_load.differentiate(here, window)[1]
    assert (ahead - back) / 2e-6 == pytest.approx(slopes.sum(axis=1), rel=1e-3)


@pytest.mark.parametrize("ln_stiffness", [-1e5, -2e3, 1e4, np.nan])
def test_a_trial_stiffness_beyond_all_numbers_has_no_orbit_and_is_no_defect(problem, ln_stiffness):
    made, theta = problem
    far = np.where(np.arange(theta.size) == STIFFNESS, ln_stiffness, theta)
    with np.errstate(all="ignore"):
        assert evaluate(made, far, np.zeros(2)).predicted is None


def test_a_gap_that_is_held_stays_while_all_else_moves(problem):
    made, theta = problem
    held = hold_delta(made, evaluate(made, theta), 0.8, np.inf).theta
    assert held[DELTA] == 0.8
    assert (np.delete(held, DELTA) != np.delete(theta, DELTA)).all()


def test_a_descent_goes_by_steps_that_no_machine_s_last_bits_change(problem):
    made, theta = problem
    end = descend(made, evaluate(made, theta), 1e-3).theta
    steps = (end - theta) / FIRST_STEP * 2**17
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    assert np.abs(steps).max() > 1e4


@pytest.mark.parametrize(("cosine", "is_stable"), [(25.0, True), (-25.0, False)])
def test_an_orbit_that_no_load_keeps_to_is_no_answer(turn, cosine, is_stable):
    """In a wide gap a load hangs or stands at rest; Newton's method finds both."""
    forcing = np.zeros((3, 1000))
    forcing[1] = cosine
    theta = some_unknowns(delta_mrad=100.0, drag=0.0)
    compared = turn[0]._replace(step_s=1e-3, motion=np.zeros((3, 1000)))
    orbit = driven_load._close_orbit(theta, compared, forcing, 0, np.zeros(2))
    assert (orbit is not None) == is_stable


def test_a_turn_of_an_orbit_ends_where_it_begins_with_its_contact_torques(turn):
    window, theta, here = turn
    # From a start that is off by so much, Newton's last step goes by slopes alone.
    again = predict(theta, window, here.start + np.array([2e-8, -5e-6]))
    assert again.start == pytest.approx(here.start, abs=1e-10)
    assert again.contact == pytest.approx(here.contact, abs=1e-7 * np.abs(here.contact).max())


# ------------------------------------------------------------------ by hand, and by SciPy


def a_comparison(step_s=1e-4):
    """Three harmonics of which two are compared, of a turn of 0.5 s."""
    order = np.arange(1, 4)
    omega = turns.TURN / 0.5 * order
    speed = turns.Harmonics(order, omega, np.array([0.03 + 0.01j, 0.005j, 0.002]), np.full(3, 1e-3))
    force = turns.Harmonics(order, omega, np.array([2 - 1j, 0.5, 0.1j]), np.array([0.1, 0.2, 0.3]))
    accuracy = driven_load.Accuracy(0.05, step_s, 100.0, 80)
    return driven_load.compare(speed, force, np.array([1, 0, 1], bool), accuracy, 0.01)


def some_unknowns(**others):
    values = {
        "delta_mrad": 1.5,
        "ln_stiffness": np.log(2e4),
        "ln_damping": np.log(0.03),
        "friction": 0.1,
        "phase_rad": 0.4,
        "ln_gravity": np.log(30.0),
        "lag_ms": 0.8,
        "ln_inertia_ratio": np.log(2.0),
        "ln_inertia": np.log(0.5),
        "delay_ms": 0.6,
        "loss": 0.1,
        "soft_mrad": 0.2,
        "filter_ms": 2.0,
        "soft_share": 0.6,
        "drag": 0.25,
    }
    return np.array([(values | others)[name] for name in NAMES])


def test_the_motion_is_that_of_the_speeds_harmonics_in_the_middle_of_each_step():
    made = a_comparison()
    steps = made.motion.shape[1]
    assert steps * made.step_s == pytest.approx(0.5, rel=1e-12)
    assert 0.97e-4 < made.step_s <= 1e-4
    assert a_comparison(0.1).motion.shape[1] >= 8
    t = (np.arange(steps) + 0.5) * made.step_s
    harmonics = np.array([[0.03 + 0.01j], [0.005j], [0.002]])
    jw = 4j * np.pi * np.arange(1, 4)[:, None]
    rates = [2 * (harmonics * jw**k * np.exp(jw * t)).real.sum(axis=0) for k in (-1, 0, 1, 2)]
    angle = turns.TURN * t / 0.5 + rates[0]
    np.testing.assert_allclose(made.direction, np.exp(1j * angle), rtol=1e-9, atol=1e-9)
    expected = [1e-3 * rates[1], rates[2], 1e-3 * rates[3]]
    np.testing.assert_allclose(made.motion, expected, rtol=1e-9, atol=1e-9)
    power = np.array([0.25, 0.01])  # beyond the first, the mean over seven with the ends mirrored
    mean = [5.0, (4 * power[0] + 3 * power[1]) / 7]
    own = np.array([0.1, 0.3]) ** 2 + 0.05**2 * np.array(mean) / 2
    np.testing.assert_allclose(made.own_variance, own, rtol=1e-9)


def test_torque_and_sd_are_those_of_the_harmonics_by_hand():
    made, theta = a_comparison(), some_unknowns()
    here = predict(theta, made)
    w, late = made.omega, np.exp(-6e-4j * made.omega) / (1 + 2e-3j * made.omega)
    t = (np.arange(here.contact.size) + 0.5) * made.step_s
    # The loss is a tenth of the torque that the gear carries, whichever way, smoothly where that is zero.
    lost = 0.1 * np.hypot(here.contact, 0.01)
    carried = (here.contact + lost) @ np.exp(-1j * np.outer(t, w)) / t.size
    inertial = 1j * w * (1 + 8e-4j * w) * np.array([0.03 + 0.01j, 0.002])
    expected = 0.5 * late * (inertial + 2 * carried)
    np.testing.assert_allclose(here.torque, expected, rtol=1e-9)
    spring = 2e4 + 2j * 0.03 * np.sqrt(2e4) * w
    by_speed = 1e-3 * 0.5 * late * w * (1 + 8e-4j * w) * (1 + 2 * spring / (spring - w**2))
    sd = np.sqrt(np.abs(by_speed) ** 2 + made.own_variance)
    np.testing.assert_allclose(here.sd, sd, rtol=1e-9)
    residual = (expected - np.array([2 - 1j, 0.1j])) / sd
    both = np.ravel([residual.real, residual.imag], "F")
    np.testing.assert_allclose(driven_load.torque_residuals(here), both, rtol=1e-9)


def test_the_orbit_is_the_one_that_scipy_integrates():
    made, theta = a_comparison(1e-4), some_unknowns()
    orbit = predict(theta, made)
    h, steps = made.step_s, made.motion.shape[1]
    angle_by_lag, acceleration, acceleration_by_lag = made.motion
    q = np.angle(made.direction) + 0.8 * angle_by_lag + 0.4

    def contact(x, v):
        depth = max(abs(x) - 1.5e-3, 0)
        wound_up = 0.6 * depth + 0.4 * max(depth - 2e-4, 0)  # softer over the first 0.2 mrad
        damper = 2 * 0.03 * np.sqrt(2e4) * v
        c = (2e4 * wound_up + 0.75 * damper * np.sign(x)) * (depth > 0)
        return np.sign(x) * max(c, 0) + 0.25 * damper  # a quarter drags in the gap, too

    def rates(t, y):
        i = min(int(t / h), steps - 1)
        force = acceleration[i] + 0.8 * acceleration_by_lag[i] + 30 * (np.sin(q[i]) + 0.1)
        return y[1], force - 30 * np.cos(q[i]) * y[0] - contact(*y)

    orbit_by_scipy = solve_ivp(
        rates, (0, 0.5), orbit.start, t_eval=(np.arange(steps) + 0.5) * h, max_step=h
    )
    expected = [contact(*y) for y in orbit_by_scipy.y.T]
    size = np.abs(expected).max()
    assert (np.abs(orbit_by_scipy.y[0]) < 1.5e-3).any()  # the teeth part
    assert np.sqrt(np.mean((orbit.contact - expected) ** 2)) < 0.01 * size
    assert orbit_by_scipy.y[0, -1] == pytest.approx(orbit.start[0], abs=5e-5)


def test_half_a_step_has_a_third_of_the_error_or_less():
    """A damper at the step's begin, in place of its middle, has half the error instead."""
    torques = [
        predict(some_unknowns(), a_comparison(step_s)).torque
        for step_s in (2e-3, 1e-3, 5e-4, 2.5e-4)
    ]
    changes = np.abs(np.diff(torques, axis=0)).max(axis=1)
    assert changes[0] < 0.01 * np.abs(torques[0]).max()
    assert (changes[1:] < changes[:-1] / 3).all()


COMPILED = ["backlash.torque.load", "studies.simulated_joints", "studies.engine"]
COMPILED += [f"replication.{name}" for name in ("cmaes", "joint", "misfit")]


@pytest.mark.parametrize("name", COMPILED)
def test_compiled_code_that_is_cached_holds_no_other_files_constants(name):
    """The cache is renewed when the function's own file changes, and no other."""
    module = importlib.import_module(name)
    own = {
        place.id
        for line in ast.parse(inspect.getsource(module)).body
        for place in ast.walk(line)
        if isinstance(place, ast.Name) and isinstance(place.ctx, ast.Store)
    }
    functions = [each.py_func for each in vars(module).values() if hasattr(each, "py_func")]
    functions = [each for each in functions if each.__module__ == name]
    assert functions
    for each in functions:
        for read in each.__code__.co_names:
            value = each.__globals__.get(read)
            is_own = read in own or getattr(value, "__module__", None) == name
            assert value is None or inspect.ismodule(value) or is_own, (each.__name__, read)
