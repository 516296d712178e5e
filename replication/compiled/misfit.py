"""The misfit of a whole population of signatures: the fast twin of `signature.rmse`, equal to it but for rounding.

Where the turn is a whole number of samples, all windows of a signature hold the same values: on a record that `fold`
has summed over them, a member of the population costs one window instead of 2 n.
"""

from typing import NamedTuple

import numpy as np

from replication.arrays import FloatArray
from replication.compiled.cache import njit
from replication.signature import Timing

CANCELLED = 1e-3  # a smaller share of the record's square, left over by a difference, has lost digits


class Fold(NamedTuple):
    """An evenly sampled record, and its sums over the windows of a signature where they are folded."""

    t: FloatArray
    v: FloatArray  # in any unit
    T_d: float
    T_f: float
    n: int
    dt: float
    mean: float = 0.0
    square: float = 0.0  # sum of (v - mean)^2
    tie: float = 0.0  # how close to a sample [samples] rounding decides anew in each turn whether a window holds it
    half: int = 0  # samples of T_d and of T_f; 0 if nothing is folded
    turn: int = 0
    # For the sample at which a window's first, positive oscillation has a value: sum of v - mean over all windows, less
    # that over the negative ones; number of windows there, less that of the negative ones; number of both; windows in
    # which a long oscillation meets its own turn's other one, and the next turn's first one.
    sums: FloatArray = np.empty((5, 0))


def unfolded(t: FloatArray, v: FloatArray, timing: Timing) -> Fold:
    """A record as it is, for the misfits of a few members: each of their windows is gone through."""
    return Fold(t, v, float(timing.T_d), float(timing.T_f), timing.n, (t[-1] - t[0]) / (t.size - 1))


def fold(t: FloatArray, v: FloatArray, timing: Timing) -> Fold:
    """Fold an evenly sampled record if T_d < T_f and both are whole numbers of samples.

    Raises
    ------
    ValueError
        A sample is not finite, T_d or T_f is not above 0, or the record is shorter than one turn.
    """
    if not (timing.T_d > 0 and timing.T_f > 0):
        raise ValueError(f"T_d = {timing.T_d} s, T_f = {timing.T_f} s: both must lie above 0")
    if not (np.isfinite(t).all() and np.isfinite(v).all()):
        raise ValueError("the record holds a time or a speed that is not finite")
    if t.size < 2 or t.size * (t[-1] - t[0]) / (t.size - 1) < (1 - 1e-9) * timing.T_f:
        raise ValueError(f"the record is shorter than one turn of {timing.T_f} s")
    record = unfolded(t, v, timing)
    dt, n = record.dt, timing.n
    half, turn = round(timing.T_d / dt), round(timing.T_f / dt)
    off = np.abs([half * dt - timing.T_d, n * (turn * dt - timing.T_f), np.ptp(t - t[0] - dt * np.arange(t.size))])
    rounding = 1e-15 * max(abs(t[0]), abs(t[-1]))
    if off.max() > rounding or not 0 < half < turn:
        return record
    mean, size = float(v.mean()), t.size
    r, there = np.zeros((2, size + half + n * turn))
    r[:size], there[:size] = v - mean, 1.0
    value, count = (sum((x[i * turn :][: size + half] for i in range(n)), np.zeros(size + half)) for x in (r, there))
    first, second = count[:size], count[half:]
    following = np.minimum(second, max(n - 1, 0))
    sums = np.array([value[:size] - value[half:], first - second, first + second, first, following])
    square = float((r**2).sum())
    return record._replace(mean=mean, square=square, tie=4 * rounding / dt, half=half, turn=turn, sums=sums)


def population_rmse(t: FloatArray, v: FloatArray, population: FloatArray, timing: Timing) -> FloatArray:
    """Misfits [rps] of a population of shape (members, 7) on an evenly sampled record, not folded."""
    return folded_rmse(np.ascontiguousarray(population), unfolded(t, v, timing))


def residual(t: FloatArray, v: FloatArray, X: FloatArray, timing: Timing) -> FloatArray:
    """Residual r(t) - h(t) [rps] of an evenly sampled record, shape (samples,)."""
    return _subtract(np.ascontiguousarray(X), unfolded(t, v, timing), np.empty((3, t.size)))


@njit
def folded_rmse(members, record):
    """Misfits of members of shape (members, 7), in the unit of v: by sums where they tell it, else window by window."""
    misfits = np.empty(members.shape[0])
    scratch = np.empty((3, record.t.size))
    for p in range(misfits.size):
        square = _square_by_sums(members[p], record, scratch)
        if square < 0.0:
            error = _subtract(members[p], record, scratch)
            for k in range(error.size):
                error[k] *= error[k]
            square = _total(error)
        misfits[p] = np.sqrt(square / record.t.size)
    return misfits


