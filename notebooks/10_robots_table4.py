# %% [markdown]
# # 10 · Two robots in a plant (Table 4), as stand-ins
#
# *You will see how a threshold on $A$ is chosen, and which disturbance looks like backlash. Reading
# time: 8 min. Run time: 40 s. Before this: notebook [9](09_bench_table3.ipynb).*
#
# **The robots' logs were never published. Everything below comes from simulated robots,
# [stand-ins](glossary.md#stand-in), and none of it tests the printed numbers.**
#
# ## Claim
#
# On axis 4 of two robots of one model, 30 [runs](glossary.md#run) each, $A$ tells the one with
# excessive [backlash](glossary.md#backlash) from the other, although the other joints' disturbances
# may hide the signature (section "Testing on real-world data from robots", Table 4).
#
# ## Method
#
# A stand-in axis is a bench of notebook 9 with less gravity (axis 4 carries the wrist and a tool
# only), and with three sinusoidal torques on its load, of any frequency from 2.5 to 40 Hz: what
# reaches it from the other joints. A healthy axis has up to 0.1 mrad of backlash, a bad one 0.2 to
# 0.5 mrad. All of these are assumptions (`bench.draw_robot`).
#
# Two robots say little about a threshold on $A$, so we draw many of each kind, and fit each by the
# best fit (notebook 8).

# %%
import numpy as np
import pandas as pd
from matplotlib import pyplot as plt

import workbook
from replication import bench, characteristic, figures, joint, published

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
repeats = 30  # CMA-ES runs on each of the two logs
robots_each = 30  # robots of each kind
robot_seed = 1  # which robots are drawn
couplings = [0.03, 0.1]  # largest torque of a coupling, over m g r, of two kinds of arms
torque_shares = [0.02, 0.1]  # torque over m g r of one disturbance, on a joint without backlash

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.check_parameters(
    repeats=(repeats, range(2, 1001)),
    robots_each=(robots_each, range(2, 10001)),
    robot_seed=(robot_seed, range(0, 10**6)),
    couplings=(couplings, [(0, 1)]),
    torque_shares=(torque_shares, [(1e-4, 1)]),
)

# %% [markdown]
# ## Result
#
# ### Many robots, and the threshold
#
# $A$ [rps] of the two kinds, one log a robot. A threshold $T$ [rps] has the rates of detection and of false alarms
#
# $$d(T) = P(A \ge T \mid \text{excessive}), \qquad f(T) = P(A \ge T \mid \text{healthy}).$$
#
# The curve of $d$ over $f$, with a point for each $A$ that occurs, is the receiver operating characteristic (ROC). The
# area under it is the probability that an excessive robot has a larger $A$ than a healthy one. Youden's index
# ([1950](https://doi.org/10.1002/1097-0142%281950%293:1%3C32::AID-CNCR2820030106%3E3.0.CO;2-3)) selects
#
# $$T^* = \arg\max_T \left[ d(T) - f(T) \right].$$
#
# *Predict:* which of the printed amplitudes is the better threshold?


# %%
def draw_robots(coupling):  # of each kind as many: kinds, and cases of (bench, backlash)
    rng = np.random.default_rng(robot_seed)
    kinds = list(bench.ROBOTS) * robots_each
    return kinds, [bench.draw_robot(rng, kind, coupling) for kind in kinds]


def roc(table):  # thresholds T, with the shares of healthy and of excessive robots at or above
    T = np.r_[np.inf, np.sort(table["A_rps"])[::-1]]
    healthy, excessive = (table["A_rps"][table["kind"] == kind] for kind in bench.ROBOTS)
    f, d = (np.mean(A.to_numpy()[:, None] >= T, axis=0) for A in (healthy, excessive))
    return pd.DataFrame({"T": T, "f": f, "d": d})


# %%
populations, curves = {}, {}
for coupling in couplings:
    kinds, cases = draw_robots(coupling)
    populations[coupling] = bench.fit_logs(cases, robot_seed).assign(kind=kinds)
    curves[coupling] = roc(populations[coupling])
areas = {coupling: np.trapezoid(curve["d"], curve["f"]) for coupling, curve in curves.items()}
population, curve = populations[couplings[0]], curves[couplings[0]]
best = curve.loc[(curve["d"] - curve["f"]).idxmax()]  # Youden

