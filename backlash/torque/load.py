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
from scipy.fft import next_fast_len
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

# From rest, unless a turn ends nearer to where it began: Newton's method alone may find an orbit that no load keeps to.
_SETTLING_TURNS = 10
_SETTLED_RAD = 1e-6
_MOST_TURNS = 12  # by Newton's method, which needs 2 to 4
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
    for k in range(slope.size):
        slope[k] = 0.0
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
def _simulate_turn(theta, h, motion, forcing, smoothing, state, jacobian, contact, waves):
    """Move x and x' on by a turn of x'' = force - cosine x - c, with their Jacobian, shape (2, columns).

    Columns are x and x' at the turn's start, then the unknowns; `contact`, shape (steps,), receives c, and `waves`,
    shape (columns, steps), the slopes of c + mu |c|.
    """
    K, g = np.exp(theta[STIFFNESS]), np.exp(theta[GRAVITY])
    D = 2 * np.exp(theta[DAMPING]) * np.sqrt(K)
    columns = jacobian.shape[1]
    slope, own, source = np.zeros(6), np.zeros(12), np.zeros(12)
    x, v, loud = state[0], state[1], 1.0
    for i in range(contact.size):
        cosine, sine = forcing[1, i], forcing[2, i]
        c, c_x, c_v = _contact_torque(x, v, h, theta, K, D, slope)
        contact[i] = c
        middle = x + 0.5 * h * v
        v_end = v + h * (forcing[0, i] - cosine * middle - c)
        if columns > 2:
            loud = 1 + theta[LOSS] * c / np.sqrt(c * c + smoothing * smoothing)
            for k in range(6):
                own[2 + k] = slope[k]
            tilt = cosine + sine * middle
            source[2 + FRICTION] = g
            source[2 + PHASE] = tilt
            source[2 + GRAVITY] = sine + g * theta[FRICTION] - cosine * middle
            source[2 + LAG] = motion[3, i] + tilt * motion[1, i]
        for k in range(columns):
            by_x, by_v = jacobian[0, k], jacobian[1, k]
            c_k = own[k] + c_x * by_x + c_v * by_v
            v_end_k = by_v + h * (source[k] - cosine * (by_x + 0.5 * h * by_v) - c_k)
            jacobian[0, k] = by_x + 0.5 * h * (by_v + v_end_k)
            jacobian[1, k] = v_end_k
            waves[k, i] = loud * c_k
        x += 0.5 * h * (v + v_end)
        v = v_end
    state[0], state[1] = x, v


@njit
def _close_orbit(theta, h, motion, forcing, settling_turns, start, contact):
    """Move the start until its turn ends there, by Newton's method; whether it does, and a load keeps to that orbit."""
    end, by, unused = np.empty(2), np.empty((2, 2)), np.empty((2, contact.size))
    before, rate = np.inf, np.exp(0.5 * theta[STIFFNESS])
    for turn in range(settling_turns + _MOST_TURNS):
        end[0], end[1] = start[0], start[1]
        by[0, 0], by[0, 1], by[1, 0], by[1, 1] = 1.0, 0.0, 0.0, 1.0
        _simulate_turn(theta, h, motion, forcing, 1.0, end, by, contact, unused)
        miss_x, miss_v = end[0] - start[0], end[1] - start[1]
        distance = abs(miss_x) + abs(miss_v) / rate
        if distance < _CLOSED_RAD:  # both multipliers are within the unit circle
            trace, product = by[0, 0] + by[1, 1], by[0, 0] * by[1, 1] - by[0, 1] * by[1, 0]
            return product <= 1 and abs(trace) <= 1 + product
        if not distance < 1.0:  # ran away
            return False
        determinant = (1 - by[0, 0]) * (1 - by[1, 1]) - by[0, 1] * by[1, 0]
        is_settled = turn >= settling_turns or distance < _SETTLED_RAD
        if is_settled and distance < before and abs(determinant) > 1e-9:
            start[0] += ((1 - by[1, 1]) * miss_x + by[0, 1] * miss_v) / determinant
            start[1] += (by[1, 0] * miss_x + (1 - by[0, 0]) * miss_v) / determinant
        else:
            start[0], start[1] = end[0], end[1]
        if is_settled:
            before = distance
    return False


def _force_load(theta: FloatArray, c: Comparison) -> FloatArray:
    """What forces the load, a / N + g sin(q) + g F = force - cosine x, to the first order in x.

    Force, cosine and sine, shape (3, steps).
    """
    at_lag_0, angle_by_lag, acceleration, acceleration_by_lag = c.motion
    angle = at_lag_0 + theta[LAG] * angle_by_lag + theta[PHASE]
    forcing = np.empty((3, angle.size))
    force, cosine, sine = forcing
    g = np.exp(theta[GRAVITY])
    np.cos(angle, out=cosine)
    np.sin(angle, out=sine)
    forcing[1:] *= g
    np.multiply(theta[LAG], acceleration_by_lag, out=force)
    force += acceleration
    force += sine
    force += g * theta[FRICTION]
    return forcing


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
    contact = np.empty(forcing.shape[1])
    begin = np.zeros(2) if start is None else start.copy()
    settling_turns = _SETTLING_TURNS if start is None else 0
    if not _close_orbit(theta, c.step_s, c.motion, forcing, settling_turns, begin, contact):
        return None
    carried = carry(contact, c)
    torque, sd = predict_torque(theta, c, carried)
    return Prediction(theta, begin, forcing, contact, carried, torque, sd)


