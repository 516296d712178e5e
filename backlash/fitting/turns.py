"""Settled turns of many joints at once, and of one joint with its slopes by all that its row holds; compiled.

The joint is that of `simulate` with a linear drive and one load friction. A turn repeats itself
exactly, because the drive's period is taken as a whole part of it; the first turns, in which the
drive settles, are left out.

The slopes follow the equations of motion linearised along the turn. Where the teeth part or meet,
torque and rates are continuous, so the slopes pass from region to region without a jump.
"""

import math
from typing import NamedTuple

import numpy as np

from replication.arrays import FloatArray
from replication.compiling import njit
from replication.simulator import core
from replication.simulator.parameters import GRAVITY as GRAVITY_MS2
from replication.simulator.parameters import TURN, JointParameters, joint_from_ratios

# Columns of a joint's row: backlash, friction over m g r, and `JointParameters.ratios`.
COLUMNS = (
    "delta_rad",
    "friction",
    "stiffness_per_s2",
    "gravity_per_s2",
    "inertia_ratio",
    "speed_gain_per_s",
    "integral_gain_per_s2",
    "derivative_gain",
    "leaky_gain_per_s2",
    "position_gain_per_s",
    "leaky_rate_per_s",
    "torque_lag_s",
)
DELTA, FRICTION, STIFFNESS, GRAVITY, INERTIA = range(5)
SPEED, INTEGRAL, DERIVATIVE, LEAKY, POSITION, RATE, LAG = range(5, 12)
_WIDTH = len(COLUMNS)

# The drive's slowest modes, 13 per second in the paper's joint, are gone after this time to 3e-5.
_SETTLING_S = 0.8
# Of the control and of a Runge-Kutta step, a quarter of a radian of the fastest mode: 3e-5 rps RMS
# off.
_CONTROL_S = 5e-4
_DELAY_PERIODS = 1
# Turns with slopes: the first two at most are the drive's; one that has not settled after the last
# never does.
_LEAST_TURNS = 3
_MOST_TURNS = 14

# Of the Runge-Kutta method: when a stage is [steps], what part of the step it weighs, and which
# forcing it takes.
_SHIFTS = (0.0, 0.5, 0.5, 1.0)
_PARTS = (6.0, 3.0, 3.0, 6.0)
_FORCED_AT = (0, 1, 1, 2)


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
    slopes: FloatArray  # of the motor's speed by `COLUMNS`
    turns_before: int


class _Joint(NamedTuple):
    """A joint's row, and what the simulator makes of it."""

    row: FloatArray
    constants: core.Constants
    drive: core.Drive


class _Memory(NamedTuple):
    """What `core.control` keeps: integral, leaky integral, speed and position; and the torques that are under way."""

    drive: FloatArray
    torques: FloatArray


class _Slopes(NamedTuple):
    """Slopes of the state and of the drive's memory by the columns, in the last axis."""

    state: FloatArray
    drive: FloatArray
    torques: FloatArray
    forced: FloatArray  # what columns do to three rates at a step's start, middle and end


class _Linear(NamedTuple):
    """The equations of motion, linear within a region: every factor of `_rates`."""

    ks: float
    per_turn: float
    push: float
    swing: float
    rub: float
    lag: float


def joint_of(
    row: FloatArray, movement: Movement, angle: float, differencing: bool
) -> JointParameters:
    """Joint of a row, its load's inertia 1: half of the friction is Coulomb's, half viscous."""
    value = dict(zip(COLUMNS, row.tolist(), strict=True))
    n, period = movement
    gravity = value["gravity_per_s2"]
    rubbing = 0.5 * value["friction"] * gravity
    return joint_from_ratios(
        {name: value[name] for name in COLUMNS[STIFFNESS:]}
        | {"start_angle_rad": angle, "lead_s": 0.0},
        gear_ratio=n,
        load_mass_kg=(gravity / GRAVITY_MS2) ** 2,
        commanded_speed_rps=n / period,
        control_period_s=period / movement.periods,
        load_viscous_nms_per_rad=rubbing * period / TURN,
        load_coulomb_nm=rubbing,
        speed_by_differencing=differencing,
    )


def turns_to_settle(movement: Movement) -> int:
    """Turns after which the drive of a well damped joint has settled."""
    return max(math.ceil(_SETTLING_S / movement.turn_period_s), 1)


