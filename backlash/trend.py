"""Backlash over time from dated logs, and the date at which it crosses a limit.

The line through the dated estimates is weighted by their intervals, widened where they scatter more. The crossing's
interval is that of Fieller's theorem: the dates at which the line's confidence band holds the limit.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.special import fdtri, ndtri, stdtrit

from backlash.estimation import Estimate
from backlash.reading.tables import UnusableLog
from replication.arrays import FloatArray

CONFIDENCE = 0.95
_LEAST_DATES = 3
_DATE = re.compile(r"(?<!\d)(\d{4})[-_.]?(\d{2})[-_.]?(\d{2})(?!\d)")
_DAYS_AHEAD = 36525  # a century; further off, a date says nothing


@dataclass(frozen=True)
class Trend:
    """A line through dated estimates of backlash."""

    points: pd.DataFrame  # `date, file, backlash_rad, low_rad, high_rad`, by date
    origin: pd.Timestamp  # the line's time zero, the weighted mean date
    line_rad: tuple[float, float]  # backlash at `origin` [rad], and its growth [rad/day]
    covariance: FloatArray  # of the two
    quantile: float  # of the t distribution, for two-sided intervals at `CONFIDENCE`
    limit_rad: float | None
    crossing: pd.Timestamp | None  # when the line reaches the limit
    crossing_interval: tuple[pd.Timestamp | None, pd.Timestamp | None] | None  # None: no end in a century
    warnings: tuple[str, ...]

    @property
    def growth_interval(self) -> tuple[float, float]:
        """Interval of the growth [rad/day]."""
        half = self.quantile * float(np.sqrt(self.covariance[1, 1]))
        return self.line_rad[1] - half, self.line_rad[1] + half

    def band(self, days: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The line [rad] at days from `origin`, and half the width of its confidence band."""
        a, b = self.line_rad
        variance = self.covariance[0, 0] + 2 * days * self.covariance[0, 1] + days**2 * self.covariance[1, 1]
        return a + b * days, self.quantile * np.sqrt(np.maximum(variance, 0.0))


def dates_of(files: Sequence[Path], table: Path | None = None) -> dict[Path, pd.Timestamp]:
    """Date of each log, by the table's columns `file` and `date`, else by its name, as in `axis4_2024-03-17.csv`."""
    known = _dates_in(table) if table else {}
    found = {}
    for file in files:
        date = known.get(file.name, known.get(str(file)))
        match = _DATE.search(file.stem)
        if date is None and match and table is None:
            date = pd.to_datetime("-".join(match.groups()), errors="coerce")
        if date is None or pd.isna(date):
            where = f"in {table}" if table else "in its name (like 2024-03-17); give --dates"
            raise UnusableLog(f"{file}: no date {where}")
        found[file] = date
    return found


def _dates_in(table: Path) -> dict[str, pd.Timestamp]:
    try:
        frame = pd.read_csv(table, dtype=str)
        dates = pd.to_datetime(frame["date"], format="ISO8601", utc=True).dt.tz_localize(None)
        return dict(zip(frame["file"], dates, strict=True))
    except (OSError, ValueError, KeyError) as error:
        raise UnusableLog(f"{table}: no table with columns file and date ({error}); dates like 2024-03-17") from error


