"""Equations 1 to 7 and 11 at known parameters, and Table 1's box."""

import numpy as np
import pytest

from replication import published
from replication.signature import Parameters, Timing, d_b, f, h, rmse, table1_box

X = Parameters(A=0.5, t0=0.01, tau=12.0, omega=130.0, v_t=100.0, T2=0.15, T1=0.02)


def test_an_oscillation_is_zero_outside_its_window_and_damped_from_its_beginning():
    window = X._replace(T1=0.25, T2=0.5)
    t = 1 + np.array([0.2499, 0.25, 0.375, 0.5, 0.5001])
    since = np.array([0.25, 0.375, 0.5])
    inside = 0.5 * np.exp(-12 * (since - 0.25)) * np.sin(130 * since)
    np.testing.assert_allclose(d_b(t, window, 1.0), [0, *inside, 0], rtol=1e-12)


def test_the_second_oscillation_of_a_turn_is_the_first_inverted_half_a_turn_later():
    t = np.linspace(0.03, 0.15, 50)
    np.testing.assert_allclose(f(t + 0.2, X, 0.01, 0.2), -f(t, X, 0.01, 0.2))
    assert np.abs(f(t, X, 0.01, 0.2)).max() > 0.2


def test_the_signature_repeats_every_turn_for_n_turns():
    t = 0.002 * np.arange(200) + 5e-4
    turns = Timing(T_d=0.2, T_f=0.4, n=3)
    first = h(t, X, turns)
    np.testing.assert_allclose(h(t + 0.4, X, turns), first, atol=1e-12)
    np.testing.assert_allclose(h(t + 0.8, X, turns), first, atol=1e-12)
    assert not h(t + 1.2, X, turns).any()


def test_the_misfit_is_that_of_the_speed_less_the_commanded_one():
    t = 0.002 * np.arange(2401)
    v = 100 + h(t, X)
    assert rmse(t, v, X) < 1e-13
    assert rmse(t, v + 0.3, X) == pytest.approx(0.3)
    assert rmse(t, v, X._replace(v_t=99.9)) == pytest.approx(0.1)


def test_the_sign_of_the_amplitude_says_nothing_but_for_the_first_half_turn():
    t = 0.002 * np.arange(100, 2300) + 1e-3
    np.testing.assert_allclose(
        h(t, X), h(t, X._replace(A=-0.5, t0=0.01 + 0.2 - 0.4), Timing(n=13)), atol=1e-9
    )


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
