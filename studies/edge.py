"""The edge of the dead zone: what alpha the records need, and what a torque that steps does to a simulation."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from operator import attrgetter

import numpy as np
import pandas as pd

from replication.arrays import FloatArray
from replication.compiling import njit
from replication.simulator import core
from replication.simulator.identification import identify_joint, third_turn_errors
from replication.simulator.parameters import TURN, JointParameters, identified_joint
from replication.simulator.simulate import settled_peak_rps, simulate
from replication.records import load_clean_records
from studies.reidentify import FIT_LEVELS

# Sharpness of the edge [1/rad] at which the joint is identified anew, from sharp to soft.
ALPHAS = (1e6, 1e5, 1e4, 1e3)
DAMPING_RATIO = 0.05  # of the joint whose torque steps


def misfit_facts(refitted: pd.DataFrame) -> dict[str, tuple[float, str]]:
    """What texts say of two of the edges of `refit_alphas`: their sharpness [1/rad] and misfit [%]."""
    misfit = 100 * refitted.set_index("alpha_per_rad")["nrmse"]
    return {
        "alpha_misfit": (misfit[1e5], ".1f"),
        "softer_alpha": (1e4, ".0e"),
        "softer_misfit": (misfit[1e4], ".1f"),
    }


def refit_alphas() -> pd.DataFrame:
    """Identify the joint anew at each of `ALPHAS`: misfit, misfit with the joint's own ratios, new ratios."""
    records = load_clean_records(FIT_LEVELS)
    joint = last = identified_joint()
    rows = []
    for alpha in ALPHAS:
        # With a soft edge the misfit has several minima: two starts, the better fit counts.
        starts = [replace(start, alpha_per_rad=alpha) for start in (joint, last)]
        fits = [identify_joint(records, start) for start in starts]
        fit = min(fits, key=attrgetter("mean_square"))
        last = fit.parameters
        kept = math.sqrt(np.mean(third_turn_errors(starts[0], records) ** 2))
        misfits = {"nrmse": math.sqrt(fit.mean_square), "nrmse_kept": kept}
        rows.append({"alpha_per_rad": alpha} | misfits | fit.parameters.ratios)
    return pd.DataFrame(rows)


@njit
def _plain_steps(y, speeds, skip, delay, step, c, drive):
    """Runge-Kutta steps of one length, whatever the gap does within them; speeds at every control period."""
    ring = np.full(delay + 1, y[4])
    memory = np.array([y[4], 0.0, 0.0, y[0]])
    edges = np.array([-c.delta, 0.0, c.delta])
    command = y[4]
    per_period = round(drive.period / step)
    for i in range(speeds.size * per_period):
        t = (i - skip) * step
        if i % per_period == 0:
            speeds[i // per_period] = y[1]
            command = core.control(t, y, memory, ring, i // per_period, drive, c)
            if c.torque_lag == 0:
                y = (y[0], y[1], y[2], y[3], command)
        total, stage = y, y
        for k in range(4):
            late = step * (0.0, 0.5, 0.5, 1.0)[k]
            region = np.searchsorted(edges, stage[0] / c.gear_ratio - stage[2])
            rates = core.derivative(t + late, stage, command, region, c)
            total = core.along(total, step * (1 / 6, 1 / 3, 1 / 3, 1 / 6)[k], rates)
            stage = core.along(y, step * (0.5, 0.5, 1.0, 0.0)[k], rates)
        y = total
        if not abs(y[1]) < core.DIVERGED * c.omega:
            speeds[:] = np.nan
            return


def plain_steps_speed_rps(
    joint: JointParameters, delta_rad: float, duration_s: float, step_s: float
) -> FloatArray:
    """Motor speed [rps] by control period from steps that do not locate the contact; NaN if it diverged."""
    skip = round(joint.lead_s / step_s)
    before = skip // round(joint.control_period_s / step_s)
    speeds = np.full(before + round(duration_s / joint.control_period_s), np.nan)
    y, _ = core.start_state(joint, delta_rad)
    c = core.constants_of(joint, delta_rad)
    _plain_steps(y, speeds, skip, joint.control_delay_periods, step_s, c, core.drive_of(joint))
    return joint.commanded_speed_rps + speeds[before:] / TURN


def stepping_torque_study(
    joint: JointParameters, deltas_rad: FloatArray, steps_s: Sequence[float]
) -> pd.DataFrame:
    """Settled peaks from plain steps against fine ones that locate the contact, with a stepping torque or not."""
    damping = 2 * DAMPING_RATIO * math.sqrt(joint.stiffness_nm_per_rad * joint.load_inertia_kgm2)
    models = {
        "stepping": replace(joint, clamped=True, damping_nms_per_rad=damping),
        "modified": joint,
    }
    period = joint.control_period_s
    duration = 4 * joint.turn_period_s
    first_turn = round(joint.turn_period_s / period)
    rows = []
    for (name, model), delta in product(models.items(), deltas_rad):
        fine = simulate(model, delta, duration_s=duration, sample_s=period, step_s=period / 50)
        reference = settled_peak_rps(fine, model)
        for step in steps_s:
            speed = plain_steps_speed_rps(model, delta, duration, step)
            peak = speed[first_turn:].max() - model.commanded_speed_rps
            rows.append((name, delta, step, peak, reference, peak / reference - 1))
    return pd.DataFrame(
        rows, columns=["model", "delta_rad", "step_s", "peak_rps", "reference_rps", "error"]
    )