def fit_trend(answers: Sequence[Estimate], dates: Sequence[pd.Timestamp], limit_rad: float | None = None) -> Trend:
    """Fit a line to dated estimates.

    Parameters
    ----------
    answers, dates : sequence of Estimate, sequence of Timestamp
        Those without a backlash do not count.
    limit_rad : float, optional
        The backlash whose date is wanted [rad].

    Raises
    ------
    UnusableLog
        Fewer than three estimates at different dates, or no finite limit above zero.
    """
    if limit_rad is not None and not (np.isfinite(limit_rad) and limit_rad > 0):
        raise UnusableLog(f"--limit {limit_rad:g}: give a finite backlash above 0 [rad]")
    found = [
        (date, answer.file, answer.backlash_rad, *(answer.backlash_interval_rad or ()))
        for answer, date in zip(answers, dates, strict=True)
        if answer.verdict == "backlash"
    ]
    points = pd.DataFrame(found, columns=["date", "file", "backlash_rad", "low_rad", "high_rad"])
    points = points.sort_values(["date", "file"], ignore_index=True)
    count, left_out = points["date"].nunique(), len(answers) - len(points)
    if count < _LEAST_DATES:
        raise UnusableLog(f"{count} dates with an estimate of backlash; a trend needs {_LEAST_DATES} or more")
    warnings = [f"{left_out} of {len(answers)} logs have no backlash to go by: left out"] if left_out else []
    delta = points["backlash_rad"].to_numpy()
    deviation = (points["high_rad"] - points["low_rad"]).to_numpy() / 2 / ndtri((1 + CONFIDENCE) / 2)
    weight = 1 / np.maximum(deviation, 1e-3 * delta.max()) ** 2
    since = (points["date"] - points["date"].iloc[0]).dt.total_seconds().to_numpy() / 86400
    middle = float(weight @ since / weight.sum())
    days = since - middle
    # Of the growth since the first log: equal estimates then have a slope of zero, to the last digit.
    (growth, offset), covariance = np.polyfit(days, delta - delta[0], 1, w=np.sqrt(weight), cov="unscaled")
    line, covariance = (delta[0] + offset, growth), covariance[::-1, ::-1]
    chi2 = float(weight @ (delta - line[0] - line[1] * days) ** 2)
    freedom = delta.size - 2
    covariance = covariance * max(1.0, chi2 / freedom)
    if freedom > 2 and _is_curved(days, delta, weight, chi2):
        warnings.append("the growth is no straight line: the date of the crossing may be far off")
    quantile = float(stdtrit(freedom, (1 + CONFIDENCE) / 2))
    origin = points["date"].iloc[0] + pd.Timedelta(days=middle)
    crossing = interval = None
    if limit_rad is not None and line[1] <= 0:
        warnings.append("the backlash does not grow: no crossing")
    elif limit_rad is not None:
        when = float((limit_rad - line[0]) / line[1])
        ends = _fieller_days(line, covariance, quantile, limit_rad)
        crossing, first, last = (_date(origin, day) for day in (when, *ends))
        interval = first, last
        if None in ends:
            warnings.append("the growth is not sure: the interval of the crossing is open")
        if when > days.max() + np.ptp(days):
            warnings.append("the crossing lies further ahead than the logs go back")
    a, b = (float(part) for part in line)
    return Trend(points, origin, (a, b), covariance, quantile, limit_rad, crossing, interval, tuple(warnings))


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


def as_object(trend: Trend) -> dict:
    """A trend as an object for JSON."""
    points = [
        {"file": row.file, "date": _day(row.date), "backlash_rad": row.backlash_rad,
         "backlash_interval_rad": [row.low_rad, row.high_rad]}
        for row in trend.points.itertuples()
    ]  # fmt: skip
    return {
        "points": points,
        "growth_rad_per_day": trend.line_rad[1],
        "growth_interval_rad_per_day": list(trend.growth_interval),
        "limit_rad": trend.limit_rad,
        "crossing_date": _day(trend.crossing),
        "crossing_interval": trend.crossing_interval and [_day(end) for end in trend.crossing_interval],
        "confidence": CONFIDENCE,
        "warnings": list(trend.warnings),
    }


def as_text(trend: Trend) -> str:
    """A trend for people."""
    lines = [
        f"{row.date:%Y-%m-%d}  {1e3 * row.backlash_rad:.3f} mrad ({1e3 * row.low_rad:.3f} to {1e3 * row.high_rad:.3f})"
        f"  {row.file}"
        for row in trend.points.itertuples()
    ]
    growth, low, high = (1e3 * 365.25 * rate for rate in (trend.line_rad[1], *trend.growth_interval))
    lines.append(f"growth {growth:.3f} mrad a year (95 %: {low:.3f} to {high:.3f})")
    if trend.limit_rad is not None and trend.crossing is not None:
        first, last = (_day(end) or "no date" for end in trend.crossing_interval or (None, None))
        lines.append(f"{1e3 * trend.limit_rad:.3f} mrad crossed on {trend.crossing:%Y-%m-%d} (95 %: {first} to {last})")
    return "\n".join([*lines, *(f"note: {warning}" for warning in trend.warnings)])
