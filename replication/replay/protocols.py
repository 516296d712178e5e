"""Which protocol printed Table 2? Candidates, each judged by the distribution of tables that it gives.

The rule, fixed on 2026-11-23, before a number of the study was computed with it. Known before: what
an earlier rule said of the authors' five noises (a t of logarithms); that outside this project rpm
about the mean with a population of 600 had been seen to fit nearly all of the table, and no
candidate the SDs of rows 7 and 10.

1. Candidates stand in `table2_candidates.csv`, with the reason of each and its number N of
   realisations. One of them leads. Each is read twice: Table 2's last column as SDs, as its head says,
   and as variances, as the text says. A variance cannot be, because the last row's would lie outside
   the box (erratum E11): that reading is shown, and judges no cell.
2. A realisation of a row is the authors' clean record (row 1: our identified joint, because that
   record is not public; row 11: constant speed) and uniform noise of the printed amplitude, and 30
   runs, with seeds of their own. It gives a mean and an SD of |A| (row 11: of A).
3. For rows 1 to 10 a score says how far a number lies from the middle of the N and the printed one:
   for means the squared deviation of the logarithm from the median, over half the distance of the
   16 % and 84 % quantiles; for SDs, which have two humps, -2 ln of the two-sided rank p.
4. The rows' noises are independent. So the sum of the ten scores is compared with sums of ten drawn
   ones, one from each row's N + 1: p_means and p_sds are exact, whatever the law. The candidate's p is
   min(1, 2 min(p_means, p_sds)). It is excluded below the level of claim `random_start`.
5. A cell must not choose its judges: for a cell of rows 1 to 10 a candidate is excluded by the other
   19 numbers. The candidates that are left judge it, each by its own region (`workbook/judging.py`);
   if none is left, all do. A candidate with too few realisations for a region judges no cell.
6. Pooled bias of a table: the mean over ten rows of mean over theoretical A, less 1. Two-sided rank p
   of the printed one, and of zero, among a candidate's N.

Added after the first result, by nine candidates, and before a number of theirs: populations of 1000
and 2000 (for time 20 of the latter, too few to judge a cell), and 80 more realisations of the drawn
start in rpm (p = 0.027 with 40), which alone kept three cells undecided. Whichever way it falls, both
results are shown, and 120 are the last.
"""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from replication import published
from replication.arrays import FloatArray, IntArray
from replication.authors import load_clean
from replication.files import ROOT, write_csv
from replication.identify import Protocol, paper_fit
from replication.parallel import one_by_one
from replication.recording import Recording, constant_speed, from_sample, uniform_noise
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings
from replication.table2 import basin_labels, table2_levels, theoretical_amplitudes

ROWS = range(1, 11)
LAST_ROW = 11  # noise only
NUMBERS = ("mean", "sd")
READINGS = ("sd", "variance")
RUNS = int(published.value("text.runs"))
STUDY_SEED = 2026
# Of the last row, which no p counts.
LAST_ROW_REALISATIONS = 40
DRAWS = 20_000
REALISATIONS = ROOT / "results" / "table2_realisations.csv"

LEVEL = published.criterion("random_start")

LISTED = published.table2_candidates()
_SETTINGS = {field.name for field in fields(Protocol)} & {*LISTED.columns}
CANDIDATES = {
    name: Protocol(name=str(name), **{setting: row[setting] for setting in _SETTINGS})
    for name, row in LISTED.astype({"rpm": bool}).iterrows()
}
LEADER = LISTED.index[0]


# ------------------------------------------------------------------------------------------ realisations


