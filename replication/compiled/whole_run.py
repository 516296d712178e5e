"""Whole runs of the search in compiled code: the fast twin of `search.search`, equal to it to the last bit.

Each sum is taken in the order of `search`. Samples are columns here, so that loops over the members are vectorised.
"""

from typing import NamedTuple

import numba
import numpy as np

from replication.arrays import FloatArray
from replication.compiled.bounds import bend_into, from_box, margins_of
from replication.compiled.eigen import symmetric_eigen
from replication.compiled.misfit import FoldedRecord, folded_rmse
from replication.search import HISTORY, Search, check_settings, constants
from replication.signature import Box


class State(NamedTuple):
    """The distribution of the next samples, and the paths, as `search.State`."""

    m: FloatArray
    sigma: float
    C: FloatArray
    p_sigma: FloatArray
    p_c: FloatArray


class Axes(NamedTuple):
    """Axes of C and their lengths, and the unit of the parameters."""

    B: FloatArray
    D: FloatArray
    unit: FloatArray


class Settings(NamedTuple):
    """What stays the same in a run."""

    start: FloatArray
    unit: FloatArray
    seed: int
    iterations: int
    total_weight: float


def whole_run(record: FoldedRecord, box: Box, seed: int, population: int, iterations: int) -> Search:
    """Search a folded record as `search.search` does from the middle of the box with `random_normals(seed)`."""
    check_settings(box, population, iterations, seed)
    c = constants(population, box.lower.size)
    start = from_box((box.lower + box.upper) / 2, box)
    unit = (box.upper - box.lower) / 4
    bounds = (box.lower, box.upper, *margins_of(box))
    settings = Settings(start, unit, seed, iterations, c.weights.sum())
    best, misfit, stop, history = _run(record, bounds, settings, c, np.empty((iterations, len(HISTORY))))
    return Search(best, misfit, population * len(history), stop, history)


@numba.njit(cache=True)
def _run(record, bounds, settings, c, history):
    """Compiled body of `whole_run`, in the names of `search`; fills the history."""
    size, n = c.weights.size, settings.start.size
    np.random.seed(settings.seed)  # noqa: NPY002  Numba's own generator: the same numbers as `random_normals`
    C = np.diag(np.exp(1e-4 * np.arange(n) / n))
    state = State(settings.start, 1.0, C, np.zeros(n), np.zeros(n))
    best, misfit = settings.start, np.inf
    stop = ""
    g = 0
    while stop == "":
        g += 1
        C = (state.C + state.C.T) / 2
        squares, B = symmetric_eigen(C)
        axes = Axes(B, np.sqrt(np.maximum(squares, 1e-15 * squares[-1])), settings.unit)
        # Equation 12.
        z = np.random.standard_normal((size, n)).T  # noqa: NPY002
        x = _column(state.m) + state.sigma * (_column(axes.unit) * _turn(B, _column(axes.D) * z))
        members = bend_into(x.T, *bounds)
        misfits = folded_rmse(members, record)
        ranking = np.argsort(misfits, kind="mergesort")
        before = State(state.m, state.sigma, C, state.p_sigma, state.p_c)
        state = _update(g, before, x[:, ranking], axes, c, settings.total_weight)
        ranked = misfits[ranking]
        std = state.sigma * (axes.unit * np.sqrt(np.diag(state.C)))
        history[g - 1, 0] = ranked[0]
        history[g - 1, 1] = (ranked[(size - 1) // 2] + ranked[size // 2]) / 2
        history[g - 1, 2] = ranked[int(0.75 * size)]
        history[g - 1, 3] = state.sigma
        history[g - 1, 4] = axes.D[-1] / axes.D[0]
        history[g - 1, 5] = std.min()
        history[g - 1, 6] = std.max()
        if ranked[0] < misfit:
            best, misfit = members[ranking[0]].copy(), ranked[0]
        stop = _stop_rule(history[:g], ranked[-1], state, axes, std, size)
        stop = "maxiter" if g == settings.iterations else stop
    return best, misfit, stop, history[:g].copy()


@numba.njit(cache=True)
def _update(g, state, ranked, axes, c, total_weight):
    """Twin of `search.update`, for samples in columns, the best first."""
    n, size = ranked.shape
    B, D, unit = axes
    # Equation 13.
    step = (c.weights[: c.mu] * (ranked[:, : c.mu] - _column(state.m))).sum(axis=1)
    shift = step / unit / state.sigma
    # Equation 14.
    white = (B * ((B.T * shift).sum(axis=1) / D)).sum(axis=1)
    p_sigma = (1 - c.c_sigma) * state.p_sigma + np.sqrt(c.c_sigma * (2 - c.c_sigma) * c.mu_eff) * white
    # Equation 15.
    squared = (p_sigma**2).sum()
    growth = c.c_sigma / c.d_sigma * (np.sqrt(squared) / c.chi_n - 1)
    sigma = state.sigma * np.exp(min(1.0, growth))
    # Equation 16.
    fresh = 1 - (1 - c.c_sigma) ** (2 * g)
    h_sigma = 1.0 if squared / fresh / n < 2 + 4 / (n + 1) else 0.0
    p_c = (1 - c.c_c) * state.p_c + h_sigma * np.sqrt(c.c_c * (2 - c.c_c) * c.mu_eff) * shift
    # Equation 17.
    y = (ranked - _column(state.m)) / state.sigma / _column(unit)
    length = ((_turn(B.T, y[:, c.mu :]) / _column(D)) ** 2).sum(axis=0)
    w = c.weights.copy()
    w[c.mu :] = w[c.mu :] * n / (np.sqrt(length) + 1e-9) ** 2
    learnt = np.zeros((n, n))
    for k in range(size):
        for i in range(n):
            for j in range(n):
                learnt[i, j] += w[k] * y[i, k] * y[j, k]
    lost = c.c_1 * (1 - h_sigma) * c.c_c * (2 - c.c_c)
    kept = 1 - c.c_1 + lost - c.c_mu * total_weight
    C = kept * state.C + c.c_1 * _column(p_c) * p_c + c.c_mu * learnt
    return State(state.m + step, sigma, C, p_sigma, p_c)


@numba.njit(cache=True)
def _column(x):
    return x.reshape(-1, 1)


@numba.njit(cache=True)
def _turn(axes, columns):
    """Product of a small matrix and columns, summed in order: without BLAS."""
    turned = np.zeros(columns.shape)
    for i in range(axes.shape[0]):
        for j in range(axes.shape[1]):
            turned[i] += axes[i, j] * columns[j]
    return turned


@numba.njit(cache=True)
def _stop_rule(history, worst, state, axes, std, size):
    """Twin of `search.stop_rule`; the most generations are the caller's."""
    m, sigma, unit = state.m, state.sigma, axes.unit
    n, g = m.size, history.shape[0]
    recent = history[max(0, g - 10 - 30 * n // size) :, 0]
    spread = recent.max() - recent.min()
    if worst - recent[-1] < 1e-11 and spread < 1e-11:
        return "tolfun"
    if recent.size > 9 and spread < 1e-12:
        return "tolfunhist"
    if (std < 1e-11).all() and (sigma * unit * state.p_c < 1e-11).all():
        return "tolx"
    if (std > 1000 * unit).any():
        return "tolfacupx"
    if axes.D[-1] > 1e7 * axes.D[0]:
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
    k = g % n  # the axis that this generation tries
    if (m == m + 0.1 * sigma * axes.D[k] * unit * axes.B[:, k]).all():
        return "noeffectaxis"
    return ""
