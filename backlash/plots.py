"""Plots of the virtual sensor's answers: arrays in, a matplotlib figure out."""

from io import BytesIO
from pathlib import Path
from textwrap import fill

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import pyplot as plt
from matplotlib.dates import ConciseDateFormatter
from matplotlib.figure import Figure

from backlash.estimates import Estimate
from backlash.refusals import one_line
from backlash.trends import Trend, days_since
from replication.figures import STYLE, in_style
from replication.files import write_bytes

_SHOWN_TURNS = 3
_TITLE_LETTERS = 70  # in a line
# Dates would make each file another.
_UNDATED: dict[str, dict[str, None]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure whole or not at all, the same bytes each time; it is closed."""
    content, ending = BytesIO(), path.suffix.lower()
    with mpl.rc_context(STYLE):
        figure.savefig(content, format=ending[1:], metadata=_UNDATED.get(ending))
    plt.close(figure)
    write_bytes(path, content.getvalue())


@in_style
def estimate_figure(answer: Estimate) -> Figure:
    """Show three turns in the middle of a log as measured and by the model, and what the model leaves of the whole log.

    By the torque that is the torque, else the motor's speed.
    """
    trace = answer.trace
    if trace is None:
        raise ValueError(f"{answer.file}: there is no fit to show")
    figure, (above, below) = plt.subplots(2, figsize=(5.3, 4.4), height_ratios=(3, 2))
    t = trace.t - trace.t[0]
    middle = t[-1] / 2
    half = min(_SHOWN_TURNS * (answer.turn_period_s or t[-1]), t[-1]) / 2
    above.plot(t, trace.measured, color="0.55", linewidth=0.9, label="measured")
    above.plot(t, trace.model, color="C0", linewidth=1.4, label="model")
    title = fill(f"(a) {one_line(answer.summary)}", _TITLE_LETTERS)
    above.set(xlim=(middle - half, middle + half), title=title)
    above.set(xlabel="time [s]", ylabel=trace.signal)
    reach = np.ptp(trace.measured) / 2
    below.plot(t, trace.measured - trace.model, color="C1", linewidth=0.7)
    below.set(xlim=(0, t[-1]), ylim=(-reach, reach), title="(b) on the same scale")
    below.set(xlabel="time [s]", ylabel=f"residual {trace.signal[trace.signal.find('[') :]}")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


@in_style
def trend_figure(trend: Trend) -> Figure:
    """Show dated estimates with the line through them, and when it crosses the limit."""
    figure, axis = plt.subplots(figsize=(5.3, 3.4))
    points = trend.points
    scale, unit = trend.shown_in
    value, low, high = (scale * points[name] for name in ("value", "low", "high"))
    axis.errorbar(
        points["date"], value, [value - low, high - value], fmt="ko", label="estimate, 95 %"
    )
    since = days_since(points["date"], trend.origin)
    last = since[-1]
    if trend.crossing:
        ahead = (trend.crossing - trend.origin).days + 0.15 * np.ptp(since)
        last = np.clip(ahead, last, last + 2 * np.ptp(since))
    days = np.linspace(since[0], last, 200)
    line, half = trend.band(days)
    dates = trend.origin + pd.to_timedelta(days, unit="D")
    axis.plot(dates, scale * line, color="C0", label="line")
    band = scale * (line - half), scale * (line + half)
    axis.fill_between(dates, *band, color="C0", alpha=0.15, lw=0, label="its 95 %")
    if trend.limit_rad is not None:
        axis.axhline(scale * trend.limit_rad, color="C3", linestyle="--", label="limit")
        first, after = trend.crossing_interval
        if first and after:
            after = min(after, dates[-1])
            axis.axvspan(first, after, color="C3", alpha=0.12, lw=0, label="crossing, 95 %")
    name = "amplitude" if trend.is_relative else "backlash $\\delta$"
    axis.margins(x=0.03)
    axis.set(ylabel=f"{name} [{unit}]", ylim=(0, None))
    axis.xaxis.set_major_formatter(ConciseDateFormatter(axis.xaxis.get_major_locator()))
    figure.legend(loc="outside lower center", ncols=3)
    return figure
