"""Measured errors of every method: on the authors' noisy logs, cross-validated, and on simulated ones."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from numpy.polynomial import Polynomial

from replication import published
from replication.datasets import Recording, add_uniform_noise, level_delta_rad
from replication.global_fit.fit import global_fit
from replication.methods.calibration import Calibration, backlashes, calibrate, default_calibration, fit_polynomial
from replication.methods.joint_match import NUISANCES, match_joint
from replication.methods.readings import protocol_for, reading_of_fit
from replication.methods.waveform import make_bank, match, mean_turn
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import TURN, JointParameters, encoder_position, simulate
from replication.studies import limits

# Methods through the joint: what is unknown besides the backlash.
JOINT_METHODS = {
    "joint": (),
    "joint, start angle free": ("start_angle",),
    "joint, all nuisances free": tuple(NUISANCES),
}
POLYNOMIAL_METHODS = ("amplitude", "energy", "impact")


def _cross_validated(log: tuple[int, int], values: pd.DataFrame, turns: Mapping, record: Recording) -> dict[str, float]:
    """Backlash [rad] of a log (realisation, level) by calibrations on other realisations' logs of other levels."""
    realisation, level = log
    known = values[(values["realisation"] != realisation) & (values["level"] != level)]
    found = {}
    for method in POLYNOMIAL_METHODS:
        coefficients, _ = fit_polynomial(known[method].to_numpy(), known["delta_rad"].to_numpy(), method)
        found[method] = float(Polynomial(coefficients)(values.set_index(["realisation", "level"]).loc[log, method]))
    others = [key for key in turns if key[0] != realisation and key[1] != level]
    bank = make_bank([level_delta_rad(key[1]) for key in others], [turns[key] for key in others])
    return found | {"waveform, noisy logs": match(record, bank).delta_rad}


def cross_validation(
    records: Mapping[tuple[int, int], Recording], joint: JointParameters, scored: Sequence[int]
) -> pd.DataFrame:
    """Errors on noisy logs, none of which is known to what measures it.

    "amplitude", "energy", "impact" and "waveform, noisy logs" are calibrated anew for each log, on the other
    realisations' logs of the other levels. "equation 10" is printed. "waveform" and the joint's methods come from the
    simulated joint, which was identified from clean records.
    """
    fits = {log: global_fit(record, protocol_for(record)) for log, record in records.items()}
    values = pd.DataFrame(
        [
            {"realisation": log[0], "level": log[1], "delta_rad": level_delta_rad(log[1])}
            | {name: reading_of_fit(records[log], name, fit).value for name in POLYNOMIAL_METHODS}
            for log, fit in fits.items()
        ]
    )
    turns = {log: mean_turn(record, 200) for log, record in records.items()}
    calibrations = {"equation 10": default_calibration("paper"), "waveform": default_calibration("waveform")}

    def measured(log: tuple[int, int]) -> dict[str, float]:
        record = records[log]
        calibrated = {name: b.delta_rad for name, b in backlashes(record, fits[log], calibrations).items()}
        found = {"equation 10": calibrated["equation 10"]} | _cross_validated(log, values, turns, record) | calibrated
        return found | {name: match_joint(record, joint, free).delta_rad for name, free in JOINT_METHODS.items()}

    logs = [log for log in records if log[1] in scored]
    rows = [
        {
            "method": name,
            "realisation": log[0],
            "level": log[1],
            "delta_rad": level_delta_rad(log[1]),
            "found_rad": delta,
        }
        for log, found in zip(logs, Parallel(n_jobs=-1)(delayed(measured)(log) for log in logs), strict=True)
        for name, delta in found.items()
    ]
    table = pd.DataFrame(rows)
    return table.assign(error_rad=table["found_rad"] - table["delta_rad"])


def summarise_errors(table: pd.DataFrame, by: Sequence[str] = ("method",)) -> pd.DataFrame:
    """Summarise errors by method."""
    groups = table.assign(size=table["error_rad"].abs()).groupby(list(by), sort=False)
    summary = groups.agg(logs=("size", "size"), mean_abs_error_rad=("size", "mean"), max_abs_error_rad=("size", "max"))
    summary["rmse_rad"] = groups["error_rad"].apply(lambda error: np.sqrt(np.mean(error**2)))
    return summary.reset_index()


# ---------------------------------------------------------------------------------------------------------------
# Errors against noise, sampling, length and encoder

# Backlashes that the calibrations for an encoder are made at [rad].
ENCODER_RAD = np.arange(3e-4, 21.5e-4, 1e-4)

# The authors' records, around which one thing is changed at a time.
USUAL = {"noise_half_amplitude_rps": 0.1, "sampling_hz": 500.0, "turns": 12, "encoder_bits": 0}


