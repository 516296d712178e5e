"""The load alone, driven by the measured motor motion, and the torque that it asks of the motor.

With x = theta_m / N - q the wind-up of the joint:

    x'' = a / N - c + g sin(q) + g F        the load under the contact torque c, gravity and friction
    c = K (p(delta) + p(delta + e)) / 2 + D x' [in contact]     springs and damper
    T = J_m (a + N rho (c + mu |c|))        the motor's torque, with the loss in the gear

where p(gap) is how far x is beyond a gap to either side: over e beyond the teeth's gap of delta the spring is half as
stiff, as strain wave gears' are near zero torque. c is over the load's inertia J_l and never pulls, a is the motor's
acceleration, g = m g r / J_l, rho = J_l / (N^2 J_m), F the load's friction over gravity, which sets the instants at
which the teeth part, and mu the loss: the gear's efficiency is 1 / (1 + mu) where the motor drives. The torque is
logged late, through a low-pass of first order. Neither the drive nor the motor's own friction is in it.

The torque is compared harmonic by harmonic of the mean turn. Noise of the speed reaches it through the model: each
harmonic's SD is that of both columns there, by the joint with its teeth in contact, and a model error, a share of the
torque. Slopes by the unknowns are integrated with the load.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.ndimage import uniform_filter1d

from backlash.turns import TURN, ComplexArray, Harmonics
from replication import njit
from replication.signature import FloatArray

# Unknowns, and their places: delta [mrad], the logarithms of K [1/s^2], of the damping ratio, e [mrad]; F, gravity's
# phase [rad], the logarithm of g [1/s^2], the speed's lag [ms]; the logarithms of rho and of N J_m, the torque's delay
# [ms], mu, the time constant of the torque's low-pass [ms].
UNKNOWNS = (
    *("delta_mrad", "ln_stiffness", "ln_damping", "soft_mrad"),
    *("friction", "phase_rad", "ln_gravity", "lag_ms"),
    *("ln_inertia_ratio", "ln_drive", "delay_ms", "loss", "filter_ms"),
)
DELTA, STIFFNESS, DAMPING, SOFT, FRICTION, PHASE, GRAVITY, LAG = range(8)
RATIO, DRIVE, DELAY, LOSS, FILTER = range(8, 13)
_OF_CONTACT = 8  # unknowns that the contact torque depends on, the first ones
_OF_SD = [STIFFNESS, DAMPING, LAG, RATIO, DRIVE, FILTER]  # those that the torque's SD depends on

# Of K up to e: catalogues of strain wave gears have 0.4 to 0.8 (K_1 / K_3 and K_1 / K_2).
_SOFT_SHARE = 0.5
_MOST_TURNS = 40  # simulated until the orbit closes; Newton's method needs 3 to 10
_CLOSED_RAD = 1e-11  # a millionth of the least backlash that matters


class Comparison(NamedTuple):
    """Harmonics that are compared, and the motor's motion that drives the load."""

    order: NDArray[np.int64]
    omega: FloatArray
    speed: ComplexArray
    torque: ComplexArray
    speed_sd: FloatArray
    torque_sd: FloatArray
    model_error: FloatArray  # SD
    mid_step: ComplexArray  # the phase of half a step, times the number of steps
    step_s: float
    motion: FloatArray  # angle and acceleration in the middle of each step, each with its slope by the lag [ms]
    smoothing: float  # contact torque below which the loss is smooth [1/s^2]


