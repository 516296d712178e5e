"""What speed the workbook's own code gains over a direct one: both arms of each row in one run."""

import json
from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from backlash.fitting.global_fit import global_fit
from replication import published, table2
from replication.arrays import FloatArray
from replication.files import ROOT, write_csv
from replication.records import Recording, add_uniform_noise
from replication.signature import rmse
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import simulate
from replication.table2 import SearchSettings, search_box, theoretical_amplitudes
from studies.reference import solve_ivp_speed_rps
from studies.todays_cma import fit_with_todays_cma

PROTOCOL = SearchSettings()
RUNS = 30  # of each record in the table, and CMA-ES fits that one global fit is measured against
REPEATS = 5  # that a median is taken over
AUTHORS_LOOP = (
    "the authors' loop: today's cma with its bounds, equations 1 to 7 in NumPy; "
    "scaled to as many evaluations"
)
RUN = ROOT / "results" / "run.json"

Row = tuple[str, float, float, str]  # name, seconds of ours and of the reference, what that is


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


def bench_search(records: Sequence[Recording]) -> list[Row]:
    """Time one evaluation, one fit, all fits of Table 2's records, and one global fit.

    All but the last two rows use the first record.
    """
    record = records[0]
    box = search_box(record, PROTOCOL)
    unit = np.random.default_rng(1).random((PROTOCOL.population, box.lower.size))
    population = box.lower + unit * (box.upper - box.lower)
    misfits, plain = table2.cost(record, PROTOCOL), plain_misfits(record)
    compiled = median_seconds(lambda: misfits(population)) / len(population)
    written = median_seconds(lambda: plain(population)) / len(population)
    fit = median_seconds(lambda: table2.fit(record, PROTOCOL, 1))
    loop, slow = once(lambda: fit_with_todays_cma(record, PROTOCOL, 1, plain))
    loop /= slow.evaluations
    many, ours = once(lambda: [table2.fit(record, PROTOCOL, 1 + run) for run in range(RUNS)])
    jobs = [delayed(table2.fit)(r, PROTOCOL, 1 + run) for r in records for run in range(RUNS)]
    with Parallel(n_jobs=2) as pool:
        pool(jobs[:2])  # starts and compiles
        table, fits = once(lambda: pool(jobs))
    evaluations = sum(fit.evaluations for fit in fits)
    whole = median_seconds(lambda: [global_fit(each) for each in records]) / len(records)
    return [
        ("objective", compiled, written, "equations 1 to 7 in NumPy"),
        ("paper_fit", fit, loop * ours[0].evaluations, AUTHORS_LOOP),
        ("table2_300_fits", table, loop * evaluations / 2, f"two cores; {AUTHORS_LOOP}"),
        ("global_fit", whole, many, f"{RUNS} of our fits, one core"),
    ]


def bench_simulator() -> Row:
    """Time a record of 4.8 s against SciPy's LSODA on the same compiled field; the note gives both errors."""
    joint, delta_rad = identified_joint(), 15e-4
    period = joint.control_period_s
    converged = simulate(joint, delta_rad, sample_s=period, step_s=1e-6).motor_speed_rps
    slow, theirs = once(
        lambda: solve_ivp_speed_rps(joint, delta_rad, 4.8, "LSODA", rtol=1e-6, atol=1e-9)
    )
    fast = median_seconds(lambda: simulate(joint, delta_rad))
    ours = simulate(joint, delta_rad, sample_s=period).motor_speed_rps
    errors = [np.abs(speed - converged).max() for speed in (ours, theirs)]
    note = "LSODA on the same field; errors {:.1e} and {:.1e} rps".format(*errors)
    return "simulate_record", fast, slow, note


def bench() -> pd.DataFrame:
    """Measure all rows of `bench.csv`, on simulated records of Table 2."""
    noise = published.column("Table 2", "noise")
    clean = simulate_recordings(identified_joint(), list(theoretical_amplitudes()))
    rng = np.random.default_rng(1)
    records = [add_uniform_noise(*pair, rng) for pair in zip(clean, noise[:-1], strict=True)]
    rows = [*bench_search(records), bench_simulator()]
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
