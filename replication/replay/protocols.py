"""Which protocol printed Table 2? Candidates that could exist before 2022, judged on five noises.

The criterion, fixed before any number was computed with it. Known before: all ten printed means lie
in the intervals of the authors' notebook; a fixed window, or T_d and T_f as printed, gives an A far
below them on R = 1 and 2.
1. A candidate runs on the records R = 1 to 5 of each row; a row's numbers are mean and SD of |A|
   over the runs.
2. For each row, t = (ln printed - m) / (s sqrt(1 + 1/5)), m and s from the five ln means, and
   likewise from the five ln SDs: the printed table has another noise. Two-sided p by Student's t
   with 4 degrees of freedom.
3. Ten p make one by Fisher's method, as each row has its own noise: p_means and p_sds. The
   candidate's p is min(1, 2 min(p_means, p_sds)). It explains the table if p >= 0.05.
4. Calibration: each realisation in turn takes the printed table's place, judged by the other four:
   five p.
5. Multiplicity: no correction; of twelve candidates, each tested at 5 %, all right, 0.6 would fail
   by chance.
6. Claim `random_start`: it holds if a candidate with a drawn start explains the table and none with
   the whole record does; it does not hold if it is the other way round; otherwise it is undecided.
"""

import json
from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from replication import published
from replication.arrays import FloatArray
from replication.authors import LOW_NOISE, load_noisy
from replication.files import ROOT
from replication.identify import Fit, Protocol, paper_fit
from replication.parallel import in_parallel
from replication.published import Criteria, Decision
from replication.recording import Recording, from_sample
from replication.table2 import (
    AUTHORS_PROTOCOL,
    basin_labels,
    error_percent,
    start_samples,
    table2,
    table2_levels,
)

ROWS = range(1, 11)
COLUMNS = ("mean_A_rps", "sd_A_rps")
LEVEL = published.criterion("random_start")
PROTOCOL_RUNS = ROOT / "results" / "protocol_runs.csv"
# [rps], (2, rows)
PRINTED = np.stack([published.column("Table 2", name)[: len(ROWS)] for name in ("mean", "sd")])


# The authors' notebook, and what of it may have been otherwise when Table 2 was printed. The
# switched-off line is one of the notebook, which does not say T_f: 2 T_d, as in Table 1.
_CHANGES = json.loads((published.DATA / "variants.json").read_text(encoding="utf-8"))
VARIANTS = {AUTHORS_PROTOCOL.name: AUTHORS_PROTOCOL} | {
    name: replace(AUTHORS_PROTOCOL, name=name, **changes) for name, changes in _CHANGES.items()
}
# Those that could exist before 2022.
CANDIDATES = {name: variant for name, variant in VARIANTS.items() if variant.engine == "2021"}


def variant_scores(runs: pd.DataFrame) -> pd.DataFrame:
    """Compare each variant's means and SDs with Table 2's, row by row, from `repeated_fits` of one realisation."""
    parts = []
    for name, part in runs.groupby("protocol", sort=False):
        table = table2(part)
        scores = table[["delta_rad", "mean_A_rps", "sd_A_rps"]].assign(
            mean_error_percent=error_percent(table, "mean_A_rps"),
            sd_ratio=table["sd_A_rps"] / published.column("Table 2", "sd")[table["row"] - 1],
            best_basin_share=table["best_basin_runs"] / table["runs"],
        )
        scores.insert(0, "protocol", name)
        parts.append(scores)
    return pd.concat(parts, ignore_index=True)


def runs_of(candidate: Protocol) -> int:
    """Runs of a candidate on each record: fewer where one takes longer, 20 times as long as the notebook's."""
    if candidate.fixed_T2_s is not None:
        return 3
    return 10 if candidate.population == 2000 else 30


@cache
def _record(row: int, realisation: int) -> Recording:
    return load_noisy(table2_levels()[row - 1], realisation)


def one_run(candidate: Protocol, row: int, realisation: int, seed: int) -> Fit:
    """Fit the authors' record of a row and a realisation once."""
    (start,) = start_samples(candidate, [seed], (row, realisation))
    return paper_fit(from_sample(_record(row, realisation), start), candidate, seed)


def summarise(candidate: Protocol, row: int, realisation: int) -> dict[str, Any]:
    """Mean and SD of |A| [rps] and the best basin's share over a candidate's runs on one record."""
    fits = [one_run(candidate, row, realisation, seed) for seed in range(1, runs_of(candidate) + 1)]
    A = np.array([fit.amplitude_rps for fit in fits])
    best = basin_labels(np.array([fit.rmse for fit in fits])) == 1
    key = {"protocol": candidate.name, "row": row, "realisation": realisation, "runs": len(fits)}
    return key | {
        "mean_A_rps": A.mean(),
        "sd_A_rps": A.std(ddof=1),
        "best_basin_share": best.mean(),
    }


