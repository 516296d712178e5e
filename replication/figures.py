"""The paper's figures and tables as plots: arrays and data frames in, a matplotlib figure out.

One look means one thing in all figures: `LOG` what was recorded, `STAND_IN` what is simulated in place of an
unpublished log, `FIT` what was fitted or simulated over it, `RESIDUAL` what that leaves, `OURS` what we computed,
`PRINTED` what the paper prints, `DIFFERS` a printed number outside our interval. A figure of a notebook's own begins
with `panel` or `grid` and ends with `finish`.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from itertools import cycle
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler
from numpy.typing import NDArray

from replication.signature import Parameters, Timing

FloatArray = NDArray[np.float64]
Style = dict[str, Any]

# Okabe and Ito's colours, ordered so that neighbours also differ in grey.
INK, BLUE, ORANGE, GREEN = "#000000", "#0072B2", "#E69F00", "#009E73"
PINK, SKY, VERMILION = "#CC79A7", "#56B4E9", "#D55E00"
LOG: Style = {"color": ORANGE, "linewidth": 3.0, "alpha": 0.8}
STAND_IN = LOG | {"color": PINK}
RESIDUAL: Style = {"color": BLUE, "linewidth": 0.9}
FIT: Style = {"color": INK, "linewidth": 0.8}
OURS: Style = {"color": BLUE}
PRINTED: Style = {"color": INK, "marker": "x", "linestyle": "none", "markersize": 6, "mew": 1.5}
DIFFERS = PRINTED | {"color": VERMILION, "marker": "X", "markersize": 9, "mew": 0.5}
WIDE: Style = {"color": "0.8", "linewidth": 4.0}  # below a thin line
MARKS: Style = {"color": VERMILION, "marker": "x", "linestyle": "none"}
THIN: Style = {"color": INK, "linewidth": 0.8}
DOTTED: Style = {"color": "0.5", "linewidth": 0.8, "linestyle": ":"}

WIDTH_IN = 4.6  # on a screen of 390 dots the smallest text, 8.5 pt, is ten dots high
BACKLASH_LABEL = "backlash $\\delta$ [mrad]"
MRAD = 1e3  # per rad

STYLE: dict[Any, Any] = {
    "figure.dpi": 100,
    "figure.constrained_layout.use": True,
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.5,
    "lines.markersize": 4,
    "errorbar.capsize": 3,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": cycler(color=[BLUE, ORANGE, GREEN, PINK, SKY, INK]),
    "grid.color": "0.9",
    "legend.frameon": False,
    "svg.hashsalt": "backlash",
    "svg.fonttype": "path",
}


# ------------------------------------------------------------------------------------------------------------- style


def in_style(plot: Callable[..., Figure]) -> Callable[..., Figure]:
    """Draw a figure in the workbook's style, leaving matplotlib's settings alone."""

    @wraps(plot)
    def styled(*args, **options) -> Figure:
        with mpl.rc_context(STYLE):
            figure = plot(*args, **options)
            interactive = mpl.is_interactive()
        # A notebook's backend switches this on with its first figure; off again, no other figure would be shown.
        mpl.interactive(interactive)
        return figure

    return styled


def grid(
    rows: int = 1, columns: int = 1, height_in: float = 3.2, **options
) -> tuple[Figure, np.ndarray]:
    """Make a figure in the workbook's style and its axes, always as an array of shape (rows, columns)."""
    with mpl.rc_context(STYLE):
        return plt.subplots(rows, columns, squeeze=False, figsize=(WIDTH_IN, height_in), **options)


def panel(height_in: float = 3.2) -> tuple[Figure, Axes]:
    """Make a figure in the workbook's style, and its only axes."""
    figure, axes = grid(height_in=height_in)
    return figure, axes[0, 0]


