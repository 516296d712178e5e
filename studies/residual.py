"""The residual of a signature, window by window and compiled: for searches that want more than its mean square."""

import numpy as np

from replication.arrays import FloatArray
from replication.compiling import njit
from replication.misfit import oscillate
from replication.signature import Timing


def residual(t: FloatArray, v: FloatArray, X: FloatArray, timing: Timing) -> FloatArray:
    """R - h (equation 11) on an evenly sampled record, shape (samples,)."""
    error = v - X[4]
    dt = (t[-1] - t[0]) / (t.size - 1)
    _subtract(np.ascontiguousarray(X), t, error, dt, timing.T_d, timing.T_f, timing.n)
    return error


@njit
def _subtract(X, t, error, dt, T_d, T_f, n):
    """Subtract h, one window after the other."""
    A, t0, tau, omega, _, T2, T1 = X
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
