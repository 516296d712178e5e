"""The paper's search, CMA-ES (equations 12 to 17), as the library of the authors' time computed it.

Equations and symbols are the paper's. Constants, damping, negative weights and stop rules are those
of N. Hansen's tutorial (arXiv:1604.00772) with the values that `cma` had until 3.2; that nothing is
done about an uneven C but to stop is as it was until 2.6. In equation 17, c_1 = c_cov / mu_cov and
c_mu = c_cov (1 - 1 / mu_cov), and the sum runs over all members: the worse half has negative
weights. Samples are rows, shape (population, n), and every sum is taken in order, without BLAS, so
that a seed and an eigensolver give the same run on every processor.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from replication.arrays import FloatArray, IntArray
from replication.bounds import from_box, into_box
from replication.signature import Box

# Eigenvalues of a symmetric matrix, ascending, and its eigenvectors in columns.
Eigensolver = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


class Constants(NamedTuple):
    """What the population and the dimension n fix: w_i of the ranked members, then the equations' constants."""

    weights: FloatArray  # mu positive ones of sum 1 (equation 13), then equation 17's negative ones
    total_weight: float  # their sum
    mu: int
    n: int
    mu_eff: float
    chi_n: float  # expected length of a standard normal vector
    c_sigma: float
    d_sigma: float
    c_c: float
    c_1: float
    c_mu: float


def constants(population: int, n: int) -> Constants:
    """The constants for a population and n dimensions."""
    raw = np.array([math.log((population + 1) / 2) - math.log(i) for i in range(1, population + 1)])
    positive = raw[raw > 0] / raw[raw > 0].sum()
    negative = raw[raw <= 0]
    mu_eff = 1 / (positive**2).sum()
    mu_eff_negative = negative.sum() ** 2 / (negative**2).sum()
    # Within 3e-4 of the quotient of Gamma functions at n = 7.
    chi_n = n**0.5 * (1 - 1 / (4 * n) + 1 / (21 * n**2))
    c_sigma = (mu_eff + 2) / (n + mu_eff + 3)
    c_1 = min(1, population / 6) * 2 / ((n + 1.3) ** 2 + mu_eff)
    c_mu = min(1 - c_1, 2 * (mu_eff - 1.75 + 1 / mu_eff) / ((n + 2) ** 2 + mu_eff))
    # As much as keeps the size of C on average, but no more than keeps it positive definite.
    total = min(1 + c_1 / c_mu, (1 - c_1 - c_mu) / c_mu / n, 1 + 2 * mu_eff_negative / (mu_eff + 2))
    weights = np.r_[positive, total * negative / abs(negative.sum())]
    return Constants(
        weights=weights,
        total_weight=weights.sum(),
        mu=positive.size,
        n=n,
        mu_eff=mu_eff,
        chi_n=chi_n,
        c_sigma=c_sigma,
        d_sigma=1 + 2 * max(0, ((mu_eff - 1) / (n + 1)) ** 0.5 - 1) + c_sigma,
        c_c=(4 + mu_eff / n) / (n + 4 + 2 * mu_eff / n),
        c_1=c_1,
        c_mu=c_mu,
    )


class State(NamedTuple):
    """The distribution of the next samples, and the paths.

    `unit` is the length that sigma and C count along x_i.
    """

    g: int  # generations so far
    m: FloatArray
    sigma: float
    C: FloatArray
    p_sigma: FloatArray
    p_c: FloatArray
    unit: FloatArray
    B: FloatArray  # axes of the C that was sampled last, in columns
    D: FloatArray  # their lengths, ascending: C = B D^2 B'

    @property
    def std(self) -> FloatArray:
        """Standard deviations of the next samples, shape (n,)."""
        return self.sigma * (self.unit * np.sqrt(np.diag(self.C)))


@dataclass(frozen=True)
class Generation:
    """One generation: samples x drawn from `before`, members in the box, misfits, ranks, and the state `after`."""

    before: State
    x: FloatArray
    members: FloatArray
    misfits: FloatArray
    ranking: IntArray  # numbers of the members, the best first
    after: State
    constants: Constants


