# %% [markdown]
# # 11 · Two robots in a plant (Table 4), as stand-ins
#
# *You will see how a threshold on $A$ is chosen, and which disturbance looks like backlash. Run
# time: 30 s. Before this: notebook [10](10_bench_table3.ipynb).*
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
# The paper's static characteristic turns an amplitude $A$ [rps] into rad,
#
# $$\delta = a_0 + a_1 \cdot 60A + a_2 (60A)^2 + a_3 (60A)^3 \tag{10}$$
#
# with the printed coefficients $a_k$ [rad/rpm$^k$] (notebook 6).
#
# A stand-in axis is a bench of notebook 10 with less gravity (axis 4 carries the wrist and a tool
# only), and with three sinusoidal torques on its load, of any frequency from 2.5 to 40 Hz: what
# reaches it from the other joints. A healthy axis has up to 10⁻⁴ rad of backlash, a bad one 2·10⁻⁴
# to 5·10⁻⁴ rad. All of these are assumptions (`RobotSpread` in `standins`).
#
# Two robots say little about a threshold $T$ [rps]. Many of each kind give its rates of detection
# and of false alarms,
#
# $$d(T) = P(A \ge T \mid \text{excessive}), \qquad f(T) = P(A \ge T \mid \text{healthy}).$$
#
# The curve of $d$ over $f$ for all $T$ is the receiver operating characteristic (ROC). The area
# under it is the probability that an excessive robot has a larger $A$ than a healthy one. Youden's
# index
# ([1950](https://doi.org/10.1002/1097-0142%281950%293:1%3C32::AID-CNCR2820030106%3E3.0.CO;2-3))
# selects
#
# $$T^* = \arg\max_T \left[ d(T) - f(T) \right].$$
#
# These robots are fitted by the global fit (notebook 8), one fit a robot. The real logs' loader
# would go where the bench's goes (notebook 10).

# %%
from dataclasses import replace

import numpy as np
import pandas as pd

import workbook
from backlash.fitting.global_fit import global_fit
from replication import published, standins, table2
from studies import standin_plots

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
repeats = 30  # CMA-ES runs on each of the two logs
robots_each = 100  # robots of each kind
robot_seed = 1  # which robots are drawn
coupling = 0.03  # largest torque of a coupling, over m g r
loud_coupling = 0.1  # the same in a strongly coupled arm
loud_robots_each = 50  # robots of each kind with strongly coupled arms
frequency_step_hz = 0.5  # of the sweep of one disturbance
torque_shares = [0.02, 0.05, 0.1]  # its torque over m g r

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.check_parameters(
    repeats=(repeats, range(2, 1001)),
    robots_each=(robots_each, range(2, 10001)),
    robot_seed=(robot_seed, range(0, 10**6)),
    coupling=(coupling, workbook.Interval(0, 1)),
    loud_coupling=(loud_coupling, workbook.Interval(0, 1)),
    loud_robots_each=(loud_robots_each, range(2, 10001)),
    frequency_step_hz=(frequency_step_hz, workbook.Interval(0.1, 17.5)),
    torque_shares=(torque_shares, [workbook.Interval(1e-4, 1)]),
)

# %% [markdown]
# ## Result
#
# ### Many robots, and the threshold
#
# $A$ [rps] of the two kinds, in arms with little and with much coupling. The ROC has one point for
# each $A$ that occurs, taken as the threshold. Predict first: which of the printed amplitudes is
# the better threshold?

# %%
spread = standins.RobotSpread(coupling=coupling)
loud_spread = replace(spread, coupling=loud_coupling)
population, loud = (
    standins.robot_population(global_fit, each, of, robot_seed)
    for each, of in ((robots_each, spread), (loud_robots_each, loud_spread))
)


def roc(table):  # thresholds and their rates
    healthy, excessive = (table["A_rps"][table["kind"] == kind] for kind in standins.KINDS)
    T = np.r_[np.inf, np.unique(table["A_rps"])[::-1]]
    rates = [np.mean(A.to_numpy()[:, None] >= T, axis=0) for A in (healthy, excessive)]
    return pd.DataFrame({"threshold_rps": T, "false_alarms": rates[0], "detected": rates[1]})


# %%
def area_under(curve):
    return np.trapezoid(curve["detected"], curve["false_alarms"])


def youden(curve):  # the row of the best threshold
    return curve.loc[(curve["detected"] - curve["false_alarms"]).idxmax()]


def rates_at(T, table):  # shares of the healthy and of the excessive at or above T
    above = (table["A_rps"] >= T).groupby(table["kind"]).mean()
    return tuple(above[list(standins.KINDS)])


curve, loud_curve = roc(population), roc(loud)
best, loud_best = youden(curve), youden(loud_curve)

