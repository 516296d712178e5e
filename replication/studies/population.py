"""Every method on logs of joints that nobody calibrated: benches drawn at large, and joints outside the model.

Criteria, fixed before the final logs were drawn, are those of `BARS`; methods were developed on other seeds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from replication.characteristic import printed_levels_rad
from replication.datasets import Recording, level_delta_rad, load_noisy
from replication.global_fit.fit import global_fit
from replication.methods.calibration import backlashes, default_calibration
from replication.methods.readings import protocol_for
from replication.methods.self_calibration import fit_joint
from replication.methods.spread import widened
from replication.simulator.parameters import TURN
from replication.simulator.turns import COLUMNS, Movement, settled_turns
from replication.standins.joints import Bench, Spread, draw_bench, encoder_log
from replication.standins.odd_joints import KINDS, draw_odd_log
from replication.studies.basins import rate_interval

# Populations of benches: as drawn for the paper's bench, and far from it.
SPREADS = {
    "default spread": Spread(),
    "20 % spread, 5 % friction, double ripple": Spread(ratios=0.2, load_friction=0.05, ripple=0.04),
}
METHODS = ("self", "paper", "amplitude", "energy", "waveform")
AUTHORS_LOGS = tuple((realisation, level) for realisation in (1, 2) for level in range(3, 12))

DEVELOPMENT_SEED, FINAL_SEED = 1616, 20260
_BOUND_STEPS = {"delta_rad": 2e-6, "friction": 1e-3}
_BOUND_RATIOS = ("stiffness_per_s2", "gravity_per_s2", "inertia_ratio", "speed_gain_per_s", "integral_gain_per_s2")


@dataclass(frozen=True)
class Log:
    """A log of known backlash: where it is from, which it is, delta [rad], its Cramer-Rao bound [rad], the record."""

    population: str
    number: int
    delta_rad: float
    bound_rad: float
    recording: Recording


def draw_log(population: str, number: int, seed: int) -> Log:
    """Draw a log of a population; backlash is drawn evenly from Table 2's range.

    Benches whose drive is unstable are drawn again: nobody runs one.

    Parameters
    ----------
    population : str
        A key of `SPREADS`, or one of `odd_joints.KINDS`.
    number, seed : int
        Which log, of which draw of the population.
    """
    rng = np.random.default_rng((seed, [*SPREADS, *KINDS].index(population), number))
    delta = float(rng.uniform(*printed_levels_rad()[[0, -1]]))
    if population in KINDS:
        return Log(population, number, delta, np.nan, draw_odd_log(population, delta, rng))
    while True:
        bench = draw_bench(rng, SPREADS[population])
        try:
            recording = encoder_log(bench, delta, rng)
        except (ValueError, ArithmeticError):
            continue
        return Log(population, number, delta, bench_bound_rad(bench, delta, recording), recording)


def authors_logs() -> list[Log]:
    """The authors' noisy logs of levels 3 to 11; errors as of `datasets.load_noisy`."""
    return [
        Log("authors' logs", number, level_delta_rad(level), np.nan, load_noisy(level, realisation))
        for number, (realisation, level) in enumerate(AUTHORS_LOGS)
    ]


