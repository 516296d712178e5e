"""The backlash of a joint that turns round under any drive, from its motor's speed and torque.

A load that the measured motor motion drives is fitted to the torque (`driven_load`). Least-squares descents start at
many backlashes and frictions, because each bounce of the teeth more or less is a minimum of its own, and go on beside
the lowest end until none is lower. That is the answer, unless another backlash fits nearly as well.
"""

import math
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.optimize import least_squares

from backlash.driven_load import (
    DAMPING,
    DELAY,
    DELTA,
    DRIVE,
    FILTER,
    FRICTION,
    GRAVITY,
    LAG,
    LOSS,
    PHASE,
    RATIO,
    SOFT,
    STIFFNESS,
    UNKNOWNS,
    Comparison,
    Orbit,
    compare,
    find_orbit,
    predict_torque,
    residual_slopes,
    residuals,
)
from backlash.load_data import LoadData
from backlash.refusals import Reason, Refusal
from backlash.turns import (
    LEAST_GRAVITY,
    TURN,
    Harmonics,
    gravity_by_turn,
    harmonics,
    periodic,
    turn_phases,
)
from replication.records import Recording
from replication.signature import FloatArray

NORMAL_95 = 1.96  # half width over SD of a 95 % interval


@dataclass(frozen=True)
class TorqueSettings:
    """Constants of the method, each with its source.

    "Benches" are the joints of `studies.benches`; the limits were fixed on logs of other seeds than the datasheet's.
    """

    driven_hz: float = 300.0  # of the motion that drives the load: five times the fastest ring
    fitted_hz: float = 100.0  # of the torque: beyond, benches' logs hold noise alone
    rings_hz: tuple[float, float] = (10.0, 60.0)  # industrial joints: 8 to 60 Hz
    step_s: float = 7e-4  # an eighth of a radian of a ring of 30 Hz
    most_harmonics: int = 80
    search_harmonics: int = 20  # with few harmonics the misfit has few minima
    least_harmonics: int = 12  # more numbers than unknowns
    # Of the motor's turn: encoders err once and twice, torques ripple with the phases.
    motor_orders: tuple[int, ...] = (1, 2, 6)
    # Of the torque: cogging's side bands, friction that is not constant. In the search the load's data are still wrong.
    model_error: float = 0.02
    search_model_error: float = 0.1
    loss_smoothing: float = 0.01  # of gravity, within which the loss changes its sign

    # Means and SDs of the priors. Industrial joints ring at 10 to 50 Hz with damping ratios of 0.01 to 0.1, filters lag
    # by 0.2 to 1.5 ms, gears lose 2 to 30 % (data sheets of strain wave and cycloidal gears).
    ln_stiffness: tuple[float, float] = (2 * math.log(TURN * 22.0), 1.0)
    ln_damping: tuple[float, float] = (math.log(0.04), 0.5)
    friction: tuple[float, float] = (0.0, 0.3)
    lag_ms: tuple[float, float] = (0.7, 0.5)
    delay_ms: tuple[float, float] = (0.0, 4.0)
    loss: tuple[float, float] = (0.05, 0.15)
    # Strain wave gears are softer up to a fifth of their rated torque, where they are wound up by 0.1 to 0.3 mrad;
    # drives low-pass the current that they log at 25 Hz (6 ms) or above.
    soft_mrad: tuple[float, float] = (0.0, 0.2)
    filter_ms: tuple[float, float] = (0.0, 3.0)
    # SDs below zero of gap, soft part, friction and low-pass, of which none can be: small, yet smooth for a descent. A
    # torque is early by what the speed is late beyond its lag.
    below_zero: tuple[float, ...] = (0.003, 0.015, 0.03, 0.3, 1.5)
    friction_beyond_sd: float = 0.05  # by which the load's friction may exceed all friction

    starts_mrad: tuple[float, ...] = (0.0, 0.05, 0.15, 0.3, 0.5, 0.8, 1.2, 1.7, 2.4)
    start_rings: int = 7
    start_frictions: tuple[float, ...] = (0.02, 0.25, 0.5, 0.75, 0.95)  # of all friction
    # Of 40 benches' logs each but one had its best end among those of its 16 best starts, best rings of a gap and a
    # friction. The best frictions of each gap and ring follow where these end in no usual joint: farther off than
    # `most_off`, or with a chi squared that noise exceeds in one of 20 logs. Of 60
    # logs of another seed three needed them.
    first_starts: int = 16
    usual_misfit: float = 1.6
    finalists: tuple[int, int] = (5, 20)
    # Beside the best: steps of 6 % of the backlash and 0.02 mrad, of ln K, and whether a soft part comes or goes, which
    # is a minimum of its own. Benches' wrong minima have too stiff a spring and too small a gap.
    neighbours: tuple[tuple[float, float, bool], ...] = (
        *product((1.0, -1.0), (0.15, -0.15, 0.45, -0.45), (False,)),
        (2.0, -0.8, False),
        (3.0, -1.6, False),
        *product((0.0,), (0.0, -0.3), (True,)),
    )
    start_soft_mrad: float = 0.3
    most_rounds: int = 4
    # Shares of chi squared, about a hundred, by which a step that ends a descent lowers it: 2, 0.1, and nothing.
    rough_tolerance: float = 2e-2
    tolerance: float = 1e-3
    last_tolerance: float = 1e-8
    same: float = 0.03  # first steps between two ends of one minimum, and where descents were rough
    rough_same: float = 0.5

    # Errors beyond what noise explains: on 20 benches of a seed of their own the errors' SD was 0.55 of that with 0.07.
    method_error: float = 0.05
    # Of the soft part: a share of 0.4 or 0.6 in place of a half moves the gap by as much.
    soft_error: float = 0.1
    # Of benches without soft teeth fits have a soft part of 0.11 mrad (RMS of 87).
    least_soft_sd_mrad: float = 0.1
    least_sd_rad: float = 5e-6  # half a count of 19 bits
    most_sd: float = 0.2  # over the backlash: a wider interval is no answer
    most_misfit: float = 3.1  # SDs of chi squared; noise alone exceeds this in one of 1000 logs
    # SDs of what is known beforehand; of 60 benches' right fits none was 3.1 off.
    most_off: float = 3.5
    most_delay_ms: float = 5.0  # a current loop's and a bus's are below
    most_change: float = 0.03  # of gravity by turns: a backlash off by as much is covered
    # Acceleration of a line over gravity's: of 130 benches' joints 0.05 at most, but for one whose drive hums; with a
    # gear's error of 0.5 mrad a hundred times a turn 0.09 or more, if it is sampled at all. Below the 15th harmonic
    # gravity and friction stand out themselves.
    most_ripple: float = 0.1
    first_ripple: int = 15
    # Chi squared that a backlash must lose to another to be excluded, five SDs, and to be as good, three.
    clear: float = 25.0
    rival: float = 9.0
    negligible_rad: float = 5e-5  # 0.015 mm at an arm of 0.3 m; less is "no backlash"


