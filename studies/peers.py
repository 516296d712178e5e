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
from replication.misfit import PROJECTED, cost, fold, project
from replication.records import Recording, add_noise, simulate_clean
from replication.signature import Box, FloatArray
from replication.table2 import BASIN_GAP, NOTEBOOK, RPM_600

# From members of shape (population, n) to their misfits.
Misfits = Callable[[FloatArray], Any]
POPULATION = NOTEBOOK.population


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


def compare_peers(runs: int = 20, slow_runs: int = 6) -> pd.DataFrame:
    """Rows of `peers.csv`: CPU time of a run, how many find the best minimum, CPU time to find it with 99 %."""
    record = make_records()[4]
    box = table2.search_box(record, NOTEBOOK)
    misfits = cost(record.t, record.v, NOTEBOOK.timing)
    folded = fold(record.t, record.v, NOTEBOOK.timing)
    five = Box(box.lower[PROJECTED], box.upper[PROJECTED])

    def projected(shapes: FloatArray) -> Any:
        return project(shapes, folded, box.upper[0])[1]

    def ours(seed: int) -> float:
        return search(generations(projected, five, seed, RPM_600.population), 200).misfit

    def lowest_of(peer: Callable[..., Any], seed: int) -> float:
        lowest = []

        def watched(members: FloatArray) -> FloatArray:
            costs = misfits(members)
            lowest.append(float(costs.min()))
            return costs

        peer(watched, box, seed, NOTEBOOK.iterations)
        return min(lowest)

    methods: dict[str, tuple[int, Callable[[int], float]]] = {
        "ours, five projected parameters, 600": (runs, ours),
        "ours, 600": (runs, lambda seed: table2.fit(record, RPM_600, seed).rmse),
        "ours": (runs, lambda seed: table2.fit(record, NOTEBOOK, seed).rmse),
    }
    if find_spec("fcmaes"):
        methods["fcmaes (C++)"] = runs, partial(lowest_of, run_fcmaes)
    slow = {
        "differential evolution (SciPy)": run_differential_evolution,
        "cma": run_cma,
        "cmaes": run_cmaes,
    }
    methods |= {name: (slow_runs, partial(lowest_of, peer)) for name, peer in slow.items()}
    limit = best_fit(record).rmse * (1 + BASIN_GAP)
    rows = [time_search(name, *method, limit) for name, method in methods.items()]
    return pd.DataFrame(rows)


def time_search(
    name: str, runs: int, run: Callable[[int], float], limit: float
) -> dict[str, str | float]:
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
        "search": name,
        "runs": runs,
        "best_minimum": best,
        "seconds_a_run": seconds,
        "seconds_to_99_percent": needed * seconds,
    }
