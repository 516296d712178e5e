"""The backlash of a joint that turns round under any drive, from its motor's speed and torque.

A load that the measured motor motion drives is fitted to the torque (`driven_load`). Least-squares descents start at
many backlashes and frictions, because each bounce of the teeth more or less is a minimum of its own, and go on beside
the lowest end until none is lower. That is the answer, unless another backlash fits nearly as well.
"""

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backlash.driven_load import (
    DAMPING,
    DELAY,
    DELTA,
    DRIVE,
    FRICTION,
    GRAVITY,
    LAG,
    LOSS,
    PHASE,
    RATIO,
    STIFFNESS,
    UNKNOWNS,
    Comparison,
    compare,
    residuals,
    solve_load,
)
from backlash.load_data import LoadData
from backlash.refusals import Reason, Refusal
from backlash.turns import TURN, Harmonics, gravity_by_turn, harmonics, periodic, turn_phases
from replication.records import Recording
from replication.signature import FloatArray

NORMAL_95 = 1.96  # half width over SD of a 95 % interval
MOTOR_ORDERS = (
    1,
    2,
    6,
)  # of the motor's turn: encoders err once and twice, torques ripple with the phases


@dataclass(frozen=True)
class TorqueSettings:
    """Constants of the method, each with its source.

    "Benches" are the joints of `studies.benches`; the limits were fixed on logs of other seeds than the datasheet's.
    """

    driven_hz: float = 300.0  # of the motion that drives the load: five times the fastest ring
    fitted_hz: float = (
        100.0  # of the torque that is compared: beyond, benches' logs hold noise alone
    )
    rings_hz: tuple[float, float] = (10.0, 60.0)  # industrial joints: 8 to 60 Hz
    step_s: float = 7e-4  # an eighth of a radian of a ring of 30 Hz
    most_harmonics: int = 80
    search_harmonics: int = 20  # with few harmonics the misfit has few minima
    least_harmonics: int = 12  # more numbers than unknowns
    # Of the torque: cogging's side bands, friction that is not constant. In the search the load's data are still wrong.
    model_error: float = 0.02
    search_model_error: float = 0.1
    loss_smoothing: float = 0.01  # of gravity, within which the loss changes its sign

    # Means and SDs of the priors; industrial joints ring at 10 to 50 Hz with damping ratios of 0.01 to 0.1,
    # filters lag by 0.2 to 1.5 ms, and gears lose 2 to 30 % (data sheets of strain wave and cycloidal gears).
    ring_hz: float = 22.0
    damping: float = 0.04
    lag_ms: float = 0.7
    loss: float = 0.05
    stiffness_sd: float = 1.5
    damping_sd: float = 0.5
    friction_sd: float = 0.3
    lag_sd_ms: float = 0.5
    delay_sd_ms: float = 2.0
    loss_sd: float = 0.15
    negative_friction: float = 10.0  # times the weight of a positive one
    friction_beyond_sd: float = 0.05  # by which the load's friction may exceed all friction

    starts_mrad: tuple[float, ...] = (0.0, 0.05, 0.15, 0.3, 0.5, 0.8, 1.2, 1.7, 2.4)
    start_rings: int = 9
    start_frictions: tuple[float, ...] = (0.02, 0.25, 0.5, 0.75, 0.95)  # of all friction
    finalists: int = 6
    # Beside the best: steps of 6 % of the backlash and 0.02 mrad, and of ln K.
    neighbours: tuple[tuple[float, float], ...] = tuple(
        product((1.0, -1.0), (0.15, -0.15, 0.45, -0.45))
    )
    most_rounds: int = 4
    most_steps: int = 100  # of a descent; most need 15
    overlap_mrad: float = 0.01  # a gap that is less than none by more is no joint's

    # Errors beyond what noise explains: on 20 benches of a seed of their own the errors' SD was 0.55 of that with 0.07.
    method_error: float = 0.05
    least_sd_rad: float = 5e-6  # half a count of 19 bits
    most_sd: float = 0.15  # over the backlash: a wider interval is no answer
    most_chi2: float = 3.0  # per compared number; on benches below 2
    most_chi2_of_none: float = 1.5  # noise alone exceeds this in 3 of 10,000 logs
    most_off: float = 3.5  # SDs of the load's data and of the loss
    most_delay_ms: float = 3.0  # a current loop's and a filter's are below
    most_change: float = (
        0.03  # of gravity's torque from turn to turn: a backlash that is off by as much is covered
    )
    most_ripple: float = 0.1  # acceleration over gravity's; cogging and encoders make a third of it
    least_gravity: float = 10.0  # of the torque once a turn, in its SDs
    # Chi squared that a backlash must lose to another to be excluded, five SDs, and to be as good, three.
    clear: float = 25.0
    rival: float = 9.0
    negligible_rad: float = 5e-5  # 0.015 mm at an arm of 0.3 m; less is "no backlash"


