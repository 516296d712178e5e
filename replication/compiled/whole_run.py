"""Whole runs of the search in compiled code: the fast twin of `search.search` for the pools of many runs.

At populations of some hundred, more than half the time of a run is Python's, once the record is folded. Sums are
rounded in another order than in `search`, so runs part late, at ties; in which basin a run ends is decided before.
"""

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from replication.compiled.bounds import Margin, _into_box, _margins, from_box, margin_2021
from replication.compiled.eigen import diagonalise, tridiagonal
from replication.compiled.folded import Fold, _misfits
from replication.search import constants
from replication.signature import Box

FloatArray = NDArray[np.float64]


class Run(NamedTuple):
    """A finished run: its best member, the misfit of that, and the best misfit of each generation."""

    best: FloatArray
    misfit: float
    history: FloatArray


def whole_run(fold: Fold, box: Box, seed: int, population: int, iterations: int, margin: Margin = margin_2021) -> Run:
    """Search a folded record from the middle of the box, as `search.search` does with `random_normals(seed)`.

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
    Run

    Raises
    ------
    ValueError
        The seed is not above 0, or the population is below 4.
    """
    if seed <= 0 or population < 4:
        raise ValueError(f"seed {seed}, population {population}: a seed above 0 and at least 4 members are needed")
    c = constants(population, box.lower.size)
    rates = (c.mu_eff, c.chi_n, c.c_sigma, c.d_sigma, c.c_c, c.c_1, c.c_mu)
    start = from_box((box.lower + box.upper) / 2, box, margin)
    bounds = (box.lower, box.upper, *_margins(box, margin))
    unit = (box.upper - box.lower) / 4
    return Run(*_run(tuple(fold), bounds, start, unit, c.weights, c.mu, rates, seed, iterations))


@numba.njit(cache=True)
def _run(fold, bounds, start, unit, weights, mu, rates, seed, iterations):
    """Compiled body of `whole_run`: equations 12 to 17, in the names of `search`."""
    mu_eff, chi_n, c_sigma, d_sigma, c_c, c_1, c_mu = rates
    size, n = weights.size, start.size
    # Numba's own generator: the same numbers as `random_normals`.
    np.random.seed(seed)  # noqa: NPY002
    m, sigma, g = start.copy(), 1.0, 0
    C = np.diag(np.exp(1e-4 * np.arange(n) / n))
    p_sigma, p_c = np.zeros(n), np.zeros(n)
    z, x, y = np.empty((size, n)), np.empty((size, n)), np.empty(n)
    history = np.empty((iterations, 3))
    best, misfit, total = m, np.inf, weights.sum()
    while True:
        D, beside, B = tridiagonal((C + C.T) / 2)
        diagonalise(D, beside, B)
        D = np.sqrt(np.maximum(D, 1e-15 * D[-1]))
        # Equation 12.
        for k in range(size):
            for j in range(n):
                z[k, j] = np.random.standard_normal()  # noqa: NPY002
            for i in range(n):
                along = 0.0
                for j in range(n):
                    along += B[i, j] * (D[j] * z[k, j])
                x[k, i] = m[i] + sigma * (unit[i] * along)
        members = _into_box(x, *bounds)
        misfits = _misfits(members, *fold)
        ranking = np.argsort(misfits, kind="mergesort")
        ranked = misfits[ranking]
        g += 1
        # Equation 13.
        shift = np.zeros(n)
        for k in range(mu):
            for i in range(n):
                shift[i] += weights[k] * (x[ranking[k], i] - m[i])
        previous = m.copy()
        m = m + shift
        shift = shift / unit / sigma
        # Equation 14.
        white = np.zeros(n)
        for j in range(n):
            along = 0.0
            for i in range(n):
                along += B[i, j] * shift[i]
            for i in range(n):
                white[i] += B[i, j] * (along / D[j])
        p_sigma = (1 - c_sigma) * p_sigma + (c_sigma * (2 - c_sigma) * mu_eff) ** 0.5 * white
        # Equation 15.
        squared = (p_sigma**2).sum()
        old = sigma
        sigma *= np.exp(min(1.0, c_sigma / d_sigma * (squared**0.5 / chi_n - 1)))
        # Equation 16.
        h_sigma = 1.0 if squared / (1 - (1 - c_sigma) ** (2 * g)) / n < 2 + 4 / (n + 1) else 0.0
        p_c = (1 - c_c) * p_c + h_sigma * (c_c * (2 - c_c) * mu_eff) ** 0.5 * shift
        # Equation 17.
        lost = c_1 * (1 - h_sigma) * c_c * (2 - c_c)
        C *= 1 - c_1 + lost - c_mu * total
        for i in range(n):
            for j in range(n):
                C[i, j] += c_1 * p_c[i] * p_c[j]
        for k in range(size):
            w = weights[k]
            for i in range(n):
                y[i] = (x[ranking[k], i] - previous[i]) / (old * unit[i])
            if w < 0:
                length = 0.0
                for j in range(n):
                    length += z[ranking[k], j] ** 2
                w *= n / (np.sqrt(length) + 1e-9) ** 2
            for i in range(n):
                for j in range(n):
                    C[i, j] += c_mu * w * y[i] * y[j]
        half = size // 2
        median = ranked[half] if size % 2 else (ranked[half - 1] + ranked[half]) / 2
        history[g - 1] = ranked[0], median, ranked[int(0.75 * size)]
        if ranked[0] < misfit:
            best, misfit = members[ranking[0]].copy(), ranked[0]
        if g == iterations or _stops(history[:g], ranked[-1], m, sigma, unit, C, p_c, D, B, g, size):
            return best, misfit, history[:g, 0].copy()


@numba.njit(cache=True)
def _stops(history, worst, m, sigma, unit, C, p_c, D, B, g, size):
    """Whether one of the rules of `search.stop_rule` holds; the most generations are the caller's."""
    n = m.size
    std = sigma * (unit * np.sqrt(np.diag(C)))
    recent = history[max(0, g - 10 - 30 * n // size) :, 0]
    spread = recent.max() - recent.min()
    if (worst - recent[-1] < 1e-11 and spread < 1e-11) or (recent.size > 9 and spread < 1e-12):
        return True
    if (std < 1e-11).all() and (sigma * unit * p_c < 1e-11).all():
        return True
    if (std > 1000 * unit).any() or D[-1] > 1e7 * D[0]:
        return True
    if g > 1 and history[-1, 2] <= history[-1, 0] and history[-2, 2] <= history[-2, 0]:
        return True
    fifths = g // 5
    part = int(max(int(100 + 100 * n**1.5 / size) / 10, fifths / 10))
    if fifths > max(100, 2 * part):
        fifth = history[4::5][::-1]
        if np.median(fifth[:part, 0]) >= np.median(fifth[part : 2 * part, 0]) and np.median(
            fifth[:part, 1]
        ) >= np.median(fifth[part : 2 * part, 1]):
            return True
    axis = 0.1 * sigma * D[g % n] * unit * B[:, g % n]
    return bool((m == m + 0.2 * std).any() or (m == m + axis).all())