# %%
printed = pd.Series(published.column("Table 4", "mean"), ["robot A", "robot B"])
figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
edges = np.linspace(0, 1.02 * population["A_rps"].max(), 40)
for kind, part in population.groupby("kind", sort=False):
    left.hist(part["A_rps"], edges, alpha=0.55, label=kind)
for label, T in {"best threshold": best["T"], **printed.add_prefix("printed, ")}.items():
    left.axvline(T, color="k", linestyle="-" if label == "best threshold" else ":")
for coupling, each in curves.items():
    label = f"couplings to {100 * coupling:.3g} %, area {areas[coupling]:.3f}"
    right.plot(100 * each["f"], 100 * each["d"], label=label)
left.set(xlabel="fitted A [rps]", ylabel="number of robots")
right.set(xlabel="healthy called excessive [%]", ylabel="excessive detected [%]")
left.legend()
right.legend()
workbook.show_figure(
    "table4_robots",
    figure,
    f"Left: A of {robots_each} simulated healthy robots and as many with excessive backlash; the best threshold "
    "(line) and the printed A of the two robots (dotted). Right: the rates of all thresholds.",
)

# %% [markdown]
# What the printed amplitudes mean in rad, by equation 10 (notebook 6), and which rates they would have as thresholds.

# %%
thresholds = pd.DataFrame({"A_rps": [*printed, best["T"]]}, [*printed.index, "best threshold"])
thresholds["equation_10_rad"] = characteristic.equation_10().backlash_rad(thresholds["A_rps"])
for kind, part in population.groupby("kind", sort=False):
    thresholds[f"{kind}_above"] = [np.mean(part["A_rps"] >= T) for T in thresholds["A_rps"]]
thresholds

# %% [markdown]
# ### Table 4
#
# Robots A and B are the first healthy and the first bad one of the population above. The sign of $A$ is dropped.

# %%
_, cases = draw_robots(couplings[0])
table = bench.table4(cases[:2], robot_seed, repeats)
columns = {"printed_mean": "mean", "printed_sd": "sd"}
columns |= {"mean_A_rps": "mean_ours", "sd_A_rps": "sd_ours"}
workbook.show_figure(
    "table4_means",
    figures.means_beside(table.set_index("robot").rename(columns=columns)),
    f"A of the stand-in robots (mean, SD of {repeats} runs) beside Table 4's.",
)

# %% [markdown]
# ### A healthy joint shaken near 21 Hz
#
# A joint without any backlash, shaken by one sinusoidal torque of amplitude $\tau_0$ [N m] and phase $\varphi$ [rad].
# If it goes through $k$ periods in a load turn of $T_f$ [s], then half a turn later it is
#
# $$\tau\left(t + \frac{T_f}{2}\right) = \tau_0 \sin\left(2\pi k\,\frac{t + T_f/2}{T_f} + \varphi\right)
# = (-1)^k\,\tau(t).$$
#
# At an odd $k$ it repeats with opposite sign half a turn later, as the [signature](glossary.md#signature) does: no
# number of turns tells the two apart, and the disturbance is read as $A$. At an even $k$ the two half turns of the
# signature cancel it. The response is largest near the joint's own frequency, where the signature rings too.

# %%
quiet = bench.draw_bench(np.random.default_rng(robot_seed), bench.Spread(ratios=0.0))
turn_hz = 1 / quiet.joint.turn_period
orders = np.arange(5.0, 12.01, 0.25)  # k
shaken = []
for share in torque_shares:
    for k in orders:
        wave = joint.Wave(k / quiet.joint.N, 0.0, on_load=share * quiet.joint.G)
        shaken.append((quiet._replace(joint=quiet.joint._replace(waves=(wave,))), 0.0))
sweep = bench.fit_logs(shaken, robot_seed).assign(
    share=np.repeat(torque_shares, orders.size), hertz=np.tile(orders * turn_hz, len(torque_shares))
)

# %%
figure, axis = plt.subplots(figsize=(6, 3), layout="constrained")
for odd in np.arange(5, 12.1, 2) * turn_hz:
    axis.axvline(odd, color="0.85", linewidth=5)
for share, part in sweep.groupby("share"):
    axis.plot(part["hertz"], part["A_rps"], "o-", label=f"{100 * share:.3g} % of m g r")
