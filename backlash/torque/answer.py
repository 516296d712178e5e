"""The answer of a fit: which movements and joints are refused, the gap's interval, and what "no backlash" needs."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.special import ndtr

from backlash.answer import TORQUE_SIGNAL, Trace
from backlash.load_data import LoadData
from backlash.refusals import Reason, Refusal
from backlash.torque.load import (
    DELAY,
    DELTA,
    FILTER,
    GRAVITY,
    INERTIA,
    LOSS,
    RATIO,
    SHARE,
    SOFT,
    STIFFNESS,
)
from backlash.torque.problem import (
    FINE,
    ROUGH,
    Movement,
    Problem,
    measure_turn,
    state_problem,
    weigh_prior,
)
from backlash.torque.problem import SETTINGS as COMPARISON
from backlash.torque.search import Candidate, descend, evaluate_beside, hold_delta, search
from backlash.torque.strokes import measure_strokes, state_strokes, trace_strokes
from backlash.torque.unknowns import IS_LOGARITHM, NAMES, TABLE
from backlash.turns import end_by_gravity, is_to_and_fro, periodic, settled_turns, turn_phases
from replication.records import Recording
from replication.signature import FloatArray

NORMAL_95 = 1.96  # half width over SD of a 95 % interval


@dataclass(frozen=True)
class AnswerLimits:
    """Errors beyond the noise, and what is refused, each with its reason; "joints" are simulated ones."""

    # Errors of the model beyond noise, by which the stated SD is that of the errors on joints: a share of the gap, and
    # one of the soft part, which bends rather than breaks, or stands for what else the model lacks.
    method_error: float = 0.025
    soft_error: float = 0.05
    # Joints without soft teeth are fitted with a soft part of about this size.
    least_soft_sd_mrad: float = 0.1
    least_sd_rad: float = 5e-6  # half a count of 19 bits
    most_sd: float = 0.2  # over the backlash: a wider interval is no answer
    most_misfit: float = 3.1  # SDs of chi squared; noise alone exceeds this in one of 1000 logs
    # Right fits of joints stay below; a soft part may stand for other errors, and what was given of the load must not
    # be far from what the log tells, for the gap goes with it.
    most_prior_residual: float = 3.5
    most_soft_residual: float = 6.0
    most_load_residual: float = 2.5
    most_delay_ms: float = 5.0  # a current loop's and a bus's are below
    usual_low_pass_ms: float = (
        3.0  # of a drive's current; a slower torque may be filtered or a mean
    )
    most_change: float = 0.03  # of gravity by turns: a backlash that errs by as much is covered
    # Odd against even turns over gravity, and the times of gravity's line: joints stay below a third of these limits.
    # Another axis of 2 % of gravity at 0.5 or 1.5 times the turn, and a clock that wanders by 3 ms, exceed them.
    most_odd_against_even: float = 0.006
    most_scatter_s: float = 1e-3
    # Acceleration of a line over gravity's: joints stay below half of it, unless the drive hums; a gear's error of
    # 0.5 mrad a hundred times a turn reaches about as much, if it is sampled at all.
    most_ripple: float = 0.1
    # Chi squared that a backlash must lose to another to be excluded, four SDs, where healthy joints stay below 4.
    clear: float = 16.0
    rival: float = 16.0
    # Over what noise alone has: by so much model errors move chi squared of one minimum against another's.
    between_minima: float = 2.0
    # Harmonics of the speed beyond four SDs: without them nothing but what was given of the load tells the gap's scale.
    least_lines: int = 2
    line_sds: float = 4.0
    # Running means of speed and torque that are tried, for all from 11 to 20 ms; chi squared by which one may fit less,
    # and half widths of the interval from which on its backlash is another: those of joints lie within 1.25.
    means_s: tuple[float, ...] = (0.012, 0.016)
    rival_mean: float = 6.0
    other_backlash: float = 1.25
    negligible_rad: float = 5e-5  # 0.015 mm at an arm of 0.3 m; less is "no backlash"


LIMITS = AnswerLimits()
_MOST_RESIDUAL = np.full(len(TABLE), LIMITS.most_prior_residual)
_MOST_RESIDUAL[SOFT] = LIMITS.most_soft_residual
_MOST_RESIDUAL[[GRAVITY, RATIO]] = LIMITS.most_load_residual
# Running means of a torque that are looked for; shorter ones a low-pass follows.
_LEAST_MEAN_S, _LONGEST_MEAN_S = 0.009, 0.080
_LEAST_MEAN_SAMPLES = 4  # with two holes; one may be between two lines
_HOLES = 3  # that are asked
_HALF_HOLE = 0.12  # of the way to the lobe: at its edge a mean leaves a fourteenth of a lobe
_MOST_IN_A_HOLE = 0.1
_ADVICE = "turn the joint faster (twice as fast, about half the SD), log more turns, or with a finer encoder"


@dataclass(frozen=True)
class TorqueFit:
    """The joint that speed and torque tell of."""

    delta_rad: float  # half of the play
    interval_rad: tuple[float, float]  # 95 %
    is_none: bool  # the backlash is negligible, and one that is not fits clearly worse
    chi_squared: float  # per compared number
    joint: dict[str, tuple[float, float]]  # quantities of the joint, each with its SD
    trace: Trace  # the torque, up to 100 Hz
    strokes: str  # which, in words; none of turns


@np.errstate(all="ignore")  # trials far from any joint
def fit_torque(recording: Recording, torque: FloatArray, load: LoadData) -> TorqueFit:
    """Find the backlash from the motor's speed and torque; Refusal where they do not tell it.

    The torque, shape (samples,), is the motor's at the same samples, positive where it drives forward, in any unit, as
    its current.
    """
    measured, state, trace = measure(recording, torque)
    check_movement(measured.movement, load)
    problem = state(measured, load)
    best, *others = _put_joint_first(problem, search(problem, state(measured, load, ROUGH)))
    scale = problem.scale(best.chi2)
    covariance = scale * _covariance(problem, best)
    _check_joint(problem, best, covariance)
    rivals = [each for each in others if each.chi2 < best.chi2 + LIMITS.rival * scale]
    interval, is_none = _pool_intervals(problem, best, covariance, rivals, scale)
    excluded_rad = LIMITS.negligible_rad if is_none else 0.0
    clear = best.chi2 + LIMITS.clear * scale
    if not is_none:
        _check_speed(problem)
    if hold_delta(problem, best, 1e3 * excluded_rad, clear).chi2 < clear:
        also = f"{1e3 * excluded_rad:g} mrad fits nearly as well as {1e3 * best.delta_rad:.2g} mrad"
        raise Refusal(f"{also}; {_ADVICE}", Reason.AMBIGUOUS)
    for mean_s in LIMITS.means_s:
        left = state(measured, load, FINE._replace(mean_s=mean_s))
        undone = state(measured, load, FINE._replace(mean_s=mean_s, is_undone=True))
        _refuse_mean(left, undone, mean_s, best, interval)
    return TorqueFit(
        delta_rad=0.0 if is_none else best.delta_rad,
        interval_rad=interval,
        is_none=is_none,
        chi_squared=best.chi2 / problem.size,
        joint=_quantities(
            problem, best, covariance, rivals, scale, measured.movement.gear_ratio, is_none
        ),
        trace=trace(problem, best),
        strokes=measured.movement.strokes,
    )


def measure(
    recording: Recording, torque: FloatArray
) -> tuple[Any, Callable[..., Problem], Callable[[Problem, Candidate], Trace]]:
    """The mean turn, or mean strokes, what states their problem, of a load, and what traces a joint's torque."""
    if is_to_and_fro(recording.v):
        strokes = measure_strokes(recording, torque)
        for each in strokes.means:
            refuse_averaged_rows(each.torques, strokes.sample_s)
        return strokes, state_strokes, partial(trace_strokes, strokes)
    settled, settled_torque = end_by_gravity(recording, torque)
    trace = partial(_trace_turns, recording, torque, settled.t.size)
    return measure_turn(settled, settled_torque), state_problem, trace


