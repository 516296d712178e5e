import numpy as np
import pytest

from replication import statistics


def test_the_interval_of_a_rate_is_clopper_and_pearsons():
    none = {"rate": 0, "rate_low": 0, "rate_high": pytest.approx(1 - 0.025**0.1)}
    assert statistics.rate_columns(0, 10) == none
    assert statistics.rate_columns(10, 10)["rate_high"] == 1
    assert statistics.rate_columns(5, 10, "seen")["seen"] == 0.5
    assert np.isnan(
        [statistics.rate_columns(0, 0)[name] for name in ("rate_low", "rate_high")]
    ).all()


def test_another_value_lies_in_its_interval_95_times_of_100():
    rng = np.random.default_rng(1)
    drawn = rng.standard_normal((4000, 6))
    intervals = np.array([statistics.another_interval(row[:5]) for row in drawn])
    share = np.mean((intervals[:, 0] < drawn[:, 5]) & (drawn[:, 5] < intervals[:, 1]))
    assert share == pytest.approx(0.95, abs=0.012)
