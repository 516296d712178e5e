"""The load alone, simulated, driven by the measured motor motion, and the torque that it asks of the motor.

With x = theta_m / N - q the wind-up:

    x'' = a / N - c + g sin(q) + F,     T = J_m (a + N rho c)

where c, the contact's torque over the load's inertia J_l, is that of spring and damper beyond the gap of delta
to either side, and never pulls; a is the motor's acceleration, g = m g r / J_l, rho = J_l / (N^2 J_m) and F the
load's friction, which sets the instants at which the teeth part. Neither the drive nor the motor's own friction
is in it.

The torque is compared harmonic by harmonic of the mean turn. Noise of the speed reaches it through the model: each
harmonic's SD is that of both columns there, by the joint with its teeth in contact, and a share of the torque that
the model lacks. Slopes are integrated with the load, and sums are plain loops: BLAS rounds by the processor.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from backlash.detection.pattern import MOTOR_ORDERS
from backlash.fitting.harmonics import spectrum
from backlash.fitting.waveform import drop_first_turn
from replication.arrays import FloatArray
from replication.compiling import njit
from replication.records import Recording
from replication.simulator.parameters import TURN

ComplexArray = NDArray[np.complex128]

# Places of the unknowns: delta [mrad], ln K, ln damping ratio, F / g, gravity's phase, ln g, the speed's lag [ms],
# ln rho, ln (N J_m), the torque's delay [ms].
DELTA, STIFFNESS, DAMPING, FRICTION, PHASE, PULL, LAG, RATIO, DRIVE, DELAY = range(10)
LOAD = [PULL, RATIO]
_OF_CONTACT = 7  # unknowns that the contact depends on, the first ones

_DRIVEN_HZ = 300.0  # of the motor's motion that drives the load; its own orders, too
_FITTED_HZ = 100.0  # of the torque that is compared, of any ring
MOST_HARMONICS = 80
_LEAST_HARMONICS = 12
_BESIDE = 3  # harmonics to either side whose surroundings tell a harmonic's noise
_LEAST_GRAVITY = 10.0  # of the torque once a turn, in its SDs
_MOST_PERIODS = 40  # simulated until the turn comes back to where it began
_MOST_OFF_RAD = 1e-11
# Orders of the motor's turn, at which gears err, and those between, noise.
_RIPPLES = np.arange(1, 7, 0.5)
RINGS_HZ = 10.0, 60.0


class Turn(NamedTuple):
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


class Comparison(NamedTuple):
    """Harmonics that are compared, and the motion in the middle of each step, as it is and its slope by the lag."""

    order: NDArray[np.int64]
    omega: FloatArray
    speed: ComplexArray
    torque: ComplexArray
    speed_sd: FloatArray
    torque_sd: FloatArray
    lacking: FloatArray  # SD of what the model lacks
    middle: ComplexArray  # of the steps, as phase
    step_s: float
    angle: FloatArray
    angle_slope: FloatArray
    pushed: FloatArray
    pushed_slope: FloatArray


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


def mean_turn(recording: Recording, torque: FloatArray) -> Turn:
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
    return Turn(
        np.float64(TURN / period) * order,
        speed,
        found,
        speed_sd,
        sd,
        (order <= min(fitted, MOST_HARMONICS)) & ~beside_motor.any(axis=1),
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
    size = 2 / speed.size * np.abs(np.sum(waves * (speed - rate), axis=1))
    clear = np.maximum(size[::2] - 3 * np.median(size[1::2]), 0)
    hz = _RIPPLES[::2] * rate / TURN
    is_own = np.abs(hz - np.round(hz * dt) / dt) > RINGS_HZ[1]
    return float((_RIPPLES[::2] * rate * clear * is_own).max())


def compare(turn: Turn, lacking: float, harmonics: int, step_s: float) -> Comparison:
    """Prepare so many harmonics, whose torque the model lacks a share of, and steps of so long at most."""
    from scipy.ndimage import uniform_filter1d  # slow to import

    used = turn.is_fitted & (np.arange(turn.omega.size) < harmonics)
    power = np.abs(turn.torque) ** 2
    power[1:] = uniform_filter1d(power[1:], 2 * _BESIDE + 1)
    least = max(TURN / turn.omega[0] / step_s, 2 * turn.omega.size + 2)
    steps = 2 * next_fast_len(int(least / 2) + 1, real=True)
    step_s = TURN / turn.omega[0] / steps
    middle = np.exp(0.5j * step_s * turn.omega)
    waves = np.zeros((4, steps // 2 + 1), dtype=complex)
    for k in range(4):  # the angle, its slope by the lag, and both their second slopes by time
        waves[k, 1 : turn.omega.size + 1] = (
            middle * turn.speed * 1e-3 ** (k % 2) * (1j * turn.omega) ** (k // 2 * 2 + k % 2 - 1)
        )
    angle, angle_slope, pushed, pushed_slope = np.fft.irfft(waves, steps) * steps
    angle += TURN / steps * (np.arange(steps) + 0.5)
    return Comparison(
        np.flatnonzero(used) + 1,
        turn.omega[used],
        turn.speed[used],
        turn.torque[used],
        turn.speed_sd[used],
        turn.torque_sd[used],
        lacking * np.sqrt(power / 2)[used],
        middle[used] * steps,
        step_s,
        angle,
        angle_slope,
        pushed,
        pushed_slope,
    )


@njit(inner=True)
def _press(deep, deeper):
    """Mean of what is above 0 on a straight course between two depths, the share of the course, and their slopes."""
    most, least = max(deep, deeper), min(deep, deeper)
    if most <= 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if least >= 0:
        return 0.5 * (most + least), 1.0, 0.5, 0.5, 0.0, 0.0
    share = most / (most - least)
    by_least = 0.5 * share * share
    by_most = share - by_least
    longer = most / (most - least) ** 2
    shorter = -least / (most - least) ** 2
    if deep > deeper:
        return 0.5 * share * most, share, by_most, by_least, shorter, longer
    return 0.5 * share * most, share, by_least, by_most, longer, shorter


@njit
def _simulate(theta, motion, start, columns, torque, slopes):
    """Contact's torque in each step of the turn that begins at `start`, and its first so many slopes.

    Columns are by x and v at the start, then by the unknowns. In a step the contact is the mean along a straight
    course, which makes it smooth in all of them. Returns x and v at the end with their slopes.
    """
    h = motion.step_s
    delta, stiffness = 1e-3 * theta[DELTA], np.exp(theta[STIFFNESS])
    damping = 2 * np.exp(theta[DAMPING]) * np.sqrt(stiffness)
    gravity = np.exp(theta[PULL])
    friction, lag = theta[FRICTION], theta[LAG]
    x, v = start
    end = np.eye(2, 10)
    forced_by = np.zeros(10)
    slope_by, contact_by = np.zeros(10), np.zeros(10)
    forced_by[2 + FRICTION] = gravity
    for i in range(torque.size):
        angle = motion.angle[i] + lag * motion.angle_slope[i] + theta[PHASE]
        sine, falling = gravity * np.sin(angle), gravity * np.cos(angle)
        forced = motion.pushed[i] + lag * motion.pushed_slope[i] + sine + gravity * friction
        mean = touch = by_deep = by_deeper = touch_by_deep = touch_by_deeper = 0.0
        side = touch_by_gap = 0.0
        for way in (1.0, -1.0):
            deep = way * x - delta
            m, t, a, b, c, e = _press(deep, deep + way * h * v)
            mean += way * m
            touch += t
            by_deep += a
            by_deeper += b
            touch_by_deep += way * c
            touch_by_deeper += way * e
            side += way * (a + b)
            touch_by_gap += c + e
        pushed = stiffness * mean + damping * touch * v
        is_parting = touch <= 1 and pushed * mean <= 0  # teeth do not pull
        torque[i] = 0.0 if is_parting else pushed
        middle = x + 0.5 * h * v
        v1 = v + h * (forced - falling * middle - torque[i])
        if columns > 2:
            forced_by[2 + PHASE], slope_by[2 + PHASE] = falling, -sine
            forced_by[2 + PULL], slope_by[2 + PULL] = sine + gravity * friction, falling
            forced_by[2 + LAG] = motion.pushed_slope[i] + falling * motion.angle_slope[i]
            slope_by[2 + LAG] = -sine * motion.angle_slope[i]
            contact_by[2 + DELTA] = -1e-3 * (stiffness * side + damping * v * touch_by_gap)
            contact_by[2 + STIFFNESS] = stiffness * mean + 0.5 * damping * touch * v
            contact_by[2 + DAMPING] = damping * touch * v
        for k in range(columns):
            by_x, by_v = end[0, k], end[1, k]
            by = 0.0
            if not is_parting:
                by = contact_by[k] + stiffness * (by_deep * by_x + by_deeper * (by_x + h * by_v))
                by += damping * v * (touch_by_deep * by_x + touch_by_deeper * (by_x + h * by_v))
                by += damping * touch * by_v
            slopes[k, i] = by
            pull = slope_by[k] * middle + falling * (by_x + 0.5 * h * by_v)
            end[1, k] = by_v + h * (forced_by[k] - pull - by)
            end[0, k] = by_x + 0.5 * h * (by_v + end[1, k])
        x += 0.5 * h * (v + v1)
        v = v1
    return x, v, end


@njit
def _return(theta, motion, start, torque, slopes):
    """Newton's method for the turn that comes back to its start, which is changed in place; whether it does."""
    before = np.inf
    for _ in range(_MOST_PERIODS):
        x, v, end = _simulate(theta, motion, start, 2, torque, slopes)
        dx, dv = x - start[0], v - start[1]
        off = abs(dx) + abs(dv) * np.exp(-0.5 * theta[STIFFNESS])
        if off < _MOST_OFF_RAD:
            return True
        if not off < 1.0:  # ran away
            return False
        xx, xv = end[0, 0], end[0, 1]
        vx, vv = end[1, 0], end[1, 1]
        determinant = (1 - xx) * (1 - vv) - xv * vx
        if off < before and determinant > 1e-9:
            dx, dv = (
                ((1 - vv) * dx + xv * dv) / determinant,
                (vx * dx + (1 - xx) * dv) / determinant,
            )
        start[0] += dx
        start[1] += dv
        before = off
    return False


