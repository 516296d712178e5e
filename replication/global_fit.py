"""Deterministic global fit of the signature: the paper's cost function, in the paper's box, without chance.

Given the rest, A and v_t are linear, so they are projected out. The window's start and end matter only by the
samples they take in, so they are indices. What is left, t0, tau and omega, is searched on a grid and refined.
"""

from dataclasses import dataclass
from math import erf, sqrt
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from replication.datasets import Recording
from replication.identify import Protocol, protocol_box
from replication.signature import FREE_PARAMETERS, Timing, population_rmse, signature

FloatArray = NDArray[np.float64]

# Distance kept from a sample at which a window would open or close: far above rounding, far below any effect.
CLEARANCE_S = 1e-12


class Fold(NamedTuple):
    """A record folded on the signature's windows.

    Position x[i] after the first window's origin meets a sample in one or more of the 2 n windows; a window that
    holds positions a to b is the sum over them, whatever the turn period is in samples.

    Attributes
    ----------
    x : array of shape (positions,)
        Instants [s] at which a first window's edge passes a sample of any window.
    value : array of shape (positions,)
        Sum over the windows of sign times (v - mean v) [rps].
    count, sign : arrays of shape (positions,)
        Samples there, and the sum of their signs.
    pairs : array of shape (positions,)
        Samples there that the preceding window holds too, if it reaches as far as `partner`.
    partner, inverse : integer arrays of shape (positions,)
        Position T_d later, and T_d earlier (-1 if there is none).
    classes : int
        Positions per sample interval.
    scale : tuple of float
        Sum of squares of v - mean v [rps^2], and the number of samples.
    """

    x: FloatArray
    value: FloatArray
    count: FloatArray
    sign: FloatArray
    pairs: FloatArray
    partner: NDArray[np.int64]
    inverse: NDArray[np.int64]
    classes: int
    scale: tuple[float, float]


class Limits(NamedTuple):
    """The box in the form the search needs: |A|, first t0, longest T1 and T2 [s], tau and omega from and to."""

    A: float
    t0: float
    T1: float
    T2: float
    tau: tuple[float, float]
    omega: tuple[float, float]


@dataclass(frozen=True)
class GlobalFit:
    """The best signature of a record.

    The same signal has many parameter vectors. Of these, X has the window's start midway between the last sample
    outside and the first inside it (as far as the box lets it), and the latest t0 before that start; the amplitude is
    |A|, because (A, t0) and (-A, t0 + pi/omega) are the same signal.

    Attributes
    ----------
    X : array of shape (7,)
        Parameters in `signature.FREE_PARAMETERS` order.
    rmse : float
        Misfit, the paper's cost [rps].
    turn_period_s : float
        T_f, given or found [s].
    amplitude_rps : float
        |A| [rps].
    amplitude_interval_rps : tuple of float
        95 % confidence interval of |A|, window start unknown [rps].
    at_bound : tuple of str
        Names of the parameters at a bound of the box.
    sign_flipped : bool
        A is negative in X, so that `amplitude_rps` is -A.
    rival_rps : tuple of float
        |A| of other basins whose misfit is within 1 % and whose |A| lies outside the interval [rps].
    """

    X: FloatArray
    rmse: float
    turn_period_s: float
    amplitude_rps: float
    amplitude_interval_rps: tuple[float, float]
    at_bound: tuple[str, ...]
    sign_flipped: bool
    rival_rps: tuple[float, ...]


def fold_record(t: FloatArray, v: FloatArray, timing: Timing, whole_samples: bool = False) -> Fold:
    """Fold a record on the windows of a signature whose two oscillations lie half a turn apart.

    Parameters
    ----------
    t, v : array of shape (samples,)
        Time [s], evenly sampled, and motor speed [rps].
    timing : Timing
        T_d, T_f and the number of turns.
    whole_samples : bool
        Round each window's delay to whole samples, for one position a sample: what a grid search can do with.

    Returns
    -------
    Fold

    Raises
    ------
    ValueError
        T_d is not half of T_f.
    """
    if abs(timing.T_d - timing.T_f / 2) > 1e-9 * timing.T_f:
        raise ValueError(f"T_d = {timing.T_d} s is not half of T_f = {timing.T_f} s: the turns do not fold")
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
    inverse = np.full(x.size, -1)
    inverse[partner[partner >= 0]] = np.flatnonzero(partner >= 0)
    centred = v - v.mean()
    columns = _fold(centred, first, group, phases.size)
    return Fold(x, *columns, partner, inverse, phases.size, (float(centred @ centred), float(t.size)))


