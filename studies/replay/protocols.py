"""Settings of the search that may have given Table 2, and the tables that each of them gives.

1. The settings stand in `table2_candidates.csv`, with the reason of each and its number of realisations. Those with
   the whole record and a population of 300 to 1000, `POOLED`, judge Table 2 together, with as many realisations each.
2. A realisation of a row is the authors' clean record (row 1: our identified joint, because that record is not public;
   row 11: constant speed) and uniform noise of the printed amplitude, and 30 runs, with seeds of their own. It gives a
   mean and an SD of |A| (row 11: of A).
3. Is the printed table one more of them? A score says how far a number of rows 1 to 10 lies from the middle of the N
   and the printed one: for means the squared deviation of the logarithm from the median, over half the distance of
   the 16 % and 84 % quantiles; for SDs, which have two humps, -2 ln of the two-sided rank p. The rows' noises are
   independent, so the sum of the ten scores is compared with sums of ten drawn ones, one from each row's N + 1:
   `p_means` and `p_sds`, exact whatever the law.
4. Pooled bias of a table: the mean over ten rows of mean over theoretical A, less 1. `p_bias` is the two-sided p of
   the printed one among tables that are drawn row by row. It needs no SDs, so it does not depend on whether the
   table's last column holds SDs (as its head says) or variances (as the text says).
5. Settings are excluded if one of the three p lies below the level of claim `random_start`. The claim does not hold if
   the pooled bias excludes every start drawn for each record, but not the whole record.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import cache

import numpy as np
import pandas as pd
from joblib import Memory
from numpy.typing import NDArray

from replication import published, table2
from replication.arrays import FloatArray, IntArray
from replication.files import ROOT
from replication.parallel import in_parallel
from replication.records import (
    Recording,
    constant_speed,
    from_sample,
    load_clean,
    simulate_clean,
    uniform_noise,
)
from replication.table2 import SearchSettings, basin_labels, prediction_interval, table2_levels
from studies.replay.eigen import symmetric_eigen

ROWS = range(1, 11)
LAST_ROW = 11  # noise only
NUMBERS = ("mean", "sd")
RUNS = int(published.value("text.runs"))
STUDY_SEED = 2026
DRAWS = 20_000
REALISATIONS = ROOT / "results" / "table2_realisations.csv"

LEVEL = published.criterion("random_start")

LISTED = published.table("table2_candidates")
_SETTINGS = LISTED.columns.intersection([field.name for field in fields(SearchSettings)])
CANDIDATES = {
    name: SearchSettings(name=str(name), **settings)
    for name, settings in LISTED.astype({"rpm": bool})[_SETTINGS].to_dict("index").items()
}
LEADER = LISTED.index[0]
# Those that judge Table 2 together, with as many realisations each.
POOLED = [*LISTED.index[(LISTED["start"] == "whole") & LISTED["population"].between(300, 1000)]]
REALISATIONS_EACH = 40
KEPT = ROOT / ".make"  # where the realisations of an interrupted study are


# ------------------------------------------------------------------------- realisations


@cache
def clean_record(row: int) -> Recording:
    """The record of a row of Table 2 without its noise."""
    if row == LAST_ROW:
        return constant_speed(samples=2401, dt=0.002)
    level = table2_levels()[row - 1]
    if row > 1:
        return load_clean(level)
    return simulate_clean(level)


def _seeds(row: int, realisation: int, base_seed: int) -> list[np.random.SeedSequence]:
    """Seeds of a realisation's noise, start and runs."""
    return np.random.SeedSequence((base_seed, realisation, row)).spawn(3)


def noisy_record(
    row: int, realisation: int, base_seed: int = STUDY_SEED, noise: Callable = uniform_noise
) -> Recording:
    """A row's record with one noise of the printed half-amplitude, the same for every candidate.

    Its law is a function of a generator, the half-amplitude [rps] and the number of samples.
    """
    rng = np.random.default_rng(_seeds(row, realisation, base_seed)[0])
    record, half = clean_record(row), published.column("Table 2", "noise")[row - 1]
    return replace(record, v=record.v + noise(rng, half, record.v.size))


