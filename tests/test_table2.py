import pandas as pd
import pytest

from replication import datasets, published, table2


@pytest.mark.parametrize("realisations", [[], [7], [1, 11]])
def test_table_2_is_made_of_the_published_low_noise_or_refused_in_one_line(realisations):
    with pytest.raises(ValueError, match=r"^realisations \[.*\]: name some of \[1, 2, 3, 4, 5\], .*$"):
        table2.authors_table2_records(realisations)


def test_no_runs_are_refused_before_anything_is_computed():
    with pytest.raises(ValueError, match=r"^no seeds: .*$"):
        table2.repeated_fits([], [table2.AUTHORS], range(1, 1), label="none")


def test_the_five_realisations_give_fifty_records_of_their_own(authors_data):
    records = table2.authors_table2_records(datasets.LOW_NOISE)
    assert len({(key["realisation"], key["row"]) for key, _ in records}) == 50
    assert len({recording.v.tobytes() for _, recording in records}) == 50


def test_our_numbers_of_a_cell_are_one_for_each_realisation():
    noises = {seed: table2.noise_only_record(seed) for seed in (1, 2)}
    fits = table2.repeated_fits(list(noises.values()), [table2.AUTHORS], [1, 2, 3], label="two noises")
    cells = table2.table2_cells(table2.table2(fits))
    assert list(cells) == ["table2.row11.mean", "table2.row11.sd"]
    for seed, mean in zip(noises, cells["table2.row11.mean"], strict=True):
        assert mean == pytest.approx(fits.loc[fits["realisation"] == seed, "A_rps"].mean())


def test_the_error_against_the_printed_mean_is_of_the_rows_with_backlash():
    means = published.column("Table 2", "mean")
    rows = [{"row": row, "A": 1.02 * means[row - 1], "theoretical_A_rps": float(row < 11)} for row in (1, 10, 11)]
    error = table2.error_percent(pd.DataFrame(rows), "A")
    assert error.tolist()[:2] == pytest.approx([2.0, 2.0])
    assert error.isna().tolist() == [False, False, True]
