"""Why Table 2's means are not made again where the search begins at a sample that is drawn for each row.

The sentence: with such a start our means of A are too small because the search misses the best minimum, not because of
the start. Criteria, fixed on 2026-11-29 before a result with these seeds was seen; deviations are of A from the
theoretical one, on average over ten rows.

- Refuted if the best minima with drawn starts lie more than 2 points below those with the whole record (over the
  authors' five noises), or if fits that end in the best minimum (over all searches) lie more than 2 points below the
  best minima of the same records.
- Supported if neither, and a search with restarts, which finds the best minimum more often, leaves at most half of a
  single search's distance between the means and the best minima. Else it is undecided.
- "Restarts (a larger population) do not make the means again" is refuted if the mean deviation of one of their tables
  is the printed one or higher. Ten tables were planned, and time allowed eight, whatever they showed: if all are lower,
  that leaves 0 to 37 % (95 %).

A best minimum is that of `best_fit`, or of a run where that is lower. Restarts: a fit is the lowest in RMSE of five
searches, which spend what one of a fivefold population does. All searches on a row have the same noise and start.
"""

from dataclasses import replace
from itertools import chain, product
from operator import attrgetter
from typing import Any

import numpy as np
from pandas import DataFrame

from replication import published
from replication.best_fit import best_fit
from replication.records import LOW_NOISE, Recording, load_noisy
from replication.table2 import (
    BASIN_GAP,
    LEVELS,
    NOTEBOOK,
    ROWS,
    RPM_600,
    RUNS,
    WHOLE,
    Fit,
    SearchSettings,
    fit,
)
from studies.claims import span
from studies.multiverse import deviation_percent, printed_table
from studies.realisations import FIRST_SAMPLES, draw_record, from_sample

SEED = 20261129
TABLES = 8
SEARCHES = 5  # of which restarts keep the best
AUTHORS, OWN = "authors'", "own"  # noises
SINGLE, RESTARTS = "one search", "best of five searches"
LARGER = (1000, 3000)  # populations
BY_RMSE = attrgetter("rmse")


def draw_row(noise: str, table: int, start: str, row: int) -> tuple[Recording, int, np.ndarray]:
    """A row's record from its start on, that start [samples], and seeds of shape (thirty, five) for its searches."""
    rng = np.random.default_rng((SEED, *noise.encode(), table, row))
    record = draw_record(row, rng) if noise == OWN else load_noisy(LEVELS[row - 1], table)
    drawn = int(rng.integers(FIRST_SAMPLES))
    first_sample = 0 if start == WHOLE else drawn
    seeds = rng.integers(1, 2**31, (RUNS, SEARCHES))
    return from_sample(record, first_sample), first_sample, seeds


def measure_row(noise: str, settings: str, table: int, start: str, row: int) -> list[dict]:
    """What the searches find on one row, by one search each and, on our own noises, by the others: a row for each."""
    usual = {each.name: each for each in (NOTEBOOK, RPM_600)}[settings]
    record, first_sample, seeds = draw_row(noise, table, start, row)

    def fit_each(settings: SearchSettings, seeds: np.ndarray) -> list[Fit]:
        return [fit(record, settings, int(seed)) for seed in seeds]

    fits = {SINGLE: fit_each(usual, seeds[:, 0])}
    if noise == OWN:
        fits[RESTARTS] = [min(fit_each(usual, of_run), key=BY_RMSE) for of_run in seeds]
        for population in LARGER:
            larger = replace(usual, population=population)
            fits[f"population {population}"] = fit_each(larger, seeds[:, 0])
    best = best_fit(record, usual)
    lowest = min(chain(*fits.values()), key=BY_RMSE)
    if lowest.rmse * (1 + BASIN_GAP) < best.rmse:
        best = lowest
    rows = []
    for search, part in fits.items():
        A = np.array([each.amplitude_rps for each in part])
        in_best = np.array([each.rmse for each in part]) <= best.rmse * (1 + BASIN_GAP)
        rows.append(
            {
                "noise": noise,
                "settings": settings,
                "start": start,
                "search": search,
                "table": table,
                "row": row,
                "first_sample": first_sample,
                "best_A_rps": best.amplitude_rps,
                "mean_A_rps": A.mean(),
                "sd_A_rps": A.std(ddof=1),
                "best_share": in_best.mean(),
                "mean_A_in_best_rps": A[in_best].mean() if in_best.any() else np.nan,
            }
        )
    return rows


def planned_rows() -> list[tuple[str, str, int, str, int]]:
    """Noise, settings, table, start and row of all that is measured."""
    settings = (NOTEBOOK.name, RPM_600.name)
    return [
        *product([AUTHORS], settings, LOW_NOISE, (WHOLE, "per row"), ROWS),
        *product([OWN], settings[1:], range(1, TABLES + 1), ["per row"], ROWS),
    ]


