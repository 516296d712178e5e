"""Whole runs of the search in compiled code: the fast twin of `search.search`, equal to it to the last bit.

Each sum is taken in the order of `search`. Samples are columns here, so that loops over the members are vectorised.
"""

import numba
import numpy as np

from replication.compiled.bounds import Margin, _into_box, _margins, from_box, margin_2021
from replication.compiled.eigen import diagonalise, tridiagonal
from replication.compiled.folded import Fold
from replication.compiled.misfit import _misfits
from replication.search import Search, checked, constants
from replication.signature import Box

# Those of `search.stop_rule`, in its order.
RULES = ("", "maxiter", "tolfun", "tolfunhist", "tolx", "tolfacupx", "tolconditioncov", "tolflatfitness")
RULES += ("tolstagnation", "noeffectcoord", "noeffectaxis")


def whole_run(
    fold: Fold, box: Box, seed: int, population: int, iterations: int, margin: Margin = margin_2021
) -> Search:
    """Search a record from the middle of the box, as `search.search` does with `random_normals(seed)`.

    Parameters
    ----------
    fold : Fold
        The record, from `folded.fold`.
    box : Box
        Bounds, each of shape (7,).
    seed : int
        Seed of the run, above 0.
    population, iterations : int
        Members of a generation, and the most generations.
    margin : callable
        Width of the margin at a bound.

    Returns
    -------
    Search

    Raises
    ------
    ValueError
        See `search.checked`.
    """
    checked(box, population, iterations, seed)
    c = constants(population, box.lower.size)
    rates = (c.mu_eff, c.chi_n, c.c_sigma, c.d_sigma, c.c_c, c.c_1, c.c_mu, c.weights.sum())
    start = from_box((box.lower + box.upper) / 2, box, margin)
    bounds = (box.lower, box.upper, *_margins(box, margin))
    unit = (box.upper - box.lower) / 4
    best, misfit, rule, history = _run(fold, bounds, start, unit, c.weights, c.mu, rates, seed, iterations)
    return Search(best, misfit, population * len(history), RULES[rule], history)


@numba.njit(cache=True)
def _run(fold, bounds, start, unit, weights, mu, rates, seed, iterations):
    """Compiled body of `whole_run`: equations 12 to 17, in the names of `search`."""
    mu_eff, chi_n, c_sigma, d_sigma, c_c, c_1, c_mu, total = rates
    size, n = weights.size, start.size
    # Numba's own generator: the same numbers as `random_normals`.
    np.random.seed(seed)  # noqa: NPY002
    m, sigma = start, 1.0
    C = np.diag(np.exp(1e-4 * np.arange(n) / n))
    p_sigma, p_c = np.zeros(n), np.zeros(n)
    z, x = np.empty((n, size)), np.empty((n, size))
    history = np.empty((iterations, 7))
    best, misfit, spare = m, np.inf, np.nan
    for g in range(1, iterations + 1):
        C = (C + C.T) / 2
        D, beside, B = tridiagonal(C.copy())
        diagonalise(D, beside, B)
        D = np.sqrt(np.maximum(D, 1e-15 * D[-1]))
        # Equation 12.
        spare = _draw(z, spare)
        for i in range(n):
            z[i] *= D[i]
        _turn(B, z, x)
        for i in range(n):
            x[i] = m[i] + sigma * (unit[i] * x[i])
        members = _into_box(x.T, *bounds)
        misfits = _misfits(members, fold)
        ranking = np.argsort(misfits, kind="mergesort")
        # Equation 13.
        step = np.zeros(n)
        for k in range(mu):
            for i in range(n):
                step[i] += weights[k] * (x[i, ranking[k]] - m[i])
        before, m = m, m + step
        shift = step / unit / sigma
        # Equation 14.
        white, along = np.zeros((n, 1)), np.zeros((n, 1))
        _turn(B.T, shift.reshape(-1, 1), along)
        _turn(B, along / D.reshape(-1, 1), white)
        p_sigma = (1 - c_sigma) * p_sigma + np.sqrt(c_sigma * (2 - c_sigma) * mu_eff) * white[:, 0]
        # Equation 15.
        squared = (p_sigma**2).sum()
        old = sigma
        sigma *= np.exp(min(1.0, c_sigma / d_sigma * (np.sqrt(squared) / chi_n - 1)))
        # Equation 16.
        h_sigma = 1.0 if squared / (1 - (1 - c_sigma) ** (2 * g)) / n < 2 + 4 / (n + 1) else 0.0
        p_c = (1 - c_c) * p_c + h_sigma * np.sqrt(c_c * (2 - c_c) * mu_eff) * shift
        # Equation 17.
        learnt = _spread(x, ranking, before, old, unit, weights, mu, B, D)
        lost = c_1 * (1 - h_sigma) * c_c * (2 - c_c)
        kept = 1 - c_1 + lost - c_mu * total
        for i in range(n):
            for j in range(n):
                C[i, j] = kept * C[i, j] + c_1 * p_c[i] * p_c[j] + c_mu * learnt[i, j]
        std = sigma * (unit * np.sqrt(np.diag(C)))
        ranked, half = misfits[ranking], size // 2
        median = ranked[half] if size % 2 else (ranked[half - 1] + ranked[half]) / 2
        history[g - 1] = (ranked[0], median, ranked[int(0.75 * size)], sigma, D[-1] / D[0], std.min(), std.max())
        if ranked[0] < misfit:
            best, misfit = members[ranking[0]].copy(), ranked[0]
        rule = _stop_rule(history[:g], ranked[-1], m, sigma, unit, std, p_c, D, B, size)
        if rule or g == iterations:
            return best, misfit, 1 if g == iterations else rule, history[:g].copy()


