"""Windows that start or end exactly on a sample, where rounding decides turn by turn what they hold.

Whether t0 + i T_f + T1 <= t <= t0 + i T_f + T2 holds for a sample on a gate depends on the last bits of these sums.
A signature made on a computer has such gates if its window starts or ends on a sample. And where T1 or T2 is pressed
against its bound, the paper's cost has this freedom in any record, and CMA-ES runs use it.
"""

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from replication.global_fit.folding import Fold, Limits, descend, latest_t0, t0_range
from replication.global_fit.windows import refine
from replication.signature import Timing

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# Steps of t0 that round t0 + i T_f + T_d in all possible ways if T_d is 0.125 s or more.
_STEP_S = 2.0**-57

# A gate lies on a sample if that explains so many times what noise holds in the samples there.
_BEYOND_NOISE = 4.0


class Fit(NamedTuple):
    """A minimum of the misfit, and which windows hold the samples on its gates.

    Attributes
    ----------
    a, b : int
        First and last position of the windows.
    theta : array of shape (3,)
        t0, tau and omega.
    cost : float
        Sum of squares [rps^2].
    holds_a, holds_b : bool arrays of shape (2 n,), or None
        Which windows hold position a, and b; None if all do, because the gate lies between two samples.
    T1, T2 : float or None
        Start and end of the windows after t0 [s] to the last bit, if the gate lies on a sample.
    """

    a: int
    b: int
    theta: FloatArray
    cost: float
    holds_a: BoolArray | None = None
    holds_b: BoolArray | None = None
    T1: float | None = None
    T2: float | None = None


class Record(NamedTuple):
    """A record, its fold and the box."""

    t: FloatArray
    v: FloatArray
    timing: Timing
    limits: Limits
    fold: Fold


