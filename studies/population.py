"""Every method on logs of joints that nobody calibrated: benches drawn at large, joints outside the model, worse logs.

Criteria, fixed before the final logs were drawn, are `ACCEPTANCE_CRITERIA`. Methods were developed
on other seeds, among them 20260, 20261 and 20262, whose logs were the final ones of earlier states
of "self" and told where it erred.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from numpy.random import Generator
from pandas import DataFrame, Series, concat, read_csv
from scipy import signal, stats

from backlash.calibration import default_calibration
from backlash.fitting.global_fit import global_fit
from backlash.fitting.readings import protocol_for
from backlash.fitting.torque import LoadData, fit_torque
from backlash.fitting.turns import COLUMNS, Movement, simulate_turns
from backlash.fleet import examine_or_refuse
from backlash.reading.columns import LogFormat
from backlash.settings import Settings, settings_for
from replication.arrays import FloatArray
from replication.authors import level_delta_rad, load_clean, load_noisy
from replication.characteristic import printed_levels_rad
from replication.parallel import in_parallel
from replication.recording import Recording
from replication.simulator.parameters import TURN, Disturbance, identified_joint
from replication.standins import SAMPLE_S, VARIED_RATIOS, Bench, Spread, draw_bench
from replication.statistics import rate_columns
from studies import benchmark, odd_joints
from studies.accuracy import cramer_rao_sd
from studies.benchmark import DrawnLog, KnownLog, Row, hold_truth, interval_answer, self_answer
from studies.odd_joints import KINDS, draw_odd_log
from studies.strokes import StrokesLog, draw_strokes

# Populations of benches: as drawn for the paper's bench, and far from it.
SPREADS = {
    "default spread": Spread(),
    "20 % spread, 5 % friction, double ripple": Spread(ratios=0.2, load_friction=0.05, ripple=0.04),
}
NEAR, FAR = SPREADS
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

# Logs of each population that the whole sensor measures, from a table of time and speed on, or
# method torque.
BENCHES = SPREADS | {"plain benches": SPREADS[NEAR], "hard benches": SPREADS[FAR]}
CHANGED = ("other movements", "two dropped samples")
# Teeth that stay on one flank, or noise in place of the log: nothing tells of their backlash.
NEVER_PARTING = ("vertical axis", "friction above gravity", "noise alone")
BY_TORQUE = ("torque, paper's drive", "torque, other drives")
STROKES = ("torque, strokes", "torque, healthy strokes")
DATASHEET = (
    {"plain benches": 160, "hard benches": 80}
    | dict.fromkeys(KINDS, 8)
    | dict.fromkeys((*CHANGED, "low-passed speed", "faults", "healthy"), 50)
    | {"other drives": 40}
    | dict.fromkeys(BY_TORQUE, 50)
    | dict.fromkeys((*NEVER_PARTING, "small backlashes"), 20)
    | dict(zip(STROKES, (40, 10), strict=True))
)
FAULTS = ("mains hum", "drift", "clipped", "coarse", "another axis")
_HEALTHY_RAD = 2e-5
_STROKES_RAD = (2e-4, 2e-3)
_HEALTHY = ("plain benches", "other movements", "other drives", "faults")
_SLOW_TURN_S = 2.9  # of every sixth other movement
_UNKNOWN = (np.nan, np.nan)
_LOAD_SDS = (0.1, 0.05)  # relative, of the inertia ratio and the gravity that method torque is told

DEVELOPMENT_SEED = 1616
FINAL_SEED = 20263
DATASHEET_SEED = 90817
# What the other methods' intervals are made wide by: population, logs, seed, methods. Then the
# final logs, likewise.
SPREAD_STUDY = (NEAR, range(100), DEVELOPMENT_SEED, COMPARED_METHODS[1:])
FINAL_STUDIES = (
    (NEAR, range(100), FINAL_SEED, COMPARED_METHODS),
    (NEAR, range(100, 400), FINAL_SEED, ("self",)),
    (FAR, range(25), FINAL_SEED, COMPARED_METHODS),
    (FAR, range(25, 150), FINAL_SEED, ("self",)),
    *((kind, range(25), FINAL_SEED, COMPARED_METHODS) for kind in KINDS),
)
NORMAL_95 = 1.96
NOMINAL = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)

MET_BY_SILENCE = ("held_or_refused", "wrong_healthy")

# What "self" is to reach, then the whole sensor: population, column of `summarise_intervals` (or
# RMS error over the bound) or of `summarise_sensor`, sign and limit. Why these: a third of the
# error that a calibration of another joint makes; no more than 30 % above what any method could
# reach; an interval of 95 % that holds within what 400 logs can tell; refusals that leave an owner
# without an answer seldom.
_CRITERIA_FILE = Path(__file__).with_name("criteria.csv")
ACCEPTANCE_CRITERIA = list(read_csv(_CRITERIA_FILE).itertuples(index=False, name=None))
# Steps of the slopes of a Cramer-Rao bound; those of the ratios are shares of them.
_BOUND_STEPS = {"delta_rad": 2e-6, "friction": 1e-3}
_BOUND_SHARE = 1e-2


def _draw_delta_rad(rng: Generator) -> float:
    """Backlash uniform over Table 2's range."""
    return float(rng.uniform(*printed_levels_rad()[[0, -1]]))


