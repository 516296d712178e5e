"""The unknowns of the torque's fit, in one table: what each is, what is known of it before, and where it is printed."""

import math
from typing import NamedTuple

import numpy as np

from backlash.turns import TURN

LOAD = math.nan  # a prior that comes from the load's data and from the log


class Unknown(NamedTuple):
    """One unknown; a name that begins with `ln_` is a logarithm, whose SDs are shares of the quantity."""

    name: str
    unit: str
    meaning: str
    mean: float  # prior
    sd: float
    first_step: float  # of a descent: a bounce of the teeth, or about the prior's SD
    sd_below_zero: float = math.nan  # of what cannot be negative: small, yet smooth for a descent
    printed: str = ""  # what it is called in the answer
    error: float = 0.0  # SD that the model's errors add to the printed one's
    share: float = (
        1.0  # of the SD by noise, in which the model's error counts, that joints' printed ones have
    )


# Joints ring at 10 to 50 Hz with damping ratios of 0.01 to 0.1 and load friction below a third of gravity. Strain wave
# gears are softer up to a fifth of their rated torque, where they are wound up by 0.1 to 0.3 mrad, by a share K1 / K2
# of 0.4 to 0.8, and lose 2 to 30 % (data sheets); speeds are filtered over 0.2 to 1.5 ms, and currents low-passed at
# 25 Hz (6 ms) or above. A torque is early by what the speed is late beyond its lag.
TABLE = (
    # The contact torque depends on these six.
    Unknown("delta_mrad", "mrad", "half of the gap", 0.0, math.inf, 0.3, 0.003),
    Unknown(
        *("ln_stiffness", "1/s^2", "K, of the spring, over the load's inertia"),
        *(2 * math.log(TURN * 22.0), 1.0, 0.5),
        printed="stiffness_per_s2",
        error=0.1,
    ),
    Unknown(
        *("ln_damping", "1", "zeta, the spring's damping ratio", math.log(0.04), 0.5, 1.0),
        printed="damping_ratio",
        error=0.35,
    ),
    Unknown(
        *("soft_mrad", "mrad", "e, the soft part beyond the gap", 0.0, 0.2, 0.2, 0.015),
        printed="soft_mrad",
        error=0.13,
    ),
    Unknown("soft_share", "1", "s, stiffness of the soft part over the spring's", 0.55, 0.12, 0.1),
    Unknown("drag", "1", "d, share of the damping that acts in the gap, too", 0.0, 0.3, 0.2, 0.03),
    # The load's motion depends on these four, too.
    Unknown(
        *("friction", "1", "F, the load's friction over gravity", 0.0, 0.3, 0.2, 0.03),
        printed="friction_share",
        error=0.0025,
    ),
    Unknown("phase_rad", "rad", "gravity's angle where the turn begins", LOAD, math.inf, 0.1),
    Unknown(
        *("ln_gravity", "1/s^2", "g, gravity over the load's inertia", LOAD, LOAD, 0.2),
        printed="gravity_per_s2",
        error=0.03,
    ),
    Unknown(
        *("lag_ms", "ms", "lag of the speed", 0.7, 0.5, 1.0), printed="speed_lag_ms", error=0.4
    ),
    # The torque depends on these, too.
    Unknown(
        *("ln_inertia_ratio", "1", "rho = J_l / (N^2 J_m)", LOAD, LOAD, 0.2),
        printed="inertia_ratio",
        error=0.08,
    ),
    Unknown(
        *("ln_inertia", "log's unit", "N J_m", LOAD, math.inf, 0.2),
        printed="motor_inertia",
        error=0.08,
    ),
    Unknown(
        *("delay_ms", "ms", "delay of the torque's log", 0.0, 4.0, 1.0, 1.5),
        printed="torque_delay_ms",
    ),
    Unknown(
        *("loss", "1", "mu, the gear's loss over the contact torque", 0.05, 0.15, 0.1),
        printed="loss",
        share=0.75,
    ),
    Unknown(
        *("filter_ms", "ms", "low-pass of the torque's log", 0.0, 3.0, 2.0, 0.3),
        printed="torque_filter_ms",
    ),
)

NAMES = tuple(each.name for each in TABLE)
FIRST_STEP = np.array([each.first_step for each in TABLE])
IS_LOGARITHM = np.array([name.startswith("ln_") for name in NAMES])