def _members(record: Record, position: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Windows that have a sample on a position, and these samples."""
    t, dt = record.t, (record.t[-1] - record.t[0]) / (record.t.size - 1)
    windows = np.arange(2 * record.timing.n)
    place = (record.fold.x[position] - t[0] + windows * record.timing.T_d) / dt
    samples = np.round(place).astype(np.int64)
    there = (np.abs(place - samples) < 1e-6) & (samples < t.size)
    return windows[there], samples[there]


@numba.njit(cache=True)
def _unit_signature(t, T_d, windows, first, last, theta, dt):
    """The signature with A = 1 at the first position, its windows holding the instants from `first` to `last`."""
    unit = np.zeros(t.size)
    t0, tau, omega = theta
    for m in range(windows):
        start = first + m * T_d
        for k in range(max(0, int(np.ceil((start - t[0]) / dt - 1e-6))), t.size):
            since = t[k] - m * T_d
            if since > last + 1e-6 * dt:
                break
            wave = np.exp(-tau * (since - first)) * np.sin(omega * (since - t0))
            unit[k] += wave if m % 2 == 0 else -wave
    return unit


def _waves(record: Record, fit: Fit, position: int) -> FloatArray:
    """What each window with A = 1 at position a has on a position."""
    t0, tau, omega = fit.theta
    x = record.fold.x
    wave = np.exp(-tau * (x[position] - x[fit.a])) * np.sin(omega * (x[position] - t0))
    return np.where(np.arange(2 * record.timing.n) % 2, -wave, wave)


def _residual(record: Record, fit: Fit) -> tuple[FloatArray, float]:
    """What a fit leaves of the record, and its A at position a."""
    t, v, x = record.t, record.v, record.fold.x
    dt = (t[-1] - t[0]) / (t.size - 1)
    unit = _unit_signature(t, record.timing.T_d, 2 * record.timing.n, x[fit.a], x[fit.b], fit.theta, dt)
    for position, holds in ((fit.a, fit.holds_a), (fit.b, fit.holds_b)):
        if holds is not None:
            windows, samples = _members(record, position)
            unit[samples] -= np.where(holds[windows], 0.0, _waves(record, fit, position)[windows])
    centred = unit - unit.mean()
    power = (centred * centred).sum()
    A = np.clip((centred * v).sum() / power, -record.limits.A, record.limits.A) if power > 0 else 0.0
    return v - v.mean() - A * centred, float(A)


def _gains(record: Record, fit: Fit, residual: FloatArray, A: float, position: int, held: BoolArray) -> FloatArray:
    """By how much the sum of squares falls if a window holds its sample on a position, against if it does not."""
    windows, samples = _members(record, position)
    wave = A * _waves(record, fit, position)[windows]
    without = residual[samples] + np.where(held[windows], wave, 0.0)
    gains = np.zeros(held.size)
    gains[windows] = without**2 - (without - wave) ** 2
    return gains


def part_fold(record: Record, fit: Fit) -> Fold:
    """The fold of a record without the samples that the windows of a fit leave out on its gates."""
    fold, count = record.fold, 2 * record.timing.n
    part = fold._replace(
        value=fold.value.copy(), count=fold.count.copy(), sign=fold.sign.copy(), pairs=fold.pairs.copy()
    )
    centred = record.v - record.v.mean()
    everyone = np.ones(count, dtype=bool)
    holds_a = everyone if fit.holds_a is None else fit.holds_a
    holds_b = everyone if fit.holds_b is None else fit.holds_b
    for position, holds in ((fit.a, holds_a), (fit.b, holds_b)):
        windows, samples = _members(record, position)
        inside = holds[windows].astype(float)
        signs = np.where(windows % 2, -1.0, 1.0) * inside
        part.value[position] = (signs * centred[samples]).sum()
        part.count[position], part.sign[position] = inside.sum(), signs.sum()
    # A sample on position a of window m lies half a turn on in window m - 1.
    windows, _ = _members(record, fit.a)
    later = windows[windows > 0]
    before = holds_b[later - 1] if fold.partner[fit.a] == fit.b else everyone[later]
    part.pairs[fit.a] = (holds_a[later] & before).sum()
    if fold.inverse[fit.b] > fit.a:
        windows, _ = _members(record, fold.inverse[fit.b])
        part.pairs[fold.inverse[fit.b]] = holds_b[windows[windows > 0] - 1].sum()
    return part


@numba.njit(cache=True)
def _last_distance(start, instant, opens):
    """The distance T at which a gate at start + T, rounded, just still holds a sample, as it opens or closes there.

    It is the largest T with start + T <= instant for a gate that opens, the smallest with start + T >= instant for
    one that closes.
    """
    step = 2.0**-52 * max(instant, start) * (1.0 if opens else -1.0)
    held, not_held = instant - start - step, instant - start + step
    while True:
        middle = held + (not_held - held) / 2
        if middle in (held, not_held):
            return held
        if (start + middle <= instant) if opens else (start + middle >= instant):
            held = middle
        else:
            not_held = middle


@numba.njit(cache=True)
def _best_distance(starts, instants, gains, opens):
    """The distance T whose rounded gates hold the windows that gain most, and that gain; NaN instants are no sample."""
    distances = np.full(starts.size, np.nan)
    for m in range(starts.size):
        if not np.isnan(instants[m]):
            distances[m] = _last_distance(starts[m], instants[m], opens)
    best, T = -np.inf, np.nan
    for candidate in distances:
        gain = 0.0
        for m in range(starts.size):
            if (distances[m] >= candidate) if opens else (distances[m] <= candidate):
                gain += gains[m]
        if gain > best and not np.isnan(candidate):
            best, T = gain, candidate
    return T, max(best, 0.0)


@numba.njit(cache=True)
def _window_starts(t0, T_d, T_f, windows):
    """Starts of the windows, rounded as equations 6 and 7 round them."""
    starts = np.empty(windows)
    for m in range(windows):
        starts[m] = t0 + (m // 2) * T_f
        if m % 2:
            starts[m] += T_d
    return starts


@numba.njit(cache=True)
def _last_bits(t0, T_d, T_f, instants, gains, steps):
    """The t0 next to a given one, T1 and T2 whose rounded gates hold the windows that gain most; that gain first.

    Rows of `instants` and `gains` are the start and the end; NaN where no gate lies on a sample. So many `steps` of t0
    are tried.
    """
    best, best_t0, T1, T2, trial = -np.inf, t0, np.nan, np.nan, np.nan
    for step in range(steps):
        before, trial = trial, (np.floor(t0 / _STEP_S) + step) * _STEP_S
        if trial == before:  # t0 has no finer bits
            continue
        starts = _window_starts(trial, T_d, T_f, instants.shape[1])
        trial_T1, gain_a = _best_distance(starts, instants[0], gains[0], True)
        trial_T2, gain_b = _best_distance(starts, instants[1], gains[1], False)
        if gain_a + gain_b > best:
            best, best_t0, T1, T2 = gain_a + gain_b, trial, trial_T1, trial_T2
    return best, best_t0, T1, T2


def _limits(record: Record, fit: Fit) -> Limits:
    """The box, for windows that start on position a and not anywhere in the gap before it if their gate lies there."""
    if fit.holds_a is None or fit.a == 0:
        return record.limits
    return record.limits._replace(T1=record.limits.T1 - (record.fold.x[fit.a] - record.fold.x[fit.a - 1]))


def _refine(record: Record, fit: Fit) -> Fit | None:
    """Refine a fit with its gates on samples held, the others free; None if the box does not let it stand."""
    part, limits = part_fold(record, fit), _limits(record, fit)
    t0 = latest_t0(part, limits, fit.a, fit.b, fit.theta[0], fit.theta[2])
    if np.isnan(t0):
        return None
    theta = np.array([t0, *fit.theta[1:]])
    held = fit.holds_a is not None, fit.holds_b is not None
    a, b, theta, cost = refine(part, limits, fit.a, fit.b, theta, 30, 5, *held)
    return fit._replace(a=int(a), b=int(b), theta=theta, cost=cost)


def _rounded(record: Record, fit: Fit, instants_t0: FloatArray) -> Fit:
    """Choose the last bits of t0, near one of those given, T1 and T2, and refine with the windows that these hold."""
    timing, windows = record.timing, 2 * record.timing.n
    instants, gains = np.full((2, windows), np.nan), np.zeros((2, windows))
    residual, A = _residual(record, fit)
    for edge, (position, holds) in enumerate(((fit.a, fit.holds_a), (fit.b, fit.holds_b))):
        if holds is not None:
            there, samples = _members(record, position)
            instants[edge, there] = record.t[samples]
            gains[edge] = _gains(record, fit, residual, A, position, holds)
    steps = round(2 * np.spacing(record.t[-1]) / _STEP_S)  # after two last bits of the latest sum, roundings repeat
    bits = [_last_bits(t0, timing.T_d, timing.T_f, instants, gains, steps) for t0 in instants_t0]
    _, t0, T1, T2 = max(bits, key=lambda found: found[0])
    starts = _window_starts(t0, timing.T_d, timing.T_f, windows)
    if fit.holds_a is not None:
        fit = fit._replace(T1=T1, holds_a=instants[0] >= starts + T1)
    if fit.holds_b is not None:
        fit = fit._replace(T2=T2, holds_b=instants[1] <= starts + T2)
    theta = np.array([t0, *fit.theta[1:]])
    theta, cost = descend(part_fold(record, fit), _limits(record, fit), fit.a, fit.b, theta, 30, True)
    return fit._replace(theta=theta, cost=cost)


def _shown(record: Record, before: Fit, cost: float, samples: int) -> bool:
    """Whether a fall of the sum of squares is more than noise in some samples could cause, and than rounding."""
    noise = max(cost, 0.0) / record.t.size
    return before.cost - cost > max(_BEYOND_NOISE * samples * noise, 1e-14 * record.fold.scale[0])


def _better_gate(record: Record, fit: Fit) -> Fit | None:
    """The fit with the gate that the record shows most clearly to lie on a sample; None if it shows none."""
    nobody, everyone = np.zeros(2 * record.timing.n, dtype=bool), np.ones(2 * record.timing.n, dtype=bool)
    residual, A = _residual(record, fit)
    most, trial = 0.0, None
    for edge, position in (("a", fit.a), ("a", fit.a - 1), ("b", fit.b), ("b", fit.b + 1)):
        held, outside = getattr(fit, f"holds_{edge}"), position not in (fit.a, fit.b)
        if not 0 <= position < record.fold.x.size or (outside and held is not None):
            continue
        held = nobody if outside else everyone if held is None else held
        gains = _gains(record, fit, residual, A, position, held)
        fall = np.maximum(gains, 0.0).sum() - gains[held].sum()
        if fall > most and _shown(record, fit, fit.cost - fall, np.count_nonzero(gains)):
            most, trial = fall, fit._replace(**{edge: position, f"holds_{edge}": gains > 0})
    better = None if trial is None else _refine(record, trial)
    return better if better and _shown(record, fit, better.cost, 2 * record.timing.n) else None


def on_samples(record: Record, fit: Fit) -> Fit:
    """Put a fit's gates on samples if the record shows that they lie there: if noise could not explain the gain.

    Parameters
    ----------
    record : Record
        The record.
    fit : Fit
        Its best fit with gates between samples.

    Returns
    -------
    Fit
        The same one if the record does not show it.
    """
    found = fit
    for _ in range(6):
        better = _better_gate(record, found)
        if better is None:
            break
        found = better
    if found is fit:
        return fit
    half, low = np.pi / found.theta[2], t0_range(record.fold, _limits(record, found), found.a, found.b)[0]
    turned = np.arange(max(0, int((found.theta[0] - low) / half)) + 1)  # half oscillations; each rounds its own way
    found = _rounded(record, found, found.theta[0] - half * turned)
    return found if _shown(record, fit, found.cost, 2 * record.timing.n) else fit


def at_bound(record: Record, fit: Fit) -> Fit:
    """End the windows on a sample if t0 is at its lowest, as where T2 is pressed against its bound, and that is better.

    Parameters
    ----------
    record : Record
        The record.
    fit : Fit
        Its best fit with gates between samples.

    Returns
    -------
    Fit
        The same one if t0 is not at its lowest, or nothing is gained.
    """
    fold, limits, best = record.fold, record.limits, fit
    for b in (fit.b, fit.b + 1):
        if b >= fold.x.size:
            break
        low, high = t0_range(fold, limits, fit.a, b)
        if b <= fit.a or not low <= high or abs(fit.theta[0] - low) > fold.x[fold.classes] - fold.x[0]:
            continue
        theta, cost = descend(fold, limits, fit.a, b - 1, np.array([low, *fit.theta[1:]]), 8, True)
        nobody = np.zeros(2 * record.timing.n, dtype=bool)
        trial = _rounded(record, Fit(fit.a, b, theta, cost, holds_b=nobody), np.array([low]))
        if trial.cost < best.cost - 1e-14 * fold.scale[0]:
            best = trial
    return best
