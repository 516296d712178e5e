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
#     quick: {}
# ---

# %% [markdown]
# # 4 · The simulator against the published signals (figure 10)
#
# ## Claim
#
# The simulator reproduces the behaviour of the joint with backlash: position, speed and current of the bench and of the
# simulator, one over the other (section "Matlab/Simulink model of the robotic joint", figure 10).
#
# ## Method
#
# The bench's signals are not public. What can be compared is the *speed*, with the records that the authors' own
# simulator made; position and torque (the current times a constant) are shown as our simulator has them. Bars for the
# settled turns: RMSE over the signal's SD below 6.5 % for each record and 5 % on average, and the peak before sampling
# within 2.5 % of each printed theoretical $A$. The model's structure was chosen with these records and peaks in view
# (notebook 3), so this shows how well it fits, and is no independent validation.

# %%
import numpy as np
import pandas as pd

from replication import datasets, workbook
from replication.figures import paper
from replication.simulator.identification import FINE_S
from replication.simulator.recordings import SIMULATION_STEP_S, simulate_recordings
from replication.simulator.simulate import identified_joint, simulate
from replication.simulator.study import CLEAN_LEVELS, changed_joint, clean_records, positive_impact_delay, validate

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
level = 8  # the authors' record K that is drawn
changes = {}  # ratios of the joint to multiply, such as {"stiffness_per_s2": 1.05}

# %% [markdown]
# ## Result

# %%
joint = changed_joint(identified_joint(), changes)
records = clean_records(CLEAN_LEVELS)
delta_rad = datasets.level_delta_rad(level)
run = simulate(joint, delta_rad, step_s=SIMULATION_STEP_S)
shown = (run.time_s >= 2 * joint.turn_period_s) & (run.time_s <= 4 * joint.turn_period_s)
motion = run.motor_position_rad - joint.commanded_speed_rad_per_s * run.time_s
signals = [
    ("motor position less\nconstant speed [rad]", motion[shown], None),
    ("motor speed [rps]", run.motor_speed_rps[shown], records[delta_rad].v[shown]),
    ("simulated -\nrecord [rps]", (run.motor_speed_rps - records[delta_rad].v)[shown], None),
    ("motor torque [N m]\n(current)", run.motor_torque_nm[shown], None),
    (
        "motor - load\n[1e-4 rad]",
        1e4 * (run.motor_position_rad / joint.gear_ratio - run.load_position_rad)[shown],
        None,
    ),
]
figure = paper.simulated_joint(run.time_s[shown], signals)
workbook.save_figure(
    figure,
    "figure10_simulator",
    caption="Position, speed and torque of our joint over two turns. Only the speed is published: record and "
    "simulation coincide; the third panel shows their difference.",
)

# %% [markdown]
# ### Level by level
#
# Worked example, one level: the misfit over the settled turns as a share of the SD, and the peak of the finely sampled
# speed above the commanded one, which is the theoretical $A$.

# %%
record = records[delta_rad]
settled = record.t >= joint.turn_period_s - 1e-9
fine = simulate(joint, delta_rad, sample_s=FINE_S, step_s=FINE_S)
error = (fine.motor_speed_rps[:: round(0.002 / FINE_S)] - record.v)[settled]
peak = fine.motor_speed_rps[fine.time_s >= joint.turn_period_s].max() - joint.commanded_speed_rps
pd.Series({"nrmse": np.sqrt(np.mean(error**2)) / record.v[settled].std(), "peak_rps": peak}).to_frame(f"K = {level}")

# %% [markdown]
# The same for every level.

# %%
table = validate(joint, records)
workbook.save_table(table, "simulator_validation")
table

# %%
figure = paper.validation(table)
workbook.save_figure(
    figure,
    "figure10_validation",
    caption="Simulation against every published clean record: the misfit is as small on the levels that the fit "
    "of the ratios does not use (open) as on those that it uses, and the peaks lie close to the printed amplitudes. "
    "The model's structure was chosen with all of these in view.",
)

# %% [markdown]
# ### How late the positive impact comes
#
# The two impacts are half a turn apart only in the paper's model of the signature. In the records the positive one is
# late, the more the wider the gap, because gravity turns with the load, and the load lags by the gap. The simulated
# joint shows it too.

# %%
lateness = pd.DataFrame(
    [
        {
            "delta_rad": delta,
            "record_ms": 1e3 * positive_impact_delay(records[delta]),
            "simulated_ms": 1e3 * positive_impact_delay(simulate_recordings(joint, [delta])[0]),
        }
        for delta in list(records)[::2]
    ]
)
workbook.save_table(lateness, "positive_impact_delay")
lateness

# %% [markdown]
# ## Verdict

# %%
printed_rows = table.dropna(subset="printed_A_rps")["peak_rps"].to_numpy()
cells = {f"table2.row{row:02d}.theoretical": peak for row, peak in enumerate(printed_rows, start=1)}
workbook.record_verdicts({"simulated": cells})

# %%
print(f"largest peak error {table['peak_error_percent'].abs().max():.2f} %; peaks helped to choose the structure")

# %% [markdown]
# ## Try changing
#
# 1. `changes = {"stiffness_per_s2": 1.05}`: 5 % more stiffness, a faster ring, and five times the misfit.
# 2. `changes = {"start_angle_rad": 0.5}`: the impacts come at another time; three quarters of the signal are missed.
# 3. `level = 13`: the widest gap that is public; the speed still lies within the line's width.