def compute_runs() -> pd.DataFrame:
    """Summarise every candidate's runs on every row and realisation, for `PROTOCOL_RUNS`."""

    # One record at a time: reading it takes a second.
    def summaries(row: int, realisation: int) -> list[dict]:
        return [summarise(candidate, row, realisation) for candidate in CANDIDATES.values()]

    found = in_parallel(summaries, product(ROWS, LOW_NOISE), "records")
    return pd.DataFrame([row for of_candidate in zip(*found, strict=True) for row in of_candidate])


def numbers_of(runs: pd.DataFrame, name: str) -> FloatArray:
    """Means and SDs [rps] of a candidate, shape (2, rows, realisations)."""
    part = runs[runs["protocol"] == name]
    return np.stack(
        [part.pivot(index="row", columns="realisation", values=column) for column in COLUMNS]
    )


def student_t(numbers: FloatArray, judged: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Criterion 2: t and two-sided p of judged numbers among n realisations, the last axis."""
    n = numbers.shape[-1]
    logs = np.log(numbers)
    t = (np.log(judged) - logs.mean(axis=-1)) / (logs.std(axis=-1, ddof=1) * np.sqrt(1 + 1 / n))
    return t, 2 * stats.t.sf(np.abs(t), n - 1)


def table_p(numbers: FloatArray, judged: FloatArray) -> tuple[float, float, float]:
    """Criterion 3: p_means, p_sds and p of a whole table of shape (2, rows), among tables of n realisations."""
    p_means, p_sds = (
        stats.combine_pvalues(p, "fisher").pvalue for p in student_t(numbers, judged)[1]
    )
    return p_means, p_sds, min(1.0, 2 * min(p_means, p_sds))


def leave_one_out(numbers: FloatArray) -> FloatArray:
    """Criterion 4: p_means, p_sds and p of each realisation's table among the others', shape (realisations, 3)."""
    n = numbers.shape[-1]
    return np.array([table_p(np.delete(numbers, k, axis=-1), numbers[..., k]) for k in range(n)])


def residuals(runs: pd.DataFrame) -> pd.DataFrame:
    """Compare each printed number with each candidate: `protocol, column` ("mean" or "sd") `, row, t, p`."""
    parts = []
    for name in runs["protocol"].unique():
        t, p = student_t(numbers_of(runs, name), PRINTED)
        for k, column in enumerate(("mean", "sd")):
            part = {"protocol": name, "column": column, "row": ROWS, "t": t[k], "p": p[k]}
            parts.append(pd.DataFrame(part))
    return pd.concat(parts, ignore_index=True)


def judge(runs: pd.DataFrame, level: float = LEVEL) -> pd.DataFrame:
    """Judge every candidate by the criterion above: its settings and p-values, a row each, the largest p first."""
    table = residuals(runs)
    outside = table[table["p"] < level].groupby(["protocol", "column"]).size()
    rows = []
    for name, part in runs.groupby("protocol", sort=False):
        candidate = CANDIDATES[name]
        numbers = numbers_of(runs, name)
        p_means, p_sds, p = table_p(numbers, PRINTED)
        rejected = (leave_one_out(numbers) < level).sum(axis=0)
        row = {
            "protocol": name,
            "population": candidate.population,
            "start": candidate.start,
            "amplitude_factor": candidate.amplitude_factor,
            "T_d_s": candidate.T_d,
            "T_f_s": candidate.T_f,
            "rpm": candidate.rpm,
            "bounds": candidate.fixed_T2_s is None,
            "runs": part["runs"].iloc[0],
            "p_means": p_means,
            "p_sds": p_sds,
            "p": p,
            "explains": p >= level,
            "means_outside": outside.get((name, "mean"), 0),
            "left_out_means_rejected": rejected[0],
            "sds_outside": outside.get((name, "sd"), 0),
            "left_out_sds_rejected": rejected[1],
            "best_basin_share": part["best_basin_share"].mean(),
        }
        rows.append(row)
    return pd.DataFrame(rows).sort_values("p", ascending=False, kind="stable", ignore_index=True)


def random_start(judged: pd.DataFrame, criteria: Criteria = None) -> Decision:
    """Criterion 6: whether the start was drawn, from `judge`'s table, and what was measured."""
    best = judged.sort_values("p", ascending=False).groupby(judged["start"] != "whole").first()
    drawn, whole = best.loc[True], best.loc[False]
    neither = max(drawn["p"], whole["p"]) < published.criterion("random_start", criteria)
    measured = (np.nan, np.nan) if neither else (whole["p"], drawn["p"])
    return published.decide("random_start", measured, criteria), (
        f"largest p of Table 2 with a drawn start {drawn['p']:.2g} ({drawn['protocol']}), "
        f"with the whole record {whole['p']:.2g} ({whole['protocol']})"
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
