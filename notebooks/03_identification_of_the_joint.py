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
# # 3 · The joint, identified from the published signals
#
# *You will know the joint's equations of motion and its drive, and which of their parameters the motor speed tells.
# Run time: 12 s.*
#
# ## Claim
#
# "The parameters of the Simulink model were estimated by processing experimental data collected on a test-bench"
# (section "Matlab/Simulink model of the robotic joint"). Neither the model nor its parameters are public.
#
# ## Method
#
# The signals that the model made are public: eleven noise-free records. A joint with
# [backlash](glossary.md#backlash) and a digital drive is fitted to four of them.
#
# **The mechanics.** The motor (angle $\theta_m$ [rad], speed $\omega_m = \dot\theta_m$ [rad/s], inertia $J_m$
# [kg m²]) turns the load ($\theta_l$, $\omega_l$, $J_l$) through a gear of ratio $N$ and an elastic coupling, which
# transmits the torque $\tau_l$ [N m]. Gravity pulls at a mass $m$ [kg] on an arm $r$ [m], $g$ = 9.81 m/s²;
# $\theta_l = 0$ hangs straight down. $\tau_m$ [N m] is the motor's torque.
#
# $$J_m \dot\omega_m = \tau_m - \frac{\tau_l}{N}$$
#
# $$J_l \dot\omega_l = \tau_l - m g r \sin\theta_l$$
#
# $$\tau_l = \left[\Delta\theta - \delta \cdot \text{sign}(\Delta\theta) + \frac{D_s}{K_s}\Delta\omega\right]
# \cdot K_{BL}(\Delta\theta, \delta), \qquad \Delta\theta = \frac{\theta_m}{N} - \theta_l,
# \quad \Delta\omega = \frac{\omega_m}{N} - \omega_l \tag{9}$$
#
# $K_{BL}$ [N m/rad] is equation 8's stiffness (notebook 2), $K_s$ outside the gap of $2\delta$ [rad]. The damping
# $D_s$ [N m s/rad] and all friction are zero here: the records do not need them.
#
# **The drive.** Every control period $T_c$ = 0.5 ms, at $t_k = k T_c$, it reads the motor's angle and speed and
# compares them with those commanded, $N\theta_0 + \Omega t_k$ and $\Omega = 2\pi v_t$, $v_t$ = 100 rps. $\theta_0$ is
# the load's angle at $t = 0$. The position gain $K_\text{pos}$ and the speed gain $K_p$ act on the error $e_k$ [rad/s],
# the integral $I_k$ adds it up, a derivative $K_d$ damps, and a leaky integrator $w_k$ [rad] forgets at the rate $a_w$:
#
# $$e_k = K_\text{pos}\left[N\theta_0 + \Omega t_k - \theta_m(t_k)\right] + \Omega - \omega_m(t_k)$$
#
# $$I_k = I_{k-1} + K_i T_c e_k, \qquad w_k = w_{k-1} + T_c\left[\Omega - \omega_m(t_k) - a_w w_{k-1}\right]$$
#
# $$u_k = K_p e_k + I_k + K_w w_k - K_d \frac{\omega_m(t_k) - \omega_m(t_{k-1})}{T_c}$$
#
# The torque is applied one period late and held for a period, and the current loop follows it with the lag $T_\tau$
# [s]:
#
# $$T_\tau \dot\tau_m = u_{k-1} - \tau_m \quad\text{for}\quad t_k \le t < t_{k+1}$$
#
# **What can be identified.** Multiplying both inertias, $K_s$, the mass and the gains by one factor multiplies every
# torque and changes no motion. So the motor speed tells only these ratios:
#
# | ratio | symbol | unit |
# |---|---|---|
# | `stiffness_per_s2` | $K_s / J_l$ | 1/s² |
# | `gravity_per_s2` | $m g r / J_l$, which is $g / r$ for a point mass | 1/s² |
# | `inertia_ratio` | $J_l / (N^2 J_m)$ | 1 |
# | `speed_gain_per_s` | $K_p / J_m$ | 1/s |
# | `integral_gain_per_s2` | $K_i / J_m$ | 1/s² |
# | `derivative_gain` | $K_d / J_m$ | 1 |
# | `leaky_gain_per_s2` | $K_w / J_m$ | 1/s² |
# | `position_gain_per_s` | $K_\text{pos}$ | 1/s |
# | `leaky_rate_per_s` | $a_w$ | 1/s |
# | `torque_lag_s` | $T_\tau$ | s |
# | `start_angle_rad` | $\theta_0$ | rad |
# | `lead_s` | time from the joint's start to the record's | s |
#
# The 5 kg of the load, as a point mass, set the scale. $N$ is 100 motor turns per 2.5 load turns a second, 40.
#
# **The cost.** The eleven ratios $p$ above `lead_s` minimise the squared error of the speed $v$ [rps] over the third
# [turn](glossary.md#turn) of four records, [levels](glossary.md#level) K = 3, 6, 9, 12, each in units of its SD $s_K$
# [rps] over the [settled](glossary.md#settled) turns. Only the backlash differs between the records.
#
# $$C(p) = \frac{1}{2} \sum_{K} \sum_{i \in \text{turn 3}}
# \left[\frac{v_\text{simulated}(t_i; p, \delta_K) - v_K(t_i)}{s_K}\right]^2$$
#
# With the Jacobian $J$ of the $n$ residuals, $\hat p_j \pm t_{0.975}\,\sigma \sqrt{[(J^\top J)^{-1}]_{jj}}$ with
# $\sigma^2 = 2C / (n - 11)$ are the 95 % intervals.
#
# The fit uses neither the other seven records nor the printed [theoretical $A$](glossary.md#theoretical-a). The
# *structure* of the model was chosen with all of them in view, among the models listed below, so none of them
# validates it independently. `make studies NAME=identify-joint` fits from rougher values and writes the set to
# `replication/data/joint.json`; all else uses it without the authors' data.