SETTINGS = TorqueSettings()
_NO_ORBIT = 1e6  # residuals where the load runs away
# The longest steps of a descent, by the places of the unknowns.
_LONGEST_STEP = np.array([0.3, 0.5, 1.0, 0.2, 0.1, 0.2, 1.0, 0.2, 0.2, 1.0, 0.1])


@dataclass(frozen=True)
class TorqueFit:
    """The joint that speed and torque tell of."""

    delta_rad: float  # half of the play
    interval_rad: tuple[float, float]  # 95 %
    sd_rad: float
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
    ripple: float  # acceleration that comes with the motor's turns [rad/s^2 of the load]


class Problem(NamedTuple):
    """Least squares in the unknowns: the numbers that are compared, and the priors."""

    compared: Comparison
    mean: FloatArray
    sd: FloatArray
    most_friction: float  # of the load: all friction

    def residuals(
        self, theta: FloatArray, start: FloatArray, wants_slopes: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Residuals over their SDs, those of the priors below; huge ones where there is no periodic orbit."""
        weight = 1 / self.sd
        weight[FRICTION] *= 1 if theta[FRICTION] > 0 else SETTINGS.negative_friction
        beyond = max(theta[FRICTION] - self.most_friction, 0) / SETTINGS.friction_beyond_sd
        prior = np.append((theta - self.mean) * weight, beyond)
        by_prior = np.vstack([np.diag(weight), np.zeros(theta.size)])
        by_prior[-1, FRICTION] = (beyond > 0) / SETTINGS.friction_beyond_sd
        orbit = start.copy()
        solved = residuals(theta, self.compared, orbit, wants_slopes)
        if solved is None:
            count = 2 * self.compared.order.size
            return np.full(count + prior.size, _NO_ORBIT), np.zeros(
                (count + prior.size, theta.size)
            )
        start[:] = orbit
        return np.concatenate([solved[0], prior]), np.vstack([solved[1], by_prior])

    def chi2(self, theta: FloatArray, start: FloatArray) -> float:
        """Sum of the squared residuals, priors included."""
        return float(np.square(self.residuals(theta, start)[0]).sum())

    def descend(self, candidate: Candidate, holds_delta: bool = False) -> Candidate:
        """Least squares by Levenberg and Marquardt, no step longer than a bounce of the teeth."""
        theta, start = candidate.theta, candidate.start.copy()
        free = slice(1 if holds_delta else 0, None)
        left, slopes = self.residuals(theta, start, True)
        chi2, damping = left @ left, 1e-3
        if left[0] == _NO_ORBIT:
            return candidate._replace(chi2=float(chi2))
        for _ in range(SETTINGS.most_steps):
            curvature = slopes[:, free].T @ slopes[:, free]
            # A load that never touches its gap's sides has no slope by the backlash.
            damped = curvature + damping * np.diag(np.maximum(np.diag(curvature), 1e-6))
            step = np.zeros(theta.size)
            step[free] = -np.linalg.solve(damped, slopes[:, free].T @ left)
            longest = np.abs(step / _LONGEST_STEP).max()
            moved, orbit = theta + step / max(longest, 1.0), start.copy()
            tried = self.residuals(moved, orbit, True)
            if (lower := tried[0] @ tried[0]) < chi2:
                theta, start, chi2 = moved, orbit, lower
                left, slopes = tried
                damping = max(0.2 * damping, 1e-9)
            else:
                damping *= 5.0
            if longest < 1e-6 or damping > 1e6:
                break
        return Candidate(theta, start, float(chi2))

    def covariance(self, candidate: Candidate) -> FloatArray:
        """Covariance of the unknowns, if the model is right."""
        slopes = self.residuals(candidate.theta, candidate.start.copy(), True)[1]
        return np.asarray(np.linalg.inv(slopes.T @ slopes))


def measure_turn(recording: Recording, torque: FloatArray) -> MeasuredTurn:
    """Harmonics of the mean turn; Refusal where they cannot tell the backlash."""
    gear_ratio = recording.commanded_speed_rps * recording.turn_period_s
    speed = harmonics(recording, TURN / gear_ratio * recording.v, SETTINGS.driven_hz)
    of_torque = harmonics(recording, torque, SETTINGS.driven_hz)
    gravity = abs(of_torque.coefficient[0])
    if gravity < SETTINGS.least_gravity * of_torque.sd[0] or torque.mean() < 0:
        significance = gravity / of_torque.sd[0]
        raise Refusal(
            f"once a turn the torque has {2 * gravity:.3g} in the log's unit, {significance:.1f} SDs "
            f"({SETTINGS.least_gravity:g} are needed), its mean is {torque.mean():.3g}; is it this motor's, "
            "positive where it drives forward, and the axis horizontal?",
            Reason.NO_GRAVITY,
        )
    orders = gear_ratio * np.array(
        MOTOR_ORDERS if gear_ratio > 1.5 else ()
    )  # the joint's side has none
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
    return MeasuredTurn(
        speed, of_torque, used, gear_ratio, friction, _ripple(recording) / gear_ratio
    )


def _ripple(recording: Recording) -> float:
    """Largest acceleration [rad/s^2] at orders 1 to 6 of the motor's turn, but for those that sampling folds low."""
    if recording.commanded_speed_rps * recording.turn_period_s < 1.5:  # the joint's side
        return 0.0
    order = np.arange(1, 7, 0.5)  # those between tell the noise
    speed, dt = TURN * recording.v, recording.sample_s
    waves = np.exp(-1j * np.outer(order, np.cumsum(speed) * dt))
    size = 2 / speed.size * np.abs((waves * (speed - speed.mean())).sum(axis=1))
    above_noise = np.maximum(size[::2] - 3 * np.median(size[1::2]), 0)
    hz = order[::2] * recording.commanded_speed_rps
    is_own = np.abs(hz - np.round(hz * dt) / dt) > SETTINGS.rings_hz[1]
    return float((TURN * hz * above_noise * is_own).max())


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
    mean = np.zeros(len(UNKNOWNS))
    sd = np.full(len(UNKNOWNS), np.inf)
    mean[STIFFNESS], sd[STIFFNESS] = 2 * np.log(TURN * s.ring_hz), s.stiffness_sd
    mean[DAMPING], sd[DAMPING] = np.log(s.damping), s.damping_sd
    mean[FRICTION], sd[FRICTION] = 0, s.friction_sd
    mean[PHASE] = np.angle(1j * weight)
    mean[GRAVITY], sd[GRAVITY] = np.log(g), load.gravity_sd + 1e-3
    mean[LAG], sd[LAG] = s.lag_ms, s.lag_sd_ms
    mean[RATIO], sd[RATIO] = np.log(rho), load.inertia_sd + 1e-3
    mean[DRIVE] = np.log(drive)
    mean[DELAY], sd[DELAY] = 0, s.delay_sd_ms
    mean[LOSS], sd[LOSS] = s.loss, s.loss_sd
    used = turn.used & (turn.speed.order <= harmonics)
    compared = compare(turn.speed, turn.torque, used, model_error, step_s, s.loss_smoothing * g)
    return Problem(compared, mean, sd, turn.friction)


def search(problem: Problem, rough: Problem) -> list[Candidate]:
    """The ends of descents from many backlashes, stiffnesses and frictions, the best first."""
    s = SETTINGS
    rings = 2 * np.log(TURN * np.geomspace(*s.rings_hz, s.start_rings))
    frictions = np.array(s.start_frictions) * min(problem.most_friction, 0.9)
    starts = [
        min((_place(rough, delta, ring, friction) for ring in rings), key=_chi2)
        for delta, friction in product(s.starts_mrad, frictions)
    ]
    ends = _distinct([rough.descend(start) for start in starts])
    found = [problem.descend(end) for end in ends[: s.finalists]]
    if not any(map(_is_physical, found)):
        found.append(hold_delta(problem, min(found, key=_chi2), 0.0))
    best = min(filter(_is_physical, found), key=_chi2)
    for _ in range(s.most_rounds):
        found += [problem.descend(_move(best, *step)) for step in s.neighbours]
        before, best = best, min(filter(_is_physical, found), key=_chi2)
        if best.chi2 > before.chi2 - 1e-3:
            break
    return _distinct(found)


def _place(problem: Problem, delta_mrad: float, ring: float, friction: float) -> Candidate:
    """The usual joint but for its backlash, stiffness and friction."""
    theta, start = problem.mean.copy(), np.zeros(2)
    theta[[DELTA, STIFFNESS, FRICTION]] = delta_mrad, ring, friction
    return Candidate(theta, start, problem.chi2(theta, start))


def _is_physical(candidate: Candidate) -> bool:
    """Whether its gap is one, or none but for what rounding leaves."""
    return bool(candidate.theta[DELTA] >= -SETTINGS.overlap_mrad)


def _move(candidate: Candidate, steps: float, stiffer: float) -> Candidate:
    """A joint beside another: its backlash some steps on, and stiffer by a factor's logarithm."""
    theta = candidate.theta.copy()
    theta[DELTA] += steps * (0.06 * abs(theta[DELTA]) + 0.02)
    theta[STIFFNESS] += stiffer
    return candidate._replace(theta=theta)


def _chi2(candidate: Candidate) -> float:
    return candidate.chi2


def _distinct(candidates: list[Candidate]) -> list[Candidate]:
    """The best first, each but once."""
    kept: list[Candidate] = []
    for candidate in sorted(candidates, key=_chi2):
        if all(
            np.abs((candidate.theta - each.theta) / _LONGEST_STEP).max() > 0.03 for each in kept
        ):
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
    candidates = search(problem, rough)
    best, *rivals = filter(_is_physical, candidates)
    count = 2 * problem.compared.order.size
    misfit = max(best.chi2 / count, 1.0)
    covariance = misfit * problem.covariance(best)
    _check_joint(problem, best, covariance, best.chi2 / count)
    if candidates[0].chi2 < best.chi2 - s.clear * misfit:
        overlap = f"a gap of {candidates[0].theta[DELTA]:.2g} mrad, less than none, fits best"
        raise Refusal(f"{overlap}; are the load's data right?", Reason.NO_FIT)

    delta = 1e-3 * float(best.theta[DELTA])
    sd = float(np.hypot(1e-3 * np.sqrt(covariance[DELTA, DELTA]), s.method_error * delta))
    sd = float(np.hypot(sd, s.least_sd_rad))
    interval = max(delta - NORMAL_95 * sd, 0.0), max(delta + NORMAL_95 * sd, 0.0)
    is_none = interval[1] < s.negligible_rad
    low, high = (-np.inf, s.negligible_rad) if is_none else interval
    for rival in rivals:
        if (
            rival.chi2 < best.chi2 + s.rival * misfit
            and not low <= 1e-3 * rival.theta[DELTA] <= high
        ):
            both = f"{rival.theta[DELTA]:.2g} mrad fits nearly as well as {1e3 * delta:.2g} mrad"
            raise Refusal(f"{both}; {_ADVICE}", Reason.AMBIGUOUS)
    excluded_rad = s.negligible_rad if is_none else 0.0
    if is_none and misfit > s.most_chi2_of_none:
        none = f"none fits best, but not well (chi squared {misfit:.2g})"
        raise Refusal(
            f"{none}; does the gear's error part the teeth, or another axis move?", Reason.NO_FIT
        )
    if not is_none and sd > s.most_sd * delta:
        raise Refusal(
            f"the backlash is not known within {s.most_sd:.0%}; {_ADVICE}", Reason.TOO_NOISY
        )
    if hold_delta(problem, best, 1e3 * excluded_rad).chi2 - best.chi2 < s.clear * misfit:
        also = f"{1e3 * excluded_rad:g} mrad fits nearly as well as {1e3 * delta:.2g} mrad"
        raise Refusal(f"{also}; {_ADVICE}", Reason.AMBIGUOUS)
    return TorqueFit(
        delta_rad=delta,
        interval_rad=interval,
        sd_rad=sd,
        is_none=is_none,
        chi_squared=best.chi2 / count,
        joint=describe_joint(best.theta, np.sqrt(np.diag(covariance)), turn.gear_ratio),
        model_torque=_model_torque(recording, torque, problem, best),
    )


def _check_movement(
    recording: Recording, torque: FloatArray, turn: MeasuredTurn, load: LoadData
) -> None:
    """Refuse a movement whose turns differ, or in which the teeth may not part, or part by the gear's error."""
    by_turn = gravity_by_turn(recording, torque)
    change = max(by_turn.real.std(), by_turn.imag.std()) / abs(by_turn.mean())
    if change > SETTINGS.most_change:
        raise Refusal(
            f"gravity's torque changes by {change:.0%} from turn to turn; does another axis move?",
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
            f"a ripple with the motor's turns is {ripple:.0%} of gravity; does the gear's error part the teeth?",
            Reason.NO_FIT,
        )


def _check_joint(
    problem: Problem, best: Candidate, covariance: FloatArray, chi_squared: float
) -> None:
    """Refuse what no joint of the model is."""
    s = SETTINGS
    off = (best.theta - problem.mean) / problem.sd
    delay = float(best.theta[DELAY])
    if chi_squared > s.most_chi2 or np.abs(off[[GRAVITY, RATIO, LOSS]]).max() > s.most_off:
        raise Refusal(
            f"no joint fits speed and torque (chi squared {chi_squared:.2g}, gravity {off[GRAVITY]:+.1f} and inertia "
            f"ratio {off[RATIO]:+.1f} SDs off, gear loss {best.theta[LOSS]:.0%}, torque {delay:.1f} ms late); are the "
            "load's data right? is there a belt, another axis, or an error of the gear?",
            Reason.NO_FIT,
        )
    if abs(delay) - NORMAL_95 * np.sqrt(covariance[DELAY, DELAY]) > s.most_delay_ms:
        when = "late" if delay > 0 else "early"
        raise Refusal(
            f"the torque comes {abs(delay):.2g} ms too {when}; log it at the same instants as the speed",
            Reason.NO_FIT,
        )


def describe_joint(
    theta: FloatArray, sd: FloatArray, gear_ratio: float
) -> dict[str, tuple[float, float]]:
    """Quantities of the joint with their SDs; a logarithm's SD is a share."""

    def from_log(place: int, factor: float = 1.0) -> tuple[float, float]:
        value = float(factor * np.exp(theta[place]))
        return value, float(value * sd[place])

    def plain(place: int) -> tuple[float, float]:
        return float(theta[place]), float(sd[place])

    return {
        "stiffness_per_s2": from_log(STIFFNESS),
        "damping_ratio": from_log(DAMPING),
        "friction_share": plain(FRICTION),
        "loss": plain(LOSS),
        "gravity_per_s2": from_log(GRAVITY),
        "inertia_ratio": from_log(RATIO),
        "motor_inertia": from_log(DRIVE, 1 / gear_ratio),
        "torque_delay_ms": plain(DELAY),
        "speed_lag_ms": plain(LAG),
    }


def _model_torque(
    recording: Recording, torque: FloatArray, problem: Problem, best: Candidate
) -> FloatArray:
    """The model's torque at the samples; its mean, which holds the motor's friction, is the log's."""
    predicted = solve_load(best.theta, problem.compared, best.start.copy(), False)
    if predicted is None:  # the best candidate has an orbit
        return np.full(torque.size, np.nan)
    wave = periodic(predicted.torque, problem.compared.order, turn_phases(recording))
    return np.asarray(torque.mean() + wave)
