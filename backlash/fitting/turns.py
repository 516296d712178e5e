"""Settled turns of many joints at once, and of one joint with its slopes by all that its row holds; compiled.

The joint is that of `simulate` with a linear drive and one load friction. A turn repeats itself exactly, because the
drive's period is taken as a whole part of it; the first turns, in which the drive settles, are left out.

The slopes follow the equations of motion linearised along the turn. Where the teeth part or meet, torque and rates are
continuous, so the slopes pass from region to region without a jump.
"""

from dataclasses import dataclass

import numpy as np

from replication.arrays import FloatArray
from replication.compiled.cache import njit
from replication.simulator import core
from replication.simulator.parameters import TURN

# Columns of a joint's row: `JointParameters.ratios` between the first two and the last four. Friction is over m g r,
# the ripple over m g r / N.
_PLANT = ("delta_rad", "friction", "stiffness_per_s2", "gravity_per_s2", "inertia_ratio")
_GAINS = ("speed_gain_per_s", "integral_gain_per_s2", "derivative_gain", "leaky_gain_per_s2", "position_gain_per_s")
_TIMES = ("leaky_rate_per_s", "torque_lag_s")
_WAVES = ("error_sine_rad", "error_cosine_rad", "ripple_sine", "ripple_cosine")
COLUMNS = (*_PLANT, *_GAINS, *_TIMES, *_WAVES)
DELTA, FRICTION, STIFFNESS, GRAVITY, INERTIA = range(5)
SPEED, INTEGRAL, DERIVATIVE, LEAKY, POSITION, RATE, LAG = range(5, 12)
ERROR, RIPPLE, _WIDTH = 12, 14, len(COLUMNS)

# The drive's slowest modes, 13 per second in the paper's joint, are gone after this time to 3e-5.
_SETTLING_S = 0.8
# Of the control and of a Runge-Kutta step, a quarter of a radian of the fastest mode: 3e-5 rps RMS off.
_CONTROL_S = 5e-4
DELAY_PERIODS = 1
_ALPHA_PER_RAD = 1e6
# Turns with slopes: the first two at most are the drive's; one that has not settled after the last never does.
_LEAST_TURNS, _MOST_TURNS = 3, 14


@dataclass(frozen=True)
class Movement:
    """The test movement: motor turns in a load turn, and the load turn's duration [s]."""

    gear_ratio: float
    turn_period_s: float

    @property
    def periods(self) -> int:
        """Control periods in a turn."""
        return max(round(self.turn_period_s / _CONTROL_S), 16)


@njit
def constants(row, n, turn_s, angle, waves):
    """Constants of a joint, its load's inertia 1: half of the friction is Coulomb's, half viscous."""
    omega = n * TURN / turn_s
    jm, ks, gravity = 1 / (n * n * row[INERTIA]), row[STIFFNESS], row[GRAVITY]
    rubbing = 0.5 * row[FRICTION] * gravity
    viscous = rubbing / (omega / n)
    return core.Constants(
        n, omega, angle, jm, 1.0, ks, 0.0, _ALPHA_PER_RAD, row[DELTA], 0.0, gravity, 0.0, viscous, 0.0, rubbing,
        row[LAG], waves,
    )  # fmt: skip


@njit
def drive(row, n, period, differencing):
    """Drive of a joint; `differencing` is 1 if it differences its encoder, as real ones do, 0 if not."""
    jm = 1 / (n * n * row[INERTIA])
    speed, integral, derivative, leaky = row[SPEED] * jm, row[INTEGRAL] * jm, row[DERIVATIVE] * jm, row[LEAKY] * jm
    return core.Drive(row[POSITION], speed, integral, derivative, leaky, row[RATE], period, np.inf, 0.0, differencing)


@njit
def start(c, friction):
    """State and region in balance, as `core.start_state`."""
    torque = c.gravity * np.sin(c.start_angle) + friction * c.gravity
    side = -1.0 if torque < 0 else 1.0
    return (0.0, 0.0, -(side * c.delta + torque / c.ks), 0.0, torque / c.gear_ratio), 3 if side > 0 else 0


