"""The backlash of a joint under any drive, from a log of motor speed and motor torque: method "torque".

The load alone is simulated, driven by the measured motor motion, and the torque that it asks of the motor is
compared with the measured one, harmonic by harmonic of the mean turn. With x = theta_m / N - q the wind-up:

    x'' = a / N - c + g sin(q) + F,     T = J_m (a + N rho c)

where c, the contact's torque over the load's inertia J_l, is that of spring and damper beyond the gap of delta
to either side, and never pulls; a is the motor's acceleration, g = m g r / J_l, rho = J_l / (N^2 J_m) and F the
load's friction, which sets the instants at which the teeth part. Neither the drive nor the motor's own friction
is in it.

Noise of the speed reaches the torque through the model: each harmonic's SD is that of both columns there, by the
joint with its teeth in contact, and a share of the torque that the model lacks.
"""

from dataclasses import dataclass, replace
from numbers import Real
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from backlash.detection.pattern import MOTOR_ORDERS
from backlash.fitting.harmonics import spectrum
from backlash.fitting.waveform import drop_first_turn
from backlash.reading.columns import is_positive
from backlash.reading.refusals import UnusableLog
from replication.arrays import FloatArray
from replication.compiling import njit
from replication.records import Recording
from replication.simulator.parameters import GRAVITY, TURN

ComplexArray = NDArray[np.complex128]

MOST_SD = 0.15  # over the backlash, above which there is no answer
NORMAL_95 = 1.96  # half width over SD

_STEP_S = 7e-4  # of the integration, at most: an eighth of a radian of a ring of 30 Hz
_DRIVEN_HZ = 300.0  # of the motor's motion that drives the load; its own orders, too
_FITTED_HZ = 100.0  # of the torque that is compared, of any ring
_MOST_HARMONICS = 80
_LEAST_HARMONICS = 12
_FEW_HARMONICS = 20  # compared in the search, where the misfit has few minima
_BESIDE = 3  # harmonics to either side whose surroundings tell a harmonic's noise
_LEAST_GRAVITY = 10.0  # of the torque once a turn, in its SDs
_MOST_BELOW = 0.1  # of an inertia that was measured, below the least that its mass has
_MOST_PERIODS = 15  # simulated until the turn comes back to where it began
_RIPPLES = np.arange(
    1, 7, 0.5
)  # orders of the motor's turn, at which gears err, and those between, noise
# Of the torque that the model lacks: cogging's side bands, friction that is not constant. In the search more, for
# there the load's data are still wrong.
_LACKING, _LACKING_AT_FIRST = 0.02, 0.1

# delta [mrad], ln K, ln damping ratio, F / g, gravity's phase, ln g, ln rho, ln (N J_m), the speed's lag and the
# torque's delay [ms]: SDs of the priors, and steps for slopes.
_SD = np.array([np.inf, 1.5, 0.5, 0.3, np.inf, 0.0, 0.0, np.inf, 0.5, 2.0])
_STEP = 1e-3 * np.array([1, 2, 20, 2, 0.5, 2, 2, 1, 10, 10])
_DELTA, _STIFFNESS, _FRICTION, _DELAY = 0, 1, 3, 9  # places
_LOAD = slice(5, 7)
_MEAN_RING_HZ, _MEAN_DAMPING, _MEAN_LAG_MS = 22.0, 0.04, 0.7
_PLAYS = np.array([0.0, 0.05, 0.15, 0.3, 0.5, 0.8, 1.2, 1.7, 2.4])  # mrad
_RINGS_HZ = 10.0, 60.0
_RINGS = np.log((TURN * np.geomspace(*_RINGS_HZ, 9)) ** 2)
_FRICTIONS = np.array([0.02, 0.12, 0.25, 0.4])

