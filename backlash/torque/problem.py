"""What is fitted: the harmonics of the mean turn that are compared, and what is known of the joint beforehand."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from backlash.load_data import LoadData
from backlash.refusals import Reason, Refusal
from backlash.torque.load import (
    FRICTION,
    GRAVITY,
    INERTIA,
    PHASE,
    RATIO,
    SHARE,
    SOFT,
    STIFFNESS,
    Accuracy,
    Comparison,
    compare,
)
from backlash.torque.unknowns import TABLE
from backlash.turns import (
    LEAST_GRAVITY,
    TURN,
    Harmonics,
    gravity_by_turn,
    harmonics,
    odd_against_even,
    round_to,
    scatter_of_phase,
    settled_turns,
)
from replication.records import Recording
from replication.signature import FloatArray


@dataclass(frozen=True)
class ComparisonSettings:
    """Constants of the comparison, each with its source."""

    driven_hz: float = 300.0  # of the motion that drives the load: five times the fastest ring
    least_harmonics: int = 12  # more numbers than unknowns
    # Of the motor's turn: encoders err once and twice, torques ripple with the phases.
    motor_orders: tuple[int, ...] = (1, 2, 6)
    loss_smoothing: float = 0.01  # of gravity, within which the loss changes its sign
    soft_wind_up: float = 0.2  # SD of the soft part's share of gravity's wind-up
    friction_beyond_sd: float = 0.05  # by which the load's friction may exceed all friction
    first_ripple: int = 15  # below, gravity and friction stand out themselves


SETTINGS = ComparisonSettings()
# Of the torque: cogging's side bands, friction that is not constant. A step is a fifth of a radian of a ring of 30 Hz;
# a third of it moves nine of ten backlashes by less than 0.7 %. Beyond 100 Hz simulated joints' logs hold noise alone.
FINE = Accuracy(0.02, 1e-3, 100.0, 80)
# In the search the load's data are still wrong; with few harmonics the misfit has few minima.
ROUGH = Accuracy(0.1, 1.4e-3, 30.0, 20)
_SOFT_SD, _BEYOND_SD = SETTINGS.soft_wind_up, SETTINGS.friction_beyond_sd
# What the comparison is rounded to: of a harmonic a share of its noise's SD, which moves chi squared by about one, or
# of itself, a hundredth of the model's error; of an SD as much as some hundred numbers tell of it.
_NOISE_SHARE, _COEFFICIENT_SHARE = 0.25, 2.5e-4
_SD_SHARE = 0.0625
_RATIO_SHARE = 1e-5  # of the gear's, to which the turn's period gives it
_FRICTION_ERROR = 1e-3  # over gravity
_BESIDE_A_LINE = [1, 1, 1, 1, 0, 0, 0, 0, 0, 1, 1, 1, 1]  # a drift of the turn widens a line


class Movement(NamedTuple):
    """By what a movement is refused: how its passes, turns or strokes, differ, and what may part the teeth or not."""

    gear_ratio: float
    change: float  # SD of gravity's line from pass to pass, over its mean
    odd_against_even: float  # difference of odd and even passes over gravity
    scatter_s: float  # of the times at which gravity's line comes
    friction: float  # mean torque over gravity's: of motor, gear and load
    # Acceleration of a line that stands out [rad/s^2 of the load]; in strokes a ring may be one.
    ripple: float = 0.0
    strokes: str = ""  # which, in words; none of turns


class MeasuredTurn(NamedTuple):
    """Harmonics of speed [rad/s of the load] and torque."""

    speed: Harmonics
    torque: Harmonics
    used: NDArray[np.bool_]
    movement: Movement


def measure_turn(recording: Recording, torque: FloatArray) -> MeasuredTurn:
    """Harmonics of the mean turn; Refusal where they cannot tell the backlash."""
    gear_ratio = recording.commanded_speed_rps * recording.turn_period_s
    gear_ratio = float(round_to(gear_ratio, _RATIO_SHARE * gear_ratio))
    of_load = TURN / gear_ratio * recording.v
    speed = round_below_noise(harmonics(recording, of_load, SETTINGS.driven_hz))
    of_torque = round_below_noise(harmonics(recording, torque, SETTINGS.driven_hz))
    gravity, mean = abs(of_torque.coefficient[0]), settled_turns(recording, torque).mean()
    if gravity < LEAST_GRAVITY * of_torque.sd[0]:
        raise Refusal(
            f"once a turn the torque has {2 * gravity:.3g} in the log's unit, {gravity / of_torque.sd[0]:.1f} SDs "
            f"({LEAST_GRAVITY:g} are needed); is it this motor's, and the axis horizontal?",
            Reason.NO_GRAVITY,
        )
    if mean < 0:
        raise Refusal(
            f"the mean torque is {mean:.3g} along the motion, where friction asks for a positive one: the column of "
            "the torque, or that of the speed, may be reversed; change its sign",
            Reason.NO_GRAVITY,
        )
    used = (speed.omega <= TURN * FINE.fitted_hz) & (speed.order <= FINE.most_harmonics)
    # A log of the joint's side has no orders of the motor's.
    orders = gear_ratio * np.array(SETTINGS.motor_orders if gear_ratio > 1.5 else ())
    used &= ~(np.abs(speed.order[:, None] - orders) < 1.5).any(axis=1)
    if used.sum() < SETTINGS.least_harmonics:
        raise Refusal(
            f"{used.sum()} harmonics of the turn up to {FINE.fitted_hz:g} Hz can be compared; "
            f"{SETTINGS.least_harmonics} are needed: sample faster",
            Reason.TOO_SLOWLY_SAMPLED,
        )
    friction = float(round_to(mean / (2 * gravity), _FRICTION_ERROR))
    movement = compare_turns(recording, torque, gear_ratio, friction, largest_ripple(speed))
    return MeasuredTurn(speed, of_torque, used, movement)


def compare_turns(
    recording: Recording, torque: FloatArray, gear_ratio: float, friction: float, ripple: float
) -> Movement:
    """By how much the turns of a movement differ, beside what its mean turn tells."""
    lines = gravity_by_turn(recording, torque)
    return Movement(
        gear_ratio=gear_ratio,
        change=max(lines.real.std(), lines.imag.std()) / abs(lines.mean()),
        odd_against_even=odd_against_even(recording, torque),
        scatter_s=scatter_of_phase(recording, torque),
        friction=friction,
        ripple=ripple,
    )


def round_below_noise(exact: Harmonics) -> Harmonics:
    """Harmonics without the digits that say nothing.

    Many minima fit nearly as well, and the last bits of a log, or of another machine, would decide which is found.
    """
    error = np.maximum(_NOISE_SHARE * exact.sd, _COEFFICIENT_SHARE * np.abs(exact.coefficient))
    coefficient = round_to(exact.coefficient, error)
    return exact._replace(coefficient=coefficient, sd=round_to(exact.sd, _SD_SHARE * exact.sd))


def largest_ripple(speed: Harmonics) -> float:
    """Acceleration [rad/s^2] of the harmonic that stands out most from those beside it.

    Impacts of the teeth fill the spectrum evenly; an error of gear, teeth or encoder is a line.
    """
    acceleration = 2 * speed.omega * np.abs(speed.coefficient)
    beside = maximum_filter(acceleration, footprint=_BESIDE_A_LINE, mode="constant")
    return float((acceleration - 2 * beside)[SETTINGS.first_ripple :].max(initial=0.0))


class Prior(NamedTuple):
    """What is known of the unknowns beforehand; a weight is one over the square of an SD."""

    mean: FloatArray
    weight: FloatArray
    weight_below_zero: FloatArray  # larger where nothing can be below
    most_friction: float  # of the load: all friction


class Minima(NamedTuple):
    """How many minima of chi squared there are: many narrow ones of strokes."""

    near: float  # chi squared beyond the lowest one's of others that go on
    most_near: int  # of these
    start_frictions: tuple[float, ...]  # of all friction
    # Chi squared per number, below which a joint fits, even if what is no joint makes so much of the speed's noise that
    # it leaves still less.
    fitting: float
    # Chi squared per number, at least: noise of the speed, which rings the load, moves a few strokes' backlash by more
    # than what they leave of the torque says.
    least_scale: float


OF_TURNS = Minima(20.0, 4, (0.02, 0.25, 0.5, 0.75, 0.95), 0.0, 1.0)
OF_STROKES = Minima(50.0, 12, tuple(np.linspace(0.0, 1.0, 13)), 1.0, 2.5)


class Problem(NamedTuple):
    """Least squares in the unknowns: the numbers that are compared, and the prior."""

    compared: Comparison
    prior: Prior
    minima: Minima = OF_TURNS

    @property
    def size(self) -> float:
        """How many numbers are compared."""
        return self.compared.size

    def scale(self, chi2: float) -> float:
        """Chi squared per number, which exceeds one where the model leaves more than noise; else the least."""
        return max(chi2 / self.size, self.minima.least_scale)

    def misfit(self, chi2: float) -> float:
        """By how many SDs chi squared exceeds what noise leaves."""
        return float((chi2 - self.size) / np.sqrt(2 * self.size))

    def prior_residuals(self, theta: FloatArray) -> FloatArray:
        """Distances from what is known beforehand over their SDs, as they are above zero."""
        distance = (theta - self.prior.mean) * np.sqrt(self.prior.weight)
        distance[SOFT] = np.hypot(distance[SOFT], wind_up_share(theta)[0] / _SOFT_SD)
        return distance


def weigh_prior(theta: FloatArray, side: FloatArray, prior: Prior) -> tuple[FloatArray, FloatArray]:
    """Half the Hessian of the prior's chi squared, by Gauss's and Newton's method, and half its slope, downhill.

    The law changes where an unknown is 0; it is that of the side on which another joint is.
    """
    weight = np.where(side < 0, prior.weight_below_zero, prior.weight)
    hessian, downhill = np.diag(weight), weight * (prior.mean - theta)
    if side[SOFT] > 0:
        share, slope = wind_up_share(theta)
        weighted = slope / _SOFT_SD**2
        hessian += weighted[:, None] * slope
        downhill -= share * weighted
    if side[FRICTION] > prior.most_friction:
        hessian[FRICTION, FRICTION] += _BEYOND_SD**-2
        downhill[FRICTION] -= (theta[FRICTION] - prior.most_friction) / _BEYOND_SD**2
    return hessian, downhill


def prior_chi_squared(theta: FloatArray, prior: Prior) -> float:
    """The sum of the squares of the distances from what is known beforehand over their SDs."""
    distance = theta - prior.mean
    weight = np.where(theta < 0, prior.weight_below_zero, prior.weight)
    share = wind_up_share(theta)[0] if theta[SOFT] > 0 else 0.0
    beyond = max(float(theta[FRICTION]) - prior.most_friction, 0.0)
    own = float(weight * distance @ distance)
    return own + (share / _SOFT_SD) ** 2 + (beyond / _BEYOND_SD) ** 2


def wind_up_share(theta: FloatArray) -> tuple[float, FloatArray]:
    """The soft part's share of what gravity winds the joint up beyond the gap, and its slopes by the unknowns."""
    gravity, stiffness, part, e = theta[[GRAVITY, STIFFNESS, SHARE, SOFT]].tolist()
    spring = 1e3 * math.exp(min(max(gravity - stiffness, -50.0), 50.0))  # trials far from any joint
    soft = (1 - part) * e
    whole = spring + max(soft, 0.0)
    slope, soft_slope = np.zeros(theta.size), spring / whole**2
    slope[SOFT], slope[SHARE] = (1 - part) * soft_slope, -e * soft_slope
    slope[STIFFNESS], slope[GRAVITY] = soft * soft_slope, -soft * soft_slope
    return soft / whole, slope


