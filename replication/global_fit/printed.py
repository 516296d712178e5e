"""The global fit of Table 2's records, beside the printed means."""

from collections.abc import Sequence

import pandas as pd

from replication import published
from replication.datasets import Recording, level_delta_rad
from replication.global_fit.fit import global_fit
from replication.table2 import table2_levels


def global_table2(records: Sequence[tuple[dict, Recording]]) -> pd.DataFrame:
    """The global fit of one realisation's `authors_table2_records` beside the printed means, a row each."""
    printed = {name: published.column("Table 2", name) for name in ("theoretical", "mean", "sd")}
    rows = []
    for key, recording in records:
        fit, at = global_fit(recording), key["row"] - 1
        theory, mean = printed["theoretical"][at], printed["mean"][at]
        rows.append(
            {
                "row": key["row"],
                "delta_rad": level_delta_rad(table2_levels()[at]),
                "theoretical_A_rps": theory,
                "printed_mean_A_rps": mean,
                "printed_sd_A_rps": printed["sd"][at],
                "A_rps": fit.amplitude_rps,
                "low_rps": fit.amplitude_interval_rps[0],
                "high_rps": fit.amplitude_interval_rps[1],
                "rmse_rps": fit.rmse,
                "error_percent": 100 * (fit.amplitude_rps / theory - 1),
                "against_printed_percent": 100 * (fit.amplitude_rps / mean - 1),
                "at_bound": " ".join(fit.at_bound),
                "sign_flipped": fit.sign_flipped,
                "rivals": len(fit.rival_rps),
            }
        )
    return pd.DataFrame(rows)