def encoder_recording(joint: JointParameters, delta_rad: float, bits: int, sample_s: float, turns: int, offset: float):
    """Record speeds differenced from the positions of an encoder that is turned by an offset [rad]."""
    run = simulate(joint, delta_rad, duration_s=turns * joint.turn_period_s, sample_s=sample_s, step_s=5e-5)
    position = encoder_position(run.motor_position_rad + offset, bits)
    t = run.time_s[:-1]
    source = f"simulated joint, {delta_rad:g} rad, {bits}-bit encoder"
    return Recording(t, np.diff(position) / sample_s / TURN, joint.commanded_speed_rps, joint.turn_period_s, source)


def _made(joint: JointParameters, delta: float, settings: Mapping[str, float], rng: np.random.Generator) -> Recording:
    """Record the joint as the settings say; with an encoder there is no other noise."""
    sample_s, turns = 1 / settings["sampling_hz"], int(settings["turns"])
    if settings["encoder_bits"]:
        offset = rng.uniform(0, TURN)
        return encoder_recording(joint, delta, int(settings["encoder_bits"]), sample_s, turns, offset)
    clean = simulate_recordings(joint, [delta], sample_s, turns)[0]
    return add_uniform_noise(clean, settings["noise_half_amplitude_rps"], rng)


def _errors(joint, delta, settings, calibrations: Mapping[str, Calibration], seed: int) -> dict[str, float]:
    record = _made(joint, delta, settings, np.random.default_rng(seed))
    fit = global_fit(record, protocol_for(record))
    found = {name: backlash.delta_rad for name, backlash in backlashes(record, fit, calibrations).items()}
    if not settings["encoder_bits"]:
        found["joint"] = match_joint(record, joint).delta_rad
    return {name: value - delta for name, value in found.items()}


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
    """Errors of the methods on simulated records as one thing changes at a time, beside the Cramer-Rao bounds."""
    calibrations = {encoder: _calibrations(joint, encoder) for encoder in (False, True)}
    jobs = [
        (axis, value, delta, seed + run)
        for axis, values in sweeps.items()
        for value in values
        for delta in deltas_rad
        for run in range(repeats)
    ]
    found = Parallel(n_jobs=-1, batch_size=4)(
        delayed(_errors)(joint, delta, settings, calibrations[settings["encoder_bits"] > 0], seed)
        for settings, delta, seed in ((USUAL | {axis: value}, delta, seed) for axis, value, delta, seed in jobs)
    )
    rows = [
        {"axis": axis, "value": value, "method": method, "square": error**2}
        for (axis, value, _, _), errors in zip(jobs, found, strict=True)
        for method, error in errors.items()
    ]
    rows += _bound_rows(joint, deltas_rad, sweeps)
    means = pd.DataFrame(rows).groupby(["axis", "value", "method"], sort=False)["square"].mean()
    return np.sqrt(means).rename("rmse_rad").reset_index()


def _bound_rows(
    joint: JointParameters, deltas_rad: Sequence[float], sweeps: Mapping[str, Sequence[float]]
) -> list[dict]:
    """Squared Cramer-Rao bounds of each setting and backlash."""
    rows = []
    for name, free in (("bound, start known", ()), ("bound, start free", ("start_angle",))):
        slopes = [limits.waveform_slopes(joint, delta, free) for delta in deltas_rad]
        for axis, values in sweeps.items():
            for value in values:
                settings = USUAL | {axis: value}
                rows += [
                    {"axis": axis, "value": value, "method": name, "square": _bound(slope, settings) ** 2}
                    for slope in slopes
                ]
    return rows


def _bound(slopes: limits.Slopes, settings: Mapping[str, float]) -> float:
    turns = max(int(settings["turns"]) - 1, 1)
    if settings["encoder_bits"]:
        return limits.encoder_bound_rad(slopes, int(settings["encoder_bits"]), settings["sampling_hz"], turns)
    noise_sd = settings["noise_half_amplitude_rps"] / np.sqrt(3)
    return limits.speed_bound_rad(slopes, noise_sd, settings["sampling_hz"], turns)


def noise_bound_rad(joint: JointParameters, levels: Sequence[int]) -> pd.DataFrame:
    """Mean size of error that white noise as loud as Table 2's must leave, over levels K = 2 to 11."""
    rows = []
    for start, free in (("known", ()), ("free", ("start_angle",))):
        bounds = []
        for level in levels:
            slopes = limits.waveform_slopes(joint, level_delta_rad(level), free)
            noise = published.column("Table 2", "noise")[level - 2]
            bounds.append(_bound(slopes, USUAL | {"noise_half_amplitude_rps": noise}))
        rows.append((start, np.sqrt(2 / np.pi) * np.mean(bounds)))
    return pd.DataFrame(rows, columns=["start", "mean_abs_error_rad"])