# %%
printed_A, printed_B = published.column("Table 4", "mean")
named = {"printed robot A": printed_A, "printed robot B": printed_B}
named["best (Youden)"] = best["threshold_rps"]
marks = pd.DataFrame(
    [(name, T, *rates_at(T, population)) for name, T in named.items()],
    columns=["name", "threshold_rps", "false_alarms", "detected"],
)
curves = {
    f"couplings up to {100 * share:.0f} %": (each, area_under(each))
    for share, each in ((coupling, curve), (loud_coupling, loud_curve))
}
workbook.show_figure(
    "table4_robots",
    standin_plots.robots(population, curves, marks),
    f"(a) A of {robots_each} simulated healthy robots and {robots_each} with excessive backlash, one log each, "
    "and three thresholds. (b) Rates of these thresholds, and of all others (curves), for couplings up to "
    f"{100 * coupling:.3g} % of gravity and, with {loud_robots_each} robots of each kind, up to "
    f"{100 * loud_coupling:.3g} %. Larger coupling torques leave a smaller area under the curve.",
)

# %%
index = curve["detected"] - curve["false_alarms"]
nearly_best = curve.loc[index >= index.max() - 0.011, "threshold_rps"]
print(
    f"thresholds from {nearly_best.min():.3f} to {nearly_best.max():.3f} rps come within 0.01 of the best index"
)
display(marks)
arms = pd.concat([population.assign(coupling=coupling), loud.assign(coupling=loud_coupling)])
arms.groupby(["coupling", "kind"], sort=False)["A_rps"].agg(["count", "mean", "std", "min", "max"])

# %% [markdown]
# The threshold depends on the amplitude of the coupling torques: that of the weakly coupled arm
# applied to the strongly coupled one, and the latter's own.

# %%
T = best["threshold_rps"]
cases = pd.DataFrame(
    [
        (coupling, "its best", *best, area_under(curve)),
        (loud_coupling, "the weakly coupled arm's", T, *rates_at(T, loud), area_under(loud_curve)),
        (loud_coupling, "its best", *loud_best, area_under(loud_curve)),
    ],
    columns=["coupling", "threshold", *best.index, "area"],
)
cases

# %% [markdown]
# ### What the printed amplitudes mean in rad

# %%
a = 1e-6 * np.array([published.value(f"equation10.A{k}") for k in range(4)])  # rad/rpm^k
printed = pd.DataFrame({"A_rps": [printed_A, printed_B]}, index=["robot A", "robot B"])
printed.assign(
    equation_10_rad=sum(a[k] * (60 * printed["A_rps"]) ** k for k in range(4))
)  # equation 10

# %% [markdown]
# Robot B's backlash, "excessive", would be less than the smallest of Table 2, 3·10⁻⁴ rad.
#
# ### Table 4
#
# Robots A and B are the first healthy and the first bad one of the population above. As in notebook
# 8, the sign of $A$ is dropped.

# %%
seeds = range(1, repeats + 1)
records = standins.table4_records(spread, robot_seed)
fits = table2.repeated_fits(
    records, [table2.AUTHORS_SETTINGS], seeds, label="Table 4, stand-in robots"
)
table = standins.table4(fits)
table.astype(object).set_index("robot").T

# %% [markdown]
# ### A healthy joint shaken near 21 Hz
#
# A joint without any backlash, shaken by one sinusoidal torque of amplitude $\tau_0$ [N m] and
# phase $\varphi$ [rad]. If it goes through $k$ periods in a load turn of $T_f$ [s], then half a
# turn later it is
#
# $$\tau\left(t + \frac{T_f}{2}\right) = \tau_0 \sin\left(2\pi k\,\frac{t + T_f/2}{T_f} + \varphi\right)
# = \tau_0 \sin\left(\frac{2\pi k t}{T_f} + \varphi + \pi k\right) = (-1)^k\,\tau(t).$$
#
# At an odd $k$ it repeats with opposite sign half a turn later. So does the
# [signature](glossary.md#signature), because gravity pulls the teeth from one side to the other: no
# number of turns tells the two apart by their sign, and the disturbance is read as $A$. At an even
# $k$ the two half turns of the signature cancel it, and at other frequencies it averages out over
# twelve turns. The response is largest near the coupling's own frequency with the teeth in contact,
# where the signature rings too.

# %%
T_f = records[0][1].turn_period_s
middle_gravity = float(np.mean(spread.gravity))
frequencies = np.arange(12.5, 30.01, frequency_step_hz)
sweep = standins.disturbed_healthy_joint(
    global_fit, frequencies, torque_shares, middle_gravity, spread.bench.noise_rps / 2, robot_seed
)
lines = {"printed robot B": printed_B, "best threshold of the robots": best["threshold_rps"]}
workbook.show_figure(
    "table4_disturbance",
    standin_plots.robots_disturbance(sweep, lines, 1 / T_f),
    f"A fitted to a joint without backlash that one sinusoidal torque shakes, at each of {frequencies.size} "
    f"frequencies and {len(torque_shares)} torques (shares of m g r); the legend's rps are the largest disturbance of "
    "the speed. A peaks near the ring's frequency and at odd harmonics of the load's rotation. Lines: thresholds. "
    "Crosses: A's interval contains zero, so that nothing is known of A.",
)

# %% [markdown]
# The fitted $A$ [rps] at the harmonics of the load's turn, and how many of the twelve turns the fit
# uses; columns are the torque over $m g r$.

