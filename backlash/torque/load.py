"""The load alone, driven by the measured motor motion, and the torque that it asks of the motor.

With x = theta_m / N - q the wind-up of the joint:

    x'' = a / N - c + g sin(q) + g F            the load under the contact torque c, gravity and friction
    c = [K p + (1 - d) D x' [in contact]] + d D x'      spring and damper, which never pull, and drag
    p = s p(delta) + (1 - s) p(delta + e)
    T = J_m (a + N rho (c + mu |c|))            the motor's torque, with the loss in the gear

where p(gap) is how far x is beyond a gap to either side: over e beyond the teeth's gap of delta the spring has a share
s of its stiffness, as strain wave gears' have near zero torque; lubricated teeth drag in the gap, too. c is over the
load's inertia J_l, a is the motor's acceleration, g = m g r / J_l, rho = J_l / (N^2 J_m), F the load's friction over
gravity, which sets the instants at which the teeth part, and mu the loss: the gear's efficiency is 1 / (1 + mu) where
the motor drives. The torque is logged late, through a low-pass of first order. Neither the drive nor the motor's own
friction is in it. `unknowns` has the table of all of them.

The torque is compared harmonic by harmonic of the mean turn. Noise of the speed reaches it through the model: each
harmonic's SD is that of both columns there, by the joint with its teeth in contact, and a model error, a share of the
torque. The Jacobian by the unknowns is integrated with the load.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft
from scipy.ndimage import uniform_filter1d

from backlash.torque.unknowns import (
    DAMPING,
    DELAY,
    DELTA,
    DRAG,
    FILTER,
    FRICTION,
    GRAVITY,
    INERTIA,
    LAG,
    LOSS,
    OF_CONTACT,
    PHASE,
    RATIO,
    SHARE,
    SOFT,
    STIFFNESS,
)
from backlash.turns import TURN, ComplexArray, Harmonics
from replication import njit
from replication.signature import FloatArray

_SETTLING_TURNS = 10  # from rest; Newton's method alone may find an orbit that no load keeps to
_MOST_TURNS = 30  # by Newton's method, which needs 3 to 10
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


# ---------------------------------------------------------------------------------------------- one turn of the load


@njit
def _mean_depth(a, b):
    """Mean of what is above 0 on a straight course from depth a to b, that share of it, and their slopes by a and b."""
    if a >= 0 and b >= 0:
        return 0.5 * (a + b), 1.0, 0.5, 0.5, 0.0, 0.0
    if a <= 0 and b <= 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    above_a, above_b = max(a, 0.0), max(b, 0.0)
    mean = 0.5 * (above_b**2 - above_a**2) / (b - a)
    share = (above_b - above_a) / (b - a)
    by_a, by_b = (mean - above_a) / (b - a), (above_b - mean) / (b - a)
    return mean, share, by_a, by_b, (share - (a > 0)) / (b - a), ((b > 0) - share) / (b - a)


@njit
def _contact_torque(x, v, h, theta, K, D, slope):
    """The contact torque of a step h, and its slopes by x and x'; `slope` receives those by the first six unknowns.

    It is the mean along the straight course from x to x + h x', which makes it smooth in all of them.
    """
    delta, soft, part, drag = 1e-3 * theta[DELTA], 1e-3 * theta[SOFT], theta[SHARE], theta[DRAG]
    p = p_x = p_v = p_delta = p_soft = p_part = 0.0
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
        p += side * part * mean
        p_part += side * mean
        p_x += part * (by_a + by_b)
        p_v += part * h * by_b
        p_delta -= side * part * (by_a + by_b)
        mean, share, by_a, by_b, share_a, share_b = _mean_depth(depth - soft, end - soft)
        p += side * (1 - part) * mean
        p_part -= side * mean
        p_x += (1 - part) * (by_a + by_b)
        p_v += (1 - part) * h * by_b
        p_soft -= side * (1 - part) * (by_a + by_b)
    dragging = drag * D * v
    damping = (1 - drag) * D
    c = K * p + damping * touching * v
    slope[:] = 0.0
    slope[STIFFNESS], slope[DAMPING], slope[DRAG] = 0.5 * dragging, dragging, D * v
    if touching <= 1 and c * p <= 0:  # teeth do not pull
        return dragging, 0.0, drag * D
    damper = damping * touching * v
    slope[DELTA] = 1e-3 * (K * (p_delta + p_soft) + damping * v * touching_delta)
    slope[STIFFNESS] += K * p + 0.5 * damper
    slope[DAMPING] += damper
    slope[SOFT] = 1e-3 * K * p_soft
    slope[SHARE] = K * p_part
    slope[DRAG] -= D * touching * v
    c_x = K * p_x + damping * v * touching_x
    c_v = K * p_v + damping * (v * touching_v + touching)
    return c + dragging, c_x, c_v + drag * D


@njit
def _simulate_turn(theta, h, forcing, state, jacobian, contact, contact_jacobian):
    """Move x and x' on by a turn of x'' = force - cosine x - c, with their Jacobian, shape (2, columns).

    Columns are x and x' at the turn's start, then the unknowns; `contact`, shape (steps,), and `contact_jacobian`,
    shape (steps, columns), receive c and its slopes.
    """
    K, g = np.exp(theta[STIFFNESS]), np.exp(theta[GRAVITY])
    D = 2 * np.exp(theta[DAMPING]) * np.sqrt(K)
    columns = jacobian.shape[1]
    slope, own, source = np.zeros(6), np.zeros(columns), np.zeros(columns)
    by_x, by_v = jacobian[0], jacobian[1]
    x, v = state[0], state[1]
    for i in range(contact.size):
        cosine, sine = forcing[i, 1], forcing[i, 2]
        c, c_x, c_v = _contact_torque(x, v, h, theta, K, D, slope)
        contact[i] = c
        middle = x + 0.5 * h * v
        v_end = v + h * (forcing[i, 0] - cosine * middle - c)
        if columns > 2:
            own[2:8] = slope
            tilt = cosine + sine * middle
            source[2 + FRICTION] = g
            source[2 + PHASE] = tilt
            source[2 + GRAVITY] = sine + g * theta[FRICTION] - cosine * middle
            source[2 + LAG] = forcing[i, 4] + tilt * forcing[i, 3]
        for k in range(columns):
            c_k = own[k] + c_x * by_x[k] + c_v * by_v[k]
            turned = by_x[k] + 0.5 * h * by_v[k]
            v_end_k = by_v[k] + h * (source[k] - cosine * turned - c_k)
            by_x[k] += 0.5 * h * (by_v[k] + v_end_k)
            by_v[k] = v_end_k
            contact_jacobian[i, k] = c_k
        x += 0.5 * h * (v + v_end)
        v = v_end
    state[0], state[1] = x, v


@njit
def _settle(theta, h, forcing, start, contact):
    """Move the start on by turns that begin where the last one ended."""
    nothing, unused = np.empty((2, 0)), np.empty((contact.size, 0))
    for _ in range(_SETTLING_TURNS):
        _simulate_turn(theta, h, forcing, start, nothing, contact, unused)


@njit
def _close_orbit(theta, h, forcing, start, contact):
    """Move the start until its turn ends there, by Newton's method; whether it does, and a load keeps to that orbit."""
    unused = np.empty((contact.size, 2))
    before = np.inf
    for _ in range(_MOST_TURNS):
        end, by = start.copy(), np.eye(2)
        _simulate_turn(theta, h, forcing, end, by, contact, unused)
        miss = end - start
        distance = abs(miss[0]) + abs(miss[1]) * np.exp(-0.5 * theta[STIFFNESS])
        trace, product = by[0, 0] + by[1, 1], by[0, 0] * by[1, 1] - by[0, 1] * by[1, 0]
        if distance < _CLOSED_RAD:  # both multipliers are within the unit circle
            return product <= 1 and abs(trace) <= 1 + product
        if not distance < 1.0:  # ran away
            return False
        determinant = 1 - trace + product
        if distance < before and abs(determinant) > 1e-9:
            start[0] += ((1 - by[1, 1]) * miss[0] + by[0, 1] * miss[1]) / determinant
            start[1] += (by[1, 0] * miss[0] + (1 - by[0, 0]) * miss[1]) / determinant
        else:
            start += miss
        before = distance
    return False


