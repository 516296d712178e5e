"""The proofs of errata that no other test of a module makes; `errata.csv` names them."""

import numpy as np
import pytest

from replication import published
from replication.characteristic import equation_10, printed_levels_rad
from replication.cmaes import constants, decompose, generations, random_normals, sample, update
from replication.joint import K_BL, identified_joint, tau_l
from replication.signature import Box, Timing, rmse, signature
from replication.table2 import SearchSettings, search_box, table2_levels
from studies.replay.inspection import STORED_NAMES
from studies.replay.protocols import LAST_ROW, noisy_record

T = 0.002 * np.arange(2401)


def test_equation_19_gives_the_printed_noise_amplitudes_for_no_a_min_and_delta_a():
    theoretical, printed = (
        published.column("Table 2", name)[:10] for name in ("theoretical", "noise")
    )
    best_line = np.polyval(
        np.polyfit(theoretical, printed, 1), theoretical
    )  # every A_min and dA is a straight line
    rounding = published.half_last_digit("0.1079")
    assert (np.abs(best_line - printed) > 5 * rounding).sum() >= 7
    in_the_number = np.polyval(np.polyfit(range(10), printed, 1), range(10))
    assert (np.abs(in_the_number - printed) < 2 * rounding).all()


def test_equation_4_read_literally_contradicts_equations_6_and_7():
    def literal(
        X, t0
    ):  # equations 1 to 4: d_b starts at t0 + T1, and is shifted by t0 + T_d and t0 + T_f
        return signature(T, X, Timing(t0 + 0.2, t0 + 0.4, 6))

    def shifted(X):  # equations 5 to 7
        return signature(T, X, Timing(0.2, 0.4, 6))

    for t0, same in ((0.0, True), (0.01, False)):
        X = np.array([1.0, t0, 14.0, 130.0, 100.0, 0.1507, 0.0111])
        assert np.allclose(literal(X, t0), shifted(X)) == same


def test_equation_4_read_literally_misses_every_stored_run_that_can_tell(record_12):
    can_tell = 0
    for _, run in published.table("authors_notebook_runs").iterrows():
        X, stored = run[list(STORED_NAMES)].to_numpy(float), run["final_rmse_rps"]
        T_d, T_f, t0 = run[["T_d_s", "T_f_s", "t0_s"]]
        assert rmse(record_12.t, record_12.v, X, Timing(T_d, T_f, 12)) == pytest.approx(
            stored, abs=1e-6
        )
        literal = rmse(record_12.t, record_12.v, X, Timing(t0 + T_d, t0 + T_f, 12))
        if t0 * 24 > T[1]:  # the last turn is off by a sample or more
            can_tell += 1
            assert literal > 2 * stored
        else:
            assert literal == pytest.approx(stored, rel=0.1)
    assert can_tell >= 10


def test_the_numbers_that_the_errata_quote_are_those_that_are_computed():
    effect = published.table("errata")["effect"]
    off = np.abs(
        equation_10().backlash_rad(published.column("Table 2", "theoretical")[:10])
        - printed_levels_rad()
    )
    assert off.max() == pytest.approx(1.8e-5, abs=0.05e-5)
    assert "1.8e-5 rad" in effect["E2"]
    joint = identified_joint()
    assert pytest.approx(14, abs=0.5) == joint.G
    for alpha, leak_percent, jump_nm in ((1e5, 0.42, 0.25), (1e6, 0.042, 0.025)):
        assert 100 * K_BL(0.0, 15e-4, 1.0, alpha) == pytest.approx(leak_percent, rel=0.02)
        assert f"{leak_percent:g} %" in effect["E8"]
        edge = joint._replace(alpha=alpha)
        below, above = (tau_l(side * 1e-12, 0.0, 15e-4, side, edge) for side in (-1, 1))
        assert below - above == pytest.approx(jump_nm, rel=0.02)
        assert f"{jump_nm:g} N m" in effect["E9"]
    sds = published.column("Table 2", "sd")
    assert np.sqrt([sds[sds > 0].min(), sds.max()]) == pytest.approx([0.03, 0.24], abs=0.005)
    noise, amplitude = (
        published.column("Table 2", name)[[0, 9]] for name in ("noise", "theoretical")
    )
    assert 100 * noise / amplitude == pytest.approx([39, 16], abs=0.5)