# %%
order = sweep["disturbance_hz"] * T_f
harmonics = sweep[np.isclose(order, order.round())].assign(k=order.round().astype(int))
harmonics.pivot(
    index=["k", "disturbance_hz"], columns="torque_share", values=["A_rps", "turns_used"]
)

# %% [markdown]
# Away from the odd harmonics a disturbance can still be large enough for a fit that begins in the
# record's last turn: Table 1 allows $t_0$ up to the record's end, so that the signature has only
# one or two windows to fit, too few for the disturbance to cancel.

# %%
by_torque = sweep.assign(
    called_excessive_percent=100 * (sweep["A_rps"] >= best["threshold_rps"]),
    fits_of_under_two_turns_percent=100 * (sweep["turns_used"] < 2),
    interval_contains_zero_percent=100 * (sweep["low_rps"] <= 0),
).groupby("torque_share")
summary = by_torque[["disturbance_rps", "A_rps"]].max().add_prefix("largest_")
percents = [name for name in by_torque.obj.columns if name.endswith("percent")]
summary[percents] = by_torque[percents].mean()
summary

# %% [markdown]
# ## Verdict
#
# All numbers are those of stand-ins and test nothing.

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
cells = standins.table4_cells(table)
by_kind = table.set_index("kind")["mean_A_rps"]
mistaken = summary["called_excessive_percent"].iloc[-1]
workbook.verdict(
    f"Robot B's mean A is {by_kind['excessive'] / by_kind['healthy']:.1f} times robot A's. Of {robots_each} robots of "
    f"each kind the best threshold, {best['threshold_rps']:.3f} rps, finds {100 * best['detected']:.0f} % of the bad "
    f"ones with {100 * best['false_alarms']:.0f} % false alarms (area {area_under(curve):.3f}); with couplings of up "
    f"to {100 * loud_coupling:.3g} % of gravity the area is {area_under(loud_curve):.3f}. One sinusoidal torque of "
    f"{100 * torque_shares[-1]:.3g} % makes {mistaken:.0f} % of the joints without backlash look excessive"
    f"{': $A$ alone does not tell a coupling torque from backlash' if mistaken > 0 else ''}.",
    cells,
)

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.export(
    tables={"table4": table},
    supplement={
        "table4_population": (population, "A of robots, healthy and with excessive backlash."),
        "table4_thresholds": (marks, "Rates of three thresholds of A."),
        "table4_disturbance": (sweep, "A that a sinusoidal torque gives a joint without backlash."),
    },
    cells=cells,
)

# %% [markdown]
# ## Try changing
#
# 1. `coupling = 0.0`: without couplings the best threshold errs nearly as often, because gravity
#    and friction differ from arm to arm, and that alone makes the kinds overlap.
# 2. `robot_seed = 2`: two other robots, B with half the backlash; its mean $A$ halves, while the
#    best threshold of the population moves by less than a tenth.
# 3. `loud_coupling = 0.3`: $A$ hardly separates the kinds; the area is near 0.5, that of guessing.
#
# ## Exercises
#
# **1.** Count, over all pairs of an excessive and a healthy robot, how often the excessive one has
# the larger $A$ (an equal $A$ counts as half). Compare with the area under the ROC.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
healthy, excessive = (
    population["A_rps"][population["kind"] == kind].to_numpy() for kind in standins.KINDS
)
difference = excessive[:, None] - healthy
chance = np.mean(difference > 0) + np.mean(difference == 0) / 2
assert np.isclose(chance, area_under(curve))
print(f"{chance:.4f}")

# %% [markdown]
# **2.** In a plant 2 % of the robots are bad. Which share (to 1 %) of those that the best threshold
# calls excessive are so (Bayes)? From which share of bad robots on is a call more often right than
# wrong?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
d, f = best["detected"], best["false_alarms"]
right = 0.02 * d / (0.02 * d + 0.98 * f)
even = f / (d + f)
assert 0 <= right <= 1
assert np.isclose(even * d, (1 - even) * f)
print(
    f"{100 * right:.0f} % of the calls are right; half of them where {100 * even:.1f} % of the robots are bad"
)

# %% [markdown]
# **3.** Split a disturbance into the part that repeats with opposite sign half a turn later and the
# rest. What is left of it in the first part at $k = 8$, at $k = 9$ and at $k = 8.5$, averaged over
# twelve turns?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
sample = np.arange(2400)  # 2 ms apart; a half turn has 100
t, sign = 2e-3 * sample, np.where(sample // 100 % 2 == 0, 1.0, -1.0)
parts = {
    k: (sign * np.sin(2 * np.pi * k * t / 0.4)).reshape(24, 100).mean(axis=0) for k in (8, 8.5, 9)
}
kept = {k: np.sqrt(np.mean(part**2)) for k, part in parts.items()}
assert np.isclose(kept[9], np.sqrt(0.5))  # all of it; nothing of the others
assert max(kept[8], kept[8.5]) < 1e-9

# %% [markdown]
# **What you have learnt**: a threshold is chosen by rates of detection and false alarm, and a
# torque at an odd harmonic looks like backlash. *Next:* [your own
# joint](beyond/12_your_own_joint.ipynb).
