"""Plots of what goes past the paper: data frames and arrays in, a matplotlib figure out."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator
from scipy import stats

from backlash.studies.population import coverage_curve, ranks
from replication.arrays import FloatArray
from replication.figures.style import BLUE, GREEN, INK, ORANGE, PINK, PRINTED, SKY, Style, grid, in_style
from replication.standins.plots import COLOURS, MARKERS


@in_style
def landscape(
    slices: Sequence[tuple[FloatArray, FloatArray, FloatArray]], runs: Mapping[int, pd.DataFrame], best: pd.Series
) -> Figure:
    """Show two slices of the misfit through the best fit, A over t0 and T1 over T2, and where runs ended, by basin."""
    figure, axes = grid(1, 2, figsize=(10.0, 4.5))
    names = (("t0_s", "A_rps"), ("T2_s", "T1_s"))
    labels = (("$t_0$ [s]", "A [rps]"), ("$T_2$ [s]", "$T_1$ [s]"))
    low, high = min(part[2].min() for part in slices), max(part[2].max() for part in slices)
    colours = (BLUE, ORANGE, GREEN, PINK, SKY, INK)
    for axis, (columns, rows, misfit), (first, second), text in zip(axes[0], slices, names, labels, strict=True):
        shade = axis.pcolormesh(columns, rows, misfit, cmap="Greys_r", vmin=low, vmax=high, rasterized=True)
        for (number, part), marker, colour in zip(runs.items(), "osv^Dx", colours, strict=False):
            style = {"marker": marker, "color": colour, "linestyle": "none", "markersize": 4, "mfc": "none"}
            axis.plot(part[first], part[second], label=f"basin {number}, {len(part)} runs", **style)
        axis.plot(best[first], best[second], marker="+", markersize=14, color=INK, label="global fit", linestyle="none")
        axis.set(xlabel=text[0], ylabel=text[1])
        axis.grid(False)
    axes[0, 0].set_xlim(slices[0][0][0], slices[0][0][-1])
    axes[0, 1].legend(fontsize=8, frameon=True, facecolor="white", framealpha=0.9)
    figure.colorbar(shade, ax=axes[0].tolist(), label="RMSE [rps]")
    return figure


@in_style
def strategy_costs(table: pd.DataFrame) -> Figure:
    """Show the function evaluations that each search strategy spends for one success, with 95 % intervals."""
    figure, ((axis,),) = grid(figsize=(8.5, 3.8))
    at = np.arange(len(table))[::-1]
    middle, low, high = (table[f"evaluations_per_success{end}"].to_numpy() for end in ("", "_low", "_high"))
    for y, centre, left, right in zip(at, middle, low, high, strict=True):
        axis.plot([left, right if np.isfinite(right) else 100 * left], [y, y], color=BLUE, linewidth=1.2)
        if np.isfinite(centre):
            axis.plot(centre, y, "o", color=BLUE)
    axis.set_yticks(at, table["strategy"])
    finite = high[np.isfinite(high)]
    axis.set(xscale="log", xlabel="function evaluations per success")
    axis.set_xlim(low.min() / 1.5, 1.5 * max(finite.max(initial=0.0), low.max()))
    ticks = [1e4, 2e4, 5e4, 1e5, 2e5, 5e5]
    axis.set_xticks(ticks, labels=[f"{tick:,.0f}" for tick in ticks])
    axis.xaxis.set_minor_locator(NullLocator())
    return figure


@in_style
def amplitude_intervals(table: pd.DataFrame) -> Figure:
    """Show the global fit's amplitudes with their intervals beside Table 2's printed means and SDs."""
    figure, ((axis,),) = grid(figsize=(8.0, 4.2))
    delta, theory = 1e4 * table["delta_rad"].to_numpy(), table["theoretical_A_rps"].to_numpy()
    middle = table["A_rps"].to_numpy()
    ends = np.abs(table[["low_rps", "high_rps"]].to_numpy().T - middle)
    style = {"linestyle": "none", "capsize": 3, "marker": "o", "color": BLUE, "label": "global fit, 95 %"}
    axis.errorbar(delta - 0.15, middle / theory, ends / theory, **style)
    printed, spread = (table[f"printed_{name}_A_rps"].to_numpy() / theory for name in ("mean", "sd"))
    style = PRINTED | {"elinewidth": 1, "capsize": 3, "label": "printed mean, SD of runs"}
    axis.errorbar(delta + 0.15, printed, spread, **style)
    axis.axhline(1, color=INK, linewidth=0.8)
    axis.set(xlabel="backlash $\\delta$ [1e-4 rad]", ylabel="A over theoretical A")
    axis.legend()
    return figure


def _arms(table: pd.DataFrame, name: str) -> FloatArray:
    """Arms of a rate's error bars, shape (2, rows)."""
    return np.abs(table[[f"{name}_low", f"{name}_high"]].to_numpy().T - table[name].to_numpy())


