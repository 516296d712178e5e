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
  gets no more runs: a share of exp(-20).
- A region: the middle 95 % of a row's predictive means, or SDs, in another realisation.
- The table's p-value: the share of predicted tables whose log-likelihood is no higher than the printed table's.
- A region that holds at least half of the other nine printed numbers of its column decides nothing
  (`workbook.judging`).
- Choice: five rows choose the candidate, the other five judge it; odd rows for even ones and conversely, and all 252
  choices of five.
- Starts drawn at random against whole records: the odds of the likeliest of each, decided at 20 to 1.
"""

import math
from collections.abc import Callable, Mapping
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from replication import published
from replication.studies import pools
from replication.studies.pools import AUTHORS, BENCHES, FOLDER, GRID, ROWS, STARTS, extend_pool, pool, realisations
from replication.studies.predictive import DRAWS, RUNS, best_basins, log_likelihood, predicted, widths

FloatArray = NDArray[np.float64]
Width = tuple[float, float]

SCREENED = 20  # runs a row, half on R = 1, half on R = 2; half as many of the slow ones with free T_d and T_f
DROPPED_BELOW = 20.0
CONTROL = "rpm, population 600"  # gets all runs even if it is dropped: so far a dropped one may still rise
CONTENDER, REFERENCE = 100, 200  # the authors' notebook, which the kernel comes from, has more
NOISES, NOISE_ONLY = 6, 30  # fresh noises over our simulated joint and over constant speed, `RUNS` runs each
TABLES = 1000  # that a p-value counts
OF_AUTHORS = ["R1", "R2"]


def compute_pools(folder: Path = FOLDER, jobs: int = 2, tell: Callable[[str], None] = print) -> None:
    """Compute all pools: every candidate is screened, those that are not dropped get `CONTENDER` runs a row.

    The likeliest of each kind of start gets them too, and the authors' notebook. The two likeliest and the authors'
    notebook also get fresh noise over our simulated joint, records of noise alone, and stand-ins of Table 3's bench.
    What is there is kept.
    """
    found = {}
    extend_pool(GRID[AUTHORS], OF_AUTHORS, REFERENCE // 2, folder, jobs)
    width = widths(pool(AUTHORS, folder))
    tell(f"R = 1 and R = 2 are {100 * width[0]:.2f} % apart in A, a factor {math.exp(width[1]):.2f} in its SD")
    for name, candidate in GRID.items():
        screened = extend_pool(candidate, OF_AUTHORS, first_runs(name) // 2, folder, jobs)
        part = screened[screened["seed"] <= first_runs(name) // 2]
        found[name] = row_log_likelihoods(name, part, width).sum()
        tell(f"{name}: {found[name]:.1f}")
    best = max(found.values())
    of_start = {start: [name for name in GRID if GRID[name].protocol.start == start] for start in STARTS}
    spared = {max(names, key=found.get) for names in of_start.values()} | {CONTROL}
    for name in sorted(found, key=found.get, reverse=True):
        if found[name] >= best - DROPPED_BELOW or name in spared:
            runs = extend_pool(GRID[name], OF_AUTHORS, CONTENDER // 2, folder, jobs)
            tell(f"{name}, {CONTENDER} runs a row: {row_log_likelihoods(name, runs, width).sum():.1f}")
    likelihoods = {name: row_log_likelihoods(name, pool(name, folder), width).sum() for name in contenders(folder)}
    for name in {AUTHORS: 0} | dict.fromkeys(sorted(likelihoods, key=likelihoods.get)[-2:]):
        for kind, numbers in (("S", range(1, NOISES + 1)), ("N", range(1, NOISE_ONLY + 1)), ("B", range(len(BENCHES)))):
            extend_pool(GRID[name], [f"{kind}{number}" for number in numbers], RUNS, folder, jobs)
        tell(f"{name}: our joint, noise alone, benches")


def first_runs(name: str) -> int:
    """Runs a row that a candidate is screened with."""
    return SCREENED // 2 if GRID[name].free_timing else SCREENED


def contenders(folder: Path = FOLDER) -> list[str]:
    """Names of the candidates with all `CONTENDER` runs a row."""
    runs = {name: pool(name, folder) for name in GRID}
    return [name for name in GRID if runs[name]["record"].isin(OF_AUTHORS).sum() >= CONTENDER * len(ROWS)]


def printed_rows() -> FloatArray:
    """Printed mean, SD and theoretical A of Table 2's ten rows [rps], shape (10, 3)."""
    return np.column_stack([published.column("Table 2", name)[:10] for name in ("mean", "sd", "theoretical")])


