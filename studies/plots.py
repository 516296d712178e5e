"""Plots of what goes past the paper: data frames and arrays in, a matplotlib figure out."""

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator, NullLocator
from pandas import DataFrame, Series
from scipy import stats

from replication.arrays import FloatArray
from replication.figures.style import (
    BACKLASH_LABEL,
    BLUE,
    GREEN,
    INK,
    MARKS,
    ORANGE,
    PINK,
    SKY,
    THIN,
    Style,
    finish,
    grid,
    in_style,
)
from replication.standins.plots import COLOURS, LINES, MARKERS
from studies.population import NORMAL_95, coverage_curve, ranks

# Of text beside a row: its x in shares of the panel.
BESIDE: Style = {"xycoords": ("axes fraction", "data"), "va": "center"}


def _arms(table: DataFrame, middle: str, low: str, high: str) -> FloatArray:
    """Arms of error bars from a middle to its limits, shape (2, rows)."""
    return np.abs(table[[low, high]].to_numpy().T - table[middle].to_numpy())


@in_style
def landscape(
    slices: Sequence[tuple[FloatArray, FloatArray, FloatArray]], runs: DataFrame, best: Series
) -> Figure:
    """Show two slices of the misfit through the best fit, and each `basin` of the runs with their number as area."""
    figure, axes = grid(1, 2, height_in=3.4)
    names = (("t0_s", "A_rps"), ("T2_s", "T1_s"))
    labels = (("$t_0$ [s]", "A [rps]"), ("$T_2$ [s]", "$T_1$ [s]"))
    low = min(misfit.min() for _, _, misfit in slices)
    high = max(misfit.max() for _, _, misfit in slices)
    basins = runs.groupby("basin")
    ends = basins[["t0_s", "A_rps", "T2_s", "T1_s"]].median()
    sizes = basins.size()
    named = sizes.nlargest(3).sort_index().index
    others = sizes.drop(named)
    groups = {f"basin {name}, {sizes[name]} runs": [name] for name in named}
    groups[f"{len(others)} other basins, {others.sum()} runs"] = others.index
    halo = {"path_effects": [withStroke(linewidth=2.8, foreground="white")]}
    cross = halo | {"color": INK, "markersize": 14, "mew": 0.8, "label": "global fit"}
    for axis, (columns, rows, misfit), pair, (xlabel, ylabel) in zip(
        axes[0], slices, names, labels, strict=True
    ):
        shade = axis.pcolormesh(
            columns, rows, misfit, cmap="Greys_r", vmin=low, vmax=high, rasterized=True
        )
        size = np.ptp(columns), np.ptp(rows)
        axis.add_patch(Rectangle((columns[0], rows[0]), *size, fill=False, linewidth=0.8))
        for (label, group), marker, colour in zip(
            groups.items(), "ovsD", (BLUE, ORANGE, GREEN, PINK), strict=True
        ):
            place = ends.loc[group, [*pair]].to_numpy().T
            ring = halo | {
                "marker": marker,
                "facecolors": "none",
                "edgecolors": colour,
                "linewidths": 1.4,
            }
            axis.scatter(*place, s=18 + 4 * sizes[group], zorder=3, label=label, **ring)
        axis.plot(*best[[*pair]], "+", **cross)
        axis.use_sticky_edges = False
        axis.margins(0.08)
        axis.set(xlabel=xlabel, ylabel=ylabel)
        axis.grid(False)
    figure.colorbar(shade, ax=axes[0].tolist(), label="RMSE [rps]")
    return finish(figure, 2)


@in_style
def strategy_costs(table: DataFrame) -> Figure:
    """Show the evaluations that each search strategy spends for one success, with 95 % intervals."""
    figure, ((axis,),) = grid(height_in=0.36 * len(table) + 1.0)
    costs = table.filter(like="evaluations_per_success")
    left = costs.min().min() / 1.5
    right = max(2 * costs[np.isfinite(costs)].max().max(), 2.5 * left)
    arrow = {"linestyle": "--", "marker": ">", "markevery": [1], "clip_on": False, "color": ORANGE}
    for at, row in enumerate(table.itertuples()):
        low = row.evaluations_per_success_low
        if row.found:
            ends = [low, row.evaluations_per_success_high]
            axis.plot(ends, [at, at], color=BLUE, linewidth=1.2, label="95 % interval")
            axis.plot(row.evaluations_per_success, at, "o", color=BLUE, label="estimate")
        else:
            axis.plot([low, right], [at, at], label="no success: above this limit (95 %)", **arrow)
        axis.annotate(f"{row.found} of {row.runs}", (1.04, at), **BESIDE)
    axis.annotate("found in", (1.04, -0.8), annotation_clip=False, **BESIDE)
    names = [textwrap.fill(name, 32) for name in table["strategy"]]
    axis.set_yticks(range(len(table)), names, linespacing=1.1)
    axis.set(xscale="log", xlabel="function evaluations per success [$10^3$]")
    axis.set(xlim=(left, right), ylim=(len(table) - 0.5, -0.5))
    ticks = [tick for tick in (1e4, 2e4, 5e4, 1e5, 2e5, 5e5, 1e6) if left < tick < right]
    axis.set_xticks(ticks, [f"{tick / 1e3:g}" for tick in ticks])
    axis.xaxis.set_minor_locator(NullLocator())
    return finish(figure, 3)


