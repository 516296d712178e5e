"""The teeth in the gap: how they are drawn, one turn of a joint as an animation, and the pages of notebook 0."""

import json
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.animation import FuncAnimation

from replication import published
from replication.arrays import FloatArray
from replication.figures import BLUE, INK, ORANGE, STYLE
from replication.joint import TURN, Joint, Run
from replication.records import ROOT

PAGES = ROOT / "studies" / "pages"
JOINT = (PAGES / "joint.svg").read_text("utf-8")  # a drawing
GAP = (PAGES / "gap.html").read_text("utf-8")  # a picture with a slider, which needs no network


def draw_arm(axis: plt.Axes, angle_rad: float) -> None:
    """Draw the load on its arm, which hangs straight down at 0, and its weight."""
    x, y = np.sin(angle_rad), -np.cos(angle_rad)
    axis.plot([0, 0], [0, -1.1], ":", color="0.6")
    axis.plot([0, x], [0, y], "o-", color="0.5", linewidth=3)
    axis.plot(x, y, "o", color=INK, markersize=11)
    axis.annotate("", (x, y - 0.75), (x, y), arrowprops={"arrowstyle": "->"})
    axis.set(xlim=(-1.3, 1.3), ylim=(-1.9, 1.3), aspect="equal")
    axis.axis("off")


def draw_teeth(axis: plt.Axes, displacement: float, delta: float, reach: float) -> None:
    """Draw the motor's tooth between the load's flanks, which springs (the coupling) hold; lengths in mrad."""
    twist = displacement - np.clip(displacement, -delta, delta)
    half, wall = 0.5 * reach, 2.5 * reach  # of the motor's tooth, of the load's body
    axis.fill(displacement + half * np.array([-1, -0.8, 0.8, 1]), [1, 0, 0, 1], color=BLUE)
    axis.fill(1.1 * wall * np.array([-1, -1, 1, 1]), [-0.5, -0.3, -0.3, -0.5], color="0.5")
    for side in (-1, 1):
        flank = twist + side * (delta + half * np.array([0.8, 1, 2, 2]))
        axis.fill(flank, [-0.2, 0.8, 0.8, -0.2], color=ORANGE if side * twist > 0 else "0.5")
        axis.fill(side * wall * np.array([1, 1, 1.1, 1.1]), [-0.4, 0.8, 0.8, -0.4], color="0.5")
        coils = 0.3 + 0.12 * np.array([0, 0, *[1, -1] * 5, 0, 0])
        axis.plot(np.linspace(flank[-1], side * wall, 14), coils, color=INK, linewidth=0.8)
    axis.vlines([-delta, displacement, delta], -0.2, 1.1, INK, ":")
    axis.set(
        xlim=(-1.12 * wall, 1.12 * wall),
        xlabel="displacement $\\Delta\\theta$ [mrad]; dotted: $-\\delta$, tooth's centre, $\\delta$",
        xticks=[-delta, delta],
        yticks=[],
    )
    axis.grid(visible=False)
    axis.spines["left"].set_visible(False)


def animate_teeth(run: Run, joint: Joint, delta: float) -> str:
    """Show a turn of a run as HTML: the arm, the teeth in the gap, the motor speed; slower while the gap is open."""
    turn = np.floor((run.theta_l - TURN / 4) / TURN) == 1
    t = 1e3 * (run.t[turn] - run.t[turn][0])
    angle = run.theta_l[turn]
    v = run.v[turn]
    x = 1e3 * (run.theta_m[turn] / joint.N - angle)
    lengths = {"delta": 1e3 * delta, "reach": np.abs(x).max()}
    free = run.gap[turn] == 0
    frames = np.flatnonzero(np.round(t, 3) % np.where(free, 3, 15) == 0)
    with plt.rc_context(STYLE | {"figure.dpi": 64}), plt.ioff():
        figure, axes = plt.subplot_mosaic("ABB;CCC", figsize=(6.4, 4.6), height_ratios=(3, 2))
        arm, gap, speed = axes.values()
        speed.plot(t, v, linewidth=0.9)
        speed.fill_between(t, v.min(), v.max(), where=free, color="0.85")
        speed.set(xlabel="time [ms]; grey: gap open", ylabel="speed [rps]")
        (now,) = speed.plot([], [], "o", color=INK)

        def draw(k: int) -> None:
            arm.clear()
            draw_arm(arm, angle[k])
            gap.clear()
            draw_teeth(gap, x[k], **lengths)
            now.set_data([t[k]], [v[k]])

        draw(0)
        figure.canvas.draw()
        figure.set_layout_engine("none")  # the axes stay where they are
        plt.close(figure)
        return FuncAnimation(figure, draw, frames=frames, interval=100).to_jshtml()


def gap_slider(
    turns_rps: Sequence[FloatArray], peaks_rps: FloatArray, backlash_rad: FloatArray, first: int
) -> str:
    """Picture with a slider: gap, motor speed over a turn and equation 10, at backlashes in steps of 0.1 mrad."""
    shown = {
        "r": [np.round(turn, 2).tolist() for turn in turns_rps],
        "peak": np.round(peaks_rps, 4).tolist(),
        "equation_10": np.round(1e3 * backlash_rad, 4).tolist(),
    }
    return GAP.replace("DATA", json.dumps(shown)).replace("VALUE", str(first))


def explorer_page(
    t: FloatArray,
    v: FloatArray,
    fitted: Mapping[str, float],
    bounds: Mapping[str, Sequence[float]],
    population: int,
    delta_rad: float,
) -> dict[str, object]:
    """What the signature explorer draws: a log, the fitted signature from its first impact on, and the bounds."""
    shape = dict(fitted)
    while shape["t0"] + shape["T1"] > shape["T_f"] / 2:  # the same signature
        shape |= {"t0": shape["t0"] - shape["T_f"] / 2, "A": -shape["A"]}
    order = ("A", "t0", "tau", "omega", "v_t", "T2", "T1", "T_f")
    wider = {"A": (-1.5, 1.5), "t0": (-0.2, 0.6), "T_f": (0.392, 0.412)}
    return {
        "record": np.round(v, 4).tolist(),
        "dt": round(t[1], 9),
        # as the sliders have it
        "fitted": {
            name: round(shape[name], 4 if name in ("tau", "omega") else 6) for name in order
        },
        "bounds": {name: pair for name, pair in (dict(bounds) | wider).items() if name != "v_t"},
        "turns": 12,
        "population": population,
        "printed_T_f": published.value("table1.T_f.max"),
        "backlash_rad": delta_rad,
    }
