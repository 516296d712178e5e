"""Backlash over time from dated logs, and the date at which it crosses a limit.

The line through the dated estimates is weighted by their intervals, widened where they scatter
more. Where no log has an absolute backlash, the line goes through the amplitudes
instead, in percent of the first.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import fdtri, ndtri, stdtrit

from backlash import __version__
from backlash.batch import estimate_many
from backlash.calibration import MISMATCH, MOST_RAD
from backlash.estimates import CANNOT_TELL
from backlash.plant import KEYS, read_rows
from backlash.reading.sources import name_of
from backlash.refusals import Refusal, check_positive, one_line
from replication.signature import FloatArray

CONFIDENCE = 0.95
_LEAST_DATES = 3
_DATE = re.compile(r"(?<!\d)(\d{4})[-_.]?(\d{2})[-_.]?(\d{2})(?!\d)")
_DAYS_AHEAD = 36525  # a century; further off, a date says nothing
_DAYS_A_YEAR = 365.25


@dataclass(frozen=True)
class Trend:
    """A line through dated backlashes (half of the play) [rad] or relative indices [%]; `print` shows it."""

    points: pd.DataFrame  # `date, file, value, low, high`, by date
    origin: pd.Timestamp  # the line's time zero, the weighted mean date
    line: tuple[float, float]  # value at `origin`, and its growth per day
    variance: np.poly1d  # of the line, over days from `origin`
    quantile: float  # of the t distribution, for two-sided intervals at `CONFIDENCE`
    limit_rad: float | None
    is_relative: bool  # the values are amplitudes, in percent of the first log's
    notes: tuple[str, ...]  # on the logs and the line

    @property
    def warnings(self) -> tuple[str, ...]:
        """What makes the line or its crossing less sure."""
        return (*self.notes, *_notes_on_crossing(self))

    @property
    def growth_interval(self) -> tuple[float, float]:
        """Interval of the growth per day."""
        half = self.quantile * float(np.sqrt(self.variance[2]))
        return self.line[1] - half, self.line[1] + half

    @property
    def alarm(self) -> bool:
        """Whether the growth is significant."""
        return self.growth_interval[0] > 0

    @property
    def crossing(self) -> pd.Timestamp | None:
        """When a growing line reaches the limit, if that is within a century."""
        value, growth = self.line
        if self.limit_rad is None or growth <= 0:
            return None
        return self._date((self.limit_rad - value) / growth)

    @property
    def crossing_interval(self) -> tuple[pd.Timestamp | None, ...]:
        """Its interval by Fieller's theorem; None: no end within a century, as of a growth that is not sure."""
        if self.limit_rad is None or not self.alarm:
            return None, None
        value, growth = self.line
        # The band holds the limit where (value + growth t - limit)^2 <= quantile^2 variance(t).
        distance = np.poly1d([growth, value - self.limit_rad])
        ends = (distance**2 - self.quantile**2 * self.variance).roots.real
        return tuple(map(self._date, sorted(ends.tolist())))

    def _date(self, days: float) -> pd.Timestamp | None:
        return self.origin + pd.Timedelta(days=days) if abs(days) < _DAYS_AHEAD else None

    @property
    def shown_in(self) -> tuple[float, str]:
        """What values are multiplied by to be shown, and the unit that they have then."""
        return (1.0, "% of the first") if self.is_relative else (1e3, "mrad")

    def to_dict(self) -> dict[str, object]:
        """The points, growth and crossing, ready for JSON."""
        dates = self.points["date"].dt.strftime("%Y-%m-%d")
        return {
            "points": self.points.assign(date=dates).to_dict("records"),
            "unit": "percent" if self.is_relative else "rad",
            "growth_per_day": self.line[1],
            "growth_interval_per_day": self.growth_interval,
            "limit_rad": self.limit_rad,
            "crossing_date": _day(self.crossing),
            "crossing_interval": [_day(end) for end in self.crossing_interval],
            "confidence": CONFIDENCE,
            "warnings": self.warnings,
            "is_relative": self.is_relative,
            "alarm": self.alarm,
            "version": __version__,
        }

    def __str__(self) -> str:
        """The trend for people."""
        scale, unit = self.shown_in
        lines = [
            f"{row.date:%Y-%m-%d}  {scale * row.value:.3f} {unit} ({scale * row.low:.3f} to {scale * row.high:.3f})"
            f"  {one_line(row.file)}"
            for row in self.points.itertuples()
        ]
        growth, low, high = scale * _DAYS_A_YEAR * np.array([self.line[1], *self.growth_interval])
        sure = "; alarm: it grows" if self.alarm else ""
        lines.append(f"growth {growth:.3f} {unit} a year (95 %: {low:.3f} to {high:.3f}){sure}")
        if self.limit_rad is not None and self.crossing is not None:
            first, last = (_day(end) or "no date" for end in self.crossing_interval)
            crossed = f"{1e3 * self.limit_rad:.3f} mrad crossed on {_day(self.crossing)}"
            lines.append(f"{crossed} (95 %: {first} to {last})")
        return "\n".join([*lines, *(f"note: {one_line(warning)}" for warning in self.warnings)])

    def band(self, days: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The line at days from `origin`, and half the width of its confidence band."""
        return np.polyval(self.line[::-1], days), self.quantile * np.sqrt(self.variance(days))


def trend(
    logs: Sequence[object],
    dates: Sequence[Any] | str | PathLike[str] | None = None,
    *,
    limit_rad: float | None = None,
    relative: bool = False,
    jobs: int = 1,
    **given: Any,
) -> Trend:
    """Fit a line to the backlashes of dated logs of one joint; parameters not named here are those of `estimate`.

    Parameters
    ----------
    logs : sequence of logs
        Paths, tables, or what `read_log` returned; one without a backlash is left out, and a warning says why.
    dates : sequence of dates, or path, optional
        As pandas reads them, or a table with columns file and date; else those in the files' names, like 2024-03-17.
    limit_rad : float, optional
        The backlash, half of the total play, whose date is wanted [rad].
    relative : bool
        Take the oscillations' amplitudes, in percent of the first; so it is by itself where no log has an answer.
    jobs : int
        Processes; -1 for all cores where that is worth it.

    Returns
    -------
    Trend
        The line, and the date on which it crosses the limit with its 95 % interval.

    Raises
    ------
    Refusal
        A date is missing, there are fewer than three, or the limit is not finite and above zero.

    Examples
    --------
    >>> import backlash
    >>> worn = backlash.trend(logs, dates, calibration="joint.json", turn_period_s=0.4, limit_rad=2e-3)
    >>> print(worn.alarm, worn.crossing.year)
    True 2024
    """
    if dates is None or isinstance(dates, str | PathLike):
        days = dates_of([Path(name_of(log)) for log in logs], dates)
    else:
        days = list(pd.DatetimeIndex(dates))
    if len(days) != len(logs):
        raise Refusal(f"{len(logs)} logs and {len(days)} dates; give a date for each log")
    answers = estimate_many(logs, jobs=jobs, **given)
    return fit_trend(answers, days, limit_rad, relative)


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
    table = read_rows(answers, *KEYS, "file", "verdict", "backlash_high_rad")
    trends: dict[str, Trend | Refusal] = {}
    for joint, own in table.fillna({"joint": "", "reason": ""}).groupby("joint"):
        try:
            trends[str(joint)] = fit_trend(own, own["date"], limit_rad, relative)
        except Refusal as refusal:
            trends[str(joint)] = refusal
    return trends


def dates_of(files: Sequence[Path], table: str | PathLike[str] | None = None) -> list[pd.Timestamp]:
    """Date of each log, by the table's columns `file` and `date`, else by its name, as in `axis4_2024-03-17.csv`."""
    if table:
        listed = read_rows(table, "file", "date").set_index("file")["date"].to_dict()
        found = [listed.get(file.name, listed.get(str(file))) for file in files]
        where = f"in {table}"
    else:
        matches = [_DATE.search(file.stem) for file in files]
        texts = ["-".join(match.groups()) if match else None for match in matches]
        found = list(pd.to_datetime(texts, errors="coerce"))
        where = "in its name (like 2024-03-17); give --dates"
    for file, date in zip(files, found, strict=True):
        if pd.isna(date):
            raise Refusal(f"{file}: no date {where}")
    return found


def fit_trend(
    answers: pd.DataFrame,
    dates: Sequence[pd.Timestamp] | pd.Series,
    limit_rad: float | None = None,
    relative: bool = False,
) -> Trend:
    """Fit a line to dated backlashes in a table of answers; to amplitudes if `relative`, or if no log has an answer."""
    check_positive(limit_rad=limit_rad)
    if limit_rad and limit_rad > MOST_RAD:
        raise Refusal(f"--limit {limit_rad:g}: give at most {MOST_RAD:g} [rad]; 1 mrad is 0.001")
    relative = relative or bool((answers["verdict"] == CANNOT_TELL).all())
    points = _points(answers.assign(date=list(dates)), relative)
    notes = _left_out(points, answers)
    if relative:
        what = "the oscillation's amplitude in percent of the first log's, not the backlash"
        notes.append(f"relative: {what}; a limit in rad says nothing of it")
        limit_rad = None
    value = points["value"].to_numpy()
    deviation = (points["high"] - points["low"]).to_numpy() / 2 / ndtri((1 + CONFIDENCE) / 2)
    weight = 1 / np.maximum(deviation, 1e-3 * value.max())
    since = days_since(points["date"], points["date"].iloc[0])
    days = since - np.average(since, weights=weight**2)
    # Of the growth since the first log: equal estimates then have a slope of zero, to the last
    # digit.
    grown = value - value[0]
    line, covariance = np.polyfit(days, grown, 1, w=weight, cov="unscaled")
    freedom = value.size - 2
    chi2, curved = (_misfit(days, grown, weight, degree) for degree in (1, 2))
    (of_growth, shared), (_, of_value) = covariance * max(1.0, chi2 / freedom)
    # Whether a parabola is better than the line, by an F test at 5 %.
    gain = (chi2 - curved) / max(curved / max(freedom - 1, 1), 1.0)
    if freedom > 2 and gain > fdtri(1, freedom - 1, 0.95):
        notes.append("the growth is no straight line: the date of the crossing may be far off")
    return Trend(
        points=points,
        origin=points["date"].iloc[0] - pd.Timedelta(days=days[0]),
        line=(float(value[0] + line[1]), float(line[0])),
        variance=np.poly1d([of_growth, 2 * shared, of_value]),
        quantile=float(stdtrit(freedom, (1 + CONFIDENCE) / 2)),
        limit_rad=limit_rad,
        is_relative=relative,
        notes=tuple(notes),
    )


def _misfit(days: FloatArray, grown: FloatArray, weight: FloatArray, degree: int) -> float:
    """Chi squared of the best polynomial of a degree."""
    fit = np.polyfit(days, grown, degree, w=weight)
    return float(np.square(weight * (grown - np.polyval(fit, days))).sum())


def days_since(dates: pd.Series, origin: pd.Timestamp) -> FloatArray:
    """Days from an origin to each date."""
    return (dates - origin).dt.total_seconds().to_numpy() / 86400


def _left_out(points: pd.DataFrame, answers: pd.DataFrame) -> list[str]:
    """Say which logs have no point; refuse too few dates."""
    count = points["date"].nunique()
    without = answers[~answers["file"].isin(points["file"])]
    notes = [f"{row.file}: {row.reason or row.verdict}" for row in without.itertuples()]
    if count < _LEAST_DATES:
        few = f"{count} dates with an estimate; a trend needs {_LEAST_DATES} or more"
        raise Refusal("; ".join([few, *notes[:1]]))
    return [f"{len(notes)} of {len(answers)} logs are left out", *notes] if notes else []


def _notes_on_crossing(trend: Trend) -> Iterator[str]:
    if trend.limit_rad is None:
        return
    if trend.line[1] <= 0:
        yield "the backlash does not grow: no crossing"
    elif not trend.alarm:
        yield "the growth is not sure: the interval of the crossing is open"
    dates = trend.points["date"]
    if trend.crossing and trend.crossing - dates.max() > dates.max() - dates.min():
        yield "the crossing lies further ahead than the logs go back"


def _points(answers: pd.DataFrame, relative: bool) -> pd.DataFrame:
    """Dated backlashes [rad], or amplitudes in percent of the first, by date."""
    name, unit = ("amplitude", "rps") if relative else ("backlash", "rad")
    columns = ["date", "file", f"{name}_{unit}", f"{name}_low_{unit}", f"{name}_high_{unit}"]
    used = answers[(answers[columns[2]] > 0) & answers[columns].notna().all(axis=1)]
    used = used.sort_values(["date", "file"], ignore_index=True)
    points = used[columns].set_axis(["date", "file", "value", "low", "high"], axis=1)
    if not relative or points.empty:
        return points
    for name, unit in (("turn_period_s", "s a turn"), ("speed_rps", "rps")):
        values = used[name]
        if values.max() > (1 + MISMATCH) * values.min():
            other = used["file"][(values / values.median() - 1).abs().idxmax()]
            raise Refusal(
                f"{values.min():.4g} to {values.max():.4g} {unit}, {other} unlike the others: "
                "amplitudes are only comparable between logs of one movement"
            )
    points[["value", "low", "high"]] *= 100 / points["value"].iloc[0]
    return points


def _day(stamp: pd.Timestamp | None) -> str | None:
    return None if stamp is None else stamp.strftime("%Y-%m-%d")
