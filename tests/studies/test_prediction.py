"""What was predicted of Table 2 is held against the printed numbers."""

import pandas as pd

from replication import published
from studies.prediction import MEANS, SDS, count_met

PRINTED = published.column("Table 2", "mean")[:10]


def test_means_within_one_percent_and_sds_between_the_limits_are_met():
    made = pd.DataFrame({"row": range(1, 11), "mean_A_rps": PRINTED, "sd_A_rps": 0.002})
    assert count_met(made) == (len(MEANS), len(SDS)) == (8, 3)
    off = made["mean_A_rps"] * [0.989, 1.011, 1.009, 0.991, 1, 1, 1, 1, 2, 2]
    sds = [0.0014, 0.0026, 9, 9, 9, 9, 0.0024, 9, 9, 9]
    assert count_met(made.assign(mean_A_rps=off, sd_A_rps=sds)) == (6, 1)