@njit
def _force_load(theta, c):
    """What forces the load, a / N + g sin(q) + g F = force - cosine x, to the first order in x, shape (steps, 5).

    Columns are force, cosine, sine, and the slopes of angle and acceleration by the lag.
    """
    at_lag_0, angle_by_lag, acceleration, acceleration_by_lag = c.motion
    angle = at_lag_0 + theta[LAG] * angle_by_lag + theta[PHASE]
    g = np.exp(theta[GRAVITY])
    sine, cosine = g * np.sin(angle), g * np.cos(angle)
    force = acceleration + theta[LAG] * acceleration_by_lag + sine + g * theta[FRICTION]
    return np.stack((force, cosine, sine, angle_by_lag, acceleration_by_lag), axis=1)


# ------------------------------------------------------------------------------------------------------- the torque


class Prediction(NamedTuple):
    """What a joint makes of the motor's motion: its periodic orbit, and the torque's harmonics with their SDs."""

    theta: FloatArray
    start: FloatArray  # x and x' where the turn begins
    forcing: FloatArray
    contact: FloatArray  # contact torque of each step
    carried: ComplexArray  # harmonics of c and of |c|, shape (2, harmonics)
    torque: ComplexArray
    sd: FloatArray


def predict(theta: FloatArray, c: Comparison, start: FloatArray | None = None) -> Prediction | None:
    """Predict the torque by the orbit near a start, or by the one that a load at rest comes to; None without one."""
    forcing = _force_load(theta, c)
    contact = np.empty(len(forcing))
    begin = np.zeros(2) if start is None else start.copy()
    if start is None:
        _settle(theta, c.step_s, forcing, begin, contact)
    if not _close_orbit(theta, c.step_s, forcing, begin, contact):
        return None
    carried = carry(contact, c)
    torque, sd = predict_torque(theta, c, carried), torque_sd(theta, c)
    return Prediction(theta, begin, forcing, contact, carried, torque, sd)


