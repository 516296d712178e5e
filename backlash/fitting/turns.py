"""Settled turns of many joints at once.

The joint is that of `simulate` with a linear drive and one load friction. A turn repeats itself
exactly, because the drive's period is taken as a whole part of it; the first turns, in which the
drive settles, are left out.
"""

import math
from typing import NamedTuple

import numpy as np

from replication.arrays import FloatArray
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
DELTA, FRICTION = 0, 1
_RATIOS = COLUMNS[2:]

# The drive's slowest modes, 13 per second in the paper's joint, are gone after this time to 3e-5.
SETTLING_S = 0.8
# Of the control and of a Runge-Kutta step, a quarter of a radian of the fastest mode: 3e-5 rps RMS
# off.
_CONTROL_S = 5e-4
_DELAY_PERIODS = 1


class Movement(NamedTuple):
    """The test movement: motor turns in a load turn, and the load turn's duration [s]."""

    gear_ratio: float
    turn_period_s: float

    @property
    def periods(self) -> int:
        """Control periods in a turn."""
        return max(round(self.turn_period_s / _CONTROL_S), 16)


def joint_of(
    row: FloatArray, movement: Movement, angle: float, differencing: bool
) -> JointParameters:
    """Joint of a row, its load's inertia 1: half of the friction is Coulomb's, half viscous."""
    value = dict(zip(COLUMNS, row.tolist(), strict=True))
    n, period = movement
    gravity = value["gravity_per_s2"]
    rubbing = 0.5 * value["friction"] * gravity
    return joint_from_ratios(
        {name: value[name] for name in _RATIOS} | {"start_angle_rad": angle, "lead_s": 0.0},
        gear_ratio=n,
        load_mass_kg=(gravity / GRAVITY_MS2) ** 2,
        commanded_speed_rps=n / period,
        control_period_s=period / movement.periods,
        load_viscous_nms_per_rad=rubbing * period / TURN,
        load_coulomb_nm=rubbing,
        speed_by_differencing=differencing,
    )


def simulate_turns(
    rows: FloatArray, movement: Movement, settling_s: float = SETTLING_S, differencing: bool = True
) -> FloatArray:
    """Deviation from the commanded speed [rps] of each joint over a turn after so long; NaN where it runs away."""
    periods = movement.periods
    before = math.ceil(settling_s / movement.turn_period_s * periods - 1e-9)
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
