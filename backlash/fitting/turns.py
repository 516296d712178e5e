"""Settled turns of many joints at once, and of one joint with its slopes by all that its row holds; compiled.

The joint is that of `simulate` with a linear drive and one load friction. A turn repeats itself exactly, because the
drive's period is taken as a whole part of it; the first turns, in which the drive settles, are left out.

The slopes follow the equations of motion linearised along the turn. Where the teeth part or meet, torque and rates are
continuous, so the slopes pass from region to region without a jump.
"""

from typing import NamedTuple

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


class Movement(NamedTuple):
    """The test movement: motor turns in a load turn, and the load turn's duration [s]."""

    gear_ratio: float
    turn_period_s: float

    @property
    def periods(self) -> int:
        """Control periods in a turn."""
        return max(round(self.turn_period_s / _CONTROL_S), 16)


class TurnWithSlopes(NamedTuple):
    """One settled turn of a joint, arrays over its control periods; all NaN for a joint that runs away."""

    motor_rps: FloatArray  # deviation from the commanded speed
    load_rad_per_s: FloatArray
    slopes: FloatArray  # of the motor's speed by `COLUMNS`, then by the pushes
    turns_before: int


class _Joint(NamedTuple):
    """A joint's row, and what the simulator makes of it; the order of its transmission error in a turn, or 0."""

    row: FloatArray
    constants: core.Constants
    drive: core.Drive
    order: float


class _Memory(NamedTuple):
    """What `core.control` keeps: integral, leaky integral, speed and position; and the torques that are under way."""

    drive: FloatArray
    torques: FloatArray


class _Slopes(NamedTuple):
    """Slopes of the state and of the drive's memory by the columns and pushes, in the last axis; and work space."""

    state: FloatArray
    drive: FloatArray
    torques: FloatArray
    before: FloatArray  # the state's, before a step that is taken back
    forced: FloatArray  # what columns and pushes do to three rates at a step's start, middle and end


class _Linear(NamedTuple):
    """The equations of motion, linear within a region: every factor of `_rates`."""

    ks: float
    per_turn: float
    push: float
    swing: float
    rub: float
    lag: float


@njit
def constants(row, n, turn_s, angle, waves):
    """Constants of a joint, its load's inertia 1: half of the friction is Coulomb's, half viscous."""
    omega = n * TURN / turn_s
    rubbing = 0.5 * row[FRICTION] * row[GRAVITY]
    return core.Constants(
        gear_ratio=n,
        omega=omega,
        start_angle=angle,
        motor_inertia=1 / (n * n * row[INERTIA]),
        load_inertia=1.0,
        ks=row[STIFFNESS],
        ds=0.0,
        alpha=_ALPHA_PER_RAD,
        delta=row[DELTA],
        clamped=0.0,
        gravity=row[GRAVITY],
        motor_viscous=0.0,
        load_viscous=rubbing / (omega / n),
        motor_coulomb=0.0,
        load_coulomb=rubbing,
        torque_lag=row[LAG],
        waves=waves,
    )


@njit
def drive(row, n, period, differencing):
    """Drive of a joint; `differencing` is 1 if it differences its encoder, as real ones do, 0 if not."""
    jm = 1 / (n * n * row[INERTIA])
    return core.Drive(
        position_gain=row[POSITION],
        speed_gain=row[SPEED] * jm,
        integral_gain=row[INTEGRAL] * jm,
        derivative_gain=row[DERIVATIVE] * jm,
        leaky_gain=row[LEAKY] * jm,
        leaky_rate=row[RATE],
        period=period,
        torque_limit=np.inf,
        resolution=0.0,
        differencing=differencing,
    )


@njit
def _start(c, friction):
    """State and region in balance, as `core.start_state`."""
    torque = c.gravity * np.sin(c.start_angle) + friction * c.gravity
    side = -1.0 if torque < 0 else 1.0
    return (0.0, 0.0, -(side * c.delta + torque / c.ks), 0.0, torque / c.gear_ratio), 3 if side > 0 else 0


@njit
def _waves_of(row, movement, order, with_ripple):
    """Disturbances of a joint, a row each; no wave at all compiles to less work."""
    n = movement.gear_ratio
    errors = 2 if order > 0 else 0
    waves = np.zeros((errors + (2 if with_ripple else 0), 5))
    for part in range(errors):
        error = row[ERROR + part]
        waves[part, 0] = order / n
        waves[part, 2] = -error * (order * TURN / movement.turn_period_s) ** 2
        waves[part, 3] = error
        waves[part, 4] = part * TURN / 4
    for part in range(len(waves) - errors):
        waves[errors + part, 0] = 1.0
        waves[errors + part, 1] = row[RIPPLE + part] * row[GRAVITY] / n
        waves[errors + part, 4] = part * TURN / 4
    return waves


