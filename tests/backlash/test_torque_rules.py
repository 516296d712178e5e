"""What the torque's fit decides and refuses, from numbers that are given."""

from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.stats import norm

from backlash.load_data import LoadData
from backlash.refusals import Reason, Refusal
from backlash.torque import answer as rules
from backlash.torque.load import (
    DELAY,
    DELTA,
    FILTER,
    FRICTION,
    GRAVITY,
    LOSS,
    RATIO,
    SHARE,
    SOFT,
    STIFFNESS,
)
from backlash.torque.problem import (
    Prior,
    Problem,
    compare_turns,
    largest_ripple,
    measure_turn,
    prior_chi_squared,
    round_below_noise,
    weigh_prior,
    wind_up_share,
)
from backlash.torque.search import Candidate
from backlash.torque.unknowns import NAMES
from backlash.turns import Harmonics
from replication.records import Recording
from tests.logs import refused_for

TURN = 2 * np.pi


def candidate(delta_mrad, chi2=100.0, gravity=0.0):
    theta = np.zeros(len(NAMES))
    theta[[DELTA, SHARE, GRAVITY]] = delta_mrad, 0.5, gravity
    return Candidate(theta, chi2)


def of_hundred_numbers(sd):
    compared = SimpleNamespace(size=100)
    return Problem(compared, Prior(np.zeros(sd.size), sd**-2, sd**-2, most_friction=0.5))


@pytest.fixture
def decide(monkeypatch):
    """What `fit_torque` makes of candidates whose misfits are of 100 numbers, with an SD of the gap [mrad]."""
    state = Mock(return_value=of_hundred_numbers(np.ones(len(NAMES))))
    movement = SimpleNamespace(gear_ratio=1.0, strokes="")
    for name, result in {
        "check_movement": None,
        "_refuse_mean": None,
        "_check_joint": None,
        "_check_speed": None,
        "_quantities": {},
        "measure": (SimpleNamespace(movement=movement), state, Mock()),
    }.items():
        monkeypatch.setattr(rules, name, Mock(return_value=result))

    def answer(*candidates, of_held=1e3, sd_mrad=0.03):
        variances = np.ones(len(NAMES))
        variances[DELTA] = sd_mrad**2
        hold = Mock(return_value=candidate(0.0, of_held))
        monkeypatch.setattr(rules, "_covariance", lambda *_: np.diag(variances))
        monkeypatch.setattr(rules, "search", lambda *_: list(candidates))
        monkeypatch.setattr(rules, "hold_delta", hold)
        try:
            fit = rules.fit_torque(None, np.zeros(1), None)
        except Refusal as refusal:
            return refusal.reason
        return fit, hold.call_args.args[2]

    return answer


@pytest.mark.parametrize("chi2", [50.0, 200.0])
def test_the_interval_holds_noise_the_methods_error_and_half_a_count(decide, chi2):
    fit, held = decide(candidate(0.9, chi2))
    assert (fit.delta_rad, fit.is_none, held) == (pytest.approx(9e-4), False, 0)
    assert fit.chi_squared == chi2 / 100
    scale = max(chi2 / 100, 1)
    sd = np.sqrt(scale * 3e-5**2 + (0.025 * 9e-4) ** 2 + 5e-6**2)
    expected = (9e-4 - 1.96 * sd, 9e-4 + 1.96 * sd)
    assert fit.interval_rad == pytest.approx(expected, rel=1e-4)
    assert decide(candidate(0.9, chi2), of_held=chi2 + 15.9 * scale) == Reason.AMBIGUOUS
    assert decide(candidate(0.9, chi2), of_held=chi2 + 16.1 * scale)[0] == fit


