"""The paper's figures and tables as plots: data frames and arrays in, a matplotlib figure out."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from replication.arrays import FloatArray
from replication.figures.style import BLUE, INK, ORANGE, PRINTED, grid, in_style


@in_style
def signature_parameters(
    t: FloatArray, h: FloatArray, t0: float, T1: float, T2: float, T_d: float, T_f: float
) -> Figure:
    """Figure 6: the signature h(t) over two turns with its instants and intervals."""
    figure, axis = plt.subplots(figsize=(6.9, 2.9))
    axis.plot(t, h, color=BLUE)
    top = np.abs(h).max()
    axis.axvline(t0, color=INK, linewidth=0.8, linestyle=":")
    axis.text(t0 + 0.005, -1.15 * top, "$t_0$", ha="left", va="center")
    spans = ((T1, 1.15, "$T_1$"), (T2, 1.4, "$T_2$"), (T_d, 1.65, "$T_d$"), (T_f, 1.9, "$T_f$"))
    for length, height, name in spans:
        y = height * top
        axis.annotate("", (t0 + length, y), (t0, y), arrowprops={"arrowstyle": "<->", "color": INK, "lw": 0.8})
        axis.plot([t0 + length] * 2, [y, 0], color="0.6", linewidth=0.8, linestyle=":")
        axis.text(t0 + length + 0.005, y, name, ha="left", va="center")
    axis.set(xlabel="time [s]", ylabel="h(t) [rps]", ylim=(-1.35 * top, 2.1 * top))
    return figure


@in_style
def record_with_fit(t: FloatArray, v: FloatArray, fitted: FloatArray, labels: Sequence[str], seconds: float) -> Figure:
    """Show a record, a fitted signature over it and the residual beneath."""
    figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(8.5, 5.0), height_ratios=(3, 1))
    upper.plot(t, v, color=ORANGE, linewidth=1.6, label=labels[0])
    upper.plot(t, fitted, color=BLUE, linewidth=0.9, label=labels[1])
    upper.set(ylabel="motor speed [rps]")
    upper.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    lower.plot(t, v - fitted, color=INK, linewidth=0.7)
    lower.set(xlabel="time [s]", ylabel="residual [rps]", xlim=(t[0], t[0] + seconds))
    return figure


@in_style
def table2(table: pd.DataFrame, regions: pd.DataFrame) -> Figure:
    """Table 2: means and SDs of every realisation, with the region that the authors' give, against the printed.

    `regions` has a row for each of the table: `mean, mean_low, mean_high, sd, sd_low, sd_high`, two of them printed.
    """
    figure, (first, second, third) = plt.subplots(3, 1, sharex=True, figsize=(6.5, 6.6), height_ratios=(3, 3, 2.4))
    shade = {"width": 0.7, "color": "0.88", "zorder": 0, "label": "95 % region of the authors' records"}
    low, high = (100 * (regions[f"mean_{end}"] / regions["mean"] - 1) for end in ("low", "high"))
    first.bar(regions.index, high - low, bottom=low, **shade)
    third.bar(regions.index, regions["sd_high"] - regions["sd_low"], bottom=regions["sd_low"], **shade)
    for axis, source, colour, side, title in (
        (first, "authors", BLUE, -0.12, "(a) authors' records"),
        (second, "simulated", ORANGE, 0.12, "(b) our simulated records"),
    ):
        part = table[table["source"] == source]
        mean = regions["mean"].loc[part["row"]].to_numpy()
        theory = part["theoretical_A_rps"] / mean
        axis.axhline(0, color=INK, linewidth=0.8, label="printed mean")
        _percent(axis, part["row"], theory, "+", INK, "theoretical A, printed", markersize=8)
        _percent(axis, part["row"] - 0.12, part["mean_A_rps"] / mean, "o", colour, f"mean of the runs, {source}")
        _percent(axis, part["row"] + 0.12, part["best_A_rps"] / mean, "s", colour, f"best basin, {source}", mfc="none")
        axis.set_title(title, loc="left", fontsize=10)
        axis.set_ylabel("against printed mean [%]")
        third.plot(part["row"] + side, part["sd_A_rps"], "o", color=colour, markersize=4)
    third.plot(regions.index, regions["sd"], **PRINTED | {"label": "printed SD"})
    third.set_title("(c) SD over the runs, both", loc="left", fontsize=10)
    third.set(xlabel="row of Table 2", ylabel="SD of A [rps]", yscale="log", xticks=list(regions.index))
    named: dict[str, Any] = {}
    for axis in (first, second, third):
        named |= {label: handle for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=2, fontsize=8)
    return figure


def _percent(axis: plt.Axes, x: pd.Series, ratio: pd.Series, marker: str, colour: str, label: str, **style) -> None:
    """Mark ratios as deviations from one in percent."""
    usual: dict[str, Any] = {"markersize": 4, "linestyle": "none", "marker": marker, "color": colour}
    axis.plot(x, 100 * (np.asarray(ratio) - 1), label=label, **usual | style)


@in_style
def basins(runs: pd.DataFrame, labels: FloatArray, title: str) -> Figure:
    """Where the runs on one record end: RMSE and |A| of each basin, the area and a count for its runs, 1 the best."""
    figure, axis = plt.subplots(figsize=(6.2, 4.0))
    ends = pd.DataFrame({"rmse": runs["rmse_rps"], "A": runs["A_rps"].abs(), "basin": labels})
    near = ends.groupby(["basin", ends["A"].round(1)], as_index=False).agg(
        rmse=("rmse", "mean"), A=("A", "mean"), runs=("A", "size"), basin=("basin", "first")
    )
    for best, colour, label in ((True, BLUE, "best basin"), (False, ORANGE, "other basins")):
        part = near[(near["basin"] == 1) == best]
        axis.scatter(part["rmse"], part["A"], 30 * part["runs"], color=colour, alpha=0.6, label=label)
        for row in part[part["runs"] > 1].itertuples():
            axis.annotate(f"{row.runs} runs", (row.rmse, row.A), (12, -14), textcoords="offset points", fontsize=8)
    axis.margins(0.15)
    axis.set(xlabel="final RMSE [rps]", ylabel="|A| [rps]", title=title)
    plt.setp(axis.legend(loc="best").legend_handles, sizes=[40])
    return figure


@in_style
def protocol_variants(scores: pd.DataFrame) -> Figure:
    """Show each protocol variant's means and SDs over the printed ones, row by row of Table 2."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 5.0))
    for (name, part), marker in zip(scores.groupby("protocol", sort=False), "osv^DxP*", strict=False):
        style = {"marker": marker, "linewidth": 0.8, "markersize": 4}
        left.plot(1e4 * part["delta_rad"], part["mean_error_percent"], label=name, **style)
        right.plot(1e4 * part["delta_rad"], part["sd_ratio"], **style)
    left.axhline(0, color=INK, linewidth=0.8)
    right.axhline(1, color=INK, linewidth=0.8)
    left.set(xlabel="backlash $\\delta$ [1e-4 rad]", ylabel="mean A against printed mean [%]")
    left.set_yscale("symlog", linthresh=10)
    left.set_yticks([-50, -20, -10, -5, 0, 5], labels=["-50", "-20", "-10", "-5", "0", "5"])
    right.set(xlabel="backlash $\\delta$ [1e-4 rad]", ylabel="SD over printed SD", yscale="log")
    figure.legend(loc="outside lower center", ncols=4, fontsize=8)
    return figure


