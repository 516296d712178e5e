"""The least misfit of a record, which is no step of the paper: its searches are held to it.

The model is linear in A and v_t, so only five parameters are searched. CMA-ES finds one oscillation. Half a period
earlier or later, with the other sign, it fits nearly as well in another window: each of these is a basin of its own, so
all are compared.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import optimize

from replication.cmaes import generations, search
from replication.misfit import PROJECTED, fold, project
from replication.records import Recording
from replication.signature import Box, FloatArray, Parameters
from replication.table2 import NOTEBOOK, Fit, SearchSettings, search_box

POPULATION = 600
# Basins on either side that are compared: nine half periods of the paper's ring are half a turn, after which the
# signature is itself with the other sign.
HALF_PERIODS = 9
FINALISTS = 3  # in its best window a basin is not yet at its bottom, and may not be the best one
MOST_SAMPLES = 12  # by which an edge of the window is moved at last
BETTER = 0.999  # of a misfit; basins that differ by less are one, see `table2.BASIN_GAP`
# First steps of t0 [s], tau [1/s] and omega [rad/s], small parts of a period, a decay and a bandwidth. Which samples a
# window holds is discrete, so it stays where it is while they move.
SMOOTH_STEPS = np.array([[2e-3, 0, 0, -2e-3, -2e-3], [0, 1, 0, 0, 0], [0, 0, 3, 0, 0]])
Misfits = Callable[
    [FloatArray], FloatArray
]  # of shapes (t0, tau, omega, T2, T1), shape (number, 5)


def best_fit(recording: Recording, settings: SearchSettings = NOTEBOOK) -> Fit:
    """Find the least misfit in the box of some settings.

    `misfit.project` gives a shape (t0, tau, omega, T2, T1) its A and v_t. Of what fits equally well, T1 lies midway
    between two samples: a window may open up to one sample earlier with the same samples, and a larger A.

    Raises
    ------
    ValueError
        The record cannot be folded (see `misfit.fold`), or is constant.
    """
    record = fold(recording.t, recording.v, settings.timing)
    lower, upper = search_box(recording, settings)
    largest = Parameters(*upper.tolist())
    if record is None or largest.A == 0:
        raise ValueError(f"{recording.source}: constant, or half a turn is no number of samples")
    box = Box(lower[PROJECTED], upper[PROJECTED])

    def project_shapes(shapes: FloatArray) -> Any:
        return project(np.clip(shapes, *box), record, largest.A)

    def misfits(shapes: FloatArray) -> Any:
        return project_shapes(shapes)[1]

    run = search(generations(misfits, box, 1, POPULATION), settings.iterations)
    shape = run.best
    better = True
    while better:
        basins = np.array([shape, *_best_basins(misfits, shape, box, record.dt)])
        depths = misfits(basins)
        better = depths.min() < BETTER * depths[0]
        shape = basins[depths.argmin()]
    members, (misfit,) = project_shapes(_best_window(misfits, shape, record.dt)[None])
    X = Parameters(*members[0].tolist())
    opening = np.ceil((X.t0 + X.T1 - record.t0) / record.dt) - 0.5
    T1 = float(np.clip(record.t0 + opening * record.dt - X.t0, 0, largest.T1))
    A = float(X.A * np.exp(-(T1 - X.T1) * X.tau))
    return Fit(X._replace(A=A, T1=T1), float(misfit), run.generations)


def _best_basins(misfits: Misfits, shape: FloatArray, box: Box, dt: float) -> list[FloatArray]:
    """The best of the basins some half periods before and after a shape, at their bottoms."""
    T1, T2 = np.meshgrid(np.arange(0, box.upper[4], dt), np.arange(0, box.upper[3], 2 * dt))
    windows = np.tile(shape, (T1.size, 1))
    windows[:, 3], windows[:, 4] = T2.ravel(), T1.ravel()
    half_period = np.array([np.pi / shape[2], 0, 0, 0, 0])
    basins = []
    for k in range(-HALF_PERIODS, HALF_PERIODS + 1):
        depths = misfits(windows + k * half_period)
        basins.append((depths.min(), windows[depths.argmin()] + k * half_period))
    basins.sort(key=lambda basin: basin[0])
    return [_descend(misfits, basin, SMOOTH_STEPS, 1e-2) for _, basin in basins[:FINALISTS]]


def _best_window(misfits: Misfits, shape: FloatArray, dt: float) -> FloatArray:
    """Move the edges of the window by whole samples, then everything."""
    moves = range(-MOST_SAMPLES, MOST_SAMPLES + 1)
    windows = shape + dt * np.array([(0, 0, 0, T2, T1 / 2) for T2 in moves for T1 in moves])
    window = windows[misfits(windows).argmin()]
    return _descend(misfits, window, np.diag([dt, 1.0, 1.0, dt, dt]), 1e-4)


def _descend(
    misfits: Misfits, shape: FloatArray, steps: FloatArray, tolerance: float
) -> FloatArray:
    """Go down from a shape by the simplex method, which first tries the rows of `steps`."""
    directions = len(steps)
    end = optimize.minimize(
        lambda z: misfits((shape + z @ steps)[None])[0],
        np.zeros(directions),
        method="Nelder-Mead",
        options={
            "initial_simplex": np.eye(directions + 1, directions, -1),
            "xatol": tolerance,
            "fatol": 1e-4 * tolerance,
            "maxiter": 600,
        },
    )
    bottom: FloatArray = shape + end.x @ steps
    return bottom
