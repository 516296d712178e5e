"""Rates and their intervals."""

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
