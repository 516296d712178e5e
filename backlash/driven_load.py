"""The load alone, driven by the measured motor motion, and the torque that it asks of the motor.

With x = theta_m / N - q the wind-up of the joint:

    x'' = a / N - c + g sin(q) + g F        the load under the contact torque c, gravity and friction
    c = K p(x) + D x' [in contact]          spring and damper, p the penetration beyond the gap of delta to either side
    T = J_m (a + N rho (c + mu |c|))        the motor's torque, with the loss in the gear

where c is over the load's inertia J_l and never pulls, a is the motor's acceleration, g = m g r / J_l,
rho = J_l / (N^2 J_m), F the load's friction over gravity, which sets the instants at which the teeth part, and mu the
loss: the gear's efficiency is 1 / (1 + mu) where the motor drives. Neither the drive nor the motor's own friction is
in it.

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

# Unknowns, and their places: delta [mrad], the logarithms of K [1/s^2], of the damping ratio; F, gravity's phase [rad],
# the logarithm of g [1/s^2], the speed's lag [ms]; the logarithms of rho and of N J_m, the torque's delay [ms], mu.
UNKNOWNS = (
    *("delta_mrad", "ln_stiffness", "ln_damping", "friction", "phase_rad", "ln_gravity", "lag_ms"),
    *("ln_inertia_ratio", "ln_drive", "delay_ms", "loss"),
)
DELTA, STIFFNESS, DAMPING, FRICTION, PHASE, GRAVITY, LAG, RATIO, DRIVE, DELAY, LOSS = range(11)
_OF_CONTACT = 7  # unknowns that the contact torque depends on, the first ones

_MOST_PERIODS = 40  # simulated until the orbit closes; Newton's method needs 3 to 10
_CLOSED_RAD = 1e-11  # a millionth of the least backlash that matters


class Comparison(NamedTuple):
    """Harmonics that are compared, and the motion in the middle of each time step, with its slope by the lag."""

    order: NDArray[np.int64]
    omega: FloatArray
    speed: ComplexArray
    torque: ComplexArray
    speed_sd: FloatArray
    torque_sd: FloatArray
    model_error: FloatArray  # SD
    mid_step: ComplexArray  # the phase of half a step, times the number of steps
    step_s: float
    angle: FloatArray
    angle_by_lag: FloatArray
    acceleration: FloatArray
    acceleration_by_lag: FloatArray
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
    steps = 2 * next_fast_len(
        int(max(turn_s / step_s, 2 * speed.order.size + 2) / 2) + 1, real=True
    )
    half_step = np.exp(0.5j * turn_s / steps * speed.omega)
    waves = np.zeros((4, steps // 2 + 1), dtype=complex)
    for k, (of_lag, derivative) in enumerate([(1.0, -1), (1e-3, 0), (1.0, 1), (1e-3, 2)]):
        motion = of_lag * speed.coefficient * (1j * speed.omega) ** derivative
        waves[k, speed.order] = half_step * motion
    angle, angle_by_lag, acceleration, acceleration_by_lag = np.fft.irfft(waves, steps) * steps
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
        angle=angle + TURN / steps * (np.arange(steps) + 0.5),
        angle_by_lag=angle_by_lag,
        acceleration=acceleration,
        acceleration_by_lag=acceleration_by_lag,
        smoothing=smoothing,
    )


@njit
def _mean_penetration(first, last):
    """Mean of what is above 0 on a straight course from one depth to another, the share of the course, their slopes."""
    most, least = max(first, last), min(first, last)
    if most <= 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if least >= 0:
        return 0.5 * (most + least), 1.0, 0.5, 0.5, 0.0, 0.0
    share = most / (most - least)
    by_least = 0.5 * share * share
    by_most = share - by_least
    share_by_least = most / (most - least) ** 2
    share_by_most = -least / (most - least) ** 2
    if first > last:
        return 0.5 * share * most, share, by_most, by_least, share_by_most, share_by_least
    return 0.5 * share * most, share, by_least, by_most, share_by_least, share_by_most


@njit
def _simulate_turn(theta, motion, start, columns, contact, slopes):
    """Contact torque in each step of the turn that begins at `start`, and the first `columns` of its slopes.

    Columns are by x and x' at the start, then by the unknowns. The contact torque of a step is its mean along a
    straight course, which makes it smooth in all of them. Returns x and x' at the end with their slopes.
    """
    h = motion.step_s
    delta, K = 1e-3 * theta[DELTA], np.exp(theta[STIFFNESS])
    D = 2 * np.exp(theta[DAMPING]) * np.sqrt(K)
    gravity = np.exp(theta[GRAVITY])
    friction, lag = theta[FRICTION], theta[LAG]
    x, v = start
    end = np.eye(2, 2 + _OF_CONTACT)
    force_by, falling_by, contact_by = np.zeros((3, 2 + _OF_CONTACT))
    force_by[2 + FRICTION] = gravity
    for i in range(contact.size):
        angle = motion.angle[i] + lag * motion.angle_by_lag[i] + theta[PHASE]
        sine, cosine = gravity * np.sin(angle), gravity * np.cos(angle)
        force = motion.acceleration[i] + lag * motion.acceleration_by_lag[i]
        force += sine + gravity * friction
        p = touch = p_by_x = p_by_end = touch_by_x = touch_by_end = 0.0
        p_by_gap = touch_by_gap = 0.0
        for side in (1.0, -1.0):
            depth = side * x - delta
            mean, share, a, b, c, e = _mean_penetration(depth, depth + side * h * v)
            p += side * mean
            touch += share
            p_by_x += a
            p_by_end += b
            touch_by_x += side * c
            touch_by_end += side * e
            p_by_gap += side * (a + b)
            touch_by_gap += c + e
        pressed = K * p + D * touch * v
        is_parting = touch <= 1 and pressed * p <= 0  # teeth do not pull
        contact[i] = 0.0 if is_parting else pressed
        middle = x + 0.5 * h * v
        v_end = v + h * (force - cosine * middle - contact[i])  # sin(q) to the first order in x
        if columns > 2:
            force_by[2 + PHASE], falling_by[2 + PHASE] = cosine, -sine
            force_by[2 + GRAVITY], falling_by[2 + GRAVITY] = sine + gravity * friction, cosine
            force_by[2 + LAG] = motion.acceleration_by_lag[i] + cosine * motion.angle_by_lag[i]
            falling_by[2 + LAG] = -sine * motion.angle_by_lag[i]
            contact_by[2 + DELTA] = -1e-3 * (K * p_by_gap + D * v * touch_by_gap)
            contact_by[2 + STIFFNESS] = K * p + 0.5 * D * touch * v
            contact_by[2 + DAMPING] = D * touch * v
        for k in range(columns):
            x_by, v_by = end[0, k], end[1, k]
            by = 0.0
            if not is_parting:
                by = contact_by[k] + K * (p_by_x * x_by + p_by_end * (x_by + h * v_by))
                by += D * v * (touch_by_x * x_by + touch_by_end * (x_by + h * v_by))
                by += D * touch * v_by
            slopes[k, i] = by
            falling = falling_by[k] * middle + cosine * (x_by + 0.5 * h * v_by)
            end[1, k] = v_by + h * (force_by[k] - falling - by)
            end[0, k] = x_by + 0.5 * h * (v_by + end[1, k])
        x += 0.5 * h * (v + v_end)
        v = v_end
    return x, v, end


@njit
def _solve_orbit(end, dx, dv):
    """The change of the start that a miss of the orbit asks for: (1 - end's slopes by the start) change = miss."""
    (xx, xv), (vx, vv) = end[0, :2], end[1, :2]
    determinant = (1 - xx) * (1 - vv) - xv * vx
    return ((1 - vv) * dx + xv * dv) / determinant, (vx * dx + (1 - xx) * dv) / determinant


@njit
def find_periodic_orbit(theta, motion, start, contact, slopes):
    """Newton's method for the turn that comes back to its start, which is changed in place; whether it does."""
    before = np.inf
    for _ in range(_MOST_PERIODS):
        x, v, end = _simulate_turn(theta, motion, start, 2, contact, slopes)
        dx, dv = x - start[0], v - start[1]
        off = abs(dx) + abs(dv) * np.exp(-0.5 * theta[STIFFNESS])
        if off < _CLOSED_RAD:
            return True
        if not off < 1.0:  # ran away
            return False
        if off < before and _determinant(end) > 1e-9:
            dx, dv = _solve_orbit(end, dx, dv)
        start[0] += dx
        start[1] += dv
        before = off
    return False


@njit
def _determinant(end):
    return (1 - end[0, 0]) * (1 - end[1, 1]) - end[0, 1] * end[1, 0]


@njit
def orbit_slopes(theta, motion, start, contact, slopes):
    """Slopes of the periodic orbit's contact torque by the unknowns; whether there are any."""
    _, _, end = _simulate_turn(theta, motion, start, 2 + _OF_CONTACT, contact, slopes)
    if abs(_determinant(end)) < 1e-9:
        return False
    for k in range(2, 2 + _OF_CONTACT):
        x_by, v_by = _solve_orbit(end, end[0, k], end[1, k])
        for i in range(contact.size):
            slopes[k, i] += x_by * slopes[0, i] + v_by * slopes[1, i]
    return True


class Prediction(NamedTuple):
    """The torque's harmonics by the model with their SDs, and the slopes of both: of the harmonics, and of ln SD."""

    torque: ComplexArray
    sd: FloatArray
    torque_by: ComplexArray  # shape (unknowns, harmonics)
    ln_sd_by: FloatArray


def predict_torque(
    theta: FloatArray, c: Comparison, contact: FloatArray, contact_by: FloatArray
) -> Prediction:
    """Predict the torque's harmonics from the contact torque of a turn and its slopes, shape (7 or 0, steps)."""
    K, zeta = np.exp(theta[STIFFNESS]), np.exp(theta[DAMPING])
    rho, N_J_m = np.exp(theta[RATIO]), np.exp(theta[DRIVE])
    iw = 1j * c.omega
    late = np.exp(-1e-3 * theta[DELAY] * iw)
    lagged = 1 + 1e-3 * theta[LAG] * iw
    size = np.sqrt(contact**2 + c.smoothing**2)  # |c|, smooth where the torque crosses zero
    carried, lost = np.fft.rfft([contact + theta[LOSS] * size, size])[:, c.order] / c.mid_step
    inertial = iw * c.speed
    torque = N_J_m * late * (inertial * lagged + rho * carried)

    # Of the speed's noise, by the joint with its teeth in contact.
    spring = K + 2 * zeta * np.sqrt(K) * iw
    compliance = 1 / (spring - c.omega**2)
    stiff = 1 + rho * spring * compliance
    by_speed = (N_J_m * c.omega * np.abs(lagged) * np.abs(stiff) * c.speed_sd) ** 2
    variance = by_speed + c.torque_sd**2 + c.model_error**2

    torque_by = np.zeros((len(UNKNOWNS), c.order.size), dtype=complex)
    ln_sd_by = np.zeros((len(UNKNOWNS), c.order.size))
    if contact_by.size:
        gain = N_J_m * late * rho
        pressed_by = contact_by * (1 + theta[LOSS] * contact / size)
        torque_by[:_OF_CONTACT] = gain * np.fft.rfft(pressed_by)[:, c.order] / c.mid_step
        torque_by[LAG] += N_J_m * late * inertial * 1e-3 * iw
        torque_by[RATIO] = gain * carried
        torque_by[LOSS] = gain * lost
        torque_by[DRIVE] = torque
        torque_by[DELAY] = -1e-3 * iw * torque
        stiff_by = -rho * c.omega**2 * compliance**2 / stiff
        ln_sd_by[STIFFNESS] = (stiff_by * 0.5 * (spring + K)).real
        ln_sd_by[DAMPING] = (stiff_by * (spring - K)).real
        ln_sd_by[LAG] = (1e-3 * iw / lagged).real
        ln_sd_by[RATIO] = ((stiff - 1) / stiff).real
        ln_sd_by[DRIVE] = 1.0
        ln_sd_by *= by_speed / variance
    return Prediction(torque, np.sqrt(variance), torque_by, ln_sd_by)


def solve_load(
    theta: FloatArray, c: Comparison, start: FloatArray, wants_slopes: bool
) -> Prediction | None:
    """Predict the torque by the periodic orbit; `start` moves to the orbit's own; None where there is no orbit."""
    contact = np.empty(c.angle.size)
    slopes = np.empty((2 + _OF_CONTACT, contact.size))
    if not find_periodic_orbit(theta, c, start, contact, slopes):
        return None
    if wants_slopes and not orbit_slopes(theta, c, start, contact, slopes):
        return None
    return predict_torque(theta, c, contact, slopes[2:] if wants_slopes else slopes[:0])


def residuals(
    theta: FloatArray, c: Comparison, start: FloatArray, wants_slopes: bool
) -> tuple[FloatArray, FloatArray] | None:
    """Real and imaginary parts of the residuals over their SDs, and their slopes, shape (numbers, unknowns)."""
    predicted = solve_load(theta, c, start, wants_slopes)
    if predicted is None:
        return None
    left = (predicted.torque - c.torque) / predicted.sd
    by = predicted.torque_by / predicted.sd - left * predicted.ln_sd_by
    return np.concatenate([left.real, left.imag]), np.hstack([by.real, by.imag]).T
