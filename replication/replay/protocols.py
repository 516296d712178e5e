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

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy import stats

from replication import published
from replication.arrays import FloatArray
from replication.authors import load_noisy
from replication.compiled.misfit import Fold, fold, folded_rmse
from replication.compiled.whole_run import whole_run
from replication.files import ROOT
from replication.identify import Protocol, protocol_box
from replication.recording import Recording, from_sample
from replication.search import Search, generations, random_normals, search
from replication.signature import Box
from replication.table2 import AUTHORS, basin_labels, start_samples, table2_levels

ROWS = range(1, 11)
REALISATIONS = range(1, 6)
COLUMNS = ("mean_A_rps", "sd_A_rps")
LEVEL = published.criterion("random_start")
RUNS = ROOT / "results" / "protocol_runs.csv"
PRINTED = np.stack([published.column("Table 2", name)[: len(ROWS)] for name in ("mean", "sd")])  # [rps], (2, rows)
WIDE = 1e3  # a box so much wider than Table 1's that no sample comes near its bounds


@dataclass(frozen=True)
class Candidate:
    """A protocol that may have printed Table 2."""

    name: str
    protocol: Protocol = AUTHORS
    rpm: bool = False  # the record is fitted as 60 (v - mean v), as equation 10 has A, and not in rps
    fixed_T2_s: float | None = None  # T1 = 0 and this T2 are fixed, and the five other parameters have no bounds
    runs: int = 30  # of each row and realisation


def _candidates() -> tuple[Candidate, ...]:
    as_printed, many = replace(AUTHORS, amplitude_factor=1.0), replace(AUTHORS, population=2000)
    T_d, T_f = (published.value(f"table1.{name}.max") for name in ("T_d", "T_f"))
    # The line does not say T_f: 2 T_d, as in Table 1. A run of it takes 20 times as long as the notebook's.
    line = Candidate("switched-off line", replace(many, T_d=T_d, T_f=T_f), fixed_T2_s=0.218, runs=3)
    return (
        Candidate("authors' notebook"),
        *(Candidate(f"population {size}", replace(AUTHORS, population=size)) for size in (600, 1000)),
        Candidate("population 2000", many, runs=10),
        Candidate("box of A as printed", as_printed),
        Candidate("rpm about the mean", as_printed, rpm=True),
        Candidate("rpm about the mean, population 2000", replace(as_printed, population=2000), rpm=True, runs=10),
        *(Candidate(f"start drawn {start}", replace(AUTHORS, start=start)) for start in ("per run", "per record")),
        Candidate("T_d and T_f as printed", replace(AUTHORS, T_d=T_d, T_f=T_f)),
        line,
        replace(line, name="switched-off line, T_d = 0.2 s", protocol=many),
    )


CANDIDATES = {candidate.name: candidate for candidate in _candidates()}


@cache
def _record(row: int, realisation: int) -> Recording:
    return load_noisy(table2_levels()[row - 1], realisation)


def one_run(candidate: Candidate, row: int, realisation: int, seed: int) -> tuple[float, float]:
    """Fit the authors' record of a row and a realisation once: |A| and RMSE [rps]."""
    protocol, scale = candidate.protocol, 60.0 if candidate.rpm else 1.0
    (start,) = start_samples(protocol, [seed], (row, realisation))
    record = from_sample(_record(row, realisation), start)
    if candidate.rpm:
        record = replace(record, v=scale * (record.v - record.v.mean()))
    settings = fold(record.t, record.v, protocol.timing), protocol_box(record, protocol), seed, protocol.population
    T2_s = candidate.fixed_T2_s
    found = (whole_run if T2_s is None else partial(_run_without_bounds, T2_s))(*settings, protocol.iterations)
    return abs(float(found.best[0])) / scale, float(found.misfit) / scale


def _run_without_bounds(T2_s: float, folded: Fold, box: Box, seed: int, population: int, iterations: int) -> Search:
    """Search over A, t0, tau, omega and v_t as `whole_run` does, from the middle of a box but not bounded by it."""
    middle, half = ((box.upper + sign * box.lower)[:5] / 2 for sign in (1, -1))

    def misfits(members: FloatArray) -> FloatArray:
        if (np.abs(members - middle) > WIDE / 2 * half).any():
            raise ValueError("a sample came near the bounds, which were not to be felt")
        return folded_rmse(np.column_stack([members, np.tile([T2_s, 0.0], (population, 1))]), folded)

    wide = Box(middle - WIDE * half, middle + WIDE * half)
    return search(generations(misfits, wide, random_normals(seed), population, sigma=1 / WIDE), iterations)


def summarise(candidate: Candidate, row: int, realisation: int) -> dict[str, Any]:
    """Mean and SD of |A| [rps] and the best basin's share over a candidate's runs on one record."""
    ends = np.array([one_run(candidate, row, realisation, seed) for seed in range(1, candidate.runs + 1)])
    A, best = ends[:, 0], basin_labels(ends[:, 1]) == 1
    key = {"protocol": candidate.name, "row": row, "realisation": realisation, "runs": len(A)}
    return key | {"mean_A_rps": A.mean(), "sd_A_rps": A.std(ddof=1), "best_basin_share": best.mean()}


