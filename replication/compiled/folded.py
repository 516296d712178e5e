"""A record prepared for the search: summed over the windows of a signature where the turn is whole samples.

All windows then hold the same values, so that a member of a population costs one window instead of 2 n.
"""

from typing import NamedTuple

import numpy as np

from replication.arrays import FloatArray
from replication.signature import Timing


class Fold(NamedTuple):
    """A record, and its sums over the windows of a signature.

    Attributes
    ----------
    t, v : array of shape (samples,)
        Time [s] and motor speed, in any unit.
    T_d, T_f, n
        As in `Timing`.
    dt, mean, square, tie : float
        Sampling period [s], mean v, the sum of (v - mean v)^2, and how close to a sample [samples] rounding decides
        anew in each turn whether a window holds it.
    half, turn : int
        Samples of T_d and of T_f; 0 if nothing is folded.
    sums : array of shape (5, samples)
        For the sample at which a window's first, positive oscillation has a value: sum of v - mean v over all windows,
        less that over the negative ones; number of windows there, less that of the negative ones; number of both;
        windows in which a long oscillation meets its own turn's other one, and the next turn's first one.
    """

    t: FloatArray
    v: FloatArray
    T_d: float
    T_f: float
    n: int
    dt: float
    mean: float
    square: float
    tie: float
    half: int
    turn: int
    sums: FloatArray


def unfolded(t: FloatArray, v: FloatArray, timing: Timing) -> Fold:
    """A record as it is, for the misfits of a few members: each of their windows is gone through."""
    dt = (t[-1] - t[0]) / (t.size - 1)
    return Fold(t, v, float(timing.T_d), float(timing.T_f), timing.n, dt, 0.0, 0.0, 0.0, 0, 0, np.empty((5, 0)))


def fold(t: FloatArray, v: FloatArray, timing: Timing) -> Fold:
    """Fold a record on the windows of the signature, if T_d < T_f and both are whole numbers of samples.

    Parameters
    ----------
    t, v : array of shape (samples,)
        Time [s], evenly sampled, and motor speed, in any unit.
    timing : Timing
        T_d, T_f and the number of turns.

    Returns
    -------
    Fold

    Raises
    ------
    ValueError
        A sample is not finite, T_d or T_f is not above 0, or the record is shorter than one turn.
    """
    if not (timing.T_d > 0 and timing.T_f > 0):
        raise ValueError(f"T_d = {timing.T_d} s, T_f = {timing.T_f} s: both must lie above 0")
    if not (np.isfinite(t).all() and np.isfinite(v).all()):
        raise ValueError("the record holds a time or a speed that is not finite")
    record = unfolded(t, v, timing) if t.size > 1 else None
    if record is None or t.size * record.dt < (1 - 1e-9) * timing.T_f:
        raise ValueError(f"the record is shorter than one turn of {timing.T_f} s")
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
