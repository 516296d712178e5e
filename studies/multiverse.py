"""Is the printed Table 2 one more of our tables? Intervals for its numbers, and tests of it as a whole, in all choices.

A realisation is one noise on a row's record and thirty runs of the search: one mean and one SD of A. Ten rows are a
table. Which start, which settings and which score a test has is the analyst's choice, so all are made: a multiverse
analysis (Steegen, Tuerlinckx, Gelman and Vanpaemel 2016), shown whole like a specification curve (Simonsohn, Simmons
and Nelson 2020).

In every test the printed table joins ours, and all are scored alike. Where rows share nothing, any of a row's numbers
may stand in a table, so the printed score is ranked among tables recombined row by row. Where they share the settings
or the start, it is ranked among the whole tables. If the printed table is one of ours, either p is uniform.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from pandas import DataFrame
from scipy import stats

from replication import published
from replication.signature import FloatArray
from replication.table2 import DRAWN_STARTS, NOISE_ROW, ROWS, SETTINGS, STARTS, WHOLE
from studies.claims import Numbers, span
from studies.intervals import prediction_interval

DRAWS = 20_000  # tables recombined for a p
LEVEL = 0.05
TOGETHER = "together"  # all settings of a start
INSIDE = "in interval"
PROTOCOLS = (*SETTINGS, *DRAWN_STARTS)
# Why a start, or settings, may be those of Table 2.
WHY = {
    WHOLE: "as the authors' notebook begins",
    "per row": "a row is a data set, with one start",
    "per fit": "each run may draw its own",
    "per table": "one start may serve all rows",
    TOGETHER: "settings are not printed",
    "authors' notebook": "public, but changed later",
    "rps": "with Table 1's bounds of A",
    "rpm": "equation 10 takes A in rpm",
}


def count_inside(printed: FloatArray, ours: FloatArray) -> float:
    """How many printed numbers, shape (rows, 1), lie in the intervals of ours, (rows, N); nan if N is too small."""
    low, high = np.array([prediction_interval(row) for row in ours]).T[..., None]
    is_inside = (low <= printed) & (printed <= high)
    return float(is_inside.sum()) if np.isfinite(low).all() else np.nan


# --------------------------------------------------------------------------------------------------- whole tables

# Numbers that are tested together, by name, each of shape (rows, N tables): means of A over theoretical A, SDs [rps].
Tables = dict[str, FloatArray]


def printed_table() -> Tables:
    """Table 2 as it is printed: N is 1."""
    table = DataFrame({"row": [*ROWS, NOISE_ROW], "protocol": "printed", "realisation": 1})
    for name in ("mean", "sd"):
        table[f"{name}_A_rps"] = published.column("Table 2", name)
    return arrange_tables(table)


def arrange_tables(realisations: DataFrame) -> Tables:
    """Arrange the rows of `realisations.read_realisations` as whole tables."""
    of_rows = realisations[realisations["row"].isin(ROWS)]
    wide = of_rows.pivot(index="row", columns=["protocol", "realisation"])
    theoretical = published.column("Table 2", "theoretical")[: len(ROWS), None]
    sds = wide["sd_A_rps"].to_numpy()
    return {
        "means": wide["mean_A_rps"].to_numpy() / theoretical,
        "SDs": sds,
        "SDs of rows 1 to 9": sds[:9],
    }


def squared_logs(numbers: FloatArray) -> FloatArray:
    """Squared deviation of each logarithm from its row's median, in half distances of the 16 and 84 % quantiles."""
    logs = np.log(numbers)
    low, middle, high = np.quantile(logs, [0.16, 0.5, 0.84], axis=1)[..., None]
    return (2 * (logs - middle) / (high - low)) ** 2


def rank_scores(numbers: FloatArray) -> FloatArray:
    """-2 ln p of each number's two-sided rank in its row."""
    below, above = (stats.rankdata(each, "max", axis=1) for each in (numbers, -numbers))
    return -2 * np.log(np.minimum(1, 2 * np.minimum(below, above) / numbers.shape[1]))


