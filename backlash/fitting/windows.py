"""Search over the signature's window and theta = (t0, tau, omega) on a folded record: a grid, then descents."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backlash.fitting.folding import (
    CLEARANCE_S,
    FoldedWindows,
    Limits,
    descend,
    latest_t0,
    t0_range,
)
from replication.arrays import FloatArray
from replication.compiling import njit

FASTEST_RAD_PER_S = 2 * np.pi * 40.0


class Minimum(NamedTuple):
    """A window from position a to b, theta = (t0, tau, omega), and the sum of squares there [rps^2]."""

    a: int
    b: int
    theta: FloatArray
    cost: float


def descend_in_window(
    fold: FoldedWindows, limits: Limits, a: int, b: int, theta: FloatArray, steps: int
) -> tuple[FloatArray, float]:
    """Descend in the window from a to b; an infinite sum of squares if there is none."""
    if a < 0 or b >= fold.x.size or b < a:
        return theta, np.inf
    low, high = t0_range(fold.x, limits, a, b)
    if low > high:
        return theta, np.inf
    shifted = latest_t0(fold.x, limits, a, b, theta[0], theta[2])
    start = theta.copy()
    if not np.isnan(shifted):
        start[0] = shifted
    return descend(fold, limits, a, b, start, steps)


def _try_window(fold: FoldedWindows, limits: Limits, best: Minimum, a: int, b: int) -> Minimum:
    """The better of the window from a to b and of the best one."""
    theta, cost = descend_in_window(fold, limits, a, b, best.theta, 6)
    return Minimum(a, b, theta, cost) if cost < best.cost * (1 - 1e-12) else best


def reachable_end(fold: FoldedWindows, limits: Limits, a: int, best: Minimum) -> int:
    """The end of the best window, or as far as T2 reaches if the window starts on position a at the same phase."""
    b = best.b
    if 0 <= a < fold.x.size:
        t0, _, omega = best.theta
        latest = fold.x[a] - (fold.x[a] - t0) % (np.pi / omega)
        while b > a and fold.x[b] > latest + limits.T2 - CLEARANCE_S:
            b -= 1
    return b


def polish(fold: FoldedWindows, limits: Limits, best: Minimum) -> Minimum:
    """Try every end, every start within twelve samples, and all nearest pairs, until nothing is better."""
    before = np.inf
    while best.cost < before:
        before = best.cost
        for b in range(best.a + 1, fold.x.size, fold.classes):
            if fold.x[b] - fold.x[best.a] > limits.T2:
                break
            best = _try_window(fold, limits, best, best.a, b)
        near = 12 * fold.classes
        for a in range(best.a - near, best.a + near + 1, fold.classes):
            best = _try_window(fold, limits, best, a, reachable_end(fold, limits, a, best))
        middle = best
        for a in range(middle.a - 2, middle.a + 3):
            for b in range(middle.b - 2, middle.b + 3):
                best = _try_window(fold, limits, best, a, b)
    return Minimum(best.a, best.b, *descend(fold, limits, best.a, best.b, best.theta, 30))


def turn_back(fold: FoldedWindows, limits: Limits, best: Minimum) -> Minimum:
    """Try the same oscillation half a turn earlier and later, as long as that is better.

    A window half a turn late misses one oscillation of the record: the commonest wrong basin.
    """
    for move in (fold.at["inverse"], fold.at["partner"]):
        while min(move[best.a], move[best.b]) >= 0:
            a, b = int(move[best.a]), int(move[best.b])
            theta = best.theta.copy()
            theta[0] = latest_t0(
                fold.x, limits, a, b, theta[0] + fold.x[a] - fold.x[best.a], theta[2]
            )
            if np.isnan(theta[0]):
                break
            trial = Minimum(a, b, *descend(fold, limits, a, b, theta, 8))
            if trial.cost >= best.cost * (1 - 1e-12):
                break
            best = trial
    return best


class Grid(NamedTuple):
    """Pairs of tau [1/s] and omega [rad/s], and the samples of their damped cosines and sines, a row each."""

    tau: FloatArray
    omega: FloatArray
    cos: FloatArray
    sin: FloatArray


class Starts(NamedTuple):
    """The best window of each start of a grid search, arrays of shape (positions,)."""

    cost: FloatArray  # sum of squares [rps^2], that of the record where nothing is better
    end: NDArray[np.int64]  # position; 0 where nothing is better
    theta: FloatArray  # shape (positions, 3)


def grid_search(fold: FoldedWindows, limits: Limits, dt: float) -> Starts:
    """The best window for each start, over a grid of damping and frequency, most promising starts first.

    Windows that overlap are left out of account. A start whose samples hold less than the best fit
    explains is not tried: it cannot be better.
    """
    starts = fold.x.size
    longest = int(limits.T2 / dt + 1e-6) + 1
    energy = np.zeros(starts + longest)  # what the folded samples from here on hold
    value, samples = fold.at["value"], fold.at["samples"]
    held = np.divide(value**2, samples, out=np.zeros(starts), where=samples > 0)
    energy[:starts] = held[::-1].cumsum()[::-1]
    reachable = energy[:starts] - energy[longest:]  # nothing is beyond the last start
    found = Starts(
        np.full(starts, fold.power), np.zeros(starts, dtype=np.int64), np.zeros((starts, 3))
    )
    order = np.argsort(-reachable, kind="stable")
    _search_starts(fold, limits, order, fold.power - reachable, _grid(longest, dt), found)
    return found


def _grid(longest: int, dt: float) -> Grid:
    """Pairs of tau and omega across Table 1's ranges, omega as dense as the damping lets it be told apart."""
    pairs = []
    for damping, step in ((5.0, 5.0), (9.0, 6.5), (14.0, 9.0), (20.0, 11.0), (28.0, 14.0)):
        frequencies = np.arange(2 * np.pi, FASTEST_RAD_PER_S + step / 2, step)
        pairs += [(damping, min(frequency, FASTEST_RAD_PER_S)) for frequency in frequencies]
    tau, omega = np.array(pairs).T.copy()
    since = dt * np.arange(longest)
    decay, angle = np.exp(np.outer(-tau, since)), np.outer(omega, since)
    return Grid(tau, omega, decay * np.cos(angle), decay * np.sin(angle))