@numba.njit(cache=True)
def _fold(v, first, group, classes):
    """Sums over the windows, at each position; compiled body of `fold_record`."""
    value = np.zeros(v.size * classes)
    count, sign, pairs = np.zeros_like(value), np.zeros_like(value), np.zeros_like(value)
    for m in range(first.size):
        direction = 1.0 - 2.0 * (m % 2)
        for sample in range(first[m], v.size):
            i = (sample - first[m]) * classes + group[m]
            value[i] += direction * v[sample]
            count[i] += 1.0
            sign[i] += direction
            pairs[i] += 1.0 if m > 0 else 0.0
    return value, count, sign, pairs


@numba.njit(cache=True)
def _t0_range(fold, limits, a, b):
    """Lowest and highest t0 that let a window hold exactly the positions a to b."""
    before = fold.x[a - 1] if a > 0 else fold.x[0]
    low = max(limits.t0, before - limits.T1 + CLEARANCE_S, fold.x[b] - limits.T2 + CLEARANCE_S)
    return low, max(fold.x[a] - CLEARANCE_S, limits.t0)


@numba.njit(cache=True)
def _latest_t0(fold, limits, a, b, t0, omega):
    """The latest admissible t0 a whole number of half oscillations from the one given, or NaN."""
    low, high = _t0_range(fold, limits, a, b)
    half = np.pi / omega
    latest = t0 + np.floor((high - t0) / half) * half
    return latest if low <= latest <= high else np.nan


@numba.njit(cache=True)
def _normal_equations(fold, a, b, t0, tau, omega):
    """Gram matrix of (unit signature, its derivatives by t0, tau, omega), v_t projected out, and their products with v."""
    size = b - a + 1
    columns = np.empty((4, size))
    for j in range(size):
        since_edge, since_t0 = fold.x[a + j] - fold.x[a], fold.x[a + j] - t0
        decay = np.exp(-tau * since_edge)
        s, c = decay * np.sin(omega * since_t0), decay * np.cos(omega * since_t0)
        columns[0, j], columns[1, j] = s, -omega * c
        columns[2, j], columns[3, j] = -since_edge * s, since_t0 * c
    gram, data, offset = np.zeros((4, 4)), np.zeros(4), np.zeros(4)
    for p in range(4):
        for j in range(size):
            data[p] += columns[p, j] * fold.value[a + j]
            offset[p] += columns[p, j] * fold.sign[a + j]
        for q in range(p + 1):
            for j in range(size):
                gram[p, q] += columns[p, j] * columns[q, j] * fold.count[a + j]
                k = fold.partner[a + j] - a
                if 0 <= k < size:  # the window before reaches this sample, with the opposite sign
                    overlap = columns[p, j] * columns[q, k] + columns[p, k] * columns[q, j]
                    gram[p, q] -= fold.pairs[a + j] * overlap
            gram[p, q] -= offset[p] * offset[q] / fold.scale[1]
            gram[q, p] = gram[p, q]
    return gram, data


@numba.njit(cache=True)
def _misfit(gram, data, fold, limits):
    """Sum of squares at the best A within its bounds, and that A (at the window's first position)."""
    A = data[0] / gram[0, 0] if gram[0, 0] > 0 else 0.0
    A = min(max(A, -limits.A), limits.A)
    return fold.scale[0] - 2 * A * data[0] + A * A * gram[0, 0], A


@numba.njit(cache=True)
def _curvature(gram, A, limits):
    """Half the Hessian of the sum of squares in (t0, tau, omega), A projected out unless it is at its bound."""
    hessian = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            hessian[i, j] = gram[1 + i, 1 + j]
            if abs(A) < limits.A:
                hessian[i, j] -= gram[0, 1 + i] * gram[0, 1 + j] / gram[0, 0]
    return A * A * hessian


