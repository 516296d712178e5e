"""Table 2: settings of the search, a fit, thirty runs, the table, and the table made again and again.

The paper gives neither the noise of Table 2 nor all settings of its search. So the table is made again many times, each
time with a noise and seeds of its own, under each of `SETTINGS` and `DRAWN_STARTS`;
`results/table2_realisations.csv` keeps the means and SDs, because they take hours.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy import optimize

from replication import published
from replication.cmaes import Eigensolver, Normals, generations, search
from replication.files import ROOT, check_kept, write_kept
from replication.misfit import PROJECTED, cost, fold, project
from replication.records import (
    RPM_PER_RPS,
    Recording,
    add_noise,
    constant_speed,
    from_sample,
    level_delta_rad,
    load_clean,
    load_noisy,
    simulate_clean,
)
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
    recording: Recording,
    settings: SearchSettings,
    seed: int,
    eigen: Eigensolver = np.linalg.eigh,
    normals: Normals | None = None,
) -> Fit:
    """Fit the signature to a record as the paper does: equations 7 and 11 by equations 12 to 17.

    Parameters
    ----------
    recording : Recording
        The record, already cut to its start sample.
    settings : SearchSettings
    seed : int
        Of the run, above 0.
    eigen, normals
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
        eigen,
        normals,
    )
    run = search(steps, settings.iterations)
    X = Parameters(*run.best.tolist())
    X = X._replace(A=X.A / unit, v_t=mean + X.v_t / unit)
    return Fit(X, run.misfit / unit, run.generations)


def best_fit(recording: Recording, settings: SearchSettings = NOTEBOOK) -> Fit:
    """Find the least misfit in the box: the model is linear in A and v_t, so only five parameters are searched.

    `misfit.project` gives a shape (t0, tau, omega, T2, T1) its A and v_t. CMA-ES finds one oscillation. Half a period
    earlier or later, with the other sign, it fits nearly as well in another window: each of these is a basin of its
    own, so all are compared. Of what fits equally well, T1 lies midway between two samples: a window may open up to one
    sample earlier with the same samples, and a larger A.

    Raises
    ------
    ValueError
        The record cannot be folded (see `misfit.fold`), or is constant.
    """
    record = fold(recording.t, recording.v, settings.timing)
    box = search_box(recording, settings)
    if record is None or box.upper[0] == 0:
        raise ValueError(f"{recording.source}: constant, or half a turn is no number of samples")
    shapes_box = Box(box.lower[PROJECTED], box.upper[PROJECTED])

    def misfits(shapes: FloatArray) -> FloatArray:
        return project(np.clip(shapes, *shapes_box), record, box.upper[0])[1]

    run = search(generations(misfits, shapes_box, 1, 600), settings.iterations)
    shape = run.best
    better = True
    while better:  # by a thousandth: basins that differ by less are one, see `BASIN_GAP`
        basins = np.array([shape, *_best_basins(misfits, shape, shapes_box, record.dt)])
        depths = misfits(basins)
        better = depths.min() < 0.999 * depths[0]
        shape = basins[depths.argmin()]
    shape = _best_window(misfits, shape, record.dt)
    members, (misfit,) = project(np.clip(shape, *shapes_box)[None], record, box.upper[0])
    X = Parameters(*members[0].tolist())
    opening = np.ceil((X.t0 + X.T1 - record.t0) / record.dt) - 0.5
    T1 = float(np.clip(record.t0 + opening * record.dt - X.t0, 0, box.upper[6]))
    A = X.A * np.exp(-(T1 - X.T1) * X.tau)
    return Fit(X._replace(A=float(A), T1=T1), float(misfit), run.generations)


# First steps of t0 [s], tau [1/s] and omega [rad/s], small parts of a period, a decay and a bandwidth. Which samples a
# window holds is discrete, so it stays where it is while they move.
SMOOTH_STEPS = np.array([[2e-3, 0, 0, -2e-3, -2e-3], [0, 1, 0, 0, 0], [0, 0, 3, 0, 0]])
Misfits = Callable[[FloatArray], FloatArray]  # of shapes, shape (number, 5)


def _best_basins(misfits: Misfits, shape: FloatArray, box: Box, dt: float) -> list[FloatArray]:
    """The three best of the basins up to nine half periods before and after a shape, at their bottoms.

    Nine half periods of the paper's ring are half a turn, after which the signature is itself with the other sign. In
    its best window a basin is not yet at its bottom, and may not be the best one: hence three.
    """
    T1, T2 = np.meshgrid(np.arange(0, box.upper[4], dt), np.arange(0, box.upper[3], 2 * dt))
    windows = np.tile(shape, (T1.size, 1))
    windows[:, 3], windows[:, 4] = T2.ravel(), T1.ravel()
    half_period = np.array([np.pi / shape[2], 0, 0, 0, 0])
    basins = []
    for k in range(-9, 10):
        depths = misfits(windows + k * half_period)
        basins.append((depths.min(), windows[depths.argmin()] + k * half_period))
    basins.sort(key=lambda basin: basin[0])
    return [_descend(misfits, basin, SMOOTH_STEPS, 1e-2) for _, basin in basins[:3]]


