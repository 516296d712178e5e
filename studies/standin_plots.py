"""Plots of the stand-ins for the bench and the robots: data frames in, a matplotlib figure out."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from replication.arrays import FloatArray
from replication.figures import paper
from replication.figures import style as house
from replication.figures.style import BLUE, GREEN, INK, ORANGE, PINK, SKY, grid, in_style

MARKERS = "osv^D"
COLOURS = (BLUE, ORANGE, GREEN, PINK, SKY)


def motions(
    time_s: FloatArray, signals: Sequence[tuple[str, FloatArray, FloatArray | None]]
) -> Figure:
    """Figure 10 with the stand-in bench in the place of a record."""
    return paper.simulated_joint(time_s, signals, "stand-in bench")


@in_style
def table3(table: pd.DataFrame, population: pd.DataFrame) -> Figure:
    """Show Table 3: the stand-in's mean and SD, the printed ones, the known A, and what other benches give."""
    figure, ((axis,),) = grid(height_in=3.6)
    delta = 1e4 * table["delta_rad"].to_numpy()
    style = {"linestyle": "none", "marker": "s", "color": BLUE}
    label = f"{population['bench'].nunique()} other benches, global fit"
    others = 1e4 * population["delta_rad"] - 0.12, population["A_rps"]
    axis.plot(*others, "o", color="0.6", mfc="none", label=label)
    label = f"stand-in bench, {table['runs'].iloc[0]} runs"
    axis.errorbar(delta, table["mean_A_rps"], table["sd_A_rps"], label=label, **style)
    axis.plot(
        delta, table["best_A_rps"], "_", color=GREEN, markersize=14, mew=2, label="its best basin"
    )
    printed = table["printed_mean_A_rps"], table["printed_sd_A_rps"]
    axis.errorbar(
        delta + 0.12, *printed, elinewidth=1, **house.PRINTED | {"label": "printed mean and SD"}
    )
    axis.plot(
        delta + 0.2,
        table["printed_known_A_rps"],
        "+",
        color=ORANGE,
        markersize=10,
        label="printed known A",
    )
    axis.set(
        xlabel=house.BACKLASH_LABEL,
        ylabel="A [rps]",
        xticks=delta,
        xlim=(delta.min() - 0.4, delta.max() + 0.4),
    )
    return house.finish(figure, 2)


@in_style
def load_friction(logs: pd.DataFrame, study: pd.DataFrame) -> Figure:
    """Show A over friction on the load, and the shares of variance that the fit explains and could explain at most."""
    figure, ((above,), (below,)) = grid(2, 1, height_in=4.4, sharex=True, height_ratios=(3, 2))
    explained = 100 * (1 - (logs["rmse_rps"] / logs["sd_rps"]) ** 2)
    share = 100 * logs["friction_share"]
    above.plot(
        100 * study["friction_share"], study["A_rps"], color=BLUE, linewidth=0.9, label="mean"
    )
    for kept, fill, label in (
        (explained >= 50, BLUE, "at least"),
        (explained < 50, "white", "less than"),
    ):
        style = {"mfc": fill, "label": f"fit explains {label} 50 %"}
        above.plot(share[kept], logs["A_rps"][kept], "o", color=BLUE, **style)
    below.plot(
        100 * study["friction_share"],
        study["opposite_percent"],
        color=INK,
        label="repeats with opposite sign",
    )
    below.plot(share, explained, "s", color=ORANGE, label="explained by the fit")
    above.set(ylabel="fitted A [rps]", ylim=(0, None))
    below.set(
        xlabel="friction on the load, share of m g r [%]",
        ylabel="share of variance [%]",
        ylim=(0, 102),
    )
    return house.finish(figure, 2)


@in_style
def robots(
    population: pd.DataFrame, curves: Mapping[str, tuple[pd.DataFrame, float]], marks: pd.DataFrame
) -> Figure:
    """Show A of healthy robots and of those with excessive backlash, and the ROC curve of a threshold on A."""
    figure, ((left, right),) = grid(1, 2, height_in=3.8)
    edges = np.linspace(0, 1.02 * population["A_rps"].max(), 40)
    kinds = population.groupby("kind", sort=False)
    for (kind, part), colour, hatch in zip(kinds, (BLUE, ORANGE), ("////", ""), strict=True):
        style = {"color": colour, "alpha": 0.55, "hatch": hatch, "edgecolor": "white"}
        left.hist(part["A_rps"], edges, label=f"{kind}, {len(part)} robots", linewidth=0, **style)
    for (label, (curve, area)), line, colour in zip(
        curves.items(), ("-", "--", ":"), (BLUE, PINK, PINK), strict=False
    ):
        shares = 100 * curve["false_alarms"], 100 * curve["detected"]
        right.plot(*shares, line, color=colour, label=f"{label}, area {area:.3f}")
    top = left.get_ylim()[1]
    for mark, marker, line in zip(marks.to_dict("records"), "xPD", (":", "-.", "-"), strict=False):
        at, label = mark["threshold_rps"], f"{mark['name']}: {mark['threshold_rps']:.4f} rps"
        style = {
            "color": INK,
            "marker": marker,
            "markersize": 6,
            "linestyle": line,
            "linewidth": 1.2,
            "clip_on": False,
            "zorder": 3,
        }
        left.plot([at, at], [0, top], label=label, markevery=[1], **style)
        right.plot(100 * mark["false_alarms"], 100 * mark["detected"], **style)
    left.set(xlabel="fitted A [rps]", ylabel="number of robots [-]", ylim=(0, top))
    right.set(
        xlabel="healthy called excessive [%]", ylabel="excessive robots found [%]", ylim=(0, 102)
    )
    return house.finish(figure, 2)


@in_style
def robots_disturbance(
    sweep: pd.DataFrame, thresholds: Mapping[str, float], turn_hz: float
) -> Figure:
    """Show the A of a joint without backlash that a sinusoidal disturbance shakes."""
    figure, ((axis,),) = grid(height_in=4.2)
    low, high = sweep["disturbance_hz"].min(), sweep["disturbance_hz"].max()
    odd = turn_hz * np.arange(1, high / turn_hz + 1, 2)
    for place, frequency in enumerate(odd[odd >= low]):
        label = "odd harmonics of the load's turn" if place == 0 else None
        axis.axvline(frequency, color="0.7", linewidth=4, alpha=0.5, label=label)
    for (share, part), colour, marker in zip(
        sweep.groupby("torque_share", sort=False), COLOURS, MARKERS, strict=False
    ):
        heard = part["disturbance_rps"].max()
        label = f"{100 * share:.0f} % of m g r, up to {heard:.2f} rps"
        look = {"marker": marker, "color": colour}
        axis.plot(part["disturbance_hz"], part["A_rps"], linewidth=0.9, label=label, **look)
        few = part[part["turns_used"] < 2]
        axis.plot(few["disturbance_hz"], few["A_rps"], linestyle="none", mfc="white", **look)
    axis.plot([], [], "o", color=INK, mfc="white", label="fit of less than two turns")
    unknown = sweep[sweep["low_rps"] <= 0]
    crossed = {"color": INK, "label": "95 % interval contains 0"}
    axis.plot(unknown["disturbance_hz"], unknown["A_rps"], "x", **crossed)
    for (name, amplitude), style in zip(thresholds.items(), ("--", "-."), strict=False):
        axis.axhline(amplitude, color=INK, linestyle=style, linewidth=1, label=name)
    axis.set(
        xlabel="frequency of the disturbance [Hz]",
        ylabel="fitted A without backlash [rps]",
        ylim=(0, None),
    )
    return house.finish(figure, 2)
