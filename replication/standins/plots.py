"""Plots of the stand-ins for the bench and the robots: data frames in, a matplotlib figure out."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from replication.figures.style import BLUE, GREEN, INK, ORANGE, PINK, PRINTED, SKY, grid, in_style

MARKERS = "osv^D"
COLOURS = (BLUE, ORANGE, GREEN, PINK, SKY)


@in_style
def table3(table: pd.DataFrame, population: pd.DataFrame) -> Figure:
    """Show Table 3: the stand-in's mean and SD, the printed ones, the known A, and what other benches give."""
    figure, axes = grid(figsize=(7.5, 4.5))
    axis = axes[0, 0]
    delta = 1e4 * table["delta_rad"].to_numpy()
    style = {"linestyle": "none", "capsize": 3}
    axis.plot(
        1e4 * population["delta_rad"] - 0.12,
        population["A_rps"],
        "o",
        color="0.6",
        mfc="none",
        markersize=4,
        label="other benches of the same spread, global fit",
    )
    axis.errorbar(
        delta, table["mean_A_rps"], table["sd_A_rps"], marker="s", color=BLUE, label="the stand-in bench", **style
    )
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
    figure, axes = grid(figsize=(6.5, 3.6))
    axis = axes[0, 0]
    axis.plot(100 * study["friction_share"], study["change_percent"], "o-", color=BLUE)
    axis.axhline(0, color=INK, linewidth=0.8)
    axis.set(xlabel="friction on the load, share of m g r [%]", ylabel="fitted A against no friction [%]")
    return figure


@in_style
def wear(tests: pd.DataFrame, limit_rad: float) -> Figure:
    """Show one bench's eight months as each sensor reads them, and how all benches' calls lie to the truth."""
    figure, axes = grid(1, 2, figsize=(10.5, 4.4), width_ratios=(3, 2))
    left, right = axes[0]
    shown = tests[tests["bench"] == 0]
    truth = shown.drop_duplicates("day")
    left.plot(truth["day"], 1e4 * truth["delta_rad"], color=INK, label="true backlash")
    left.axhline(1e4 * limit_rad, color="0.5", linestyle="--", linewidth=1, label="limit")
    left.axvline(truth["truth_day"].iloc[0], color=INK, linestyle=":", linewidth=1)
    names = list(tests["sensor"].unique())
    for place, name in enumerate(names):
        part = shown[shown["sensor"] == name]
        middle = 1e4 * part["estimate_rad"].to_numpy()
        ends = np.abs(1e4 * part[["low_rad", "high_rad"]].to_numpy().T - middle)
        style = {"marker": MARKERS[place], "color": COLOURS[place], "linestyle": "none", "capsize": 2, "markersize": 4}
        left.errorbar(part["day"] + 2.5 * place, middle, ends, label=f"{name}, 95 %", **style)
        if np.isfinite(part["call_day"].iloc[0]):
            left.axvline(part["call_day"].iloc[0], color=COLOURS[place], linestyle=":", linewidth=1)
        each = tests[tests["sensor"] == name].drop_duplicates("bench")
        delay = np.sort((each["call_day"] - each["truth_day"]).dropna())
        share = np.arange(1, delay.size + 1) / len(each)
        right.step(delay, 100 * share, where="post", color=COLOURS[place])
    left.set(xlabel="time [days]", ylabel="backlash $\\delta$ [1e-4 rad]")
    left.legend(fontsize=8)
    interval = float(truth["day"].diff().max())
    right.axvspan(0, interval, color="0.9", label="a perfect sensor: the next test")
    right.set(xlabel="time from the truth to the call [days]", ylabel="benches called for by then [%]", ylim=(0, 102))
    right.legend(fontsize=8, loc="lower right")
    return figure


@in_style
def robots(population: pd.DataFrame, curves: Mapping[str, tuple[pd.DataFrame, float]], marks: pd.DataFrame) -> Figure:
    """Show A of healthy robots and of those with excessive backlash, and the ROC curve of a threshold on A."""
    figure, axes = grid(1, 2, figsize=(10.5, 4.6), width_ratios=(3, 2))
    left, right = axes[0]
    edges = np.linspace(0, 1.02 * population["A_rps"].max(), 40)
    for (kind, part), colour, hatch in zip(
        population.groupby("kind", sort=False), (BLUE, ORANGE), ("//", ""), strict=True
    ):
        left.hist(
            part["A_rps"],
            edges,
            color=colour,
            alpha=0.55,
            hatch=hatch,
            edgecolor="white",
            label=f"{kind}, {len(part)} robots",
        )
    for (label, (curve, area)), style in zip(curves.items(), ("-", "--", ":"), strict=False):
        right.plot(
            100 * curve["false_alarms"],
            100 * curve["detected"],
            style,
            color=BLUE if style == "-" else PINK,
            label=f"{label}, area {area:.3f}",
        )
    for mark, marker, style in zip(marks.to_dict("records"), "xPD", (":", "-.", "-"), strict=False):
        left.axvline(
            mark["threshold_rps"],
            color=INK,
            linestyle=style,
            linewidth=1.2,
            label=f"{mark['name']}: {mark['threshold_rps']:.4f} rps",
        )
        right.plot(
            100 * mark["false_alarms"],
            100 * mark["detected"],
            marker,
            color=INK,
            clip_on=False,
            zorder=3,
            linestyle="none",
            label=mark["name"],
        )
    left.set(xlabel="fitted A [rps]", ylabel="number of robots [-]")
    left.legend(fontsize=8)
    right.set(xlabel="healthy robots called excessive [%]", ylabel="excessive robots found [%]", ylim=(0, 102))
    right.legend(fontsize=8, loc="lower right")
    return figure


@in_style
def robots_disturbance(sweep: pd.DataFrame, thresholds: Mapping[str, float], turn_hz: float) -> Figure:
    """Show the A of a joint without backlash that a sinusoidal disturbance shakes."""
    figure, axes = grid(figsize=(9.0, 4.6))
    axis = axes[0, 0]
    low, high = sweep["disturbance_hz"].min(), sweep["disturbance_hz"].max()
    odd = turn_hz * np.arange(1, high / turn_hz + 1, 2)
    for place, frequency in enumerate(odd[odd >= low]):
        label = "odd multiples of the load's turn" if place == 0 else None
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
