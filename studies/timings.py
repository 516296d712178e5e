"""What speed the workbook's own code gains over a direct one: both arms of each row in one run."""

import json
from collections.abc import Callable, Sequence
from functools import partial
from time import perf_counter

import cma
import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from backlash.fitting.global_fit import global_fit
from replication import published, table2
from replication.files import ROOT, write_csv
from replication.recording import Recording, add_uniform_noise
from replication.signature import rmse
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import simulate, simulate_many
from replication.table2 import Fit, Protocol, protocol_box, theoretical_amplitudes
from studies.reference import solve_ivp_speed_rps

PROTOCOL = Protocol()
RUN = ROOT / "results" / "run.json"


def reference_fit(recording: Recording, protocol: Protocol, seed: int) -> Fit:
    """The paper's fit without this project's shortcuts: cma's own bounds, and the cost function as the paper writes it.

    Parameters
    ----------
    recording : Recording
        The record.
    protocol : Protocol
        Settings of the search.
    seed : int
        Seed of the run, above 0.

    Returns
    -------
    Fit
    """
    box = protocol_box(recording, protocol)
    options = {
        "bounds": [box.lower, box.upper],
        "popsize": protocol.population,
        "maxiter": protocol.iterations,
        "CMA_stds": (box.upper - box.lower) / 4,
        "seed": np.nan,
        "randn": np.random.RandomState(seed).randn,
        "verbose": -9,
        "verb_log": 0,
    }
    strategy = cma.CMAEvolutionStrategy((box.lower + box.upper) / 2, 1.0, options)
    while not strategy.stop():
        population = strategy.ask()
        strategy.tell(
            population, [rmse(recording.t, recording.v, X, protocol.timing) for X in population]
        )
    return Fit(strategy.best.x, float(strategy.best.f), strategy.countevals, strategy.countiter)


def median_seconds(call: Callable[[], object], repeats: int) -> float:
    """Median wall time of a call [s], after one call that compiles."""
    call()
    return float(np.median([once(call) for _ in range(repeats)]))


def once(call: Callable[[], object]) -> float:
    """Wall time of one call [s]."""
    begun = perf_counter()
    call()
    return perf_counter() - begun


def bench_identification(
    records: Sequence[Recording], runs: int = 30, repeats: int = 5
) -> pd.DataFrame:
    """Measure the rows of `bench.csv` that belong to identification.

    Parameters
    ----------
    records : sequence of Recording
        Table 2's records; all but the last row use the first.
    runs : int
        Fits of each record in the table, and CMA-ES fits that one global fit is measured against.
    repeats : int
        Calls that a median is taken over.

    Returns
    -------
    DataFrame
        `name, ours_s, reference_s, ratio, note`: seconds of one evaluation, one fit, all fits of the table, one global
        fit. The note says what the reference is and whether its seconds are extrapolated.
    """
    record, timing = records[0], PROTOCOL.timing
    box = protocol_box(record, PROTOCOL)
    population = box.lower + np.random.default_rng(1).random((PROTOCOL.population, 7)) * (
        box.upper - box.lower
    )
    size = len(population)
    misfits = table2.cost(record, PROTOCOL)
    compiled = median_seconds(lambda: misfits(population), repeats) / size
    written = (
        median_seconds(lambda: [rmse(record.t, record.v, X, timing) for X in population], repeats)
        / size
    )
    fit = median_seconds(lambda: table2.fit(record, PROTOCOL, 1), repeats)
    slow: list[Fit] = []
    slow_evaluation = (
        once(lambda: slow.append(reference_fit(record, PROTOCOL, 1))) / slow[0].evaluations
    )
    ours = table2.fit(record, PROTOCOL, 1)
    jobs = [delayed(table2.fit)(r, PROTOCOL, seed) for r in records for seed in range(1, runs + 1)]
    with Parallel(n_jobs=2) as pool:
        pool(jobs[:2])  # starts and compiles
        fits: list[Fit] = []
        table = once(lambda: fits.extend(pool(jobs)))
    whole = median_seconds(lambda: [global_fit(r) for r in records], repeats) / len(records)
    many = once(lambda: [table2.fit(record, PROTOCOL, seed) for seed in range(1, runs + 1)])
    scaled = "the authors' loop: today's cma with its bounds, equations 1 to 7 in NumPy; scaled to as many evaluations"
    rows = [
        ("objective", compiled, written, "equations 1 to 7 in NumPy"),
        ("paper_fit", fit, slow_evaluation * ours.evaluations, scaled),
        (
            "table2_300_fits",
            table,
            slow_evaluation * sum(f.evaluations for f in fits) / 2,
            "two cores; " + scaled,
        ),
        ("global_fit", whole, many, f"{runs} of our fits, one core"),
    ]
    return _table(rows)


def bench_simulator(repeats: int = 11) -> pd.DataFrame:
    """Measure the rows of `bench.csv` that belong to the simulator.

    Parameters
    ----------
    repeats : int
        Calls that a median is taken over.

    Returns
    -------
    DataFrame
        Columns as in `bench_identification`: a record of 4.8 s against SciPy's LSODA on the same compiled field, and
        ten levels in one call on two threads against one. The notes give the largest errors against a converged
        record.
    """
    joint, delta = identified_joint(), 15e-4
    period = joint.control_period_s
    converged = simulate(joint, delta, sample_s=period, step_s=1e-6).motor_speed_rps
    speeds: list[np.ndarray] = []
    slow = once(
        lambda: speeds.append(solve_ivp_speed_rps(joint, delta, 4.8, "LSODA", rtol=1e-6, atol=1e-9))
    )
    fast = median_seconds(lambda: simulate(joint, delta), repeats)
    ours = np.abs(simulate(joint, delta, sample_s=period).motor_speed_rps - converged).max()
    theirs = np.abs(speeds[0] - converged).max()
    levels = [1e-4 * (2 * k - 1) for k in range(2, 12)]
    two, one = (
        median_seconds(partial(simulate_many, joint, levels, threads=n), repeats) for n in (2, 1)
    )
    rows = [
        (
            "simulate_record",
            fast,
            slow,
            f"LSODA on the same field; errors {ours:.1e} and {theirs:.1e} rps",
        ),
        ("simulate_ten_levels", two, one, "two threads against one"),
    ]
    return _table(rows)


def _table(rows: list[tuple[str, float, float, str]]) -> pd.DataFrame:
    columns = ["name", "ours_s", "reference_s", "ratio", "note"]
    return pd.DataFrame(
        [(name, ours, other, other / ours, note) for name, ours, other, note in rows],
        columns=columns,
    )


def bench() -> pd.DataFrame:
    """Measure all rows of `bench.csv`, on simulated records of Table 2.

    Raises
    ------
    DataUnavailable, DataCorrupt
        See `replication.authors.authors_file`.
    """
    noise = published.column("Table 2", "noise")
    clean = simulate_recordings(identified_joint(), list(theoretical_amplitudes()))
    rng = np.random.default_rng(1)
    records = [add_uniform_noise(*pair, rng) for pair in zip(clean, noise[:-1], strict=True)]
    return pd.concat([bench_identification(records), bench_simulator()], ignore_index=True)


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
