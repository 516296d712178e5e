"""Methods on logs of known backlash: a table of answers, and what it says of errors and intervals."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pandas import DataFrame, Series, read_csv

from backlash.calibration import Backlash, Calibration, widened
from backlash.fitting.global_fit import GlobalFit
from backlash.fitting.readings import reading_of_fit
from backlash.fitting.self_calibration import fit_joint
from replication.arrays import FloatArray
from replication.parallel import in_parallel
from replication.records import Recording
from studies.joint_match import NUISANCES
from studies.rates import rate_columns

# Methods through the joint: what is unknown besides the backlash.
JOINT_METHODS = {
    "joint": (),
    "joint, start angle free": ("start_angle",),
    "joint, all nuisances free": tuple(NUISANCES),
}

Row = dict[str, Any]


@dataclass(frozen=True)
class KnownLog:
    """A log of known backlash [rad]; its labels are the columns that say which log it is."""

    labels: Row
    delta_rad: float
    recording: Recording


# By method: the backlash found [rad], or columns of which `found_rad` is one.
Answers = Mapping[str, float | Row]
DrawnLog = KnownLog | Callable[[], KnownLog]  # a log, or a function that draws it


def logs_by_methods(logs: Iterable[DrawnLog], answers: Callable[[KnownLog], Answers]) -> DataFrame:
    """One row per log and method: labels, true and found backlash, error, and whatever else is answered."""
    rows_of_logs = in_parallel(_rows, ((log, answers) for log in logs), "logs")
    return DataFrame([row for rows in rows_of_logs for row in rows])


def _rows(drawn: DrawnLog, answers: Callable[[KnownLog], Answers]) -> list[Row]:
    log = drawn if isinstance(drawn, KnownLog) else drawn()
    rows = []
    for method, answer in answers(log).items():
        columns = answer if isinstance(answer, dict) else {"found_rad": answer}
        found_rad = columns["found_rad"]
        key = {"method": method, **log.labels, "delta_rad": log.delta_rad}
        rows.append(
            key | {"found_rad": found_rad, "error_rad": found_rad - log.delta_rad} | columns
        )
    return rows


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


def self_answer(recording: Recording) -> Row:
    """Answer of method "self", and its whole fit."""
    fit = fit_joint(recording)
    answer = interval_answer(fit.delta_rad, fit.interval_rad, fit.refusal_reason)
    return answer | {
        "sd_rad": fit.sd_rad,
        "misfit": fit.misfit,
        "unrest": fit.ring_noise_ratio,
        "fit": fit,
    }


def backlashes(
    recording: Recording, fit: GlobalFit, calibrations: Mapping[str, Calibration]
) -> dict[str, Backlash]:
    """Backlash of a record by several calibrations, from its one global fit; keys as in `calibrations`."""
    return {
        name: calibration.backlash(
            reading_of_fit(recording, calibration.method, fit, calibration.bank)
        )
        for name, calibration in calibrations.items()
    }


def widened_answers(
    recording: Recording, fit: GlobalFit, calibrations: Mapping[str, Calibration]
) -> dict[str, Row]:
    """Answers, from the global fit, to a record of another joint than that of the calibrations."""
    answers = {}
    for name, backlash in backlashes(recording, fit, calibrations).items():
        interval = widened(calibrations[name].method, backlash.delta_rad, backlash.interval_rad)
        reason = "extrapolated calibration" if backlash.extrapolated else ""
        answers[name] = interval_answer(backlash.delta_rad, interval, reason)
    return answers


def root_mean_square(values: Series | FloatArray) -> float:
    """Root of the mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(values**2)))


def summarise_errors(table: DataFrame, by: Sequence[str] = ("method",)) -> DataFrame:
    """Number of logs, and mean size, largest size and root mean square of the errors; groups in their first order."""
    groups = table.assign(size=table["error_rad"].abs()).groupby(list(by), sort=False)
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


def hold_truth(rows: DataFrame) -> int:
    """How many intervals hold the true backlash."""
    return int(rows["delta_rad"].between(rows["low_rad"], rows["high_rad"]).sum())
