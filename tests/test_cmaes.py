from itertools import islice

import cma
import numpy as np
import pytest

from replication.cmaes import constants, first_state, generations, random_normals
from replication.signature import Box
from replication.stopping import search, stop_rule

UNIT = Box(np.full(7, -1.0), np.ones(7))


def sphere(members):
    return ((members - 0.3) ** 2).sum(axis=1)


def valley(members):
    x = 10 * members
    return (100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2).sum(axis=1)


@pytest.mark.parametrize("population", [8, 31, 300])
def test_equations_13_to_17_give_what_the_library_gives_with_the_constants_of_2021(
    monkeypatch, population
):
    options = {"CMA_stds": np.full(7, 0.5), "randn": random_normals(1), "popsize": population}
    quiet = {"seed": np.nan, "verbose": -9, "verb_log": 0}
    library = cma.CMAEvolutionStrategy(np.zeros(7), 1.0, options | quiet)
    c = constants(population, 7)
    library.adapt_sigma.initialize(library)
    library.adapt_sigma.cs, library.adapt_sigma.damps = c.c_sigma, c.d_sigma
    monkeypatch.setattr(cma.sigma_adaptation.Mh, "chiN", lambda n: c.chi_n)
    for now in islice(generations(sphere, UNIT, random_normals(9), population), 12):
        library.ask()
        library.tell(list(now.x), list(now.misfits), check_points=False)
        state = now.after
        theirs = (library.mean, library.sigma, library.adapt_sigma.ps, library.pc, library.sm.C)
        for ours, value in zip(
            (state.m, state.sigma, state.p_sigma, state.p_c, state.C), theirs, strict=True
        ):
            np.testing.assert_allclose(ours, value, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize(
    ("misfits", "population", "dimensions"), [(sphere, 4, 2), (sphere, 40, 7), (valley, 60, 5)]
)
def test_the_search_finds_the_minimum(misfits, population, dimensions):
    box = Box(np.full(dimensions, -1.0), np.ones(dimensions))
    run = search(generations(misfits, box, random_normals(3), population), 1000)
    assert run.misfit < 1e-10
    assert run.stop.startswith("tol")
    np.testing.assert_allclose(run.best, 0.3 if misfits is sphere else 0.1, atol=1e-4)
    assert run.evaluations == population * len(run.history)


def test_a_minimum_on_the_edge_of_the_box_is_found_and_no_member_leaves_it():
    steps = list(islice(generations(lambda X: X.sum(axis=1), UNIT, random_normals(3), 30), 60))
    assert all(
        (now.members >= UNIT.lower).all() and (now.members <= UNIT.upper).all() for now in steps
    )
    assert steps[-1].misfits.min() == pytest.approx(-7, abs=1e-3)


TURN = np.linalg.qr(np.random.default_rng(0).standard_normal((7, 7)))[0]
HUGE = Box(np.full(7, -1e30), np.full(7, 1e30))


@pytest.mark.parametrize(
    ("misfits", "change", "stop"),
    [
        (sphere, {"iterations": 7}, "maxiter"),
        (sphere, {}, "tolfun"),
        (lambda X: np.floor(1e3 * sphere(X)), {}, "tolflatfitness"),
        (lambda X: 1e9 * np.abs(X - 0.3).sum(axis=1), {"population": 20}, "tolx"),
        (
            lambda X: ((X @ TURN) ** 2 * 10.0 ** np.arange(0, 28, 4)).sum(axis=1),
            {"population": 20},
            "tolconditioncov",
        ),
        (lambda X: np.sin(1e7 * X).sum(axis=1), {}, "tolstagnation"),
        (lambda X: -np.abs(X).sum(axis=1), {"box": HUGE, "sigma": 1e-20}, "tolfacupx"),
    ],
)
def test_a_search_ends_by_the_rule_that_holds_first(misfits, change, stop):
    setting = {"box": UNIT, "normals": random_normals(8), "population": 10} | change
    iterations = setting.pop("iterations", 3000)
    assert search(generations(misfits, **setting), iterations).stop == stop


@pytest.mark.parametrize(
    ("recent", "own", "stop"),
    [
        (0.98e-12, 1.0, "tolfunhist"),
        (1.02e-12, 1.0, ""),
        (0.98e-11, 0.98e-11, "tolfun"),
        (0.98e-11, 1.02e-11, ""),
        (1.02e-11, 0.98e-11, ""),
    ],
)
def test_a_search_ends_when_misfits_lie_closer_together_than_the_library_tells(recent, own, stop):
    """The range of recent generations' best misfits and that of a generation's own, each just beside its limit."""
    history = np.ones((50, 7))
    history[:, 0] = recent * (np.arange(50) % 2)
    state = first_state(UNIT, 1.0)._replace(g=50)
    ranked = history[-1, 0] + np.linspace(0, own, 300)
    assert stop_rule(history, ranked, state, 1.0) == stop


def test_a_seed_gives_the_same_run_twice_and_leaves_the_global_generator_alone():
    np.random.seed(3)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    first, again = (
        search(generations(valley, UNIT, random_normals(4), 100), 150) for _ in range(2)
    )
    assert (first.history.tobytes(), *first.best) == (again.history.tobytes(), *again.best)
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002


def some(members):
    return np.where(np.arange(len(members)) == 3, np.nan, 1.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"population": 3}, "population 3: at least 4"),
        ({"box": Box(np.ones(7), -np.ones(7))}, "the box is empty"),
        ({"box": Box(np.zeros(7), np.full(7, np.inf))}, "the box is empty"),
        ({"box": Box(np.zeros(0), np.zeros(0))}, "the box is empty"),
        ({"sigma": 0.0}, "sigma 0"),
        ({"misfits": some}, "generation 1: each member needs one misfit, a finite number"),
        ({"misfits": lambda X: 1.0}, "generation 1: each member needs one misfit"),
    ],
)
def test_bad_input_is_one_clear_error(change, words):
    good = {"misfits": sphere, "box": UNIT, "normals": random_normals(1), "population": 10}
    with pytest.raises(ValueError, match=words):
        next(generations(**good | change))


@pytest.mark.parametrize("seed", [0, -3])
def test_a_seed_that_means_the_clock_is_refused(seed):
    with pytest.raises(ValueError, match=f"seed {seed}"):
        random_normals(seed)