def draw_log(population: str, number: int, seed: int) -> KnownLog:
    """Draw a log of a population, one of `SPREADS` or `odd_joints.KINDS`.

    Its bench and Cramer-Rao bound if known.
    """
    rng = np.random.default_rng((seed, [*SPREADS, *KINDS].index(population), number))
    log = _draw_log(population, number, _draw_delta_rad(rng), rng)
    labels = {"population": population, "number": number, "bound_rad": np.nan}
    if bench := log.labels.get("bench"):
        labels |= {
            "bench": bench,
            "bound_rad": bench_bound_rad(bench, log.delta_rad, log.recording),
        }
    return replace(log, labels=labels)


def authors_logs() -> list[KnownLog]:
    """The authors' noisy logs of levels 3 to 11; errors as of `authors.load_noisy`."""
    logs = []
    for number, (realisation, level) in enumerate(product((1, 2), range(3, 12))):
        recording = load_noisy(level, realisation)
        delta = level_delta_rad(level)
        noise = float(np.std(recording.v - load_clean(level).v))
        bound = bench_bound_rad(Bench(identified_joint(), noise, np.nan), delta, recording)
        labels = {"population": "authors' logs", "number": number, "bound_rad": bound}
        logs.append(KnownLog(labels, delta, recording))
    return logs


def bench_bound_rad(bench: Bench, delta_rad: float, recording: Recording) -> float:
    """Cramer-Rao bound [rad] from a log's settled turns, with start, friction and ratios unknown, no prior."""
    joint = bench.joint
    samples = round(joint.turn_period_s / recording.sample_s)
    settled = recording.t.size - samples
    if settled <= 0:
        return np.inf
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


def _answers_to(log: KnownLog, methods: Sequence[str]) -> dict[str, Row]:
    """Answers of methods that have no calibration of the log's joint."""
    found = {"self": self_answer(log.recording)} if "self" in methods else {}
    if others := {name: default_calibration(name) for name in methods if name != "self"}:
        fit = global_fit(log.recording, protocol_for(log.recording))
        found |= benchmark.widened_answers(log.recording, fit, others)
    return found


def measure_logs(logs: Sequence[DrawnLog], methods: Sequence[str]) -> DataFrame:
    """A row of `ROW_COLUMNS` for each log and method; only "self" knows its SD."""
    return benchmark.logs_by_methods(logs, partial(_answers_to, methods=methods)).reindex(
        columns=ROW_COLUMNS
    )


def measure_population(
    population: str, numbers: Sequence[int], seed: int, methods: Sequence[str]
) -> DataFrame:
    """Draw logs of a population and measure them; columns `ROW_COLUMNS`."""
    return measure_logs(
        [partial(draw_log, population, number, seed) for number in numbers], methods
    )


def ranks(rows: DataFrame) -> Series:
    """Rank of the true backlash in each posterior: uniform from 0 to 1 if it is calibrated."""
    answered = rows[~rows["refused"]]
    deviation = (answered["high_rad"] - answered["found_rad"]) / NORMAL_95
    return Series(
        stats.norm.cdf((answered["delta_rad"] - answered["found_rad"]) / deviation), name="rank"
    )


def coverage_curve(rows: DataFrame) -> DataFrame:
    """Share of the answered logs that intervals of each of the `NOMINAL` levels hold, with its interval."""
    off = np.abs(ranks(rows) - 0.5)
    shares = [
        rate_columns(int((off <= level / 2).sum()), off.size, "coverage") for level in NOMINAL
    ]
    return DataFrame(shares).assign(nominal=NOMINAL)


def spread_shares(rows: DataFrame) -> DataFrame:
    """Conformal intervals for `spread_of_joints.csv`: each method's 95 % quantile of |error| / found."""
    answered = rows.query("method != 'self' and not refused")
    share = ((answered["found_rad"] - answered["delta_rad"]) / answered["found_rad"]).abs()

    def quantile(size: Series) -> float:
        level = min(np.ceil(0.95 * (size.size + 1)) / size.size, 1.0)
        return float(f"{np.quantile(size, level, method='higher'):.3f}")

    shares = share.groupby(answered["method"], sort=False).agg(quantile)
    return shares.rename("share_95").reset_index()