@njit
def _joint_of(row, movement, angle, periods, order, differencing, with_ripple):
    waves = _waves_of(row, movement, order, with_ripple)
    c = constants(row, movement.gear_ratio, movement.turn_period_s, angle, waves)
    d = drive(row, movement.gear_ratio, movement.turn_period_s / periods, differencing)
    return _Joint(row, c, d, order)


@njit(nogil=True)
def _simulate_turns(rows, movement, lead, order, differencing, out):
    """Simulate each joint for `lead` control periods and one turn more, and take that turn's speed [rps] into `out`."""
    periods = out.shape[1]
    steps = lead + periods
    record = np.empty((steps + 1, 5))
    gap = np.empty(steps + 1, dtype=np.int64)
    events = np.empty((0, 2))
    with_ripple = False
    for k in range(rows.shape[0]):
        with_ripple = with_ripple or rows[k, RIPPLE] != 0 or rows[k, RIPPLE + 1] != 0
    for k in range(rows.shape[0]):
        joint = _joint_of(rows[k], movement, -TURN * lead / periods, periods, order, differencing, with_ripple)
        c, d = joint.constants, joint.drive
        y, region = _start(c, rows[k, FRICTION])
        status, _ = core.run(y, region, steps, d.period, 0, 1, 1, DELAY_PERIODS, c, d, record, gap, events)
        for i in range(periods):
            out[k, i] = record[lead + i, 1] / TURN if status < 0 else np.nan


def turns_to_settle(movement: Movement) -> int:
    """Turns after which the drive of a well damped joint has settled."""
    return max(int(np.ceil(_SETTLING_S / movement.turn_period_s)), 1)


def simulate_turns(
    rows: FloatArray, movement: Movement, order: float = 0, lead: int | None = None, differencing: bool = True
) -> FloatArray:
    """Deviation from the commanded speed [rps] of each joint over one settled turn; NaN for a joint that runs away.

    `order` is the transmission error's periods a turn (0: none), `lead` the turns before the one that is returned.
    """
    rows = np.ascontiguousarray(rows, dtype=float)
    out = np.empty((len(rows), movement.periods))
    before = (turns_to_settle(movement) if lead is None else lead) * movement.periods
    _simulate_turns(rows, movement, before, float(order), float(differencing), out)
    return out


@njit
def _start_slopes(joint, slopes):
    """Slopes of `_start` by the row's columns, into the state's, and those of a drive at rest in balance."""
    c = joint.constants
    dy = slopes.state
    by_gravity = np.sin(c.start_angle) + joint.row[FRICTION]
    torque = c.gravity * by_gravity
    dy[2, DELTA] = 1.0 if torque < 0 else -1.0
    dy[2, STIFFNESS] = torque / c.ks**2
    dy[2, GRAVITY] = -by_gravity / c.ks
    dy[2, FRICTION] = -c.gravity / c.ks
    dy[4, GRAVITY] = by_gravity / c.gear_ratio
    dy[4, FRICTION] = c.gravity / c.gear_ratio
    for p in range(dy.shape[1]):
        slopes.drive[0, p] = dy[4, p]
        for k in range(slopes.torques.shape[0]):
            slopes.torques[k, p] = dy[4, p]


@njit
def _force(t, y, rates, region, joint, out):
    """What the columns themselves do to the rates of motor speed, load speed and torque, into `out` (3, columns)."""
    c, row, order = joint.constants, joint.row, joint.order
    n, omega = c.gear_ratio, c.omega
    angle = c.start_angle + omega / n * t
    side = 1.0 if region == 3 else (-1.0 if region == 0 else 0.0)
    twist = abs(side) * (y[0] / n - y[2]) - side * c.delta
    rubbing = 0.5 * (1 + n * y[3] / omega) + 0.5 * np.sign(omega / n + y[3])
    to_motor = n * c.motor_inertia
    sine = np.sin(omega * t + y[0]) / to_motor
    cosine = np.cos(omega * t + y[0]) / to_motor
    out[0, DELTA] = side * c.ks / to_motor
    out[1, DELTA] = -side * c.ks
    out[0, STIFFNESS] = -twist / to_motor
    out[1, STIFFNESS] = twist
    out[1, FRICTION] = -c.gravity * rubbing
    out[0, GRAVITY] = row[RIPPLE] * sine + row[RIPPLE + 1] * cosine
    out[1, GRAVITY] = -np.sin(angle + y[2]) - row[FRICTION] * rubbing
    out[0, INERTIA] = rates[1] / row[INERTIA]
    out[2, LAG] = -rates[4] / c.torque_lag
    out[0, RIPPLE] = c.gravity * sine
    out[0, RIPPLE + 1] = c.gravity * cosine
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
    torque = line.ks * (line.per_turn * x[0] - x[2])
    motor = line.push * (x[4] - line.per_turn * torque) + forced[0, p]
    load = torque - line.swing * x[2] - line.rub * x[3] + forced[1, p]
    return x[1], motor, x[3], load, line.lag * (command - x[4]) + forced[2, p]


