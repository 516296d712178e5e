"""Figures that are long: Table 2, what a threshold detects, the multiverse, the claims' margins."""

import textwrap
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from pandas import DataFrame

from replication import published
from replication.characteristic import printed_rows
from replication.figures import (
    BLUE,
    DIFFERS,
    DOTTED,
    GREEN,
    INK,
    MRAD,
    OURS,
    PRINTED,
    SKY,
    VERMILION,
    WIDTH_IN,
    Style,
    finish,
    in_style,
    letter_panels,
    panel,
    stack,
)
from replication.signature import FloatArray
from replication.table2 import WHOLE
from studies.claims import Numbers, margin, write_all


@in_style
def draw_table2(rows: DataFrame) -> Figure:
    """Table 2: printed means and SDs, ours with their intervals, and the theoretical A.

    `rows` has a row for each of the eleven of the table, by its number: `mean, mean_ours, mean_low, mean_high` and
    the same of `sd` [rps], and `theoretical`. The last row, noise alone, has a panel of its own for the mean.
    """
    shape: list[Any] = [["mean", "noise"], ["sd", "sd"]]
    figure, panels = plt.subplot_mosaic(shape, figsize=(WIDTH_IN, 5.2), width_ratios=(9, 1))
    upper = panels["mean"]
    ten = rows[rows["theoretical"] > 0]
    in_percent = ten.mul(100 / ten["mean"], axis=0) - 100
    _printed_and_ours(upper, in_percent, "mean")
    theoretical = in_percent["theoretical"].set_axis(ten.index + 0.4)
    upper.plot(theoretical, "<", color=GREEN, mfc="none", label="theoretical $A$")
    _printed_and_ours(panels["noise"], rows.drop(ten.index), "mean")
    _printed_and_ours(panels["sd"], rows, "sd")
    upper.set(title="mean of $A$", ylabel="off the printed mean [%]")
    delta = MRAD * printed_rows()["delta_rad"]
    levels = [f"{row}{'*' * (row == 1)}\n{delta[row]:.1f}" for row in ten.index]
    upper.set_xticks(ten.index, levels)
    panels["noise"].set(title="[rps]", xticks=[11], xlim=(10.2, 11.8))
    panels["noise"].yaxis.tick_right()
    panels["sd"].set(title="SD of $A$", ylabel="SD of $A$ [rps]", yscale="log")
    panels["sd"].set_xticks(rows.index, [*levels, "11"])
    panels["sd"].set_xlabel(
        "row of Table 2 above its backlash [mrad]\n(1*: on a simulated record, 11: noise alone)"
    )
    return finish(figure, 2)


def _printed_and_ours(axis: Axes, rows: DataFrame, of: str) -> None:
    """Draw an interval as a bar with our number as a line across it, and the printed one as a cross."""
    printed, low, high = (rows[name] for name in (of, f"{of}_low", f"{of}_high"))
    axis.use_sticky_edges = False  # an interval that ends at the frame would look cut
    axis.bar(rows.index, high - low, 0.6, low, color="0.85", label="our 95 % prediction interval")
    ends = rows.index - 0.3, rows.index + 0.3
    axis.hlines(rows[f"{of}_ours"], *ends, **OURS, linewidth=2.0, label="our median")
    agrees = printed.between(low, high)
    axis.plot(printed[agrees], **PRINTED, label="printed, agrees")
    if not agrees.all():
        axis.plot(printed[~agrees], **DIFFERS, label="printed, differs")


@in_style
def draw_detection(
    A_rps: Mapping[str, FloatArray],
    lines: Mapping[str, float],
    detected: Mapping[str, Sequence[FloatArray]],
) -> Figure:
    """Table 4: how many stand-in robots of each kind have which A, and what a threshold of A would detect.

    `lines` are A [rps] by what they are; `detected` gives, by name, percents of the healthy that are called excessive
    and of the excessive that are detected.
    """
    figure, upper, lower = stack(2, 5.4, sharex=False)
    bins = np.linspace(0, 1.02 * max(map(np.max, A_rps.values())), 25)
    # Filled and framed: a hatch is not drawn by every renderer of SVG.
    looks = {"color": SKY, "alpha": 0.6}, {"edgecolor": VERMILION, "fill": False, "linewidth": 1.6}
    for kind, look in zip(A_rps, looks, strict=True):
        upper.hist(A_rps[kind], bins, histtype="stepfilled", label=kind, **look)
    for name, style in zip(lines, (":", "--", "-"), strict=True):
        upper.axvline(lines[name], 0, 0.68, color=INK, linestyle=style, label=name)
    upper.set(xlabel="fitted $A$ [rps]", ylabel="number of robots")
    for name, style in zip(detected, cycle(("-", "--", ":")), strict=False):
        lower.step(*detected[name], where="post", color=INK, linestyle=style, label=name)
    lower.set(xlabel="healthy called excessive [%]", ylabel="excessive detected [%]")
    upper.set_ylim(0, 1.6 * upper.get_ylim()[1])
    upper.legend(fontsize=8, ncols=2, loc="upper left")
    lower.legend(fontsize=8)
    letter_panels([upper, lower])
    return figure


SHADES = ("white", "0.8", "0.45", "0.15")  # of a p of 0.05 and more, and below each of
P_LEVELS = (0.05, 0.01, 0.001)


