"""The cost of a population of signatures, compiled: equal to `signature.rmse`, but for samples at a window's very edge.

All windows of a signature hold the same oscillation, half a turn apart and of alternating sign. So a record that is
summed over the windows once, with their signs, costs one window in place of 2 n. Whether a window holds a sample at its
edge is decided once, for all windows; `signature.h` decides it by rounding, window by window. Two conditions, which
Table 1's box keeps: no window begins before the record, and none is longer than a turn.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from replication.compilation import njit, njit_sums
from replication.signature import FloatArray, Timing, rmse


class FoldedRecord(NamedTuple):
    """A record, and its sums over the windows: of sample j and its shifts by half and whole turns."""

    t0: float  # time of the first sample [s]
    dt: float
    size: int
    mean: float  # of v
    power: float  # sum of (v - mean)^2
    half: int  # samples of T_d
    turn: int  # and of T_f
    signed_sum: FloatArray  # v - mean in the positive windows, less that in the negative ones
    signed_count: FloatArray  # of positive windows that have this sample in the record, less that of negative ones
    both_count: FloatArray  # of windows of either sign that have it
    in_turn: FloatArray  # windows in which a long oscillation meets its own turn's other one
    in_next: FloatArray  # and the next turn's first one


def fold(t: FloatArray, v: FloatArray, timing: Timing) -> FoldedRecord | None:
    """Sum a record over the windows; None if it is sampled unevenly, or T_d or T_f is no whole number of samples."""
    dt = float(t[-1] - t[0]) / (t.size - 1)
    half = round(timing.T_d / dt)
    turn = round(timing.T_f / dt)
    uneven = np.ptp(t - dt * np.arange(t.size))
    off_grid = timing.n * max(abs(half * dt - timing.T_d), abs(turn * dt - timing.T_f))
    if max(uneven, off_grid) > 1e-6 * dt or not 0 < half < turn:
        return None
    mean = float(v.mean())
    padded = np.zeros((2, t.size + half + timing.n * turn))
    padded[0, : t.size] = v - mean
    padded[1, : t.size] = 1
    turns = [padded[:, i * turn :][:, : t.size + half] for i in range(timing.n)]
    positive, negative = (np.sum(turns, axis=0)[:, k:][:, : t.size] for k in (0, half))
    return FoldedRecord(
        t0=float(t[0]),
        dt=dt,
        size=t.size,
        mean=mean,
        power=float(np.sum((v - mean) ** 2)),
        half=half,
        turn=turn,
        signed_sum=positive[0] - negative[0],
        signed_count=positive[1] - negative[1],
        both_count=positive[1] + negative[1],
        in_turn=positive[1],
        in_next=np.minimum(negative[1], timing.n - 1),
    )


@njit
def sum_windows(members, record):
    """Sums of w^2, w (v - mean) and w over a record, with w the signature, equation 7, of A = 1; shape (3, members)."""
    sums = np.empty((3, len(members)))
    buffer = np.empty(max(record.size, 16))
    for p in range(len(members)):
        _, t0, tau, omega, _, T2, T1 = members[p]
        start = (t0 - record.t0) / record.dt
        first = max(int(np.ceil(start + T1 / record.dt)), 0)
        last = min(int(np.floor(start + T2 / record.dt)), record.size - 1)
        size = max(last + 1 - first, 0)
        # u is one window, equation 5; all others of equations 6 and 7 are its copies.
        fill_oscillation(
            buffer[: max(size, 16)], (first - start) * record.dt, T1, tau, omega, record.dt
        )
        u = buffer[:size]
        square, product, total = weigh_window(u, record, first)
        # A window longer than half a turn overlaps its own turn's other one, and the next turn's first one.
        for k in range(record.half, u.size):
            square -= 2 * record.in_turn[first + k] * u[k] * u[k - record.half]
        for k in range(record.turn - record.half, u.size):
            square -= 2 * record.in_next[first + k] * u[k] * u[k - record.turn + record.half]
        sums[0, p] = square
        sums[1, p] = product
        sums[2, p] = total
    return sums


@njit_sums
def weigh_window(u, record, first):
    """Sums of u^2, u (v - mean) and u over all windows of a record; each begins with sample `first`, none overlap."""
    square = product = total = 0.0
    both_count = record.both_count[first : first + u.size]
    signed_sum = record.signed_sum[first : first + u.size]
    signed_count = record.signed_count[first : first + u.size]
    # Equations 6 and 7, summed: the folded record has the signs of 6 and the turns of 7.
    for k in range(u.size):
        square += both_count[k] * u[k] * u[k]
        product += signed_sum[k] * u[k]
        total += signed_count[k] * u[k]
    return square, product, total


@njit
def fill_oscillation(u, since, T1, tau, omega, dt):
    """Equation 5 with A = 1 in 16 or more evenly spaced samples, the first of them `since` after the instant t0."""
    # exp(-(t - T1) tau) sin(omega t) is the imaginary part of a wave that each sample multiplies by the same factor.
    wave = np.exp(-(since - T1) * tau + 1j * omega * since)
    factor = np.exp((1j * omega - tau) * dt)
    factor_2 = factor * factor
    factor_4 = factor_2 * factor_2
    factor_8 = factor_4 * factor_4
    for k in range(4):
        later = wave * factor_4
        u[k] = wave.imag
        u[k + 4] = later.imag
        u[k + 8] = (wave * factor_8).imag
        u[k + 12] = (later * factor_8).imag
        wave *= factor
    # So u_k = a u_(k - 8) + b u_(k - 16): eight series that do not depend on each other.
    a, b = 2 * factor_8.real, -(factor_8.real**2 + factor_8.imag**2)
    for lane in range(8):
        before, now = u[lane], u[lane + 8]
        for k in range(lane + 16, u.size, 8):
            before, now = now, a * now + b * before
            u[k] = now


@njit
def population_rmse(members, record):
    """Misfits of members, shape (members, 7) in the order of `Parameters`, in the unit of v."""
    square, product, total = sum_windows(members, record)
    A, level = members[:, 0], members[:, 4] - record.mean
    # The sum of (r - h)^2 with r = v - v_t (equation 11) and h = A w.
    squares = record.power + record.size * level**2
    squares += A**2 * square - 2 * A * (product - level * total)
    return np.sqrt(np.maximum(squares, 0.0) / record.size)


# Columns of t0, tau, omega, T2 and T1 among `Parameters`: what a projection leaves.
PROJECTED = np.array([1, 2, 3, 5, 6])


@njit
def project(shapes, record, largest_A):
    """Give shapes (t0, tau, omega, T2, T1) the A and v_t of the least misfit.

    From shape (members, 5) to members of shape (members, 7) and their misfits. No step of the paper. The model
    A w + v_t, with w as in `sum_windows`, is linear in both, so least squares gives v_t = mean v - A mean w and
    A = sum((w - mean w) (v - mean v)) / sum((w - mean w)^2). A is held within plus and minus `largest_A`, v_t is free.
    """
    members = np.zeros((len(shapes), 7))
    for i in range(len(PROJECTED)):
        members[:, PROJECTED[i]] = shapes[:, i]
    square, product, total = sum_windows(members, record)
    about_mean = square - total**2 / record.size  # sum of (w - mean w)^2
    A = np.where(about_mean > 1e-9 * square, product / about_mean, 0.0)
    A = np.minimum(np.maximum(A, -largest_A), largest_A)
    members[:, 0] = A
    members[:, 4] = record.mean - A * total / record.size
    squares = record.power - 2 * A * product + A**2 * about_mean
    return members, np.sqrt(np.maximum(squares, 0.0) / record.size)


def cost(t: FloatArray, v: FloatArray, timing: Timing) -> Callable[[FloatArray], FloatArray]:
    """The paper's cost on a record: from members of shape (members, 7) to misfits of shape (members,).

    The box of the members must keep the two conditions above, as Table 1's does. A record that cannot be folded is
    fitted by equation 7 as it stands, some thousand times slower.
    """
    record = fold(t, v, timing)
    if record is None:
        return lambda members: np.array([rmse(t, v, X, timing) for X in members])
    return lambda members: population_rmse(members, record)