@njit
def waves_of(row, n, turn_s, order, with_ripple):
    """Disturbances of a joint, a row each; no wave at all compiles to less work."""
    errors = 2 if order > 0 else 0
    waves = np.zeros((errors + (2 if with_ripple else 0), 5))
    for part in range(errors):
        error = row[ERROR + part]
        waves[part] = order / n, 0.0, -error * (order * TURN / turn_s) ** 2, error, part * TURN / 4
    for part in range(len(waves) - errors):
        waves[errors + part] = 1.0, row[RIPPLE + part] * row[GRAVITY] / n, 0.0, 0.0, part * TURN / 4
    return waves


@njit(nogil=True)
def _settled(rows, n, turn_s, periods, lead, order, differencing):
    out = np.full((rows.shape[0], periods), np.nan)
    period, steps = turn_s / periods, lead + periods
    record, gap, events = np.empty((steps + 1, 5)), np.empty(steps + 1, dtype=np.int64), np.empty((0, 2))
    with_ripple = np.any(rows[:, RIPPLE:] != 0)
    for k in range(rows.shape[0]):
        waves = waves_of(rows[k], n, turn_s, order, with_ripple)
        c = constants(rows[k], n, turn_s, -TURN * lead / periods, waves)
        d = drive(rows[k], n, period, differencing)
        y, region = start(c, rows[k, FRICTION])
        status, _ = core.run(y, region, steps, period, 0, 1, 1, DELAY_PERIODS, c, d, record, gap, events)
        if status < 0:
            out[k] = record[lead:steps, 1] / TURN
    return out


def settling_turns(movement: Movement) -> int:
    """Turns after which the drive of a well damped joint has settled."""
    return max(int(np.ceil(_SETTLING_S / movement.turn_period_s)), 1)


def settled_turns(
    rows: FloatArray, movement: Movement, order: float = 0, lead: int | None = None, differencing: bool = True
) -> FloatArray:
    """Deviation from the commanded speed [rps] of each joint over one settled turn; NaN for a joint that runs away.

    `order` is the transmission error's periods a turn (0: none), `lead` the turns before the one that is returned.
    """
    n, turn_s, periods = movement.gear_ratio, movement.turn_period_s, movement.periods
    settling = (settling_turns(movement) if lead is None else lead) * periods
    rows = np.ascontiguousarray(rows, dtype=float)
    return _settled(rows, n, turn_s, periods, settling, float(order), float(differencing))


@njit
def _start_slopes(row, c, dy):
    """Slopes of `start` by the row's columns."""
    by_gravity = np.sin(c.start_angle) + row[FRICTION]
    torque = c.gravity * by_gravity
    dy[2, DELTA] = 1.0 if torque < 0 else -1.0
    dy[2, STIFFNESS] = torque / c.ks**2
    dy[2, GRAVITY], dy[2, FRICTION] = -by_gravity / c.ks, -c.gravity / c.ks
    dy[4, GRAVITY], dy[4, FRICTION] = by_gravity / c.gear_ratio, c.gravity / c.gear_ratio