@in_style
def amplitude_intervals(table: DataFrame) -> Figure:
    """Show the global fit's amplitudes and intervals beside Table 2's printed means and SDs."""
    figure, ((axis,),) = grid()
    delta = 1e4 * table["delta_rad"].to_numpy()
    theory = table["theoretical_A_rps"].to_numpy()
    middle = table["A_rps"].to_numpy() / theory
    ends = _arms(table, "A_rps", "low_rps", "high_rps") / theory
    style = {
        "linestyle": "none",
        "marker": "o",
        "color": BLUE,
        "label": "global fit, 95 % interval",
    }
    axis.errorbar(delta - 0.15, middle, ends, **style)
    printed, spread = (
        table[f"printed_{name}_A_rps"].to_numpy() / theory for name in ("mean", "sd")
    )
    style = MARKS | {"elinewidth": 1, "label": "printed mean, SD of 30 runs"}
    axis.errorbar(delta + 0.15, printed, spread, **style)
    axis.axhline(1, label="theoretical A", **THIN)
    axis.set(xlabel=BACKLASH_LABEL, ylabel="A over theoretical A [-]", xticks=np.round(delta))
    return finish(figure, 3)


# A method has one colour and one mark in every figure, a bound its line.
_OF_BOUND: Style = {"color": INK, "linewidth": 1}
_OF_METHOD = {
    "equation 10": (INK, "x"),
    "amplitude": (ORANGE, "s"),
    "impact": (GREEN, "v"),
    "energy": (PINK, "^"),
    "waveform, noisy logs": ("0.5", "d"),
    "waveform": (BLUE, "o"),
    "time in the gap": (GREEN, "<"),
    "joint": (INK, "*"),
    "joint, start angle free": (SKY, "P"),
    "joint, all nuisances free": (SKY, "D"),
}
METHOD_STYLES: dict[str, Style] = {
    "bound, start free": _OF_BOUND | {"linestyle": "-"},
    "bound, start known": _OF_BOUND | {"linestyle": "--"},
    **{name: {"color": colour, "marker": marker} for name, (colour, marker) in _OF_METHOD.items()},
}


@in_style
def cross_validation_errors(table: DataFrame, targets_rad: Mapping[str, float]) -> Figure:
    """Show each method's errors on the logs, their mean size, and targets to meet."""
    figure, ((axis,),) = grid(height_in=3.8)
    target = {
        "color": ORANGE,
        "linewidth": 2,
        "linestyle": (0, (1, 1)),
        "label": "target of the mean",
    }
    sizes = 1e6 * table["error_rad"].abs()
    by_method = dict(list(sizes.groupby(table["method"], sort=False)))
    for row, (method, size) in enumerate(by_method.items()):
        beside = [row - 0.4, row + 0.4]
        dots = METHOD_STYLES[method] | {"linestyle": "none", "alpha": 0.7}
        axis.plot(size, np.full(size.size, row), **dots)
        axis.plot([size.mean()] * 2, beside, color=INK, linewidth=2, label="mean size")
        if method in targets_rad:
            axis.plot([1e6 * targets_rad[method]] * 2, beside, **target)
    axis.set(xscale="log", xlabel="size of the error of the backlash [$10^{-6}$ rad]")
    axis.set_yticks(range(len(by_method)), list(by_method))
    axis.invert_yaxis()
    return finish(figure, 2)


@in_style
def error_limits(table: DataFrame, axes_labels: Mapping[str, str]) -> Figure:
    """Show measured errors as marks and Cramer-Rao bounds as lines, one panel for each thing that changes."""
    figure, axes = grid(2, 2, height_in=5.0)
    for axis, (name, label) in zip(axes.flat, axes_labels.items(), strict=True):
        part = table[table["axis"] == name]
        if name != "encoder_bits":  # its bounds lie lower by orders of magnitude
            axis.sharey(axes[0, 0])
        for method in (
            "bound, start free",
            "bound, start known",
            "amplitude",
            "energy",
            "waveform",
            "joint",
        ):
            rows = part[part["method"] == method]
            style = {
                "linestyle": "none",
                "label": method,
                "markersize": 6,
                "mfc": "none",
            } | METHOD_STYLES[method]
            axis.plot(rows["value"], 1e6 * rows["rmse_rad"], **style)
            if rows.empty:
                axis.set_title(f"{method}: not applied", loc="right", fontsize=8, style="italic")
        axis.set(xlabel=label, yscale="log", xscale="linear" if name == "encoder_bits" else "log")
        values = list(dict.fromkeys(part["value"]))
        axis.set_xticks(values, [f"{value:g}" for value in values])
        axis.xaxis.set_minor_locator(NullLocator())
    figure.supylabel("RMS error of the backlash [$10^{-6}$ rad]", fontsize=9)
    return finish(figure, 3)