def _put_joint_first(problem: Problem, ends: list[Candidate]) -> list[Candidate]:
    """The ends, first the lowest that a joint can be, if it fits nearly as well as the lowest of all.

    Of strokes it may fit as well as noise lets it; what is no joint, and far lower, is left out.
    """
    rival = LIMITS.rival * problem.scale(ends[0].chi2)
    most = max(ends[0].chi2 + rival, problem.minima.fitting * problem.size)
    for each in ends:
        distances = np.abs(problem.prior_residuals(each.theta)) / _MOST_RESIDUAL
        if each.chi2 < most and distances.max() < 1:
            others = (other for other in ends if other is not each)
            return [each, *(other for other in others if other.chi2 > each.chi2 - rival)]
    return ends


# ---------------------------------------------------------------------------------------------------- the interval


def _covariance(problem: Problem, best: Candidate) -> FloatArray:
    """The unknowns' covariance, by the priors as they are above zero."""
    slopes, _ = problem.compared.differentiate(best.orbit)
    hessian, _ = weigh_prior(best.theta, np.maximum(best.theta, 1e-9), problem.prior)
    return np.asarray(np.linalg.inv(slopes.T @ slopes + hessian))


def _deviations(theta: FloatArray, covariance: FloatArray) -> tuple[float, float, float]:
    """The gap, and its SDs below and above it [rad].

    A gap and a soft part take each other's place, and other errors of the model look like a soft part. As no soft part
    is less than none, the gap exceeds the best one by no more than the best soft part makes room for, and by the errors
    of a gap beside a soft part that is known.
    """
    delta, soft = np.maximum(1e-3 * theta[[DELTA, SOFT]], 0).tolist()
    soft_sd = 1e-3 * np.sqrt(covariance[SOFT, SOFT])
    slope = covariance[DELTA, SOFT] / covariance[SOFT, SOFT]
    beside = 1e-6 * (covariance[DELTA, DELTA] - slope * covariance[DELTA, SOFT])
    errors = LIMITS.method_error * delta, LIMITS.least_sd_rad + LIMITS.soft_error * soft
    sd = np.sqrt(beside + np.square(errors).sum())
    most = min(max(soft_sd, 1e-3 * LIMITS.least_soft_sd_mrad), soft)
    return delta, float(np.hypot(sd, slope * soft_sd)), float(np.hypot(sd, slope * most))