@numba.njit(cache=True)
def _descend(fold, limits, a, b, theta, steps, hold_t0=False):
    """Levenberg-Marquardt in theta = (t0, tau, omega) with the window held at positions a to b.

    Returns the refined theta and its sum of squares.
    """
    low, high = np.empty(3), np.empty(3)
    low[0], high[0] = (theta[0], theta[0]) if hold_t0 else _t0_range(fold, limits, a, b)
    low[1], high[1] = limits.tau
    low[2], high[2] = limits.omega
    theta = np.minimum(np.maximum(theta, low), high)
    gram, data = _normal_equations(fold, a, b, theta[0], theta[1], theta[2])
    cost, A = _misfit(gram, data, fold, limits)
    damping = 1e-3
    for _ in range(steps):
        slope = A * (A * gram[1:, 0] - data[1:])
        hessian = _curvature(gram, A, limits)
        for i in range(3):
            held = (theta[i] <= low[i] and slope[i] >= 0) or (theta[i] >= high[i] and slope[i] <= 0)
            hessian[i, i] = hessian[i, i] * (1 + damping) + 1e-300
            if held:
                hessian[i, :], hessian[:, i], slope[i] = 0.0, 0.0, 0.0
                hessian[i, i] = 1.0
        trial = np.minimum(np.maximum(theta - np.linalg.solve(hessian, slope), low), high)
        trial_gram, trial_data = _normal_equations(fold, a, b, trial[0], trial[1], trial[2])
        trial_cost, trial_A = _misfit(trial_gram, trial_data, fold, limits)
        if trial_cost < cost:
            settled = cost - trial_cost < 1e-13 * cost
            theta, cost, A, gram, data = trial, trial_cost, trial_A, trial_gram, trial_data
            damping = max(damping / 10, 1e-9)
            if settled:
                break
        else:
            damping *= 10
            if damping > 1e6:
                break
    return theta, cost


@numba.njit(cache=True)
def _scan_edge(fold, limits, a, b, theta, move_start):
    """The best place for one edge of the window, the rest held; returns a, b and the sum of squares."""
    t0, tau, omega = theta
    anchor = fold.x[a]
    hold, direction = (b, -1) if move_start else (a, 1)
    best_cost, best_edge = np.inf, (a if move_start else b)
    data = gram = offset = 0.0
    unit = np.empty(fold.x.size)
    i = hold
    while 0 <= i < fold.x.size and abs(fold.x[i] - fold.x[hold]) <= limits.T2:
        unit[i] = np.exp(-tau * (fold.x[i] - anchor)) * np.sin(omega * (fold.x[i] - t0))
        data += unit[i] * fold.value[i]
        gram += unit[i] * unit[i] * fold.count[i]
        offset += unit[i] * fold.sign[i]
        k = fold.partner[i] if move_start else fold.inverse[i]
        if k >= 0 and (k - hold) * direction >= 0 and (i - k) * direction > 0:
            gram -= 2 * fold.pairs[min(i, k)] * unit[i] * unit[k]
        first, last = (i, hold) if move_start else (hold, i)
        if not np.isnan(_latest_t0(fold, limits, first, last, t0, omega)):
            net = gram - offset * offset / fold.scale[1]
            limit = limits.A * np.exp(tau * (fold.x[first] - anchor))  # of A as seen from the anchor
            A = min(max(data / net, -limit), limit) if net > 0 else 0.0
            cost = fold.scale[0] - 2 * A * data + A * A * net
            if cost < best_cost:
                best_cost, best_edge = cost, i
        i += direction
    return (best_edge, b, best_cost) if move_start else (a, best_edge, best_cost)


@numba.njit(cache=True)
def _refine(fold, limits, a, b, theta, steps, rounds):
    """Alternate between descent and scans of both edges until nothing moves; returns a, b, theta, sum of squares."""
    theta, cost = _descend(fold, limits, a, b, theta, steps)
    for _ in range(rounds):
        moved = False
        for move_start in (False, True):
            new_a, new_b, new_cost = _scan_edge(fold, limits, a, b, theta, move_start)
            if new_cost < cost and (new_a != a or new_b != b):
                theta[0] = _latest_t0(fold, limits, new_a, new_b, theta[0], theta[2])
                a, b, cost, moved = new_a, new_b, new_cost, True
        if not moved:
            break
        theta, cost = _descend(fold, limits, a, b, theta, steps)
    return a, b, theta, cost


