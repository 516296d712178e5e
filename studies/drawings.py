"""Figures that are long: Table 2, what a threshold detects, the multiverse, the claims' margins."""

import textwrap
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

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
def draw_table2(rows: pd.DataFrame) -> Figure:
    """Table 2: printed means and SDs, ours with their intervals, and the theoretical A.

    `rows` has a row for each of the eleven of the table, by its number: `mean, mean_ours, mean_low, mean_high` and
    the same of `sd` [rps], and `theoretical`. The last row, noise alone, has a panel of its own for the mean.
    """
    shape: list[Any] = [["mean", "noise"], ["sd", "sd"]]
    figure, panels = plt.subplot_mosaic(shape, figsize=(WIDTH_IN, 5.2), width_ratios=(9, 1))
    upper = panels["mean"]
    noise = panels["noise"]
    lower = panels["sd"]
    ten = rows[rows["theoretical"] > 0]
    in_percent = ten.mul(100 / ten["mean"], axis=0) - 100
    _printed_and_ours(upper, in_percent, "mean")
    aside: Style = {"color": GREEN, "mfc": "none", "label": "theoretical $A$"}
    upper.plot(ten.index + 0.4, in_percent["theoretical"], "<", **aside)
    _printed_and_ours(noise, rows.drop(ten.index), "mean")
    _printed_and_ours(lower, rows, "sd")
    upper.set(title="mean of $A$", ylabel="off the printed mean [%]", xticks=ten.index)
    delta = MRAD * printed_rows()["delta_rad"]
    levels = [f"{row}{'*' * (row == 1)}\n{delta[row]:.1f}" for row in ten.index]
    upper.set_xticks(ten.index, levels)
    noise.set(title="[rps]", xticks=rows.index.difference(ten.index), xlim=(10.2, 11.8))
    noise.yaxis.tick_right()
    lower.set(title="SD of $A$", ylabel="SD of $A$ [rps]", yscale="log")
    lower.set_xticks(rows.index, [*levels, *map(str, rows.index[len(levels) :])])
    lower.set(
        xlabel="row of Table 2 above its backlash [mrad]\n(1*: on a simulated record, 11: noise alone)"
    )
    return finish(figure, 2)


def _printed_and_ours(axis: Axes, rows: pd.DataFrame, of: str) -> None:
    """Draw an interval as a bar with our number as a line across it, and the printed one as a cross."""
    printed = rows[of]
    low = rows[f"{of}_low"]
    high = rows[f"{of}_high"]
    axis.use_sticky_edges = False  # an interval that ends at the frame would look cut
    axis.bar(rows.index, high - low, 0.6, low, color="0.85", label="our 95 % prediction interval")
    line: Style = OURS | {"linewidth": 2.0, "label": "our median"}
    axis.hlines(rows[f"{of}_ours"], rows.index - 0.3, rows.index + 0.3, **line)
    agrees = (printed >= low) & (printed <= high)
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
    ends = np.concatenate(list(A_rps.values()))
    bins = np.linspace(0, 1.02 * ends.max(), 25)
    # Filled and framed: a hatch is not drawn by every renderer of SVG.
    looks = {"color": SKY, "alpha": 0.6}, {"edgecolor": VERMILION, "fill": False, "linewidth": 1.6}
    for (kind, of_kind), look in zip(A_rps.items(), looks, strict=False):
        upper.hist(of_kind, bins, histtype="stepfilled", label=kind, **look)
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


SHADES = ("white", "0.8", "0.45", "0.15")  # of a p of 0.05 and more, and below each of
P_LEVELS = (0.05, 0.01, 0.001)
SMALL: Style = {"fontsize": 7.5, "va": "center"}


