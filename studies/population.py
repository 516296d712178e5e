"""Every method on logs of joints that nobody calibrated: benches drawn at large, joints outside the model, worse logs.

Criteria, fixed before the final logs were drawn, are `CRITERIA`. Methods were developed
on other seeds, among them 20260, 20261 and 20262, whose logs were the final ones of earlier states
of "self" and told where it erred.
"""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pandas import DataFrame, Series

from backlash.calibration import default_calibration, widened
from backlash.fitting.self_calibration import fit_joint
from backlash.fitting.turns import COLUMNS, Movement, simulate_turns
from replication.characteristic import printed_levels_rad
from replication.parallel import in_parallel
from replication.records import Recording, level_delta_rad
from replication.simulator.parameters import TURN, identified_joint
from replication.records import load_clean, load_noisy
from replication.standins import VARIED_RATIOS, Bench, Spread, draw_bench, encoder_log
from studies import benchmark
from studies.accuracy import cramer_rao_sd
from studies.benchmark import Row, interval_answer
from studies.odd_joints import KINDS, draw_odd_log

# Populations of benches: as drawn for the paper's bench, and far from it.
SPREADS = {
    "default spread": Spread(),
    "20 % spread, 5 % friction, double ripple": Spread(ratios=0.2, load_friction=0.05, ripple=0.04),
}
NEAR, FAR = SPREADS
AUTHORS = "authors' logs"
COMPARED_METHODS = ("self", "paper", "amplitude", "energy", "waveform")
ROW_COLUMNS = [
    "population",
    "number",
    "delta_rad",
    "bound_rad",
    "method",
    "found_rad",
    "low_rad",
    "high_rad",
    "sd_rad",
    "misfit",
    "unrest",
    "refused",
    "reason",
]


DEVELOPMENT_SEED = 1616
FINAL_SEED = 20263
# What the other methods' intervals are made wide by: population, logs, seed, methods. Then the final logs, likewise.
SPREAD_STUDY = (NEAR, range(100), DEVELOPMENT_SEED, COMPARED_METHODS[1:])
FINAL_STUDIES = (
    (NEAR, range(100), FINAL_SEED, COMPARED_METHODS),
    (NEAR, range(100, 400), FINAL_SEED, ("self",)),
    (FAR, range(25), FINAL_SEED, COMPARED_METHODS),
    (FAR, range(25, 150), FINAL_SEED, ("self",)),
    *((kind, range(25), FINAL_SEED, COMPARED_METHODS) for kind in KINDS),
)
NORMAL_95 = 1.96

# What "self" is to reach: population, column of `summarise_intervals` (or RMS error over the bound), sign and limit.
# Why these: a third of the error that a calibration of another joint makes; no more than 30 % above what any method
# could reach; an interval of 95 % that holds within what 400 logs can tell; refusals that leave an owner without an
# answer seldom.
CRITERIA = Path(__file__).with_name("criteria.csv")
# Steps of the slopes of a Cramer-Rao bound; those of the ratios are shares of them.
_BOUND_STEPS = {"delta_rad": 2e-6, "friction": 1e-3}
_BOUND_SHARE = 1e-2


class KnownLog(NamedTuple):
    """A log of known backlash [rad], and the Cramer-Rao bound on its error [rad], nan where none is known."""

    recording: Recording
    delta_rad: float
    bound_rad: float = np.nan


def draw_log(population: str, number: int, seed: int) -> KnownLog:
    """Draw a log of a population: of `SPREADS`, of `odd_joints.KINDS`, or the authors' (`AUTHORS`)."""
    if population == AUTHORS:
        return _authors_log(number)
    rng = np.random.default_rng((seed, [*SPREADS, *KINDS].index(population), number))
    delta = float(rng.uniform(*printed_levels_rad()[[0, -1]]))
    if population in KINDS:
        return KnownLog(draw_odd_log(population, delta, rng), delta)
    while True:
        bench = draw_bench(rng, SPREADS[population])
        with suppress(ValueError, ArithmeticError):  # an unstable drive: nobody runs one
            recording = encoder_log(bench, delta, rng)
            return KnownLog(recording, delta, bench_bound_rad(bench, delta, recording))


def _authors_log(number: int) -> KnownLog:
    """One of the authors' noisy logs of levels 3 to 11, R = 1 and then R = 2."""
    realisation, level = 1 + number // 9, 3 + number % 9
    recording, delta = load_noisy(level, realisation), level_delta_rad(level)
    noise = float(np.std(recording.v - load_clean(level).v))
    bench = Bench(identified_joint(), noise, np.nan)
    return KnownLog(recording, delta, bench_bound_rad(bench, delta, recording))


