"""The residual of a signature, r - h (equation 11), window by window: compiled, the paper's but for rounding."""

import numpy as np

from replication.arrays import FloatArray
from replication.compiling import njit
from replication.signature import Parameters, Timing


def residual(t: FloatArray, v: FloatArray, X: FloatArray, timing: Timing) -> FloatArray:
    """The residual r - h (equation 11) of an evenly sampled record, shape (samples,)."""
    free = Parameters(*map(float, X))
    error = v - free.v_t
    _subtract(free, t, error, float(timing.T_d), float(timing.T_f), timing.n)
    return error


@njit
def _subtract(free, t, error, T_d, T_f, n):
    """Subtract h, one window after the other."""
    A, t0, tau, omega, _, T2, T1 = free
    dt = (t[-1] - t[0]) / (t.size - 1)
    scratch = np.empty((2, t.size))
    c, s = scratch[0], scratch[1]
    length = int(min(max((T2 - T1) / dt + 2.0, 1.0), float(t.size)))
    oscillate(scratch, length, 1.0, 0.0, tau, omega, dt)
    for i in range(2 * n):
        start = t0 + i // 2 * T_f + (i % 2) * T_d
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
def oscillate(rows, length, amplitude, phase, tau, omega, dt):
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
def sum_in_order(x):
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
