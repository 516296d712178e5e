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
from scipy.optimize import OptimizeResult, least_squares

from backlash.fitting.torque import LoadData, TorqueFit, conclude
from replication.arrays import FloatArray
from replication.compiled.cache import njit

_STEP_S = 5e-4  # of the integration, at most
_SEARCH_S = 7.0  # of the log
_TEMPER = 10.0  # on the errors
_METHOD_ERROR = 0.065  # share of the backlash that the method errs by, found on development logs
_LEAST_SD = 1e-5  # rad
_LEAST_CROSSINGS = 6
# delta [mrad], ln K, ln damping ratio, ln gravity, ln rho, ln (1 / J_m), gravity's phase, the speed's lag [ms];
# over gravity, the load's friction and viscosity, and the motor's, and its torque's offset.
_SD = np.array([np.inf, 1.0, 0.5, 0.05, 0.1, 0.3, 0.2, 0.7, 0.05, 0.02, 0.2, 0.2, 0.02])
_STEP = 1e-3 * np.array([2, 2, 30, 1, 3, 1, 0.3, 20, 1, 1, 1, 1, 1])
_LOAD = slice(3, 5)  # places of parameters
_DRIVE = 5
_PHASE = 6
_FRICTION = 8
_MOTOR_FRICTION = 10
_PLAYS = np.geomspace(0.15, 2.2, 14)
_AGAIN = (0.2, 0.35, 0.6, 1.0, 1.6, 2.4)
_RINGS = np.array([-1.2, -0.5, 0.2, 0.9])  # ln K, less its prior's mean: 12 to 35 Hz
_FRICTIONS = np.array([-0.025, -0.01, 0.01, 0.03])  # less the mean


class _Log(NamedTuple):
    """What the filter reads: speed at the samples; torque and angle in between, shape (samples - 1, steps)."""

    speed: FloatArray
    torque: FloatArray
    angle: FloatArray
    step_s: float
    running: float  # speed of the strokes
    # Power of the accelerations of motor and load, variance of the speed; unfiltered, SDs of speed and torque.
    noise: FloatArray


@njit
def _predict(log, parameters, gains, is_frozen):
    """Errors one sample ahead; gains, shape (samples, 4), are read if frozen, else written."""
    (
        delta,
        stiffness,
        zeta,
        gravity,
        ratio,
        drive,  # 1 / (N J_m)
        phase,
        lag_s,
        friction,
        viscosity,
        motor_friction,
        motor_viscosity,
        offset,
    ) = parameters
    damping = 2 * zeta * np.sqrt(stiffness)
    h = log.step_s
    follow = 1 - np.exp(-h / max(lag_s, 1e-5))
    P = log.noise[2] * np.eye(4)
    P[1, 1] = (0.1 * delta + 1e-5) ** 2
    A = np.eye(4)
    A[3, 3] = 1 - follow
    errors = np.empty(len(gains))
    start = gravity * np.sin(log.angle[0, 0] + phase)
    wind_up = start / stiffness + delta * np.sign(start)
    motor = load = logged = log.speed[0]
    for i in range(len(gains)):
        for j in range(log.torque.shape[1] if i else 0):
            bend = wind_up - min(max(wind_up, -delta), delta)
            contact = stiffness * bend + damping * (motor - load)
            touch = h if contact * bend > 0 else 0.0
            motor += (
                h
                * (
                    drive * log.torque[i - 1, j]
                    - motor_friction * min(max(50 * motor / log.running, -1.0), 1.0)
                    - motor_viscosity * motor / log.running
                    - offset
                )
                - ratio * touch * contact
            )
            load += touch * contact - h * (
                gravity * np.sin(log.angle[i - 1, j] + phase - wind_up)
                + friction * min(max(50 * load / log.running, -1.0), 1.0)
                + viscosity * load / log.running
            )
            wind_up += h * (motor - load)
            logged += follow * (motor - logged)
            if not is_frozen:
                A[2, 0] = touch * damping
                A[2, 1] = touch * stiffness
                A[2, 2] = 1 - h * viscosity / log.running - A[2, 0]
                A[0, 0] = 1 - h * motor_viscosity / log.running - ratio * A[2, 0]
                A[0, 1] = -ratio * A[2, 1]
                A[0, 2] = ratio * A[2, 0]
                for k in range(3):
                    A[1, k] = h * (A[0, k] - A[2, k])
                    A[3, k] = follow * A[0, k]
                A[1, 1] += 1
                P = A @ P @ A.T
                P[0, 0] += log.noise[0] * h
                P[2, 2] += log.noise[1] * h
        error = log.speed[i] - logged
        if not abs(error) < 1e3:
            error = 1e3
        errors[i] = error
        gain = gains[i]
        if not is_frozen:
            variance = P[3, 3] + log.noise[2]
            gain[:] = P[3] / variance
            P -= variance * np.outer(gain, gain)
        motor += gain[0] * error
        wind_up += gain[1] * error
        load += gain[2] * error
        logged += gain[3] * error
    return errors


class _Strokes:
    """A log with its priors: their means, by what the torque is made of below the ring, and their SDs."""

    def __init__(self, speed: FloatArray, torque: FloatArray, sample_s: float, load: LoadData):
        self.sample_s = sample_s
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
            raise ValueError("the torque shows no gravity; is it this motor's, with its sign?")
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

    def parameters(self, theta: FloatArray) -> tuple[float, ...]:
        """What the filter takes: an angle of the load, seconds, torques over an inertia."""
        theta = self.mean + theta
        known = np.exp(theta[1:6])
        gravity, ratio = known[2:4]
        load, motor = np.split(gravity * theta[8:], [2])
        return (abs(theta[0]) / 1e3, *known, theta[6], theta[7] / 1e3, *load, *(ratio * motor))