def bench_bound_rad(bench: Bench, delta_rad: float, recording: Recording) -> float:
    """Cramer-Rao bound [rad] from a log's settled turns, with start, friction and ratios unknown, no prior."""
    joint = bench.joint
    samples = round(joint.turn_period_s / recording.sample_s)
    settled = recording.t.size - samples
    load_speed = joint.commanded_speed_rad_per_s / joint.gear_ratio
    rubbing = joint.load_coulomb_nm + joint.load_viscous_nms_per_rad * load_speed
    here = joint.ratios | {"delta_rad": delta_rad, "friction": rubbing / joint.gravity_torque_nm}
    steps = _BOUND_STEPS | {name: _BOUND_SHARE * here[name] for name in VARIED_RATIOS}
    moved = [
        here | {name: here[name] + sign * step} for sign in (1, -1) for name, step in steps.items()
    ]
    rows = np.array([[row.get(name, 0.0) for name in COLUMNS] for row in (here, *moved)])
    movement = Movement(joint.gear_ratio, joint.turn_period_s)
    turn, *others = simulate_turns(rows, movement, differencing=joint.speed_by_differencing)
    after, before = np.split(np.array(others), 2)
    slopes = (after - before) / (2 * np.array(list(steps.values()))[:, None])
    shift = np.gradient(turn) * turn.size / TURN
    columns = np.array([*slopes, shift])[:, :: max(turn.size // samples, 1)]
    return cramer_rao_sd(columns, bench.noise_rps * np.sqrt(columns.shape[1] / settled))


def _answers_to(recording: Recording, methods: Sequence[str]) -> dict[str, Row]:
    """Answers of methods that have no calibration of the log's joint."""
    answers = {}
    if "self" in methods:
        fit = fit_joint(recording)
        answers["self"] = interval_answer(fit.delta_rad, fit.interval_rad, fit.refusal_reason)
        answers["self"] |= {
            "sd_rad": fit.sd_rad,
            "misfit": fit.misfit,
            "unrest": fit.ring_noise_ratio,
        }
    calibrations = {name: default_calibration(name) for name in methods if name != "self"}
    found = benchmark.backlashes(recording, calibrations) if calibrations else {}
    for name, backlash in found.items():
        interval = widened(name, backlash.delta_rad, backlash.interval_rad)
        reason = "extrapolated calibration" if backlash.extrapolated else ""
        answers[name] = interval_answer(backlash.delta_rad, interval, reason)
    return answers


def _measure_log(population: str, number: int, seed: int, methods: Sequence[str]) -> list[Row]:
    log = draw_log(population, number, seed)
    of_log = {"population": population, "number": number, "delta_rad": log.delta_rad}
    of_log["bound_rad"] = log.bound_rad
    answers = _answers_to(log.recording, methods)
    return [of_log | {"method": method} | answer for method, answer in answers.items()]


def measure_population(
    population: str, numbers: Sequence[int], seed: int, methods: Sequence[str]
) -> DataFrame:
    """Draw logs of a population and measure them; a row of `ROW_COLUMNS` for each log and method.

    Only "self" knows its SD.
    """
    calls = ((population, number, seed, methods) for number in numbers)
    tables = in_parallel(_measure_log, calls, "logs")
    return DataFrame([row for rows in tables for row in rows], columns=ROW_COLUMNS)


def spread_shares(rows: DataFrame) -> DataFrame:
    """Conformal intervals for `spread_of_joints.csv`: each method's 95 % quantile of |error| / found."""
    answered = rows.query("method != 'self' and not refused")
    share = ((answered["found_rad"] - answered["delta_rad"]) / answered["found_rad"]).abs()

    def quantile(size: Series) -> float:
        level = min(np.ceil(0.95 * (size.size + 1)) / size.size, 1.0)
        return float(f"{np.quantile(size, level, method='higher'):.3f}")

    shares = share.groupby(answered["method"], sort=False).agg(quantile)
    return shares.rename("share_95").reset_index()


def criteria_facts(judged: DataFrame) -> dict[str, Any]:
    """What texts say of the criteria, as `against_criteria` judged them."""
    return {
        "self_criteria": len(judged),
        "self_met": judged["met"].sum(),
        "self_failed": benchmark.describe_missed(judged),
    }


def against_criteria(table: DataFrame) -> DataFrame:
    """Compare `CRITERIA` with what `summarise_intervals` says of "self"."""
    of_self = table[table["method"] == "self"]
    over_bound = of_self["rmse_rad"] / of_self["bound_rad"]
    return benchmark.against_criteria(of_self.assign(rmse_over_bound=over_bound), CRITERIA)