def compare(
    speed: Harmonics,
    torque: Harmonics,
    used: NDArray[np.bool_],
    model_error: float,
    step_s: float,
    smoothing: float,
) -> Comparison:
    """Prepare the used ones of the torque's harmonics, and the motion by all of the speed's, in steps of `step_s`."""
    power = np.abs(torque.coefficient) ** 2
    power[1:] = uniform_filter1d(power[1:], 7)
    turn_s = TURN / speed.omega[0]
    least = int(max(turn_s / step_s, 2 * speed.order.size + 2) / 2) + 1
    steps = 2 * next_fast_len(least, real=True)
    half_step = np.exp(0.5j * turn_s / steps * speed.omega)
    waves = np.zeros((4, steps // 2 + 1), dtype=complex)
    for k, (factor, derivative) in enumerate([(1.0, -1), (1e-3, 0), (1.0, 1), (1e-3, 2)]):
        motion = factor * speed.coefficient * (1j * speed.omega) ** derivative
        waves[k, speed.order] = half_step * motion
    motion = np.fft.irfft(waves, steps) * steps
    motion[0] += TURN / steps * (np.arange(steps) + 0.5)
    return Comparison(
        order=speed.order[used],
        omega=speed.omega[used],
        speed=speed.coefficient[used],
        torque=torque.coefficient[used],
        speed_sd=speed.sd[used],
        torque_sd=torque.sd[used],
        model_error=model_error * np.sqrt(power / 2)[used],
        mid_step=half_step[used] * steps,
        step_s=turn_s / steps,
        motion=motion,
        smoothing=smoothing,
    )


@njit
def _mean_depth(a, b):
    """Mean of what is above 0 on a straight course from depth a to b, that share of it, and their slopes by a and b."""
    if a <= 0 and b <= 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if a >= 0 and b >= 0:
        return 0.5 * (a + b), 1.0, 0.5, 0.5, 0.0, 0.0
    above_a, above_b = max(a, 0.0), max(b, 0.0)
    mean = 0.5 * (above_b**2 - above_a**2) / (b - a)
    share = (above_b - above_a) / (b - a)
    by_a, by_b = (mean - above_a) / (b - a), (above_b - mean) / (b - a)
    return mean, share, by_a, by_b, (share - (a > 0)) / (b - a), ((b > 0) - share) / (b - a)


@njit
def _contact_torque(x, v, h, delta, K, D, soft):
    """The contact torque of a step h, and its slopes by x, x', delta [mrad], ln K, ln of the damping ratio, e [mrad].

    It is the mean along the straight course from x to x + h x', which makes it smooth in all of them.
    """
    p = p_x = p_v = p_delta = p_soft = 0.0
    touching = touching_x = touching_v = touching_delta = 0.0
    for side in (1.0, -1.0):
        depth = side * x - delta
        end = depth + side * h * v
        if depth <= 0 and end <= 0:
            continue
        mean, share, by_a, by_b, share_a, share_b = _mean_depth(depth, end)
        touching += share
        touching_x += side * (share_a + share_b)
        touching_v += side * h * share_b
        touching_delta -= share_a + share_b
        p += side * _SOFT_SHARE * mean
        p_x += _SOFT_SHARE * (by_a + by_b)
        p_v += _SOFT_SHARE * h * by_b
        p_delta -= side * _SOFT_SHARE * (by_a + by_b)
        mean, share, by_a, by_b, share_a, share_b = _mean_depth(depth - soft, end - soft)
        p += side * (1 - _SOFT_SHARE) * mean
        p_x += (1 - _SOFT_SHARE) * (by_a + by_b)
        p_v += (1 - _SOFT_SHARE) * h * by_b
        p_soft -= side * (1 - _SOFT_SHARE) * (by_a + by_b)
    p_delta += p_soft
    c = K * p + D * touching * v
    if touching <= 1 and c * p <= 0:  # teeth do not pull
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    c_x = K * p_x + D * v * touching_x
    c_v = K * p_v + D * v * touching_v + D * touching
    c_delta = 1e-3 * (K * p_delta + D * v * touching_delta)
    damper = D * touching * v
    return c, c_x, c_v, c_delta, K * p + 0.5 * damper, damper, 1e-3 * K * p_soft


@njit
def _simulate_turn(theta, h, force, cosine, drive_by, state, state_by, contact, contact_by):
    """Move x and x' on by a turn of x'' = force - cosine x - c, with their slopes, shape (2, columns).

    Columns are x and x' at the turn's start, then the unknowns, by which the drive has the slopes `drive_by`, shape
    (2, unknowns, steps); `contact` and `contact_by` receive c and its slopes.
    """
    delta, K, soft = 1e-3 * theta[DELTA], np.exp(theta[STIFFNESS]), 1e-3 * theta[SOFT]
    D = 2 * np.exp(theta[DAMPING]) * np.sqrt(K)
    c_by = np.zeros(2 + _OF_CONTACT)
    x, v = state
    for i in range(force.size):
        c, c_x, c_v, c_delta, c_stiffness, c_damping, c_soft = _contact_torque(
            x, v, h, delta, K, D, soft
        )
        c_by[2 + DELTA] = c_delta
        c_by[2 + STIFFNESS] = c_stiffness
        c_by[2 + DAMPING] = c_damping
        c_by[2 + SOFT] = c_soft
        contact[i] = c
        middle = x + 0.5 * h * v
        v_end = v + h * (force[i] - cosine[i] * middle - c)
        for k in range(state_by.shape[1]):
            x_k, v_k = state_by[0, k], state_by[1, k]
            c_k = c_by[k] + c_x * x_k + c_v * v_k
            force_k = -cosine[i] * (x_k + 0.5 * h * v_k)
            if k >= 2:
                force_k += drive_by[0, k - 2, i] - drive_by[1, k - 2, i] * middle
            v_end_k = v_k + h * (force_k - c_k)
            state_by[0, k] += 0.5 * h * (v_k + v_end_k)
            state_by[1, k] = v_end_k
            contact_by[k, i] = c_k
        x += 0.5 * h * (v + v_end)
        v = v_end
    state[0], state[1] = x, v


def _drive_load(theta: FloatArray, c: Comparison) -> FloatArray:
    """What drives the load, a / N + g sin(q) + g F = force - cosine x, to the first order in x: force, cosine, sine."""
    angle, angle_by_lag, acceleration, acceleration_by_lag = c.motion
    angle = angle + theta[LAG] * angle_by_lag + theta[PHASE]
    g = np.exp(theta[GRAVITY])
    sine = g * np.sin(angle)
    force = acceleration + theta[LAG] * acceleration_by_lag + sine + g * theta[FRICTION]
    return np.array([force, g * np.cos(angle), sine])


def _drive_slopes(theta: FloatArray, c: Comparison, drive: FloatArray) -> FloatArray:
    """Slopes of force and cosine by the unknowns, shape (2, unknowns, steps)."""
    _, cosine, sine = drive
    _, angle_by_lag, _, acceleration_by_lag = c.motion
    by = np.zeros((2, _OF_CONTACT, sine.size))
    by[0, FRICTION] = g = np.exp(theta[GRAVITY])
    by[:, PHASE] = cosine, -sine
    by[:, GRAVITY] = sine + g * theta[FRICTION], cosine
    by[:, LAG] = acceleration_by_lag + cosine * angle_by_lag, -sine * angle_by_lag
    return by


class Orbit(NamedTuple):
    """A periodic orbit: x and x' where the turn begins, the contact torque of each step, and what drives the load."""

    start: FloatArray
    contact: FloatArray
    drive: FloatArray


def find_orbit(theta: FloatArray, c: Comparison, start: FloatArray) -> Orbit | None:
    """Find the turn that ends where it begins, by Newton's method; None where there is none."""
    drive = _drive_load(theta, c)
    start, contact = start.copy(), np.empty(drive.shape[1])
    is_closed = _close_orbit(theta, c.step_s, drive, start, contact)
    return Orbit(start, contact, drive) if is_closed else None


@njit
def _close_orbit(theta, h, drive, start, contact):
    """Move the start until its turn ends there; whether it does."""
    force, cosine, _ = drive
    no_unknowns, contact_by = np.empty((2, 0, 0)), np.empty((2, force.size))
    before = np.inf
    for _ in range(_MOST_TURNS):
        end, by = start.copy(), np.eye(2)
        _simulate_turn(theta, h, force, cosine, no_unknowns, end, by, contact, contact_by)
        miss = end - start
        off = abs(miss[0]) + abs(miss[1]) * np.exp(-0.5 * theta[STIFFNESS])
        if off < _CLOSED_RAD:
            return True
        if not off < 1.0:  # ran away
            return False
        determinant = (1 - by[0, 0]) * (1 - by[1, 1]) - by[0, 1] * by[1, 0]
        if off < before and abs(determinant) > 1e-9:
            start[0] += ((1 - by[1, 1]) * miss[0] + by[0, 1] * miss[1]) / determinant
            start[1] += (by[1, 0] * miss[0] + (1 - by[0, 0]) * miss[1]) / determinant
        else:
            start += miss
        before = off
    return False


def _contact_slopes(theta: FloatArray, c: Comparison, orbit: Orbit) -> ComplexArray:
    """Slopes of the harmonics of c + mu |c| by the unknowns that c depends on, shape (8, harmonics)."""
    force, cosine, _ = orbit.drive
    end, end_by, contact = orbit.start.copy(), np.eye(2, 2 + _OF_CONTACT), np.empty(force.size)
    contact_by = np.empty((2 + _OF_CONTACT, force.size))
    drive_by = _drive_slopes(theta, c, orbit.drive)
    _simulate_turn(theta, c.step_s, force, cosine, drive_by, end, end_by, contact, contact_by)
    contact_by *= 1 + theta[LOSS] * orbit.contact / _size(orbit.contact, c)
    by = _at_harmonics(contact_by, c)
    # The orbit's start moves with the unknowns, so that the turn ends where it begins.
    start_by = np.linalg.solve(np.eye(2) - end_by[:, :2], end_by[:, 2:])
    return by[2:] + start_by.T @ by[:2]


def _at_harmonics(wave: FloatArray, c: Comparison) -> ComplexArray:
    return np.asarray(np.fft.rfft(wave)[..., c.order] / c.mid_step)


def predict_torque(theta: FloatArray, c: Comparison, contact: FloatArray) -> ComplexArray:
    """The torque's harmonics by the contact torque of a turn: N J_m (a / N + rho (c + mu |c|)), late."""
    lagged, late = 1 + 1e-3j * theta[LAG] * c.omega, _logged(theta, c)
    acceleration = 1j * c.omega * lagged * c.speed
    carried = _at_harmonics(contact + theta[LOSS] * _size(contact, c), c)
    return np.exp(theta[DRIVE]) * late * (acceleration + np.exp(theta[RATIO]) * carried)


def _logged(theta: FloatArray, c: Comparison) -> ComplexArray:
    """Response of the delay and the low-pass between the torque and its log."""
    low_pass = 1 / (1 + 1e-3j * theta[FILTER] * c.omega)
    return np.asarray(np.exp(-1e-3j * theta[DELAY] * c.omega) * low_pass)


def _size(contact: FloatArray, c: Comparison) -> FloatArray:
    """|c|, smooth where the torque crosses zero."""
    return np.sqrt(contact**2 + c.smoothing**2)


def torque_sd(theta: FloatArray, c: Comparison) -> FloatArray:
    """SD of each harmonic: the torque's noise, that of the speed by the joint with its teeth in contact, the model's.

    The unknowns have the shape (unknowns, ...), the SDs (..., harmonics).
    """
    value = theta[..., None]
    K, zeta = np.exp(value[STIFFNESS]), np.exp(value[DAMPING])
    lagged = 1 + 1e-3j * value[LAG] * c.omega
    spring = K + 2j * zeta * np.sqrt(K) * c.omega
    stiff = lagged * (1 + np.exp(value[RATIO]) * spring / (spring - c.omega**2))
    logged = np.exp(value[DRIVE]) / np.hypot(1, 1e-3 * value[FILTER] * c.omega)
    by_speed = logged * c.omega * np.abs(stiff) * c.speed_sd
    return np.sqrt(by_speed**2 + c.torque_sd**2 + c.model_error**2)


def residuals(theta: FloatArray, c: Comparison, orbit: Orbit) -> FloatArray:
    """What the model leaves of the torque's harmonics over their SDs, real and imaginary parts in turn."""
    left = (predict_torque(theta, c, orbit.contact) - c.torque) / torque_sd(theta, c)
    return left.view(float)


def residual_slopes(theta: FloatArray, c: Comparison, orbit: Orbit) -> FloatArray:
    """Slopes of the residuals by the unknowns, shape (residuals, unknowns)."""
    torque, sd = predict_torque(theta, c, orbit.contact), torque_sd(theta, c)
    drive = np.exp(theta[DRIVE]) * _logged(theta, c)
    size = _size(orbit.contact, c)
    by = np.zeros((len(UNKNOWNS), c.order.size), dtype=complex)
    by[:_OF_CONTACT] = _contact_slopes(theta, c, orbit)
    by[LOSS], by[RATIO] = _at_harmonics(np.array([size, orbit.contact + theta[LOSS] * size]), c)
    by *= drive * np.exp(theta[RATIO])
    by[LAG] -= 1e-3 * drive * c.omega**2 * c.speed
    by[DRIVE] = torque
    by[DELAY] = -1e-3j * c.omega * torque
    by[FILTER] = -1e-3j * c.omega / (1 + 1e-3j * theta[FILTER] * c.omega) * torque
    step = 1e-6 * np.eye(theta.size)[_OF_SD]
    sd_by = np.zeros(by.shape)
    sd_by[_OF_SD] = (torque_sd(theta[:, None] + step.T, c) - sd) / 1e-6
    return ((by - (torque - c.torque) * sd_by / sd) / sd).view(float).T