def row_log_likelihoods(name: str, runs: pd.DataFrame, width: Width, kind: str = "R", draws: int = DRAWS) -> FloatArray:
    """Log-likelihood of each printed row under a candidate with some runs, shape (10,)."""
    rng = np.random.default_rng(1)
    return np.array(
        [
            log_likelihood(
                np.array([[mean, sd]]), predicted(realisations(runs, row, GRID[name], kind), rng, draws), width, theory
            )[0]
            for row, (mean, sd, theory) in zip(ROWS, printed_rows(), strict=True)
        ]
    )


def likelihood_table(width: Width, folder: Path = FOLDER) -> pd.DataFrame:
    """Log-likelihood of each printed row under every candidate: a row a candidate of `GRID`, columns `ROWS`."""
    table = {name: row_log_likelihoods(name, pool(name, folder), width) for name in GRID}
    return pd.DataFrame(table, index=ROWS).T


def odds_of_starts(log_likelihoods: pd.Series) -> tuple[float, str, str]:
    """Odds of the likeliest candidate with a drawn start against the likeliest with the whole record, and their names.

    Only populations from 300 on count.
    """
    large = {name: candidate.protocol for name, candidate in GRID.items() if candidate.protocol.population >= 300}
    whole, drawn = ([n for n in large if (large[n].start == "whole") == is_whole] for is_whole in (True, False))
    best = [str(log_likelihoods[names].idxmax()) for names in (drawn, whole)]
    return float(np.exp(log_likelihoods[best[0]] - log_likelihoods[best[1]])), *best


def shares(log_likelihoods: pd.Series) -> pd.Series:
    """Posterior shares of the candidates: every one is as probable as any other before."""
    odds = np.exp(log_likelihoods - log_likelihoods.max())
    return odds / odds.sum()


def ranking(likelihoods: pd.DataFrame, width: Width, folder: Path = FOLDER) -> pd.DataFrame:
    """Rank the candidates.

    Parameters
    ----------
    likelihoods : DataFrame
        From `likelihood_table`.
    width : two floats
        The kernel's, as for `likelihoods`.

    Returns
    -------
    DataFrame
        A row a candidate, the likeliest first: `protocol`, what it is, `runs_a_row`, `log_likelihood` and from one
        realisation alone, `share`, `best_basin_share` of its runs and `dropped` after screening.
    """
    part, rows = shares(likelihoods.sum(axis=1)), []
    kept = contenders(folder)
    for name, candidate in GRID.items():
        runs, protocol = pool(name, folder), candidate.protocol
        of_authors = runs[runs["record"].isin(OF_AUTHORS)]
        single = {
            f"log_likelihood_{label}": row_log_likelihoods(name, runs[runs["record"] == label], width).sum()
            for label in OF_AUTHORS
        }
        rows.append(
            {
                "protocol": name,
                "unit": candidate.unit,
                "amplitude_factor": protocol.amplitude_factor,
                "population": protocol.population,
                "iterations": protocol.iterations or "default",
                "restarts": candidate.restarts,
                "start": protocol.start,
                "T_d_s": "free" if candidate.free_timing else protocol.T_d,
                "runs_a_row": len(of_authors) // len(ROWS),
                "log_likelihood": likelihoods.loc[name].sum(),
                **single,
                "share": part[name],
                "best_basin_share": best_basins(of_authors)["share"].mean(),
                "dropped": name not in kept,
            }
        )
    return pd.DataFrame(rows).sort_values("log_likelihood", ascending=False, kind="stable", ignore_index=True)


