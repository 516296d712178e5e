"""Measured errors of every method: on the authors' noisy logs, cross-validated, and on simulated ones."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
import pandas as pd
from numpy.polynomial import Polynomial

from replication import published
from replication.datasets import Recording, add_uniform_noise, level_delta_rad
from replication.global_fit.fit import global_fit
from replication.methods.calibration import Calibration, backlashes, calibrate, default_calibration, fit_polynomial
from replication.methods.joint_match import match_joint
from replication.methods.readings import protocol_for, reading_of_fit
from replication.methods.waveform import make_bank, match, mean_turn
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import TURN, JointParameters, encoder_speed_rps, simulate
from replication.studies import limits
from replication.studies.benchmark import JOINT_METHODS, Log, calibrated_answers, logs_by_methods, summarise_errors

POLYNOMIAL_METHODS = ("amplitude", "energy", "impact")
BOUNDS = {"bound, start known": (), "bound, start free": ("start_angle",)}

# Backlashes that the calibrations for an encoder are made at [rad].
ENCODER_RAD = np.arange(3e-4, 21.5e-4, 1e-4)

# The authors' records, around which one thing is changed at a time.
USUAL = {"noise_half_amplitude_rps": 0.1, "sampling_hz": 500.0, "turns": 12, "encoder_bits": 0}


def cross_validation(
    records: Mapping[tuple[int, int], Recording], joint: JointParameters, scored: Sequence[int]
) -> pd.DataFrame:
    """Errors on noisy logs (realisation, level) of the scored levels, none of which is known to what measures it."""
    fits = {log: global_fit(record, protocol_for(record)) for log, record in records.items()}
    left_out = _left_out_answers(records, fits)
    calibrations = {"equation 10": default_calibration("paper"), "waveform": default_calibration("waveform")}

    def answers(log: Log) -> dict[str, float]:
        key = log.labels["realisation"], log.labels["level"]
        found = backlashes(log.recording, fits[key], calibrations)
        by_joint = {name: match_joint(log.recording, joint, free).delta_rad for name, free in JOINT_METHODS.items()}
        return (
            {"equation 10": found["equation 10"].delta_rad}
            | left_out(key)
            | {"waveform": found["waveform"].delta_rad}
            | by_joint
        )

    logs = [
        Log({"realisation": realisation, "level": level}, level_delta_rad(level), record)
        for (realisation, level), record in records.items()
        if level in scored
    ]
    return logs_by_methods(logs, answers)


def _left_out_answers(
    records: Mapping[tuple[int, int], Recording], fits: Mapping
) -> Callable[[tuple[int, int]], dict[str, float]]:
    """Answers to a log by calibrations on the other realisations' logs of the other levels."""
    values = pd.DataFrame(
        [
            {name: reading_of_fit(records[log], name, fit).value for name in POLYNOMIAL_METHODS}
            for log, fit in fits.items()
        ],
        index=pd.MultiIndex.from_tuples(fits, names=["realisation", "level"]),
    )
    turns = {log: mean_turn(record, 200) for log, record in records.items()}

    def answers(log: tuple[int, int]) -> dict[str, float]:
        others = [key for key in records if key[0] != log[0] and key[1] != log[1]]
        deltas, found = np.array([level_delta_rad(level) for _, level in others]), {}
        for method in POLYNOMIAL_METHODS:
            coefficients, _ = fit_polynomial(values.loc[others, method].to_numpy(), deltas, method)
            found[method] = float(Polynomial(coefficients)(values.loc[log, method]))
        bank = make_bank(deltas.tolist(), [turns[key] for key in others])
        return found | {"waveform, noisy logs": match(records[log], bank).delta_rad}

    return answers


# ---------------------------------------------------------------------------------------------------------------
# Errors against noise, sampling, length and encoder


def encoder_recording(
    joint: JointParameters, delta_rad: float, bits: int, sample_s: float, turns: int, offset_rad: float
) -> Recording:
    """Record speeds differenced from the positions of an encoder that is turned by an offset."""
    run = simulate(joint, delta_rad, duration_s=turns * joint.turn_period_s, sample_s=sample_s, step_s=5e-5)
    speed = encoder_speed_rps(run.motor_position_rad + offset_rad, bits, sample_s)
    source = f"simulated joint, {delta_rad:g} rad, {bits}-bit encoder"
    return Recording(run.time_s[:-1], speed, joint.commanded_speed_rps, joint.turn_period_s, source)