class Score(NamedTuple):
    """What a test compares: a number for each row of a table, and how a table's numbers become one."""

    of_rows: Callable[[FloatArray], FloatArray]  # shape (rows, N) both
    combine: Callable[..., FloatArray]  # along an axis
    two_sided: bool = False


MEAN_DEVIATION = "mean deviation"
OF_BOTH = {"squares": Score(squared_logs, np.sum), "ranks": Score(rank_scores, np.sum)}
SCORES_OF_MEANS = OF_BOTH | {
    MEAN_DEVIATION: Score(lambda ratios: ratios - 1, np.mean, two_sided=True),
    "largest error": Score(lambda ratios: np.abs(ratios - 1), np.max, two_sided=True),
}
SCORES_OF_SDS = OF_BOTH | {"mean logarithm": Score(np.log, np.mean, two_sided=True)}


def p_values(score: Score, numbers: FloatArray, by_rows: bool) -> FloatArray:
    """Share of tables whose score is as extreme as each of N, numbers of shape (rows, N): its p as one of them.

    The share is of `DRAWS` tables that are put together of rows drawn independently, and itself; or of the N whole
    tables.
    """
    of_rows = score.of_rows(numbers)
    statistics = null = score.combine(of_rows, axis=0)
    if by_rows:
        chosen = np.random.default_rng(1).integers(numbers.shape[1], size=(len(numbers), DRAWS))
        null = score.combine(np.take_along_axis(of_rows, chosen, axis=1), axis=0)
    itself = int(by_rows)
    rounding = 1e-9 * np.maximum(1, np.abs(statistics))
    ranked = np.sort(null)
    above = itself + null.size - np.searchsorted(ranked, statistics - rounding, "left")
    below = itself + np.searchsorted(ranked, statistics + rounding, "right")
    tail = 2 * np.minimum(above, below) if score.two_sided else above
    return np.minimum(1, tail / (itself + null.size))


# --------------------------------------------------------------------------------------------------- the multiverse


def split_protocols(realisations: DataFrame) -> Iterator[tuple[str, str, DataFrame]]:
    """Yield start, settings and their realisations: of each start all settings together, then one by one."""
    for start, ending in STARTS.items():
        alone = {each.name: [each.protocol] for each in PROTOCOLS if each.start == start}
        together = [name + ending for name in alone]
        for settings, protocols in ({TOGETHER: together} | alone).items():
            yield start, settings, realisations[realisations["protocol"].isin(protocols)]


def make_multiverse(realisations: DataFrame) -> DataFrame:
    """Test the printed table against ours in all choices of start, settings, numbers and score.

    Parameters
    ----------
    realisations : DataFrame
        `realisations.read_realisations`.

    Returns
    -------
    DataFrame
        A row for each choice: `start, settings, tables` (how many of ours), `numbers, score`; `by` ("rows" or
        "tables", see above), `p`, `least_p` (the smallest that so many tables can give) and `false_alarms` (the
        share of our own tables, each in turn as the printed one, with p < 0.05); or, where the score is "in
        interval", `inside`, how many printed numbers lie in the 95 % prediction intervals.
    """
    rows: list[dict[str, object]] = []
    expected = printed_table()
    for start, settings, part in split_protocols(realisations):
        by_rows = settings != TOGETHER and start != "per table"
        for name, ours in arrange_tables(part).items():
            N = ours.shape[1]
            key = {"start": start, "settings": settings, "tables": N, "numbers": name}
            rows.append(key | {"score": INSIDE, "inside": count_inside(expected[name], ours)})
            for label, score in (SCORES_OF_MEANS if name == "means" else SCORES_OF_SDS).items():
                tested = {
                    "score": label,
                    "by": "rows" if by_rows else "tables",
                    "p": p_values(score, np.hstack([expected[name], ours]), by_rows)[0],
                    "least_p": (1 + score.two_sided) / (1 + (DRAWS if by_rows else N)),
                    "false_alarms": np.mean(p_values(score, ours, by_rows) < LEVEL),
                }
                rows.append(key | tested)
    return DataFrame(rows)


# --------------------------------------------------------------------------------------------------- what it says