def first_state(box: Box, sigma: float) -> State:
    """Middle of the box, a sigma in quarters of its width, and no path yet."""
    n = box.lower.size
    middle = from_box((box.lower + box.upper) / 2, box)
    # The identity, but for an order of the axes.
    C = np.diag([math.exp(1e-4 * i / n) for i in range(n)])
    unit = (box.upper - box.lower) / 4
    return State(0, middle, sigma, C, np.zeros(n), np.zeros(n), unit, np.eye(n), np.ones(n))


# ---------------------------------------------------------------------------------------- equations 12 to 17


def decompose(state: State, eigen: Eigensolver = np.linalg.eigh) -> State:
    """Find axes B and lengths D of C."""
    C = (state.C + state.C.T) / 2
    squares, B = eigen(C)
    # Rounding may leave an eigenvalue at or below 0; the floor is beyond the condition at which the
    # search stops.
    D = np.sqrt(np.maximum(squares, 1e-15 * squares[-1]))
    return state._replace(C=C, B=B, D=D)


def sample(state: State, z: FloatArray) -> FloatArray:
    """Equation 12: samples x of N(m, sigma^2 C) from standard normal z, shapes (population, n)."""
    y = _turn(state.B, _column(state.D) * _columns(z))
    return _rows(_column(state.m) + state.sigma * (_column(state.unit) * y))


def mean_step(state: State, ranked: FloatArray, c: Constants) -> FloatArray:
    """Equation 13, as a step from the last mean: the difference of two means has lost digits."""
    return (c.weights[: c.mu, None] * (ranked[: c.mu] - state.m)).sum(axis=0)


def conjugate_path(state: State, shift: FloatArray, c: Constants) -> FloatArray:
    """Equation 14: p_sigma after a step of the mean, in units and sigmas, with C^(-1/2) = B D^-1 B'."""
    B, D = state.B, state.D
    white = (B * ((B.T * shift).sum(axis=1) / D)).sum(axis=1)
    gain = math.sqrt(c.c_sigma * (2 - c.c_sigma) * c.mu_eff)
    return (1 - c.c_sigma) * state.p_sigma + gain * white


def step_size(sigma: float, p_sigma: FloatArray, c: Constants) -> float:
    """Equation 15, by a factor e at most."""
    growth = c.c_sigma / c.d_sigma * (math.sqrt((p_sigma**2).sum()) / c.chi_n - 1)
    return sigma * math.exp(min(1.0, growth))


def path_advances(p_sigma: FloatArray, g: int, c: Constants) -> float:
    """h_sigma of equation 16: 0, and p_c stalls, while p_sigma is much too long; else 1."""
    fresh = 1 - (1 - c.c_sigma) ** (2 * g)
    return float((p_sigma**2).sum() / fresh / c.n < 2 + 4 / (c.n + 1))


def evolution_path(state: State, shift: FloatArray, h_sigma: float, c: Constants) -> FloatArray:
    """Equation 16: p_c after a step of the mean, in units and sigmas."""
    gain = h_sigma * math.sqrt(c.c_c * (2 - c.c_c) * c.mu_eff)
    return (1 - c.c_c) * state.p_c + gain * shift


def covariance(
    state: State, ranked: FloatArray, p_c: FloatArray, h_sigma: float, c: Constants
) -> FloatArray:
    """Equation 17, from the ranked samples and the new path."""
    y = (_columns(ranked) - _column(state.m)) / state.sigma / _column(state.unit)
    # Where the weight is negative, y gets the expected length of a sample.
    length = np.sqrt(((_turn(state.B.T, y[:, c.mu :]) / _column(state.D)) ** 2).sum(axis=0))
    w = c.weights.copy()
    w[c.mu :] = w[c.mu :] * c.n / (length + 1e-9) ** 2
    products = np.empty((w.size, c.n, c.n))
    np.multiply((w * y)[:, None], y, out=products.transpose(1, 2, 0))
    learnt = products.reshape(w.size, -1).sum(axis=0).reshape(c.n, c.n)
    # By a stalled path: the paper's delta(h_sigma)
    lost = c.c_1 * (1 - h_sigma) * c.c_c * (2 - c.c_c)
    kept = 1 - c.c_1 + lost - c.c_mu * c.total_weight
    return kept * state.C + c.c_1 * _column(p_c) * p_c + c.c_mu * learnt