def predicted_tables(name: str, runs: pd.DataFrame, width: Width, kind: str = "R", draws: int = DRAWS) -> FloatArray:
    """Means and SDs [rps] of tables in another realisation, shape (draws, 10, 2).

    Of the authors' realisations there are two only, so the numbers move by the kernel's widths, as from one of them to
    the other; of our joint's, kind "S", there are enough.
    """
    rng = np.random.default_rng(2)
    table = np.stack([predicted(realisations(runs, row, GRID[name], kind), rng, draws) for row in ROWS], axis=1)
    return table * np.exp(width * rng.standard_normal(table.shape)) if kind == "R" else table


def simulated_likelihoods(name: str, runs: pd.DataFrame, width: Width, tables: int = TABLES) -> FloatArray:
    """Log-likelihood of each row of tables that a candidate itself would print, shape (tables, 10)."""
    made, rng = predicted_tables(name, runs, width, draws=tables), np.random.default_rng(3)
    drawn = [predicted(realisations(runs, row, GRID[name]), rng, DRAWS // 2) for row in ROWS]
    theory = printed_rows()[:, 2]
    return np.column_stack([log_likelihood(made[:, i], drawn[i], width, theory[i]) for i in range(len(ROWS))])


def joint_p(chosen: Mapping[int, str], likelihoods: pd.DataFrame, simulated: Mapping[str, FloatArray]) -> float:
    """Share of predicted tables that are no likelier than the printed one.

    Parameters
    ----------
    chosen : mapping of row to name
        The candidate that judges each row; rows that are not there are not judged.
    likelihoods : DataFrame
        From `likelihood_table`.
    simulated : mapping of name to array
        From `simulated_likelihoods`.
    """
    printed = sum(likelihoods.loc[name, row] for row, name in chosen.items())
    made = sum(simulated[name][:, row - 1] for row, name in chosen.items())
    return float((made <= printed).mean())


def chosen_by(likelihoods: pd.DataFrame, rows: tuple[int, ...]) -> str:
    """Name of the candidate under which some rows are the likeliest."""
    return str(likelihoods[list(rows)].sum(axis=1).idxmax())


def chosen_by_other_half(likelihoods: pd.DataFrame) -> dict[int, str]:
    """The candidate that the odd rows choose for the even ones, and conversely, by row."""
    odd, even = tuple(row for row in ROWS if row % 2), tuple(row for row in ROWS if row % 2 == 0)
    return {row: chosen_by(likelihoods, even if row % 2 else odd) for row in ROWS}


def fives() -> list[tuple[int, ...]]:
    """All choices of five rows."""
    return list(combinations(ROWS, len(ROWS) // 2))


def choices(likelihoods: pd.DataFrame, simulated: Mapping[str, FloatArray]) -> pd.DataFrame:
    """Let any five rows choose a candidate and the other five judge it.

    Parameters
    ----------
    likelihoods : DataFrame
        From `likelihood_table`, of the contenders.
    simulated : mapping of name to array
        From `simulated_likelihoods`, of each of them.

    Returns
    -------
    DataFrame
        A row a choice of five: `choosing` (the rows), `protocol`, and the other five rows' `log_likelihood` and `p`.
    """
    found = []
    for five in fives():
        name, others = chosen_by(likelihoods, five), [row for row in ROWS if row not in five]
        p = joint_p(dict.fromkeys(others, name), likelihoods, simulated)
        found.append((" ".join(map(str, five)), name, likelihoods.loc[name, others].sum(), p))
    return pd.DataFrame(found, columns=["choosing", "protocol", "log_likelihood", "p"])


def table2_regions(chosen: Mapping[int, str], kind: str = "R", folder: Path = FOLDER) -> pd.DataFrame:
    """Between which numbers 95 % of the predicted tables lie.

    Parameters
    ----------
    chosen : mapping of row to name
        The candidate that judges each row.
    kind : str
        "R" predicts from the authors' records, "S" from our simulated joint's.

    Returns
    -------
    DataFrame
        `row, column, protocol, median, low, high, printed, inside, p`, column "mean" or "sd" [rps]; p is twice the
        smaller tail.
    """
    width = widths(pool(AUTHORS, folder))
    tables = {name: predicted_tables(name, pool(name, folder), width, kind) for name in set(chosen.values())}
    rows = []
    for row, name in chosen.items():
        for index, column in enumerate(("mean", "sd")):
            drawn, printed = tables[name][:, row - 1, index], printed_rows()[row - 1, index]
            rows.append({"row": row, "column": column, "protocol": name, **_region(drawn, printed)})
    return pd.DataFrame(rows)


def _region(drawn: FloatArray, printed: float) -> dict[str, float | bool]:
    low, median, high = np.quantile(drawn, [0.025, 0.5, 0.975])
    p = min(1.0, 2 * min((drawn <= printed).mean(), (drawn >= printed).mean()))
    where = {"median": median, "low": low, "high": high, "printed": printed}
    return where | {"inside": bool(low <= printed <= high), "p": p}


def noise_only_regions(name: str, folder: Path = FOLDER) -> pd.DataFrame:
    """Table 2's last row over many noises: mean and SD of A with its sign, and what can be compared, the RMS of A.

    Returns
    -------
    DataFrame
        `row, column, protocol, median, low, high, printed, inside, p`, column "mean", "sd" or "rms" [rps].
    """
    row = len(ROWS) + 1
    drawn = predicted(realisations(pool(name, folder), row, GRID[name], "N"), np.random.default_rng(4))
    printed = [published.value(f"table2.row{row}.{column}") for column in ("mean", "sd")]
    both = {"mean": (drawn[:, 0], printed[0]), "sd": (drawn[:, 1], printed[1]), "rms": (_rms(drawn), _rms(printed))}
    return pd.DataFrame(
        [{"row": row, "column": column, "protocol": name, **_region(*pair)} for column, pair in both.items()]
    )


def _rms(mean_and_sd) -> FloatArray:
    mean, sd = np.moveaxis(np.asarray(mean_and_sd, dtype=float), -1, 0)
    return np.sqrt(mean**2 + sd**2 * (RUNS - 1) / RUNS)


def regions(name: str = AUTHORS, kind: str = "R", folder: Path = FOLDER) -> dict[str, tuple[float, float]]:
    """Regions of Table 2's cells under one candidate, from its pool, as `workbook.verdict` takes them.

    Parameters
    ----------
    name : str
        A candidate of `pools.GRID`; the authors' notebook has all kinds of records.
    kind : str
        "R" for the authors' records, "S" for our simulated joint's, with the row without backlash.
    folder : Path
        Where pools are kept.

    Returns
    -------
    dict of cell id to (low, high)
    """
    table = table2_regions(dict.fromkeys(ROWS, name), kind, folder)
    if kind == "S":
        noise = noise_only_regions(name, folder)
        table = pd.concat([table, noise[noise["column"] != "rms"]], ignore_index=True)
    return cells_of(table)


def cells_of(table: pd.DataFrame) -> dict[str, tuple[float, float]]:
    """Regions of a table of regions by cell id."""
    return {
        f"table2.row{row['row']:02d}.{row['column']}": (row["low"], row["high"]) for row in table.to_dict("records")
    }


def chosen_cells(chosen: Mapping[int, str], record: str = "R1", folder: Path = FOLDER) -> dict[str, float]:
    """Mean and SD of |A| [rps] over the first `RUNS` runs on one realisation, by cell id.

    Parameters
    ----------
    chosen : mapping of row to name
        The candidate that computes each row.
    record : str
        The realisation, as in `pools.pool`.
    """
    cells = {}
    for row, name in chosen.items():
        runs = pool(name, folder)
        part = runs[(runs["record"] == record) & (runs["row"] == row) & (runs["seed"] <= RUNS)]["A_rps"].abs()
        cells |= {f"table2.row{row:02d}.mean": part.mean(), f"table2.row{row:02d}.sd": part.std(ddof=1)}
    return cells


def mean_tolerances(name: str, folder: Path = FOLDER) -> pd.DataFrame:
    """What a row's mean may be off by in another realisation: what "2 % for gate and realisation" should be.

    Returns
    -------
    DataFrame
        By `row`: A in the best basin, `R1_rps` and `R2_rps`, and how far they are `apart_percent`; `gate_percent`, its
        SD over runs; `noises_percent`, its SD over our joint's noises; `half_region_percent` of the predicted mean.
    """
    runs = pool(name, folder)
    best = best_basins(runs[runs["row"].isin(ROWS)])
    mean, sd = best["mean_rps"].unstack("record"), best["sd_rps"].unstack("record")
    noises = np.log(mean[[label for label in mean if label.startswith("S")]])
    table = table2_regions(dict.fromkeys(ROWS, name), folder=folder)
    half = table[table["column"] == "mean"].set_index("row")
    return pd.DataFrame(
        {
            "R1_rps": mean["R1"],
            "R2_rps": mean["R2"],
            "apart_percent": 100 * np.log(mean["R2"] / mean["R1"]),
            "gate_percent": 100 * (sd["R1"] / mean["R1"]),
            "noises_percent": 100 * noises.std(axis=1, ddof=1),
            "half_region_percent": 50 * (half["high"] - half["low"]) / half["median"],
        }
    ).reset_index(names="row")


def stray_pattern(name: str, width: Width, quiet_share: float, folder: Path = FOLDER) -> pd.DataFrame:
    """How often a row is as quiet as if no run had strayed: its SD below a share of its mean.

    Returns
    -------
    DataFrame
        By `row`: `printed_quiet`, `predicted_quiet`, the predicted share, and `best_basin_share` of the runs.
    """
    runs, printed = pool(name, folder), printed_rows()
    tables = predicted_tables(name, runs, width)
    best = best_basins(runs[runs["record"].isin(OF_AUTHORS)])["share"].groupby("row").mean()
    return pd.DataFrame(
        {
            "row": ROWS,
            "printed_quiet": printed[:, 1] < quiet_share * printed[:, 0],
            "predicted_quiet": (tables[:, :, 1] < quiet_share * tables[:, :, 0]).mean(axis=0),
            "best_basin_share": best.to_numpy(),
        }
    )


def bench_sds(name: str, folder: Path = FOLDER) -> pd.DataFrame:
    """How often stand-ins of Table 3's bench, under one candidate, have SDs as small and as large as the printed ones.

    Returns
    -------
    DataFrame
        A row for each of `pools.BENCHES`: `noise_rps, friction_share`, `median_sd_rps` of the three states, and the
        shares of drawn SDs `at_most_0.0010` and `at_least_0.0879`.
    """
    printed, runs, rng, rows = published.column("Table 3", "sd"), pool(name, folder), np.random.default_rng(5), []
    for number, (noise, friction) in enumerate(BENCHES):
        drawn = [predicted(realisations(runs, row, GRID[name], f"B{number}"), rng)[:, 1] for row in (1, 2, 3)]
        rows.append(
            {
                "protocol": name,
                "noise_rps": noise,
                "friction_share": friction,
                "median_sd_rps": np.median(drawn),
                f"at_most_{printed.min():.4f}": (np.array(drawn) <= printed.min()).mean(),
                f"at_least_{printed.max():.4f}": (np.array(drawn) >= printed.max()).mean(),
            }
        )
    return pd.DataFrame(rows)


def recomputed(names: list[str], number: int, rng: np.random.Generator, folder: Path = FOLDER) -> pd.DataFrame:
    """Run a few of the pools' runs again, drawn at random.

    Returns
    -------
    DataFrame
        A row a run: `protocol, record, row, seed`, what the pool keeps of it and `again`, as written, and whether they
        are the `same`.
    """
    kept = pd.concat([pool(name, folder).assign(protocol=name) for name in names], ignore_index=True)
    rows = []
    for run in kept.iloc[np.sort(rng.choice(len(kept), size=number, replace=False))].to_dict("records"):
        recording = pools.records(run["record"])[run["row"]]
        found = pools.one_run(GRID[run["protocol"]], recording, run["row"], run["seed"])
        before = " ".join(f"{run[column]:.6g}" for column in pools.COLUMNS[3:])
        again = " ".join(f"{number:.6g}" for number in found)
        key = {column: run[column] for column in ("protocol", "record", "row", "seed")}
        rows.append(key | {"kept": before, "again": again, "same": before == again})
    return pd.DataFrame(rows)
