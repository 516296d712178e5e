"""The paper's figures and tables as plots: data frames and arrays in, a matplotlib figure out."""

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

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
from replication.signature import Parameters, Timing

DOTTED: Style = {"linewidth": 0.8, "linestyle": ":"}
# Of a note beside a point, so many points away.
LEFT: Style = {"xytext": (-4, 0), "textcoords": "offset points", "ha": "right", "va": "center"}
RIGHT: Style = {"xytext": (4, 0), "textcoords": "offset points", "va": "center"}


@in_style
def signature_parameters(t: FloatArray, h: FloatArray, X: FloatArray, timing: Timing) -> Figure:
    """Figure 6: the signature h(t) over some turns, and its first oscillation, with the instants and intervals."""
    figure, ((turns,), (first,)) = grid(2, 1, height_in=4.2)
    A, t0, tau, _, _, T2, T1 = Parameters(*X)
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
    lower.plot(x, residual, line, color=BLUE, linewidth=0.9)
    lower.set(xlabel=labels[0], ylabel=labels[1])
    _centre(lower)
    letter_panels((upper, lower))
    return figure, upper


def _centre(axis: Axes) -> None:
    """Put zero into the middle of a residual's axis."""
    limit = np.abs(axis.get_ylim()).max()
    axis.set_ylim(-limit, limit)


@in_style
def table2(rows: pd.DataFrame) -> Figure:
    """Table 2: printed means and SDs, our intervals, and the theoretical A.

    `rows` has a row for each of the table: `mean, mean_low, mean_high, sd, sd_low, sd_high, theoretical`. A number that
    agrees with an interval whose ends are a factor of 9 apart has a hollow mark: the agreement is weak.
    """
    figure, axes = grid(2, 1, height_in=4.6, sharex=True, height_ratios=(3, 2.4))
    upper, lower = axes[:, 0]
    percent = 100 / rows["mean"]
    for axis, of, scale, offset in ((upper, "mean", percent, 100), (lower, "sd", 1.0, 0)):
        printed, low, high = (rows[of + end] * scale - offset for end in ("", "_low", "_high"))
        axis.use_sticky_edges = False  # an interval that ends at the frame would look cut
        axis.bar(rows.index, high - low, 0.6, low, color="0.8", label="our 95 % interval")
        agrees = (printed >= low) & (printed <= high)
        weak = agrees & (rows[f"{of}_high"] > 9 * rows[f"{of}_low"])
        filled = PRINTED | {"marker": "X", "markersize": 8}
        for chosen, look in (
            (agrees & ~weak, {"label": "printed, agrees"}),
            (weak, {"label": "printed, agrees weakly", "mfc": "none"}),
            (~agrees, {"label": "printed, differs", "color": ORANGE}),
        ):
            if chosen.any():
                axis.plot(printed[chosen], **filled | look)
    theoretical = MARKS | {
        "marker": "_",
        "markersize": 18,
        "color": BLUE,
        "label": "theoretical $A$",
    }
    upper.plot(rows["theoretical"] * percent - 100, **theoretical)
    upper.set(title="mean of $A$", ylabel="off the printed mean [%]")
    lower.set(title="SD of $A$", ylabel="SD of $A$ [rps]", yscale="log", xlabel="row of Table 2")
    lower.set_xticks(rows.index)
    return finish(figure, 3)


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
    stiffness = curves["stiffness_nm_per_rad"]
    dashes = ("-", "--", "-.", ":")
    for k, (alpha, curve) in enumerate(curves.groupby("alpha_per_rad", sort=False)):
        line = {"linestyle": dashes[k % 4], "linewidth": max(2.4 - 0.4 * k, 1.2)}
        label = f"$\\alpha = 10^{{{np.log10(alpha):.3g}}}$ rad$^{{-1}}$"
        if np.isinf(alpha):
            label, line = "clamped dead zone", THIN
        x = 1e4 * curve["delta_theta_rad"]
        upper.plot(x, curve["stiffness_nm_per_rad"], label=label, **line)
        lower.plot(x, curve["torque_nm"], **line)
    for axis in (upper, lower):
        for edge in (-delta_rad, delta_rad):
            axis.axvline(1e4 * edge, color="0.5", **DOTTED)
    upper.set(ylabel="stiffness $K_{BL}$ [N m/rad]", yscale="log")
    upper.set_ylim(stiffness[stiffness > 0].min() / 3)
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
        axis.plot(delta[used], values[used], "s", color=BLUE, label="level used in the fit")
        open_circle = {"mfc": "none", "color": ORANGE}
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
    lower.plot(delta, peaks["amplitude_rps"], "o-", color=BLUE, label="peak before sampling")
    lower.plot(delta, peaks["sampled_rps"], "s--", color=ORANGE, label="peak of the 2 ms samples")
    lower.plot(1e4 * np.array(list(printed)), list(printed.values()), **PRINTED)
    lower.set(xlabel=BACKLASH_LABEL, ylabel="amplitude $A$ [rps]")
    return finish(figure, 3)
