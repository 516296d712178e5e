"""The backlash signature h(t), its cost and the box of its parameters (equations 1 to 7 and 11, Table 1).

Times in s, speeds in rps, frequencies in rad/s. Equations 5 to 7 are what the authors' program fits, and what stands
here. Equations 1 to 4 introduce the model with absolute instants; as printed they are not the same: equation 1 has
another phase, and by equation 4 the turns would be t0 further apart (data/errata.csv, E6 and E15).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
TURN = 2 * np.pi


class Parameters(NamedTuple):
    """The seven free parameters X, in the order in which the authors' public notebook samples them.

    In another order a seed would give another run. The paper's list has T_d and T_f too, whose bounds in Table 1 are
    equal, so they are not searched (`Timing`), and leaves out v_t, which Table 1 bounds.
    """

    A: float  # amplitude factor [rps]
    t0: float  # starting point of the first disturbance [s]
    tau: float  # damping factor [1/s]; Table 1 prints no unit
    omega: float  # angular frequency [rad/s]
    v_t: (
        float  # level of the speed [rps]: commanded in the text, but searched, as Table 1 bounds it
    )
    T2: float  # the oscillation's window ends so long after the starting point [s]
    T1: float  # and begins so long after it [s]


class Timing(NamedTuple):
    """What the test movement fixes. Table 1 prints 0.204 and 0.408 s; the records repeat after 0.400 s."""

    T_d: float = 0.2  # delay of a turn's second oscillation [s]
    T_f: float = 0.4  # period of a load turn [s]
    n: int = 12  # turns


MOVEMENT = Timing()


class Box(NamedTuple):
    """Bounds of a search, each of shape (parameters,)."""

    lower: FloatArray
    upper: FloatArray


def d_b(t: FloatArray, X: Parameters, start: float) -> FloatArray:
    """Equation 5: one damped oscillation, between T1 and T2 after its own starting point; shape (samples,)."""
    since = t - start
    inside = (since >= X.T1) & (since <= X.T2)
    since = np.where(inside, since, X.T1)  # outside, where exp() could overflow, any value serves
    oscillation = X.A * np.exp(-(since - X.T1) * X.tau) * np.sin(X.omega * since)  # equation 5
    return np.where(inside, oscillation, 0.0)


def f(t: FloatArray, X: Parameters, start: float, T_d: float) -> FloatArray:
    """Equation 6: the two oscillations of a turn, of opposite sign; shape (samples,)."""
    return d_b(t, X, start) - d_b(t, X, start + T_d)  # equation 6


def h(t: FloatArray, X: Parameters | FloatArray, timing: Timing = MOVEMENT) -> FloatArray:
    """Equation 7: the signature [rps] of n turns.

    Parameters
    ----------
    t : array of shape (samples,)
        Time [s].
    X : Parameters, or array of shape (7,)
        The free parameters; v_t does not enter.
    timing : Timing
        T_d, T_f and n.

    Returns
    -------
    array of shape (samples,)
    """
    X = Parameters(*X)
    turns = [f(t, X, X.t0 + i * timing.T_f, timing.T_d) for i in range(timing.n)]
    signature: FloatArray = np.sum(turns, axis=0)  # equation 7
    return signature


def rmse(
    t: FloatArray, v: FloatArray, X: Parameters | FloatArray, timing: Timing = MOVEMENT
) -> float:
    """Root mean square [rps] of r - h, the paper's cost function, with r of equation 11.

    `t` and `v` [rps] have shape (samples,). `misfit.population_rmse` is the same for many X, compiled.
    """
    r = v - Parameters(*X).v_t  # equation 11
    return float(np.sqrt(np.mean((r - h(t, X, timing)) ** 2)))


def table1_box(
    t: FloatArray, v: FloatArray, amplitude_factor: float = 1.0, longest_window: float = 0.204
) -> Box:
    """Table 1: acceptable ranges of the free parameters for a record, each of shape (7,).

    Parameters
    ----------
    t, v : array of shape (samples,)
        The record [s, rps].
    amplitude_factor : float
        Widens the range of A. Table 1 has 1, the authors' notebook 1.3.
    longest_window : float
        Upper bound of T2 [s]; that of T1 is its half. Table 1 prints 0.204, which is more than the records' T_d of
        0.200: windows may overlap.
    """
    A = amplitude_factor * np.ptp(v) / 2
    bounds = {
        "A": (-A, A),
        "t0": (t.min(), t.max()),
        "tau": (5, 30),
        "omega": (TURN, TURN * 40),
        "v_t": (v.min(), v.max()),
        "T2": (0, longest_window),
        "T1": (0, longest_window / 2),
    }
    lower, upper = np.array([bounds[name] for name in Parameters._fields], dtype=float).T
    return Box(lower, upper)