def test_minima_count_by_how_well_they_fit_until_they_are_no_answer(decide):
    alone = decide(candidate(0.9))[0].interval_rad
    assert decide(candidate(0.9), candidate(1.0, 116.1))[0].interval_rad == alone
    low, high = decide(candidate(0.9), candidate(1.0, 106.0))[0].interval_rad
    # Of two normal laws, one of which has a weight of exp(-6 / 4), 2.5 % lie beyond either end.
    sd = np.sqrt(3e-5**2 + (0.025 * np.array([9e-4, 1e-3])) ** 2 + 5e-6**2)
    weight = np.array([1, np.exp(-1.5)]) / (1 + np.exp(-1.5))
    for end, share in ((low, 0.025), (high, 0.975)):
        assert weight @ norm.cdf((end - np.array([9e-4, 1e-3])) / sd) == pytest.approx(share, 1e-3)
    assert decide(candidate(0.9), candidate(1.9, 106.0)) == Reason.AMBIGUOUS
    assert decide(candidate(0.9), candidate(0.2, 106.0)) == Reason.AMBIGUOUS


@pytest.mark.parametrize("chi2", [50.0, 200.0])
def test_a_joint_is_told_that_fits_nearly_as_well_as_one_that_none_can_be(decide, chi2):
    rival = 16 * max(chi2 / 100, 1)
    for gravity, more, expected_mrad in (
        (2.4, 1.0, 1.1),
        (2.6, 0.99 * rival, 0.9),
        (2.6, 1.01 * rival, 1.1),
    ):
        lower = candidate(1.1, chi2, gravity)
        fit, _ = decide(lower, candidate(0.9, chi2 + more))
        assert fit.delta_rad == pytest.approx(1e-3 * expected_mrad)


def test_what_is_negligible_is_none_if_it_fits_and_what_is_not_fits_clearly_worse(decide):
    fit, held = decide(candidate(0.01), sd_mrad=0.01)
    assert (fit.is_none, held) == (True, 0.05)
    assert fit.interval_rad[0] == 0
    # 0.05 mrad is 0.01 and 1.96 SDs.
    sd = np.sqrt((0.04 / 1.96) ** 2 - 0.005**2 - 0.00025**2)
    assert decide(candidate(0.01), sd_mrad=0.995 * sd)[0].is_none
    assert decide(candidate(0.01), sd_mrad=1.005 * sd) == Reason.TOO_NOISY
    none = {"sd_mrad": 0.01}
    assert decide(candidate(0.01), candidate(0.049, 101), **none)[0].is_none
    assert decide(candidate(0.01), candidate(0.051, 101), **none) == Reason.AMBIGUOUS
    assert decide(candidate(0.01), of_held=115.9, **none) == Reason.AMBIGUOUS


def test_a_backlash_within_a_fifth_is_an_answer_and_a_wider_one_is_not(decide):
    # With a method's error of 2.5 % and half a count.
    sd = np.sqrt(0.2**2 - 0.025**2 - 0.005**2)
    assert decide(candidate(1.0), sd_mrad=0.999 * sd)[0].delta_rad == 1e-3
    assert decide(candidate(1.0), sd_mrad=1.001 * sd) == Reason.TOO_NOISY


@pytest.mark.parametrize(
    ("soft_mrad", "sd_mrad", "most_mrad"),
    [(-0.01, 0.2, 0.0), (0.1, 0.2, 0.1), (0.3, 0.2, 0.2), (0.3, 0.05, 0.1), (0.05, 0.05, 0.05)],
)
def test_a_soft_part_makes_room_for_a_smaller_gap_and_no_more_than_it_is_for_a_larger_one(
    soft_mrad, sd_mrad, most_mrad
):
    theta, covariance = np.zeros(len(NAMES)), np.zeros((len(NAMES),) * 2)
    theta[[DELTA, SOFT]] = 1.0, soft_mrad
    soft = max(1e-3 * soft_mrad, 0)
    both = -0.5 * sd_mrad**2
    covariance[np.ix_([DELTA, SOFT], [DELTA, SOFT])] = [[0.02, both], [both, sd_mrad**2]]
    delta, *sds = rules._deviations(theta, covariance)
    own = 1e-6 * (0.02 + 0.5 * both) + 2.5e-5**2 + (5e-6 + 0.05 * soft) ** 2
    room = 0.5e-3 * np.array([sd_mrad, most_mrad])
    assert (delta, *sds) == pytest.approx((1e-3, *np.sqrt(own + room**2)), rel=1e-9)


