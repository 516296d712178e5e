"""Which protocol printed Table 2? Candidates, their pools of runs, and how likely each makes the printed table.

The criteria, written down before any pool was computed:

- Summary of a row: mean and SD of |A| over 30 runs. Strays, runs outside the best basin (`table2.basin_labels`), are
  counted too, but nothing of them is printed.
- Predictive distribution: a row's realisation is drawn among R = 1 and 2, its pool is resampled (the pool is finite),
  and 30 runs are drawn from that. Rows are independent: each has its own noise.
- Likelihood of a row: a Gaussian kernel in ln mean and ln SD around each of `DRAWS` draws. Its width along ln mean is
  how far R = 1 and R = 2 are apart in the best basin's A, rms over the rows: the printed realisation is unknown, and so
  far it is from ours. Along ln SD it is how far they are apart in the best basin's SD, but not less than 0.13, what an
  SD of 30 normal runs leaves open. Both are derived once, from the pool of the authors' notebook.
- With a probability of `OTHER` a row's numbers come from something else, evenly spread over ±10 % of the theoretical A
  (the text's limit) and, in ln SD, from 0.0003 to 0.3 rps. So no single row decides alone.
- Prior: every candidate is as probable as any other.
- Dropping: a candidate whose log-likelihood after `SCREENED` runs a row is more than `DROPPED_BELOW` below the best
  gets no more runs. A row's log-likelihood has a range of about 9 and, from so few runs, an error of 1 or so; ten rows
  make 3; 20 is more than six of those, and a share of exp(-20).
- A region: the middle 95 % of a row's predictive means, or SDs, in another realisation.
- The table's p-value: the share of predicted tables whose log-likelihood is no higher than the printed table's.
- A region that holds at least half of the other nine printed numbers of its column decides nothing
  (`workbook.judging`).
- Choice: five rows choose the candidate, the other five judge it; odd rows for even ones and conversely, and all 252
  choices of five.
- Starts drawn at random against whole records: the odds of the likeliest of each, decided at 20 to 1.
"""

import gzip
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from numpy.typing import NDArray

from replication import published
from replication.compiled.bounds import Margin, margin_2021, margin_today
from replication.compiled.folded import fold
from replication.compiled.misfit import population_rmse
from replication.compiled.whole_run import whole_run
from replication.datasets import Recording, from_sample, load_noisy
from replication.identify import Protocol, protocol_box
from replication.search import generations, random_normals, search
from replication.signature import Box, Timing
from replication.simulator.simulate import identified_joint
from replication.table2 import basin_labels, noise_only_record, simulated_table2_records, table2_levels
from replication.workbook.files import ROOT, write_bytes

FloatArray = NDArray[np.float64]

RUNS = 30  # of a printed row
DRAWS = 4000
OTHER = 0.01
OTHER_MEAN = 0.1  # half-width, relative to the theoretical A
OTHER_SD_RPS = (0.0003, 0.3)
LEAST_SD_WIDTH = 0.13
SCREENED = 20  # runs a row, half on R = 1, half on R = 2; half as many of the slow ones with free T_d and T_f
CONTENDER = 200
NOISES, NOISE_ONLY = 10, 30  # fresh noises over our simulated joint and over constant speed, `RUNS` runs each
DROPPED_BELOW = 20.0

ROWS = range(1, 11)
STARTS = ("whole", "per record", "per run")
BLOCK = 10  # runs that share a start which is drawn once for a record: a block stands for another draw

RPS, RPM = "rps", "rpm about the mean"
PRINTED_T_S = (published.value("table1.T_d.max"), published.value("table1.T_f.max"))
# T_d and T_f are free within this share of the data's; no bounds are printed.
FREE_SHARE = 0.1
SEED_STEP = 10_000  # between a run's restarts
FOLDER = ROOT / "results" / "protocols"
COLUMNS = ["record", "row", "seed", "A_rps", "omega_rad_per_s", "rmse_rps"]


@dataclass(frozen=True)
class Candidate:
    """A protocol that may have printed Table 2.

    Attributes
    ----------
    name : str
        What tables call it.
    protocol : Protocol
        Population, iterations, box of A, T_d and T_f, start.
    unit : str
        `RPS`, the record as it is; or `RPM`, 60 (v - mean v), as equation 10 has A.
    restarts : int
        How often a run starts again with twice the population, and keeps its best end.
    free_timing : bool
        T_d and T_f are searched too.
    positive : bool
        The box of A begins at 0.
    margin : callable
        Width of the margin at a bound.
    """

    name: str
    protocol: Protocol
    unit: str = RPS
    restarts: int = 0
    free_timing: bool = False
    positive: bool = False
    margin: Margin = margin_2021