def _interval_of(minima: list[tuple[float, float, float]], weight: FloatArray) -> FloatArray:
    """The ends [rad] that hold 95 % of minima as likely as their weights, each a normal law with an SD a side."""
    delta, below, above = np.array(minima).T
    grid = np.linspace(0.0, (delta + 4 * above).max(), 4001)
    distance = grid[:, None] - delta
    share = ndtr(distance / np.where(distance < 0, below, above)) @ (weight / weight.sum())
    return np.interp(ndtr([-NORMAL_95, NORMAL_95]), share, grid)


def _weigh(best: Candidate, rivals: list[Candidate], scale: float) -> FloatArray:
    """How likely each minimum is, the best one first, over the best one."""
    more = np.array([each.chi2 - best.chi2 for each in (best, *rivals)])
    return np.exp(-0.5 * more / (LIMITS.between_minima * scale))


def _pool_intervals(
    problem: Problem, best: Candidate, covariance: FloatArray, rivals: list[Candidate], scale: float
) -> tuple[tuple[float, float], bool]:
    """The interval over all minima that fit nearly as well, and whether it is of no backlash; Refusal if too wide."""
    minima = [_deviations(best.theta, covariance)]
    minima += [_deviations(each.theta, scale * _covariance(problem, each)) for each in rivals]
    weight = _weigh(best, rivals, scale)
    own, (low, high) = (_interval_of(minima[:k], weight[:k]).tolist() for k in (1, len(minima)))
    is_none = own[1] < LIMITS.negligible_rad
    widest = 2 * NORMAL_95 * LIMITS.most_sd * best.delta_rad
    if is_none:
        # None has no rival that is not negligible, however unlikely.
        own[0] = low = 0.0
        widest = LIMITS.negligible_rad
        high = max(own[1], *(delta for delta, *_ in minima))
    if own[1] - own[0] > widest:
        unknown = f"the backlash is not known within {LIMITS.most_sd:.0%}"
        raise Refusal(f"{unknown}; {_ADVICE}", Reason.TOO_NOISY)
    if high - low > widest:
        ends = f"{1e3 * low:.2g} to {1e3 * high:.2g}"
        also = f"backlashes of {ends} mrad fit nearly as well as {1e3 * best.delta_rad:.2g} mrad"
        raise Refusal(f"{also}; {_ADVICE}", Reason.AMBIGUOUS)
    return (low, high), is_none