def test_tau_has_the_unit_1_per_s():
    X = np.array([1.0, 0.01, 14.0, 130.0, 100.0, 0.1507, 0.0111])
    in_ms = X * [1, 1e3, 1e-3, 1e-3, 1, 1e3, 1e3]
    seconds = signature(T, X, Timing(0.2, 0.4, 12))
    milliseconds = Timing(200.0, 400.0, 12)
    np.testing.assert_allclose(signature(1e3 * T, in_ms, milliseconds), seconds, atol=1e-9)
    without_unit = in_ms.copy()
    without_unit[2] = X[2]
    assert (
        np.abs(signature(1e3 * T, without_unit, milliseconds)).max() < 0.1 * np.abs(seconds).max()
    )


def test_the_last_printed_sd_cannot_be_a_variance():
    noise, runs = published.value("table2.row11.noise"), published.value("text.runs")
    smallest = published.value("table2.row11.sd") - published.half_last_digit("0.0178")
    record = noisy_record(LAST_ROW, 1)
    box = search_box(record, SearchSettings()).upper[0]  # of A, the wider of the two boxes
    assert (
        0.99 * SearchSettings().amplitude_factor * noise
        < box
        <= SearchSettings().amplitude_factor * noise
    )
    largest_sd = box * np.sqrt(runs / (runs - 1))  # half of the runs at either end
    assert np.sqrt(smallest) > largest_sd
    assert smallest < 0.2 * largest_sd


def test_equation_13_needs_the_ranked_members_of_the_new_generation():
    def misfits(members):  # lowest away from the middle, where the search starts
        return ((members - 0.5) ** 2).sum(axis=1)

    box, normals = Box(-np.ones(7), np.ones(7)), random_normals(1)
    first = next(generations(misfits, box, normals, 300))
    c = constants(300, 7)

    def distance_after(ranked):
        state, draw = first.before, random_normals(2)
        for _ in range(20):
            state = decompose(state)
            x = sample(state, draw(300, 7))
            state = update(state, x[np.argsort(misfits(x), kind="stable")] if ranked else x, c)
        return np.sqrt(misfits(state.m[None]).item())

    start = np.sqrt(misfits(first.before.m[None]).item())
    assert distance_after(ranked=True) < 1e-2 * start
    assert distance_after(ranked=False) > 0.3 * start


def test_the_noise_is_not_proportional_to_the_amplitude():
    printed, amplitude = (
        published.column("Table 2", name)[:10] for name in ("noise", "theoretical")
    )
    ratio = printed / amplitude
    assert (np.diff(ratio) < 0).all()
    assert ratio[0] / ratio[-1] > 2
    line = [0.1 + (level - 1) * 0.15 / 19 for level in table2_levels()]
    np.testing.assert_allclose(printed, line, atol=1e-4)


def test_v_t_is_bounded_in_table_1_and_identified_by_the_stored_runs():
    bounds = published.cells("Table 1").set_index(["row", "column"])["value"]["v_t"]
    assert bounds["min"] < bounds["max"]
    identified = published.table("authors_notebook_runs")["c_rps"]
    assert identified.nunique() > 1
    assert identified.between(99.98, 100.02).all()


def test_equation_1_depends_on_the_clock_and_equation_5_does_not():
    def equation_1(t, t_1):
        return np.exp(-14.0 * (t - t_1)) * np.sin(130.0 * t)

    def equation_5(t, t_0, T_1=0.01):
        return np.exp(-14.0 * (t - (t_0 + T_1))) * np.sin(130.0 * (t - t_0))

    t = np.linspace(0.02, 0.1, 50)
    assert np.allclose(equation_5(t, 0.0), equation_5(t + 0.3, 0.3))
    assert not np.allclose(equation_1(t, 0.01), equation_1(t + 0.3, 0.31), atol=0.5)


def one_generation(low, high):
    box = Box(np.full(7, low), np.full(7, high))
    return next(generations(lambda members: (members**2).sum(axis=1), box, random_normals(1), 300))


def test_c_sigma_acts_on_the_step_size_and_not_on_the_path_of_the_covariance():
    first = one_generation(-1.0, 1.0)
    ranked, c = first.x[first.ranking], first.constants
    ours, theirs = (update(first.before, ranked, each) for each in (c, c._replace(c_sigma=0.5)))
    assert ours.sigma != theirs.sigma
    np.testing.assert_array_equal(ours.p_c, theirs.p_c)


def test_members_are_drawn_about_the_mean_of_equation_12():
    first = one_generation(5.0, 6.0)
    off = np.abs(first.x.mean(axis=0) - first.before.m) / first.before.std * len(first.x) ** 0.5
    assert off.max() < 4
    assert (np.abs(first.before.m) > 10 * first.before.std).all()  # a mean of zero would be far off