# %%
from dataclasses import replace

import numpy as np
import pandas as pd

import workbook
from replication import published
from replication.authors import CLEAN_LEVELS, level_delta_rad, load_clean_records
from replication.figures import paper
from replication.simulator import checks, identification
from replication.simulator.parameters import identified_joint, with_ratios
from replication.simulator.recordings import simulate_recordings
from replication.simulator.reidentify import FIT_LEVELS
from workbook import Interval

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
start_factor = 1.3  # the fit starts at the committed ratios, those of `started` multiplied by this, 0.75 to 1.6
started = ["stiffness_per_s2", "inertia_ratio", "speed_gain_per_s"]
alphas = [1e4, 1e5, 1e6, 1e7]  # sharpness of the edge, 1/rad
profiled = ""  # a ratio to profile, such as "leaky_rate_per_s"; takes a minute

# %% tags=["plumbing"]
fitted_ratios = tuple(name for name in identified_joint().ratios if name not in identification.HELD)
workbook.check_parameters(
    start_factor=(start_factor, Interval(0.75, 1.6)),
    started=(started, [fitted_ratios]),
    alphas=(alphas, [Interval(1e3, 1e12)]),
    profiled=(profiled, ("", *fitted_ratios)),
)

# %% [markdown]
# ## Result
#
# ### The ratios, fitted from a start away from the committed set
#
# The ratios in `started` start away from the committed values, the others at them. Much farther away, such as from 0.7
# times the default three, the fit ends in another minimum of the cost.
#
# The misfit is the NRMSE: the root mean square of the error over the record's SD, here on the third turn of 200
# samples. Its mean square over the four records is $2C / n$, $n$ = 800.

# %%
committed = identified_joint()
records = load_clean_records(CLEAN_LEVELS)
of_fit = {delta: records[delta] for delta in map(level_delta_rad, FIT_LEVELS)}
third_turn, settled = slice(400, 600), slice(200, None)


def nrmse(joint, records, rows):  # one number for each record
    errors = [
        s.v - r.v
        for s, r in zip(simulate_recordings(joint, list(records)), records.values(), strict=True)
    ]
    sds = [record.v[settled].std() for record in records.values()]
    return np.array(
        [np.sqrt(np.mean(error[rows] ** 2)) / sd for error, sd in zip(errors, sds, strict=True)]
    )


start = with_ratios(committed, {name: start_factor * committed.ratios[name] for name in started})
misfit = pd.DataFrame(
    {"start": nrmse(start, of_fit, third_turn)}, index=[f"K = {level}" for level in FIT_LEVELS]
)
fit = identification.identify_joint(of_fit, start)
misfit["fitted"] = nrmse(fit.parameters, of_fit, third_turn)
misfit["committed"] = nrmse(committed, of_fit, third_turn)
(100 * misfit).add_suffix(": NRMSE [%]").round(3)

# %% [markdown]
# `off_in_widths` is the distance of the fitted ratio from the committed one, over its interval's width.

# %%
ratios = pd.DataFrame(
    [
        {
            "ratio": name,
            "committed": committed.ratios[name],
            "fitted": value,
            "low_95": low,
            "high_95": high,
        }
        for name, value in fit.parameters.ratios.items()
        for low, high in [fit.confidence.get(name, (np.nan, np.nan))]
    ]
)
ratios["started"] = list(start.ratios.values())
ratios["off_in_widths"] = (ratios["fitted"] - ratios["committed"]).abs() / (
    ratios["high_95"] - ratios["low_95"]
)
shown = ["started", "committed", "fitted", "low_95", "high_95", "off_in_widths"]
ratios.set_index("ratio")[shown].map("{:.6g}".format).replace("nan", "held")

