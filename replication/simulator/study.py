"""The identified joint against the authors' records and the printed amplitudes, and its identification."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pandas as pd

from replication import published
from replication.data.authors import authors_file
from replication.datasets import Recording, level_delta_rad, load_clean
from replication.simulator.identification import (
    FINE_S,
    fine_per_sample,
    identify_joint,
    identify_lead,
    joint_record,
    settled_sd,
    simulate_finely,
)
from replication.simulator.parameters import JointParameters, joint_from_ratios, with_ratios
from replication.simulator.simulate import settled_peak_rps, simulate_many

# Levels K of the authors' data: published clean, used to identify the joint, and all that they made.
CLEAN_LEVELS = range(3, 14)
FIT_LEVELS = (3, 6, 9, 12)
ALL_LEVELS = range(2, 21)


def clean_records(levels: Sequence[int]) -> dict[float, Recording]:
    """Load the authors' clean records of some levels, by backlash [rad]."""
    return {level_delta_rad(level): load_clean(level) for level in levels}


def printed_amplitudes() -> dict[float, float]:
    """Table 2's theoretical A [rps] by backlash [rad]."""
    theoretical = published.column("Table 2", "theoretical")
    return {level_delta_rad(level): theoretical[level - 2] for level in range(2, 2 + theoretical.size - 1)}


def validate(joint: JointParameters, records: dict[float, Recording]) -> pd.DataFrame:
    """Compare the simulated joint with every clean record and every printed theoretical A; K = 2 has no record."""
    levels = {level_delta_rad(level): level for level in range(2, CLEAN_LEVELS.stop)}
    printed, turn = printed_amplitudes(), joint.turn_period_s
    runs = simulate_finely(joint, levels, float(next(iter(records.values())).t[-1]))
    rows = []
    for (delta, level), run in zip(levels.items(), runs, strict=True):
        nrmse = math.nan
        if delta in records:
            record = records[delta]
            error = (run.motor_speed_rps[:: fine_per_sample(record)] - record.v)[record.t >= turn - 1e-9]
            nrmse = float(np.sqrt(np.mean(error**2)) / settled_sd(record, turn))
        peak, a = settled_peak_rps(run, joint), printed.get(delta, math.nan)
        rows.append((f"Speeddata{level}", delta, level in FIT_LEVELS, nrmse, peak, a, 100 * (peak / a - 1)))
    columns = ["dataset", "delta_rad", "used_in_fit", "nrmse", "peak_rps", "printed_A_rps", "peak_error_percent"]
    return pd.DataFrame(rows, columns=columns)


def amplitudes(joint: JointParameters, deltas_rad: Sequence[float]) -> pd.DataFrame:
    """Measure the theoretical A of the simulated joint: the settled peak before sampling at 2 ms, and after."""
    fine = simulate_many(joint, deltas_rad, sample_s=FINE_S, step_s=FINE_S)
    coarse = simulate_many(joint, deltas_rad, step_s=FINE_S)
    before, after = ([settled_peak_rps(run, joint) for run in runs] for runs in (fine, coarse))
    return pd.DataFrame({"delta_rad": deltas_rad, "amplitude_rps": before, "sampled_rps": after})


def disturbances(recordings: Sequence[Recording], deltas_rad: Sequence[float]) -> pd.DataFrame:
    """Cut the third turn out of records: figure 11's signals."""
    parts = []
    for recording, delta in zip(recordings, deltas_rad, strict=True):
        begin, end = 2 * recording.turn_period_s, 3 * recording.turn_period_s
        rows = (recording.t >= begin - 1e-9) & (recording.t < end - 1e-9)
        v = recording.v[rows] - recording.commanded_speed_rps
        parts.append(pd.DataFrame({"delta_rad": delta, "time_s": recording.t[rows] - begin, "disturbance_rps": v}))
    return pd.concat(parts, ignore_index=True)


def alpha_study(joint: JointParameters, records: dict[float, Recording], alphas: Sequence[float]) -> pd.DataFrame:
    """Misfit of the simulated joint as the edge of equation 8 softens, the rest kept."""
    joints = [(alpha, replace(joint, alpha_per_rad=alpha)) for alpha in alphas]
    joints.append((np.inf, replace(joint, clamped=True)))
    rows = [(alpha, 100 * validate(changed, records)["nrmse"].mean()) for alpha, changed in joints]
    return pd.DataFrame(rows, columns=["alpha_per_rad", "mean_nrmse_percent"])


def simulator_attempts() -> pd.DataFrame:
    """Load the log of the models of the drive that were fitted on the way to the identified one, kept or not."""
    return pd.read_csv(published.DATA / "simulator_attempts.csv")


def changed_joint(joint: JointParameters, factors: Mapping[str, float]) -> JointParameters:
    """Multiply some of a joint's ratios by factors, for a student to play with."""
    unknown = set(factors) - set(joint.ratios)
    if unknown:
        raise ValueError(f"no such ratio: {', '.join(sorted(unknown))}; there are {', '.join(joint.ratios)}")
    return with_ratios(joint, {name: factor * joint.ratios[name] for name, factor in factors.items()})


def positive_impact_delay(recording: Recording) -> float:
    """How much later than half a turn after the negative impact the positive one comes [s].

    From the phase between the two halves of the mean settled turn, weighted by their cross spectrum below 100 Hz.
    """
    dt = recording.t[1] - recording.t[0]
    half_turn = round(recording.turn_period_s / 2 / dt)
    settled = recording.v[2 * half_turn : 12 * half_turn] - recording.commanded_speed_rps
    turn = settled.reshape(-1, 2 * half_turn).mean(axis=0)
    negative, positive = turn[:half_turn], turn[half_turn:]
    if np.abs(negative.min()) < np.abs(negative.max()):
        negative, positive = positive, negative
    spectrum = np.fft.rfft(-negative).conj() * np.fft.rfft(positive)
    frequency = np.fft.rfftfreq(half_turn, dt)
    band = (frequency > 0) & (frequency < 100)
    weight = np.abs(spectrum[band])
    phase = np.angle(spectrum[band])
    return float(-np.sum(weight * phase * frequency[band]) / np.sum(weight * frequency[band] ** 2) / (2 * np.pi))


# Rough values, from which the fit finds the identified ones; with all signs right, which it keeps.
CALIBRATION_START = {
    "stiffness_per_s2": 4.5e4,
    "gravity_per_s2": 33.0,
    "inertia_ratio": 5.0,
    "speed_gain_per_s": 850.0,
    "integral_gain_per_s2": 1.5e5,
    "derivative_gain": 1.0,
    "leaky_gain_per_s2": -4e4,
    "position_gain_per_s": 25.0,
    "leaky_rate_per_s": 30.0,
    "torque_lag_s": 1.5e-3,
    "start_angle_rad": 0.149,
    "lead_s": 0.0455,
}


def reidentify_joint() -> str:
    """Identify the joint from the authors' clean records, from a rough start."""
    records = clean_records(FIT_LEVELS)
    start = joint_from_ratios(CALIBRATION_START)
    fit = identify_joint(records, start)
    leads = start.control_period_s * np.arange(0, 161)
    lead = identify_lead(records, fit.parameters, leads)
    fit = replace(fit, parameters=replace(fit.parameters, lead_s=float(round(lead, 9))))
    sources = [authors_file(f"Speeddata{level}.xlsx") for level in FIT_LEVELS]
    return joint_record(fit, sources, {name: version(name) for name in ("numpy", "scipy", "numba")})