# Fixed on 45 development logs of `studies.benches`, before its final seeds were drawn. On these the method erred by
# 7 % beyond what noise explains (the speed's noise makes gravity and damping seem larger), chi squared was below 2,
# and the load's data were within 3 SDs of what was said, but in wrong minima.
_METHOD_ERROR = 0.07  # share of the backlash
_LEAST_SD = 5e-6  # rad: half a count of 19 bits
_MOST_CHI2 = 3.0  # per compared number
_MOST_OFF = 3.5  # SDs of the load's data
_MOST_DELAY_MS = 3.0  # a current loop's and a filter's are below
_MOST_CHANGE = (
    0.03  # of gravity's torque from turn to turn: a backlash that is off by as much is held
)
_MOST_RIPPLE = 0.1  # of gravity's torque; cogging and encoders make a third of it
# Chi squared that a backlash must lose to another to be excluded, and a gap less than none to zero: five SDs, three.
_CLEAR, _LITTLE = 25.0, 9.0
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


class _Turn(NamedTuple):
    """Harmonics of the mean turn from order 1, of the speed over the gear ratio [rad/s] and of the torque.

    With the SDs of their parts; all friction and the change from turn to turn are over gravity's torque, the
    ripple is the acceleration that comes with the motor's turns, over the gear ratio [rad/s^2].
    """

    omega: FloatArray
    speed: ComplexArray
    torque: ComplexArray
    speed_sd: FloatArray
    torque_sd: FloatArray
    is_fitted: NDArray[np.bool_]
    gear_ratio: float
    friction: float
    change: float
    ripple: float