@pytest.mark.parametrize(
    ("other_mrad", "more", "words"),
    [
        (1.051, 5.9, "means over some 12 ms, 1.1 mrad"),
        (0.874, 5.9, "means over some 12 ms, 0.87 mrad"),
        (1.051, 6.1, None),
        (1.049, 5.9, None),
        (0.876, 5.9, None),
    ],
)
def test_a_mean_of_speed_and_torque_is_refused_if_a_backlash_beyond_the_interval_fits(
    monkeypatch, other_mrad, more, words
):
    best, both = candidate(1.0), [candidate(1.0), candidate(other_mrad, 100.0 + more)]
    monkeypatch.setattr(rules, "evaluate_beside", Mock(side_effect=both))
    monkeypatch.setattr(rules, "descend", lambda problem, begin, tolerance: begin)
    windows = (SimpleNamespace(order=np.arange(30)),)
    problem = Problem(SimpleNamespace(windows=windows), None)
    # A quarter beyond either end.
    with refused_for(words):
        rules._refuse_mean(problem, problem, 0.012, best, (0.9e-3, 1.04e-3))


@pytest.mark.parametrize(("significant", "words"), [(2, None), (1, "leaves 1 of its harmonics")])
def test_a_backlash_asks_for_two_harmonics_of_the_speed_that_stand_out(significant, words):
    omega = np.arange(1.0, 21)
    speed = np.where(omega <= significant, 4.1, 3.9) * 0.5
    window = SimpleNamespace(omega=omega, speed_sd=0.5, acceleration=1j * omega * speed)
    with refused_for(words):
        rules._check_speed(Problem(SimpleNamespace(windows=(window,)), None))


@pytest.mark.parametrize(
    ("amplitude", "period_turns", "late_s", "fields", "words"),
    [
        (0.029, 4, 0.0, {}, None),
        (0.031, 4, 0.0, {}, "changes by 3%"),
        (0.0029, 2, 0.0, {}, None),
        (0.0031, 2, 0.0, {}, "odd and even turns differ by 0.6%"),
        (0.0, 4, 0.95e-3, {}, None),
        (0.0, 4, 1.05e-3, {}, "ms early or late"),
        (0.0, 4, 0.0, {"friction": 0.999}, None),
        (0.0, 4, 0.0, {"friction": 1.001}, "may hold the teeth on one flank"),
        (0.0, 4, 0.0, {"ripple": 0.099 * 60}, None),
        (0.0, 4, 0.0, {"ripple": 0.101 * 60}, "ripple"),
    ],
)
@pytest.mark.parametrize("phase", [0.0, np.pi / 2])
def test_a_movement_is_refused_beyond_its_limits(
    amplitude, period_turns, late_s, fields, words, phase
):
    t = 4e-3 * np.arange(1200) + 2e-3
    record = Recording(t, np.ones(t.size), 100.0, 0.4, "made")
    sign = (-1) ** np.floor(t / 0.4 * 2 / period_turns)
    wave = (1 + amplitude * sign) * np.cos(TURN * (t - late_s * sign) / 0.4 + phase)
    movement = compare_turns(
        record, wave, **{"gear_ratio": 40.0, "friction": 0.5, "ripple": 0.0} | fields
    )
    with refused_for(words):
        rules.check_movement(movement, LoadData(2.0, 30.0))


