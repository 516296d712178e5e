"""The paper's figures and tables as plots: data frames and arrays in, a matplotlib figure out."""

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from replication.arrays import FloatArray
from replication.figures.style import BLUE, GREEN, INK, ORANGE, PRINTED, grid, in_style


@in_style
def signature_parameters(
    t: FloatArray, h: FloatArray, t0: float, T1: float, T2: float, T_d: float, T_f: float
) -> Figure:
    """Figure 6: the signature h(t) over two turns with its instants and intervals."""
    figure, axes = grid(figsize=(8.5, 4.2))
    axis = axes[0, 0]
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
    figure, axes = grid(2, 1, sharex=True, figsize=(8.5, 5.0), height_ratios=(3, 1))
    upper, lower = axes[:, 0]
    upper.plot(t, v, color=ORANGE, linewidth=1.6, label=labels[0])
    upper.plot(t, fitted, color=BLUE, linewidth=0.9, label=labels[1])
    upper.set(ylabel="motor speed [rps]")
    upper.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    lower.plot(t, v - fitted, color=INK, linewidth=0.7)
    lower.set(xlabel="time [s]", ylabel="residual [rps]", xlim=(t[0], t[0] + seconds))
    return figure


@in_style
def table2(rows: Mapping[str, pd.DataFrame], printed: pd.DataFrame) -> Figure:
    """Show Table 2's amplitudes: mean and SD of every source, their best basin and the printed marks.

    Parameters
    ----------
    rows : mapping of label to DataFrame
        Ten rows each, columns `delta_rad, mean_A_rps, sd_A_rps, best_A_rps, theoretical_A_rps`.
    printed : DataFrame
        Ten rows, columns `mean, sd, theoretical`, in the same order.

    Returns
    -------
    Figure
    """
    figure, axes = grid(2, 1, sharex=True, figsize=(8.5, 6.5), height_ratios=(2, 1))
    upper, lower = axes[:, 0]
    delta = 1e4 * next(iter(rows.values()))["delta_rad"].to_numpy()
    theory = printed["theoretical"].to_numpy()
    upper.plot(delta, theory, "+-", color="0.5", linewidth=1, markersize=8, label="theoretical A, printed")
    offsets = np.linspace(-0.25, 0.25, len(rows) + 1)
    for (label, table), colour, marker, offset in zip(
        rows.items(), (BLUE, ORANGE, GREEN), "os^", offsets, strict=False
    ):
        style = {"color": colour, "marker": marker, "markersize": 4, "linestyle": "none"}
        at = delta + offset
        upper.errorbar(at, table["mean_A_rps"], table["sd_A_rps"], capsize=3, label=label, **style)
        upper.plot(at, table["best_A_rps"], marker="_", markersize=10, linestyle="none", color=colour)
        difference = 100 * (table["best_A_rps"].to_numpy() / printed["mean"].to_numpy() - 1)
        lower.plot(at, difference, label=f"best basin, {label}", **style)
    at = delta + offsets[-1]
    upper.errorbar(at, printed["mean"], printed["sd"], elinewidth=1, capsize=3, **PRINTED)
    lower.axhspan(-2, 2, color="0.9", label="$\\pm$2 %: window gate and noise realisation")
    lower.set(xlabel="backlash $\\delta$ [1e-4 rad]", ylabel="against printed\nmean [%]", ylim=(-10, 7))
    upper.set(ylabel="A [rps], mean $\\pm$ SD of runs")
    upper.legend(loc="upper left")
    lower.legend(loc="lower right", fontsize=8, ncols=2)
    return figure


@in_style
def basins(runs: pd.DataFrame, labels: FloatArray, title: str) -> Figure:
    """Show where repeated runs on one record end: misfit against amplitude, one marker a run.

    Parameters
    ----------
    runs : DataFrame
        Columns `A_rps, rmse_rps`.
    labels : array of shape (runs,)
        Basin of each run, 0 the best.
    title : str
        Which record.

    Returns
    -------
    Figure
    """
    figure, axes = grid(figsize=(7.0, 4.0))
    axis = axes[0, 0]
    amplitude, rmse = runs["A_rps"].abs(), runs["rmse_rps"]
    best = labels == 0
    axis.plot(rmse[~best], amplitude[~best], "o", mfc="none", color=ORANGE, label=f"other basins, {(~best).sum()} runs")
    axis.plot(rmse[best], amplitude[best], "s", color=BLUE, label=f"best basin, {best.sum()} runs")
    axis.set(xlabel="final RMSE [rps]", ylabel="|A| [rps]", title=title)
    axis.legend()
    return figure


