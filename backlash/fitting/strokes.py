"""The backlash of a joint that makes strokes to and fro across the vertical, from motor speed and motor torque.

Two inertias, spring, play and friction are driven by the logged torque, and an extended Kalman filter corrects them
by the logged speed. Its prediction errors, one sample ahead, are made least. What is known of the load, and wide
limits of what is not, are priors. Descents start at many plays, for the errors have several minima; the lowest one is
the answer, unless a play outside its interval fits nearly as well. The first steps hold the filter's gains: they depend
on the play, and slopes without that dependence lead a descent astray. Teeth meet smoothly, within a few microradians:
under a hard contact the errors are rough, so that rounding decides where a descent ends.

States, over the gear ratio where the motor's: motor speed, wind-up, load speed, logged speed, which lags.
The errors are taken ten times as large as they are, so that the priors outweigh what the model lacks: the drive's
timing, friction at low speed, cogging.
"""

from dataclasses import replace
from multiprocessing import parent_process
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import OptimizeResult, least_squares
from scipy.special import huber
from tqdm import tqdm

from backlash.fitting.torque import NORMAL_95, LoadData, TorqueFit, conclude
from replication.arrays import FloatArray
from replication.compiling import njit

_STEP_S = 5e-4  # of the integration, at most
# within which the teeth meet: in the search, and in the answer
_SOFT_RAD = 1.5e-5
_HARD_RAD = 4e-6
_SEARCH_S = 7.0  # of the log
_TEMPER = 10.0  # on the errors
_HUBER = 3.0  # SDs above which errors count linearly
# Share of the backlash that the method errs by: of the intervals on 68 fresh logs 94 % hold with it, 82 % without.
_METHOD_ERROR = 0.065
_LEAST_SD = 1e-5  # rad
_LEAST_CROSSINGS = 6
# delta [mrad], ln K, ln damping ratio, ln gravity, ln rho, ln (1 / J_m), gravity's phase, the speed's lag [ms];
# over gravity, the load's friction and viscosity, and the motor's, and its torque's offset.
_SD = np.array([np.inf, 1.0, 0.5, 0.05, 0.1, 0.3, 0.2, 0.7, 0.05, 0.02, 0.2, 0.2, 0.02])
_STEP = 1e-4  # of a parameter, for the slopes of the joint by it
_STIFFNESS = 1  # places of parameters
_LOAD = slice(3, 5)
_DRIVE = 5
_PHASE = 6
_FRICTION = 8
_MOTOR_FRICTION = 10
_PLAYS = np.geomspace(0.15, 2.2, 14)
_RINGS = np.array([-1.2, -0.5, 0.2, 0.9, 1.5])  # ln K, less its prior's mean: 12 to 47 Hz
_FRICTIONS = np.array([-0.015, 0.02])  # less the mean
_AGAIN = np.array([0.8, 0.93, 1.07, 1.25])  # of the best play
_SAME = 0.03  # share of the play within which two minima are one
_MOST_DESCENTS = 66
_RIVAL_COST = NORMAL_95**2 / 2  # above the least: within it lies a likelihood interval of 95 %
_FILTER = np.empty((0, 4))  # gains to hold: none, the filter's own are taken


class _Log(NamedTuple):
    """What the filter reads: speed at the samples; torque and angle in between, shape (samples - 1, steps)."""

    speed: FloatArray
    torque: FloatArray
    angle: FloatArray
    step_s: float
    running: float  # speed of the strokes
    # Power of the accelerations of motor and load, variance of the speed; unfiltered, SDs of speed and torque.
    noise: FloatArray
    soft_rad: float = 0.0  # within which the teeth meet


class _Joint(NamedTuple):
    """An angle of the load, seconds, torques over the load's inertia or, of the motor, over N^2 J_m."""

    delta: float
    stiffness: float
    damping: float
    gravity: float
    ratio: float
    drive: float  # 1 / (N J_m)
    phase: float
    lag_s: float
    friction: float
    viscosity: float
    motor_friction: float
    motor_viscosity: float
    offset: float


