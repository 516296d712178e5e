"""Movements to and fro: what is measured of strokes, what they tell, and what is refused."""

from types import SimpleNamespace

import numpy as np
import pytest

import backlash
from backlash import Reason
from backlash.load_data import LoadData
from backlash.torque import load as driven_load
from backlash.torque.load import DRAG, FILTER, FRICTION, LOSS, SOFT, STIFFNESS
from backlash.torque.strokes import measure_strokes, state_strokes
from backlash.torque.unknowns import NAMES
from replication.records import Recording
from studies.simulated_joints import CONTROL_S, TO_AND_FRO, TURN, Fault, draw_log, stroke_speeds
from tests.backlash.test_torque_answer import (
    DELTA,
    answer,
    answers_under_other_kernels,
    is_covered,
    numbers_of,
)

RATIO, GRAVITY = 100.0, 30.0
# Backlash [rad], chi squared, and the backlash's interval.
KNOWN = (1.0455257991e-3, 0.58186980678, 8.9062501517e-4, 1.1733629698e-3)


@pytest.fixture(scope="module")
def drawn():
    return draw_log(np.random.default_rng((83, 0)), DELTA, 0.1, 0.05, ranges=TO_AND_FRO)


@pytest.fixture(scope="module")
def answered(drawn):
    return answer(drawn)


def measured(log):
    """Mean strokes of a log; of its speed and its turn only the gear ratio counts."""
    return measure_strokes(Recording(log.t, log.v, 1.0, log.gear_ratio, "made"), log.torque)


def stated(log):
    return state_strokes(measured(log), LoadData(log.inertia_ratio, log.gravity_per_s2))


@pytest.fixture(scope="module")
def problem(drawn):
    """Unknowns near the joint, and what is compared of drawn strokes, were it what these predict."""
    made = stated(drawn)
    theta = made.prior.mean.copy()
    theta[[driven_load.DELTA, FRICTION, LOSS, DRAG, SOFT, FILTER]] = 0.9, 0.1, 0.05, 0.2, 0.1, 1.0
    predicted = made.compared.predict(theta)
    for _ in range(12):  # to where no start fits better
        predicted = made.compared.predict(theta, predicted.start)
    each = zip(made.compared.windows, predicted.each, strict=True)
    windows = tuple(window._replace(torque=window.torque + one.left) for window, one in each)
    compared = made.compared._replace(windows=windows)
    return made._replace(compared=compared), theta, predicted.start


def test_the_backlash_is_told_at_the_hanging_position_by_how_many_strokes_over_which_angles(
    answered,
):
    assert is_covered(answered, DELTA)
    assert "mrad at the hanging position" in answered.summary
    assert " forth, " in answered.strokes
    assert answered.strokes in str(answered)
    assert answered.turn_period_s is None
    trace = answered.trace
    residual = trace.measured - trace.model
    assert 0 < np.std(residual) < 0.1 * np.std(trace.measured)


@pytest.mark.slow
def test_a_healthy_joint_is_not_called_and_most_drawn_ones_are_answered():
    healthy = draw_log(np.random.default_rng((83, 1)), 0.0, 0.1, 0.05, ranges=TO_AND_FRO)
    assert answer(healthy).verdict != "backlash"
    outcomes = []
    for number in range(6):
        rng = np.random.default_rng((84, number))
        delta = float(rng.uniform(4e-4, 1.5e-3))
        drawn = delta, rng.uniform(0, 0.2), rng.uniform(0, 0.1)
        estimate = answer(draw_log(rng, *drawn, ranges=TO_AND_FRO))
        assert estimate.verdict != "no backlash"
        outcomes.append((estimate.verdict == "backlash", is_covered(estimate, delta)))
    answered, covered = np.sum(outcomes, axis=0)
    assert answered >= 3
    assert covered >= answered - 1


@pytest.mark.parametrize("place", range(len(NAMES)), ids=NAMES)
def test_slopes_are_those_of_differences_with_the_start_that_fits_best(problem, place):
    made, theta, start = problem

    here = made.compared.predict(theta, start)
    slopes, start_slopes = made.compared.differentiate(here)

    def residuals(step):
        moved = np.where(np.arange(theta.size) == place, step, 0.0)
        there = made.compared.predict(theta + moved, here.start + start_slopes @ moved)
        return made.compared.residuals(there)

    expected = (residuals(1e-5) - residuals(-1e-5)) / 2e-5
    assert slopes[:, place] == pytest.approx(expected, abs=3e-3 * np.abs(expected).max() + 1e-5)


def test_a_window_leaves_of_harmonics_what_it_leaves_of_their_wave(problem):
    window = problem[0].compared.windows[0]
    taper = window.stroke.taper
    t = np.arange(taper.size) / taper.size
    coefficient = np.zeros(window.order.size, dtype=complex)
    coefficient[4] = 2 - 1j
    wave = 2 * np.real(coefficient[4] * np.exp(2j * np.pi * window.order[4] * t))
    expected = np.fft.rfft(taper * wave)[window.order] / taper.size
    tapered = driven_load._in_window(coefficient, window.stroke, window)
    assert tapered == pytest.approx(expected, abs=1e-12)


def test_the_strokes_of_a_mirrored_log_are_the_same_but_for_the_direction(drawn):
    plain = measured(drawn)
    mirrored = measured(drawn._replace(v=-drawn.v, torque=-drawn.torque))
    for one, other in zip(plain.means, mirrored.means[::-1], strict=True):
        np.testing.assert_allclose(one.torque.coefficient, other.torque.coefficient, atol=1e-9)
        np.testing.assert_allclose(one.speed.coefficient, other.speed.coefficient, atol=1e-12)
    assert mirrored.gravity.phase == pytest.approx(-plain.gravity.phase)


