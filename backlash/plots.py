"""Plots of the virtual sensor's answers: arrays in, a matplotlib figure out."""

from collections.abc import Callable
from functools import wraps
from io import BytesIO
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from backlash.estimates import Estimate
from backlash.refusals import one_line
from backlash.trends import Trend, growth_over_time
from replication.records import write_bytes

_SHOWN_TURNS = 3
_STYLE = Path(__file__).with_name("data") / "plots.mplstyle"
# By ending, stamps that would make each file another; None leaves them out.
STAMPS: dict[str, dict[str, None]] = {
    ".png": {},
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
}


def in_style(plot: Callable[..., Figure]) -> Callable[..., Figure]:
    """Draw a figure in the sensor's style, leaving matplotlib's settings alone."""

    @wraps(plot)
    def styled(*args) -> Figure:
        with plt.style.context(_STYLE, after_reset=True):
            figure = plot(*args)
            interactive = mpl.is_interactive()
        # A notebook's backend switches this on with its first figure; switched back, no other
        # figure would be shown.
        mpl.interactive(interactive)
        return figure

    return styled


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure whole or not at all, the same bytes each time; it is closed."""
    content, ending = BytesIO(), path.suffix.lower()
    with plt.style.context(_STYLE, after_reset=True):
        figure.savefig(content, format=ending[1:], metadata=STAMPS[ending])
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
    above.set(xlim=(middle - half, middle + half), title=f"(a) {one_line(answer.summary)}")
    above.set(xlabel="time [s]", ylabel=trace.signal)
    reach = np.ptp(trace.measured) / 2
    below.plot(t, trace.measured - trace.model, color="C1", linewidth=0.7)
    below.set(xlim=(0, t[-1]), ylim=(-reach, reach), title="(b) on the same scale")
    below.set(xlabel="time [s]", ylabel=f"residual {trace.signal[trace.signal.find('[') :]}")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def _draw_alarms(axis: Axes, trend: Trend) -> None:
    """Draw the growth that the logs up to each date told; it is an alarm where its interval is above zero."""
    told = growth_over_time(trend)
    scale, unit = trend.shown_in
    growth, low, high = (
        365.25 * scale * told[name].to_numpy() for name in ("growth", "low", "high")
    )
    for is_alarm, color, label in ((False, "0.5", "no alarm"), (True, "C3", "alarm")):
        of = (low > 0) == is_alarm
        ends = np.array([growth - low, high - growth])[:, of]
        axis.errorbar(
            told["date"][of], growth[of], ends, fmt="o", color=color, markersize=4, label=label
        )
    axis.axhline(0, color="black", linewidth=0.7)
    top = max(2 * np.abs(growth).max(), 1e-9)
    axis.set_ylim(-top / 2, top)
    axis.set(ylabel=f"growth [{unit} a year]")


@in_style
def trend_figure(trend: Trend) -> Figure:
    """Show dated estimates with the line through them and the limit, and below when the growth was an alarm."""
    figure, (axis, below) = plt.subplots(2, figsize=(5.3, 5.0), height_ratios=(3, 2), sharex=True)
    _draw_alarms(below, trend)
    points = trend.points
    scale, unit = trend.shown_in
    delta = scale * points["value"].to_numpy()
    ends = np.abs(scale * points[["low", "high"]].to_numpy().T - delta)
    axis.errorbar(
        points["date"],
        delta,
        ends,
        fmt="o",
        color="black",
        markersize=4,
        capsize=3,
        label="estimate, 95 %",
    )
    since = (points["date"] - trend.origin).dt.total_seconds().to_numpy() / 86400
    last, length = since[-1], np.ptp(since)
    if trend.crossing_days:
        ahead = trend.crossing_days[0] + 0.15 * length
        last = max(last, min(ahead, last + 2 * length))
    days = np.linspace(since[0], last, 200)
    line, half = trend.band(days)
    dates = trend.origin + np.round(days * 86400).astype("timedelta64[s]")
    axis.plot(dates, scale * line, color="C0", label="line")
    ends = scale * (line - half), scale * (line + half)
    axis.fill_between(dates, *ends, color="C0", alpha=0.15, lw=0, label="its 95 %")
    if trend.limit_rad is not None:
        axis.axhline(1e3 * trend.limit_rad, color="C3", linestyle="--", label="limit")
        first, after = trend.crossing_interval or (None, None)
        if first is not None:
            last_drawn = min(after or dates[-1], dates[-1])
            axis.axvspan(first, last_drawn, color="C3", alpha=0.12, lw=0, label="crossing, 95 %")
    name = "amplitude" if trend.is_relative else "backlash $\\delta$"
    axis.margins(x=0.03)
    axis.set(ylabel=f"{name} [{unit}]", ylim=(0, None))
    figure.legend(loc="outside lower center", ncols=3)
    return figure