# ------------------------------------------------------------------------------------------------- what is refused


def check_movement(movement: Movement, load: LoadData) -> None:
    """Refuse a movement whose passes differ, or in which the teeth may not part, or part by the gear's error."""
    passes = "stroke" if movement.strokes else "turn"
    ripple = movement.ripple / (load.gravity_per_s2 * load.inertia_ratio)
    for is_beyond, reason, sentence in (
        (
            movement.change > LIMITS.most_change,
            Reason.NOT_PERIODIC,
            f"the torque's line of gravity changes by {movement.change:.0%} from {passes} to {passes}; is it "
            "gravity's, or does another axis move?",
        ),
        (
            movement.odd_against_even > LIMITS.most_odd_against_even,
            Reason.NOT_PERIODIC,
            f"odd and even {passes}s differ by {movement.odd_against_even:.1%} of gravity; does another axis, "
            "or something in the gear, turn at half this joint's rate? hold all other axes still",
        ),
        (
            movement.scatter_s > LIMITS.most_scatter_s,
            Reason.NOT_PERIODIC,
            f"gravity's line comes {1e3 * movement.scatter_s:.2g} ms early or late by the {passes}; does the log's "
            "clock wander, or does another axis move?",
        ),
        (
            movement.friction > 1.0,
            Reason.NO_REVERSAL,
            f"the mean torque, {movement.friction:.2f} of gravity's, may hold the teeth on one flank; the test needs "
            "an off-centre load whose gravity exceeds friction and losses, and a horizontal axis",
        ),
        (
            ripple > LIMITS.most_ripple,
            Reason.NO_FIT,
            f"a line of the speed is a ripple of {ripple:.0%} of gravity; does the gear's error part the teeth, or "
            "does the drive hum?",
        ),
    ):
        if is_beyond:
            raise Refusal(sentence, reason)


def refuse_averaged(recording: Recording, torque: FloatArray) -> None:
    """Refuse a torque of turns that is a running mean."""
    rows = settled_turns(recording, torque)
    refuse_averaged_rows(rows, recording.turn_period_s / rows.shape[1])


def refuse_averaged_rows(rows: FloatArray, sample_s: float) -> None:
    """Refuse a torque, shape (passes, samples), that is a running mean, which no low-pass of the fit follows.

    A mean over T leaves nothing of the frequencies 1/T, 2/T, ..., neither of noise nor of a ring: what passes differ by
    has holes there.
    """
    differences = np.diff(rows, axis=0).ravel()
    power = np.abs(np.fft.rfft(differences * np.hanning(differences.size))) ** 2
    shortest = max(2 * _LEAST_MEAN_S / sample_s, 2 * _LEAST_MEAN_SAMPLES)
    means = np.arange(np.ceil(shortest), 2 * _LONGEST_MEAN_S / sample_s) / 2  # [samples]
    filled = [_largest_hole(power, samples) for samples in means]
    if min(filled, default=1.0) < _MOST_IN_A_HOLE:
        mean_s = means[np.argmin(filled)] * sample_s
        raise Refusal(
            f"the torque is a running mean over {1e3 * mean_s:.0f} ms, which hides what the teeth do; log it as the "
            "drive measures it, or filtered by 3 ms at most",
            Reason.NO_FIT,
        )


