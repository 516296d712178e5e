"""The compiled cost is the equations' cost, and the projection is least squares."""

import numpy as np
import pytest

from replication.misfit import PROJECTED, cost, fold, population_rmse, project
from replication.signature import MOVEMENT, Parameters, Timing, h, rmse, table1_box
from tests.made import TIME, TRUE, make_record


def draw_members(t, v, number):
    rng = np.random.default_rng(2)
    box = table1_box(t, v, 1.3)
    members = rng.uniform(*box, (number, 7))
    members[::4, 6], members[::4, 5] = 0.001, 0.2035  # windows that overlap the next one
    members[::3, 1] = t[0] + 0.1 * (members[::3, 1] - t[0])  # that lie in the record
    members[1, 6], members[1, 5] = 0.05, 0.04  # that hold no sample
    members[2, 1], members[2, 6] = t[-1] - 0.0105, 0.0  # that begin in its last samples
    members[5, 1] = t[0] - members[5, 6] + 0.0001  # and in its first ones
    return members


EVEN = 0.002 * np.arange(1200)
FOLDED = (MOVEMENT, Timing(0.002, 0.408, 11), Timing(0.1, 0.4, 3))


@pytest.mark.parametrize(
    ("t", "timing", "folds"),
    [
        *((begin + TIME, timing, True) for timing in FOLDED for begin in (0.0, 1.3)),
        (EVEN + 1e-5 * np.sin(EVEN), MOVEMENT, False),
        (EVEN, Timing(0.2005, 0.401, 6), False),
        (EVEN, Timing(0.4, 0.4, 6), False),
        (EVEN, Timing(0.0, 0.4, 6), False),
    ],
)
def test_the_cost_is_that_of_equations_5_to_7_and_11_of_a_record_that_is_folded_or_not(
    t, timing, folds
):
    v = make_record().v[: t.size]
    members = draw_members(t, v, 60)
    assert (fold(t, v, timing) is not None) == folds
    expected = [rmse(t, v, X, timing) for X in members]
    np.testing.assert_allclose(cost(t, v, timing)(members), expected, rtol=1e-11 if folds else 0)


@pytest.mark.parametrize(("off", "folds"), [(0.95, True), (1.05, False)])
def test_a_record_is_folded_if_its_instants_and_turns_are_even_within_a_millionth(off, folds):
    t, v = TIME, make_record().v
    shift = off * 1e-6 * 0.002
    uneven = t + shift * (np.arange(t.size) == 7)
    assert (fold(uneven, v, MOVEMENT) is not None) == folds
    # Over twelve turns.
    for timing in (Timing(0.2 + shift / 12), Timing(T_f=0.4 - shift / 12)):
        assert (fold(t, v, timing) is not None) == folds


def test_the_projection_gives_the_least_misfit_over_A_and_v_t():
    t, v = TIME, make_record().v
    members = draw_members(t, v, 12)
    record = fold(t, v, MOVEMENT)
    projected, misfits = project(members[:, PROJECTED], record, largest_A=5.0)
    np.testing.assert_allclose(population_rmse(projected, record), misfits, rtol=1e-9)
    np.testing.assert_array_equal(projected[:, PROJECTED], members[:, PROJECTED])
    for X, (A, *_, v_t, _, _) in zip(members, projected, strict=True):
        u = h(t, Parameters(*X)._replace(A=1.0))
        # The minimum-norm solution: A is 0 where the windows hold no sample.
        expected, *_ = np.linalg.lstsq(np.column_stack((u, np.ones(t.size))), v, rcond=None)
        assert [A, v_t] == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_projected_A_stays_within_its_bound(sign):
    v = 100 + sign * (make_record().v - 100)
    shape = np.array([TRUE])[:, PROJECTED]
    projected, misfits = project(shape, fold(TIME, v, MOVEMENT), largest_A=0.1)
    assert projected[0, 0] == -0.1 * sign
    assert misfits[0] == pytest.approx(rmse(TIME, v, projected[0]), rel=1e-9)
