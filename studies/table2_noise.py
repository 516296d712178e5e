"""Which noise and which start are behind Table 2: a prediction fixed beforehand, drawn starts, nearness of noises.

The prediction, fixed on 2026-11-24, before a run with its seeds was made. Searches through some 340
settings, outside this project, had found that the authors' noise R = 1 without the last turn
(samples 0 to 2200) gives nearly the printed means. If that noise and that window are Table 2's, then
with fresh seeds, the speed in rpm about its mean, Table 1's box, a population of 600 and 300 runs on
each row: the means of |A| over all runs lie within 1 % of the printed ones in rows 1 to 8, and the
SDs over all runs between 0.0015 and 0.0025 rps in rows 1, 2 and 7. It holds if all eleven numbers
do. It is run once, and the outcome is kept whichever way it falls.
"""

from dataclasses import replace

import numpy as np
from pandas import DataFrame

from replication.recording import Recording
from replication.replay.protocols import CANDIDATES
from replication.table2 import authors_table2_records, error_percent, repeated_fits, table2

LEADER = CANDIDATES["rpm, population 600"]
SEED = 20261124

PREDICTED_RUNS = 300
PREDICTED_MEANS = range(1, 9)  # rows
MEAN_WITHIN_PERCENT = 1.0
PREDICTED_SDS = (1, 2, 7)  # rows
SD_BETWEEN_RPS = (0.0015, 0.0025)


def without_last_turn(recording: Recording) -> Recording:
    """Samples 0 to 2200 of a record of twelve turns."""
    return replace(recording, t=recording.t[:2201], v=recording.v[:2201])


def run_prediction() -> DataFrame:
    """The runs of the prediction, condensed to a row for each of Table 2's rows."""
    records = [(key, without_last_turn(record)) for key, record in authors_table2_records([1])]
    seeds = 1 + np.random.SeedSequence(SEED).generate_state(PREDICTED_RUNS) // 2
    return table2(repeated_fits(records, [LEADER], seeds.tolist(), "prediction"))


def failed_predictions(table: DataFrame) -> dict[str, list[int]]:
    """Rows of Table 2 whose mean or SD is not as predicted, from `run_prediction`."""
    off = error_percent(table, "mean_A_rps").abs()
    missed = {
        "mean": table["row"].isin(PREDICTED_MEANS) & ~(off < MEAN_WITHIN_PERCENT),
        "sd": table["row"].isin(PREDICTED_SDS) & ~table["sd_A_rps"].between(*SD_BETWEEN_RPS),
    }
    return {of: table.loc[rows, "row"].tolist() for of, rows in missed.items()}
