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


def another_interval(values: Sequence[float]) -> tuple[float, float]:
    """95 % interval in which another value like these lies: mean ± t(n - 1) s sqrt(1 + 1/n)."""
    size = len(values)
    half = stats.t.ppf((1 + LEVEL) / 2, size - 1) * np.std(values, ddof=1) * np.sqrt(1 + 1 / size)
    return float(np.mean(values) - half), float(np.mean(values) + half)
