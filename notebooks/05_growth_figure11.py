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
# # 5 · The data sets, and how the disturbance grows (figures 5 and 11)
#
# *You will see how the disturbance of the motor speed grows with the backlash, and why a little slower than in
# proportion. Run time: 5 s.*
#
# ## Claim
#
# Ten data sets are simulated at 100 rps with a load of 5 kg, [backlash](glossary.md#backlash) 3·10⁻⁴ to 21·10⁻⁴ rad in
# steps of 2·10⁻⁴; the amplitude of the disturbance grows regularly with the backlash (sections "Dataset creation" and
# "Backlash signature behaviour").
#
# ## Method
#
# The identified joint (notebook 3) is simulated at the same ten [levels](glossary.md#level), and on to the 39·10⁻⁴ rad
# of the authors' own files. The disturbance $r$ [rps] is the motor speed $v$ less the commanded one $v_t$:
#
# $$r(t) = v(t) - v_t \tag{11}$$
#
# The [theoretical $A$](glossary.md#theoretical-a) is its largest value in the [settled](glossary.md#settled) turns,
# *before* the speed is sampled at 2 ms: the samples miss up to some percent of it. The load turns once in
# $T_f = N / v_t$ [s] with the gear ratio $N$.
#
# **Why the growth slows down.** The teeth separate where gravity on the load changes its sign. If the motor kept its
# speed, gravity alone would then turn the load (angle $\theta_l$ [rad], speed $\omega_l = 2\pi / T_f$ [rad/s], mass $m$
# [kg] on an arm $r_m$ [m], inertia $J_l = m r_m^2$ [kg m²], gravity $g$ [m/s²]) against it, with an acceleration that
# grows from zero as $\frac{g}{r_m} \sin(\omega_l t) \approx \frac{g}{r_m} \omega_l t$. The gap of $2\delta$ [rad] is
# crossed after
#
# $$2\delta = \frac{1}{6} \frac{g}{r_m} \omega_l t_\text{gap}^3 \quad\Rightarrow\quad
# t_\text{gap} = \left(\frac{12\,\delta\, r_m}{g\, \omega_l}\right)^{1/3}$$
#
# and the teeth meet with the relative speed
#
# $$\Delta\omega = \frac{1}{2} \frac{g}{r_m} \omega_l t_\text{gap}^2 \;\propto\; \delta^{2/3}\, \omega_l^{1/3}.$$
#
# An impact that is twice as fast makes a ring twice as high.

# %%
from dataclasses import replace

import numpy as np
import pandas as pd

import workbook
from replication import table2
from replication.authors import ALL_LEVELS, level_delta_rad
from replication.figures import paper
from replication.recording import COMMANDED_SPEED_RPS, TURN_PERIOD_S, add_uniform_noise
from replication.simulator.identification import FINE_S
from replication.simulator.parameters import changeable, changed_joint, identified_joint
from replication.simulator.recordings import SIMULATION_STEP_S, simulate_recordings
from replication.simulator.simulate import settled_peak_rps, simulate
from workbook import Interval

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
speed_level = 12  # level K of the speed signal in figure 5
noise_rps = 0.0  # half-amplitude of uniform noise added in figure 5
noise_seed = 1
# Of the motor; the load turns once in 40 of its turns, 0.4 s at 100 rps.
commanded_speed_rps = 100.0
changes = {}  # factors for the joint's ratios or physical quantities, as in notebook 4

# %% tags=["plumbing"]
workbook.check_parameters(
    speed_level=(speed_level, ALL_LEVELS),
    noise_rps=(noise_rps, Interval(0, 10)),
    noise_seed=(noise_seed, Interval(0, whole=True)),
    commanded_speed_rps=(commanded_speed_rps, Interval(10, 300)),
    changes=(changes, [changeable(identified_joint())]),
)
workbook.check_parameters(factors=(list(changes.values()), [Interval(0, 100)]))

# %% [markdown]
# ## Result
#
# ### Figure 5
#
# The paper's signal comes from a robot or bench and is not public; this is the simulated joint's.

# %%
joint = changed_joint(replace(identified_joint(), commanded_speed_rps=commanded_speed_rps), changes)
v_t, T_f = joint.commanded_speed_rps, joint.turn_period_s
speed = simulate_recordings(joint, [level_delta_rad(speed_level)])[0]
speed = add_uniform_noise(speed, noise_rps, np.random.default_rng(noise_seed))
shown = speed.t <= 4 * T_f
figure5 = paper.speed_signal(speed.t[shown], speed.v[shown], T_f)

# %% [markdown]
# With `make lab` the speed has a slider for $\delta$. The axes stay, so that the growth shows.

# %%
(widest,) = simulate_recordings(joint, [4e-3])
highest = 1.1 * np.abs(widest.v - v_t).max()