def curves(
    lines: Mapping[str, Sequence[Any]],
    xlabel: str,
    ylabel: str,
    height_in: float = 2.6,
    columns: int = 2,
    **limits: tuple[float, float],
) -> Figure:
    """Draw lines in one panel: by what they are called, x, y and, where it is not the usual one, a style."""
    figure, axis = panel(height_in)
    for label, (x, y, *style) in lines.items():
        axis.plot(x, y, label=label, **dict(*style))
    axis.set(xlabel=xlabel, ylabel=ylabel, **limits)
    return finish(figure, columns)


def letter_panels(axes: Iterable[Axes]) -> None:
    """Put (a), (b), ... before the titles of a figure's panels."""
    for letter, axis in zip("abcdefgh", axes, strict=False):
        axis.set_title(f"({letter}) {axis.get_title(loc='left')}".rstrip(), loc="left")


def finish(figure: Figure, columns: int, loc: Any = "outside lower center") -> Figure:
    """Letter the panels of a figure, and put one legend beside them, each label once."""
    panels = [
        axis for axis in figure.axes if axis.get_visible() and axis.get_label() != "<colorbar>"
    ]
    if len(panels) > 1:
        with mpl.rc_context(STYLE):
            letter_panels(panels)
    listed = [zip(*axis.get_legend_handles_labels(), strict=True) for axis in panels]
    entries = {label: handle for handles in listed for handle, label in handles}
    if entries:
        with mpl.rc_context(STYLE):
            figure.legend(entries.values(), entries.keys(), loc=loc, ncols=columns)
    return figure


def save(figure: Figure, folder: Path, name: str, mark: str = "") -> None:
    """Write a figure as SVG and PNG, without anything that differs from run to run."""
    folder.mkdir(parents=True, exist_ok=True)
    if mark:
        style: Style = {"fontsize": 40, "color": "0.6", "alpha": 0.4, "rotation": 20}
        figure.text(0.5, 0.5, mark, ha="center", va="center", **style)
    with mpl.rc_context(STYLE):
        about = {"Date": None, "Description": description(figure)}
        figure.savefig(folder / f"{name}.svg", metadata=about)
        figure.savefig(folder / f"{name}.png", dpi=200)


def description(figure: Figure) -> str:
    """Say what a figure's axes are, a panel each: the SVG's description, and what reads it aloud says."""
    panels = []
    for axis in figure.axes:
        labels = [
            label.replace("\n", " ") for label in (axis.get_xlabel(), axis.get_ylabel()) if label
        ]
        panels.append(" versus ".join(labels[::-1]))
    panels += [figure.get_supylabel(), figure.get_supxlabel()]
    return "; ".join(dict.fromkeys(panel for panel in panels if panel))


def _centre(axis: Axes) -> None:
    """Put zero into the middle of a residual's axis."""
    limit = 1.1 * np.abs(axis.get_ylim()).max()
    axis.set_ylim(-limit, limit)


# ----------------------------------------------------------------------------------------------------------- figures


@in_style
def speed_signal(t: FloatArray, v: FloatArray, turn_period_s: float) -> Figure:
    """Figure 5: the motor speed with its superimposed oscillations; dotted lines are turns."""
    figure, axis = panel(2.6)
    axis.plot(t, v, **FIT)
    for turn in np.arange(t[0], t[-1], turn_period_s):
        axis.axvline(turn, **DOTTED)
    axis.set(xlabel="time $t$ [s]", ylabel="motor speed $v$ [rps]", xlim=(t[0], t[-1]))
    return figure


