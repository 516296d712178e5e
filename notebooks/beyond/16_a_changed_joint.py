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
#     quick: {changes: [0.2], deltas_rad: [0.0011]}
# ---

# %% [markdown]
# # 16 · What does a changed joint do to each method?
#
# ## Claim
#
# The paper calibrates equation 10 on one simulated joint, and disregards friction (section "Backlash signature and its
# mathematical model"). It leaves open what a joint that is not quite the calibrated one does to the answer.
#
# ## Method
#
# Noise-free records of a joint of which one thing has changed, measured by methods that do not know it: equation 10 as
# printed; the signature's amplitude, its energy and the settled waveform, calibrated on the joint as it was; and the
# joint simulated anew with start angle, friction and load unknown. The identified joint has no friction, so that
# friction grows from nothing to a share of the gravity torque.

# %%
import pandas as pd

from backlash.calibration import default_calibration
from backlash.fitting.joint_match import NUISANCES, match_joint
from backlash.studies import accuracy, plots
from backlash.studies.benchmark import JOINT_ALL_FREE, calibrated_answers
from replication import workbook
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import identified_joint

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
shown = "load Coulomb friction"  # the change in the worked example, one of `accuracy.CHANGES`
changes = [-0.2, 0.2]  # relative changes of the joint; the largest is that of the worked example
deltas_rad = [5e-4, 15e-4]  # backlashes of the changed joint
left_out = []  # parameters, of `accuracy.CHANGES`, that do not change

# %% [markdown]
# ## Result
#
# ### Worked example: one record of a changed joint

# %%
joint = identified_joint()
delta_rad = deltas_rad[-1]
changed_joint = accuracy.CHANGES[shown](joint, max(changes))
record = simulate_recordings(changed_joint, [delta_rad])[0]

calibrations = {name: default_calibration(name) for name in ("amplitude", "energy", "waveform")}
calibrations |= {"equation 10": default_calibration("paper")}
answers_rad = calibrated_answers(record, calibrations)
answers_rad[JOINT_ALL_FREE] = match_joint(record, joint, tuple(NUISANCES))["delta_rad"]
one = pd.DataFrame(answers_rad.items(), columns=["method", "backlash_rad"])
one["error_rad"] = one["backlash_rad"] - delta_rad
one

# %% [markdown]
# ### Every change, and what each method reads

# %%
changing = [name for name in accuracy.CHANGES if name not in left_out]
moved = accuracy.errors_after_changes(joint, deltas_rad, changes, changing)
ends = accuracy.mean_errors(moved)
workbook.save_table(ends, "robustness")
ends.pivot(index=["parameter", "change"], columns="method", values="mean_error_rad")

# %% [markdown]
# The methods in the order of their RMS error over all changes; `unchanged_rmse_rad` is that on the joint as it was.

# %%
ranked = accuracy.ranking(moved)
workbook.save_table(ranked, "robustness_ranking")
ranked

# %%
figure = plots.tornado(ends[ends["change"] != 0], ["equation 10", "amplitude", "energy", "waveform", JOINT_ALL_FREE])
workbook.save_figure(
    figure,
    "beyond_robustness",
    caption="Error of each method on a changed joint without recalibration: friction misleads every method but the "
    "full joint model.",
)

# %% [markdown]
# Friction moves the two impacts of a turn in opposite directions, so that the second no longer comes half a turn after
# the first. The signature has that built in ($T_d = T_f/2$), and so has any waveform of the joint without friction:
# all of them fail when friction is 20 % of the gravity torque. The joint model with friction unknown does not. All of
# this is on simulated logs of the identified joint, which that model describes exactly but for the change; on joints
# of another structure it is not known. A change of the drive's gains shifts it as it shifts the others.
#
# ## Verdict
#
# No number of the paper is judged here. The answer:

# %%
print(f"least error over all changes: {ranked['method'][0]}, RMS {ranked['rmse_rad'][0]:.1e} rad")
for row in ranked.itertuples():
    print(f"{row.method}: at most {row.max_abs_error_rad:.1e} rad, when the {row.worst_parameter} changes")

# %% [markdown]
# ## Try changing
#
# 1. `changes = [-0.05, 0.05]`: a joint that has changed little; every method's error shrinks.
# 2. `left_out = ["load Coulomb friction", "load viscous friction"]`: without friction all methods but the joint's match
#    err by a third less or more; that one gains nothing, and leads by little.
# 3. `deltas_rad = [3e-4]`: of a small backlash friction hides two thirds from the waveform; the joint's match still
#    reads it within 2 %.