SETTINGS = TorqueSettings()
_BESIDE_A_LINE = [1, 1, 1, 1, 0, 0, 0, 0, 0, 1, 1, 1, 1]  # a drift of the turn widens a line
# The first steps of a descent, by the places of the unknowns: a bounce of the teeth, or about a prior's SD.
_FIRST_STEP = np.array([0.3, 0.5, 1.0, 0.2, 0.2, 0.1, 0.2, 1.0, 0.2, 0.2, 1.0, 0.1, 2.0])


@dataclass(frozen=True)
class TorqueFit:
    """The joint that speed and torque tell of."""

    delta_rad: float  # half of the play
    interval_rad: tuple[float, float]  # 95 %
    is_none: bool  # the backlash is negligible, and one that is not fits clearly worse
    chi_squared: float  # per compared number
    joint: dict[str, tuple[float, float]]  # quantities of the joint, each with its SD
    model_torque: FloatArray  # at the samples, up to 100 Hz


class Candidate(NamedTuple):
    """A joint of the search: its unknowns, the wind-up and its rate where the turn begins, and its misfit."""

    theta: FloatArray
    start: FloatArray
    chi2: float


class MeasuredTurn(NamedTuple):
    """Harmonics of speed [rad/s of the load] and torque, and what they tell of friction and ripple."""

    speed: Harmonics
    torque: Harmonics
    used: NDArray[np.bool_]
    gear_ratio: float
    friction: float  # mean torque over gravity's: of motor, gear and load
    ripple: float  # acceleration of a line that stands out [rad/s^2 of the load]


