"""Identification of the joint from clean motor-speed records, and its validation.

A motor-speed record fixes ratios only: stiffness and gravity per load inertia, the two inertias'
ratio, the gains per motor inertia, and the times and angle. One scale of torque (here the 5 kg of
the load) is free. The load's Coulomb friction must be far below the gravity torque or the impacts
would not be evenly spaced; friction and the coupling's damping stay at zero because the records do
not need them.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.optimize import least_squares
from scipy.stats import t as student
from tqdm import tqdm

from replication.arrays import FloatArray
from replication.records import Recording
from replication.simulator.parameters import JointParameters, with_ratios
from replication.simulator.simulate import DivergenceError, SimulatedJoint, simulate_many

Records = Mapping[float, Recording]  # by backlash [rad]

FINE_S = 5e-5  # fine enough that the settled peak is not missed between samples

# When the joint started shows in the first turn only, which `identify_joint` leaves to
# `identify_lead`.
HELD = ("lead_s",)


@dataclass(frozen=True)
class JointFit:
    """An identified joint."""

    parameters: JointParameters
    confidence: dict[
        str, tuple[float, float]
    ]  # 95 % interval of each ratio, from the linearised least squares
    correlation: pd.DataFrame  # of the ratios' estimates
    mean_square: float  # mean over the levels of the squared normalised RMSE
    evaluations: int  # simulations of all records, those for the Jacobian among them


def fine_per_sample(record: Recording) -> int:
    """Count the fine samples that make one of a record's, which must be even and start at t = 0."""
    steps = np.diff(record.t)
    if steps.size < 2 or abs(record.t[0]) > 1e-9 or not np.allclose(steps, steps[0], rtol=1e-6):
        raise ValueError("a recording must start at t = 0 and be sampled evenly; resample it first")
    return round(float(steps.mean()) / FINE_S)


def simulate_finely(
    joint: JointParameters, deltas_rad: Iterable[float], duration_s: float
) -> list[SimulatedJoint]:
    """Simulate each backlash with nothing missed between samples."""
    return simulate_many(
        joint, list(deltas_rad), duration_s=duration_s, sample_s=FINE_S, step_s=FINE_S
    )


def sd_after_first_turn(record: Recording, turn_s: float) -> float:
    """SD of a record's speed after its first turn [rps]."""
    return float(record.v[record.t >= turn_s - 1e-9].std())


def third_turn_errors(joint: JointParameters, records: Records) -> FloatArray:
    """Simulated less recorded speed in the third turn of each record, one after the other.

    In units of the record's SD after its first turn. All turns from the second on repeat.
    """
    turn = joint.turn_period_s
    runs = simulate_finely(joint, records, 3 * turn)
    parts = []
    for run, record in zip(runs, records.values(), strict=True):
        third = (record.t >= 2 * turn - 1e-9) & (record.t < 3 * turn - 1e-9)
        rows = np.flatnonzero(third)
        speed = run.motor_speed_rps[:: fine_per_sample(record)]
        parts.append((speed[rows] - record.v[rows]) / sd_after_first_turn(record, turn))
    return np.concatenate(parts)


def identify_joint(
    records: Records, start: JointParameters, *, held: Iterable[str] = HELD
) -> JointFit:
    """Fit the ratios of a joint to clean motor-speed records by least squares.

    Every level weighs the same: its settled waveform's error counts in units of the signal's SD.
    The peaks before sampling are not used, so they validate.
    """
    free = {name: value for name, value in start.ratios.items() if name not in set(held)}
    names = list(free)
    values = np.array(list(free.values()))
    shortest, turn = min(record.t[-1] for record in records.values()), start.turn_period_s
    if shortest < 3 * turn:
        raise ValueError(
            f"a recording of {shortest} s is too short: three turns of {turn} s are needed"
        )
    size = third_turn_errors(start, records).size
    progress = tqdm(desc="simulations of the fit")

    def residual(z: FloatArray) -> FloatArray:
        progress.update()
        tried = dict(zip(names, values * z, strict=True))
        try:
            return third_turn_errors(with_ratios(start, tried), records)
        except (ValueError, DivergenceError):
            return np.full(size, 10.0)

    fit = least_squares(
        residual,
        np.ones(len(names)),
        "3-point",
        # No ratio may change its sign: the fit would end in a worse basin without the leaky
        # integral.
        bounds=(0.1, 10.0),
        diff_step=1e-3,
        x_scale="jac",
    )
    progress.close()
    inverse = np.linalg.inv(fit.jac.T @ fit.jac)
    spread = np.sqrt(np.diag(inverse))
    degrees = size - len(names)
    sd = spread * math.sqrt(2 * fit.cost / degrees)
    half = dict(
        zip(names, (student.ppf(0.975, degrees) * sd * np.abs(values)).tolist(), strict=True)
    )
    best = dict(zip(names, (values * fit.x).tolist(), strict=True))
    return JointFit(
        parameters=with_ratios(start, best),
        confidence={name: (best[name] - half[name], best[name] + half[name]) for name in names},
        correlation=pd.DataFrame(inverse / np.outer(spread, spread), index=names, columns=names),
        mean_square=2 * fit.cost / size,
        evaluations=fit.nfev + 2 * len(names) * fit.njev,
    )


def identify_lead(records: Records, parameters: JointParameters, leads_s: Iterable[float]) -> float:
    """Find how long before the records the joint started: the lead whose worst turn is best."""
    turn = parameters.turn_period_s

    def worst_first_turn(lead: float) -> float:
        runs = simulate_finely(replace(parameters, lead_s=lead), records, turn)
        errors = []
        for record, run in zip(records.values(), runs, strict=True):
            v = run.motor_speed_rps[:: fine_per_sample(record)]
            rms = np.sqrt(np.mean((v - record.v[: v.size]) ** 2))
            errors.append(rms / sd_after_first_turn(record, turn))
        return max(errors)

    return min(leads_s, key=worst_first_turn)
