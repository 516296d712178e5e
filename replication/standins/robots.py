"""Stand-ins for the plant robots of Table 4: axis 4 of an arm whose other joints shake it.

Nothing is published of these robots but four numbers, so every spread here is an assumption. Where
a loader for their logs would go, `standins` says.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from replication import published
from replication.recording import Recording
from replication.simulator.parameters import TURN, Disturbance, JointParameters, identified_joint
from replication.standins.joints import (
    Bench,
    FitRecord,
    Spread,
    draw_bench,
    encoder_log,
    fitted_logs,
)
from replication.table2 import summarise_runs

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
