"""Plots of what goes past the paper: data frames and arrays in, a matplotlib figure out."""

import textwrap
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from pandas import DataFrame
from scipy import stats

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
from studies.population import NORMAL_95

# A method has one colour and one mark in every figure, a bound its line.
_OF_BOUND: Style = {"color": INK, "linewidth": 1}
_OF_METHOD = {
    "equation 10": (INK, "x"),
    "amplitude": (ORANGE, "s"),
    "impact": (GREEN, "v"),
    "energy": (PINK, "^"),
    "waveform, noisy logs": ("0.5", "d"),
    "waveform": (BLUE, "o"),
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
