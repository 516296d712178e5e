"""What the authors' records show by themselves: their turn period and their noise."""

import numpy as np
from scipy import signal, stats

from replication.arrays import FloatArray
from replication.records import LOW_NOISE, Recording
from replication.records import load_clean, load_noisy
from replication.table2 import LEVELS

# Parameters of a stored run, in `signature.FREE_PARAMETERS` order.
STORED_NAMES = (
    "A_rps",
    "t0_s",
    "tau_per_s",
    "omega_rad_per_s",
    "c_rps",
    "window_end_s",
    "window_start_s",
)


def turn_period(recording: Recording) -> float:
    """Turn period [s]: the lag, within 20 % of the recording's own, at which its settled part best resembles itself."""
    expected = recording.turn_period_s / recording.sample_s
    settled = recording.v[round(expected) :]
    lags = np.arange(round(0.8 * expected), round(1.2 * expected) + 1)
    mismatch = np.array([np.mean((settled[lag:] - settled[:-lag]) ** 2) for lag in lags])
    best = int(np.clip(mismatch.argmin(), 1, lags.size - 2))
    before, at, after = mismatch[best - 1 : best + 2]
    lag = lags[best] + 0.5 * (before - after) / (before - 2 * at + after)
    return float(lag * recording.sample_s)


def interpolated_peak_rps(recording: Recording) -> float:
    """Theoretical A [rps] of a clean recording: its settled turns' largest v - v_t, at a 40th of its sampling period.

    The settled turns are one period of their Fourier series, which is the band-limited interpolation
    without a parameter and without a model of the joint.
    """
    turn = round(recording.turn_period_s / recording.sample_s)
    settled = recording.v[turn : recording.v.size // turn * turn]
    return signal.resample(settled, 40 * settled.size).max() - recording.commanded_speed_rps


def added_noise(level: int, realisation: int) -> FloatArray:
    """Noise that was added to the authors' clean record of a level [rps]."""
    return load_noisy(level, realisation).v - load_clean(level).v


def uniform_noise_test(noise: FloatArray) -> dict[str, float]:
    """P-values of a noise: of two laws (Kolmogorov and Smirnov's), of its mean, of the correlation of neighbours."""
    correlation = np.corrcoef(noise[1:], noise[:-1])[0, 1]
    z = [noise.mean() / stats.sem(noise, ddof=0), correlation * np.sqrt(noise.size - 1)]
    p_mean, p_lag_one = 2 * stats.norm.sf(np.abs(z))
    return {
        "p_uniform": stats.kstest(noise, stats.uniform(noise.min(), np.ptp(noise)).cdf).pvalue,
        "p_normal": stats.kstest(noise, stats.norm(noise.mean(), noise.std()).cdf).pvalue,
        "p_mean": p_mean,
        "p_lag_one": p_lag_one,
    }


def noise_amplitudes() -> FloatArray:
    """Half-amplitude of the noise [rps] in the authors' low-noise records of Table 2's ten rows, R = 1 to 5.

    Half the range of what was added to the clean record; where that is not public, from the
    variance about the mean of the five realisations, which is a twelfth of the squared range.
    """
    first, *public = LEVELS
    variance = np.var([load_noisy(first, R).v for R in LOW_NOISE], axis=0, ddof=1)
    ranges = [np.ptp([added_noise(level, R) for R in LOW_NOISE]) for level in public]
    return np.array([np.sqrt(12 * variance.mean()), *ranges]) / 2
