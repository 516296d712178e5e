"""Errors of every method on the authors' logs, on simulated ones and after changes of the joint, and their bound."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pandas as pd
from joblib import delayed

from backlash.calibration import Calibration, backlashes, default_calibration, fit_calibration
from backlash.fitting.global_fit import global_fit
from backlash.fitting.readings import protocol_for, read
from replication.arrays import FloatArray
from replication.authors import level_delta_rad
from replication.recording import Recording, add_uniform_noise
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import TURN, JointParameters, encoder_speed_rps, simulate
from studies.benchmark import JOINT_ALL_FREE, JOINT_METHODS, Log, in_parallel, logs_by_methods
from studies.gap_time import time_in_gap
from studies.joint_match import PHASES, changed, match_joint, settled_turn

CALIBRATED_METHODS = ("amplitude", "energy", "waveform")

# Backlashes that calibrations on simulated records are made at [rad].
CALIBRATED_RAD = np.arange(3e-4, 21.5e-4, 1e-4).tolist()
# The authors' records, around which one thing is changed at a time.
USUAL: dict[str, float] = {"noise_half_amplitude_rps": 0.1, "sampling_hz": 500.0, "turns": 12, "encoder_bits": 0}


def _answers(
    recording: Recording, calibrations: Mapping[str, Calibration], joint: JointParameters, unknown: Mapping[str, tuple]
) -> dict[str, float]:
    """Backlash [rad] by calibrations, and by simulating the joint with what each of its methods has unknown."""
    fit = global_fit(recording, protocol_for(recording))
    calibrated = {name: found.delta_rad for name, found in backlashes(recording, fit, calibrations).items()}
    return calibrated | {name: match_joint(recording, joint, free)["delta_rad"] for name, free in unknown.items()}


def cross_validation(
    records: Mapping[tuple[int, int], Recording], joint: JointParameters, scored: Sequence[int], smoothing_s: float
) -> pd.DataFrame:
    """Errors on noisy logs (realisation, level) of the scored levels, none of which is known to what measures it.

    Calibrations on noisy logs are made on the other realisations' logs of the other levels.
    """

    def answers(log: Log) -> dict[str, float]:
        others = [key for key in records if key[0] != log.labels["realisation"] and key[1] != log.labels["level"]]
        known, deltas = [records[key] for key in others], [level_delta_rad(level) for _, level in others]
        calibrations = {"equation 10": default_calibration("paper")}
        calibrations |= {method: fit_calibration(known, deltas, method) for method in ("amplitude", "energy", "impact")}
        calibrations |= {"waveform, noisy logs": fit_calibration(known, deltas, "waveform")}
        calibrations |= {"waveform": default_calibration("waveform")}
        rival = {"time in the gap": time_in_gap(log.recording, joint, smoothing_s)}
        return _answers(log.recording, calibrations, joint, JOINT_METHODS) | rival

    kept = [(*log, record) for log, record in records.items() if log[1] in scored]
    logs = [Log({"realisation": R, "level": level}, level_delta_rad(level), record) for R, level, record in kept]
    return logs_by_methods(logs, answers)


def encoder_recording(
    joint: JointParameters, delta_rad: float, bits: int, offset_rad: float = 0.0,
    sample_s: float = 2e-3, turns: int = 12, step_s: float = 5e-5,
) -> Recording:  # fmt: skip
    """Record speeds differenced from the positions of an encoder that is turned by an offset."""
    run = simulate(joint, delta_rad, duration_s=turns * joint.turn_period_s, sample_s=sample_s, step_s=step_s)
    speed = encoder_speed_rps(run.motor_position_rad + offset_rad, bits, sample_s)
    source = f"simulated joint, {delta_rad:g} rad, {bits}-bit encoder"
    return Recording(run.time_s[:-1], speed, joint.commanded_speed_rps, joint.turn_period_s, source)


def _draw_log(joint: JointParameters, axis: str, value: float, delta_rad: float, seed: int) -> Log:
    """Record the joint with one setting changed; with an encoder there is no other noise."""
    settings, rng = USUAL | {axis: value}, np.random.default_rng(seed)
    sample_s, turns = 1 / settings["sampling_hz"], int(settings["turns"])
    if settings["encoder_bits"]:
        offset = rng.uniform(0, TURN)
        record = encoder_recording(joint, delta_rad, int(settings["encoder_bits"]), offset, sample_s, turns)
    else:
        clean = simulate_recordings(joint, [delta_rad], sample_s, turns)[0]
        record = add_uniform_noise(clean, settings["noise_half_amplitude_rps"], rng)
    return Log({"axis": axis, "value": value}, delta_rad, record)


def measured_errors(
    joint: JointParameters, deltas_rad: Sequence[float], sweeps: Mapping[str, Sequence[float]], repeats: int, seed: int
) -> pd.DataFrame:
    """Errors on simulated records as one of `USUAL` changes at a time; the joint is matched to speeds only."""
    fine = [encoder_recording(joint, delta, 24) for delta in CALIBRATED_RAD]
    of_encoder = {method: fit_calibration(fine, CALIBRATED_RAD, method) for method in CALIBRATED_METHODS}
    of_speed = {method: default_calibration(method) for method in CALIBRATED_METHODS}

    def answers(log: Log) -> dict[str, float]:
        if log.labels["axis"] == "encoder_bits":
            return _answers(log.recording, of_encoder, joint, {})
        return _answers(log.recording, of_speed, joint, {"joint": ()})

    settings = [(axis, value) for axis, values in sweeps.items() for value in values]
    drawn = product(settings, deltas_rad, range(repeats))
    logs = [partial(_draw_log, joint, *setting, delta, seed + run) for setting, delta, run in drawn]
    return logs_by_methods(logs, answers)


def errors_after_changes(logs: Sequence[Log], joint: JointParameters) -> pd.DataFrame:
    """Errors on logs of changed joints, of methods that are calibrated on the joint as it was."""
    calibrations = {"equation 10": default_calibration("paper")}
    calibrations |= {method: default_calibration(method) for method in CALIBRATED_METHODS}

    def answers(log: Log) -> dict[str, float]:
        # The commanded speed is known; the sensor refuses a log of another one, here it is measured all the same.
        known = replace(joint, commanded_speed_rps=log.recording.commanded_speed_rps)
        return _answers(log.recording, calibrations, known, {JOINT_ALL_FREE: JOINT_METHODS[JOINT_ALL_FREE]})

    return logs_by_methods(logs, answers)


def _scaled(field: str) -> Callable[[JointParameters, float], JointParameters]:
    """Multiply a field by 1 + change."""
    return lambda joint, share: replace(joint, **{field: (1 + share) * getattr(joint, field)})


# What changes, by name. The identified joint has no friction, so it only grows, to a share of the gravity torque.
CHANGES: dict[str, Callable[[JointParameters, float], JointParameters]] = {
    "load mass": lambda joint, share: changed(joint, {"load": 1 + share}),
    "commanded speed": _scaled("commanded_speed_rps"),
    "stiffness": _scaled("stiffness_nm_per_rad"),
    "position gain": _scaled("position_gain_per_s"),
    "speed gain": _scaled("speed_gain_nms_per_rad"),
    "integral gain": _scaled("integral_gain_nm_per_rad"),
    "derivative gain": _scaled("derivative_gain_nms2_per_rad"),
    "leaky gain": _scaled("leaky_gain_nm_per_rad"),
    "torque lag": _scaled("torque_lag_s"),
    "load Coulomb friction": lambda joint, share: replace(joint, load_coulomb_nm=share * joint.gravity_torque_nm),
    "load viscous friction": lambda joint, share: replace(
        joint, load_viscous_nms_per_rad=share * joint.gravity_torque_nm * joint.turn_period_s / TURN
    ),
}


def waveform_slopes(joint: JointParameters, delta_rad: float) -> FloatArray:
    """Slopes of a turn's settled speed at even phases by the backlash, and by the start angle; shape (2, phases)."""

    def slope(step_rad: float, angle_step_rad: float) -> FloatArray:
        after, before = (
            settled_turn(changed(joint, {"start_angle": sign * angle_step_rad}), delta_rad + sign * step_rad, PHASES)
            for sign in (1, -1)
        )
        return (after - before) / (2 * (step_rad + angle_step_rad))

    return np.array([slope(1e-6, 0.0), slope(0.0, 1e-3)])


def cramer_rao_sd(slopes: FloatArray, noise_sd: float) -> float:
    """Least SD of the first unknown (slopes: unknowns by samples) in white noise, a constant offset unknown too."""
    if slopes.shape[1] <= len(slopes):
        return np.inf
    centred = slopes - slopes.mean(axis=1, keepdims=True)
    information = centred @ centred.T
    scale = np.sqrt(np.diag(information))  # unknowns in units of their own, so that the inverse is well conditioned
    inverse = np.linalg.inv(information / np.outer(scale, scale))
    return float(noise_sd * np.sqrt(inverse[0, 0]) / scale[0])


def noisy_energy(clean: Recording, half_amplitude_rps: float, rng: np.random.Generator, logs: int) -> FloatArray:
    """RMS of the signature fitted to a record with uniform noise [rps], for so many drawings of the noise."""
    seeds = rng.integers(2**31, size=logs)
    noisy = (add_uniform_noise(clean, half_amplitude_rps, np.random.default_rng(seed)) for seed in seeds)
    return np.array([found.value for found in in_parallel((delayed(read)(log, "energy") for log in noisy), "noises")])