@in_style
def detection_curves(table: DataFrame, limits_rad: Sequence[float]) -> Figure:
    """Show the share of records that are seen to have backlash, and what a filter that knows the waveform would see."""
    figure, ((axis,),) = grid()
    parts = table.groupby("noise_half_amplitude_rps", sort=False)
    for (noise, part), limit, colour, marker, line in zip(
        parts, limits_rad, COLOURS, MARKERS, LINES[1:], strict=False
    ):
        style = {"color": colour, "marker": marker, "label": f"energy, noise of {noise:g} rps"}
        arms = _arms(part, "seen", "seen_low", "seen_high")
        axis.errorbar(1e4 * part["delta_rad"], part["seen"], arms, **style)
        axis.axvline(
            1e4 * limit, color=colour, linestyle=line, label=f"matched filter, {noise:g} rps"
        )
    axis.set(
        xlabel=BACKLASH_LABEL,
        ylabel="share of records above\nthe threshold [-]",
        ylim=(-0.03, 1.03),
    )
    return finish(figure, 2)


@in_style
def tornado(table: DataFrame, methods: Sequence[str]) -> Figure:
    """Show the mean error of methods at the ends of what may change, the parameter with the largest on top."""
    order = table["mean_error_rad"].abs().groupby(table["parameter"]).max().sort_values().index
    figure, axes = grid(2, 3, height_in=5.4, sharey=True, sharex=True)
    for axis, method in zip(axes.flat, methods, strict=False):
        changes = table[table["method"] == method].groupby("change")
        for number, (change, part) in enumerate(changes):
            at = order.get_indexer(part["parameter"]) + 0.3 * number - 0.15
            error = 1e6 * part["mean_error_rad"]
            colour, label = COLOURS[number], f"changed by {100 * change:+.0f} %"
            axis.plot(error, at, MARKERS[number], color=colour, label=label)
            axis.hlines(at, 0, error, color=colour, linewidth=1)
        axis.axvline(0, **THIN)
        axis.set_yticks(range(order.size), order)
        axis.set_title(textwrap.fill(method, 16))
        axis.tick_params(labelbottom=True)
    axes[0, 0].xaxis.set_major_locator(MaxNLocator(3))
    axes[1, 2].set_visible(len(methods) > 5)
    figure.supxlabel("mean error of the backlash [$10^{-6}$ rad]", fontsize=9)
    return finish(figure, 2, "outside upper center")


@in_style
def population_errors(rows: DataFrame, populations: Mapping[str, str]) -> Figure:
    """Error of method "self" over the true backlash, its stated size, and how often it is how many stated SDs."""
    figure, axes = grid(
        len(populations), 2, height_in=2.5 * len(populations), width_ratios=(3, 2), sharex="col"
    )
    around = np.linspace(-4, 4, 17)
    answered = rows.query("method == 'self' and not refused")
    for (left, right), (population, title) in zip(axes, populations.items(), strict=True):
        part = answered[answered["population"] == population]
        delta, found, high = (1e4 * part[f"{name}_rad"] for name in ("delta", "found", "high"))
        error, half = found - delta, high - found
        held = error.abs() <= half
        left.plot(delta[held], error[held], ".", color="0.65", label="truth in the 95 % interval")
        left.plot(delta[~held], error[~held], "x", color=ORANGE, label="truth outside")
        edges = np.linspace(delta.min(), delta.max(), 7)
        place = np.digitize(delta, edges[1:-1])
        rms = np.sqrt((error**2).groupby(place).mean())
        stated = half.groupby(place).median()
        for sign in (1, -1):
            left.stairs(
                sign * rms, edges, baseline=None, color=BLUE, linewidth=1.4, label="RMS error"
            )
            dashed = {"color": INK, "linestyle": "--", "label": "median half-width"}
            left.stairs(sign * stated, edges, baseline=None, **dashed)
        left.axhline(0, **THIN)
        left.set(
            ylabel="error [$10^{-4}$ rad]", title=textwrap.fill(f"{title}, n = {len(part)}", 36)
        )
        right.hist((NORMAL_95 * error / half).clip(-4, 4), around, color="0.75", label="logs")
        expected = len(part) * np.diff(stats.norm.cdf(around))
        right.plot(
            (around[1:] + around[:-1]) / 2, expected, ".-", color=BLUE, label="normal distribution"
        )
        right.set(ylabel="number of logs [-]", axisbelow=True)
    axes[-1, 0].set_xlabel(f"true {BACKLASH_LABEL}")
    axes[-1, 1].set_xlabel("error over stated SD [-]")
    return finish(figure, 3)


