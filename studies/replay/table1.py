"""Table 1: which bounds the authors' stored runs had, found by replaying them."""

from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
from tqdm import tqdm

from replication import published
from replication.cmaes import generations, random_normals
from replication.records import Recording
from replication.signature import Box, Parameters
from replication.table2 import AUTHORS_SETTINGS, cost, search_box
from studies.replay import AGREE_RPS
from studies.replay.inspection import turn_period

NAMES = Parameters._fields

# Each bound is tried where Table 1 has it and moved by these shares of the parameter's printed range; 0.15 at both
# ends makes A's box 1.3 times as wide.
SHIFTS = (-0.15, -0.1, -0.01, 0.0, 0.01, 0.1, 0.15)


def count_replayed(recording: Recording, box: Box) -> int:
    """How many of the 30 stored runs give their stored first generation in a box."""
    misfits = cost(recording, AUTHORS_SETTINGS)

    def first_best(seed: int) -> float:
        steps = generations(misfits, box, random_normals(seed), AUTHORS_SETTINGS.population)
        return next(steps).misfits.min()

    stored = published.table("authors_notebook_runs")
    best = stored["cma_seed"].map(first_best)
    return int(((best - stored["generation_1_best_rmse_rps"]).abs() < AGREE_RPS).sum())


def bounds_by_replay(recording: Recording) -> pd.DataFrame:
    """First generations of 30 that replay with each bound shifted, the others as stored."""
    stored = search_box(recording, AUTHORS_SETTINGS)
    printed = search_box(recording, replace(AUTHORS_SETTINGS, amplitude_factor=1.0))
    width = printed.upper - printed.lower
    sides = ("min", "lower"), ("max", "upper")
    rows = []
    trials = list(product(sides, enumerate(NAMES), SHIFTS))
    for (side, end), (i, name), shift in tqdm(trials):
        bounds = getattr(stored, end).copy()
        bounds[i] = getattr(printed, end)[i] + shift * width[i]
        count = count_replayed(recording, replace(stored, **{end: bounds}))
        rows.append((f"table1.{name}.{side}", shift, bounds[i], count))
    return pd.DataFrame(rows, columns=["cell", "shift", "bound", "replayed"])


def table1_cells(recording: Recording, tried: pd.DataFrame) -> pd.Series:
    """Table 1's cells: the bound at which most stored runs replay (NaN if two do), and the turn period of a record."""
    t, v = recording.t, recording.v
    shift = {"t0": t[0], "v_t": v.min()}
    scale = {"A": np.ptp(v), "t0": np.ptp(t), "v_t": np.ptp(v)}
    cells = {}
    for cell, part in tried.groupby("cell", sort=False):
        best = part[part["replayed"] == part["replayed"].max()]
        name = cell.split(".")[1]
        bound = best["bound"].iloc[0] if len(best) == 1 else np.nan
        cells[cell] = (bound - shift.get(name, 0.0)) / scale.get(name, 1.0)
    period = turn_period(recording)
    for side in ("min", "max"):
        cells |= {f"table1.T_d.{side}": period / 2, f"table1.T_f.{side}": period}
    return pd.Series(cells, name="reproduced")
