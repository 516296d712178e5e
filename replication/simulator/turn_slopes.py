"""A settled turn and its slopes by all that a joint's row holds, integrated together: what a fit of a joint needs.

The slopes follow the equations of motion linearised along the turn. Where the teeth part or meet, torque and rates are
continuous, so the slopes pass from region to region without a jump.
"""

import numba as nb
import numpy as np

from replication.arrays import FloatArray
from replication.simulator import core
from replication.simulator.parameters import TURN
from replication.simulator.turns import (
    COLUMNS,
    DELAY_PERIODS,
    STEPS_PER_PERIOD,
    Movement,
    constants,
    drive,
    start,
    waves_of,
)

_P = len(COLUMNS)
_DELTA, _FRICTION, _STIFFNESS, _GRAVITY, _INERTIA = range(5)
_SPEED, _INTEGRAL, _DERIVATIVE, _LEAKY, _POSITION, _RATE, _LAG, _COUPLING, _MOTOR = range(5, 14)
_ERROR, _RIPPLE = 14, 16

# The first turns are the drive's; a joint that has not settled after the last never does.
_LEAST_TURNS, _MOST_TURNS = 3, 14


@nb.njit(cache=True)
def _start_slopes(row, c, dy):
    """Slopes of `turns.start` by the row's columns."""
    n, sine = c.gear_ratio, np.sin(c.start_angle)
    torque = c.gravity * (sine + row[_FRICTION])
    side = -1.0 if torque < 0 else 1.0
    by_gravity, by_friction = sine + row[_FRICTION], c.gravity
    dy[2, _DELTA] = -side
    dy[2, _STIFFNESS] = torque / c.ks**2
    dy[2, _GRAVITY], dy[2, _FRICTION] = -by_gravity / c.ks, -by_friction / c.ks
    dy[4, _GRAVITY], dy[4, _FRICTION] = by_gravity / n, by_friction / n


@nb.njit(cache=True)
def _forcing(t, y, rates, region, c, row, order, out):
    """What the columns themselves do to the rates of motor speed, load speed and torque, into `out` (3, columns)."""
    n, omega, jm = c.gear_ratio, c.omega, c.motor_inertia
    angle = c.start_angle + omega / n * t
    sine = np.sin(angle + y[2])
    side = 1.0 if region == 3 else (-1.0 if region == 0 else 0.0)
    twist = abs(side) * (y[0] / n - y[2]) - side * c.delta
    rubbing = 0.5 * (1 + n * y[3] / omega) + 0.5 * np.sign(omega / n + y[3])
    out[0, _DELTA], out[1, _DELTA] = side * c.ks / (n * jm), -side * c.ks
    out[0, _STIFFNESS], out[1, _STIFFNESS] = -twist / (n * jm), twist
    out[1, _FRICTION] = -c.gravity * rubbing
    out[1, _GRAVITY] = -sine - row[_FRICTION] * rubbing
    out[0, _INERTIA] = rates[1] / row[_INERTIA]
    out[2, _LAG] = -rates[4] / c.torque_lag
    wave, quarter = np.sin(omega * t + y[0]) / (n * jm), np.cos(omega * t + y[0]) / (n * jm)
    out[0, _RIPPLE], out[0, _RIPPLE + 1] = c.gravity * wave, c.gravity * quarter
    out[0, _GRAVITY] = row[_RIPPLE] * wave + row[_RIPPLE + 1] * quarter
    if order > 0:
        shaken = c.gravity * np.cos(angle) - (order * omega / n) ** 2
        out[1, _ERROR] = shaken * np.sin(order * omega / n * t)
        out[1, _ERROR + 1] = shaken * np.cos(order * omega / n * t)


@nb.njit(cache=True)
def _weighed(y, h, k1, k2, k3, k4):
    """State after a Runge-Kutta step with these rates."""
    return core.along(core.along(core.along(core.along(y, h / 6, k1), h / 3, k2), h / 3, k3), h / 6, k4)


@nb.njit(cache=True)
def _rates(x, command, line, on_motor, on_load, on_torque):
    """Rates of a slope `x` of the state: the equations of motion, linear within a region, and what is forced on it."""
    ks, ds, per_turn, push, own, swing, rub, lag = line
    torque = ks * (per_turn * x[0] - x[2]) + ds * (per_turn * x[1] - x[3])
    motor = push * (x[4] - per_turn * torque - own * x[1]) + on_motor
    return x[1], motor, x[3], torque - swing * x[2] - rub * x[3] + on_load, lag * (command - x[4]) + on_torque


