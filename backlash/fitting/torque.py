"""The backlash of a joint under any drive, from a log of motor speed and motor torque: method "torque".

A load that the measured motor motion drives is fitted to the torque (`driven_load`): descents start at many plays
and frictions, run until they stand, and go on beside the lowest end until none is lower. That is the answer, unless
another play fits nearly as well, or a gap that is less than none clearly better. Each bounce of the teeth more or less
is a minimum of its own: with few starts rounding decides which one is found. Least squares are solved in plain loops:
BLAS rounds by the processor.
"""

from dataclasses import dataclass, replace
from itertools import product
from numbers import Real
from typing import NamedTuple

import numpy as np

from backlash.fitting.driven_load import (
    DELAY,
    DELTA,
    DRIVE,
    FRICTION,
    LOAD,
    MOST_HARMONICS,
    RINGS_HZ,
    STIFFNESS,
    Comparison,
    Turn,
    compare,
    mean_turn,
    residuals,
)
from backlash.reading.columns import is_positive
from backlash.refusals import Refusal
from replication.arrays import FloatArray
from replication.compiling import njit
from replication.records import Recording
from replication.simulator.parameters import GRAVITY, TURN

MOST_SD = 0.15  # over the backlash, above which there is no answer
NORMAL_95 = 1.96  # half width over SD

_STEP_S = 7e-4  # of the integration, at most: an eighth of a radian of a ring of 30 Hz
_FEW_HARMONICS = 20  # compared in the search, where the misfit has few minima
_MOST_BELOW = 0.1  # of an inertia that was measured, below the least that its mass has
# Of the torque that the model lacks: cogging's side bands, friction that is not constant. In the search more, for
# there the load's data are still wrong.
_LACKING, _LACKING_AT_FIRST = 0.02, 0.1

# Of the unknowns, in the places of `driven_load`: SDs of the priors, and the largest step of a descent.
_SD = np.array([np.inf, 1.5, 0.5, 0.3, np.inf, 0.0, 0.5, 0.0, np.inf, 2.0])
_LONGEST = np.array([0.3, 0.5, 1.0, 0.2, 0.1, 0.2, 1.0, 0.2, 0.2, 1.0])
_MOST_STEPS = 100
_STANDS = 1e-6  # steps in units of the longest, below which a descent stands
_MEAN_RING_HZ = 22.0
_MEAN_DAMPING = 0.04
_MEAN_LAG_MS = 0.7
_PLAYS = np.array([0.0, 0.05, 0.15, 0.3, 0.5, 0.8, 1.2, 1.7, 2.4])  # mrad
_RINGS = np.log((TURN * np.geomspace(*RINGS_HZ, 9)) ** 2)
_FRICTIONS = np.array([0.02, 0.25, 0.5, 0.75, 0.95])  # of the load, over all friction
_FINALISTS = 6
# Steps of delta, and of ln K.
_NEIGHBOURS = tuple(product((1.0, -1.0), (0.15, -0.15, 0.45, -0.45)))
_MOST_ROUNDS = 4  # of neighbours of the best
_OVERLAP_MRAD = 0.01  # a gap that is less than none by more is no joint's

# Fixed on 45 development logs of `studies.benches`, before its final seeds were drawn. On these the method erred by
# 7 % beyond what noise explains (the speed's noise makes gravity and damping seem larger), chi squared was below 2,
# and the load's data were within 3 SDs of what was said, but in wrong minima.
_METHOD_ERROR = 0.07  # share of the backlash
_LEAST_SD = 5e-6  # rad: half a count of 19 bits
_MOST_CHI2 = 3.0  # per compared number
# An absence needs a model that fits; noise alone exceeds this in 3 of 10,000 logs.
_MOST_CHI2_OF_NONE = 1.5
_MOST_OFF = 3.5  # SDs of the load's data
_MOST_DELAY_MS = 3.0  # a current loop's and a filter's are below
_MOST_CHANGE = (
    0.03  # of gravity's torque from turn to turn: a backlash that is off by as much is held
)
_MOST_RIPPLE = 0.1  # of gravity's torque; cogging and encoders make a third of it
# Chi squared that a backlash must lose to another to be excluded: five SDs.
_CLEAR = 25.0
_RIVAL = 9.0  # and for another backlash to be as good as the best: three SDs
# A backlash below this counts as none: 0.015 mm at an arm of 0.3 m.
_NEGLIGIBLE_RAD = 5e-5


