"""The backlash of a joint under any drive, from a log of motor speed and motor torque: method "torque".

On the harmonics of the mean turn, every torque over the motor's inertia J_m:

1. The teeth pass on the torque that does not accelerate the motor: c = T / J_m - a.
2. It and gravity accelerate the load: q'' = c / (N rho) - g sin(theta), with rho = J_l / (N^2 J_m) and g = m g r / J_l.
3. Once a turn that is gravity's torque, which tells J_m in units of T: T_1 / J_m = N rho (g + q''_1) + a_1.
4. The wind-up is x = theta_m / N - q, with theta_m = -a / omega^2 and q = -q'' / omega^2 at each harmonic.
5. Where the teeth touch, x = delta sign(c) + c / K: the coefficient of sign(c) is delta, half of the play.

Harmonics 1 and 2 of x, where a small error of c is large, are free; so are what damping adds to x,
the rate of c, and what a lag between the columns of speed and torque adds, the speed. Constant
friction is in no harmonic.
"""

from dataclasses import dataclass, replace
from numbers import Real
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, toeplitz

from backlash.fitting.harmonics import turn_harmonics
from backlash.reading.columns import is_positive
from backlash.reading.refusals import UnusableLog
from replication.arrays import FloatArray
from replication.recording import Recording
from replication.simulator.parameters import GRAVITY