def default_iterations(population: int, n: int = 7) -> int:
    """The most generations that the library allows if nothing is said."""
    return int(100 + 150 * (n + 3) ** 2 / population**0.5)


NO_LIMIT = 0  # iterations: the library's default for each population


def _around(pole: str, unit: str, factor: float) -> list[Candidate]:
    """Candidates that differ from a pole in one respect, or in two that go together."""
    base = Protocol(amplitude_factor=factor)
    other = 1.0 if factor != 1.0 else 1.3
    # From 300 on, hardly a run needs 200 generations.
    large = [
        (f"population {size}{text}", Candidate("", replace(base, population=size, iterations=limit), unit))
        for size, limit, text in (
            *((size, 200, "") for size in (150, 600, 1000, 2000)),
            *((size, NO_LIMIT, ", no limit") for size in (150, 300)),
        )
    ]
    starts = [
        (f"start {start}, population {size}", Candidate("", replace(base, population=size, start=start), unit))
        for start in ("per record", "per run")
        for size in (300, 1000, 2000)
    ]
    restarted = [
        (f"{size} and {n} restarts", Candidate("", replace(base, population=size, iterations=NO_LIMIT), unit, n))
        for size, n in ((9, 4), (9, 5), (9, 6), (9, 7), (150, 1), (150, 2), (300, 1), (300, 2))
    ]
    others = [
        ("", Candidate("", base, unit)),
        (
            "box of A " + ("as printed" if other == 1.0 else "1.3"),
            Candidate("", replace(base, amplitude_factor=other), unit),
        ),
        ("T_d and T_f printed", Candidate("", replace(base, T_d=PRINTED_T_S[0], T_f=PRINTED_T_S[1]), unit)),
        ("T_d and T_f free", Candidate("", base, unit, free_timing=True)),
        ("A positive", Candidate("", base, unit, positive=True)),
        ("margins of cma 4", Candidate("", base, unit, margin=margin_today)),
    ]
    return [
        replace(candidate, name=f"{pole}, {text}" if text else pole)
        for text, candidate in (*others, *large, *starts, *restarted)
    ]


AUTHORS, PAPER = "authors' notebook", "rpm"
GRID = {c.name: c for c in (*_around(AUTHORS, RPS, 1.3), *_around(PAPER, RPM, 1.0))}


def file_of(name: str, folder: Path = FOLDER) -> Path:
    """File that keeps a candidate's pool."""
    kept = "".join(letter if letter.isalnum() else " " for letter in name.replace("'", "").lower())
    return folder / f"{'_'.join(kept.split())}.csv.gz"


def pool(name: str, folder: Path = FOLDER) -> pd.DataFrame:
    """Load a candidate's runs: `COLUMNS`, record "R1" (authors' realisation 1), "S3" (our joint), "N5" (noise only)."""
    path = file_of(name, folder)
    return pd.read_csv(path) if path.exists() else pd.DataFrame(columns=COLUMNS)


@cache
def records(label: str) -> dict[int, Recording]:
    """The records that a pool calls by a label, by row of Table 2: "R1", "S3" or "N5", as in `pool`."""
    kind, number = label[0], int(label[1:])
    if kind == "R":
        return {row: load_noisy(level, number) for row, level in zip(ROWS, table2_levels(), strict=True)}
    found = simulated_table2_records(identified_joint(), number) if kind == "S" else [noise_only_record(number)]
    return {key["row"]: recording for key, recording in found}