@in_style
def protocol_variants(scores: pd.DataFrame) -> Figure:
    """Show each protocol variant's means and SDs over the printed ones, row by row of Table 2."""
    figure, axes = grid(1, 2, figsize=(9.5, 5.0))
    left, right = axes[0]
    markers = "osv^DxP*"
    for (name, part), marker in zip(scores.groupby("protocol", sort=False), markers, strict=False):
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
    figure, axes = grid(2, 1, sharex=True, figsize=(7.5, 5.5), height_ratios=(3, 1))
    upper, lower = axes[:, 0]
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
    figure, axes = grid(1, 2, figsize=(9.5, 4.2))
    styles = ("-", "--", "-.", ":", (0, (6, 2)))
    for (alpha, curve), style in zip(curves.groupby("alpha_per_rad", sort=False), styles, strict=False):
        label = f"$\\alpha$ = {alpha:.0e} rad$^{{-1}}$" if np.isfinite(alpha) else "clamped dead zone"
        x = 1e4 * curve["delta_theta_rad"]
        axes[0, 0].plot(x, 1e-3 * curve["stiffness_nm_per_rad"], linestyle=style, label=label)
        axes[0, 1].plot(x, curve["torque_nm"], linestyle=style, label=label)
    for axis in axes[0]:
        axis.set(xlabel="displacement $\\Delta\\theta$ [1e-4 rad]")
        for edge in (-delta_rad, delta_rad):
            axis.axvline(1e4 * edge, color="0.5", linewidth=0.8, linestyle=":")
    axes[0, 0].set(ylabel="stiffness $K_{BL}$ [kN m/rad]")
    axes[0, 1].set(ylabel="torque on the load [N m]")
    axes[0, 1].legend(fontsize=8)
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
    figure, axes = grid(1, 2, figsize=(9.5, 3.8))
    delta, used = 1e4 * table["delta_rad"], table["used_in_fit"]
    for axis, column, factor in ((axes[0, 0], "nrmse", 100), (axes[0, 1], "peak_error_percent", 1)):
        axis.plot(delta[used], factor * table.loc[used, column], "s", color=BLUE, label="level used in the fit")
        axis.plot(
            delta[~used], factor * table.loc[~used, column], "o", mfc="none", color=ORANGE, label="level left out"
        )
        axis.set(xlabel="backlash $\\delta$ [1e-4 rad]")
    axes[0, 0].set(ylabel="RMSE over signal SD [%]", ylim=(0, None))
    axes[0, 1].set(ylabel="peak against printed A [%]")
    axes[0, 1].axhline(0, color=INK, linewidth=0.8, label="printed in the paper")
    axes[0, 0].legend()
    axes[0, 1].legend(handles=axes[0, 1].lines[-1:], fontsize=8)
    return figure


@in_style
def speed_signal(t: FloatArray, v: FloatArray, turn_period_s: float) -> Figure:
    """Figure 5: the motor speed with its superimposed oscillations."""
    figure, axes = grid(figsize=(8.5, 3.4))
    axis = axes[0, 0]
    axis.plot(t, v, color=BLUE, linewidth=0.9)
    for turn in np.arange(t[0], t[-1], turn_period_s):
        axis.axvline(turn, color="0.7", linewidth=0.8, linestyle=":")
    axis.set(xlabel="time [s], dotted: one load turn", ylabel="motor speed [rps]", xlim=(t[0], t[-1]))
    return figure


@in_style
def growth(disturbances: pd.DataFrame, peaks: pd.DataFrame, printed: Mapping[float, float]) -> Figure:
    """Figure 11: the disturbance at growing backlash, and its peak over the printed theoretical A."""
    figure, axes = grid(1, 2, figsize=(10.0, 4.4), width_ratios=(3, 2))
    left, right = axes[0]
    levels = disturbances["delta_rad"].unique()
    for index, delta in enumerate(levels):
        part = disturbances[disturbances["delta_rad"] == delta]
        colour = plt.cm.viridis(0.9 * index / max(len(levels) - 1, 1))
        left.plot(part["time_s"], part["disturbance_rps"], color=colour, linewidth=0.9, label=f"{1e4 * delta:.0f}")
    left.set(xlabel="time in a settled turn [s]", ylabel="disturbance v - 100 [rps]")
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
    figure, axes = grid(2, 1, sharex=True, figsize=(7.5, 5.0), height_ratios=(3, 1))
    upper, lower = axes[:, 0]
    upper.plot(
        curve["amplitude_rps"], 1e4 * curve["printed_rad"], color=INK, linestyle="--", label="equation 10, printed"
    )
    upper.plot(curve["amplitude_rps"], 1e4 * curve["fitted_rad"], color=BLUE, label="cubic through our simulated peaks")
    upper.plot(list(printed.values()), 1e4 * np.array(list(printed)), **PRINTED)
    upper.set(ylabel="backlash $\\delta$ [1e-4 rad]")
    upper.legend()
    lower.plot(curve["amplitude_rps"], 1e6 * curve["difference_rad"], color=BLUE)
    lower.set(xlabel="amplitude A [rps]", ylabel="ours - printed\n[1e-6 rad]")
    return figure