@in_style
def posterior_calibration(rows: DataFrame, populations: Mapping[str, str]) -> Figure:
    """Ranks of the truth in the posterior, with their band, and coverage against the nominal level."""
    figure, axes = grid(2, len(populations), height_in=5.0, sharex="row", sharey="row")
    of_self = rows[rows["method"] == "self"]
    dots = {"fmt": "o", "capsize": 2, "color": ORANGE, "label": "coverage, 95 % interval"}
    for (top, bottom), (population, title) in zip(axes.T, populations.items(), strict=True):
        part = of_self[of_self["population"] == population]
        rank, curve = ranks(part), coverage_curve(part)
        low, high = 10 / rank.size * np.array(stats.binom.interval(0.95, rank.size, 0.1))
        top.axhspan(low, high, color="0.88", label="95 % of uniform ranks")
        top.hist(
            rank, bins=10, range=(0, 1), histtype="step", density=True, color=BLUE, label="ranks"
        )
        top.axhline(1, **THIN)
        top.set_title(textwrap.fill(f"{title}, n = {rank.size}", 28))
        top.set(xlabel="rank of the true backlash [-]", ylabel="density [-]")
        arms = _arms(curve, "coverage", "coverage_low", "coverage_high")
        bottom.errorbar(curve["nominal"], curve["coverage"], arms, **dots)
        bottom.plot([0.5, 1], [0.5, 1], label="expected", **THIN)
        bottom.set(xlabel="nominal level [-]", ylabel="share of intervals that\nhold the truth [-]")
    return finish(figure, 2)


@in_style
def backlash_profile(rows: DataFrame) -> Figure:
    """Signed root of chi squared over the backlash, and Laplace's approximation of it."""
    figure, ((axis,),) = grid()
    delta, deviation = 1e4 * rows["delta_rad"], rows["deviation"]
    root = np.sign(deviation) * np.sqrt(rows["chi2"].clip(lower=0))
    axis.plot(delta, deviation, label="Laplace's approximation", **THIN)
    axis.plot(delta, root, "o", color=BLUE, label="all else fitted anew")
    axis.set(xlabel=BACKLASH_LABEL, ylabel="signed root of the\nincrease of $\\chi^2$ [-]")
    return finish(figure, 2)


@in_style
def wear(tests: DataFrame, limit_rad: float) -> Figure:
    """Show one bench's eight months as each sensor reads them, and the alarm delays on all benches."""
    figure, axes = grid(3, 2, height_in=6.0)
    *panels, last = axes.flat
    shown = tests[tests["bench"] == 0]
    truth = shown.drop_duplicates("day")
    sensors = shown.groupby("sensor", sort=False)
    for axis, letter, (name, part), marker, colour in zip(
        panels, "abcde", sensors, MARKERS, COLOURS, strict=True
    ):
        axis.plot(
            truth["day"], 1e4 * truth["delta_rad"], color=INK, linewidth=1, label="true backlash"
        )
        axis.axhline(1e4 * limit_rad, color="0.5", linestyle="--", linewidth=1, label="limit")
        estimates = 1e4 * part[["estimate_rad", "low_rad", "high_rad"]]
        arms = _arms(estimates, *estimates)
        style = {"marker": marker, "color": colour, "linestyle": "none"}
        middle = estimates["estimate_rad"].to_numpy()
        axis.errorbar(part["day"], middle, arms, capsize=2, **style)
        axis.axvline(part["call_day"].iloc[0], color=INK, linestyle=":", label="alarm")
        each = tests[tests["sensor"] == name].drop_duplicates("bench")
        delay = each["call_day"] - each["truth_day"]
        row = f"({letter}) {delay.count()} of {delay.size}"
        last.plot(delay, delay.size * [row], alpha=0.7, **style)
        axis.set(xlabel="time [days]", ylabel=BACKLASH_LABEL, title=textwrap.fill(name, 30))
        axis.sharey(panels[0])
    last.axvspan(0, truth["day"].diff().max(), color="0.9", label="alarm of a perfect sensor")
    last.set(xlabel="alarm delay [days]", ylabel="benches with an alarm [-]")
    last.margins(y=0.12)
    last.invert_yaxis()
    return finish(figure, 4)
