"""Intervals that several parts of the project need, all of one level."""

from collections.abc import Sequence

import numpy as np
from scipy import stats

LEVEL = 0.95


def rate_columns(hits: int, runs: int, name: str = "rate") -> dict[str, float]:
    """A rate and its 95 % interval, after Clopper and Pearson (NaN without runs): `name, name_low, name_high`."""
    low, high = (
        stats.binomtest(hits, runs).proportion_ci(LEVEL, method="exact")
        if runs
        else (np.nan, np.nan)
    )
    return {name: hits / max(runs, 1), f"{name}_low": float(low), f"{name}_high": float(high)}


def predictive_region(values: Sequence[float]) -> tuple[float, float]:
    """Ends between which one more number like these lies with at least 95 %: order statistics, no law assumed.

    Of N numbers the k-th smallest and the k-th largest, k the largest with 1 - 2 k / (N + 1) >= 95 %.
    Anywhere, where N is below 39.
    """
    k = int((len(values) + 1) * (1 - LEVEL) / 2 + 1e-9)
    ranked = sorted(values)
    return (ranked[k - 1], ranked[-k]) if k else (-np.inf, np.inf)
