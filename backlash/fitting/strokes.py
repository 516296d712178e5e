"""The backlash of a joint that makes strokes to and fro across the vertical, from motor speed and motor torque.

Two inertias, spring, play and friction are driven by the logged torque, and an extended Kalman filter corrects them
by the logged speed. Its prediction errors, one sample ahead, are made least. What is known of the load, and wide
limits of what is not, are priors. The descent starts at many plays: the errors have several minima.

States, over the gear ratio where the motor's: motor speed, wind-up, load speed, logged speed, which lags.
The errors are taken ten times as large as they are, so that the priors outweigh what the model lacks: the drive's
timing, friction at low speed, cogging.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from backlash.fitting.torque import MOST_SD, NORMAL_95, LoadData, TorqueFit
from replication.arrays import FloatArray
from replication.compiled.cache import njit

_STEP_S = 5e-4  # of the integration, at most
# Share of gravity that the model lacks, over 5 ms, and seconds of the log.
_STAGES = {"rough": (0.01, 7.0), "fine": (0.001, 7.0), "whole": (0.001, np.inf)}
_TEMPER = 10.0  # on the errors
_METHOD_ERROR = 0.065  # share of the backlash that the method errs by, found on development logs
_LEAST_SD = 1e-5  # rad
_LEAST_CROSSINGS = 6
_HUBER = 3.0
# delta [mrad], ln K, ln damping ratio, ln gravity, its phase, load's friction and viscosity over gravity, ln rho,
# ln (1 / J_m), motor's friction, viscosity and offset over gravity, the speed's lag [ms]
_SD = np.array([np.inf, 1.0, 0.5, 0.05, 0.2, 0.05, 0.02, 0.1, 0.3, 0.2, 0.2, 0.02, 0.7])
_STEP = 1e-3 * np.array([2, 2, 30, 1, 0.3, 1, 1, 3, 1, 1, 1, 1, 20])
_GRAVITY = 3  # places of parameters
_RATIO = 7
_DRIVE = 8
_HELD = [0, 1, 12]  # whose moves are bounded
_PLAYS = np.geomspace(0.15, 2.2, 10)
_AGAIN = (0.2, 0.35, 0.6, 1.0, 1.6, 2.4)
_RINGS_HZ = (12, 17, 24, 34)
_FRICTIONS = (0.005, 0.02, 0.04, 0.06)


class _Joint(NamedTuple):
    """Parameters per second, of an angle of the load; torques over an inertia."""

    delta: float
    stiffness: float
    damping: float
    gravity: float
    phase: float
    friction: float
    viscosity: float
    ratio: float
    drive: float  # 1 / (N J_m)
    motor_friction: float
    motor_viscosity: float
    offset: float
    lag_s: float


class _Log(NamedTuple):
    """What the filter reads: speed at the samples; torque and angle in between, shape (samples - 1, steps)."""

    speed: FloatArray
    torque: FloatArray
    angle: FloatArray
    step_s: float
    slow: float  # speed below which Coulomb friction is less
    noise: FloatArray  # power of the accelerations of motor and load, variance of the speed


@njit(inner=True)
def _carry(A, P, work):
    """P = A P A', in place."""
    for i in range(4):
        for j in range(4):
            work[i, j] = 0.0
            for k in range(4):
                work[i, j] += A[i, k] * P[k, j]
    for i in range(4):
        for j in range(4):
            P[i, j] = 0.0
            for k in range(4):
                P[i, j] += work[i, k] * A[j, k]


@njit(inner=True)
def _transition(A, joint, h, touch, follow):
    """Write the derivative of a step by the states before it."""
    spring = h * touch * joint.stiffness
    damper = h * touch * joint.damping
    A[0, 0] = 1 - h * joint.motor_viscosity - joint.ratio * damper
    A[0, 1] = -joint.ratio * spring
    A[0, 2] = joint.ratio * damper
    A[2, 0] = damper
    A[2, 1] = spring
    A[2, 2] = 1 - h * joint.viscosity - damper
    for k in range(3):
        A[1, k] = h * (A[0, k] - A[2, k])
        A[3, k] = follow * A[0, k]
    A[1, 1] += 1
    A[3, 3] = 1 - follow


