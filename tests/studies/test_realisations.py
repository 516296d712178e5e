"""Table 2 is made again with noises and seeds of its own under each setting, and kept."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from replication import table2
from replication.records import constant_speed
from studies import realisations


def test_a_row_made_again_is_the_committed_one():
    """Another kernel moves the mean by 2e-4 of it."""
    kept = realisations.read_realisations().set_index(["protocol", "row", "realisation"])
    made = realisations.realise(table2.NOTEBOOK.protocol, 1, 1)
    key = [made.pop(name) for name in kept.index.names]
    expected = kept.loc[tuple(key)]
    assert made["mean_A_rps"] == pytest.approx(expected["mean_A_rps"], rel=1e-3)
    assert made["sd_A_rps"] == pytest.approx(expected["sd_A_rps"], rel=5e-3)
    assert made["best_basin_share"] == pytest.approx(expected["best_basin_share"], abs=1e-6)


@pytest.fixture
def constant(monkeypatch):
    """A speed in place of the authors' records."""
    monkeypatch.setattr(realisations, "load_clean", lambda level: constant_speed())


def test_a_protocol_has_its_own_noise_and_seeds_the_same_twice(constant):
    drawn = [
        realisations.noisy_records(settings, 5, 3)
        for settings in (*realisations.PROTOCOLS.values(), table2.NOTEBOOK)
    ]
    for (record, seed), (again, seed_again) in zip(drawn[0], drawn[-1], strict=True):
        np.testing.assert_array_equal(record.v, again.v)
        assert seed == seed_again
    assert len({tuple(seed for _, seed in each) for each in drawn}) == 14
    assert len({each[0][0].v[-1] for each in drawn}) == 14
    assert {len(each) for each in drawn} == {table2.RUNS}
    # The printed noise of row 5.
    assert np.abs(drawn[0][0][0].v - 100).max() == pytest.approx(0.1394, rel=0.01)


@pytest.mark.parametrize("start", table2.STARTS)
def test_a_start_is_one_of_the_first_hundred_samples_for_what_it_is_drawn_for(start, constant):
    settings = replace(table2.RPM_600, start=start)
    rows = [
        [2401 - record.v.size for record, _ in realisations.noisy_records(settings, row, number)]
        for number, row in product(range(1, 21), (5, 6))
    ]
    starts = np.reshape(rows, (20, 2, 30))  # tables, rows, fits
    assert 0 <= starts.min() <= starts.max() < 100
    of_row, of_table = (np.ptp(starts, axis=axes).max() for axes in (2, (1, 2)))
    assert (of_row > 0) == (start == "per fit")
    assert (of_table > 0) == (start in ("per fit", "per row"))
    assert (np.ptp(starts) > 70) == (start != table2.WHOLE)


def test_a_record_from_a_later_sample_starts_at_time_zero():
    cut = realisations.from_sample(constant_speed(), 10)
    assert (cut.t[0], cut.t[1], cut.t.size) == (0.0, pytest.approx(0.002), 2391)