def one_run(candidate: Candidate, recording: Recording, row: int, seed: int) -> tuple[float, float, float]:
    """Fit a record of Table 2 once.

    Parameters
    ----------
    candidate : Candidate
        The protocol.
    recording : Recording
        The whole record [rps].
    row : int
        Row of Table 2, which the draw of the start depends on.
    seed : int
        Seed of the run, above 0.

    Returns
    -------
    tuple of float
        A [rps], with its sign, omega [rad/s] and RMSE [rps].
    """
    protocol = candidate.protocol
    record = from_sample(recording, _start(protocol, row, seed))
    scale = 1.0 if candidate.unit == RPS else 60.0
    if candidate.unit == RPM:
        record = replace(record, v=scale * (record.v - record.v.mean()))
    box = protocol_box(record, protocol)
    if candidate.positive:
        box = Box(np.r_[0.0, box.lower[1:]], box.upper)
    best, misfit = np.empty(0), math.inf
    for restart in range(candidate.restarts + 1):
        population = protocol.population * 2**restart
        iterations = protocol.iterations or default_iterations(population)
        settings = seed + SEED_STEP * restart, population, iterations
        if candidate.free_timing:
            found = _free_run(record, box, protocol.timing, *settings)
        else:
            run = whole_run(fold(record.t, record.v, protocol.timing), box, *settings, candidate.margin)
            found = run.best, run.misfit
        if found[1] < misfit:
            best, misfit = found
    return float(best[0] / scale), float(best[3]), float(misfit / scale)