@njit
def _errors(log, joint, gains, variance, is_frozen, errors):
    """Prediction errors; gains and variances are read if frozen, else written."""
    h = log.step_s
    P = np.diag(
        np.array([log.noise[2], (0.1 * joint.delta + 1e-5) ** 2, log.noise[2], log.noise[2]])
    )
    A = np.zeros((4, 4))
    work = np.empty((4, 4))
    start = joint.gravity * np.sin(log.angle[0, 0] + joint.phase)
    wind_up = start / joint.stiffness + joint.delta * np.sign(start)
    motor = load = logged = log.speed[0]
    follow = 1 - np.exp(-h / max(joint.lag_s, 1e-5))
    for i in range(log.speed.size):
        for j in range(log.torque.shape[1] if i else 0):
            rate = motor - load
            bend = wind_up - min(max(wind_up, -joint.delta), joint.delta)
            contact = joint.stiffness * bend + joint.damping * rate
            touch = 1.0 if contact * bend > 0 else 0.0
            contact *= touch
            motor += h * (
                joint.drive * log.torque[i - 1, j]
                - joint.motor_friction * min(max(motor / log.slow, -1.0), 1.0)
                - joint.motor_viscosity * motor
                - joint.offset
                - joint.ratio * contact
            )
            load += h * (
                contact
                - joint.gravity * np.sin(log.angle[i - 1, j] + joint.phase - wind_up)
                - joint.friction * min(max(load / log.slow, -1.0), 1.0)
                - joint.viscosity * load
            )
            wind_up += h * (motor - load)
            logged += follow * (motor - logged)
            if not is_frozen:
                _transition(A, joint, h, touch, follow)
                _carry(A, P, work)
                P[0, 0] += log.noise[0] * h
                P[2, 2] += log.noise[1] * h
        error = log.speed[i] - logged
        errors[i] = error if abs(error) < 1e3 else 1e3
        if not is_frozen:
            variance[i] = max(P[3, 3], 0.0) + log.noise[2]
            for k in range(4):
                gains[i, k] = P[k, 3] / variance[i]
            for k in range(4):
                for m in range(4):
                    P[k, m] -= gains[i, k] * gains[i, m] * variance[i]
        motor += gains[i, 0] * errors[i]
        wind_up += gains[i, 1] * errors[i]
        load += gains[i, 2] * errors[i]
        logged += gains[i, 3] * errors[i]


class _Fit(NamedTuple):
    """Parameters, minus twice the logarithm of their likelihood, and what least squares give there."""

    theta: FloatArray
    cost: float
    hessian: FloatArray
    scores: FloatArray  # shape (samples, parameters)


