"""Plots of the stand-ins for the bench and the robots: data frames in, a matplotlib figure out."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from replication import figures as house
from replication.figures import BLUE, GREEN, INK, ORANGE, PINK, grid, in_style


@in_style
def table3(table: pd.DataFrame, population: pd.DataFrame) -> Figure:
    """Show Table 3: the stand-in's mean and SD, the printed ones, the known A, and what other benches give."""
    figure, ((axis,),) = grid(height_in=3.6)
    delta = 1e3 * table["delta_rad"].to_numpy()
    beside, far_beside = delta + 0.012, delta + 0.02
    others = f"{population['bench'].nunique()} other benches, global fit"
    at = 1e3 * population["delta_rad"] - 0.012
    axis.plot(at, population["A_rps"], "o", color="0.6", mfc="none", label=others)
    label = f"stand-in bench, {table['runs'].iloc[0]} runs"
    axis.errorbar(delta, table["mean_A_rps"], table["sd_A_rps"], fmt="s", label=label)
    dash = {"color": GREEN, "markersize": 14, "mew": 2}
    axis.plot(delta, table["best_A_rps"], "_", label="its best basin", **dash)
    printed = house.PRINTED | {"label": "printed, not tested", "elinewidth": 1}
    axis.errorbar(beside, table["printed_mean_A_rps"], table["printed_sd_A_rps"], **printed)
    cross = {"color": ORANGE, "markersize": 10, "label": "printed known $A$"}
    axis.plot(far_beside, table["printed_known_A_rps"], "+", **cross)
    axis.set(xlabel=house.BACKLASH_LABEL, ylabel="$A$ [rps]", xticks=delta)
    return house.finish(figure, 2)


@in_style
def load_friction(logs: pd.DataFrame, study: pd.DataFrame) -> Figure:
    """Show A over friction on the load, and the shares of variance that the fit explains and could explain at most."""
    figure, ((above,), (below,)) = grid(2, 1, height_in=4.4, sharex=True, height_ratios=(3, 2))
    explained = 100 * (1 - (logs["rmse_rps"] / logs["sd_rps"]) ** 2)
    share, studied = 100 * logs["friction_share"], 100 * study["friction_share"]
    above.plot(studied, study["A_rps"], color=BLUE, linewidth=0.9, label="mean")
    for kept, fill, label in (
        (explained >= 50, BLUE, "at least"),
        (explained < 50, "white", "less than"),
    ):
        style = {"mfc": fill, "label": f"fit explains {label} 50 %"}
        above.plot(share[kept], logs["A_rps"][kept], "o", color=BLUE, **style)
    repeats = {"color": INK, "label": "repeats with opposite sign"}
    below.plot(studied, study["opposite_percent"], **repeats)
    below.plot(share, explained, "s", color=ORANGE, label="explained by the fit")
    above.set(ylabel="fitted $A$ [rps]", ylim=(0, None))
    friction = "friction on the load, share of m g r [%]"
    below.set(xlabel=friction, ylabel="share of variance [%]", ylim=(0, 102))
    return house.finish(figure, 2)


@in_style
def robots(
    population: pd.DataFrame, curves: Mapping[str, tuple[pd.DataFrame, float]], marks: pd.DataFrame
) -> Figure:
    """Show A of healthy robots and of those with excessive backlash, and the ROC curve of a threshold on A."""
    figure, ((left, right),) = grid(1, 2, height_in=3.8)
    edges = np.linspace(0, 1.02 * population["A_rps"].max(), 40)
    for kind, part in population.groupby("kind", sort=False):
        left.hist(part["A_rps"], edges, alpha=0.55, label=f"{kind}, {len(part)} robots")
    for (label, (curve, area)), line in zip(curves.items(), ("-", "--", ":"), strict=False):
        shares = 100 * curve["false_alarms"], 100 * curve["detected"]
        right.plot(*shares, line, color=PINK, label=f"{label}, area {area:.3f}")
    for mark, marker, line in zip(marks.to_dict("records"), "xPD", (":", "-.", "-"), strict=False):
        at, label = mark["threshold_rps"], f"{mark['name']}: {mark['threshold_rps']:.4f} rps"
        style = {"color": INK, "marker": marker, "markersize": 6, "linestyle": line}
        style |= {"clip_on": False, "zorder": 3}
        left.axvline(at, label=label, markevery=[1], **style)
        right.plot(100 * mark["false_alarms"], 100 * mark["detected"], **style)
    left.set(xlabel="fitted $A$ [rps]", ylabel="number of robots [-]")
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
    low, high = sweep["disturbance_hz"].agg(["min", "max"])
    odd = turn_hz * np.arange(1, high / turn_hz + 1, 2)
    of_turn = {"color": "0.85", "linewidth": 4, "label": "odd harmonics of the load's turn"}
    for frequency in odd[odd >= low]:
        axis.axvline(frequency, **of_turn)
    shares = sweep.groupby("torque_share", sort=False)
    for (share, part), marker in zip(shares, "osv^D", strict=False):
        label = f"{100 * share:.0f} % of m g r, up to {part['disturbance_rps'].max():.2f} rps"
        (line,) = axis.plot(part["disturbance_hz"], part["A_rps"], marker=marker, label=label)
        few = part[part["turns_used"] < 2]
        hollow = {"color": line.get_color(), "mfc": "white"}
        axis.plot(few["disturbance_hz"], few["A_rps"], marker, **hollow)
    axis.plot([], [], "o", color=INK, mfc="white", label="fit of less than two turns")
    unknown = sweep[sweep["low_rps"] <= 0]
    crossed = {"color": INK, "label": "95 % interval contains 0"}
    axis.plot(unknown["disturbance_hz"], unknown["A_rps"], "x", **crossed)
    for (name, amplitude), style in zip(thresholds.items(), ("--", "-."), strict=False):
        axis.axhline(amplitude, color=INK, linestyle=style, linewidth=1, label=name)
    axis.set(
        xlabel="frequency of the disturbance [Hz]",
        ylabel="fitted $A$ without backlash [rps]",
        ylim=(0, None),
    )
    return house.finish(figure, 2)