def draw(delta_mrad):
    (record,) = simulate_recordings(joint, [1e-3 * delta_mrad])
    settled, first = record.t >= T_f, record.t <= 4 * T_f
    (axis,) = paper.speed_signal(record.t[first], record.v[first], T_f).axes
    axis.set(ylim=(v_t - highest, v_t + highest))
    axis.set_title(
        f"largest settled sample {(record.v[settled] - v_t).max():.3f} rps above {v_t:g} rps"
    )


workbook.sliders(draw, delta_mrad=(1e3 * level_delta_rad(speed_level), 0.1, 4.0))

# %% [markdown]
# ### Figure 11
#
# The third turn of each level, and the settled peak before and after sampling: 40 fine samples are 2 ms.

# %%
ten = [level_delta_rad(level) for level in table2.table2_levels()]
every = [level_delta_rad(level) for level in ALL_LEVELS]


def settled_peaks(joint):
    runs = simulate_recordings(joint, every, sample_s=FINE_S)
    settled, r = (
        runs[0].t >= joint.turn_period_s,
        np.array([run.v - run.commanded_speed_rps for run in runs]),
    )
    before, after = r[:, settled].max(axis=1), r[:, ::40][:, settled[::40]].max(axis=1)
    return runs, pd.DataFrame({"delta_rad": every, "amplitude_rps": before, "sampled_rps": after})


fine, peaks = settled_peaks(joint)
third = (fine[0].t >= 2 * T_f - 1e-9) & (fine[0].t < 3 * T_f - 1e-9)
signals = pd.concat(
    [
        pd.DataFrame(
            {
                "delta_rad": delta,
                "time_s": run.t[third] - 2 * T_f,
                "disturbance_rps": run.v[third] - v_t,
            }
        )
        for delta, run in zip(ten, fine, strict=False)
    ],
    ignore_index=True,
)
published_motion = np.isclose([v_t, T_f], [COMMANDED_SPEED_RPS, TURN_PERIOD_S]).all()
figure11 = paper.growth(signals, peaks, table2.theoretical_amplitudes() if published_motion else {})

# %% [markdown]
# The amplitudes, the share of the peak that the samples miss, and the exponent $p$ of $A \propto \delta^p$ from each
# level to the next.

# %%
logs = np.log(peaks[["delta_rad", "amplitude_rps"]]).diff()
peaks.assign(
    missed_percent=100 * (1 - peaks["sampled_rps"] / peaks["amplitude_rps"]),
    exponent=logs["amplitude_rps"] / logs["delta_rad"],
).round(5)

# %% [markdown]
# ## Verdict
#
# That the disturbance grows regularly is decided on the authors' own records, in notebook 18. Ours, over all levels:

# %%
same = joint == identified_joint()
as_committed = (
    peaks["amplitude_rps"] if same else settled_peaks(identified_joint())[1]["amplitude_rps"]
)
step = peaks["amplitude_rps"].diff()
p = np.polyfit(np.log(peaks["delta_rad"]), np.log(peaks["amplitude_rps"]), 1)[0]
against = 100 * (peaks["amplitude_rps"] / as_committed - 1)
grows = (
    "grows from every level to the next"
    if step.min() > 0
    else "does not grow from every level to the next"
)
print(
    f"At {v_t:g} rps (a load turn of {T_f:g} s) the amplitude {grows}, by {step.min():.3f} to {step.max():.3f} rps, "
    f"about as the backlash to the power {p:.2f}; the impact's speed would grow with the power 0.67. "
    f"Samples of 2 ms miss up to {100 * (1 - peaks['sampled_rps'] / peaks['amplitude_rps']).max():.1f} % of it."
)
print(
    "The joint is the identified one."
    if same
    else f"Against the identified joint at {COMMANDED_SPEED_RPS:g} rps the amplitudes change by "
    f"{against.min():+.1f} to {against.max():+.1f} %, on average {against.mean():+.1f} %."
)

# %% tags=["plumbing"]
with_noise = (
    f"with uniform noise of half-amplitude {noise_rps:g} rps" if noise_rps else "without noise"
)
off = (
    100
    * (
        peaks.set_index("delta_rad")["amplitude_rps"] / pd.Series(table2.theoretical_amplitudes())
        - 1
    ).abs()
)
beside = (
    f"lie within {off.max():.2g} % of the {off.count()} printed ones"
    if same
    else "are those of a changed joint"
)
workbook.export(
    supplement={"growth": (peaks, "The largest excursion of the speed at each backlash.")},
    figures={
        "figure05_speed_signal": (
            figure5,
            f"Motor speed of the simulated joint over four turns (dotted lines) {with_noise}, at a backlash of "
            f"{1e4 * level_delta_rad(speed_level):g}·10⁻⁴ rad. Two impacts a turn, opposite in sign, make the "
            f"speed ring about the commanded {v_t:g} rps. The signal of the paper's figure 5 is not public.",
        ),
        "figure11_growth": (
            figure11,
            f"(a) One settled turn at each of {len(ten)} backlashes: the larger the backlash, the later the ring "
            f"starts and the larger it is. (b) The settled peaks at {len(every)} backlashes; the paper's end at "
            f"{1e4 * max(ten):g}·10⁻⁴ rad, those of the authors' files at {1e4 * max(every):g}·10⁻⁴. Our peaks before "
            f"sampling, as we read A, {beside}; those of 2 ms samples are up to "
            f"{100 * (1 - peaks['sampled_rps'] / peaks['amplitude_rps']).max():.1f} % smaller.",
        ),
    },
)