@njit
def _step(t, y, h, command, region, joint, slopes, dcommand):
    """One Runge-Kutta step of the state and its slopes, those in place."""
    c = joint.constants
    b1 = core.derivative(t, y, command, region, c)
    y2 = core.along(y, h / 2, b1)
    b2 = core.derivative(t + h / 2, y2, command, region, c)
    y3 = core.along(y, h / 2, b2)
    b3 = core.derivative(t + h / 2, y3, command, region, c)
    y4 = core.along(y, h, b3)
    b4 = core.derivative(t + h, y4, command, region, c)
    forced = slopes.forced
    _force(t, y, b1, region, joint, forced[0])
    _force(t + h / 2, y3, b3, region, joint, forced[1])
    _force(t + h, y4, b4, region, joint, forced[2])
    line = _Linear(
        ks=c.ks if region == 0 or region == 3 else 0.0,
        per_turn=1 / c.gear_ratio,
        push=1 / c.motor_inertia,
        swing=c.gravity * np.cos(c.start_angle + c.omega / c.gear_ratio * (t + h / 2)),
        rub=c.load_viscous,
        lag=1 / c.torque_lag,
    )
    dy = slopes.state
    for p in range(dy.shape[1]):
        x = (dy[0, p], dy[1, p], dy[2, p], dy[3, p], dy[4, p])
        u = dcommand[p]
        k1 = _rates(x, u, line, forced[0], p)
        k2 = _rates(core.along(x, h / 2, k1), u, line, forced[1], p)
        k3 = _rates(core.along(x, h / 2, k2), u, line, forced[1], p)
        k4 = _rates(core.along(x, h, k3), u, line, forced[2], p)
        x = _weighed(x, h, k1, k2, k3, k4)
        for k in range(5):
            dy[k, p] = x[k]
    return _weighed(y, h, b1, b2, b3, b4)


@njit
def _control_slopes(y, count, joint, memory, slopes):
    """Slopes of `core.control`, called before it with the memory that it will find; returns those of its torque.

    First those of the state, through each of its formulas; then what the gains add themselves.
    """
    d, row = joint.drive, joint.row
    _, leaky, speed_before, position_before = memory.drive
    rate = 1 / d.period
    ki = d.integral_gain * d.period
    speed = y[1]
    new, old = 1.0, 0.0  # slopes of the measured speed by the speed, and by the position
    if d.differencing > 0 and count > 0:
        speed = (y[0] - position_before) * rate
        new, old = 0.0, rate
    past = slopes.drive
    command = slopes.torques[count % slopes.torques.shape[0]]
    for p in range(past.shape[1]):
        dposition = slopes.state[0, p]
        dspeed = old * (dposition - past[3, p]) + new * slopes.state[1, p]
        derror = -d.position_gain * dposition - dspeed
        dintegral = past[0, p] + ki * derror
        dleaky = past[1, p] - d.period * (dspeed + d.leaky_rate * past[1, p])
        ddamping = d.derivative_gain * rate * (dspeed - past[2, p])
        command[p] = d.speed_gain * derror + dintegral + d.leaky_gain * dleaky - ddamping
        past[0, p] = dintegral
        past[1, p] = dleaky
        past[2, p] = dspeed
        past[3, p] = dposition
    error = -d.position_gain * y[0] - speed
    by_leaky = leaky - d.period * (speed + d.leaky_rate * leaky)
    gained = (speed - speed_before) * rate
    jm = d.speed_gain / row[SPEED]
    for part in (past[0], command):
        part[POSITION] += -ki * y[0]
        part[INTEGRAL] += ki / row[INTEGRAL] * error
        part[INERTIA] += -ki / row[INERTIA] * error
    past[1, RATE] -= d.period * leaky
    command[RATE] -= d.leaky_gain * d.period * leaky
    command[POSITION] -= d.speed_gain * y[0]
    command[SPEED] += jm * error
    command[DERIVATIVE] -= jm * gained
    command[LEAKY] += jm * by_leaky
    command[INERTIA] -= (d.speed_gain * error + d.leaky_gain * by_leaky - d.derivative_gain * gained) / row[INERTIA]
    return slopes.torques[(count + 1) % slopes.torques.shape[0]]


