"""Stand-ins for the logs of Tables 3 and 4, which were never published: joints drawn around the identified one.

A bench is the identified joint with other parameters, friction, periodic disturbances, and a log
that comes from its encoder; a plant robot is axis 4 of an arm whose other joints shake it. Every
spread is an assumption; the paper gives none. If their logs are ever published, one function beside
`records.read_clean`, from a log's file to a `Recording`, takes the place of `encoder_log`: nothing
that comes after asks where a record is from.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from replication import characteristic, published
from replication.parallel import in_parallel
from replication.records import Recording
from replication.simulator.parameters import (
    TURN,
    Disturbance,
    JointParameters,
    changed_joint,
    identified_joint,
)
from replication.simulator.recordings import read_encoder
from replication.simulator.simulate import SimulatedJoint, simulate
from replication.table2 import AUTHORS_SETTINGS, repeated_fits, summarise_runs

SAMPLE_S = 2e-3
TURNS = 12  # of a log
FINE_BITS = 52  # of an encoder whose grid does not show
VARIED_RATIOS = (
    "stiffness_per_s2",
    "gravity_per_s2",
    "inertia_ratio",
    "speed_gain_per_s",
    "integral_gain_per_s2",
)

# Turns of the motor belt per motor turn: a belt of two and a half to five pulleys' circumference.
BELT_ORDER = (0.2, 0.4)

# Such as `backlash.fitting.global_fit`, which the paper does not have.
FitRecord = Callable[[Recording], Any]


@dataclass(frozen=True)
class Spread:
    """How far a bench may be from the identified joint.

    Uniform from zero where nothing else is said.
    """

    ratios: float = 0.05  # relative SD (log-normal) of each of `VARIED_RATIOS`
    # Largest Coulomb, and largest viscous at the commanded speed, over m g r.
    load_friction: float = 0.005
    motor_friction: float = 0.5  # the same on the motor, over m g r / N
    # Largest torque ripple at one and at six periods a motor turn, over m g r / N.
    ripple: float = 0.02
    belt_rad: float = 1e-5  # largest transmission error of the belt's turn, load side
    gear_rad: float = 1e-4  # largest transmission error of the load's turn
    noise_rps: float = 0.08  # largest SD of the measured speed's noise; the smallest is half of it
    dial_gauge_rad: float = 3e-5  # SD of the static measurement of the backlash: 0.01 mm at 0.3 m


@dataclass(frozen=True)
class Bench:
    """A joint with the SDs of its log's white noise and of a static reading of its backlash."""

    joint: JointParameters
    noise_rps: float
    dial_gauge_rad: float


def draw_bench(rng: np.random.Generator, spread: Spread | None = None) -> Bench:
    """Draw a bench around the identified joint.

    Its drive sees the encoder's 19 bits and differences them; it has turned once when its log
    begins.
    """
    spread = spread or Spread()
    joint = identified_joint()
    factors = np.exp(spread.ratios * rng.standard_normal(len(VARIED_RATIOS)))
    joint = changed_joint(joint, dict(zip(VARIED_RATIOS, factors, strict=True)))
    gravity = joint.gravity_torque_nm
    load_speed = joint.commanded_speed_rad_per_s / joint.gear_ratio
    coulomb, viscous = gravity * spread.load_friction * rng.random(2)
    motor_coulomb, motor_viscous = (
        gravity / joint.gear_ratio * spread.motor_friction * rng.random(2)
    )
    joint = replace(
        joint,
        load_coulomb_nm=coulomb,
        load_viscous_nms_per_rad=viscous / load_speed,
        motor_coulomb_nm=motor_coulomb,
        motor_viscous_nms_per_rad=motor_viscous / joint.commanded_speed_rad_per_s,
        encoder_bits=int(published.value("text.encoder_bits")),
        speed_by_differencing=True,
        lead_s=joint.turn_period_s,
        disturbances=_draw_disturbances(joint, spread, rng),
    )
    return Bench(joint, spread.noise_rps * rng.uniform(0.5, 1.0), spread.dial_gauge_rad)


