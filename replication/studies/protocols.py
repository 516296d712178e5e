"""Which protocol printed Table 2? A dozen candidates that could exist before 2022, judged on the authors' five noises.

The criterion, fixed before any number was computed with it. Known before: all ten printed means lie in the intervals
of the authors' notebook; a fixed window, or T_d and T_f as printed, gives an A far below them on R = 1 and 2.
1. A candidate runs on the records R = 1 to 5 of each row; a row's numbers are mean and SD of |A| over the runs.
2. For each row, t = (ln printed - m) / (s sqrt(1 + 1/5)), m and s from the five ln means, and likewise from the five
   ln SDs: the printed table has another noise. Two-sided p by Student's t with 4 degrees of freedom.
3. Ten p make one by Fisher's method, as each row has its own noise: p_means and p_sds. The candidate's p is
   min(1, 2 min(p_means, p_sds)). It explains the table if p >= 0.05.
4. Calibration: each realisation in turn takes the printed table's place, judged by the other four: five p.
5. Multiplicity: no correction; of twelve candidates, each tested at 5 %, all right, 0.6 would fail by chance.
6. Claim `random_start`: it holds if a candidate with a drawn start explains the table and none with the whole record
   does; it does not hold if it is the other way round; otherwise it is undecided.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from numpy.typing import NDArray

from replication import published
from replication.compiled.folded import fold, folded_rmse
from replication.compiled.misfit import population_rmse
from replication.compiled.whole_run import whole_run
from replication.datasets import Recording, from_sample, load_noisy
from replication.identify import Protocol, protocol_box
from replication.search import generations, random_normals, search
from replication.signature import Box
from replication.table2 import AUTHORS, basin_labels, table2_levels
from replication.workbook.files import ROOT, write_csv

FloatArray = NDArray[np.float64]

ROWS = range(1, 11)
REALISATIONS = range(1, 6)
RUNS = ROOT / "results" / "protocol_runs.csv"
PRINTED_T_S = (published.value("table1.T_d.max"), published.value("table1.T_f.max"))
WIDE = 1e3  # a box so much wider than Table 1's that no sample comes near its bounds


@dataclass(frozen=True)
class Candidate:
    """A protocol that may have printed Table 2.

    Attributes
    ----------
    name : str
        What tables call it.
    protocol : Protocol
        Population, iterations, box of A, T_d and T_f, start.
    rpm : bool
        The record is fitted as 60 (v - mean v), as equation 10 has A, and not in rps.
    fixed_T2_s : float, optional
        T1 = 0 and T2 are fixed and the five other parameters have no bounds; the search begins as it does in the box.
    runs : int
        Runs of each row and realisation.
    """

    name: str
    protocol: Protocol = AUTHORS
    rpm: bool = False
    fixed_T2_s: float | None = None
    runs: int = 30


def _candidates() -> tuple[Candidate, ...]:
    as_printed = replace(AUTHORS, amplitude_factor=1.0)
    printed_T = replace(AUTHORS, T_d=PRINTED_T_S[0], T_f=PRINTED_T_S[1])
    # The line says T_d and the window; its T_f is taken as Table 1 has it, 2 T_d. Its runs take 30 times as long.
    line = Candidate("switched-off line", replace(printed_T, population=2000), fixed_T2_s=0.218, runs=10)
    return (
        Candidate("authors' notebook"),
        *(Candidate(f"population {size}", replace(AUTHORS, population=size)) for size in (600, 1000, 2000)),
        Candidate("box of A as printed", as_printed),
        Candidate("rpm about the mean", as_printed, rpm=True),
        Candidate("rpm about the mean, population 2000", replace(as_printed, population=2000), rpm=True),
        *(Candidate(f"start drawn {start}", replace(AUTHORS, start=start)) for start in ("per run", "per record")),
        Candidate("T_d and T_f as printed", printed_T),
        line,
        replace(line, name="switched-off line, T_d = 0.2 s", protocol=replace(AUTHORS, population=2000)),
    )


CANDIDATES = {candidate.name: candidate for candidate in _candidates()}


@cache
def _record(row: int, realisation: int) -> Recording:
    return load_noisy(table2_levels()[row - 1], realisation)


def one_run(candidate: Candidate, row: int, realisation: int, seed: int) -> tuple[float, float]:
    """Fit the authors' record of a row and a realisation once: |A| and RMSE [rps]."""
    protocol, scale = candidate.protocol, 60.0 if candidate.rpm else 1.0
    key = {"per run": (row, realisation, seed), "per record": (row, realisation)}.get(protocol.start)
    start = int(np.random.default_rng(key).integers(protocol.latest_start)) if key else 0
    record = from_sample(_record(row, realisation), start)
    if candidate.rpm:
        record = replace(record, v=scale * (record.v - record.v.mean()))
    if candidate.fixed_T2_s is not None:
        A, misfit = _run_without_bounds(candidate, record, seed)
    else:
        folded, box = fold(record.t, record.v, protocol.timing), protocol_box(record, protocol)
        run = whole_run(folded, box, seed, protocol.population, protocol.iterations)
        A, misfit = run.best[0], run.misfit
    return abs(float(A)) / scale, float(misfit) / scale


def _run_without_bounds(candidate: Candidate, record: Recording, seed: int) -> tuple[float, float]:
    """A and misfit of a run over A, t0, tau, omega and v_t, from Table 1's box but not bounded by it."""
    protocol = candidate.protocol
    table1, timing = protocol_box(record, protocol), protocol.timing
    middle, half = ((table1.upper + sign * table1.lower)[:5] / 2 for sign in (1, -1))
    folded = fold(record.t, record.v, timing)

    def misfits(members: FloatArray) -> FloatArray:
        if (np.abs(members - middle) > WIDE / 2 * half).any():
            raise ValueError("a sample came near the bounds, which were not to be felt")
        window = np.tile([candidate.fixed_T2_s, 0.0], (len(members), 1))
        X, found = np.column_stack([members, window]), np.empty(len(members))
        early = X[:, 1] < 0  # folding needs a t0 that is not negative
        found[early] = population_rmse(record.t, record.v, X[early], timing)
        found[~early] = folded_rmse(X[~early], folded)
        return found

    box = Box(middle - WIDE * half, middle + WIDE * half)
    steps = generations(misfits, box, random_normals(seed), protocol.population, sigma=1 / WIDE)
    found = search(steps, protocol.iterations)
    return found.best[0], found.misfit


def summarise(candidate: Candidate, row: int, realisation: int) -> dict[str, str | float]:
    """Mean and SD of |A| [rps] and the best basin's share over a candidate's runs on one record."""
    ends = np.array([one_run(candidate, row, realisation, seed) for seed in range(1, candidate.runs + 1)])
    A, best = ends[:, 0], basin_labels(ends[:, 1]) == 0
    key = {"protocol": candidate.name, "row": row, "realisation": realisation, "runs": len(A)}
    return key | {"mean_A_rps": A.mean(), "sd_A_rps": A.std(ddof=1), "best_basin_share": best.mean()}


def compute_runs(jobs: int = 2, tell: Callable[[str], None] = print, path: Path = RUNS) -> None:
    """Summarise every candidate's runs on every row and realisation; write the table after each candidate."""
    rows: list[dict] = []
    for candidate in CANDIDATES.values():
        todo = [delayed(summarise)(candidate, row, R) for row in ROWS for R in REALISATIONS]
        rows += Parallel(n_jobs=jobs)(todo)
        write_csv(path, pd.DataFrame(rows))
        tell(f"{candidate.name}: done")
