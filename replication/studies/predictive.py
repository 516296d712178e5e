"""What a pool of runs predicts that a table would print, and how likely that makes the printed one."""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from replication.table2 import basin_labels

FloatArray = NDArray[np.float64]

RUNS = 30  # of a printed row
DRAWS = 4000
OTHER = 0.01
OTHER_MEAN = 0.1  # half-width, relative to the theoretical A
OTHER_SD_RPS = (0.0003, 0.3)
LEAST_SD_WIDTH = 0.13


def predicted(pools: Sequence[FloatArray], rng: np.random.Generator, draws: int = DRAWS) -> FloatArray:
    """Draw what a table would print of a row.

    Parameters
    ----------
    pools : sequence of arrays
        |A| of runs, one array a realisation, as `pools.realisations` gives them.
    rng : Generator
        Where the draws come from.
    draws : int
        How many.

    Returns
    -------
    array of shape (draws, 2)
        Mean and SD of `RUNS` runs on a realisation drawn from the pools, its pool resampled first: it is finite.
    """
    which = rng.integers(len(pools), size=draws)
    table = np.empty((draws, 2))
    for index, pool_of_one in enumerate(pools):
        rows = np.flatnonzero(which == index)
        resampled = pool_of_one[rng.integers(pool_of_one.size, size=(rows.size, pool_of_one.size))]
        drawn = np.take_along_axis(resampled, rng.integers(pool_of_one.size, size=(rows.size, RUNS)), axis=1)
        table[rows] = np.column_stack([drawn.mean(axis=1), drawn.std(axis=1, ddof=1)])
    return table


def widths(runs: pd.DataFrame) -> tuple[float, float]:
    """How far R = 1 and R = 2 are apart in the best basin, rms over the rows: ln mean and ln SD of |A|.

    These are the kernel's widths, the SD's not below `LEAST_SD_WIDTH`.
    """
    best = best_basins(runs[runs["record"].isin(["R1", "R2"])])
    apart = {
        name: np.diff(np.log(best[name].unstack("record").to_numpy(float)), axis=1) for name in ("mean_rps", "sd_rps")
    }
    mean, sd = (float(np.sqrt(np.mean(apart[name] ** 2))) for name in ("mean_rps", "sd_rps"))
    return mean, max(sd, LEAST_SD_WIDTH)


def best_basins(runs: pd.DataFrame) -> pd.DataFrame:
    """Best basin of each record and row of a pool: `mean_rps, sd_rps` of |A|, `share` of the runs, and all `runs`."""
    rows = []
    for (label, row), part in runs.groupby(["record", "row"]):
        best = basin_labels(part["rmse_rps"].to_numpy()) == 0
        A = part["A_rps"].abs().to_numpy()[best]
        rows.append((label, row, A.mean(), A.std(ddof=1) if A.size > 1 else np.nan, best.mean(), best.size))
    table = pd.DataFrame(rows, columns=["record", "row", "mean_rps", "sd_rps", "share", "runs"])
    return table.set_index(["row", "record"])


def log_likelihood(points: FloatArray, drawn: FloatArray, width: tuple[float, float], theoretical: float) -> FloatArray:
    """Natural log of the kernel density of ln mean and ln SD at some points.

    Parameters
    ----------
    points : array of shape (points, 2)
        Means and SDs [rps].
    drawn : array of shape (draws, 2)
        From `predicted`.
    width : two floats
        From `widths`.
    theoretical : float
        The row's theoretical A [rps], which anything else lies around.

    Returns
    -------
    array of shape (points,)
    """
    x, centres = np.log(points), np.log(np.maximum(drawn, 1e-9))  # a small pool may give runs that are all the same
    squared = sum(((x[:, None, i] - centres[None, :, i]) / width[i]) ** 2 for i in (0, 1))
    kernel = np.exp(-squared / 2).mean(axis=1) / (2 * np.pi * width[0] * width[1])
    area = math.log((1 + OTHER_MEAN) / (1 - OTHER_MEAN)) * math.log(OTHER_SD_RPS[1] / OTHER_SD_RPS[0])
    low = theoretical * np.array([1 - OTHER_MEAN]), theoretical * np.array([1 + OTHER_MEAN])
    inside = (low[0] <= points[:, 0]) & (points[:, 0] <= low[1])
    inside &= (OTHER_SD_RPS[0] <= points[:, 1]) & (points[:, 1] <= OTHER_SD_RPS[1])
    return np.log((1 - OTHER) * kernel + OTHER * np.where(inside, 1 / area, 1e-9))
