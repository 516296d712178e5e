"""Deterministic global fit of the signature: the paper's cost function, in the paper's box, without chance."""

from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from backlash.fitting import folding, windows
from backlash.fitting.folding import Fold, Limits, middle_of_gap
from replication.arrays import FloatArray
from replication.compiled.cache import njit
from replication.compiled.misfit import population_rmse
from replication.identify import Protocol, protocol_box
from replication.recording import Recording
from replication.signature import FREE_PARAMETERS, Timing, signature

Minimum = tuple[int, int, FloatArray, float]  # window from and to, (t0, tau, omega), sum of squares
_cost = itemgetter(3)


@dataclass(frozen=True)
class GlobalFit:
    """The best signature of a record.

    Of the parameter vectors of one signal, X has the window's start midway between the last sample outside and the
    first inside it, or as near to that as the box lets it, and the latest t0 before that start. A window that starts or
    ends exactly on a sample, so that rounding decides turn by turn whether it holds it, is not looked for: CMA-ES runs
    whose t0 ends at its bound use that, for at most 0.15 % of the misfit.
    """

    X: FloatArray  # in `signature.FREE_PARAMETERS` order
    rmse: float  # the paper's cost [rps]
    amplitude_rps: float  # |A| for a window that starts midway between two samples
    amplitude_interval_rps: tuple[float, float]  # 95 %, if the signature is right and the noise white
    at_bound: tuple[str, ...]  # parameters at a bound of the box
    sign_flipped: bool  # A is negative in X
    rival_rps: tuple[float, ...]  # |A| of other basins: misfit within 1 %, |A| outside the interval


@njit
def _window_starts(fold, limits, a, b, theta):
    """Profile over the window's start: per start within eight samples, sum of squares, |A| and A's curvature."""
    rows = np.full((17, 3), np.inf)
    for r in range(17):
        start = a + (r - 8) * fold.classes
        trial, cost = windows.descend_in_window(fold, limits, start, b, theta, 10)
        if start == b or cost == np.inf:
            continue
        _, last, _ = windows.scan_edge(fold, limits, start, b, trial, False)
        trial, cost = folding.descend(fold, limits, start, last, trial, 10)
        gram, data = folding.normal_equations(fold, start, last, trial[0], trial[1], trial[2])
        A = folding.best_misfit(gram[0, 0], data[0], fold, limits.A)[1]
        low, high = folding.theta_bounds(fold, limits, start, last)
        free = (low < trial) & (trial < high)
        information = 0.0
        if last - start >= free.sum():  # fewer positions than unknowns: nothing is known of A
            index = np.append(1 + np.flatnonzero(free), 0)
            block = gram[index][:, index]
            folding.factorise(block)
            information = block[-1, -1]  # what is left of A's once the others are projected out
        mid_gap = np.exp(trial[1] * (fold.x[start] - middle_of_gap(fold, start)))
        rows[r] = cost, abs(A) * mid_gap, information / mid_gap**2
    return rows


def _amplitude_interval(fold, limits, a, b, theta) -> tuple[float, float]:
    """95 % interval of |A|: normal about each possible window start, these weighted by their likelihood."""
    cost, A, information = _window_starts(fold, limits, a, b, theta).T
    known = np.isfinite(cost) & (information > 0)
    if not known.any():
        return 0.0, float(limits.A)
    cost, A, information = np.maximum(cost[known], 1e-15 * fold.scale[0]), A[known], information[known]
    variance = cost.min() / (fold.scale[1] - 7)
    weights = np.exp(-(cost - cost.min()) / (2 * variance))
    deviations = np.sqrt(variance / information)
    ends = (A - 12 * deviations).min(), (A + 12 * deviations).max()

    def excess(amplitude: float, probability: float) -> float:
        return float(weights @ ndtr((amplitude - A) / deviations) / weights.sum() - probability)

    low, high = (brentq(excess, *ends, (probability,), xtol=1e-14) for probability in (0.025, 0.975))
    return low, high


def _candidates(found: FloatArray, power: float) -> list[int]:
    """Up to six window starts that are the best within two samples, the best of all first.

    Only those with less than twice the best sum of squares, or a part of the record's `power`: on a record without
    noise the best is near zero, and below it where windows overlap, which the grid leaves out of account.
    """
    order = np.argsort(found[:, 0], kind="stable")
    chosen: list[int] = []
    for k in order[found[order, 0] < max(2 * found[order[0], 0], 0.05 * power)]:
        if len(chosen) == 6 or found[k, 1] == 0:
            break
        if all(abs(k - other) > 2 for other in chosen):
            chosen.append(int(k))
    return chosen