@in_style
def signature_parameters(t: FloatArray, h: FloatArray, X: FloatArray, timing: Timing) -> Figure:
    """Figure 6: the signature h(t) over some turns, and its first oscillation, with the instants and intervals."""
    figure, ((turns,), (first,)) = grid(2, 1, height_in=4.4)
    A, t0, tau, _, _, T2, T1 = Parameters(*X)
    top = np.abs(h).max()
    left = {"xytext": (-4, 0), "textcoords": "offset points", "ha": "right", "va": "center"}
    right = {"xytext": (4, 0), "textcoords": "offset points", "va": "center"}
    arrow = THIN | {"arrowstyle": "<->", "shrinkA": 0, "shrinkB": 0}
    for axis, spans in (
        (turns, {"T_d": timing.T_d, "T_f": timing.T_f}),
        (first, {"T_1": T1, "T_2": T2}),
    ):
        axis.plot(t, h, **FIT)
        axis.axvline(t0, **DOTTED)
        axis.annotate("$t_0$", (t0, 1.35 * top), **left)
        for (name, length), height in zip(spans.items(), (1.35, 1.75), strict=True):
            end, y = t0 + length, height * top
            axis.annotate("", (end, y), (t0, y), arrowprops=arrow)
            axis.plot([end, end], [y, 0], **DOTTED)
            axis.annotate(f"${name}$", (end, y), **right)
        axis.set(xlabel="time $t$ [s]", ylabel="$h(t)$ [rps]", ylim=(-1.4 * top, 2.05 * top))
    since = np.linspace(T1, T2, 200)
    envelope = np.outer(A * np.exp(-tau * (since - T1)), (-1, 1))
    first.plot(t0 + since, envelope, color="0.5", linewidth=0.8, linestyle="--")
    first.annotate("$A$", (t0 + T1, A), **left)
    first.set_xlim(t0 - 0.02, t0 + 1.05 * max(T2, timing.T_d))
    return finish(figure, 1)


@in_style
def record_with_fit(
    t: FloatArray, v: FloatArray, fitted: FloatArray, labels: Sequence[str], seconds: float
) -> Figure:
    """Show a record, what was fitted to it over it, and the residual beneath."""
    figure, ((upper,), (lower,)) = grid(2, 1, height_in=4.0, sharex=True, height_ratios=(2, 1))
    upper.plot(t, v, label=labels[0], **LOG)
    upper.plot(t, fitted, label=labels[1], **FIT)
    upper.set(ylabel="motor speed $v$ [rps]", xlim=(t[0], t[0] + seconds))
    lower.axhline(0, **THIN)
    lower.plot(t, v - fitted, **RESIDUAL)
    lower.set(xlabel="time $t$ [s]", ylabel="residual [rps]")
    _centre(lower)
    return finish(figure, 2)


@in_style
def dead_zone(
    x_rad: FloatArray, curves: Mapping[float, Sequence[FloatArray]], delta_rad: float
) -> Figure:
    """Figure 9: stiffness and torque of equations 8 and 9 against the displacement, and the torque within the gap.

    `curves` gives stiffness [N m/rad] and torque [N m] by alpha [1/rad]; an infinite one is the clamped dead zone.
    The last panel has the sharp edges alone, whose jump at zero the second one is too coarse for.
    """
    figure, axes = grid(3, 1, height_in=6.4)
    stiffness, torque, inside = axes[:, 0]
    x, in_gap, height, least = MRAD * x_rad, np.abs(x_rad) < 0.9 * delta_rad, 0.0, np.inf
    for k, (alpha, (of_stiffness, of_torque)) in enumerate(curves.items()):
        line = {"linestyle": ("-", "--", "-.", ":")[k % 4], "linewidth": max(2.4 - 0.4 * k, 1.2)}
        line |= {"color": (SKY, ORANGE, BLUE, VERMILION)[k % 4]}
        label = f"$\\alpha = 10^{{{np.log10(alpha):.3g}}}$ rad$^{{-1}}$"
        if np.isinf(alpha):
            label, line = "clamped dead zone", THIN
        stiffness.plot(x, of_stiffness, label=label, **line)
        torque.plot(x, of_torque, **line)
        least = min(least, of_stiffness[of_stiffness > 0].min(initial=np.inf))
        if alpha > 0.99e5:
            inside.plot(x, of_torque, **line)
            height = max(height, 1.3 * np.abs(of_torque[in_gap]).max())
    for axis in (stiffness, torque, inside):
        for edge in (-delta_rad, delta_rad):
            axis.axvline(MRAD * edge, **DOTTED)
    stiffness.set(ylabel="stiffness $K_{\\mathrm{BL}}$ [N m/rad]", yscale="log")
    stiffness.set_ylim(least / 3)
    torque.set(ylabel="torque $\\tau_l$ [N m]")
    inside.set(ylabel="torque $\\tau_l$ [N m]", title="within the gap")
    inside.set(xlabel="displacement $\\Delta\\theta$ [mrad]")
    inside.set(xlim=(-1.02 * MRAD * delta_rad, 1.02 * MRAD * delta_rad))
    if height > 0:  # the clamped one has none
        inside.set_ylim(-height, height)
    return finish(figure, 2, "outside upper center")