@cache
def clean_record(row: int) -> Recording:
    """The record of a row of Table 2 without its noise."""
    if row == LAST_ROW:
        return constant_speed(samples=2401, dt=0.002)
    level = table2_levels()[row - 1]
    if row > 1:
        return load_clean(level)
    return simulate_recordings(identified_joint(), [next(iter(theoretical_amplitudes()))])[0]


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
    protocol: Protocol,
    row: int,
    realisation: int,
    base_seed: int = STUDY_SEED,
    noise: Callable = uniform_noise,
) -> dict[str, object]:
    """Criterion 2: a realisation of a row; every candidate gets the same noise and seeds."""
    _, of_start, of_runs = _seeds(row, realisation, base_seed)
    noisy = noisy_record(row, realisation, base_seed, noise)
    if protocol.start == "per record":
        start = np.random.default_rng(of_start).integers(protocol.latest_start)
        noisy = from_sample(noisy, int(start))
    fits = [paper_fit(noisy, protocol, 1 + int(seed)) for seed in of_runs.generate_state(RUNS) // 2]
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
    return (*ROWS, LAST_ROW) if realisation <= LAST_ROW_REALISATIONS else ROWS


def planned() -> Iterator[tuple[Protocol, int]]:
    """Every candidate's realisations, those of each candidate's first ones before more of the leading one."""
    for first, last in (
        (0, LAST_ROW_REALISATIONS),
        (LAST_ROW_REALISATIONS, LISTED["realisations"].max()),
    ):
        for name, wanted in LISTED["realisations"].items():
            for realisation in range(first + 1, min(last, wanted) + 1):
                yield CANDIDATES[name], realisation


def _realise_rows(protocol: Protocol, realisation: int) -> pd.DataFrame:
    return pd.DataFrame([realise(protocol, row, realisation) for row in rows_of(realisation)])


def realise_all(kept: Path | None = None) -> pd.DataFrame:
    """Every realisation of the study; what `kept` holds of an interrupted one is not computed again."""
    digest = hashlib.sha256(LISTED.to_csv().encode()).hexdigest()[:8]
    kept = kept or ROOT / ".make" / f"table2_realisations_{digest}.csv"
    done = [pd.read_csv(kept)] if kept.exists() else []
    there = {
        job for table in done for job in zip(table["protocol"], table["realisation"], strict=True)
    }
    left = [job for job in planned() if (job[0].name, job[1]) not in there]
    for table in one_by_one(_realise_rows, left, "realisations"):
        done.append(table)
        write_csv(kept, pd.concat(done))
    found = pd.concat(done)
    order = {name: number for number, name in enumerate(CANDIDATES)}
    return found.sort_values(
        ["protocol", "realisation", "row"],
        key=lambda column: column.map(order) if column.name == "protocol" else column,
        ignore_index=True,
    )


# ----------------------------------------------------------------------------------------------- judging


def printed(reading: str = "sd") -> FloatArray:
    """Table 2's means and SDs [rps] of rows 1 to 10, shape (2, 10)."""
    numbers = np.stack([published.column("Table 2", name)[: len(ROWS)] for name in NUMBERS])
    return numbers if reading == "sd" else np.stack([numbers[0], np.sqrt(numbers[1])])


def numbers_of(realisations: pd.DataFrame, name: str) -> FloatArray:
    """Means and SDs [rps] of a candidate in rows 1 to 10, shape (2, 10, N)."""
    part = realisations[(realisations["protocol"] == name) & realisations["row"].isin(ROWS)]
    if part.empty:
        raise ValueError(f"{name}: no realisations; there are {', '.join(LISTED.index)}")
    return np.stack(
        [part.pivot(index="row", columns="realisation", values=f"{of}_A_rps") for of in NUMBERS]
    )


def first_result(realisations: pd.DataFrame) -> pd.DataFrame:
    """Those realisations that the first result was judged by."""
    last = realisations["protocol"].map(LISTED["first_result"])
    return realisations[realisations["realisation"] <= last]


def scores(numbers: FloatArray, judged: FloatArray) -> FloatArray:
    """Criterion 3: scores of the judged numbers, first, and of the N, shape (2, 10, N + 1)."""
    pooled = np.concatenate([judged[..., None], numbers], axis=-1)
    means, sds = np.log(pooled[0]), pooled[1]
    low, middle, high = np.quantile(means, [0.16, 0.5, 0.84], axis=-1)[..., None]
    size = pooled.shape[-1]
    below = (sds[:, None, :] <= sds[:, :, None]).sum(axis=-1)
    above = (sds[:, None, :] >= sds[:, :, None]).sum(axis=-1)
    p = np.minimum(1, 2 * np.minimum(below, above) / size)
    return np.stack([(2 * (means - middle) / (high - low)) ** 2, -2 * np.log(p)])


@cache
def _draws(size: int) -> IntArray:
    """Which of a row's numbers take part in each drawn sum; shape (draws, 10)."""
    return np.random.default_rng(1).integers(size, size=(DRAWS, len(ROWS)))


def exact_p(scores: FloatArray, left_out: int | None = None) -> float:
    """Criterion 4: p of the sum of the judged numbers' scores over rows; shape (10, N + 1)."""
    rows = [row for row in range(len(scores)) if row != left_out]
    sums = scores[rows, _draws(scores.shape[-1])[:, rows]].sum(axis=1)
    reached = (sums >= scores[rows, 0].sum() * (1 - 1e-9)).sum()
    return float((1 + reached) / (1 + DRAWS))


def table_p(
    of_table: FloatArray, left_out: tuple[int, int] = (-1, -1)
) -> tuple[float, float, float]:
    """Criterion 4: p_means, p_sds and p from `scores`, without one cell: 0 (mean) or 1 (SD), and its row from 0."""
    number, row = left_out
    p_means, p_sds = (exact_p(of_table[k], row if k == number else None) for k in range(2))
    return p_means, p_sds, min(1.0, 2 * min(p_means, p_sds))


def rank_p(numbers: FloatArray, judged: float) -> float:
    """Two-sided p of a number among N others, from its rank."""
    above, below = (numbers >= judged).sum(), (numbers <= judged).sum()
    return min(1.0, 2 * (1 + min(above, below)) / (1 + numbers.size))


def pooled_bias(means: FloatArray) -> FloatArray:
    """Criterion 6: pooled bias [%] of tables, from means of shape (10, ...)."""
    theoretical = published.column("Table 2", "theoretical")[: len(ROWS)]
    return 100 * ((means.T / theoretical).T.mean(axis=0) - 1)


def judge(realisations: pd.DataFrame, level: float = LEVEL) -> pd.DataFrame:
    """Judge every candidate under both readings: its settings, p, pooled bias, and the printed numbers' ranks.

    A rank counts the realisations that lie below the printed number.
    """
    rows = []
    for name, reading in product(realisations["protocol"].unique(), READINGS):
        numbers, judged = numbers_of(realisations, name), printed(reading)
        p_means, p_sds, p = table_p(scores(numbers, judged))
        bias, of_print = pooled_bias(numbers[0]), float(pooled_bias(judged[0]))
        row = {
            "protocol": name,
            "reading": reading,
            **LISTED.loc[name].drop(["why", "realisations", "first_result"]),
            "realisations": numbers.shape[-1],
            "p_means": p_means,
            "p_sds": p_sds,
            "p": p,
            "excluded": p < level,
            "bias_percent": np.median(bias),
            "p_printed_bias": rank_p(bias, of_print),
            "p_no_bias": rank_p(bias, 0.0),
        }
        ranks = (numbers < judged[..., None]).sum(axis=-1)
        for of, each in zip(NUMBERS, ranks, strict=True):
            row |= {
                f"{of}_rank_{number:02d}": rank for number, rank in zip(ROWS, each, strict=True)
            }
        rows.append(row)
    return pd.DataFrame(rows).sort_values("p", ascending=False, kind="stable", ignore_index=True)


def judges_of_cells(
    realisations: pd.DataFrame, level: float = LEVEL
) -> dict[str, dict[str, list[float]]]:
    """Criterion 5: for each mean and SD of Table 2 the candidates that judge it, with their numbers [rps].

    The candidates are in the order of `table2_candidates.csv`. The last row is judged by those that
    the whole table leaves.
    """
    able = LISTED.index[LISTED["realisations"] >= LAST_ROW_REALISATIONS]
    able = [name for name in able if (realisations["protocol"] == name).any()]
    of_tables = {name: scores(numbers_of(realisations, name), printed()) for name in able}

    def left(cell: tuple[int, int]) -> list[str]:
        return [name for name in able if table_p(of_tables[name], cell)[2] >= level] or able

    cells = {}
    of_rows = dict(list(realisations.groupby(["protocol", "row"])))
    for (k, of), row in product(enumerate(NUMBERS), (*ROWS, LAST_ROW)):
        judges = left((k, row - 1) if row in ROWS else (-1, -1))
        cells[f"table2.row{row:02d}.{of}"] = {
            name: of_rows[name, row][f"{of}_A_rps"].tolist()
            for name in judges
            if (name, row) in of_rows
        }
    return cells


def largest_errors(realisations: pd.DataFrame, names: Sequence[str]) -> dict[str, list[float]]:
    """Largest relative error [%] of the ten means in each realisation of some candidates."""
    theoretical = published.column("Table 2", "theoretical")[: len(ROWS), None]
    of_rows = {name: numbers_of(realisations, name)[0] for name in names}
    return {
        name: (100 * np.abs(means / theoretical - 1)).max(axis=0).tolist()
        for name, means in of_rows.items()
    }


def describe_candidates(judged: pd.DataFrame) -> str:
    """Say in one sentence which candidates of `judge` are compatible with Table 2."""
    as_sds = judged[judged["reading"] == "sd"].set_index("protocol")
    left = as_sds.loc[~as_sds["excluded"], "p"]
    said = f"{len(left) or 'None'} of {len(as_sds)} candidate protocols are compatible with Table 2"
    for name, p in left.head(1).items():
        said += f", {name} most (p = {p:.2g})"
    for name, p in as_sds.loc[as_sds["excluded"], "p"].head(1).items():
        said += f". The next, {name}, fails with p = {p:.2g}"
    return f"{said}."
