"""The misfit of a whole population of signatures: the paper's cost, equal to `signature.rmse` but for rounding.

Where the turn is a whole number of samples, all windows of a signature hold the same values: on a
record that `fold` has summed over them, a member of the population costs one window instead of 2 n.
What these sums cannot tell is computed window by window: `signature.rmse` takes a hundred times as
long, and a run that converges to t0 = T1 = 0 needs it for all members, because rounding decides there
which samples a window holds.
"""

from typing import NamedTuple

import numpy as np

from replication.arrays import FloatArray
from replication.compiling import njit
from replication.residual import oscillate, residual, sum_in_order
from replication.signature import Timing

# A smaller share of the record's square, left over by a difference, has lost digits.
CANCELLED = 1e-3


class Sums(NamedTuple):
    """A record's sums over the windows of a signature.

    The arrays are over the sample at which a window's first, positive oscillation has a value, all
    turns together.
    """

    dt: float
    mean: float
    square: float  # sum of (v - mean)^2
    tie: float  # how close to a sample [samples] rounding decides anew in each turn whether a window holds it
    half: int  # samples of T_d
    turn: int  # and of T_f
    value: FloatArray  # v - mean in the positive windows, less that in the negative ones
    sign: (
        FloatArray  # number of positive windows that are in the record, less that of negative ones
    )
    both: FloatArray  # number of positive and negative ones
    in_turn: FloatArray  # windows in which a long oscillation meets its own turn's other one
    in_next: FloatArray  # and the next turn's first one


class FoldedRecord(NamedTuple):
    """An evenly sampled record, v in any unit, and its sums where it can be folded."""

    t: FloatArray
    v: FloatArray
    timing: Timing
    sums: Sums | None


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
    dt = (t[-1] - t[0]) / (t.size - 1)
    half, turn = round(timing.T_d / dt), round(timing.T_f / dt)
    rounding = 1e-15 * max(abs(t[0]), abs(t[-1]))
    uneven = np.ptp(t - t[0] - dt * np.arange(t.size))
    off_half = abs(half * dt - timing.T_d)
    off_last_turn = abs(timing.n * (turn * dt - timing.T_f))
    if max(uneven, off_half, off_last_turn) > rounding or not 0 < half < turn:
        return FoldedRecord(t, v, timing, None)
    return FoldedRecord(t, v, timing, _sums(t, v, timing.n, half, turn, 4 * rounding / dt))


def _sums(t: FloatArray, v: FloatArray, n: int, half: int, turn: int, tie: float) -> Sums:
    size, mean = t.size, float(v.mean())
    r = np.zeros(size + half + n * turn)
    r[:size] = v - mean
    there = np.zeros(r.size)
    there[:size] = 1.0
    value = _sum_over_turns(r, n, turn, size + half)
    count = _sum_over_turns(there, n, turn, size + half)
    positive, negative = count[:size], count[half:]
    return Sums(
        dt=float((t[-1] - t[0]) / (size - 1)),
        mean=mean,
        square=float((r**2).sum()),
        tie=float(tie),
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


def population_rmse(members: FloatArray, record: FoldedRecord) -> FloatArray:
    """Misfits of members of shape (members, 7), in the unit of v."""
    squares = np.full(len(members), -1.0)
    if record.sums is not None:
        squares = _squares(np.ascontiguousarray(members), record.t, record.sums)
    misfits = np.sqrt(np.maximum(squares, 0.0) / record.t.size)
    for p in np.flatnonzero(squares < 0):
        error = residual(record.t, record.v, members[p], record.timing)
        misfits[p] = np.sqrt(sum_in_order(error * error) / record.t.size)
    return misfits


@njit
def _squares(members, t, sums):
    """Sums of squares of r - h; negative where the sums over the windows do not tell them exactly."""
    squares = np.empty(members.shape[0])
    scratch = np.empty((3, t.size))
    for p in range(squares.size):
        squares[p] = _square(members[p], t, sums, scratch)
    return squares


@njit
def _square(member, t, sums, scratch):
    A, t0, tau, omega, v_t, T2, T1 = member  # the order of `Parameters`
    dt = sums.dt
    begin = (t0 - t[0] + T1) / dt
    end = (t0 - t[0] + T2) / dt
    if abs(begin - np.rint(begin)) < sums.tie or abs(end - np.rint(end)) < sums.tie:
        return -1.0
    first = int(np.ceil(begin))
    last = min(int(np.floor(end)) + 1, t.size)
    length = last - first
    level = v_t - sums.mean
    square = sums.square + t.size * level * level
    if length <= 0:
        return square
    if first < 0 or length > sums.turn:
        return -1.0
    elapsed = t[first] - t0
    oscillate(scratch, length, A * np.exp(-(elapsed - T1) * tau), omega * elapsed, tau, omega, dt)
    h, part = scratch[1, :length], scratch[2, :length]
    value, sign = sums.value[first:last], sums.sign[first:last]
    both = sums.both[first:last]
    for j in range(length):
        part[j] = h[j] * (both[j] * h[j] - 2 * (value[j] - level * sign[j]))
    # A window longer than half a turn overlaps its own turn's other one or the next turn's first.
    _subtract_overlap(part, h, sums.in_turn[first:last], sums.half)
    _subtract_overlap(part, h, sums.in_next[first:last], sums.turn - sums.half)
    square += sum_in_order(part)
    return square if square > CANCELLED * sums.square else -1.0


@njit
def _subtract_overlap(part, h, windows, delay):
    """Subtract what two oscillations of opposite sign, a delay [samples] apart, have in common."""
    for j in range(delay, part.size):
        part[j] -= 2 * windows[j] * h[j] * h[j - delay]
