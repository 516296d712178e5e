"""Errors of every method on the authors' logs, on simulated ones and after changes of the joint, and their bounds.

The Cramer-Rao bound says how well a record can tell the backlash at all; detection, from which backlash on it is seen.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy import stats

from backlash.calibration import calibrate, default_calibration
from backlash.fitting.joint_match import PHASES, changed, match_joint, settled_turn
from backlash.fitting.readings import read
from backlash.studies import benchmark
from backlash.studies.benchmark import JOINT_ALL_FREE, JOINT_METHODS, Log, calibrated_answers, logs_by_methods
from replication import published
from replication.arrays import FloatArray
from replication.datasets import Recording, add_uniform_noise, level_delta_rad
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import TURN, JointParameters, encoder_speed_rps, simulate
from replication.statistics import rate_columns

CALIBRATED_METHODS = ("amplitude", "energy", "waveform")
BOUNDS = {"bound, start known": False, "bound, start free": True}

# Backlashes that calibrations on simulated records are made at [rad].
CALIBRATED_RAD = np.arange(3e-4, 21.5e-4, 1e-4).tolist()
# The authors' records, around which one thing is changed at a time.
USUAL: dict[str, float] = {"noise_half_amplitude_rps": 0.1, "sampling_hz": 500.0, "turns": 12, "encoder_bits": 0}


def cross_validation(
    records: Mapping[tuple[int, int], Recording], joint: JointParameters, scored: Sequence[int]
) -> pd.DataFrame:
    """Errors on noisy logs (realisation, level) of the scored levels, none of which is known to what measures it.

    Calibrations on noisy logs are made on the other realisations' logs of the other levels.
    """

    def answers(log: Log) -> dict[str, float]:
        others = [key for key in records if key[0] != log.labels["realisation"] and key[1] != log.labels["level"]]
        known, deltas = [records[key] for key in others], [level_delta_rad(level) for _, level in others]
        calibrations = {"equation 10": default_calibration("paper")}
        calibrations |= {method: calibrate(known, deltas, method) for method in ("amplitude", "energy", "impact")}
        calibrations |= {"waveform, noisy logs": calibrate(known, deltas, "waveform")}
        calibrations |= {"waveform": default_calibration("waveform")}
        by_joint = {name: match_joint(log.recording, joint, free)["delta_rad"] for name, free in JOINT_METHODS.items()}
        return calibrated_answers(log.recording, calibrations) | by_joint

    kept = [(*log, record) for log, record in records.items() if log[1] in scored]
    logs = [Log({"realisation": R, "level": level}, level_delta_rad(level), record) for R, level, record in kept]
    return logs_by_methods(logs, answers)


def encoder_recording(
    joint: JointParameters,
    delta_rad: float,
    bits: int,
    offset_rad: float = 0.0,
    sample_s: float = 2e-3,
    turns: int = 12,
    step_s: float = 5e-5,
) -> Recording:
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
    """RMS errors on simulated records as one of `USUAL` changes at a time, beside the Cramer-Rao bounds."""
    fine = [encoder_recording(joint, delta, 24) for delta in CALIBRATED_RAD]
    of_encoder = {method: calibrate(fine, CALIBRATED_RAD, method) for method in CALIBRATED_METHODS}
    of_speed = {method: default_calibration(method) for method in CALIBRATED_METHODS}

    def answers(log: Log) -> dict[str, float]:
        if log.labels["axis"] == "encoder_bits":
            return calibrated_answers(log.recording, of_encoder)
        return calibrated_answers(log.recording, of_speed) | {"joint": match_joint(log.recording, joint)["delta_rad"]}

    settings = [(axis, value) for axis, values in sweeps.items() for value in values]
    drawn = product(settings, deltas_rad, range(repeats))
    logs = [partial(_draw_log, joint, *setting, delta, seed + run) for setting, delta, run in drawn]
    bounds = []
    for name, start_is_free in BOUNDS.items():
        slopes = [waveform_slopes(joint, delta, start_is_free) for delta in deltas_rad]
        for axis, value in settings:
            errors = [bound_rad(slope, joint.turn_period_s, USUAL | {axis: value}) for slope in slopes]
            bounds.append(pd.DataFrame({"axis": axis, "value": value, "method": name, "error_rad": errors}))
    rows = pd.concat([logs_by_methods(logs, answers), *bounds])
    return benchmark.summarise_errors(rows, ("axis", "value", "method"))[["axis", "value", "method", "rmse_rad"]]


def noise_bound_rad(joint: JointParameters, levels: Sequence[int]) -> pd.DataFrame:
    """Mean size of error that white noise as loud as Table 2's must leave, with the start known and fitted."""
    noise, rows = published.column("Table 2", "noise"), []
    for name, start_is_free in BOUNDS.items():
        bounds = []
        for level in levels:
            slopes = waveform_slopes(joint, level_delta_rad(level), start_is_free)
            settings = USUAL | {"noise_half_amplitude_rps": noise[level - 2]}
            bounds.append(bound_rad(slopes, joint.turn_period_s, settings))
        rows.append((name.removeprefix("bound, start "), np.sqrt(2 / np.pi) * np.mean(bounds)))
    return pd.DataFrame(rows, columns=["start", "mean_abs_error_rad"])


