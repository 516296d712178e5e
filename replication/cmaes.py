"""The search of the paper, CMA-ES (equations 12 to 17), as the library that the authors' public notebook calls had it.

What the equations leave open follows that library, `cma` as of 2021 (2.6 to 3.2; method: Hansen, arXiv:1604.00772):

- the constants, with 3 in c_sigma and a factor min(1, lambda / 6), and the bounds and ends of a search;
- 12: C starts beside the identity, which orders equal axes, and m in the middle of the box;
- 13: the sum is over the mu best of the new members, as the text says; the equation prints unranked ones (E12);
- 15: a factor e at most, and E||N(0, I)|| by its series;
- 16: h_sigma, which the paper has in equation 17 alone, stalls p_c too;
- 17: c_1 = c_cov / mu_cov and c_mu = c_cov (1 - 1 / mu_cov), and the sum runs over all members, the worse half with
  negative weights.

Why it is written out: with the compiled cost `cma` takes seconds for a run, this a twentieth of a second, and our
prediction intervals for Table 2 need a hundred thousand runs. Besides, today's `cma` is another algorithm than that of
2021. The tests compare a generation with the library, and `studies` replays the authors' stored runs.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from replication.compilation import njit
from replication.signature import Box, FloatArray

# Eigenvalues of a symmetric matrix, ascending, and its eigenvectors in columns, whose signs are free.
Eigensolver = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


class Constants(NamedTuple):
    """What the population lambda and the dimension n fix."""

    weights: FloatArray  # w_i of the ranked members: mu positive ones of sum 1, then negative ones
    mu: int
    mu_eff: float  # variance effective selection mass
    chi_n: float  # expected length of a standard normal vector
    c_sigma: float  # learning rate of p_sigma
    d_sigma: float  # damping of the step size
    c_c: float  # learning rate of p_c
    c_1: float  # learning rate of the rank-one update, c_cov / mu_cov
    c_mu: float  # and of the rank-mu update, c_cov (1 - 1 / mu_cov)


def constants(population: int, n: int) -> Constants:
    """The library's constants for a population and n dimensions."""
    raw = np.log((population + 1) / 2) - np.log(np.arange(1, population + 1))
    positive = np.maximum(raw, 0) / raw[raw > 0].sum()
    negative = np.minimum(raw, 0) / abs(raw[raw <= 0].sum())
    mu_eff = 1 / (positive**2).sum()
    mu_eff_negative = 1 / (negative**2).sum()
    c_sigma = (mu_eff + 2) / (n + mu_eff + 3)
    c_1 = min(1, population / 6) * 2 / ((n + 1.3) ** 2 + mu_eff)
    c_mu = min(1 - c_1, 2 * (mu_eff - 1.75 + 1 / mu_eff) / ((n + 2) ** 2 + mu_eff))
    # The least of three: what keeps the size of C on average, keeps C positive definite, and suits their own mu_eff.
    total_negative = min(
        1 + c_1 / c_mu, (1 - c_1 - c_mu) / c_mu / n, 1 + 2 * mu_eff_negative / (mu_eff + 2)
    )
    return Constants(
        weights=positive + total_negative * negative,
        mu=int((raw > 0).sum()),
        mu_eff=mu_eff,
        # Within 0.03 % of sqrt(2) Gamma((n + 1) / 2) / Gamma(n / 2) at n = 7.
        chi_n=n**0.5 * (1 - 1 / (4 * n) + 1 / (21 * n**2)),
        c_sigma=c_sigma,
        d_sigma=1 + 2 * max(0, ((mu_eff - 1) / (n + 1)) ** 0.5 - 1) + c_sigma,
        c_c=(4 + mu_eff / n) / (n + 4 + 2 * mu_eff / n),
        c_1=c_1,
        c_mu=c_mu,
    )


class State(NamedTuple):
    """The distribution N(m, sigma^2 C) of the next samples, and the paths; lengths in quarters of the box."""

    g: int  # generations so far
    m: FloatArray
    sigma: float
    C: FloatArray
    p_sigma: FloatArray
    p_c: FloatArray