@njit(inner=True)
def _soft(over):
    """The part of a number above 0, smooth about it, and its slope."""
    if abs(over) > 36:  # as far as digits go
        return max(over, 0.0), 1.0 if over > 0 else 0.0
    small = np.exp(-abs(over))
    return max(over, 0.0) + np.log1p(small), (1.0 if over > 0 else small) / (1 + small)


@njit(inner=True)
def _press(joint, over, rate, soft_rad):
    """Torque between teeth that are over their touch by an angle; its slope by stiffness; the share of them in touch.

    Teeth do not pull: what damping takes off while they part is as if they were less over.
    """
    eased = min(rate, 0.0) * joint.damping / joint.stiffness
    bend, share = _soft((over + eased) / soft_rad)
    bend *= soft_rad
    torque = joint.stiffness * bend + share * joint.damping * max(rate, 0.0)
    return torque, bend - share * eased, share


@njit(inner=True)
def _touch(joint, wind_up, rate, soft_rad):
    """Torque between the teeth, its slopes by stiffness and by delta over stiffness, and the share of them in touch."""
    ahead, ahead_slope, leading = _press(joint, wind_up - joint.delta, rate, soft_rad)
    behind, behind_slope, trailing = _press(joint, -wind_up - joint.delta, -rate, soft_rad)
    return ahead - behind, ahead_slope - behind_slope, trailing - leading, leading + trailing


@njit(inner=True)
def _rub(share):
    """Friction's part at a share of the strokes' speed, smooth at standstill."""
    steep = 50 * share
    return steep / np.sqrt(1 + steep * steep)


@njit(inner=True)
def _step(joint, state, torque, angle, log, follow):
    """Move the state on by a step, in place."""
    motor, wind_up, load, logged = state
    h = log.step_s
    contact = _touch(joint, wind_up, motor - load, log.soft_rad)[0]
    driven = joint.drive * torque - joint.offset - joint.ratio * contact
    driven -= joint.motor_friction * _rub(motor / log.running)
    driven -= joint.motor_viscosity * motor / log.running
    carried = contact - joint.gravity * np.sin(angle + joint.phase - wind_up)
    carried -= joint.friction * _rub(load / log.running)
    carried -= joint.viscosity * load / log.running
    state[0] = motor + h * driven
    state[2] = load + h * carried
    state[1] = wind_up + h * (state[0] - state[2])
    state[3] = logged + follow * (state[0] - logged)


@njit(inner=True)
def _slopes(joint, state, torque, angle, log, follow, slopes, by_joint):
    """Write the slopes of a step to come: by the state, shape (4, 4), and of both speeds by the joint, (2, 13).

    Those of friction at standstill and of what touches the sooner are left out: the covariance would be rough.
    """
    motor, wind_up, load, _ = state
    h = log.step_s
    contact, by_stiffness, by_delta, share = _touch(joint, wind_up, motor - load, log.soft_rad)
    across = angle + joint.phase - wind_up
    falling = joint.gravity * np.cos(across)
    slopes[2, 0] = h * share * joint.damping
    slopes[2, 1] = h * (share * joint.stiffness + falling)
    slopes[2, 2] = 1 - slopes[2, 0] - h * joint.viscosity / log.running
    slopes[0, 0] = 1 - joint.ratio * slopes[2, 0] - h * joint.motor_viscosity / log.running
    slopes[0, 1] = -joint.ratio * h * share * joint.stiffness
    slopes[0, 2] = joint.ratio * slopes[2, 0]
    for k in range(3):
        slopes[1, k] = h * (slopes[0, k] - slopes[2, k])
        slopes[3, k] = follow * slopes[0, k]
    slopes[1, 1] += 1
    slopes[3, 3] = 1 - follow
    # Columns are places in the joint.
    for k, by in enumerate((joint.stiffness * by_delta, by_stiffness, share * (motor - load))):
        by_joint[0, k] = -h * joint.ratio * by
        by_joint[1, k] = h * by
    by_joint[0, 4] = -h * contact
    by_joint[0, 5] = h * torque
    by_joint[0, 10] = -h * _rub(motor / log.running)
    by_joint[0, 11] = -h * motor / log.running
    by_joint[0, 12] = -h
    by_joint[1, 3] = -h * np.sin(across)
    by_joint[1, 6] = -h * falling
    by_joint[1, 8] = -h * _rub(load / log.running)
    by_joint[1, 9] = -h * load / log.running


