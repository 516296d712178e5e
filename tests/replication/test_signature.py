"""Equations 1 to 7 and 11 at known parameters, and Table 1's box."""

import numpy as np
import pytest

from replication import published
from replication.signature import Parameters, Timing, d_b, h, rmse, table1_box
from tests.made import TIME

X = Parameters(A=0.5, t0=0.0105, tau=12.0, omega=130.0, v_t=100.0, T2=0.15, T1=0.02)


def test_an_oscillation_is_zero_outside_its_window_and_damped_from_its_beginning():
    window = X._replace(T1=0.25, T2=0.5)
    t = 1 + np.array([0.2499, 0.25, 0.375, 0.5, 0.5001])
    since = np.array([0.25, 0.375, 0.5])
    inside = 0.5 * np.exp(-12 * (since - 0.25)) * np.sin(130 * since)
    np.testing.assert_allclose(d_b(t, window, 1.0), [0, *inside, 0], rtol=1e-12)


def test_a_turn_has_an_oscillation_and_half_a_turn_later_its_inverse_for_n_turns():
    t = np.linspace(0.031, 0.15, 50)
    first = h(t, X)
    assert np.abs(first).max() > 0.2
    for turn in range(3):
        for half, sign in ((0.0, 1), (0.2, -1)):
            later = h(t + 0.4 * turn + half, X, Timing(n=3))
            np.testing.assert_allclose(later, sign * first, atol=1e-12)
    assert not h(t + 1.2, X, Timing(n=3)).any()
    np.testing.assert_allclose(h(t + 11 * 0.4, X), first, atol=1e-11)
    assert not h(t + 12 * 0.4, X).any()


def test_the_misfit_is_that_of_the_speed_less_the_commanded_one():
    v = 100 + h(TIME, X)
    assert rmse(TIME, v, X) < 1e-13
    assert rmse(TIME, v + 0.3, X) == pytest.approx(0.3)
    assert rmse(TIME, v, X._replace(v_t=99.9)) == pytest.approx(0.1)


def test_the_box_is_table_1():
    t, v = np.array([1.0, 2.0, 5.0]), np.array([99.0, 100.0, 101.5])
    box = table1_box(t, v)
    printed = {
        name: [published.value(f"table1.{name}.{end}") for end in ("min", "max")]
        for name in ("tau", "omega", "T1", "T2")
    }
    expected = Parameters(A=[-1.25, 1.25], t0=[1, 5], v_t=[99, 101.5], **printed)
    np.testing.assert_allclose(np.transpose([*box]), expected, rtol=1e-4)
    assert table1_box(t, v, 1.3).upper[0] == pytest.approx(1.3 * 1.25)


def test_equation_1_depends_on_the_clock_and_equation_5_does_not():
    def equation_1(t, t_1):
        return X.A * np.exp(-(t - t_1) * X.tau) * np.sin(X.omega * t)

    t, later = np.linspace(0.02, 0.14, 50), 0.3
    np.testing.assert_allclose(d_b(t + later, X, later), d_b(t, X, 0.0), atol=1e-12)
    apart = np.abs(equation_1(t + later, X.T1 + later) - equation_1(t, X.T1))
    assert apart.max() > 0.5 * abs(X.A)


def test_equation_4_read_literally_contradicts_equations_6_and_7():
    for t0, same in ((0.0, True), (0.01, False)):
        literal = h(TIME, X._replace(t0=t0), Timing(t0 + 0.2, t0 + 0.4, 6))  # shifts by t_d and t_f
        assert np.allclose(literal, h(TIME, X._replace(t0=t0), Timing(n=6))) == same


def test_tau_has_the_unit_1_per_s():
    in_ms = np.multiply(X, [1, 1e3, 1e-3, 1e-3, 1, 1e3, 1e3])
    seconds = h(TIME, X)
    np.testing.assert_allclose(h(1e3 * TIME, in_ms, Timing(200.0, 400.0)), seconds, atol=1e-9)
    in_ms[2] = X.tau  # without its unit
    assert np.abs(h(1e3 * TIME, in_ms, Timing(200.0, 400.0))).max() < 0.1 * np.abs(seconds).max()
