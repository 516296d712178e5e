"""What speed the workbook's own code gains over a direct one: both arms of each row in one run."""

import json
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd

from backlash.fitting.global_fit import global_fit
from replication import published, table2
from replication.arrays import FloatArray
from replication.files import ROOT, write_csv
from replication.records import Recording, add_uniform_noise
from replication.signature import rmse
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings
from replication.table2 import SearchSettings, search_box, theoretical_amplitudes
from studies.todays_cma import fit_with_todays_cma

PROTOCOL = SearchSettings()
RUNS = 30  # CMA-ES fits that one global fit is measured against
REPEATS = 5  # that a median is taken over
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
    """Measure all rows of `bench.csv`: an evaluation, a fit and a global fit of a record of Table 2's first row."""
    clean = simulate_recordings(identified_joint(), [next(iter(theoretical_amplitudes()))])[0]
    noise_rps = published.value("table2.row01.noise")
    record = add_uniform_noise(clean, noise_rps, np.random.default_rng(1))
    box = search_box(record, PROTOCOL)
    unit = np.random.default_rng(1).random((PROTOCOL.population, box.lower.size))
    population = box.lower + unit * (box.upper - box.lower)
    misfits, plain = table2.cost(record, PROTOCOL), plain_misfits(record)
    compiled = median_seconds(lambda: misfits(population)) / len(population)
    written = median_seconds(lambda: plain(population)) / len(population)
    fit = median_seconds(lambda: table2.fit(record, PROTOCOL, 1))
    loop, slow = once(lambda: fit_with_todays_cma(record, PROTOCOL, 1, plain))
    many, ours = once(lambda: [table2.fit(record, PROTOCOL, 1 + run) for run in range(RUNS)])
    loop *= ours[0].evaluations / slow.evaluations
    whole = median_seconds(lambda: global_fit(record))
    rows = [
        ("objective", compiled, written, "equations 1 to 7 in NumPy"),
        ("paper_fit", fit, loop, AUTHORS_LOOP),
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
    print(measured.drop(columns="note").to_string(index=False))
