"""Seconds of a fit on a noisy record by our search and others, into results/bench.csv: `python -m studies.timings`."""

from collections.abc import Callable
from time import perf_counter
from typing import Any

import cma
import numpy as np
import pandas as pd
from scipy import optimize

from replication import misfit, published, table2
from replication.records import ROOT, add_noise, simulate_clean, write_csv
from replication.signature import rmse

REPEATS = 3  # that a median is taken over
PLAIN_MEMBERS = 20  # that the cost as the paper writes it is timed on


def median_seconds(call: Callable[[], Any]) -> float:
    """Median wall time of a call [s], after one call that compiles."""
    call()
    seconds = []
    for _ in range(REPEATS):
        begun = perf_counter()
        call()
        seconds.append(perf_counter() - begun)
    return float(np.median(seconds))


def bench() -> pd.DataFrame:
    """Measure all rows of `bench.csv` on a simulated record of Table 2's middle row, one core."""
    settings = table2.NOTEBOOK
    noise = published.column("Table 2", "noise")[4]
    record = add_noise(simulate_clean(6), noise, np.random.default_rng(1))
    box = table2.search_box(record, settings)
    misfits = misfit.cost(record.t, record.v, settings.timing)
    unit = np.random.default_rng(1).random((settings.population, 7))
    members = box.lower + unit * (box.upper - box.lower)

    def plain() -> list[float]:
        return [rmse(record.t, record.v, X, settings.timing) for X in members[:PLAIN_MEMBERS]]

    def todays_cma() -> None:
        options = {
            "bounds": [box.lower, box.upper],
            "popsize": settings.population,
            "maxiter": settings.iterations,
            "CMA_stds": (box.upper - box.lower) / 4,
            "seed": 1,
            "verbose": -9,
            "verb_log": 0,
        }
        strategy = cma.CMAEvolutionStrategy((box.lower + box.upper) / 2, 1.0, options)
        while not strategy.stop():
            asked = strategy.ask()
            strategy.tell(asked, misfits(np.array(asked)))

    def differential_evolution() -> None:
        optimize.differential_evolution(
            lambda points: misfits(np.ascontiguousarray(points.T)),
            list(zip(*box, strict=True)),
            popsize=settings.population // 7,
            maxiter=settings.iterations,
            vectorized=True,
            updating="deferred",
            rng=1,
        )

    rows = [
        ("misfit, equations 1 to 7 in NumPy", median_seconds(plain) / PLAIN_MEMBERS, "one member"),
        ("misfit, compiled", median_seconds(lambda: misfits(members)) / len(members), "one member"),
        ("our search of 2021", median_seconds(lambda: table2.fit(record, settings, 1)), "one run"),
        ("our best fit", median_seconds(lambda: table2.best_fit(record)), "the global minimum"),
        ("today's cma, compiled misfit", median_seconds(todays_cma), "one run"),
        (
            "SciPy's differential evolution, compiled misfit",
            median_seconds(differential_evolution),
            "one run",
        ),
    ]
    return pd.DataFrame(rows, columns=["what", "seconds", "note"])


if __name__ == "__main__":
    table = bench()
    write_csv(ROOT / "results" / "bench.csv", table)
    print(table.to_string(index=False))
