"""What speed the workbook's own code gains over a direct one: both arms of each row in one run."""

import json
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from replication.table2 import best_fit
from replication import published, table2
from replication.arrays import FloatArray
from replication.files import ROOT, write_csv
from replication.records import Recording, add_noise, simulate_clean
from replication.signature import rmse
from replication.table2 import LEVELS, SearchSettings, search_box
from studies.todays_cma import fit_with_todays_cma

PROTOCOL = SearchSettings()
RUNS = 30  # of each record in the table, and CMA-ES fits that one global fit is measured against
REPEATS = 5  # that a median is taken over
LEAST_RATIOS = {"objective": 400, "paper_fit": 900, "table2_300_fits": 800}
AUTHORS_LOOP = (
    "the authors' loop: today's cma with its bounds, equations 1 to 7 in NumPy; "
    "scaled to as many evaluations"
)
RUN = ROOT / "results" / "run.json"


def plain_misfits(recording: Recording) -> Callable[[FloatArray], list[float]]:
    """The cost function as the paper writes it, one member after another."""
    t, v = recording.t, recording.v
    return lambda members: [rmse(t, v, X, PROTOCOL.timing) for X in members]


def median_seconds(call: Callable[[], object]) -> float:
    """Median wall time of a call [s], after one call that compiles."""
    call()
    return float(np.median([once(call)[0] for _ in range(REPEATS)]))


def once(call: Callable[[], Any]) -> tuple[float, Any]:
    """Wall time of one call [s], and what it returns."""
    begun = perf_counter()
    returned = call()
    return perf_counter() - begun, returned


def bench() -> pd.DataFrame:
    """Measure all rows of `bench.csv` on simulated records of Table 2."""
    noise = published.column("Table 2", "noise")
    clean = [simulate_clean(level) for level in LEVELS]
    rng = np.random.default_rng(1)
    records = [add_noise(*pair, rng) for pair in zip(clean, noise[:-1], strict=True)]
    record = records[0]
    box = search_box(record, PROTOCOL)
    unit = np.random.default_rng(1).random((PROTOCOL.population, box.lower.size))
    population = box.lower + unit * (box.upper - box.lower)
    misfits, plain = table2.cost(record, PROTOCOL), plain_misfits(record)
    compiled = median_seconds(lambda: misfits(population)) / len(population)
    written = median_seconds(lambda: plain(population)) / len(population)
    fit = median_seconds(lambda: table2.fit(record, PROTOCOL, 1))
    loop, slow = once(lambda: fit_with_todays_cma(record, PROTOCOL, 1, plain))
    many, ours = once(lambda: [table2.fit(record, PROTOCOL, 1 + run) for run in range(RUNS)])
    loop /= slow.evaluations
    jobs = [delayed(table2.fit)(each, PROTOCOL, 1 + run) for each in records for run in range(RUNS)]
    with Parallel(n_jobs=2) as pool:
        pool(jobs[:2])  # starts and compiles
        together, fits = once(lambda: pool(jobs))
    by_loop = loop * sum(fit.evaluations for fit in fits) / 2
    whole = median_seconds(lambda: best_fit(record))
    rows = [
        ("objective", compiled, written, "equations 1 to 7 in NumPy"),
        ("paper_fit", fit, loop * ours[0].evaluations, AUTHORS_LOOP),
        ("table2_300_fits", together, by_loop, f"two cores; {AUTHORS_LOOP}"),
        ("global_fit", whole, many, f"{RUNS} of our fits, one core"),
    ]
    table = pd.DataFrame(rows, columns=["name", "ours_s", "reference_s", "note"])
    table.insert(3, "ratio", table["reference_s"] / table["ours_s"])
    return table


def notebook_times() -> pd.DataFrame:
    """Collect the seconds of each notebook's last run, two at a time, as `make all` noted them."""
    run = json.loads(RUN.read_text("utf-8"))
    seconds = pd.Series(run["seconds"], name="seconds").rename_axis("notebook")
    return seconds.reset_index().assign(cores=run["cores"], machine=run["machine"])


if __name__ == "__main__":
    if RUN.exists():
        write_csv(ROOT / "results" / "notebook_times.csv", notebook_times())
    else:
        print("no `make all` here yet: the notebooks' times stay as they are")
    measured = bench()
    write_csv(ROOT / "results" / "bench.csv", measured)
    least = measured["name"].map(LEAST_RATIOS)
    print(measured.drop(columns="note").assign(at_least=least).to_string(index=False))
