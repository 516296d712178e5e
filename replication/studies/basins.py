"""Where repeated searches end: basins, their rates with intervals, and what raises the rate of the best one."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count, repeat

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from numpy.typing import NDArray
from scipy import stats

from replication.arrays import FloatArray
from replication.compiled.misfit import population_rmse
from replication.datasets import Recording
from replication.global_fit.folding import projected_rmse
from replication.identify import Protocol, protocol_box
from replication.search import generations
from replication.search import search as follow
from replication.signature import FREE_PARAMETERS, Box
from replication.statistics import rate_columns, rate_interval
from replication.table2 import BASIN_GAP, basin_labels

# Runs of one misfit whose windows start further apart are in different basins: a quarter of the oscillation.
START_GAP_S = 0.01


def label_basins(rmse: FloatArray, window_start_s: FloatArray) -> NDArray[np.int64]:
    """Number the basins of runs, lowest misfit first: `table2.basin_labels`, split where windows start apart."""
    by_misfit = basin_labels(rmse)
    labels = np.empty(by_misfit.size, dtype=np.int64)
    following = 0
    for label in range(by_misfit.max() + 1):
        members = np.flatnonzero(by_misfit == label)
        members = members[np.argsort(window_start_s[members], kind="stable")]
        part = np.r_[0, np.cumsum(np.diff(window_start_s[members]) > START_GAP_S)]
        labels[members] = following + part
        following += part[-1] + 1
    return labels


def basin_table(runs: pd.DataFrame) -> pd.DataFrame:
    """One row per basin that runs on one record ended in: its rate, amplitudes and median window."""
    edges = runs.assign(
        A_rps=runs["A_rps"].abs(),
        window_start_s=runs["t0_s"] + runs["T1_s"],
        window_end_s=runs["t0_s"] + runs["T2_s"],
    )
    labels = label_basins(edges["rmse_rps"].to_numpy(), edges["window_start_s"].to_numpy())
    rows = []
    for _, part in edges.groupby(labels):
        rows.append(
            {"rmse_rps": part["rmse_rps"].min(), "runs": len(part)}
            | rate_columns(len(part), len(runs))
            | {"A_low_rps": part["A_rps"].min(), "A_high_rps": part["A_rps"].max()}
            | part[["t0_s", "omega_rad_per_s", "window_start_s", "window_end_s"]].median().to_dict()
        )
    return pd.DataFrame(rows)


def compare_basins(stored: pd.DataFrame, ours: pd.DataFrame) -> pd.DataFrame:
    """Rates of the stored runs' basins in two sets of runs, and Fisher's p; the last row is elsewhere."""
    sets, rows = {"stored": stored, "ours": ours}, []
    elsewhere = {name: len(runs) for name, runs in sets.items()}
    for misfit in basin_table(stored)["rmse_rps"]:
        hits = {name: int(((runs["rmse_rps"] / misfit - 1).abs() < BASIN_GAP).sum()) for name, runs in sets.items()}
        elsewhere = {name: elsewhere[name] - hits[name] for name in sets}
        rows.append({"rmse_rps": misfit} | _compare_rates(hits, sets))
    return pd.DataFrame([*rows, {"rmse_rps": np.nan} | _compare_rates(elsewhere, sets)])


def _compare_rates(hits: Mapping[str, int], sets: Mapping[str, pd.DataFrame]) -> dict[str, float]:
    row = {}
    for name, runs in sets.items():
        rates = rate_columns(hits[name], len(runs))
        row |= {f"runs_{name}": hits[name]} | {f"{column}_{name}": rate for column, rate in rates.items()}
    table = [[hits[name], len(runs) - hits[name]] for name, runs in sets.items()]
    return row | {"p_same": stats.fisher_exact(table).pvalue}


def compare_searches(sets: Mapping[str, pd.DataFrame], draws: int = 4000, seed: int = 1) -> pd.DataFrame:
    """Compare sets of runs on the same records with the first set: what another library, or other seeds, change.

    `sets` holds runs from `table2.repeated_fits` by name. A row a set: `records` that it shares with the first, its
    `runs` on them, `best_basin_runs` (within `table2.BASIN_GAP` of the lowest misfit that any set has on the record),
    their `rate` with its 95 % limits, and `first_rate` of the first set on these records. `shift_percent` is how far
    the means over a record's runs lie from the first set's, on average over the records, `best_shift_percent` that of
    the best basin; their 95 % limits are a bootstrap's over the runs. `apart_percent` is the rms over the records, and
    `chance_percent`, with 95 % limits, what it is if both sets are drawn from all runs together: chance alone.
    """
    lowest = pd.concat(sets.values()).groupby("row")["rmse_rps"].min()
    by_row = {name: _amplitudes(runs, lowest) for name, runs in sets.items()}
    first, generator, table = next(iter(by_row.values())), np.random.default_rng(seed), []
    for name, runs in by_row.items():
        pairs = [(first[row], runs[row]) for row in sorted(first.keys() & runs.keys())]
        table.append({"search": name, "records": len(pairs)} | _rates(pairs))
        if runs is not first:
            all_runs = [(before["A_rps"], after["A_rps"]) for before, after in pairs]
            best = [(before["A_rps"][before["best"]], after["A_rps"][after["best"]]) for before, after in pairs]
            table[-1] |= _shift("shift", all_runs, draws, generator) | _shift("best_shift", best, draws, generator)
            table[-1] |= _apart(all_runs, draws, generator)
    return pd.DataFrame(table)


def _amplitudes(runs: pd.DataFrame, lowest: pd.Series) -> dict[int, pd.DataFrame]:
    """|A| of the runs on each record, and whether they ended in its best basin."""
    best = runs["rmse_rps"] <= runs["row"].map(lowest) * (1 + BASIN_GAP)
    return dict(list(runs[["row"]].assign(A_rps=runs["A_rps"].abs(), best=best).groupby("row")))


def _rates(pairs: list[tuple[pd.DataFrame, pd.DataFrame]]) -> dict[str, float]:
    """How many runs of the second sets end in the best basin, and the share of the first sets'."""
    before, after = (np.concatenate([part["best"] for part in parts]) for parts in zip(*pairs, strict=True))
    found = {"runs": after.size, "best_basin_runs": int(after.sum())}
    return found | rate_columns(int(after.sum()), after.size) | {"first_rate": before.mean()}