def sample(
    state: State, z: FloatArray, B: FloatArray, D: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Equation 12: members of the next generation, drawn from N(m, sigma^2 C) with C = B D^2 B'.

    Parameters
    ----------
    state : State
    z : array of shape (population, n)
        Standard normal numbers.
    B : array of shape (n, n)
        Axes of C in columns.
    D : array of shape (n,)
        Their lengths.

    Returns
    -------
    x, y : arrays of shape (population, n)
        The members, unbounded, and their steps (x - m) / sigma.
    """
    y = z @ (B * D).T
    x = state.m + state.sigma * y  # equation 12
    return x, y


@njit
def update(state: State, z: FloatArray, y: FloatArray, B: FloatArray, c: Constants) -> State:
    """Equations 13 to 17: the next distribution.

    Parameters
    ----------
    state : State
        The distribution that was sampled.
    z : array of shape (population, n)
        Standard normal numbers of the samples, the best first.
    y : array of shape (population, n)
        Their steps (x_{i:lambda} - m) / sigma = B D z, so C^(-1/2) y = B z, and |C^(-1/2) y| = |z|.
    B : array of shape (n, n)
        Axes of C in columns: C = B D^2 B'.
    c : Constants
    """
    n = state.m.size
    step = c.weights[: c.mu] @ y[: c.mu]  # (equation 13's sum - m) / sigma, as weights sum to 1
    m = state.m + state.sigma * step  # equation 13

    whitened = B @ (c.weights[: c.mu] @ z[: c.mu])  # C^(-1/2) step
    gain = np.sqrt(c.c_sigma * (2 - c.c_sigma) * c.mu_eff)
    p_sigma = (1 - c.c_sigma) * state.p_sigma + gain * whitened  # equation 14

    growth = c.c_sigma / c.d_sigma * (float(np.linalg.norm(p_sigma)) / c.chi_n - 1)
    # By a factor e at most.
    sigma = state.sigma * np.exp(min(1.0, growth))  # equation 15

    # 0, and p_c stalls, while p_sigma is much too long; else 1.
    squared_length = p_sigma @ p_sigma / (1 - (1 - c.c_sigma) ** (2 * state.g + 2))
    h_sigma = 1.0 if squared_length / n < 2 + 4 / (n + 1) else 0.0
    gain = h_sigma * np.sqrt(c.c_c * (2 - c.c_c) * c.mu_eff)
    p_c = (1 - c.c_c) * state.p_c + gain * step  # equation 16

    # Where the weight is negative, a step is rescaled to the Mahalanobis length sqrt(n),
    # that of a usual sample.
    w = c.weights.copy()
    for i in range(c.mu, w.size):
        w[i] *= n / (np.sqrt(z[i] @ z[i]) + 1e-9) ** 2
    delta = (1 - h_sigma) * c.c_c * (2 - c.c_c)  # the paper's delta(h_sigma)
    C = (1 - c.c_1 - c.c_mu * c.weights.sum()) * state.C  # equation 17, first term
    C += c.c_1 * (p_c[:, None] * p_c + delta * state.C)  # equation 17, second term
    C += c.c_mu * (w * y.T) @ y  # equation 17, third term
    return State(state.g + 1, m, sigma, C, p_sigma, p_c)


class Normals:
    """The normal numbers of a seed, a generation after the other, drawn when they are asked for first."""

    def __init__(self, seed: int, population: int, n: int):
        self._source = np.random.RandomState(seed)
        self._shape = (population, n)
        self._drawn: list[FloatArray] = []

    def of(self, g: int) -> FloatArray:
        """Those of generation g, shape (population, n)."""
        while len(self._drawn) <= g:
            self._drawn.append(self._source.randn(*self._shape))
        return self._drawn[g]


class Generation(NamedTuple):
    """One generation: the distribution that it was drawn from, its members in the box, and their misfits."""

    state: State
    D: FloatArray  # lengths of the axes of C, ascending
    members: FloatArray  # shape (population, n)
    misfits: FloatArray  # shape (population,)


def generations(
    misfits: Callable[[FloatArray], FloatArray],
    box: Box,
    seed: int,
    population: int,
    eigen: Eigensolver = np.linalg.eigh,
    normals: Normals | None = None,
) -> Iterator[Generation]:
    """Search from the middle of the box, with a quarter of it as standard deviations, a generation at a time.

    Parameters
    ----------
    misfits : callable
        From members in the box, shape (population, n), to their misfits, shape (population,).
    box : Box
        Bounds of the n parameters.
    seed : int
        Above 0. The normal numbers come in the order of the stored runs.
    population : int
        Members lambda of a generation, at least 4.
    eigen : callable
        A seed's run depends on the signs that it gives the eigenvectors.
    normals : Normals, optional
        The seed's own, where several runs share them.

    Yields
    ------
    Generation
        Without end.

    Raises
    ------
    ValueError
        The box is empty, the population or the seed too small, or a member has no finite misfit.
    """
    width = box.upper - box.lower
    if not (np.isfinite(width).all() and (width > 0).all()):
        raise ValueError("the box is empty: each lower bound must lie below its upper one")
    if population < 4 or seed <= 0:
        raise ValueError(f"population {population}, seed {seed}: at least 4 and 1 are needed")
    n = width.size
    unit = width / 4
    normals = normals or Normals(seed, population, n)
    c = constants(population, n)
    C = np.diag(np.exp(1e-4 * np.arange(n) / n))  # nearly the identity, with an order
    m = (box.lower + box.upper) / 2 / unit
    state = State(0, m, 1.0, C, np.zeros(n), np.zeros(n))
    bounds = (*box, *margins(box))
    while True:
        squares, B = eigen((state.C + state.C.T) / 2)
        D = np.sqrt(np.maximum(squares, 1e-15 * squares[-1]))  # rounding may leave a square below 0
        z = normals.of(state.g)
        x, y = sample(state, z, B, D)  # equation 12
        members = _into_box(x * unit, *bounds)
        costs = misfits(members)
        if costs.shape != (population,) or not np.isfinite(costs).all():
            raise ValueError(f"generation {state.g + 1}: each member needs one finite misfit")
        yield Generation(state, D, members, costs)
        order = np.argsort(costs, kind="stable")
        state = update(state, z.take(order, axis=0), y.take(order, axis=0), B, c)


class Search(NamedTuple):
    """The end of a search."""

    best: FloatArray  # the best member of all, shape (n,)
    misfit: float
    generations: int


def search(steps: Iterator[Generation], iterations: int) -> Search:
    """Follow `generations` until either of two rules of the library holds, or for so many iterations.

    The best misfits of the last 10 + 30 n / population generations (in a shorter run of all, but of ten at least) are
    alike within 1e-11, in the misfit's unit; or the axes of C differ by a factor 1e7. The library's other rules hardly
    ever end a run here.
    """
    history: list[float] = []
    best = Search(np.empty(0), np.inf, 0)
    for now in steps:
        k = now.misfits.argmin()
        history.append(now.misfits[k])
        if now.misfits[k] < best.misfit:
            best = Search(now.members[k], float(now.misfits[k]), 0)
        population, n = now.members.shape
        recent = history[-10 - 30 * n // population :]
        alike = len(recent) >= 10 and max(recent) - min(recent) < 1e-11
        if alike or now.D[-1] > 1e7 * now.D[0] or len(history) >= iterations:
            break
    return best._replace(generations=len(history))


# -------------------------------------------------- bounds, as the library had them in 2021


def margins(box: Box) -> tuple[FloatArray, FloatArray]:
    """Half-widths of the margins about the lower and upper bounds, in which the map into the box is a parabola."""
    half = (box.upper - box.lower) / 2
    at_lower = np.minimum(half, (1 + np.abs(box.lower)) / 20)
    at_upper = np.minimum(half, (1 + np.abs(box.upper)) / 20)
    return at_lower, at_upper


def into_box(x: FloatArray, box: Box) -> FloatArray:
    """Map unbounded samples, shape (population, n), into the box.

    The identity inside, a parabola in the margins, mirrored at the ends of the margins, which are mapped to the bounds.
    """
    return _into_box(x, *box, *margins(box))


@njit
def _into_box(x, lower, upper, at_lower, at_upper):
    """Map each element by itself."""
    members = np.empty_like(x)
    for p in range(x.shape[0]):
        for i in range(x.shape[1]):
            value = x[p, i]
            first, last = lower[i] - at_lower[i], upper[i] + at_upper[i]
            if value < first or value > last:
                value = first + abs((value - last) % (2 * (last - first)) - (last - first))
            if value < lower[i] + at_lower[i]:
                value = lower[i] + (value - first) ** 2 / (4 * at_lower[i])
            elif value > upper[i] - at_upper[i]:
                value = upper[i] - (value - last) ** 2 / (4 * at_upper[i])
            members[p, i] = value
    return members
