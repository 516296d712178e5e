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

Of strokes, a window of the mean stroke of each direction is compared alike. It need not end where it begins: x and x'
there, the level of the motor's friction and its ripple are those that fit best, and a stroke back is one forth with
gravity's phase negated. What the window leaves of a harmonic is compared, and of its noise.
"""

import cmath
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.ndimage import uniform_filter1d

from backlash.turns import TURN, ComplexArray, Harmonics
from replication.compilation import njit
from replication.signature import FloatArray

# Places in `unknowns.TABLE`; they stand here because compiled code that is cached keeps another file's constants.
DELTA, STIFFNESS, DAMPING, SOFT, SHARE, DRAG, FRICTION, PHASE, GRAVITY, LAG = range(10)
RATIO, INERTIA, DELAY, LOSS, FILTER = range(10, 15)
OF_CONTACT = 10  # unknowns that the contact torque of a turn depends on

# From rest, unless a turn ends nearer to where it began: Newton's method alone may find an orbit that no load keeps to.
_SETTLING_TURNS = 10
_SETTLED_RAD = 1e-6
_MOST_TURNS = 12  # by Newton's method, which needs 2 to 4
# From here Newton's last step is exact to 1e-11, a millionth of the least backlash that matters.
_NEARLY_CLOSED_RAD = 1e-7
_LEAST_DETERMINANT = 1e-9  # below, turns hardly say where an orbit closes
_BEGIN = np.eye(2, 3 + OF_CONTACT, 1)  # x and x', with their slopes by themselves
_LEAST_LEFT = 0.2  # the gain of a running mean below which it is not undone
_MOST_STARTS = 3  # of strokes, that are tried
_LEAST_GAIN = 0.03  # of chi squared, by which a start is tried again


class Stroke(NamedTuple):
    """What a window of strokes has and a turn, which ends where it begins, has not."""

    signs: FloatArray  # of the unknowns: a stroke back, mirrored, is one forth with gravity's phase negated
    pads: FloatArray  # of each step: 1 in the window, smoothly 0 at the ends of what is driven
    taper: FloatArray  # of the window, on an even grid of times
    free: ComplexArray  # harmonics of what the motor's friction and ripple may add, a row each
    least: FloatArray  # of the normal matrix of a start and of what is free
    spread: FloatArray  # from powers of harmonics to those of what the window leaves of them
    size: float  # how many numbers it tells


class Window(NamedTuple):
    """Harmonics of a turn, or of strokes, that are compared, and the motor's motion that drives the load."""

    order: NDArray[np.int64]
    omega: FloatArray
    torque: ComplexArray
    speed_sd: FloatArray
    own_variance: FloatArray  # of the torque's noise and of the model's error
    per_ms: ComplexArray  # i omega over 1 ms
    acceleration: ComplexArray  # i omega times the speed
    mid_step: ComplexArray  # the phase of half a step, times the number of steps
    step_s: float
    # In the middle of each step: e^(i angle) and its slope by the lag [ms]; the angle's slope by the lag, acceleration
    # and its slope by the lag.
    direction: ComplexArray
    direction_by_lag: ComplexArray
    motion: FloatArray
    smoothing: float  # contact torque below which the loss is smooth [1/s^2]
    stroke: Stroke | None = None
    ring_damping: float = 0.0  # of the noise's ring, beside the spring's: what a short window has


class Accuracy(NamedTuple):
    """How finely a joint is compared."""

    model_error: float  # of the torque
    step_s: float
    fitted_hz: float
    most_harmonics: int
    mean_s: float = 0.0  # a running mean of speed and torque, beyond which little is left of them
    is_undone: bool = False