def _largest_hole(power: FloatArray, samples: float) -> float:
    """Power where a mean over some samples leaves none, over that halfway to the next such place: the largest of three.

    Holes are at the even numbers of half a period in the mean, the lobes between them at the odd ones.
    """
    place = np.linspace(0.0, samples, power.size)
    nearest = np.rint(place).astype(int)
    is_used = (np.abs(place - nearest) < _HALF_HOLE) & (nearest <= 2 * _HOLES + 1)
    nearest = nearest[is_used]
    mean = np.bincount(nearest, power[is_used]) / np.bincount(nearest)
    holes, lobes = mean[2::2], np.append(mean[1::2], np.inf)
    beside = np.minimum(lobes[: holes.size], lobes[1 : holes.size + 1])
    return float((holes / beside).max())


def _refuse_mean(
    left: Problem, undone: Problem, mean_s: float, best: Candidate, interval: tuple[float, float]
) -> None:
    """Refuse where another backlash fits nearly as well, had speed and torque gone through a running mean.

    That leaves what is linear as it is, and only makes the gap smaller.
    """
    if any(window.order.size < COMPARISON.least_harmonics for window in left.compared.windows):
        return
    own, other = (
        descend(each, evaluate_beside(each, best, best.theta), 1e-4) for each in (left, undone)
    )
    fits = other.chi2 < own.chi2 + LIMITS.rival_mean
    low, high = best.delta_rad + LIMITS.other_backlash * (np.array(interval) - best.delta_rad)
    if fits and not low <= other.delta_rad <= high:
        raise Refusal(
            f"if speed and torque are means over some {1e3 * mean_s:.0f} ms, {1e3 * other.delta_rad:.2g} mrad fits as "
            f"well as {1e3 * best.delta_rad:.2g} mrad; log what the drive measures, not what it averages",
            Reason.AMBIGUOUS,
        )


def _check_speed(problem: Problem) -> None:
    """Refuse a speed whose noise hides what the teeth do."""
    lines = sum(
        int((np.abs(c.acceleration) > LIMITS.line_sds * c.omega * c.speed_sd).sum())
        for c in problem.compared.windows
    )
    if lines < LIMITS.least_lines:
        raise Refusal(
            f"the speed's noise leaves {lines} of its harmonics ({LIMITS.least_lines} are needed); {_ADVICE}",
            Reason.TOO_NOISY,
        )


def _check_joint(problem: Problem, best: Candidate, covariance: FloatArray) -> None:
    """Refuse what no joint of the model is."""
    distances, delay = problem.prior_residuals(best.theta), float(best.theta[DELAY])
    is_bad = problem.misfit(best.chi2) > LIMITS.most_misfit
    is_late = abs(delay) - NORMAL_95 * np.sqrt(covariance[DELAY, DELAY]) > LIMITS.most_delay_ms
    if is_late and not is_bad:
        when = "late" if delay > 0 else "early"
        raise Refusal(
            f"the torque comes {abs(delay):.2g} ms too {when}; log it at the same instants as the speed",
            Reason.NO_FIT,
        )
    shares = np.abs(distances) / _MOST_RESIDUAL
    largest = int(shares.argmax())
    off = [
        f"{NAMES[place].removeprefix('ln_').replace('_', ' ')} {distances[place]:+.1f}"
        for place in dict.fromkeys((largest, GRAVITY, RATIO))
    ]
    low_pass = float(best.theta[FILTER])
    filtered = "is the torque filtered, or a mean of some samples? "
    if low_pass <= LIMITS.usual_low_pass_ms:
        filtered = ""
    if is_bad or shares[largest] > 1:
        raise Refusal(
            f"speed and torque disagree (chi squared {best.chi2 / problem.size:.2g}, {', '.join(off)} SDs off, "
            f"gear loss {best.theta[LOSS]:.0%}, torque {delay:.1f} ms late and low-passed by {low_pass:.1f} ms); "
            f"{filtered}are "
            "the load's data right? are all other axes held still, and is the arm stiff beside the payload (its "
            "first swing, at 6 to 15 Hz, usually refuses a wrist's log)? is there a belt, or an error of the gear?",
            Reason.NO_FIT,
        )