def test_what_is_compared_is_the_same_whatever_a_logs_last_bits_are(drawn):
    one = stated(drawn)
    other = stated(drawn._replace(v=(1 - 1e-9) * drawn.v, torque=(1 + 1e-9) * drawn.torque))
    for a, b in zip(one.compared.windows, other.compared.windows, strict=True):
        np.testing.assert_array_equal(a.torque, b.torque)
        np.testing.assert_array_equal(a.direction, b.direction)
        np.testing.assert_allclose(a.own_variance, b.own_variance, rtol=1e-9)
    np.testing.assert_array_equal(one.prior.mean, other.prior.mean)


def test_the_answer_is_the_known_one_to_1e_9_and_under_other_kernels(answered):
    assert numbers_of(answered.to_dict()) == pytest.approx(KNOWN, rel=1e-9)
    drawn = "draw_log(np.random.default_rng((83, 0)), DELTA, 0.1, 0.05, ranges=TO_AND_FRO)"
    [there] = answers_under_other_kernels(f"[answer({drawn})]")
    assert numbers_of(there) == pytest.approx(numbers_of(answered.to_dict()), rel=1e-9)


def test_a_trial_far_from_any_joint_has_no_motion_and_is_no_defect(problem):
    made, theta, _ = problem
    for far in (-1e5, 1e4, np.nan):
        moved = np.where(np.arange(theta.size) == STIFFNESS, far, theta)
        with np.errstate(all="ignore"):
            predicted = made.compared.predict(moved)
        assert predicted is None or np.isfinite(predicted.start).all()


# ------------------------------------------------------------------------------------------------- what is refused


def made_log(ends_deg=(-70, 75), speeds=(1.5,), strokes=10, gravity=1.0, friction=0.1, axis=0.0):
    """Strokes of a stiff joint: time [s], motor speed [rps] and torque each 2 ms."""
    every = round(2e-3 / CONTROL_S)
    ends = np.radians(ends_deg)
    parts = [stroke_speeds(speed, ends, strokes, 0.2, 0.2) for speed in speeds]
    speed = np.concatenate(parts)[::every]
    t = every * CONTROL_S * np.arange(speed.size)
    angle = ends[0] + np.cumsum(speed) * every * CONTROL_S
    torque = gravity * (1 + axis * np.sin(2.1 * t)) * np.sin(angle) + friction * np.sign(speed)
    noise = np.random.default_rng(5).standard_normal((2, t.size))
    v = RATIO / TURN * (speed + 1e-3 * noise[1])
    return SimpleNamespace(t=t, v=v, torque=torque + 0.005 * noise[0])


REFUSED = {
    "few strokes": (made_log(strokes=4), {}, Reason.NOT_CONSTANT_SPEED, "3 of each are needed"),
    "speeds that differ": (
        made_log(speeds=(1.0, 1.2, 1.5, 1.8), strokes=4),
        {},
        Reason.NOT_CONSTANT_SPEED,
        "have one speed",
    ),
    "beside hanging": (made_log((20, 100)), {}, Reason.NO_REVERSAL, "of the hanging position"),
    "too fast for the way": (made_log((-50, 50), (3.0,)), {}, Reason.NO_REVERSAL, "60 degrees"),
    "another axis": (made_log(axis=0.1), {}, Reason.NOT_PERIODIC, "another axis"),
    "a vertical axis": (made_log(gravity=0.0), {}, Reason.NO_GRAVITY, "the axis horizontal"),
    "a torque of the wrong sign": (
        made_log(gravity=-1.0, friction=-0.1),
        {},
        Reason.NO_GRAVITY,
        "drives forward",
    ),
    "friction above gravity": (made_log(friction=1.2), {}, Reason.NO_REVERSAL, "on one flank"),
    "twice the gear ratio": (
        made_log(),
        {"gear_ratio": 2 * RATIO},
        Reason.WRONG_PERIOD,
        "is the gear ratio right",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_strokes_that_cannot_tell_are_refused_for_their_reason_in_a_line(kind):
    log, others, reason, words = REFUSED[kind]
    given = {"gear_ratio": RATIO, "inertia_ratio": 2.0, "gravity_per_s2": GRAVITY} | others
    estimate = backlash.estimate(log.t, log.v, torque=log.torque, unit="rps", **given)
    assert (estimate.verdict, estimate.reason) == ("cannot tell", reason.value)
    assert words in estimate.explanation


def test_strokes_without_a_torque_are_asked_for_it():
    log = made_log()
    estimate = backlash.estimate(log.t, log.v, unit="rps", gear_ratio=RATIO)
    assert "log the torque, too" in estimate.explanation


def test_a_torque_that_was_logged_beside_a_position_is_no_running_mean():
    log = draw_log(np.random.default_rng((91, 1)), DELTA, 0.1, 0.05, ranges=TO_AND_FRO)
    rows = slice(None, None, round(4e-3 / log.t[1]))
    position = np.cumsum(log.v) * log.t[1]
    log = log._replace(t=log.t[rows], v=position[rows], torque=log.torque[rows])
    assert is_covered(answer(log, unit="turns", position=True), DELTA)


def test_a_running_mean_of_the_torque_gets_no_answer():
    fault = Fault(torque_mean=50)
    log = draw_log(np.random.default_rng((83, 0)), DELTA, 0.1, 0.05, fault, TO_AND_FRO)
    assert answer(log).verdict == "cannot tell"