def _shift(name: str, pairs: list[tuple[pd.Series, pd.Series]], draws: int, generator: np.random.Generator) -> dict:
    """Mean over the records of how far the second mean lies from the first, with bootstrap limits."""
    pairs = [pair for pair in pairs if all(part.size for part in pair)]
    if not pairs:
        return _percent(name, np.nan, np.array([np.nan]))
    shift = np.mean([after.mean() / before.mean() - 1 for before, after in pairs])
    drawn = [
        _means(after, after.size, draws, generator) / _means(before, before.size, draws, generator) - 1
        for before, after in pairs
    ]
    return _percent(name, shift, np.mean(drawn, axis=0))


def _apart(pairs: list[tuple[pd.Series, pd.Series]], draws: int, generator: np.random.Generator) -> dict:
    """RMS over the records of how far the means are apart, and what chance gives for sets of these sizes."""
    apart = np.sqrt(np.mean([(after.mean() / before.mean() - 1) ** 2 for before, after in pairs]))
    drawn = []
    for pair in pairs:
        before, after = (_means(pd.concat(pair), part.size, draws, generator) for part in pair)
        drawn.append((after / before - 1) ** 2)
    chance = np.sqrt(np.mean(drawn, axis=0))
    return {"apart_percent": 100 * apart} | _percent("chance", np.median(chance), chance)


def _means(values: pd.Series, size: int, draws: int, generator: np.random.Generator) -> FloatArray:
    """Means of so many values drawn with replacement."""
    return generator.choice(values.to_numpy(), (draws, size)).mean(axis=1)


def _percent(name: str, value: float, drawn: FloatArray) -> dict[str, float]:
    """A share and its 95 % limits in percent."""
    low, high = np.percentile(drawn, [2.5, 97.5])
    return {f"{name}_percent": 100 * value, f"{name}_low_percent": 100 * low, f"{name}_high_percent": 100 * high}


# From a generator to the population and the breadth of each search in turn.
Schedule = Callable[[np.random.Generator], Iterator[tuple[int, float]]]


@dataclass(frozen=True)
class Strategy:
    """One way to spend function evaluations."""

    name: str
    schedule: Schedule
    budget: int
    projected: bool = False


def repeated(population: int) -> Schedule:
    """The same search over and over."""
    return lambda _: repeat((population, 1.0))


def growing(population: int) -> Schedule:
    """IPOP (Auger and Hansen 2005): each search has twice the population of the one before."""
    return lambda _: ((population * 2**k, 1.0) for k in count())


def alternating(population: int) -> Schedule:
    """BIPOP (Hansen 2009), by turns: a growing population, and a small one with a narrow start."""

    def schedule(generator: np.random.Generator) -> Iterator[tuple[int, float]]:
        size = population
        yield size, 1.0
        while True:
            size *= 2
            yield size, 1.0
            small = population * (size / population / 2) ** (generator.random() ** 2)
            yield int(small), float(10 ** (-2 * generator.random()))

    return schedule