def compare(
    speed: Harmonics,
    torque: Harmonics,
    used: NDArray[np.bool_],
    accuracy: Accuracy,
    smoothing: float,
    begin: complex = 1.0,
    advance: float = TURN,
) -> Window:
    """Prepare the used ones of the torque's harmonics, and the motion by all of the speed's, in steps.

    The load begins in a direction, e^(i angle), and moves on by an angle.
    """
    gain = np.sinc(speed.omega * accuracy.mean_s / TURN)
    is_left = np.cumprod(gain > _LEAST_LEFT) > 0
    used = used & is_left
    if accuracy.is_undone:
        gain = np.where(is_left, 1 / gain, 0.0)
        speed, torque = (
            each._replace(coefficient=gain * each.coefficient, sd=gain * each.sd)
            for each in (speed, torque)
        )
    power = np.abs(torque.coefficient) ** 2
    power[1:] = uniform_filter1d(power[1:], 7)
    turn_s = TURN / speed.omega[0]
    least = int(max(turn_s / accuracy.step_s, 2 * speed.order.size + 2) / 2) + 1
    steps = 2 * next_fast_len(least, real=True)
    half_step = np.exp(0.5j * turn_s / steps * speed.omega)
    waves = np.zeros((4, steps // 2 + 1), dtype=complex)
    for k, (factor, derivative) in enumerate([(1.0, -1), (1e-3, 0), (1.0, 1), (1e-3, 2)]):
        motion = factor * speed.coefficient * (1j * speed.omega) ** derivative
        waves[k, speed.order] = half_step * motion
    motion = np.fft.irfft(waves, steps) * steps
    motion[0] += advance / steps * (np.arange(steps) + 0.5)
    direction = begin * np.exp(1j * motion[0])
    return Window(
        order=speed.order[used],
        omega=speed.omega[used],
        torque=torque.coefficient[used],
        speed_sd=speed.sd[used],
        own_variance=(torque.sd**2 + accuracy.model_error**2 * power / 2)[used],
        per_ms=np.asarray(1e-3j * speed.omega[used], dtype=complex),
        acceleration=(1j * speed.omega * speed.coefficient)[used],
        mid_step=half_step[used] * steps,
        step_s=turn_s / steps,
        direction=direction,
        direction_by_lag=1j * motion[1] * direction,
        motion=motion[1:],
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
    mean_a, mean_b = (mean - above_a) / (b - a), (above_b - mean) / (b - a)
    return mean, share, mean_a, mean_b, (share - (a > 0)) / (b - a), ((b > 0) - share) / (b - a)


@njit
def _contact_torque(x, v, w, h, joint, slope):
    """The contact torque of a step h, and its slopes by x, x' and w; `slope` receives those by the first six unknowns.

    It is the mean along the straight course from x to x + h x', which makes it smooth in all of them. The damper has
    the speed in the middle of the step, w - c h / 2, where w is what that would be without contact.
    """
    delta, K, D, soft, part, drag = joint
    p = p_x = p_v = p_delta = p_soft = p_part = 0.0
    touching = touching_x = touching_v = touching_delta = 0.0
    for side in (1.0, -1.0):
        depth = side * x - delta
        end = depth + side * h * v
        if depth <= 0 and end <= 0:
            continue
        mean, share, mean_a, mean_b, share_a, share_b = _mean_depth(depth, end)
        after, _, after_a, after_b, _, _ = _mean_depth(depth - soft, end - soft)
        touching += share
        touching_x += side * (share_a + share_b)
        touching_v += side * h * share_b
        touching_delta -= share_a + share_b
        by_gap, by_soft = part * (mean_a + mean_b), (1 - part) * (after_a + after_b)
        p += side * part * mean
        p += side * (1 - part) * after
        p_x += by_gap
        p_x += by_soft
        p_v += part * h * mean_b
        p_v += (1 - part) * h * after_b
        p_delta -= side * by_gap
        p_soft -= side * by_soft
        p_part += side * (mean - after)
    dragging = drag * D
    damping = dragging + (D - dragging) * touching
    # c = K p + damping (w - c h / 2), solved for c.
    gain = 1 / (1 + 0.5 * h * damping)
    c = gain * (K * p + damping * w)
    v_mid = w - 0.5 * h * c
    if touching <= 1 and (c - dragging * v_mid) * p <= 0:  # teeth do not pull
        gain = 1 / (1 + 0.5 * h * dragging)
        v_mid = gain * w
        c, damping = dragging * v_mid, dragging
        c_x = c_v = 0.0
        slope[:] = 0.0
        slope[STIFFNESS] = 0.5 * gain * c
        slope[DRAG] = gain * D * v_mid
    else:
        spring, damper = gain * K, gain * (D - dragging) * v_mid
        c_x = spring * p_x + damper * touching_x
        c_v = spring * p_v + damper * touching_v
        slope[DELTA] = 1e-3 * (spring * (p_delta + p_soft) + damper * touching_delta)
        slope[STIFFNESS] = spring * p + 0.5 * gain * damping * v_mid
        slope[SOFT] = 1e-3 * spring * p_soft
        slope[SHARE] = spring * p_part
        slope[DRAG] = gain * D * (1 - touching) * v_mid
    slope[DAMPING] = gain * damping * v_mid
    return c, c_x, c_v, gain * damping


@njit
def _simulate_turn(theta, h, motion, forcing, state, waves):
    """Move x and x', the first column of a state, on by a turn of x'' = force - cosine x - c, the others their slopes.

    These are by x and x' at the turn's start, then by the unknowns; `waves`, shape (columns, steps), receives c and its
    slopes.
    """
    K, g = np.exp(theta[STIFFNESS]), np.exp(theta[GRAVITY])
    D = 2 * np.exp(theta[DAMPING]) * np.sqrt(K)
    # In the order of the unknowns.
    joint = (1e-3 * theta[DELTA], K, D, 1e-3 * theta[SOFT], theta[SHARE], theta[DRAG])
    columns = state.shape[1]
    slope = np.zeros(6)
    own = np.zeros(13)
    source = np.zeros(13)
    x, v = state[0, 0], state[1, 0]
    for i in range(waves.shape[1]):
        cosine, sine = forcing[1, i], forcing[2, i]
        middle = x + 0.5 * h * v
        w = v + 0.5 * h * (forcing[0, i] - cosine * middle)
        c, c_x, c_v, c_w = _contact_torque(x, v, w, h, joint, slope)
        waves[0, i] = c
        v_end = 2 * w - v - h * c
        if columns > 3:
            for k in range(6):
                own[3 + k] = slope[k]
            tilt = cosine + sine * middle
            source[3 + FRICTION] = g
            source[3 + PHASE] = tilt
            source[3 + GRAVITY] = sine + g * theta[FRICTION] - cosine * middle
            source[3 + LAG] = motion[2, i] + tilt * motion[0, i]
        for k in range(1, columns):
            x_slope, v_slope = state[0, k], state[1, k]
            w_slope = v_slope + 0.5 * h * (source[k] - cosine * (x_slope + 0.5 * h * v_slope))
            c_k = own[k] + c_x * x_slope + c_v * v_slope + c_w * w_slope
            v_end_k = 2 * w_slope - v_slope - h * c_k
            state[0, k] = x_slope + 0.5 * h * (v_slope + v_end_k)
            state[1, k] = v_end_k
            waves[k, i] = c_k
        x += 0.5 * h * (v + v_end)
        v = v_end
    state[0, 0], state[1, 0] = x, v


def _simulate(
    theta: FloatArray, c: Window, forcing: FloatArray, start: FloatArray, unknowns: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Where a load ends that begins with x and x', shape (2, 1 + 2 + unknowns), with slopes; its contact torques."""
    state = _BEGIN[:, : 3 + unknowns].copy()
    state[:, 0] = start
    waves = np.empty((3 + unknowns, forcing.shape[1]))
    _simulate_turn(theta, c.step_s, c.motion, forcing, state, waves)
    return state, waves


def _close_orbit(
    theta: FloatArray, c: Window, forcing: FloatArray, settling_turns: int, start: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Find where a turn ends where it begins, by Newton's method, and its contact torques.

    None if it finds none, or no load keeps to it. The last step moves the contact torques by their slopes.
    """
    before, rate = math.inf, np.exp(max(0.5 * theta[STIFFNESS], -700.0))  # above 0
    for turn in range(settling_turns + _MOST_TURNS):
        end, waves = _simulate(theta, c, forcing, start)
        miss_x, miss_v = (end[:, 0] - start).tolist()
        (xx, xv), (vx, vv) = end[:, 1:].tolist()
        distance = abs(miss_x) + abs(miss_v) / rate
        if not distance < 1.0:  # ran away
            return None
        determinant = (1 - xx) * (1 - vv) - xv * vx
        is_settled = turn >= settling_turns or distance < _SETTLED_RAD
        if is_settled and distance < before and abs(determinant) > _LEAST_DETERMINANT:
            step_x = ((1 - vv) * miss_x + xv * miss_v) / determinant
            step_v = (vx * miss_x + (1 - xx) * miss_v) / determinant
            start = np.add(start, (step_x, step_v))
            if distance < _NEARLY_CLOSED_RAD:
                contact = waves[0] + (step_x * waves[1] + step_v * waves[2])
                product = xx * vv - xv * vx
                # Whether both multipliers are within the unit circle.
                return (start, contact) if product <= 1 and abs(xx + vv) <= 1 + product else None
        else:
            start = end[:, 0]
        if is_settled:
            before = distance
    return None


def _force_load(theta: FloatArray, c: Window) -> FloatArray:
    """What forces the load, a / N + g sin(q) + g F = force - cosine x, to the first order in x.

    Force, cosine and sine, shape (3, steps). What the lag moves the angle by, a ripple, is taken to the first order, as
    the lag is.
    """
    _, acceleration, acceleration_by_lag = c.motion
    lag, g = float(theta[LAG]), math.exp(min(theta[GRAVITY], 700.0))  # below infinity
    turned = lag * c.direction_by_lag
    turned += c.direction
    turned *= cmath.rect(g, theta[PHASE])
    forcing = np.empty((3, turned.size))
    forcing[1], forcing[2] = turned.real, turned.imag
    np.multiply(lag, acceleration_by_lag, out=forcing[0])
    forcing[0] += acceleration
    forcing[0] += forcing[2]
    forcing[0] += g * theta[FRICTION]
    return forcing


# ------------------------------------------------------------------------------------------------------- the torque


class Responses(NamedTuple):
    """Responses at each harmonic: of the torque's log, of the speed's, and of the joint in contact."""

    rho: float
    torque_log: ComplexArray  # delay and low-pass
    motor: ComplexArray  # N J_m with these
    lag: ComplexArray
    spring: ComplexArray  # K and its damper
    carried: ComplexArray  # the load's torque over that of the motor's own inertia


class Prediction(NamedTuple):
    """What a joint makes of the motor's motion: the load's, and the torque's harmonics with their SDs."""

    theta: FloatArray
    forcing: FloatArray
    response: Responses
    sd: FloatArray
    start: FloatArray  # x and x' where the turn begins; of strokes what is free, too
    contact: FloatArray  # contact torque of each step
    torque: ComplexArray
    left: ComplexArray  # of the measured harmonics, with the other sign


def predict(theta: FloatArray, c: Window, start: FloatArray | None = None) -> Prediction | None:
    """Predict the torque by the orbit near a start, or by the one that a load at rest comes to; None without one.

    Of strokes it is the motion that fits best, from a start near one, or near where the load would rest.
    """
    if c.stroke:
        theta = theta * c.stroke.signs
    forcing = _force_load(theta, c)
    if c.stroke:
        return _fit_start(theta, c, c.stroke, forcing, start)
    settling_turns = _SETTLING_TURNS if start is None else 0
    orbit = _close_orbit(theta, c, forcing, settling_turns, np.zeros(2) if start is None else start)
    if orbit is None:
        return None
    response, sd = respond(theta, c)
    _, contact = orbit
    torque = _torque_of(
        response, _at_harmonics(contact + theta[LOSS] * smooth_abs(contact, c), c), c
    )
    return Prediction(theta, forcing, response, sd, *orbit, torque, torque - c.torque)


def _fit_start(
    theta: FloatArray, c: Window, stroke: Stroke, forcing: FloatArray, start: FloatArray | None
) -> Prediction | None:
    """The motion whose start, and whose motor's friction and ripple, fit best, by Gauss's and Newton's method.

    None if the load runs away. The last step moves the torque by its slopes.
    """
    response, sd = respond(theta, c)
    if start is None:
        force = float(forcing[0, 0])
        rest = force / np.exp(theta[STIFFNESS]) + math.copysign(1e-3 * theta[DELTA], force)
        start = np.array([rest, 0.0])
    # Another comparison's start may be of fewer or more that is free.
    count = 2 + len(stroke.free)
    start = np.append(start, np.zeros(count))[:count]
    lowest, best = math.inf, None
    for _ in range(_MOST_STARTS):
        end, waves = _simulate(theta, c, forcing, start[:2])
        size, rows = _carry(theta, c, waves)
        rows[0] = waves[0] + theta[LOSS] * size
        carried = _at_harmonics(rows, c)
        torque = _torque_of(response, carried[0], c)
        by_start = response.motor * response.rho * carried[1:]
        windowed = _in_window(np.vstack([torque, by_start]), stroke, c)
        left = windowed[0] + start[2:] @ stroke.free - c.torque
        residuals = (left / sd).view(float)
        chi2 = float(residuals @ residuals)
        if not (abs(end[0, 0]) < 1.0 and chi2 < lowest):
            break
        best, lowest = Prediction(theta, forcing, response, sd, start, waves[0], torque, left), chi2
        rows = np.vstack([windowed[1:], stroke.free])
        slopes = (rows / sd).view(float).T
        downhill = -slopes.T @ residuals
        step = np.linalg.solve(slopes.T @ slopes + stroke.least, downhill)
        start = start + step
        if step @ downhill < _LEAST_GAIN * chi2:
            return best._replace(
                start=start,
                contact=waves[0] + step[:2] @ waves[1:],
                torque=torque + step[:2] @ by_start,
                left=left + step @ rows,
            )
    return best


def _in_window(harmonics: ComplexArray, stroke: Stroke, c: Window) -> ComplexArray:
    """Harmonics, shape (..., harmonics), of what the window leaves of their wave."""
    grid = np.zeros((*harmonics.shape[:-1], stroke.taper.size // 2 + 1), dtype=complex)
    grid[..., c.order] = harmonics
    return np.take(np.fft.rfft(stroke.taper * np.fft.irfft(grid)), c.order, axis=-1)


def respond(theta: FloatArray, c: Window) -> tuple[Responses, FloatArray]:
    """Find the responses of log and joint at each harmonic; and the SDs of the torque's harmonics.

    These are of the torque's noise, of the speed's, and of the model's error.
    """
    delay, low_pass, lag = theta[[DELAY, FILTER, LAG]].tolist()
    log = np.exp(-delay * c.per_ms) / (1 + low_pass * c.per_ms)
    K, zeta, rho = np.exp(theta[[STIFFNESS, DAMPING, RATIO]]).tolist()
    spring = K + 2e3 * (zeta + c.ring_damping) * math.sqrt(K) * c.per_ms
    carried = rho * spring / (spring - c.omega**2)
    motor = np.exp(theta[INERTIA]) * log
    response = Responses(rho, log, motor, 1 + lag * c.per_ms, spring, carried)
    variance = _spread(_noise_power(theta, response, c), c) + c.own_variance
    return response, np.sqrt(variance)


def _torque_of(response: Responses, carried: ComplexArray, c: Window) -> ComplexArray:
    """The torque's harmonics by those of c + mu |c|: N J_m (a / N + rho (c + mu |c|)), late."""
    return response.motor * (response.lag * c.acceleration + response.rho * carried)


def _noise_power(theta: FloatArray, response: Responses, c: Window) -> FloatArray:
    """Variance of each harmonic of the torque by the noise of the speed."""
    by_speed = np.abs(response.torque_log * response.lag * (1 + response.carried))
    noise = np.exp(theta[INERTIA]) * by_speed * c.omega * c.speed_sd
    return np.asarray(noise**2)


def _spread(power: FloatArray, c: Window) -> FloatArray:
    """Powers of noise, shape (..., harmonics), as the window spreads them."""
    return np.asarray(power @ c.stroke.spread) if c.stroke else power


def smooth_abs(contact: FloatArray, c: Window) -> FloatArray:
    """|c|, smooth where the torque crosses zero."""
    return np.sqrt(contact * contact + c.smoothing**2)


def _carry(theta: FloatArray, c: Window, waves: FloatArray) -> tuple[FloatArray, FloatArray]:
    """|c| of waves whose first is c, the others its slopes; and these as those of c + mu |c|."""
    size = smooth_abs(waves[0], c)
    return size, (1 + theta[LOSS] * waves[0] / size) * waves


def _at_harmonics(waves: FloatArray, c: Window) -> ComplexArray:
    """The compared harmonics of waves, shape (..., steps), as (..., harmonics)."""
    padded = c.stroke.pads * waves if c.stroke else waves
    return np.asarray(np.fft.rfft(padded)[..., c.order] / c.mid_step)


def torque_residuals(predicted: Prediction) -> FloatArray:
    """What the model leaves of the torque's harmonics over their SDs, real and imaginary parts in turn."""
    return (predicted.left / predicted.sd).view(float)


def differentiate(predicted: Prediction, c: Window) -> tuple[FloatArray, FloatArray]:
    """Slopes of the residuals, shape (residuals, unknowns), and of the start; not finite where orbits part."""
    theta = predicted.theta
    end, waves = _simulate(theta, c, predicted.forcing, predicted.start[:2], OF_CONTACT)
    _, waves = _carry(theta, c, waves)
    waves[0] = smooth_abs(predicted.contact, c)
    slope = _at_harmonics(waves, c)
    if c.stroke:
        slopes = _residual_slopes(predicted, c, slope[3:], slope[0])
        response = predicted.response
        rows = _in_window(response.motor * response.rho * slope[1:3], c.stroke, c)
        by_start = (np.vstack([rows, c.stroke.free]) / predicted.sd).view(float).T
        normal = by_start.T @ by_start + c.stroke.least
        start_slopes = -np.linalg.solve(normal, by_start.T @ slopes)
        return (slopes + by_start @ start_slopes) * c.stroke.signs, start_slopes * c.stroke.signs
    # The start moves with the unknowns, so that the turn ends where it begins.
    (p, q), (r, s) = np.eye(2) - end[:, 1:3]
    start_slopes = np.array([[s, -q], [-r, p]]) @ end[:, 3:] / (p * s - q * r)
    contact_slope = slope[3:] + start_slopes.T @ slope[1:3]
    return _residual_slopes(predicted, c, contact_slope, slope[0]), start_slopes


def _residual_slopes(
    predicted: Prediction, c: Window, contact_slope: ComplexArray, loss_slope: ComplexArray
) -> FloatArray:
    """Slopes of the residuals by all unknowns, by those of the harmonics of c + mu |c|."""
    theta, response = predicted.theta, predicted.response
    gain, rho = response.motor, response.rho
    slope = np.empty((theta.size, c.omega.size), dtype=complex)
    np.multiply(gain * rho, contact_slope, out=slope[:OF_CONTACT])
    slope[LAG] += gain * c.per_ms * c.acceleration
    slope[RATIO] = predicted.torque - gain * response.lag * c.acceleration
    slope[INERTIA] = predicted.torque
    slope[DELAY] = -c.per_ms * predicted.torque
    slope[LOSS] = gain * rho * loss_slope
    slope[FILTER] = slope[DELAY] / (1 + theta[FILTER] * c.per_ms)
    if c.stroke:
        slope = _in_window(slope, c.stroke, c)
    slope -= predicted.left / predicted.sd * _sd_slopes(predicted, c)
    slope /= predicted.sd
    return slope.view(float).T


def _sd_slopes(predicted: Prediction, c: Window) -> FloatArray:
    """Slopes of the torque's SDs by the unknowns, shape (unknowns, harmonics): the speed's noise goes with them."""
    theta, response = predicted.theta, predicted.response
    spring, carried = response.spring, response.carried
    half_damper = 0.5j * spring.imag
    spring_slope = carried * (1 / spring - 1 / (spring - c.omega**2)) / (1 + carried)
    slope = np.zeros((theta.size, c.omega.size))  # of the noise's logarithm
    slope[STIFFNESS] = (spring_slope * (spring - half_damper)).real
    own_share = 1 / (1 + c.ring_damping / np.exp(theta[DAMPING]))
    slope[DAMPING] = 2 * own_share * (spring_slope * half_damper).real
    slope[LAG] = (c.per_ms / response.lag).real
    slope[RATIO] = (carried / (1 + carried)).real
    slope[INERTIA] = 1.0
    slope[FILTER] = -(c.per_ms / (1 + theta[FILTER] * c.per_ms)).real
    slope *= _noise_power(theta, response, c)
    return np.asarray(_spread(slope, c) / predicted.sd)


class Predictions(NamedTuple):
    """What a joint makes of the motion in each window."""

    each: list[Prediction]

    @property
    def start(self) -> FloatArray:
        """Where the load begins, in one window after the other."""
        return np.concatenate([one.start for one in self.each])


class Comparison(NamedTuple):
    """What is compared: the mean turn, the only window, or the mean stroke of each direction."""

    windows: tuple[Window, ...]
    size: float  # how many numbers are compared

    def predict(self, theta: FloatArray, start: FloatArray | None = None) -> Predictions | None:
        """Predict the torque of all windows; None if one has no motion."""
        count = len(self.windows)
        starts = [None] * count if start is None else np.split(start, count)
        each = [predict(theta, *both) for both in zip(self.windows, starts, strict=True)]
        whole = [one for one in each if one]
        return Predictions(whole) if len(whole) == count else None

    def residuals(self, predicted: Predictions) -> FloatArray:
        """What the model leaves, over its SDs."""
        return np.concatenate([*map(torque_residuals, predicted.each)])

    def differentiate(self, predicted: Predictions) -> tuple[FloatArray, FloatArray]:
        """Slopes of the residuals by the unknowns, and of the starts."""
        slopes, starts = zip(*map(differentiate, predicted.each, self.windows), strict=True)
        return np.vstack(slopes), np.vstack(starts)
