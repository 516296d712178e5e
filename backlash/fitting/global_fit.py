"""Deterministic global fit of the signature: the paper's cost function, in the paper's box, without chance."""

import math
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
from scipy.special import ndtr

from backlash.fitting import folding, windows
from backlash.fitting.folding import FoldedWindows, Limits, middle_of_gap
from backlash.fitting.windows import Minimum
from replication.arrays import FloatArray
from replication.records import Recording
from replication.signature import Box, Timing, rmse
from replication.signature import h as signature
from replication.table2 import Settings, search_box

_MOST_CANDIDATES = 6
_STARTS_BESIDE = 8  # samples to either side of the best window's start that it may have instead


@dataclass(frozen=True)
class GlobalFit:
    """The best signature of a record.

    Of the parameter vectors of one signal, X has the window's start midway between the last sample
    outside and the first inside it, or as near to that as the box lets it, and the latest t0 before
    that start. A window that starts or ends exactly on a sample, so that rounding decides turn by
    turn whether it holds it, is not looked for: CMA-ES runs whose t0 ends at its bound use that,
    for at most 0.15 % of the misfit.
    """

    X: FloatArray  # in `signature.FREE_PARAMETERS` order
    rmse: float  # the paper's cost [rps]
    amplitude_rps: float  # |A| for a window that starts midway between two samples
    amplitude_interval_rps: tuple[
        float, float
    ]  # 95 %, if the signature is right and the noise white


def _window_starts(fold: FoldedWindows, limits: Limits, best: Minimum) -> FloatArray:
    """Profile over the window's start: sum of squares, |A| and A's curvature, a row for each admissible start."""
    rows = []
    for away in range(-_STARTS_BESIDE, _STARTS_BESIDE + 1):
        start = best.a + away * fold.classes
        last = windows.reachable_end(fold, limits, start, best)
        theta, cost = windows.descend_in_window(fold, limits, start, last, best.theta, 20)
        if start == last or cost == np.inf:
            continue
        gram, data = folding.normal_equations(fold, start, last, theta)
        A = folding.best_misfit(gram[0, 0], data[0], fold.power, limits.A)[1]
        low, high = folding.theta_bounds(fold, limits, start, last)
        free = np.flatnonzero((low < theta) & (theta < high))
        information = 0.0
        if last - start >= free.size:  # fewer positions than unknowns: nothing is known of A
            index = np.append(1 + free, 0)
            block = gram[np.ix_(index, index)]
            folding.factorise(block)
            information = block[-1, -1]  # what is left of A's once the others are projected out
        mid_gap = math.exp(theta[1] * (fold.x[start] - middle_of_gap(fold, start)))
        rows.append((cost, abs(A) * mid_gap, information / (mid_gap * mid_gap)))
    return np.array(rows).reshape(-1, 3)


def _amplitude_interval(fold: FoldedWindows, limits: Limits, best: Minimum) -> tuple[float, float]:
    """95 % interval of |A|: normal about each possible window start, these weighted by their likelihood."""
    profile = _window_starts(fold, limits, best)
    cost, A, information = profile[np.isfinite(profile[:, 0]) & (profile[:, 2] > 0)].T
    if cost.size == 0:
        return 0.0, float(limits.A)
    if fold.total <= 7:
        raise ValueError(f"{fold.total:g} samples leave nothing over for an interval")
    cost = np.maximum(cost, 1e-15 * fold.power)
    variance = cost.min() / (fold.total - 7)
    weights = np.exp(-(cost - cost.min()) / (2 * variance))
    deviations = np.sqrt(variance / information)
    ends = (A - 12 * deviations).min(), (A + 12 * deviations).max()

    def quantile(probability: float) -> float:
        """Halve the interval to the last digit; scipy's root finders are slow to import."""
        low, high = ends
        while low < (middle := (low + high) / 2) < high:
            share = weights @ ndtr((middle - A) / deviations) / weights.sum()
            low, high = (middle, high) if share < probability else (low, middle)
        return float(middle)

    return quantile(0.025), quantile(0.975)


def _candidates(found: windows.Starts, power: float) -> list[int]:
    """Up to six window starts that are the best within two samples, the best of all first.

    Only those with less than twice the best sum of squares, or a part of the record's `power`: on a
    record without noise the best is near zero, and below it where windows overlap, which the grid
    leaves out of account.
    """
    order = np.argsort(found.cost, kind="stable")
    chosen: list[int] = []
    for k in order[found.cost[order] < max(2 * found.cost[order[0]], 0.05 * power)]:
        if len(chosen) == _MOST_CANDIDATES or found.end[k] == 0:
            break
        if all(abs(k - other) > 2 for other in chosen):
            chosen.append(int(k))
    return chosen