def _draw_disturbances(
    joint: JointParameters, spread: Spread, rng: np.random.Generator
) -> tuple[Disturbance, ...]:
    """Torque ripple at one and six periods a motor turn, eccentricity of the belt's and of the load's turn."""
    ripple = spread.ripple * joint.gravity_torque_nm / joint.gear_ratio
    once, six_times, belt, gear = rng.random(4)
    phases = TURN * rng.random(4)
    return (
        Disturbance(1.0, motor_torque_nm=ripple * once, phase_rad=phases[0]),
        Disturbance(6.0, motor_torque_nm=ripple * six_times, phase_rad=phases[1]),
        Disturbance(
            rng.uniform(*BELT_ORDER),
            transmission_error_rad=spread.belt_rad * belt,
            phase_rad=phases[2],
        ),
        Disturbance(
            1 / joint.gear_ratio, transmission_error_rad=spread.gear_rad * gear, phase_rad=phases[3]
        ),
    )


def run_and_log(
    bench: Bench, delta_rad: float, rng: np.random.Generator, sample_s: float = SAMPLE_S
) -> tuple[SimulatedJoint, Recording]:
    """Run a bench for twelve turns from a random angle, and log its encoder's position, differenced, with noise."""
    joint = replace(bench.joint, start_angle_rad=float(rng.uniform(0, TURN)))
    run = simulate(joint, delta_rad, duration_s=TURNS * joint.turn_period_s, sample_s=sample_s)
    source = f"simulated encoder log, {delta_rad:g} rad"
    log = read_encoder(
        joint, run.time_s, run.motor_position_rad, joint.encoder_bits or FINE_BITS, source
    )
    noise = rng.normal(0.0, bench.noise_rps, log.v.size)
    return run, replace(log, v=log.v + noise)


def encoder_log(bench: Bench, delta_rad: float, rng: np.random.Generator) -> Recording:
    """Log of `run_and_log`, sampled every 2 ms."""
    return run_and_log(bench, delta_rad, rng)[1]


def _log_and_fit(
    fit_record: FitRecord, bench: Bench, delta_rad: float, seed: Sequence[int]
) -> dict[str, float]:
    recording = encoder_log(bench, delta_rad, np.random.default_rng(seed))
    fit = fit_record(recording)
    _, t0, _, omega, *_ = fit.X
    low, high = fit.amplitude_interval_rps
    return {
        "delta_rad": delta_rad,
        "A_rps": fit.amplitude_rps,
        "low_rps": low,
        "high_rps": high,
        "frequency_hz": omega / TURN,
        "t0_s": t0,
        "rmse_rps": fit.rmse,
        "sd_rps": recording.v.std(),
    }


def fitted_logs(
    fit_record: FitRecord, cases: Sequence[tuple[Bench, float]], seeds: Sequence[Sequence[int]]
) -> pd.DataFrame:
    """Log each case and fit it, on all cores."""
    calls = [(fit_record, *case, seed) for case, seed in zip(cases, seeds, strict=True)]
    return pd.DataFrame(in_parallel(_log_and_fit, calls, "logs"))


# ------------------------------------------------------------ Table 3, and a population of benches


# Table 3's cells, by their names among the printed ones, and our columns.
TABLE3_COLUMNS = {
    "known": "known_A_rps",
    "mean": "mean_A_rps",
    "sd": "sd_A_rps",
    "relative_error": "relative_error_percent",
}


def table3_records(
    bench: Bench, deltas_rad: Sequence[float], seed: int
) -> list[tuple[dict, Recording]]:
    """Measure and log the bench in each state of wear."""
    rng = np.random.default_rng(seed)
    records = []
    for row, delta in enumerate(deltas_rad, start=1):
        reading = delta + rng.normal(0.0, bench.dial_gauge_rad)
        known = characteristic.known_amplitude_rps(reading)
        key = {"row": row, "delta_rad": delta, "reading_rad": reading, "known_A_rps": known}
        records.append((key, encoder_log(bench, delta, rng)))
    return records


