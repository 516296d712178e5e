import numpy as np
import pytest

from replication.standins.joints import draw_bench
from studies import population


@pytest.fixture(scope="module")
def table():
    harder = {"turns": [12, 4, 1], "decimation factor": [4]}
    return population.degrade_logs(draw_bench(np.random.default_rng(5)), 9e-4, 1, harder).set_index(
        ["what", "value"]
    )


def test_fewer_turns_and_coarser_samples_tell_less(table):
    whole = table.loc[("turns", 12)]
    for harder in (("turns", 4), ("decimation factor", 4)):
        assert table.loc[harder, "sd_rad"] > whole["sd_rad"]
        assert table.loc[harder, "bound_rad"] > whole["bound_rad"]


def test_errors_are_those_that_the_sd_says(table):
    answered = table[table["answer"] == "yes"]
    assert len(answered) == 3
    assert (answered["error_rad"].abs() < 4 * answered["sd_rad"]).all()


def test_a_log_without_turns_enough_says_so(table):
    assert "two turns" in table.loc[("turns", 1), "answer"]
    assert np.isnan(table.loc[("turns", 1), "error_rad"])