def _minima(t: FloatArray, v: FloatArray, timing: Timing, limits: Limits) -> tuple[Fold, list[Minimum]]:
    """A folded record, and refined local minima of its misfit, the best first."""
    fold = folding.fold_record(t, v, timing)
    coarse = fold if fold.classes == 1 else folding.fold_record(t, v, timing, whole_samples=True)
    dt = (t[-1] - t[0]) / (t.size - 1)
    taus, omegas = windows.damping_frequency_grid()
    joined = max(1, round(1 / (omegas.max() * dt)))
    thin = windows.join_positions(coarse, joined)
    found = windows.grid_search(thin, limits, joined * dt, taus, omegas)
    minima: dict[tuple[int, int], Minimum] = {}
    for k in _candidates(found, fold.scale[0]):
        a = int(np.searchsorted(fold.x, thin.x[k] - joined * dt / 2))
        b = int(np.searchsorted(fold.x, thin.x[int(found[k, 1])] + joined * dt / 2)) - 1
        a, b, theta, cost = windows.refine(fold, limits, a, b, found[k, 2:].copy(), 8, 3)
        if (a, b) not in minima or cost < minima[a, b][3]:
            minima[a, b] = a, b, theta, cost
    ranked = sorted(minima.values(), key=_cost)
    if ranked:
        turned = windows.turn_back(fold, limits, ranked[0])
        ranked = sorted((minima | {turned[:2]: turned}).values(), key=_cost)
    near = [minimum for minimum in ranked[1:2] if minimum[3] < 1.2 * ranked[0][3]]
    polished = [windows.polish(fold, limits, minimum) for minimum in ranked[:1] + near]
    return fold, sorted(polished + ranked[len(polished) :], key=_cost)


def _parameters(recording: Recording, timing: Timing, limits: Limits, fold: Fold, minimum: Minimum) -> FloatArray:
    """X of a minimum: window edges in mid-gap, A and v_t projected."""
    t, v = recording.t, recording.v
    a, b, (t0, tau, omega), _ = minimum
    after = fold.x[b + 1] if b + 1 < fold.x.size else fold.x[b] + fold.x[1] - fold.x[0]
    T2 = (fold.x[b] + min(after, t0 + limits.T2)) / 2 - t0
    T1 = np.clip(middle_of_gap(fold, a) - t0, 0.0, limits.T1)
    X = np.array([1.0, t0, tau, omega, 0.0, T2, T1])
    unit = signature(t, X, timing)
    centred = unit - unit.mean()
    A = (centred * v).sum() / (centred * centred).sum()
    if abs(A) > limits.A:  # a later start in the same gap has a smaller A
        X[6] = min(T1 + np.log(abs(A) / limits.A) / tau, limits.T1, fold.x[a] - t0 - folding.CLEARANCE_S)
        unit = signature(t, X, timing)
        A = np.clip(A, -limits.A, limits.A)
    X[0], X[4] = A, v.mean() - A * unit.mean()
    return X


def global_fit(recording: Recording, protocol: Protocol | None = None) -> GlobalFit:
    """Find the signature with the least misfit to a record, in the box of a protocol: by default the authors' notebook.

    ValueError if T_d is not half of T_f, or the record is too short, constant, or sampled too rarely for any window.
    """
    protocol = Protocol() if protocol is None else protocol
    t, v = recording.t, recording.v
    if t[-1] - t[0] < protocol.T_d or v.max() == v.min():
        raise ValueError(f"{recording.source}: shorter than half a turn, or constant: there is no signature to fit")
    box, timing = protocol_box(recording, protocol), protocol.timing
    A, t0, tau, omega, _, T2, T1 = zip(box.lower.tolist(), box.upper.tolist(), strict=True)
    limits = Limits(A[1], t0[0], T1[1], T2[1], tau, omega)
    fold, minima = _minima(t, v, timing, limits)
    if not minima:
        raise ValueError(f"{recording.source}: {t.size} samples are too few for the signature's windows; sample faster")
    a, b, theta, cost = minima[0]
    interval = _amplitude_interval(fold, limits, a, b, theta)
    X = _parameters(recording, timing, limits, fold, minima[0])
    others = (_parameters(recording, timing, limits, fold, m) for m in minima[1:] if m[3] < 1.01**2 * cost)
    near = np.minimum(X - box.lower, box.upper - X) <= 1e-6 * (box.upper - box.lower)
    return GlobalFit(
        X,
        float(population_rmse(t, v, X[None, :], timing)[0]),
        float(abs(X[0]) * np.exp(X[2] * (X[1] + X[6] - middle_of_gap(fold, a)))),
        interval,
        tuple(name for name, bound in zip(FREE_PARAMETERS, near, strict=True) if bound),
        bool(X[0] < 0),
        tuple(float(abs(other[0])) for other in others if not interval[0] <= abs(other[0]) <= interval[1]),
    )