@numba.njit(cache=True)
def _try_window(fold, limits, best, a, b):
    """Descend in the window from a to b; returns the better of that and `best` = (a, b, theta, sum of squares)."""
    if a < 0 or b >= fold.x.size or b < a:
        return best
    low, high = _t0_range(fold, limits, a, b)
    if low > high:
        return best
    theta = best[2].copy()
    shifted = _latest_t0(fold, limits, a, b, theta[0], theta[2])
    theta[0] = theta[0] if np.isnan(shifted) else shifted
    theta, cost = _descend(fold, limits, a, b, theta, 6)
    return (a, b, theta, cost) if cost < best[3] * (1 - 1e-12) else best


@numba.njit(cache=True)
def _polish(fold, limits, best, sweep):
    """Try every end, every start within `sweep` samples, and all nearest pairs, each with a descent of its own.

    Takes and returns (a, b, theta, sum of squares); goes on until nothing is better.
    """
    before = np.inf
    while best[3] < before:
        before = best[3]
        for b in range(best[0] + 1, fold.x.size, fold.classes):
            if fold.x[b] - fold.x[best[0]] > limits.T2:
                break
            best = _try_window(fold, limits, best, best[0], b)
        for a in range(best[0] - sweep * fold.classes, best[0] + sweep * fold.classes + 1, fold.classes):
            best = _try_window(fold, limits, best, a, best[1])
        a, b = best[0], best[1]
        for near_a in range(a - 2, a + 3):
            for near_b in range(b - 2, b + 3):
                best = _try_window(fold, limits, best, near_a, near_b)
    return _refine(fold, limits, best[0], best[1], best[2], 30, 5)


@numba.njit(cache=True)
def _grid_search(fold, limits, dt, taus, omegas):
    """Best signature on a grid of tau and omega for each window start, phase and A free.

    Starts that cannot be better than the best found so far are left out: a window explains no more than its samples
    hold. Returns per start (one a sample): sum of squares, last position, t0, tau, omega.
    """
    step = fold.classes
    starts = fold.x.size // step
    longest = int(limits.T2 / dt + 1e-6) + 1
    energy = np.zeros(starts + longest)  # what the folded samples from here on hold
    for k in range(starts - 1, -1, -1):
        i = k * step
        energy[k] = energy[k + 1] + (fold.value[i] ** 2 / fold.count[i] if fold.count[i] > 0 else 0.0)
    reachable = np.empty(starts)
    for k in range(starts):
        reachable[k] = energy[k] - energy[min(k + longest, starts)]
    found = np.zeros((starts, 5))
    found[:, 0] = fold.scale[0]
    cos, sin = np.empty((taus.size, longest)), np.empty((taus.size, longest))
    for g in range(taus.size):
        for j in range(longest):
            decay = np.exp(-taus[g] * j * dt)
            cos[g, j], sin[g, j] = decay * np.cos(omegas[g] * j * dt), decay * np.sin(omegas[g] * j * dt)
    best = fold.scale[0]
    for k in np.argsort(-reachable):
        if fold.scale[0] - reachable[k] > best:
            break
        for g in range(taus.size):
            _grid_point(fold, limits, k * step, cos[g], sin[g], taus[g], omegas[g], found[k])
        best = min(best, found[k, 0])
    return found


