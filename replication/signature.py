"""The backlash signature h(t) and its misfit (equations 1 to 7 and 11, the cost function, Table 1).

A parameter vector X lists the free parameters in the order of `FREE_PARAMETERS`. T_d and T_f are not free:
Table 1 gives them equal lower and upper bounds, so the optimiser never sees them.
"""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# The order in which the authors' CMA-ES samples them: a seed means the same runs only in this order.
FREE_PARAMETERS = ("A_rps", "t0_s", "tau_per_s", "omega_rad_per_s", "v_t_rps", "T2_s", "T1_s")

# Table 1's bounds of tau [1/s], and of omega over 2 pi [Hz].
DAMPING_PER_S = (5.0, 30.0)
FREQUENCY_HZ = (1.0, 40.0)


@dataclass(frozen=True)
class Timing:
    """What of the signature the test movement fixes (section "Backlash signature", Table 1).

    Attributes
    ----------
    T_d : float
        Delay of a turn's second oscillation [s]; half a turn.
    T_f : float
        Period of a load turn [s].
    n : int
        Turns in the model (12 in the paper).
    """

    T_d: float
    T_f: float
    n: int


@dataclass(frozen=True)
class Box:
    """Lower and upper bounds of the free parameters, each of shape (7,), in `FREE_PARAMETERS` order."""

    lower: FloatArray
    upper: FloatArray


def damped_oscillation(
    t: FloatArray, A: float, t0: float, tau: float, omega: float, T1: float, T2: float
) -> FloatArray:
    """Equation 5: one damped oscillation d_b(t - t0), zero outside t0 + T1 <= t <= t0 + T2.

    Parameters
    ----------
    t : array of shape (samples,)
        Time [s].
    A : float
        Amplitude factor, in the unit of the result.
    t0, T1, T2 : float
        Reference instant, start and end of the window after it [s].
    tau : float
        Damping factor [1/s].
    omega : float
        Angular frequency [rad/s].

    Returns
    -------
    array of shape (samples,)
    """
    inside = (t >= t0 + T1) & (t <= t0 + T2)
    elapsed = np.where(inside, t - (t0 + T1), 0.0)
    return np.where(inside, A * np.exp(-elapsed * tau) * np.sin(omega * (t - t0)), 0.0)


def signature(t: FloatArray, X: FloatArray, timing: Timing) -> FloatArray:
    """Equation 7: the signature h(t), n turns of equation 6, as the paper writes it.

    This direct transcription is the reference; `population_rmse` is what a search calls.

    Parameters
    ----------
    t : array of shape (samples,)
        Time [s].
    X : array of shape (7,)
        Parameters in `FREE_PARAMETERS` order; v_t does not enter.
    timing : Timing
        T_d, T_f and the number of turns.

    Returns
    -------
    array of shape (samples,)
        Speed disturbance [rps].
    """
    A, t0, tau, omega, _, T2, T1 = X
    h = np.zeros_like(t)
    for i in range(timing.n):
        start = t0 + i * timing.T_f
        h += damped_oscillation(t, A, start, tau, omega, T1, T2)
        h -= damped_oscillation(t, A, start + timing.T_d, tau, omega, T1, T2)
    return h


def rmse(t: FloatArray, v: FloatArray, X: FloatArray, timing: Timing) -> float:
    """Root mean square of r(t) - h(t), the paper's cost function, with r(t) = v(t) - v_t (equation 11).

    Parameters
    ----------
    t, v : array of shape (samples,)
        Time [s] and motor speed [rps].
    X : array of shape (7,)
        Parameters in `FREE_PARAMETERS` order.
    timing : Timing
        T_d, T_f and the number of turns.

    Returns
    -------
    float
        Misfit [rps].
    """
    return float(np.sqrt(np.mean((v - X[4] - signature(t, X, timing)) ** 2)))


def table1_box(
    t: FloatArray,
    v: FloatArray,
    longest_window_s: float,
    amplitude_factor: float = 1.0,
    damping_per_s: tuple[float, float] = DAMPING_PER_S,
    frequency_hz: tuple[float, float] = FREQUENCY_HZ,
) -> Box:
    """Table 1's acceptable ranges of the free parameters for a record.

    Parameters
    ----------
    t, v : array of shape (samples,)
        Time [s] and motor speed [rps].
    longest_window_s : float
        Upper bound of T2, and twice that of T1; Table 1 prints its T_d there.
    amplitude_factor : float
        Widens the range of A; Table 1 has 1.
    damping_per_s, frequency_hz : two floats
        Bounds of tau [1/s] and of omega over 2 pi [Hz].

    Returns
    -------
    Box
    """
    half_range = amplitude_factor * (v.max() - v.min()) / 2
    (tau_min, tau_max), (omega_min, omega_max) = damping_per_s, (2 * np.pi * f for f in frequency_hz)
    lower = np.array([-half_range, t.min(), tau_min, omega_min, v.min(), 0.0, 0.0])
    upper = np.array([half_range, t.max(), tau_max, omega_max, v.max(), longest_window_s, longest_window_s / 2])
    return Box(lower, upper)


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
    last = first + decay_cos.size
    gate = start + T2
    while last > first and (last > t.size or t[last - 1] > gate):
        last -= 1
    if last == first:
        return
    amplitude = A * np.exp(-(t[first] - (start + T1)) * tau)
    phase = omega * (t[first] - start)
    a = amplitude * np.sin(phase)
    b = amplitude * np.cos(phase)
    for j in range(last - first):
        error[first + j] -= a * decay_cos[j] + b * decay_sin[j]


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
