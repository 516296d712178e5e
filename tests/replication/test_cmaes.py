"""Equations 12 to 17 against the library, the bounds by hand, and what the search finds and when it ends."""

from itertools import islice

import cma
import numpy as np
import pytest

from replication.cmaes import (
    Generation,
    State,
    constants,
    generations,
    into_box,
    margins,
    search,
    update,
)
from replication.signature import Box

UNIT = Box(np.full(7, -1.0), np.ones(7))
START = State(0, np.zeros(7), 1.0, np.eye(7), np.zeros(7), np.zeros(7))


def sphere(members):
    return ((members - 0.3) ** 2).sum(axis=1)


def valley(members):
    x = 10 * members
    return (100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2).sum(axis=1)


# In turn a population whose negative weights are limited by each of three bounds, and c_mu by 1 - c_1.
@pytest.mark.parametrize(("population", "n"), [(4, 7), (12, 7), (31, 7), (300, 7), (300, 2)])
@pytest.mark.filterwarnings("ignore:orphanated")
def test_equations_13_to_17_give_what_the_library_gives_with_the_constants_of_2021(
    monkeypatch, population, n
):
    options = {"popsize": population, "seed": np.nan, "verbose": -9, "verb_log": 0}
    library = cma.CMAEvolutionStrategy(np.zeros(n), 1.0, options)
    c = constants(population, n)
    # What the library has otherwise today.
    assert c.c_sigma == pytest.approx((c.mu_eff + 2) / (n + c.mu_eff + 3), rel=1e-12)
    longer = max(0, np.sqrt((c.mu_eff - 1) / (n + 1)) - 1)
    assert c.d_sigma == pytest.approx(1 + c.c_sigma + 2 * longer, rel=1e-12)
    assert c.chi_n == pytest.approx(np.sqrt(n) * (1 - 0.25 / n + 1 / 21 / n**2), rel=1e-12)
    library.adapt_sigma.initialize(library)
    library.adapt_sigma.cs, library.adapt_sigma.damps = c.c_sigma, c.d_sigma
    monkeypatch.setattr(cma.sigma_adaptation.Mh, "chiN", lambda n: c.chi_n)
    box = Box(np.full(n, -1.0), np.ones(n))
    state = next(generations(valley, box, 1, population)).state
    rng = np.random.default_rng(1)
    for generation in range(8):
        library.ask()
        before = state.sigma
        squares, B = np.linalg.eigh(state.C)
        z = rng.standard_normal((population, n))
        z *= 40 if generation == 5 else 1  # the step size grows by e, and p_c stalls
        y = z @ (B * np.sqrt(squares)).T
        x = state.m + state.sigma * y
        misfits = valley(x / 10)
        library.tell(list(x), list(misfits), check_points=False)
        order = np.argsort(misfits)
        state = update(state, z[order], y[order], B, c)
        assert generation != 5 or state.sigma == pytest.approx(np.e * before)
        theirs = (library.mean, library.sigma, library.sm.C, library.adapt_sigma.ps, library.pc)
        for our, their in zip(state[1:], theirs, strict=True):
            np.testing.assert_allclose(our, their, rtol=1e-11, atol=1e-11 * np.abs(their).max())


@pytest.mark.parametrize(("side", "stalls"), [(1 - 1e-9, False), (1 + 1e-9, True)])
def test_p_c_stalls_where_p_sigma_is_longer_than_the_method_allows(side, stalls):
    n, g, c = 7, 3, constants(30, 7)
    # Hansen's threshold for the squared length of p_sigma, over its share of the stationary one after g + 1 steps.
    longest = np.sqrt((2 + 4 / (n + 1)) * n * (1 - (1 - c.c_sigma) ** (2 * (g + 1))))
    p_sigma = np.eye(n)[0] * longest * side / (1 - c.c_sigma)
    state = START._replace(g=g, p_sigma=p_sigma)
    after = update(state, np.zeros((30, n)), np.ones((30, n)), START.C, c)
    assert (after.p_c == 0).all() == stalls


def test_c_sigma_acts_on_the_step_size_and_not_on_the_path_of_the_covariance():
    z, c = np.random.default_rng(1).standard_normal((300, 7)), constants(300, 7)
    ours, other = (update(START, z, z, START.C, each) for each in (c, c._replace(c_sigma=0.5)))
    assert ours.sigma != other.sigma
    np.testing.assert_array_equal(ours.p_c, other.p_c)


def test_equation_13_needs_the_ranked_members_of_the_new_generation():
    far = []
    for misfits in (sphere, lambda members: np.zeros(len(members))):
        *_, last = islice(generations(misfits, UNIT, 2, 300), 61)
        far.append(sphere(last.members).mean())
    assert far[0] < 1e-6
    assert far[1] > 1


