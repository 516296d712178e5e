"""Identification of the joint from clean motor-speed records, and its validation.

A motor-speed record fixes ratios only: stiffness and gravity per load inertia, the two inertias' ratio, the
gains per motor inertia, and the times and angle. One scale of torque (here the 5 kg of the load) is free.
The load's Coulomb friction must be far below the gravity torque or the impacts would not be evenly spaced;
friction and the coupling's damping stay at zero because the records do not need them.
"""

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from replication.arrays import FloatArray
from replication.simulator.simulate import (
    DivergenceError,
    JointParameters,
    SimulatedJoint,
    settled_peak_rps,
    simulate_many,
    with_ratios,
)

Signal = tuple[FloatArray, FloatArray]

# Fine enough that the settled peak is not missed between samples.
FINE_S = 5e-5

VALIDATION_COLUMNS = ["dataset", "delta_rad", "used_in_fit", "nrmse", "peak_rps", "printed_A_rps", "peak_error_percent"]

# When the joint started shows in the first turn only, which `identify_joint` leaves to `identify_lead`.
HELD = ("lead_s",)


@dataclass(frozen=True)
class JointFit:
    """An identified joint."""

    parameters: JointParameters
    confidence: dict[str, tuple[float, float]]  # 95 % interval of each ratio, from the linearised least squares
    correlation: pd.DataFrame  # of the ratios' estimates
    mean_square: float  # mean over the levels of the squared normalised RMSE
    evaluations: int  # of the residual, those for the Jacobian not counted


def _sampling(time_s: FloatArray) -> tuple[float, float]:
    """Return the sampling period and the duration of a record."""
    steps = np.diff(time_s)
    if steps.size < 2 or abs(time_s[0]) > 1e-9 or not np.allclose(steps, steps[0], rtol=1e-6):
        raise ValueError("a recording must start at t = 0 and be sampled evenly; resample it first")
    return round(float(steps.mean()), 9), float(time_s[-1])


def _third_turn(signal: Signal, turn_s: float) -> tuple[NDArray[np.int64], FloatArray, float]:
    """Return rows and speeds of the third turn (all from the second on repeat) and the settled SD."""
    time, speed = signal
    if _sampling(time)[1] < 3 * turn_s:
        raise ValueError(f"a recording of {time[-1]} s is too short: three turns of {turn_s} s are needed")
    rows = np.flatnonzero((time >= 2 * turn_s - 1e-9) & (time < 3 * turn_s - 1e-9))
    return rows, speed[rows], float(speed[time >= turn_s - 1e-9].std())


def _simulations(
    parameters: JointParameters, recordings: Mapping[float, Signal], duration_s: float | None = None
) -> tuple[list[SimulatedJoint], int]:
    """Simulate every level finely; also return how many fine samples make one of the recordings'."""
    sample, duration = _sampling(next(iter(recordings.values()))[0])
    runs = simulate_many(
        parameters, list(recordings), duration_s=duration_s or duration, sample_s=FINE_S, step_s=FINE_S
    )
    return runs, round(sample / FINE_S)


def identify_joint(
    recordings: Mapping[float, Signal], start: JointParameters, *, held: Iterable[str] = HELD
) -> JointFit:
    """Fit the ratios of a joint to clean motor-speed records by least squares.

    Every level weighs the same: its settled waveform's error counts in units of the signal's SD.
    The peaks before sampling are not used, so they validate.
    """
    free = {name: value for name, value in start.ratios.items() if name not in set(held)}
    names, values = list(free), np.array(list(free.values()))
    turn = start.turn_period_s
    targets = {delta: _third_turn(signal, turn) for delta, signal in recordings.items()}
    size = sum(target.size for _, target, _ in targets.values())

    def residual(z: FloatArray) -> FloatArray:
        try:
            runs, stride = _simulations(
                with_ratios(start, dict(zip(names, values * z, strict=True))), recordings, 3 * turn
            )
        except (ValueError, DivergenceError):
            return np.full(size, 10.0)
        return np.concatenate(
            [
                (run.motor_speed_rps[::stride][rows] - v) / sd
                for run, (rows, v, sd) in zip(runs, targets.values(), strict=True)
            ]
        )

    fit = least_squares(
        residual,
        np.ones(len(names)),
        "3-point",
        # No ratio may change its sign: the fit would end in a worse basin without the leaky integral.
        bounds=(0.1, 10.0),
        diff_step=1e-3,
        x_scale="jac",
    )
    inverse = np.linalg.inv(fit.jac.T @ fit.jac)
    spread = np.sqrt(np.diag(inverse))
    sd = spread * math.sqrt(2 * fit.cost / (size - len(names)))
    half = student.ppf(0.975, size - len(names)) * sd * np.abs(values)
    best = dict(zip(names, (values * fit.x).tolist(), strict=True))
    return JointFit(
        parameters=with_ratios(start, best),
        confidence={name: (best[name] - h, best[name] + h) for name, h in zip(names, half.tolist(), strict=True)},
        correlation=pd.DataFrame(inverse / np.outer(spread, spread), index=names, columns=names),
        mean_square=2 * fit.cost / size,
        evaluations=int(fit.nfev),
    )