def _harmonics(
    signal: FloatArray, recording: Recording, last: int
) -> tuple[ComplexArray, FloatArray]:
    """Of the mean settled turn, from order 1, and the SD of their parts, by what lies beside them."""
    a_turn = recording.turn_period_s / recording.sample_s
    kept = drop_first_turn(recording)[0].size
    turns = int(kept / a_turn + 1e-6)
    y = signal[-kept:][: round(turns * a_turn)]
    drift = y[-round(a_turn) :].mean() - y[: round(a_turn)].mean()
    y = y - drift / (y.size - a_turn) * np.arange(y.size)
    y -= y.mean()
    bins, between = spectrum(y, turns, last + _BESIDE, turns * a_turn)
    beside = [
        between[max(k - _BESIDE, 0) * turns + turns // 2 : (k + _BESIDE) * turns + 1]
        for k in range(1, last + 1)
    ]
    # The last sample's share of the last turn counts.
    whole = bins + (turns * a_turn - y.size) * y[0] / y.size
    sd = np.sqrt(np.array([float(np.nanmean(power)) for power in beside]))
    return whole[turns::turns][:last], sd


def _mean_turn(recording: Recording, torque: FloatArray) -> _Turn:
    """Harmonics of the mean turn; ValueError where they cannot tell the backlash."""
    name, period = recording.source, recording.turn_period_s
    last, fitted = (
        int(min(hz, 0.45 / recording.sample_s) * period) for hz in (_DRIVEN_HZ, _FITTED_HZ)
    )
    if not (
        torque.shape == recording.v.shape
        and 0 < np.ptp(torque) < np.inf
        and fitted >= _LEAST_HARMONICS
    ):
        needed = f"{recording.v.size} finite numbers that vary, and {_LEAST_HARMONICS} harmonics of the turn to 100 Hz"
        raise ValueError(f"{name}: the torque needs {needed}")
    gear_ratio = recording.commanded_speed_rps * period
    speed, speed_sd = _harmonics(TURN / gear_ratio * recording.v, recording, last)
    found, sd = _harmonics(torque, recording, last)
    size = abs(found[0])
    if size < _LEAST_GRAVITY * sd[0] or torque.mean() < 0:
        raise ValueError(
            f"{name}: the torque shows no gravity, or drives backward; is it this motor's, with its sign?"
        )
    order = np.arange(1, last + 1)
    beside_motor = np.abs(order[:, None] - gear_ratio * np.array(MOTOR_ORDERS)) < 1.5
    return _Turn(
        np.float64(TURN / period) * order,
        speed,
        found,
        speed_sd,
        sd,
        (order <= min(fitted, _MOST_HARMONICS)) & ~beside_motor.any(axis=1),
        gear_ratio,
        float(torque.mean() / (2 * size)),
        _change(recording, torque) / size,
        _ripple(recording) / gear_ratio,
    )


def _change(recording: Recording, torque: FloatArray) -> float:
    """SD of gravity's torque, over turns."""
    turn = recording.t / recording.turn_period_s
    number = turn.astype(np.int64)
    wave = (torque - torque.mean()) * np.exp(-1j * TURN * turn)
    whole = number < int(turn[-1] + 1e-3)
    each = [np.bincount(number[whole], part[whole]) for part in (wave.real, wave.imag)]
    return float(np.std(np.array(each) / np.bincount(number[whole]), axis=1).max())


def _ripple(recording: Recording) -> float:
    """Largest amplitude of the motor's acceleration [rad/s^2] at orders of its own turn, but for those folded low."""
    speed, dt = TURN * recording.v, recording.sample_s
    rate = speed.mean()
    waves = np.exp(-1j * np.outer(_RIPPLES, np.cumsum(speed) * dt))
    size = 2 / speed.size * np.abs(waves @ (speed - rate))
    clear = np.maximum(size[::2] - 3 * np.median(size[1::2]), 0)
    hz = _RIPPLES[::2] * rate / TURN
    is_own = np.abs(hz - np.round(hz * dt) / dt) > _RINGS_HZ[1]
    return float((_RIPPLES[::2] * rate * clear * is_own).max())


@njit
def _contact(forced, slope, step_s, delta, stiffness, damping, start):
    """Contact's torque in each step of the periodic turn of x'' = forced - slope x - torque.

    In a step it is the mean along a straight course, which makes it smooth in all parameters. Newton's method on
    the turn's own slopes finds the start that comes back to itself, from that of the turn before.
    """
    torque = np.empty(forced.size)
    before = np.inf
    if not abs(start[0]) + abs(start[1]) < 1.0:  # of a joint that ran away
        start[:] = 0.0
    for _ in range(_MOST_PERIODS):
        x, v = start
        xx, xv, vx, vv = 1.0, 0.0, 0.0, 1.0  # slopes of x and v by those at the start
        for i in range(forced.size):
            mean = touch = 0.0
            for side in (1.0, -1.0):
                deep = side * x - delta
                deeper = deep + side * step_s * v
                most, least = max(deep, deeper), min(deep, deeper)
                if most > 0:
                    share = 1.0 if least >= 0 else most / (most - least)
                    touch += share
                    mean += side * 0.5 * share * (most + max(least, 0.0))
            torque[i] = stiffness * mean + damping * touch * v
            if touch <= 1 and torque[i] * mean <= 0:  # teeth do not pull
                torque[i] = touch = 0.0
            pull = stiffness * touch + slope[i]
            brake = 0.5 * step_s * pull + damping * touch
            v1 = v + step_s * (forced[i] - slope[i] * (x + 0.5 * step_s * v) - torque[i])
            v1x = vx - step_s * (pull * xx + brake * vx)
            v1v = vv - step_s * (pull * xv + brake * vv)
            x += 0.5 * step_s * (v + v1)
            xx += 0.5 * step_s * (vx + v1x)
            xv += 0.5 * step_s * (vv + v1v)
            v, vx, vv = v1, v1x, v1v
        dx, dv = x - start[0], v - start[1]
        off = abs(dx) + abs(dv) / np.sqrt(stiffness)
        if off < 1e-10:
            break
        determinant = (1 - xx) * (1 - vv) - xv * vx
        if off < before and determinant > 1e-9:
            dx, dv = (
                ((1 - vv) * dx + xv * dv) / determinant,
                (vx * dx + (1 - xx) * dv) / determinant,
            )
        start[0] += dx
        start[1] += dv
        before = off
    return torque


class _Joint:
    """A mean turn with its priors; `compare` says how much of it a fit takes, and how well it must agree."""

    def __init__(self, turn: _Turn, load: LoadData):
        from scipy.ndimage import uniform_filter1d  # slow to import

        self.turn = turn
        g, rho = load.gravity_per_s2, load.inertia_ratio
        turning = (1 + rho) * 1j * turn.omega[0] * turn.speed[0]
        way = turn.torque[0]
        for _ in range(4):  # what is not gravity's is small
            pull = 0.5 * rho * g * way / abs(way) + turning
            drive = abs(turn.torque[0] / pull)
            way = turn.torque[0] / drive - turning
        phase = np.angle(1j * way)
        known = np.log([_MEAN_DAMPING, g, rho, drive])
        stiffness = 2 * np.log(TURN * _MEAN_RING_HZ)
        self.mean = np.array([0, stiffness, known[0], 0, phase, *known[1:], _MEAN_LAG_MS, 0])
        self.sd = _SD.copy()
        self.sd[_LOAD] = np.array([load.gravity_sd, load.inertia_sd]) + 1e-3
        power = np.abs(turn.torque) ** 2
        power[1:] = uniform_filter1d(power[1:], 2 * _BESIDE + 1)
        self.size = np.sqrt(power / 2)

    def compare(self, lacking: float, harmonics: int, step_s: float) -> None:
        """Compare so many harmonics, whose torque the model lacks a share of."""
        turn = self.turn
        self.used = turn.is_fitted & (np.arange(turn.omega.size) < harmonics)
        self.lacking = lacking * self.size[self.used]
        self.over_noise = np.ones_like(self.lacking)
        least = max(TURN / turn.omega[0] / step_s, 2 * turn.omega.size + 2)
        self.steps = 2 * next_fast_len(int(least / 2) + 1, real=True)
        self.start = np.zeros(2)

    def weigh(self, theta: FloatArray) -> None:
        """Count what the model lacks as a multiple of this joint's noise: else the least noisy joint would fit best."""
        noise = self.noise(theta)
        self.over_noise = np.hypot(noise, self.lacking) / noise
        self.lacking = np.zeros_like(noise)

    def noise(self, theta: FloatArray) -> FloatArray:
        """SDs of the torque's harmonics, with what the joint in contact makes of the speed's noise."""
        turn, used = self.turn, self.used
        k, zeta, rho, drive = np.exp(np.clip(theta[[1, 2, 6, 7]], -20, 20))
        omega = turn.omega[used]
        spring = k + 2j * zeta * np.sqrt(k) * omega
        gain = (
            drive
            * omega
            * (1 + 1e-3j * theta[8] * omega)
            * (1 + rho * spring / (spring - omega**2))
        )
        return np.hypot(np.abs(gain) * turn.speed_sd[used], turn.torque_sd[used])

    def residuals(self, theta: FloatArray) -> FloatArray:
        """Of the torque's harmonics and of the priors, over their SDs."""
        delta, *logs, lag, delay = theta
        k, zeta, g, rho, drive = np.exp(np.clip(np.array(logs)[[0, 1, 4, 5, 6]], -20, 20))
        friction, phase = logs[2:4]
        omega, count = self.turn.omega, self.turn.omega.size
        speed = self.turn.speed * (1 + 1e-3j * lag * omega)
        step_s = TURN / omega[0] / self.steps
        middle = np.exp(0.5j * step_s * omega)
        waves = np.zeros((2, self.steps // 2 + 1), dtype=complex)
        waves[:, 1 : count + 1] = middle * np.array([speed / (1j * omega), 1j * omega * speed])
        moved, pushed = np.fft.irfft(waves, self.steps) * self.steps
        angle = phase + moved + TURN / self.steps * (np.arange(self.steps) + 0.5)
        forced = pushed + g * (np.sin(angle) + friction)
        damping = 2 * zeta * np.sqrt(k)
        passed = _contact(forced, g * np.cos(angle), step_s, 1e-3 * delta, k, damping, self.start)
        contact = np.fft.rfft(passed)[1 : count + 1] / middle / self.steps
        torque = drive * (1j * omega * speed + rho * contact) * np.exp(-1e-3j * delay * omega)
        sd = np.hypot(self.over_noise * self.noise(theta), self.lacking)
        rest = (torque - self.turn.torque)[self.used] / sd
        prior = (theta - self.mean) / self.sd
        prior[_FRICTION] *= 1 if friction > 0 else 10
        beyond = (
            max(friction - self.turn.friction, 0) / 0.05
        )  # the motor's friction is not negative
        return np.nan_to_num(np.concatenate([rest.real, rest.imag, prior, [beyond]]), nan=1e6)

    def chi2(self, theta: FloatArray) -> float:
        """Sum of the squared residuals, whatever joint was simulated before."""
        self.start[:] = 0.0
        return float(np.sum(self.residuals(theta) ** 2))

    def slopes(self, theta: FloatArray, is_central: bool = True) -> FloatArray:
        """Derivatives of the residuals, shape (residuals, unknowns)."""
        steps = np.diag(_STEP)
        if is_central:
            moved = [(self.residuals(theta + h) - self.residuals(theta - h)) / 2 for h in steps]
        else:
            here = self.residuals(theta)
            moved = [self.residuals(theta + h) - here for h in steps]
        return np.transpose(moved) / _STEP

    def hold(self, theta: FloatArray, delta_mrad: float) -> FloatArray:
        """The best joint of a backlash, from another's."""
        start = theta.copy()
        start[_DELTA] = delta_mrad
        return self.descend(start, 30, 1e-4, holds_delta=True)

    def descend(
        self, start: FloatArray, steps: int, least: float, holds_delta: bool = False
    ) -> FloatArray:
        """Least squares by Levenberg and Marquardt, in a trust region."""
        from scipy.optimize import least_squares  # slow to import

        kept = slice(1 if holds_delta else 0, None)
        self.start[:] = 0.0

        def whole(part: FloatArray) -> FloatArray:
            return np.append(start[:1], part) if holds_delta else part

        found = least_squares(
            lambda part: self.residuals(whole(part)),
            start[kept],
            lambda part: self.slopes(whole(part), steps > 10)[:, kept],
            x_scale=_STEP[kept],
            ftol=least,
            xtol=None,
            gtol=None,
            max_nfev=steps,
        )
        return whole(found.x)


def _search(joint: _Joint) -> FloatArray:
    """The best of descents from many plays, stiffnesses and frictions."""
    joint.compare(_LACKING_AT_FIRST, _FEW_HARMONICS, 2 * _STEP_S)
    frictions = _FRICTIONS[: max(np.searchsorted(_FRICTIONS, joint.turn.friction), 2)]
    starts = []
    for delta in _PLAYS:
        rows = np.tile(joint.mean, (_RINGS.size, frictions.size, 1))
        rows[..., _DELTA] = delta
        rows[..., _STIFFNESS] = _RINGS[:, None]
        rows[..., _FRICTION] = frictions
        by_ring = [min(row, key=joint.chi2) for row in rows]
        by_ring.sort(key=joint.chi2)
        others = [row for row in by_ring if abs(row[_STIFFNESS] - by_ring[0][_STIFFNESS]) > 0.5]
        starts += [by_ring[0], others[0]]
    found = sorted((joint.descend(theta, 7, 1e-2) for theta in starts), key=joint.chi2)
    found = sorted((joint.descend(theta, 8, 1e-3) for theta in found[:6]), key=joint.chi2)
    joint.compare(_LACKING, _MOST_HARMONICS, _STEP_S)
    joint.weigh(found[0])
    found = [joint.descend(theta, 12, 1e-3) for theta in found[:3]]
    best = min(found, key=joint.chi2)
    for share, stiffer in ((1.06, 0.15), (0.94, -0.15), (1.06, -0.15), (0.94, 0.15)):
        again = best.copy()
        again[_DELTA] *= share
        again[_STIFFNESS] += stiffer
        found.append(joint.descend(again, 8, 1e-3))
    return joint.descend(min(found, key=joint.chi2), 40, 1e-9)


def _check(joint: _Joint, theta: FloatArray, misfit: float) -> None:
    """Refuse what no joint of the model is, with its likely cause."""
    turn, delay = joint.turn, theta[_DELAY]
    if turn.change > _MOST_CHANGE:
        raise ValueError(
            f"gravity's torque changes by {turn.change:.0%} from turn to turn; does another axis move?"
        )
    ripple = turn.ripple / np.exp(joint.mean[_LOAD].sum())
    if ripple > _MOST_RIPPLE:
        raise ValueError(
            f"a ripple with the motor's turns is {ripple:.0%} of gravity; does the gear's error part the teeth?"
        )
    off = (theta - joint.mean)[_LOAD] / joint.sd[_LOAD]
    if misfit > _MOST_CHI2 or np.abs(off).max() > _MOST_OFF:
        raise ValueError(
            f"no joint fits speed and torque (chi squared {misfit:.2g}, gravity {off[0]:+.1f} and inertia ratio "
            f"{off[1]:+.1f} SDs off, torque {delay:.1f} ms late); are the load's data right? is there a belt, "
            "another axis, or an error of the gear?"
        )
    if abs(delay) > _MOST_DELAY_MS:
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
    joint = _Joint(_mean_turn(recording, np.asarray(torque, dtype=float)), load)
    if joint.turn.friction >= 1:
        return TorqueFit(np.nan, (np.nan, np.nan), np.nan, np.nan, reverses=False)
    theta = _search(joint)
    misfit = max(joint.chi2(theta) / (2 * np.count_nonzero(joint.used)), 1.0)

    def lost_by(other_mrad: float) -> float:
        return joint.chi2(joint.hold(theta, other_mrad)) - joint.chi2(theta)

    _check(joint, theta, misfit)
    if theta[_DELTA] < 0 and lost_by(0.0) < _LITTLE * misfit:
        theta = joint.hold(theta, 0.0)
    delta = 1e-3 * float(theta[_DELTA])
    slopes = joint.slopes(theta)
    of_log = 1e-3 * np.sqrt(
        misfit * np.linalg.inv(slopes.T @ slopes + 1e-9 * np.eye(theta.size))[0, 0]
    )
    deviation = float(np.linalg.norm([of_log, _METHOD_ERROR * delta, _LEAST_SD]))
    inertia = float(np.exp(theta[7]) / joint.turn.gear_ratio)
    advice = "turn the joint faster (twice as fast, about half the SD), log more turns, or with a finer encoder"
    fit = replace(
        conclude(delta, deviation, inertia, advice),
        friction_share=abs(float(theta[_FRICTION])),
        stiffness_per_s2=float(np.exp(theta[_STIFFNESS])),
    )
    if delta < 0:
        raise ValueError(
            f"a gap of {delta:.2g} rad, less than none, fits best; are the load's data right?"
        )
    if fit.interval_rad[1] < _NEGLIGIBLE_RAD:
        is_none = lost_by(1e3 * _NEGLIGIBLE_RAD) > _CLEAR * misfit
        reason = "" if is_none else f"{_NEGLIGIBLE_RAD:g} rad fits nearly as well as none; {advice}"
        return replace(fit, is_none=is_none, refusal_reason=reason)
    if not fit.refusal_reason and lost_by(0.0) < _CLEAR * misfit:
        return replace(fit, refusal_reason=f"none fits nearly as well as {delta:.2g} rad; {advice}")
    return fit
