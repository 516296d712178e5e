"""The style of every figure, and how a figure is written."""

from collections.abc import Callable, Iterable
from functools import wraps
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler

# Okabe and Ito's colours, ordered so that neighbours also differ in grey.
INK = "#000000"
BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
PINK = "#CC79A7"
SKY = "#56B4E9"

Style = dict[str, Any]
THIN: Style = {"color": INK, "linewidth": 0.8}
MARKS: Style = {"color": INK, "marker": "x", "linestyle": "none", "markersize": 7}
PRINTED = MARKS | {"label": "printed in the paper"}

WIDTH_IN = 5.3  # in a journal's column of 85 mm the smallest text, 8 pt, has 5 pt
BACKLASH_LABEL = "backlash $\\delta$ [$10^{-4}$ rad]"

STYLE: dict[Any, Any] = {
    "figure.figsize": (WIDTH_IN, 3.2),
    "figure.dpi": 100,
    "figure.constrained_layout.use": True,
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
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


def in_style(plot: Callable[..., Figure]) -> Callable[..., Figure]:
    """Draw a figure in the workbook's style, leaving matplotlib's settings alone."""

    @wraps(plot)
    def styled(*args, **options) -> Figure:
        with mpl.rc_context(STYLE):
            figure = plot(*args, **options)
            interactive = mpl.is_interactive()
        # A notebook's backend switches this on with its first figure; off again, no other figure
        # would be shown.
        mpl.interactive(interactive)
        return figure

    return styled


def save(figure: Figure, folder: Path, name: str, mark: str = "") -> None:
    """Write a figure as SVG and PNG, without anything that differs from run to run."""
    folder.mkdir(parents=True, exist_ok=True)
    if mark:
        style: Style = {"fontsize": 40, "color": "0.6", "alpha": 0.4, "rotation": 20}
        figure.text(0.5, 0.5, mark, ha="center", va="center", **style)
    with mpl.rc_context(STYLE):
        figure.savefig(
            folder / f"{name}.svg", metadata={"Date": None, "Description": description(figure)}
        )
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


def grid(
    rows: int = 1, columns: int = 1, height_in: float = 3.2, **options
) -> tuple[Figure, np.ndarray]:
    """Make a figure and its axes, always as an array of shape (rows, columns)."""
    return plt.subplots(rows, columns, squeeze=False, figsize=(WIDTH_IN, height_in), **options)


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
        letter_panels(panels)
    listed = [zip(*axis.get_legend_handles_labels(), strict=True) for axis in panels]
    entries = {label: handle for handles in listed for handle, label in handles}
    if entries:
        figure.legend(entries.values(), entries.keys(), loc=loc, ncols=columns)
    return figure