def state_problem(turn: MeasuredTurn, load: LoadData, accuracy: Accuracy = FINE) -> Problem:
    """Priors by the table of unknowns, by the load's data and, of phase and inertia, by the first harmonic."""
    g, rho = load.gravity_per_s2, load.inertia_ratio
    first = turn.torque.coefficient[0]
    inertial = (1 + rho) * 1j * turn.speed.omega[0] * turn.speed.coefficient[0]
    weight = first
    for _ in range(4):  # T = N J_m (inertial + rho g weight), whose direction is nearly that of T
        inertia = abs(first / (0.5 * rho * g * weight / abs(weight) + inertial))
        weight = first / inertia - inertial
    used = turn.used & (turn.speed.order <= accuracy.most_harmonics)
    smoothing = SETTINGS.loss_smoothing * g
    compared = compare(turn.speed, turn.torque, used, accuracy, smoothing)
    prior = state_prior(load, float(np.angle(1j * weight)), inertia, turn.movement.friction)
    return Problem(Comparison((compared,), 2 * compared.order.size), prior)


def state_prior(load: LoadData, phase: float, inertia: float, most_friction: float) -> Prior:
    """What is known of all joints, of this one's load, and of gravity's phase and N J_m by the log."""
    mean, sd, below = np.array([(each.mean, each.sd, each.sd_below_zero) for each in TABLE]).T
    mean[PHASE], mean[INERTIA] = phase, np.log(inertia)
    mean[GRAVITY], sd[GRAVITY] = np.log(load.gravity_per_s2), load.gravity_sd + 1e-3
    mean[RATIO], sd[RATIO] = np.log(load.inertia_ratio), load.inertia_sd + 1e-3
    below = np.where(np.isnan(below), sd, below)
    return Prior(mean, sd**-2.0, below**-2.0, most_friction)