def carry(contact: FloatArray, c: Comparison) -> ComplexArray:
    """Harmonics of the contact torque of a turn and of its size, which the gear's loss goes with."""
    return _at_harmonics(np.column_stack([contact, smooth_abs(contact, c)]), c)


def _at_harmonics(waves: FloatArray, c: Comparison) -> ComplexArray:
    """The compared harmonics of waves, shape (steps, waves), as (waves, harmonics)."""
    return np.ascontiguousarray((rfft(waves, axis=0)[c.order] / c.mid_step[:, None]).T)


@njit
def smooth_abs(contact, c):
    """|c|, smooth where the torque crosses zero."""
    return np.sqrt(contact**2 + c.smoothing**2)


@njit
def log_response(theta, c):
    """Response of the delay and the low-pass between the torque and its log."""
    low_pass = 1 / (1 + 1e-3j * theta[FILTER] * c.omega)
    return np.exp(-1e-3j * theta[DELAY] * c.omega) * low_pass


@njit
def predict_torque(theta, c, carried):
    """The torque's harmonics by those of c and |c|: N J_m (a / N + rho (c + mu |c|)), late."""
    acceleration = 1j * c.omega * (1 + 1e-3j * theta[LAG] * c.omega) * c.speed
    contact = np.exp(theta[RATIO]) * (carried[0] + theta[LOSS] * carried[1])
    return np.exp(theta[INERTIA]) * log_response(theta, c) * (acceleration + contact)


@njit
def _speed_noise(theta, c):
    """SD that the speed's noise has in each harmonic of the torque, by the joint in contact."""
    K, zeta, rho = np.exp(theta[STIFFNESS]), np.exp(theta[DAMPING]), np.exp(theta[RATIO])
    spring = K + 2j * zeta * np.sqrt(K) * c.omega
    moved = (1 + 1e-3j * theta[LAG] * c.omega) * (1 + rho * spring / (spring - c.omega**2))
    return np.exp(theta[INERTIA]) * c.omega * np.abs(moved * log_response(theta, c)) * c.speed_sd


