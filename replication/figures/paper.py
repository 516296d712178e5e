"""The paper's figures and tables as plots: data frames and arrays in, a matplotlib figure out."""

import re
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

from replication.arrays import FloatArray
from replication.figures.style import BACKLASH_LABEL, BLUE, INK, ORANGE, PRINTED, grid, in_style, letter_panels
from replication.signature import Timing


@in_style
def signature_parameters(t: FloatArray, h: FloatArray, X: FloatArray, timing: Timing) -> Figure:
    """Figure 6: the signature h(t) over some turns, and its first oscillation, with the instants and intervals."""
    figure, ((turns,), (first,)) = grid(2, 1, height_in=4.2)
    A, t0, tau, _, _, T2, T1 = X
    top = np.abs(h).max()
    for axis, spans in zip(
        (turns, first), ({"T_d": timing.T_d, "T_f": timing.T_f}, {"T_1": T1, "T_2": T2}), strict=True
    ):
        axis.plot(t, h, color=BLUE)
        axis.axvline(t0, color=INK, linewidth=0.8, linestyle=":")
        axis.annotate("$t_0$", (t0, 1.35 * top), (-4, 0), textcoords="offset points", ha="right", va="center")
        for (name, length), height in zip(spans.items(), (1.35, 1.75), strict=True):
            ends, y = (t0, t0 + length), height * top
            style = {"arrowstyle": "<->", "color": INK, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}
            axis.annotate("", (ends[1], y), (ends[0], y), arrowprops=style)
            axis.plot([ends[1]] * 2, [y, 0], color="0.6", linewidth=0.8, linestyle=":")
            axis.annotate(f"${name}$", (ends[1], y), (4, 0), textcoords="offset points", va="center")
        axis.set(xlabel="time $t$ [s]", ylabel="$h(t)$ [rps]", ylim=(-1.4 * top, 2.05 * top))
    since = np.linspace(T1, T2, 200)
    for side in (-1, 1):
        first.plot(t0 + since, side * A * np.exp(-tau * (since - T1)), color="0.5", linewidth=0.8, linestyle="--")
    first.annotate("$A$", (t0 + T1, A), (-4, 0), textcoords="offset points", ha="right", va="center")
    first.set_xlim(t0 - 0.02, t0 + 1.05 * max(T2, timing.T_d))
    letter_panels((turns, first))
    return figure


@in_style
def record_with_fit(t: FloatArray, v: FloatArray, fitted: FloatArray, labels: Sequence[str], seconds: float) -> Figure:
    """Show a record, what was fitted to it over it, and the residual beneath."""
    figure, upper = _above_residual(t, v - fitted, ("time [s]", "residual [rps]"), "-")
    upper.plot(t, v, color=ORANGE, linewidth=2.2, label=labels[0])
    upper.plot(t, fitted, color=INK, linewidth=0.8, label=labels[1])
    upper.set(ylabel="motor speed $v$ [rps]")
    upper.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0)
    upper.set_xlim(t[0], t[0] + seconds)
    return figure


def _above_residual(x: FloatArray, residual: FloatArray, labels: tuple[str, str], line: str) -> tuple[Figure, Axes]:
    """Make a figure with a residual about zero in its lower panel, and give the upper panel."""
    figure, ((upper,), (lower,)) = grid(2, 1, height_in=4.0, sharex=True, height_ratios=(2, 1))
    lower.axhline(0, color=INK, linewidth=0.8)
    lower.plot(x, residual, line, color=BLUE, markersize=4, linewidth=0.9)
    lower.set(xlabel=labels[0], ylabel=labels[1])
    _centre(lower, residual)
    letter_panels((upper, lower))
    return figure, upper


def _centre(axis: Axes, residual: FloatArray) -> None:
    """Put zero into the middle of a residual's axis."""
    limit = 1.1 * np.abs(residual).max() or 1.0
    axis.set_ylim(-limit, limit)


