"""The identified joint against the authors' records, and its identification from a rough start."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pandas as pd

from replication import published
from replication.arrays import FloatArray
from replication.data.authors import authors_file
from replication.datasets import Recording, level_delta_rad, load_clean
from replication.simulator.growth import printed_amplitudes
from replication.simulator.identification import identify_joint, identify_lead, joint_record, validation_table
from replication.simulator.simulate import JointParameters, joint_from_ratios, with_ratios

# Levels K of the authors' data: published clean, used to identify the joint, and all that they made.
CLEAN_LEVELS = range(3, 14)
FIT_LEVELS = (3, 6, 9, 12)
ALL_LEVELS = range(2, 21)


def clean_records(levels: Sequence[int]) -> dict[float, Recording]:
    """Load the authors' clean records of some levels, by backlash [rad]."""
    return {level_delta_rad(level): load_clean(level) for level in levels}


def signals(records: dict[float, Recording]) -> dict[float, tuple[FloatArray, FloatArray]]:
    """Time and speed of records, by backlash [rad]: what the identification takes."""
    return {delta: (record.t, record.v) for delta, record in records.items()}


def validate(joint: JointParameters, records: dict[float, Recording]) -> pd.DataFrame:
    """Compare the simulated joint with every clean record and every printed theoretical A; K = 2 has no record."""
    levels = range(2, CLEAN_LEVELS.stop)
    datasets = {level_delta_rad(level): f"Speeddata{level}" for level in levels}
    used = [level_delta_rad(level) for level in FIT_LEVELS]
    printed = printed_amplitudes()
    return validation_table(joint, signals(records), datasets, used_in_fit=used, printed_a_rps=printed)


def alpha_study(joint: JointParameters, records: dict[float, Recording], alphas: Sequence[float]) -> pd.DataFrame:
    """Misfit of the simulated joint as the edge of equation 8 softens, the rest kept."""
    joints = [(alpha, replace(joint, alpha_per_rad=alpha)) for alpha in alphas]
    joints.append((np.inf, replace(joint, clamped=True)))
    rows = [(alpha, 100 * validate(changed, records)["nrmse"].mean()) for alpha, changed in joints]
    return pd.DataFrame(rows, columns=["alpha_per_rad", "mean_nrmse_percent"])


def simulator_attempts() -> pd.DataFrame:
    """Load the log of the models of the drive that were fitted on the way to the identified one, kept or not."""
    with (published.DATA / "simulator_attempts.csv").open(encoding="utf-8") as file:
        return pd.read_csv(file)


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
    records = signals(clean_records(FIT_LEVELS))
    start = joint_from_ratios(CALIBRATION_START)
    fit = identify_joint(records, start)
    leads = start.control_period_s * np.arange(0, 161)
    lead = identify_lead(records, fit.parameters, leads)
    fit = replace(fit, parameters=replace(fit.parameters, lead_s=float(round(lead, 9))))
    sources = [authors_file(f"Speeddata{level}.xlsx") for level in FIT_LEVELS]
    return joint_record(fit, sources, {name: version(name) for name in ("numpy", "scipy", "numba")})
