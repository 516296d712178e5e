"""Plots of the populations: data frames in, a matplotlib figure out."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from replication.figures.style import BLUE, INK, ORANGE, PINK, grid, in_style
from replication.studies.population import coverage_curve, ranks

_MILLI = 1e3


@in_style
def errors(rows: pd.DataFrame, populations: dict[str, str]) -> Figure:
    """Error of method "self" over the true backlash with its 95 % interval, a panel a population."""
    figure, axes = grid(1, len(populations), figsize=(5.0 * len(populations), 4.2))
    for axis, (population, title) in zip(axes[0], populations.items(), strict=True):
        part = rows[(rows["population"] == population) & (rows["method"] == "self") & ~rows["refused"]]
        error = _MILLI * (part["found_rad"] - part["delta_rad"])
        half = _MILLI * (part["high_rad"] - part["found_rad"])
        held = error.abs() <= half
        for kept, colour, label in ((held, BLUE, "interval holds the truth"), (~held, ORANGE, "does not")):
            axis.errorbar(
                _MILLI * part["delta_rad"][kept], error[kept], half[kept], fmt="o", markersize=3, linewidth=0.7,
                color=colour, label=f"{label} ({int(kept.sum())})",
            )  # fmt: skip
        axis.axhline(0, color=INK, linewidth=0.8)
        axis.set(xlabel="true backlash [mrad]", ylabel="error [mrad]", title=title)
        axis.legend(fontsize=8, frameon=True, framealpha=0.9)
    return figure


@in_style
def calibration(rows: pd.DataFrame, populations: dict[str, str]) -> Figure:
    """Ranks of the truth in the posterior, and coverage against the nominal level."""
    figure, axes = grid(1, 2, figsize=(10.0, 4.2))
    for (population, title), colour in zip(populations.items(), (BLUE, ORANGE, PINK), strict=False):
        part = rows[(rows["population"] == population) & (rows["method"] == "self")]
        axes[0, 0].hist(ranks(part), bins=10, range=(0, 1), histtype="step", density=True, color=colour, label=title)
        curve = coverage_curve(part)
        below, above = curve["coverage"] - curve["low"], curve["high"] - curve["coverage"]
        axes[0, 1].errorbar(
            curve["nominal"], curve["coverage"], [below, above], fmt="o-", markersize=3, color=colour, label=title
        )
    axes[0, 0].axhline(1, color=INK, linewidth=0.8)
    axes[0, 0].set(xlabel="rank of the truth in the posterior", ylabel="density")
    axes[0, 1].plot([0.5, 1], [0.5, 1], color=INK, linewidth=0.8)
    axes[0, 1].set(xlabel="nominal level", ylabel="share of intervals that hold")
    axes[0, 1].legend(fontsize=8)
    return figure


@in_style
def profile(rows: pd.DataFrame) -> Figure:
    """Signed root of chi squared over the backlash, and Laplace's approximation of it."""
    figure, axes = grid(1, 1, figsize=(6.0, 4.2))
    axis, delta = axes[0, 0], _MILLI * rows["delta_rad"]
    root = np.sign(rows["deviation"]) * np.sqrt(rows["chi2"].clip(lower=0))
    axis.plot(delta, rows["deviation"], color=INK, linewidth=0.8, label="Laplace's approximation")
    axis.plot(delta, root, "o-", markersize=3, color=BLUE, label="all else fitted anew")
    axis.set(xlabel="backlash [mrad]", ylabel="signed root of the gain in chi squared")
    axis.legend(fontsize=8)
    return figure
