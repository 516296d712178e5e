"""Speed as ratios, both arms in one run, and peers of the search: `make bench`.

It prints how ours compares with a direct way; `results/peers.csv` gives the time in which a search finds the best
minimum of a noisy record with 99 %, `results/notebook_times.csv` how long the notebooks took in `make all`.
"""

import json
import os
from collections.abc import Callable
from datetime import datetime
from functools import partial
from time import perf_counter
from typing import Any

import cma
import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from llvmlite import binding
from scipy import optimize

from replication import published, table2
from replication.cmaes import generations, search
from replication.files import ROOT, write_csv
from replication.misfit import PROJECTED, cost, fold, project
from replication.records import Recording, add_noise, simulate_clean
from replication.signature import Box, FloatArray, rmse
from replication.table2 import BASIN_GAP, NOTEBOOK, RPM_600

REPEATS = 5  # that a median is taken over
AUTHORS_LOOP = (
    "the authors' loop: today's cma, equations 1 to 7 in NumPy, scaled to as many evaluations"
)

Cost = Callable[[FloatArray], Any]


def time_call(call: Callable[[], Any]) -> tuple[float, Any]:
    """Wall time of one call [s], and what it returns."""
    begun = perf_counter()
    returned = call()
    return perf_counter() - begun, returned


def run_seeds(run: Callable[[int], float], number: int) -> list[float]:
    """Lowest misfits of runs with the seeds 1 to `number`."""
    return [run(seed) for seed in range(1, number + 1)]


def median_seconds(call: Callable[[], Any]) -> float:
    """Median wall time of a call [s], after one call that compiles."""
    call()
    return float(np.median([time_call(call)[0] for _ in range(REPEATS)]))


def run_todays_cma(misfits: Cost, box: Box, seed: int, iterations: int) -> tuple[float, int]:
    """Lowest misfit and evaluations of a run of the library as it is today, from the middle of the box."""
    options = {
        "bounds": [box.lower, box.upper],
        "popsize": NOTEBOOK.population,
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
    return strategy.result.fbest, strategy.result.evaluations


def make_records() -> list[Recording]:
    """A noisy record of our joint for each row of Table 2."""
    rng = np.random.default_rng(1)
    noise = published.column("Table 2", "noise")
    return [
        add_noise(simulate_clean(level), half, rng)
        for level, half in zip(table2.LEVELS, noise, strict=False)
    ]


def bench() -> pd.DataFrame:
    """Measure ours, a reference, and the reference over ours."""
    records = make_records()
    record, settings = records[4], NOTEBOOK
    box = table2.search_box(record, settings)
    members = np.random.default_rng(1).uniform(*box, (settings.population, 7))
    misfits = cost(record.t, record.v, settings.timing)

    def by_equations(members: FloatArray) -> list[float]:
        return [rmse(record.t, record.v, X, settings.timing) for X in members]

    compiled = median_seconds(lambda: misfits(members)) / len(members)
    plain = median_seconds(lambda: by_equations(members)) / len(members)
    loop, (_, evaluations) = time_call(lambda: run_todays_cma(by_equations, box, 1, 10))
    fit = median_seconds(lambda: table2.fit(record, settings, 1))
    generations_of_fit = table2.fit(record, settings, 1).generations
    jobs = [delayed(table2.fit_each)(records, settings, seed) for seed in range(1, 31)]
    with Parallel(n_jobs=2) as pool:
        pool(jobs[:2])  # starts and compiles
        together, fits = time_call(lambda: pool(jobs))
    loop_of_fits = (
        sum(each.generations for fit in fits for each in fit)
        * settings.population
        * loop
        / evaluations
    )
    rows = [
        ("misfit of a member", compiled, plain, "equations 1 to 7 in NumPy"),
        (
            "a fit of the paper",
            fit,
            generations_of_fit * settings.population * loop / evaluations,
            AUTHORS_LOOP,
        ),
        ("300 fits of Table 2", together, loop_of_fits / 2, f"two cores; {AUTHORS_LOOP}"),
    ]
    table = pd.DataFrame(rows, columns=["what", "ours_s", "reference_s", "reference"])
    table.insert(3, "ratio", table["reference_s"] / table["ours_s"])
    return table


def compare_peers(runs: int = 20, slow_runs: int = 6) -> pd.DataFrame:
    """Rows of `peers.csv`: seconds of a run, how many find the best minimum, seconds to find it with 99 %."""
    record = make_records()[4]
    box = table2.search_box(record, NOTEBOOK)
    misfits = cost(record.t, record.v, NOTEBOOK.timing)
    folded = fold(record.t, record.v, NOTEBOOK.timing)
    assert folded is not None

    def projected(shapes: FloatArray) -> FloatArray:
        return project(shapes, folded, box.upper[0])[1]

    def differential_evolution(seed: int) -> float:
        found = optimize.differential_evolution(
            lambda points: misfits(np.ascontiguousarray(points.T)),
            list(zip(*box, strict=True)),
            popsize=NOTEBOOK.population // 7,
            maxiter=NOTEBOOK.iterations,
            vectorized=True,
            updating="deferred",
            rng=seed,
        )
        return float(found.fun)

    five = Box(box.lower[PROJECTED], box.upper[PROJECTED])
    methods: dict[str, tuple[int, Callable[[int], float]]] = {
        "this CMA-ES, population 300": (runs, lambda k: table2.fit(record, NOTEBOOK, k).rmse),
        "this CMA-ES, population 600": (runs, lambda k: table2.fit(record, RPM_600, k).rmse),
        "this CMA-ES on the five parameters that the projection leaves, population 600": (
            runs,
            lambda k: search(generations(projected, five, k, 600), 200).misfit,
        ),
        "today's cma, our compiled misfit": (
            slow_runs,
            lambda k: run_todays_cma(misfits, box, k, NOTEBOOK.iterations)[0],
        ),
        "SciPy's differential evolution, our compiled misfit": (slow_runs, differential_evolution),
    }
    limit = table2.best_fit(record).rmse * (1 + BASIN_GAP)
    rows = []
    for name, (number, run) in methods.items():
        run(1)
        seconds, ends = time_call(partial(run_seeds, run, number))
        best = int(np.sum(np.array(ends) <= limit))
        # With half a run more on either side, a share of 0 or 1 is not certain.
        share = (best + 0.5) / (number + 1)
        needed = max(1.0, np.log(0.01) / np.log(1 - share))
        rows.append((name, number, best, seconds / number, needed * seconds / number))
    columns = ["search", "runs", "best_minimum", "seconds_a_run", "seconds_to_99_percent"]
    return pd.DataFrame(rows, columns=columns)


def collect_notebook_times() -> pd.DataFrame:
    """Seconds of each notebook's last run here, as `make all` noted them, two at a time."""
    stamps = sorted((ROOT / ".make").glob("[0-9]*.ran"))
    rows = [(stamp.stem, json.loads(stamp.read_text("utf-8"))["seconds"]) for stamp in stamps]
    return pd.DataFrame(rows, columns=["notebook", "seconds"])


def of_now(table: pd.DataFrame) -> pd.DataFrame:
    """Add the date and the machine that times are of."""
    processor = f"{binding.get_host_cpu_name()}, {os.cpu_count()} cores"
    return table.assign(date=f"{datetime.now():%Y-%m-%d}", machine=processor)


if __name__ == "__main__":
    print(bench().to_string(index=False))
    for name, table in (("peers", compare_peers()), ("notebook_times", collect_notebook_times())):
        if len(table):
            write_csv(ROOT / "results" / f"{name}.csv", of_now(table))
        print(table.to_string(index=False))