@nb.njit(cache=True)
def _step(t, y, dy, h, command, dcommand, region, c, row, order, forced):
    """One Runge-Kutta step of the state and its slopes, those in place; `forced` (3, 3, slopes) is memory."""
    b1 = core.derivative(t, y, command, region, c)
    y2 = core.along(y, h / 2, b1)
    b2 = core.derivative(t + h / 2, y2, command, region, c)
    y3 = core.along(y, h / 2, b2)
    b3 = core.derivative(t + h / 2, y3, command, region, c)
    y4 = core.along(y, h, b3)
    b4 = core.derivative(t + h, y4, command, region, c)
    _forcing(t, y, b1, region, c, row, order, forced[0])
    _forcing(t + h / 2, y3, b3, region, c, row, order, forced[1])
    _forcing(t + h, y4, b4, region, c, row, order, forced[2])
    touching = region == 0 or region == 3
    ks, ds = (c.ks, c.ds) if touching else (0.0, 0.0)
    swing = c.gravity * np.cos(c.start_angle + c.omega / c.gear_ratio * (t + h / 2))
    line = (
        ks, ds, 1 / c.gear_ratio, 1 / c.motor_inertia, c.motor_viscous, swing, c.load_viscous, 1 / c.torque_lag
    )  # fmt: skip
    for p in range(dy.shape[1]):
        x, u = (dy[0, p], dy[1, p], dy[2, p], dy[3, p], dy[4, p]), dcommand[p]
        k1 = _rates(x, u, line, forced[0, 0, p], forced[0, 1, p], forced[0, 2, p])
        middle = forced[1, 0, p], forced[1, 1, p], forced[1, 2, p]
        k2 = _rates(core.along(x, h / 2, k1), u, line, *middle)
        k3 = _rates(core.along(x, h / 2, k2), u, line, *middle)
        k4 = _rates(core.along(x, h, k3), u, line, forced[2, 0, p], forced[2, 1, p], forced[2, 2, p])
        dy[0, p], dy[1, p], dy[2, p], dy[3, p], dy[4, p] = _weighed(x, h, k1, k2, k3, k4)
    return _weighed(y, h, b1, b2, b3, b4)


@nb.njit(cache=True)
def _control_slopes(y, dy, memory, dmemory, dring, count, d, row):
    """Slopes of `core.control`, called before it with the memory that it will find; returns those of the torque."""
    position, speed, rate, ki = y[0], y[1], 1 / d.period, d.integral_gain * d.period
    by_difference = d.differencing > 0 and count > 0
    if by_difference:
        speed = (position - memory[3]) * rate
    new, old = (0.0, rate) if by_difference else (1.0, 0.0)
    now = dring[count % dring.shape[0]]
    for p in range(dy.shape[1]):
        dposition = dy[0, p]
        dspeed = old * (dposition - dmemory[3, p]) + new * dy[1, p]
        derror = -d.position_gain * dposition - dspeed
        dintegral = dmemory[0, p] + ki * derror
        dleaky = dmemory[1, p] - d.period * (dspeed + d.leaky_rate * dmemory[1, p])
        damping = d.derivative_gain * rate * (dspeed - dmemory[2, p])
        now[p] = d.speed_gain * derror + dintegral + d.leaky_gain * dleaky - damping
        dmemory[0, p], dmemory[1, p], dmemory[2, p], dmemory[3, p] = dintegral, dleaky, dspeed, dposition
    error = -d.position_gain * position - speed
    leaky = memory[1] - d.period * (speed + d.leaky_rate * memory[1])
    gained, jm = (speed - memory[2]) * rate, d.speed_gain / row[_SPEED]
    for p, more in (
        (_POSITION, -ki * position), (_INTEGRAL, ki / row[_INTEGRAL] * error), (_INERTIA, -ki / row[_INERTIA] * error)
    ):  # fmt: skip
        dmemory[0, p] += more
        now[p] += more
    dmemory[1, _RATE] -= d.period * memory[1]
    now[_RATE] -= d.leaky_gain * d.period * memory[1]
    now[_POSITION] -= d.speed_gain * position
    now[_SPEED] += jm * error
    now[_DERIVATIVE] -= jm * gained
    now[_LEAKY] += jm * leaky
    now[_INERTIA] -= (d.speed_gain * error + d.leaky_gain * leaky - d.derivative_gain * gained) / row[_INERTIA]
    return dring[(count + 1) % dring.shape[0]]