@in_style
def table2(table: pd.DataFrame, regions: pd.DataFrame) -> Figure:
    """Table 2: means and SDs of every realisation, with the region that the authors' give, against the printed.

    `regions` has a row for each of the table: `mean, mean_low, mean_high, sd, sd_low, sd_high`, two of them printed.
    """
    figure, axes = grid(3, 1, height_in=6.8, sharex=True, height_ratios=(3, 3, 2.6))
    first, second, third = panels = axes[:, 0]
    second.sharey(first)
    shade = {"width": 0.7, "color": "0.86", "zorder": 0, "label": "95 % region of the authors' records"}
    low, high = (100 * (regions[f"mean_{end}"] / regions["mean"] - 1) for end in ("low", "high"))
    first.bar(regions.index, high - low, bottom=low, **shade)
    third.bar(regions.index, regions["sd_high"] - regions["sd_low"], bottom=regions["sd_low"], **shade)
    for axis, source, name, colour, marker, side in (
        (first, "authors", "authors' records", BLUE, "o", -0.12),
        (second, "simulated", "our simulated records", ORANGE, "^", 0.12),
    ):
        part = table[table["source"] == source]
        mean = regions["mean"].loc[part["row"]].to_numpy()
        theory = part["theoretical_A_rps"] / mean
        axis.axhline(0, color=INK, linewidth=0.8, label="printed mean")
        _percent(axis, part["row"], theory, "+", INK, "theoretical $A$, printed", markersize=8)
        _percent(axis, part["row"] - 0.12, part["mean_A_rps"] / mean, marker, colour, f"mean of the runs, {name}")
        best = part["best_A_rps"] / mean
        _percent(axis, part["row"] + 0.12, best, marker, colour, f"best basin, {name}", markerfacecolor="none")
        axis.set(title=f"mean of $A$, {name}", ylabel="deviation from printed [%]")
        third.plot(part["row"] + side, part["sd_A_rps"], marker, color=colour, markersize=4)
    third.plot(regions.index, regions["sd"], **PRINTED | {"label": "printed SD"})
    third.set(title="SD of $A$ over the runs, both", ylabel="SD of $A$ [rps]", yscale="log")
    third.set(xlabel="row of Table 2", xticks=list(regions.index))
    for axis in panels:
        axis.use_sticky_edges = False  # a region that ends at the frame would look cut
        axis.autoscale()
    named = {handle.get_label(): handle for axis in panels for handle in axis.get_legend_handles_labels()[0]}
    figure.legend(handles=list(named.values()), loc="outside lower center", ncols=2)
    letter_panels(panels)
    return figure


def _percent(axis: Axes, x: pd.Series, ratio: pd.Series, marker: str, colour: str, label: str, **style) -> None:
    """Mark ratios as deviations from one in percent."""
    usual: dict[str, Any] = {"markersize": 4, "linestyle": "none", "marker": marker, "color": colour}
    axis.plot(x, 100 * (np.asarray(ratio) - 1), label=label, **usual | style)


@in_style
def basins(runs: pd.DataFrame, labels: FloatArray, title: str) -> Figure:
    """Where the runs on one record end: RMSE and |A| of each basin, the area and a count for its runs, 1 the best."""
    figure, ((axis,),) = grid(height_in=3.4)
    ends = pd.DataFrame({"rmse": runs["rmse_rps"], "A": runs["A_rps"].abs(), "basin": labels})
    near = ends.groupby(["basin", ends["A"].round(1)], as_index=False).agg(
        rmse=("rmse", "mean"), A=("A", "mean"), runs=("A", "size"), basin=("basin", "first")
    )
    for best, colour, marker, label in ((True, BLUE, "o", "best basin"), (False, ORANGE, "s", "other basins")):
        part = near[(near["basin"] == 1) == best]
        axis.scatter(part["rmse"], part["A"], 20 * part["runs"], color=colour, marker=marker, label=label, zorder=2)
        for row in part.itertuples():
            below = (0, -5 - np.sqrt(5 * row.runs))
            count = f"{row.runs} run" + "s" * (row.runs > 1)
            style = {"textcoords": "offset points", "ha": "center", "va": "top", "fontsize": 8}
            axis.annotate(count, (row.rmse, row.A), below, **style)
    axis.margins(0.12, 0.15)
    axis.set(xlabel="final RMSE [rps]", ylabel="$|A|$ [rps]", title=title)
    key = axis.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0)
    plt.setp(key.legend_handles, sizes=[30])
    return figure


