"""Backlash over time from dated logs, and the date at which it crosses a limit.

The line through the dated estimates is weighted by their intervals, widened where they scatter
more. The crossing's interval is that of Fieller's theorem: the dates at which the line's confidence
band holds the limit. Where no log has an absolute backlash, the line goes through the amplitudes
instead, in percent of the first.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import pandas as pd
from scipy.special import fdtri, ndtri, stdtrit

from backlash import __version__, batch
from backlash.calibration import MISMATCH, MOST_RAD
from backlash.reading.batch import KEYS, read_rows
from backlash.reading.columns import is_positive
from backlash.reading.sources import name_of
from backlash.refusals import Refusal, one_line
from backlash.settings import Given
from replication.signature import FloatArray

CONFIDENCE = 0.95
_LEAST_DATES = 3
_DATE = re.compile(r"(?<!\d)(\d{4})[-_.]?(\d{2})[-_.]?(\d{2})(?!\d)")
_DAYS_AHEAD = 36525  # a century; further off, a date says nothing


@dataclass(frozen=True)
class Trend:
    """A line through dated backlashes (half of the play) [rad] or relative indices [%]; `print` shows it."""

    points: pd.DataFrame  # `date, file, value, low, high`, by date
    origin: pd.Timestamp  # the line's time zero, the weighted mean date
    line: tuple[float, float]  # value at `origin`, and its growth per day
    covariance: FloatArray  # of the two
    quantile: float  # of the t distribution, for two-sided intervals at `CONFIDENCE`
    limit_rad: float | None
    warnings: tuple[str, ...]
    is_relative: bool = False  # the values are amplitudes, in percent of the first log's

    @property
    def alarm(self) -> bool:
        """Whether the growth is significant."""
        return self.growth_interval[0] > 0

    @property
    def crossing_days(self) -> tuple[float, float | None, float | None] | None:
        """When a growing line reaches the limit, and the ends of the interval, in days from `origin`."""
        a, b = self.line
        if self.limit_rad is None or b <= 0:
            return None
        ends = _fieller_days(self.line, self.covariance, self.quantile, self.limit_rad)
        return (self.limit_rad - a) / b, *ends

    @property
    def crossing(self) -> pd.Timestamp | None:
        """When the line reaches the limit, if that is within a century."""
        return _date(self.origin, self.crossing_days[0]) if self.crossing_days else None

    @property
    def crossing_interval(self) -> tuple[pd.Timestamp | None, ...] | None:
        """Interval of the crossing; None: no end in a century."""
        days = self.crossing_days
        return days and tuple(_date(self.origin, end) for end in days[1:])

    @property
    def shown_in(self) -> tuple[float, str]:
        """What values are multiplied by to be shown, and the unit that they have then."""
        return (1.0, "% of the first") if self.is_relative else (1e3, "mrad")

    def to_dict(self) -> dict[str, object]:
        """The points, growth and crossing, ready for JSON; keys say the unit."""
        name, unit = ("relative_index", "percent") if self.is_relative else ("backlash", "rad")
        points = [
            {
                "file": row.file,
                "date": _day(row.date),
                f"{name}_{unit}": row.value,
                f"{name}_interval_{unit}": [row.low, row.high],
            }
            for row in self.points.itertuples()
        ]
        return {
            "points": points,
            f"growth_{unit}_per_day": self.line[1],
            f"growth_interval_{unit}_per_day": list(self.growth_interval),
            "limit_rad": self.limit_rad,
            "crossing_date": _day(self.crossing),
            "crossing_interval": self.crossing_interval
            and [_day(end) for end in self.crossing_interval],
            "confidence": CONFIDENCE,
            "warnings": list(self.warnings),
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
        growth, low, high = (
            scale * 365.25 * rate for rate in (self.line[1], *self.growth_interval)
        )
        sure = "; alarm: it grows" if self.alarm else ""
        lines.append(f"growth {growth:.3f} {unit} a year (95 %: {low:.3f} to {high:.3f}){sure}")
        if self.limit_rad is not None and self.crossing is not None:
            first, last = (_day(end) or "no date" for end in self.crossing_interval or (None, None))
            crossed = f"{1e3 * self.limit_rad:.3f} mrad crossed on {self.crossing:%Y-%m-%d}"
            lines.append(f"{crossed} (95 %: {first} to {last})")
        return "\n".join([*lines, *(f"note: {one_line(warning)}" for warning in self.warnings)])

    @property
    def growth_interval(self) -> tuple[float, float]:
        """Interval of the growth per day."""
        half = self.quantile * float(np.sqrt(self.covariance[1, 1]))
        return self.line[1] - half, self.line[1] + half

    def band(self, days: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The line at days from `origin`, and half the width of its confidence band."""
        a, b = self.line
        (of_a, shared), (_, of_b) = self.covariance
        variance = np.polyval([of_b, 2 * shared, of_a], days)
        return a + b * days, self.quantile * np.sqrt(np.maximum(variance, 0.0))


