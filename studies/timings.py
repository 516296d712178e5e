"""Speed as ratios, both arms in one run, and peers of the search: `make bench`.

It prints how ours compares with a direct way; `results/peers.csv` gives the time in which a search finds the best
minimum of a noisy record with 99 %, `results/notebook_times.csv` how long the notebooks took in `make all`.

All peers have the same compiled misfit, box, first mean (the middle of the box) and first SD (a quarter of its width),
and a population of 300 where none is named.
"""

import json
import os
from collections.abc import Callable
from datetime import datetime
from functools import partial
from importlib.util import find_spec
from time import perf_counter, process_time
from timeit import repeat
from typing import Any

import cma
import cmaes
import numpy as np
from llvmlite import binding
from numpy.random import default_rng
from pandas import DataFrame
from scipy import optimize

from replication import misfit, published
from replication.best_fit import best_fit
from replication.cmaes import generations, search
from replication.files import ROOT, write_kept
from replication.misfit import PROJECTED
from replication.records import Recording, add_noise, simulate_clean
from replication.signature import Box, FloatArray, rmse
from replication.table2 import BASIN_GAP, LEVELS, NOTEBOOK, RPM_600, fit, search_box
from studies.optimizers import BUDGET, POPULATION, Cost

# From members of shape (population, n) to their misfits.
Misfits = Callable[[FloatArray], Any]
Search = Callable[[int], float]  # from a seed to the lowest misfit
ROW = 5  # of Table 2
RUNS, SLOW_RUNS = 20, 6
REPEATS = 5  # that a median is taken over
AUTHORS_LOOP = (
    "the authors' loop: today's cma, equations 1 to 7 in NumPy, scaled to as many evaluations"
)


def make_record() -> Recording:
    """A noisy record of our joint, of one row of Table 2."""
    noise = published.column("Table 2", "noise")[ROW - 1]
    return add_noise(simulate_clean(LEVELS[ROW - 1]), noise, default_rng(1))


# ---------------------------------------------------------------------------------------- against a direct way


def median_seconds(call: Callable[[], Any]) -> float:
    """Median wall time of a call [s], after one call that compiles."""
    call()
    return float(np.median(repeat(call, number=1, repeat=REPEATS)))


def bench() -> DataFrame:
    """Measure ours, a reference, and the reference over ours."""
    record, settings = make_record(), NOTEBOOK
    box = search_box(record, settings)
    members = default_rng(1).uniform(*box, (POPULATION, 7))
    misfits = misfit.cost(record.t, record.v, settings.timing)

    def by_equations(members: FloatArray) -> list[float]:
        return [rmse(record.t, record.v, X, settings.timing) for X in members]

    compiled = median_seconds(lambda: misfits(members)) / POPULATION
    plain = median_seconds(lambda: by_equations(members)) / POPULATION
    fit_s = median_seconds(lambda: fit(record, settings, 1))
    evaluations = fit(record, settings, 1).generations * POPULATION
    begun = perf_counter()
    scaled = evaluations / run_cma(by_equations, box, 1, 10)
    loop = scaled * (perf_counter() - begun)
    rows = [
        ("misfit of a member", compiled, plain, "equations 1 to 7 in NumPy"),
        ("a fit of the paper", fit_s, loop, AUTHORS_LOOP),
    ]
    table = DataFrame(rows, columns=["what", "ours_s", "reference_s", "reference"])
    table.insert(3, "ratio", table["reference_s"] / table["ours_s"])
    return table


# ---------------------------------------------------------------------------------------- peers of the search


def run_cma(misfits: Misfits, box: Box, seed: int, iterations: int) -> int:
    """Run today's `cma`, and return its evaluations."""
    options = {
        "bounds": [*box],
        "popsize": POPULATION,
        "maxiter": iterations,
        "CMA_stds": (box.upper - box.lower) / 4,
        "seed": seed,
        "verbose": -9,
        "verb_log": 0,
    }

    def list_misfits(asked: list[FloatArray]) -> list[float]:
        return list(misfits(np.array(asked)))

    middle = (box.lower + box.upper) / 2
    _, strategy = cma.fmin2(None, middle, 1.0, options, parallel_objective=list_misfits)
    evaluations: int = strategy.result.evaluations
    return evaluations


def run_cmaes(misfits: Misfits, box: Box, seed: int, iterations: int) -> None:
    """Run `cmaes`, which has one step size for all parameters: shares of the box."""
    n = box.lower.size
    unit = np.tile([0.0, 1.0], (n, 1))
    strategy = cmaes.CMA(np.full(n, 0.5), 0.25, unit, seed=seed, population_size=POPULATION)
    for _ in range(iterations):
        shares = np.array([strategy.ask() for _ in range(POPULATION)])
        costs = misfits(box.lower + (box.upper - box.lower) * shares)
        strategy.tell(list(zip(shares, costs, strict=True)))
        if strategy.should_stop():
            break


