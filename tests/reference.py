"""What the simulator is checked against: the joint integrated by SciPy, and its settled peaks."""

import numpy as np
from scipy.integrate import solve_ivp

from replication.arrays import FloatArray
from replication.simulator import core
from replication.simulator.identification import FINE_S
from replication.simulator.parameters import TURN, JointParameters
from replication.simulator.simulate import settled_peak_rps, simulate_many
from replication.table2 import theoretical_amplitudes


def simulate_amplitudes(joint: JointParameters) -> list[float]:
    """Theoretical A [rps] of a joint for Table 2's ten rows: settled peaks before sampling."""
    runs = simulate_many(joint, list(theoretical_amplitudes()), sample_s=FINE_S, step_s=FINE_S)
    return [settled_peak_rps(run, joint) for run in runs]


def solve_ivp_speed_rps(
    p: JointParameters, delta_rad: float, duration_s: float, method: str, **tolerances: float
) -> FloatArray:
    """Motor speed at every control period, the compiled field integrated by `solve_ivp` between them."""
    c, drive = core.constants_of(p, delta_rad), core.drive_of(p)
    y, _ = core.start_state(p, delta_rad)
    ring, memory = np.full(p.control_delay_periods + 1, y[4]), np.array([y[4], 0.0, 0.0, y[0]])
    edges = np.array([-delta_rad, 0.0, delta_rad])

    def field(t, y, command):
        return core.derivative(
            t, tuple(y), command, int(np.searchsorted(edges, y[0] / c.gear_ratio - y[2])), c
        )

    skip, speeds = round(p.lead_s / p.control_period_s), []
    for i in range(skip + round(duration_s / p.control_period_s) + 1):
        t = (i - skip) * p.control_period_s
        speeds.append(y[1])
        command = core.control(t, tuple(y), memory, ring, i, drive, c)
        span = (t, t + p.control_period_s)
        y = solve_ivp(field, span, np.array(y), method=method, args=(command,), **tolerances).y[
            :, -1
        ]
    return p.commanded_speed_rps + np.array(speeds[skip:]) / TURN