def _best_window(misfits: Misfits, shape: FloatArray, dt: float) -> FloatArray:
    """Move the edges of the window by whole samples, then everything."""
    moves = [(0, 0, 0, T2, T1 / 2) for T2 in range(-12, 13) for T1 in range(-12, 13)]
    windows = shape + dt * np.array(moves)
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
    return shape + end.x @ steps


# ------------------------------------------------------------------------------------------- thirty runs, a table


def theoretical_amplitudes() -> dict[float, float]:
    """Table 2's theoretical A [rps] of its ten rows, by backlash [rad]."""
    theoretical = published.column("Table 2", "theoretical")
    return dict(zip(map(level_delta_rad, LEVELS), theoretical, strict=False))


def table2_records(realisations: Iterable[int]) -> list[tuple[dict, Recording]]:
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
    records: Sequence[tuple[dict, Recording]], settings: SearchSettings, seeds: Iterable[int]
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


# --------------------------------------------------------------------------------- Table 2, again and again

REALISATIONS = ROOT / "results" / "table2_realisations.csv"
STUDY_SEED = 2027


def draw_starts(settings: SearchSettings, realisation: int, rng: np.random.Generator) -> np.ndarray:
    """Draw the first samples of a row's thirty fits, of the first 100, for each fit, row or table; shape (30,)."""
    if settings.start == WHOLE:
        return np.zeros(RUNS, int)
    if settings.start == "per table":  # whose rows share a stream
        rng = np.random.default_rng((STUDY_SEED, *settings.protocol.encode(), realisation))
    return np.broadcast_to(rng.integers(100, size=RUNS if settings.start == "per fit" else 1), RUNS)


def noisy_records(
    settings: SearchSettings, row: int, realisation: int
) -> list[tuple[Recording, int]]:
    """Draw a noise of the printed amplitude, and of each of a row's thirty fits the record and the seed.

    No other settings have the same. Row 1's clean record is not public, so our joint's takes its place.
    """
    rng = np.random.default_rng((STUDY_SEED, *settings.protocol.encode(), realisation, row))
    if row == NOISE_ROW:
        clean = constant_speed()
    else:
        level = LEVELS[row - 1]
        clean = simulate_clean(level) if row == 1 else load_clean(level)
    record = add_noise(clean, published.column("Table 2", "noise")[row - 1], rng)
    starts = draw_starts(settings, realisation, rng)
    seeds = rng.integers(1, 2**31, RUNS)
    return [
        (from_sample(record, int(start)), int(seed))
        for start, seed in zip(starts, seeds, strict=True)
    ]


def realise(settings: SearchSettings, row: int, realisation: int) -> dict[str, object]:
    """Make one row of Table 2 again: the mean and SD [rps] over thirty runs, and the best basin's share of them."""
    records = noisy_records(settings, row, realisation)
    fits = [fit(record, settings, seed) for record, seed in records]
    A = np.array([each.X.A if row == NOISE_ROW else each.amplitude_rps for each in fits])
    in_best = basin_labels(np.array([each.rmse for each in fits])) == 1
    return {
        "protocol": settings.protocol,
        "realisation": realisation,
        "row": row,
        "mean_A_rps": A.mean(),
        "sd_A_rps": A.std(ddof=1),
        "best_basin_share": in_best.mean(),
    }


def read_realisations(path: Path = REALISATIONS) -> pd.DataFrame:
    """The realisations that are kept, under each protocol as many of each of rows 1 to 10: the rows of `realise`."""
    check_kept(path)
    table = pd.read_csv(path)
    made = table[table["row"].isin(ROWS)].groupby(["protocol", "row"]).size()
    whole = made.groupby("protocol").min()
    return table[table["realisation"] <= table["protocol"].map(whole)]


def make_realisations(path: Path = REALISATIONS, number: int = 40) -> None:
    """Make Table 2 again so many times under each setting, into a table that grows; it resumes if it was interrupted.

    Row 11, noise alone, is made ten times with the whole record.
    """
    for realisation in range(1, number + 1):
        table = (
            pd.read_csv(path)
            if path.exists()
            else pd.DataFrame(columns=["protocol", "realisation", "row"])
        )
        made = table[table["realisation"] == realisation]
        there = {*zip(made["protocol"], made["row"], strict=True)}
        plan = [
            (settings, row, realisation)
            for settings in (*SETTINGS, *DRAWN_STARTS)
            for row in ((*ROWS, NOISE_ROW) if settings in SETTINGS and realisation <= 10 else ROWS)
            if (settings.protocol, row) not in there
        ]
        rows = Parallel(n_jobs=-1)(delayed(realise)(*arguments) for arguments in plan)
        new = pd.DataFrame(rows)
        write_kept(path, pd.concat([table, new]) if len(table) else new)
