# %% [markdown]
# # 3 · The simulator against the published signals (figure 10)
#
# *You will see how far a simulated joint agrees with the published speed, and what friction,
# inertia and gear ratio change. Run time: 8 s. Before this: notebook [1](01_the_joint.ipynb).*
#
# ## Claim
#
# The simulator reproduces the behaviour of the joint with [backlash](glossary.md#backlash):
# position, speed and current of the bench and of the simulator, superimposed (section
# "Matlab/Simulink model of the robotic joint", figure 10).
#
# ## Method
#
# The simulated joint has notebook 9's equations of motion and drive, and equations 8 and 9 for the
# torque in the coupling. The bench's signals are not public. What can be compared is the motor
# speed $v$ [rps], with the records that the authors' own simulator made; position and torque (the
# current times a constant) are shown as our simulator has them. Per [level](glossary.md#level) K,
# two numbers say how well they agree, over the [settled](glossary.md#settled) turns, after the
# first turn of the duration $T_f = N / v_t$ [s] with the gear ratio $N$ and the commanded motor
# speed $v_t$ [rps]. The misfit is over the $n$ samples of 2 ms, in units of the record's SD $s_K$
# [rps]:
#
# $$\text{NRMSE} = \frac{1}{s_K} \sqrt{\frac{1}{n} \sum_{t_i \ge T_f}
# \left[v_\text{simulated}(t_i) - v_K(t_i)\right]^2}$$
#
# The settled peak, before sampling, is our reading of the [theoretical
# $A$](glossary.md#theoretical-a) [rps]:
#
# $$A = \max_{t \ge T_f} v(t) - v_t$$
#
# The limits for both are set under *Verdict*. The model's structure was chosen with these records
# and peaks in view (notebook 9), so this shows how well it fits, and is no independent validation.
# The verdicts on the printed $A$ therefore rest on the clean records alone where these are public:
# their settled turns, interpolated.
#
# Coulomb friction $\tau_c$ [N m] adds to gravity on the load, whose speed $\omega_l$ [rad/s] does
# not change its sign:
#
# $$J_l \dot\omega_l = \tau_l - m g r \sin\theta_l - \tau_c, \qquad \tau_c = \text{friction share} \cdot m g r$$

# %%
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy import signal

import workbook
from replication import figures, sources, table2
from replication.records import CLEAN_LEVELS, level_delta_rad
from replication.simulator.parameters import (
    changeable,
    changed_joint,
    identified_joint,
    joint_from_ratios,
)
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import settled_peak_rps, simulate_many

# %% [markdown]
# ## Parameters
#
# `changes` multiplies by factors. A *ratio* of notebook 9 (such as `stiffness_per_s2`,
# `inertia_ratio`, `speed_gain_per_s`) is changed with the other ratios kept: half the
# `inertia_ratio` doubles the motor's inertia *and* all gains. A *physical quantity* (such as
# `motor_inertia_kgm2`, `gear_ratio`, `load_mass_kg` or `speed_gain_nms_per_rad`) is changed alone;
# `load_mass_kg` changes gravity, and not `load_inertia_kgm2`.

# %% tags=["parameters"]
level = 8  # the authors' record K that is drawn
friction_share = 0.0  # Coulomb friction on the load as a share of m g r
changes = {}  # factors for ratios or physical quantities, such as {"motor_inertia_kgm2": 2.0}

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.check_parameters(
    level=(level, CLEAN_LEVELS),
    friction_share=(friction_share, workbook.Interval(0, 0.5)),
    changes=(changes, dict.fromkeys(changeable(identified_joint()), workbook.Interval(0, 100))),
)

# %% [markdown]
# ## Result
#
# ### Figure 10
#
# Two settled turns. A joint that turns otherwise than the authors' is not compared with their
# records.

# %%
committed = identified_joint()
joint = changed_joint(committed, changes)
friction_nm = friction_share * joint.gravity_torque_nm
joint = replace(joint, load_coulomb_nm=joint.load_coulomb_nm + friction_nm)
v_t, T_f = joint.commanded_speed_rps, joint.turn_period_s
compared = np.allclose([v_t, T_f], [committed.commanded_speed_rps, committed.turn_period_s])
clean = sources.load_clean_records(CLEAN_LEVELS)
records = clean if compared else {}

