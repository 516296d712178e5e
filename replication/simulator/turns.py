"""Settled turns of many joints at once, compiled: what a fit that asks for thousands of them needs.

The joint is that of `simulate`, its edge the clamped dead zone (the limit of equation 8 for a large alpha), with a
linear drive and one load friction. A turn is repeated exactly, because the drive's period is taken as a whole part of
it; the first turns, in which the drive settles, are left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from replication.simulator import core
from replication.simulator.parameters import TURN

FloatArray = NDArray[np.float64]

# Columns of a joint's row; all but the first two and the last two are `JointParameters.ratios`.
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
)

# The drive's slowest modes, 13 per second in the paper's joint, are gone after this time to 3e-5.
_SETTLING_S = 0.8
_CONTROL_S = 5e-4
_DELAY_PERIODS = 1
# Two steps a control period: an RK4 step of an eighth of a radian of the fastest mode.
_STEPS_PER_PERIOD = 2


@dataclass(frozen=True)
class Movement:
    """The test movement: motor turns in a load turn, and the load turn's duration [s]."""

    gear_ratio: float
    turn_period_s: float

    @property
    def periods(self) -> int:
        """Control periods in a turn."""
        return max(round(self.turn_period_s / _CONTROL_S), 16)


@nb.njit(cache=True, nogil=True)
def _settled(rows, n, turn_s, periods, lead, delay, per_period):
    out = np.empty((rows.shape[0], periods))
    period, omega = turn_s / periods, n * 2 * np.pi / turn_s
    step = period / per_period
    record, gap = np.empty((lead + periods + 1, 5)), np.empty(lead + periods + 1, dtype=np.int64)
    events = np.empty((0, 2))
    steps = (lead + periods) * per_period
    for k in range(rows.shape[0]):
        delta, friction, ks, gravity, inertia, kp, ki, kd, kw, kpos, rate, lag, damping, viscous = rows[k]
        jm = 1 / (n * n * inertia)
        load_speed = omega / n
        # Half of the load's friction is Coulomb's, half viscous: at a constant speed only their sum shows.
        cl, bl, bm = 0.5 * friction * gravity, 0.5 * friction * gravity / load_speed, viscous * jm
        theta0 = -2 * np.pi * lead / periods
        c = (n, omega, theta0, jm, 1.0, ks, damping * ks, 1e6, delta, 0.0, gravity, bm, bl, 0.0, cl, lag, None)
        drive = (kpos, kp * jm, ki * jm, kd * jm, kw * jm, rate, period, np.inf, 0.0, 1.0)
        torque = gravity * np.sin(theta0) + friction * gravity
        side = -1.0 if torque < 0 else 1.0
        y = (0.0, 0.0, -(side * delta + torque / ks), 0.0, torque / n + bm * omega)
        region = 3 if side > 0 else 0
        status, _ = core.run(
            y, region, steps, step, 0, per_period, per_period, delay, c, drive, record, gap, events
        )
        out[k] = np.nan
        if status < 0:
            out[k] = record[lead : lead + periods, 1] / (2 * np.pi)
    return out


def settled_turns(rows: FloatArray, movement: Movement) -> FloatArray:
    """Motor speed of each joint over one settled turn.

    Parameters
    ----------
    rows : array of shape (joints, 14)
        See `COLUMNS`: delta [rad], load friction over m g r, ratios, D_s / K_s [s], and the motor's viscous friction
        over its inertia [1/s].
    movement : Movement
        The test movement.

    Returns
    -------
    array of shape (joints, movement.periods)
        Deviation from the commanded speed [rps] at even phases, the load hanging straight down at phase 0; NaN for a
        joint that runs away.
    """
    periods = movement.periods
    turns = max(int(np.ceil(_SETTLING_S / movement.turn_period_s)), 1)
    rows = np.ascontiguousarray(rows, dtype=float)
    return _settled(
        rows, movement.gear_ratio, movement.turn_period_s, periods, turns * periods, _DELAY_PERIODS, _STEPS_PER_PERIOD
    )