@njit
def _search_starts(fold, limits, order, least_cost, grid, found):
    """Fill in what the starts find, in an order, up to the first that cannot be better than the best."""
    best = fold.power
    for a in order:
        if least_cost[a] > best:
            break
        for g in range(grid.tau.size):
            _try_start(fold, limits, a, grid, g, found)
        best = min(best, found.cost[a])


@njit(inner=True)
def _try_start(fold, limits, a, grid, g, found):
    """Update what a start at position a has found with the best length and phase at one pair of the grid."""
    tau = grid.tau[g]
    omega = grid.omega[g]
    hc = hs = cc = cs = ss = 0.0
    for j in range(min(grid.cos.shape[1], fold.x.size - a)):
        i = a + j
        c = grid.cos[g, j]
        s = grid.sin[g, j]
        hc += c * fold.at[i].value
        hs += s * fold.at[i].value
        cc += c * c * fold.at[i].samples
        cs += c * s * fold.at[i].samples
        ss += s * s * fold.at[i].samples
        determinant = cc * ss - cs * cs
        if j < 2 or j % 2 or determinant <= 1e-9 * cc * ss:
            continue
        gain = hc * hc * ss - 2 * hc * hs * cs + hs * hs * cc
        if gain <= (fold.power - found.cost[a]) * determinant:
            continue
        low, high = t0_range(fold.x, limits, a, i)
        if low > high:
            break
        # sin(omega (x - t0)) = sin(phase) cos(omega (x - x[a])) + cos(phase) sin(omega (x - x[a]))
        phase = np.arctan2(hc * ss - hs * cs, hs * cc - hc * cs) % np.pi
        t0 = fold.x[a] - phase / omega
        cost = fold.power - gain / determinant
        if not low <= t0 <= high:
            t0 = low
            cost = np.inf
            for bound in (low, high):
                p = np.sin(omega * (fold.x[a] - bound))
                q = np.cos(omega * (fold.x[a] - bound))
                norm = p * p * cc + 2 * p * q * cs + q * q * ss
                at_bound = fold.power - ((p * hc + q * hs) ** 2 / norm if norm > 0 else 0.0)
                if at_bound < cost:
                    cost = at_bound
                    t0 = bound
        if cost < found.cost[a]:
            found.cost[a] = cost
            found.end[a] = i
            found.theta[a, 0] = t0
            found.theta[a, 1] = tau
            found.theta[a, 2] = omega


def join_positions(fold: FoldedWindows, together: int) -> FoldedWindows:
    """Join neighbouring positions, for a grid search that needs no finer ones; only `grid_search` may use it."""
    whole = fold.x.size // together * together
    joined = np.zeros(whole // together, fold.at.dtype)
    for name in ("value", "samples"):
        joined[name] = fold.at[name][:whole].reshape(-1, together).sum(axis=1)
    return fold._replace(x=fold.x[:whole].reshape(-1, together).mean(axis=1), at=joined)
