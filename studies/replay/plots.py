"""Pictures of the replayed runs and of the settings that may have printed Table 2."""

import textwrap

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from replication.figures import BLUE, GREEN, INK, ORANGE, finish, grid, in_style

SMALLEST_RPS = 1e-17  # drawn for a difference of 0


@in_style
def replay(compared: pd.DataFrame, ended: pd.DataFrame, agree_rps: float) -> Figure:
    """Show how far replayed runs are from stored ones, at their generations and ends."""
    figure, ((left, right),) = grid(1, 2, height_in=3.6, sharey=True, width_ratios=(3, 2))
    diverging = iter(((ORANGE, "^"), (GREEN, "s")))
    for run, part in compared.dropna().groupby("run"):
        shown = np.maximum(part["difference_rps"], SMALLEST_RPS)
        style = {"color": BLUE, "alpha": 0.5, "zorder": 1, "label": "other runs"}
        if (part["difference_rps"] > agree_rps).any():
            colour, marker = next(diverging, (INK, "D"))
            style = {"color": colour, "marker": marker, "label": f"run {run}, diverges"}
        left.plot(part["generation"], shown, linewidth=0.7, **style)
    right.plot(ended["run"], np.maximum(ended["difference_rps"], SMALLEST_RPS), "o", color=BLUE)
    for axis, label in (left, None), (right, "limit of agreement"):
        axis.axhline(agree_rps, color=INK, linewidth=0.8, linestyle=":", label=label)
    left.set(
        xlabel="generation [-]",
        ylabel="|ours $-$ stored| [rps]",
        yscale="log",
        title="printed generations",
    )
    right.set(xlabel="stored run", title="end of each run")
    return finish(figure, 2)


@in_style
def protocol_agreement(inside: pd.DataFrame) -> Figure:
    """Show under which settings alone each row's mean and SD agree, settings from top to bottom.

    `inside` has the columns `of` ("mean" or "sd"), `row`, `protocol`, `agrees`.
    """
    names = inside["protocol"].unique()
    figure, axes = grid(1, 2, height_in=0.32 * len(names) + 1.2, sharey=True)
    for axis, (of, part) in zip(axes[0], inside.groupby("of", sort=False), strict=True):
        for agrees, marker, colour in ((True, "o", BLUE), (False, "x", ORANGE)):
            chosen = part[part["agrees"] == agrees]
            y = chosen["protocol"].map(list(names).index)
            label = "agrees" if agrees else "differs"
            axis.scatter(chosen["row"], y, 50, marker=marker, color=colour, label=label)
        axis.set(title=f"{of}s".replace("sd", "SD"), xlabel="row of Table 2")
        axis.set_xticks(rows := sorted(part["row"].unique()), rows, size=8)
        axis.set_ylim(len(names) - 0.4, -0.6)
        axis.grid(visible=False)
    axes[0, 0].set_yticks(range(len(names)), [textwrap.fill(name, 20) for name in names])
    return finish(figure, 3)