@njit
def _forcing(t, y, rates, region, c, row, order, out):
    """What the columns themselves do to the rates of motor speed, load speed and torque, into `out` (3, columns)."""
    n, omega, jm = c.gear_ratio, c.omega, c.motor_inertia
    angle = c.start_angle + omega / n * t
    side = 1.0 if region == 3 else (-1.0 if region == 0 else 0.0)
    twist = abs(side) * (y[0] / n - y[2]) - side * c.delta
    rubbing = 0.5 * (1 + n * y[3] / omega) + 0.5 * np.sign(omega / n + y[3])
    out[0, DELTA], out[1, DELTA] = side * c.ks / (n * jm), -side * c.ks
    out[0, STIFFNESS], out[1, STIFFNESS] = -twist / (n * jm), twist
    out[1, FRICTION] = -c.gravity * rubbing
    out[1, GRAVITY] = -np.sin(angle + y[2]) - row[FRICTION] * rubbing
    out[0, INERTIA] = rates[1] / row[INERTIA]
    out[2, LAG] = -rates[4] / c.torque_lag
    sine, cosine = np.sin(omega * t + y[0]) / (n * jm), np.cos(omega * t + y[0]) / (n * jm)
    out[0, RIPPLE], out[0, RIPPLE + 1] = c.gravity * sine, c.gravity * cosine
    out[0, GRAVITY] = row[RIPPLE] * sine + row[RIPPLE + 1] * cosine
    if order > 0:
        shaken = c.gravity * np.cos(angle) - (order * omega / n) ** 2
        out[1, ERROR] = shaken * np.sin(order * omega / n * t)
        out[1, ERROR + 1] = shaken * np.cos(order * omega / n * t)


@njit
def _weighed(y, h, k1, k2, k3, k4):
    """State after a Runge-Kutta step with these rates."""
    return core.along(core.along(core.along(core.along(y, h / 6, k1), h / 3, k2), h / 3, k3), h / 6, k4)


@njit
def _rates(x, command, line, forced, p):
    """Rates of a slope `x` of the state: the equations of motion, linear within a region, and what is forced on it."""
    ks, per_turn, push, swing, rub, lag = line
    torque = ks * (per_turn * x[0] - x[2])
    motor = push * (x[4] - per_turn * torque) + forced[0, p]
    return x[1], motor, x[3], torque - swing * x[2] - rub * x[3] + forced[1, p], lag * (command - x[4]) + forced[2, p]


@njit
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
    ks = c.ks if region == 0 or region == 3 else 0.0
    swing = c.gravity * np.cos(c.start_angle + c.omega / c.gear_ratio * (t + h / 2))
    line = ks, 1 / c.gear_ratio, 1 / c.motor_inertia, swing, c.load_viscous, 1 / c.torque_lag
    for p in range(dy.shape[1]):
        x, u = (dy[0, p], dy[1, p], dy[2, p], dy[3, p], dy[4, p]), dcommand[p]
        k1 = _rates(x, u, line, forced[0], p)
        k2 = _rates(core.along(x, h / 2, k1), u, line, forced[1], p)
        k3 = _rates(core.along(x, h / 2, k2), u, line, forced[1], p)
        k4 = _rates(core.along(x, h, k3), u, line, forced[2], p)
        dy[0, p], dy[1, p], dy[2, p], dy[3, p], dy[4, p] = _weighed(x, h, k1, k2, k3, k4)
    return _weighed(y, h, b1, b2, b3, b4)


@njit
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
    gained, jm, inertia = (speed - memory[2]) * rate, d.speed_gain / row[SPEED], row[INERTIA]
    by_position, by_integral, by_inertia = -ki * position, ki / row[INTEGRAL] * error, -ki / inertia * error
    for part in (dmemory[0], now):
        part[POSITION] += by_position
        part[INTEGRAL] += by_integral
        part[INERTIA] += by_inertia
    dmemory[1, RATE] -= d.period * memory[1]
    now[RATE] -= d.leaky_gain * d.period * memory[1]
    now[POSITION] -= d.speed_gain * position
    now[SPEED] += jm * error
    now[DERIVATIVE] -= jm * gained
    now[LEAKY] += jm * leaky
    now[INERTIA] -= (d.speed_gain * error + d.leaky_gain * leaky - d.derivative_gain * gained) / inertia
    return dring[(count + 1) % dring.shape[0]]