@in_style
def simulated_joint(
    time_s: FloatArray,
    signals: Sequence[tuple[str, FloatArray, FloatArray | None]],
    stand_in: str = "",
) -> Figure:
    """Figure 10: signals of the simulated joint, over a recorded one or a named stand-in, the difference beneath."""
    heights = [part for *_, other in signals for part in ([1.0] if other is None else [1.0, 0.5])]
    figure, axes = grid(
        len(heights), 1, height_in=0.6 + 1.25 * sum(heights), sharex=True, height_ratios=heights
    )
    panels = iter(axes[:, 0])
    for label, simulated, other in signals:
        axis = next(panels)
        if other is not None:
            look = STAND_IN if stand_in else LOG
            axis.plot(time_s, other, label=stand_in or "authors' record", **look)
            below = next(panels)
            below.axhline(0, **THIN)
            below.plot(time_s, simulated - other, label="the difference", **RESIDUAL)
            below.set_ylabel("[" + label.rpartition("[")[2])
            _centre(below)
        axis.plot(time_s, simulated, label="simulated joint", **FIT)
        axis.set(ylabel=label, xlim=(time_s[0], time_s[-1]))
        if simulated.min() < 0 < simulated.max():
            _centre(axis)
    axes[-1, 0].set(xlabel="time $t$ [s]")
    figure.align_ylabels()
    return finish(figure, 2, "outside upper center")


@in_style
def growth(
    disturbances: Mapping[float, Sequence[FloatArray]],
    peaks: pd.DataFrame,
    printed: Mapping[float, float],
) -> Figure:
    """Figure 11: the disturbance at growing backlash, and its peak beside the printed A [rps] by backlash [rad].

    `disturbances` gives times [s] and the disturbance [rps] by backlash [rad].
    """
    figure, ((upper,), (lower,)) = grid(2, 1, height_in=5.0)
    largest = 1.1 * MRAD * max(disturbances)
    shades = plt.cm.ScalarMappable(plt.Normalize(0, largest), "viridis")
    for delta, (time_s, r) in disturbances.items():
        upper.plot(time_s, r, color=shades.to_rgba(np.array(MRAD * delta)), linewidth=0.9)
    upper.set(xlabel="time in a settled turn [s]", ylabel="disturbance $v - v_t$ [rps]")
    figure.colorbar(shades, ax=upper, label=BACKLASH_LABEL)
    delta = MRAD * peaks["delta_rad"]
    lower.plot(delta, peaks["amplitude_rps"], "o-", label="our peak before sampling", **OURS)
    sampled = {"color": SKY, "mfc": "none", "label": "our peak of the 2 ms samples"}
    lower.plot(delta, peaks["sampled_rps"], "s--", **sampled)
    at = MRAD * np.array(list(printed))
    lower.plot(at, list(printed.values()), **PRINTED, label="printed theoretical $A$")
    lower.set(xlabel=BACKLASH_LABEL, ylabel="amplitude $A$ [rps]")
    return finish(figure, 2)