@dataclass(frozen=True)
class LoadData:
    """What must be known of the load, by its data sheet or the drive's autotune, each with a relative SD."""

    # rho = J_l / (N^2 J_m): of the load, seen from the motor, to the motor's own.
    inertia_ratio: float
    gravity_per_s2: float  # m g r / J_l: 9.81 / r for a point load
    inertia_sd: float = 0.1
    gravity_sd: float = 0.05
    motor_inertia_kgm2: float | None = None  # the unit of J_m that is found is compared with it
    note: str = ""  # what was made of what was said

    def __post_init__(self):
        """Refuse what no load has."""
        known = () if self.motor_inertia_kgm2 is None else (self.motor_inertia_kgm2,)
        if not (
            all(map(is_positive, (self.inertia_ratio, self.gravity_per_s2, *known)))
            and all(
                isinstance(sd, Real) and 0 <= sd <= 0.5 for sd in (self.inertia_sd, self.gravity_sd)
            )
        ):
            raise Refusal(
                f"{self!r}: inertias and gravity must be above 0, SDs shares up to 0.5, all numbers"
            )

    @staticmethod
    def from_masses(
        gear_ratio: float,
        motor_inertia_kgm2: float,
        load_mass_kg: float,
        load_arm_m: float,
        load_inertia_kgm2: float | None = None,
        **sds: float,
    ) -> "LoadData":
        """Find both ratios from the mass of all that the joint moves and the arm of its centre of mass.

        Its inertia is about the joint's axis; without one it is a point.
        """
        known = () if load_inertia_kgm2 is None else (load_inertia_kgm2,)
        given = (gear_ratio, motor_inertia_kgm2, load_mass_kg, load_arm_m, *known)
        if not all(map(is_positive, given)):
            raise Refusal(
                f"gear ratio, motor inertia, mass, arm and load inertia {given}: give finite numbers above 0"
            )
        point = load_mass_kg * load_arm_m**2
        said = load_inertia_kgm2 or point
        inertia, note = max(said, point), ""
        if said < point:
            note = (
                f"; the load's inertia {said:g} is below m r^2 = {point:.4g} kg m^2: that was taken"
            )
        if said < (1 - _MOST_BELOW) * point:
            raise Refusal(
                f"--load-inertia {said:g}: its mass at its arm alone has {point:.4g} kg m^2; "
                "give the inertia about the joint's axis, not about the centre of mass"
            )
        return LoadData(
            inertia / (gear_ratio**2 * motor_inertia_kgm2),
            GRAVITY * load_mass_kg * load_arm_m / inertia,
            motor_inertia_kgm2=motor_inertia_kgm2,
            note=note,
            **sds,
        )

    def __str__(self) -> str:
        """What was said, as a note."""
        ratio = f"an inertia ratio of {self.inertia_ratio:g} (SD {self.inertia_sd:.0%})"
        gravity = f"m g r / J_l of {self.gravity_per_s2:g} per s^2 (SD {self.gravity_sd:.0%})"
        return f"by the torque, {ratio} and {gravity}{self.note}"


@dataclass(frozen=True)
class TorqueFit:
    """The backlash that speed and torque tell of."""

    delta_rad: float  # half of the play
    interval_rad: tuple[float, float]  # 95 %
    sd_rad: float
    motor_inertia: float  # J_m, its unit the torque's over rad/s^2: compare it with the data sheet
    refusal_reason: str = ""  # why this is no answer; empty if it is one
    is_none: bool = False  # it is negligible, and one that is not fits clearly worse
    # The mean torque, which holds all friction, is less than gravity's: it parts the teeth, if they can.
    reverses: bool = True
    friction_share: float | None = None  # the load's friction over its gravity
    stiffness_per_s2: float | None = None  # of the joint, over the load's inertia


def conclude(delta_rad: float, sd_rad: float, inertia: float, advice: str) -> TorqueFit:
    """An answer with its interval, or why it is none and what would tell more."""
    half = NORMAL_95 * sd_rad
    interval = max(delta_rad - half, 0.0), max(delta_rad + half, 0.0)
    # Without numbers: near zero the SD is none.
    told = f"the backlash is not known within {MOST_SD:.0%}"
    reason = "" if sd_rad <= MOST_SD * delta_rad else f"{told}; {advice}"
    return TorqueFit(delta_rad, interval, sd_rad, inertia, reason)


