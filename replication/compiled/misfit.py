"""The misfit of a whole population of signatures: the fast twin of `signature.rmse`.

Equal to `rmse` but for rounding, for windows that overlap, lie partly or wholly outside the record, or are empty.
"""

import numba
import numpy as np

from replication.arrays import FloatArray
from replication.compiled.folded import Fold, unfolded
from replication.signature import Timing

CANCELLED = 1e-3  # a smaller share of the record's square, left over by a difference, has lost digits


def folded_rmse(members: FloatArray, record: Fold) -> FloatArray:
    """Misfits of members of shape (members, 7), in the unit of v, on a record from `folded.fold`."""
    return _misfits(np.ascontiguousarray(members), record)


def population_rmse(t: FloatArray, v: FloatArray, population: FloatArray, timing: Timing) -> FloatArray:
    """Misfits [rps] of a population of shape (members, 7) on an evenly sampled record, not folded."""
    return _misfits(np.ascontiguousarray(population), unfolded(t, v, timing))


def residual(t: FloatArray, v: FloatArray, X: FloatArray, timing: Timing) -> FloatArray:
    """Residual r(t) - h(t) [rps] of an evenly sampled record, shape (samples,)."""
    scratch = np.empty((3, t.size))
    _subtract(np.ascontiguousarray(X), unfolded(t, v, timing), scratch)
    return scratch[2]


@numba.njit(cache=True)
def _misfits(members, record):
    """Compiled body of `folded_rmse`: by the sums of the record where they tell the misfit, else window by window."""
    misfit = np.empty(members.shape[0])
    scratch = np.empty((3, record.t.size))
    for p in range(members.shape[0]):
        square = _by_sums(members[p], record, scratch) if record.turn > 0 else -1.0
        if square < 0.0:
            _subtract(members[p], record, scratch)
            error = scratch[2]
            for k in range(error.size):
                error[k] *= error[k]
            square = _total(error)
        misfit[p] = np.sqrt(square / record.t.size)
    return misfit


@numba.njit(cache=True)
def _by_sums(member, record, scratch):
    """Sum of squares of r - h by the sums over the windows; negative where they do not tell it exactly."""
    A, t0, tau, omega, v_t, T2, T1 = member
    t, dt, half, turn = record.t, record.dt, record.half, record.turn
    begin, end = (t0 - t[0] + T1) / dt, (t0 - t[0] + T2) / dt
    if abs(begin - np.rint(begin)) < record.tie or abs(end - np.rint(end)) < record.tie:
        return -1.0
    first = int(np.ceil(begin))
    length = min(int(np.floor(end)), t.size - 1) - first + 1
    level = v_t - record.mean
    square = record.square + t.size * level * level
    if length <= 0:
        return square
    if first < 0 or length > turn:
        return -1.0
    elapsed = t[first] - t0
    _oscillate(scratch, length, A * np.exp(-(elapsed - T1) * tau), omega * elapsed, tau, omega, dt)
    h, part = scratch[1, :length], scratch[2, :length]
    sums = record.sums[:, first : first + length]
    value, sign, count = sums[0], sums[1], sums[2]
    for j in range(length):
        part[j] = h[j] * (count[j] * h[j] - 2 * (value[j] - level * sign[j]))
    # Windows longer than half a turn overlap the next one, of the other sign.
    _overlap(part, h, sums[3], half)
    _overlap(part, h, sums[4], turn - half)
    square += _total(part)
    return square if square > CANCELLED * record.square else -1.0


@numba.njit(cache=True)
def _overlap(part, h, windows, delay):
    """Add what an oscillation and another one, of the other sign and begun `delay` samples earlier, have in common."""
    if h.size > delay:
        late, met, weight = part[delay:], h[delay:], windows[delay:]
        for j in range(late.size):
            late[j] -= 2 * weight[j] * met[j] * h[j]


@numba.njit(cache=True)
def _subtract(X, record, scratch):
    """Residual r - h into the last row of `scratch`, one window after the other."""
    A, t0, tau, omega, v_t, T2, T1 = X
    t, dt, error = record.t, record.dt, scratch[2]
    length = int(min(max((T2 - T1) / dt + 2.0, 1.0), float(t.size)))
    _oscillate(scratch, length, 1.0, 0.0, tau, omega, dt)
    for k in range(t.size):
        error[k] = record.v[k] - v_t
    for i in range(2 * record.n):
        start = t0 + i // 2 * record.T_f + (i % 2) * record.T_d
        first = _first_at_or_after(t, start + T1, dt)
        last = min(first + length, t.size)
        gate = start + T2
        while last > first and t[last - 1] > gate:
            last -= 1
        if last > first:
            amplitude = (1 - 2 * (i % 2)) * A * np.exp(-(t[first] - (start + T1)) * tau)
            phase = omega * (t[first] - start)
            a, b = amplitude * np.sin(phase), amplitude * np.cos(phase)
            part, c, s = error[first:last], scratch[0], scratch[1]
            for j in range(part.size):
                part[j] -= a * c[j] + b * s[j]


@numba.njit(cache=True)
def _first_at_or_after(t, instant, dt):
    """Index of the first sample with t[k] >= instant (t.size if there is none), on an even grid."""
    k = int(min(max(np.ceil((instant - t[0]) / dt), 0.0), float(t.size)))
    while k > 0 and t[k - 1] >= instant:
        k -= 1
    while k < t.size and t[k] < instant:
        k += 1
    return k


@numba.njit(cache=True)
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


@numba.njit(cache=True)
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