MOST_SD = 0.15  # over the backlash, above which there is no answer
NORMAL_95 = 1.96  # half width over SD
_IN_CONTACT = 0.15  # the teeth touch above this share of the largest torque
_FASTEST_HZ = 100.0  # of a ring
_ROUGHNESS = 0.2  # share of the wind-up that no noise explains
_METHOD_ERROR = 0.02  # share of the backlash that the method errs by without noise
_FREE_HARMONICS = 2
_LEAST_HARMONICS = 12
_LEAST_GRAVITY = 10.0  # of the torque once a turn, in its SDs
_DRAWS = 200
_MOST_BELOW = 0.1  # of an inertia that was measured, below the least that its mass has


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
            raise UnusableLog(
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
            raise UnusableLog(
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
            raise UnusableLog(
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


class _Turn(NamedTuple):
    """Harmonics of the mean turn from order 0, and their SDs: a row for the speed [rad/s], one for the torque."""

    omega: FloatArray
    gear_ratio: float
    mean: NDArray[np.complex128]
    sd: FloatArray

    @property
    def acceleration(self) -> NDArray[np.complex128]:
        return 1j * self.omega * self.mean[0]

    @property
    def motor_angle(self) -> NDArray[np.complex128]:
        """From order 1, over the gear ratio."""
        return self.mean[0][1:] / (1j * self.omega[1:]) / self.gear_ratio


class _Regression(NamedTuple):
    """The wind-up at even phases of a turn as a sum of the columns of a basis: the last is the contact's sign."""

    basis: FloatArray
    wind_up: FloatArray
    inertia: float  # J_m


class _Solution(NamedTuple):
    """Backlash [rad], J_m and the wind-up's first harmonic."""

    delta_rad: float
    inertia: float
    first: complex


def _harmonics(recording: Recording, count: int) -> tuple[NDArray[np.complex128], FloatArray]:
    """Coefficients and SDs; 0 where `turn_harmonics` leaves one out, but for the first."""
    found = turn_harmonics(recording)
    order = found.order[found.order < count]
    coefficient = np.zeros(count, dtype=complex)
    coefficient[order] = found.coefficient[: order.size]
    coefficient[1] = found.first.coefficient
    sd = np.zeros(count)
    sd[order] = found.sd[: order.size]
    sd[1] = found.first.sd
    return coefficient, sd


def _motor_inertia(turn: _Turn, load: LoadData, first: complex) -> float:
    """J_m by gravity's torque once a turn (step 3)."""
    torque = turn.mean[1][1]
    load_angle = turn.motor_angle[0] - first
    load_first = 0.5 * load.gravity_per_s2 * torque / abs(torque) - turn.omega[1] ** 2 * load_angle
    turning = turn.gear_ratio * load.inertia_ratio * load_first + turn.acceleration[1]
    return 1 / float(np.real(turning / torque))


def _regression(turn: _Turn, load: LoadData, first: complex) -> _Regression:
    """Steps 1 to 5; `first` is the wind-up's first harmonic."""
    inertia = _motor_inertia(turn, load, first)
    contact = turn.mean[1] / inertia - turn.acceleration
    size = 3 * contact.size
    wind_up = np.zeros(size // 2 + 1, dtype=complex)
    through = turn.gear_ratio * load.inertia_ratio * turn.omega[1:] ** 2
    wind_up[1 : contact.size] = turn.motor_angle + contact[1:] / through
    wind_up[: _FREE_HARMONICS + 1] = 0  # with gravity, which has the first alone
    x = np.fft.irfft(wind_up, size) * size
    rate, lag, c = (
        np.fft.irfft(wave, size) * size
        for wave in (1j * turn.omega * contact, turn.mean[0], contact)
    )
    angle = 2 * np.pi * np.outer(np.arange(1, _FREE_HARMONICS + 1), np.arange(size)) / size
    columns = np.array([np.ones(size), *np.cos(angle), *np.sin(angle), rate, lag, c, np.sign(c)])
    return _Regression((columns / np.abs(columns).max(axis=1, keepdims=True)).T, x, inertia)


def _instruments(turn: _Turn, load: LoadData) -> FloatArray:
    """Regressors where the teeth touch, whitened by the wind-up's noise, for generalised least squares."""
    basis, x, inertia = _regression(turn, load, 0j)
    omega = turn.omega[1:]
    through = 1 / (turn.gear_ratio * load.inertia_ratio)
    by_speed, by_torque = (
        turn.sd[:, 1:] / omega * np.array([[1 / turn.gear_ratio + through], [through / inertia]])
    )
    variance = np.zeros(x.size // 2 + 1)
    variance[_FREE_HARMONICS + 1 : turn.omega.size] = (
        2 * (by_speed**2 + (by_torque / omega) ** 2)[_FREE_HARMONICS:]
    )
    touching = np.flatnonzero(np.abs(basis[:, -2]) > _IN_CONTACT)
    covariance = toeplitz(np.fft.irfft(variance, x.size) * x.size)[np.ix_(touching, touching)]
    covariance += (_ROUGHNESS * x.std()) ** 2 * np.eye(touching.size)
    whitened = np.zeros_like(basis)
    whitened[touching] = cho_solve(cho_factor(covariance), basis[touching])
    return whitened


def _solve(turn: _Turn, load: LoadData, instruments: FloatArray, first: complex) -> _Solution:
    """Solution from a guess of the wind-up's first harmonic."""
    basis, x, inertia = _regression(turn, load, first)
    found = np.linalg.solve(instruments.T @ basis, instruments.T @ x)
    return _Solution(
        float(found[-1]), inertia, complex(np.fft.fft(basis[:, -2:] @ found[-2:])[1] / x.size)
    )


def _mean_turn(recording: Recording, torque: FloatArray) -> _Turn:
    """Harmonics of the mean turn; ValueError where they cannot tell the backlash."""
    name, period = recording.source, recording.turn_period_s
    count = int(min(_FASTEST_HZ, 0.45 / recording.sample_s) * period) + 1
    if not (
        torque.shape == recording.v.shape
        and 0 < np.ptp(torque) < np.inf
        and count > _LEAST_HARMONICS
    ):
        needed = f"{recording.v.size} finite numbers that vary, and {_LEAST_HARMONICS} harmonics of the turn to 100 Hz"
        raise ValueError(f"{name}: the torque needs {needed}")
    mean, sd = zip(
        *(_harmonics(replace(recording, v=v), count) for v in (2 * np.pi * recording.v, torque)),
        strict=True,
    )
    omega = np.float64(2 * np.pi / period) * np.arange(count)
    turn = _Turn(omega, recording.commanded_speed_rps * period, np.array(mean), np.array(sd))
    if abs(turn.mean[1, 1]) < _LEAST_GRAVITY * turn.sd[1, 1] or torque.mean() < 0:
        raise ValueError(
            f"{name}: the torque shows no gravity, or drives backward; is it this motor's, with its sign?"
        )
    return turn


def _draw(turn: _Turn, load: LoadData, rng: np.random.Generator) -> tuple[_Turn, LoadData]:
    """A turn and a load that the log's noise and the load's SDs allow."""
    noise = rng.standard_normal(turn.mean.shape) + 1j * rng.standard_normal(turn.mean.shape)
    rho, g = np.exp(rng.standard_normal(2) * (load.inertia_sd, load.gravity_sd))
    other = replace(
        load, inertia_ratio=rho * load.inertia_ratio, gravity_per_s2=g * load.gravity_per_s2
    )
    return turn._replace(mean=turn.mean + turn.sd * noise), other


def fit_torque(
    recording: Recording, torque: FloatArray, load: LoadData, rng: np.random.Generator
) -> TorqueFit:
    """Find the backlash from the motor's speed and torque; ValueError where they cannot tell it.

    The torque, shape (samples,), is the motor's at the same samples, positive where it drives
    forward, in any unit, as its current. The generator draws noise and load data for the interval.
    """
    turn = _mean_turn(recording, np.asarray(torque, dtype=float))
    instruments = _instruments(turn, load)
    first = 0j
    for _ in range(2):  # what the wind-up adds to gravity once a turn is small
        delta, inertia, first = _solve(turn, load, instruments, first)
    drawn = [_solve(*_draw(turn, load, rng), instruments, first).delta_rad for _ in range(_DRAWS)]
    deviation = float(np.hypot(np.std(drawn), _METHOD_ERROR * delta))
    advice = "turn the joint faster (twice as fast, about half the SD), log more turns, or with a finer encoder"
    reverses = bool(np.mean(torque) < 2 * abs(turn.mean[1, 1]))
    return replace(conclude(delta, deviation, inertia, advice), reverses=reverses)
