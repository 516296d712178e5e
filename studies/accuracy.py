"""Errors of every method on the authors' logs and on simulated ones; their bound."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pandas import DataFrame

from backlash.calibration import default_calibration, fit_calibration
from replication.arrays import FloatArray
from replication.parallel import in_parallel
from replication.records import Recording, level_delta_rad
from replication.simulator.parameters import JointParameters
from replication.simulator.recordings import read_encoder
from replication.simulator.simulate import simulate
from studies.benchmark import backlashes
from studies.joint_match import NUISANCES, PHASES, add_nuisances, match_joint, simulate_turn

# Methods through the joint: what is unknown besides the backlash.
JOINT_METHODS = {
    "joint": (),
    "joint, start angle free": ("start_angle",),
    "joint, all nuisances free": tuple(NUISANCES),
}


def cross_validation(
    records: Mapping[tuple[int, int], Recording], joint: JointParameters, scored: Sequence[int]
) -> DataFrame:
    """Errors on noisy logs (realisation, level) of the scored levels, none of which is known to what measures it.

    Calibrations on noisy logs are made on the other realisations' logs of the other levels.
    """

    def measure_log(realisation: int, level: int) -> list[dict[str, Any]]:
        others = [(R, K) for R, K in records if realisation != R and level != K]
        logs, levels_rad = [records[key] for key in others], [level_delta_rad(K) for _, K in others]
        calibrations = {"equation 10": default_calibration("paper")}
        for name in ("amplitude", "energy", "impact", "waveform, noisy logs"):
            method = name.split(",")[0]
            calibrations[name] = fit_calibration(logs, levels_rad, method)
        calibrations["waveform"] = default_calibration("waveform")
        log, delta_rad = records[realisation, level], level_delta_rad(level)
        found = {name: each.delta_rad for name, each in backlashes(log, calibrations).items()}
        for name, free in JOINT_METHODS.items():
            found[name] = match_joint(log, joint, free)["delta_rad"]
        key = {"realisation": realisation, "level": level, "delta_rad": delta_rad}
        return [
            {"method": name, **key, "found_rad": rad, "error_rad": rad - delta_rad}
            for name, rad in found.items()
        ]

    tables = in_parallel(measure_log, [key for key in records if key[1] in scored], "logs")
    return DataFrame([row for rows in tables for row in rows])


def encoder_recording(
    joint: JointParameters, delta_rad: float, bits: int, offset_rad: float
) -> Recording:
    """Record speeds differenced from the positions of an encoder that is turned by an offset."""
    run = simulate(joint, delta_rad, duration_s=12 * joint.turn_period_s)
    source = f"simulated joint, {delta_rad:g} rad, {bits}-bit encoder"
    return read_encoder(joint, run.time_s, run.motor_position_rad + offset_rad, bits, source)


def waveform_slopes(joint: JointParameters, delta_rad: float) -> FloatArray:
    """Slopes of a turn's settled speed at even phases by the backlash, and by the start angle, shape (2, phases)."""

    def turn_rps(delta_step_rad: float, angle_step_rad: float) -> FloatArray:
        moved = add_nuisances(joint, {"start_angle": angle_step_rad})
        return simulate_turn(moved, delta_rad + delta_step_rad, PHASES)

    h, angle_h = 1e-6, 1e-3
    by_backlash = (turn_rps(h, 0.0) - turn_rps(-h, 0.0)) / (2 * h)
    by_start = (turn_rps(0.0, angle_h) - turn_rps(0.0, -angle_h)) / (2 * angle_h)
    return np.array([by_backlash, by_start])


def cramer_rao_sd(slopes: FloatArray, noise_sd: float) -> float:
    """Least SD of the first unknown in white noise, its mean unknown too; slopes: unknowns by samples."""
    centred = slopes - slopes.mean(axis=1, keepdims=True)
    information = centred @ centred.T
    # Unknowns in units of their own, so that the inverse is well conditioned.
    scale = np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information / np.outer(scale, scale))
    return float(noise_sd * np.sqrt(inverse[0, 0]) / scale[0])
