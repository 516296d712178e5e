"""How figures look; and figure 6. A figure of a notebook's own begins with `panel` or `stack`.

One look means one thing in all figures: `LOG` what was recorded, `FIT` what was fitted or simulated over it, `RESIDUAL`
what that leaves, `OURS` what we computed, `PRINTED` what the paper prints, `DIFFERS` a printed number outside our
interval.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler

from replication.signature import FloatArray, Parameters, Timing

Style = dict[str, Any]

# Okabe and Ito's colours, ordered so that neighbours also differ in grey.
INK = "#000000"
BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
PINK = "#CC79A7"
SKY = "#56B4E9"
VERMILION = "#D55E00"
LOG: Style = {"color": ORANGE, "linewidth": 3.0, "alpha": 0.8}
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
    def styled(*args: Any, **options: Any) -> Figure:
        with mpl.rc_context(STYLE):
            figure = plot(*args, **options)
            interactive = mpl.is_interactive()
        # A notebook's backend switches this on with its first figure; off again, no other figure would be shown.
        mpl.interactive(interactive)
        return figure

    return styled


def stack(rows: int, height_in: float = 3.2, sharex: bool = True) -> tuple[Any, ...]:
    """Make a figure in the workbook's style; it, and its panels from the top, which share their x or do not."""
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(
            rows, squeeze=False, figsize=(WIDTH_IN, height_in), sharex=sharex
        )
    return figure, *axes[:, 0]


def panel(height_in: float = 3.2) -> tuple[Any, ...]:
    """Make a figure in the workbook's style, and its only panel."""
    return stack(1, height_in)


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


def centre(axis: Axes) -> None:
    """Put zero into the middle of a residual's axis."""
    limit = 1.1 * np.abs(axis.get_ylim()).max()
    axis.set_ylim(-limit, limit)


@in_style
def signature_parameters(t: FloatArray, h: FloatArray, X: FloatArray, timing: Timing) -> Figure:
    """Figure 6: the signature h(t) over some turns, and its first oscillation, with the instants and intervals."""
    figure, turns, first = stack(2, 4.4, sharex=False)
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