class Problem(NamedTuple):
    """Least squares in the unknowns: the numbers that are compared, and the priors."""

    compared: Comparison
    mean: FloatArray
    sd: FloatArray
    sd_below_zero: FloatArray
    most_friction: float  # of the load: all friction

    def prior(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distances from what is known beforehand over their SDs, and their slopes."""
        weight = 1 / np.where(theta < 0, self.sd_below_zero, self.sd)
        beyond = (theta[FRICTION] - self.most_friction) / SETTINGS.friction_beyond_sd
        slope = np.zeros(theta.size)
        slope[FRICTION] = (beyond > 0) / SETTINGS.friction_beyond_sd
        left = np.append((theta - self.mean) * weight, max(beyond, 0.0))
        return left, np.vstack([np.diag(weight), slope])

    def residuals(self, theta: FloatArray, orbit: Orbit) -> FloatArray:
        """What the model leaves of the torque, then the distances of the priors, over their SDs."""
        return np.append(residuals(theta, self.compared, orbit), self.prior(theta)[0])

    def slopes(self, theta: FloatArray, orbit: Orbit) -> FloatArray:
        """Slopes of the residuals by the unknowns."""
        return np.vstack([residual_slopes(theta, self.compared, orbit), self.prior(theta)[1]])

    @property
    def size(self) -> int:
        """How many numbers are compared."""
        return 2 * self.compared.order.size

    def misfit(self, chi2: float) -> float:
        """By how many SDs chi squared exceeds what noise leaves."""
        return float((chi2 - self.size) / np.sqrt(2 * self.size))

    def off(self, theta: FloatArray) -> FloatArray:
        """Distances from what is known beforehand, over their SDs."""
        return (theta - self.mean) / self.sd

    def farthest(self, theta: FloatArray) -> float:
        """The farthest of them."""
        return float(np.abs(self.off(theta)).max())

    def place(self, theta: FloatArray) -> Candidate:
        """A joint with its misfit, which is infinite where the load has no periodic orbit."""
        orbit = find_orbit(theta, self.compared, np.zeros(2))
        if orbit is None:
            return Candidate(theta, np.zeros(2), np.inf)
        return Candidate(theta, orbit.start, float(np.square(self.residuals(theta, orbit)).sum()))

    def descend(
        self,
        begin: Candidate,
        tolerance: float = SETTINGS.last_tolerance,
        holds_delta: bool = False,
    ) -> Candidate:
        """Least squares by SciPy's trust region, whose first step is no longer than a bounce of the teeth."""
        first = find_orbit(begin.theta, self.compared, begin.start)
        if first is None:
            return begin._replace(chi2=np.inf)
        orbit = first
        unit = np.diag(_FIRST_STEP)[:, 1 if holds_delta else 0 :]

        def left(move: FloatArray) -> FloatArray:
            nonlocal orbit
            theta = begin.theta + unit @ move
            tried = find_orbit(theta, self.compared, orbit.start)
            if tried is None:  # a shorter step is tried
                return np.full(self.size + theta.size + 1, np.inf)
            orbit = tried
            return self.residuals(theta, orbit)

        def slopes(move: FloatArray) -> FloatArray:  # where `left` was taken last
            return self.slopes(begin.theta + unit @ move, orbit) @ unit

        end = least_squares(
            left, np.zeros(unit.shape[1]), slopes, ftol=tolerance, xtol=1e-6, gtol=None
        )
        return Candidate(begin.theta + unit @ end.x, orbit.start, 2 * float(end.cost))


def measure_turn(recording: Recording, torque: FloatArray) -> MeasuredTurn:
    """Harmonics of the mean turn; Refusal where they cannot tell the backlash."""
    gear_ratio = recording.commanded_speed_rps * recording.turn_period_s
    speed = harmonics(recording, TURN / gear_ratio * recording.v, SETTINGS.driven_hz)
    of_torque = harmonics(recording, torque, SETTINGS.driven_hz)
    gravity = abs(of_torque.coefficient[0])
    if gravity < LEAST_GRAVITY * of_torque.sd[0] or torque.mean() < 0:
        significance = gravity / of_torque.sd[0]
        raise Refusal(
            f"once a turn the torque has {2 * gravity:.3g} in the log's unit, {significance:.1f} SDs "
            f"({LEAST_GRAVITY:g} are needed), its mean is {torque.mean():.3g}; is it this motor's, "
            "positive where it drives forward, and the axis horizontal?",
            Reason.NO_GRAVITY,
        )
    # A log of the joint's side has no orders of the motor's.
    orders = gear_ratio * np.array(SETTINGS.motor_orders if gear_ratio > 1.5 else ())
    beside_motor = np.abs(speed.order[:, None] - orders) < 1.5
    used = (speed.omega <= TURN * SETTINGS.fitted_hz) & (speed.order <= SETTINGS.most_harmonics)
    used &= ~beside_motor.any(axis=1)
    if used.sum() < SETTINGS.least_harmonics:
        raise Refusal(
            f"{used.sum()} harmonics of the turn up to {SETTINGS.fitted_hz:g} Hz can be compared; "
            f"{SETTINGS.least_harmonics} are needed: sample faster",
            Reason.TOO_SLOWLY_SAMPLED,
        )
    friction = float(torque.mean() / (2 * gravity))
    return MeasuredTurn(speed, of_torque, used, gear_ratio, friction, _ripple(speed))


def _ripple(speed: Harmonics) -> float:
    """Acceleration [rad/s^2] of the harmonic that stands out most from those beside it.

    Impacts of the teeth fill the spectrum evenly; an error of gear, teeth or encoder is a line.
    """
    acceleration = 2 * speed.omega * np.abs(speed.coefficient)
    beside = maximum_filter(acceleration, footprint=_BESIDE_A_LINE, mode="constant")
    return float((acceleration - 2 * beside)[SETTINGS.first_ripple :].max(initial=0.0))


def state_problem(
    turn: MeasuredTurn, load: LoadData, model_error: float, harmonics: int, step_s: float
) -> Problem:
    """What is compared, and what is known of the joint beforehand: by its load and by the first harmonic."""
    g, rho = load.gravity_per_s2, load.inertia_ratio
    first = turn.torque.coefficient[0]
    inertial = (1 + rho) * 1j * turn.speed.omega[0] * turn.speed.coefficient[0]
    weight = first
    for _ in range(4):  # T = N J_m (inertial + rho g weight), whose direction is nearly that of T
        drive = abs(first / (0.5 * rho * g * weight / abs(weight) + inertial))
        weight = first / drive - inertial
    s = SETTINGS
    mean, sd = np.zeros(len(UNKNOWNS)), np.full(len(UNKNOWNS), np.inf)
    mean[PHASE], mean[DRIVE] = np.angle(1j * weight), np.log(drive)
    mean[GRAVITY], sd[GRAVITY] = np.log(g), load.gravity_sd + 1e-3
    mean[RATIO], sd[RATIO] = np.log(rho), load.inertia_sd + 1e-3
    for name in set(UNKNOWNS) & set(vars(s)):
        place = UNKNOWNS.index(name)
        mean[place], sd[place] = getattr(s, name)
    used = turn.used & (turn.speed.order <= harmonics)
    compared = compare(turn.speed, turn.torque, used, model_error, step_s, s.loss_smoothing * g)
    sd_below_zero = sd.copy()
    sd_below_zero[[DELTA, SOFT, FRICTION, FILTER, DELAY]] = s.below_zero
    return Problem(compared, mean, sd, sd_below_zero, turn.friction)


def search(problem: Problem, rough: Problem) -> list[Candidate]:
    """The ends of descents from many backlashes, stiffnesses and frictions, the best first."""
    s = SETTINGS
    found: list[Candidate] = []
    for starts, finalists in zip(_rank_starts(rough), s.finalists, strict=True):
        ends = [rough.descend(start, s.rough_tolerance) for start in starts]
        ends = _distinct(ends, s.rough_same)[:finalists]
        found += [problem.descend(end, s.tolerance) for end in ends]
        found += _descend_beside(problem, min(found, key=_chi2))
        best = min(found, key=_chi2)
        is_near = problem.farthest(best.theta) < s.most_off
        if is_near and problem.misfit(best.chi2) < s.usual_misfit:
            break
    return _distinct([*found, problem.descend(best)], s.same)


def _rank_starts(rough: Problem) -> tuple[list[Candidate], list[Candidate]]:
    """Joints of a grid: the best ring of each gap and friction, ranked; the best friction of each gap and ring."""
    s = SETTINGS
    rings = 2 * np.log(TURN * np.geomspace(*s.rings_hz, s.start_rings))
    frictions = np.array(s.start_frictions) * min(rough.most_friction, 0.9)
    grid = [
        [[_place(rough, delta, ring, friction) for friction in frictions] for ring in rings]
        for delta in s.starts_mrad
    ]
    best_ring = [min(each, key=_chi2) for by_ring in grid for each in zip(*by_ring, strict=True)]
    best_friction = [min(each, key=_chi2) for by_ring in grid for each in by_ring]
    return sorted(best_ring, key=_chi2)[: s.first_starts], best_friction


def _descend_beside(problem: Problem, best: Candidate) -> list[Candidate]:
    """The ends of descents from beside the best joint, and beside a better one that is among them."""
    s = SETTINGS
    found: list[Candidate] = []
    for _ in range(s.most_rounds):
        found += [problem.descend(_move(best, *step), s.tolerance) for step in s.neighbours]
        before, best = best, min([best, *found], key=_chi2)
        if best.chi2 > before.chi2 * (1 - s.tolerance) - 0.1:
            break
    return found


def _place(problem: Problem, delta_mrad: float, ring: float, friction: float) -> Candidate:
    """The usual joint but for its backlash, stiffness and friction."""
    theta = problem.mean.copy()
    theta[[DELTA, STIFFNESS, FRICTION]] = delta_mrad, ring, friction
    return problem.place(theta)


def _move(candidate: Candidate, steps: float, stiffer: float, is_soft_changed: bool) -> Candidate:
    """A joint beside another: its backlash some steps on, stiffer by a factor's logarithm, soft if it was not.

    The gap and half of the soft part take each other's place.
    """
    theta = candidate.theta.copy()
    theta[DELTA] += steps * (0.06 * abs(theta[DELTA]) + 0.02)
    theta[STIFFNESS] += stiffer
    if is_soft_changed:
        start = SETTINGS.start_soft_mrad
        more = start - theta[SOFT] if theta[SOFT] < 0.5 * start else -theta[SOFT]
        theta[SOFT] += more
        theta[DELTA] -= 0.5 * more
    return candidate._replace(theta=theta)


def _chi2(candidate: Candidate) -> float:
    return candidate.chi2


def _distinct(candidates: list[Candidate], same: float) -> list[Candidate]:
    """The best first, each but once; `same` is in first steps."""
    kept: list[Candidate] = []
    for candidate in sorted(candidates, key=_chi2):
        if all(np.abs((candidate.theta - each.theta) / _FIRST_STEP).max() > same for each in kept):
            kept.append(candidate)
    return kept


def hold_delta(problem: Problem, candidate: Candidate, delta_mrad: float) -> Candidate:
    """The best joint of a backlash, from another's."""
    theta = candidate.theta.copy()
    theta[DELTA] = delta_mrad
    return problem.descend(candidate._replace(theta=theta), holds_delta=True)


_ADVICE = "turn the joint faster (twice as fast, about half the SD), log more turns, or with a finer encoder"


@np.errstate(all="ignore")  # trials far from any joint
def fit_torque(recording: Recording, torque: FloatArray, load: LoadData) -> TorqueFit:
    """Find the backlash from the motor's speed and torque; Refusal where they do not tell it.

    The torque, shape (samples,), is the motor's at the same samples, positive where it drives forward, in any unit, as
    its current.
    """
    s = SETTINGS
    turn = measure_turn(recording, torque)
    _check_movement(recording, torque, turn, load)
    rough = state_problem(turn, load, s.search_model_error, s.search_harmonics, 2 * s.step_s)
    problem = state_problem(turn, load, s.model_error, s.most_harmonics, s.step_s)
    best, *rivals = search(problem, rough)
    misfit = max(best.chi2 / problem.size, 1.0)
    covariance = misfit * _covariance(problem, best)
    _check_joint(problem, best, covariance)
    delta = 1e-3 * max(float(best.theta[DELTA]), 0.0)
    own = _interval(best.theta, covariance)
    is_none = own[1] < s.negligible_rad
    rivals = [each for each in rivals if each.chi2 < best.chi2 + s.rival * misfit]
    # Of the answer are the intervals of all minima that fit nearly as well; none has none that is not negligible.
    others = [
        (0.0, 1e-3 * each.theta[DELTA])
        if is_none
        else _interval(each.theta, misfit * _covariance(problem, each))
        for each in rivals
    ]
    interval = min(low for low, _ in [own, *others]), max(high for _, high in [own, *others])
    widest = s.negligible_rad if is_none else 2 * NORMAL_95 * s.most_sd * delta
    if own[1] - own[0] > widest:
        raise Refusal(
            f"the backlash is not known within {s.most_sd:.0%}; {_ADVICE}", Reason.TOO_NOISY
        )
    if interval[1] - interval[0] > widest:
        ends = " to ".join(f"{1e3 * end:.2g}" for end in interval)
        raise Refusal(
            f"backlashes of {ends} mrad fit nearly as well as {1e3 * delta:.2g} mrad; {_ADVICE}",
            Reason.AMBIGUOUS,
        )
    excluded_rad = s.negligible_rad if is_none else 0.0
    if hold_delta(problem, best, 1e3 * excluded_rad).chi2 - best.chi2 < s.clear * misfit:
        also = f"{1e3 * excluded_rad:g} mrad fits nearly as well as {1e3 * delta:.2g} mrad"
        raise Refusal(f"{also}; {_ADVICE}", Reason.AMBIGUOUS)
    return TorqueFit(
        delta_rad=delta,
        interval_rad=interval,
        is_none=is_none,
        chi_squared=best.chi2 / problem.size,
        joint=_quantities(best.theta.copy(), np.sqrt(np.diag(covariance)), turn.gear_ratio),
        model_torque=_model_torque(recording, torque, problem, best),
    )


def _covariance(problem: Problem, best: Candidate) -> FloatArray:
    """The unknowns' covariance, by the priors as they are above zero."""
    by = residual_slopes(best.theta, problem.compared, _orbit_of(problem, best))
    return np.asarray(np.linalg.inv(by.T @ by + np.diag(problem.sd**-2.0)))


def _orbit_of(problem: Problem, candidate: Candidate) -> Orbit:
    orbit = find_orbit(candidate.theta, problem.compared, candidate.start)
    if orbit is None:
        raise Refusal("under no joint that was tried does the load turn on", Reason.NO_FIT)
    return orbit


def _interval(theta: FloatArray, covariance: FloatArray) -> tuple[float, float]:
    """The gap's 95 % interval [rad].

    A gap and a soft part take each other's place, and other errors of the model look like a soft part. As no soft part
    is less than none, the gap exceeds the best one by no more than the best soft part makes room for, and by the errors
    of a gap beside a soft part that is known.
    """
    s = SETTINGS
    delta, soft = np.maximum(1e-3 * theta[[DELTA, SOFT]], 0)
    soft_sd = 1e-3 * np.sqrt(covariance[SOFT, SOFT])
    slope = covariance[DELTA, SOFT] / covariance[SOFT, SOFT]
    beside = 1e-6 * (covariance[DELTA, DELTA] - slope * covariance[DELTA, SOFT])
    errors = s.method_error * delta, s.least_sd_rad + s.soft_error * soft
    sd = np.sqrt(beside + np.square(errors).sum())
    low = delta - NORMAL_95 * np.hypot(sd, slope * soft_sd)
    most = min(max(soft_sd, 1e-3 * s.least_soft_sd_mrad), soft)
    high = delta + NORMAL_95 * np.hypot(sd, slope * most)
    return max(float(low), 0.0), float(high)


def _check_movement(
    recording: Recording, torque: FloatArray, turn: MeasuredTurn, load: LoadData
) -> None:
    """Refuse a movement whose turns differ, or in which the teeth may not part, or part by the gear's error."""
    by_turn = gravity_by_turn(recording, torque)
    change = max(by_turn.real.std(), by_turn.imag.std()) / abs(by_turn.mean())
    if change > SETTINGS.most_change:
        raise Refusal(
            f"the torque's line once a turn changes by {change:.0%} from turn to turn; is it gravity's, or does "
            "another axis move?",
            Reason.NOT_PERIODIC,
        )
    if turn.friction >= 1:
        raise Refusal(
            f"the mean torque, {turn.friction:.2f} of gravity's, may hold the teeth on one flank; the test needs an "
            "off-centre load whose gravity exceeds friction and losses, and a horizontal axis",
            Reason.NO_REVERSAL,
        )
    ripple = turn.ripple / (load.gravity_per_s2 * load.inertia_ratio)
    if ripple > SETTINGS.most_ripple:
        raise Refusal(
            f"a line of the speed is a ripple of {ripple:.0%} of gravity; does the gear's error part the teeth, or "
            "does the drive hum?",
            Reason.NO_FIT,
        )


def _check_joint(problem: Problem, best: Candidate, covariance: FloatArray) -> None:
    """Refuse what no joint of the model is."""
    s = SETTINGS
    off, delay = problem.off(best.theta), float(best.theta[DELAY])
    is_bad = problem.misfit(best.chi2) > s.most_misfit
    is_late = abs(delay) - NORMAL_95 * np.sqrt(covariance[DELAY, DELAY]) > s.most_delay_ms
    if is_late and not is_bad:
        when = "late" if delay > 0 else "early"
        raise Refusal(
            f"the torque comes {abs(delay):.2g} ms too {when}; log it at the same instants as the speed",
            Reason.NO_FIT,
        )
    if is_bad or problem.farthest(best.theta) > s.most_off:
        farthest = int(np.abs(off).argmax())
        raise Refusal(
            f"no joint fits speed and torque (chi squared {best.chi2 / problem.size:.2g}, {UNKNOWNS[farthest]} "
            f"{off[farthest]:+.1f}, gravity {off[GRAVITY]:+.1f} and inertia ratio {off[RATIO]:+.1f} SDs off, gear loss "
            f"{best.theta[LOSS]:.0%}, torque {delay:.1f} ms late and low-passed by {best.theta[FILTER]:.1f} ms); are "
            "the load's data right? is there a belt, another axis, or an error of the gear?",
            Reason.NO_FIT,
        )


# Quantities whose logarithm is an unknown, and those that are unknowns.
_BY_LOGARITHM = {
    "stiffness_per_s2": STIFFNESS,
    "damping_ratio": DAMPING,
    "gravity_per_s2": GRAVITY,
    "inertia_ratio": RATIO,
    "motor_inertia": DRIVE,
}
_PLAIN = {
    "soft_mrad": SOFT,
    "friction_share": FRICTION,
    "loss": LOSS,
    "torque_delay_ms": DELAY,
    "torque_filter_ms": FILTER,
    "speed_lag_ms": LAG,
}


def _quantities(
    theta: FloatArray, sd: FloatArray, gear_ratio: float
) -> dict[str, tuple[float, float]]:
    """Quantities of the joint with their SDs; a logarithm's SD is a share."""
    theta[DRIVE] -= np.log(gear_ratio)  # of N J_m
    value = np.exp(theta)
    joint = {name: (value[k], value[k] * sd[k]) for name, k in _BY_LOGARITHM.items()}
    joint |= {name: (theta[k], sd[k]) for name, k in _PLAIN.items()}
    return {name: (float(each), float(of)) for name, (each, of) in joint.items()}


def _model_torque(
    recording: Recording, torque: FloatArray, problem: Problem, best: Candidate
) -> FloatArray:
    """The model's torque at the samples; its mean, which holds the motor's friction, is the log's."""
    contact = _orbit_of(problem, best).contact
    predicted = predict_torque(best.theta, problem.compared, contact)
    wave = periodic(predicted, problem.compared.order, turn_phases(recording))
    return np.asarray(torque.mean() + wave)