def bench_bound_rad(bench: Bench, delta_rad: float, recording: Recording) -> float:
    """Cramer-Rao bound of a bench's backlash from its log's settled turns [rad].

    Start angle, friction, stiffness, gravity, inertia ratio, speed and integral gain are unknown, without any prior.
    """
    joint = bench.joint
    load_speed = joint.commanded_speed_rad_per_s / joint.gear_ratio
    rubbing = joint.load_coulomb_nm + joint.load_viscous_nms_per_rad * load_speed
    here = dict.fromkeys(COLUMNS, 0.0) | {name: v for name, v in joint.ratios.items() if name in COLUMNS}
    here |= {"delta_rad": delta_rad, "friction": rubbing / joint.gravity_torque_nm}
    steps = _BOUND_STEPS | {name: 1e-2 * here[name] for name in _BOUND_RATIOS}
    rows = [here | {name: here[name] + sign * step} for name, step in steps.items() for sign in (1, -1)]
    turns = settled_turns(
        np.array([[row[name] for name in COLUMNS] for row in [here, *rows]]),
        Movement(joint.gear_ratio, joint.turn_period_s),
    )
    slopes = (turns[1::2] - turns[2::2]) / (2 * np.array(list(steps.values()))[:, None])
    shift = np.gradient(turns[0]) * turns.shape[1] / TURN
    samples = round(joint.turn_period_s / recording.sample_s)
    columns = np.array([*slopes, shift])[:, :: max(turns.shape[1] // samples, 1)]
    columns = columns - columns.mean(axis=1, keepdims=True)
    settled = recording.t.size - samples
    information = columns @ columns.T * (settled / columns.shape[1]) / bench.noise_rps**2
    scale = np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    return float(np.sqrt(inverse[0, 0]))


def measure_log(log: Log, methods: Sequence[str] = METHODS) -> pd.DataFrame:
    """Measure a log by each method, without a calibration of its joint; columns as of `measure_population`."""
    rows = [_row(log, *_by_self(log.recording))] if "self" in methods else []
    others = {name: default_calibration(name) for name in methods if name != "self"}
    if others:
        fit = global_fit(log.recording, protocol_for(log.recording))
        for name, found in backlashes(log.recording, fit, others).items():
            interval = widened(name, found.delta_rad, found.interval_rad)
            reason = "extrapolated calibration" if found.extrapolated else ""
            rows.append(_row(log, name, found.delta_rad, interval, reason))
    return pd.DataFrame(rows)


def _by_self(recording: Recording) -> tuple[str, float, tuple[float, float], str, float, float, float]:
    found = fit_joint(recording)
    return "self", found.delta_rad, found.interval_rad, found.doubt, found.sd_rad, found.misfit, found.unrest


def _row(log: Log, method: str, found_rad: float, interval_rad: tuple[float, float], reason: str, *fitted) -> dict:
    """A row of `measure_population`; what is not known is NaN."""
    sd, misfit, unrest = fitted or (np.nan, np.nan, np.nan)
    return {
        "population": log.population, "number": log.number, "delta_rad": log.delta_rad, "bound_rad": log.bound_rad,
        "method": method, "found_rad": found_rad, "low_rad": interval_rad[0], "high_rad": interval_rad[1],
        "sd_rad": sd, "misfit": misfit, "unrest": unrest, "refused": bool(reason), "reason": reason.split(" (")[0],
    }  # fmt: skip


def _drawn_and_measured(population: str, number: int, seed: int, methods: Sequence[str]) -> pd.DataFrame:
    return measure_log(draw_log(population, number, seed), methods)


def measure_population(
    population: str, numbers: Sequence[int], seed: int, methods: Sequence[str] = METHODS, jobs: int = -1
) -> pd.DataFrame:
    """Draw logs of a population and measure them.

    Returns
    -------
    DataFrame
        A row a log and method: `population, number, delta_rad, bound_rad, method, found_rad, low_rad, high_rad`, for
        "self" `sd_rad, misfit, unrest`, and `refused, reason` where there is no answer.
    """
    tasks = (delayed(_drawn_and_measured)(population, number, seed, methods) for number in numbers)
    return pd.concat(Parallel(n_jobs=jobs)(tasks), ignore_index=True)


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Error, coverage and refusals of each method on each population.

    Returns
    -------
    DataFrame
        `population, method, logs, refused, rmse_rad, median_abs_error_rad, coverage, coverage_low, coverage_high,
        held_or_refused, bound_rad` (root mean square of the answered logs' bounds).
    """
    table = []
    for (population, method), part in rows.groupby(["population", "method"], sort=False):
        answered = part[~part["refused"]]
        error = answered["found_rad"] - answered["delta_rad"]
        held = int(answered["delta_rad"].between(answered["low_rad"], answered["high_rad"]).sum())
        interval = rate_interval(held, len(answered)) if len(answered) else (np.nan, np.nan)
        table.append(
            (population, method, len(part), part["refused"].mean(), np.sqrt(np.mean(error**2)), error.abs().median(),
             held / max(len(answered), 1), *interval, (held + part["refused"].sum()) / len(part),
             np.sqrt(np.mean(answered["bound_rad"] ** 2)))
        )  # fmt: skip
    columns = ["population", "method", "logs", "refused", "rmse_rad", "median_abs_error_rad", "coverage",
               "coverage_low", "coverage_high", "held_or_refused", "bound_rad"]  # fmt: skip
    return pd.DataFrame(table, columns=columns)
