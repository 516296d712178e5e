"""The backlash signature h(t) and its misfit (equations 1 to 7 and 11, the cost function, Table 1).

Symbols are the paper's: t0, T1, T2, T_d and T_f in s, the damping tau in 1/s, the angular frequency
omega in rad/s, the amplitude factor A and the motor speed v in rps. Time t and v are arrays of
shape (samples,). A parameter vector X of shape (7,) lists the free parameters in the order of
`Parameters`. T_d and T_f are not free: Table 1 gives them equal lower and upper bounds, so the
optimiser never sees them.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from replication.arrays import FloatArray

# Names of the columns that hold `Parameters`, with their units.
FREE_PARAMETERS = ("A_rps", "t0_s", "tau_per_s", "omega_rad_per_s", "v_t_rps", "T2_s", "T1_s")

# Table 1's bounds of tau [1/s], and of omega over 2 pi [Hz].
DAMPING_PER_S = (5.0, 30.0)
FREQUENCY_HZ = (1.0, 40.0)


class Parameters(NamedTuple):
    """The free parameters in the order in which the authors' CMA-ES samples them: a seed means its run only so."""

    A: float
    t0: float
    tau: float
    omega: float
    v_t: float
    T2: float
    T1: float


@dataclass(frozen=True)
class Timing:
    """What of the signature the test movement fixes (section "Backlash signature", Table 1)."""

    T_d: float  # delay of a turn's second oscillation [s], half a turn
    T_f: float  # period of a load turn [s]
    n: int  # turns in the model, 12 in the paper


@dataclass(frozen=True)
class Box:
    """Bounds of the free parameters, each of shape (7,), in the order of `Parameters`."""

    lower: FloatArray
    upper: FloatArray


def damped_oscillation(t: FloatArray, X: Parameters) -> FloatArray:
    """Equation 5: one damped oscillation d_b(t - t0), zero outside t0 + T1 <= t <= t0 + T2; shape (samples,)."""
    inside = (t >= X.t0 + X.T1) & (t <= X.t0 + X.T2)
    elapsed = np.where(inside, t - (X.t0 + X.T1), 0.0)
    return np.where(inside, X.A * np.exp(-elapsed * X.tau) * np.sin(X.omega * (t - X.t0)), 0.0)


def signature(t: FloatArray, X: FloatArray, timing: Timing) -> FloatArray:
    """Equation 7: the signature h(t) [rps], n turns of equation 6, as the paper writes it; shape (samples,).

    This direct transcription is the reference; `misfit.population_rmse` is what a search calls. v_t
    does not enter.
    """
    first = Parameters(*X)
    h = np.zeros_like(t)
    for i in range(timing.n):
        start = first.t0 + i * timing.T_f
        h += damped_oscillation(t, first._replace(t0=start))
        h -= damped_oscillation(t, first._replace(t0=start + timing.T_d))
    return h


def rmse(t: FloatArray, v: FloatArray, X: FloatArray, timing: Timing) -> float:
    """Root mean square of r(t) - h(t) [rps], the paper's cost function, with r(t) = v(t) - v_t (equation 11)."""
    return float(np.sqrt(np.mean((v - Parameters(*X).v_t - signature(t, X, timing)) ** 2)))


def table1_box(
    t: FloatArray,
    v: FloatArray,
    longest_window_s: float,
    amplitude_factor: float = 1.0,
    damping_per_s: tuple[float, float] = DAMPING_PER_S,
    frequency_hz: tuple[float, float] = FREQUENCY_HZ,
    start_s: tuple[float, float] | None = None,
) -> Box:
    """Table 1's acceptable ranges of the free parameters for a record.

    Parameters
    ----------
    t, v : array of shape (samples,)
        The record [s, rps].
    longest_window_s : float
        Upper bound of T2, and twice that of T1; Table 1 prints its T_d there.
    amplitude_factor : float
        Widens the range of A; Table 1 has 1.
    damping_per_s, frequency_hz : (float, float)
        Bounds of tau, and of omega over 2 pi.
    start_s : (float, float), optional
        Bounds of t0; Table 1 has the whole record.
    """
    half_range = amplitude_factor * np.ptp(v) / 2
    bounds = [
        (-half_range, half_range),
        start_s or (t.min(), t.max()),
        damping_per_s,
        2 * np.pi * np.array(frequency_hz),
        (v.min(), v.max()),
        (0.0, longest_window_s),
        (0.0, longest_window_s / 2),
    ]
    return Box(*np.array(bounds).T.copy())
