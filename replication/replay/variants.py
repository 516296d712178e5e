"""Variants of the protocol, and how close they come to Table 2."""

from dataclasses import replace

import pandas as pd

from replication import published
from replication.table2 import AUTHORS, error_percent, table2

_PRINTED_T_D, _PRINTED_T_F = published.value("table1.T_d.max"), published.value("table1.T_f.max")
VARIANTS = (
    AUTHORS,
    replace(AUTHORS, name="start drawn per run", start="per run"),
    replace(AUTHORS, name="start drawn per record", start="per record"),
    replace(AUTHORS, name="A bound as printed", amplitude_factor=1.0),
    replace(AUTHORS, name="T_d and T_f as printed", T_d=_PRINTED_T_D, T_f=_PRINTED_T_F),
    replace(AUTHORS, name="today's cma", engine="cma"),
    replace(AUTHORS, name="population 1000", population=1000),
)


def variant_scores(runs: pd.DataFrame) -> pd.DataFrame:
    """Compare each variant's means and SDs with Table 2's, row by row, from `repeated_fits` of one realisation."""
    parts = []
    for protocol, part in runs.groupby("protocol", sort=False):
        table = table2(part)
        scores = table[["delta_rad", "mean_A_rps", "sd_A_rps"]].assign(
            mean_error_percent=error_percent(table, "mean_A_rps"),
            sd_ratio=table["sd_A_rps"] / published.column("Table 2", "sd")[table["row"] - 1],
            best_basin_share=table["best_basin_runs"] / table["runs"],
        )
        scores.insert(0, "protocol", protocol)
        parts.append(scores)
    return pd.concat(parts, ignore_index=True)
