"""The misfit of a whole population of signatures: the fast twin of `signature.rmse`, equal to it but for rounding.

Where the turn is a whole number of samples, all windows of a signature hold the same values: on a
record that `fold` has summed over them, a member of the population costs one window instead of 2 n.
"""

from typing import NamedTuple

import numpy as np

from replication.arrays import FloatArray
from replication.compiled.cache import njit
from replication.signature import Timing

# A smaller share of the record's square, left over by a difference, has lost digits.
CANCELLED = 1e-3


NOT_FOLDED = np.empty(0)


class FoldedRecord(NamedTuple):
    """An evenly sampled record, and its sums over the windows of a signature if it is folded."""

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
    # For the sample at which a window's first, positive oscillation has a value, over all turns:
    # Sum of v - mean in the positive windows, less that in the negative ones.
    value: FloatArray = NOT_FOLDED
    # Number of positive windows that are in the record, less that of negative ones.
    sign: FloatArray = NOT_FOLDED
    both: FloatArray = NOT_FOLDED  # number of positive and negative ones
    # Windows in which a long oscillation meets its own turn's other one.
    in_turn: FloatArray = NOT_FOLDED
    in_next: FloatArray = NOT_FOLDED  # and the next turn's first one


def unfolded(t: FloatArray, v: FloatArray, timing: Timing) -> FoldedRecord:
    """A record as it is, for a few members: each of their windows is gone through."""
    dt = (t[-1] - t[0]) / (t.size - 1)
    return FoldedRecord(t, v, float(timing.T_d), float(timing.T_f), timing.n, dt)


def fold(t: FloatArray, v: FloatArray, timing: Timing) -> FoldedRecord:
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
    rounding = 1e-15 * max(abs(t[0]), abs(t[-1]))
    uneven = np.ptp(t - t[0] - dt * np.arange(t.size))
    off_half = abs(half * dt - timing.T_d)
    off_last_turn = abs(n * (turn * dt - timing.T_f))
    if max(uneven, off_half, off_last_turn) > rounding or not 0 < half < turn:
        return record
    size, mean = t.size, float(v.mean())
    r = np.zeros(size + half + n * turn)
    r[:size] = v - mean
    there = np.zeros(r.size)
    there[:size] = 1.0
    value = _sum_over_turns(r, n, turn, size + half)
    count = _sum_over_turns(there, n, turn, size + half)
    positive, negative = count[:size], count[half:]
    return record._replace(
        mean=mean,
        square=float((r**2).sum()),
        tie=4 * rounding / dt,
        half=half,
        turn=turn,
        value=value[:size] - value[half:],
        sign=positive - negative,
        both=positive + negative,
        in_turn=positive,
        in_next=np.minimum(negative, max(n - 1, 0)),
    )


def _sum_over_turns(x: FloatArray, n: int, turn: int, size: int) -> FloatArray:
    """Add up x from each of n turns on, the first `size` values of each."""
    total = np.zeros(size)
    for i in range(n):
        total += x[i * turn :][:size]
    return total


def population_rmse(
    t: FloatArray, v: FloatArray, population: FloatArray, timing: Timing
) -> FloatArray:
    """Misfits [rps] of a population of shape (members, 7) on an evenly sampled record, not folded."""
    return folded_rmse(np.ascontiguousarray(population), unfolded(t, v, timing))


def residual(t: FloatArray, v: FloatArray, X: FloatArray, timing: Timing) -> FloatArray:
    """Residual r(t) - h(t) [rps] of an evenly sampled record, shape (samples,)."""
    return _subtract(np.ascontiguousarray(X), unfolded(t, v, timing), np.empty((3, t.size)))


@njit
def folded_rmse(members, record):
    """Misfits of members of shape (members, 7), in the unit of v: by the sums, or window by window."""
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
    """Sum of squares of r - h by the sums over the windows.

    Negative where they do not tell it exactly.
    """
    A, t0, tau, omega, v_t, T2, T1 = member
    t, dt = record.t, record.dt
    begin = (t0 - t[0] + T1) / dt
    end = (t0 - t[0] + T2) / dt
    if (
        record.turn == 0
        or abs(begin - np.rint(begin)) < record.tie
        or abs(end - np.rint(end)) < record.tie
    ):
        return -1.0
    first = int(np.ceil(begin))
    last = min(int(np.floor(end)) + 1, t.size)
    length = last - first
    level = v_t - record.mean
    square = record.square + t.size * level * level
    if length <= 0:
        return square
    if first < 0 or length > record.turn:
        return -1.0
    elapsed = t[first] - t0
    _oscillate(scratch, length, A * np.exp(-(elapsed - T1) * tau), omega * elapsed, tau, omega, dt)
    h, part = scratch[1, :length], scratch[2, :length]
    value, sign = record.value[first:last], record.sign[first:last]
    both = record.both[first:last]
    for j in range(length):
        part[j] = h[j] * (both[j] * h[j] - 2 * (value[j] - level * sign[j]))
    # A window longer than half a turn overlaps its own turn's other one or the next turn's first.
    _subtract_overlap(part, h, record.in_turn[first:last], record.half)
    _subtract_overlap(part, h, record.in_next[first:last], record.turn - record.half)
    square += _total(part)
    return square if square > CANCELLED * record.square else -1.0


@njit
def _subtract_overlap(part, h, windows, delay):
    """Subtract what two oscillations of opposite sign, a delay [samples] apart, have in common."""
    for j in range(delay, part.size):
        part[j] -= 2 * windows[j] * h[j] * h[j - delay]


@njit
def _subtract(X, record, scratch):
    """Residual r - h, one window after the other; the last row of `scratch`."""
    A, t0, tau, omega, v_t, T2, T1 = X
    t, dt = record.t, record.dt
    c, s = scratch[0], scratch[1]
    error = scratch[2]
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
            a = amplitude * np.sin(phase)
            b = amplitude * np.cos(phase)
            part = error[first:last]
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
    """First values of a damped cosine and sine into two rows.

    A block turned on by its own length is the next block.
    """
    c, s = rows[0], rows[1]
    c[0] = amplitude * np.cos(phase)
    s[0] = amplitude * np.sin(phase)
    decay = np.exp(-tau * dt)
    x = decay * np.cos(omega * dt)
    y = decay * np.sin(omega * dt)
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
    """Sum by four running sums, in the same order on every processor: no addition waits for another."""
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