axis.axhline(best["T"], color="k", linestyle="--", label="best threshold of the robots")
axis.set(xlabel="frequency of the torque [Hz]", ylabel="fitted A [rps]")
axis.legend()
workbook.show_figure(
    "table4_disturbance",
    figure,
    "A fitted to a joint without backlash that one sinusoidal torque shakes. Grey: odd harmonics of the load's turn.",
)

# %% [markdown]
# ## Verdict
#
# All numbers are those of stand-ins and test nothing.

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
cells = {}
for row, made in enumerate(table.to_dict("records"), start=1):
    cells[f"table4.row{row:02d}.mean"] = made["mean_A_rps"]
    cells[f"table4.row{row:02d}.sd"] = made["sd_A_rps"]
healthy_A, excessive_A = table["mean_A_rps"]
loudest = sweep[sweep["share"] == max(torque_shares)]
mistaken = 100 * np.mean(loudest["A_rps"] >= best["T"])
of_areas = ", ".join(f"{area:.3f} at {100 * each:.3g} %" for each, area in areas.items())
workbook.verdict(
    f"Robot B's mean A is {excessive_A / healthy_A:.1f} times robot A's. Of {robots_each} robots of each kind the best "
    f"threshold, {best['T']:.3f} rps, detects {100 * best['d']:.0f} % of the bad ones with {100 * best['f']:.0f} % "
    f"false alarms. The area under the curve by the largest coupling torque: {of_areas} of gravity. One sinusoidal "
    f"torque of {100 * max(torque_shares):.3g} % makes a joint without backlash look excessive at {mistaken:.0f} % of "
    f"the frequencies{': $A$ alone does not tell a coupling torque from backlash' if mistaken else ''}.",
    cells,
    tables={"table4": table},
)

# %% [markdown]
# ## Try changing
#
# 1. `couplings = [0.0]`: without couplings gravity and friction still differ from arm to arm, and that alone makes the
#    kinds overlap.
# 2. `robot_seed = 2`: two other robots, and another ratio of their $A$.
# 3. `couplings = [0.03, 0.3]`: with such couplings $A$ hardly separates the kinds; the area is near 0.5, that of
#    guessing.
#
# ## Exercises
#
# Each asks for numbers by a `name`. The cell below your answer says *right* or *not yet*.

# %%
chance = share_right = left = np.nan  # your answers

# %% [markdown]
# **1.** Over all pairs of an excessive and a healthy robot, in which share (`chance`) has the
# excessive one the larger $A$ (an equal $A$ counts as half)? Compare with the area under the ROC.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
healthy, excessive = (
    population["A_rps"][population["kind"] == kind].to_numpy() for kind in bench.ROBOTS
)
difference = excessive[:, None] - healthy
chance = np.mean(difference > 0) + np.mean(difference == 0) / 2
print(f"{chance:.4f}, as the area")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(chance, areas[couplings[0]], atol=1e-3)

# %% [markdown]
# **2.** In a plant 2 % of the robots are bad. Which share (`share_right`) of those that the best
# threshold calls excessive are so (Bayes)? From which share of bad robots on is a call more often
# right than wrong?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
d, f = best["d"], best["f"]
share_right = 0.02 * d / (0.02 * d + 0.98 * f)
print(
    f"{share_right:.2f}; half of the calls are right where {f / (d + f):.2f} of the robots are bad"
)

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
called = 0.02 * best["d"] + 0.98 * best["f"]
workbook.check_answer(share_right, 0.02 * best["d"] / called, rtol=0.05)

# %% [markdown]
# **3.** Of $\sin(2\pi k t/T_f)$ take the part that repeats with opposite sign half a turn later,
# averaged over twelve turns. Which shares of the RMS has it at $k$ = 8, 8.5 and 9 (`left`, a list)?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
sample = np.arange(2400)  # 2 ms apart; a half turn has 100
sign = np.where(sample // 100 % 2 == 0, 1.0, -1.0)
waves = [np.sin(2 * np.pi * k * sample / 200) for k in (8, 8.5, 9)]
parts = [(sign * wave).reshape(24, 100).mean(axis=0) for wave in waves]
left = [np.std(part) / np.std(sign * wave) for part, wave in zip(parts, waves, strict=True)]
print(np.round(left, 3))

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(left, [0, 0, 1], atol=0.01)

# %% [markdown]
# **What you have learnt**: a threshold is chosen by rates of detection and false alarm, and a
# torque at an odd harmonic looks like backlash. *Next:* [your own
# joint](beyond/11_your_own_joint.ipynb).