# %%
delta_rad = level_delta_rad(level)
(run,) = simulate_many(joint, [delta_rad], duration_s=12 * T_f, step_s=5e-5)
recorded = records[delta_rad].v if compared else np.nan * run.time_s
start_rad = joint.gear_ratio * joint.start_angle_rad
lag_rad = run.motor_position_rad - start_rad - joint.commanded_speed_rad_per_s * run.time_s
displacement = run.motor_position_rad / joint.gear_ratio - run.load_position_rad
error = run.motor_speed_rps - recorded

# %%
shown = (run.time_s >= 2 * T_f) & (run.time_s <= 4 * T_f)
signals = [
    ("position less\ncommanded [rad]", lag_rad[shown], None),
    ("motor speed\n[rps]", run.motor_speed_rps[shown], recorded[shown]),
    ("simulated $-$\nrecord [rps]", error[shown], None),
    ("motor torque\n[N m]", run.motor_torque_nm[shown], None),
    ("displacement\n[mrad]", 1e3 * displacement[shown], None),
]
figure10 = figures.simulated_joint(run.time_s[shown], signals)
for edge in (-1e3, 1e3):
    figure10.axes[-1].axhline(edge * delta_rad, **figures.DOTTED)
workbook.show_figure(
    "figure10_simulator",
    figure10,
    f"Two settled turns of our joint at level {level}, a backlash of {1e3 * delta_rad:g} mrad: (a) motor position "
    "less the commanded one, (b) motor speed over the record, (c) simulated less recorded speed, (d) motor torque, "
    "(e) motor position over N less the load's, with the gap's edges (dotted). Only the speed is published.",
)

# %% [markdown]
# What changed of the joint:

# %%
compare_joints = pd.DataFrame({"committed": vars(committed), "here": vars(joint)})
compare_joints[compare_joints["committed"] != compare_joints["here"]]

# %% [markdown]
# ### Level by level
#
# Misfit and settled peak at every level, and the change of the peak from that of the committed
# joint. The simulated speed has 40 samples in 2 ms; 200 samples of 2 ms are the first turn of a
# record. K = 2 has a printed $A$ alone. Predict first: where is the misfit larger, at the four
# levels that the fit of the ratios used, or at the others?

# %%
FINE_S = 5e-5  # 40 in 2 ms
levels = {level_delta_rad(k): k for k in range(2, CLEAN_LEVELS.stop)}


def finely(joint, deltas_rad=tuple(levels)):
    duration_s = 12 * joint.turn_period_s
    return simulate_many(joint, deltas_rad, duration_s=duration_s, sample_s=FINE_S, step_s=FINE_S)


def peaks_rps(joint, deltas_rad=tuple(levels)):
    runs = finely(joint, deltas_rad)
    return np.array([settled_peak_rps(run, joint) for run in runs])


# %%
def nrmse(run):
    if run.delta_rad not in records:
        return np.nan
    v = records[run.delta_rad].v[200:]
    return np.sqrt(np.mean((run.motor_speed_rps[::40][200:] - v) ** 2)) / v.std()


table = pd.DataFrame({"delta_rad": levels.keys(), "level": levels.values()})
table["used_in_fit"] = table["level"].isin([3, 6, 9, 12])  # notebook 9
table["nrmse"] = [nrmse(run) for run in finely(joint)]
table["peak_rps"] = peaks_rps(joint)
table["printed_A_rps"] = table["delta_rad"].map(table2.theoretical_amplitudes())
ratio = table["peak_rps"] / table["printed_A_rps"] if compared else np.nan
table["peak_error_percent"] = 100 * (ratio - 1)
peak_change_percent = 100 * (table["peak_rps"] / peaks_rps(committed) - 1)

# %%
workbook.show_figure(
    "figure10_validation",
    figures.validation(table),
    f"The simulated joint (a) against the {len(records)} published clean records and (b) against the "
    f"{table['printed_A_rps'].count()} printed amplitudes. Squares: levels that the fit of the ratios uses; circles: "
    "the others. The model's structure was chosen with all of these in view.",
)
table.assign(peak_change_percent=peak_change_percent.round(2))

