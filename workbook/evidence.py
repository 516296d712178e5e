"""Is the printed Table 2 one more of our tables? Its means together, its SDs together, its bias.

A realisation is one noise on a row's record and thirty runs of the search: one mean and one SD of A. Rows have noises
of their own, so a table of ours is any choice of one realisation for each row.
"""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from replication import published
from replication.table2 import DRAWN_STARTS, ROWS

DRAWS = 20_000  # tables drawn for a p
LEVEL = 0.05

Floats = NDArray[np.float64]


class Tables(NamedTuple):
    """The numbers of ours that judge Table 2, by setting: means and SDs [rps], each of shape (10, N)."""

    means: Floats
    sds: Floats


def starts_drawn(realisations: pd.DataFrame) -> pd.Series:
    """Which realisations start at a random one of the first 100 samples, as the text says."""
    return realisations["protocol"].isin([settings.name for settings in DRAWN_STARTS])


def tables(realisations: pd.DataFrame) -> Tables:
    """Arrange realisations of one setting, or of several together, as numbers of each of the ten rows."""
    of_rows = realisations[realisations["row"].isin(ROWS)]
    made = ["protocol", "realisation"]
    wide = of_rows.pivot(index="row", columns=made, values=["mean_A_rps", "sd_A_rps"])
    return Tables(wide["mean_A_rps"].to_numpy(), wide["sd_A_rps"].to_numpy())


def printed_table() -> Tables:
    """Table 2's printed means and SDs [rps], of shape (10, 1)."""
    columns = (published.column("Table 2", name)[: len(ROWS), None] for name in ("mean", "sd"))
    return Tables(*columns)


def mean_scores(numbers: Floats) -> Floats:
    """How far each mean lies from its row's middle: squared deviation of the logarithm over its scatter."""
    logs = np.log(numbers)
    low, middle, high = np.quantile(logs, [0.16, 0.5, 0.84], axis=1)[..., None]
    return (2 * (logs - middle) / (high - low)) ** 2


def rank_scores(numbers: Floats) -> Floats:
    """How far each SD lies from its row's middle: -2 ln p of its two-sided rank, because SDs have two humps."""
    below, above = (stats.rankdata(each, "max", axis=1) for each in (numbers, -numbers))
    return -2 * np.log(np.minimum(1, 2 * np.minimum(below, above) / numbers.shape[1]))


def draw_tables(numbers: Floats) -> Floats:
    """Draw tables from numbers of shape (10, N), for each row one of its N: shape (draws, 10)."""
    chosen = np.random.default_rng(1).integers(numbers.shape[1], size=(DRAWS, len(numbers)))
    return numbers[np.arange(len(numbers)), chosen]


def joint_p(scores: Floats) -> float:
    """Share of tables that lie as far out as the printed one; scores of shape (10, 1 + N), the printed ones first.

    Of each row one of the 1 + N scores is drawn; exact whatever the law of the numbers.
    """
    reached = (draw_tables(scores).sum(axis=1) >= scores[:, 0].sum() * (1 - 1e-9)).sum()
    return float((1 + reached) / (1 + DRAWS))


def bias_percent(means: Floats) -> Floats:
    """Mean over the ten rows of mean A over theoretical A, less 1 [%]; means of shape (10, N)."""
    theoretical = published.column("Table 2", "theoretical")[: len(ROWS), None]
    return 100 * ((means / theoretical).mean(axis=0) - 1)


def bias_p(means: Floats, printed: Floats) -> float:
    """Two-sided p of the printed bias among tables drawn row by row from means of shape (10, N)."""
    drawn = bias_percent(draw_tables(means).T)
    (bias,) = bias_percent(printed)
    tail = min((drawn <= bias).sum(), (drawn >= bias).sum())
    return min(1.0, 2 * (1 + int(tail)) / (1 + DRAWS))


def p_values(realisations: pd.DataFrame) -> dict[str, float]:
    """Test the printed table against realisations: p of the means, of the SDs, of the bias; and our bias [%]."""
    ours, printed = tables(realisations), printed_table()
    return {
        "p_means": joint_p(mean_scores(np.hstack([printed.means, ours.means]))),
        "p_sds": joint_p(rank_scores(np.hstack([printed.sds, ours.sds]))),
        "p_bias": bias_p(ours.means, printed.means),
        "bias": float(np.median(bias_percent(ours.means))),
    }


def table2_evidence(realisations: pd.DataFrame) -> dict[str, Any]:
    """What the report says of Table 2 as a whole: with the whole record, and with a drawn start."""
    drawn = starts_drawn(realisations)
    whole = realisations[~drawn]
    alone = [p_values(part) for _, part in whole.groupby("protocol")]
    late = [part for _, part in realisations[drawn].groupby("protocol")]
    late_means = [np.median(tables(part).means, axis=1, keepdims=True) for part in late]
    printed = printed_table().means
    return {
        "settings": len(alone),
        "tables": whole["realisation"].nunique() * len(alone),
        "whole": p_values(whole),
        "sds_rejected": sum(each["p_sds"] < LEVEL for each in alone),
        "drawn_p": max(p_values(part)["p_bias"] for part in late),
        "drawn_shift": 100 * (np.hstack(late_means) / printed - 1),
        "printed_bias": float(bias_percent(printed)[0]),
    }