@in_style
def characteristic(
    curves: Mapping[str, Sequence[FloatArray]],
    points: Mapping[str, Sequence[FloatArray]],
    residuals: Mapping[str, Sequence[FloatArray]],
) -> Figure:
    """Figure 12: curves and points of (A [rps], delta [rad]) by name, and differences of two of them [rad] beneath.

    The first points are the printed ones, the second ours.
    """
    figure, ((upper,), (lower,)) = grid(2, 1, height_in=4.6, sharex=True, height_ratios=(2, 1))
    looks = {"color": INK, "linestyle": "-"}, {"color": BLUE, "linestyle": "--"}
    for (label, (A, delta)), look in zip(curves.items(), looks, strict=False):
        upper.plot(A, MRAD * delta, label=label, linewidth=1.0, **look)
    marks = PRINTED, {"color": BLUE, "marker": "s", "linestyle": "none", "mfc": "none"}
    for (label, (A, delta)), mark in zip(points.items(), marks, strict=False):
        upper.plot(A, MRAD * delta, label=label, **mark)
    marks = PRINTED | {"marker": "o", "mfc": "none", "mew": 1.0}, RESIDUAL | {"linestyle": "--"}
    for (label, (A, residual)), mark in zip(residuals.items(), marks, strict=False):
        lower.plot(A, MRAD * residual, label=label, **mark)
    lower.axhline(0, **THIN)
    lower.set(xlabel="amplitude $A$ [rps]", ylabel="difference [mrad]")
    _centre(lower)
    upper.set(ylabel=BACKLASH_LABEL)
    return finish(figure, 1)


@in_style
def table2(rows: pd.DataFrame) -> Figure:
    """Table 2: printed means and SDs, ours with their intervals, and the theoretical A.

    `rows` has a row for each of the eleven of the table, by its number: `mean, mean_ours, mean_low, mean_high` and
    the same of `sd` [rps], and `theoretical`. The last row, noise alone, has a panel of its own for the mean.
    """
    shape: list[Any] = [["mean", "noise"], ["sd", "sd"]]
    figure, panels = plt.subplot_mosaic(shape, figsize=(WIDTH_IN, 5.2), width_ratios=(9, 1))
    upper, noise, lower = panels["mean"], panels["noise"], panels["sd"]
    ten = rows[rows["theoretical"] > 0]
    percent = 100 / ten["mean"]
    in_percent = ten.mul(percent, axis=0) - 100
    _printed_and_ours(upper, in_percent, "mean")
    aside: Style = {"color": GREEN, "mfc": "none", "label": "theoretical $A$"}
    upper.plot(ten.index + 0.4, in_percent["theoretical"], "<", **aside)
    _printed_and_ours(noise, rows.drop(ten.index), "mean")
    _printed_and_ours(lower, rows, "sd")
    upper.set(title="mean of $A$", ylabel="off the printed mean [%]", xticks=ten.index)
    upper.set_xticks(ten.index, ["1*", *ten.index[1:]])
    noise.set(title="[rps]", xticks=rows.index.difference(ten.index), xlim=(10.2, 11.8))
    noise.yaxis.tick_right()
    lower.set(title="SD of $A$", ylabel="SD of $A$ [rps]", yscale="log")
    lower.set_xticks(rows.index, ["1*", *rows.index[1:]])
    lower.set(xlabel="row of Table 2 (1*: on a simulated record, 11: noise alone)")
    return finish(figure, 2)


def _printed_and_ours(axis: Axes, rows: pd.DataFrame, of: str) -> None:
    """Draw an interval as a bar with our number as a line across it, and the printed one as a cross."""
    printed, ours, low, high = (rows[of + end] for end in ("", "_ours", "_low", "_high"))
    axis.use_sticky_edges = False  # an interval that ends at the frame would look cut
    axis.bar(rows.index, high - low, 0.6, low, color="0.85", label="our 95 % prediction interval")
    line: Style = OURS | {"linewidth": 2.0, "label": "our median"}
    axis.hlines(ours, rows.index - 0.3, rows.index + 0.3, **line)
    agrees = (printed >= low) & (printed <= high)
    axis.plot(printed[agrees], **PRINTED, label="printed, agrees")
    if not agrees.all():
        axis.plot(printed[~agrees], **DIFFERS, label="printed, differs")