@numba.njit(cache=True)
def _grid_point(fold, limits, a, cos, sin, tau, omega, found):
    """Update `found` with the best length and phase of a window that starts at position a."""
    hc = hs = cc = cs = ss = 0.0
    for j in range(cos.size):
        i = a + j * fold.classes
        if i >= fold.x.size:
            break
        c, s, count = cos[j], sin[j], fold.count[i]
        hc += c * fold.value[i]
        hs += s * fold.value[i]
        cc += c * c * count
        cs += c * s * count
        ss += s * s * count
        determinant = cc * ss - cs * cs
        if j < 2 or j % 2 or determinant <= 1e-9 * cc * ss:
            continue
        gain = hc * hc * ss - 2 * hc * hs * cs + hs * hs * cc
        if gain <= (fold.scale[0] - found[0]) * determinant:
            continue
        low, high = _t0_range(fold, limits, a, i)
        if low > high:
            break
        # sin(omega (x - t0)) = sin(phase) cos(omega (x - x[a])) + cos(phase) sin(omega (x - x[a]))
        phase = np.arctan2(hc * ss - hs * cs, hs * cc - hc * cs) % np.pi
        t0 = fold.x[a] - phase / omega
        if low <= t0 <= high:
            cost = fold.scale[0] - gain / determinant
            if cost < found[0]:
                found[0], found[1], found[2], found[3], found[4] = cost, i, t0, tau, omega
            continue
        for bound in (low, high):
            p, q = np.sin(omega * (fold.x[a] - bound)), np.cos(omega * (fold.x[a] - bound))
            norm = p * p * cc + 2 * p * q * cs + q * q * ss
            cost = fold.scale[0] - ((p * hc + q * hs) ** 2 / norm if norm > 0 else 0.0)
            if cost < found[0]:
                found[0], found[1], found[2], found[3], found[4] = cost, i, bound, tau, omega


@numba.njit(cache=True)
def _window_starts(fold, limits, a, b, theta, reach):
    """Profile over the window's start: per start within `reach` samples, sum of squares, |A| and A's curvature."""
    rows = np.full((2 * reach + 1, 3), np.inf)
    for r in range(2 * reach + 1):
        start = a + (r - reach) * fold.classes
        if not 0 <= start < b or _t0_range(fold, limits, start, b)[0] > _t0_range(fold, limits, start, b)[1]:
            continue
        first, shifted = theta.copy(), _latest_t0(fold, limits, start, b, theta[0], theta[2])
        first[0] = theta[0] if np.isnan(shifted) else shifted
        trial, cost = _descend(fold, limits, start, b, first, 10)
        _, last, _ = _scan_edge(fold, limits, start, b, trial, False)
        trial, cost = _descend(fold, limits, start, last, trial, 10)
        gram, data = _normal_equations(fold, start, last, trial[0], trial[1], trial[2])
        A = _misfit(gram, data, fold, limits)[1]
        low, high = _t0_range(fold, limits, start, last)
        free = np.array(
            [
                low < trial[0] < high,
                limits.tau[0] < trial[1] < limits.tau[1],
                limits.omega[0] < trial[2] < limits.omega[1],
            ]
        )
        information = gram[0, 0]
        if free.any():
            index = 1 + np.flatnonzero(free)
            block = np.empty((index.size, index.size))
            for i in range(index.size):
                for j in range(index.size):
                    block[i, j] = gram[index[i], index[j]]
            side = gram[0][index]
            information -= side @ np.linalg.solve(block, side)
        mid_gap = np.exp(trial[1] * (fold.x[start] - _middle_of_gap(fold, limits, start, trial[0])))
        rows[r] = cost, abs(A) * mid_gap, information / mid_gap**2
    return rows


@numba.njit(cache=True)
def _middle_of_gap(fold, limits, a, t0):
    """Where the window's start is put: in the middle of what takes in position a but not the one before."""
    before = fold.x[a - 1] if a > 0 else fold.x[0]
    return (max(before, t0) + min(fold.x[a], t0 + limits.T1)) / 2


@numba.njit(cache=True)
def _mixture_quantile(probability, weights, means, deviations):
    """Quantile of a mixture of normal distributions, by bisection."""
    low, high = (means - 12 * deviations).min(), (means + 12 * deviations).max()
    for _ in range(60):
        middle = (low + high) / 2
        below = 0.0
        for i in range(means.size):
            below += weights[i] * (1 + erf((middle - means[i]) / (deviations[i] * sqrt(2.0)))) / 2
        low, high = (middle, high) if below < probability else (low, middle)
    return (low + high) / 2


def _amplitude_interval(fold, limits, a, b, theta) -> tuple[float, float]:
    """95 % interval of |A|: normal about each possible window start, these weighted by their likelihood."""
    cost, A, information = _window_starts(fold, limits, a, b, theta, 8).T
    known = np.isfinite(cost) & (information > 0)
    cost, A, information = cost[known], A[known], information[known]
    variance = cost.min() / (fold.scale[1] - 7)
    weights = np.exp(-(cost - cost.min()) / (2 * variance))
    deviations = np.sqrt(variance / information)
    low, high = (_mixture_quantile(p, weights / weights.sum(), A, deviations) for p in (0.025, 0.975))
    return float(low), float(high)