def strategies(budget: int = 60000) -> list[Strategy]:
    """The settings that are compared: the authors' population, larger and smaller ones, restarts, fewer dimensions."""
    whole = {
        "population 300 (the authors'), restarted": repeated(300),
        **{f"population {size}, restarted": repeated(size) for size in (1000, 100, 30)},
        "IPOP from 30": growing(30),
        "BIPOP from 30": alternating(30),
    }
    projected = {f"A and v_t projected out, population {size}, restarted": repeated(size) for size in (300, 100, 30)}
    return [
        *(Strategy(name, schedule, budget) for name, schedule in whole.items()),
        *(Strategy(name, schedule, budget, projected=True) for name, schedule in projected.items()),
    ]


def search(recording: Recording, protocol: Protocol, strategy: Strategy, seed: int, target_rmse: float) -> dict:
    """Search from the middle of the box, over and over, until the target or the strategy's budget is reached."""
    generator = np.random.default_rng(seed)
    box, misfits = _problem(recording, protocol, strategy.projected)
    best, spent, searches = np.inf, 0, 0

    def normals(*shape: int) -> FloatArray:
        return generator.standard_normal(shape)

    for population, breadth in strategy.schedule(generator):
        searches += 1
        steps = generations(misfits, box, normals, population, breadth)
        run = follow(steps, math.ceil((strategy.budget - spent) / population), target_rmse)
        spent, best = spent + run.evaluations, min(best, run.misfit)
        if spent >= strategy.budget or best <= target_rmse:
            break
    return {"rmse_rps": best, "evaluations": spent, "searches": searches, "found": best <= target_rmse}


def _problem(
    recording: Recording, protocol: Protocol, projected: bool
) -> tuple[Box, Callable[[FloatArray], FloatArray]]:
    """Box and misfit of a population, in all dimensions or without A and v_t."""
    box = protocol_box(recording, protocol)
    if not projected:
        return box, lambda X: population_rmse(recording.t, recording.v, X, protocol.timing)
    kept = [i for i, name in enumerate(FREE_PARAMETERS) if name not in ("A_rps", "v_t_rps")]
    rest = Box(box.lower[kept], box.upper[kept])
    return rest, projected_rmse(recording.t, recording.v, protocol.timing, box.upper[0])


def study(
    recording: Recording, protocol: Protocol, compared: Sequence[Strategy], seeds: Sequence[int], target_rmse: float
) -> pd.DataFrame:
    """Run every strategy with every seed, on all cores."""
    keys = [(strategy, seed) for strategy in compared for seed in seeds]
    # The schedules are closures, which only cloudpickle, loky's own, can send: joblib's default does.
    results = Parallel(n_jobs=-1)(delayed(search)(recording, protocol, *key, target_rmse) for key in keys)
    return pd.DataFrame(
        [{"strategy": key[0].name, "seed": key[1]} | result for key, result in zip(keys, results, strict=True)]
    )


def strategy_table(results: pd.DataFrame) -> pd.DataFrame:
    """Success rate of each strategy, and evaluations per success with limits from the rate's alone."""
    rows = []
    for name, part in results.groupby("strategy", sort=False):
        found, spent = int(part["found"].sum()), part["evaluations"].mean()
        rate, (low, high) = found / len(part), rate_interval(found, len(part))
        costs = [spent / r if r > 0 else np.inf for r in (rate, high, low)]
        rows.append([name, len(part), found, rate, low, high, spent, *costs])
    names = ["strategy", "runs", "found", "rate", "rate_low", "rate_high", "mean_evaluations"]
    costs = ["evaluations_per_success", "evaluations_per_success_low", "evaluations_per_success_high"]
    return pd.DataFrame(rows, columns=names + costs)


def landscape(
    recording: Recording,
    protocol: Protocol,
    X: FloatArray,
    axes: tuple[str, str],
    values: tuple[Sequence[float], Sequence[float]],
) -> FloatArray:
    """Misfits [rps] on a slice through X, the first axis along columns, the second along rows."""
    first, second = (np.asarray(value, dtype=float) for value in values)
    population = np.tile(X, (second.size * first.size, 1))
    population[:, FREE_PARAMETERS.index(axes[0])] = np.tile(first, second.size)
    population[:, FREE_PARAMETERS.index(axes[1])] = np.repeat(second, first.size)
    return population_rmse(recording.t, recording.v, population, protocol.timing).reshape(second.size, first.size)


def slices(
    recording: Recording, protocol: Protocol, X: FloatArray, points: int = 161
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Two slices through X for `plots.landscape`: A over t0 in the first turn, and T1 over T2."""
    box = protocol_box(recording, protocol)
    ends = {
        name: np.linspace(low, high, points)
        for name, low, high in zip(FREE_PARAMETERS, box.lower, box.upper, strict=True)
    }
    ends["t0_s"] = recording.t[0] + np.linspace(0, protocol.T_f, points)
    pairs = (("t0_s", "A_rps"), ("T2_s", "T1_s"))
    return [(ends[a], ends[b], landscape(recording, protocol, X, (a, b), (ends[a], ends[b]))) for a, b in pairs]