@njit
def torque_sd(theta, c):
    """SD of each harmonic: the torque's noise, that of the speed, and the model's error."""
    return np.sqrt(_speed_noise(theta, c) ** 2 + c.torque_sd**2 + c.model_error**2)


@njit
def torque_sd_slopes(theta, c, sd):
    """Slopes of these SDs by the unknowns, shape (unknowns, harmonics)."""
    K, zeta, rho = np.exp(theta[STIFFNESS]), np.exp(theta[DAMPING]), np.exp(theta[RATIO])
    damper = 2j * zeta * np.sqrt(K) * c.omega
    spring = K + damper
    carried = rho * spring / (spring - c.omega**2)
    by_spring = -rho * c.omega**2 / (spring - c.omega**2) ** 2 / (1 + carried)
    low_pass = 1e-3 * theta[FILTER] * c.omega
    slope = np.zeros((theta.size, c.omega.size))  # of the logarithm
    slope[STIFFNESS] = (by_spring * (K + 0.5 * damper)).real
    slope[DAMPING] = (by_spring * damper).real
    slope[LAG] = (1e-3j * c.omega / (1 + 1e-3j * theta[LAG] * c.omega)).real
    slope[RATIO] = (carried / (1 + carried)).real
    slope[INERTIA] = 1.0
    slope[FILTER] = -1e-3 * c.omega * low_pass / (1 + low_pass**2)
    return slope * _speed_noise(theta, c) ** 2 / sd


@njit
def residuals(predicted, c):
    """What the model leaves of the torque's harmonics over their SDs, real and imaginary parts in turn."""
    return ((predicted.torque - c.torque) / predicted.sd).view(np.float64)


def jacobian(predicted: Prediction, c: Comparison) -> tuple[FloatArray, FloatArray]:
    """Slopes of the residuals, shape (residuals, unknowns), and of the orbit's start; not finite where orbits part."""
    theta, start, forcing, contact, *_ = predicted
    end, by = start.copy(), np.eye(2, 2 + OF_CONTACT)
    unused, waves = np.empty(contact.size), np.empty((contact.size, 2 + OF_CONTACT))
    _simulate_turn(theta, c.step_s, forcing, end, by, unused, waves)
    waves *= (1 + theta[LOSS] * contact / smooth_abs(contact, c))[:, None]
    slope = _at_harmonics(waves, c)
    # The start moves with the unknowns, so that the turn ends where it begins.
    (p, q), (r, s) = np.eye(2) - by[:, :2]
    start_by = np.array([[s, -q], [-r, p]]) @ by[:, 2:] / (p * s - q * r)
    return _residual_slopes(predicted, c, slope[2:] + start_by.T @ slope[:2]), start_by


@njit
def _residual_slopes(predicted, c, contact_slope):
    """Slopes of the residuals by all unknowns, by those of the harmonics of c + mu |c|."""
    theta, carried, torque, sd = predicted.theta, predicted.carried, predicted.torque, predicted.sd
    response = np.exp(theta[INERTIA]) * log_response(theta, c)
    slope = np.zeros((theta.size, c.omega.size), dtype=np.complex128)
    slope[:OF_CONTACT] = contact_slope
    slope[LOSS], slope[RATIO] = carried[1], carried[0] + theta[LOSS] * carried[1]
    slope *= response * np.exp(theta[RATIO])
    slope[LAG] -= 1e-3 * response * c.omega**2 * c.speed
    slope[INERTIA] = torque
    slope[DELAY] = -1e-3j * c.omega * torque
    slope[FILTER] = -1e-3j * c.omega / (1 + 1e-3j * theta[FILTER] * c.omega) * torque
    sd_slope = torque_sd_slopes(theta, c, sd)
    return ((slope - (torque - c.torque) * sd_slope / sd) / sd).view(np.float64).T
