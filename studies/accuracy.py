"""Errors of every method on the authors' logs and on simulated ones; their bound."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from pandas import DataFrame

from backlash.calibration import default_calibration, fit_calibration
from backlash.fitting.global_fit import global_fit
from backlash.fitting.readings import protocol_for
from replication.arrays import FloatArray
from replication.records import Recording, level_delta_rad
from replication.simulator.parameters import TURN, JointParameters
from replication.simulator.recordings import SIMULATION_STEP_S, read_encoder
from replication.simulator.simulate import simulate
from studies.benchmark import JOINT_METHODS, KnownLog, backlashes, logs_by_methods
from studies.joint_match import PHASES, add_nuisances, match_joint, simulate_turn


def cross_validation(
    records: Mapping[tuple[int, int], Recording], joint: JointParameters, scored: Sequence[int]
) -> DataFrame:
    """Errors on noisy logs (realisation, level) of the scored levels, none of which is known to what measures it.

    Calibrations on noisy logs are made on the other realisations' logs of the other levels.
    """

    def answers(log: KnownLog) -> dict[str, float]:
        others = [
            (R, K)
            for R, K in records
            if log.labels["realisation"] != R and log.labels["level"] != K
        ]
        logs_and_levels = (
            [records[key] for key in others],
            [level_delta_rad(level) for _, level in others],
        )
        calibrations = {"equation 10": default_calibration("paper")}
        calibrations |= {
            method: fit_calibration(*logs_and_levels, method)
            for method in ("amplitude", "energy", "impact")
        }
        calibrations["waveform, noisy logs"] = fit_calibration(*logs_and_levels, "waveform")
        calibrations["waveform"] = default_calibration("waveform")
        fit = global_fit(log.recording, protocol_for(log.recording))
        calibrated = backlashes(log.recording, fit, calibrations)
        return {name: answer.delta_rad for name, answer in calibrated.items()} | {
            name: match_joint(log.recording, joint, free)["delta_rad"]
            for name, free in JOINT_METHODS.items()
        }

    logs = [
        KnownLog({"realisation": R, "level": level}, level_delta_rad(level), record)
        for (R, level), record in records.items()
        if level in scored
    ]
    return logs_by_methods(logs, answers)


def encoder_recording(
    joint: JointParameters,
    delta_rad: float,
    bits: int,
    offset_rad: float = 0.0,
    sample_s: float = 2e-3,
    turns: int = 12,
    step_s: float = SIMULATION_STEP_S,
) -> Recording:
    """Record speeds differenced from the positions of an encoder that is turned by an offset."""
    run = simulate(
        joint, delta_rad, duration_s=turns * joint.turn_period_s, sample_s=sample_s, step_s=step_s
    )
    source = f"simulated joint, {delta_rad:g} rad, {bits}-bit encoder"
    return read_encoder(joint, run.time_s, run.motor_position_rad + offset_rad, bits, source)


# Friction on the load of a joint without it, grown to a share of the gravity torque, by name.
CHANGES: dict[str, Callable[[JointParameters, float], JointParameters]] = {
    "load Coulomb friction": lambda joint, share: add_nuisances(joint, {"friction": share}),
    "load viscous friction": lambda joint, share: replace(
        joint, load_viscous_nms_per_rad=share * joint.gravity_torque_nm * joint.turn_period_s / TURN
    ),
}


def waveform_slopes(joint: JointParameters, delta_rad: float) -> FloatArray:
    """Slopes of a turn's settled speed at even phases by the backlash, and by the start angle, shape (2, phases)."""

    def slope(step_rad: float, angle_step_rad: float) -> FloatArray:
        def turn(sign: int) -> FloatArray:
            moved = add_nuisances(joint, {"start_angle": sign * angle_step_rad})
            return simulate_turn(moved, delta_rad + sign * step_rad, PHASES)

        return (turn(1) - turn(-1)) / (2 * (step_rad + angle_step_rad))

    return np.array([slope(1e-6, 0.0), slope(0.0, 1e-3)])


def cramer_rao_sd(slopes: FloatArray, noise_sd: float) -> float:
    """Least SD of the first unknown in white noise, its mean unknown too; slopes: unknowns by samples."""
    if slopes.shape[1] <= len(slopes):
        return np.inf
    centred = slopes - slopes.mean(axis=1, keepdims=True)
    information = centred @ centred.T
    # Unknowns in units of their own, so that the inverse is well conditioned.
    scale = np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information / np.outer(scale, scale))
    return float(noise_sd * np.sqrt(inverse[0, 0]) / scale[0])
