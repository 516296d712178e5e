"""The paper's figures and tables as plots: data frames and arrays in, a matplotlib figure out."""

import re
from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from scipy import stats

from replication.arrays import FloatArray
from replication.figures.style import (
    BACKLASH_LABEL,
    BLUE,
    INK,
    MARKS,
    ORANGE,
    PRINTED,
    THIN,
    Style,
    finish,
    grid,
    in_style,
    letter_panels,
)
from replication.signature import Timing

DOTTED: Style = {"linewidth": 0.8, "linestyle": ":"}
# Of a note beside a point, so many points away.
LEFT: Style = {"xytext": (-4, 0), "textcoords": "offset points", "ha": "right", "va": "center"}
RIGHT: Style = {"xytext": (4, 0), "textcoords": "offset points", "va": "center"}
BELOW: Style = {"textcoords": "offset points", "ha": "center", "va": "top", "size": 8}


@in_style
def signature_parameters(t: FloatArray, h: FloatArray, X: FloatArray, timing: Timing) -> Figure:
    """Figure 6: the signature h(t) over some turns, and its first oscillation, with the instants and intervals."""
    figure, ((turns,), (first,)) = grid(2, 1, height_in=4.2)
    A, t0, tau, _, _, T2, T1 = X
    top = np.abs(h).max()
    arrow = THIN | {"arrowstyle": "<->", "shrinkA": 0, "shrinkB": 0}
    for axis, spans in (
        (turns, {"T_d": timing.T_d, "T_f": timing.T_f}),
        (first, {"T_1": T1, "T_2": T2}),
    ):
        axis.plot(t, h, color=BLUE)
        axis.axvline(t0, color=INK, **DOTTED)
        axis.annotate("$t_0$", (t0, 1.35 * top), **LEFT)
        for (name, length), height in zip(spans.items(), (1.35, 1.75), strict=True):
            end, y = t0 + length, height * top
            axis.annotate("", (end, y), (t0, y), arrowprops=arrow)
            axis.plot([end, end], [y, 0], color="0.6", **DOTTED)
            axis.annotate(f"${name}$", (end, y), **RIGHT)
        axis.set(xlabel="time $t$ [s]", ylabel="$h(t)$ [rps]", ylim=(-1.4 * top, 2.05 * top))
    since = np.linspace(T1, T2, 200)
    envelope = np.outer(A * np.exp(-tau * (since - T1)), (-1, 1))
    first.plot(t0 + since, envelope, color="0.5", linewidth=0.8, linestyle="--")
    first.annotate("$A$", (t0 + T1, A), **LEFT)
    first.set_xlim(t0 - 0.02, t0 + 1.05 * max(T2, timing.T_d))
    return finish(figure, 1)


@in_style
def record_with_fit(
    t: FloatArray, v: FloatArray, fitted: FloatArray, labels: Sequence[str], seconds: float
) -> Figure:
    """Show a record, what was fitted to it over it, and the residual beneath."""
    figure, upper = _above_residual(t, v - fitted, ("time [s]", "residual [rps]"), "-")
    upper.plot(t, v, color=ORANGE, linewidth=2.2, label=labels[0])
    upper.plot(t, fitted, label=labels[1], **THIN)
    upper.set(ylabel="motor speed $v$ [rps]", xlim=(t[0], t[0] + seconds))
    upper.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0)
    return figure


def _above_residual(
    x: FloatArray, residual: FloatArray, labels: tuple[str, str], line: str
) -> tuple[Figure, Axes]:
    """Make a figure with a residual about zero in its lower panel, and give the upper panel."""
    figure, ((upper,), (lower,)) = grid(2, 1, height_in=4.0, sharex=True, height_ratios=(2, 1))
    lower.axhline(0, **THIN)
    lower.plot(x, residual, line, color=BLUE, markersize=4, linewidth=0.9)
    lower.set(xlabel=labels[0], ylabel=labels[1])
    _centre(lower)
    letter_panels((upper, lower))
    return figure, upper


def _centre(axis: Axes) -> None:
    """Put zero into the middle of a residual's axis."""
    limit = np.abs(axis.get_ylim()).max()
    axis.set_ylim(-limit, limit)


