"""The two claims that Table 2 decides: no mean errs by 10 %, and runs avoid local minima."""

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from replication import published
from replication.published import Criteria, Decision
from replication.table2 import basin_labels

BOOTSTRAP_DRAWS = 20000


def decide_error_below_10(runs: pd.DataFrame, criteria: Criteria = None) -> Decision:
    """Decide whether every mean |A| errs by less than 10 %, from runs on the authors' records.

    The second value says what was measured: the largest error, with a 95 % bootstrap interval, all
    records together.
    """
    theoretical = published.column("Table 2", "theoretical")
    rng = np.random.default_rng(1)
    records = runs.groupby(["realisation", "row"], sort=False)
    tail = 0.025 / records.ngroups
    errors = []
    for (_, row), part in records:
        amplitude = part["A_rps"].abs().to_numpy()
        true = theoretical[row - 1]
        drawn = rng.integers(amplitude.size, size=(BOOTSTRAP_DRAWS, amplitude.size))
        means = amplitude[drawn].mean(axis=1)
        low, high = np.quantile(100 * np.abs(means / true - 1), [tail, 1 - tail])
        errors.append((100 * abs(amplitude.mean() / true - 1), low, high))
    largest, low, high = np.max(errors, axis=0)
    holds = published.decide("error_below_10", (low, high), criteria)
    return (
        holds,
        f"largest error of a mean {largest:.1f} % (95 % interval {low:.1f} to {high:.1f} %)",
    )


def decide_local_minima(table: pd.DataFrame, criteria: Criteria = None) -> Decision:
    """Decide whether runs avoid local minima, from `table2` of the authors' records; say what was measured.

    The interval of the share is Student's over the records, because runs on one record are not
    independent.
    """
    hits, runs = table["best_basin_runs"], table["runs"]
    share = hits / runs
    half = stdtrit(share.size - 1, 0.975) * share.std() / np.sqrt(share.size)
    low, high = share.mean() - half, share.mean() + half
    stored = basin_labels(published.table("authors_notebook_runs")["final_rmse_rps"].to_numpy())
    return published.decide("local_minima", (low, high), criteria), (
        f"{hits.sum()} of {runs.sum()} runs on {share.size} noisy records end in the best basin, "
        f"{100 * share.mean():.0f} % ({100 * low:.0f} to {100 * high:.0f} %); of the authors' {stored.size} "
        f"stored runs on the noise-free record 12, {(stored == 1).sum()} do"
    )