class Joint(NamedTuple):
    """A joint of the search: its unknowns, the wind-up and its rate where the turn begins, and its misfit."""

    theta: FloatArray
    start: FloatArray
    chi2: float


class _Priors(NamedTuple):
    mean: FloatArray
    sd: FloatArray
    friction: float  # of motor and load, over gravity


def _priors(turn: Turn, load: LoadData) -> _Priors:
    """What is known of the joint by its load and by the first harmonic."""
    g, rho = load.gravity_per_s2, load.inertia_ratio
    turning = (1 + rho) * 1j * turn.omega[0] * turn.speed[0]
    way = turn.torque[0]
    for _ in range(4):  # what is not gravity's is small
        pull = 0.5 * rho * g * way / abs(way) + turning
        drive = abs(turn.torque[0] / pull)
        way = turn.torque[0] / drive - turning
    stiffness = 2 * np.log(TURN * _MEAN_RING_HZ)
    damping, pull, ratio, scale = np.log([_MEAN_DAMPING, g, rho, drive])
    phase = np.angle(1j * way)
    mean = np.array([0, stiffness, damping, 0, phase, pull, _MEAN_LAG_MS, ratio, scale, 0])
    sd = _SD.copy()
    sd[LOAD] = np.array([load.gravity_sd, load.inertia_sd]) + 1e-3
    return _Priors(mean, sd, turn.friction)


def _misfit(
    theta: FloatArray, start: FloatArray, compared: Comparison, priors: _Priors, wants_slopes: bool
) -> tuple[float, FloatArray, FloatArray]:
    """Chi squared with its priors, half its gradient and half its second slopes; without a turn infinite."""
    found = residuals(theta, compared, start, wants_slopes)
    if found is None:
        return np.inf, np.zeros(0), np.zeros((0, 0))
    weight = 1 / priors.sd
    weight[FRICTION] *= 1 if theta[FRICTION] > 0 else 10
    prior = (theta - priors.mean) * weight
    # The motor's friction is not negative.
    beyond = max(theta[FRICTION] - priors.friction, 0) / 0.05
    chi2 = _sum_squares(found[0]) + _sum_squares(prior) + beyond**2
    if not wants_slopes:
        return chi2, np.zeros(0), np.zeros((0, 0))
    gradient, curvature = _normal_equations(*found)
    gradient += prior * weight
    gradient[FRICTION] += beyond / 0.05
    curvature += np.diag(weight**2)
    curvature[FRICTION, FRICTION] += 400.0 if beyond > 0 else 0.0
    return chi2, gradient, curvature


@njit
def _sum_squares(rest):
    total = 0.0
    for each in rest:
        total += each * each
    return total


@njit
def _normal_equations(rest, by):
    """The products of the slopes with the residuals and with each other."""
    count = by.shape[1]
    gradient, curvature = np.zeros(count), np.zeros((count, count))
    for i in range(rest.size):
        for j in range(count):
            gradient[j] += by[i, j] * rest[i]
            for k in range(j + 1):
                curvature[j, k] += by[i, j] * by[i, k]
    for j in range(count):
        for k in range(j):
            curvature[k, j] = curvature[j, k]
    return gradient, curvature


