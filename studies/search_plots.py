"""Pictures of the search: one generation in two dimensions, and a whole run."""

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from replication.arrays import FloatArray
from replication.cmaes import Generation, State
from replication.figures import BLUE, INK, ORANGE, Style, finish, grid, in_style
from replication.signature import Box


@in_style
def one_generation(
    now: Generation, weights: FloatArray, box: Box, at: tuple[int, int], labels: Sequence[str]
) -> Figure:
    """Show a generation in two of its dimensions: samples and ranks, the new mean, the new distribution."""
    figure, axes = grid(2, 2, height_in=4.8, sharex=True, sharey=True)
    first, second, third, key = axes.ravel()
    i, j = at
    ranked, half = now.x[now.ranking], int((weights > 0).sum())
    before, after = now.before, now.after
    titles = "samples (eq. 12)", "new mean (eq. 13)", "new ellipse (eq. 14-17)"
    for axis, title in zip((first, second, third), titles, strict=True):
        draw_bounds(axis, box, at)
        ellipse(axis, before, at, color=INK, linestyle="--", label="2 SD before")
        axis.set(xlabel=labels[0], ylabel=labels[1], title=title)
        axis.tick_params(labelbottom=True, labelleft=True)
    first.plot(ranked[half:, i], ranked[half:, j], "x", color="0.5", label="worse half")
    first.plot(ranked[:half, i], ranked[:half, j], ".", color=BLUE, label="better half")
    sizes = 40 * weights[:half] / weights[0]
    label = "better half, area: weight"
    second.scatter(ranked[:half, i], ranked[:half, j], sizes, color=BLUE, linewidths=0, label=label)
    for axis in (second, third):
        axis.plot(before.m[i], before.m[j], "P", color=INK, markersize=7, label="mean before")
        axis.plot(after.m[i], after.m[j], "s", color=ORANGE, label="mean after")
    ellipse(third, after, at, color=ORANGE, label="2 SD after")
    key.set_visible(False)
    return finish(figure, 1, (0.64, 0.12))


@in_style
def run(
    states: Sequence[State], best: FloatArray, box: Box, at: tuple[int, int], labels: Sequence[str]
) -> Figure:
    """Show a run: its distribution in two dimensions at some generations, and what it finds."""
    figure, ((upper,), (lower,)) = grid(2, 1, height_in=5.0, height_ratios=(3, 2))
    above = np.where(best > best.min(), best - best.min(), np.nan)
    lower.plot(np.arange(1, best.size + 1), above, color="0.5", linewidth=0.9)
    draw_bounds(upper, box, at)
    for k, (state, marker) in enumerate(zip(states, "osD^v", strict=False)):
        style = {"color": plt.cm.viridis(k / len(states)), "marker": marker, "mfc": "none"}
        ellipse(upper, state, at, color=style["color"])
        upper.plot(*state.m[list(at)], label=f"generation {state.g}", **style)
        lower.plot(state.g, above[state.g - 1], **style)
    upper.set(xlabel=labels[0], ylabel=labels[1])
    lower.set(xlabel="generation [-]", ylabel="misfit above the best [rps]", yscale="log")
    return finish(figure, 3, "outside upper center")


def draw_bounds(axis: Axes, box: Box, at: tuple[int, int]) -> None:
    """Frame the box of the search in two dimensions."""
    (left, bottom), size = box.lower[list(at)], (box.upper - box.lower)[list(at)]
    style: Style = {"fill": False, "color": "0.6", "label": "bounds of the search"}
    axis.add_patch(Rectangle((left, bottom), *size, **style))


def ellipse(axis: Axes, state: State, at: tuple[int, int], **style: Any) -> None:
    """Draw where 2 standard deviations of the next samples lie in two dimensions, whatever the others are."""
    scale = state.sigma * state.unit
    covariance = (state.C * np.outer(scale, scale))[np.ix_(at, at)]
    angle = np.linspace(0, 2 * np.pi, 181)
    circle = 2 * np.array([np.cos(angle), np.sin(angle)])
    axis.plot(*(state.m[list(at)][:, None] + np.linalg.cholesky(covariance) @ circle), **style)
