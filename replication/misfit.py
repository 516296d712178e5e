"""The cost of a population of signatures, compiled: equal to `signature.rmse`, but for samples at a window's very edge.

All windows of a signature hold the same oscillation, half a turn apart and of alternating sign. So a record that is
summed over the windows once, with their signs, costs one window in place of 2 n. Whether a window holds a sample at its
edge is decided once, for all windows; `signature.h` decides it by rounding, window by window. Two conditions, which
Table 1's box keeps: no window begins before the record, and none is longer than a turn.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from replication import njit
from replication.signature import FloatArray, Timing, rmse


class FoldedRecord(NamedTuple):
    """A record, and its sums over the windows: of sample j and its shifts by half and whole turns."""

    t0: float  # time of the first sample [s]
    dt: float
    size: int
    mean: float  # of v
    square: float  # sum of (v - mean)^2
    half: int  # samples of T_d
    turn: int  # and of T_f
    value: FloatArray  # v - mean in the positive windows, less that in the negative ones
    sign: FloatArray  # number of positive windows that have this sample in the record, less that of negative ones
    both: FloatArray  # number of both
    in_turn: FloatArray  # windows in which a long oscillation meets its own turn's other one
    in_next: FloatArray  # and the next turn's first one


def fold(t: FloatArray, v: FloatArray, timing: Timing) -> FoldedRecord | None:
    """Sum a record over the windows; None if it is sampled unevenly, or T_d or T_f is no whole number of samples."""
    dt = float(t[-1] - t[0]) / (t.size - 1)
    half, turn = round(timing.T_d / dt), round(timing.T_f / dt)
    uneven = np.ptp(t - dt * np.arange(t.size))
    off_grid = timing.n * max(abs(half * dt - timing.T_d), abs(turn * dt - timing.T_f))
    if max(uneven, off_grid) > 1e-6 * dt or not 0 < half < turn:
        return None
    mean = float(v.mean())
    padded = np.zeros((2, t.size + half + timing.n * turn))
    padded[0, : t.size] = v - mean
    padded[1, : t.size] = 1
    turns = [padded[:, i * turn :][:, : t.size + half] for i in range(timing.n)]
    first, second = (np.sum(turns, axis=0)[:, k:][:, : t.size] for k in (0, half))
    return FoldedRecord(
        t0=float(t[0]),
        dt=dt,
        size=t.size,
        mean=mean,
        square=float(np.sum((v - mean) ** 2)),
        half=half,
        turn=turn,
        value=first[0] - second[0],
        sign=first[1] - second[1],
        both=first[1] + second[1],
        in_turn=first[1],
        in_next=np.minimum(second[1], timing.n - 1),
    )


@njit
def sum_windows(members, record):
    """Sums of w^2, w (v - mean) and w over a record, shape (members, 3); w is the signature of A = 1."""
    sums = np.empty((len(members), 3))
    buffer = np.empty(record.size)
    for p in range(len(members)):
        _, t0, tau, omega, _, T2, T1 = members[p]
        start = (t0 - record.t0) / record.dt
        first = max(int(np.ceil(start + T1 / record.dt)), 0)
        last = min(int(np.floor(start + T2 / record.dt)), record.size - 1)
        # u is one window; all others are its copies.
        u = buffer[: max(last + 1 - first, 0)]
        fill_oscillation(u, (first - start) * record.dt, T1, tau, omega, record.dt)
        value, both, sign = record.value[first:], record.both[first:], record.sign[first:]
        square = product = total = 0.0
        for k in range(u.size):
            square += both[k] * u[k] ** 2
            product += value[k] * u[k]
            total += sign[k] * u[k]
        # A window longer than half a turn overlaps its own turn's other one, and the next turn's first one.
        for k in range(record.half, u.size):
            square -= 2 * record.in_turn[first + k] * u[k] * u[k - record.half]
        for k in range(record.turn - record.half, u.size):
            square -= 2 * record.in_next[first + k] * u[k] * u[k - record.turn + record.half]
        sums[p] = square, product, total
    return sums


@njit
def fill_oscillation(u, since, T1, tau, omega, dt):
    """Equation 5 with A = 1 in evenly spaced samples, the first of them `since` after the instant t0."""
    # exp(-(t - T1) tau) sin(omega t) is the imaginary part of a wave that each sample multiplies by the same factor.
    wave = np.exp(-(since - T1) * tau + 1j * omega * since)
    factor = np.exp((1j * omega - tau) * dt)
    for k in range(min(u.size, 16)):
        u[k] = wave.imag
        wave *= factor
    # So u_k = a u_(k - 8) + b u_(k - 16): of eight samples none waits for another.
    factor *= factor
    factor *= factor
    factor *= factor
    a, b = 2 * factor.real, -(factor.real**2 + factor.imag**2)
    for k in range(16, u.size):
        u[k] = a * u[k - 8] + b * u[k - 16]


def population_rmse(members: FloatArray, record: FoldedRecord) -> FloatArray:
    """Misfits of members, shape (members, 7) in the order of `Parameters`, in the unit of v."""
    square, product, total = sum_windows(members, record).T
    A, level = members[:, 0], members[:, 4] - record.mean
    # The sum of (r - h)^2 with r = v - v_t (equation 11) and h = A w.
    squares = record.square + record.size * level**2
    squares += A**2 * square - 2 * A * (product - level * total)
    return np.sqrt(np.maximum(squares, 0) / record.size)


def project(
    members: FloatArray, record: FoldedRecord, largest_A: float
) -> tuple[FloatArray, FloatArray]:
    """Replace A and v_t of members by those of the least misfit; with these misfits, shapes (members, 7), (members,).

    No step of the paper. The model A w + v_t, with w as in `sum_windows`, is linear in both, so least squares
    gives A = mean((w - mean w) (v - mean v)) / var w and v_t = mean v - A mean w. A is held within plus and minus
    `largest_A`, v_t is free.
    """
    square, product, total = sum_windows(members, record).T
    variance = square - total**2 / record.size
    A = np.divide(product, variance, out=np.zeros_like(product), where=variance > 1e-9 * square)
    A = np.clip(A, -largest_A, largest_A)
    projected = members.copy()
    projected[:, 0] = A
    projected[:, 4] = record.mean - A * total / record.size
    squares = record.square - 2 * A * product + A**2 * variance
    return projected, np.sqrt(np.maximum(squares, 0) / record.size)


def cost(t: FloatArray, v: FloatArray, timing: Timing) -> Callable[[FloatArray], FloatArray]:
    """The paper's cost on a record: from members of shape (members, 7) to misfits of shape (members,).

    A record that cannot be folded is fitted by equation 7 as it stands, some thousand times slower.
    """
    record = fold(t, v, timing)
    if record is None:
        return lambda members: np.array([rmse(t, v, X, timing) for X in members])
    return lambda members: population_rmse(members, record)
