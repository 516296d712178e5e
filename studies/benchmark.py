"""Methods on logs of known backlash: their answers, and what a table of these says of errors and intervals."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pandas import DataFrame, Series, read_csv

from backlash.calibration import Backlash, Calibration
from backlash.fitting.global_fit import global_fit
from backlash.fitting.readings import protocol_for, reading_of_fit
from replication.arrays import FloatArray
from replication.records import Recording
from studies.rates import rate_columns

Row = dict[str, Any]


def interval_answer(found_rad: float, interval_rad: tuple[float, float], reason: str) -> Row:
    """Columns of an answer with an interval; a reason refuses it."""
    low, high = interval_rad
    return {
        "found_rad": found_rad,
        "low_rad": low,
        "high_rad": high,
        "refused": bool(reason),
        "reason": reason.split(" (")[0],
    }


def backlashes(
    recording: Recording, calibrations: Mapping[str, Calibration]
) -> dict[str, Backlash]:
    """Backlash of a record by several calibrations, from its one global fit; keys as in `calibrations`."""
    fit = global_fit(recording, protocol_for(recording))
    return {
        name: calibration.backlash(
            reading_of_fit(recording, calibration.method, fit, calibration.bank)
        )
        for name, calibration in calibrations.items()
    }


def root_mean_square(values: Series | FloatArray) -> float:
    """Root of the mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(values**2)))


def summarise_errors(table: DataFrame) -> DataFrame:
    """Number of logs, and mean size, largest size and root mean square of the errors of each method, in their order."""
    groups = table.assign(size=table["error_rad"].abs()).groupby("method", sort=False)
    return groups.agg(
        logs=("size", "size"),
        mean_abs_error_rad=("size", "mean"),
        max_abs_error_rad=("size", "max"),
        rmse_rad=("error_rad", root_mean_square),
    ).reset_index()


def summarise_intervals(rows: DataFrame) -> DataFrame:
    """Refusals of each method on each population; errors, coverage and bound (RMS) of the logs that were answered."""
    table = []
    for (population, method), part in rows.groupby(["population", "method"], sort=False):
        answered = part[~part["refused"]]
        error = answered["found_rad"] - answered["delta_rad"]
        held = hold_truth(answered)
        row = {
            "population": population,
            "method": method,
            "logs": len(part),
            "refused": part["refused"].mean(),
            "rmse_rad": root_mean_square(error),
            "mean_abs_error_rad": error.abs().mean(),
            **rate_columns(held, len(answered), "coverage"),
            "held_or_refused": (held + part["refused"].sum()) / len(part),
            "bound_rad": root_mean_square(answered["bound_rad"]),
        }
        table.append(row)
    return DataFrame(table)


def against_criteria(table: DataFrame, criteria: Path) -> DataFrame:
    """Compare a table of populations with criteria on them (column, sign, limit), fixed before its logs were drawn."""
    measured = table.set_index("population")
    bars = read_csv(criteria)
    bars = bars[bars["population"].isin(measured.index)]
    values = [measured.at[bar.population, bar.figure] for bar in bars.itertuples()]
    return DataFrame(
        {
            "population": bars["population"],
            "figure": bars["figure"],
            "bar": bars["sign"] + bars["limit"].map(" {:g}".format),
            "measured": values,
            "met": np.where(bars["sign"] == "<=", values <= bars["limit"], values >= bars["limit"]),
        }
    ).reset_index(drop=True)


def describe_missed(bars: DataFrame) -> str:
    """Say which of the criteria of `against_criteria` are not met."""
    missed = [
        f"{bar.population}: {bar.figure} {bar.measured:.3g}, not {bar.bar}"
        for bar in bars[~bars["met"]].itertuples()
    ]
    return "; ".join(missed).replace("_rad", " [rad]").replace("_", " ") or "none"


def hold_truth(rows: DataFrame) -> int:
    """How many intervals hold the true backlash."""
    return int(rows["delta_rad"].between(rows["low_rad"], rows["high_rad"]).sum())
