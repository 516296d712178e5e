"""Plots of what goes past the paper: data frames and arrays in, a matplotlib figure out."""

import textwrap
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from pandas import DataFrame
from scipy import stats

from replication.figures import BACKLASH_LABEL, BLUE, INK, ORANGE, THIN, finish, grid, in_style
from studies.population import NORMAL_95


@in_style
def cross_validation_errors(table: DataFrame, bounds_rad: Mapping[str, float]) -> Figure:
    """Show each method's errors on the logs and their mean size, and the least mean size that there can be."""
    figure, ((axis,),) = grid(height_in=3.8)
    sizes = table.assign(size=1e6 * table["error_rad"].abs())
    axis.plot(sizes["size"], sizes["method"], "o", color=BLUE, alpha=0.7, label="a log")
    means = sizes.groupby("method", sort=False)["size"].mean()
    axis.plot(means, means.index, "|", color=INK, markersize=18, mew=2, label="mean size")
    for (name, bound), line in zip(bounds_rad.items(), ("--", "-"), strict=True):
        axis.axvline(1e6 * bound, color=INK, linewidth=1, linestyle=line, label=name)
    axis.set(xscale="log", xlabel="size of the error of the backlash [$10^{-6}$ rad]")
    axis.invert_yaxis()
    return finish(figure, 4)


@in_style
def population_errors(rows: DataFrame, populations: Mapping[str, str]) -> Figure:
    """Error of method "self" over the true backlash, its stated size, and how often it is how many stated SDs."""
    rows_shown = len(populations)
    figure, axes = grid(rows_shown, 2, 2.5 * rows_shown, width_ratios=(3, 2), sharex="col")
    around = np.linspace(-4, 4, 17)
    answered = rows.query("method == 'self' and not refused")
    for (left, right), (population, title) in zip(axes, populations.items(), strict=True):
        part = answered[answered["population"] == population]
        delta, found, high = (1e3 * part[f"{name}_rad"] for name in ("delta", "found", "high"))
        error, half = found - delta, high - found
        held = error.abs() <= half
        left.plot(delta[held], error[held], ".", color="0.65", label="truth in the 95 % interval")
        left.plot(delta[~held], error[~held], "x", color=ORANGE, label="truth outside")
        edges = np.linspace(delta.min(), delta.max(), 7)
        place = np.digitize(delta, edges[1:-1])
        rms = np.sqrt((error**2).groupby(place).mean())
        stated = half.groupby(place).median()
        for size, colour, label in ((rms, BLUE, "RMS error"), (stated, INK, "median half-width")):
            left.stairs(size, edges, baseline=None, color=colour, label=label)
            left.stairs(-size, edges, baseline=None, color=colour)
        left.axhline(0, **THIN)
        title = textwrap.fill(f"{title}, n = {len(part)}", 36)
        left.set(ylabel="error [mrad]", title=title)
        right.hist((NORMAL_95 * error / half).clip(-4, 4), around, color="0.75", label="logs")
        expected = len(part) * np.diff(stats.norm.cdf(around))
        middles = (around[1:] + around[:-1]) / 2
        right.plot(middles, expected, ".-", color=BLUE, label="normal distribution")
        right.set(ylabel="number of logs [-]")
    axes[-1, 0].set_xlabel(f"true {BACKLASH_LABEL}")
    axes[-1, 1].set_xlabel("error over stated SD [-]")
    return finish(figure, 3)
