"""How well a record can tell the backlash at all: the Cramer-Rao bound, and the smallest backlash to be seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy import stats

from replication.arrays import FloatArray
from replication.datasets import Recording, add_uniform_noise
from replication.methods.joint_match import NUISANCES, PHASES, changed, settled_turn
from replication.methods.readings import read
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import JointParameters
from replication.statistics import rate_columns

# Step in backlash of central differences.
_STEP_RAD = 1e-6


@dataclass(frozen=True, eq=False)
class Slopes:
    """Settled speed of a turn at even phases, differentiated by the backlash and by nuisances, a row each."""

    turn_period_s: float
    slope: FloatArray


def waveform_slopes(joint: JointParameters, delta_rad: float, free: Sequence[str] = ("start_angle",)) -> Slopes:
    """Differentiate the joint's settled waveform by the backlash and by nuisances."""

    def turn(delta: float, **unknown: float) -> FloatArray:
        return settled_turn(changed(joint, unknown), delta, PHASES)

    slopes = [(turn(delta_rad + _STEP_RAD) - turn(delta_rad - _STEP_RAD)) / (2 * _STEP_RAD)]
    for name in free:
        value, (low, _), step = NUISANCES[name]
        before = value if value - step < low else value - step  # friction cannot be negative
        slopes.append(
            (turn(delta_rad, **{name: value + step}) - turn(delta_rad, **{name: before})) / (value + step - before)
        )
    return Slopes(joint.turn_period_s, np.array(slopes))


def cramer_rao_sd(slopes: FloatArray, noise_sd: float) -> float:
    """Least SD of the first unknown (slopes: unknowns by samples) in white noise, a constant offset unknown too."""
    if slopes.shape[1] <= len(slopes):
        return np.inf
    centred = slopes - slopes.mean(axis=1, keepdims=True)
    information = centred @ centred.T
    scale = np.sqrt(np.diag(information))  # unknowns in units of their own, so that the inverse is well conditioned
    inverse = np.linalg.inv(information / np.outer(scale, scale))
    return float(noise_sd * np.sqrt(inverse[0, 0]) / scale[0])


def speed_bound_rad(slopes: Slopes, noise_sd_rps: float, sampling_hz: float, turns: int) -> float:
    """Least SD of an unbiased backlash from settled speed samples in white Gaussian noise."""
    phase = np.arange(round(turns * slopes.turn_period_s * sampling_hz)) / (slopes.turn_period_s * sampling_hz) % 1.0
    grid = np.arange(slopes.slope.shape[1]) / slopes.slope.shape[1]
    return cramer_rao_sd(np.array([np.interp(phase, grid, slope, period=1.0) for slope in slopes.slope]), noise_sd_rps)


def encoder_bound_rad(slopes: Slopes, bits: int, sampling_hz: float, turns: int) -> float:
    """Least SD of an unbiased backlash from an encoder's positions, their rounding taken for white noise."""
    t = np.arange(round(turns * slopes.turn_period_s * sampling_hz)) / sampling_hz
    size = slopes.slope.shape[1]
    dt = slopes.turn_period_s / size
    swing = [np.cumsum(slope - slope.mean()) * dt for slope in slopes.slope]
    grid = np.arange(size) * dt
    columns = [np.interp(t, grid, position, period=slopes.turn_period_s) for position in swing]
    return cramer_rao_sd(np.array([*columns, t - t.mean()]), 2.0**-bits / np.sqrt(12))


def noisy_energy(clean: Recording, half_amplitude_rps: float, seeds: Sequence[int]) -> FloatArray:
    """RMS of the signature fitted to a record with uniform noise [rps], once for each seed."""

    def value(seed: int) -> float:
        noisy = add_uniform_noise(clean, half_amplitude_rps, np.random.default_rng(seed))
        return read(noisy, "energy").value

    return np.array(Parallel(n_jobs=-1, batch_size=8)(delayed(value)(seed) for seed in seeds))


def detection(
    joint: JointParameters,
    deltas_rad: Sequence[float],
    half_amplitude_rps: float,
    rate: float,
    healthy: int,
    repeats: int,
    seed: int,
) -> pd.DataFrame:
    """How often backlash is seen by the signature's energy, with a threshold from records without backlash."""
    seeds = np.random.default_rng(seed).integers(2**31, size=2 * healthy + len(deltas_rad) * repeats).tolist()
    first, fresh, others = seeds[:healthy], seeds[healthy : 2 * healthy], seeds[2 * healthy :]
    clean = simulate_recordings(joint, [0.0, *deltas_rad])
    threshold = float(np.quantile(noisy_energy(clean[0], half_amplitude_rps, first), 1 - rate))
    groups = [fresh, *(others[k * repeats : (k + 1) * repeats] for k in range(len(deltas_rad)))]
    rows = []
    for delta, record, group in zip([0.0, *deltas_rad], clean, groups, strict=True):
        seen = int((noisy_energy(record, half_amplitude_rps, group) > threshold).sum())
        settings = {"noise_half_amplitude_rps": half_amplitude_rps, "delta_rad": delta, "threshold_rps": threshold}
        rows.append(settings | rate_columns(seen, len(group), "seen"))
    return pd.DataFrame(rows)


def smallest_seen_rad(table: pd.DataFrame, power: float) -> float:
    """Backlash, interpolated, from which on the share that `detection` sees stays at `power`; NaN if it never does."""
    below = np.flatnonzero(table["seen"].to_numpy() < power)
    last = below[-1] if below.size else 0
    if last == len(table) - 1:
        return float("nan")
    pair = table.iloc[last : last + 2]
    return float(np.interp(power, pair["seen"], pair["delta_rad"]))


def matched_filter_delta_rad(
    joint: JointParameters, deltas_rad: Sequence[float], noise_sd_rps: float, samples: int, rate: float, power: float
) -> float:
    """Smallest backlash that a filter which knows the waveform sees in white Gaussian noise."""
    needed = stats.norm.isf(rate) + stats.norm.ppf(power)
    healthy = settled_turn(joint, 0.0, PHASES)
    distance = [
        np.std(settled_turn(joint, delta, PHASES) - healthy) * np.sqrt(samples) / noise_sd_rps for delta in deltas_rad
    ]
    if distance[-1] < needed:
        return float("nan")
    return float(np.interp(needed, distance, deltas_rad))


def detection_summary(tables: Sequence[pd.DataFrame], filtered_rad: Sequence[float], power: float) -> pd.DataFrame:
    """Summarise detection at each loudness of the noise."""
    rows = [
        (
            *table.iloc[0][["noise_half_amplitude_rps", "seen", "seen_low", "seen_high"]],
            smallest_seen_rad(table, power),
            f,
        )
        for table, f in zip(tables, filtered_rad, strict=True)
    ]
    alarms = ["false_alarms", "false_alarms_low", "false_alarms_high"]
    return pd.DataFrame(rows, columns=["noise_half_amplitude_rps", *alarms, "smallest_seen_rad", "matched_filter_rad"])
