"""Variants of the search, ranked by how close they come to Table 2."""

import numpy as np
import pandas as pd

from replication import published
from replication.table2 import summarise_runs


def variant_scores(runs: pd.DataFrame) -> pd.DataFrame:
    """Compare each protocol variant's means and SDs with Table 2's, row by row.

    Parameters
    ----------
    runs : DataFrame
        From `repeated_fits` on the ten records of one realisation with several protocols.

    Returns
    -------
    DataFrame
        One row per protocol and level: `protocol, delta_rad, mean_A_rps, sd_A_rps, mean_error_percent, sd_ratio,
        best_basin_share`.
    """
    means, sds = published.column("Table 2", "mean"), published.column("Table 2", "sd")
    theoretical = published.column("Table 2", "theoretical")
    rows = []
    for (protocol, row), part in runs.groupby(["protocol", "row"], sort=False):
        summary = summarise_runs(part, theoretical[row - 1])
        rows.append(
            {
                "protocol": protocol,
                "delta_rad": part["delta_rad"].iloc[0],
                "mean_A_rps": summary["mean_A_rps"],
                "sd_A_rps": summary["sd_A_rps"],
                "mean_error_percent": 100 * (summary["mean_A_rps"] / means[row - 1] - 1),
                "sd_ratio": summary["sd_A_rps"] / sds[row - 1],
                "best_basin_share": summary["best_basin_runs"] / summary["runs"],
            }
        )
    return pd.DataFrame(rows)


def rank_variants(scores: pd.DataFrame) -> pd.DataFrame:
    """Rank the protocol variants by how close they come to Table 2.

    Parameters
    ----------
    scores : DataFrame
        From `variant_scores`.

    Returns
    -------
    DataFrame
        One row per protocol, the closest first: `mean_abs_error_percent` of the means, `sd_factor` (the geometric mean
        of SD over printed SD or its inverse, whichever is above 1).
    """
    grouped = scores.assign(
        mean_abs_error_percent=scores["mean_error_percent"].abs(), log_sd=np.log(scores["sd_ratio"]).abs()
    ).groupby("protocol", sort=False)
    table = grouped[["mean_abs_error_percent", "log_sd", "best_basin_share"]].mean()
    table = table.assign(sd_factor=np.exp(table.pop("log_sd")))
    return table.sort_values("mean_abs_error_percent", kind="stable").reset_index()
