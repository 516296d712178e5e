"""Search over the signature's window and theta = (t0, tau, omega) on a folded record: a grid, then descents."""

import numpy as np

from backlash.fitting.folding import CLEARANCE_S, Fold, best_misfit, descend, latest_t0, t0_range
from replication.arrays import FloatArray
from replication.compiled.cache import njit


@njit
def scan_edge(fold, limits, a, b, theta, move_start):
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
        gram += unit[i] * unit[i] * fold.samples[i]
        offset += unit[i] * fold.sign[i]
        k = fold.partner[i] if move_start else fold.inverse[i]
        if k >= 0 and (k - hold) * direction >= 0 and (i - k) * direction > 0:
            gram -= 2 * fold.pairs[min(i, k)] * unit[i] * unit[k]
        first, last = (i, hold) if move_start else (hold, i)
        if not np.isnan(latest_t0(fold, limits, first, last, t0, omega)):
            limit = limits.A * np.exp(tau * (fold.x[first] - anchor))  # of A as seen from the anchor
            cost, _ = best_misfit(gram - offset * offset / fold.scale[1], data, fold, limit)
            if cost < best_cost:
                best_cost, best_edge = cost, i
        i += direction
    return (best_edge, b, best_cost) if move_start else (a, best_edge, best_cost)


@njit
def refine(fold, limits, a, b, theta, steps, rounds):
    """Alternate between descent and scans of the edges until nothing moves; returns a, b, theta, sum of squares."""
    theta, cost = descend(fold, limits, a, b, theta, steps)
    for _ in range(rounds):
        moved = False
        for move_start in (False, True):
            new_a, new_b, new_cost = scan_edge(fold, limits, a, b, theta, move_start)
            if new_cost < cost and (new_a != a or new_b != b):
                theta[0] = latest_t0(fold, limits, new_a, new_b, theta[0], theta[2])
                a, b, cost, moved = new_a, new_b, new_cost, True
        if not moved:
            break
        theta, cost = descend(fold, limits, a, b, theta, steps)
    return a, b, theta, cost


@njit
def descend_in_window(fold, limits, a, b, theta, steps):
    """Descend in the window from a to b; an infinite sum of squares if there is none."""
    theta = theta.copy()
    if a < 0 or b >= fold.x.size or b < a:
        return theta, np.inf
    low, high = t0_range(fold, limits, a, b)
    if low > high:
        return theta, np.inf
    shifted = latest_t0(fold, limits, a, b, theta[0], theta[2])
    theta[0] = theta[0] if np.isnan(shifted) else shifted
    return descend(fold, limits, a, b, theta, steps)


@njit
def _try_window(fold, limits, best, a, b):
    """The better of the window from a to b and of `best` = (a, b, theta, sum of squares)."""
    theta, cost = descend_in_window(fold, limits, a, b, best[2], 6)
    return (a, b, theta, cost) if cost < best[3] * (1 - 1e-12) else best


@njit
def _reachable_end(fold, limits, a, best):
    """The end of the best window, or as far as T2 reaches if the window starts on position a at the same phase."""
    b = best[1]
    if 0 <= a < fold.x.size:
        half = np.pi / best[2][2]
        t0 = fold.x[a] - (fold.x[a] - best[2][0]) % half
        while b > a and fold.x[b] > t0 + limits.T2 - CLEARANCE_S:
            b -= 1
    return b


@njit
def polish(fold, limits, best):
    """Try every end, every start within twelve samples, and all nearest pairs, until nothing is better."""
    before = np.inf
    while best[3] < before:
        before = best[3]
        for b in range(best[0] + 1, fold.x.size, fold.classes):
            if fold.x[b] - fold.x[best[0]] > limits.T2:
                break
            best = _try_window(fold, limits, best, best[0], b)
        for a in range(best[0] - 12 * fold.classes, best[0] + 12 * fold.classes + 1, fold.classes):
            best = _try_window(fold, limits, best, a, _reachable_end(fold, limits, a, best))
        a, b = best[0], best[1]
        for near_a in range(a - 2, a + 3):
            for near_b in range(b - 2, b + 3):
                best = _try_window(fold, limits, best, near_a, near_b)
    return refine(fold, limits, best[0], best[1], best[2], 30, 5)