@nb.njit(cache=True)
def _period(t, y, dy, memory, dmemory, ring, dring, count, region, c, d, row, order, forced, kept):
    """One control period of the state and its slopes, those in place; returns state and region."""
    dcommand = _control_slopes(y, dy, memory, dmemory, dring, count, d, row)
    command = core.control(t, y, memory, ring, count, d, c)
    edges = (-np.inf, -c.delta, 0.0, c.delta, np.inf)
    for k in range(STEPS_PER_PERIOD):
        now, left = t + k * d.period / STEPS_PER_PERIOD, d.period / STEPS_PER_PERIOD
        for _ in range(16):
            kept[:] = dy
            end = _step(now, y, dy, left, command, dcommand, region, c, row, order, forced)
            x = end[0] / c.gear_ratio - end[2]
            up = x > edges[region + 1]
            if not up and x >= edges[region]:
                break
            dy[:] = kept
            edge = edges[region + 1] if up else edges[region]
            s, _ = core.locate(now, y, left, end, edge, command, region, c)
            y = _step(now, y, dy, s, command, dcommand, region, c, row, order, forced)
            region = region + 1 if up else region - 1
            now, left = now + s, left - s
        y = end
    return y, region


@nb.njit(cache=True, nogil=True)
def _run(row, n, turn_s, periods, order, differencing, with_ripple, settled_rps, pushes):
    period = turn_s / periods
    c = constants(row, n, turn_s, 0.0, waves_of(row, n, turn_s, order, with_ripple))
    d = drive(row, n, period, differencing)
    y, region = start(c, row[1])
    size = _P + pushes.shape[0]
    out, slopes = np.zeros((2, periods)), np.empty((size, periods))
    dy, dmemory, dring = np.zeros((5, size)), np.zeros((4, size)), np.zeros((DELAY_PERIODS + 1, size))
    _start_slopes(row, c, dy)
    dmemory[0], dring[:] = dy[4], dy[4]
    memory, ring = np.array([y[4], 0.0, 0.0, y[0]]), np.full(DELAY_PERIODS + 1, y[4])
    forced, kept = np.zeros((3, 3, size)), np.empty((5, size))
    before = np.inf
    for turn in range(_MOST_TURNS):
        square = 0.0
        for i in range(periods):
            square += (y[1] / TURN - out[0, i]) ** 2
            out[0, i], out[1, i] = y[1] / TURN, y[3]
            slopes[:, i] = dy[1] / TURN
            then = (i + 1) % periods
            for j in range(pushes.shape[0]):
                forced[0, 1, _P + j], forced[2, 1, _P + j] = pushes[j, i], pushes[j, then]
                forced[1, 1, _P + j] = 0.5 * (pushes[j, i] + pushes[j, then])
            count = turn * periods + i
            y, region = _period(
                count * period, y, dy, memory, dmemory, ring, dring, count, region, c, d, row, order, forced, kept
            )
            if not abs(y[1]) < core.DIVERGED * c.omega:
                out[:] = np.nan
                slopes[:] = np.nan
                return out, slopes, turn
        change = np.sqrt(square / periods)
        # What is still to come, if it goes on shrinking as from the last turn to this one.
        shrinking = change / before
        if turn >= _LEAST_TURNS - 1 and shrinking < 1 and change * shrinking < settled_rps * (1 - shrinking):
            return out, slopes, turn
        before = change
    return out, slopes, _MOST_TURNS - 1


def turn_and_slopes(
    row: FloatArray,
    movement: Movement,
    order: float,
    differencing: bool,
    with_ripple: bool,
    settled_rps: float,
    pushes: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, int]:
    """Motor speed [rps] and load speed [rad/s] of a joint over one settled turn, the slopes, and the turns before it.

    The slopes are the motor speed's derivatives by `COLUMNS` and by `pushes`, further accelerations of the load over a
    turn. The turn has settled where turns to come would change it by less than `settled_rps` (RMS). The drive's speed
    and integral gain and the torque's lag must not be 0; a joint that runs away gives NaN.
    """
    periods = movement.periods
    pushes = np.empty((0, periods)) if pushes is None else np.ascontiguousarray(pushes, dtype=float)
    return _run(
        np.ascontiguousarray(row, dtype=float), movement.gear_ratio, movement.turn_period_s, periods, float(order),
        float(differencing), with_ripple, settled_rps, pushes,
    )  # fmt: skip
