import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from replication.cmaes import generations, random_normals
from replication.misfit import fold, population_rmse
from replication.signature import Timing, rmse, signature, table1_box
from replication.stopping import search
from studies.replay.eigen import symmetric_eigen
from tests.conftest import TRUE_X, signature_record
from tests.processors import printed

TURN = Timing(0.2, 0.4, 12)


def members(t, v, rng, number=400):
    box = table1_box(t, v, 0.204, 1.3)
    found = box.lower + (box.upper - box.lower) * rng.random((number, 7))
    found[::3, 1] *= 0.1  # windows that lie wholly in the record
    found[::4, 5], found[::4, 6] = (
        0.204 - 0.002 * rng.random(found[::4].shape[0]),
        0.001,
    )  # that overlap the next one
    return found


def test_the_folded_misfit_is_the_same_in_rpm_about_the_mean():
    record = signature_record()
    t, v = record.t, 60 * (record.v - record.v.mean())
    some = members(t, v, np.random.default_rng(1))
    by_equation = [rmse(t, v, each, TURN) for each in some]
    np.testing.assert_allclose(population_rmse(some, fold(t, v, TURN)), by_equation, atol=1e-10)


whole = st.builds(
    lambda half, more, n: Timing(0.002 * half, 0.002 * (half + more), n),
    *[st.integers(20, 120)] * 2,
    st.integers(0, 12),
)
any_timing = st.builds(Timing, st.floats(0.05, 0.4), st.floats(0.1, 0.8), st.integers(0, 12))


@given(
    unit=st.lists(st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0, 1)), min_size=7, max_size=7),
    timing=st.one_of(
        st.sampled_from([TURN, Timing(0.204, 0.408, 12), Timing(0.2, 0.401, 12)]), whole, any_timing
    ),
    begin=st.sampled_from([0.0, 0.114, 3.0, -1.3]),
    longest=st.sampled_from([0.1, 0.204, 0.45]),
    noise=st.sampled_from([0.0, 0.1]),
)
def test_the_folded_misfit_is_the_papers_on_any_record_and_timing(
    unit, timing, begin, longest, noise
):
    t = begin + 0.002 * np.arange(1300)
    v = (
        100
        + signature(t - begin, TRUE_X, TURN)
        + np.random.default_rng(1).uniform(-noise, noise, t.size)
    )
    box = table1_box(t, v, longest, 1.3)
    some = box.lower + np.array(unit) * (box.upper - box.lower)
    np.testing.assert_allclose(
        population_rmse(some[None], fold(t, v, timing)),
        rmse(t, v, some, timing),
        rtol=0,
        atol=1e-12,
    )


def test_a_member_at_the_truth_of_a_record_without_noise_keeps_its_digits():
    t = 0.002 * np.arange(2401)
    v, near = 100 + signature(t, TRUE_X, TURN), TRUE_X * (1 + 1e-7)
    assert population_rmse(near[None], fold(t, v, TURN))[0] == pytest.approx(
        rmse(t, v, near, TURN), rel=1e-6
    )


@pytest.mark.parametrize(
    ("samples", "speed", "timing", "words"),
    [
        (2401, 100.0, Timing(0.0, 0.4, 12), "must lie above 0"),
        (2401, 100.0, Timing(0.2, -0.4, 12), "must lie above 0"),
        (2401, 100.0, Timing(np.nan, 0.4, 12), "must lie above 0"),
        (199, 100.0, TURN, "shorter than one turn"),
        (2401, np.nan, TURN, "not finite"),
    ],
)
def test_a_record_that_cannot_be_fitted_is_one_clear_error(samples, speed, timing, words):
    v = np.full(samples, 100.0)
    v[-1] = speed
    with pytest.raises(ValueError, match=words):
        fold(0.002 * np.arange(samples), v, timing)


@pytest.mark.slow  # all is compiled for another processor, 7 s
def test_but_for_the_eigensolver_a_run_is_the_same_to_the_last_bit_with_the_kernels_of_other_processors():
    other = {"OPENBLAS_CORETYPE": "Prescott", "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    other["NPY_DISABLE_CPU_FEATURES"] = "X86_V4 X86_V3"
    assert printed("from tests.test_misfit import digest; print(digest())", **other) == digest()


def digest() -> str:
    made = signature_record()
    record = fold(made.t, made.v, TURN)
    steps = generations(
        lambda some: population_rmse(some, record),
        table1_box(made.t, made.v, 0.204, 1.3),
        random_normals(4),
        100,
        eigen=symmetric_eigen,
    )
    run = search(steps, 150)
    return run.best.tobytes().hex() + run.history.tobytes().hex()[-64:]