def carry(contact: FloatArray, c: Comparison) -> ComplexArray:
    """Harmonics of the contact torque of a turn and of its size, smooth at zero, which the gear's loss goes with."""
    return _at_harmonics(np.array([contact, np.sqrt(contact * contact + c.smoothing**2)]), c)


def _at_harmonics(waves: FloatArray, c: Comparison) -> ComplexArray:
    """The compared harmonics of waves, shape (waves, steps), as (waves, harmonics)."""
    found: ComplexArray = np.fft.rfft(waves)[:, c.order] / c.mid_step
    return found


class _Responses(NamedTuple):
    """Responses at each harmonic: of the torque's log, of the speed's, and of the joint in contact."""

    log: ComplexArray  # delay and low-pass
    lag: ComplexArray
    spring: ComplexArray  # K and its damper
    carried: ComplexArray  # torque of the load over that of the motor's own inertia


def _respond(theta: FloatArray, c: Comparison) -> _Responses:
    per_ms = 1e-3j * c.omega
    log = np.exp(-theta[DELAY] * per_ms) / (1 + theta[FILTER] * per_ms)
    K = np.exp(theta[STIFFNESS])
    spring = K + 2j * np.exp(theta[DAMPING]) * np.sqrt(K) * c.omega
    carried = np.exp(theta[RATIO]) * spring / (spring - c.omega**2)
    return _Responses(log, 1 + theta[LAG] * per_ms, spring, carried)


def predict_torque(
    theta: FloatArray, c: Comparison, carried: ComplexArray
) -> tuple[ComplexArray, FloatArray]:
    """The torque's harmonics by those of c and |c|, N J_m (a / N + rho (c + mu |c|)), late, and their SDs.

    An SD is that of the torque's noise, of the speed's, and of the model's error.
    """
    by = _respond(theta, c)
    contact = np.exp(theta[RATIO]) * (carried[0] + theta[LOSS] * carried[1])
    response = np.exp(theta[INERTIA]) * by.log
    torque = response * (1j * c.omega * by.lag * c.speed + contact)
    noise = np.abs(response * by.lag * (1 + by.carried)) * c.omega * c.speed_sd
    return torque, np.sqrt(noise**2 + c.torque_sd**2 + c.model_error**2)


def residuals(predicted: Prediction, c: Comparison) -> FloatArray:
    """What the model leaves of the torque's harmonics over their SDs, real and imaginary parts in turn."""
    return ((predicted.torque - c.torque) / predicted.sd).view(float)


def jacobian(predicted: Prediction, c: Comparison) -> tuple[FloatArray, FloatArray]:
    """Slopes of the residuals, shape (residuals, unknowns), and of the orbit's start; not finite where orbits part."""
    theta, steps = predicted.theta, predicted.contact.size
    end, by = predicted.start.copy(), np.eye(2, 2 + OF_CONTACT)
    unused, waves = np.empty(steps), np.empty((2 + OF_CONTACT, steps))
    _simulate_turn(
        *(theta, c.step_s, c.motion, predicted.forcing, c.smoothing, end, by, unused, waves)
    )
    slope = _at_harmonics(waves, c)
    # The start moves with the unknowns, so that the turn ends where it begins.
    (p, q), (r, s) = np.eye(2) - by[:, :2]
    start_by = np.array([[s, -q], [-r, p]]) @ by[:, 2:] / (p * s - q * r)
    return _residual_slopes(predicted, c, slope[2:] + start_by.T @ slope[:2]), start_by


def _residual_slopes(
    predicted: Prediction, c: Comparison, contact_slope: ComplexArray
) -> FloatArray:
    """Slopes of the residuals by all unknowns, by those of the harmonics of c + mu |c|."""
    theta, torque, sd = predicted.theta, predicted.torque, predicted.sd
    by, per_ms = _respond(theta, c), 1e-3j * c.omega
    response = np.exp(theta[INERTIA]) * by.log
    slope = np.empty((theta.size, c.omega.size), dtype=complex)
    np.multiply(response * np.exp(theta[RATIO]), contact_slope, out=slope[:OF_CONTACT])
    slope[LAG] += response * per_ms * 1j * c.omega * c.speed
    slope[RATIO] = torque - response * 1j * c.omega * by.lag * c.speed
    slope[INERTIA] = torque
    slope[DELAY] = -per_ms * torque
    slope[LOSS] = response * np.exp(theta[RATIO]) * predicted.carried[1]
    slope[FILTER] = -per_ms / (1 + theta[FILTER] * per_ms) * torque
    slope -= (torque - c.torque) / sd * _sd_slopes(theta, c, by, sd)
    return (slope / sd).view(float).T


def _sd_slopes(theta: FloatArray, c: Comparison, by: _Responses, sd: FloatArray) -> FloatArray:
    """Slopes of the torque's SDs by the unknowns, shape (unknowns, harmonics): the speed's noise goes with them."""
    K = np.exp(theta[STIFFNESS])
    damper = by.spring - K
    by_spring = by.carried * (1 / by.spring - 1 / (by.spring - c.omega**2)) / (1 + by.carried)
    slope = np.zeros((theta.size, c.omega.size))  # of the noise's logarithm
    slope[STIFFNESS] = (by_spring * (K + 0.5 * damper)).real
    slope[DAMPING] = (by_spring * damper).real
    slope[LAG] = (1e-3j * c.omega / by.lag).real
    slope[RATIO] = (by.carried / (1 + by.carried)).real
    slope[INERTIA] = 1.0
    slope[FILTER] = -((1e-3 * c.omega) ** 2) * theta[FILTER]
    slope[FILTER] /= 1 + (1e-3 * c.omega * theta[FILTER]) ** 2
    return slope * (sd**2 - c.torque_sd**2 - c.model_error**2) / sd