class Rejections(NamedTuple):
    """How many tests of one kind reject the printed table at 5 %."""

    tests: int
    rejected: int


def count_rejections(multiverse: DataFrame, start: str, numbers: str) -> Rejections:
    """Count what rejects means or SDs under a start, of the tests that have tables enough to reject."""
    of_start = (multiverse["start"] == start) & (multiverse["numbers"] == numbers)
    p = multiverse.loc[of_start & (multiverse["least_p"] < LEVEL), "p"]
    return Rejections(p.size, int((p < LEVEL).sum()))


def name_exclusions(multiverse: DataFrame, start: str, limit: float) -> str:
    """Say which scores exclude a start under all its settings: "the means' largest error, the SDs' ranks".

    They do where the largest p, of the tests that have tables enough for the limit, is below it.
    """
    tests = multiverse[multiverse["start"] == start].dropna(subset="p")
    tests = tests[tests["numbers"].isin(["means", "SDs"])]
    enough = tests["p"].where(tests["least_p"] < limit)
    p = enough.groupby([tests["numbers"], tests["score"]], sort=False).max()
    excluding = p.index[p < limit].to_frame(index=False)
    if p.isna().all():
        return f"none, because so few tables give no p below {limit:g}"
    if len(excluding) in (0, len(p)):
        return f"{'all' if len(excluding) else 'none of'} {len(p)} scores"
    by_numbers = excluding.groupby("numbers", sort=False)["score"].agg(", ".join)
    listed = by_numbers.str.replace(r", (?=[^,]*$)", " and ", regex=True)
    return ", ".join(f"the {numbers}' {scores}" for numbers, scores in listed.items())


READINGS = {
    "per row": "once a row, the likely reading",
    "per fit": "for each fit",
    "per table": "once for the table",
}


def measure_random_start(multiverse: DataFrame, criteria: published.Criteria = None) -> Numbers:
    """Whether the search begins at a random sample, whichever way the text is read, by p of the mean deviation.

    Compared are the largest p of the whole record and of a drawn start, and nothing where both are excluded.
    """
    limit = published.criterion("random_start", criteria)
    alone = multiverse[multiverse["settings"] != TOGETHER]
    by_start = alone[alone["score"] == MEAN_DEVIATION].groupby("start")["p"]
    p = by_start.agg(["min", "max"])
    settings = by_start.size()
    compared = {"whole_p": p.loc[WHOLE, "max"], "drawn_p": p.loc[[*READINGS], "max"].max()}
    if max(compared.values()) < limit:
        compared = dict.fromkeys(compared, np.nan)
    rows = [
        {
            "reading": reading,
            "p": span(p.loc[start], ".1g"),
            "limit": limit,
            "excluded_by": name_exclusions(multiverse, start, limit),
        }
        for start, reading in READINGS.items()
    ]
    return {
        **compared,
        "p_of_whole": span(p.loc[WHOLE], ".1g"),
        "whole_settings": settings[WHOLE],
        "drawn_settings": settings[[*READINGS]].max(),
        "rows": rows,
    }


def compare_starts(realisations: DataFrame) -> DataFrame:
    """What our tables with each start say of the printed one, by one measure under the settings that all starts have.

    Returns
    -------
    DataFrame
        By start: `tables`, ours; `settings`, how many; `means_inside` and `sds_inside`, of ten printed numbers in our
        95 % prediction intervals; `deviation_percent` of our means from the theoretical A, on average over rows and
        tables, and its `smallest_percent` and `largest_percent` of the settings; `reaching`, our tables whose means
        deviate as the printed ones or less.
    """
    printed = printed_table()
    rows = {}
    for start, ending in STARTS.items():
        protocols = {settings.name + ending for settings in DRAWN_STARTS}
        of_start = realisations[realisations["protocol"].isin(protocols)]
        ours = arrange_tables(of_start)
        parts = [arrange_tables(part) for _, part in of_start.groupby("protocol")]
        off = [deviation_percent(part).mean() for part in parts]
        rows[start] = {
            "tables": ours["means"].shape[1],
            "settings": len(parts),
            "means_inside": count_inside(printed["means"], ours["means"]),
            "sds_inside": count_inside(printed["SDs"], ours["SDs"]),
            "deviation_percent": np.mean(off),
            "smallest_percent": min(off),
            "largest_percent": max(off),
            "reaching": int((deviation_percent(ours) >= deviation_percent(printed)).sum()),
        }
    return DataFrame.from_dict(rows, orient="index").rename_axis("start")