# Of 100 numbers, chi squared of noise has the SD of 14.1.
@pytest.mark.parametrize(
    ("place", "value", "chi2", "words"),
    [
        (GRAVITY, 0.249, 143.0, None),
        (GRAVITY, -0.251, 100.0, r"squared 1, gravity -2.5, inertia ratio \+0.0 SDs"),
        (RATIO, -0.251, 100.0, r"squared 1, inertia ratio -2.5, gravity \+0.0 SDs"),
        (SHARE, 0.349, 100.0, None),
        (LOSS, 0.351, 100.0, "loss .3.5"),
        (STIFFNESS, 0.0, 144.0, r"ms\); are the load's data right"),
        (FILTER, 3.1, 144.0, r"low-passed by 3.1 ms\); is the torque filtered, or a mean"),
        (DELAY, 5.9, 100.0, None),
        (DELAY, 6.0, 100.0, "6 ms too late"),
        (DELAY, -6.0, 100.0, "6 ms too early"),
    ],
)
def test_a_joint_is_refused_beyond_its_limits(place, value, chi2, words):
    theta, sd = np.zeros(len(NAMES)), np.full(len(NAMES), 0.1)
    theta[place], sd[DELAY] = value, 4.0
    covariance = 0.25 * np.eye(theta.size)  # an SD of 0.5 ms
    given = (of_hundred_numbers(sd), Candidate(theta, chi2), covariance)
    with refused_for(words):
        rules._check_joint(*given)


SD = 1 + np.arange(1.0 * len(NAMES))


def a_problem():
    mean = np.arange(1.0, SD.size + 1)
    mean[SOFT] = 0.0
    return Problem(None, Prior(mean, SD**-2, (0.1 * SD) ** -2, most_friction=0.6))


def prior_residuals(theta, mean):
    """By hand: distances over SDs, the soft part's share of the wind-up, and friction beyond all there is."""
    soft = max((1 - theta[SHARE]) * theta[SOFT], 0.0)
    share = soft / (soft + 1e3 * np.exp(theta[GRAVITY] - theta[STIFFNESS]))
    beyond = max(theta[FRICTION] - 0.6, 0.0)
    return np.array(
        [*(theta - mean) / np.where(theta < 0, 0.1 * SD, SD), share / 0.2, beyond / 0.05]
    )


@pytest.mark.parametrize("friction", [0.2, -0.2, 0.7], ids=["usual", "below zero", "beyond all"])
@pytest.mark.parametrize("soft", [-0.1, 0.2])
def test_a_prior_is_of_distances_over_sds_with_their_slopes(friction, soft):
    problem = a_problem()
    mean = problem.prior.mean
    theta = mean + 0.5
    theta[[FRICTION, SOFT, SHARE, GRAVITY, STIFFNESS]] = friction, soft, 0.6, 3.4, 9.9
    residuals = prior_residuals(theta, mean)
    assert prior_chi_squared(theta, problem.prior) == pytest.approx(residuals @ residuals)
    moves = 1e-6 * np.eye(theta.size)
    ends = [(prior_residuals(theta + m, mean), prior_residuals(theta - m, mean)) for m in moves]
    slopes = np.array([ahead - back for ahead, back in ends]) / 2e-6
    hessian, downhill = weigh_prior(theta, theta, problem.prior)
    assert hessian == pytest.approx(slopes @ slopes.T, rel=1e-6, abs=1e-8)
    assert downhill == pytest.approx(-slopes @ residuals, rel=1e-6, abs=1e-7)
    # By the law above zero, wherever a joint is.
    above = weigh_prior(theta, np.abs(theta), problem.prior)[1][FRICTION]
    assert above == pytest.approx(
        (mean - theta)[FRICTION] / SD[FRICTION] ** 2 - 20 * residuals[-1], rel=1e-9
    )
    if soft > 0:
        both = np.hypot(residuals[SOFT], residuals[-2])
        assert problem.prior_residuals(theta)[SOFT] == pytest.approx(both)


def test_a_joint_without_a_soft_part_may_have_a_spring_that_no_number_holds():
    theta = a_problem().prior.mean
    theta[STIFFNESS] = 2000.0
    assert wind_up_share(theta)[0] == 0.0