@in_style
def characteristic(
    amplitude_rps: FloatArray, delta_rad: FloatArray, curve_A: FloatArray, curve_delta: FloatArray, label: str
) -> Figure:
    """Figure 12: backlash against amplitude, the points and the cubic, with the residual beneath."""
    figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(6.5, 3.3), height_ratios=(3, 1))
    order = np.argsort(curve_A)
    upper.plot(curve_A[order], 1e4 * curve_delta[order], color=BLUE, label=label)
    upper.plot(amplitude_rps, 1e4 * delta_rad, **PRINTED)
    upper.set(ylabel="backlash $\\delta$ [1e-4 rad]")
    upper.legend()
    residual = curve_delta[: len(delta_rad)] - delta_rad
    lower.plot(amplitude_rps, 1e6 * residual, "o", color=BLUE, markersize=4)
    lower.axhline(0, color=INK, linewidth=0.8)
    lower.set(xlabel="amplitude A [rps]", ylabel="fit - point\n[1e-6 rad]")
    return figure


@in_style
def dead_zone(curves: pd.DataFrame, delta_rad: float) -> Figure:
    """Figure 9: stiffness and torque of equations 8 and 9 against the displacement, and the clamped dead zone."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 4.2))
    styles = ("-", "--", "-.", ":", (0, (6, 2)))
    for (alpha, curve), style in zip(curves.groupby("alpha_per_rad", sort=False), styles, strict=False):
        label = f"$\\alpha$ = {alpha:.0e} rad$^{{-1}}$" if np.isfinite(alpha) else "clamped dead zone"
        x = 1e4 * curve["delta_theta_rad"]
        left.plot(x, 1e-3 * curve["stiffness_nm_per_rad"], linestyle=style, label=label)
        right.plot(x, curve["torque_nm"], linestyle=style, label=label)
    for axis in (left, right):
        axis.set(xlabel="displacement $\\Delta\\theta$ [1e-4 rad]")
        for edge in (-delta_rad, delta_rad):
            axis.axvline(1e4 * edge, color="0.5", linewidth=0.8, linestyle=":")
    left.set(ylabel="stiffness $K_{BL}$ [kN m/rad]")
    right.set(ylabel="torque on the load [N m]")
    right.legend(fontsize=8)
    return figure


@in_style
def simulated_joint(
    time_s: FloatArray,
    signals: Sequence[tuple[str, FloatArray, FloatArray | None]],
    recorded_label: str = "authors' record",
) -> Figure:
    """Figure 10: signals of the simulated joint, with the recorded one over it where there is one."""
    figure, axes = grid(len(signals), 1, sharex=True, figsize=(8.5, 1.9 * len(signals)))
    for axis, (label, simulated, recorded) in zip(axes[:, 0], signals, strict=True):
        if recorded is not None:
            axis.plot(time_s, recorded, color=ORANGE, linewidth=2.2)
        axis.plot(time_s, simulated, color=INK, linewidth=0.8)
        axis.set(ylabel=label, xlim=(time_s[0], time_s[-1]))
    axes[-1, 0].set(xlabel="time [s]")
    handles = [plt.Line2D([], [], color=INK, linewidth=0.8), plt.Line2D([], [], color=ORANGE, linewidth=2.2)]
    figure.legend(handles, ["simulated joint", recorded_label], loc="outside upper right", ncols=2)
    return figure


@in_style
def validation(table: pd.DataFrame) -> Figure:
    """Show the simulator's misfit and its peaks' errors, level by level."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(6.9, 2.9))
    delta, used = 1e4 * table["delta_rad"], table["used_in_fit"]
    for axis, values in ((left, 100 * table["nrmse"]), (right, table["peak_error_percent"])):
        axis.plot(delta[used], values[used], "s", color=BLUE, label="level used in the fit")
        axis.plot(delta[~used], values[~used], "o", mfc="none", color=ORANGE, label="level left out")
        axis.set(xlabel="backlash $\\delta$ [1e-4 rad]")
    left.set(ylabel="RMSE over signal SD [%]", ylim=(0, None))
    left.legend()
    right.set(ylabel="peak against printed A [%]")
    printed = right.axhline(0, color=INK, linewidth=0.8, label="printed in the paper")
    right.legend(handles=[printed], fontsize=8)
    return figure