def trend(
    logs: Sequence[object],
    dates: Sequence[Any] | str | PathLike[str] | None = None,
    *,
    limit_rad: float | None = None,
    relative: bool = False,
    jobs: int = 1,
    **given: Unpack[Given],
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
    answers = dict(batch.run_batch(batch.read_batch(logs, given), jobs))
    table = batch.as_table([answers[number] for number in sorted(answers)])
    return fit_trend(table, days, limit_rad, relative)


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
    known = {}
    if table:
        dated = read_rows(table, "file", "date")
        known = dict(zip(dated["file"], dated["date"], strict=True))
    found = []
    for file in files:
        date = known.get(file.name, known.get(str(file)))
        match = _DATE.search(file.stem)
        if match and table is None:
            date = pd.to_datetime("-".join(match.groups()), errors="coerce")
        if pd.isna(date):
            where = f"in {table}" if table else "in its name (like 2024-03-17); give --dates"
            raise Refusal(f"{file}: no date {where}")
        found.append(date)
    return found


def fit_trend(
    answers: pd.DataFrame,
    dates: Sequence[pd.Timestamp] | pd.Series,
    limit_rad: float | None = None,
    relative: bool = False,
) -> Trend:
    """Fit a line to dated backlashes in a table of answers; to amplitudes if `relative`, or if no log has an answer."""
    if limit_rad is not None and not (is_positive(limit_rad) and limit_rad <= MOST_RAD):
        raise Refusal(
            f"--limit {limit_rad!r}: give a backlash above 0, at most {MOST_RAD:g} [rad]; 1 mrad is 0.001"
        )
    relative = relative or bool((answers["verdict"] == "cannot tell").all())
    points = _points(answers.assign(date=list(dates)), relative)
    warnings = _left_out(points, answers)
    if relative:
        warnings.append(
            "relative: the oscillation's amplitude in percent of the first log's, not the backlash"
        )
        if limit_rad is not None:
            warnings.append("a limit in rad says nothing of a relative trend")
        limit_rad = None
    trend, is_curved = _line_through(points, limit_rad, relative)
    if is_curved:
        warnings.append("the growth is no straight line: the date of the crossing may be far off")
    days = (points["date"] - trend.origin).dt.total_seconds().to_numpy() / 86400
    return replace(trend, warnings=(*warnings, *_notes_on_crossing(trend, days)))


def growth_over_time(trend: Trend) -> pd.DataFrame:
    """Growth per day that the logs up to each date told, and its interval: `date, growth, low, high`."""
    rows = []
    for count in range(_LEAST_DATES, len(trend.points) + 1):
        points = trend.points.iloc[:count]
        if points["date"].nunique() >= _LEAST_DATES:
            known, _ = _line_through(points, None, trend.is_relative)
            rows.append((points["date"].iloc[-1], known.line[1], *known.growth_interval))
    return pd.DataFrame(rows, columns=["date", "growth", "low", "high"])


def _line_through(
    points: pd.DataFrame, limit_rad: float | None, relative: bool
) -> tuple[Trend, bool]:
    """The line through dated points, and whether a parabola is clearly better."""
    delta = points["value"].to_numpy()
    deviation = (points["high"] - points["low"]).to_numpy() / 2 / ndtri((1 + CONFIDENCE) / 2)
    weight = 1 / np.maximum(deviation, 1e-3 * delta.max()) ** 2
    since = (points["date"] - points["date"].iloc[0]).dt.total_seconds().to_numpy() / 86400
    middle = float(weight @ since / weight.sum())
    days = since - middle
    # Of the growth since the first log: equal estimates then have a slope of zero, to the last
    # digit.
    (growth, offset), covariance = np.polyfit(
        days, delta - delta[0], 1, w=np.sqrt(weight), cov="unscaled"
    )
    line = float(delta[0] + offset), float(growth)
    chi2 = float(weight @ (delta - line[0] - line[1] * days) ** 2)
    freedom = delta.size - 2
    trend = Trend(
        points=points,
        origin=points["date"].iloc[0] + pd.Timedelta(days=middle),
        line=line,
        covariance=covariance[::-1, ::-1] * max(1.0, chi2 / freedom),
        quantile=float(stdtrit(freedom, (1 + CONFIDENCE) / 2)),
        limit_rad=limit_rad,
        warnings=(),
        is_relative=relative,
    )
    return trend, freedom > 2 and _is_curved(days, delta, weight, chi2)


def _left_out(points: pd.DataFrame, answers: pd.DataFrame) -> list[str]:
    """Say which logs have no point; refuse too few dates."""
    count = points["date"].nunique()
    without = answers[~answers["file"].isin(points["file"])]
    notes = [f"{row.file}: {row.reason or row.verdict}" for row in without.itertuples()]
    if count < _LEAST_DATES:
        few = f"{count} dates with an estimate; a trend needs {_LEAST_DATES} or more"
        raise Refusal("; ".join([few, *notes[:1]]))
    return [f"{len(notes)} of {len(answers)} logs are left out", *notes] if notes else []


def _notes_on_crossing(trend: Trend, days: FloatArray) -> Iterator[str]:
    if trend.crossing_days:
        when, *ends = trend.crossing_days
        if None in ends:
            yield "the growth is not sure: the interval of the crossing is open"
        if when > days.max() + np.ptp(days):
            yield "the crossing lies further ahead than the logs go back"
    elif trend.limit_rad is not None:
        yield "the backlash does not grow: no crossing"


def _points(answers: pd.DataFrame, relative: bool) -> pd.DataFrame:
    """Dated backlashes [rad], or amplitudes in percent of the first, by date."""
    name, unit = ("amplitude", "rps") if relative else ("backlash", "rad")
    columns = ["date", "file", f"{name}_{unit}", f"{name}_low_{unit}", f"{name}_high_{unit}"]
    used = answers[(answers[columns[2]] > 0) & answers[columns].notna().all(axis=1)]
    used = used.sort_values(["date", "file"], ignore_index=True)
    for name, unit in (("turn_period_s", "s a turn"), ("speed_rps", "rps")):
        values = used[name]
        if relative and values.max() > (1 + MISMATCH) * values.min():
            other = used["file"][(values / values.median() - 1).abs().idxmax()]
            what = f"{values.min():.4g} to {values.max():.4g} {unit}, {other} unlike the others"
            raise Refusal(f"{what}: amplitudes are only comparable between logs of one movement")
    points = used[columns].set_axis(["date", "file", "value", "low", "high"], axis=1)
    if relative and len(points):
        points[["value", "low", "high"]] *= 100 / points["value"].iloc[0]
    return points


def _is_curved(days: FloatArray, delta: FloatArray, weight: FloatArray, chi2: float) -> bool:
    """Whether a parabola is better than the line, by an F test at 5 %."""
    scaled = days / np.abs(days).max()
    if np.unique(scaled).size < 4:
        return False
    parabola = np.polyfit(scaled, delta, 2, w=np.sqrt(weight))
    curved = float(weight @ (delta - np.polyval(parabola, scaled)) ** 2)
    freedom = delta.size - 3
    return (chi2 - curved) / max(curved / freedom, 1.0) > fdtri(1, freedom, 0.95)


def _fieller_days(
    line: tuple[float, float], covariance: FloatArray, quantile: float, limit: float
) -> tuple[float | None, float | None]:
    """Fieller's interval of a growing line's crossing, in days from the origin; None for an open end."""
    (a, b), q2 = line, quantile**2
    # The band holds the limit where square t^2 + 2 half t + constant <= 0.
    square = b**2 - q2 * covariance[1, 1]
    half = b * (a - limit) - q2 * covariance[0, 1]
    constant = (a - limit) ** 2 - q2 * covariance[0, 0]
    if square == 0 or (square < 0 and constant <= 0):
        return None, None
    root = np.sqrt(max(half**2 - square * constant, 0.0))
    early, late = sorted([float((-half - root) / square), float((-half + root) / square)])
    if square > 0:
        return early, late
    return (late, None) if a < limit else (None, early)


def _date(origin: pd.Timestamp, days: float | None) -> pd.Timestamp | None:
    return None if days is None or abs(days) > _DAYS_AHEAD else origin + pd.Timedelta(days=days)


def _day(stamp: pd.Timestamp | None) -> str | None:
    return None if stamp is None else stamp.strftime("%Y-%m-%d")