# A method has one colour and one mark in every figure, a bound its line.
METHOD_STYLES: dict[str, Style] = {
    "bound, start free": {"color": INK, "linestyle": "-", "linewidth": 1},
    "bound, start known": {"color": INK, "linestyle": "--", "linewidth": 1},
    "equation 10": {"color": INK, "marker": "x"},
    "amplitude": {"color": ORANGE, "marker": "s"},
    "impact": {"color": GREEN, "marker": "v"},
    "energy": {"color": PINK, "marker": "^"},
    "waveform, noisy logs": {"color": "0.5", "marker": "d"},
    "waveform": {"color": BLUE, "marker": "o"},
    "time in the gap": {"color": GREEN, "marker": "<"},
    "joint": {"color": INK, "marker": "*"},
    "joint, start angle free": {"color": SKY, "marker": "P"},
    "joint, all nuisances free": {"color": SKY, "marker": "D"},
}


@in_style
def cross_validation_errors(table: pd.DataFrame, targets_rad: Mapping[str, float]) -> Figure:
    """Show the error of each method on each log, the mean size of each method's, and targets to meet."""
    figure, ((axis,),) = grid(figsize=(8.5, 4.8))
    methods = list(dict.fromkeys(table["method"]))
    for row, method in enumerate(methods):
        size = 1e6 * table.loc[table["method"] == method, "error_rad"].abs()
        style = METHOD_STYLES[method]
        axis.plot(size, np.full(size.size, row), linestyle="none", alpha=0.7, **style)
        axis.plot([size.mean()] * 2, [row - 0.35, row + 0.35], color=INK, linewidth=2)
        if method in targets_rad:
            axis.plot([1e6 * targets_rad[method]] * 2, [row - 0.35, row + 0.35], color=INK, linewidth=1, linestyle=":")
    axis.set(xscale="log", xlabel="error of backlash [1e-6 rad] (line: mean size, dotted: target)", xlim=(0.05, 600))
    axis.set_yticks(range(len(methods)), methods)
    axis.invert_yaxis()
    return figure