class _Strokes:
    """A log with its priors."""

    def __init__(self, speed: FloatArray, torque: FloatArray, sample_s: float, load: LoadData):
        self.speed, self.sample_s = speed, sample_s
        self.time = sample_s * np.arange(speed.size)
        self.running = float(np.percentile(np.abs(speed), 85))
        slow = np.where(np.abs(speed) < 0.25 * self.running, 1.0, 0.0)
        self.used = (gaussian_filter1d(slow, 5e-3 / sample_s) < 0.02) & (self.time > 0.1)
        self.sd = _SD.copy()
        self.sd[[_GRAVITY, _RATIO]] = load.gravity_sd + 1e-3, load.inertia_sd + 1e-3
        curve = CubicSpline(self.time, speed)
        self.mean, self.friction = self._first_guess(curve, torque, load)
        noise = [np.median(np.abs(np.diff(y, 4))) / 0.6745 / 70**0.5 for y in (speed, torque)]
        self.speed_sd = max(noise[0], 3e-4 * self.running)
        self.drive_sd = noise[1] * np.exp(self.mean[_DRIVE])
        steps = int(np.ceil(sample_s / _STEP_S))
        between = self.time[:-1, None] + sample_s * (np.arange(steps) + 0.5) / steps
        self.torque = CubicSpline(self.time, torque)(between)
        self.angle = curve.antiderivative()(between)

    def _first_guess(
        self, curve: CubicSpline, torque: FloatArray, load: LoadData
    ) -> tuple[FloatArray, FloatArray]:
        """Means of the priors; Coulomb's and viscous friction of motor and load together, over gravity."""
        angle, share = curve.antiderivative()(self.time), self.speed / self.running
        columns = [curve(self.time, 1), np.sin(angle), np.cos(angle)]
        columns += [np.clip(20 * share, -1, 1), share, np.ones_like(share), torque]
        smooth = gaussian_filter1d(np.array(columns).T, 0.015 / self.sample_s, axis=0)
        smooth = smooth[np.abs(share) > 0.3]
        found = np.linalg.lstsq(smooth[:, :-1], smooth[:, -1])[0]
        size = np.hypot(found[1], found[2])
        left = smooth[:, -1] - smooth[:, :-1] @ found
        if not (found[0] > 0 and np.std(left) < 0.3 * np.std(smooth[:, 1:3] @ found[1:3])):
            raise ValueError("the torque shows no gravity; is it this motor's, with its sign?")
        phase = np.arctan2(found[2], found[1])
        above = np.sign(np.sin(angle + phase)[self.used])
        self.crossings = int(np.count_nonzero(np.diff(above)))
        rho, g = load.inertia_ratio, load.gravity_per_s2
        mean = np.array([0, 9.86, -3.2, np.log(g), phase, 0.03, 0.01])
        rest = [np.log(rho), np.log(rho * g / size), 0, 0, found[5] / size, 1.0]
        return np.append(mean, rest), found[3:5] / size

    def start(self, delta_mrad: float, ring_hz: float, friction: float) -> FloatArray:
        """Parameters to begin a descent at."""
        theta = self.mean.copy()
        theta[[0, 1, 5]] = delta_mrad, 2 * np.log(2 * np.pi * ring_hz), friction
        theta[9:11] = np.maximum(self.friction - (friction, 0.01), 0)
        return theta

    def joint(self, theta: FloatArray) -> _Joint:
        """The parameters per second."""
        stiffness, zeta, gravity, ratio, drive = np.exp(theta[[1, 2, _GRAVITY, _RATIO, _DRIVE]])
        torques = gravity * np.array([theta[5], theta[6] / self.running])
        motor = ratio * gravity * np.array([theta[9], theta[10] / self.running, theta[11]])
        damping = 2 * zeta * stiffness**0.5
        first = (abs(theta[0]) * 1e-3, stiffness, damping, gravity, theta[4])
        return _Joint(*map(float, (*first, *torques, ratio, drive, *motor, theta[12] * 1e-3)))

    def filter_of(self, stage: str) -> "_Filter":
        """The filter over the first seconds, or the whole log."""
        share, seconds = _STAGES[stage]
        count = int(min(seconds / self.sample_s, self.speed.size))
        rough = share * np.exp(self.mean[_GRAVITY])
        driven = self.sample_s * self.drive_sd**2 + 5e-3 * (rough * np.exp(self.mean[_RATIO])) ** 2
        noise = np.array([driven, 5e-3 * rough**2, self.speed_sd**2])
        log = _Log(
            self.speed[:count],
            self.torque[: count - 1],
            self.angle[: count - 1],
            self.sample_s / self.torque.shape[1],
            0.02 * self.running,
            noise,
        )
        return _Filter(self, log)


