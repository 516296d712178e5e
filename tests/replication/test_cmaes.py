"""Equations 12 to 17 against the library, and what the search finds."""

from itertools import islice

import cma
import numpy as np
import pytest

from replication.cmaes import constants, from_box, generations, into_box, margins, search, update
from replication.signature import Box

UNIT = Box(np.full(7, -1.0), np.ones(7))


def sphere(members):
    return ((members - 0.3) ** 2).sum(axis=1)


def valley(members):
    x = 10 * members
    return (100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2).sum(axis=1)


@pytest.mark.parametrize("population", [4, 31, 300])
@pytest.mark.filterwarnings("ignore:orphanated")
def test_equations_13_to_17_give_what_the_library_gives_with_the_constants_of_2021(
    monkeypatch, population
):
    options = {"popsize": population, "seed": np.nan, "verbose": -9, "verb_log": 0}
    library = cma.CMAEvolutionStrategy(np.zeros(7), 1.0, options)
    c = constants(population, 7)
    library.adapt_sigma.initialize(library)
    library.adapt_sigma.cs, library.adapt_sigma.damps = c.c_sigma, c.d_sigma
    monkeypatch.setattr(cma.sigma_adaptation.Mh, "chiN", lambda n: c.chi_n)
    state = next(generations(valley, UNIT, 1, population)).state
    rng = np.random.default_rng(1)
    for _ in range(12):
        library.ask()
        squares, B = np.linalg.eigh(state.C)
        y = rng.standard_normal((population, 7)) @ (B * np.sqrt(squares)).T
        x = state.m + state.sigma * y
        misfits = valley(x / 10)
        library.tell(list(x), list(misfits), check_points=False)
        state = update(state, y[np.argsort(misfits)], B, np.sqrt(squares), c)
        theirs = (library.mean, library.sigma, library.adapt_sigma.ps, library.pc, library.sm.C)
        ours = (state.m, state.sigma, state.p_sigma, state.p_c, state.C)
        for our, their in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(our, their, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("population", [4, 31, 300])
def test_constants_that_have_not_changed_since_2021_are_the_librarys(population):
    options = {"popsize": population, "seed": np.nan, "verbose": -9, "verb_log": 0}
    sp = cma.CMAEvolutionStrategy(np.zeros(7), 1.0, options).sp
    c = constants(population, 7)
    np.testing.assert_allclose(c.weights, sp.weights, rtol=1e-9)
    ours = [c.mu, c.mu_eff, c.c_c, c.c_1, c.c_mu]
    np.testing.assert_allclose(ours, [sp.weights.mu, sp.weights.mueff, sp.cc, sp.c1, sp.cmu])


def test_the_step_size_is_damped_as_in_2021():
    c = constants(300, 7)
    # By hand, with mu_eff = 78.03: (mu_eff + 2) / (n + mu_eff + 3), 1 + 2 (sqrt(77.03 / 8) - 1) + c_sigma.
    assert c.c_sigma == pytest.approx(80.03 / 88.03, abs=1e-4)
    assert c.d_sigma == pytest.approx(6.115, abs=1e-3)
    assert c.chi_n == pytest.approx(2.5538, abs=1e-3)  # sqrt(2) Gamma(4) / Gamma(3.5)


@pytest.mark.parametrize(
    ("misfits", "population", "dimensions"), [(sphere, 4, 2), (sphere, 40, 7), (valley, 60, 5)]
)
def test_the_search_finds_the_minimum_and_ends_by_itself(misfits, population, dimensions):
    box = Box(np.full(dimensions, -1.0), np.ones(dimensions))
    run = search(generations(misfits, box, 3, population), 1000)
    assert run.misfit < 1e-9
    assert run.generations < 1000
    np.testing.assert_allclose(run.best, 0.3 if misfits is sphere else 0.1, atol=1e-3)


def test_a_search_ends_after_its_iterations():
    assert search(generations(sphere, UNIT, 3, 40), 7).generations == 7


def test_a_search_ends_when_the_axes_of_its_distribution_differ_by_a_factor_of_1e7():
    scales = 10.0 ** np.arange(0, 28, 4)
    steps = generations(lambda X: (X**2 * scales).sum(axis=1), UNIT, 8, 20)
    run = search(steps, 3000)
    assert run.generations < 3000
    assert run.misfit > 1e-11  # not for want of differences


def test_a_minimum_on_the_edge_of_the_box_is_approached_and_no_member_leaves_it():
    steps = list(islice(generations(lambda X: X.sum(axis=1), UNIT, 3, 30), 60))
    members = np.concatenate([now.members for now in steps])
    assert (members >= UNIT.lower).all()
    assert (members <= UNIT.upper).all()
    assert steps[-1].misfits.min() == pytest.approx(-7, abs=1e-3)


def test_samples_are_mapped_into_the_box_by_parabolas_in_its_margins_and_mirrored_beyond():
    box = Box(np.array([-2.0, 0.0]), np.array([2.0, 10.0]))
    x = np.random.default_rng(1).uniform(-40, 40, (500, 2))
    members = into_box(x, box)
    a_lower, a_upper = margins(box)
    assert ((members >= box.lower) & (members <= box.upper)).all()
    inner = (x > box.lower + a_lower) & (x < box.upper - a_upper)
    np.testing.assert_array_equal(members[inner], x[inner])
    # At the end of a margin lies the bound; beyond it the map is its mirror image.
    ends = np.stack((box.lower - a_lower, box.upper + a_upper))
    np.testing.assert_allclose(into_box(ends, box), [*box], atol=1e-12)
    np.testing.assert_allclose(into_box(ends + 0.03, box), into_box(ends - 0.03, box), atol=1e-12)


def test_the_map_into_the_box_is_inverted_for_its_points():
    box = Box(np.array([-2.0, 0.0]), np.array([2.0, 10.0]))
    points = np.random.default_rng(1).uniform(*box, (200, 2))
    for point in [*points, *box]:
        np.testing.assert_allclose(into_box(from_box(point, box)[None], box)[0], point, atol=1e-12)


def test_a_seed_gives_the_same_run_twice_and_leaves_the_global_generator_alone():
    np.random.seed(3)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    first, again = (search(generations(valley, UNIT, 4, 100), 150) for _ in range(2))
    np.testing.assert_array_equal(first.best, again.best)
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"population": 3}, "population 3"),
        ({"seed": 0}, "seed 0"),
        ({"box": Box(np.ones(7), -np.ones(7))}, "the box is empty"),
        ({"box": Box(np.zeros(7), np.full(7, np.inf))}, "the box is empty"),
        ({"misfits": lambda X: np.full(len(X), np.nan)}, "generation 1: each member needs"),
        ({"misfits": lambda X: np.ones(3)}, "generation 1: each member needs"),
    ],
)
def test_what_cannot_be_searched_is_one_clear_error(change, words):
    good = {"misfits": sphere, "box": UNIT, "seed": 1, "population": 10}
    with pytest.raises(ValueError, match=words):
        next(generations(**good | change))
