"""Pictures of the search: the replay of the stored runs, one generation in two dimensions, and a whole run."""

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from replication.arrays import FloatArray
from replication.figures.style import BLUE, GREEN, INK, ORANGE, in_style
from replication.search import Generation, State
from replication.signature import Box

SMALLEST_RPS = 1e-17  # drawn for a difference of 0


@in_style
def replay(compared: pd.DataFrame, ended: pd.DataFrame, agree_rps: float) -> Figure:
    """Show how far the replayed runs are from the stored ones, generation by generation and at their ends."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(6.9, 3.2), sharey=True, width_ratios=(3, 2))
    parted = iter((ORANGE, GREEN, INK))
    for run, part in compared.dropna().groupby("run"):
        shown = np.maximum(part["difference_rps"], SMALLEST_RPS)
        if (part["difference_rps"] > agree_rps).any():
            left.plot(part["generation"], shown, "o-", markersize=3, color=next(parted, INK), label=f"run {run}")
        else:
            left.plot(part["generation"], shown, ".-", markersize=3, linewidth=0.5, color=BLUE, alpha=0.5)
    right.plot(ended["run"], np.maximum(ended["difference_rps"], SMALLEST_RPS), "s", markersize=4, color=BLUE)
    for axis in (left, right):
        axis.axhline(agree_rps, color=INK, linewidth=0.8, linestyle=":")
    left.set(xlabel="generation", ylabel="|our lowest misfit - stored| [rps]", yscale="log")
    left.legend(title="runs that diverge temporarily", fontsize=8)
    right.set(xlabel="stored run", title="lowest misfit of the whole run")
    left.set_title("generations that the authors' notebook prints", fontsize=9)
    right.title.set_fontsize(9)
    return figure


@in_style
def one_generation(
    now: Generation, weights: FloatArray, box: Box, at: tuple[int, int], labels: Sequence[str]
) -> Figure:
    """Show a generation in two of its dimensions: samples and ranks, the new mean, the new distribution."""
    figure, axes = plt.subplots(1, 3, figsize=(10.5, 4.0), sharex=True, sharey=True)
    i, j = at
    ranked, half = now.x[now.ranking], int((weights > 0).sum())
    before, after = now.before, now.after
    for axis in axes:
        ellipse(axis, before, at, color=INK, linestyle="--", label="2 $\\sigma$, before")
        corners = [(box.lower, box.lower), (box.upper, box.lower), (box.upper, box.upper), (box.lower, box.upper)]
        axis.plot(*np.array([(x[i], y[j]) for x, y in [*corners, corners[0]]]).T, color="0.7", linewidth=0.8)
        axis.set_xlabel(labels[0])
    first, second, third = axes
    first.plot(ranked[half:, i], ranked[half:, j], ".", color="0.6", markersize=4, label="worse half")
    first.plot(ranked[:half, i], ranked[:half, j], ".", color=BLUE, markersize=4, label="better half")
    sizes = 60 * weights[:half] / weights[0]
    better = ranked[:half].T
    second.scatter(better[i], better[j], s=sizes, color=BLUE, linewidths=0, label="better half, by weight")
    step = {"arrowstyle": "->", "color": ORANGE, "linewidth": 2}
    second.annotate("", (after.m[i], after.m[j]), (before.m[i], before.m[j]), arrowprops=step)
    second.plot(after.m[i], after.m[j], "s", color=ORANGE, label="new mean")
    third.plot(after.m[i], after.m[j], "s", color=ORANGE)
    ellipse(third, after, at, color=ORANGE, label="2 $\\sigma$, after")
    for axis, title in zip(axes, ("equation 12, and ranks", "equation 13", "equations 14 to 17"), strict=True):
        axis.set_title(title)
        axis.legend(loc="lower center", fontsize=7, ncols=2)
    first.set_ylabel(labels[1])
    return figure


@in_style
def run(states: Sequence[State], best: FloatArray, box: Box, at: tuple[int, int], labels: Sequence[str]) -> Figure:
    """Show a run: its distribution in two dimensions at some generations, and what it finds."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 4.2))
    i, j = at
    for state, shade in zip(states, np.linspace(0.25, 1, len(states)), strict=True):
        ellipse(left, state, at, color=BLUE, alpha=shade)
        left.plot(state.m[i], state.m[j], "s", color=BLUE, alpha=shade, markersize=3)
        left.annotate(str(state.g), (state.m[i], state.m[j]), xytext=(4, 4), textcoords="offset points", fontsize=8)
    left.set(xlabel=labels[0], ylabel=labels[1], xlim=(box.lower[i], box.upper[i]), ylim=(box.lower[j], box.upper[j]))
    left.set_title("mean and 2 $\\sigma$ after so many generations")
    right.plot(np.arange(1, best.size + 1), np.maximum(best - best.min(), SMALLEST_RPS), color=BLUE)
    right.set(xlabel="generation", ylabel="lowest misfit above that of the run [rps]", yscale="log")
    return figure


def ellipse(axis: Axes, state: State, at: tuple[int, int], **style: Any) -> None:
    """Draw where 2 standard deviations of the next samples lie in two dimensions, whatever the others are."""
    pick = np.ix_(at, at)
    scale = state.sigma * state.unit[list(at)]
    covariance = state.C[pick] * np.outer(scale, scale)
    angle = np.linspace(0, 2 * np.pi, 181)
    circle = 2 * np.array([np.cos(angle), np.sin(angle)])
    axis.plot(*(state.m[list(at)][:, None] + np.linalg.cholesky(covariance) @ circle), **style)
