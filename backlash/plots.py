"""Plots of the virtual sensor's answers: arrays in, a matplotlib figure out."""

import numpy as np
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from backlash.trend_line import Trend
from replication.arrays import FloatArray
from replication.figures.style import BLUE, INK, ORANGE, PINK, finish, grid, in_style
from replication.recording import Recording

_SHOWN_TURNS = 3


@in_style
def estimate_figure(recording: Recording, model_rps: FloatArray, title: str) -> Figure:
    """Show three turns in the middle of a record with the fitted model [rps], and the residual of the whole record."""
    figure, axes = grid(2, 1, height_in=4.4, height_ratios=(3, 2))
    t, disturbance = recording.t - recording.t[0], recording.v - recording.v.mean()
    model = model_rps - model_rps.mean()
    middle, half = t[-1] / 2, min(_SHOWN_TURNS * recording.turn_period_s, t[-1]) / 2
    axes[0, 0].plot(t, disturbance, color="0.55", linewidth=0.9, label="record, less its mean")
    axes[0, 0].plot(t, model, color=BLUE, linewidth=1.4, label="fitted model")
    top = 1.05 * max(np.abs(disturbance).max(), 1e-9)
    axes[0, 0].set(xlim=(middle - half, middle + half), ylim=(-top, top), title=title)
    axes[0, 0].set(xlabel="time [s]", ylabel="motor speed [rps]")
    axes[1, 0].plot(t, disturbance - model, color=ORANGE, linewidth=0.7)
    axes[1, 0].set(xlim=(0, t[-1]), ylim=(-top, top), xlabel="time [s]", ylabel="residual [rps]")
    return finish(figure, 2)


@in_style
def trend_figure(trend: Trend) -> Figure:
    """Show dated estimates with their intervals, the line through them with its band, and the limit."""
    figure, axes = grid(height_in=3.6)
    axis, points = axes[0, 0], trend.points
    scale, unit = trend.shown_in
    delta = scale * points["value"].to_numpy()
    ends = np.abs(scale * points[["low", "high"]].to_numpy().T - delta)
    axis.errorbar(points["date"], delta, ends, fmt="o", color=INK, markersize=4, capsize=3, label="estimate, 95 %")
    since = (points["date"] - trend.origin).dt.total_seconds().to_numpy() / 86400
    last = since[-1]
    if trend.crossing is not None:
        crossing = (trend.crossing - trend.origin).total_seconds() / 86400
        last = max(last, min(crossing + 0.15 * np.ptp(since), since[-1] + 2 * np.ptp(since)))
    days = np.linspace(since[0], last, 200)
    line, half = trend.band(days)
    dates = trend.origin + np.round(days * 86400).astype("timedelta64[s]")
    axis.plot(dates, scale * line, color=BLUE, label="line")
    low, high = scale * (line - half), scale * (line + half)
    axis.fill_between(dates, low, high, color=BLUE, alpha=0.15, lw=0, label="its 95 %")
    if trend.limit_rad is not None:
        axis.axhline(1e3 * trend.limit_rad, color=PINK, linestyle="--", label="limit")
        first, after = trend.crossing_interval or (None, None)
        if first is not None:
            last_drawn = min(after or dates[-1], dates[-1])
            axis.axvspan(first, last_drawn, color=PINK, alpha=0.12, lw=0, label="crossing, 95 %")
    locator = AutoDateLocator()
    axis.xaxis.set_major_locator(locator)
    axis.xaxis.set_major_formatter(ConciseDateFormatter(locator))
    name = "amplitude" if trend.is_relative else "backlash $\\delta$"
    axis.set(ylabel=f"{name} [{unit}]", xlim=(dates[0] - (dates[-1] - dates[0]) * 0.03, dates[-1]))
    axis.set_ylim(bottom=0)
    return finish(figure, 3)