# %% [markdown]
# ### The peaks without a simulator
#
# The settled turns of a record are periodic and have $n$ samples $v_j$ of $\Delta t$ = 2 ms.
# Between the samples we take their Fourier series, the band-limited interpolation:
#
# $$v(t) = \sum_{k=-n/2}^{n/2} c_k\, e^{2\pi i k t / (n \Delta t)}, \qquad
# c_k = \frac{1}{n} \sum_{j=0}^{n-1} v_j\, e^{-2\pi i k j / n}$$
#
# (the two coefficients at $k = \pm n/2$ are halved). Simulated signals, sampled at each of 40
# phases within 2 ms and rounded to 0.01 rps like the records, tell how well this finds the peak.


# %%
def interpolated_peak_rps(v):
    settled = v[200 : v.size // 200 * 200]
    return signal.resample(settled, 40 * settled.size).max() - committed.commanded_speed_rps


printed = pd.Series(table2.theoretical_amplitudes())
public = [delta for delta in printed.index if delta in clean]
true = peaks_rps(committed, public)

# %%
of_interpolation = 100 * np.array(
    [
        interpolated_peak_rps(run.motor_speed_rps[phase::40].round(2)) / peak - 1
        for run, peak in zip(finely(committed, public), true, strict=True)
        for phase in range(40)
    ]
)
pd.Series(of_interpolation, name="error of the interpolated peak [%]").describe().round(1)

# %% [markdown]
# The authors' clean records, at the levels of Table 2 that are public (K = 3 to 11; row 1 has
# none). We kept the tolerance of 2.5 % that our simulator's peaks had. When we did, it was known
# that the interpolated peaks agree within 2.3 %, so their agreement was no surprise.

# %%
traced = pd.DataFrame(
    {
        "level": [levels[delta] for delta in public],
        "largest_sample_rps": [clean[d].v[200:].max() - 100 for d in public],
        "interpolated_rps": [interpolated_peak_rps(clean[delta].v) for delta in public],
        "printed_A_rps": printed[public].to_numpy(),
    },
    index=pd.RangeIndex(2, 2 + len(public), name="row"),
)
traced["error_percent"] = 100 * (traced["interpolated_rps"] / traced["printed_A_rps"] - 1)
traced.round(4)

# %% [markdown]
# ### How late the positive impact comes
#
# The two impacts are half a turn apart only in the paper's [signature](glossary.md#signature).
# Gravity turns with the load, and the load lags by the gap: the positive impact is late, the more
# the wider the gap.

# %%
impacts = [run.impact_time_s[run.impact_time_s > 2 * T_f] for run in finely(joint)]
late_ms = [1e3 * np.abs(np.diff(times) - T_f / 2).mean() for times in impacts]
pd.Series(late_ms, 1e3 * table["delta_rad"], name="late [ms]").rename_axis("backlash [mrad]").round(
    2
)

# %% [markdown]
# ## Verdict
#
# The limits and their reasons. The first continuous drive that was fitted misses the records by 4.8
# % on average and 6.6 % at worst, and the printed peaks by up to 1.9 % (attempt 1 of notebook 9). A
# joint under a digital drive has more freedom and must not be worse: 5 and 6.5 % are the first two,
# rounded. 2.5 % for the peaks is the tolerance of the printed $A$. The limits only tell whether a
# change spoils the joint.

# %%
limits = pd.Series({"mean misfit": 5.0, "largest misfit": 6.5, "largest error of a peak": 2.5})
misfits_percent = 100 * table["nrmse"]
largest_error = table["peak_error_percent"].abs().max()
reached = pd.Series([misfits_percent.mean(), misfits_percent.max(), largest_error], limits.index)
pd.DataFrame({"reached [%]": reached, "limit [%]": limits}).round(2)

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
name = "The identified joint"
if changes or friction_share:
    name = (
        f"The changed joint, whose peaks differ from the committed one's by {peak_change_percent.min():+.1f} to "
        f"{peak_change_percent.max():+.1f} % (on average {peak_change_percent.mean():+.1f} %),"
    )
verdict = (
    f"{'meets' if (reached < limits).all() else 'does not meet'} the limits: it misses the records by "
    f"{reached.iloc[0]:.1f} % of their SD on average and {reached.iloc[1]:.1f} % at worst, and its peaks differ from "
    f"the printed ones by up to {reached.iloc[2]:.2g} %"
)
if not compared:
    verdict = f"turns in {T_f:g} s at {v_t:g} rps and is not compared with the records"
peaks = table.dropna(subset="printed_A_rps")["peak_rps"]
cells = {f"table2.row{row:02d}.theoretical": A for row, A in traced["interpolated_rps"].items()}
if compared:
    cells["table2.row01.theoretical"] = peaks.iloc[0]
workbook.verdict(
    f"{name} {verdict}. The peaks helped to choose "
    "the model's structure: an agreement is a fit, not a validation. Read from the authors' clean records without a "
    f"simulator, the peaks of {len(traced)} levels lie within {traced['error_percent'].abs().max():.1f} % of the "
    f"printed $A$. The smallest level has no public clean record: there our peak is compared. At level {level} the "
    f"simulated speed differs from the record by at most {np.abs(error[shown]).max():.2g} rps.",
    cells,
)

# %% jupyter={"source_hidden": true} tags=["hide-input"]
used = table["used_in_fit"]
printed_A = np.array([*table2.theoretical_amplitudes().values()])
workbook.export(
    supplement={"simulator_validation": (table, "Its errors at records and printed amplitudes.")},
    facts={
        "nrmse_records": table["nrmse"].count(),
        "nrmse_used": table.loc[used, "nrmse"].count(),
        "nrmse_mean": (reached.iloc[0], ".1f"),
        "nrmse_largest": (reached.iloc[1], ".1f"),
        "nrmse_left_out": (100 * table.loc[~used, "nrmse"].max(), ".1f"),
        "peak_error": (largest_error, ".1f"),
        "interpolated_error": (traced["error_percent"].abs().max(), ".1f"),
        "nearest_row": (100 * np.min(np.diff(printed_A) / printed_A[:-1]), ".0f"),
    },
    cells=cells,
)

# %% [markdown]
# ## Try changing
#
# 1. `changes = {"stiffness_per_s2": 1.05}`: 5 % more stiffness, a faster ring, and nearly six times
#    the misfit.
# 2. `changes = {"start_angle_rad": 0.5}`: the impacts come at another time; three quarters of the
#    signal are missed.
# 3. `level = 13`: the widest gap that is public; the speed still lies within the line's width.
#
# ## Exercises
#
# **1.** Double the motor's inertia in two ways: `{"inertia_ratio": 0.5}` and
# `{"motor_inertia_kgm2": 2.0}`. How do the peaks at $\delta$ = 15·10⁻⁴ rad change (to 1 %), and
# what else differs between the two joints?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
(A,) = peaks_rps(committed, [15e-4])
ways = [
    changed_joint(committed, way) for way in ({"inertia_ratio": 0.5}, {"motor_inertia_kgm2": 2.0})
]
all_doubled, alone = (peaks_rps(way, [15e-4])[0] / A for way in ways)
gains = [way.speed_gain_nms_per_rad / committed.speed_gain_nms_per_rad for way in ways]
assert all_doubled < 0.7 < 1 < alone
assert np.allclose(gains, [2, 1])
print(
    f"peaks {all_doubled:.2f} and {alone:.2f} times as high; K_p {gains[0]:.0f} and {gains[1]:.0f} times"
)

# %% [markdown]
# **2.** Move the joint's start by half a turn of the load, $\theta_0 + \pi$. What happens to the
# signs of the impacts, and how far is the settled speed from the old one half a turn later (at
# most, in rps)?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
moved = replace(committed, start_angle_rad=committed.start_angle_rad + np.pi)
before, after = (simulate_recordings(each, [15e-4])[0].v - 100 for each in (committed, moved))
apart_rps = np.abs(before[500:2000] - after[400:1900]).max()  # 100 samples are half a turn
assert apart_rps < 1e-3
print(f"each impact comes half a turn earlier, with the other sign; {apart_rps:.0e} rps apart")

# %% [markdown]
# **3.** A joint with all ratios as committed has the gear ratio 80 and is commanded to 200 rps. How
# does its load turn, and how high are its peaks (to 0.1 %)? What do the records tell of $N$?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
geared = joint_from_ratios(committed.ratios, gear_ratio=80.0, commanded_speed_rps=200.0)
assert geared.turn_period_s == committed.turn_period_s
twice = peaks_rps(geared, [15e-4])[0] / A
assert np.isclose(twice, 2, rtol=1e-6)
print(f"{twice:.4f} times as high: theta_m / N moves as before, the records tell N only as v_t T_f")

# %% [markdown]
# **What you have learnt**: a fitted simulator can be compared with records, and is not validated by
# those it was chosen with. *Next:* [records and noise](04_growth_figure11.ipynb).
