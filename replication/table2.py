"""Table 2: settings of the search, a fit, thirty runs, the table.

The paper gives neither the noise of Table 2 nor all settings of its search: `SETTINGS` and `DRAWN_STARTS` are those
that may have given it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from replication import published
from replication.cmaes import Normals, generations, search
from replication.misfit import cost
from replication.records import RPM_PER_RPS, Recording, level_delta_rad, load_noisy
from replication.signature import MOVEMENT, Box, FloatArray, Parameters, Timing, table1_box

# Columns of a table of runs that hold `Parameters`.
PARAMETER_COLUMNS = ("A_rps", "t0_s", "tau_per_s", "omega_rad_per_s", "v_t_rps", "T2_s", "T1_s")

LEVELS = range(2, 12)  # K of the authors' records behind Table 2's ten rows
ROWS = range(1, 11)
NOISE_ROW = 11  # noise alone
RUNS = 30  # of each record


# --------------------------------------------------------------------------------------------- settings, a fit

WHOLE = "whole record"
# The text begins at a random one of the first 100 samples, and does not say for what one is drawn: most likely for each
# data set, which is a row of Table 2. By start, how the names of protocols end, which seed their noises.
STARTS = {
    WHOLE: "",
    "per row": ", drawn start",
    "per fit": ", start per fit",
    "per table": ", start per table",
}
DRAWN = tuple(STARTS)[1:]


@dataclass(frozen=True)
class SearchSettings:
    """How a fit is run; the defaults are the authors' public notebook.

    The search starts from the middle of the box, with a quarter of its width as standard deviations.
    """

    name: str = "authors' notebook"
    population: int = 300  # members of a generation
    iterations: int = 200  # the most generations
    amplitude_factor: float = 1.3  # how much wider than Table 1's the box of A is
    rpm: bool = False  # the search sees 60 (v - mean v), as equation 10 has A, in place of v [rps]
    start: str = WHOLE  # one of `STARTS`
    timing: Timing = MOVEMENT
    longest_window_s: float = 0.204  # Table 1's upper bound of T2, twice that of T1

    @property
    def protocol(self) -> str:
        """Name of settings and start together."""
        return self.name + STARTS[self.start]


NOTEBOOK = SearchSettings()
# What may have given Table 2. Equation 10 takes A in rpm, Table 1 has a narrower box of A than the public notebook, and
# comments in it say that its population was changed.
SETTINGS = (
    NOTEBOOK,
    SearchSettings("rps, population 300", 300, amplitude_factor=1.0),
    SearchSettings("rps, population 600", 600, amplitude_factor=1.0),
    *(
        SearchSettings(f"rpm, population {population}", population, amplitude_factor=1.0, rpm=True)
        for population in (300, 450, 600, 800, 1000)
    ),
)
RPM_600 = SETTINGS[5]  # what notebook 8 runs
# Both at each drawn start.
DRAWN_STARTS = tuple(
    replace(settings, start=start) for start in DRAWN for settings in (NOTEBOOK, RPM_600)
)


@dataclass(frozen=True)
class Fit:
    """One fitted signature, its misfit [rps], and how many generations the search took."""

    X: Parameters
    rmse: float
    generations: int

    @property
    def amplitude_rps(self) -> float:
        """|A| [rps]: (A, t0) and (-A, t0 plus or minus T_d) are the same signal, so the sign says nothing."""
        return abs(self.X.A)


def search_box(recording: Recording, settings: SearchSettings) -> Box:
    """Table 1's box for a record, as the settings have it."""
    return table1_box(
        recording.t, recording.v, settings.amplitude_factor, settings.longest_window_s
    )


def fit(
    recording: Recording, settings: SearchSettings, seed: int, normals: Normals | None = None
) -> Fit:
    """Fit the signature to a record as the paper does: equations 7 and 11 by equations 12 to 17.

    Parameters
    ----------
    recording : Recording
        The record, already cut to its start sample.
    settings : SearchSettings
    seed : int
        Of the run, above 0.
    normals
        See `cmaes.generations`.

    Raises
    ------
    ValueError
        See `cmaes.generations`.
    """
    mean, unit = (recording.v.mean(), RPM_PER_RPS) if settings.rpm else (0.0, 1.0)
    seen = replace(recording, v=unit * (recording.v - mean))
    steps = generations(
        cost(seen.t, seen.v, settings.timing),
        search_box(seen, settings),
        seed,
        settings.population,
        normals=normals,
    )
    run = search(steps, settings.iterations)
    X = Parameters(*run.best.tolist())
    X = X._replace(A=X.A / unit, v_t=mean + X.v_t / unit)
    return Fit(X, run.misfit / unit, run.generations)


# ------------------------------------------------------------------------------------------- thirty runs, a table