@in_style
def means_beside(rows: pd.DataFrame) -> Figure:
    """Table 3: printed mean and SD of A, and the known A, beside those of a stand-in.

    `rows` has the columns of `standins.table3`, and names of its rows.
    """
    figure, axis = panel(3.0)
    at = np.arange(len(rows))
    style: Style = {"fmt": "s", "color": PINK, "label": "stand-in (simulated)"}
    axis.errorbar(at - 0.1, rows["mean_A_rps"], rows["sd_A_rps"], **style)
    printed = PRINTED | {"label": "printed, not tested"}
    axis.errorbar(at + 0.1, rows["printed_mean"], rows["printed_sd"], **printed)
    known: Style = {"color": GREEN, "mfc": "none", "label": "printed known $A$"}
    axis.plot(at + 0.25, rows["printed_known"], "<", **known)
    axis.margins(y=0.1)
    axis.set(ylabel="mean and SD of $A$ [rps]", ylim=(0, None))
    axis.set_xticks(at, rows.index)
    return finish(figure, 2)


@in_style
def search_map(
    t0: FloatArray,
    omega: FloatArray,
    misfits: FloatArray,
    members: Mapping[int, FloatArray],
    best: tuple[float, float],
) -> Figure:
    """The members of some generations, shape (number, 2), on the map of the misfit of t0 and omega."""
    figure, axes = grid(2, 2, height_in=4.4, sharex=True, sharey=True)
    for axis, (generation, drawn) in zip(axes.flat, members.items(), strict=False):
        shades = axis.contourf(t0, omega, misfits, 20, cmap="Greys_r")
        axis.plot(*drawn.T, "o", color="white", mec=INK, mew=0.6, label="members")
        axis.plot(*best, "X", color=BLUE, mec="white", mew=0.6, markersize=9, label="best fit")
        axis.set(title=f"generation {generation}", xlim=(t0[0], t0[-1]), ylim=(omega[0], omega[-1]))
    for axis in axes[-1]:
        axis.set(xlabel="start $t_0$ [s]")
    for axis in axes[:, 0]:
        axis.set(ylabel="$\\omega$ [rad/s]")
    figure.colorbar(shades, ax=axes, location="top", aspect=40, label="misfit [rps]")
    return finish(figure, 2)


@in_style
def detection(
    A_rps: Mapping[str, FloatArray],
    lines: Mapping[str, float],
    detected: Mapping[str, Sequence[FloatArray]],
) -> Figure:
    """Table 4: how many stand-in robots of each kind have which A, and what a threshold of A would detect.

    `lines` are A [rps] by what they are; `detected` gives, by name, percents of the healthy that are called excessive
    and of the excessive that are detected.
    """
    figure, ((upper,), (lower,)) = grid(2, 1, height_in=5.4)
    ends = np.concatenate(list(A_rps.values()))
    bins = np.linspace(0, 1.02 * ends.max(), 25)
    looks = {"color": SKY, "hatch": ""}, {"color": PINK, "hatch": "///"}
    for (kind, of_kind), look in zip(A_rps.items(), looks, strict=False):
        upper.hist(of_kind, bins, alpha=0.6, label=kind, **look)
    for (name, A), style in zip(lines.items(), (":", "--", "-"), strict=False):
        upper.axvline(A, 0, 0.68, color=INK, linestyle=style, label=name)
    upper.set(xlabel="fitted $A$ [rps]", ylabel="number of robots")
    for (name, (false, true)), style in zip(
        detected.items(), cycle(("-", "--", ":")), strict=False
    ):
        lower.step(false, true, where="post", color=INK, linestyle=style, label=name)
    lower.set(xlabel="healthy called excessive [%]", ylabel="excessive detected [%]")
    upper.set_ylim(0, 1.6 * upper.get_ylim()[1])
    upper.legend(fontsize=8, ncols=2, loc="upper left")
    lower.legend(fontsize=8)
    letter_panels([upper, lower])
    return figure