# ------------------------------------------------------------------------------------------------ what it says

OF_SEARCH = ["noise", "settings", "start", "search"]


def summarise(rows: DataFrame) -> DataFrame:
    """Condense the kept table into a row for each noise, settings, start and search.

    Columns: `tables`; deviations from the theoretical A [%], on average over a table's rows and over tables: of the
    best minima (`best_percent`), of the means (`mean_percent`; `lowest_percent` and `highest_percent` of one table) and
    of fits in the best minimum (`in_best_percent`, with that of their best minima, `their_best_percent`); `best_share`,
    the share of fits in the best minimum; `reaching`, in how many tables the means deviate as the printed ones or less.
    """
    theoretical = published.column("Table 2", "theoretical")[rows["row"] - 1]
    A = rows[["best_A_rps", "mean_A_rps", "mean_A_in_best_rps"]]
    off = 100 * (A.div(theoretical, axis=0) - 1)
    off.columns = ["best_percent", "mean_percent", "in_best_percent"]
    measured = rows[[*OF_SEARCH, "table", "best_share"]].join(off)
    measured["their_best_percent"] = off["best_percent"].where(off["in_best_percent"].notna())
    of_tables = measured.groupby([*OF_SEARCH, "table"], sort=False).mean().droplevel("table")
    groups = of_tables.groupby(OF_SEARCH, sort=False)
    condensed = groups.mean()
    condensed.insert(0, "tables", groups.size())
    condensed["lowest_percent"] = groups["mean_percent"].min()
    condensed["highest_percent"] = groups["mean_percent"].max()
    reaching = of_tables["mean_percent"] >= deviation_percent(printed_table()).item()
    condensed["reaching"] = reaching.groupby(OF_SEARCH, sort=False).sum()
    return condensed.reset_index()


MOST_POINTS = 2.0  # see the criteria above


def decide(summary: DataFrame) -> bool | None:
    """Whether the search misses the best minimum, by the criteria above on `summarise`; None is undecided."""
    authors = summary[summary["noise"] == AUTHORS].pivot(index="settings", columns="start")
    own = summary[summary["noise"] == OWN].set_index("search")
    costs = authors["best_percent", WHOLE] - authors["best_percent", "per row"]
    low = summary["their_best_percent"] - summary["in_best_percent"]
    if max(costs.max(), low.max()) > MOST_POINTS:
        return False
    distance = own["best_percent"] - own["mean_percent"]
    return True if distance[RESTARTS] <= distance[SINGLE] / 2 else None


def describe(summary: DataFrame) -> dict[str, Any]:
    """What the report says of drawn starts, from `summarise`.

    Deviations of the best minima [%] on the authors' noises, and shares of fits that end there, by start, each with its
    ends over the settings; the searches on our own tables; and the verdict.
    """
    authors = summary[summary["noise"] == AUTHORS].groupby("start")
    own = summary[summary["noise"] == OWN]
    columns = ["search", "tables", "mean_percent", "highest_percent", "best_share", "reaching"]
    return {
        "best_percent": authors["best_percent"].mean().to_dict(),
        "best_share": authors["best_share"].agg(["min", "max"]).T.to_dict("list"),
        "own": own[columns].to_dict("records"),
        "search_misses": decide(summary),
    }


def write_answer(numbers: dict[str, Any]) -> str:
    """Write what `describe` gives as sentences."""
    best, share = numbers["best_percent"], numbers["best_share"]
    whole, drawn = (span(100 * np.array(share[start]), ".0f") for start in (WHOLE, "per row"))
    own = {each["search"]: each for each in numbers["own"]}
    low = {search: f"{-each['mean_percent']:.1f} %" for search, each in own.items()}
    why = {
        True: "So it is the search that fails, and not the start.",
        False: "So the search alone does not explain it.",
        None: "Whether the search or the start fails is undecided.",
    }[numbers["search_misses"]]
    restarts = own[RESTARTS]
    return (
        f"On the authors' five noises the best minimum lies {-best[WHOLE]:.1f} % below the theoretical A with the "
        f"whole record, and {-best['per row']:.1f} % with a start drawn for each row. A search ends there in {whole} % "
        f"of fits, with a drawn start in {drawn} %. {why} With the {RESTARTS} {restarts['tables']} tables with drawn "
        f"starts lie {low[RESTARTS]} below (the nearest {-restarts['highest_percent']:.2f} %), with one search "
        f"{low[SINGLE]}; of the former {restarts['reaching']} come as near as the printed one. What we exclude is a "
        "start drawn for each row *with one such search*; of restarts so few tables cannot say so."
    )
