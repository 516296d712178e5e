"""The sensor's datasheet: what it says of logs of simulated joints, by what their owners have.

Turns with the motor's torque and strokes come from code that shares nothing with the sensor's fits
(`benches`, `strokes`), and so do turns under other drives; the speed of the paper's kind of drive
comes from the simulator that method self fits, with parameters drawn anew.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.random import Generator
from pandas import DataFrame, Series, concat
from scipy import signal

from backlash.fleet import examine_or_refuse
from backlash.reading.columns import LogFormat
from backlash.settings import Settings, settings_for
from replication.arrays import FloatArray
from replication.characteristic import printed_levels_rad
from replication.parallel import in_parallel
from replication.records import Recording
from replication.simulator.parameters import TURN, Disturbance
from replication.standins import SAMPLE_S, Bench, draw_bench
from studies import benchmark, odd_joints
from studies.benches import draw_turns
from studies.benchmark import Row, describe_missed, hold_truth, interval_answer, root_mean_square
from studies.odd_joints import KINDS, draw_log_uniform, draw_odd_log
from studies.population import FAR, NEAR
from studies.population import SPREADS as DRAWN_SPREADS
from studies.rates import rate_columns
from studies.strokes import draw_strokes

SEED = 71019
CRITERIA = Path(__file__).with_name("datasheet_criteria.csv")

# Logs of each population. Every sixth joint of turns with torque has no backlash.
FRICTIONS = {
    f"turns with torque, friction {100 * share:.0f} % of gravity": share
    for share in (0.0, 0.05, 0.1, 0.15, 0.25, 0.5)
}
STROKES = ("strokes with torque", "strokes with torque, healthy")
TURNS, ALL_BY_SPEED = "turns with torque, all", "speed alone, all"
ABOVE_GRAVITY = "friction above gravity"
SPREADS = {"plain benches": DRAWN_SPREADS[NEAR], "hard benches": DRAWN_SPREADS[FAR]}
BY_SPEED = {
    "plain benches": 120,
    "hard benches": 60,
    "other drives": 30,
    "outside the model": 20,
    "other movements": 40,
    "two dropped samples": 20,
    "low-passed speed": 40,
    "faults": 50,
    "small backlashes": 20,
    "healthy": 40,
    "vertical axis": 20,
    ABOVE_GRAVITY: 20,
    "noise alone": 20,
}
SIZES = dict.fromkeys(FRICTIONS, 24) | dict(zip(STROKES, (40, 10), strict=True)) | BY_SPEED

FAULTS = ("mains hum", "drift", "clipped", "coarse", "another axis")
_HEALTHY_EVERY = 6
_HEALTHY_KINDS = ("plain benches", "other movements", "faults")
_HEALTHY_RAD = 2e-5  # a joint of less has no backlash that matters
_NEGLIGIBLE_RAD = 5e-5  # less than this is told "no backlash"
_BACKLASH_RAD = (2e-4, 2e-3)
_SMALL_RAD = (2e-5, 3e-4)
_SLOW_TURN_S = 2.9  # of every sixth other movement
_LOAD_SDS = (0.1, 0.05)  # relative, by which inertia ratio and gravity are misjudged
_UNKNOWN = (np.nan, np.nan)


def measure_sensor(sizes: Mapping[str, int], seed: int) -> DataFrame:
    """Draw logs of populations of `SIZES`, and measure each as a table; a row each."""
    logs = [
        (population, number, seed) for population, size in sizes.items() for number in range(size)
    ]
    return DataFrame(in_parallel(_measure_log, logs, "logs"))


def _measure_log(population: str, number: int, seed: int) -> Row:
    """Draw a log and ask the sensor."""
    rng = np.random.default_rng((seed, list(SIZES).index(population), number))
    delta = _draw_backlash(population, number, rng)
    labels = {"population": population, "number": number, "delta_rad": delta}
    if population in BY_SPEED:
        return labels | _answer_speed(population, number, delta, rng)
    friction = FRICTIONS.get(population)
    log = draw_strokes(rng, delta) if friction is None else draw_turns(rng, delta, friction)
    inertia, gravity = np.exp(rng.standard_normal(2) * _LOAD_SDS)
    table = DataFrame({"time [s]": log.t, "speed [rps]": log.v, "torque": log.torque})
    settings = settings_for(
        LogFormat(gear_ratio=log.gear_ratio, torque="torque"),
        inertia_ratio=log.inertia_ratio * inertia,
        gravity_per_s2=log.gravity_per_s2 * gravity,
    )
    return labels | _answer(table, settings)


def _draw_backlash(population: str, number: int, rng: Generator) -> float:
    """Draw the backlash [rad] of a log."""
    if population == "healthy":
        return float(rng.choice([0.0, _HEALTHY_RAD]) * rng.random())
    if population == STROKES[1]:
        return 0.0
    if population in FRICTIONS and number % _HEALTHY_EVERY == _HEALTHY_EVERY - 1:
        return 0.0
    if population in (*FRICTIONS, STROKES[0]):
        return draw_log_uniform(rng, *_BACKLASH_RAD)
    if population == "small backlashes":
        return float(rng.uniform(*_SMALL_RAD))
    return float(rng.uniform(*printed_levels_rad()[[0, -1]]))


def _answer(table: DataFrame, settings: Settings) -> Row:
    """Columns of the whole sensor's answer."""
    estimate = examine_or_refuse(table, settings).estimate
    reason = estimate.warnings[0] if estimate.verdict == "cannot tell" else ""
    half = np.nan if reason else estimate.backlash_rad or 0.0
    answer = interval_answer(half, estimate.backlash_interval_rad or _UNKNOWN, reason)
    return answer | {"verdict": estimate.verdict}


