"""The misfit of a whole population by a record's few folded samples: a faster twin of `compiled.misfit`.

Where the turn is a whole number of samples, all windows of a signature hold the same values, so the record is summed
over the windows first, and a member costs one window instead of 2 n.
"""

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from replication.signature import Timing

FloatArray = NDArray[np.float64]


class Fold(NamedTuple):
    """A record folded on the windows of a signature.

    Attributes
    ----------
    sums : array of shape (positions, 3)
        For the sample at which a window's first, positive oscillation has a value: sum of v - mean v over all windows,
        less that over the negative ones; number of windows there, less that of the negative ones; number of both.
    own, following : arrays of shape (positions,)
        Windows in which a long oscillation meets its own turn's other one, and the next turn's first one.
    square, mean, dt : float
        Sum of (v - mean v)^2, mean v, and the sampling period [s].
    samples, half, other_half : int
        Samples of the record, of T_d and of T_f - T_d.
    """

    sums: FloatArray
    own: FloatArray
    following: FloatArray
    square: float
    mean: float
    dt: float
    samples: int
    half: int
    other_half: int


def fold(t: FloatArray, v: FloatArray, timing: Timing) -> Fold:
    """Fold a record on the windows of the signature.

    Parameters
    ----------
    t, v : array of shape (samples,)
        Time from 0 [s], evenly sampled, and motor speed, in any unit.
    timing : Timing
        T_d, T_f and the number of turns.

    Returns
    -------
    Fold

    Raises
    ------
    ValueError
        T_d or T_f is not a whole number of samples, or the time does not begin at 0.
    """
    dt = (t[-1] - t[0]) / (t.size - 1)
    half, turn = round(timing.T_d / dt), round(timing.T_f / dt)
    if t[0] != 0 or max(abs(half * dt - timing.T_d), abs(turn * dt - timing.T_f)) > 1e-9:
        raise ValueError("folding needs a time from 0, and T_d and T_f of whole samples")
    mean, size = float(v.mean()), t.size + 2 * turn
    r, there = np.zeros(size + half + timing.n * turn), np.zeros(size + half + timing.n * turn)
    r[: t.size], there[: t.size] = v - mean, 1.0
    value, count = (sum(x[i * turn : i * turn + size + half] for i in range(timing.n)) for x in (r, there))
    first, second = count[:size], count[half:]
    sums = np.column_stack([value[:size] - value[half:], first - second, first + second])
    following = np.minimum(second, timing.n - 1.0)
    return Fold(sums, first, following, float((r**2).sum()), mean, dt, t.size, half, turn - half)


def folded_rmse(members: FloatArray, record: Fold) -> FloatArray:
    """`population_rmse` of a folded record, equal but for rounding.

    Parameters
    ----------
    members : array of shape (members, 7)
        Parameters in `FREE_PARAMETERS` order, t0 and T1 not negative, windows shorter than 2 T_d and 2 (T_f - T_d).
    record : Fold
        From `fold`.

    Returns
    -------
    array of shape (members,)
        Misfits, in the unit of v.
    """
    return _misfits(np.ascontiguousarray(members), *record)


@numba.njit(cache=True)
def _misfits(members, sums, own, following, total, mean, dt, samples, half, other_half):
    """Compiled body of `folded_rmse`."""
    misfit = np.empty(members.shape[0])
    h = np.empty(sums.shape[0])
    for p in range(members.shape[0]):
        A, t0, tau, omega, v_t, T2, T1 = members[p]
        level = v_t - mean
        first = int(np.ceil((t0 + T1) / dt))
        length = min(int(np.floor((t0 + T2) / dt)), samples - 1) - first + 1
        square = total + samples * level * level
        if length > 0:
            # A damped sine one sample on is the last one times exp((-tau + i omega) dt).
            decay = np.exp(-tau * dt)
            step_cos, step_sin = decay * np.cos(omega * dt), decay * np.sin(omega * dt)
            amplitude = A * np.exp(-(first * dt - t0 - T1) * tau)
            c, s = amplitude * np.cos(omega * (first * dt - t0)), amplitude * np.sin(omega * (first * dt - t0))
            for j in range(length):
                h[j] = s
                c, s = c * step_cos - s * step_sin, c * step_sin + s * step_cos
            for j in range(length):
                value, sign, count = sums[first + j]
                square += h[j] * (count * h[j] - 2 * (value - level * sign))
            # Windows longer than half a turn overlap the next one, of the other sign.
            for j in range(half, length):
                square -= 2 * own[first + j] * h[j] * h[j - half]
            for j in range(other_half, length):
                square -= 2 * following[first + j] * h[j] * h[j - other_half]
        misfit[p] = np.sqrt(max(square, 0.0) / samples)
    return misfit