@njit(inner=True)
def _spread(covariance, slopes, log, work):
    """Move the covariance on by a step, in place; plain loops, as BLAS rounds by the processor."""
    for i in range(4):
        for j in range(4):
            work[i, j] = 0.0
            for k in range(4):
                work[i, j] += slopes[i, k] * covariance[k, j]
    for i in range(4):
        for j in range(i + 1):
            total = 0.0
            for k in range(4):
                total += work[i, k] * slopes[j, k]
            covariance[i, j] = total
            covariance[j, i] = total
    covariance[0, 0] += log.noise[0] * log.step_s
    covariance[2, 2] += log.noise[1] * log.step_s


@njit(inner=True)
def _lean(tangent, slopes, by_joint, h, follow):
    """Move the slopes of the state by the joint, shape (4, 13), on by a step, in place."""
    for k in range(tangent.shape[1]):
        motor, wind_up, load, logged = tangent[:, k]
        tangent[0, k] = (
            slopes[0, 0] * motor + slopes[0, 1] * wind_up + slopes[0, 2] * load + by_joint[0, k]
        )
        tangent[2, k] = (
            slopes[2, 0] * motor + slopes[2, 1] * wind_up + slopes[2, 2] * load + by_joint[1, k]
        )
        tangent[1, k] = wind_up + h * (tangent[0, k] - tangent[2, k])
        tangent[3, k] = logged + follow * (tangent[0, k] - logged)


@njit(inner=True)
def _correct(state, covariance, error, noise, gain):
    """Write the gain of a sample, and correct the state and its covariance by it, in place."""
    variance = covariance[3, 3] + noise
    for k in range(4):
        gain[k] = covariance[3, k] / variance
        state[k] += gain[k] * error
    for i in range(4):
        for j in range(4):
            covariance[i, j] -= variance * gain[i] * gain[j]


@njit
def _predict(log, joint, count, wants_slopes, held):
    """Errors one sample ahead, the gains, and slopes of the errors by the joint; gains are those held, if any."""
    lag_s = max(joint.lag_s, 1e-5)
    follow = 1 - np.exp(-log.step_s / lag_s)
    follow_by_lag = -(1 - follow) * log.step_s / lag_s**2
    covariance = log.noise[2] * np.eye(4)
    covariance[1, 1] = (0.1 * joint.delta + 1e-5) ** 2
    slopes = np.zeros((4, 4))
    work = np.empty((4, 4))
    tangent = np.zeros((4, 13))
    by_joint = np.zeros((2, 13))
    start = joint.gravity * np.sin(log.angle[0, 0] + joint.phase)
    state = np.full(4, log.speed[0])
    state[1] = start / joint.stiffness + joint.delta * np.sign(start)
    tangent[1, 0] = np.sign(start)
    errors = np.empty(count)
    gains = np.empty((count, 4))
    by = np.zeros((count if wants_slopes else 0, 13))
    for i in range(count):
        for j in range(log.torque.shape[1] if i else 0):
            torque, angle = log.torque[i - 1, j], log.angle[i - 1, j]
            if wants_slopes or not held.size:
                _slopes(joint, state, torque, angle, log, follow, slopes, by_joint)
            if not held.size:
                _spread(covariance, slopes, log, work)
            logged = state[3]
            _step(joint, state, torque, angle, log, follow)
            if wants_slopes:
                _lean(tangent, slopes, by_joint, log.step_s, follow)
                tangent[3, 7] += follow_by_lag * (state[0] - logged)
        error = log.speed[i] - state[3]
        errors[i] = error if abs(error) < 1e3 else 1e3
        if held.size:
            for k in range(4):
                gains[i, k] = held[i, k]
                state[k] += gains[i, k] * errors[i]
        else:
            _correct(state, covariance, errors[i], log.noise[2], gains[i])
        if wants_slopes:
            by[i] = -tangent[3]
            for k in range(4):
                tangent[k] += gains[i, k] * by[i]
    return errors, gains, by


