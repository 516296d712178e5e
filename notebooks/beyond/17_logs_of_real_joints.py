# %% [markdown]
# # 17 · Logs of real joints
#
# *You will give the sensor public logs of real joints, and find out what it could have seen in
# them. Run time: 2 min. Before this: notebook [12](12_your_own_joint.ipynb).*
#
# ## Claim
#
# The sensor works on real joints. The paper says so of its own bench and robots, whose logs were
# never published. Public logs of other joints allow only half of a test: none is of a joint of
# known [backlash](../glossary.md#backlash), so they can show false alarms, but no right answer.
#
# ## Method
#
# Each log is downloaded from its repository at a fixed commit and verified, or read from the folder
# `HARDWARE_LOGS`; no log is part of this project. Without them this notebook is not run, and its
# committed results stay.
#
# *What it could have seen.* A log without an answer says something only if a backlash would have
# been answered. A twin is a simulated joint that makes the log's movement under a rigid load of the
# inertia $J_l$ [kg m²], with gravity $m g r$ [N m] and friction $F$ [N m]. Without backlash and
# elasticity its torque would be
#
# $$\tau = m g r \sin(q - q_0) + F\, \text{sign}(\dot q) + d\, \dot q + (J_l + N^2 J_m)\, \ddot q$$
#
# with the angle $q$ [rad], and $q_0$, $F$ and the viscosity $d$ [N m s] from the log. It has the
# log's time stamps; what this equation leaves of the log's torque is its noise. Stiffness, damping
# and drive are drawn. The *detection limit* of a log is the smallest backlash whose twins are
# answered in 90 % of the draws (`make studies NAME=hardware`).
#
# *A second encoder.* Three axes have one at the load. Motor and load part by $\varepsilon$ [rad],
#
# $$\varepsilon = \delta\, \text{sign}(\tau) + h\, \text{sign}(\dot q)
# + c_1 \tau + c_2 \dot q + c_3 \ddot q + c_4 q + c_0$$
#
# where $h$ [rad] is what friction winds up. The regression's $\delta$ is an upper limit of the
# backlash.

# %%
import numpy as np
import pandas as pd
from scipy import stats

import workbook
from studies import hardware
from workbook import Interval

pd.set_option("display.max_colwidth", None)

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
makes = ["Universal Robots", "printed", "KUKA", "T-Motor"]  # whose logs are read
twin_of = "UR10e joint 1"  # log whose twin is looked at
backlash_mrad = 3.0  # of the twin
twin_seed = 1  # its stiffness, damping, drive and noise

# %% jupyter={"source_hidden": true} tags=["hide-input"]
logs = hardware.list_logs()
workbook.check_parameters(
    makes=(makes, [sorted(logs["make"].unique())]),
    twin_of=(twin_of, tuple(logs.index)),
    backlash_mrad=(backlash_mrad, Interval(0, 10)),
    twin_seed=(twin_seed, range(0, 2**31)),
)

# %% [markdown]
# ## Result
#
# ### The answers
#
# By the torque, from what is known of each load. The printed gears carry no load, and are read by
# the speed alone, too.

# %%
read = {name: hardware.load_log(row) for name, row in logs.iterrows() if row["make"] in makes}
told = {name: hardware.answer(log, logs.loc[name]) for name, log in read.items()}
printed = [name for name in read if logs.loc[name, "make"] == "printed"]
by_speed = {name: hardware.answer(read[name], logs.loc[name], method="self") for name in printed}
table = logs.loc[[*told], ["make", "joint", "repository", "licence"]].assign(
    verdict=[each.verdict for each in told.values()],
    reason=[each.warnings[0] for each in told.values()],
)
table[["verdict", "reason"]]

# %%
turns = pd.DataFrame(index=printed)
turns["verdict"] = [by_speed[name].verdict for name in printed]
turns["reason"] = [by_speed[name].warnings[0] for name in printed]
turns["turn_s"] = [by_speed[name].turn_period_s for name in printed]
turns["by_position_s"] = [hardware.turn_period_s(read[name]) for name in printed]
turns["off_percent"] = 100 * (turns["turn_s"] / turns["by_position_s"] - 1).abs()
turns