def against_criteria(table: DataFrame) -> DataFrame:
    """Compare `ACCEPTANCE_CRITERIA` with what `summarise_intervals` says of "self", or `summarise_sensor`.

    `met_by_silence` tells of which a sensor that never answers would meet, too.
    """
    of_self = table[table["method"] == "self"] if "method" in table else table
    measured = of_self.set_index("population")
    measured = measured.assign(
        rmse_over_bound=measured["rmse_rad"] / measured.get("bound_rad", np.nan)
    )
    rows = []
    for population, figure, sign, limit in ACCEPTANCE_CRITERIA:
        value = measured.get(figure, Series()).get(population, np.nan)
        met = bool(value <= limit if sign == "<=" else value >= limit)
        if not np.isnan(value):
            silence = figure in MET_BY_SILENCE or (figure, sign) == ("none", "<=")
            rows.append((population, figure, f"{sign} {limit:g}", value, met, silence))
    columns = ["population", "figure", "bar", "measured", "met", "met_by_silence"]
    return DataFrame(rows, columns=columns)


def _draw_bench_of(population: str, number: int, rng: Generator) -> Bench:
    """Draw a bench of a population."""
    bench = (
        odd_joints.draw_cascade(rng)
        if "drives" in population
        else draw_bench(rng, BENCHES.get(population))
    )
    if population == "other movements":
        gear_ratio, turn_s = odd_joints.draw_movement(rng)
        return odd_joints.move_bench(bench, gear_ratio, _SLOW_TURN_S if number % 6 == 0 else turn_s)
    joint = bench.joint
    gravity = joint.gravity_torque_nm
    if population == "vertical axis":
        rubbing = rng.uniform(0.02, 0.3) * gravity
        joint = replace(joint, gravity_arm_m=0.0, load_coulomb_nm=rubbing)
    elif population == "friction above gravity":
        joint = replace(joint, load_coulomb_nm=rng.uniform(1.2, 2.0) * gravity)
    elif population == "faults" and FAULTS[number % len(FAULTS)] == "another axis":
        push = rng.uniform(0.02, 0.2) * gravity
        axis = Disturbance(rng.uniform(0.5, 4.0) / joint.gear_ratio, load_torque_nm=push)
        joint = replace(joint, disturbances=(*joint.disturbances, axis))
    return replace(bench, joint=joint)


def _draw_log(population: str, number: int, delta_rad: float, rng: Generator) -> KnownLog:
    """Draw a log whose table is still right, its bench and torque among the labels."""
    if population in KINDS:
        return KnownLog({}, delta_rad, draw_odd_log(population, delta_rad, rng))
    half_as_long = population not in (*BENCHES, *BY_TORQUE) and number % 2 == 1
    while True:
        bench = _draw_bench_of(population, number, rng)
        with suppress(ValueError, ArithmeticError):  # an unstable drive: nobody runs one
            sample_s = SAMPLE_S / 2 if half_as_long else SAMPLE_S
            recording, torque = odd_joints.log_with_torque(bench, delta_rad, rng, sample_s)
            return KnownLog({"bench": bench, "torque": torque}, delta_rad, recording)


def _spoilt(population: str, number: int, log: Recording, rng: Generator) -> DataFrame:
    """Table of a log with what is wrong in its population."""
    v: FloatArray = log.v - log.commanded_speed_rps
    fault = FAULTS[number % len(FAULTS)] if population == "faults" else population
    if fault == "low-passed speed":
        pole = np.exp(-TURN * odd_joints.draw_log_uniform(rng, 40.0, 300.0) * log.sample_s)
        v = signal.lfilter([1 - pole], [1, -pole], v)
    elif fault == "noise alone":
        v = rng.normal(0.0, 0.08, v.size)
    elif fault == "mains hum":
        v = v + rng.uniform(0.03, 0.3) * np.sin(TURN * (50 * log.t + rng.random()))
    elif fault == "drift":
        v = v + rng.uniform(-0.01, 0.01) * log.commanded_speed_rps * log.t / log.t[-1]
    elif fault == "clipped":
        v = np.minimum(v, rng.uniform(0.3, 0.9) * v.max())
    elif fault == "coarse":
        v = np.round(v, 1)
    table = DataFrame({"time [s]": log.t, "speed [rps]": v + log.commanded_speed_rps})
    dropped = rng.choice(
        np.arange(1, len(table) - 1), 2 if fault == "two dropped samples" else 0, replace=False
    )
    return table.drop(dropped).reset_index(drop=True)