def measured_record(period_s, hertz=1000, mean=2.0, noise=0.0, gear_ratio=30.0):
    t = np.arange(round(12 * period_s * hertz)) / hertz
    angle = TURN * t / period_s
    rps = gear_ratio / period_s
    speed = rps + 0.1 * np.sin(angle)
    force = mean + 3 * np.cos(angle + 0.4)
    force = force + noise * np.random.default_rng(1).normal(size=t.size)
    return Recording(t, speed, rps, period_s, "made"), force


@pytest.mark.parametrize(
    ("period_s", "gear_ratio", "last", "orders"),
    [
        (0.4, 30.0, 40, (30,)),
        (1.0, 30.0, 80, (30, 60)),
        (1.0, 10.0, 80, (10, 20, 60)),
        (0.4, 1.0, 40, ()),
        (0.125, 30.0, 12, ()),  # twelve are needed
    ],
)
def test_harmonics_up_to_100_hz_and_80_are_compared_but_for_the_motors_orders(
    period_s, gear_ratio, last, orders
):
    turn = measure_turn(*measured_record(period_s, gear_ratio=gear_ratio))
    beside = {order + k for order in orders for k in (-1, 0, 1)}
    assert set(turn.speed.order[turn.used]) == set(range(1, last + 1)) - beside
    assert turn.speed.order[-1] == int(300 * period_s)
    assert turn.movement.friction == pytest.approx(2 / 3, rel=1e-3)
    amplitude = abs(turn.speed.coefficient[0])
    assert amplitude == pytest.approx(TURN / gear_ratio * 0.05, rel=1e-3)
    with refused_for(Reason.TOO_SLOWLY_SAMPLED.value):
        measure_turn(*measured_record(0.115))


def test_harmonics_are_rounded_below_their_noise_and_no_last_bit_moves_them():
    numbers = np.random.default_rng(3).normal(size=40) * np.logspace(-3, 3, 40)
    order = np.arange(40)
    exact = Harmonics(order, 1.0 * order, numbers * (1 - 0.5j), np.full(40, 0.1))
    made = round_below_noise(exact)
    moved = np.abs(made.coefficient - exact.coefficient)
    assert (moved < np.maximum(0.125 * 0.1, 1.25e-4 * np.abs(exact.coefficient)) * 2**0.5).all()
    nearly = exact._replace(coefficient=(1 + 1e-9) * exact.coefficient, sd=(1 - 1e-9) * exact.sd)
    np.testing.assert_equal(round_below_noise(nearly), made)
    # Without noise nothing is lost but the digits of which the model errs by more.
    noiseless = round_below_noise(exact._replace(sd=np.zeros(40)))
    assert noiseless.coefficient == pytest.approx(exact.coefficient, rel=2.5e-4)
    assert (noiseless.sd == 0).all()


@pytest.mark.parametrize(("noise", "mean"), [(0.8, 2.0), (100.0, 2.0), (0.0, -0.1)])
def test_gravitys_line_must_be_ten_of_its_sds_and_the_mean_torque_forward(noise, mean):
    with refused_for(None if noise == 0.8 else Reason.NO_GRAVITY.value):
        measure_turn(*measured_record(0.4, noise=noise, mean=mean))


def test_a_ripple_is_a_line_that_stands_out_of_the_spectrum_from_the_16th_harmonic_on():
    order = np.arange(1, 101)
    omega = TURN * order
    for line, expected in ((60, 0.5 - 2 * 0.02), (16, 0.5 - 2 * 0.02), (15, 0.0)):
        acceleration = np.full(100, 0.02)
        acceleration[line - 1] = 0.5
        speed = Harmonics(order, omega, acceleration / (2 * omega), np.zeros(100))
        assert largest_ripple(speed) == pytest.approx(expected, abs=1e-12)
