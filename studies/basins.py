"""Where searches end: basins and their rates.

And how often the global fit's interval holds the true A.
"""

from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.random import Generator
from pandas import DataFrame, Series, concat

from backlash.fitting.global_fit import global_fit
from replication.arrays import FloatArray, IntArray
from replication.identify import Protocol, protocol_box
from replication.parallel import in_parallel
from replication.recording import add_normal_noise, add_uniform_noise, constant_speed
from replication.signature import signature
from replication.statistics import rate_columns
from replication.table2 import BASIN_GAP, basin_labels

# Runs of one misfit whose windows start further apart are in different basins: a quarter of the
# oscillation.
START_GAP_S = 0.01
_DRAWS = 4000  # of a bootstrap
# Signatures like those of the authors' records: least and largest A, t0, tau, omega, T1 and T2 -
# T1.
_LEAST = (0.3, 0.002, 10, 100, 0.002, 0.1)
_LARGEST = (1.5, 0.15, 25, 170, 0.02, 0.17)

Pairs = list[tuple[Series, Series]]  # values of two sets, a pair for each record


def label_basins(rmse: FloatArray, window_start_s: FloatArray) -> IntArray:
    """Number the basins of runs from 1, lowest misfit first, split where windows start apart."""
    by_misfit = basin_labels(rmse)
    order = np.lexsort((window_start_s, by_misfit))
    is_next = (np.diff(by_misfit[order]) > 0) | (np.diff(window_start_s[order]) > START_GAP_S)
    labels = np.empty(by_misfit.size, dtype=np.int64)
    labels[order] = np.r_[1, 1 + np.cumsum(is_next)]
    return labels


def basin_table(runs: DataFrame) -> DataFrame:
    """One row per basin that runs on a record ended in: its rate, amplitudes and median window."""
    edges = runs.assign(
        A_rps=runs["A_rps"].abs(),
        window_start_s=runs["t0_s"] + runs["T1_s"],
        window_end_s=runs["t0_s"] + runs["T2_s"],
    )
    labels = label_basins(edges["rmse_rps"].to_numpy(), edges["window_start_s"].to_numpy())
    rows = []
    for basin, part in edges.groupby(labels):
        row = {
            "basin": basin,
            "rmse_rps": part["rmse_rps"].min(),
            "runs": len(part),
            **rate_columns(len(part), len(runs)),
            "A_low_rps": part["A_rps"].min(),
            "A_high_rps": part["A_rps"].max(),
            **part[["t0_s", "omega_rad_per_s", "window_start_s", "window_end_s"]].median(),
        }
        rows.append(row)
    return DataFrame(rows)


def compare_searches(sets: Mapping[str, DataFrame]) -> DataFrame:
    """Compare sets of runs of `table2.repeated_fits` with the first set, on the records that they share.

    `first_rate` is the first set's rate of the best basin, that of the lowest misfit that any set
    has on a record. `shift_percent` is how far the means over a record's runs lie from the first
    set's, on average, `best_shift_percent` that of the best basin, with bootstrap limits.
    `apart_percent` is the rms over the records, and `chance_percent` what it is if both sets are
    drawn from all runs together.
    """
    lowest = concat(sets.values()).groupby("row")["rmse_rps"].min()
    by_row = {}
    for name, runs in sets.items():
        best = runs["rmse_rps"] <= runs["row"].map(lowest) * (1 + BASIN_GAP)
        by_row[name] = dict(
            list(runs[["row"]].assign(A_rps=runs["A_rps"].abs(), best=best).groupby("row"))
        )
    first = next(iter(by_row.values()))
    rng = np.random.default_rng(1)
    table = []
    for name, parts in by_row.items():
        shared = sorted(first.keys() & parts.keys())
        before, after = ([of[row] for row in shared] for of in (first, parts))
        row = {"search": name, "records": len(shared)} | _rates(concat(before), concat(after))
        if parts is not first:
            both = list(zip(before, after, strict=True))
            pairs = [(old["A_rps"], new["A_rps"]) for old, new in both]
            of_best = [
                (a[old["best"]], b[new["best"]])
                for (a, b), (old, new) in zip(pairs, both, strict=True)
            ]
            row |= _shift("shift", pairs, rng)
            row |= _shift("best_shift", of_best, rng) | _apart(pairs, rng)
        table.append(row)
    return DataFrame(table)


