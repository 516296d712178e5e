"""One table for all studies: logs of known backlash by methods."""

from functools import partial

import numpy as np
import pandas as pd
import pytest

from replication.recording import Recording
from studies.benchmark import KnownLog, logs_by_methods, summarise_intervals


def made(number, delta_rad):
    t = np.arange(3.0)
    return KnownLog(
        {"number": number}, delta_rad, Recording(t, np.full(3, delta_rad), 100.0, 0.4, "made")
    )


def answers(log):
    found = float(log.recording.v[0])
    return {"truth": found, "double": {"found_rad": 2 * found, "reason": "doubled"}}


def test_each_log_has_a_row_for_each_method_with_its_labels_its_error_and_what_the_method_says():
    table = logs_by_methods([made(1, 1e-3), partial(made, 2, 2e-3)], answers)
    assert table["number"].tolist() == [1, 1, 2, 2]
    assert table["method"].tolist() == ["truth", "double"] * 2
    assert table["error_rad"].tolist() == [0.0, 1e-3, 0.0, 2e-3]
    assert table["reason"].fillna("").tolist() == ["", "doubled"] * 2


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