def describe_intervals(rows: DataFrame) -> dict[str, dict[str, Any]]:
    """How Table 2's means and SDs lie in our intervals.

    `rows` have `mean, mean_ours, mean_low, mean_high` and the same of `sd`, by number: `agree`, how many of `all`;
    `differ`, the rows of the others; `width_percent`, smallest and largest width of an interval over ours; `factor`,
    smallest and largest upper end over the lower one, of those that agree.
    """
    described = {}
    for of in ("mean", "sd"):
        low, high = rows[f"{of}_low"], rows[f"{of}_high"]
        agrees = rows[of].between(low, high)
        width = 100 * (high - low) / rows[f"{of}_ours"]
        factor = (high / low)[agrees]
        described[f"{of}s"] = {
            "all": len(rows),
            "agree": int(agrees.sum()),
            "differ": rows.index[~agrees].tolist(),
            "width_percent": width.agg(["min", "max"]).tolist(),
            "factor": factor.agg(["min", "max"]).dropna().tolist(),
        }
    return described


def deviation_percent(tables: Tables) -> FloatArray:
    """Mean deviation of the means of A from the theoretical A [%], of each of N tables."""
    return 100 * (tables["means"].mean(axis=0) - 1)


def write_rejections(tests: Rejections) -> str:
    """Write how many tests reject: "none of 36 tests"."""
    if tests.tests == 0:
        return "too few tables to test"
    number = {0: "none of", tests.tests: "all"}.get(tests.rejected, f"{tests.rejected} of")
    return f"{number} {tests.tests} tests"


def write_p(p: float, least: float = 0.0) -> str:
    """Write a p with two digits, or what it is below: 0.44, below 0.001, "at most 0.0031" if it can be no less."""
    bound = "at most " if p <= 1.001 * least else ""
    return "below 0.001" if p < 0.001 else f"{bound}{p:.2g}"


def describe_multiverse(realisations: DataFrame, multiverse: DataFrame) -> dict[str, Any]:
    """What the report says of Table 2 as a whole, from the kept realisations and `make_multiverse` of them.

    `starts` are `compare_starts`; `whole` our tables with the whole record under all settings; `rejections` counts
    tests in words, by start and numbers; `p_of_sds` has the p of each score, in words, with all settings together.
    """
    whole = next(arrange_tables(part) for _, _, part in split_protocols(realisations))
    printed = printed_table()
    of_whole = multiverse[multiverse["start"] == WHOLE].set_index("numbers")
    alone = of_whole[of_whole["settings"] != TOGETHER]
    sds_together = of_whole[of_whole["settings"] == TOGETHER].drop("means").dropna(subset="p")
    alarms = 100 * multiverse["false_alarms"]
    sds = count_rejections(multiverse, WHOLE, "SDs")
    return {
        "starts": compare_starts(realisations).to_dict("index"),
        "whole": {
            "tables": whole["means"].shape[1],
            "settings": alone["settings"].nunique(),
            "means_inside": alone.loc["means", "inside"].dropna().tolist(),
            "deviation_percent": float(deviation_percent(whole).mean()),
            "sds_rejected": sds.rejected / max(sds.tests, 1),
            "row10_below": int((whole["SDs"][9] > printed["SDs"][9]).sum()),
        },
        "printed_percent": deviation_percent(printed).item(),
        "rejections": {
            start: {
                numbers: write_rejections(count_rejections(multiverse, start, numbers))
                for numbers in printed
            }
            for start in STARTS
        },
        "p_of_sds": {
            numbers: dict(zip(part["score"], map(write_p, part["p"], part["least_p"]), strict=True))
            for numbers, part in sds_together.groupby(level=0)
        },
        "false_alarms_percent": {"mean": alarms.mean(), "most": alarms.max()},
    }
