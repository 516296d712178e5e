"""The joint integrated by SciPy: what the compiled simulator is checked and timed against."""

import numpy as np
from scipy.integrate import solve_ivp

from replication.arrays import FloatArray
from replication.simulator import core
from replication.simulator.parameters import TURN, JointParameters


def solve_ivp_speed_rps(
    p: JointParameters, delta_rad: float, duration_s: float, method: str, **tolerances: float
) -> FloatArray:
    """Motor speed at every control period, the compiled field integrated by `solve_ivp` between them."""
    c, drive = core.constants_of(p, delta_rad), core.drive_of(p)
    y, _ = core.start_state(p, delta_rad)
    ring, memory = np.full(p.control_delay_periods + 1, y[4]), np.array([y[4], 0.0, 0.0, y[0]])
    edges = np.array([-delta_rad, 0.0, delta_rad])

    def field(t, y, command):
        return core.derivative(t, tuple(y), command, int(np.searchsorted(edges, y[0] / c.gear_ratio - y[2])), c)

    skip, speeds = round(p.lead_s / p.control_period_s), []
    for i in range(skip + round(duration_s / p.control_period_s) + 1):
        t = (i - skip) * p.control_period_s
        speeds.append(y[1])
        command = core.control(t, tuple(y), memory, ring, i, drive, c)
        span = (t, t + p.control_period_s)
        y = solve_ivp(field, span, np.array(y), method=method, args=(command,), **tolerances).y[:, -1]
    return p.commanded_speed_rps + np.array(speeds[skip:]) / TURN