@njit
def turn_back(fold, limits, best):
    """Try the same oscillation half a turn earlier and later, as long as that is better.

    A window half a turn late misses one oscillation of the record: the commonest wrong basin.
    """
    for move in (fold.inverse, fold.partner):
        while min(move[best[0]], move[best[1]]) >= 0:
            a, b, theta = move[best[0]], move[best[1]], best[2].copy()
            t0 = latest_t0(fold, limits, a, b, theta[0] + fold.x[a] - fold.x[best[0]], theta[2])
            if np.isnan(t0):
                break
            theta[0] = t0
            trial = refine(fold, limits, a, b, theta, 8, 3)
            if trial[3] >= best[3] * (1 - 1e-12):
                break
            best = trial
    return best


@njit
def grid_search(fold, limits, dt, taus, omegas):
    """Best signature on a grid of tau and omega for each window start, phase and A free.

    Starts that cannot be better than the best found so far are left out: a window explains no more than its samples
    hold. Returns per start: sum of squares, last position, t0, tau, omega.
    """
    starts = fold.x.size
    longest = int(limits.T2 / dt + 1e-6) + 1
    energy = np.zeros(starts + longest)  # what the folded samples from here on hold
    for k in range(starts - 1, -1, -1):
        energy[k] = energy[k + 1] + (fold.value[k] ** 2 / fold.samples[k] if fold.samples[k] > 0 else 0.0)
    reachable = energy[:starts] - energy[longest:]  # nothing is beyond the last start
    found = np.zeros((starts, 5))
    found[:, 0] = fold.scale[0]
    samples = np.arange(longest) * 1.0
    decay, angle = np.exp(-np.outer(taus, samples) * dt), np.outer(omegas, samples) * dt
    cos, sin = decay * np.cos(angle), decay * np.sin(angle)
    best = fold.scale[0]
    for k in np.argsort(-reachable):
        if fold.scale[0] - reachable[k] > best:
            break
        for g in range(taus.size):
            _grid_point(fold, limits, k, cos[g], sin[g], taus[g], omegas[g], found[k])
        best = min(best, found[k, 0])
    return found


@njit
def _grid_point(fold, limits, a, cos, sin, tau, omega, found):
    """Update `found` with the best length and phase of a window that starts at position a."""
    hc = hs = cc = cs = ss = 0.0
    for j in range(min(cos.size, fold.x.size - a)):
        i = a + j
        c, s, count = cos[j], sin[j], fold.samples[i]
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
        low, high = t0_range(fold, limits, a, i)
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


def join_positions(fold: Fold, together: int) -> Fold:
    """Join neighbouring positions, for a grid search that needs no finer ones; only `grid_search` may use it."""
    whole = fold.x.size // together * together
    x, value, samples = (column[:whole].reshape(-1, together) for column in (fold.x, fold.value, fold.samples))
    return fold._replace(x=x.mean(axis=1), value=value.sum(axis=1), samples=samples.sum(axis=1))


def damping_frequency_grid() -> tuple[FloatArray, FloatArray]:
    """Pairs of tau and omega across Table 1's ranges, omega as dense as the damping lets it be told apart."""
    pairs = []
    for tau, step in ((5.0, 5.0), (9.0, 6.5), (14.0, 9.0), (20.0, 11.0), (28.0, 14.0)):
        pairs += [(tau, omega) for omega in np.arange(2 * np.pi, 2 * np.pi * 40 + step / 2, step)]
    taus, omegas = np.array(pairs).T
    return np.ascontiguousarray(taus), np.ascontiguousarray(np.minimum(omegas, 2 * np.pi * 40))