def test_members_are_drawn_about_the_mean_of_equation_12():
    """At first the middle of the box, by a quarter of it."""
    box = Box(np.array([-2.0, 0.0]), np.array([2.0, 10.0]))
    first, second = islice(generations(lambda X: X[:, 0], box, 3, 40), 2)
    assert (first.state.g, second.state.g) == (0, 1)
    D = np.exp(0.5e-4 * np.array([0, 0.5]))  # square roots of C's diagonal, beside one
    x = [0, 5] + [1, 2.5] * D * np.random.RandomState(3).randn(40, 2)
    np.testing.assert_allclose(first.members, into_box(x, box), rtol=1e-12)
    np.testing.assert_allclose(first.D, D, rtol=1e-12)


def test_the_axes_are_those_of_the_symmetric_part_of_C_and_a_square_below_zero_is_rounding():
    asked = []

    def eigen(C):
        asked.append(C)
        return np.array([-1.0, 1, 1, 1, 1, 1, 4]), np.eye(7)

    first, second = islice(generations(sphere, UNIT, 1, 4, eigen), 2)
    np.testing.assert_allclose(first.D, [2 * np.sqrt(1e-15), *[1] * 5, 2], rtol=1e-12)
    C = second.state.C
    np.testing.assert_allclose(asked[1], (C + C.T) / 2, rtol=1e-12)


@pytest.mark.parametrize(("misfits", "at"), [(sphere, 0.3), (valley, 0.1)])
def test_the_search_finds_the_minimum_and_ends_by_itself(misfits, at):
    run = search(generations(misfits, UNIT, 3, 60), 1000)
    assert run.misfit < 1e-9
    assert run.generations < 1000
    np.testing.assert_allclose(run.best, at, atol=1e-3)


def script(misfits, population=300, axes=(2.0, 3.0, 4.0)):
    """Generations with these best misfits; the best member holds its generation's number."""
    for number, misfit in enumerate(misfits, start=1):
        members = np.zeros((population, 7))
        members[2] = number
        costs = np.full(population, 9.0)
        costs[2] = misfit
        yield Generation(START, np.array(axes), members, costs)


@pytest.mark.parametrize(
    ("population", "window"), [(300, 10), (40, 15), (217, 10), (210, 11), (4, 62)]
)
def test_a_search_ends_when_the_last_misfits_are_alike_within_1e_11(population, window):
    # 10 + 30 n / population generations, and fewer in a run that is shorter.
    falls = [1.0] + [0.0] * 99
    alike, apart = ([0.5, 0.5 + size] * 50 for size in (0.95e-11, 1.05e-11))
    for misfits, end in ((falls, window + 1), (alike, 10), (apart, 99)):
        assert search(script(misfits, population), 99).generations == end


@pytest.mark.parametrize(("ratio", "end"), [(0.95e7, 9), (1.05e7, 1)])
def test_a_search_ends_when_the_axes_of_its_distribution_differ_by_a_factor_of_1e7(ratio, end):
    steps = script(range(100), axes=(2.0, 3.0, 2 * ratio))
    assert search(steps, 9).generations == end


def test_the_best_member_of_all_generations_is_returned():
    run = search(script([5.0, 3.0, 1.0, 1.0, 2.0, 4.0]), 6)
    assert (run.best[0], run.misfit, run.generations) == (3, 1.0, 6)


def test_samples_are_mapped_into_the_box_by_parabolas_in_its_margins_and_mirrored_beyond():
    box = Box(np.array([-2.0, 0.0, 5.0]), np.array([2.0, 10.0, 5.1]))
    np.testing.assert_allclose(margins(box), [[0.15, 0.05, 0.05], [0.15, 0.55, 0.05]], rtol=1e-9)
    box = Box(box.lower[1:2], box.upper[1:2])
    # From -0.05 to 10.55 the map rises; then it is mirrored, and again after 21.2.
    lower, upper = 0.05**2 / 0.2, 10 - 0.55**2 / 2.2
    expected = {-0.05: 0, 0: lower, 0.05: 0.05, 7: 7, 9.45: 9.45, 10: upper, 10.55: 10}
    expected |= {-0.1: lower, -1: 0.9, 11.1: upper, 14.1: 7, 21.2: lower, 28.2: 7, -28.3: 7}
    x = np.array([*expected])
    np.testing.assert_allclose(into_box(x[:, None], box)[:, 0], [*expected.values()], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"population": 3}, "population 3"),
        ({"seed": 0}, "seed 0"),
        ({"box": Box(np.ones(7), np.ones(7))}, "box is empty"),
        ({"misfits": lambda X: np.full(len(X), np.nan)}, "one finite misfit"),
        ({"misfits": lambda X: np.ones(3)}, "one finite misfit"),
    ],
)
def test_what_cannot_be_searched_is_one_clear_error(change, words):
    good = {"misfits": sphere, "box": UNIT, "seed": 1, "population": 4}
    with pytest.raises(ValueError, match=words):
        next(generations(**good | change))