def realise(
    protocol: SearchSettings,
    row: int,
    realisation: int,
    base_seed: int = STUDY_SEED,
    noise: Callable = uniform_noise,
) -> dict[str, object]:
    """Rule 2: a realisation of a row; all settings get the same noise and seeds."""
    _, of_start, of_runs = _seeds(row, realisation, base_seed)
    noisy = noisy_record(row, realisation, base_seed, noise)
    if protocol.start == "per record":
        start = np.random.default_rng(of_start).integers(protocol.latest_start)
        noisy = from_sample(noisy, int(start))
    fits = [
        table2.fit(noisy, protocol, 1 + int(seed), symmetric_eigen)
        for seed in of_runs.generate_state(RUNS) // 2
    ]
    A = np.array([fit.X[0] if row == LAST_ROW else fit.amplitude_rps for fit in fits])
    best = basin_labels(np.array([fit.rmse for fit in fits])) == 1
    return {
        "protocol": protocol.name,
        "realisation": realisation,
        "row": row,
        "mean_A_rps": A.mean(),
        "sd_A_rps": A.std(ddof=1),
        "best_basin_share": best.mean(),
    }


def rows_of(realisation: int) -> Sequence[int]:
    """Rows that a realisation of the study has."""
    return (*ROWS, LAST_ROW) if realisation <= REALISATIONS_EACH else ROWS


def _realise_rows(protocol: SearchSettings, realisation: int) -> pd.DataFrame:
    return pd.DataFrame([realise(protocol, row, realisation) for row in rows_of(realisation)])


def realise_all() -> pd.DataFrame:
    """Every realisation of the study; what `KEPT` holds of an interrupted one is not computed again."""
    realise_rows = Memory(KEPT, verbose=0).cache(_realise_rows)
    calls = [
        (CANDIDATES[name], realisation)
        for name, wanted in LISTED["realisations"].items()
        for realisation in range(1, wanted + 1)
    ]
    return pd.concat(in_parallel(realise_rows, calls, "realisations"), ignore_index=True)


# ------------------------------------------------------------------------------ judging


def printed() -> FloatArray:
    """Table 2's means and SDs [rps] of rows 1 to 10, shape (2, 10)."""
    return np.stack([published.column("Table 2", name)[: len(ROWS)] for name in NUMBERS])


def pooled(realisations: pd.DataFrame) -> pd.DataFrame:
    """The realisations that judge Table 2: equally many, the first ones, of each of `POOLED`."""
    first = realisations["realisation"] <= REALISATIONS_EACH
    return realisations[first & realisations["protocol"].isin(POOLED)]


def numbers_by_setting(realisations: pd.DataFrame) -> dict[str, dict[str, list[float]]]:
    """Numbers [rps] of each mean and SD of Table 2 by cell id and setting."""
    cells: dict[str, dict[str, list[float]]] = defaultdict(dict)
    for (row, name), part in realisations.groupby(["row", "protocol"], sort=False):
        for number in NUMBERS:
            cells[f"table2.row{row:02d}.{number}"][name] = part[f"{number}_A_rps"].tolist()
    return dict(cells)


def numbers_of(realisations: pd.DataFrame) -> FloatArray:
    """Means and SDs [rps] in rows 1 to 10, of one setting or of several together, shape (2, 10, N)."""
    rows = realisations[realisations["row"].isin(ROWS)]
    made = ["protocol", "realisation"]
    return np.stack(
        [rows.pivot(index="row", columns=made, values=f"{number}_A_rps") for number in NUMBERS]
    )