# %% [markdown]
# The intervals are those of the linearised least squares. They take the residual for white noise of one SD; most of it
# is the records' rounding, which is finer below 100 rps (exercise 3): read them as approximate. `lead_s` shows in the
# first turn only and is identified there.
#
# Some ratios are known only together: four of the drive's form one shallow valley. The pairs with a correlation
# beyond 0.9:

# %%
correlation = fit.correlation.stack().rename("correlation").reset_index()
correlation = correlation[correlation["level_0"] < correlation["level_1"]]
together = correlation[correlation["correlation"].abs() > 0.9].sort_values(
    "correlation", key=abs, ascending=False
)
together.rename(columns={"level_0": "ratio", "level_1": "known together with"}).set_index("ratio")

# %%
if profiled:
    display(identification.profile_ratio(profiled, (0.9, 1.0, 1.1), of_fit, fit.parameters))

# %% [markdown]
# ### Physical values, for a load of 5 kg

# %%
physical = pd.Series(
    {
        "motor inertia J_m [kg m²]": committed.motor_inertia_kgm2,
        "load inertia J_l [kg m²]": committed.load_inertia_kgm2,
        "arm r [m]": committed.gravity_arm_m,
        "stiffness K_s [N m/rad]": committed.stiffness_nm_per_rad,
        "position gain K_pos [1/s]": committed.position_gain_per_s,
        "speed gain K_p [N m s/rad]": committed.speed_gain_nms_per_rad,
        "integral gain K_i [N m/rad]": committed.integral_gain_nm_per_rad,
        "derivative gain K_d [N m s²/rad]": committed.derivative_gain_nms2_per_rad,
        "leaky gain K_w [N m/rad]": committed.leaky_gain_nm_per_rad,
        "leaky rate a_w [1/s]": committed.leaky_rate_per_s,
        "torque lag T_tau [s]": committed.torque_lag_s,
        "start angle θ_0 [rad]": committed.start_angle_rad,
    },
    name="value",
)
physical.map("{:.4g}".format).to_frame()

# %% [markdown]
# ### The sharpness of the edge
#
# The misfit to the settled turns, the mean over all eleven records, as $\alpha$ of equation 8 changes and the ratios
# are kept; the clamped dead zone is an infinite $\alpha$. From 10⁶ per rad on little changes.

# %%
edges = {value: replace(committed, alpha_per_rad=value) for value in alphas}
edges[np.inf] = replace(committed, clamped=True)
alpha = pd.DataFrame(
    [(value, 100 * nrmse(joint, records, settled).mean()) for value, joint in edges.items()],
    columns=["alpha_per_rad", "mean_nrmse_percent"],
)
alpha.map("{:.4g}".format)

# %% [markdown]
# ### What helped, and what did not
#
# The log of the models that were fitted on the way. The structure was chosen by two figures together: the waveform
# (NRMSE over all records) and the peaks before sampling, our reading of $A$ (against the printed one). A continuous
# drive reproduces the peaks within 2 % and the waveform within 5 %; a drive sampled at 2 ms has a better waveform, and
# peaks that depend on its clock. About 1 ms of delay in the loop *and* a derivative reduce the misfit in the first 10
# ms after an impact; a leaky integrator, which adds freedom at the once-a-turn frequency, lowers both figures. It
# describes the authors'
# loop; what it was in their model is not known. Friction, filters and damping add nothing.

# %%
attempts = pd.read_csv(published.DATA / "simulator_attempts.csv", index_col="attempt")
attempts[attempts["kept"] != "no"]

# %% [markdown]
# The eight with the lowest misfit to the worst record:

# %%
attempts.nsmallest(8, "max_nrmse_percent")

# %% [markdown]
# ### The residual
#
# The largest level, which the fit of the ratios does not use.

# %%
record = records[level_delta_rad(13)]
simulated = simulate_recordings(committed, [level_delta_rad(13)])[0]
labels = ("authors' record 13", "simulated joint")
residual = paper.record_with_fit(record.t, record.v, simulated.v, labels, seconds=1.6)

# %% [markdown]
# ## Verdict
#
# The paper prints no parameter of its model, so no cell is judged here.