Change = Callable[[JointParameters, float], JointParameters]


def _scaled(field: str) -> Change:
    """Multiply a field by 1 + change."""
    return lambda joint, share: replace(joint, **{field: (1 + share) * getattr(joint, field)})


def _viscous_friction(joint: JointParameters, share: float) -> JointParameters:
    load_speed = joint.commanded_speed_rad_per_s / joint.gear_ratio
    return replace(joint, load_viscous_nms_per_rad=share * (joint.gravity_torque_nm / load_speed))


# What changes, by name. The identified joint has no friction, so it only grows, to a share of the gravity torque.
CHANGES: dict[str, Change] = {
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
    "load viscous friction": _viscous_friction,
}


def errors_after_changes(
    joint: JointParameters, deltas_rad: Sequence[float], shares: Sequence[float], names: Sequence[str] = tuple(CHANGES)
) -> pd.DataFrame:
    """Errors on noise-free records of methods that are calibrated on the joint before one thing about it changed."""
    calibrations = {"equation 10": default_calibration("paper")}
    calibrations |= {method: default_calibration(method) for method in CALIBRATED_METHODS}

    def answers(log: Log) -> dict[str, float]:
        # The commanded speed is known; the sensor refuses a log of another one, here it is measured all the same.
        known = replace(joint, commanded_speed_rps=log.recording.commanded_speed_rps)
        by_joint = match_joint(log.recording, known, JOINT_METHODS[JOINT_ALL_FREE])["delta_rad"]
        return calibrated_answers(log.recording, calibrations) | {JOINT_ALL_FREE: by_joint}

    changes = [(name, share) for name in names for share in shares if share > 0 or "friction" not in name]
    changes.append(("stiffness", 0.0))
    logs = [
        Log({"parameter": name if share else "nothing", "change": share}, delta, record)
        for name, share in changes
        for delta, record in zip(deltas_rad, simulate_recordings(CHANGES[name](joint, share), deltas_rad), strict=True)
    ]
    return logs_by_methods(logs, answers)


def mean_errors(table: pd.DataFrame) -> pd.DataFrame:
    """Mean and largest error of each method at each change, over the backlashes."""
    groups = table.groupby(["parameter", "method", "change"], sort=False)["error_rad"]
    return groups.agg(mean_error_rad="mean", max_abs_error_rad=lambda error: error.abs().max()).reset_index()


def ranking(table: pd.DataFrame) -> pd.DataFrame:
    """Rank the methods by their RMS error over all changes, beside that on the joint as it was."""
    moved, still = table[table["change"] != 0], table[table["change"] == 0]
    ranked = benchmark.summarise_errors(moved)[["method", "rmse_rad", "max_abs_error_rad"]]
    worst = moved["error_rad"].abs().groupby(moved["method"]).idxmax()
    ranked["worst_parameter"] = moved["parameter"].loc[worst.loc[ranked["method"]]].to_numpy()
    ranked["unchanged_rmse_rad"] = benchmark.summarise_errors(still)["rmse_rad"]
    return ranked.sort_values("rmse_rad", ignore_index=True)


def waveform_slopes(joint: JointParameters, delta_rad: float, start_is_free: bool) -> FloatArray:
    """Settled speed of a turn at even phases, differentiated by the backlash and, where free, the start angle."""

    def slope(step_rad: float, angle_step_rad: float) -> FloatArray:
        ends = [
            settled_turn(changed(joint, {"start_angle": sign * angle_step_rad}), delta_rad + sign * step_rad, PHASES)
            for sign in (1, -1)
        ]
        return (ends[0] - ends[1]) / (2 * (step_rad + angle_step_rad))

    return np.array([slope(1e-6, 0.0), slope(0.0, 1e-3)] if start_is_free else [slope(1e-6, 0.0)])


def cramer_rao_sd(slopes: FloatArray, noise_sd: float) -> float:
    """Least SD of the first unknown (slopes: unknowns by samples) in white noise, a constant offset unknown too."""
    if slopes.shape[1] <= len(slopes):
        return np.inf
    centred = slopes - slopes.mean(axis=1, keepdims=True)
    information = centred @ centred.T
    scale = np.sqrt(np.diag(information))  # unknowns in units of their own, so that the inverse is well conditioned
    inverse = np.linalg.inv(information / np.outer(scale, scale))
    return float(noise_sd * np.sqrt(inverse[0, 0]) / scale[0])


