"""Plots of what goes past the paper: data frames and arrays in, a matplotlib figure out."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from replication.figure_style import BLUE, GREEN, INK, ORANGE, PINK, PRINTED, SKY, grid, in_style

FloatArray = NDArray[np.float64]


@in_style
def landscape(
    slices: Sequence[tuple[FloatArray, FloatArray, FloatArray]], runs: Sequence[pd.DataFrame], best: pd.Series
) -> Figure:
    """Show two slices of the misfit through the best fit, A over t0 and T1 over T2, and where runs ended.

    Parameters
    ----------
    slices : two of (columns, rows, misfit)
        Values along both axes, of lengths n and m, and the misfit [rps] of shape (m, n).
    runs : sequence of DataFrame
        The runs of each basin, the best first: columns `A_rps, t0_s, T1_s, T2_s`.
    best : Series
        The best fit, same entries.

    Returns
    -------
    Figure
    """
    figure, axes = grid(1, 2, figsize=(10.0, 4.5))
    names = (("t0_s", "A_rps"), ("T2_s", "T1_s"))
    labels = (("$t_0$ [s]", "A [rps]"), ("$T_2$ [s]", "$T_1$ [s]"))
    low, high = min(part[2].min() for part in slices), max(part[2].max() for part in slices)
    markers, colours = "osv^Dx", (BLUE, ORANGE, GREEN, PINK, SKY, INK)
    for axis, (columns, rows, misfit), (first, second), text in zip(axes[0], slices, names, labels, strict=True):
        shade = axis.pcolormesh(columns, rows, misfit, cmap="Greys_r", vmin=low, vmax=high, rasterized=True)
        for number, (part, marker, colour) in enumerate(zip(runs, markers, colours, strict=False)):
            style = {"marker": marker, "color": colour, "linestyle": "none", "markersize": 4, "mfc": "none"}
            axis.plot(part[first], part[second], label=f"basin {number + 1}, {len(part)} runs", **style)
        axis.plot(best[first], best[second], marker="+", markersize=14, color=INK, label="global fit", linestyle="none")
        axis.set(xlabel=text[0], ylabel=text[1])
        axis.grid(False)
    axes[0, 0].set_xlim(slices[0][0][0], slices[0][0][-1])
    axes[0, 1].legend(fontsize=8)
    figure.colorbar(shade, ax=axes[0].tolist(), label="RMSE [rps]")
    return figure


@in_style
def strategy_costs(table: pd.DataFrame) -> Figure:
    """Show the function evaluations that each search strategy spends for one success, with 95 % intervals.

    Parameters
    ----------
    table : DataFrame
        Columns `strategy, evaluations_per_success` and its limits `..._low, ..._high`.

    Returns
    -------
    Figure
    """
    figure, axes = grid(figsize=(8.5, 3.8))
    axis = axes[0, 0]
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
    """Show the global fit's amplitudes with their intervals beside Table 2's printed means and SDs.

    Parameters
    ----------
    table : DataFrame
        Columns `delta_rad, theoretical_A_rps, printed_mean_A_rps, printed_sd_A_rps, A_rps, low_rps, high_rps`.

    Returns
    -------
    Figure
    """
    figure, axes = grid(figsize=(8.0, 4.2))
    axis = axes[0, 0]
    delta, theory = 1e4 * table["delta_rad"].to_numpy(), table["theoretical_A_rps"].to_numpy()
    middle = table["A_rps"].to_numpy()
    ends = np.abs(table[["low_rps", "high_rps"]].to_numpy().T - middle)
    style = {"linestyle": "none", "capsize": 3}
    axis.errorbar(
        delta - 0.15, middle / theory, ends / theory, marker="o", color=BLUE, label="global fit, 95 %", **style
    )
    printed, spread = (table[f"printed_{name}_A_rps"].to_numpy() / theory for name in ("mean", "sd"))
    axis.errorbar(
        delta + 0.15, printed, spread, elinewidth=1, capsize=3, **PRINTED | {"label": "printed mean, SD of runs"}
    )
    axis.axhline(1, color=INK, linewidth=0.8)
    axis.set(xlabel="backlash $\\delta$ [1e-4 rad]", ylabel="A over theoretical A")
    axis.legend()
    return figure
