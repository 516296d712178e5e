"""The backlash of a joint under any drive, from a log of motor speed and motor torque: method "torque".

On the harmonics of the mean turn, every torque over the motor's inertia J_m:

1. The teeth pass on the torque that does not accelerate the motor: c = T / J_m - a.
2. It and gravity accelerate the load: q'' = c / (N rho) - g sin(theta), with rho = J_l / (N^2 J_m) and g = m g r / J_l.
3. Once a turn that is gravity's torque, which tells J_m in units of T: T_1 / J_m = N rho (g + q''_1) + a_1.
4. The wind-up is x = theta_m / N - q, with theta_m = -a / omega^2 and q = -q'' / omega^2 at each harmonic.
5. Where the teeth touch, x = delta sign(c) + c / K: the coefficient of sign(c) is delta, half of the play.

Harmonics 1 and 2 of x, where a small error of c is large, are free; so are what damping adds to x, the rate of c, and
what a lag between the columns of speed and torque adds, the speed. Constant friction is in no harmonic.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, toeplitz

from backlash.fitting.harmonics import turn_harmonics
from backlash.fitting.waveform import settled
from backlash.reading.refusals import UnusableLog
from replication.arrays import FloatArray
from replication.recording import Recording

MOST_SD, NORMAL_95 = 0.15, 1.96  # SD over the backlash, above which there is no answer; half width over SD
_IN_CONTACT, _FASTEST_HZ = 0.15, 100.0  # the teeth touch above this share of the largest torque; the fastest ring
# Shares of the wind-up that no noise explains, and of the backlash that the method errs by without noise.
_ROUGHNESS, _METHOD_ERROR = 0.2, 0.02
_FREE_HARMONICS, _LEAST_HARMONICS, _LEAST_GRAVITY, _DRAWS = 2, 12, 10.0, 200


@dataclass(frozen=True)
class LoadData:
    """What must be known of the load, by its data sheet or the drive's autotune, each with a relative SD."""

    inertia_ratio: float  # rho = J_l / (N^2 J_m): of the load, seen from the motor, to the motor's own
    gravity_per_s2: float  # m g r / J_l: 9.81 / r for a point load
    inertia_sd: float = 0.1
    gravity_sd: float = 0.05

    def __post_init__(self):
        """Refuse what no load has."""
        values, sds = (self.inertia_ratio, self.gravity_per_s2), (self.inertia_sd, self.gravity_sd)
        if not (all(0 < value < np.inf for value in values) and all(0 <= sd <= 0.5 for sd in sds)):
            raise UnusableLog(f"{self!r}: inertia ratio and gravity must be above 0, their SDs shares up to 0.5")

    def __str__(self) -> str:
        """What was said, as a note."""
        ratio = f"an inertia ratio of {self.inertia_ratio:g} (SD {self.inertia_sd:.0%})"
        return f"by the torque, {ratio} and m g r / J_l of {self.gravity_per_s2:g} per s^2 (SD {self.gravity_sd:.0%})"


@dataclass(frozen=True)
class TorqueFit:
    """The backlash that speed and torque tell of."""

    delta_rad: float  # half of the play
    interval_rad: tuple[float, float]  # 95 %
    sd_rad: float
    motor_inertia: float  # J_m, its unit the torque's over rad/s^2: compare it with the data sheet
    refusal_reason: str = ""  # why this is no answer; empty if it is one


class _Turn(NamedTuple):
    """Harmonics of the mean turn from order 0, and their SDs: a row for the speed [rad/s], one for the torque."""

    omega: FloatArray
    gear_ratio: float
    mean: NDArray[np.complex128]
    sd: FloatArray


def _harmonics(recording: Recording, count: int) -> tuple[NDArray[np.complex128], FloatArray]:
    """Coefficients and SDs; 0 where `turn_harmonics` leaves one out, but for the first."""
    found, (phase, v) = turn_harmonics(recording), settled(recording)
    order = found.order[found.order < count]
    whole = phase < phase[0] + int(phase[-1] - phase[0] + recording.sample_s / recording.turn_period_s + 1e-6) - 1e-9
    coefficient, sd = np.zeros(count, dtype=complex), np.zeros(count)
    coefficient[order], sd[order], sd[1] = found.coefficient[: order.size], found.sd[: order.size], found.sd[0]
    coefficient[1] = np.mean((v[whole] - v[whole].mean()) * np.exp(-2j * np.pi * phase[whole]))
    return coefficient, sd


