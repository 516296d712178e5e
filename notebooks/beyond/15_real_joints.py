# %% [markdown]
# # 15 · Logs of real joints
#
# *You will give the sensor public logs of real joints, and see what their torque says of the gears.
# Before this: notebook [11](11_your_own_joint.ipynb).*

# %% jupyter={"source_hidden": true} tags=["hide-input"]
import numpy as np
import pandas as pd

import workbook
from studies import hardware

workbook.say_times("15_real_joints")

# %% [markdown]
# ## Claim
#
# The paper's sensor works on real joints: its own bench and robots, whose logs were never published.
# We looked through some 75 repositories for a public log that has the sensor's movement and a known
# [backlash](../glossary.md#backlash), and found none. So logs of other joints can show a false alarm
# here, but no right answer.
#
# ## Method
#
# Each log is downloaded from its repository at a fixed commit and verified, or read from the folder
# `HARDWARE_LOGS`; no log is part of this project. Without them this notebook is not run, and its
# committed results stay.
#
# *The answers* are those of `backlash.estimate` by the torque, from what is known of each load.
#
# *A rigid load.* Without backlash and elasticity the torque [N m] of a joint at the angle $q$ [rad]
# would be
#
# $$\tau = m g r \sin(q - q_0) + J\, \ddot q + F\, \text{sign}(\dot q) + d\, \dot q
# + \ell\, |m g r \sin(q - q_0)|\, \text{sign}(\dot q) + c$$
#
# with gravity $m g r$, the inertia $J$, friction $F$, viscosity $d$, and the share $\ell$ of the
# carried torque that is lost in the gear. All are found by linear regression. A joint whose load is
# small beside what this equation leaves has no gravity that could move it through a gap: it could not
# be judged, whatever its backlash.
#
# *A second encoder.* Three axes have one at the load. Motor and load part by $\varepsilon$ [rad],
#
# $$\varepsilon = \delta\, \text{sign}(\tau) + h\, \text{sign}(\dot q)
# + c_1 \tau + c_2 \dot q + c_3 \ddot q + c_4 q + c_0$$
#
# where $h$ [rad] is what friction winds up. The regression's $\delta$ [rad] is an upper limit of the
# backlash, as far as the motor's torque changes its sign when that of the teeth does.

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
makes = ["Universal Robots", "printed", "KUKA", "T-Motor"]  # whose logs are read
known_gravity = 1.0  # factor on the gravity that the sensor is given

# %% jupyter={"source_hidden": true} tags=["hide-input"]
logs = hardware.list_logs()
workbook.check_parameters(
    globals(), makes=[tuple(logs["make"].unique())], known_gravity=(0.01, 100)
)

# %% [markdown]
# ## Result
#
# ### The answers
#
# *Predict:* what will most of these logs lack?

# %%
chosen = logs[logs["make"].isin(makes)].assign(
    gravity_per_s2=lambda table: known_gravity * table["gravity_per_s2"]
)
records = {name: hardware.load_log(row) for name, row in chosen.iterrows()}
answers = {
    name: hardware.answer(records[name], row) for name, row in chosen.iterrows()
}
chosen["verdict"] = [answer.verdict for answer in answers.values()]
chosen["reason"] = [answer.reason for answer in answers.values()]
chosen[["joint", "verdict", "reason"]]

# %% jupyter={"source_hidden": true} tags=["hide-input"]
commonest = chosen["reason"].value_counts().items()
reasons = "; ".join(f"{reason}: {count}" for reason, count in commonest)
workbook.say(f"The reasons: {reasons or 'none'}.")

# %% [markdown]
# Robots are logged while they work, and seldom while one joint turns round at constant speed under
# gravity. One of each reason, in full:

# %%
for name in chosen.groupby("reason").head(1).index:
    print(f"{name}: {answers[name].summary}\n")

# %% [markdown]
# ### What a rigid load leaves
#
# `left` is the SD of what the equation leaves, over gravity; `left_lossless` the same with
# $\ell = 0$. Near 1 and above there is hardly a gravity in the torque; only well below it can gravity be
# told from what else the torque does.