class _Filter:
    """Prediction errors where the joint runs, and their descent, over parameters less the priors' means.

    The model lacks a share of gravity, over 5 ms.
    """

    def __init__(self, strokes: _Strokes, lacking: float, seconds: float):
        self.strokes = strokes
        count = int(min(seconds / strokes.sample_s, strokes.used.size))
        self.used = strokes.used[:count]
        self.gains = np.empty((count, 4))
        gravity, ratio, drive = np.exp(strokes.mean[3:6])
        speed_sd, torque_sd = strokes.log.noise
        power = 5e-3 * (lacking * gravity) ** 2
        driven = strokes.sample_s * (drive * torque_sd) ** 2 + ratio**2 * power
        self.log = strokes.log._replace(noise=np.array([driven, power, speed_sd**2]))

    def errors(self, theta: FloatArray, is_frozen: bool = False) -> FloatArray:
        """One sample ahead, over their SDs' shares of the median; with the gains of before if frozen."""
        found = _predict(self.log, self.strokes.parameters(theta), self.gains, is_frozen)
        weight = 1 - self.gains[self.used, 3]
        return found[self.used] * np.sqrt(weight / np.median(weight))

    def size(self, theta: FloatArray, most: float = 4.0) -> float:
        """Of the errors, none taken as more than so many medians."""
        size = np.abs(self.errors(theta))
        return float(np.sqrt(np.mean(np.minimum(size, most * np.median(size)) ** 2)))

    def rank(self, fit: OptimizeResult) -> float:
        """Size of the errors of a fit."""
        return self.size(fit.x, 30.0)

    def descend(self, start: FloatArray, steps: int, least: float) -> OptimizeResult:
        """Least squares, robust; the gains are held while the slopes are taken."""
        scale = _TEMPER * self.size(start)
        sd = self.strokes.sd

        def weigh(theta: FloatArray) -> FloatArray:
            return np.append(self.errors(theta) / scale, theta / sd)

        def slopes(theta: FloatArray) -> FloatArray:
            now = self.errors(theta)
            moved = [self.errors(theta + row, True) - now for row in np.diag(_STEP)]
            return np.vstack([np.transpose(moved) / _STEP / scale, np.diag(1 / sd)])

        return least_squares(
            weigh,
            start,
            slopes,
            x_scale=np.minimum(sd, 1.0),
            loss="huber",
            f_scale=3.0,
            ftol=least,
            xtol=None,
            gtol=None,
            max_nfev=steps,
        )


def _search(strokes: _Strokes) -> OptimizeResult:
    """The best of descents from many plays."""
    rough = _Filter(strokes, 0.01, _SEARCH_S)
    fine = _Filter(strokes, 0.001, _SEARCH_S)
    whole = _Filter(strokes, 0.001, np.inf)
    starts = []
    for delta_mrad in _PLAYS:
        row = np.zeros((_RINGS.size, _FRICTIONS.size, _SD.size))
        row[..., 0] = delta_mrad
        row[..., 1] = _RINGS[:, None]
        row[..., _FRICTION] = _FRICTIONS
        row[..., _MOTOR_FRICTION] = -_FRICTIONS
        starts.append(min(row.reshape(-1, _SD.size), key=rough.size))
    fits = [rough.descend(theta, 9, 0.03) for theta in starts]
    best = min(fits, key=rough.rank).x.copy()
    best[1:3] *= np.abs(best[1:3]) < 0.8
    for delta_mrad in _AGAIN:
        best[0] = delta_mrad
        fits.append(rough.descend(best, 9, 0.03))
    kept: list[FloatArray] = []
    for fit in sorted(fits, key=rough.rank):
        if not any(np.allclose(fit.x[:2], theta[:2], 0.03, 0.01) for theta in kept):
            kept.append(fit.x)
    fits = sorted((fine.descend(theta, 10, 0.015) for theta in kept[:4]), key=fine.rank)
    fits = [whole.descend(fit.x, 14, 7e-4) for fit in fits[:2]]
    return whole.descend(min(fits, key=whole.rank).x, 12, 7e-5)


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
            f"{strokes.crossings} strokes cross the vertical; {_LEAST_CROSSINGS} or more are needed"
        )
    fit = _search(strokes)
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    turned = np.cumsum(np.diff(np.sign(strokes.log.speed), prepend=0) != 0)[strokes.used]
    scores = (fit.fun[:, None] * fit.jac)[: turned.size]
    sums = np.array([scores[turned == k].sum(axis=0) for k in np.unique(turned)])
    meat = len(sums) * np.cov(sums.T) + np.diag(strokes.sd**-2)
    delta = 1e-3 * abs(fit.x[0])
    of_log = 1e-3 * (covariance @ meat @ covariance)[0, 0] ** 0.5
    deviation = float(np.linalg.norm((of_log, _METHOD_ERROR * delta, _LEAST_SD)))
    inertia = float(np.exp(-strokes.mean[_DRIVE] - fit.x[_DRIVE]) / gear_ratio)
    return conclude(
        float(delta),
        deviation,
        inertia,
        "log more strokes, faster or quieter; strokes never tell that there is none",
    )
