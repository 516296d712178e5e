import numpy as np
import pandas as pd
import pytest

from replication import published, table2
from replication.authors import LOW_NOISE


@pytest.mark.parametrize("realisations", [[], [7], [21]])
def test_table_2_is_made_of_published_noise_or_refused_in_one_line(realisations):
    with pytest.raises(
        ValueError, match=r"^(realisations \[\]: name some of 1 to 5|no noisy record K = 2, R = )"
    ):
        table2.authors_table2_records(realisations)


def test_a_record_is_labelled_by_its_noise_and_how_loud_it_is(monkeypatch):
    monkeypatch.setattr(table2, "load_noisy", lambda level, R: (level, R))
    (low, *_), (high, *_) = (table2.authors_table2_records([R])[9] for R in (1, 11))
    assert (low["noise_level"], high["noise_level"]) == ("low", "high")
    assert low["noise_amplitude_rps"] == published.value("table2.row10.noise")
    assert high["noise_amplitude_rps"] / low["noise_amplitude_rps"] == pytest.approx(1.5)


def test_the_noise_of_our_records_is_made_louder_by_a_factor():
    (_, once), (key, twice) = (table2.noise_only_record(1, factor) for factor in (1.0, 2.0))
    assert twice.v - 100 == pytest.approx(2 * (once.v - 100))
    assert (key["noise_level"], key["noise_amplitude_rps"]) == ("noise only", 0.2)


def test_no_runs_are_refused_before_anything_is_computed():
    with pytest.raises(ValueError, match=r"^no seeds: .*$"):
        table2.repeated_fits([], [table2.AUTHORS_PROTOCOL], range(1, 1), label="none")


@pytest.mark.slow
def test_the_five_realisations_give_fifty_records_of_their_own(authors_data):
    records = table2.authors_table2_records(LOW_NOISE)
    assert len({(key["realisation"], key["row"]) for key, _ in records}) == 50
    assert len({recording.v.tobytes() for _, recording in records}) == 50


def test_our_numbers_of_a_cell_are_one_for_each_realisation():
    noises = {seed: table2.noise_only_record(seed) for seed in (1, 2)}
    fits = table2.repeated_fits(
        list(noises.values()), [table2.AUTHORS_PROTOCOL], [1, 2, 3], label="two noises"
    )
    cells = table2.table2_cells(table2.table2(fits))
    assert list(cells) == ["table2.row11.mean", "table2.row11.sd"]
    for seed, mean in zip(noises, cells["table2.row11.mean"], strict=True):
        A = fits.loc[fits["realisation"] == seed, "A_rps"]
        assert mean == pytest.approx(A.mean())
        assert cells["table2.row11.sd"][seed - 1] == pytest.approx(A.std())


def test_misfits_within_two_thousandths_are_one_basin():
    assert table2.basin_labels(np.array([1.0, 1.00199, 1.00403])).tolist() == [1, 1, 2]


def test_the_error_against_the_printed_mean_is_of_the_rows_with_backlash():
    means = published.column("Table 2", "mean")
    rows = [
        {"row": row, "A": 1.02 * means[row - 1], "theoretical_A_rps": float(row < 11)}
        for row in (1, 10, 11)
    ]
    error = table2.error_percent(pd.DataFrame(rows), "A")
    assert error.tolist()[:2] == pytest.approx([2.0, 2.0])
    assert error.isna().tolist() == [False, False, True]


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
    decided, said = table2.decide_error_below_10(runs)
    assert decided is holds
    largest = max(
        100 * abs(part["A_rps"].mean() / theoretical[row - 1] - 1)
        for row, part in runs.groupby("row")
    )
    assert said.startswith(f"largest error of a mean {largest:.1f} %")


def test_one_realisation_with_a_large_error_decides_on_all_of_them():
    theoretical = published.column("Table 2", "theoretical")[:10]
    runs = pd.DataFrame(
        [
            {"realisation": R, "row": row, "A_rps": A * (0.98 if (R, row) != (4, 7) else 0.8)}
            for R in range(1, 6)
            for row, A in enumerate(theoretical, start=1)
            for _ in range(3)
        ]
    )
    assert table2.decide_error_below_10(runs)[0] is False
    assert table2.decide_error_below_10(runs[runs["realisation"] != 4])[0] is True


@pytest.mark.parametrize(
    ("hits", "holds"), [([24, 20, 22], True), ([3, 6, 5], False), ([16, 20, 24], None)]
)
def test_the_share_of_runs_in_the_best_basin_varies_with_the_record(hits, holds):
    decided, said = table2.decide_local_minima(pd.DataFrame({"best_basin_runs": hits, "runs": 30}))
    assert decided is holds
    assert said.startswith(f"{sum(hits)} of 90 runs on 3 noisy records")
    assert "stored runs on the noise-free record 12, 10 do" in said


def test_one_record_alone_does_not_decide_on_local_minima():
    assert (
        table2.decide_local_minima(pd.DataFrame({"best_basin_runs": [30], "runs": [30]}))[0] is None
    )
