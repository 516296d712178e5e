import os
import subprocess
import sys
from itertools import islice

import numpy as np
import pytest

from replication import datasets, published
from replication.compiled.bounds import margin_today
from replication.compiled.folded import fold, folded_rmse
from replication.compiled.misfit import population_rmse
from replication.compiled.whole_run import whole_run
from replication.search import generations, random_normals, search
from replication.signature import Timing, signature, table1_box

TURN = Timing(0.2, 0.4, 12)
X = np.array([-0.6, 0.0125, 15.0, 134.0, 100.0, 0.1515, 0.0125])


@pytest.fixture(scope="module")
def record():
    base = datasets.constant_speed(samples=2401, dt=0.002)
    rng = np.random.default_rng(5)
    return base.t, base.v + signature(base.t, X, TURN) + rng.uniform(-0.1, 0.1, base.t.size)


def members(t, v, rng, number=4000):
    box = table1_box(t, v, 0.204, 1.3)
    found = box.lower + (box.upper - box.lower) * rng.random((number, 7))
    found[::3, 1] *= 0.1  # windows that lie wholly in the record
    found[::4, 5], found[::4, 6] = 0.204 - 0.002 * rng.random(found[::4].shape[0]), 0.001  # that overlap the next one
    return found


@pytest.mark.parametrize("timing", [TURN, Timing(0.204, 0.408, 12), Timing(0.2, 0.4, 5)], ids=str)
@pytest.mark.parametrize("start", [0, 57])
def test_the_folded_misfit_is_the_misfit(record, timing, start):
    t, v = record[0][start:] - record[0][start], record[1][start:]
    some = members(t, v, np.random.default_rng(1))
    np.testing.assert_allclose(folded_rmse(some, fold(t, v, timing)), population_rmse(t, v, some, timing), atol=1e-13)


def test_the_folded_misfit_is_the_same_in_rpm_about_the_mean(record):
    t, v = record[0], 60 * (record[1] - record[1].mean())
    some = members(t, v, np.random.default_rng(1))
    np.testing.assert_allclose(folded_rmse(some, fold(t, v, TURN)), population_rmse(t, v, some, TURN), atol=1e-11)


@pytest.mark.parametrize("timing", [Timing(0.2005, 0.4, 12), Timing(0.2, 0.401, 12)])
def test_a_turn_that_is_no_whole_number_of_samples_is_refused(record, timing):
    with pytest.raises(ValueError, match="whole samples"):
        fold(*record, timing)


@pytest.mark.parametrize(("population", "seed"), [(9, 2), (31, 3), (300, 4), (1000, 1)])
def test_a_compiled_run_is_the_search_generation_by_generation(record, population, seed):
    t, v = record
    box, folded = table1_box(t, v, 0.204, 1.3), fold(t, v, TURN)
    steps = generations(lambda some: folded_rmse(some, folded), box, random_normals(seed), population)
    theirs = [now.misfits.min() for now in islice(steps, 20)]
    np.testing.assert_allclose(whole_run(folded, box, seed, population, 20).history, theirs, rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(1, 9))
def test_a_compiled_run_ends_where_the_search_ends(record, seed):
    t, v = record
    box, folded = table1_box(t, v, 0.204, 1.3), fold(t, v, TURN)
    run = whole_run(folded, box, seed, 300, 200)
    theirs = search(generations(lambda some: folded_rmse(some, folded), box, random_normals(seed), 300), 200)
    assert run.misfit == pytest.approx(theirs.misfit, abs=1e-9)
    assert run.misfit == pytest.approx(population_rmse(t, v, run.best[None], TURN)[0], abs=1e-12)
    assert abs(run.history.size - theirs.history.shape[0]) < 15  # rounding decides the generation of the last tie


def test_at_least_28_of_the_30_stored_runs_end_at_the_stored_misfit(record_12):
    t, v = record_12.t, record_12.v
    box, folded = table1_box(t, v, 0.204, 1.3), fold(t, v, TURN)
    stored = published.authors_notebook_runs()
    ours = np.array([whole_run(folded, box, seed, 300, 200).misfit for seed in stored["cma_seed"]])
    assert (np.abs(ours - stored["final_rmse_rps"]) < 1e-9).sum() >= 28


def test_other_margins_make_another_run(record):
    t, v = record
    box, folded = table1_box(t, v, 0.204, 1.3), fold(t, v, TURN)
    one, other = whole_run(folded, box, 1, 300, 1), whole_run(folded, box, 1, 300, 1, margin_today)
    assert one.misfit != other.misfit


@pytest.mark.parametrize(("seed", "population"), [(0, 300), (1, 3)])
def test_seed_zero_and_a_population_below_four_are_refused(record, seed, population):
    t, v = record
    with pytest.raises(ValueError, match="seed"):
        whole_run(fold(t, v, TURN), table1_box(t, v, 0.204), seed, population, 10)


def test_a_compiled_run_is_the_same_to_the_last_bit_with_the_kernels_of_other_processors():
    code = "from tests.compiled.test_whole_run import digest; print(digest())"
    other = {"OPENBLAS_CORETYPE": "Prescott", "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    other["NPY_DISABLE_CPU_FEATURES"] = "X86_V4 X86_V3"
    found = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code], env=os.environ | other, capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == digest()


def digest() -> str:
    t = 0.002 * np.arange(2401)
    v = 100 + signature(t, X, TURN) + np.random.default_rng(5).uniform(-0.1, 0.1, t.size)
    run = whole_run(fold(t, v, TURN), table1_box(t, v, 0.204, 1.3), 4, 100, 150)
    return run.best.tobytes().hex() + run.history.tobytes().hex()[-64:]