def _sensor_answer(log: KnownLog, table: DataFrame) -> Row:
    """Answer of the whole sensor to a log's table."""
    record = log.recording
    form = LogFormat(
        turn_period_s=record.turn_period_s, commanded_speed_rps=record.commanded_speed_rps
    )
    return _whole_answer(table, settings_for(form))


def _whole_answer(table: DataFrame, settings: Settings) -> Row:
    found = examine_or_refuse(table, settings).estimate
    why = found.warnings[0] if found.verdict == "cannot tell" else ""
    ends = found.backlash_interval_rad or _UNKNOWN
    half = np.nan if why else found.backlash_rad or 0.0
    return interval_answer(half, ends, why) | {"verdict": found.verdict}


def _strokes_answer(log: StrokesLog, rng: Generator) -> Row:
    """Answer of the whole sensor to strokes, the load's data off by their SDs."""
    inertia, gravity = np.exp(rng.standard_normal(2) * _LOAD_SDS)
    table = DataFrame({"time [s]": log.t, "speed [rps]": log.v, "torque": log.torque})
    settings = settings_for(
        LogFormat(gear_ratio=log.gear_ratio, torque="torque"),
        inertia_ratio=log.inertia_ratio * inertia,
        gravity_per_s2=log.gravity_per_s2 * gravity,
    )
    return _whole_answer(table, settings)


def _torque_answer(log: KnownLog, rng: Generator) -> Row:
    """Answer of method torque, the load's data off by their SDs."""
    ratios = log.labels["bench"].joint.ratios
    inertia, gravity = np.exp(rng.standard_normal(2) * _LOAD_SDS)
    load = LoadData(
        ratios["inertia_ratio"] * inertia, ratios["gravity_per_s2"] * gravity, *_LOAD_SDS
    )
    try:
        fit = fit_torque(log.recording, log.labels["torque"], load)
    except ValueError as error:
        return interval_answer(np.nan, (np.nan, np.nan), str(error)) | {"verdict": "backlash"}
    answer = interval_answer(fit.delta_rad, fit.interval_rad, fit.refusal_reason)
    return answer | {"verdict": "no backlash" if fit.is_none else "backlash"}


def _sensor_row(population: str, number: int, seed: int) -> Row:
    """Draw a log of `DATASHEET` and measure it."""
    rng = np.random.default_rng((seed, list(DATASHEET).index(population), number))
    delta = _draw_delta_rad(rng)
    if population == "small backlashes":
        delta = rng.uniform(2e-5, 3e-4)
    if population in STROKES:
        delta = odd_joints.draw_log_uniform(rng, *_STROKES_RAD) if population == STROKES[0] else 0.0
    kind, place = population, number
    if population == "healthy":
        delta = rng.choice([0.0, _HEALTHY_RAD]) * rng.random()
        place, which = divmod(number, len(_HEALTHY))
        kind = _HEALTHY[which]
    known = {"population": population, "number": number, "delta_rad": delta}
    if population in STROKES:
        return known | _strokes_answer(draw_strokes(rng, delta), rng)
    log = _draw_log(kind, place, delta, rng)
    if population in BY_TORQUE:
        return known | _torque_answer(log, rng)
    return known | _sensor_answer(log, _spoilt(kind, place, log.recording, rng))


def measure_sensor(sizes: Mapping[str, int], seed: int) -> DataFrame:
    """Draw logs of populations of `DATASHEET`, and measure each from its table on; a row each."""
    logs = [
        (population, number, seed) for population, size in sizes.items() for number in range(size)
    ]
    return DataFrame(in_parallel(_sensor_row, logs, "logs"))


def summarise_sensor(rows: DataFrame) -> DataFrame:
    """Of each population and of all by speed: logs answered; covered among them.

    Healthy joints called backlash.
    """
    by_speed = rows[~rows["population"].isin([*BY_TORQUE, *STROKES])].assign(
        population="all by speed"
    )
    table = []
    for population, part in concat([rows, by_speed]).groupby("population", sort=False):
        answered = part[~part["refused"]]
        wrong = (answered["delta_rad"] <= _HEALTHY_RAD) & (answered["verdict"] == "backlash")
        row = {
            "population": population,
            "logs": len(part),
            **rate_columns(len(answered), len(part), "answered"),
            **rate_columns(hold_truth(answered), len(answered), "covered"),
            "rmse_rad": benchmark.root_mean_square(answered["found_rad"] - answered["delta_rad"]),
            "wrong_healthy": int(wrong.sum()),
            "none": float((part["verdict"] == "no backlash").mean()),
            "held_or_refused": (hold_truth(answered) + part["refused"].sum()) / len(part),
        }
        table.append(row)
    return DataFrame(table)