# %%
farthest = ratios.loc[ratios["off_in_widths"].idxmax()]
off_percent = 100 * farthest["off_in_widths"]
came_back = "comes back to" if off_percent < 50 else "does not come back to"
print(
    f"Started with {', '.join(started) or 'no ratio'} at {start_factor:g} times the committed value, the fit "
    f"{came_back} the committed set after {fit.evaluations} simulations of the records: the farthest ratio, "
    f"{farthest['ratio']}, is off by {off_percent:.2g} % of its interval's width. "
    f"It misses the fitted turns by {100 * np.sqrt(fit.mean_square):.2f} % of their SD."
)

# %% tags=["plumbing"]
workbook.export(
    tables={"joint_ratios": ratios},
    supplement={
        "joint_alpha": (
            alpha,
            "Misfit of the identified joint to all clean records, by sharpness of the edge.",
        )
    },
    facts={"models_tried": len(attempts)},
    figures={
        "joint_residual": (
            residual,
            "(a) The first four of twelve turns of the authors' record 13, which the fit of the ratios does not use, "
            "and of the identified joint. (b) The residual: after the first turn its RMS is "
            f"{np.sqrt(np.mean((record.v - simulated.v)[settled] ** 2)):.2g} rps. The record is rounded to 0.01 rps "
            "from 100 rps on, to 0.001 rps below.",
        )
    },
)

# %% [markdown]
# ## Try changing
#
# 1. `alphas = [1e3]`: so soft an edge that the gap leaks a third of the stiffness; the misfit exceeds the signal.
# 2. `profiled = "leaky_rate_per_s"`: 10 % away from its best, with the others fitted anew, the misfit hardly rises.
# 3. `alphas = [1e9]`: the misfit of the clamped dead zone, to three digits.
#
# ## Exercises
#
# **1.** Multiply both inertias, $K_s$, the mass and all four gains that are a torque by 3. By how much do the motor's
# speed and its torque change?

# %% tags=["solution"]
scaled = [
    *(
        "motor_inertia_kgm2",
        "load_inertia_kgm2",
        "stiffness_nm_per_rad",
        "load_mass_kg",
        "speed_gain_nms_per_rad",
    ),
    *("integral_gain_nm_per_rad", "derivative_gain_nms2_per_rad", "leaky_gain_nm_per_rad"),
]
heavy = replace(committed, **{name: 3 * getattr(committed, name) for name in scaled})
three_times = simulate_recordings(heavy, [25e-4])[0].v - simulated.v
assert np.abs(three_times).max() < 1e-6
print(f"the speed by at most {np.abs(three_times).max():.0e} rps; every torque is tripled")

# %% [markdown]
# **2.** The disturbance rings near 21 Hz. Compare two models: the two inertias on the spring $K_s$ without a drive, and
# the linear closed loop with the teeth in contact, whose matrix over one period $T_c$ is
# `checks.closed_loop_matrix(committed)`, with the eigenvalues $e^{s T_c}$. Which rings near 21 Hz, and how fast does
# it decay?

# %% tags=["solution"]
without_drive_hz = np.sqrt(
    committed.ratios["stiffness_per_s2"] * (1 + committed.ratios["inertia_ratio"])
) / (2 * np.pi)
eigenvalues = np.linalg.eigvals(checks.closed_loop_matrix(committed)).astype(complex)
modes = np.log(eigenvalues[np.abs(eigenvalues) > 1e-3]) / committed.control_period_s
ring = min(modes[modes.imag > 0], key=abs)
ring_hz = ring.imag / (2 * np.pi)
assert 20 < ring_hz < 22 < without_drive_hz
print(
    f"free joint {without_drive_hz:.1f} Hz; with the drive {ring_hz:.1f} Hz, decaying at {-ring.real:.1f}/s"
)

# %% [markdown]
# **3.** The records hold five significant digits: steps of 0.01 rps from 100 rps on, of 0.001 rps below. Rounding to
# steps $q$ leaves an error of the SD $q / \sqrt{12}$. How much of the committed joint's residual is rounding?

# %% tags=["solution"]
runs = simulate_recordings(committed, list(of_fit))
error = np.concatenate(
    [(s.v - r.v)[third_turn] for s, r in zip(runs, of_fit.values(), strict=True)]
)
fast = np.concatenate([r.v[third_turn] for r in of_fit.values()]) >= 100
for name, rows, step in (("from 100 rps on", fast, 0.01), ("below", ~fast, 0.001)):
    print(f"{name}: residual {error[rows].std():.2g} rps, rounding {step / np.sqrt(12):.2g} rps")
rounding_share = np.sum(np.where(fast, 0.01, 0.001) ** 2) / 12 / np.sum(error**2)
assert rounding_share > 0.8
print(f"{100 * rounding_share:.0f} % of the residual's sum of squares")