def run_fcmaes(misfits: Misfits, box: Box, seed: int, iterations: int) -> None:
    """Run the C++ code of `fcmaes`, which sees the box as -1 to 1: a quarter of it is 0.5."""
    from fcmaes.cmaescpp import ACMA_C  # which is not for every platform

    strategy = ACMA_C(
        box.lower.size,
        optimize.Bounds(*box),
        (box.lower + box.upper) / 2,
        input_sigma=0.5,
        popsize=POPULATION,
        max_evaluations=POPULATION * iterations,
        rg=default_rng(seed),
    )
    for _ in range(iterations):
        if strategy.tell(misfits(np.ascontiguousarray(strategy.ask()))):
            break


def run_differential_evolution(misfits: Misfits, box: Box, seed: int, iterations: int) -> None:
    """Run SciPy's differential evolution."""
    optimize.differential_evolution(
        lambda points: misfits(np.ascontiguousarray(points.T)),
        optimize.Bounds(*box),
        popsize=POPULATION // box.lower.size,
        maxiter=iterations,
        vectorized=True,
        updating="deferred",
        rng=seed,
    )


def compare_peers() -> DataFrame:
    """Rows of `peers.csv`: CPU time of a run, how many find the best minimum, CPU time to find it with 99 %."""
    record = make_record()
    box = search_box(record, NOTEBOOK)
    folded = misfit.fold(record.t, record.v, NOTEBOOK.timing)
    five = Box(box.lower[PROJECTED], box.upper[PROJECTED])

    def projected(shapes: FloatArray) -> Any:
        return misfit.project(shapes, folded, box.upper[0])[1]

    def ours(seed: int) -> float:
        return search(generations(projected, five, seed, RPM_600.population), 200).misfit

    def lowest_of(peer: Callable[..., Any], seed: int) -> float:
        cost = Cost(record, 0.0, RUNS * BUDGET)  # which no run spends
        peer(cost.of_members, box, seed, NOTEBOOK.iterations)
        return cost.best

    searches: dict[str, tuple[int, Search]] = {
        "ours, five projected parameters, 600": (RUNS, ours),
        "ours, 600": (RUNS, lambda seed: fit(record, RPM_600, seed).rmse),
        "ours": (RUNS, lambda seed: fit(record, NOTEBOOK, seed).rmse),
        "fcmaes (C++)": (RUNS, partial(lowest_of, run_fcmaes)),
        "differential evolution (SciPy)": (
            SLOW_RUNS,
            partial(lowest_of, run_differential_evolution),
        ),
        "cma": (SLOW_RUNS, partial(lowest_of, run_cma)),
        "cmaes": (SLOW_RUNS, partial(lowest_of, run_cmaes)),
    }
    if not find_spec("fcmaes"):
        del searches["fcmaes (C++)"]
    limit = best_fit(record).rmse * (1 + BASIN_GAP)
    return DataFrame(
        {"search": name, **time_search(run, runs, limit)} for name, (runs, run) in searches.items()
    )


def time_search(run: Search, runs: int, limit: float) -> dict[str, float]:
    """Run a search with the seeds 1 to `runs`; it found the best minimum where its misfit is within a limit."""
    run(1)
    begun = process_time()
    ends = [run(seed) for seed in range(1, runs + 1)]
    seconds = (process_time() - begun) / runs
    best = sum(end <= limit for end in ends)
    # With half a run more on either side, a share of 0 or 1 is not certain.
    share = (best + 0.5) / (runs + 1)
    needed = max(1.0, np.log(0.01) / np.log(1 - share))
    return {
        "runs": runs,
        "best_minimum": best,
        "seconds_a_run": seconds,
        "seconds_to_99_percent": needed * seconds,
    }


def collect_notebook_times() -> DataFrame:
    """Seconds of each notebook's last run here, as `make all` noted them, two at a time."""
    stamps = sorted((ROOT / ".make").glob("[0-9]*.ran"))
    rows = [(stamp.stem, json.loads(stamp.read_text("utf-8"))["seconds"]) for stamp in stamps]
    return DataFrame(rows, columns=["notebook", "seconds"])


if __name__ == "__main__":
    print(bench().to_string(index=False))
    processor = f"{binding.get_host_cpu_name()}, {os.cpu_count()} cores"
    for name, table in (("peers", compare_peers()), ("notebook_times", collect_notebook_times())):
        if len(table):
            of_now = table.assign(date=f"{datetime.now():%Y-%m-%d}", machine=processor)
            write_kept(ROOT / "results" / f"{name}.csv", of_now)
        print(table.to_string(index=False))