class _Filter:
    """Prediction errors where the joint runs, and their descent."""

    def __init__(self, strokes: _Strokes, log: _Log):
        self.strokes, self.log = strokes, log
        self.used = strokes.used[: log.speed.size]
        self.gains, self.variance = np.empty((log.speed.size, 4)), np.empty(log.speed.size)

    def errors(self, theta: FloatArray, is_frozen: bool = False) -> FloatArray:
        """One sample ahead; with the gains of before if frozen."""
        found = np.empty(self.log.speed.size)
        joint = self.strokes.joint(theta)
        _errors(self.log, joint, self.gains, self.variance, is_frozen, found)
        return found[self.used]

    def weigh(self, errors: FloatArray) -> tuple[FloatArray, float]:
        """The errors over their SDs' shares of the median, and their size without the largest."""
        variance = self.variance[self.used]
        ratio = errors / np.sqrt(variance / np.median(variance))
        size = np.abs(ratio)
        return ratio, float(np.sqrt(np.mean(np.minimum(size, 4 * np.median(size)) ** 2)))

    def size(self, theta: FloatArray) -> float:
        """Of the errors."""
        return self.weigh(self.errors(theta))[1]

    def _cost(self, ratio: FloatArray, theta: FloatArray) -> float:
        size = np.abs(ratio)
        robust = np.where(size > _HUBER, 2 * _HUBER * size - _HUBER**2, size**2)
        return float(robust.sum() + np.sum(((theta - self.strokes.mean) / self.strokes.sd) ** 2))

    def descend(self, theta: FloatArray, steps: int, least: float) -> _Fit:
        """Levenberg-Marquardt; the gains are held while the slopes are taken."""
        damping = 1e-2
        mean, sd = self.strokes.mean, self.strokes.sd
        for _ in range(steps):
            now = self.errors(theta)
            ratio, size = self.weigh(now)
            scale = _TEMPER * size * now / ratio
            before = self._cost(now / scale, theta)
            moved = [self.errors(theta + row, True) for row in np.diag(_STEP)]
            slopes = (np.array(moved) - now).T / _STEP / scale[:, None]
            weight = np.minimum(1, _HUBER / np.maximum(np.abs(now / scale), 1e-9))
            scores = slopes * (weight * now / scale)[:, None]
            hessian = slopes.T @ (slopes * weight[:, None]) + np.diag(sd**-2)
            slope = scores.sum(axis=0) + (theta - mean) / sd**2
            fit = _Fit(theta, float(now.size * np.log(np.mean(ratio**2))), hessian, scores)
            for _ in range(7):
                move = np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), slope)
                trial = theta - move
                trial[0] = abs(trial[0])
                is_far = np.abs(move[_HELD]) > (max(0.5 * theta[0], 0.1), 0.7, 1.5)
                after = np.inf if is_far.any() else self._cost(self.errors(trial) / scale, trial)
                if after < before:
                    break
                damping *= 4
            if not after < before:
                break
            theta = trial
            damping = max(damping / 6, 1e-8)
            if before - after < least:
                break
        return fit


def _search(strokes: _Strokes) -> _Fit:
    """The best of descents from many plays."""
    grid = [[strokes.start(d, ring, f) for ring in _RINGS_HZ for f in _FRICTIONS] for d in _PLAYS]
    rough, fine, whole = (strokes.filter_of(stage) for stage in _STAGES)
    fits = [rough.descend(min(row, key=rough.size), 7, 2.0) for row in grid]
    best = min(fits, key=lambda fit: fit.cost).theta
    for delta_mrad in _AGAIN:
        theta = best.copy()
        theta[0] = delta_mrad
        theta[1:3] = np.where(np.abs(best - strokes.mean)[1:3] > 0.8, strokes.mean[1:3], best[1:3])
        fits.append(rough.descend(theta, 7, 2.0))
    kept: list[_Fit] = []
    for fit in sorted(fits, key=lambda fit: fit.cost):
        if len(kept) < 4 and all(abs(np.log(fit.theta[0] / k.theta[0])) > 0.03 for k in kept):
            kept.append(fit)
    fits = sorted((fine.descend(fit.theta, 8, 1.0) for fit in kept), key=lambda fit: fit.cost)
    fits = [whole.descend(fit.theta, 12, 0.1) for fit in fits[:2]]
    return whole.descend(min(fits, key=lambda fit: fit.cost).theta, 10, 0.01)


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
            f"{strokes.crossings} strokes cross the vertical; {_LEAST_CROSSINGS} or more are needed"
        )
    fit = _search(strokes)
    covariance = np.linalg.inv(fit.hessian)
    turned = np.cumsum(np.diff(np.sign(strokes.speed), prepend=0) != 0)[strokes.used]
    scores = np.array([fit.scores[turned == k].sum(axis=0) for k in np.unique(turned)])
    prior = np.diag(strokes.sd**-2)
    spread = covariance @ (len(scores) * np.cov(scores.T) + prior) @ covariance
    delta = 1e-3 * fit.theta[0]
    errors = (1e-3 * spread[0, 0] ** 0.5, _METHOD_ERROR * delta, _LEAST_SD)
    deviation = float(np.linalg.norm(errors))
    interval = max(delta - NORMAL_95 * deviation, 0.0), delta + NORMAL_95 * deviation
    reason = f"it tells {delta:.2g} rad, SD {deviation:.2g}, above {MOST_SD:.0%}; log more strokes, or quieter"
    return TorqueFit(
        float(delta),
        interval,
        deviation,
        float(np.exp(-fit.theta[_DRIVE]) / gear_ratio),
        "" if deviation <= MOST_SD * delta else reason,
    )