def identify_lead(recordings: Mapping[float, Signal], parameters: JointParameters, leads_s: Iterable[float]) -> float:
    """Find how long before the records the joint started: the lead whose worst first turn is best."""

    def worst_first_turn(lead: float) -> float:
        turn = parameters.turn_period_s
        runs, stride = _simulations(replace(parameters, lead_s=lead), recordings, turn)
        errors = []
        for (time, speed), run in zip(recordings.values(), runs, strict=True):
            v = run.motor_speed_rps[::stride]
            errors.append(np.sqrt(np.mean((v - speed[: v.size]) ** 2)) / speed[time >= turn - 1e-9].std())
        return max(errors)

    return min(leads_s, key=worst_first_turn)


def validation_table(
    parameters: JointParameters,
    recordings: Mapping[float, Signal],
    datasets: Mapping[float, str],
    *,
    used_in_fit: Iterable[float] = (),
    printed_a_rps: Mapping[float, float] | None = None,
) -> pd.DataFrame:
    """Compare the simulated joint with the records and with the printed amplitudes, level by level."""
    printed, used = printed_a_rps or {}, set(used_in_fit)
    grid = next(iter(recordings.values()))
    runs, stride = _simulations(parameters, {delta: recordings.get(delta, grid) for delta in datasets})
    rows = []
    for (delta, name), run in zip(datasets.items(), runs, strict=True):
        nrmse = math.nan
        if delta in recordings:
            time, speed = recordings[delta]
            settled = time >= parameters.turn_period_s - 1e-9
            error = (run.motor_speed_rps[::stride] - speed)[settled]
            nrmse = float(np.sqrt(np.mean(error**2)) / speed[settled].std())
        peak, a = settled_peak_rps(run, parameters), printed.get(delta, math.nan)
        rows.append((name, delta, delta in used, nrmse, peak, a, 100 * (peak / a - 1)))
    return pd.DataFrame(rows, columns=VALIDATION_COLUMNS)


def profile_ratio(
    name: str, factors: Iterable[float], recordings: Mapping[float, Signal], best: JointParameters
) -> pd.DataFrame:
    """Profile of the misfit along one ratio: the others are fitted anew at each value."""
    rows = []
    for factor in factors:
        start = with_ratios(best, {name: best.ratios[name] * factor})
        fit = identify_joint(recordings, start, held={name, *HELD})
        rows.append((factor, start.ratios[name], math.sqrt(fit.mean_square)))
    return pd.DataFrame(rows, columns=["factor", "value", "nrmse"])


def joint_record(fit: JointFit, sources: Iterable[Path], versions: Mapping[str, str]) -> str:
    """Return an identified joint with its provenance as the JSON text that `identified_joint` reads."""
    p = fit.parameters
    data = {
        "ratios": {name: float(f"{value:.7g}") for name, value in p.ratios.items()},
        "drive": {"control_period_s": p.control_period_s, "control_delay_periods": p.control_delay_periods},
        "confidence_95": {name: [float(f"{x:.4g}") for x in pair] for name, pair in fit.confidence.items()},
        "root_mean_square": float(f"{math.sqrt(fit.mean_square):.4g}"),
        "sources": {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(sources)},
        "versions": dict(versions),
    }
    return json.dumps(data, indent=2) + "\n"
