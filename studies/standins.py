"""Stand-ins for the logs of Tables 3 and 4, which were never published: joints drawn around the identified one.

A bench is the identified joint with other ratios, friction, periodic disturbances, and a log that comes from its
encoder; a plant robot is axis 4 of an arm whose other joints shake it. The paper gives none of these: every spread is
our assumption, and what these logs give tests nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed
from numpy.random import Generator, default_rng
from pandas import DataFrame

from replication import characteristic, published
from replication.best_fit import best_fit
from replication.joint import Joint, Wave, change, identified_joint, simulate
from replication.records import Recording
from replication.signature import TURN, FloatArray
from replication.table2 import NOTEBOOK, repeated_fits, summarise_runs

TURNS = 12  # of a log
VARIED_RATIOS = ("K_s/J_l", "G/J_l", "J_l/(N^2 J_m)", "K_p/J_m", "K_i/J_m")
DIAL_GAUGE_RAD = 3e-5  # SD of a static measure of the backlash: 0.01 mm at 0.3 m
# Belt turns in a motor turn: a belt as long as 2.5 to 5 circumferences of its pulley.
BELT_ORDER = (0.2, 0.4)


@dataclass(frozen=True)
class Spread:
    """How far a bench may be from the identified joint: uniform from zero where nothing else is said."""

    ratios: float = 0.05  # relative SD (log-normal) of each of `VARIED_RATIOS`
    # Largest Coulomb, and largest viscous at the commanded speed: on the load over G, on the motor over G / N.
    load_friction: float = 0.005
    motor_friction: float = 0.5
    ripple: float = 0.02  # largest torque ripple at one and at six periods a motor turn, over G / N
    belt_rad: float = 1e-5  # largest transmission error of the belt's turn, load side
    gear_rad: float = 1e-4  # largest transmission error of the load's turn
    noise_rps: float = 0.08  # largest SD of the measured speed's noise; the smallest is half of it


class Bench(NamedTuple):
    """A joint with the SD of its log's white noise."""

    joint: Joint
    noise_rps: float


def transmission_error(joint: Joint, order: float, phase: float, error_rad: float) -> Wave:
    """Disturbance of an eccentric pulley or gear, theta_m / N - theta_l - e sin(order Omega t + phase) in the coupling.

    For the load's position plus the error it is a torque J_l times the error's second derivative; that gravity's angle
    is off by the error is left out.
    """
    return Wave(order, phase, on_load=-joint.J_l * error_rad * (order * joint.Omega) ** 2)


def draw_bench(rng: Generator, spread: Spread | None = None) -> Bench:
    """Draw a bench: its drive sees the encoder's 19 bits, and it has turned once when its log begins."""
    spread = spread or Spread()
    factors = np.exp(spread.ratios * rng.standard_normal(len(VARIED_RATIOS)))
    joint = change(identified_joint(), dict(zip(VARIED_RATIOS, factors.tolist(), strict=True)))
    on_motor = joint.G / joint.N
    coulomb, viscous = joint.G * spread.load_friction * rng.random(2)
    motor_coulomb, motor_viscous = on_motor * spread.motor_friction * rng.random(2)
    ripple, sixth, belt, gear = rng.random(4)
    phases = TURN * rng.random(4)
    belt_order = rng.uniform(*BELT_ORDER)
    waves = (
        Wave(1.0, phases[0], on_motor=on_motor * spread.ripple * ripple),
        Wave(6.0, phases[1], on_motor=on_motor * spread.ripple * sixth),
        transmission_error(joint, belt_order, phases[2], spread.belt_rad * belt),
        transmission_error(joint, 1 / joint.N, phases[3], spread.gear_rad * gear),
    )
    joint = joint._replace(
        load_coulomb=coulomb,
        load_viscous=viscous / (joint.Omega / joint.N),
        motor_coulomb=motor_coulomb,
        motor_viscous=motor_viscous / joint.Omega,
        encoder_step=characteristic.encoder_step_rad(),
        lead=joint.turn_period,
        waves=waves,
    )
    return Bench(joint, spread.noise_rps * rng.uniform(0.5, 1.0))


def clean_record(joint: Joint, delta: float, turns: int = TURNS) -> Recording:
    """Record of the motor's true speed, as the authors' noise-free records are."""
    run = simulate(joint, delta, turns * joint.turn_period, step=5e-5)
    source = f"simulated joint, {delta:g} rad"
    return Recording(run.t, run.v, joint.Omega / TURN, joint.turn_period, source)


def read_encoder(
    joint: Joint, t: FloatArray, theta_m: FloatArray, step: float, source: str
) -> Recording:
    """Record of the speed that is differenced from an encoder's positions, rounded down; a sample shorter."""
    positions = np.floor(theta_m / step) * step if step > 0 else theta_m
    v = np.diff(positions) / np.diff(t) / TURN
    return Recording(t[:-1], v, joint.Omega / TURN, joint.turn_period, source)