def bound_rad(slopes: FloatArray, turn_s: float, settings: Mapping[str, float]) -> float:
    """Least SD of an unbiased backlash from a log with `settings`, its first turn left out.

    In the speed's noise, taken for white; with an encoder in the rounding of its positions, taken for white noise.
    """
    turns, rate, phases = max(int(settings["turns"]) - 1, 1), settings["sampling_hz"], slopes.shape[1]
    t, drift = np.arange(round(turns * turn_s * rate)) / rate, []
    noise_sd = settings["noise_half_amplitude_rps"] / np.sqrt(3)
    if settings["encoder_bits"]:
        slopes = np.cumsum(slopes - slopes.mean(axis=1, keepdims=True), axis=1) * turn_s / phases
        noise_sd, drift = 2.0 ** -settings["encoder_bits"] / np.sqrt(12), [t - t.mean()]
    grid = np.arange(phases) * turn_s / phases
    return cramer_rao_sd(np.array([*(np.interp(t, grid, slope, period=turn_s) for slope in slopes), *drift]), noise_sd)


def noisy_energy(clean: Recording, half_amplitude_rps: float, seeds: Iterable[int]) -> FloatArray:
    """RMS of the signature fitted to a record with uniform noise [rps], once for each seed."""

    def value(seed: int) -> float:
        return read(add_uniform_noise(clean, half_amplitude_rps, np.random.default_rng(seed)), "energy").value

    return np.array(Parallel(n_jobs=-1, batch_size=8)(delayed(value)(seed) for seed in seeds))


def detection_rates(
    joint: JointParameters,
    deltas_rad: Sequence[float],
    half_amplitude_rps: float,
    rate: float,
    healthy: int,
    repeats: int,
    seed: int,
) -> pd.DataFrame:
    """How often backlash is seen by the signature's energy, with a threshold from records without backlash."""
    clean, rng, rows = simulate_recordings(joint, [0.0, *deltas_rad]), np.random.default_rng(seed), []
    first = noisy_energy(clean[0], half_amplitude_rps, rng.integers(2**31, size=healthy))
    threshold = float(np.quantile(first, 1 - rate))
    for k, (delta, record) in enumerate(zip([0.0, *deltas_rad], clean, strict=True)):
        energy = noisy_energy(record, half_amplitude_rps, rng.integers(2**31, size=repeats if k else healthy))
        seen = int((energy > threshold).sum())
        settings = {"noise_half_amplitude_rps": half_amplitude_rps, "delta_rad": delta, "threshold_rps": threshold}
        rows.append(settings | rate_columns(seen, energy.size, "seen"))
    return pd.DataFrame(rows)


def smallest_seen_rad(table: pd.DataFrame, power: float) -> float:
    """Backlash, interpolated, from which on the share of `detection_rates` stays at `power`; NaN if it never does."""
    last = max(np.flatnonzero(table["seen"].to_numpy() < power), default=0)
    if last == len(table) - 1:
        return float("nan")
    pair = table.iloc[last : last + 2]
    return float(np.interp(power, pair["seen"], pair["delta_rad"]))


def matched_filter_delta_rad(
    joint: JointParameters, deltas_rad: Sequence[float], noise_sd_rps: float, samples: int, rate: float, power: float
) -> float:
    """Smallest backlash that a filter which knows the waveform sees in white Gaussian noise."""
    needed, healthy = stats.norm.isf(rate) + stats.norm.ppf(power), settled_turn(joint, 0.0, PHASES)
    differences = [settled_turn(joint, delta, PHASES) - healthy for delta in deltas_rad]
    distance = [np.std(difference) * np.sqrt(samples) / noise_sd_rps for difference in differences]
    return float(np.interp(needed, distance, deltas_rad, right=np.nan))


def detection_summary(tables: Sequence[pd.DataFrame], filtered_rad: Sequence[float], power: float) -> pd.DataFrame:
    """Summarise detection at each loudness of the noise."""
    columns = ["noise_half_amplitude_rps", "seen", "seen_low", "seen_high"]
    healthy = pd.concat([table.loc[:0, columns] for table in tables], ignore_index=True)
    smallest = [smallest_seen_rad(table, power) for table in tables]
    healthy = healthy.rename(columns=lambda name: name.replace("seen", "false_alarms"))
    return healthy.assign(smallest_seen_rad=smallest, matched_filter_rad=filtered_rad)