@njit
def _period(y, dy, memory, dmemory, ring, dring, count, region, c, d, row, order, forced, kept):
    """One control period of the state and its slopes, those in place; returns state and region."""
    t, left = count * d.period, d.period
    dcommand = _control_slopes(y, dy, memory, dmemory, dring, count, d, row)
    command = core.control(t, y, memory, ring, count, d, c)
    edges = (-np.inf, -c.delta, 0.0, c.delta, np.inf)
    end = y
    for _ in range(16):
        kept[:] = dy
        end = _step(t, y, dy, left, command, dcommand, region, c, row, order, forced)
        x = end[0] / c.gear_ratio - end[2]
        up = x > edges[region + 1]
        if not up and x >= edges[region]:
            break
        dy[:] = kept
        s, _ = core.locate(t, y, left, end, edges[region + 1] if up else edges[region], command, region, c)
        y = _step(t, y, dy, s, command, dcommand, region, c, row, order, forced)
        region = region + 1 if up else region - 1
        t, left = t + s, left - s
    return end, region


@njit(nogil=True)
def _run(row, n, turn_s, periods, order, differencing, with_ripple, settled_rps, pushes):
    c = constants(row, n, turn_s, 0.0, waves_of(row, n, turn_s, order, with_ripple))
    d = drive(row, n, turn_s / periods, differencing)
    y, region = start(c, row[FRICTION])
    size = _WIDTH + pushes.shape[0]
    out, slopes = np.zeros((2, periods)), np.empty((size, periods))
    dy, dmemory, dring = np.zeros((5, size)), np.zeros((4, size)), np.zeros((DELAY_PERIODS + 1, size))
    _start_slopes(row, c, dy)
    dmemory[0], dring[:] = dy[4], dy[4]
    memory, ring = np.array([y[4], 0.0, 0.0, y[0]]), np.full(DELAY_PERIODS + 1, y[4])
    forced, kept = np.zeros((3, 3, size)), np.empty((5, size))
    before, least = np.inf, min(_LEAST_TURNS, int(np.ceil(_SETTLING_S / turn_s)) + 1)
    for turn in range(_MOST_TURNS):
        square = 0.0
        for i in range(periods):
            square += (y[1] / TURN - out[0, i]) ** 2
            out[0, i], out[1, i] = y[1] / TURN, y[3]
            slopes[:, i] = dy[1] / TURN
            now, then = pushes[:, i], pushes[:, (i + 1) % periods]
            forced[0, 1, _WIDTH:], forced[1, 1, _WIDTH:], forced[2, 1, _WIDTH:] = now, 0.5 * (now + then), then
            count = turn * periods + i
            y, region = _period(y, dy, memory, dmemory, ring, dring, count, region, c, d, row, order, forced, kept)
            if not abs(y[1]) < core.DIVERGED * c.omega:
                out[:], slopes[:] = np.nan, np.nan
                return out, slopes, turn
        change = np.sqrt(square / periods)
        # What is still to come, if it goes on shrinking as from the last turn to this one.
        shrinking = change / before
        if turn >= least - 1 and shrinking < 1 and change * shrinking < settled_rps * (1 - shrinking):
            return out, slopes, turn
        before = change
    return out, slopes, _MOST_TURNS - 1


def turn_and_slopes(
    row: FloatArray, movement: Movement, order: float, differencing: bool, with_ripple: bool, settled_rps: float,
    pushes: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, int]:  # fmt: skip
    """Motor speed [rps] and load speed [rad/s] of a joint over one settled turn, the slopes, and the turns before it.

    The slopes are the motor speed's derivatives by `COLUMNS` and by `pushes`, further accelerations of the load over a
    turn. The turn has settled where turns to come would change it by less than `settled_rps` (RMS). The drive's speed
    and integral gain and the torque's lag must not be 0; a joint that runs away gives NaN.
    """
    n, turn_s, periods = movement.gear_ratio, movement.turn_period_s, movement.periods
    row = np.ascontiguousarray(row, dtype=float)
    pushes = np.empty((0, periods)) if pushes is None else np.ascontiguousarray(pushes, dtype=float)
    return _run(row, n, turn_s, periods, float(order), float(differencing), with_ripple, settled_rps, pushes)