def encoder_log(bench: Bench, delta: float, rng: Generator) -> Recording:
    """Run a bench for twelve turns from a random angle, and log its encoder's position, differenced, with noise."""
    joint = bench.joint._replace(start_angle=float(rng.uniform(0, TURN)))
    run = simulate(joint, delta, TURNS * joint.turn_period)
    source = f"simulated encoder log, {delta:g} rad"
    log = read_encoder(joint, run.t, run.theta_m, joint.encoder_step, source)
    return replace(log, v=log.v + rng.normal(0.0, bench.noise_rps, log.v.size))


# -------------------------------------------------------------------------------------------- many logs


def fit_logs(cases: Sequence[tuple[Bench, float]], seed: int) -> DataFrame:
    """Log each bench with a backlash and find A of the best fit of the signature, on all cores; a row a log."""
    logs = (encoder_log(*case, default_rng((seed, k))) for k, case in enumerate(cases))
    fits = Parallel(n_jobs=-1)(delayed(best_fit)(log) for log in logs)
    deltas = [delta for _, delta in cases]
    return DataFrame({"delta_rad": deltas, "A_rps": [fit.amplitude_rps for fit in fits]})


# -------------------------------------------------------------------------------------- Tables 3 and 4


def search_logs(
    element: str, keys: list[str], logs: Sequence[tuple[Any, Recording]], repeats: int
) -> DataFrame:
    """The paper's search on each log, again and again: a row as `table2.summarise_runs` has it, with printed numbers.

    The mean is of |A|. What says which log it is, by `keys`, has its `theoretical_A_rps`, too.
    """
    runs = repeated_fits(logs, NOTEBOOK, range(1, repeats + 1))
    table = summarise_runs(runs.assign(A_rps=runs["A_rps"].abs()), keys)
    names = published.cells(element)["column"].unique()
    return table.assign(**{f"printed_{name}": published.column(element, name) for name in names})


def table3(bench: Bench, deltas: Sequence[float], seed: int, repeats: int) -> DataFrame:
    """Make Table 3 of a bench: a log and a static measure, whose A is the known one, at each backlash [rad]."""
    rng = default_rng(seed)
    logs = []
    for row, delta in enumerate(deltas, start=1):
        measure = delta + rng.normal(0.0, DIAL_GAUGE_RAD)
        key = {"row": row, "delta_rad": delta, "measure_rad": measure}
        key["theoretical_A_rps"] = characteristic.known_amplitude_rps(measure)
        logs.append((key, encoder_log(bench, delta, rng)))
    table = search_logs("Table 3", ["row", "delta_rad", "measure_rad"], logs, repeats)
    return table.rename(columns={"theoretical_A_rps": "known_A_rps"})


# Backlash [rad] of the two kinds of robots, between limits.
ROBOTS = {"healthy": (0.0, 1e-4), "excessive": (2e-4, 5e-4)}
WRIST_GRAVITY = (0.3, 0.8)  # over the bench's: axis 4 carries only wrist and tool
COUPLINGS = 3  # vibrations of the other joints that reach the axis as torques on its load
COUPLING_HZ = (2.5, 40.0)


def draw_robot(rng: Generator, kind: str, coupling: float = 0.03) -> tuple[Bench, float]:
    """Draw the axis 4 of a robot of a kind of `ROBOTS`, and its backlash [rad].

    `coupling` is the largest torque of each coupling, over the axis's own largest torque of gravity.
    """
    bench = draw_bench(rng)
    joint = bench.joint._replace(G=bench.joint.G * rng.uniform(*WRIST_GRAVITY))
    orders = rng.uniform(*COUPLING_HZ, COUPLINGS) / (joint.Omega / TURN)
    torques = coupling * joint.G * rng.random(COUPLINGS)
    phases = TURN * rng.random(COUPLINGS)
    waves = [Wave(*each) for each in zip(orders, phases, np.zeros(COUPLINGS), torques, strict=True)]
    delta = float(rng.uniform(*ROBOTS[kind]))
    return bench._replace(joint=joint._replace(waves=(*joint.waves, *waves))), delta


def table4(robots: Sequence[tuple[Bench, float]], seed: int, repeats: int) -> DataFrame:
    """Make Table 4 of two robots, a healthy A and an excessive B: a log each."""
    logs = []
    for number, (robot, (bench, delta)) in enumerate(zip("AB", robots, strict=True)):
        key = {"robot": robot, "delta_rad": delta, "theoretical_A_rps": np.nan}
        logs.append((key, encoder_log(bench, delta, default_rng((seed, number)))))
    table = search_logs("Table 4", ["robot", "delta_rad"], logs, repeats)
    return table.drop(columns=["theoretical_A_rps", "relative_error_percent"])