@in_style
def table2(table: pd.DataFrame, regions: pd.DataFrame) -> Figure:
    """Table 2: means and SDs of every realisation, with the region that the authors' give, against the printed.

    `regions` has a row for each of the table: `mean, mean_low, mean_high, sd, sd_low, sd_high`, two
    of them printed.
    """
    figure, axes = grid(3, 1, height_in=6.8, sharex=True, height_ratios=(3, 3, 2.6))
    first, second, third = axes[:, 0]
    second.sharey(first)
    # A region that ends at the frame would look cut.
    first.use_sticky_edges = second.use_sticky_edges = third.use_sticky_edges = False
    shade = {
        "width": 0.7,
        "color": "0.86",
        "zorder": 0,
        "label": "95 % region of the authors' records",
    }
    low, high = (100 * (regions[f"mean_{end}"] / regions["mean"] - 1) for end in ("low", "high"))
    first.bar(regions.index, high - low, bottom=low, **shade)
    third.bar(
        regions.index, regions["sd_high"] - regions["sd_low"], bottom=regions["sd_low"], **shade
    )
    for axis, source, name, colour, marker, side in (
        (first, "authors", "authors' records", BLUE, "o", -0.12),
        (second, "simulated", "our simulated records", ORANGE, "^", 0.12),
    ):
        part = table[table["source"] == source]
        row = part["row"]
        printed = regions["mean"].loc[row].to_numpy()
        dots = {"markersize": 4, "linestyle": "none", "marker": marker, "color": colour}
        axis.axhline(0, label="printed mean", **THIN)
        theoretical = MARKS | {"marker": "+", "markersize": 8, "label": "theoretical $A$, printed"}
        axis.plot(row, _percent_off(part["theoretical_A_rps"], printed), **theoretical)
        of_runs = _percent_off(part["mean_A_rps"], printed)
        axis.plot(row - 0.12, of_runs, label=f"mean of the runs, {name}", **dots)
        best = _percent_off(part["best_A_rps"], printed)
        axis.plot(row + 0.12, best, label=f"best basin, {name}", markerfacecolor="none", **dots)
        axis.set(title=f"mean of $A$, {name}", ylabel="deviation from printed [%]")
        third.plot(row + side, part["sd_A_rps"], marker, color=colour, markersize=4)
    third.plot(regions.index, regions["sd"], label="printed SD", **MARKS)
    third.set(
        title="SD of $A$, both", ylabel="SD of $A$ [rps]", yscale="log", xlabel="row of Table 2"
    )
    third.set_xticks(regions.index)
    return finish(figure, 2)


def _percent_off(values: pd.Series, printed: FloatArray) -> FloatArray:
    """Deviations from printed values in percent."""
    return 100 * (np.asarray(values / printed) - 1)


@in_style
def basins(runs: pd.DataFrame, labels: FloatArray, title: str) -> Figure:
    """Where the runs on one record end: RMSE and |A| of each basin, the area and a count for its runs, 1 the best."""
    figure, ((axis,),) = grid(height_in=3.4)
    ends = pd.DataFrame({"rmse": runs["rmse_rps"], "A": runs["A_rps"].abs(), "basin": labels})
    near = ends.groupby(["basin", ends["A"].round(1)], as_index=False).agg(
        rmse=("rmse", "mean"), A=("A", "mean"), runs=("A", "size"), basin=("basin", "first")
    )
    is_best = near["basin"] == 1
    for part, colour, marker, label in (
        (near[is_best], BLUE, "o", "best basin"),
        (near[~is_best], ORANGE, "s", "other basins"),
    ):
        axis.scatter(
            part["rmse"],
            part["A"],
            20 * part["runs"],
            color=colour,
            marker=marker,
            label=label,
            zorder=2,
        )
        for row in part.itertuples():
            count = f"{row.runs} run" + "s" * (row.runs > 1)
            axis.annotate(count, (row.rmse, row.A), (0, -5 - np.sqrt(5 * row.runs)), **BELOW)
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
        for axis, values in (left, part["mean_error_percent"]), (right, part["sd_ratio"]):
            axis.plot(values, y, "o", color=BLUE, markersize=3.5)
            axis.axhline(place + 0.5, color="0.8", linewidth=0.8)
    names = [re.sub(r"\b(T_[df]|A)\b", r"$\1$", name) for name in off.index]
    left.set(
        yticks=range(off.size),
        yticklabels=names,
        xlabel="deviation from printed mean [%]",
        title="mean of $A$",
    )
    right.set(xlabel="SD over printed SD [-]", xscale="log", title="SD of $A$")
    left.set_ylim(off.size - 0.5, -0.5)
    for axis, printed in ((left, 0), (right, 1)):
        axis.axvline(printed, **THIN)
        axis.grid(visible=False, axis="y")
    return finish(figure, 1)


