"""Table 1: which bounds and how many turns the authors' stored runs had, found by replaying them."""

from dataclasses import replace

import numpy as np
import pandas as pd

from replication import published
from replication.compiled.misfit import population_rmse
from replication.datasets import Recording
from replication.search import generations, random_normals
from replication.signature import Box, Timing, table1_box
from replication.studies.inspection import stored_misfits, turn_period

NAMES = ("A", "t0", "tau", "omega", "v_t", "T2", "T1")

# Of the stored runs; the notebook that stores them says that it had widened A's box for a comparison.
POPULATION = 300
LONGEST_WINDOW_S = published.value("table1.T2.max")
AMPLITUDE_FACTOR = 1.3
SAME_RPS = 1e-9  # far above rounding, far below what another bound changes
SAME_STORED_RPS = 1e-6  # the stored parameters have nine digits

# Each bound is tried where Table 1 has it and moved by these shares of the parameter's printed range; 0.15 at both
# ends makes A's box 1.3 times as wide.
SHIFTS = (-0.15, -0.1, -0.01, 0.0, 0.01, 0.1, 0.15)


def replayed(recording: Recording, box: Box, timing: Timing) -> int:
    """How many of the 30 stored runs give their stored first generation in a box."""
    count = 0
    for run in published.authors_notebook_runs().to_dict("records"):
        steps = generations(
            lambda members: population_rmse(recording.t, recording.v, members, timing),
            box,
            random_normals(run["cma_seed"]),
            POPULATION,
        )
        count += abs(next(steps).misfits.min() - run["generation_1_best_rmse_rps"]) < SAME_RPS
    return count


def bounds_by_replay(recording: Recording, timing: Timing) -> pd.DataFrame:
    """First generations of 30 that replay with each bound shifted, the others as the stored runs had them."""
    printed = table1_box(recording.t, recording.v, LONGEST_WINDOW_S)
    stored = table1_box(recording.t, recording.v, LONGEST_WINDOW_S, AMPLITUDE_FACTOR)
    width, rows = printed.upper - printed.lower, []
    for side, ends in (("min", "lower"), ("max", "upper")):
        for i, name in enumerate(NAMES):
            for shift in SHIFTS:
                bounds = getattr(stored, ends).copy()
                bounds[i] = getattr(printed, ends)[i] + shift * width[i]
                count = replayed(recording, replace(stored, **{ends: bounds}), timing)
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
    cells |= {f"table1.T_d.{side}": period / 2 for side in ("min", "max")}
    cells |= {f"table1.T_f.{side}": period for side in ("min", "max")}
    return pd.Series(cells, name="reproduced")


def turns_by_replay(recording: Recording, turns: range = range(8, 17)) -> pd.Series:
    """Stored runs whose misfit is reproduced, by the model's number of turns; more than recorded are alike."""
    stored = published.authors_notebook_runs()["final_rmse_rps"].to_numpy()
    return pd.Series({n: int((np.abs(stored_misfits(recording, n) - stored) < SAME_STORED_RPS).sum()) for n in turns})