@in_style
def draw_multiverse(choices: pd.DataFrame, why: Mapping[str, str]) -> Figure:
    """Table 2 as a whole in all choices: start and settings downwards, numbers and score across, a p in each cell.

    `choices` are those of `multiverse.make_multiverse`; `why` says, by start and by the first word of settings, why
    each may be Table 2's.
    """
    y = _spread(choices, ["start", "settings"], 1.2)
    x = _spread(choices, ["numbers", "score"], 0.4)
    bottom = max(y.values()) + 1
    right = max(x.values()) + 1.3
    figure, axis = plt.subplots(figsize=(6.9, 0.2 * (bottom + 8)))
    for choice in choices.to_dict("records"):
        corner = x[choice["numbers"], choice["score"]], y[choice["start"], choice["settings"]]
        shade = sum(choice["p"] < level for level in P_LEVELS)
        _draw_cell(axis, corner, shade, _write_choice(choice))
    titled: set[str] = set()
    for (start, settings), part in choices.groupby(["start", "settings"], sort=False):
        top = y[start, settings]
        if start not in titled:
            title = start if start == WHOLE else f"start drawn {start}"
            axis.text(-0.2, top - 0.45, title, ha="right", style="italic", **SMALL)
            axis.text(right, top - 0.45, why[start], style="italic", **SMALL)
            titled.add(start)
        label = f"{settings.replace('population ', '')} ({part['tables'].iloc[0]})"
        axis.text(-0.2, top + 0.55, label, ha="right", **SMALL)
        reason = why.get(settings, why.get(settings.partition(",")[0], ""))
        axis.text(right, top + 0.55, reason, **SMALL)
    for (_, score), left in x.items():
        axis.text(left + 0.5, -0.2, score, ha="center", rotation=90, **SMALL | {"va": "bottom"})
    axis.text(right, -1.6, "why it may be Table 2's", **SMALL)
    for numbers in choices["numbers"].unique():
        middle = np.mean([left for (name, _), left in x.items() if name == numbers]) + 0.5
        axis.text(float(middle), bottom + 0.7, numbers, ha="center", **SMALL)
    key = ["p at least 0.05", *(f"below {level:g}" for level in P_LEVELS)]
    for k, words in enumerate(key):
        _draw_cell(axis, (4.2 * k, bottom + 1.7), k, "")
        axis.text(4.2 * k + 1.1, bottom + 2.25, words, **SMALL)
    axis.set(xlim=(-4.7, right + 6.2), ylim=(bottom + 3, -5))
    axis.set(xlabel="numbers and score", ylabel="start and settings")
    axis.axis("off")
    return figure


def _draw_cell(axis: Axes, corner: tuple[float, float], shade: int, written: str) -> None:
    """Draw a cell of a table at its upper left corner, shaded by its p, with a gap to the next."""
    left, top = corner
    frame: Style = {"facecolor": SHADES[shade], "edgecolor": "0.6", "linewidth": 0.3}
    axis.add_patch(plt.Rectangle((left + 0.04, top + 0.05), 0.92, 0.9, **frame))
    text: Style = {"ha": "center", "color": "white" if shade > 1 else INK}
    text["fontsize"] = 7 if len(written) < 5 else 6
    axis.text(left + 0.5, top + 0.55, written, **SMALL | text)


def _spread(choices: pd.DataFrame, names: list[str], gap: float) -> dict[tuple[str, str], float]:
    """Put pairs of choices one after another, with a gap where the first one changes."""
    pairs = choices[names].drop_duplicates().to_numpy().tolist()
    groups = [*dict.fromkeys(group for group, _ in pairs)]
    return {(group, name): k + gap * groups.index(group) for k, (group, name) in enumerate(pairs)}


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
    compared = {claim: numbers for claim, (numbers, _) in write_all(measured).items()}
    ends = sorted((*margin(claim, compared[claim], criteria), claim) for claim in compared)
    figure, axis = panel(0.6 + 0.36 * len(ends))
    low_end, high_end = SHOWN[0] * 1.4, SHOWN[1] / 1.4
    for row, (low, high, claim) in enumerate(ends):
        look = LOOKS[decided[claim][0]]
        axis.plot(np.clip([low, high], low_end, high_end), [row, row], markersize=5, **look)
        for beyond, end, arrow in (
            (low < SHOWN[0], low_end, "<"),
            (high > SHOWN[1], high_end, ">"),
        ):
            if beyond:
                axis.plot(end, row, arrow, color=look["color"], markersize=10)
    axis.axvline(1, **DOTTED | {"linewidth": 1.2})
    claims = published.table("claims")
    same = "the same, " + claims["reading"]
    sentences = claims["quote"].where(claims["of"] == "paper", same)
    sentences = [_wrap(sentences[claim]) for *_, claim in ends]
    axis.set_yticks(range(len(ends)), sentences, fontsize=7)
    axis.set(xscale="log", xlim=SHOWN, xlabel="measured over limit")
    axis.invert_yaxis()
    return finish(figure, 3)


def _wrap(sentence: str) -> str:
    """Write a sentence in two lines at most."""
    return textwrap.fill(
        sentence, SENTENCE_WIDTH, max_lines=2, placeholder=" …", break_on_hyphens=False
    )