def _draw_log(joint: JointParameters, axis: str, value: float, delta_rad: float, seed: int) -> Log:
    """Record the joint with one setting changed; with an encoder there is no other noise."""
    settings, rng = USUAL | {axis: value}, np.random.default_rng(seed)
    sample_s, turns = 1 / settings["sampling_hz"], int(settings["turns"])
    if settings["encoder_bits"]:
        offset = rng.uniform(0, TURN)
        record = encoder_recording(joint, delta_rad, int(settings["encoder_bits"]), sample_s, turns, offset)
    else:
        clean = simulate_recordings(joint, [delta_rad], sample_s, turns)[0]
        record = add_uniform_noise(clean, settings["noise_half_amplitude_rps"], rng)
    return Log({"axis": axis, "value": value}, delta_rad, record)


def _calibrations(joint: JointParameters, encoder: bool) -> dict[str, Calibration]:
    """Calibrations for a record of speeds, or of a fine encoder's differenced positions."""
    methods = ("amplitude", "energy", "waveform")
    if not encoder:
        return {method: default_calibration(method) for method in methods}
    sample_s = 1 / USUAL["sampling_hz"]
    records = [encoder_recording(joint, delta, 24, sample_s, USUAL["turns"], 0.0) for delta in ENCODER_RAD]
    return {method: calibrate(records, ENCODER_RAD, method) for method in methods}


def measured_errors(
    joint: JointParameters,
    deltas_rad: Sequence[float],
    sweeps: Mapping[str, Sequence[float]],
    repeats: int,
    seed: int,
) -> pd.DataFrame:
    """RMS errors on simulated records as one of `USUAL` changes at a time, beside the Cramer-Rao bounds."""
    calibrations = {encoder: _calibrations(joint, encoder) for encoder in (False, True)}

    def answers(log: Log) -> dict[str, float]:
        encoder = log.labels["axis"] == "encoder_bits"
        found = calibrated_answers(log.recording, calibrations[encoder])
        return found if encoder else found | {"joint": match_joint(log.recording, joint).delta_rad}

    settings = [(axis, value) for axis, values in sweeps.items() for value in values]
    logs = [
        partial(_draw_log, joint, *setting, delta, seed + run)
        for setting in settings
        for delta in deltas_rad
        for run in range(repeats)
    ]
    slopes = {name: [limits.waveform_slopes(joint, d, free) for d in deltas_rad] for name, free in BOUNDS.items()}
    bounds = [
        {"axis": axis, "value": value, "method": name, "error_rad": _bound_rad(slope, USUAL | {axis: value})}
        for name in BOUNDS
        for axis, value in settings
        for slope in slopes[name]
    ]
    rows = pd.concat([logs_by_methods(logs, answers), pd.DataFrame(bounds)])
    return summarise_errors(rows, ("axis", "value", "method"))[["axis", "value", "method", "rmse_rad"]]


def _bound_rad(slopes: limits.Slopes, settings: Mapping[str, float]) -> float:
    turns = max(int(settings["turns"]) - 1, 1)
    if settings["encoder_bits"]:
        return limits.encoder_bound_rad(slopes, int(settings["encoder_bits"]), settings["sampling_hz"], turns)
    noise_sd = settings["noise_half_amplitude_rps"] / np.sqrt(3)
    return limits.speed_bound_rad(slopes, noise_sd, settings["sampling_hz"], turns)


def noise_bound_rad(joint: JointParameters, levels: Sequence[int]) -> pd.DataFrame:
    """Mean size of error that white noise as loud as Table 2's must leave, with the start known and fitted."""
    noise, rows = published.column("Table 2", "noise"), []
    for name, free in BOUNDS.items():
        bounds = [
            _bound_rad(
                limits.waveform_slopes(joint, level_delta_rad(level), free),
                USUAL | {"noise_half_amplitude_rps": noise[level - 2]},
            )
            for level in levels
        ]
        rows.append((name.removeprefix("bound, start "), np.sqrt(2 / np.pi) * np.mean(bounds)))
    return pd.DataFrame(rows, columns=["start", "mean_abs_error_rad"])