# --------------------------------------------------------------------------------------------------- what is printed


def _quantities(
    problem: Problem,
    best: Candidate,
    covariance: FloatArray,
    rivals: list[Candidate],
    scale: float,
    gear_ratio: float,
    is_none: bool,
) -> dict[str, tuple[float, float]]:
    """Quantities of the joint with their SDs: by noise, by the minima that fit nearly as well, by the model's errors.

    The stiffness is that up to gravity's torque: a stiffer spring beside a soft part fits as well. It and the damping
    are told by a ring that is compared, which harmonics of a slow turn do not reach. Friction is told by the instants
    at which teeth part, and they do not where there is no backlash.
    """
    values = np.array([_up_to_gravity(each.theta) for each in (best, *rivals)])
    slope, moves = np.eye(len(TABLE)), 1e-6 * np.eye(len(TABLE))
    ends = [
        (_up_to_gravity(best.theta + move), _up_to_gravity(best.theta - move)) for move in moves
    ]
    slope[STIFFNESS] = [(ahead - back)[STIFFNESS] / 2e-6 for ahead, back in ends]
    errors, shares = np.array([(each.error, each.share) for each in TABLE]).T
    weight = _weigh(best, rivals, scale)
    spread = weight @ (values - values[0]) ** 2 / weight.sum()
    sd = np.sqrt(shares**2 * np.diag(slope @ covariance @ slope.T) + spread + errors**2)
    theta = values[0] - np.log(gear_ratio) * (np.arange(len(TABLE)) == INERTIA)  # J_m of N J_m
    value = np.where(IS_LOGARITHM, np.exp(theta), theta)
    of_value = np.where(IS_LOGARITHM, value * sd, sd)
    rows = zip(TABLE, value.tolist(), of_value.tolist(), strict=True)
    joint = {unknown.printed: (each, own) for unknown, each, own in rows if unknown.printed}
    if is_none:
        del joint["friction_share"]
    fastest = max(float(window.omega[-1]) for window in problem.compared.windows)
    if fastest**2 < joint["stiffness_per_s2"][0]:
        del joint["stiffness_per_s2"], joint["damping_ratio"]
    return joint


def _up_to_gravity(theta: FloatArray) -> FloatArray:
    """The unknowns with the stiffness up to gravity's torque, that over its wind-up, in the place of the spring's."""
    g, K = np.exp(theta[[GRAVITY, STIFFNESS]])
    soft = 1e-3 * max(theta[SOFT], 0.0)
    wind_up = min(g / (theta[SHARE] * K), g / K + (1 - theta[SHARE]) * soft)
    return np.where(np.arange(theta.size) == STIFFNESS, np.log(g / wind_up), theta)


def _trace_turns(
    recording: Recording, torque: FloatArray, end: int, problem: Problem, best: Candidate
) -> Trace:
    """The torque at all samples and the model's, up to an end of which it was fitted, with the mean of the log's."""
    phases = turn_phases(recording, end)
    [turn], [window] = best.orbit.each, problem.compared.windows
    model = torque.mean() + periodic(turn.torque, window.order, phases)
    return Trace(recording.t, torque, model, TORQUE_SIGNAL)