@in_style
def protocol_variants(scores: pd.DataFrame) -> Figure:
    """Show how far each protocol variant's means and SDs are from the printed ones: a band a variant, a mark a row."""
    figure, ((left, right),) = grid(1, 2, height_in=4.2, sharey=True, width_ratios=(4, 3))
    off = scores["mean_error_percent"].abs().groupby(scores["protocol"]).mean().sort_values()
    for place, name in enumerate(off.index):
        part = scores[scores["protocol"] == name]
        y = place + np.linspace(-0.32, 0.32, len(part))
        left.plot(part["mean_error_percent"], y, "o", color=BLUE, markersize=3.5)
        right.plot(part["sd_ratio"], y, "o", color=BLUE, markersize=3.5)
    names = [re.sub(r"\b(T_[df]|A)\b", r"$\1$", name) for name in off.index]
    left.set(yticks=range(off.size), yticklabels=names, xlabel="deviation from printed mean [%]", title="mean of $A$")
    right.set(xlabel="SD over printed SD [-]", xscale="log", title="SD of $A$")
    left.set_ylim(off.size - 0.5, -0.5)
    for axis, printed in ((left, 0), (right, 1)):
        axis.axvline(printed, color=INK, linewidth=0.8)
        axis.grid(visible=False, axis="y")
        for edge in np.arange(1, off.size) - 0.5:
            axis.axhline(edge, color="0.8", linewidth=0.8)
    letter_panels((left, right))
    return figure


@in_style
def characteristic(
    amplitude_rps: FloatArray, delta_rad: FloatArray, curve_A: FloatArray, curve_delta: FloatArray, label: str
) -> Figure:
    """Figure 12: backlash against amplitude, the points and the cubic, with the residual beneath."""
    residual = 1e6 * (curve_delta[: len(delta_rad)] - delta_rad)
    labels = ("amplitude $A$ [rps]", "cubic $-$ point\n[$10^{-6}$ rad]")
    figure, upper = _above_residual(amplitude_rps, residual, labels, "o")
    order = np.argsort(curve_A)
    upper.plot(curve_A[order], 1e4 * curve_delta[order], color=BLUE, label=label)
    upper.plot(amplitude_rps, 1e4 * delta_rad, **PRINTED)
    upper.set(ylabel=BACKLASH_LABEL)
    upper.legend()
    return figure


@in_style
def dead_zone(curves: pd.DataFrame, delta_rad: float) -> Figure:
    """Figure 9: stiffness and torque of equations 8 and 9 against the displacement, and the clamped dead zone."""
    figure, ((upper,), (lower,)) = grid(2, 1, height_in=5.0, sharex=True)
    alphas = curves.groupby("alpha_per_rad", sort=False)
    widths = np.linspace(2.4, 0.9, len(alphas))
    for (alpha, curve), style, width in zip(alphas, cycle(("-", "--", "-.", ":", (0, (6, 2)))), widths, strict=False):
        digits, power = f"{alpha:.0e}".split("e") if np.isfinite(alpha) else ("", "0")
        times = "" if digits == "1" else f"{digits} \\cdot "
        label = f"$\\alpha = {times}10^{{{int(power)}}}$ rad$^{{-1}}$" if digits else "clamped dead zone"
        x = 1e4 * curve["delta_theta_rad"]
        upper.plot(x, 1e-3 * curve["stiffness_nm_per_rad"], linestyle=style, linewidth=width, label=label)
        lower.plot(x, curve["torque_nm"], linestyle=style, linewidth=width)
    for axis in (upper, lower):
        for edge in (-delta_rad, delta_rad):
            axis.axvline(1e4 * edge, color="0.5", linewidth=0.8, linestyle=":")
    upper.set(ylabel="stiffness $K_{BL}$ [kN m/rad]")
    lower.set(xlabel="displacement $\\Delta\\theta$ [$10^{-4}$ rad]", ylabel="torque $\\tau_l$ on the load [N m]")
    figure.legend(loc="outside upper center", ncols=3)
    letter_panels((upper, lower))
    return figure


@in_style
def simulated_joint(
    time_s: FloatArray,
    signals: Sequence[tuple[str, FloatArray, FloatArray | None]],
    recorded_label: str = "authors' record",
) -> Figure:
    """Figure 10: signals of the simulated joint, with the recorded one over it where there is one."""
    figure, axes = grid(len(signals), 1, height_in=0.6 + 1.2 * len(signals), sharex=True)
    for axis, (label, simulated, recorded) in zip(axes[:, 0], signals, strict=True):
        if recorded is not None:
            axis.plot(time_s, recorded, color=ORANGE, linewidth=2.2)
        axis.plot(time_s, simulated, color=INK, linewidth=0.8)
        axis.set(ylabel=label, xlim=(time_s[0], time_s[-1]))
        if simulated.min() < 0 < simulated.max():
            _centre(axis, simulated)
    axes[-1, 0].set(xlabel="time [s]")
    handles = [plt.Line2D([], [], color=INK, linewidth=0.8), plt.Line2D([], [], color=ORANGE, linewidth=2.2)]
    figure.legend(handles, ["simulated joint", recorded_label], loc="outside upper right", ncols=2)
    figure.align_ylabels()
    letter_panels(axes[:, 0])
    return figure


