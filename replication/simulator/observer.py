"""The joint simulated along a record that corrects it: a fading-memory Kalman filter, compiled.

Where the drive damps badly, turns do not repeat: what one turn leaves behind decides the next. Simulated from turn to
turn such a joint loses the record; corrected by each sample, it keeps to it, and what is left to correct (the
innovations) tells whether it is the right joint. The memory fades with a turn, so that ripple and the like, which the
joint does not have, are forgotten.
"""

import numba as nb
import numpy as np
from numpy.typing import NDArray

from replication.simulator import core
from replication.simulator.turns import STEPS_PER_PERIOD, TURN, constants, drive, start

FloatArray = NDArray[np.float64]


@nb.njit(cache=True)
def _side(x, delta):
    """Region of the displacement, 0 to 3 from the left, as `core` counts them."""
    if x > 0:
        return 3 if x > delta else 2
    return 1 if x > -delta else 0


@nb.njit(cache=True)
def _advance(t, y, region, left, command, c):
    """One step of `core.run`, split at the gap's edges."""
    edges = (-np.inf, -c.delta, 0.0, c.delta, np.inf)
    end = core._runge_kutta(t, y, left, command, region, c)
    for _ in range(16):
        x = end[0] / c.gear_ratio - end[2]
        up = x > edges[region + 1]
        if not up and x >= edges[region]:
            break
        s, y = core._locate(t, y, left, end, edges[region + 1] if up else edges[region], command, region, c)
        region = region + 1 if up else region - 1
        t, left = t + s, left - s
        end = core._runge_kutta(t, y, left, command, region, c)
    return end, region


@nb.njit(cache=True, nogil=True)
def innovations(rows, phases, n, turn_s, sample_s, per_sample, v, gains):
    """Run joints along a record.

    Parameters
    ----------
    rows : array of shape (joints, 16)
        See `turns.COLUMNS`.
    phases : array of shape (joints,)
        The load's angle at the first sample [rad].
    n, turn_s, sample_s : float
        Gear ratio, turn period and sampling period [s].
    per_sample : int
        Control periods in a sampling period.
    v : array of shape (samples,)
        Motor speed less the commanded one [rps].
    gains : array of shape (samples, 10)
        By which each innovation corrects the state.

    Returns
    -------
    array of shape (joints, samples), array of shape (samples,)
        Innovations [rps], and the share of each sampling period that the last joint spends in contact.
    """
    out, contact = np.full((rows.shape[0], v.size), np.nan), np.zeros(v.size)
    period = sample_s / per_sample
    step = period / STEPS_PER_PERIOD
    for k in range(rows.shape[0]):
        c, d = constants(rows[k], n, turn_s, phases[k], np.zeros((0, 5))), drive(rows[k], n, period)
        y, region = start(c, rows[k, 1])
        memory, ring = np.array([y[4], 0.0, 0.0, 0.0]), np.array([y[4], 0.0])
        for j in range(v.size):
            before, touching = y[0], 0
            for i in range(per_sample):
                command = core.control(0.0, y, memory, ring, 1, d, c)
                ring[0] = ring[1]
                for s in range(STEPS_PER_PERIOD):
                    t = (j * per_sample + i) * period + s * step
                    y, region = _advance(t, y, region, step, command, c)
                touching += region in (0, 3)
            contact[j] = touching / per_sample
            e = v[j] - (y[0] - before) / (sample_s * TURN)
            out[k, j] = e
            if not abs(e) < 1e3:
                break
            g = gains[j]
            y = (y[0] + g[0] * e, y[1] + g[1] * e, y[2] + g[2] * e, y[3] + g[3] * e, y[4] + g[4] * e)
            for m in range(4):
                memory[m] += g[5 + m] * e
            ring[0] += g[9] * e
            region = _side(y[0] / n - y[2], c.delta)
    return out, contact


@nb.njit(cache=True, nogil=True)
def filter_gains(contact, touching, free, sample_s, noise, deviation, push, fading):
    """Gains of the filter along a run, and the innovations' SD.

    Parameters
    ----------
    contact : array of shape (samples,)
        From `innovations`.
    touching, free : array of shape (10, 10)
        The state's flow over a sampling period with the teeth in contact, and inside the gap.
    sample_s : float
        Sampling period [s].
    noise : float
        SD of a sample [rps].
    deviation : array of shape (10,)
        SD of each state at the start.
    fading : float
        By which the state's SD grows in a sampling period, 1 or a little more.

    Returns
    -------
    array of shape (samples, 10), array of shape (samples,)
        Gains per rps, and SD [rps].
    """
    size = deviation.size
    p = np.diag(deviation**2)
    gains, sd = np.empty((contact.size, size)), np.empty(contact.size)
    for j in range(contact.size):
        flow = touching if contact[j] >= 0.5 else free
        h = flow[0].copy()
        h[0] -= 1.0
        h /= sample_s * TURN
        ph = p @ h
        s = h @ ph + noise * noise
        g = flow @ ph / s
        p = flow @ p @ flow.T
        for a in range(size):
            for b in range(size):
                p[a, b] = (p[a, b] - s * g[a] * g[b]) * fading * fading
        for a in range(size):
            p[a, a] += push[a] ** 2
        gains[j], sd[j] = g, np.sqrt(s)
    return gains, sd
