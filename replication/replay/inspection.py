"""What the authors' records and stored runs show by themselves: turns, impacts, noise, first generations."""

from dataclasses import replace

import numpy as np
import pandas as pd
from scipy import stats

from replication import published
from replication.arrays import FloatArray
from replication.datasets import LOW_NOISE, Recording, load_clean, load_noisy
from replication.identify import paper_fit
from replication.signature import Timing, rmse
from replication.table2 import AUTHORS, basin_labels, table2_levels

# Parameters of a stored run, in `signature.FREE_PARAMETERS` order.
STORED_NAMES = ("A_rps", "t0_s", "tau_per_s", "omega_rad_per_s", "c_rps", "window_end_s", "window_start_s")


def impacts_alternate(recording: Recording) -> bool:
    """Whether the largest excursion alternates its sign by half turns; the first turn, a transient, is left out."""
    half_turn = round(recording.turn_period_s / 2 / recording.sample_s)
    disturbance = recording.v - recording.commanded_speed_rps
    halves = disturbance[2 * half_turn : disturbance.size // half_turn * half_turn].reshape(-1, half_turn)
    signs = np.sign(halves[np.arange(len(halves)), np.abs(halves).argmax(axis=1)])
    return bool((signs[1:] == -signs[:-1]).all())


def turn_period(recording: Recording) -> float:
    """Turn period [s]: the lag, within 20 % of the recording's own, at which its settled part best resembles itself."""
    dt = recording.t[1] - recording.t[0]
    expected = recording.turn_period_s / dt
    settled = recording.v[round(expected) :]
    lags = np.arange(round(0.8 * expected), round(1.2 * expected) + 1)
    mismatch = np.array([np.mean((settled[lag:] - settled[:-lag]) ** 2) for lag in lags])
    best = int(np.clip(mismatch.argmin(), 1, lags.size - 2))
    before, at, after = mismatch[best - 1 : best + 2]
    return float((lags[best] + 0.5 * (before - after) / (before - 2 * at + after)) * dt)


def half_turn_mismatch(recording: Recording) -> float:
    """How far a settled record differs from itself inverted and half a turn later, over its SD."""
    half_turn = round(recording.turn_period_s / 2 / recording.sample_s)
    settled = recording.v[2 * half_turn :] - recording.commanded_speed_rps
    return float(np.sqrt(np.mean((settled[half_turn:] + settled[:-half_turn]) ** 2)) / settled.std())


def added_noise(level: int, realisation: int) -> FloatArray:
    """Noise that was added to the authors' clean record of a level [rps]."""
    return load_noisy(level, realisation).v - load_clean(level).v


def uniform_noise_test(noise: FloatArray) -> pd.Series:
    """Kolmogorov-Smirnov p of a record's noise for two laws, its mean in standard errors, its correlation."""
    low, high = noise.min(), noise.max()
    return pd.Series(
        {
            "p_uniform": stats.kstest(noise, stats.uniform(low, high - low).cdf).pvalue,
            "p_normal": stats.kstest(noise, stats.norm(noise.mean(), noise.std()).cdf).pvalue,
            "mean_over_standard_error": noise.mean() / (noise.std() / np.sqrt(noise.size)),
            "lag_one_correlation": np.corrcoef(noise[1:], noise[:-1])[0, 1],
        }
    )


def noise_amplitudes() -> FloatArray:
    """Half-amplitude of the noise [rps] in the authors' low-noise records of Table 2's ten rows, R = 1 to 5.

    Half the range of what was added to the clean record; where that is not public, from the variance about the mean of
    the five realisations, which is a third of the squared half-amplitude.
    """
    amplitudes = []
    for level in table2_levels():
        if level < 3:
            v = np.array([load_noisy(level, realisation).v for realisation in LOW_NOISE])
            amplitudes.append(np.sqrt(3 * v.var(axis=0, ddof=1).mean()))
        else:
            amplitudes.append(np.ptp([added_noise(level, realisation) for realisation in LOW_NOISE]) / 2)
    return np.array(amplitudes)


def stored_misfits(recording: Recording, turns: int = AUTHORS.turns) -> FloatArray:
    """Misfits [rps] of a record at the parameters of the stored runs, with so many turns in the model."""
    runs, t, v = published.authors_notebook_runs(), recording.t, recording.v
    found = zip(runs[list(STORED_NAMES)].to_numpy(), runs["T_d_s"], runs["T_f_s"], strict=True)
    return np.array([rmse(t, v, X, Timing(T_d, T_f, turns)) for X, T_d, T_f in found])


def stored_runs(recording: Recording) -> pd.DataFrame:
    """Stored misfits of the authors' 30 runs beside ours at their parameters, and today's first generations."""
    stored, first = published.authors_notebook_runs(), replace(AUTHORS, engine="cma", iterations=1)
    return pd.DataFrame(
        {
            "run": stored["run"],
            "stored_rmse_rps": stored["final_rmse_rps"],
            "rmse_rps": stored_misfits(recording),
            "stored_first_rps": stored["generation_1_best_rmse_rps"],
            "first_today_rps": [paper_fit(recording, first, seed).rmse for seed in stored["cma_seed"]],
            "A_rps": stored["A_rps"],
            "basin": basin_labels(stored["final_rmse_rps"].to_numpy()),
        }
    )
