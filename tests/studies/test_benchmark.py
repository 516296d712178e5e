"""One table for all studies: logs of known backlash by methods."""

import numpy as np
import pandas as pd
import pytest

from studies.benchmark import summarise_intervals


def test_refused_logs_count_as_refused_and_not_as_errors():
    rows = pd.DataFrame(
        {"method": "a", "delta_rad": 1.0, "found_rad": [1.1, 0.8, 9.0], "bound_rad": 0.1}
    )
    rows = rows.assign(low_rad=rows["found_rad"] - 0.15, high_rad=rows["found_rad"] + 0.15)
    rows = rows.assign(population="all", refused=[False, False, True])
    summary = summarise_intervals(rows).iloc[0]
    assert summary["refused"] == pytest.approx(1 / 3)
    assert summary["rmse_rad"] == pytest.approx(np.sqrt(0.025))
    assert summary["coverage"] == 0.5
    assert summary["held_or_refused"] == pytest.approx(2 / 3)
