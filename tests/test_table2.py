import numpy as np
import pandas as pd
import pytest

from replication import published, table2, table2_claims
from replication.records import LOW_NOISE, read_noisy


@pytest.mark.parametrize("realisations", [[], [7]])
def test_table_2_is_made_of_published_noise_or_refused_in_one_line(realisations):
    with pytest.raises(
        ValueError, match=r"^(realisations \[\]: name some of 1 to 5|no noisy record K = 2, R = )"
    ):
        table2.table2_records(realisations, read_noisy)


def test_no_runs_are_refused_before_anything_is_computed():
    with pytest.raises(ValueError, match=r"^no seeds: .*$"):
        table2.repeated_fits([], [table2.AUTHORS_SETTINGS], range(1, 1), label="none")


@pytest.mark.slow
def test_the_five_realisations_give_fifty_records_of_their_own(authors_data):
    records = table2.table2_records(LOW_NOISE, read_noisy)
    assert len({(key["realisation"], key["row"]) for key, _ in records}) == 50
    assert len({recording.v.tobytes() for _, recording in records}) == 50


def test_the_sd_of_the_runs_is_that_of_a_sample():
    A = [0.26, 0.27, -0.28]
    runs = pd.DataFrame({"A_rps": A, "rmse_rps": 1.0, "realisation": 1, "row": 1})
    runs = runs.assign(delta_rad=3e-4, noise_amplitude_rps=0.1079)
    (found,) = table2.table2(runs).to_dict("records")
    assert found["mean_A_rps"] == pytest.approx(0.27)
    assert found["sd_A_rps"] == pytest.approx(0.01)


def test_misfits_within_two_thousandths_are_one_basin():
    assert table2.basin_labels(np.array([1.0, 1.00199, 1.00403])).tolist() == [1, 1, 2]


def test_the_error_against_the_printed_mean_is_relative():
    means = published.column("Table 2", "mean")
    rows = pd.DataFrame([{"row": row, "A": 1.02 * means[row - 1]} for row in (1, 10)])
    assert table2.error_percent(rows, "A").tolist() == pytest.approx([2.0, 2.0])


@pytest.mark.parametrize(
    ("off", "holds"), [(0.02, True), (0.2, False), (0.093, None), (0.0995, None)]
)
def test_an_error_near_the_limit_is_undecided(off, holds):
    theoretical = published.column("Table 2", "theoretical")[:10]
    rng = np.random.default_rng(1)
    runs = pd.DataFrame(
        [
            {"realisation": 1, "row": row, "A_rps": A * (1 - off + rng.normal(0, 0.01))}
            for row, A in enumerate(theoretical, start=1)
            for _ in range(30)
        ]
    )
    decided, said = table2_claims.decide_error_below_10(runs)
    assert decided is holds
    largest = max(
        100 * abs(part["A_rps"].mean() / theoretical[row - 1] - 1)
        for row, part in runs.groupby("row")
    )
    assert said.startswith(f"largest error of a mean {largest:.1f} %")


@pytest.mark.parametrize(
    ("hits", "holds"), [([24, 20, 22], True), ([3, 6, 5], False), ([16, 20, 24], None)]
)
def test_the_share_of_runs_in_the_best_basin_varies_with_the_record(hits, holds):
    decided, said = table2_claims.decide_local_minima(
        pd.DataFrame({"best_basin_runs": hits, "runs": 30})
    )
    assert decided is holds
    assert said.startswith(f"{sum(hits)} of 90 runs on 3 noisy records")
    assert "stored runs on the noise-free record 12, 10 do" in said


@pytest.mark.parametrize(("size", "coverage"), [(39, 0.95), (200, 0.95), (60, 1 - 2 / 61)])
def test_one_more_number_lies_in_the_region_as_often_as_it_says(size, coverage):
    drawn = np.exp(np.random.default_rng(1).standard_normal((4000, size + 1)))
    regions = np.array([table2.predictive_region(row[:-1]) for row in drawn])
    share = np.mean((regions[:, 0] <= drawn[:, -1]) & (drawn[:, -1] <= regions[:, 1]))
    assert share == pytest.approx(coverage, abs=0.012)


def test_a_region_of_too_few_numbers_is_everything():
    assert table2.predictive_region(range(38)) == (-np.inf, np.inf)
    assert table2.predictive_region(range(39)) == (0, 38)