def update(state: State, ranked: FloatArray, c: Constants) -> State:
    """Equations 13 to 17: the next state from the samples x_{1:lambda} to x_{lambda:lambda}, the best first."""
    step = mean_step(state, ranked, c)
    shift = step / state.unit / state.sigma
    p_sigma = conjugate_path(state, shift, c)
    h_sigma = path_advances(p_sigma, state.g + 1, c)
    p_c = evolution_path(state, shift, h_sigma, c)
    return state._replace(
        g=state.g + 1,
        m=state.m + step,
        sigma=step_size(state.sigma, p_sigma, c),
        C=covariance(state, ranked, p_c, h_sigma, c),
        p_sigma=p_sigma,
        p_c=p_c,
    )


def _turn(axes: FloatArray, columns: FloatArray) -> FloatArray:
    """Product of a small matrix and columns."""
    return (axes[:, :, None] * columns).sum(axis=1)


def _column(x: FloatArray) -> FloatArray:
    return x[:, None]


def _columns(rows: FloatArray) -> FloatArray:
    """A sample a column, in memory too: a third of the time of rows."""
    return np.ascontiguousarray(rows.T)


_rows = _columns


# ------------------------------------------------------------------------------------------------ search


def check_settings(box: Box, population: int) -> None:
    """Refuse settings that no search can be run with, by a ValueError that names the first one."""
    width = box.upper - box.lower
    if population < 4:
        raise ValueError(f"population {population}: at least 4 members are needed")
    if width.size == 0 or not np.all(np.isfinite(width) & (width > 0)):
        raise ValueError(
            "the box is empty: every lower bound must lie below its upper one, both finite"
        )


def random_normals(seed: int) -> Callable[[int, int], FloatArray]:
    """Standard normal numbers in the order of the stored runs, from a generator of their own.

    A seed above 0.
    """
    if seed <= 0:
        raise ValueError(f"seed {seed}: a seed above 0 is needed (cma takes 0 for the clock)")
    return np.random.RandomState(seed).randn


def generations(
    misfits: Callable[[FloatArray], FloatArray],
    box: Box,
    normals: Callable[[int, int], FloatArray],
    population: int,
    sigma: float = 1.0,
    eigen: Eigensolver = np.linalg.eigh,
) -> Iterator[Generation]:
    """Go through the search from the middle of the box, one generation at a time, without end.

    Parameters
    ----------
    misfits : callable
        From members of shape (population, n) in the box to misfits of shape (population,).
    box : Box
        Bounds, each of shape (n,).
    normals : callable
        Gives standard normal numbers of a shape, as `random_normals` does.
    population : int
        Members lambda of a generation, at least 4.
    sigma : float
        First standard deviations, in quarters of the box.
    eigen : callable
        Eigenvalues of a symmetric matrix, ascending, and its eigenvectors. A vector's sign is free,
        and a seed's run depends on it.

    Raises
    ------
    ValueError
        Settings that `check_settings` refuses, sigma not above 0, or a misfit that is not finite.
    """
    check_settings(box, population)
    n = box.lower.size
    if not 0 < sigma < math.inf:
        raise ValueError(f"sigma {sigma}: a number above 0 is needed")
    c = constants(population, n)
    after = first_state(box, sigma)
    while True:
        before = decompose(after, eigen)
        x = sample(before, normals(population, n))
        members = into_box(x, box)
        found = np.asarray(misfits(members), dtype=float)
        if found.shape != (population,) or not np.isfinite(found).all():
            raise ValueError(
                f"generation {before.g + 1}: each member needs one misfit, a finite number"
            )
        ranking = np.argsort(found, kind="stable")
        after = update(before, x[ranking], c)
        yield Generation(before, x, members, found, ranking, after, c)