def _join_positions(fold: Fold, together: int) -> Fold:
    """Join neighbouring positions, for a grid search that needs no finer ones; only `_grid_search` may use it."""
    whole = fold.x.size // together * together
    value, count = (column[:whole].reshape(-1, together).sum(axis=1) for column in (fold.value, fold.count))
    return fold._replace(x=fold.x[:whole].reshape(-1, together).mean(axis=1), value=value, count=count)


def _grid() -> tuple[FloatArray, FloatArray]:
    """Pairs of tau and omega across Table 1's ranges, omega as dense as the damping lets it be told apart."""
    pairs = []
    for tau, step in ((5.0, 5.0), (9.0, 6.5), (14.0, 9.0), (20.0, 11.0), (28.0, 14.0)):
        pairs += [(tau, omega) for omega in np.arange(2 * np.pi, 2 * np.pi * 40 + step / 2, step)]
    taus, omegas = np.array(pairs).T
    return np.ascontiguousarray(taus), np.ascontiguousarray(np.minimum(omegas, 2 * np.pi * 40))


def _candidates(found: FloatArray, apart: int, most: int) -> list[int]:
    """Window starts that are the best within `apart` samples, the best of all first."""
    order = np.argsort(found[:, 0], kind="stable")
    chosen: list[int] = []
    for k in order[found[order, 0] < 2 * found[order[0], 0]]:
        if len(chosen) == most or found[k, 1] == 0:
            break
        if all(abs(k - other) > apart for other in chosen):
            chosen.append(int(k))
    return chosen


def _minima(t, v, timing, limits):
    """Refined local minima of the misfit, the best first: (a, b, theta, sum of squares), and the fold they are in."""
    fold = fold_record(t, v, timing)
    coarse = fold if fold.classes == 1 else fold_record(t, v, timing, whole_samples=True)
    dt = (t[-1] - t[0]) / (t.size - 1)
    taus, omegas = _grid()
    joined = max(1, round(1 / (omegas.max() * dt)))
    thin = _join_positions(coarse, joined)
    found = _grid_search(thin, limits, joined * dt, taus, omegas)
    minima = {}
    for k in _candidates(found, 2, 6):
        a = int(np.searchsorted(fold.x, thin.x[k] - joined * dt / 2))
        b = int(np.searchsorted(fold.x, thin.x[int(found[k, 1])] + joined * dt / 2)) - 1
        a, b, theta, cost = _refine(fold, limits, a, b, found[k, 2:].copy(), 8, 3)
        minima[a, b] = min(minima.get((a, b), (a, b, theta, cost)), (a, b, theta, cost), key=_cost)
    ranked = sorted(minima.values(), key=_cost)
    ranked[:2] = [_polish(fold, limits, minimum, 12) for minimum in ranked[:2] if minimum[3] < 1.2 * ranked[0][3]]
    return fold, sorted(ranked, key=_cost)


def _cost(minimum) -> float:
    """The sum of squares of a minimum (a, b, theta, sum of squares)."""
    return minimum[3]