# %%
rigid = pd.DataFrame(
    {name: hardware.fit_rigid_load(log) for name, log in records.items()}
).T
rigid.round(3)

# %% [markdown]
# ### The second encoder
#
# The larger end of an interval by the sign of the torque is the limit. Where the torque does not
# change its sign there is no row, and a backlash would not be seen. *Predict:* how many axes have a
# limit?

# %%
axes = chosen[chosen["load_encoder"]].groupby("joint").groups
lost = {
    joint: hardware.lost_motion([records[name] for name in axes[joint]])
    for joint in axes
}
with_limit = "No joint of these logs has a second encoder."
if lost:
    table = pd.concat(lost, names=["joint", "by"])
    display(table.map("{:.2e}".format))
    limits = 1e3 * table["high_rad"].xs("sign of torque", level="by")
    with_limit = f"{len(limits)} of {len(lost)} axes have a limit"
    with_limit += f", at most {limits.max():.3f} mrad." if len(limits) else "."
workbook.say(with_limit)

# %% [markdown]
# ## Verdict
#
# No number of the paper is judged here.

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
refused = (chosen["verdict"] == "cannot tell").sum()
joints = chosen["joint"].nunique()
workbook.verdict(
    f"Of {len(chosen)} logs (joints: {joints}) the sensor answers "
    f"{len(chosen) - refused} and refuses {refused} ({reasons}). A refusal is no "
    "evidence for the sensor or against it: a positive test needs a joint of known "
    "play, loaded by gravity, that turns round twelve times at constant speed, "
    "with speed and torque logged at 500 Hz."
)

# %% [markdown]
# ## Try changing

# %% jupyter={"source_hidden": true} tags=["hide-input", "promises"]
workbook.try_changing(
    (
        'makes = ["printed"]',
        "the gears that turn round, without a load, or swing a small one slowly; "
        "they "
        "are refused, too",
        lambda now, was: (
            0 < len(now.chosen) < len(was.chosen) and now.refused == len(now.chosen)
        ),
    ),
    (
        "known_gravity = 10.0",
        "the sensor is given ten times the gravity; no refusal goes away, for "
        "none is for the size of gravity",
        lambda now, was: (
            now.refused == was.refused
            and now.known_gravity == 10 * was.known_gravity
        ),
    ),
    (
        'makes = ["KUKA"]',
        "the axes with a second encoder alone",
        lambda now, was: now.chosen["load_encoder"].all(),
    ),
)

# %% [markdown]
# ## Exercises
#
# Answer by the `name`; the cell below says *right* or *not yet*. Solutions are folded in the
# committed notebooks.

# %%
highest_percent = sure = half_play_mrad = np.nan  # your answers

# %% [markdown]
# **1.** No alarm on `joints` independent joints that were all answered: how large may the rate of
# false alarms still be (`highest_percent` [%], two-sided, 95 %, to 1)? What does it say of the
# joints above?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
highest_percent = 100 * (1 - 0.025 ** (1 / joints))
print(f"up to {highest_percent:.0f} %; of joints that were refused it says nothing")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(highest_percent, 100 * (1 - 0.025 ** (1 / joints)), to=1)

# %% [markdown]
# **2.** The loss $\ell$ of a log has the SD `loss_sd`. How many logs (`sure`, a whole number) have a
# loss that differs from 0 by more than 3 SDs, and why may it still not be a loss where it is
# negative?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
sure = int(((rigid["loss"] / rigid["loss_sd"]).abs() > 3).sum())
print(
    f"{sure}; a gear gains no torque: something else changes its sign with the "
    "speed"
)

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(sure, len(rigid.query("abs(loss) > 3 * loss_sd")))

# %% [markdown]
# **3.** A data sheet gives a lost motion of 0.15 degrees from side to side. How large is $\delta$ at
# most (`half_play_mrad` [mrad], to 0.01)?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
half_play_mrad = 1e3 * (0.15 * np.pi / 180) / 2
print(f"{half_play_mrad:.2f} mrad")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(half_play_mrad, 1.309, to=0.01)

# %% [markdown]
# **What you have learnt**: a sensor can only be tested on logs that it could judge.
