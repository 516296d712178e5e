"""Speed as ratios, both arms in one run, and peers of the search: `make bench`.

It prints how ours compares with a direct way; `results/peers.csv` gives the time in which a search finds the best
minimum of a noisy record with 99 %, `results/notebook_times.csv` how long the notebooks took in `make all`.
"""

import json
import os
from collections.abc import Callable
from datetime import datetime
from time import perf_counter
from timeit import repeat
from typing import Any

import numpy as np
import pandas as pd
from llvmlite import binding

from replication import table2
from replication.files import ROOT, write_kept
from replication.misfit import cost
from replication.signature import FloatArray, rmse
from replication.table2 import NOTEBOOK
from studies.peers import compare_peers, make_records, run_cma

REPEATS = 5  # that a median is taken over
AUTHORS_LOOP = (
    "the authors' loop: today's cma, equations 1 to 7 in NumPy, scaled to as many evaluations"
)


def median_seconds(call: Callable[[], Any]) -> float:
    """Median wall time of a call [s], after one call that compiles."""
    call()
    return float(np.median(repeat(call, number=1, repeat=REPEATS)))


def bench() -> pd.DataFrame:
    """Measure ours, a reference, and the reference over ours."""
    record, settings = make_records()[4], NOTEBOOK
    box = table2.search_box(record, settings)
    members = np.random.default_rng(1).uniform(*box, (settings.population, 7))
    misfits = cost(record.t, record.v, settings.timing)

    def by_equations(members: FloatArray) -> list[float]:
        return [rmse(record.t, record.v, X, settings.timing) for X in members]

    compiled = median_seconds(lambda: misfits(members)) / len(members)
    plain = median_seconds(lambda: by_equations(members)) / len(members)
    fit = median_seconds(lambda: table2.fit(record, settings, 1))
    evaluations = table2.fit(record, settings, 1).generations * settings.population
    begun = perf_counter()
    scaled = evaluations / run_cma(by_equations, box, 1, 10)
    loop = scaled * (perf_counter() - begun)
    rows = [
        ("misfit of a member", compiled, plain, "equations 1 to 7 in NumPy"),
        ("a fit of the paper", fit, loop, AUTHORS_LOOP),
    ]
    table = pd.DataFrame(rows, columns=["what", "ours_s", "reference_s", "reference"])
    table.insert(3, "ratio", table["reference_s"] / table["ours_s"])
    return table


def collect_notebook_times() -> pd.DataFrame:
    """Seconds of each notebook's last run here, as `make all` noted them, two at a time."""
    stamps = sorted((ROOT / ".make").glob("[0-9]*.ran"))
    rows = [(stamp.stem, json.loads(stamp.read_text("utf-8"))["seconds"]) for stamp in stamps]
    return pd.DataFrame(rows, columns=["notebook", "seconds"])


if __name__ == "__main__":
    print(bench().to_string(index=False))
    processor = f"{binding.get_host_cpu_name()}, {os.cpu_count()} cores"
    for name, table in (("peers", compare_peers()), ("notebook_times", collect_notebook_times())):
        if len(table):
            of_now = table.assign(date=f"{datetime.now():%Y-%m-%d}", machine=processor)
            write_kept(ROOT / "results" / f"{name}.csv", of_now)
        print(table.to_string(index=False))
