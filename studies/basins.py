"""Sets of searches compared: how often they end in the best basin, and how far apart their means are."""

from collections.abc import Mapping

import numpy as np
from numpy.random import Generator
from pandas import DataFrame, Series, concat

from replication.arrays import FloatArray
from replication.statistics import rate_columns
from replication.table2 import BASIN_GAP

_DRAWS = 4000  # of a bootstrap

Pairs = list[tuple[Series, Series]]  # values of two sets, a pair for each record


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
