"""Peers of the search: in how much time each finds the best minimum of one noisy record with 99 %.

All have the same compiled misfit, box, first mean (the middle of the box) and first SD (a quarter of its width), and a
population of 300 where none is named.
"""

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from time import process_time
from typing import Any

import cma
import cmaes
import numpy as np
import pandas as pd
from scipy import optimize

from replication import published, table2
from replication.best_fit import best_fit
from replication.cmaes import generations, search
from replication.misfit import PROJECTED, fold, project
from replication.records import Recording, add_noise, simulate_clean
from replication.signature import Box, FloatArray
from replication.table2 import BASIN_GAP, NOTEBOOK, RPM_600
from studies.optimizers import BUDGET, POPULATION, Cost

# From members of shape (population, n) to their misfits.
Misfits = Callable[[FloatArray], Any]
RUNS, SLOW_RUNS = 20, 6


def make_records() -> list[Recording]:
    """A noisy record of our joint for each row of Table 2."""
    rng = np.random.default_rng(1)
    noise = published.column("Table 2", "noise")
    return [
        add_noise(simulate_clean(level), half, rng)
        for level, half in zip(table2.LEVELS, noise, strict=False)
    ]


def run_cma(misfits: Misfits, box: Box, seed: int, iterations: int) -> int:
    """Run today's `cma`, and return its evaluations."""
    options = {
        "bounds": [box.lower, box.upper],
        "popsize": POPULATION,
        "maxiter": iterations,
        "CMA_stds": (box.upper - box.lower) / 4,
        "seed": seed,
        "verbose": -9,
        "verb_log": 0,
    }
    strategy = cma.CMAEvolutionStrategy((box.lower + box.upper) / 2, 1.0, options)
    while not strategy.stop():
        asked = strategy.ask()
        strategy.tell(asked, list(misfits(np.array(asked))))
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
        rg=np.random.default_rng(seed),
    )
    for _ in range(iterations):
        if strategy.tell(misfits(np.ascontiguousarray(strategy.ask()))):
            break


def run_differential_evolution(misfits: Misfits, box: Box, seed: int, iterations: int) -> None:
    """Run SciPy's differential evolution."""
    optimize.differential_evolution(
        lambda points: misfits(np.ascontiguousarray(points.T)),
        list(zip(*box, strict=True)),
        popsize=POPULATION // box.lower.size,
        maxiter=iterations,
        vectorized=True,
        updating="deferred",
        rng=seed,
    )


def compare_peers() -> pd.DataFrame:
    """Rows of `peers.csv`: CPU time of a run, how many find the best minimum, CPU time to find it with 99 %."""
    record = make_records()[4]
    box = table2.search_box(record, NOTEBOOK)
    folded = fold(record.t, record.v, NOTEBOOK.timing)
    five = Box(box.lower[PROJECTED], box.upper[PROJECTED])

    def projected(shapes: FloatArray) -> Any:
        return project(shapes, folded, box.upper[0])[1]

    def ours(seed: int) -> float:
        return search(generations(projected, five, seed, RPM_600.population), 200).misfit

    def lowest_of(peer: Callable[..., Any], seed: int) -> float:
        cost = Cost(record, 0.0, RUNS * BUDGET)  # which no run spends
        peer(cost.of_members, box, seed, NOTEBOOK.iterations)
        return cost.best

    quick: dict[str, Callable[[int], float]] = {
        "ours, five projected parameters, 600": ours,
        "ours, 600": lambda seed: table2.fit(record, RPM_600, seed).rmse,
        "ours": lambda seed: table2.fit(record, NOTEBOOK, seed).rmse,
    }
    if find_spec("fcmaes"):
        quick["fcmaes (C++)"] = partial(lowest_of, run_fcmaes)
    slow = {
        "differential evolution (SciPy)": partial(lowest_of, run_differential_evolution),
        "cma": partial(lowest_of, run_cma),
        "cmaes": partial(lowest_of, run_cmaes),
    }
    limit = best_fit(record).rmse * (1 + BASIN_GAP)
    rows = [
        {"search": name, **time_search(run, runs, limit)}
        for searches, runs in ((quick, RUNS), (slow, SLOW_RUNS))
        for name, run in searches.items()
    ]
    return pd.DataFrame(rows)


def time_search(run: Callable[[int], float], runs: int, limit: float) -> dict[str, float]:
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
