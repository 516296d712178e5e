"""Sets of searches compared: how often they end in the best basin, and how far apart their means are."""

from collections.abc import Mapping

import numpy as np
from numpy.random import Generator
from pandas import DataFrame, Series, concat

from replication.arrays import FloatArray
from replication.table2 import BASIN_GAP
from studies.rates import rate_columns

_DRAWS = 4000  # of a bootstrap

Pairs = list[tuple[Series, Series]]  # |A| of two sets, a pair for each record


def compare_searches(sets: Mapping[str, DataFrame]) -> DataFrame:
    """Compare sets of runs of `table2.repeated_fits` with the first set, on the records that they share.

    `first_rate` is the first set's rate of the best basin, that of the lowest misfit that any set has on a record.
    `shift_percent` is how far the means over a record's runs lie from the first set's, on average,
    `best_shift_percent` that of the best basin, with bootstrap limits. `apart_percent` is the rms over the records, and
    `chance_percent` what it is if both sets are drawn from all runs together.
    """
    limits = concat(sets.values()).groupby("row")["rmse_rps"].min() * (1 + BASIN_GAP)
    first = next(iter(sets.values()))
    rng = np.random.default_rng(1)
    table = []
    for name, runs in sets.items():
        before = first[first["row"].isin(runs["row"])]
        after = runs[runs["row"].isin(first["row"])]
        best_before, best_after = (
            part[part["rmse_rps"] <= part["row"].map(limits)] for part in (before, after)
        )
        row = {
            "search": name,
            "records": after["row"].nunique(),
            "runs": len(after),
            "best_basin_runs": len(best_after),
            **rate_columns(len(best_after), len(after)),
            "first_rate": len(best_before) / len(before),
        }
        if runs is not first:
            pairs = _pairs(before, after)
            row |= _shift("shift", pairs, rng)
            row |= _shift("best_shift", _pairs(best_before, best_after), rng)
            row |= _apart(pairs, rng)
        table.append(row)
    return DataFrame(table)


def _pairs(before: DataFrame, after: DataFrame) -> Pairs:
    """|A| of the runs of two sets on each record that both have."""
    old, new = (dict(list(runs["A_rps"].abs().groupby(runs["row"]))) for runs in (before, after))
    return [(old[record], new[record]) for record in sorted(old.keys() & new.keys())]


def _shift(name: str, pairs: Pairs, rng: Generator) -> dict[str, float]:
    """Mean over the records of how far the second mean lies from the first, with its limits."""
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