def _regression(turn: _Turn, load: LoadData, first: complex) -> tuple[FloatArray, FloatArray, float]:
    """Regressors and wind-up at even phases of a turn, and J_m; `first` is the wind-up's first harmonic."""
    omega, n, rho = turn.omega[1:], turn.gear_ratio, load.inertia_ratio
    speed, torque = turn.mean
    a, motor = 1j * turn.omega * speed, speed[1:] / (1j * omega) / n
    load_first = 0.5 * load.gravity_per_s2 * torque[1] / abs(torque[1]) - omega[0] ** 2 * (motor[0] - first)
    inertia = 1 / float(np.real((n * rho * load_first + a[1]) / torque[1]))
    contact = torque / inertia - a
    count, size = contact.size, 3 * contact.size
    waves = np.zeros((4, size // 2 + 1), dtype=complex)
    waves[0, 1:count] = motor + contact[1:] / (n * rho * omega**2)
    waves[0, : _FREE_HARMONICS + 1] = 0  # with gravity, which has the first alone
    waves[1:, :count] = 1j * turn.omega * contact, speed, contact
    x, rate, lag, c = np.fft.irfft(waves, size) * size
    angle = 2 * np.pi * np.outer(np.arange(1, _FREE_HARMONICS + 1), np.arange(size)) / size
    columns = np.array([np.ones(size), *np.cos(angle), *np.sin(angle), rate, lag, c, np.sign(c)])
    return (columns / np.abs(columns).max(axis=1, keepdims=True)).T, x, inertia


def _instruments(turn: _Turn, load: LoadData) -> FloatArray:
    """Regressors where the teeth touch, whitened by the wind-up's noise, for generalised least squares."""
    basis, x, inertia = _regression(turn, load, 0j)
    omega, through = turn.omega[1:], 1 / (turn.gear_ratio * load.inertia_ratio)
    by_speed, by_torque = turn.sd[:, 1:] / omega * np.array([[1 / turn.gear_ratio + through], [through / inertia]])
    variance = np.zeros(x.size // 2 + 1)
    variance[_FREE_HARMONICS + 1 : turn.omega.size] = 2 * (by_speed**2 + (by_torque / omega) ** 2)[_FREE_HARMONICS:]
    touching = np.flatnonzero(np.abs(basis[:, -2]) > _IN_CONTACT)
    covariance = toeplitz(np.fft.irfft(variance, x.size) * x.size)[np.ix_(touching, touching)]
    covariance += (_ROUGHNESS * x.std()) ** 2 * np.eye(touching.size)
    whitened = np.zeros_like(basis)
    whitened[touching] = cho_solve(cho_factor(covariance), basis[touching])
    return whitened


def _solve(turn: _Turn, load: LoadData, instruments: FloatArray, first: complex) -> tuple[float, float, complex]:
    """Backlash [rad], J_m and the wind-up's first harmonic, from a guess of the last."""
    basis, x, inertia = _regression(turn, load, first)
    found = np.linalg.solve(instruments.T @ basis, instruments.T @ x)
    return float(found[-1]), inertia, complex(np.fft.fft(basis[:, -2:] @ found[-2:])[1] / x.size)


def fit_torque(recording: Recording, torque: FloatArray, load: LoadData, rng: np.random.Generator) -> TorqueFit:
    """Find the backlash from the motor's speed and torque; ValueError where they cannot tell it.

    The torque, shape (samples,), is the motor's at the same samples, positive where it drives forward, in any unit, as
    its current. The generator draws noise and load data for the interval.
    """
    torque, period, name = np.asarray(torque, dtype=float), recording.turn_period_s, recording.source
    count = int(min(_FASTEST_HZ, 0.45 / recording.sample_s) * period) + 1
    if not (torque.shape == recording.v.shape and 0 < np.ptp(torque) < np.inf and count > _LEAST_HARMONICS):
        needed = f"{recording.v.size} finite numbers that vary, and {_LEAST_HARMONICS} harmonics of the turn to 100 Hz"
        raise ValueError(f"{name}: the torque needs {needed}")
    both = [_harmonics(replace(recording, v=v), count) for v in (2 * np.pi * recording.v, torque)]
    mean, sd = np.array([each[0] for each in both]), np.array([each[1] for each in both])
    turn = _Turn(np.float64(2 * np.pi / period) * np.arange(count), recording.commanded_speed_rps * period, mean, sd)
    if abs(mean[1, 1]) < _LEAST_GRAVITY * sd[1, 1] or torque.mean() < 0:
        raise ValueError(f"{name}: the torque shows no gravity, or drives backward; is it this motor's, with its sign?")
    instruments, first = _instruments(turn, load), 0j
    for _ in range(2):  # what the wind-up adds to gravity once a turn is small
        delta, inertia, first = _solve(turn, load, instruments, first)
    draws = []
    for _ in range(_DRAWS):  # turns and loads that the log's noise and the load's SDs allow
        noise = rng.standard_normal((2, count)) + 1j * rng.standard_normal((2, count))
        rho, g = np.exp(rng.standard_normal(2) * (load.inertia_sd, load.gravity_sd))
        other = replace(load, inertia_ratio=rho * load.inertia_ratio, gravity_per_s2=g * load.gravity_per_s2)
        draws.append(_solve(turn._replace(mean=mean + sd * noise), other, instruments, first)[0])
    deviation = float(np.hypot(np.std(draws), _METHOD_ERROR * delta))
    interval = max(delta - NORMAL_95 * deviation, 0.0), max(delta + NORMAL_95 * deviation, 0.0)
    reason = f"the torque tells {delta:.2g} rad with an SD of {deviation:.2g}, above {MOST_SD:.0%}"
    return TorqueFit(delta, interval, deviation, inertia, "" if deviation <= MOST_SD * delta else reason)