class _Strokes:
    """A log with its priors: their means, by what the torque is made of below the ring, and their SDs."""

    def __init__(self, speed: FloatArray, torque: FloatArray, sample_s: float, load: LoadData):
        self.sample_s = sample_s
        # A terminal sees the descents of its own process, and the time left.
        is_hidden = None if parent_process() is None else True
        self.progress = tqdm(total=_MOST_DESCENTS, leave=False, disable=is_hidden)
        time = sample_s * np.arange(speed.size)
        curve = CubicSpline(time, speed)
        steps = int(np.ceil(sample_s / _STEP_S))
        between = time[:-1, None] + sample_s * (np.arange(steps) + 0.5) / steps
        running = float(np.percentile(np.abs(speed), 85))
        noise = [np.median(np.abs(np.diff(y, 4))) / 0.6745 / 70**0.5 for y in (speed, torque)]
        self.log = _Log(
            speed,
            CubicSpline(time, torque)(between),
            curve.antiderivative()(between),
            sample_s / steps,
            running,
            np.maximum(noise, [3e-4 * running, 0]),
        )
        angle, share = curve.antiderivative()(time), speed / running
        slow = gaussian_filter1d(np.where(np.abs(share) < 0.25, 1.0, 0.0), 5e-3 / sample_s)
        self.used = (slow < 0.02) & (time > 0.1)
        columns = [curve(time, 1), np.sin(angle), np.cos(angle)]
        columns += [np.clip(20 * share, -1, 1), share, np.ones_like(share), torque]
        smooth = gaussian_filter1d(np.array(columns).T, 0.015 / sample_s, axis=0)
        smooth = smooth[np.abs(share) > 0.3]
        found = np.linalg.lstsq(smooth[:, :-1], smooth[:, -1])[0]
        left = smooth[:, -1] - smooth[:, :-1] @ found
        if not (found[0] > 0 and np.std(left) < 0.3 * np.std(smooth[:, 1:3] @ found[1:3])):
            raise ValueError(
                "the torque shows no gravity; is it this motor's, with its sign, and the axis "
                "horizontal, and no other axis moving?"
            )
        self._set_priors(load, found)
        above = np.sign(np.sin(angle + self.mean[_PHASE])[self.used])
        self.crossings = int(np.count_nonzero(np.diff(above)))

    def _set_priors(self, load: LoadData, found: FloatArray) -> None:
        """By the load, and what acceleration, gravity, friction, viscosity and offset add to the torque."""
        size = np.hypot(found[1], found[2])
        phase = np.arctan2(found[2], found[1])
        self.sd = _SD.copy()
        self.sd[_LOAD] = np.array([load.gravity_sd, load.inertia_sd]) + 1e-3
        # The log tells rho g / (1 + rho), to 2 %.
        rho = load.inertia_ratio
        known = np.log([load.gravity_per_s2, rho])
        slope = np.array([1, 1 / (1 + rho)])
        gain = self.sd[_LOAD] ** 2 * slope
        surplus = np.log(size / found[0] * (1 + rho)) - known.sum()
        known += gain * surplus / (gain @ slope + 0.02**2)
        mean = [0, 9.86, -3.2, *known, known.sum() - np.log(size), phase, 1.0, 0.03, 0.01]
        self.mean = np.append(mean, found[3:6] / size - (0.03, 0.01, 0))

    def joint(self, theta: FloatArray) -> _Joint:
        """The joint of parameters less their priors' means."""
        theta = self.mean + theta
        known = np.exp(theta[1:6])
        stiffness, zeta, gravity, ratio, _ = known
        known[1] = 2 * zeta * np.sqrt(stiffness)
        load, motor = np.split(gravity * theta[8:], [2])
        play, lag_s = abs(theta[0]) / 1e3, theta[7] / 1e3
        return _Joint._make((play, *known, theta[6], lag_s, *load, *(ratio * motor)))