@njit
def _copy(source, target):
    for k in range(source.shape[0]):
        for p in range(source.shape[1]):
            target[k, p] = source[k, p]


@njit
def _advance(y, region, count, joint, memory, slopes):
    """One control period of the state and its slopes, those in place; returns state and region."""
    c, d = joint.constants, joint.drive
    t = count * d.period
    left = d.period
    dcommand = _control_slopes(y, count, joint, memory, slopes)
    command = core.control(t, y, memory.drive, memory.torques, count, d, c)
    edges = (-np.inf, -c.delta, 0.0, c.delta, np.inf)
    end = y
    for _ in range(16):
        _copy(slopes.state, slopes.before)
        end = _step(t, y, left, command, region, joint, slopes, dcommand)
        x = end[0] / c.gear_ratio - end[2]
        up = x > edges[region + 1]
        if not up and x >= edges[region]:
            break
        _copy(slopes.before, slopes.state)
        s, _ = core.locate(t, y, left, end, edges[region + 1] if up else edges[region], command, region, c)
        y = _step(t, y, s, command, region, joint, slopes, dcommand)
        region = region + 1 if up else region - 1
        t += s
        left -= s
    return end, region


@njit(nogil=True)
def _run(row, movement, order, differencing, with_ripple, settled_rps, pushes):
    """Motor and load speed over the turn that has settled, its slopes, the turns before it, and whether it is one."""
    periods = pushes.shape[1]
    joint = _joint_of(row, movement, 0.0, periods, order, differencing, with_ripple)
    y, region = _start(joint.constants, row[FRICTION])
    size = _WIDTH + pushes.shape[0]
    memory = _Memory(np.zeros(4), np.empty(DELAY_PERIODS + 1))
    memory.drive[0] = y[4]
    memory.drive[3] = y[0]
    for k in range(DELAY_PERIODS + 1):
        memory.torques[k] = y[4]
    slopes = _Slopes(
        state=np.zeros((5, size)),
        drive=np.zeros((4, size)),
        torques=np.zeros((DELAY_PERIODS + 1, size)),
        before=np.zeros((5, size)),
        forced=np.zeros((3, 3, size)),
    )
    _start_slopes(joint, slopes)
    speeds = np.zeros((2, periods))
    by_column = np.zeros((size, periods))
    before = np.inf
    least = min(_LEAST_TURNS, int(np.ceil(_SETTLING_S / movement.turn_period_s)) + 1)
    for turn in range(_MOST_TURNS):
        square = 0.0
        for i in range(periods):
            square += (y[1] / TURN - speeds[0, i]) ** 2
            speeds[0, i] = y[1] / TURN
            speeds[1, i] = y[3]
            for p in range(size):
                by_column[p, i] = slopes.state[1, p] / TURN
            for p in range(pushes.shape[0]):
                now = pushes[p, i]
                then = pushes[p, (i + 1) % periods]
                slopes.forced[0, 1, _WIDTH + p] = now
                slopes.forced[1, 1, _WIDTH + p] = 0.5 * (now + then)
                slopes.forced[2, 1, _WIDTH + p] = then
            y, region = _advance(y, region, turn * periods + i, joint, memory, slopes)
            if not abs(y[1]) < core.DIVERGED * joint.constants.omega:
                return speeds, by_column, turn, False
        change = np.sqrt(square / periods)
        # What is still to come, if it goes on shrinking as from the last turn to this one.
        shrinking = change / before
        if turn >= least - 1 and shrinking < 1 and change * shrinking < settled_rps * (1 - shrinking):
            return speeds, by_column, turn, True
        before = change
    return speeds, by_column, _MOST_TURNS - 1, True


def turn_and_slopes(
    row: FloatArray,
    movement: Movement,
    order: float,
    differencing: bool,
    with_ripple: bool,
    settled_rps: float,
    pushes: FloatArray | None = None,
) -> TurnWithSlopes:
    """One settled turn of a joint, and the derivatives of its speed.

    `pushes` are further accelerations of the load over a turn. The turn has settled where turns to come would change it
    by less than `settled_rps` (RMS). The drive's speed and integral gain and the torque's lag must not be 0.
    """
    row = np.ascontiguousarray(row, dtype=float)
    pushes = np.empty((0, movement.periods)) if pushes is None else np.ascontiguousarray(pushes, dtype=float)
    speeds, slopes, turns, is_turn = _run(
        row, movement, float(order), float(differencing), with_ripple, settled_rps, pushes
    )
    if not is_turn:
        speeds[:] = slopes[:] = np.nan
    return TurnWithSlopes(speeds[0], speeds[1], slopes, turns)
