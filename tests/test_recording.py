import numpy as np
import pytest

from replication import published, table2
from replication.public_files import DataUnavailable
from replication.records import Recording, add_uniform_noise, constant_speed, from_sample
from replication.sources import load_clean, load_noisy
from studies.replay import inspection


def test_a_record_from_a_later_sample_starts_at_time_zero():
    record = constant_speed(samples=50, dt=0.002)
    cut = from_sample(record, 10)
    assert (cut.t[0], cut.t.size) == (0.0, 40)
    with pytest.raises(ValueError, match="start sample 48"):
        from_sample(record, 48)


def test_added_noise_is_reproducible_and_bounded():
    record = constant_speed(samples=500, dt=0.002)
    first, second = (add_uniform_noise(record, 0.1, np.random.default_rng(3)).v for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert 0.099 < np.abs(first - 100).max() <= 0.1


def test_the_clean_records_are_twelve_turns_of_five_significant_digits(authors_data):
    for level in range(3, 14):
        record = load_clean(level)
        assert record.t.size == 2401
        np.testing.assert_allclose(np.diff(record.t), record.sample_s, rtol=1e-6)
        assert round(np.ptp(record.t) / record.turn_period_s) == published.value("text.turns")
        five_digits = np.where(record.v < 100, record.v.round(3), record.v.round(2))
        np.testing.assert_array_equal(record.v, five_digits)


def test_the_one_bad_first_row_is_dropped(authors_data):
    record = load_noisy(1, 1)
    assert record.t.size == 2401
    np.testing.assert_allclose(np.diff(record.t), 0.002, rtol=1e-6)
    assert abs(record.v[0] - 100) < 0.2


def test_the_turn_period_in_the_data_is_400_ms(authors_data):
    for level in (3, 8, 13):
        period = inspection.turn_period(load_clean(level))
        assert period == pytest.approx(0.400, abs=2e-4)
        assert abs(period - published.value("table1.T_f.max")) > 10 * published.tolerance(
            "table1.T_f.max"
        )


def test_the_turn_period_of_a_made_record_is_found_to_a_tenth_of_a_sample():
    t = 0.002 * np.arange(2401)
    record = Recording(t, 100 + np.sin(2 * np.pi * t / 0.4137), 100.0, 0.4, "made")
    assert inspection.turn_period(record) == pytest.approx(0.4137, abs=2e-4)


@pytest.fixture(scope="module")
def noise_laws(authors_data):
    return {
        level: inspection.uniform_noise_test(inspection.added_noise(level, 1))
        for level in range(3, 12)
    }


def test_the_added_noise_is_uniform_with_the_printed_half_amplitude(noise_laws):
    printed = dict(zip(table2.table2_levels(), published.column("Table 2", "noise"), strict=False))
    for level, law in noise_laws.items():
        assert law["p_uniform"] > 0.01
        assert law["p_mean"] > 0.003
        half = np.ptp(inspection.added_noise(level, 1)) / 2
        assert half == pytest.approx(printed[level], rel=0.005)


def test_the_added_noise_is_not_gaussian(noise_laws):
    assert max(law["p_normal"] for law in noise_laws.values()) < 1e-3


def test_level_1_is_not_free_of_backlash(authors_data):
    record = load_noisy(1, 1)
    only_noise = 0.1 / np.sqrt(3)
    assert record.v.std() > 1.2 * only_noise


def test_the_first_negative_impact_is_a_start_up_transient(authors_data):
    record = load_clean(10)
    turns = record.v[:2400].reshape(12, 200).min(axis=1) - record.commanded_speed_rps
    assert turns[0] < 1.1 * turns[1:].min()
    assert np.ptp(turns[1:]) < 0.02 * abs(turns[1:].mean())


def test_a_level_below_the_published_ones_is_refused(authors_data):
    with pytest.raises(DataUnavailable, match=r"Speeddata2\.xlsx"):
        load_clean(2)


@pytest.mark.parametrize(("level", "realisation"), [(3, 7), (3, 0), (21, 1), (0, 11)])
def test_a_noisy_record_that_is_not_public_is_refused_in_one_line(level, realisation):
    with pytest.raises(ValueError, match=rf"^no noisy record K = {level}, R = {realisation}: .*$"):
        load_noisy(level, realisation)