# %% [markdown]
# ## Try changing
#
# 1. `noise_rps = 0.18`: the noise of Table 2's row 10, over figure 5's signal.
# 2. `changes = {"gravity_per_s2": 1.2}`: a heavier load closes the gap harder; every amplitude grows.
# 3. `speed_level = 2`: the smallest of the ten gaps; the oscillation is a quarter as high.
#
# ## Exercises
#
# **1.** The teeth separate with a relative speed already, because the spring $K_s$ [N m/rad] unwinds:
# $\dot{\Delta\theta}_0 = \frac{g}{r_m} \omega_l J_l / K_s$. Solve
# $2\delta = \dot{\Delta\theta}_0 t + \frac{1}{6} \frac{g}{r_m} \omega_l t^3$ for 3·10⁻⁴, 10·10⁻⁴ and 20·10⁻⁴ rad, and
# compare it and $t_\text{gap}$ with the time from a separation to the next impact in the simulation.

# %% tags=["solution"]
plain = identified_joint()
jerk = plain.ratios["gravity_per_s2"] * 2 * np.pi / plain.turn_period_s
for delta in (3e-4, 10e-4, 20e-4):
    run = simulate(plain, delta, step_s=SIMULATION_STEP_S)
    impact_s = run.impact_time_s[run.impact_time_s > plain.turn_period_s][0]
    simulated_s = impact_s - run.separation_time_s[run.separation_time_s < impact_s][-1]
    roots = np.roots([jerk / 6, 0, jerk / plain.ratios["stiffness_per_s2"], -2 * delta])
    solved_s, t_gap = roots[np.abs(roots.imag) < 1e-9].real[0], (12 * delta / jerk) ** (1 / 3)
    print(
        f"{delta:g} rad: simulated {1e3 * simulated_s:.1f}, solved {1e3 * solved_s:.1f}, t_gap {1e3 * t_gap:.1f} ms"
    )
    assert abs(solved_s - simulated_s) < abs(
        t_gap - simulated_s
    )  # the rest: the motor does not keep its speed

# %% [markdown]
# **2.** Is $A$ in proportion to the relative speed $\omega_m / N - \omega_l$ at the impact? Take it from simulations at
# 50 and 100 rps, with 3·10⁻⁴, 10·10⁻⁴ and 20·10⁻⁴ rad.

# %% tags=["solution"]
ratio = {}
for rps in (50.0, 100.0):
    slow = replace(plain, commanded_speed_rps=rps)
    for delta in (3e-4, 10e-4, 20e-4):
        run = simulate(
            slow, delta, duration_s=4 * slow.turn_period_s, sample_s=FINE_S, step_s=FINE_S
        )
        relative = run.motor_speed_rad_per_s / slow.gear_ratio - run.load_speed_rad_per_s
        settled = run.impact_time_s > 2 * slow.turn_period_s
        impact_rad_per_s = np.abs(np.interp(run.impact_time_s[settled], run.time_s, relative)).max()
        ratio[rps, delta] = settled_peak_rps(run, slow) / impact_rad_per_s
print(f"A is {min(ratio.values()):.2f} to {max(ratio.values()):.2f} rps per rad/s")
assert max(ratio.values()) < 1.1 * min(ratio.values())

# %% [markdown]
# **3.** The faster the joint turns, the more is left of a ring when the next impact comes. The ring decays as
# $e^{-15 t}$ with $t$ in s. How much is left half a turn later at 100 and at 50 rps, and at which commanded speed is a
# tenth left?

# %% tags=["solution"]
left = {rps: np.exp(-15 * plain.gear_ratio / rps / 2) for rps in (100, 50)}
tenth_rps = 15 * plain.gear_ratio / 2 / np.log(10)
assert np.isclose(np.exp(-15 * plain.gear_ratio / tenth_rps / 2), 0.1)
assert left[50] < left[100] < 0.1
print(
    f"{100 * left[100]:.0f} % at 100 rps, {100 * left[50]:.2g} % at 50 rps; a tenth at {tenth_rps:.0f} rps"
)
