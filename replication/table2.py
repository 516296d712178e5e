"""Table 2: settings of the search, fits of its records, the table that they give, the two claims that it decides."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pandas as pd

from replication import published
from replication.arrays import FloatArray, IntArray
from replication.cmaes import Eigensolver, generations, random_normals
from replication.misfit import fold, population_rmse
from replication.parallel import in_parallel
from replication.records import RPM_PER_RPS, Recording, level_delta_rad
from replication.signature import (
    DAMPING_PER_S,
    FREE_PARAMETERS,
    FREQUENCY_HZ,
    Box,
    Parameters,
    Timing,
    table1_box,
)
from replication.stopping import search

# Runs whose misfits differ by less are the same basin: rounding at a window's end moves them by up
# to 0.15 %.
BASIN_GAP = 2e-3
LEVEL = 0.95  # of an interval


# ---------------------------------------------------------------------------------------------- one fit


@dataclass(frozen=True)
class SearchSettings:
    """How one CMA-ES fit is run; the defaults are the authors' notebook.

    The search starts from the middle of the box, with a quarter of its width as standard
    deviations. "per record" drops up to `latest_start` samples, drawn once, from a record's beginning.
    """

    name: str = "authors' notebook"  # what tables call it
    population: int = 300  # members of a generation
    iterations: int = 200  # the most generations
    amplitude_factor: float = 1.3  # how much wider than Table 1's the box of A is
    longest_window_s: float = 0.204  # Table 1's upper bound of T2, twice that of T1
    damping_per_s: tuple[float, float] = DAMPING_PER_S  # bounds of tau
    frequency_hz: tuple[float, float] = FREQUENCY_HZ  # bounds of omega over 2 pi
    start_s: tuple[float, float] | None = None  # bounds of t0; None: the whole record
    T_d: float = 0.2  # delay of the second oscillation [s]
    T_f: float = 0.4  # turn period [s]
    turns: int = 12  # n of the model
    start: str = "whole"  # or "per record"
    latest_start: int = 100  # sample
    rpm: bool = False  # the search sees 60 (v - mean v), as equation 10 has A, and not v in rps

    @property
    def timing(self) -> Timing:
        """The fixed part of the signature."""
        return Timing(self.T_d, self.T_f, self.turns)


@dataclass(frozen=True)
class Fit:
    """One fitted signature: its `Parameters`, its misfit [rps], what the search spent."""

    X: FloatArray
    rmse: float
    evaluations: int
    iterations: int

    @property
    def amplitude_rps(self) -> float:
        """|A| [rps]: (A, t0) and (-A, t0 plus or minus T_d) are the same signal, so the sign says nothing."""
        return float(abs(Parameters(*self.X).A))


def search_box(recording: Recording, settings: SearchSettings) -> Box:
    """Table 1's box for a record, as the settings widen it."""
    return table1_box(
        recording.t,
        recording.v,
        settings.longest_window_s,
        settings.amplitude_factor,
        settings.damping_per_s,
        settings.frequency_hz,
        settings.start_s,
    )


AUTHORS_SETTINGS = SearchSettings()


def cost(recording: Recording, settings: SearchSettings) -> Callable[[FloatArray], FloatArray]:
    """The paper's cost on a record: from members of shape (population, 7) to their misfits."""
    record = fold(recording.t, recording.v, settings.timing)
    return lambda members: population_rmse(members, record)


def fit(
    recording: Recording, settings: SearchSettings, seed: int, eigen: Eigensolver = np.linalg.eigh
) -> Fit:
    """Fit the signature to a record by CMA-ES, as the paper does (equations 7 and 11 to 17).

    Parameters
    ----------
    recording : Recording
        The record, already cut to its start sample.
    seed : int
        Seed of the run, above 0.
    eigen : callable
        See `cmaes.generations`.

    Raises
    ------
    ValueError
        See `cmaes.generations`, `stopping.search` and `misfit.fold`.
    """
    mean, unit = (recording.v.mean(), RPM_PER_RPS) if settings.rpm else (0.0, 1.0)
    seen = replace(recording, v=unit * (recording.v - mean)) if settings.rpm else recording
    steps = generations(
        cost(seen, settings),
        search_box(seen, settings),
        random_normals(seed),
        settings.population,
        eigen=eigen,
    )
    run = search(steps, settings.iterations)
    best = Parameters(*run.best)
    X = np.array(best._replace(A=best.A / unit, v_t=mean + best.v_t / unit))
    return Fit(X, run.misfit / unit, run.evaluations, len(run.history))


# -------------------------------------------------------------------------------------------- thirty fits


def table2_levels() -> range:
    """Numbers K of the authors' records behind Table 2's ten rows."""
    return range(2, 2 + int(published.value("text.levels")))


def theoretical_amplitudes() -> dict[float, float]:
    """Table 2's theoretical A [rps] of its ten rows, by backlash [rad]."""
    theoretical = published.column("Table 2", "theoretical")
    return dict(zip(map(level_delta_rad, table2_levels()), theoretical, strict=False))