@njit
def _square_by_sums(member, record, scratch):
    """Sum of squares of r - h by the sums over the windows; negative where they do not tell it exactly."""
    A, t0, tau, omega, v_t, T2, T1 = member
    t, dt, half, turn = record.t, record.dt, record.half, record.turn
    begin, end = (t0 - t[0] + T1) / dt, (t0 - t[0] + T2) / dt
    if turn == 0 or abs(begin - np.rint(begin)) < record.tie or abs(end - np.rint(end)) < record.tie:
        return -1.0
    first = int(np.ceil(begin))
    last = min(int(np.floor(end)) + 1, t.size)
    length, level = last - first, v_t - record.mean
    square = record.square + t.size * level * level
    if length <= 0:
        return square
    if first < 0 or length > turn:
        return -1.0
    elapsed = t[first] - t0
    _oscillate(scratch, length, A * np.exp(-(elapsed - T1) * tau), omega * elapsed, tau, omega, dt)
    h, part = scratch[1, :length], scratch[2, :length]
    value, sign, count = record.sums[0, first:last], record.sums[1, first:last], record.sums[2, first:last]
    for j in range(length):
        part[j] = h[j] * (count[j] * h[j] - 2 * (value[j] - level * sign[j]))
    # A window longer than half a turn overlaps its own turn's other one or the next turn's first, of the other sign.
    for delay, windows in ((half, record.sums[3, first:last]), (turn - half, record.sums[4, first:last])):
        if length > delay:
            part[delay:] -= 2 * windows[delay:] * h[delay:] * h[: length - delay]
    square += _total(part)
    return square if square > CANCELLED * record.square else -1.0


@njit
def _subtract(X, record, scratch):
    """Residual r - h, one window after the other; the last row of `scratch`."""
    A, t0, tau, omega, v_t, T2, T1 = X
    t, dt, c, s, error = record.t, record.dt, scratch[0], scratch[1], scratch[2]
    for k in range(t.size):
        error[k] = record.v[k] - v_t
    length = int(min(max((T2 - T1) / dt + 2.0, 1.0), float(t.size)))
    _oscillate(scratch, length, 1.0, 0.0, tau, omega, dt)
    for i in range(2 * record.n):
        start = t0 + i // 2 * record.T_f + (i % 2) * record.T_d
        first = _first_at_or_after(t, start + T1, dt)
        last = min(first + length, t.size)
        while last > first and t[last - 1] > start + T2:
            last -= 1
        if last > first:
            amplitude = (1 - 2 * (i % 2)) * A * np.exp(-(t[first] - (start + T1)) * tau)
            phase = omega * (t[first] - start)
            a, b, part = amplitude * np.sin(phase), amplitude * np.cos(phase), error[first:last]
            for j in range(part.size):
                part[j] -= a * c[j] + b * s[j]
    return error


@njit
def _first_at_or_after(t, instant, dt):
    """Index of the first sample with t[k] >= instant (t.size if there is none), on an even grid."""
    k = int(min(max(np.ceil((instant - t[0]) / dt), 0.0), float(t.size)))
    while k > 0 and t[k - 1] >= instant:
        k -= 1
    while k < t.size and t[k] < instant:
        k += 1
    return k


@njit
def _oscillate(rows, length, amplitude, phase, tau, omega, dt):
    """First values of a damped cosine and sine into two rows; a block turned on by its own length is the next block."""
    c, s = rows[0], rows[1]
    c[0], s[0] = amplitude * np.cos(phase), amplitude * np.sin(phase)
    decay = np.exp(-tau * dt)
    x, y = decay * np.cos(omega * dt), decay * np.sin(omega * dt)
    known = 1
    while known < length:
        next_c, next_s = c[known : min(2 * known, length)], s[known : min(2 * known, length)]
        for j in range(next_c.size):
            next_c[j] = c[j] * x - s[j] * y
            next_s[j] = c[j] * y + s[j] * x
        x, y = x * x - y * y, 2 * x * y
        known *= 2


@njit
def _total(x):
    """Sum by four running sums: additions do not wait for one another, in the same order on every processor."""
    a = b = c = d = 0.0
    blocks = x.size // 4 * 4
    for k in range(0, blocks, 4):
        a += x[k]
        b += x[k + 1]
        c += x[k + 2]
        d += x[k + 3]
    for k in range(blocks, x.size):
        a += x[k]
    return (a + b) + (c + d)