def _answer_speed(population: str, number: int, delta_rad: float, rng: Generator) -> Row:
    """Answer to a log of the speed alone."""
    kind, place = population, number
    if population == "healthy":
        place, which = divmod(number, len(_HEALTHY_KINDS))
        kind = _HEALTHY_KINDS[which]
    if kind == "other drives":
        log = draw_turns(rng, delta_rad)
        table = DataFrame({"time [s]": log.t, "speed [rps]": log.v})
        return _answer(table, settings_for(LogFormat(gear_ratio=log.gear_ratio)))
    recording = _draw_recording(kind, place, delta_rad, rng)
    movement = LogFormat(
        turn_period_s=recording.turn_period_s, commanded_speed_rps=recording.commanded_speed_rps
    )
    return _answer(_spoil(kind, place, recording, rng), settings_for(movement))


def _draw_recording(population: str, number: int, delta_rad: float, rng: Generator) -> Recording:
    """Draw the record of a joint of a population, before anything happens to its log."""
    if population == "outside the model":
        return draw_odd_log(KINDS[number % len(KINDS)], delta_rad, rng)
    half_as_long = population not in SPREADS and number % 2 == 1
    while True:
        bench = _draw_bench_of(population, number, rng)
        with suppress(ValueError, ArithmeticError):  # an unstable drive: nobody runs one
            sample_s = SAMPLE_S / 2 if half_as_long else SAMPLE_S
            return odd_joints.log_with_torque(bench, delta_rad, rng, sample_s)[0]


def _draw_bench_of(population: str, number: int, rng: Generator) -> Bench:
    """Draw a bench of a population."""
    bench = draw_bench(rng, SPREADS.get(population))
    if population == "other movements":
        gear_ratio, turn_s = odd_joints.draw_movement(rng)
        return odd_joints.move_bench(bench, gear_ratio, _SLOW_TURN_S if number % 6 == 0 else turn_s)
    joint = bench.joint
    gravity = joint.gravity_torque_nm
    if population == "vertical axis":
        rubbing = rng.uniform(0.02, 0.3) * gravity
        joint = replace(joint, gravity_arm_m=0.0, load_coulomb_nm=rubbing)
    elif population == ABOVE_GRAVITY:
        joint = replace(joint, load_coulomb_nm=rng.uniform(1.2, 2.0) * gravity)
    elif population == "faults" and FAULTS[number % len(FAULTS)] == "another axis":
        push = rng.uniform(0.02, 0.2) * gravity
        axis = Disturbance(rng.uniform(0.5, 4.0) / joint.gear_ratio, load_torque_nm=push)
        joint = replace(joint, disturbances=(*joint.disturbances, axis))
    return replace(bench, joint=joint)


def _spoil(population: str, number: int, log: Recording, rng: Generator) -> DataFrame:
    """Table of a log with what is wrong in its population."""
    v: FloatArray = log.v - log.commanded_speed_rps
    fault = FAULTS[number % len(FAULTS)] if population == "faults" else population
    if fault == "low-passed speed":
        pole = np.exp(-TURN * draw_log_uniform(rng, 40.0, 300.0) * log.sample_s)
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
    lost = 2 if fault == "two dropped samples" else 0
    dropped = rng.choice(np.arange(1, len(table) - 1), lost, replace=False)
    return table.drop(dropped).reset_index(drop=True)