@in_style
def validation(table: pd.DataFrame) -> Figure:
    """Show the simulator's misfit and its peaks' errors, level by level."""
    figure, ((left, right),) = grid(1, 2, height_in=2.8)
    delta, used = 1e4 * table["delta_rad"], table["used_in_fit"]
    for axis, values in ((left, 100 * table["nrmse"]), (right, table["peak_error_percent"])):
        axis.plot(delta[used], values[used], "s", color=BLUE, markersize=5, label="level used in the fit")
        axis.plot(delta[~used], values[~used], "o", mfc="none", color=ORANGE, markersize=5, label="level left out")
        axis.set(xlabel=BACKLASH_LABEL)
    left.set(ylabel="RMSE over the record's SD [%]", ylim=(0, None))
    right.set(ylabel="deviation from printed $A$ [%]")
    right.axhline(0, color=INK, linewidth=0.8)
    if table["peak_error_percent"].notna().any():
        _centre(right, table["peak_error_percent"].dropna())
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    letter_panels((left, right))
    return figure


@in_style
def speed_signal(t: FloatArray, v: FloatArray, turn_period_s: float) -> Figure:
    """Figure 5: the motor speed with its superimposed oscillations."""
    figure, ((axis,),) = grid(height_in=2.6)
    axis.plot(t, v, color=BLUE, linewidth=0.9)
    for turn in np.arange(t[0], t[-1], turn_period_s):
        axis.axvline(turn, color="0.4", linewidth=0.8, linestyle=":")
    axis.set(xlabel="time [s]", ylabel="motor speed $v$ [rps]", xlim=(t[0], t[-1]))
    return figure


@in_style
def growth(disturbances: pd.DataFrame, peaks: pd.DataFrame, printed: Mapping[float, float]) -> Figure:
    """Figure 11: the disturbance at growing backlash, and its peak over the printed theoretical A."""
    figure, ((upper,), (lower,)) = grid(2, 1, height_in=5.2)
    levels = disturbances.groupby("delta_rad", sort=False)
    colours = plt.cm.viridis(np.linspace(0, 0.9, len(levels)))
    for (_, part), colour in zip(levels, colours, strict=True):
        upper.plot(part["time_s"], part["disturbance_rps"], color=colour, linewidth=0.9)
    upper.set(xlabel="time in a settled turn [s]", ylabel="disturbance $v - v_t$ [rps]")
    shades = ScalarMappable(Normalize(-0.5, len(levels) - 0.5), ListedColormap(colours))
    bar = figure.colorbar(shades, ax=upper, label=BACKLASH_LABEL)
    bar.set_ticks(range(len(levels)), labels=[f"{1e4 * delta:.0f}" for delta in levels.groups])
    bar.ax.grid(visible=False)
    delta = 1e4 * peaks["delta_rad"]
    lower.plot(delta, peaks["amplitude_rps"], "o-", color=BLUE, markersize=4, label="peak before sampling")
    lower.plot(delta, peaks["sampled_rps"], "s--", color=ORANGE, markersize=4, label="peak of the 2 ms samples")
    lower.plot(1e4 * np.array(list(printed)), list(printed.values()), **PRINTED)
    lower.set(xlabel=BACKLASH_LABEL, ylabel="amplitude $A$ [rps]")
    lower.legend()
    letter_panels((upper, lower))
    return figure


@in_style
def characteristic_difference(curve: pd.DataFrame, printed: Mapping[float, float]) -> Figure:
    """Show our characteristic, equation 10 and its points as printed, and the difference of the two beneath."""
    labels = ("amplitude $A$ [rps]", "ours $-$ printed\n[$10^{-6}$ rad]")
    figure, upper = _above_residual(curve["amplitude_rps"], 1e6 * curve["difference_rad"], labels, "-")
    A, printed_rad, fitted_rad = curve["amplitude_rps"], 1e4 * curve["printed_rad"], 1e4 * curve["fitted_rad"]
    upper.plot(A, printed_rad, color=INK, linestyle="--", label="equation 10, printed")
    upper.plot(A, fitted_rad, color=BLUE, label="cubic through our simulated peaks")
    upper.plot(list(printed.values()), 1e4 * np.array(list(printed)), **PRINTED)
    upper.set(ylabel=BACKLASH_LABEL)
    upper.legend()
    return figure