class _Filter:
    """Prediction errors where the joint runs, and their descent, over parameters less the priors' means.

    The model lacks a share of gravity, over 5 ms.
    """

    def __init__(self, strokes: _Strokes, lacking: float, seconds: float, soft_rad: float):
        self.strokes = strokes
        count = int(min(seconds / strokes.sample_s, strokes.used.size))
        self.used = strokes.used[:count]
        gravity, ratio, drive = np.exp(strokes.mean[3:6])
        speed_sd, torque_sd = strokes.log.noise
        power = 5e-3 * (lacking * gravity) ** 2
        driven = strokes.sample_s * (drive * torque_sd) ** 2 + ratio**2 * power
        noise = np.array([driven, power, speed_sd**2])
        self.log = strokes.log._replace(noise=noise, soft_rad=soft_rad)

    def _predict(
        self, theta: FloatArray, wants_slopes: bool, held: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        return _predict(self.log, self.strokes.joint(theta), self.used.size, wants_slopes, held)

    def gains(self, theta: FloatArray) -> FloatArray:
        """Of the filter at each sample."""
        return np.asarray(self._predict(theta, False, _FILTER)[1])

    def errors(self, theta: FloatArray, held: FloatArray = _FILTER) -> FloatArray:
        """One sample ahead, over their SDs' shares of the median."""
        found, gains, _ = self._predict(theta, False, held)
        return np.asarray(found[self.used] * _weight(gains[self.used, 3]))

    def slopes(self, theta: FloatArray, held: FloatArray = _FILTER) -> FloatArray:
        """Slopes of the errors, the gains held."""
        _, gains, by = self._predict(theta, True, held)
        moved = [
            np.array(self.strokes.joint(theta + row)) - self.strokes.joint(theta - row)
            for row in _STEP * np.eye(_SD.size)
        ]
        by_theta = np.transpose(moved) / (2 * _STEP)
        return by[self.used] @ by_theta * _weight(gains[self.used, 3])[:, None]

    def size(self, theta: FloatArray) -> float:
        """Of the errors, none taken as more than four medians."""
        size = np.abs(self.errors(theta))
        return float(np.sqrt(np.mean(np.minimum(size, 4.0 * np.median(size)) ** 2)))

    def descend_all(
        self, starts: list[FloatArray], steps: int, least: float
    ) -> list[OptimizeResult]:
        """Descents from all starts, of one scale: their costs can be compared."""
        scale = _TEMPER * min(map(self.size, starts))
        return [self.descend(start, scale, steps, least) for start in starts]

    def leap(self, starts: list[FloatArray]) -> list[FloatArray]:
        """Where descents with the gains of their starts end, or the starts where those fit better; the best first."""
        scale = _TEMPER * min(map(self.size, starts))

        def cost(theta: FloatArray) -> float:
            weighed = np.append(self.errors(theta) / scale, theta / self.strokes.sd)
            return float(huber(_HUBER, weighed).sum())

        ends = [self.descend(start, scale, 8, 0.01, self.gains(start)).x for start in starts]
        return sorted((min(pair, key=cost) for pair in zip(starts, ends, strict=True)), key=cost)

    def descend(
        self, start: FloatArray, scale: float, steps: int, least: float, held: FloatArray = _FILTER
    ) -> OptimizeResult:
        """Least squares, robust; the gains are held while the slopes are taken, or all the time."""
        sd = self.strokes.sd
        self.strokes.progress.update()

        def weigh(theta: FloatArray) -> FloatArray:
            return np.append(self.errors(theta, held) / scale, theta / sd)

        def slopes(theta: FloatArray) -> FloatArray:
            return np.vstack([self.slopes(theta, held) / scale, np.diag(1 / sd)])

        return least_squares(
            weigh,
            start,
            slopes,
            x_scale=np.minimum(sd, 1.0),
            loss="huber",
            f_scale=_HUBER,
            ftol=least,
            xtol=None,
            gtol=None,
            max_nfev=steps,
        )


def _weight(gains: FloatArray) -> FloatArray:
    """Of errors by the gains of the logged speed: over their SDs, 1 in the median."""
    return np.sqrt((1 - gains) / np.median(1 - gains))


def _distinct(fits: list[OptimizeResult], most: int) -> list[OptimizeResult]:
    """The best of fits whose plays differ."""
    kept: list[OptimizeResult] = []
    for fit in sorted(fits, key=_cost):
        if len(kept) < most and all(_apart(fit, other) > _SAME for other in kept):
            kept.append(fit)
    return kept


def _cost(fit: OptimizeResult) -> float:
    return float(fit.cost)


def _apart(fit: OptimizeResult, other: OptimizeResult) -> float:
    """How far one play is from the other, over that."""
    return float(abs(abs(fit.x[0]) / abs(other.x[0]) - 1))


def _search(strokes: _Strokes) -> list[OptimizeResult]:
    """The lowest minimum of descents from many plays, and the others that are nearly as low."""
    rough = _Filter(strokes, 0.01, _SEARCH_S, _SOFT_RAD)
    starts = []
    for delta_mrad in _PLAYS:
        row = np.zeros((_RINGS.size, _FRICTIONS.size, _SD.size))
        row[..., 0] = delta_mrad
        row[..., 1] = _RINGS[:, None]
        row[..., _FRICTION] = _FRICTIONS
        row[..., _MOTOR_FRICTION] = -_FRICTIONS
        starts.append(min(row.reshape(-1, _SD.size), key=rough.size))
    fits = rough.descend_all(rough.leap(rough.leap(starts)[:7]), 5, 0.03)
    for lacking in (0.003, 0.001):
        fine = _Filter(strokes, lacking, _SEARCH_S, _SOFT_RAD)
        kept = [fit.x for fit in _distinct(fits, 4)]
        kept += [np.append(share * kept[0][0], kept[0][1:]) for share in _AGAIN]
        fits = fine.descend_all(fine.leap(kept), 10, 0.005)
    whole = _Filter(strokes, 0.001, np.inf, _HARD_RAD)
    fits = _distinct(whole.descend_all([fit.x for fit in _distinct(fits, 3)], 14, 7e-4), 3)
    found = _distinct(whole.descend_all([fit.x for fit in fits], 12, 7e-5), 3)
    strokes.progress.close()
    return found


@np.errstate(all="ignore")  # a filter that runs away has large errors
def fit_strokes(
    speed: FloatArray, torque: FloatArray, sample_s: float, gear_ratio: float, load: LoadData
) -> TorqueFit:
    """Find the backlash from strokes to and fro across the vertical; ValueError where they cannot tell it.

    Motor speed [rad/s] and torque, both shape (samples,), are of the same instants, evenly spaced; the
    torque is in any unit, positive where it drives forward. At least six strokes at an even speed are
    needed. Where the vertical lies, friction, stiffness and damping of the joint are found.
    """
    strokes = _Strokes(np.asarray(speed) / gear_ratio, np.asarray(torque, float), sample_s, load)
    if strokes.crossings < _LEAST_CROSSINGS:
        raise ValueError(
            f"{strokes.crossings} strokes cross the vertical, by the torque; {_LEAST_CROSSINGS} or more "
            "are needed; is the gear ratio that of the log's side (1 for the joint's)?"
        )
    fit, *others = _search(strokes)
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    turned = np.cumsum(np.diff(np.sign(strokes.log.speed), prepend=0) != 0)[strokes.used]
    scores = (fit.fun[:, None] * fit.jac)[: turned.size]
    sums = np.array([scores[turned == k].sum(axis=0) for k in np.unique(turned)])
    meat = len(sums) * np.cov(sums.T) + np.diag(strokes.sd**-2)
    delta = 1e-3 * abs(fit.x[0])
    of_log = 1e-3 * (covariance @ meat @ covariance)[0, 0] ** 0.5
    deviation = float(np.linalg.norm((of_log, _METHOD_ERROR * delta, _LEAST_SD)))
    for other in others:
        play = 1e-3 * abs(other.x[0])
        if other.cost < fit.cost + _RIVAL_COST and abs(play - delta) > NORMAL_95 * deviation:
            told = f"{delta:.2g} and {play:.2g} rad fit nearly as well"
            raise ValueError(f"{told}; log more strokes, faster or quieter")
    inertia = float(np.exp(-strokes.mean[_DRIVE] - fit.x[_DRIVE]) / gear_ratio)
    advice = "log more strokes, faster or quieter; strokes never tell that there is none"
    found = strokes.mean + fit.x
    return replace(
        conclude(float(delta), deviation, inertia, advice),
        friction_share=float(found[_FRICTION]),
        stiffness_per_s2=float(np.exp(found[_STIFFNESS])),
    )