@in_style
def error_limits(table: pd.DataFrame, axes_labels: Mapping[str, str]) -> Figure:
    """Show measured errors as marks and Cramer-Rao bounds as lines, one panel for each thing that changes."""
    figure, axes = grid(2, 2, figsize=(9.0, 7.0), sharey=True)
    for axis, (name, label) in zip(axes.flat, axes_labels.items(), strict=True):
        part = table[table["axis"] == name]
        for method in ("bound, start free", "bound, start known", "amplitude", "energy", "waveform", "joint"):
            rows = part[part["method"] == method]
            style = {"linestyle": "none", "label": method} | METHOD_STYLES[method]
            axis.plot(rows["value"], 1e6 * rows["rmse_rad"], **style)
        axis.set(xlabel=label, yscale="log", xscale="linear" if name == "encoder_bits" else "log")
        axis.set_xticks(values := list(dict.fromkeys(part["value"])), [f"{value:g}" for value in values])
        axis.xaxis.set_minor_locator(NullLocator())
    for row in axes:
        row[0].set_ylabel("RMS error of backlash [1e-6 rad]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=6, fontsize=9)
    return figure


@in_style
def detection_curves(table: pd.DataFrame, limits_rad: Sequence[float]) -> Figure:
    """Show the share of records that are seen to have backlash, and what a filter that knows the waveform would see."""
    figure, ((axis,),) = grid(figsize=(8.0, 4.2))
    loudness = table.groupby("noise_half_amplitude_rps", sort=False)
    for (noise, part), limit, colour, marker in zip(
        loudness, limits_rad, (BLUE, ORANGE, PINK, INK), "os^D", strict=False
    ):
        style = {"color": colour, "marker": marker, "capsize": 3, "label": f"noise of {noise:g} rps"}
        axis.errorbar(1e4 * part["delta_rad"], part["seen"], _arms(part, "seen"), **style)
        axis.axvline(1e4 * limit, color=colour, linestyle=":", label=f"matched filter, {noise:g} rps")
    axis.set(xlabel="backlash [1e-4 rad]", ylabel="share of records above the threshold [-]", ylim=(-0.03, 1.03))
    axis.legend(loc="lower right")
    return figure


@in_style
def tornado(table: pd.DataFrame, methods: Sequence[str]) -> Figure:
    """Show the mean error of methods at the ends of what may change, the parameter with the largest on top."""
    order = table["mean_error_rad"].abs().groupby(table["parameter"]).max().sort_values().index
    figure, axes = grid(1, len(methods), figsize=(11.0, 4.8), sharey=True, sharex=True)
    for axis, method in zip(axes[0], methods, strict=True):
        bars = 1e6 * table[table["method"] == method].pivot(
            index="parameter", columns="change", values="mean_error_rad"
        )
        bars = bars.loc[order].rename(columns="{:+.0%}".format)
        bars.plot.barh(ax=axis, color=[ORANGE, BLUE], width=0.8, legend=False, ylabel="")
        axis.axvline(0, color=INK, linewidth=0.8)
        axis.set_axisbelow(True)
        axis.set_title(method.replace(", ", ",\n"), fontsize=10)
    axes[0, 0].xaxis.set_major_locator(MaxNLocator(3))
    figure.supxlabel("mean error of backlash [1e-6 rad]", fontsize=10)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    return figure


@in_style
def protocol_residuals(table: pd.DataFrame, judged: pd.DataFrame, level: float, degrees: int) -> Figure:
    """Show how far Table 2's means (a) and SDs (b) lie from each candidate's, in t, and the p of the whole table.

    Candidates are in the order of `judged`; in the grey band the p of one number is above `level`.
    """
    figure, axes = grid(1, 2, figsize=(5.4, 0.36 * len(judged) + 1.2), sharey=True)
    edge = stats.t.isf(level / 2, degrees)
    for axis, letter, column, text in zip(axes[0], "ab", ("mean", "sd"), ("means", "SDs"), strict=True):
        axis.axvspan(-edge, edge, color="0.9", zorder=0)
        beside = {"xycoords": ("axes fraction", "data"), "va": "center"}
        axis.annotate("p", (1.03, -0.9), style="italic", annotation_clip=False, **beside)
        for at, (candidate, p) in enumerate(zip(judged["protocol"], judged[f"p_{column}s"], strict=True)):
            part = table[(table["protocol"] == candidate) & (table["column"] == column)]
            axis.plot(part["t"], np.full(len(part), at), "o", color=BLUE, markersize=4.5, alpha=0.6)
            axis.annotate(f"{p:.1g}", (1.03, at), weight="bold" if p < level / 2 else "normal", **beside)
        axis.set_title(f"({letter}) {text}", fontsize=10, loc="left")
        axis.set(xscale="symlog", xlabel="t [-]", ylim=(len(judged) - 0.4, -0.6))
        axis.set_xticks([-10, -1, 0, 1, 10], ["-10", "-1", "0", "1", "10"])
        axis.xaxis.set_minor_locator(NullLocator())
    axes[0, 0].set_yticks(range(len(judged)), judged["protocol"].str.replace(", ", ",\n"), linespacing=0.9)
    return figure


@in_style
def population_errors(rows: pd.DataFrame, populations: dict[str, str]) -> Figure:
    """Error of method "self" over the true backlash with its 95 % interval, a panel a population."""
    figure, axes = grid(1, len(populations), figsize=(5.0 * len(populations), 4.2))
    for axis, (population, title) in zip(axes[0], populations.items(), strict=True):
        part = rows[(rows["population"] == population) & (rows["method"] == "self") & ~rows["refused"]]
        error = 1e3 * (part["found_rad"] - part["delta_rad"])
        half = 1e3 * (part["high_rad"] - part["found_rad"])
        held = error.abs() <= half
        for kept, colour, label in ((held, BLUE, "interval holds the truth"), (~held, ORANGE, "does not")):
            style = {"fmt": "o", "markersize": 3, "linewidth": 0.7, "color": colour}
            label = f"{label} ({int(kept.sum())})"
            axis.errorbar(1e3 * part["delta_rad"][kept], error[kept], half[kept], label=label, **style)
        axis.axhline(0, color=INK, linewidth=0.8)
        axis.set(xlabel="true backlash [mrad]", ylabel="error [mrad]", title=title)
        axis.legend(fontsize=8, frameon=True, framealpha=0.9)
    return figure


@in_style
def posterior_calibration(rows: pd.DataFrame, populations: dict[str, str]) -> Figure:
    """Ranks of the truth in the posterior, and coverage against the nominal level."""
    figure, axes = grid(1, 2, figsize=(10.0, 4.2))
    for (population, title), colour in zip(populations.items(), (BLUE, ORANGE, PINK), strict=False):
        part = rows[(rows["population"] == population) & (rows["method"] == "self")]
        axes[0, 0].hist(ranks(part), bins=10, range=(0, 1), histtype="step", density=True, color=colour, label=title)
        curve = coverage_curve(part)
        style = {"fmt": "o-", "markersize": 3, "color": colour, "label": title}
        axes[0, 1].errorbar(curve["nominal"], curve["coverage"], _arms(curve, "coverage"), **style)
    axes[0, 0].axhline(1, color=INK, linewidth=0.8)
    axes[0, 0].set(xlabel="rank of the truth in the posterior", ylabel="density")
    axes[0, 1].plot([0.5, 1], [0.5, 1], color=INK, linewidth=0.8)
    axes[0, 1].set(xlabel="nominal level", ylabel="share of intervals that hold")
    axes[0, 1].legend(fontsize=8)
    return figure


@in_style
def backlash_profile(rows: pd.DataFrame) -> Figure:
    """Signed root of chi squared over the backlash, and Laplace's approximation of it."""
    figure, ((axis,),) = grid(figsize=(6.0, 4.2))
    delta = 1e3 * rows["delta_rad"]
    root = np.sign(rows["deviation"]) * np.sqrt(rows["chi2"].clip(lower=0))
    axis.plot(delta, rows["deviation"], color=INK, linewidth=0.8, label="Laplace's approximation")
    axis.plot(delta, root, "o-", markersize=3, color=BLUE, label="all else fitted anew")
    axis.set(xlabel="backlash [mrad]", ylabel="signed root of the gain in chi squared")
    axis.legend(fontsize=8)
    return figure


@in_style
def wear(tests: pd.DataFrame, limit_rad: float) -> Figure:
    """Show one bench's eight months as each sensor reads them, and how all benches' calls lie to the truth."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.5, 4.4), width_ratios=(3, 2))
    shown = tests[tests["bench"] == 0]
    truth = shown.drop_duplicates("day")
    left.plot(truth["day"], 1e4 * truth["delta_rad"], color=INK, label="true backlash")
    left.axhline(1e4 * limit_rad, color="0.5", linestyle="--", linewidth=1, label="limit")
    left.axvline(truth["truth_day"].iloc[0], color=INK, linestyle=":", linewidth=1)
    for place, name in enumerate(tests["sensor"].unique()):
        part = shown[shown["sensor"] == name]
        middle = 1e4 * part["estimate_rad"].to_numpy()
        ends = np.abs(1e4 * part[["low_rad", "high_rad"]].to_numpy().T - middle)
        style = {"marker": MARKERS[place], "color": COLOURS[place], "linestyle": "none", "capsize": 2, "markersize": 4}
        left.errorbar(part["day"] + 2.5 * place, middle, ends, label=f"{name}, 95 %", **style)
        if np.isfinite(part["call_day"].iloc[0]):
            left.axvline(part["call_day"].iloc[0], color=COLOURS[place], linestyle=":", linewidth=1)
        each = tests[tests["sensor"] == name].drop_duplicates("bench")
        delay = np.sort((each["call_day"] - each["truth_day"]).dropna())
        share = np.arange(1, delay.size + 1) / len(each)
        right.step(delay, 100 * share, where="post", color=COLOURS[place])
    left.set(xlabel="time [days]", ylabel="backlash $\\delta$ [1e-4 rad]")
    left.legend(fontsize=8)
    interval = float(truth["day"].diff().max())
    right.axvspan(0, interval, color="0.9", label="a perfect sensor: the next test")
    right.set(xlabel="time from the truth to the call [days]", ylabel="benches called for by then [%]", ylim=(0, 102))
    right.legend(fontsize=8, loc="lower right")
    return figure
