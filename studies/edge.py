"""The edge of the dead zone: what alpha the records need, and what a torque that steps does to a simulation."""

import math
from collections.abc import Iterable, Sequence
from itertools import product
from operator import attrgetter

import numba
import numpy as np
from pandas import DataFrame

from replication import joint as simulator
from replication.joint import Joint, identified_joint, ratios, settled_peak, simulate
from replication.records import load_clean_records
from replication.signature import TURN, FloatArray
from studies.identification import FIT_LEVELS, errors_in_turn, identify_joint

# Sharpness of the edge [1/rad] at which the joint is identified anew, from sharp to soft.
ALPHAS = (1e6, 1e5, 1e4, 1e3)
DAMPING_RATIO = 0.05  # of the joint whose torque steps


def refit_alphas(alpha: float) -> DataFrame:
    """Identify the joint anew at each of `ALPHAS` down to one: misfit, that with the joint's own ratios, new ratios."""
    records = load_clean_records(FIT_LEVELS)
    last = identified_joint()
    rows = []
    for sharper in ALPHAS[: ALPHAS.index(alpha) + 1]:
        same = identified_joint()._replace(alpha=sharper)
        # With a soft edge the misfit has several minima: two starts, at first the same, the better fit counts.
        starts = dict.fromkeys((same, last._replace(alpha=sharper)))
        fit = min((identify_joint(records, start) for start in starts), key=attrgetter("nrmse"))
        last = fit.joint
        errors = np.concatenate(errors_in_turn(same, records, 3))
        misfits = {"nrmse": fit.nrmse, "nrmse_same_ratios": math.sqrt(np.mean(errors**2))}
        rows.append({"alpha": sharper} | misfits | ratios(last))
    return DataFrame(rows)


# Of each stage of the classical Runge-Kutta method, in steps: its time, its weight, and how far the next one starts.
STAGES = ((0.0, 1 / 6, 0.5), (0.5, 1 / 3, 0.5), (0.5, 1 / 3, 1.0), (1.0, 1 / 6, 0.0))


@numba.njit  # not cached: it holds functions of another file
def _plain_steps(y, periods, delta, step, j):
    """Speeds at so many periods of the drive, by steps that do not look for a contact; NaN from where they diverge."""
    speeds = np.full(periods, np.nan)
    lead_steps = round(j.lead / step)
    memory = np.array([y[4], 0.0, 0.0, y[0]])
    pending = np.full(j.delay + 1, y[4])
    per_period = round(j.period / step)
    command = y[4]
    for i in range(periods * per_period):
        t = (i - lead_steps) * step
        period, rest = divmod(i, per_period)
        if rest == 0:
            speeds[period] = y[1]
            command = simulator.drive(t, y, memory, pending, period, j)
        total, stage = y, y
        for late, weight, ahead in STAGES:
            x = stage[0] / j.N - stage[2]
            side = 0 if j.clamped and abs(x) <= delta else np.sign(x)
            held = simulator.Held(command, delta, side)
            rates = simulator.rates(t + step * late, stage, held, j)
            total = simulator.advance(total, step * weight, rates)
            stage = simulator.advance(y, step * ahead, rates)
        y = total
        if not abs(y[1]) < 10 * j.Omega:
            break
    return speeds


def plain_steps_speed(joint: Joint, delta: float, duration: float, step: float) -> FloatArray:
    """Motor speed [rps] at the drive's periods from plain steps; NaN from where they diverge."""
    start, _ = simulator.balance(joint, delta)
    before, periods = (round(time / joint.period) for time in (joint.lead, duration))
    compilable = simulator.compilable(joint)
    speeds = _plain_steps(start, before + periods, delta, step, compilable)[before:]
    return (joint.Omega + speeds) / TURN


def stepping_torque_study(
    joint: Joint, deltas: Iterable[float], steps: Sequence[float]
) -> DataFrame:
    """Settled peaks from plain steps against fine ones that locate the contact, with a stepping torque or not."""
    damping = 2 * DAMPING_RATIO * math.sqrt(joint.K_s * joint.J_l)
    models = {"stepping": joint._replace(clamped=True, D_s=damping), "modified": joint}
    duration = 4 * joint.turn_period
    first_turn = round(joint.turn_period / joint.period)
    rows = []
    for (name, model), delta in product(models.items(), deltas):
        fine = simulate(model, delta, duration, joint.period, joint.period / 50)
        reference = settled_peak(fine, model)
        for step in steps:
            speed = plain_steps_speed(model, delta, duration, step)
            error = (speed[first_turn:].max() - joint.Omega / TURN) / reference - 1
            rows.append((name, delta, step, error))
    return DataFrame(rows, columns=["model", "delta_rad", "step_s", "error"])