@numba.njit(cache=True)
def _round_gates(t, samples, gains, instant, t0, T_d, T_f):
    """The t0 and T2, to the last bits, whose rounded gates t0 + i T_f + T2 near an instant gain most.

    gains[m] is what the sample of window m gains if it is let in. Returns t0, T2, and which samples are let in.
    """
    best, best_t0, best_T2 = -np.inf, t0, instant - t0
    inside = np.zeros(samples.size, dtype=np.bool_)
    for search in (True, False):
        for phase in range(64 if search else 1):
            trial_t0 = t0 + phase * 2.0**-55 if search else best_t0
            for last_bits in range(-80, 81) if search else range(1):
                T2 = instant - trial_t0 + last_bits * 2.0**-55 if search else best_T2
                gain = 0.0
                for m in range(samples.size):
                    start = trial_t0 + (m // 2) * T_f
                    inside[m] = t[samples[m]] <= (start + T_d if m % 2 else start) + T2
                    gain += gains[m] if inside[m] else 0.0
                if gain > best:
                    best, best_t0, best_T2 = gain, trial_t0, T2
    return best_t0, best_T2, inside


def _end_on_sample(t, v, timing, limits, fold, best, b):
    """Fit with T2 at its bound and windows that end on position b's samples, where rounding decides turn by turn.

    Whether t <= t0 + i T_f + T2 holds there depends on the last bits, which so choose the turns whose window takes its
    last sample in. The paper's cost has this freedom, and CMA-ES runs that are pressed against the bound use it.
    Returns (a, b, theta, sum of squares) and T2, or `best` and no T2 if that is not better.
    """
    a, _, theta, best_cost = best
    if fold.classes > 1 or b >= fold.x.size:
        return best, None
    low, high = _t0_range(fold, limits, a, b)
    if not low <= high or abs(theta[0] - low) > fold.x[1] - fold.x[0]:
        return best, None
    bounded, _ = _descend(fold, limits, a, b - 1, np.array([low, *theta[1:]]), 8, True)
    X = _parameters(t, v, timing, limits, fold, (a, b - 1, bounded, 0.0))
    samples = b + np.round(timing.T_d / (fold.x[1] - fold.x[0]) * np.arange(2 * timing.n)).astype(np.int64)
    samples = samples[samples < t.size]
    signs = np.where(np.arange(samples.size) % 2, -1.0, 1.0)
    since_t0 = fold.x[b] - low
    last = signs * X[0] * np.exp(-X[2] * (since_t0 - X[6])) * np.sin(X[3] * since_t0)
    error = v[samples] - X[4] - signature(t, X, timing)[samples]
    t0, T2, inside = _round_gates(t, samples, error**2 - (error - last) ** 2, fold.x[b], low, timing.T_d, timing.T_f)
    part = fold._replace(
        value=fold.value.copy(), count=fold.count.copy(), sign=fold.sign.copy(), pairs=fold.pairs.copy()
    )
    part.value[b], part.count[b], part.sign[b] = (
        (inside * signs) @ (v[samples] - v.mean()),
        inside.sum(),
        inside @ signs,
    )
    if fold.inverse[b] >= 0:
        part.pairs[fold.inverse[b]] = inside[: 2 * timing.n - 1].sum()
    bounded, cost = _descend(part, limits, a, b, np.array([t0, *bounded[1:]]), 8, True)
    return ((a, b, bounded, cost), T2) if cost < best_cost else (best, None)


def _parameters(t, v, timing, limits, fold, best, T2=None) -> FloatArray:
    """X of a minimum (a, b, theta, sum of squares): window edges in mid-gap unless T2 is given, A and v_t projected."""
    a, b, (t0, tau, omega), _ = best
    after = fold.x[b + 1] if b + 1 < fold.x.size else fold.x[b] + fold.x[1] - fold.x[0]
    T2 = (fold.x[b] + min(after, t0 + limits.T2)) / 2 - t0 if T2 is None else T2
    X = np.array([1.0, t0, tau, omega, 0.0, T2, _middle_of_gap(fold, limits, a, t0) - t0])
    unit = signature(t, X, timing)
    centred = unit - unit.mean()
    A = centred @ v / (centred @ centred)
    if abs(A) > limits.A:  # a later start in the same gap has a smaller A
        X[6] = min(X[6] + np.log(abs(A) / limits.A) / tau, limits.T1, fold.x[a] - t0 - CLEARANCE_S)
        A = np.clip(A, -limits.A, limits.A)
        unit = signature(t, X, timing)
    X[0], X[4] = A, v.mean() - A * unit.mean()
    return X


@numba.njit(cache=True)
def _turn_energy(t, v, periods, bins):
    """Sum of squares of the mean half turn, the second half of each turn taken negative, for each turn period."""
    energy = np.zeros(periods.size)
    for p in range(periods.size):
        total, count = np.zeros(bins), np.zeros(bins)
        for i in range(t.size):
            position = (t[i] - t[0]) / periods[p] * 2 * bins
            half, k = divmod(int(position), bins)
            total[k] += v[i] if half % 2 == 0 else -v[i]
            count[k] += 1
        for k in range(bins):
            energy[p] += total[k] ** 2 / max(count[k], 1.0)
    return energy


def _find_turn_period(t, v, protocol, limits, tolerance) -> float:
    """The turn period within a relative tolerance of the protocol's that the signature fits best [s]."""
    dt = (t[-1] - t[0]) / (t.size - 1)
    step = protocol.T_f * dt / (t[-1] - t[0])
    reach = int(np.ceil(tolerance * protocol.T_f / step))
    periods = protocol.T_f + step * np.arange(-reach, reach + 1)
    period = periods[np.argmax(_turn_energy(t, v - v.mean(), periods, round(protocol.T_d / dt)))]
    best = None
    while step > 1e-6 * period:
        trials = period + step * np.array([0.0, -2.0, -1.0, 1.0, 2.0])
        for trial in trials:
            timing = Timing(trial / 2, trial, protocol.turns)
            if best is None:
                fold, minima = _minima(t, v, timing, limits)
                best = minima[0]
                edges = fold.x[best[0]], fold.x[best[1]]
            moved = (period - trial) * protocol.turns / 2
            fold = fold_record(t, v, timing)
            a, b = np.clip(np.searchsorted(fold.x, np.array(edges) + moved), 0, fold.x.size - 1)
            theta = best[2] + np.array([moved, 0.0, 0.0])
            found = _refine(fold, limits, int(a), int(b), theta, 8, 4)
            if found[3] < best[3]:
                best, edges, period = found, (fold.x[found[0]], fold.x[found[1]]), trial
        step /= 2
    return period


def global_fit(recording: Recording, protocol: Protocol | None = None, period_tolerance: float = 0.0) -> GlobalFit:
    """Find the signature with the least misfit to a record, in the box of a protocol of the paper.

    Parameters
    ----------
    recording : Recording
        The record.
    protocol : Protocol, optional
        Timing and box; the paper's search settings do not matter. By default the authors' notebook.
    period_tolerance : float
        Search the turn period within this fraction of the protocol's T_f, with T_d half of it; 0 takes T_f as known.

    Returns
    -------
    GlobalFit

    Raises
    ------
    ValueError
        T_d is not half of T_f, or the record is shorter than half a turn or constant.
    """
    protocol = Protocol() if protocol is None else protocol
    t, v = recording.t, recording.v
    if t[-1] - t[0] < protocol.T_d or v.max() == v.min():
        raise ValueError(f"{recording.source}: shorter than half a turn, or constant: there is no signature to fit")
    box = protocol_box(recording, protocol)
    A, t0, tau, omega, _, T2, T1 = zip(box.lower.tolist(), box.upper.tolist(), strict=True)
    limits = Limits(A[1], t0[0], T1[1], T2[1], tau, omega)
    timing = protocol.timing
    if period_tolerance > 0:
        period = _find_turn_period(t, v, protocol, limits, period_tolerance)
        timing = Timing(period / 2, period, protocol.turns)
    fold, minima = _minima(t, v, timing, limits)
    best = minima[0]
    interval = _amplitude_interval(fold, limits, *best[:3])
    on_sample, T2 = best, None
    for b in (best[1], best[1] + 1):
        trial, trial_T2 = _end_on_sample(t, v, timing, limits, fold, on_sample, b)
        on_sample, T2 = (trial, trial_T2) if trial_T2 else (on_sample, T2)
    X = _parameters(t, v, timing, limits, fold, on_sample, T2)
    misfit = float(population_rmse(t, v, X[None, :], timing)[0])
    rivals = (abs(_parameters(t, v, timing, limits, fold, m)[0]) for m in minima[1:] if m[3] < 1.01**2 * best[3])
    near = np.minimum(X - box.lower, box.upper - X) <= 1e-6 * (box.upper - box.lower)
    return GlobalFit(
        X,
        misfit,
        timing.T_f,
        float(abs(X[0])),
        interval,
        tuple(name for name, bound in zip(FREE_PARAMETERS, near, strict=True) if bound),
        bool(X[0] < 0),
        tuple(float(rival) for rival in rivals if not interval[0] <= rival <= interval[1]),
    )
