# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     notebook_metadata_filter: replication
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
#   replication:
#     quick: {repeats: 3, robots_each: 10, loud_robots_each: 10, frequency_step_hz: 2.5}
# ---

# %% [markdown]
# # 11 · Two robots in a plant (Table 4), as stand-ins
#
# **The robots' logs were never published. Everything below comes from simulated robots, and none of it counts as
# reproduced.**
#
# ## Claim
#
# On axis 4 of two robots of one model, 30 runs each, $A$ tells the one with excessive backlash from the other,
# although the other joints' disturbances may hide the signature (section "Testing on real-world data from robots",
# Table 4).
#
# ## Method
#
# A stand-in axis is a bench of notebook 10 with less gravity (axis 4 carries the wrist and a tool only), and with
# three sinusoidal torques on its load, of any frequency from 2.5 to 40 Hz: what reaches it from the other joints. A
# healthy axis has up to 1e-4 rad of backlash, a bad one 2e-4 to 5e-4 rad. Equation 10 makes 2.3e-4 rad of robot B's
# printed $A$, which is less than the smallest level of Table 2. All of these are assumptions (`RobotSpread` in
# `standins.robots`).
#
# Two robots say little about a threshold. Many of each kind give a ROC curve: how many bad ones each threshold on $A$
# finds, and how many healthy ones it calls bad. These are fitted by the global fit (notebook 9), one fit a robot. The
# real logs' loader would go where the bench's goes (notebook 10).

# %%
from dataclasses import replace

import numpy as np
import pandas as pd

from backlash.fitting.global_fit import global_fit
from replication import characteristic, published, table2, workbook
from replication.simulator.simulate import identified_joint
from replication.standins import plots, robots

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
repeats = 30  # CMA-ES runs on each of the two logs
robots_each = 100  # robots of each kind
robot_seed = 1  # which robots are drawn
coupling = 0.03  # largest torque of a coupling, over m g r
loud_coupling = 0.1  # the same in a louder arm
loud_robots_each = 50  # robots of each kind with louder arms
frequency_step_hz = 0.5  # of the sweep of one disturbance
torque_shares = [0.02, 0.05, 0.1]  # its torque over m g r

# %% [markdown]
# ## Result
#
# ### What the printed amplitudes mean in rad

# %%
printed_A, printed_B = published.column("Table 4", "mean")
pd.DataFrame(
    {
        "A_rps": [printed_A, printed_B],
        "equation_10_rad": characteristic.equation_10().backlash_rad([printed_A, printed_B]),
    },
    index=["robot A", "robot B"],
)

# %% [markdown]
# ### Table 4
#
# Robots A and B are the first healthy and the first bad one of the population below. As in notebook 8, the sign of
# $A$ is dropped.

# %%
spread = robots.RobotSpread(coupling=coupling)
seeds = range(1, repeats + 1)
records = robots.table4_records(spread, robot_seed)
fits = table2.repeated_fits(records, [table2.AUTHORS], seeds, label="Table 4, stand-in robots")
table = robots.table4(fits)
workbook.save_table(table, "table4")
table.set_index("robot").T

# %% [markdown]
# ### Many robots

# %%
population = robots.robot_population(global_fit, robots_each, spread, robot_seed)
loud = robots.robot_population(global_fit, loud_robots_each, replace(spread, coupling=loud_coupling), robot_seed)
workbook.save_table(population, "table4_population")
by_kind = population.groupby("kind", sort=False)["A_rps"]
by_kind.describe()

# %%
healthy, excessive = (part.to_numpy() for _, part in by_kind)
curve = robots.roc(healthy, excessive)
loud_kinds = [part.to_numpy() for _, part in loud.groupby("kind", sort=False)["A_rps"]]
loud_curve = robots.roc(*loud_kinds)
best = robots.best_threshold(curve)
thresholds = {"printed robot A": printed_A, "printed robot B": printed_B, "best (Youden)": best["threshold_rps"]}
marks = pd.DataFrame(
    [(name, threshold, *robots.shares_at(healthy, excessive, threshold)) for name, threshold in thresholds.items()],
    columns=["name", "threshold_rps", "false_alarms", "detected"],
)
workbook.save_table(marks, "table4_thresholds")
marks

