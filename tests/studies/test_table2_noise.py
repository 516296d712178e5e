import numpy as np
import pandas as pd
import pytest

from replication.table2 import SearchSettings
from studies import table2_noise
from studies.replay import protocols

PRINTED = protocols.printed()[0]


def p_of_bias(means):
    return protocols.bias_p(means, float(protocols.pooled_bias(PRINTED)))


def test_the_prediction_fails_only_in_rows_that_it_names():
    table = pd.DataFrame({"row": protocols.ROWS, "mean_A_rps": PRINTED, "sd_A_rps": 0.002})
    assert table2_noise.failed_predictions(table) == {"mean": [], "sd": []}
    off = table.assign(mean_A_rps=1.011 * PRINTED, sd_A_rps=0.0026)
    assert table2_noise.failed_predictions(off) == {"mean": [*range(1, 9)], "sd": [1, 2, 7]}


@pytest.mark.parametrize(("factor", "below"), [(1.0, False), (0.95, True)])
def test_means_that_are_all_low_have_a_small_p_also_on_another_noise(factor, below):
    scatter = np.exp(0.03 * np.random.default_rng(1).standard_normal((10, 40)))
    means = factor * PRINTED[:, None] * scatter
    assert (p_of_bias(means) < 0.001) is below
    each_run = pd.DataFrame({"mean_A_rps": factor * PRINTED, "sd_A_rps": 0.001, "runs": 60})
    assert (p_of_bias(table2_noise.on_other_noises(each_run, means)) < 0.01) is below


@pytest.mark.parametrize(
    ("drawn", "whole", "holds"),
    [(0.3, 0.001, True), (0.001, 0.3, False), (0.3, 0.3, None), (0.001, 0.001, None)],
)
def test_the_start_is_decided_only_if_one_kind_of_start_alone_explains_the_means(
    drawn, whole, holds
):
    p = pd.Series({"start per run": drawn, "start per record": 1e-4, "notebook": whole})
    assert table2_noise.random_start(p)[0] is holds


def test_runs_begin_at_samples_of_their_own(made_record):
    protocol = SearchSettings(population=30, iterations=60)
    found = table2_noise.drawn_starts(made_record, protocol, 4, 1)
    assert found["runs"] == 4
    assert 0.1 < found["mean_A_rps"] < 0.8
    assert found["best_basin_share"] < 1
