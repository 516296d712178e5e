"""Proofs that `errata.csv` names; those on equation 10 are in `test_published.py`, on 8 and 9 in `test_joint.py`."""

from itertools import islice

import numpy as np
import pytest
from scipy import stats

from replication import published
from replication.characteristic import printed_rows
from replication.cmaes import constants, generations, update
from replication.records import load_clean, load_noisy
from replication.signature import Box, Timing, d_b, h
from replication.table2 import NOISE_ROW, NOTEBOOK, search_box
from studies.realisations import noisy_records
from tests.made import TIME as T
from tests.made import TRUE as X


def first_ten(*columns):
    return (published.column("Table 2", name)[:10] for name in columns)


# ----------------------------------------------------------------------------------------------- data and noise


def test_the_turn_period_in_the_data_is_400_ms(authors_data):
    for level in (3, 8, 13):
        v = load_clean(level).v[200:]  # without the start-up transient
        off = {lag: np.sqrt(np.mean((v[lag:] - v[:-lag]) ** 2)) for lag in range(190, 211)}
        assert min(off, key=off.get) == 200
        assert off[204] > 5 * off[200]  # samples of 2 ms: the printed 0.408 s


def test_the_added_noise_is_not_gaussian(authors_data):
    for level in range(3, 12):
        noise = load_noisy(level, 1).v - load_clean(level).v
        assert stats.normaltest(noise).pvalue < 1e-6
        half = published.value(f"table2.row{level - 1:02d}.noise")
        assert np.ptp(noise) / 2 == pytest.approx(half, rel=0.005)
        assert stats.kstest(noise, stats.uniform(-half, 2 * half).cdf).pvalue > 0.001


def test_the_one_bad_first_row_is_dropped(authors_data):
    record = load_noisy(1, 1)
    assert record.t.size == 2401
    np.testing.assert_allclose(np.diff(record.t), 0.002, rtol=1e-6)


def test_equation_19_gives_the_printed_noise_amplitudes_for_no_a_min_and_delta_a():
    theoretical, printed = first_ten("theoretical", "noise")
    # Every A_min and dA is a straight line.
    line = np.polyval(np.polyfit(theoretical, printed, 1), theoretical)
    rounding = published.half_last_digit("0.1079")
    assert (np.abs(line - printed) > 5 * rounding).sum() >= 7
    in_the_number = np.polyval(np.polyfit(range(10), printed, 1), range(10))
    assert (np.abs(in_the_number - printed) < 2 * rounding).all()


def test_the_noise_is_not_proportional_to_the_amplitude():
    printed, amplitude = first_ten("noise", "theoretical")
    ratio = printed / amplitude
    assert (np.diff(ratio) < 0).all()
    assert 100 * ratio[[0, -1]] == pytest.approx([39, 16], abs=0.5)
    line = 0.1 + np.arange(1, 11) * 0.15 / 19
    np.testing.assert_allclose(printed, line, atol=1e-4)


def test_the_last_printed_sd_cannot_be_a_variance():
    noise, runs = published.value("table2.row11.noise"), published.value("text.runs")
    (record, _), *_ = noisy_records(NOTEBOOK, NOISE_ROW, 1)
    widest = search_box(record, NOTEBOOK).upper[0]  # of A, the wider of the two boxes
    assert 0.99 < widest / (NOTEBOOK.amplitude_factor * noise) <= 1
    largest_sd = widest * np.sqrt(runs / (runs - 1))  # half of the runs at either end
    smallest = published.value("table2.row11.sd") - published.half_last_digit("0.0178")
    assert np.sqrt(smallest) > largest_sd
    assert smallest < 0.2 * largest_sd
    sds, effect = published.column("Table 2", "sd"), published.table("errata")["effect"]["E11"]
    assert f"{np.sqrt(sds.min()):.2f} to {np.sqrt(sds.max()):.2f} rps" in effect
    assert f"{np.sqrt(published.value('table2.row11.sd')):.3f} in row 11" in effect
    assert f"at most {widest:.2f} rps" in effect