@in_style
def protocol_residuals(
    table: pd.DataFrame, judged: pd.DataFrame, level: float, degrees: int
) -> Figure:
    """Show how far Table 2's numbers lie from each candidate's, in t (grey: p above `level`), and the p of all ten."""
    figure, axes = grid(1, 2, height_in=0.4 * len(judged) + 1.0, sharex=True, sharey=True)
    edge = stats.t.isf(level / 2, degrees)
    beside = {"xycoords": ("axes fraction", "data"), "va": "center"}
    ticks = [-20, -2, 0, 2, 20]
    for axis, column, text in zip(axes[0], ("mean", "sd"), ("means", "SDs"), strict=True):
        axis.axvspan(-edge, edge, color="0.9", zorder=0)
        axis.annotate("p", (1.03, -0.9), style="italic", annotation_clip=False, **beside)
        of_column = table[table["column"] == column]
        for at, (candidate, p) in enumerate(
            zip(judged["protocol"], judged[f"p_{column}s"], strict=True)
        ):
            t = of_column.loc[of_column["protocol"] == candidate, "t"]
            axis.plot(t, np.full(len(t), at), "o", color=BLUE, markersize=4, alpha=0.6)
            digit, _, power = f"{p:.0e}".partition("e")
            shown = f"{p:.1g}" if p >= 1e-3 else f"${digit}\\cdot10^{{{int(power)}}}$"
            axis.annotate(shown, (1.03, at), fontsize=8, **beside)
        axis.set(title=text, xscale="symlog", ylim=(len(judged) - 0.4, -0.6))
        axis.axhline(judged["explains"].sum() - 0.5, color=INK, linestyle="--", linewidth=1)
        axis.set_xticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks])
        axis.xaxis.set_minor_locator(NullLocator())
    figure.supxlabel("t [-], linear from −2 to 2, logarithmic beyond", fontsize=9)
    axes[0, 0].set_yticks(range(len(judged)), judged["protocol"].str.replace(", ", ",\n"))
    return finish(figure, 1)


@in_style
def characteristic(
    curves: Mapping[str, Sequence[FloatArray]],
    points: Sequence[FloatArray],
    residual: Sequence[FloatArray],
    name: str,
) -> Figure:
    """Figure 12: curves of (A [rps], delta [rad]) over the printed points, and a named residual [rad] beneath."""
    labels = ("amplitude $A$ [rps]", f"{name}\n[$10^{{-6}}$ rad]")
    line = "o" if len(residual[0]) < 50 else "-"
    figure, upper = _above_residual(residual[0], 1e6 * residual[1], labels, line)
    for (label, (A, delta)), colour, line in zip(
        curves.items(), (BLUE, INK), ("-", "--"), strict=False
    ):
        upper.plot(A, 1e4 * delta, line, color=colour, label=label)
    upper.plot(points[0], 1e4 * points[1], **PRINTED)
    upper.set(ylabel=BACKLASH_LABEL)
    upper.legend()
    return figure


@in_style
def dead_zone(curves: pd.DataFrame, delta_rad: float) -> Figure:
    """Figure 9: stiffness and torque of equations 8 and 9 against the displacement, and the clamped dead zone."""
    figure, ((upper,), (lower,)) = grid(2, 1, height_in=5.0, sharex=True)
    dashes = ("-", "--", "-.", ":", (0, (6, 2)))
    for k, (alpha, curve) in enumerate(curves.groupby("alpha_per_rad", sort=False)):
        line = {"linestyle": dashes[k % 5], "linewidth": max(2.4 - 0.4 * k, 0.8)}
        power = f"$\\alpha = 10^{{{np.log10(alpha):.3g}}}$ rad$^{{-1}}$"
        label = power if np.isfinite(alpha) else "clamped dead zone"
        x = 1e4 * curve["delta_theta_rad"]
        upper.plot(x, 1e-3 * curve["stiffness_nm_per_rad"], label=label, **line)
        lower.plot(x, curve["torque_nm"], **line)
    for axis in (upper, lower):
        for edge in (-delta_rad, delta_rad):
            axis.axvline(1e4 * edge, color="0.5", **DOTTED)
    upper.set(ylabel="stiffness $K_{BL}$ [kN m/rad]")
    lower.set(
        xlabel="displacement $\\Delta\\theta$ [$10^{-4}$ rad]",
        ylabel="torque $\\tau_l$ on the load [N m]",
    )
    return finish(figure, 3, "outside upper center")