def simulate_turns(
    rows: FloatArray, movement: Movement, lead: int | None = None, differencing: bool = True
) -> FloatArray:
    """Deviation from the commanded speed [rps] of each joint over one settled turn; NaN for a joint that runs away.

    `lead` is the number of turns before the one that is returned.
    """
    periods = movement.periods
    before = (turns_to_settle(movement) if lead is None else lead) * periods
    steps = before + periods
    record = np.empty((steps + 1, 5))
    gap = np.empty(steps + 1, dtype=np.int64)
    events = np.empty((0, 2))
    out = np.full((len(rows), periods), np.nan)
    for row, turn in zip(rows, out, strict=True):
        joint = joint_of(row, movement, -TURN * before / periods, differencing)
        c, d = core.constants_of(joint, row[DELTA]), core.drive_of(joint)
        y, region = core.start_state(joint, row[DELTA])
        schedule = core.Schedule(steps, d.period, 0, 1, 1, _DELAY_PERIODS)
        status, _ = core.run(y, region, schedule, c, d, core.Log(record, gap, events))
        if status < 0:
            turn[:] = record[before:steps, 1] / TURN
    return out


@njit(inner=True)
def _force(t, y, rates, region, joint, out):
    """What the columns themselves do to the rates of motor speed, load speed and torque, into `out` (3, columns)."""
    c, row = joint.constants, joint.row
    n, omega = c.gear_ratio, c.omega
    angle = c.start_angle + omega / n * t
    side = 1.0 if region == 3 else (-1.0 if region == 0 else 0.0)
    twist = abs(side) * (y[0] / n - y[2]) - side * c.delta
    rubbing = 0.5 * (1 + n * y[3] / omega) + 0.5 * np.sign(omega / n + y[3])
    to_motor = n * c.motor_inertia
    out[0, DELTA] = side * c.ks / to_motor
    out[1, DELTA] = -side * c.ks
    out[0, STIFFNESS] = -twist / to_motor
    out[1, STIFFNESS] = twist
    out[1, FRICTION] = -c.gravity * rubbing
    out[1, GRAVITY] = -np.sin(angle + y[2]) - row[FRICTION] * rubbing
    out[0, INERTIA] = rates[1] / row[INERTIA]
    out[2, LAG] = -rates[4] / c.torque_lag


@njit(inner=True)
def _rates(x, command, line, forced, at, p):
    """Rates of a slope `x` of the state: the equations of motion, linear within a region, and what is forced on it."""
    torque = line.ks * (line.per_turn * x[0] - x[2])
    motor = line.push * (x[4] - line.per_turn * torque) + forced[at, 0, p]
    load = torque - line.swing * x[2] - line.rub * x[3] + forced[at, 1, p]
    return x[1], motor, x[3], load, line.lag * (command - x[4]) + forced[at, 2, p]


@njit(inner=True)
def _step(t, y, h, command, region, joint, forced):
    """One Runge-Kutta step of the state; what is forced on its slopes goes into `forced`."""
    k = (0.0, 0.0, 0.0, 0.0, 0.0)
    after = y
    for stage in range(4):
        shift = h * _SHIFTS[stage]
        here = core.along(y, shift, k)
        k = core.derivative(t + shift, here, command, region, joint.constants)
        after = core.along(after, h / _PARTS[stage], k)
        if stage != 1:  # of the two in the middle the second is better
            _force(t + shift, here, k, region, joint, forced[_FORCED_AT[stage]])
    return after


@njit(inner=True)
def _step_slopes(t, h, region, joint, slopes, dcommand):
    """The same step of the slopes, in place."""
    c = joint.constants
    line = _Linear(
        ks=c.ks if region == 0 or region == 3 else 0.0,
        per_turn=1 / c.gear_ratio,
        push=1 / c.motor_inertia,
        swing=c.gravity * np.cos(c.start_angle + c.omega / c.gear_ratio * (t + h / 2)),
        rub=c.load_viscous,
        lag=1 / c.torque_lag,
    )
    dy = slopes.state
    for p in range(_WIDTH):
        x = (dy[0, p], dy[1, p], dy[2, p], dy[3, p], dy[4, p])
        k = (0.0, 0.0, 0.0, 0.0, 0.0)
        then = x
        for stage in range(4):
            here = core.along(x, h * _SHIFTS[stage], k)
            k = _rates(here, dcommand[p], line, slopes.forced, _FORCED_AT[stage], p)
            then = core.along(then, h / _PARTS[stage], k)
        for i in range(5):
            dy[i, p] = then[i]