# %%
curves = {
    f"couplings up to {100 * share:.0f} %": (each, robots.area_under(each))
    for share, each in ((coupling, curve), (loud_coupling, loud_curve))
}
figure = plots.robots(population, curves, marks)
workbook.save_figure(
    figure,
    "table4_robots",
    caption="Simulated healthy and excessive robots: two barely overlapping distributions, so that a threshold on A "
    "separates them, unless the coupling torques are larger.",
)

# %% [markdown]
# The threshold depends on the amplitude of the coupling torques: that of the quiet arm applied to the loud one, and the
# loud one's own.

# %%
of_quiet, loud_best = best["threshold_rps"], robots.best_threshold(loud_curve)
cases = pd.DataFrame(
    [
        (coupling, "its best", of_quiet, best["false_alarms"], best["detected"]),
        (loud_coupling, "the quiet arm's", of_quiet, *robots.shares_at(*loud_kinds, of_quiet)),
        (loud_coupling, "its best", loud_best["threshold_rps"], loud_best["false_alarms"], loud_best["detected"]),
    ],
    columns=["coupling", "threshold", "threshold_rps", "false_alarms", "detected"],
).assign(area=[robots.area_under(each) for each in (curve, loud_curve, loud_curve)])
workbook.save_table(cases, "table4_loudness")
cases

# %% [markdown]
# ### A healthy joint with a loud disturbance near 21 Hz
#
# A joint without any backlash, shaken by one sinusoidal torque. The coupling's own frequency with the teeth in
# contact is where the joint answers loudest, and it is also where the signature rings.
#
# Two things go wrong. At an odd harmonic of the load's rotation a disturbance repeats with opposite sign half a turn
# later, as the signature does: its amplitude is read as $A$, and the misfit is as low as with backlash. At other
# frequencies it averages out over twelve turns, unless it is large enough for a fit that begins in the record's last
# turn: Table 1 allows $t_0$ up to the record's end, so that the signature has only one or two windows to fit.

# %%
joint = identified_joint()
middle_gravity = float(np.mean(spread.gravity))
frequencies = np.arange(12.5, 30.01, frequency_step_hz)
sweep = robots.disturbed_healthy_joint(
    global_fit, frequencies, torque_shares, middle_gravity, spread.bench.noise_rps / 2, robot_seed
)
workbook.save_table(sweep, "table4_disturbance")
lines = {"printed robot B": printed_B, "best threshold of the robots above": best["threshold_rps"]}
figure = plots.robots_disturbance(sweep, lines, 1 / joint.turn_period_s)
workbook.save_figure(
    figure,
    "table4_disturbance",
    caption="A disturbance near the ring's frequency, or at an odd harmonic of the load's rotation, makes a joint "
    "without backlash look like one with it.",
)

# %%
called = sweep.assign(
    called_excessive=sweep["A_rps"] >= best["threshold_rps"],
    late=sweep["turns_used"] < 2,
    cannot_tell=sweep["low_rps"] <= 0,
).groupby("torque_share")
pd.DataFrame(
    {
        "loudest_rps": called["disturbance_rps"].max(),
        "largest_A_rps": called["A_rps"].max(),
        "called_excessive_percent": 100 * called["called_excessive"].mean(),
        "fits_of_under_two_turns_percent": 100 * called["late"].mean(),
        "interval_contains_zero_percent": 100 * called["cannot_tell"].mean(),
    }
)

# %% [markdown]
# A large $A$ whose interval contains zero is the slow answer to gravity, fitted at the lowest frequency of Table 1's
# box, where $A$ and the window trade off: the interval says that it tells nothing, the amplitude alone does not.

# %% [markdown]
# ## Verdict
#
# All cells are `stand-in`.

# %%
workbook.record_verdicts({"stand-in": robots.table4_cells(table)})

# %% [markdown]
# ## Try changing
#
# 1. `coupling = 0.0`: without couplings the best threshold errs nearly as often, because gravity and friction differ
#    from arm to arm, and that alone makes the kinds overlap.
# 2. `robot_seed = 2`: two other robots, B with half the backlash; its mean $A$ halves, and the best threshold of the
#    population falls by a fifth.
# 3. `loud_coupling = 0.3`: $A$ hardly separates the kinds; the area is near 0.5, that of guessing.