# %% [markdown]
# The ripple of a printed gear repeats with its turn, as a backlash does. The turn that the sensor
# finds in the speed is that of the position; the speed column itself is 0.2 % off.
#
# ### What it could have seen
#
# *Predict:* a log at 94 Hz, strokes of 0.6 to 1 rad/s: from which backlash on does the sensor
# answer?

# %%
twins = pd.read_csv(workbook.ROOT / "results" / "hardware.csv")
limits = hardware.detection_limits(twins)
limits.rename_axis("log")

# %% [markdown]
# A limit of nan: too few twins were answered at each backlash that was simulated, so the refusal of
# such a log says nothing of its joint. Twins that were answered, and how many of their intervals
# hold the backlash:

# %%
twins[twins["answered"] > 0]

# %% [markdown]
# One twin, looked at:

# %%
row = logs.loc[twin_of]
twin = hardware.simulate_twin(
    hardware.load_log(row), row, 1e-3 * backlash_mrad, np.random.default_rng(twin_seed)
)
print(hardware.answer(twin, row))

# %% [markdown]
# ### The second encoder

# %%
axes = logs[logs["load_encoder"] & logs["make"].isin(makes)].groupby("joint")
parts = {
    joint: hardware.lost_motion([read[name] for name in names])
    for joint, names in axes.groups.items()
}
lost = pd.concat(parts, names=["joint", "by"]) if parts else pd.DataFrame()
lost

# %% [markdown]
# The larger end of an interval is the limit, as far as the motor's torque changes sign when the
# teeth's does. The torque of axis 3 does not change its sign, so that a backlash would not be seen
# there.
#
# ## Verdict

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
joints = table["joint"].nunique()
alarms, clear = (int((table["verdict"] == name).sum()) for name in ("backlash", "no backlash"))
drawn, answered, covered = twins[["draws", "answered", "covered"]].sum()
largest_mrad = 1e3 * twins["delta_rad"].max()
workbook.verdict(
    f"Of {len(table)} logs of {joints} joints ({', '.join(makes)}) {alarms} are called a backlash and {clear} none. Of "
    f"{drawn} simulated twins with up to {largest_mrad:g} mrad {answered} got an answer, {covered} a right one: that "
    "there is no alarm proves nothing. A positive test needs a joint of known play on a bench, loaded by gravity, 12 "
    "turns at constant speed, sampled at 500 Hz or more."
)

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.export(
    facts=hardware.facts(table, twins, lost)
    | {"hardware_turn_off": (turns["off_percent"].max(), ".1g")},
    supplement={
        "hardware_answers": (table.reset_index(), "Public logs of real joints: the answers."),
        "hardware_limits": (limits.reset_index(names="log"), "What their twins would have shown."),
        "hardware_lost_motion": (lost.reset_index(), "Motor against load by a second encoder."),
    },
)

# %% [markdown]
# ## Try changing
#
# 1. `twin_of = "UR10e joint 5"`: no gravity either, and refused for it.
# 2. `backlash_mrad = 0.0`: the refusal is the same without any backlash.
# 3. `makes = ["T-Motor"]`: a pendulum that swings; no turn or stroke at constant speed.
#
# ## Exercises
#
# **1.** No alarm on $n$ independent joints: how large may the rate of false alarms still be
# (two-sided, 95 %)?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
highest = 1 - 0.025 ** (1 / joints)
assert np.isclose(highest, stats.binomtest(0, joints).proportion_ci().high)
print(f"up to {100 * highest:.0f} %")

# %% [markdown]
# **2.** All of 20 twins are answered. Which share of the draws may be answered at least (two-sided,
# 95 %)?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
least = stats.binomtest(20, 20).proportion_ci().low
assert np.isclose(least, 0.025 ** (1 / 20))
print(f"{100 * least:.0f} %")

# %% [markdown]
# **3.** A data sheet gives a lost motion of 0.15 degrees from side to side. What is $\delta$ in
# mrad, at most?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
half_play_mrad = 1e3 * np.deg2rad(0.15) / 2
assert 1.3 < half_play_mrad < 1.32
print(f"{half_play_mrad:.2f} mrad")