def compute_runs() -> pd.DataFrame:
    """Summarise every candidate's runs on every row and realisation, for `RUNS`."""

    def summaries(row: int, realisation: int) -> list[dict]:  # one record at a time: reading it takes a second
        return [summarise(candidate, row, realisation) for candidate in CANDIDATES.values()]

    # Two processes, on any machine: only new ones heed the environment that `make protocols` pins.
    found = Parallel(n_jobs=2, verbose=10)(delayed(summaries)(*record) for record in product(ROWS, REALISATIONS))
    return pd.DataFrame([row for of_candidate in zip(*found, strict=True) for row in of_candidate])


def numbers_of(runs: pd.DataFrame, name: str) -> FloatArray:
    """Means and SDs [rps] of a candidate, shape (2, rows, realisations)."""
    part = runs[runs["protocol"] == name]
    return np.stack([part.pivot(index="row", columns="realisation", values=column) for column in COLUMNS])


def student_t(numbers: FloatArray, judged: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Criterion 2: t and two-sided p of judged numbers among those of n realisations, the last axis."""
    n, logs = numbers.shape[-1], np.log(numbers)
    t = (np.log(judged) - logs.mean(axis=-1)) / (logs.std(axis=-1, ddof=1) * np.sqrt(1 + 1 / n))
    return t, 2 * stats.t.sf(np.abs(t), n - 1)


def table_p(numbers: FloatArray, judged: FloatArray) -> tuple[float, float, float]:
    """Criterion 3: p_means, p_sds and p of a whole table of shape (2, rows), among tables of n realisations."""
    p_means, p_sds = (stats.combine_pvalues(p, "fisher").pvalue for p in student_t(numbers, judged)[1])
    return p_means, p_sds, min(1.0, 2 * min(p_means, p_sds))


def leave_one_out(numbers: FloatArray) -> FloatArray:
    """Criterion 4: p_means, p_sds and p of each realisation's table among the others', shape (realisations, 3)."""
    n = numbers.shape[-1]
    return np.array([table_p(np.delete(numbers, k, axis=-1), numbers[..., k]) for k in range(n)])


def residuals(runs: pd.DataFrame) -> pd.DataFrame:
    """Compare each printed number with each candidate: `protocol, column` ("mean" or "sd") `, row, t, p`."""
    found = [
        {"protocol": name, "column": column, "row": ROWS, "t": t, "p": p}
        for name in runs["protocol"].unique()
        for column, t, p in zip(("mean", "sd"), *student_t(numbers_of(runs, name), PRINTED), strict=True)
    ]
    return pd.concat(map(pd.DataFrame, found), ignore_index=True)


def judge(runs: pd.DataFrame, level: float = LEVEL) -> pd.DataFrame:
    """Judge every candidate by the criterion above: its settings and p-values, a row each, the largest p first."""
    table, rows = residuals(runs), []
    outside = table[table["p"] < level].groupby(["protocol", "column"]).size()
    for name, part in runs.groupby("protocol", sort=False):
        candidate, numbers = CANDIDATES[name], numbers_of(runs, name)
        settings, left_out = candidate.protocol, leave_one_out(numbers)
        p_means, p_sds, p = table_p(numbers, PRINTED)
        of = {"protocol": name, "population": settings.population, "start": settings.start}
        of |= {"amplitude_factor": settings.amplitude_factor, "T_d_s": settings.T_d, "T_f_s": settings.T_f}
        of |= {"rpm": candidate.rpm, "bounds": candidate.fixed_T2_s is None, "runs": part["runs"].iloc[0]}
        of |= {"p_means": p_means, "p_sds": p_sds, "p": p, "explains": p >= level}
        for k, column in enumerate(("mean", "sd")):
            of[f"{column}s_outside"] = outside.get((name, column), 0)
            of[f"left_out_{column}s_rejected"] = (left_out[:, k] < level).sum()
        rows.append(of | {"best_basin_share": part["best_basin_share"].mean()})
    return pd.DataFrame(rows).sort_values("p", ascending=False, kind="stable", ignore_index=True)


def random_start(judged: pd.DataFrame, criteria: Mapping[str, float] | None = None) -> tuple[bool | None, str]:
    """Criterion 6: whether the start was drawn, from `judge`'s table, and what was measured."""
    best = judged.sort_values("p", ascending=False).groupby(judged["start"] != "whole").first()
    drawn, whole = best.loc[True], best.loc[False]
    text = "largest p of Table 2 with a drawn start {:.2g} ({}), with the whole record {:.2g} ({})"
    neither = max(drawn["p"], whole["p"]) < published.criterion("random_start", criteria)
    measured = (np.nan, np.nan) if neither else (whole["p"], drawn["p"])
    return published.decide("random_start", measured, criteria), text.format(
        drawn["p"], drawn["protocol"], whole["p"], whole["protocol"]
    )


def describe_candidates(judged: pd.DataFrame) -> str:
    """Say in one sentence which candidates of `judge` are compatible with Table 2."""
    p = judged.set_index("protocol")["p"]
    explains = judged["explains"].to_numpy(bool)
    named = ", ".join(f"{name} (p = {value:.2g})" for name, value in p[explains].items())
    said = f"{explains.sum() or 'None'} of {len(p)} candidate protocols are compatible with Table 2"
    said += f": {named}" if named else ""
    said += "; the table cannot tell them apart" if explains.sum() > 1 else ""
    for name, value in p[~explains].nlargest(1).items():
        said += f". The next, {name}, fails with p = {value:.2g}"
    return f"{said}. Other seeds move such a p; no p is corrected for the number of candidates."