def scores(numbers: FloatArray, judged: FloatArray) -> FloatArray:
    """Rule 3: scores of the judged numbers, first, and of the N, shape (2, 10, N + 1)."""
    together = np.concatenate([judged[..., None], numbers], axis=-1)
    means, sds = np.log(together[0]), together[1]
    low, middle, high = np.quantile(means, [0.16, 0.5, 0.84], axis=-1)[..., None]
    size = together.shape[-1]
    below = (sds[:, None, :] <= sds[:, :, None]).sum(axis=-1)
    above = (sds[:, None, :] >= sds[:, :, None]).sum(axis=-1)
    p = np.minimum(1, 2 * np.minimum(below, above) / size)
    return np.stack([(2 * (means - middle) / (high - low)) ** 2, -2 * np.log(p)])


@cache
def _draws(size: int) -> IntArray:
    """Which of a row's numbers take part in each drawn table; shape (draws, 10)."""
    return np.random.default_rng(1).integers(size, size=(DRAWS, len(ROWS)))


def exact_p(scores: FloatArray) -> float:
    """Rule 3: p of the sum of the judged numbers' scores over rows; shape (10, N + 1)."""
    sums = scores[np.arange(len(scores)), _draws(scores.shape[-1])].sum(axis=1)
    reached = (sums >= scores[:, 0].sum() * (1 - 1e-9)).sum()
    return float((1 + reached) / (1 + DRAWS))


def pooled_bias(means: FloatArray) -> FloatArray:
    """Rule 4: pooled bias [%] of tables, from means of shape (10, ...)."""
    theoretical = published.column("Table 2", "theoretical")[: len(ROWS)]
    return 100 * ((means.T / theoretical).T.mean(axis=0) - 1)


def bias_p(means: FloatArray, bias_percent: float) -> float:
    """Rule 4: p of a pooled bias among tables that are drawn row by row from means of shape (10, N)."""
    drawn = pooled_bias(means[np.arange(len(means)), _draws(means.shape[-1])].T)
    tail = min((drawn <= bias_percent).sum(), (drawn >= bias_percent).sum())
    return min(1.0, 2 * (1 + int(tail)) / (1 + DRAWS))


def lies_inside(numbers: FloatArray, judged: FloatArray) -> NDArray[np.bool_]:
    """Whether judged numbers, shape (2, 10), lie in the prediction intervals of N others."""
    ends = np.array([[prediction_interval(row) for row in rows] for rows in numbers.tolist()])
    return (ends[..., 0] <= judged) & (judged <= ends[..., 1])


def compare(numbers: FloatArray, judged: FloatArray) -> dict[str, float]:
    """Compare a table of means and SDs, shape (2, 10), with N others: rules 3 and 4, and how many lie inside."""
    of_table = scores(numbers, judged)
    inside = lies_inside(numbers, judged).sum(axis=-1)
    return {
        "realisations": numbers.shape[-1],
        "p_means": exact_p(of_table[0]),
        "p_sds": exact_p(of_table[1]),
        "p_bias": bias_p(numbers[0], float(pooled_bias(judged[0]))),
        "bias_percent": float(np.median(pooled_bias(numbers[0]))),
        "means_inside": inside[0],
        "sds_inside": inside[1],
    }


def judge(realisations: pd.DataFrame, level: float = LEVEL) -> pd.DataFrame:
    """Compare the printed table with those of each setting, and of `POOLED` together, the first row."""
    table = [{"protocol": "pooled", **compare(numbers_of(pooled(realisations)), printed())}]
    for name, part in realisations.groupby("protocol", sort=False):
        about = LISTED.loc[name, ["population", "amplitude_factor", "rpm", "start"]]
        table.append({"protocol": name, **about, **compare(numbers_of(part), printed())})
    judged = pd.DataFrame(table)
    smallest = judged[["p_means", "p_sds", "p_bias"]].min(axis=1)
    return judged.assign(pooled=judged["protocol"].isin(POOLED), excluded=smallest < level)