def _rates(before: DataFrame, after: DataFrame) -> dict[str, float]:
    """How many runs of the second set end in the best basin, and the share of the first set's."""
    hits, runs = int(after["best"].sum()), len(after)
    return (
        {"runs": runs, "best_basin_runs": hits}
        | rate_columns(hits, runs)
        | {"first_rate": before["best"].mean()}
    )


def _shift(name: str, pairs: Pairs, rng: Generator) -> dict[str, float]:
    """Mean over the records of how far the second mean lies from the first, with its limits."""
    pairs = [pair for pair in pairs if all(part.size for part in pair)]
    if not pairs:
        return _percent(name, np.nan, np.array([np.nan]))
    shift = np.mean([after.mean() / before.mean() - 1 for before, after in pairs])
    drawn = [
        _means(after, after.size, rng) / _means(before, before.size, rng) for before, after in pairs
    ]
    return _percent(name, shift, np.mean(np.array(drawn) - 1, axis=0))


def _apart(pairs: Pairs, rng: Generator) -> dict[str, float]:
    """RMS over the records of how far the means are apart, and what chance gives."""
    apart = np.sqrt(np.mean([(after.mean() / before.mean() - 1) ** 2 for before, after in pairs]))
    drawn = []
    for pair in pairs:
        before, after = (_means(concat(pair), part.size, rng) for part in pair)
        drawn.append((after / before - 1) ** 2)
    chance = np.sqrt(np.mean(drawn, axis=0))
    return {"apart_percent": 100 * apart} | _percent("chance", np.median(chance), chance)


def _means(values: Series, size: int, rng: Generator) -> FloatArray:
    """Means of so many values drawn with replacement."""
    return rng.choice(values.to_numpy(), (_DRAWS, size)).mean(axis=1)


def _percent(name: str, value: float, drawn: FloatArray) -> dict[str, float]:
    """A share and its 95 % limits in percent."""
    low, high = np.percentile(drawn, [2.5, 97.5])
    return {
        f"{name}_percent": 100 * value,
        f"{name}_low_percent": 100 * low,
        f"{name}_high_percent": 100 * high,
    }


def coverage_runs(law: str, half_amplitude_rps: float, runs: int, rng: Generator) -> DataFrame:
    """Fit made records whose A is known and lies in the box that the record gives.

    The true A is that of the same signal if its window starts midway between two samples, as in
    `GlobalFit`.
    """
    base, protocol = constant_speed(samples=2401, dt=0.002), Protocol()
    rows: list[tuple[float, float, float, bool]] = []
    while len(rows) < runs:
        A, t0, tau, omega, T1, length = rng.uniform(_LEAST, _LARGEST)
        X = np.array([A, t0, tau, omega, base.commanded_speed_rps, T1 + length, T1])
        clean = replace(base, v=base.v + signature(base.t, X, protocol.timing))
        if law == "uniform":
            record = add_uniform_noise(clean, half_amplitude_rps, rng)
        else:
            record = add_normal_noise(clean, half_amplitude_rps / np.sqrt(3), rng)
        midway = (np.ceil((t0 + T1) / 0.002) - 0.5) * 0.002
        truth = float(A * np.exp(-tau * (midway - t0 - T1)))
        if truth < protocol_box(record, protocol).upper[0]:
            low, high = global_fit(record, protocol).amplitude_interval_rps
            rows.append((truth, low, high, low <= truth <= high))
    return DataFrame(rows, columns=["true_A_rps", "low_rps", "high_rps", "covered"])


def coverage_table(runs: int, seed: int) -> DataFrame:
    """How often the 95 % interval covers, for two laws of noise of the same SD at three levels."""
    settings = list(product(("uniform", "Gaussian"), (0.05, 0.15, 0.3)))
    # Rows that shared draws would err together.
    seeds = np.random.SeedSequence(seed).spawn(len(settings))
    calls = [
        (*each, runs, np.random.default_rng(own)) for each, own in zip(settings, seeds, strict=True)
    ]
    rows = []
    for (law, half_amplitude), part in zip(
        settings, in_parallel(coverage_runs, calls, "made records"), strict=True
    ):
        row = {
            "law": law,
            "half_amplitude_rps": half_amplitude,
            "runs": runs,
            **rate_columns(int(part["covered"].sum()), runs),
            "relative_width": ((part["high_rps"] - part["low_rps"]) / part["true_A_rps"]).median(),
        }
        rows.append(row)
    return DataFrame(rows)