@in_style
def multiverse(choices: pd.DataFrame) -> Figure:
    """Table 2 as a whole in all choices: start and settings downwards, numbers and score across, a p in each cell.

    `choices` are those of `evidence.make_multiverse`.
    """
    of_row, of_column = ["start", "settings"], ["numbers", "score"]
    rows, columns = (
        [*choices[names].drop_duplicates().itertuples(index=False, name=None)]
        for names in (of_row, of_column)
    )
    y, x = _spread(rows, 1.2), _spread(columns, 0.4)
    figure, axis = panel(0.2 * (max(y.values()) + 7))
    small: Style = {"fontsize": 7.5, "va": "center"}
    for choice in choices.to_dict("records"):
        at = x[choice["numbers"], choice["score"]], y[choice["start"], choice["settings"]]
        shade = sum(choice["p"] < level for level in (0.05, 0.01, 0.001))
        face = ("white", "0.8", "0.45", "0.15")[shade]
        axis.add_patch(plt.Rectangle(at, 1, 1, facecolor=face, edgecolor="0.6", linewidth=0.3))
        written = _write_choice(choice)
        size = 7 if len(written) < 5 else 6
        text = small | {"ha": "center", "color": "white" if shade > 1 else INK, "fontsize": size}
        axis.text(at[0] + 0.5, at[1] + 0.55, written, **text)
    tables = choices.groupby(of_row)["tables"].first()
    for (start, settings), top in y.items():
        if (start, settings) == next(row for row in rows if row[0] == start):
            title = start if start == "whole record" else f"start drawn {start}"
            axis.text(-0.2, top - 0.45, title, ha="right", style="italic", **small)
        label = f"{settings.replace('population ', '')} ({tables[start, settings]})"
        axis.text(-0.2, top + 0.55, label, ha="right", **small)
    for (_, score), left in x.items():
        axis.text(left + 0.5, -0.2, score, ha="center", rotation=90, **small | {"va": "bottom"})
    bottom = max(y.values()) + 1
    for numbers in dict.fromkeys(name for name, _ in columns):
        middle = np.mean([left for (name, _), left in x.items() if name == numbers]) + 0.5
        axis.text(float(middle), bottom + 0.7, numbers, ha="center", **small)
    axis.set(xlim=(-4.7, max(x.values()) + 1.2), ylim=(bottom + 1.3, -5))
    axis.set(xlabel="numbers and score", ylabel="start and settings")
    axis.axis("off")
    return figure


def _spread(keys: Sequence[tuple[str, str]], gap: float) -> dict[tuple[str, str], float]:
    """Put keys one after another, with a gap where the first name changes."""
    names = [*dict.fromkeys(name for name, _ in keys)]
    return {key: k + gap * names.index(key[0]) for k, key in enumerate(keys)}


def _write_choice(choice: Mapping[Any, Any]) -> str:
    """Write a count, or a p without its zero: ".13", ".003", "0"; "≤" where no table of ours lies as far out."""
    if choice["p"] < 0.0005:
        return "0"
    if not np.isfinite(choice["p"]):
        return f"{choice['inside']:.0f}" if np.isfinite(choice["inside"]) else "–"
    text = f"{choice['p']:.3f}" if choice["p"] < 0.0095 else f"{choice['p']:.2f}"
    bound = "≤" if choice["by"] == "tables" and choice["p"] <= 1.001 * choice["least_p"] else ""
    return bound + text.removeprefix("0")
