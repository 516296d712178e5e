"""A record folded on the signature's windows: the paper's misfit, A and v_t projected out, by the few folded samples.

Given the rest, A and v_t are linear. The window's start and end matter only by the samples they
take in, so they are indices. What is left is theta = (t0, tau, omega). Loops instead of array
expressions compile four times as fast.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from replication.arrays import FloatArray
from replication.compiling import njit
from replication.signature import Timing

# Distance kept from a sample at which a window would open or close: far above rounding, far below
# any effect.
CLEARANCE_S = 1e-12


# What a folded record holds at a position. Fewer arrays compile faster.
_POSITION = np.dtype(
    [
        ("value", float),  # sum over the windows of sign times (v - mean v) [rps]
        ("samples", float),  # how many samples there
        ("sign", float),  # sum of their signs
        (
            "pairs",
            float,
        ),  # samples there that the preceding window holds too, if it reaches as far as `partner`
        ("partner", np.int64),  # position T_d later, -1 if there is none
        ("inverse", np.int64),  # position T_d earlier, or -1
    ]
)


class FoldedWindows(NamedTuple):
    """A record folded on the signature's windows, arrays of shape (positions,), whatever the turn is in samples.

    Position x[i] after the first window's origin meets a sample in one or more of the 2 n windows.
    """

    x: FloatArray  # instants [s] at which a first window's edge passes a sample of any window
    at: NDArray[np.void]  # records of `_POSITION`
    classes: int  # positions per sample interval
    power: float  # sum of squares of v - mean v [rps^2]
    total: float  # number of samples


class Limits(NamedTuple):
    """The box in the form the search needs: |A|, first t0, longest T1 and T2 [s], tau and omega from and to."""

    A: float
    t0: float
    T1: float
    T2: float
    tau: tuple[float, float]
    omega: tuple[float, float]


def fold_record(
    t: FloatArray, v: FloatArray, timing: Timing, whole_samples: bool = False
) -> FoldedWindows:
    """Fold an evenly sampled record on windows half a turn apart.

    With `whole_samples` each window's delay is rounded to whole samples: one position a sample, for
    a grid search.
    """
    if abs(timing.T_d - timing.T_f / 2) > 1e-9 * timing.T_f:
        raise ValueError(
            f"T_d = {timing.T_d} s is not half of T_f = {timing.T_f} s: the turns do not fold"
        )
    dt = (t[-1] - t[0]) / (t.size - 1)
    delays = timing.T_d / dt * np.arange(2 * timing.n)
    if whole_samples:
        delays = np.round(delays)
    fractions = np.round(-delays % 1.0, 9) % 1.0
    phases, group = np.unique(fractions, return_inverse=True)
    first = np.round(delays + phases[group]).astype(np.int64)
    x = t[0] + (np.arange(t.size)[:, None] + phases).ravel() * dt
    partner = np.searchsorted(x, x + timing.T_d - 1e-6 * dt)
    partner[partner == x.size] = -1
    partner[np.abs(x[partner] - x - timing.T_d) > 1e-6 * dt] = -1
    at = np.zeros(x.size, _POSITION)
    at["partner"] = partner
    at["inverse"] = -1
    at["inverse"][partner[partner >= 0]] = np.flatnonzero(partner >= 0)
    centred = v - v.mean()
    for m in range(first.size):
        direction = 1.0 - 2.0 * (m % 2)
        part = centred[first[m] :]
        there = at[group[m] :: phases.size][: part.size]
        there["value"] += direction * part
        there["samples"] += 1.0
        there["sign"] += direction
        there["pairs"] += float(m > 0)
    power = float((centred * centred).sum())
    return FoldedWindows(x, at, phases.size, power, float(t.size))


@njit
def t0_range(x, limits, a, b):
    """Lowest and highest t0 that let a window hold exactly the positions a to b."""
    before = x[a - 1] if a > 0 else x[0]
    low = max(limits.t0, max(before - limits.T1 + CLEARANCE_S, x[b] - limits.T2 + CLEARANCE_S))
    return low, max(x[a] - CLEARANCE_S, limits.t0)


@njit
def latest_t0(x, limits, a, b, t0, omega):
    """The latest admissible t0 a whole number of half oscillations from the one given, or NaN."""
    low, high = t0_range(x, limits, a, b)
    half = np.pi / omega
    latest = t0 + np.floor((high - t0) / half) * half
    return latest if low <= latest <= high else np.nan


@njit
def theta_bounds(fold, limits, a, b):
    """Lowest and highest theta = (t0, tau, omega) of a window."""
    bounds = np.array((t0_range(fold.x, limits, a, b), limits.tau, limits.omega))
    return bounds[:, 0], bounds[:, 1]


@njit
def normal_equations(fold, a, b, theta):
    """Gram matrix of the unit signature and its derivatives by theta, v_t projected out, and their products with v."""
    t0, tau, omega = theta
    size = b - a + 1
    columns = np.empty((4, size))
    for j in range(size):
        since_edge = fold.x[a + j] - fold.x[a]
        since_t0 = fold.x[a + j] - t0
        decay = np.exp(-tau * since_edge)
        s = decay * np.sin(omega * since_t0)
        c = decay * np.cos(omega * since_t0)
        columns[0, j] = s
        columns[1, j] = -omega * c
        columns[2, j] = -since_edge * s
        columns[3, j] = since_t0 * c
    gram = np.zeros((4, 4))
    data = np.zeros(4)
    offset = np.zeros(4)
    for j in range(size):
        k = fold.at[a + j].partner - a
        overlaps = 0 <= k < size  # the window before reaches this sample, with the opposite sign
        for p in range(4):
            data[p] += columns[p, j] * fold.at[a + j].value
            offset[p] += columns[p, j] * fold.at[a + j].sign
            for q in range(p + 1):
                gram[p, q] += columns[p, j] * columns[q, j] * fold.at[a + j].samples
                if overlaps:
                    gram[p, q] -= fold.at[a + j].pairs * (
                        columns[p, j] * columns[q, k] + columns[p, k] * columns[q, j]
                    )
    for p in range(4):
        for q in range(p + 1):
            gram[p, q] -= offset[p] * offset[q] / fold.total
            gram[q, p] = gram[p, q]
    return gram, data


@njit
def best_misfit(gram, data, power, limit):
    """Sum of squares at the best A up to `limit`, and that A (at the window's first position)."""
    A = min(max(data / gram, -limit), limit) if gram > 0 else 0.0
    return power - 2 * A * data + A * A * gram, A


@njit
def factorise(matrix):
    """Factors L and D of a symmetric matrix L D L', in place: D on the diagonal, L below it.

    A pivot that rounding cannot tell from zero is set to zero, and its column of L too. Written out
    here, because the last bits of a library's solver change from processor to processor.
    """
    size = matrix.shape[0]
    least = np.empty(size)
    for k in range(size):
        least[k] = 1e-14 * matrix[k, k]
    for k in range(size):
        is_singular = not matrix[k, k] > least[k]
        for i in range(k, size):
            if is_singular:
                matrix[i, k] = 0.0
            elif i > k:
                matrix[i, k] /= matrix[k, k]
        for i in range(k + 1, size):
            for j in range(k + 1, size):
                matrix[i, j] -= matrix[i, k] * matrix[j, k] * matrix[k, k]


@njit
def solve_or_zero(matrix, side):
    """Solve a symmetric positive definite system in place; zeros if it is singular, as very few samples make it."""
    factorise(matrix)
    size = side.size
    is_singular = False
    for i in range(size):
        is_singular = is_singular or matrix[i, i] == 0.0
        for j in range(i + 1, size):
            side[j] -= matrix[j, i] * side[i]
    for i in range(size - 1, -1, -1):
        side[i] = 0.0 if is_singular else side[i] / matrix[i, i]
        for j in range(i + 1, size):
            side[i] -= matrix[j, i] * side[j]


@njit(inner=True)
def _step(gram, data, A, is_free, damping, theta, low, high):
    """Levenberg-Marquardt step from theta, within its bounds; A is projected out if it is free."""
    slope = np.empty(3)
    hessian = np.empty((3, 3))
    for i in range(3):
        slope[i] = A * (A * gram[i + 1, 0] - data[i + 1])
        for j in range(3):
            hessian[i, j] = gram[i + 1, j + 1]
            if is_free:
                hessian[i, j] -= gram[0, i + 1] * gram[0, j + 1] / gram[0, 0]
            hessian[i, j] *= A * A
    for i in range(3):
        hessian[i, i] = hessian[i, i] * (1 + damping) + 1e-300
        if (theta[i] <= low[i] and slope[i] >= 0) or (
            theta[i] >= high[i] and slope[i] <= 0
        ):  # held at its bound
            slope[i] = 0.0
            for j in range(3):
                hessian[i, j] = hessian[j, i] = 0.0
            hessian[i, i] = 1.0
    solve_or_zero(hessian, slope)
    trial = np.empty(3)
    for i in range(3):
        trial[i] = theta[i] - slope[i]
    _bound(trial, low, high)
    return trial


@njit(inner=True)
def _bound(theta, low, high):
    """Move theta into its bounds, in place."""
    for i in range(3):
        theta[i] = min(max(theta[i], low[i]), high[i])


@njit
def descend(fold, limits, a, b, start, steps):
    """Levenberg-Marquardt in theta = (t0, tau, omega), the window held; refined theta and its sum of squares."""
    low, high = theta_bounds(fold, limits, a, b)
    theta = start.copy()
    _bound(theta, low, high)
    gram, data = normal_equations(fold, a, b, theta)
    cost, A = best_misfit(gram[0, 0], data[0], fold.power, limits.A)
    damping = 1e-3
    for _ in range(steps):
        is_free = abs(A) < limits.A and gram[0, 0] > 0
        trial = _step(gram, data, A, is_free, damping, theta, low, high)
        trial_gram, trial_data = normal_equations(fold, a, b, trial)
        trial_cost, trial_A = best_misfit(trial_gram[0, 0], trial_data[0], fold.power, limits.A)
        if trial_cost < cost:
            is_settled = cost - trial_cost < 1e-13 * cost
            for k in range(3):
                theta[k] = trial[k]
            gram, data = trial_gram, trial_data
            cost, A = trial_cost, trial_A
            damping = max(damping / 10, 1e-9)
            if is_settled:
                break
        else:
            damping *= 10
            if damping > 1e6:
                break
    return theta, cost


def middle_of_gap(fold: FoldedWindows, a: int) -> float:
    """Midway between the last instant at which a window's start would take in one more sample, and position a."""
    return (fold.x[a] + fold.x[a - 1]) / 2 if a > 0 else fold.x[0] - (fold.x[1] - fold.x[0]) / 2