@in_style
def simulated_joint(
    time_s: FloatArray,
    signals: Sequence[tuple[str, FloatArray, FloatArray | None]],
    recorded_label: str = "authors' record",
) -> Figure:
    """Figure 10: signals of the simulated joint, over the recorded one where there is one."""
    figure, axes = grid(len(signals), 1, height_in=0.6 + 1.2 * len(signals), sharex=True)
    for axis, (label, simulated, recorded) in zip(axes[:, 0], signals, strict=True):
        if recorded is not None:
            axis.plot(time_s, recorded, color=ORANGE, linewidth=2.2, label=recorded_label)
        axis.plot(time_s, simulated, label="simulated joint", **THIN)
        axis.set(ylabel=label, xlim=(time_s[0], time_s[-1]))
        if simulated.min() < 0 < simulated.max():
            _centre(axis)
    axes[-1, 0].set(xlabel="time [s]")
    figure.align_ylabels()
    return finish(figure, 2, "outside upper right")


@in_style
def validation(table: pd.DataFrame) -> Figure:
    """Show the simulator's misfit and its peaks' errors, level by level."""
    figure, ((left, right),) = grid(1, 2, height_in=2.8)
    delta = 1e4 * table["delta_rad"]
    used = table["used_in_fit"]
    for axis, values in ((left, 100 * table["nrmse"]), (right, table["peak_error_percent"])):
        axis.plot(
            delta[used], values[used], "s", color=BLUE, markersize=5, label="level used in the fit"
        )
        open_circle = {"mfc": "none", "color": ORANGE, "markersize": 5}
        axis.plot(delta[~used], values[~used], "o", label="level left out", **open_circle)
        axis.set(xlabel=BACKLASH_LABEL)
    left.set(ylabel="RMSE over the record's SD [%]", ylim=(0, None))
    right.set(ylabel="deviation from printed $A$ [%]")
    right.axhline(0, **THIN)
    _centre(right)
    return finish(figure, 2, "outside upper center")


@in_style
def speed_signal(t: FloatArray, v: FloatArray, turn_period_s: float) -> Figure:
    """Figure 5: the motor speed with its superimposed oscillations."""
    figure, ((axis,),) = grid(height_in=2.6)
    axis.plot(t, v, color=BLUE, linewidth=0.9)
    for turn in np.arange(t[0], t[-1], turn_period_s):
        axis.axvline(turn, color="0.4", **DOTTED)
    axis.set(xlabel="time [s]", ylabel="motor speed $v$ [rps]", xlim=(t[0], t[-1]))
    return figure


@in_style
def growth(
    disturbances: pd.DataFrame, peaks: pd.DataFrame, printed: Mapping[float, float]
) -> Figure:
    """Figure 11: the disturbance at growing backlash, and its peak beside the printed A."""
    figure, ((upper,), (lower,)) = grid(2, 1, height_in=5.2)
    shades = plt.cm.ScalarMappable(
        plt.Normalize(0, 1.1e4 * disturbances["delta_rad"].max()), "viridis"
    )
    for delta, part in disturbances.groupby("delta_rad"):
        colour = shades.to_rgba(1e4 * delta)
        upper.plot(part["time_s"], part["disturbance_rps"], color=colour, linewidth=0.9)
    upper.set(xlabel="time in a settled turn [s]", ylabel="disturbance $v - v_t$ [rps]")
    figure.colorbar(shades, ax=upper, label=BACKLASH_LABEL)
    delta = 1e4 * peaks["delta_rad"]
    lower.plot(
        delta, peaks["amplitude_rps"], "o-", color=BLUE, markersize=4, label="peak before sampling"
    )
    lower.plot(
        delta,
        peaks["sampled_rps"],
        "s--",
        color=ORANGE,
        markersize=4,
        label="peak of the 2 ms samples",
    )
    lower.plot(1e4 * np.array(list(printed)), list(printed.values()), **PRINTED)
    lower.set(xlabel=BACKLASH_LABEL, ylabel="amplitude $A$ [rps]")
    return finish(figure, 3)
