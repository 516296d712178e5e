"""Whole runs of the search in compiled code: the fast twin of `search.search`, equal to it to the last bit.

Each sum is taken in the order of `search`. Samples are columns here, so that loops over the members are vectorised.
"""

import numpy as np

from replication.compiled.bounds import bend_into, from_box, margins_of
from replication.compiled.cache import njit
from replication.compiled.eigen import symmetric_eigen
from replication.compiled.misfit import Fold, folded_rmse
from replication.search import Search, check_settings, constants
from replication.signature import Box


def whole_run(record: Fold, box: Box, seed: int, population: int, iterations: int) -> Search:
    """Search a folded record as `search.search` does from the middle of the box with `random_normals(seed)`."""
    check_settings(box, population, iterations, seed)
    c = constants(population, box.lower.size)
    start, bounds = from_box((box.lower + box.upper) / 2, box), (box.lower, box.upper, *margins_of(box))
    unit = (box.upper - box.lower) / 4
    best, misfit, stop, history = _run(record, bounds, start, unit, c, c.weights.sum(), seed, iterations)
    return Search(best, misfit, population * len(history), stop, history)


@njit
def _run(record, bounds, start, unit, c, total_weight, seed, iterations):
    """Compiled body of `whole_run`, in the names of `search`."""
    size, n = c.weights.size, start.size
    np.random.seed(seed)  # noqa: NPY002  Numba's own generator: the same numbers as `random_normals`
    m, sigma, C = start, 1.0, np.diag(np.exp(1e-4 * np.arange(n) / n))
    p_sigma, p_c = np.zeros(n), np.zeros(n)
    history, best, misfit, stop = np.empty((iterations, 7)), m, np.inf, ""
    g = 0
    while stop == "":
        g += 1
        C = (C + C.T) / 2
        squares, B = symmetric_eigen(C)
        D = np.sqrt(np.maximum(squares, 1e-15 * squares[-1]))
        # Equation 12.
        z = np.random.standard_normal((size, n)).T  # noqa: NPY002
        x = _column(m) + sigma * (_column(unit) * _turn(B, _column(D) * z))
        members = bend_into(x.T, *bounds)
        misfits = folded_rmse(members, record)
        ranking = np.argsort(misfits, kind="mergesort")
        state = m, sigma, C, p_sigma, p_c
        m, sigma, C, p_sigma, p_c = _update(g, state, x[:, ranking], unit, B, D, c, total_weight)
        ranked, std = misfits[ranking], sigma * (unit * np.sqrt(np.diag(C)))
        median = (ranked[(size - 1) // 2] + ranked[size // 2]) / 2
        history[g - 1] = (ranked[0], median, ranked[int(0.75 * size)], sigma, D[-1] / D[0], std.min(), std.max())
        if ranked[0] < misfit:
            best, misfit = members[ranking[0]].copy(), ranked[0]
        stop = _stop_rule(history[:g], ranked[-1], m, sigma, unit, std, p_c, D, B, size)
        stop = "maxiter" if g == iterations else stop
    return best, misfit, stop, history[:g].copy()


@njit
def _update(g, state, ranked, unit, B, D, c, total_weight):
    """Twin of `search.update`, for samples in columns, the best first."""
    m, sigma, C, p_sigma, p_c = state
    n, size = ranked.shape
    # Equation 13.
    step = (c.weights[: c.mu] * (ranked[:, : c.mu] - _column(m))).sum(axis=1)
    shift = step / unit / sigma
    # Equation 14.
    white = (B * ((B.T * shift).sum(axis=1) / D)).sum(axis=1)
    p_sigma = (1 - c.c_sigma) * p_sigma + np.sqrt(c.c_sigma * (2 - c.c_sigma) * c.mu_eff) * white
    # Equation 15.
    squared = (p_sigma**2).sum()
    next_sigma = sigma * np.exp(min(1.0, c.c_sigma / c.d_sigma * (np.sqrt(squared) / c.chi_n - 1)))
    # Equation 16.
    h_sigma = 1.0 if squared / (1 - (1 - c.c_sigma) ** (2 * g)) / n < 2 + 4 / (n + 1) else 0.0
    p_c = (1 - c.c_c) * p_c + h_sigma * np.sqrt(c.c_c * (2 - c.c_c) * c.mu_eff) * shift
    # Equation 17.
    y = (ranked - _column(m)) / sigma / _column(unit)
    length = ((_turn(B.T, y[:, c.mu :]) / _column(D)) ** 2).sum(axis=0)
    w = c.weights.copy()
    w[c.mu :] = w[c.mu :] * n / (np.sqrt(length) + 1e-9) ** 2
    learnt = np.zeros((n, n))
    for k in range(size):
        for i in range(n):
            for j in range(n):
                learnt[i, j] += w[k] * y[i, k] * y[j, k]
    lost = c.c_1 * (1 - h_sigma) * c.c_c * (2 - c.c_c)
    C = (1 - c.c_1 + lost - c.c_mu * total_weight) * C + c.c_1 * _column(p_c) * p_c + c.c_mu * learnt
    return m + step, next_sigma, C, p_sigma, p_c


@njit
def _column(x):
    return x.reshape(-1, 1)


@njit
def _turn(axes, columns):
    """Product of a small matrix and columns, summed in order: without BLAS."""
    turned = np.zeros(columns.shape)
    for i in range(axes.shape[0]):
        for j in range(axes.shape[1]):
            turned[i] += axes[i, j] * columns[j]
    return turned


@njit
def _stop_rule(history, worst, m, sigma, unit, std, p_c, D, B, size):
    """Twin of `search.stop_rule`; the most generations are the caller's."""
    n, g = m.size, history.shape[0]
    recent = history[max(0, g - 10 - 30 * n // size) :, 0]
    spread = recent.max() - recent.min()
    if worst - recent[-1] < 1e-11 and spread < 1e-11:
        return "tolfun"
    if recent.size > 9 and spread < 1e-12:
        return "tolfunhist"
    if (std < 1e-11).all() and (sigma * unit * p_c < 1e-11).all():
        return "tolx"
    if (std > 1000 * unit).any():
        return "tolfacupx"
    if D[-1] > 1e7 * D[0]:
        return "tolconditioncov"
    if g > 1 and history[-1, 2] <= history[-1, 0] and history[-2, 2] <= history[-2, 0]:
        return "tolflatfitness"
    part = int(max(int(100 + 100 * n**1.5 / size) / 10, g // 5 / 10))
    if g // 5 > max(100, 2 * part):
        fifth = history[4::5][::-1]
        new, old = fifth[:part], fifth[part : 2 * part]
        if np.median(new[:, 0]) >= np.median(old[:, 0]) and np.median(new[:, 1]) >= np.median(old[:, 1]):
            return "tolstagnation"
    if (m == m + 0.2 * std).any():
        return "noeffectcoord"
    if (m == m + 0.1 * sigma * D[g % n] * unit * B[:, g % n]).all():
        return "noeffectaxis"
    return ""
