"""Errors of every method on the authors' logs, on simulated ones and on changed joints; their bound."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
from numpy.random import Generator
from pandas import DataFrame

from backlash.calibration import Calibration, backlashes, default_calibration, fit_calibration
from backlash.fitting.global_fit import global_fit
from backlash.fitting.readings import protocol_for, read
from replication.arrays import FloatArray
from replication.authors import level_delta_rad
from replication.parallel import in_parallel
from replication.recording import Recording, add_uniform_noise
from replication.simulator.parameters import TURN, JointParameters
from replication.simulator.recordings import SIMULATION_STEP_S, read_encoder, simulate_recordings
from replication.simulator.simulate import simulate
from studies.benchmark import JOINT_ALL_FREE, JOINT_METHODS, KnownLog, logs_by_methods
from studies.gap_time import time_in_gap
from studies.joint_match import PHASES, add_nuisances, match_joint, simulate_turn

CALIBRATED_METHODS = ("amplitude", "energy", "waveform")

# Backlashes that calibrations on simulated records are made at [rad].
CALIBRATED_RAD = np.arange(3e-4, 21.5e-4, 1e-4).tolist()
# The authors' records, around which one thing is changed at a time.
USUAL: dict[str, float] = {
    "noise_half_amplitude_rps": 0.1,
    "sampling_hz": 500.0,
    "turns": 12,
    "encoder_bits": 0,
}


def _answers(
    recording: Recording,
    calibrations: Mapping[str, Calibration],
    joint: JointParameters,
    unknown: Mapping[str, tuple],
) -> dict[str, float]:
    """Backlash [rad] by calibrations, and by simulating the joint with some of it unknown, by method."""
    fit = global_fit(recording, protocol_for(recording))
    calibrated = {
        name: found.delta_rad for name, found in backlashes(recording, fit, calibrations).items()
    }
    return calibrated | {
        name: match_joint(recording, joint, free)["delta_rad"] for name, free in unknown.items()
    }


def cross_validation(
    records: Mapping[tuple[int, int], Recording],
    joint: JointParameters,
    scored: Sequence[int],
    smoothing_s: float,
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
        known = [records[key] for key in others], [level_delta_rad(level) for _, level in others]
        calibrations = {"equation 10": default_calibration("paper")}
        calibrations |= {
            method: fit_calibration(*known, method) for method in ("amplitude", "energy", "impact")
        }
        calibrations["waveform, noisy logs"] = fit_calibration(*known, "waveform")
        calibrations["waveform"] = default_calibration("waveform")
        rival = {"time in the gap": time_in_gap(log.recording, joint, smoothing_s)}
        return _answers(log.recording, calibrations, joint, JOINT_METHODS) | rival

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


def _draw_log(
    joint: JointParameters, axis: str, value: float, delta_rad: float, seed: int
) -> KnownLog:
    """Record the joint with one setting changed; with an encoder there is no other noise."""
    settings = USUAL | {axis: value}
    rng = np.random.default_rng(seed)
    length = 1 / settings["sampling_hz"], int(settings["turns"])
    if bits := int(settings["encoder_bits"]):
        record = encoder_recording(joint, delta_rad, bits, rng.uniform(0, TURN), *length)
    else:
        (clean,) = simulate_recordings(joint, [delta_rad], *length)
        record = add_uniform_noise(clean, settings["noise_half_amplitude_rps"], rng)
    return KnownLog({"axis": axis, "value": value}, delta_rad, record)


def measured_errors(
    joint: JointParameters,
    deltas_rad: Sequence[float],
    sweeps: Mapping[str, Sequence[float]],
    repeats: int,
    seed: int,
) -> DataFrame:
    """Errors on simulated records as one of `USUAL` changes at a time.

    The joint is matched to speeds only.
    """
    fine = [encoder_recording(joint, delta, 24) for delta in CALIBRATED_RAD]
    of_encoder = {
        method: fit_calibration(fine, CALIBRATED_RAD, method) for method in CALIBRATED_METHODS
    }
    of_speed = {method: default_calibration(method) for method in CALIBRATED_METHODS}

    def answers(log: KnownLog) -> dict[str, float]:
        if log.labels["axis"] == "encoder_bits":
            return _answers(log.recording, of_encoder, joint, {})
        return _answers(log.recording, of_speed, joint, {"joint": ()})

    settings = [(axis, value) for axis, values in sweeps.items() for value in values]
    drawn = product(settings, deltas_rad, range(repeats))
    logs = [partial(_draw_log, joint, *setting, delta, seed + run) for setting, delta, run in drawn]
    return logs_by_methods(logs, answers)


def errors_after_changes(logs: Sequence[KnownLog], joint: JointParameters) -> DataFrame:
    """Errors on logs of changed joints, of methods that are calibrated on the joint as it was."""
    calibrations = {"equation 10": default_calibration("paper")}
    calibrations |= {method: default_calibration(method) for method in CALIBRATED_METHODS}

    def answers(log: KnownLog) -> dict[str, float]:
        # The commanded speed is known; the sensor refuses a log of another one, here it is measured
        # all the same.
        known = replace(joint, commanded_speed_rps=log.recording.commanded_speed_rps)
        return _answers(
            log.recording, calibrations, known, {JOINT_ALL_FREE: JOINT_METHODS[JOINT_ALL_FREE]}
        )

    return logs_by_methods(logs, answers)


def _scaled(field: str) -> Callable[[JointParameters, float], JointParameters]:
    """Multiply a field by 1 + change."""
    return lambda joint, share: replace(joint, **{field: (1 + share) * getattr(joint, field)})


_SCALED = {
    "commanded speed": "commanded_speed_rps",
    "stiffness": "stiffness_nm_per_rad",
    "position gain": "position_gain_per_s",
    "speed gain": "speed_gain_nms_per_rad",
    "integral gain": "integral_gain_nm_per_rad",
    "derivative gain": "derivative_gain_nms2_per_rad",
    "leaky gain": "leaky_gain_nm_per_rad",
    "torque lag": "torque_lag_s",
}
# What changes, by name. The identified joint has no friction, so it only grows, to a share of the
# gravity torque.
CHANGES: dict[str, Callable[[JointParameters, float], JointParameters]] = {
    "load mass": lambda joint, share: add_nuisances(joint, {"load": 1 + share}),
    **{name: _scaled(field) for name, field in _SCALED.items()},
    "load Coulomb friction": lambda joint, share: add_nuisances(joint, {"friction": share}),
    "load viscous friction": lambda joint, share: replace(
        joint, load_viscous_nms_per_rad=share * joint.gravity_torque_nm * joint.turn_period_s / TURN
    ),
}


def waveform_slopes(joint: JointParameters, delta_rad: float) -> FloatArray:
    """Slopes of a turn's settled speed at even phases by the backlash, and by the start angle.

    Shape (2, phases).
    """

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


def noisy_energy(
    clean: Recording, half_amplitude_rps: float, rng: Generator, logs: int
) -> FloatArray:
    """RMS of the signature fitted to a record with uniform noise [rps], for so many drawings of the noise."""
    seeds = rng.integers(2**31, size=logs)
    noisy = [
        add_uniform_noise(clean, half_amplitude_rps, np.random.default_rng(seed)) for seed in seeds
    ]
    return np.array(
        [found.value for found in in_parallel(read, [(log, "energy") for log in noisy], "noises")]
    )