@njit
def _settle(theta, motion, start, torque, slopes):
    """Slopes of the contact's torque by the unknowns, those of the start included; whether there are any."""
    _, _, end = _simulate(theta, motion, start, 2 + _OF_CONTACT, torque, slopes)
    xx, xv = end[0, 0], end[0, 1]
    vx, vv = end[1, 0], end[1, 1]
    determinant = (1 - xx) * (1 - vv) - xv * vx
    if abs(determinant) < 1e-9:
        return False
    for k in range(2, 2 + _OF_CONTACT):
        by_x = ((1 - vv) * end[0, k] + xv * end[1, k]) / determinant
        by_v = (vx * end[0, k] + (1 - xx) * end[1, k]) / determinant
        for i in range(torque.size):
            slopes[k, i] += by_x * slopes[0, i] + by_v * slopes[1, i]
    return True


@njit
def _weigh(theta, c, contact, by_contact, rest, by):
    """Write the residuals of the torque's harmonics over their SDs, and their slopes, shape (2, harmonics, ...)."""
    k, zeta = np.exp(theta[STIFFNESS]), np.exp(theta[DAMPING])
    rho, drive = np.exp(theta[RATIO]), np.exp(theta[DRIVE])
    slope = np.zeros(10, dtype=np.complex128)
    for i in range(c.omega.size):
        omega = c.omega[i]
        lagged = 1 + 1e-3j * theta[LAG] * omega
        spring = k + 2j * zeta * np.sqrt(k) * omega
        over = 1 / (spring - omega**2)
        carried = 1 + rho * spring * over
        gain = drive * omega * abs(lagged) * abs(carried)
        sd2 = (gain * c.speed_sd[i]) ** 2 + c.torque_sd[i] ** 2 + c.lacking[i] ** 2
        late = np.exp(-1e-3j * theta[DELAY] * omega)
        turning = drive * late * 1j * omega * c.speed[i]
        for p in range(by_contact.shape[0]):
            slope[p] = drive * late * rho * by_contact[p, i] / c.middle[i]
        slope[LAG] += turning * 1e-3j * omega
        slope[RATIO] = drive * late * rho * contact[i] / c.middle[i]
        slope[DRIVE] = turning * lagged + slope[RATIO]
        slope[DELAY] = -1e-3j * omega * slope[DRIVE]
        sd = np.sqrt(sd2)
        left = (slope[DRIVE] - c.torque[i]) / sd
        rest[0, i], rest[1, i] = left.real, left.imag
        bend = -rho * omega**2 * over**2 / carried  # of ln gain by the spring
        share = (gain * c.speed_sd[i]) ** 2 / sd2
        for p in range(by.shape[2]):
            wider = 0.0
            if p == STIFFNESS:
                wider = (bend * 0.5 * (spring + k)).real
            elif p == DAMPING:
                wider = (bend * (spring - k)).real
            elif p == LAG:
                wider = (1e-3j * omega / lagged).real
            elif p == RATIO:
                wider = ((carried - 1) / carried).real
            elif p == DRIVE:
                wider = 1.0
            each = slope[p] / sd - left * share * wider
            by[0, i, p], by[1, i, p] = each.real, each.imag


def residuals(
    theta: FloatArray, compared: Comparison, start: FloatArray, wants_slopes: bool = True
) -> tuple[FloatArray, FloatArray] | None:
    """Of the torque's harmonics over their SDs, and slopes; `start` moves to the turn's own; None without one."""
    torque = np.empty(compared.angle.size)
    slopes = np.empty((2 + _OF_CONTACT, torque.size))
    if not _return(theta, compared, start, torque, slopes):
        return None
    if wants_slopes and not _settle(theta, compared, start, torque, slopes):
        return None
    orders = compared.order
    contact = np.fft.rfft(torque)[orders]
    by_contact = np.fft.rfft(slopes[2:] if wants_slopes else slopes[:0])[:, orders]
    rest = np.empty((2, orders.size))
    by = np.empty((2, orders.size, theta.size if wants_slopes else 0))
    _weigh(theta, compared, contact, by_contact, rest, by)
    return rest.ravel(), by.reshape(rest.size, -1)