@in_style
def speed_signal(t: FloatArray, v: FloatArray, turn_period_s: float) -> Figure:
    """Figure 5: the motor speed with its superimposed oscillations."""
    figure, axis = plt.subplots(figsize=(8.5, 3.4))
    axis.plot(t, v, color=BLUE, linewidth=0.9)
    for turn in np.arange(t[0], t[-1], turn_period_s):
        axis.axvline(turn, color="0.7", linewidth=0.8, linestyle=":")
    axis.set(xlabel="time [s], dotted: one load turn", ylabel="motor speed [rps]", xlim=(t[0], t[-1]))
    return figure


@in_style
def growth(disturbances: pd.DataFrame, peaks: pd.DataFrame, printed: Mapping[float, float]) -> Figure:
    """Figure 11: the disturbance at growing backlash, and its peak over the printed theoretical A."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(6.5, 3.3), width_ratios=(3, 2))
    levels = disturbances.groupby("delta_rad", sort=False)
    for (delta, part), share in zip(levels, 0.9 * np.arange(len(levels)) / max(len(levels) - 1, 1), strict=True):
        style = {"color": plt.cm.viridis(share), "linewidth": 0.9, "label": f"{1e4 * delta:.0f}"}
        left.plot(part["time_s"], part["disturbance_rps"], **style)
    left.set(xlabel="time in a settled turn [s]", ylabel="disturbance $v - v_t$ [rps]")
    left.legend(title="$\\delta$ [1e-4 rad]", fontsize=7, ncols=2)
    right.plot(1e4 * peaks["delta_rad"], peaks["amplitude_rps"], "o-", color=BLUE, label="peak before sampling")
    right.plot(1e4 * peaks["delta_rad"], peaks["sampled_rps"], "s--", color=ORANGE, ms=4, label="peak of 2 ms samples")
    right.plot(1e4 * np.array(list(printed)), list(printed.values()), **PRINTED)
    right.set(xlabel="backlash $\\delta$ [1e-4 rad]", ylabel="amplitude [rps]")
    right.legend(fontsize=8)
    return figure


@in_style
def characteristic_difference(curve: pd.DataFrame, printed: Mapping[float, float]) -> Figure:
    """Show our characteristic, equation 10 and its points as printed, and the difference of the two beneath."""
    figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(7.5, 5.0), height_ratios=(3, 1))
    A, printed_rad, fitted_rad = curve["amplitude_rps"], 1e4 * curve["printed_rad"], 1e4 * curve["fitted_rad"]
    upper.plot(A, printed_rad, color=INK, linestyle="--", label="equation 10, printed")
    upper.plot(A, fitted_rad, color=BLUE, label="cubic through our simulated peaks")
    upper.plot(list(printed.values()), 1e4 * np.array(list(printed)), **PRINTED)
    upper.set(ylabel="backlash $\\delta$ [1e-4 rad]")
    upper.legend()
    lower.plot(A, 1e6 * curve["difference_rad"], color=BLUE)
    lower.set(xlabel="amplitude A [rps]", ylabel="ours - printed\n[1e-6 rad]")
    return figure