def theoretical_amplitudes() -> dict[float, float]:
    """Table 2's theoretical A [rps] of its ten rows, by backlash [rad]."""
    theoretical = published.column("Table 2", "theoretical")
    return dict(zip(map(level_delta_rad, LEVELS), theoretical, strict=False))


def table2_records(realisations: Iterable[int]) -> list[tuple[dict[str, Any], Recording]]:
    """Load Table 2's ten records for each of some realisations R of the authors' noise, with what says which it is."""
    noise = published.column("Table 2", "noise")
    return [
        (
            {
                "realisation": R,
                "row": row,
                "delta_rad": level_delta_rad(level),
                "noise_amplitude_rps": noise[row - 1],
            },
            load_noisy(level, R),
        )
        for R in realisations
        for row, level in zip(ROWS, LEVELS, strict=True)
    ]


def fit_each(recordings: Iterable[Recording], settings: SearchSettings, seed: int) -> list[Fit]:
    """Fit every record with one seed, whose normal numbers are drawn once."""
    normals = Normals(seed, settings.population, len(Parameters._fields))
    return [fit(recording, settings, seed, normals=normals) for recording in recordings]


def repeated_fits(
    records: Sequence[tuple[dict[str, Any], Recording]],
    settings: SearchSettings,
    seeds: Iterable[int],
) -> pd.DataFrame:
    """Fit every record with every seed, on all cores.

    Parameters
    ----------
    records : sequence of (dict, Recording)
        The dict's entries become columns that say which record it is.

    Returns
    -------
    DataFrame
        A row a run: the record's entries, `seed`, the free parameters, `rmse_rps`, `generations`.
    """
    seeds = list(seeds)
    recordings = [record for _, record in records]
    fits_of_seeds = Parallel(n_jobs=-1)(
        delayed(fit_each)(recordings, settings, seed) for seed in seeds
    )
    plan = [(key, seed) for key, _ in records for seed in seeds]
    fits = [each for of_record in zip(*fits_of_seeds, strict=True) for each in of_record]
    rows = [
        key
        | {"seed": seed}
        | dict(zip(PARAMETER_COLUMNS, each.X, strict=True))
        | {"rmse_rps": each.rmse, "generations": each.generations}
        for (key, seed), each in zip(plan, fits, strict=True)
    ]
    return pd.DataFrame(rows)


# Runs whose misfits differ by less are in one basin: an edge of the window on a sample moves them by up to 0.15 %.
BASIN_GAP = 2e-3


def basin_labels(rmse: FloatArray) -> np.ndarray:
    """Number the basins that runs on one record ended in, from the lowest misfit (1) upwards; shape (runs,).

    A new basin begins where the sorted misfits jump by more than `BASIN_GAP`, relatively.
    """
    rmse = np.asarray(rmse)
    order = np.argsort(rmse, kind="stable")
    jumps = rmse[order][1:] > rmse[order][:-1] * (1 + BASIN_GAP)
    labels = np.empty(rmse.size, dtype=int)
    labels[order] = np.r_[1, 1 + np.cumsum(jumps)]
    return labels


def summarise_runs(runs: pd.DataFrame, keys: Sequence[str]) -> pd.DataFrame:
    """Condense the runs of `repeated_fits` on each record into a row of a table.

    `keys` are the columns that say which record it is. Means and SDs are of |A|; where there is no backlash
    (`theoretical_A_rps` is 0) they are of A, because only noise has no sign to lose. `best_A_rps` and its SD are over
    the runs of the best basin.
    """
    rows = []
    for key, part in runs.groupby(list(keys), sort=False):
        theoretical = part["theoretical_A_rps"].iloc[0]
        amplitude = part["A_rps"].abs() if theoretical > 0 else part["A_rps"]
        labels = basin_labels(part["rmse_rps"].to_numpy())
        best = part["A_rps"].abs()[labels == 1]
        summary = {
            "theoretical_A_rps": theoretical,
            "mean_A_rps": amplitude.mean(),
            "sd_A_rps": amplitude.std(),
            "relative_error_percent": 100 * abs(amplitude.mean() / theoretical - 1)
            if theoretical > 0
            else np.nan,
            "best_A_rps": best.mean(),
            "best_sd_A_rps": best.std(),
            "best_rmse_rps": part["rmse_rps"].min(),
            "best_basin_runs": best.size,
            "basins": labels.max(),
            "runs": len(part),
        }
        rows.append(dict(zip(keys, key, strict=True)) | summary)
    return pd.DataFrame(rows)


def table2(runs: pd.DataFrame) -> pd.DataFrame:
    """Table 2 from runs on the records of `table2_records`: a row for each realisation and row."""
    theoretical = published.column("Table 2", "theoretical")[runs["row"] - 1]
    keys = ["realisation", "row", "delta_rad", "noise_amplitude_rps"]
    return summarise_runs(runs.assign(theoretical_A_rps=theoretical), keys)
