"""Table 2: its records, repeated fits of them, the table that they give, and the two claims that it decides."""

from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np
import pandas as pd
from scipy import stats

from replication import published
from replication.arrays import FloatArray, IntArray
from replication.authors import HIGH_NOISE, HIGH_OVER_LOW, level_delta_rad, load_noisy
from replication.identify import Protocol, paper_fit
from replication.parallel import in_parallel
from replication.published import Criteria, Decision
from replication.recording import Recording, add_uniform_noise, constant_speed, from_sample
from replication.signature import FREE_PARAMETERS
from replication.simulator.parameters import JointParameters
from replication.simulator.recordings import simulate_recordings

AUTHORS_PROTOCOL = Protocol()

# Runs whose misfits differ by less are the same basin: rounding at a window's end moves them by up
# to 0.15 %.
BASIN_GAP = 2e-3
BOOTSTRAP_DRAWS = 20000


def table2_levels() -> range:
    """Numbers K of the authors' records behind Table 2's ten rows."""
    return range(2, 2 + int(published.value("text.levels")))


def theoretical_amplitudes() -> dict[float, float]:
    """Table 2's theoretical A [rps] of its ten rows, by backlash [rad]."""
    theoretical = published.column("Table 2", "theoretical")
    return {
        level_delta_rad(level): A for level, A in zip(table2_levels(), theoretical, strict=False)
    }


def authors_table2_records(realisations: Sequence[int]) -> list[tuple[dict, Recording]]:
    """Load the authors' noisy records of Table 2's ten rows, for each of some realisations R of either noise."""
    if not realisations:
        raise ValueError(
            "realisations []: name some of 1 to 5 (low noise) and 11 to 20 (high noise)"
        )
    return [
        (_key("authors", R, row, "high" if R in HIGH_NOISE else "low"), load_noisy(level, R))
        for R in realisations
        for row, level in enumerate(table2_levels(), start=1)
    ]


def simulated_table2_records(
    joint: JointParameters, seed: int, factor: float = 1.0
) -> list[tuple[dict, Recording]]:
    """Simulate Table 2's ten records: the joint at each level, with `factor` times the printed uniform noise."""
    noise = factor * published.column("Table 2", "noise")
    rng = np.random.default_rng(seed)
    clean = simulate_recordings(joint, [level_delta_rad(level) for level in table2_levels()])
    return [
        (
            _key("simulated", seed, row, "low", factor),
            add_uniform_noise(recording, noise[row - 1], rng),
        )
        for row, recording in enumerate(clean, start=1)
    ]


def noise_only_record(seed: int, factor: float = 1.0) -> tuple[dict, Recording]:
    """Make Table 2's last record: constant speed with uniform noise of `factor` times its printed amplitude."""
    key = _key("simulated", seed, len(table2_levels()) + 1, "noise only", factor)
    base = constant_speed(samples=2401, dt=0.002)
    return key, add_uniform_noise(base, key["noise_amplitude_rps"], np.random.default_rng(seed))


def _key(source: str, realisation: int, row: int, noise_level: str, factor: float = 1.0) -> dict:
    """What a record of Table 2's row is called in data frames.

    A simulated realisation is the seed of its noise.
    """
    louder = HIGH_OVER_LOW if noise_level == "high" else factor
    return {
        "source": source,
        "realisation": realisation,
        "row": row,
        "delta_rad": 0.0
        if noise_level == "noise only"
        else level_delta_rad(table2_levels()[row - 1]),
        "noise_level": noise_level,
        "noise_amplitude_rps": published.column("Table 2", "noise")[row - 1] * louder,
    }


def start_samples(
    protocol: Protocol, seeds: Sequence[int], record_seed: int | Sequence[int]
) -> list[int]:
    """Draw the start sample of each run of a record, as the protocol's `start` says."""

    def draw(seed: int | Sequence) -> int:
        return int(np.random.default_rng(seed).integers(protocol.latest_start))

    if protocol.start == "whole":
        return [0] * len(seeds)
    if protocol.start == "per record":
        return [draw(record_seed)] * len(seeds)
    if protocol.start == "per run":
        return [draw((record_seed, seed)) for seed in seeds]
    raise ValueError(f"start {protocol.start!r}: expected 'whole', 'per run' or 'per record'")


def _run(recording: Recording, protocol: Protocol, seed: int, start: int) -> dict[str, float]:
    fit = paper_fit(from_sample(recording, start), protocol, seed)
    found = dict(zip(FREE_PARAMETERS, fit.X, strict=True))
    spent = {"rmse_rps": fit.rmse, "evaluations": fit.evaluations, "iterations": fit.iterations}
    return {"seed": seed, "start_sample": start} | found | spent