@njit
def _solve(matrix, right):
    """Solve for a positive definite matrix by Cholesky's method."""
    n = right.size
    lower, x = np.zeros((n, n)), right.copy()
    for j in range(n):
        for i in range(j, n):
            total = matrix[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = np.sqrt(max(total, 1e-300)) if i == j else total / lower[j, j]
    for i in range(n):
        for k in range(i):
            x[i] -= lower[i, k] * x[k]
        x[i] /= lower[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= lower[k, i] * x[k]
        x[i] /= lower[i, i]
    return x


def _descend(
    start: Joint, compared: Comparison, priors: _Priors, holds_delta: bool = False
) -> Joint:
    """Least squares by Levenberg and Marquardt, until they stand."""
    theta, begin = start.theta, start.start.copy()
    chi2, gradient, curvature = _misfit(theta, begin, compared, priors, True)
    damped = 1e-3
    for _ in range(_MOST_STEPS):
        if not np.isfinite(chi2):
            break
        matrix = curvature + damped * np.diag(np.diag(curvature))
        pull = -gradient
        if holds_delta:
            matrix[DELTA] = 0.0
            matrix[:, DELTA] = 0.0
            matrix[DELTA, DELTA] = 1.0
            pull[DELTA] = 0.0
        step = _solve(matrix, pull)
        long = np.abs(step / _LONGEST).max()
        step /= max(long, 1.0)
        begins = begin.copy()
        found = _misfit(theta + step, begins, compared, priors, True)
        if found[0] < chi2:
            theta, begin = theta + step, begins
            chi2, gradient, curvature = found
            damped = max(0.2 * damped, 1e-9)
        else:
            damped *= 5.0
        if long < _STANDS or damped > 1e6:
            break
    return Joint(theta, begin, chi2)


def _search(turn: Turn, compared: Comparison, priors: _Priors) -> list[Joint]:
    """The ends of descents from many plays, stiffnesses and frictions, the best first."""
    few = compare(turn, _LACKING_AT_FIRST, _FEW_HARMONICS, 2 * _STEP_S)
    starts = [
        min((_place(priors, few, delta, ring, friction) for ring in _RINGS), key=_chi2)
        for delta in _PLAYS
        for friction in _FRICTIONS * min(turn.friction, 0.9)
    ]
    ends = _distinct([_descend(each, few, priors) for each in starts])
    found = [_descend(each, compared, priors) for each in ends[:_FINALISTS]]
    if not any(map(_is_physical, found)):
        found.append(_hold(min(found, key=_chi2), compared, priors, 0.0))
    best = min(filter(_is_physical, found), key=_chi2)
    for _ in range(_MOST_ROUNDS):
        found += [_descend(_move(best, *step), compared, priors) for step in _NEIGHBOURS]
        before, best = best, min(filter(_is_physical, found), key=_chi2)
        if best.chi2 > before.chi2 - 1e-3:
            break
    return _distinct(found)


def _is_physical(joint: Joint) -> bool:
    """Whether its gap is one, or none but for what rounding leaves."""
    return bool(joint.theta[DELTA] >= -_OVERLAP_MRAD)


def _move(joint: Joint, steps: float, stiffer: float) -> Joint:
    """A joint beside another: its play some steps on, and stiffer by a factor's logarithm."""
    theta = joint.theta.copy()
    theta[DELTA] += steps * (0.06 * abs(theta[DELTA]) + 0.02)
    theta[STIFFNESS] += stiffer
    return joint._replace(theta=theta)


def _place(
    priors: _Priors, compared: Comparison, delta: float, ring: float, friction: float
) -> Joint:
    """The usual joint but for its play, stiffness and friction."""
    theta, start = priors.mean.copy(), np.zeros(2)
    theta[[DELTA, STIFFNESS, FRICTION]] = delta, ring, friction
    chi2 = _misfit(theta, start, compared, priors, False)[0]
    return Joint(theta, start, chi2)


def _chi2(joint: Joint) -> float:
    return joint.chi2


def _distinct(joints: list[Joint]) -> list[Joint]:
    """The best first, each but once."""
    kept: list[Joint] = []
    for joint in sorted(joints, key=_chi2):
        if all(np.abs((joint.theta - each.theta) / _LONGEST).max() > 0.03 for each in kept):
            kept.append(joint)
    return kept


def _hold(joint: Joint, compared: Comparison, priors: _Priors, delta_mrad: float) -> Joint:
    """The best joint of a backlash, from another's."""
    theta = joint.theta.copy()
    theta[DELTA] = delta_mrad
    return _descend(joint._replace(theta=theta), compared, priors, holds_delta=True)


def _deviation(curvature: FloatArray, place: int) -> float:
    """SD of an unknown, from half the second slopes of chi squared."""
    unit = np.eye(curvature.shape[0])[place]
    return float(np.sqrt(_solve(curvature, unit)[place]))


def _check(turn: Turn, priors: _Priors, theta: FloatArray, misfit: float) -> None:
    """Refuse what no joint of the model is, with its likely cause."""
    if turn.change > _MOST_CHANGE:
        raise ValueError(
            f"gravity's torque changes by {turn.change:.0%} from turn to turn; does another axis move?"
        )
    ripple = turn.ripple / np.exp(priors.mean[LOAD].sum())
    if ripple > _MOST_RIPPLE:
        raise ValueError(
            f"a ripple with the motor's turns is {ripple:.0%} of gravity; does the gear's error part the teeth?"
        )
    off = (theta - priors.mean)[LOAD] / priors.sd[LOAD]
    if misfit > _MOST_CHI2 or np.abs(off).max() > _MOST_OFF:
        raise ValueError(
            f"no joint fits speed and torque (chi squared {misfit:.2g}, gravity {off[0]:+.1f} and inertia ratio "
            f"{off[1]:+.1f} SDs off, torque {theta[DELAY]:.1f} ms late); are the load's data right? is there a belt, "
            "another axis, or an error of the gear?"
        )


def _check_delay(delay: float, sd: float) -> None:
    """Refuse a torque [ms] that surely comes at other instants than the speed."""
    if abs(delay) - NORMAL_95 * sd > _MOST_DELAY_MS:
        when = "late" if delay > 0 else "early"
        raise ValueError(
            f"the torque comes {abs(delay):.2g} ms too {when}; log it at the same instants as the speed"
        )


@np.errstate(all="ignore")  # trials far from any joint
def fit_torque(recording: Recording, torque: FloatArray, load: LoadData) -> TorqueFit:
    """Find the backlash from the motor's speed and torque; ValueError where they cannot tell it.

    The torque, shape (samples,), is the motor's at the same samples, positive where it drives
    forward, in any unit, as its current.
    """
    turn = mean_turn(recording, np.asarray(torque, dtype=float))
    if turn.friction >= 1:
        return TorqueFit(np.nan, (np.nan, np.nan), np.nan, np.nan, reverses=False)
    priors = _priors(turn, load)
    compared = compare(turn, _LACKING, MOST_HARMONICS, _STEP_S)
    ends = _search(turn, compared, priors)
    best, *rivals = filter(_is_physical, ends)
    misfit = max(best.chi2 / (2 * compared.omega.size), 1.0)

    def lost_by(other_mrad: float) -> float:
        return _hold(best, compared, priors, other_mrad).chi2 - best.chi2

    theta = best.theta
    _check(turn, priors, theta, misfit)
    curvature = _misfit(theta, best.start.copy(), compared, priors, True)[2] / misfit
    _check_delay(theta[DELAY], _deviation(curvature, DELAY))
    delta = 1e-3 * float(theta[DELTA])
    of_log = 1e-3 * _deviation(curvature, DELTA)
    deviation = float(np.sqrt(of_log**2 + (_METHOD_ERROR * delta) ** 2 + _LEAST_SD**2))
    inertia = float(np.exp(theta[DRIVE]) / turn.gear_ratio)
    advice = "turn the joint faster (twice as fast, about half the SD), log more turns, or with a finer encoder"
    fit = replace(
        conclude(delta, deviation, inertia, advice),
        friction_share=abs(float(theta[FRICTION])),
        stiffness_per_s2=float(np.exp(theta[STIFFNESS])),
    )
    if ends[0].chi2 < best.chi2 - _CLEAR * misfit:
        overlap = 1e-3 * float(ends[0].theta[DELTA])
        raise ValueError(
            f"a gap of {overlap:.2g} rad, less than none, fits best; are the load's data right?"
        )
    low, high = fit.interval_rad
    if high < _NEGLIGIBLE_RAD:
        low, high = -np.inf, _NEGLIGIBLE_RAD
    for rival in rivals:
        other = 1e-3 * float(rival.theta[DELTA])
        if rival.chi2 < best.chi2 + _RIVAL * misfit and not low <= other <= high:
            also = f"{other:.2g} rad fits nearly as well as {delta:.2g} rad"
            return replace(fit, refusal_reason=f"{also}; {advice}")
    if fit.interval_rad[1] < _NEGLIGIBLE_RAD:
        if misfit > _MOST_CHI2_OF_NONE:
            told = f"none fits best, but not well (chi squared {misfit:.2g})"
            raise ValueError(f"{told}; does the gear's error part the teeth, or another axis move?")
        is_none = lost_by(1e3 * _NEGLIGIBLE_RAD) > _CLEAR * misfit
        reason = "" if is_none else f"{_NEGLIGIBLE_RAD:g} rad fits nearly as well as none; {advice}"
        return replace(fit, is_none=is_none, refusal_reason=reason)
    if not fit.refusal_reason and lost_by(0.0) < _CLEAR * misfit:
        return replace(fit, refusal_reason=f"none fits nearly as well as {delta:.2g} rad; {advice}")
    return fit
