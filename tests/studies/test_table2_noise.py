import pandas as pd
import pytest

from replication import published
from studies import table2_noise


@pytest.fixture
def as_predicted():
    printed = published.column("Table 2", "mean")[:10]
    return pd.DataFrame({"row": range(1, 11), "mean_A_rps": 1.005 * printed, "sd_A_rps": 0.002})


def test_the_prediction_fails_only_in_rows_that_it_names(as_predicted):
    assert table2_noise.failed_predictions(as_predicted) == {"mean": [], "sd": []}
    off = as_predicted.assign(mean_A_rps=1.011 * as_predicted["mean_A_rps"] / 1.005)
    assert table2_noise.failed_predictions(off)["mean"] == [*range(1, 9)]
    wide = as_predicted.assign(sd_A_rps=0.0026)
    assert table2_noise.failed_predictions(wide)["sd"] == [1, 2, 7]