def table2_records(
    realisations: Sequence[int], load_noisy: Callable[[int, int], Recording]
) -> list[tuple[dict, Recording]]:
    """Load Table 2's ten records for each of some realisations R of the noise.

    `load_noisy` gives the record of a level K and a realisation, such as `records.read_noisy`.
    """
    if not realisations:
        raise ValueError("realisations []: name some of 1 to 5")
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
        for row, level in enumerate(table2_levels(), start=1)
    ]


def repeated_fits(
    records: Sequence[tuple[dict, Recording]],
    settings: Iterable[SearchSettings],
    seeds: Sequence[int],
    label: str,
    fit: Callable[[Recording, SearchSettings, int], Fit] = fit,
) -> pd.DataFrame:
    """Fit every record with all settings and seeds, on all cores; the label stands beside the progress bar.

    Parameters
    ----------
    records : sequence of (dict, Recording)
        The dict's entries become columns that say which record it is.

    Returns
    -------
    DataFrame
        A row for each run: the record's entries, `protocol`, `seed`, the free parameters, `rmse_rps`, `evaluations`,
        `iterations`.

    Raises
    ------
    ValueError
        There are no seeds, or see `fit`.
    """
    if not len(seeds):
        raise ValueError("no seeds: at least one run of each record is needed")
    plan = list(product(settings, records, seeds))
    calls = [(recording, each, seed) for each, (_, recording), seed in plan]
    fits = in_parallel(fit, calls, label)
    return pd.DataFrame(
        [
            key
            | {"protocol": each.name, "seed": seed}
            | dict(zip(FREE_PARAMETERS, fitted.X, strict=True))
            | {
                "rmse_rps": fitted.rmse,
                "evaluations": fitted.evaluations,
                "iterations": fitted.iterations,
            }
            for (each, (key, _), seed), fitted in zip(plan, fits, strict=True)
        ]
    )


def basin_labels(rmse: FloatArray) -> IntArray:
    """Number the basins that runs on one record ended in, from the lowest misfit (1) upwards; shape (runs,).

    A new basin begins where the sorted final misfit jumps by more than `BASIN_GAP`, relatively.
    """
    order = np.argsort(rmse, kind="stable")
    ranked = np.asarray(rmse)[order]
    labels = np.empty(ranked.size, dtype=np.int64)
    labels[order] = np.r_[1, 1 + np.cumsum(ranked[1:] > ranked[:-1] * (1 + BASIN_GAP))]
    return labels


def summarise_runs(runs: pd.DataFrame, keys: Sequence[str]) -> pd.DataFrame:
    """Condense the runs of `repeated_fits` on each record into a row of a table.

    `keys` are the columns that say which record it is, the last one its theoretical A [rps]. A
    record without backlash, whose theoretical A is 0, keeps the sign of A. `best_A_rps` and its SD
    are over the best basin's runs, because A is free within the window's gate.
    """
    rows = []
    for key, part in runs.groupby(list(keys), sort=False):
        theoretical = key[-1]
        signed = part["A_rps"].to_numpy()
        # (A, t0) and (-A, t0 plus or minus T_d) are the same signal; only pure noise has no sign to
        # lose.
        amplitude = np.abs(signed) if theoretical > 0 else signed
        mean = amplitude.mean()
        error = 100 * abs(mean - theoretical) / theoretical if theoretical > 0 else np.nan
        labels = basin_labels(part["rmse_rps"].to_numpy())
        best = np.abs(signed)[labels == 1]
        summary = {
            "mean_A_rps": mean,
            "sd_A_rps": amplitude.std(ddof=1),
            "relative_error_percent": error,
            "best_A_rps": best.mean(),
            "best_sd_A_rps": best.std(),
            "best_rmse_rps": part["rmse_rps"].min(),
            "best_basin_runs": best.size,
            "basins": int(labels.max()),
            "runs": len(part),
        }
        rows.append(dict(zip(keys, key, strict=True)) | summary)
    return pd.DataFrame(rows)


def table2(runs: pd.DataFrame) -> pd.DataFrame:
    """Condense the runs on the records of `table2_records`: a row for each realisation and row."""
    theoretical = published.column("Table 2", "theoretical")[runs["row"] - 1]
    of_record = ["realisation", "row", "delta_rad", "noise_amplitude_rps"]
    return summarise_runs(
        runs.assign(theoretical_A_rps=theoretical), [*of_record, "theoretical_A_rps"]
    )


def predictive_region(values: Sequence[float]) -> tuple[float, float]:
    """Ends between which one more number like these lies with at least 95 %: order statistics, no law assumed.

    Of N numbers the k-th smallest and the k-th largest, k the largest with 1 - 2 k / (N + 1) >= 95 %.
    Anywhere, where N is below 39.
    """
    k = int((len(values) + 1) * (1 - LEVEL) / 2 + 1e-9)
    ranked = sorted(values)
    return (ranked[k - 1], ranked[-k]) if k else (-np.inf, np.inf)


def error_percent(table: pd.DataFrame, column: str) -> pd.Series:
    """How far a column of A lies from the printed means [%]."""
    printed = published.column("Table 2", "mean")[table["row"] - 1]
    return 100 * (table[column] / printed - 1)
