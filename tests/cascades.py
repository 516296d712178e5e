"""Joints under a cascade of loops that has nothing of the paper's drive, for the tests of the sensor."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from replication.simulator.checks import check_stability, closed_loop_matrix
from replication.simulator.parameters import GRAVITY, TURN, JointParameters, with_ratios
from replication.standins import Bench, Spread, draw_bench
from studies.odd_joints import draw_log_uniform, draw_movement, move_bench

LEAST_DAMPING = 0.02  # who tunes a cascade leaves its ring this damping at least


def draw_cascade(rng: Generator) -> Bench:
    """Draw a joint under P position, PI speed and current loops tuned to it, its encoder of 17 to 20 bits."""
    while True:
        bench = move_bench(draw_bench(rng, Spread(load_friction=0.02)), *draw_movement(rng))
        ring = TURN * draw_log_uniform(rng, 12.0, 50.0)
        bandwidth = TURN * rng.uniform(15.0, 60.0)
        inertia_ratio = draw_log_uniform(rng, 0.5, 5.0)
        gain = bandwidth * (1 + inertia_ratio)
        ratios = {
            "stiffness_per_s2": ring**2,
            "gravity_per_s2": GRAVITY / rng.uniform(0.15, 0.5),
            "inertia_ratio": inertia_ratio,
            "speed_gain_per_s": gain,
            "integral_gain_per_s2": gain * bandwidth / rng.uniform(4.0, 10.0),
            "derivative_gain": 0.0,
            "leaky_gain_per_s2": 0.0,
            "leaky_rate_per_s": 0.0,
            "position_gain_per_s": bandwidth * rng.uniform(0.03, 0.2),
            "torque_lag_s": rng.uniform(3e-4, 1e-3),
        }
        joint = with_ratios(bench.joint, ratios)
        damping = 2 * rng.uniform(0.01, 0.06) * ring * joint.load_inertia_kgm2
        joint = replace(joint, damping_nms_per_rad=damping, encoder_bits=int(rng.integers(17, 21)))
        with suppress(ValueError):
            check_stability(joint)
            if _is_damped(joint):
                return replace(bench, joint=joint)


def _is_damped(joint: JointParameters) -> bool:
    """Whether all modes above 2 Hz are damped by `LEAST_DAMPING`."""
    modes = np.log(np.linalg.eigvals(closed_loop_matrix(joint)).astype(complex) + 1e-300)
    ringing = modes[modes.imag > TURN * 2.0 * joint.control_period_s]
    return bool((-ringing.real >= LEAST_DAMPING * np.abs(ringing)).all())
