"""Settled turns of many joints at once, compiled: what a fit that asks for thousands of them needs.

The joint is that of `simulate` with a linear drive and one load friction. A turn repeats itself exactly, because the
drive's period is taken as a whole part of it; the first turns, in which the drive settles, are left out.
"""

from dataclasses import dataclass

import numba as nb
import numpy as np

from replication.arrays import FloatArray
from replication.simulator import core
from replication.simulator.parameters import TURN

# Columns of a joint's row; all but the first two and the last six are `JointParameters.ratios`. Friction is over m g r,
# the motor's damping over its inertia, the coupling's damping over its stiffness, the ripple over m g r / N.
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
    "coupling_damping_s",
    "motor_damping_per_s",
    "error_sine_rad",
    "error_cosine_rad",
    "ripple_sine",
    "ripple_cosine",
)

# The drive's slowest modes, 13 per second in the paper's joint, are gone after this time to 3e-5.
_SETTLING_S = 0.8
_CONTROL_S = 5e-4
DELAY_PERIODS = 1
ALPHA_PER_RAD = 1e6
# Of a Runge-Kutta step, a quarter of a radian of the fastest mode: 3e-4 rps off at most, 3e-5 rps RMS.
STEPS_PER_PERIOD = 1


@dataclass(frozen=True)
class Movement:
    """The test movement: motor turns in a load turn, and the load turn's duration [s]."""

    gear_ratio: float
    turn_period_s: float

    @property
    def periods(self) -> int:
        """Control periods in a turn."""
        return max(round(self.turn_period_s / _CONTROL_S), 16)


# What a joint's row means to `core`, with the load's inertia 1: only ratios count. Half of the load's friction is
# Coulomb's, half viscous: at a constant speed only their sum shows.
@nb.njit(cache=True)
def constants(row, n, turn_s, angle, waves):
    """Constants of a joint in the order of `COLUMNS`, and its disturbances as `core` takes them."""
    omega = n * TURN / turn_s
    delta, friction, ks, gravity, inertia, damping, viscous = row[0], row[1], row[2], row[3], row[4], row[12], row[13]
    jm = 1 / (n * n * inertia)
    rubbing = 0.5 * friction * gravity
    return core.Constants(
        n, omega, angle, jm, 1.0, ks, damping * ks, ALPHA_PER_RAD, delta, 0.0, gravity, viscous * jm,
        rubbing / (omega / n), 0.0, rubbing, row[11], waves,
    )  # fmt: skip


@nb.njit(cache=True)
def drive(row, n, period, differencing):
    """Drive of a joint in the order of `COLUMNS`; 1 if it differences its encoder, as real ones do, 0 if not."""
    jm = 1 / (n * n * row[4])
    return core.Drive(
        row[9], row[5] * jm, row[6] * jm, row[7] * jm, row[8] * jm, row[10], period, np.inf, 0.0, differencing
    )  # fmt: skip


@nb.njit(cache=True)
def start(c, friction):
    """State and region in balance, as `core.start_state`."""
    torque = c.gravity * np.sin(c.start_angle) + friction * c.gravity
    side = -1.0 if torque < 0 else 1.0
    motor = c.motor_viscous * c.omega
    return (0.0, 0.0, -(side * c.delta + torque / c.ks), 0.0, torque / c.gear_ratio + motor), 3 if side > 0 else 0


@nb.njit(cache=True)
def waves_of(row, n, turn_s, order, with_ripple):
    """Disturbances of a joint in the order of `COLUMNS`, a row each; no wave at all compiles to less work."""
    errors = 2 if order > 0 else 0
    waves = np.zeros((errors + (2 if with_ripple else 0), 5))
    for part in range(errors):
        error = row[14 + part]
        waves[part] = order / n, 0.0, -error * (order * TURN / turn_s) ** 2, error, part * TURN / 4
    for part in range(len(waves) - errors):
        waves[errors + part] = 1.0, row[16 + part] * row[3] / n, 0.0, 0.0, part * TURN / 4
    return waves


@nb.njit(cache=True, nogil=True)
def _settled(rows, n, turn_s, periods, lead, order, differencing):
    out = np.empty((rows.shape[0], periods))
    period = turn_s / periods
    record, gap = np.empty((lead + periods + 1, 5)), np.empty(lead + periods + 1, dtype=np.int64)
    events = np.empty((0, 2))
    with_ripple = np.any(rows[:, 16:] != 0)
    for k in range(rows.shape[0]):
        waves = waves_of(rows[k], n, turn_s, order, with_ripple)
        c = constants(rows[k], n, turn_s, -TURN * lead / periods, waves)
        y, region = start(c, rows[k, 1])
        status, _ = core.run(
            y, region, (lead + periods) * STEPS_PER_PERIOD, period / STEPS_PER_PERIOD, 0, STEPS_PER_PERIOD,
            STEPS_PER_PERIOD, DELAY_PERIODS, c, drive(rows[k], n, period, differencing), record, gap, events,
        )  # fmt: skip
        out[k] = np.nan
        if status < 0:
            out[k] = record[lead : lead + periods, 1] / TURN
    return out


def settling_turns(movement: Movement) -> int:
    """Turns after which the drive of a well damped joint has settled."""
    return max(int(np.ceil(_SETTLING_S / movement.turn_period_s)), 1)


def settled_turns(
    rows: FloatArray, movement: Movement, order: float = 0, lead: int | None = None, differencing: bool = True
) -> FloatArray:
    """Deviation from the commanded speed [rps] of each joint over one settled turn; NaN for a joint that runs away.

    `order` is the transmission error's periods a turn (0: none), `lead` the turns before the one that is returned, and
    `differencing` says that the drive differences its encoder instead of being told the speed.
    """
    periods = movement.periods
    turns = settling_turns(movement) if lead is None else lead
    rows = np.ascontiguousarray(rows, dtype=float)
    return _settled(
        rows, movement.gear_ratio, movement.turn_period_s, periods, turns * periods, float(order), float(differencing)
    )