@in_style
def draw_multiverse(choices: DataFrame, why: Mapping[str, str]) -> Figure:
    """Table 2 as a whole in all choices: start and settings downwards, numbers and score across, a p in each cell.

    `choices` are those of `multiverse.make_multiverse`; `why` says, by start and by the first word of settings, why
    each may be Table 2's.
    """
    starts = choices.groupby("start", sort=False)
    heights = starts["settings"].nunique()
    figure, axes = plt.subplots(
        len(heights), figsize=(6.9, 6.6), height_ratios=heights, sharex=True
    )
    for axis, (start, cells) in zip(axes, starts, strict=True):
        _draw_cells(axis, cells)
        name = start if start == WHOLE else f"start drawn {start}"
        axis.set_title(f"{name}: {why[start]}", style="italic")
        axis.set_ylabel("settings")
        settings = cells["settings"].unique()
        reasons = [why.get(each, why.get(each.partition(",")[0], "")) for each in settings]
        axis.secondary_yaxis("right").set_yticks(axis.get_yticks(), reasons)
    axes[-1].set_xlabel("numbers and score")
    key = ["p at least 0.05", *(f"below {level:g}" for level in P_LEVELS)]
    patches = [Patch(facecolor=shade, edgecolor="0.6") for shade in SHADES]
    figure.legend(patches, key, loc="outside lower center", ncols=len(key))
    return figure


def _draw_cells(axis: Axes, choices: DataFrame) -> None:
    """Draw settings downwards and scores across, a cell each, shaded by its p."""
    scores = (choices["numbers"] + ", " + choices["score"]).unique()
    labels = (choices["settings"] + choices["tables"].map(" ({})".format)).unique()
    p = choices["p"].to_numpy().reshape(len(labels), -1)
    shades = sum(p < level for level in P_LEVELS)
    axis.pcolormesh(
        shades, cmap=ListedColormap(SHADES), vmax=len(P_LEVELS), edgecolors="0.6", linewidth=0.3
    )
    for (y, x), choice in zip(np.ndindex(p.shape), choices.to_dict("records"), strict=True):
        text = axis.text(x + 0.5, y + 0.5, _write_choice(choice), ha="center", va="center")
        text.set(fontsize=6.5, color="white" if shades[y, x] > 1 else INK)
    axis.set_xticks(np.arange(len(scores)) + 0.5, scores, rotation=90)
    axis.set_yticks(np.arange(len(labels)) + 0.5, labels)
    axis.set_ylim(len(labels), 0)
    axis.grid(False)


def _write_choice(choice: Mapping[Any, Any]) -> str:
    """Write a count, or a p without its zero: ".13", ".003", "0"; "≤" where no table of ours is as extreme."""
    if choice["p"] < 0.0005:
        return "0"
    if not np.isfinite(choice["p"]):
        return f"{choice['inside']:.0f}" if np.isfinite(choice["inside"]) else "–"
    text = f"{choice['p']:.3f}" if choice["p"] < 0.0095 else f"{choice['p']:.2f}"
    bound = "≤" if choice["by"] == "tables" and choice["p"] <= 1.001 * choice["least_p"] else ""
    return bound + text.removeprefix("0")


LOOKS: dict[bool | None, Style] = {
    True: {"label": "holds", "color": BLUE, "marker": "o"},
    False: {"label": "does not hold", "color": VERMILION, "marker": "X"},
    None: {"label": "undecided", "color": INK, "marker": "D"},
}


SHOWN = (1e-2, 1e2)  # of what was measured over its limit; beyond stands an arrow
SENTENCE_WIDTH = 42  # characters a line


@in_style
def draw_margins(
    measured: Mapping[str, Numbers],
    decided: Mapping[str, tuple[bool | None, str]],
    criteria: published.Criteria = None,
) -> Figure:
    """What was measured of each claim over its limit, sorted: left of 1 it holds, right of 1 it does not."""
    compared = write_all(measured)
    ends = sorted((*margin(claim, compared[claim][0], criteria), claim) for claim in compared)
    figure, axis = panel(0.6 + 0.36 * len(ends))
    least, most = SHOWN
    for row, (low, high, claim) in enumerate(ends):
        look = LOOKS[decided[claim][0]]
        shown = np.clip([low, high], 1.4 * least, most / 1.4)
        axis.plot(shown, [row, row], markersize=5, **look)
        arrow: Style = {"color": look["color"], "markersize": 10}
        if low < least:
            axis.plot(shown[0], row, "<", **arrow)
        if high > most:
            axis.plot(shown[1], row, ">", **arrow)
    axis.axvline(1, **DOTTED | {"linewidth": 1.2})
    claims = published.table("claims")
    same = "the same, " + claims["reading"]
    sentences = claims["quote"].where(claims["of"] == "paper", same)
    lines: Style = {"max_lines": 2, "placeholder": " …", "break_on_hyphens": False}
    sentences = [textwrap.fill(sentences[claim], SENTENCE_WIDTH, **lines) for *_, claim in ends]
    axis.set_yticks(range(len(ends)), sentences, fontsize=7)
    axis.set(xscale="log", xlim=SHOWN, xlabel="measured over limit")
    axis.invert_yaxis()
    return finish(figure, 3)
