import numpy as np
import pytest

from replication import published
from replication.signature import Parameters, Timing, damped_oscillation, signature, table1_box

TIMING = Timing(T_d=0.2, T_f=0.4, n=12)
T = 0.002 * np.arange(2401)
V = 100 + np.sin(7 * T) + 0.3 * np.cos(140 * T)


def test_the_oscillation_is_zero_outside_its_window_and_equation_5_inside():
    t = np.array([0.0, 0.1, 0.15, 0.2, 0.3])
    h = damped_oscillation(t, Parameters(2.0, 0.05, 10.0, 100.0, v_t=100.0, T2=0.15, T1=0.05))
    inside = (
        2.0
        * np.exp(-10.0 * np.array([0.0, 0.05, 0.1]))
        * np.sin(100.0 * np.array([0.05, 0.1, 0.15]))
    )
    np.testing.assert_allclose(h, [0, *inside, 0], atol=1e-15)


def test_the_oscillations_alternate_in_sign_half_a_turn_apart():
    X = np.array([1.0, 0.01, 12.0, 130.0, 100.0, 0.1507, 0.0113])
    h = signature(T, X, TIMING)
    np.testing.assert_allclose(h[100:2400], -h[:2300], atol=1e-12)


def test_the_box_is_table_1():
    box = table1_box(T, V, published.value("table1.T2.max"))
    for index, name in ((2, "tau"), (3, "omega"), (5, "T2"), (6, "T1")):
        assert box.lower[index] == published.value(f"table1.{name}.min")
        assert box.upper[index] == pytest.approx(published.value(f"table1.{name}.max"), rel=1e-15)
    assert box.upper[0] == published.value("table1.A.max") * np.ptp(V)
    assert (box.lower[1], box.upper[1]) == (T.min(), T.max())
    assert (box.lower[4], box.upper[4]) == (V.min(), V.max())