@njit(inner=True)
def _control_slopes(y, count, joint, memory, slopes):
    """Slopes of `core.control`, called before it with the memory that it will find; returns those of its torque.

    Those of the state go through each of its formulas, what the integral's gains add themselves
    with them; then what the other gains add.
    """
    d, row = joint.drive, joint.row
    leaky = memory.drive[1]
    rate = 1 / d.period
    ki = d.integral_gain * d.period
    speed = y[1]
    new, old = 1.0, 0.0  # slopes of the measured speed by the speed, and by the position
    if d.differencing > 0 and count > 0:
        speed = (y[0] - memory.drive[3]) * rate
        new, old = 0.0, rate
    error = -d.position_gain * y[0] - speed
    by_leaky = leaky - d.period * (speed + d.leaky_rate * leaky)
    gained = (speed - memory.drive[2]) * rate
    past = slopes.drive
    past[0, POSITION] -= ki * y[0]
    past[0, INTEGRAL] += ki / row[INTEGRAL] * error
    past[0, INERTIA] -= ki / row[INERTIA] * error
    command = slopes.torques[count % slopes.torques.shape[0]]
    for p in range(_WIDTH):
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
    jm = d.speed_gain / row[SPEED]
    past[1, RATE] -= d.period * leaky
    command[RATE] -= d.leaky_gain * d.period * leaky
    command[POSITION] -= d.speed_gain * y[0]
    command[SPEED] += jm * error
    command[DERIVATIVE] -= jm * gained
    command[LEAKY] += jm * by_leaky
    by_gains = d.speed_gain * error + d.leaky_gain * by_leaky - d.derivative_gain * gained
    command[INERTIA] -= by_gains / row[INERTIA]
    return slopes.torques[(count + 1) % slopes.torques.shape[0]]


@njit(inner=True)
def _advance(y, region, count, joint, memory, slopes):
    """One control period of the state and its slopes, those in place; returns state and region."""
    c = joint.constants
    t = count * joint.drive.period
    left = joint.drive.period
    dcommand = _control_slopes(y, count, joint, memory, slopes)
    command = core.control(t, y, memory.drive, memory.torques, count, joint.drive, c)
    edges = (-np.inf, -c.delta, 0.0, c.delta, np.inf)
    end = y
    for _ in range(16):
        end = _step(t, y, left, command, region, joint, slopes.forced)
        x = end[0] / c.gear_ratio - end[2]
        up = x > edges[region + 1]
        if not up and x >= edges[region]:
            break
        edge = edges[region + 1] if up else edges[region]
        h, _ = core.locate(t, y, left, end, edge, command, region, c)
        y = _step(t, y, h, command, region, joint, slopes.forced)
        _step_slopes(t, h, region, joint, slopes, dcommand)
        region += 1 if up else -1
        t += h
        left -= h
    _step_slopes(t, left, region, joint, slopes, dcommand)
    return end, region


@njit(nogil=True)
def _run(joint, start, memory, slopes, least, settled_rps, out):
    """Go on from the start until a turn has settled; it in `out`, the turns before it, and whether it is one."""
    y, region = start
    periods = out.motor_rps.size
    before = np.inf
    for turn in range(_MOST_TURNS):
        square = 0.0
        for i in range(periods):
            square += (y[1] / TURN - out.motor_rps[i]) ** 2
            out.motor_rps[i] = y[1] / TURN
            for p in range(_WIDTH):
                out.slopes[p, i] = slopes.state[1, p] / TURN
            y, region = _advance(y, region, turn * periods + i, joint, memory, slopes)
            if not abs(y[1]) < core.DIVERGED * joint.constants.omega:
                return turn, False
        change = np.sqrt(square / periods)
        # What is still to come, if it goes on shrinking as from the last turn to this one.
        shrinking = change / before
        if (
            turn >= least - 1
            and shrinking < 1
            and change * shrinking < settled_rps * (1 - shrinking)
        ):
            return turn, True
        before = change
    return _MOST_TURNS - 1, True


def turn_and_slopes(
    row: FloatArray, movement: Movement, differencing: bool, settled_rps: float
) -> TurnWithSlopes:
    """One settled turn of a joint, and the derivatives of its speed.

    The turn has settled where turns to come would change it by less than `settled_rps` (RMS). The
    drive's speed and integral gain and the torque's lag must not be 0.
    """
    periods = movement.periods
    joint = joint_of(row, movement, 0.0, differencing)
    compiled = _Joint(row, core.constants_of(joint, row[DELTA]), core.drive_of(joint))
    start = core.start_state(joint, row[DELTA])
    torque = start[0][4]
    memory = _Memory(np.array([torque, 0.0, 0.0, 0.0]), np.full(_DELAY_PERIODS + 1, torque))
    slopes = _Slopes(
        np.zeros((5, _WIDTH)),
        np.zeros((4, _WIDTH)),
        np.zeros((_DELAY_PERIODS + 1, _WIDTH)),
        np.zeros((3, 3, _WIDTH)),
    )
    least = min(_LEAST_TURNS, math.ceil(_SETTLING_S / movement.turn_period_s) + 1)
    out = TurnWithSlopes(np.zeros(periods), np.zeros((_WIDTH, periods)), 0)
    turns_before, is_turn = _run(compiled, start, memory, slopes, least, settled_rps, out)
    if not is_turn:
        for part in out[:2]:
            part[:] = np.nan
    return out._replace(turns_before=turns_before)
