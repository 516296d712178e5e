"""The misfit of a whole population of signatures: the fast twin of `signature.rmse`."""

import numba
import numpy as np
from numpy.typing import NDArray

from replication.signature import Timing

FloatArray = NDArray[np.float64]


@numba.njit(cache=True)
def _first_at_or_after(t: FloatArray, instant: float, dt: float) -> int:
    """Index of the first sample with t[k] >= instant (t.size if there is none), on an even grid."""
    size = t.size
    guess = np.ceil((instant - t[0]) / dt)
    k = int(min(max(guess, 0.0), float(size)))
    while k > 0 and t[k - 1] >= instant:
        k -= 1
    while k < size and t[k] < instant:
        k += 1
    return k


@numba.njit(cache=True)
def _subtract_window(error, t, dt, A, start, tau, omega, T1, T2, decay_cos, decay_sin):
    """Subtract one damped oscillation from `error` in place, by its tabulated powers."""
    first = _first_at_or_after(t, start + T1, dt)
    last = min(first + decay_cos.size, t.size)
    gate = start + T2
    while last > first and t[last - 1] > gate:
        last -= 1
    if last == first:
        return
    amplitude = A * np.exp(-(t[first] - (start + T1)) * tau)
    phase = omega * (t[first] - start)
    a = amplitude * np.sin(phase)
    b = amplitude * np.cos(phase)
    part = error[first:last]  # an index that cannot be negative lets the loop be vectorised
    for j in range(part.size):
        part[j] -= a * decay_cos[j] + b * decay_sin[j]


@numba.njit(cache=True)
def _mean_square(x: FloatArray) -> float:
    """Mean square with eight running sums, so that the additions do not wait for one another."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    blocks = x.size // 8 * 8
    for k in range(0, blocks, 8):
        s0 += x[k] * x[k]
        s1 += x[k + 1] * x[k + 1]
        s2 += x[k + 2] * x[k + 2]
        s3 += x[k + 3] * x[k + 3]
        s4 += x[k + 4] * x[k + 4]
        s5 += x[k + 5] * x[k + 5]
        s6 += x[k + 6] * x[k + 6]
        s7 += x[k + 7] * x[k + 7]
    for k in range(blocks, x.size):
        s0 += x[k] * x[k]
    return (((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7))) / x.size


@numba.njit(cache=True)
def _population_rmse(t, v, population, T_d, T_f, n):
    """Compiled body of `population_rmse`."""
    dt = (t[-1] - t[0]) / (t.size - 1)
    misfit = np.empty(population.shape[0])
    error = np.empty(t.size)
    decay_cos = np.empty(t.size)
    decay_sin = np.empty(t.size)
    for p in range(population.shape[0]):
        A, t0, tau, omega, v_t, T2, T1 = population[p]
        length = int(min(max((T2 - T1) / dt + 2.0, 0.0), float(t.size)))
        # A damped sine one sample on is the last one times exp((-tau + i omega) dt).
        step = np.exp(-tau * dt)
        step_cos = step * np.cos(omega * dt)
        step_sin = step * np.sin(omega * dt)
        c, s = 1.0, 0.0
        for j in range(length):
            decay_cos[j] = c
            decay_sin[j] = s
            c, s = c * step_cos - s * step_sin, c * step_sin + s * step_cos
        for k in range(t.size):
            error[k] = v[k] - v_t
        for i in range(n):
            start = t0 + i * T_f
            cos_part, sin_part = decay_cos[:length], decay_sin[:length]
            _subtract_window(error, t, dt, A, start, tau, omega, T1, T2, cos_part, sin_part)
            _subtract_window(error, t, dt, -A, start + T_d, tau, omega, T1, T2, cos_part, sin_part)
        misfit[p] = np.sqrt(_mean_square(error))
    return misfit


def population_rmse(t: FloatArray, v: FloatArray, population: FloatArray, timing: Timing) -> FloatArray:
    """`rmse` of a whole population in one compiled call.

    Equal to `rmse` but for rounding: within each window the damped sine follows a recurrence from sample to
    sample. Windows may overlap, lie partly or wholly outside the record, or be empty.

    Parameters
    ----------
    t, v : array of shape (samples,)
        Time [s], evenly sampled, and motor speed [rps].
    population : array of shape (members, 7)
        Parameters in `FREE_PARAMETERS` order.
    timing : Timing
        T_d, T_f and the number of turns.

    Returns
    -------
    array of shape (members,)
        Misfits [rps].
    """
    return _population_rmse(t, v, np.ascontiguousarray(population), timing.T_d, timing.T_f, timing.n)
