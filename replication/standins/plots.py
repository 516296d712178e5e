"""Plots of the stand-ins for the bench and the robots: data frames in, a matplotlib figure out."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from replication.figures.style import BLUE, GREEN, INK, ORANGE, PINK, PRINTED, SKY, in_style

MARKERS = "osv^D"
COLOURS = (BLUE, ORANGE, GREEN, PINK, SKY)


@in_style
def table3(table: pd.DataFrame, population: pd.DataFrame) -> Figure:
    """Show Table 3: the stand-in's mean and SD, the printed ones, the known A, and what other benches give."""
    figure, axis = plt.subplots(figsize=(7.5, 4.5))
    delta = 1e4 * table["delta_rad"].to_numpy()
    style: dict[str, Any] = {"linestyle": "none", "capsize": 3, "marker": "s", "color": BLUE}
    others, label = 1e4 * population["delta_rad"] - 0.12, "other benches of the same spread, global fit"
    axis.plot(others, population["A_rps"], "o", color="0.6", mfc="none", markersize=4, label=label)
    axis.errorbar(delta, table["mean_A_rps"], table["sd_A_rps"], label="the stand-in bench", **style)
    axis.plot(delta, table["best_A_rps"], "_", color=BLUE, markersize=14, label="its best basin")
    printed = table["printed_mean_A_rps"], table["printed_sd_A_rps"]
    axis.errorbar(delta + 0.12, *printed, capsize=3, elinewidth=1, **PRINTED | {"label": "printed mean, SD of runs"})
    axis.plot(delta + 0.12, table["printed_known_A_rps"], "+", color=ORANGE, markersize=10, label="printed known A")
    axis.set(xlabel="backlash $\\delta$ [1e-4 rad]", ylabel="A [rps], mean $\\pm$ SD of the runs", xticks=delta)
    axis.set_xlim(delta.min() - 0.4, delta.max() + 0.4)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    return figure


@in_style
def load_friction(study: pd.DataFrame) -> Figure:
    """Show how the fitted A falls as Coulomb friction on the load grows."""
    figure, axis = plt.subplots(figsize=(6.5, 3.6))
    axis.plot(100 * study["friction_share"], study["change_percent"], "o-", color=BLUE)
    axis.axhline(0, color=INK, linewidth=0.8)
    axis.set(xlabel="friction on the load, share of m g r [%]", ylabel="fitted A against no friction [%]")
    return figure


@in_style
def robots(population: pd.DataFrame, curves: Mapping[str, tuple[pd.DataFrame, float]], marks: pd.DataFrame) -> Figure:
    """Show A of healthy robots and of those with excessive backlash, and the ROC curve of a threshold on A."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.5, 4.6), width_ratios=(3, 2))
    edges = np.linspace(0, 1.02 * population["A_rps"].max(), 40)
    kinds = population.groupby("kind", sort=False)
    for (kind, part), colour, hatch in zip(kinds, (BLUE, ORANGE), ("//", ""), strict=True):
        style = {"color": colour, "alpha": 0.55, "hatch": hatch, "edgecolor": "white"}
        left.hist(part["A_rps"], edges, label=f"{kind}, {len(part)} robots", **style)
    for (label, (curve, area)), line, colour in zip(curves.items(), ("-", "--", ":"), (BLUE, PINK, PINK), strict=False):
        shares = 100 * curve["false_alarms"], 100 * curve["detected"]
        right.plot(*shares, line, color=colour, label=f"{label}, area {area:.3f}")
    for mark, marker, line in zip(marks.to_dict("records"), "xPD", (":", "-.", "-"), strict=False):
        label = f"{mark['name']}: {mark['threshold_rps']:.4f} rps"
        left.axvline(mark["threshold_rps"], color=INK, linestyle=line, linewidth=1.2, label=label)
        style = {"color": INK, "clip_on": False, "zorder": 3, "linestyle": "none", "label": mark["name"]}
        right.plot(100 * mark["false_alarms"], 100 * mark["detected"], marker, **style)
    left.set(xlabel="fitted A [rps]", ylabel="number of robots [-]")
    left.legend(fontsize=8)
    right.set(xlabel="healthy robots called excessive [%]", ylabel="excessive robots found [%]", ylim=(0, 102))
    right.legend(fontsize=8, loc="lower right")
    return figure


@in_style
def robots_disturbance(sweep: pd.DataFrame, thresholds: Mapping[str, float], turn_hz: float) -> Figure:
    """Show the A of a joint without backlash that a sinusoidal disturbance shakes."""
    figure, axis = plt.subplots(figsize=(9.0, 4.6))
    low, high = sweep["disturbance_hz"].min(), sweep["disturbance_hz"].max()
    odd = turn_hz * np.arange(1, high / turn_hz + 1, 2)
    for place, frequency in enumerate(odd[odd >= low]):
        label = "odd harmonics of the load's turn" if place == 0 else None
        axis.axvline(frequency, color="0.7", linewidth=4, alpha=0.5, label=label)
    for (share, part), colour, marker in zip(sweep.groupby("torque_share", sort=False), COLOURS, MARKERS, strict=False):
        heard = part["disturbance_rps"].max()
        label = f"{100 * share:.0f} % of m g r, up to {heard:.2f} rps in the log"
        axis.plot(part["disturbance_hz"], part["A_rps"], marker=marker, color=colour, markersize=4, lw=0.9, label=label)
        few = part[part["turns_used"] < 2]
        axis.plot(few["disturbance_hz"], few["A_rps"], marker, color=colour, markersize=4, mfc="white")
    axis.plot([], [], "o", color=INK, mfc="white", markersize=4, label="open: the fit uses less than two turns")
    for (name, amplitude), style in zip(thresholds.items(), ("--", "-."), strict=False):
        axis.axhline(amplitude, color=INK, linestyle=style, linewidth=1, label=name)
    axis.set(xlabel="frequency of the disturbance [Hz]", ylabel="fitted A of a joint without backlash [rps]")
    axis.set_ylim(0, None)
    figure.legend(loc="outside lower center", ncols=2, fontsize=8)
    return figure