def _start(protocol: Protocol, row: int, seed: int) -> int:
    if protocol.start == "whole":
        return 0
    key = (row, (seed - 1) // BLOCK) if protocol.start == "per record" else (row, seed)
    return int(np.random.default_rng(key).integers(protocol.latest_start))


def _free_run(record, box, timing, seed, population, iterations) -> tuple[FloatArray, float]:
    middle = np.array([timing.T_d, timing.T_f])
    wide = Box(np.r_[box.lower, (1 - FREE_SHARE) * middle], np.r_[box.upper, (1 + FREE_SHARE) * middle])

    def misfits(members: FloatArray) -> FloatArray:
        each = [population_rmse(record.t, record.v, X[None, :7], Timing(X[7], X[8], timing.n)) for X in members]
        return np.concatenate(each)

    found = search(generations(misfits, wide, random_normals(seed), population), iterations)
    return found.best, found.misfit


def extend_pool(
    candidate: Candidate, labels: Sequence[str], runs: int, folder: Path = FOLDER, jobs: int = 2
) -> pd.DataFrame:
    """Compute what a candidate's pool lacks of the seeds 1 to `runs` on some records, and keep it.

    Parameters
    ----------
    candidate : Candidate
        The protocol.
    labels : sequence of str
        Records, as in `pool`.
    runs : int
        Runs on each record.
    folder : Path
        Where pools are kept.
    jobs : int
        Processes.

    Returns
    -------
    DataFrame
        The pool, as `pool` loads it.
    """
    known = pool(candidate.name, folder)
    have = set(zip(known["record"], known["row"], known["seed"], strict=True))
    todo = [
        (label, row, recording, [seed for seed in range(1, runs + 1) if (label, row, seed) not in have])
        for label in labels
        for row, recording in records(label).items()
    ]
    todo = [part for part in todo if part[3]]
    found = Parallel(n_jobs=jobs)(delayed(_runs)(candidate, *part) for part in todo)
    if todo:
        new = pd.DataFrame([row for part in found for row in part], columns=COLUMNS)
        table = pd.concat([known, new], ignore_index=True) if len(known) else new
        table = table.sort_values(["record", "row", "seed"], kind="stable", ignore_index=True)
        text = table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
        write_bytes(file_of(candidate.name, folder), gzip.compress(text.encode(), mtime=0))
    return pool(candidate.name, folder)


def _runs(candidate: Candidate, label: str, row: int, recording: Recording, seeds: list[int]) -> list[tuple]:
    return [(label, row, seed, *one_run(candidate, recording, row, seed)) for seed in seeds]


def groups(runs: pd.DataFrame, row: int, candidate: Candidate, kind: str = "R") -> list[FloatArray]:
    """|A| [rps] of a row's runs, one array for each realisation, or for each draw of a start made once for a record.

    Parameters
    ----------
    runs : DataFrame
        A pool.
    row : int
        Row of Table 2.
    candidate : Candidate
        Whose pool it is.
    kind : str
        First letter of the records: "R", "S" or "N", whose A keeps its sign.
    """
    part = runs[(runs["row"] == row) & runs["record"].str.startswith(kind)]
    block = (part["seed"] - 1) // BLOCK if candidate.protocol.start == "per record" else 0
    found = [one["A_rps"].to_numpy() for _, one in part.groupby([part["record"], block + 0 * part["seed"]])]
    return found if kind == "N" else [np.abs(A) for A in found]


def predicted(pools: Sequence[FloatArray], rng: np.random.Generator, draws: int = DRAWS) -> FloatArray:
    """Draw what a table would print of a row.

    Parameters
    ----------
    pools : sequence of arrays
        Results of runs, one array a realisation.
    rng : Generator
        Where the draws come from.
    draws : int
        How many.

    Returns
    -------
    array of shape (draws, 2)
        Mean and SD of `RUNS` runs on a realisation drawn from the pools, its pool resampled first: it is finite.
    """
    which = rng.integers(len(pools), size=draws)
    table = np.empty((draws, 2))
    for index, pool_of_one in enumerate(pools):
        rows = np.flatnonzero(which == index)
        resampled = pool_of_one[rng.integers(pool_of_one.size, size=(rows.size, pool_of_one.size))]
        drawn = np.take_along_axis(resampled, rng.integers(pool_of_one.size, size=(rows.size, RUNS)), axis=1)
        table[rows] = np.column_stack([drawn.mean(axis=1), drawn.std(axis=1, ddof=1)])
    return table


def widths(runs: pd.DataFrame) -> tuple[float, float]:
    """How far R = 1 and R = 2 are apart in the best basin, rms over the rows: ln mean and ln SD of |A|.

    These are the kernel's widths, the SD's not below `LEAST_SD_WIDTH`.
    """
    best = best_basins(runs[runs["record"].isin(["R1", "R2"])])
    apart = {
        name: np.diff(np.log(best[name].unstack("record").to_numpy(float)), axis=1) for name in ("mean_rps", "sd_rps")
    }
    mean, sd = (float(np.sqrt(np.mean(apart[name] ** 2))) for name in ("mean_rps", "sd_rps"))
    return mean, max(sd, LEAST_SD_WIDTH)


def best_basins(runs: pd.DataFrame) -> pd.DataFrame:
    """Best basin of each record and row of a pool: `mean_rps, sd_rps` of |A|, `share` of the runs, and all `runs`."""
    rows = []
    for (label, row), part in runs.groupby(["record", "row"]):
        best = basin_labels(part["rmse_rps"].to_numpy()) == 0
        A = part["A_rps"].abs().to_numpy()[best]
        rows.append((label, row, A.mean(), A.std(ddof=1) if A.size > 1 else np.nan, best.mean(), best.size))
    table = pd.DataFrame(rows, columns=["record", "row", "mean_rps", "sd_rps", "share", "runs"])
    return table.set_index(["row", "record"])


def log_likelihood(points: FloatArray, drawn: FloatArray, width: tuple[float, float], theoretical: float) -> FloatArray:
    """Natural log of the kernel density of ln mean and ln SD at some points.

    Parameters
    ----------
    points : array of shape (points, 2)
        Means and SDs [rps].
    drawn : array of shape (draws, 2)
        From `predicted`.
    width : two floats
        From `widths`.
    theoretical : float
        The row's theoretical A [rps], which anything else lies around.

    Returns
    -------
    array of shape (points,)
    """
    x, centres = np.log(points), np.log(drawn)
    squared = sum(((x[:, None, i] - centres[None, :, i]) / width[i]) ** 2 for i in (0, 1))
    kernel = np.exp(-squared / 2).mean(axis=1) / (2 * np.pi * width[0] * width[1])
    area = math.log((1 + OTHER_MEAN) / (1 - OTHER_MEAN)) * math.log(OTHER_SD_RPS[1] / OTHER_SD_RPS[0])
    low = theoretical * np.array([1 - OTHER_MEAN]), theoretical * np.array([1 + OTHER_MEAN])
    inside = (low[0] <= points[:, 0]) & (points[:, 0] <= low[1])
    inside &= (OTHER_SD_RPS[0] <= points[:, 1]) & (points[:, 1] <= OTHER_SD_RPS[1])
    return np.log((1 - OTHER) * kernel + OTHER * np.where(inside, 1 / area, 1e-9))


def printed_rows() -> FloatArray:
    """Printed mean, SD and theoretical A of Table 2's ten rows [rps], shape (10, 3)."""
    return np.column_stack([published.column("Table 2", name)[:10] for name in ("mean", "sd", "theoretical")])


def row_log_likelihoods(
    candidate: Candidate, runs: pd.DataFrame, width: tuple[float, float], kind: str = "R", draws: int = DRAWS
) -> FloatArray:
    """Log-likelihood of each printed row under a candidate, shape (10,)."""
    rng = np.random.default_rng(1)
    return np.array(
        [
            log_likelihood(
                np.array([[mean, sd]]), predicted(groups(runs, row, candidate, kind), rng, draws), width, theoretical
            )[0]
            for row, (mean, sd, theoretical) in zip(ROWS, printed_rows(), strict=True)
        ]
    )


def predicted_tables(
    candidate: Candidate, runs: pd.DataFrame, width: tuple[float, float], kind: str = "R", draws: int = DRAWS
) -> FloatArray:
    """Means and SDs of tables in another realisation, shape (draws, 10, 2).

    With kind "R" the means move by the kernel's width along ln mean, as from one realisation to another; of kind "S"
    there are enough realisations among the records.
    """
    rng = np.random.default_rng(2)
    table = np.stack([predicted(groups(runs, row, candidate, kind), rng, draws) for row in ROWS], axis=1)
    if kind == "R":
        table[:, :, 0] *= np.exp(width[0] * rng.standard_normal(table.shape[:2]))
        table[:, :, 1] *= np.exp(width[1] * rng.standard_normal(table.shape[:2]))
    return table


def simulated_log_likelihoods(
    candidate: Candidate, runs: pd.DataFrame, width: tuple[float, float], tables: int = 1000
) -> FloatArray:
    """Log-likelihood of each row of tables that a candidate itself would print, shape (tables, 10)."""
    made, rng = predicted_tables(candidate, runs, width, draws=tables), np.random.default_rng(3)
    drawn = [predicted(groups(runs, row, candidate), rng, 2000) for row in ROWS]
    theoretical = printed_rows()[:, 2]
    return np.column_stack([log_likelihood(made[:, i], drawn[i], width, theoretical[i]) for i in range(len(ROWS))])


def compute_pools(folder: Path = FOLDER, jobs: int = 2, tell: Callable[[str], None] = print) -> None:
    """Compute all pools: every candidate is screened, those that are not dropped get `CONTENDER` runs a row.

    The likeliest of each kind of start gets them too, and the authors' notebook. The two likeliest and the authors'
    notebook also get fresh noise over our simulated joint, and records of noise alone. What is there is kept.
    """
    found = {}
    for name, candidate in GRID.items():
        screened = SCREENED // 2 if candidate.free_timing else SCREENED
        extend_pool(candidate, ["R1", "R2"], screened // 2, folder, jobs)
        if name == AUTHORS:
            extend_pool(candidate, ["R1", "R2"], CONTENDER // 2, folder, jobs)
            width = widths(pool(name, folder))
            tell(f"R = 1 and R = 2 are {100 * width[0]:.2f} % apart in A, a factor {math.exp(width[1]):.2f} in its SD")
        found[name] = first_log_likelihood(candidate, width, folder)
        tell(f"{name}: {found[name]:.1f}")
    best = max(found.values())
    starts = {max((n for n in GRID if GRID[n].protocol.start == start), key=found.get) for start in STARTS}
    for name in found:
        if found[name] >= best - DROPPED_BELOW or name in starts:
            extend_pool(GRID[name], ["R1", "R2"], CONTENDER // 2, folder, jobs)
            tell(
                f"{name}: {row_log_likelihoods(GRID[name], pool(name, folder), width).sum():.1f} with {CONTENDER} runs"
            )
    for name in {AUTHORS, *likeliest(width, folder)}:
        extend_pool(GRID[name], [f"S{seed}" for seed in range(1, NOISES + 1)], RUNS, folder, jobs)
        extend_pool(GRID[name], [f"N{seed}" for seed in range(1, NOISE_ONLY + 1)], RUNS, folder, jobs)


def first_log_likelihood(candidate: Candidate, width: tuple[float, float], folder: Path = FOLDER) -> float:
    """Log-likelihood of the printed table from the runs that a candidate is screened with."""
    runs = pool(candidate.name, folder)
    return float(row_log_likelihoods(candidate, runs[runs["seed"] <= SCREENED // 2], width).sum())


def contenders(folder: Path = FOLDER) -> list[str]:
    """Names of the candidates with all `CONTENDER` runs a row."""
    runs = {name: pool(name, folder) for name in GRID}
    return [name for name in GRID if (runs[name]["record"].isin(["R1", "R2"])).sum() >= CONTENDER * len(ROWS)]


def likeliest(width: tuple[float, float], folder: Path = FOLDER) -> list[str]:
    """Names of the two contenders that make the printed table likeliest."""
    found = {n: row_log_likelihoods(GRID[n], pool(n, folder), width).sum() for n in contenders(folder)}
    return sorted(found, key=found.get, reverse=True)[:2]