def repeated_fits(
    records: Sequence[tuple[dict, Recording]],
    protocols: Iterable[Protocol],
    seeds: Sequence[int],
    label: str,
) -> pd.DataFrame:
    """Fit every record with every protocol and seed, on all cores; the label stands beside the progress bar.

    Parameters
    ----------
    records : sequence of (dict, Recording)
        The dict's entries become columns that say which record it is.

    Returns
    -------
    DataFrame
        A row for each run: the record's entries, `protocol`, `seed`, `start_sample`, the free parameters, `rmse_rps`,
        `evaluations`, `iterations`.

    Raises
    ------
    ValueError
        There are no seeds, or see `identify.paper_fit`.
    """
    if not len(seeds):
        raise ValueError("no seeds: at least one run of each record is needed")
    calls, keys = [], []
    for protocol, (index, (key, recording)) in product(protocols, enumerate(records)):
        starts = start_samples(protocol, seeds, record_seed=index)
        for seed, start in zip(seeds, starts, strict=True):
            calls.append((recording, protocol, seed, start))
            keys.append(key | {"protocol": protocol.name})
    runs = in_parallel(_run, calls, label)
    return pd.DataFrame([key | run for key, run in zip(keys, runs, strict=True)])


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
    """Condense the runs on the records of `authors_table2_records` or `simulated_table2_records` into Table 2.

    A row for each source, realisation and row of Table 2.
    """
    theoretical = published.column("Table 2", "theoretical")[runs["row"] - 1]
    of_record = ["source", "realisation", "noise_level", "row", "delta_rad", "noise_amplitude_rps"]
    return summarise_runs(
        runs.assign(theoretical_A_rps=theoretical), [*of_record, "theoretical_A_rps"]
    )


def table2_cells(table: pd.DataFrame) -> dict[str, list[float]]:
    """Our numbers for Table 2's means and SDs by cell id: one for each realisation in the table."""
    cells: dict[str, list[float]] = {}
    for row in table.to_dict("records"):
        for name, column in (("mean", "mean_A_rps"), ("sd", "sd_A_rps")):
            cells.setdefault(f"table2.row{row['row']:02d}.{name}", []).append(row[column])
    return cells


def error_percent(table: pd.DataFrame, column: str) -> pd.Series:
    """How far a column of A lies from the printed means [%], for the rows with backlash."""
    printed = published.column("Table 2", "mean")[table["row"] - 1]
    return (100 * (table[column] / printed - 1)).where(table["theoretical_A_rps"] > 0)


def decide_error_below_10(runs: pd.DataFrame, criteria: Criteria = None) -> Decision:
    """Decide whether every mean |A| errs by less than 10 %, from runs on the authors' records.

    The second value says what was measured: the largest error, with a 95 % bootstrap interval, all
    records together. The cell `text.error_limit_percent` is judged by the same largest error.
    """
    theoretical = published.column("Table 2", "theoretical")
    rng = np.random.default_rng(1)
    records = runs[runs["row"] <= len(table2_levels())].groupby(["realisation", "row"], sort=False)
    tail = 0.025 / records.ngroups
    errors = []
    for (_, row), part in records:
        amplitude = part["A_rps"].abs().to_numpy()
        true = theoretical[row - 1]
        drawn = rng.integers(amplitude.size, size=(BOOTSTRAP_DRAWS, amplitude.size))
        means = amplitude[drawn].mean(axis=1)
        low, high = np.quantile(100 * np.abs(means / true - 1), [tail, 1 - tail])
        errors.append((100 * abs(amplitude.mean() / true - 1), low, high))
    largest, low, high = np.max(errors, axis=0)
    holds = published.decide("error_below_10", (low, high), criteria)
    return (
        holds,
        f"largest error of a mean {largest:.1f} % (95 % interval {low:.1f} to {high:.1f} %)",
    )


def decide_local_minima(table: pd.DataFrame, criteria: Criteria = None) -> Decision:
    """Decide whether runs avoid local minima, from `table2` of the authors' records; say what was measured.

    The interval of the share is Student's over the records, because runs on one record are not
    independent.
    """
    hits, runs = table["best_basin_runs"], table["runs"]
    share = hits / runs
    half = stats.t.ppf(0.975, share.size - 1) * share.std() / np.sqrt(share.size)
    low, high = share.mean() - half, share.mean() + half
    stored = basin_labels(published.authors_notebook_runs()["final_rmse_rps"].to_numpy())
    return published.decide("local_minima", (low, high), criteria), (
        f"{hits.sum()} of {runs.sum()} runs on {share.size} noisy records end in the best basin, "
        f"{100 * share.mean():.0f} % ({100 * low:.0f} to {100 * high:.0f} %); of the authors' {stored.size} "
        f"stored runs on the noise-free record 12, {(stored == 1).sum()} do"
    )