@numba.njit(cache=True)
def _draw(z, spare):
    """Fill the columns of z by Marsaglia's polar method, as NumPy's legacy generator does; return what is left over.

    It makes two numbers at a time; the second, `spare`, is nan where none waits for the next generation.
    """
    n = z.shape[0]
    for k in range(z.size):
        kept = not np.isnan(spare)
        if not kept:
            square = 0.0
            while square >= 1.0 or square == 0.0:
                first = 2.0 * np.random.random() - 1.0  # noqa: NPY002
                second = 2.0 * np.random.random() - 1.0  # noqa: NPY002
                square = first * first + second * second
            factor = np.sqrt(-2.0 * np.log(square) / square)
        z[k % n, k // n] = spare if kept else factor * second
        spare = np.nan if kept else factor * first
    return spare


@numba.njit(cache=True)
def _turn(axes, columns, turned):
    """Product of a small matrix and columns."""
    turned[:] = 0.0
    for i in range(axes.shape[0]):
        for j in range(axes.shape[1]):
            row, part, factor = turned[i], columns[j], axes[i, j]
            for k in range(row.size):
                row[k] += factor * part[k]


@numba.njit(cache=True)
def _spread(x, ranking, m, sigma, unit, weights, mu, B, D):
    """Equation 17's weighted sum of y y'; where the weight is negative, y gets the expected length of a sample."""
    n, size = x.shape
    y = np.empty((n, size))
    for i in range(n):
        for k in range(size):
            y[i, k] = (x[i, ranking[k]] - m[i]) / sigma / unit[i]
    along, length = np.empty((n, size - mu)), np.zeros(size - mu)
    _turn(B.T, y[:, mu:], along)
    for i in range(n):
        length += (along[i] / D[i]) ** 2
    w = weights.copy()
    w[mu:] = w[mu:] * n / (np.sqrt(length) + 1e-9) ** 2
    learnt = np.zeros((n, n))
    for k in range(size):
        for i in range(n):
            for j in range(n):
                learnt[i, j] += w[k] * y[i, k] * y[j, k]
    return learnt


@numba.njit(cache=True)
def _stop_rule(history, worst, m, sigma, unit, std, p_c, D, B, size):
    """Index in `RULES` of the rule of `search.stop_rule` that holds; the most generations are the caller's."""
    n, g = m.size, history.shape[0]
    recent = history[max(0, g - 10 - 30 * n // size) :, 0]
    spread = recent.max() - recent.min()
    if worst - recent[-1] < 1e-11 and spread < 1e-11:
        return 2
    if recent.size > 9 and spread < 1e-12:
        return 3
    if (std < 1e-11).all() and (sigma * unit * p_c < 1e-11).all():
        return 4
    if (std > 1000 * unit).any():
        return 5
    if D[-1] > 1e7 * D[0]:
        return 6
    if g > 1 and history[-1, 2] <= history[-1, 0] and history[-2, 2] <= history[-2, 0]:
        return 7
    part = int(max(int(100 + 100 * n**1.5 / size) / 10, g // 5 / 10))
    if g // 5 > max(100, 2 * part):
        fifth = history[4::5][::-1]
        new, old = fifth[:part], fifth[part : 2 * part]
        if np.median(new[:, 0]) >= np.median(old[:, 0]) and np.median(new[:, 1]) >= np.median(old[:, 1]):
            return 8
    if (m == m + 0.2 * std).any():
        return 9
    axis = 0.1 * sigma * D[g % n] * unit * B[:, g % n]
    return 10 if (m == m + axis).all() else 0
