"""Many joints: a table of logs, each with what is said of it, and a trend for each joint.

Columns of the table are `file`, `joint`, `date`, fields of `LogFormat`, and words of `estimate`.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from backlash import fleet, trend_line
from backlash.calibration import read_calibration
from backlash.interface import settings_of, settings_of_all
from backlash.reading import batch
from backlash.reading.columns import SAID
from backlash.reading.sources import name_of
from backlash.refusals import Refusal
from backlash.settings import MEASURING, Settings
from backlash.trend_line import Trend

COLUMNS = ("file", *batch.KEYS, *SAID, *MEASURING)


class Batch(NamedTuple):
    """Logs with their settings, or why they have none; `keys` are joints and dates, as far as a table has them."""

    logs: Sequence[Any]
    settings: Sequence[Settings | Refusal]
    keys: pd.DataFrame


def estimate_many(
    logs: Sequence[object] | batch.TableOfLogs, *, jobs: int = -1, **words: Any
) -> pd.DataFrame:
    """Estimate the backlashes of many logs, also of different joints.

    Inside `joblib.parallel_config` its backend is used: with "dask" a cluster, whose workers need this package and the
    logs under the same paths.

    Parameters
    ----------
    logs : sequence of logs, DataFrame, or path of a CSV table
        Logs as `estimate` takes them, or a table of their files with what is said of each: column `file` (in a file
        relative to it), and `joint`, `date`, and words of `estimate`, like `turn_period_s`, `torque`, `inertia_ratio`,
        `gravity_per_s2`, `calibration`. What a row leaves empty is taken from `words`.
    jobs : int
        Processes; -1 for all cores where that is worth it.
    **words
        As in `estimate`.

    Returns
    -------
    DataFrame
        A row for each log, in their order, by joint and date if the table has them. Columns are the attributes of
        `Estimate` in rad, rps, s and Hz, intervals in two each; `reason` says why there is no answer.

    Raises
    ------
    Refusal
        The table cannot be used. A log that cannot, or what its row says, only has no answer.

    Examples
    --------
    >>> import backlash
    >>> plant = pd.DataFrame({"file": files, "joint": ["A1", "A2"], "date": "2024-03-17"})
    >>> found = backlash.estimate_many(plant, method="energy", turn_period_s=0.4)
    >>> print(found.loc["A2"]["verdict"].tolist())
    ['backlash']
    """
    listed = read_batch(logs, words)
    found = dict(fleet.run_fleet(listed.logs, listed.settings, jobs))
    table = listed.keys.join(fleet.as_table([found[number] for number in sorted(found)]))
    return table.set_index([*listed.keys]) if len(listed.keys.columns) else table


def read_batch(source: Sequence[object] | batch.TableOfLogs, words: Mapping[str, Any]) -> Batch:
    """Logs, and what is said of each by its row if they are in a table, else by words that `estimate` takes."""
    if not isinstance(source, pd.DataFrame | str | PathLike):
        if not isinstance(source, Sequence):
            raise Refusal(
                f"one {type(source).__name__} of logs; give a list of them, or a pandas table with the column file"
            )
        keys = pd.DataFrame(index=range(len(source)))
        return Batch(source, settings_of_all(source, words), keys)
    logs, table = listed_logs(source, "file")
    if unknown := {*table}.difference(COLUMNS):
        known = ", ".join(COLUMNS)
        raise Refusal(f"{batch.called(source)}: column {min(unknown)!r}; there are {known}")
    keys = batch.keys_of(table)
    read = cache(read_calibration)
    settings: list[Settings | Refusal] = []
    for log, row in zip(logs, table.to_dict("records"), strict=True):
        try:
            own = batch.options_of(row)
            for name in batch.KEYS:
                own.pop(name, None)
            if "calibration" in own:
                own["calibration"] = read(own["calibration"])
            settings.append(settings_of(log, {**words, **own}))
        except Refusal as error:
            name = f"{batch.called(source)}, {Path(name_of(log)).name}"
            settings.append(Refusal(f"{name}: {error}"))
    return Batch(logs, settings, keys)


def listed_logs(source: batch.TableOfLogs, *columns: str) -> tuple[list[Any], pd.DataFrame]:
    """Logs in the first of some columns of a table, and the table without it; a file's names are relative to it."""
    table = batch.read_rows(source, *columns)
    if not isinstance(source, pd.DataFrame):
        folder = Path(source).parent
        for name in {columns[0], "calibration"} & {*table}:
            missing = "" if name == columns[0] else None
            names = table[name].astype(object).where(table[name].notna(), missing)
            table[name] = names.map(lambda each: folder / each.strip(), na_action="ignore")
    return table.pop(columns[0]).tolist(), table


def trend_many(
    answers: pd.DataFrame, *, limit_rad: float | None = None, relative: bool = False
) -> dict[str, Trend | Refusal]:
    """Fit a line to each joint's dated backlashes.

    Parameters
    ----------
    answers : DataFrame
        What `estimate_many` returned of a table with joints and dates, or several of these below each other.
    limit_rad, relative
        As in `trend`.

    Returns
    -------
    dict
        By joint its `Trend`, or the refusal that says why it has none.

    Raises
    ------
    Refusal
        A column is missing.

    Examples
    --------
    >>> import backlash
    >>> worn = backlash.trend_many(answers, limit_rad=2e-3)
    >>> print({joint: found.alarm for joint, found in worn.items()})
    {'A1': True, 'A2': True}
    """
    table = batch.read_rows(answers, *batch.KEYS, "file", "verdict", "backlash_high_rad")
    found: dict[str, Trend | Refusal] = {}
    for joint, own in table.fillna({"joint": "", "reason": ""}).groupby("joint"):
        try:
            found[str(joint)] = trend_line.fit_trend(own, own["date"], limit_rad, relative)
        except Refusal as refusal:
            found[str(joint)] = refusal
    return found