def _minima(
    t: FloatArray, v: FloatArray, timing: Timing, limits: Limits
) -> tuple[FoldedWindows, list[Minimum]]:
    """A folded record, and refined local minima of its misfit, the best first."""
    fold = folding.fold_record(t, v, timing)
    coarse = folding.fold_record(t, v, timing, whole_samples=True)
    dt = (t[-1] - t[0]) / (t.size - 1)
    joined = max(1, round(1 / (windows.FASTEST_RAD_PER_S * dt)))
    thin = windows.join_positions(coarse, joined)
    found = windows.grid_search(thin, limits, joined * dt)
    minima: dict[tuple[int, int], Minimum] = {}
    for k in _candidates(found, fold.power):
        a = int(np.searchsorted(fold.x, thin.x[k] - joined * dt / 2))
        b = int(np.searchsorted(fold.x, thin.x[found.end[k]] + joined * dt / 2)) - 1
        minimum = Minimum(a, b, *folding.descend(fold, limits, a, b, found.theta[k], 8))
        place = minimum.a, minimum.b
        if place not in minima or minimum.cost < minima[place].cost:
            minima[place] = minimum
    by_cost = attrgetter("cost")
    ranked = sorted(minima.values(), key=by_cost)
    if ranked:
        turned = windows.turn_back(fold, limits, ranked[0])
        ranked = sorted((minima | {(turned.a, turned.b): turned}).values(), key=by_cost)
    near = [minimum for minimum in ranked[1:2] if minimum.cost < 1.2 * ranked[0].cost]
    polished = [windows.polish(fold, limits, minimum) for minimum in ranked[:1] + near]
    return fold, sorted(polished + ranked[len(polished) :], key=by_cost)


def _limits(box: Box) -> Limits:
    """The box in the form the search needs."""
    A, t0, tau, omega, _, T2, T1 = zip(box.lower.tolist(), box.upper.tolist(), strict=True)
    return Limits(A[1], t0[0], T1[1], T2[1], tau, omega)


def _parameters(
    recording: Recording, timing: Timing, limits: Limits, fold: FoldedWindows, best: Minimum
) -> FloatArray:
    """X of a minimum: window edges in mid-gap, A and v_t projected."""
    t, v = recording.t, recording.v
    a, b, (t0, tau, omega), _ = best
    after = fold.x[b + 1] if b + 1 < fold.x.size else fold.x[b] + fold.x[1] - fold.x[0]
    T2 = (fold.x[b] + min(after, t0 + limits.T2)) / 2 - t0
    T1 = np.clip(middle_of_gap(fold, a) - t0, 0.0, limits.T1)
    X = np.array([1.0, t0, tau, omega, 0.0, T2, T1])
    unit = signature(t, X, timing)
    centred = unit - unit.mean()
    A = (centred * v).sum() / (centred * centred).sum()
    if abs(A) > limits.A:  # a later start in the same gap has a smaller A
        X[6] = min(
            T1 + np.log(abs(A) / limits.A) / tau, limits.T1, fold.x[a] - t0 - folding.CLEARANCE_S
        )
        unit = signature(t, X, timing)
        A = np.clip(A, -limits.A, limits.A)
    X[0], X[4] = A, v.mean() - A * unit.mean()
    return X


def global_fit(recording: Recording, protocol: Settings | None = None) -> GlobalFit:
    """Find the signature with the least misfit to a record, in the box of a protocol: by default the authors' notebook.

    ValueError if T_d is not half of T_f, or the record is too short, constant, or sampled too
    rarely for any window.
    """
    protocol = Settings() if protocol is None else protocol
    t, v = recording.t, recording.v
    if t[-1] - t[0] < protocol.timing.T_d or v.max() == v.min():
        raise ValueError(
            f"{recording.source}: shorter than half a turn, or constant: there is no signature to fit"
        )
    timing = protocol.timing
    limits = _limits(search_box(recording, protocol))
    fold, minima = _minima(t, v, timing, limits)
    if not minima:
        raise ValueError(
            f"{recording.source}: {t.size} samples are too few for the signature's windows; sample faster"
        )
    best = minima[0]
    X = _parameters(recording, timing, limits, fold, best)
    return GlobalFit(
        X=X,
        rmse=rmse(t, v, X, timing),
        amplitude_rps=float(abs(X[0]) * np.exp(X[2] * (X[1] + X[6] - middle_of_gap(fold, best.a)))),
        amplitude_interval_rps=_amplitude_interval(fold, limits, best),
    )