def test_the_printed_errors_in_rad_are_bounds_and_no_errors_of_table_2():
    """A tenth of the gap, 2 delta, rounds to the one at the largest backlash."""
    rows = printed_rows()
    erratum = published.table("errata").loc["E18"]
    small, large = rows["error_rad"].iloc[0], rows["error_rad"].max()
    assert large == rows["error_rad"].iloc[-1]
    for printed, error in (("error_rad_small", small), ("error_rad_large", large)):
        times = published.value(f"text.{printed}") / error
        assert times > 2
        assert f"{times:.2g}" in erratum["effect"]
        assert f"{error:.1e}".replace("e-0", "e-") in erratum["corrected"]
    of_gap = 0.1 * 2 * rows["delta_rad"].iloc[-1]
    assert round(of_gap, 4) == published.value("text.error_rad_large")
    assert f"{of_gap:.1e}".replace("e-0", "e-") in erratum["effect"]


# -------------------------------------------------------------------------------------------------- the signature


def test_equation_1_depends_on_the_clock_and_equation_5_does_not():
    def equation_1(t, t_1):
        return X.A * np.exp(-(t - t_1) * X.tau) * np.sin(X.omega * t)

    t, later = np.linspace(0.02, 0.14, 50), 0.3
    np.testing.assert_allclose(d_b(t + later, X, later), d_b(t, X, 0.0), atol=1e-12)
    apart = np.abs(equation_1(t + later, X.T1 + later) - equation_1(t, X.T1))
    assert apart.max() > 0.5 * abs(X.A)


def test_equation_4_read_literally_contradicts_equations_6_and_7():
    for t0, same in ((0.0, True), (0.01, False)):
        literal = h(T, X._replace(t0=t0), Timing(t0 + 0.2, t0 + 0.4, 6))  # shifts by t_d and t_f
        assert np.allclose(literal, h(T, X._replace(t0=t0), Timing(n=6))) == same


def test_tau_has_the_unit_1_per_s():
    in_ms = np.multiply(X, [1, 1e3, 1e-3, 1e-3, 1, 1e3, 1e3])
    seconds = h(T, X)
    np.testing.assert_allclose(h(1e3 * T, in_ms, Timing(200.0, 400.0)), seconds, atol=1e-9)
    in_ms[2] = X.tau  # without its unit
    assert np.abs(h(1e3 * T, in_ms, Timing(200.0, 400.0))).max() < 0.1 * np.abs(seconds).max()


def test_v_t_is_bounded_in_table_1_and_identified_by_the_stored_runs():
    bounds = published.cells("Table 1").set_index(["row", "column"])["value"]["v_t"]
    assert bounds["min"] < bounds["max"]
    identified = published.table("authors_notebook_runs")["c_rps"]
    assert identified.nunique() > 1
    assert identified.between(99.98, 100.02).all()


# -------------------------------------------------------------------------------------------------------- CMA-ES


def bowl(members):
    """Misfits that are lowest at 0.5 in each parameter, away from the middle of a box about 0."""
    return ((members - 0.5) ** 2).sum(axis=1)


def one_generation(low, high):
    box = Box(np.full(7, low), np.full(7, high))
    return next(generations(bowl, box, 1, 300))


def test_equation_13_needs_the_ranked_members_of_the_new_generation():
    def unranked(members):
        return np.zeros(len(members))

    far = []
    for misfits in (bowl, unranked):
        *_, last = islice(generations(misfits, Box(np.full(7, -1.0), np.ones(7)), 2, 300), 61)
        far.append(bowl(last.members).mean())
    assert far[0] < 1e-6
    assert far[1] > 1


def test_c_sigma_acts_on_the_step_size_and_not_on_the_path_of_the_covariance():
    state, c = one_generation(-1.0, 1.0).state, constants(300, 7)
    z = np.random.default_rng(1).standard_normal((300, 7))
    ours, other = (update(state, z, z, np.eye(7), each) for each in (c, c._replace(c_sigma=0.5)))
    assert ours.sigma != other.sigma
    np.testing.assert_array_equal(ours.p_c, other.p_c)


def test_members_are_drawn_about_the_mean_of_equation_12():
    members = one_generation(5.0, 6.0).members
    middle, spread = members.mean(axis=0), members.std(axis=0)
    assert (np.abs(middle - 5.5) < 4 * spread / np.sqrt(300)).all()
    assert (middle > 10 * spread).all()  # a mean of zero would be far off
