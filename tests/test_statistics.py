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


@pytest.mark.parametrize(("size", "coverage"), [(39, 0.95), (200, 0.95), (60, 1 - 2 / 61)])
def test_one_more_number_lies_in_the_region_as_often_as_it_says(size, coverage):
    drawn = np.exp(np.random.default_rng(1).standard_normal((4000, size + 1)))
    regions = np.array([statistics.predictive_region(row[:-1]) for row in drawn])
    share = np.mean((regions[:, 0] <= drawn[:, -1]) & (drawn[:, -1] <= regions[:, 1]))
    assert share == pytest.approx(coverage, abs=0.012)


def test_a_region_of_too_few_numbers_is_everything():
    assert statistics.predictive_region(range(38)) == (-np.inf, np.inf)
    assert statistics.predictive_region(range(39)) == (0, 38)