def fit_table3(bench: Bench, deltas_rad: Sequence[float], seed: int, repeats: int) -> pd.DataFrame:
    """Table 3 of a bench: the paper's search on its log in each state of wear, from so many seeds."""
    records = table3_records(bench, deltas_rad, seed)
    label = "Table 3, stand-in bench"
    return table3(repeated_fits(records, [AUTHORS_SETTINGS], range(1, repeats + 1), label))


def table3(runs: pd.DataFrame) -> pd.DataFrame:
    """Condense the runs on the bench's records into Table 3, the printed columns beside."""
    keys = ["source", "row", "delta_rad", "reading_rad", "known_A_rps"]
    printed = {
        f"printed_{column}": published.column("Table 3", cell)
        for cell, column in TABLE3_COLUMNS.items()
    }
    return summarise_runs(runs.assign(source="stand-in"), keys).assign(**printed)


def table3_cells(table: pd.DataFrame) -> dict[str, float]:
    """Means and SDs of Table 3 by cell id, from `table3`."""
    rows = table.set_index("row")
    return {
        f"table3.row{row:02d}.{cell}": rows.at[row, TABLE3_COLUMNS[cell]]
        for row in rows.index
        for cell in ("mean", "sd")
    }


def bench_population(
    fit_record: FitRecord,
    benches: int,
    deltas_rad: Sequence[float],
    seed: int,
    spread: Spread | None = None,
) -> pd.DataFrame:
    """Fit the logs of many benches in each state: what the spread alone makes of Table 3."""
    drawn = [draw_bench(np.random.default_rng((seed, number)), spread) for number in range(benches)]
    cases = [(bench, delta) for bench in drawn for delta in deltas_rad]
    table = fitted_logs(fit_record, cases, [(seed, benches + index) for index in range(len(cases))])
    known = np.array([characteristic.known_amplitude_rps(delta) for delta in table["delta_rad"]])
    table.insert(0, "bench", np.repeat(np.arange(benches), len(deltas_rad)))
    return table.assign(error_percent=100 * (table["A_rps"] / known - 1))


# ----------------------------------------------------------------------------------------- Table 4


KINDS = ("healthy", "excessive")


@dataclass(frozen=True)
class RobotSpread:
    """What a plant robot's axis 4 has besides a bench's spread; uniform between limits."""

    bench: Spread = field(default_factory=Spread)
    gravity: tuple[float, float] = (
        0.3,
        0.8,
    )  # torque over the bench's: axis 4 carries only the wrist and its tool
    couplings: int = 3  # vibrations of the other joints that reach the axis as torques on its load
    coupling: float = 0.03  # largest amplitude of each, over the axis's own m g r
    coupling_hz: tuple[float, float] = (2.5, 40.0)
    healthy_rad: tuple[float, float] = (0.0, 1e-4)
    excessive_rad: tuple[float, float] = (2e-4, 5e-4)


def draw_robot(rng: np.random.Generator, spread: RobotSpread, kind: str) -> tuple[Bench, float]:
    """Draw the axis 4 of a robot, and its backlash."""
    bench = draw_bench(rng, spread.bench)
    joint = replace(
        bench.joint, load_mass_kg=bench.joint.load_mass_kg * rng.uniform(*spread.gravity)
    )
    orders = rng.uniform(*spread.coupling_hz, spread.couplings) / joint.commanded_speed_rps
    torques = spread.coupling * joint.gravity_torque_nm * rng.random(spread.couplings)
    couplings = tuple(
        Disturbance(float(order), load_torque_nm=float(torque), phase_rad=float(phase))
        for order, torque, phase in zip(
            orders, torques, TURN * rng.random(spread.couplings), strict=True
        )
    )
    backlash = rng.uniform(*(spread.healthy_rad if kind == "healthy" else spread.excessive_rad))
    return replace(
        bench, joint=replace(joint, disturbances=(*joint.disturbances, *couplings))
    ), float(backlash)


