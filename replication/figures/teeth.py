"""The teeth in the gap: how they are drawn, and one turn of a joint as an animation."""

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.animation import FuncAnimation

from replication.figures.style import BLUE, INK, ORANGE, STYLE
from replication.simulator.parameters import TURN, JointParameters
from replication.simulator.simulate import SimulatedJoint


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
    """Draw the motor's tooth between the load's flanks, which springs (the coupling) hold.

    Lengths in mrad.
    """
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


def animate_teeth(run: SimulatedJoint, joint: JointParameters) -> str:
    """Show a turn of a run as HTML: the arm, the teeth in the gap, the motor speed.

    Slower while the gap is open.
    """
    turn = np.floor((run.load_position_rad - TURN / 4) / TURN) == 1
    time_s = run.time_s[turn]
    t = 1e3 * (time_s - time_s[0])
    angle = run.load_position_rad[turn]
    v = run.motor_speed_rps[turn]
    x = 1e3 * (run.motor_position_rad[turn] / joint.gear_ratio - angle)
    free = run.gap_state[turn] == 0
    frames = np.flatnonzero(np.round(t, 3) % np.where(free, 5, 25) == 0)
    with (
        plt.rc_context(STYLE | {"figure.dpi": 64, "figure.constrained_layout.use": False}),
        plt.ioff(),
    ):
        margins = {
            "left": 0.15,
            "right": 0.99,
            "bottom": 0.12,
            "top": 0.99,
            "hspace": 0.32,
            "height_ratios": (3, 2),
        }
        figure, axes = plt.subplot_mosaic("ABB;CCC", figsize=(6.4, 4.6), gridspec_kw=margins)
        figure.canvas.draw_idle = lambda: None  # type: ignore[method-assign,misc]  # a frame is drawn as it is saved
        arm, gap, speed = axes.values()
        speed.plot(t, v, linewidth=0.9)
        speed.fill_between(t, v.min(), v.max(), where=free, color="0.85")
        speed.set(xlabel="time [ms]; grey: gap open", ylabel="speed [rps]")
        (dot,) = speed.plot([], [], "o", color=INK)

        def draw(k: int) -> None:
            for artist in (*arm.lines, *arm.texts, *gap.lines, *gap.patches, *gap.collections):
                artist.remove()  # to clear the axes takes ten times as long
            draw_arm(arm, angle[k])
            draw_teeth(gap, x[k], 1e3 * run.delta_rad, np.abs(x).max())
            dot.set_data(t[[k]], v[[k]])

        turned = FuncAnimation(figure, draw, frames=frames, interval=100, init_func=lambda: None)
        html = turned.to_jshtml()
        plt.close(figure)
    return html