def summarise_sensor(rows: DataFrame) -> DataFrame:
    """Of each population, of all turns with torque and of all by speed: shares with 95 % intervals.

    `answered` among joints of more than 0.2 mrad, or among all where a population has none;
    `covered` among the answered; `false_alarm` among healthy joints that are told a backlash;
    `false_all_clear` among joints whose backlash matters that are told "no backlash".
    """
    turns = rows[rows["population"].isin(FRICTIONS)].assign(population=TURNS)
    speed = rows[rows["population"].isin(BY_SPEED)].assign(population=ALL_BY_SPEED)
    groups = concat([rows, turns, speed]).groupby("population", sort=False)
    return DataFrame([_summary(population, part) for population, part in groups])


def _summary(population: str, part: DataFrame) -> Row:
    """A row of `summarise_sensor`."""
    answered = part[~part["refused"]]
    large = part[part["delta_rad"] >= _BACKLASH_RAD[0]]
    asked = part if large.empty else large
    healthy = part[part["delta_rad"] <= _HEALTHY_RAD]
    ill = part[part["delta_rad"] > _NEGLIGIBLE_RAD]
    alarms = int((healthy["verdict"] == "backlash").sum())
    all_clears = int((ill["verdict"] == "no backlash").sum())
    return {
        "population": population,
        "logs": len(part),
        "asked": len(asked),
        **rate_columns(int((~asked["refused"]).sum()), len(asked), "answered"),
        "answers": len(answered),
        **rate_columns(hold_truth(answered), len(answered), "covered"),
        "rmse_rad": root_mean_square(answered["found_rad"] - answered["delta_rad"]),
        "healthy": len(healthy),
        "false_alarms": alarms,
        **rate_columns(alarms, len(healthy), "false_alarm"),
        "ill": len(ill),
        "false_all_clears": all_clears,
        **rate_columns(all_clears, len(ill), "false_all_clear"),
    }


def against_criteria(sheet: DataFrame) -> DataFrame:
    """Compare `datasheet_criteria.csv` with a datasheet; none of these would be met by a sensor that never answers."""
    return benchmark.against_criteria(sheet, CRITERIA)


_IN_SENTENCES = {
    "turns": TURNS,
    "strokes": STROKES[0],
    "plain": "plain benches",
    "hard": "hard benches",
    "other_drives": "other drives",
}


def datasheet_facts(sheet: DataFrame, rounds: DataFrame) -> dict[str, str]:
    """What sentences say of a datasheet and of its rounds."""
    rows = sheet.set_index("population")
    drawn, above = rows.loc[list(SIZES)].sum(), rows.loc[ABOVE_GRAVITY]
    bars = against_criteria(sheet)
    met = rounds["met"].astype(str) + " of " + rounds["criteria"].astype(str)
    return (
        {
            f"sheet_{name}": _describe(rows.loc[population])
            for name, population in _IN_SENTENCES.items()
        }
        | {f"sheet_round_{number}": text for number, text in enumerate(met[:-1], 1)}
        | {
            "sheet_friction": f"{100 * max(FRICTIONS.values()):.0f} %",
            "sheet_met": f"{bars['met'].sum()} of {len(bars)}",
            "sheet_missed": describe_missed(bars),
            "sheet_all_clears_torque": _false_all_clears(rows.loc[[TURNS, STROKES[0]]]),
            "sheet_all_clears_speed": _false_all_clears(
                rows.loc[[name for name in BY_SPEED if name != ABOVE_GRAVITY]]
            ),
            "sheet_above_gravity": f"{above['false_all_clears']:.0f} of {above['ill']:.0f}",
            "sheet_alarms": f"{drawn['false_alarms']:.0f} of {drawn['healthy']:.0f}",
        }
    )


def _describe(row: Series) -> str:
    """Answered and covered logs of a population, with 95 % intervals of the shares."""
    text = (
        f"{row['answered'] * row['asked']:.0f} of {row['asked']:.0f} answered "
        f"({100 * row['answered_low']:.0f} to {100 * row['answered_high']:.0f} %)"
    )
    if not row["answers"]:
        return text
    held = row["covered"] * row["answers"]
    return (
        f"{text}, {held:.0f} of {row['answers']:.0f} intervals hold the true backlash "
        f"({100 * row['covered_low']:.0f} to {100 * row['covered_high']:.0f} %)"
    )


def _false_all_clears(rows: DataFrame) -> str:
    """How many joints with backlash were told to have none."""
    wrong, ill = int(rows["false_all_clears"].sum()), int(rows["ill"].sum())
    high = rate_columns(wrong, ill)["rate_high"]
    return f"{wrong} of {ill} (95 % interval up to {100 * high:.1f} %)"