def table4_records(spread: RobotSpread, seed: int) -> list[tuple[dict, Recording]]:
    """Log robots A and B: the first healthy and the first excessive one of a seed."""
    records = []
    for robot, kind in zip("AB", KINDS, strict=True):
        rng = np.random.default_rng((seed, KINDS.index(kind), 0))
        axis, delta = draw_robot(rng, spread, kind)
        records.append(
            ({"robot": robot, "kind": kind, "delta_rad": delta}, encoder_log(axis, delta, rng))
        )
    return records


def table4(runs: pd.DataFrame) -> pd.DataFrame:
    """Condense the runs on the two robots into Table 4, the printed columns beside."""
    keys = ["source", "robot", "kind", "delta_rad", "theoretical_A_rps"]
    signless = runs.assign(source="stand-in", theoretical_A_rps=0.0, A_rps=runs["A_rps"].abs())
    table = summarise_runs(signless, keys).drop(
        columns=["theoretical_A_rps", "relative_error_percent"]
    )
    return table.assign(
        **{f"printed_{name}_A_rps": published.column("Table 4", name) for name in ("mean", "sd")}
    )


def table4_cells(table: pd.DataFrame) -> dict[str, float]:
    """Values of Table 4's cells by id, from `table4`."""
    rows = enumerate(table.to_dict("records"), start=1)
    return {
        f"table4.row{row:02d}.{name}": values[f"{name}_A_rps"]
        for row, values in rows
        for name in ("mean", "sd")
    }


def robot_population(
    fit_record: FitRecord, each: int, spread: RobotSpread, seed: int
) -> pd.DataFrame:
    """Fit the logs of many robots of each kind; the first of each are robots A and B."""
    kinds = [kind for kind in KINDS for _ in range(each)]
    seeds = [(seed, KINDS.index(kind), number) for kind in KINDS for number in range(each)]
    cases = [
        draw_robot(np.random.default_rng(stream), spread, kind)
        for stream, kind in zip(seeds, kinds, strict=True)
    ]
    table = fitted_logs(fit_record, cases, [(*stream, 1) for stream in seeds])
    table.insert(0, "kind", kinds)
    return table


def disturbed_healthy_joint(
    fit_record: FitRecord,
    frequencies_hz: Sequence[float],
    torque_shares: Sequence[float],
    gravity: float,
    noise_rps: float,
    seed: int,
) -> pd.DataFrame:
    """Fit a joint without backlash that one other joint shakes, over the disturbance's frequency and amplitude."""
    identified = identified_joint()
    joint = replace(identified, load_mass_kg=gravity * identified.load_mass_kg)
    grid = [
        (0.0, 0.0),
        *((frequency, share) for share in torque_shares for frequency in frequencies_hz),
    ]
    cases = [
        (Bench(_shaken(joint, frequency, share), noise_rps, 0.0), 0.0) for frequency, share in grid
    ]
    table = fitted_logs(fit_record, cases, [(seed,)] * len(cases))
    heard = np.sqrt(2 * np.maximum(table["sd_rps"] ** 2 - table["sd_rps"].iloc[0] ** 2, 0.0))
    frequencies, shares = np.array(grid).T
    table = table.assign(turns_used=12 - table["t0_s"] / joint.turn_period_s)
    head = pd.DataFrame(
        {"disturbance_hz": frequencies, "torque_share": shares, "disturbance_rps": heard}
    )
    return pd.concat([head, table], axis=1).iloc[1:].reset_index(drop=True)


def _shaken(joint: JointParameters, frequency_hz: float, torque_share: float) -> JointParameters:
    """Add one sinusoidal torque on the load to a joint; none for a share of zero."""
    if torque_share == 0:
        return joint
    torque = torque_share * joint.gravity_torque_nm
    wave = Disturbance(frequency_hz / joint.commanded_speed_rps, load_torque_nm=torque)
    return replace(joint, disturbances=(*joint.disturbances, wave))
