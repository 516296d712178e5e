"""Intervals: of a rate, and of one more number."""

from collections.abc import Sequence

import numpy as np
from scipy import stats

from replication.signature import FloatArray

LEVEL = 0.95


def rate_columns(hits: int, runs: int, name: str = "rate") -> dict[str, float]:
    """A rate and its 95 % interval, after Clopper and Pearson (NaN without runs): `name, name_low, name_high`."""
    low, high = (
        stats.binomtest(hits, runs).proportion_ci(LEVEL, method="exact")
        if runs
        else (np.nan, np.nan)
    )
    return {name: hits / max(runs, 1), f"{name}_low": float(low), f"{name}_high": float(high)}


def prediction_interval(
    numbers: Sequence[float] | FloatArray, level: float = LEVEL
) -> tuple[float, float]:
    """Ends between which one more number like these lies with at least this probability, whatever their law.

    Of N numbers in order, one more lies between the k-th from either end with the probability 1 - 2 k / (N + 1); k is
    the largest that gives `level`. Infinite where N is too small: below 39 for 95 %.
    """
    ranked = np.sort(numbers)
    k = int((ranked.size + 1) * (1 - level) / 2 + 1e-9)
    return (float(ranked[k - 1]), float(ranked[-k])) if k else (-np.inf, np.inf)
