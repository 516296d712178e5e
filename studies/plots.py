"""Plots of what goes past the paper: data frames and arrays in, a matplotlib figure out."""

import textwrap
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from pandas import DataFrame
from scipy import stats

from replication.arrays import FloatArray
from replication.figures.standins import COLOURS, MARKERS
from replication.figures.style import (
    BACKLASH_LABEL,
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PINK,
    SKY,
    THIN,
    Style,
    finish,
    grid,
    in_style,
)
from studies.population import NORMAL_95, coverage_curve, ranks

# Of text beside a row: its x in shares of the panel.
BESIDE: Style = {"xycoords": ("axes fraction", "data"), "va": "center"}


def _arms(table: DataFrame, middle: str, low: str, high: str) -> FloatArray:
    """Arms of error bars from a middle to its limits, shape (2, rows)."""
    return np.abs(table[[low, high]].to_numpy().T - table[middle].to_numpy())


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
def cross_validation_errors(table: DataFrame, bounds_rad: Mapping[str, float]) -> Figure:
    """Show each method's errors on the logs and their mean size, and the least mean size that there can be."""
    figure, ((axis,),) = grid(height_in=3.8)
    sizes = 1e6 * table["error_rad"].abs()
    by_method = dict(list(sizes.groupby(table["method"], sort=False)))
    for row, (method, size) in enumerate(by_method.items()):
        dots = METHOD_STYLES[method] | {"linestyle": "none", "alpha": 0.7}
        axis.plot(size, np.full(size.size, row), **dots)
        beside = [row - 0.4, row + 0.4]
        axis.plot([size.mean()] * 2, beside, color=INK, linewidth=2, label="mean size")
    for name, bound in bounds_rad.items():
        axis.axvline(1e6 * bound, label=name, **METHOD_STYLES[name])
    axis.set(xscale="log", xlabel="size of the error of the backlash [$10^{-6}$ rad]")
    axis.set_yticks(range(len(by_method)), list(by_method))
    axis.invert_yaxis()
    return finish(figure, 3)


@in_style
def error_limits(table: DataFrame, axes_labels: Mapping[str, str]) -> Figure:
    """Show measured errors as marks and Cramer-Rao bounds as lines, one panel for each thing that changes."""
    panels = table.groupby("axis", sort=False)
    figure, axes = grid(1, panels.ngroups, height_in=3.2, sharey=True)
    for axis, (name, part) in zip(axes.flat, panels, strict=True):
        for method, rows in part.groupby("method"):
            style = {"linestyle": "none", "label": method, "markersize": 6, "mfc": "none"}
            axis.plot(rows["value"], 1e6 * rows["rmse_rad"], **style | METHOD_STYLES[method])
        axis.set(xlabel=axes_labels[name], xscale="log", yscale="log")
        values = sorted({*part["value"]})
        axis.set_xticks(values, [f"{value:g}" for value in values], rotation=45)
        axis.xaxis.set_minor_locator(NullLocator())
    axes[0, 0].set_ylabel("RMS error of the backlash [$10^{-6}$ rad]")
    return finish(figure, 3)


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
