# %% [markdown]
# # 0 · Start here: the sensor
#
# *You will see what backlash is, how it shows in the motor speed, and how to estimate it from a
# log. Run time: 10 s. Before this: nothing but Python. Symbols and units:
# [notation](glossary.md#notation).*
#
# ## Claim
#
# The backlash of a robot's joint can be known from the motor's encoder alone: the method "only
# relies on data gathered from the motor encoder, which is always present in a robotic joint"
# (abstract).
#
# ## Method
#
# The arm turns about a horizontal axis, at constant speed. Gravity presses the teeth of the gear on
# one flank while the load rises, on the other while it falls. So the teeth cross the gap twice in
# each turn of the load. Each time they meet with an impact, and the motor speed rings. The larger
# the [backlash](glossary.md#backlash), the larger the ring.
#
# **1. The log.** The encoder gives the motor speed $v(t)$ in rps, revolutions per second.
# Subtracting the commanded speed $v_t$ [rps] gives the disturbance $r(t) = v(t) - v_t$ (equation
# 11).
#
# **2. The fit.** The [signature](glossary.md#signature) is a model of $r(t)$. An impact leaves a
# damped oscillation of the amplitude $A$ [rps], the damping $\tau$ [1/s] and the frequency $\omega$
# [rad/s], from $T_1$ to $T_2$ [s] after the instant $t_0$ [s]:
#
# $$d_b(t - t_0) = A\,e^{-(t - (t_0 + T_1))\tau} \sin\omega(t - t_0)
# \quad\text{for}\quad t_0 + T_1 \le t \le t_0 + T_2, \text{ else } 0 \tag{5}$$
#
# The second impact of a turn comes $T_d$ [s], half a turn, later and has the opposite sign. The
# next turn comes $T_f$ [s] later:
#
# $$f(t - t_0) = d_b(t - t_0) - d_b(t - (t_0 + T_d)) \tag{6}$$
#
# $$h(t) = \sum_{i=1}^{n} f(t - (t_0 + (i - 1)\,T_f)) \tag{7}$$
#
# $n$ is the number of turns. The search looks for the parameters with the smallest root mean square
# (RMSE) of $r(t) - h(t)$.
#
# **3. The backlash.** A cubic turns the fitted $A$, in rpm (revolutions per minute), into the
# backlash $\delta$ [rad]:
#
# $$\delta = 10^{-6} \left(-0.0018\, A^3 + 0.4323\, A^2 + 9.2524\, A + 34.0313\right)
# \quad\text{with } A \text{ in rpm} \tag{10}$$

# %%
from dataclasses import replace
from itertools import islice

import numpy as np
from IPython.display import HTML
from matplotlib import pyplot as plt
from tqdm import tqdm

import workbook
from replication import cmaes, published
from replication.signature import Box
from replication.simulator.parameters import identified_joint
from replication.simulator.simulate import simulate
from studies import teeth

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
backlash_mrad = 0.5  # delta, half of the play; equation 10 was fitted from 0.3 to 2.1
friction_share = 0.0  # Coulomb friction on the load, over the largest torque of gravity
sample_ms = 2.0  # sampling period of the log
turn_period_s = 0.4  # T_f of the fit; Table 1 prints 0.408
noise_rps = 0.1  # half-amplitude of the uniform noise on the logged speed
noise_law = "uniform"  # or "normal", with the same SD
seed = 1  # of the noise
population = 60  # points that the search tries in a generation
runs = 25  # of the search

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.check_parameters(
    backlash_mrad=(backlash_mrad, workbook.Interval(0, 2.1)),
    friction_share=(friction_share, workbook.Interval(0, 0.5)),
    sample_ms=(sample_ms, (1.0, 2.0, 4.0, 5.0)),
    turn_period_s=(turn_period_s, workbook.Interval(0.3, 0.5)),
    noise_rps=(noise_rps, workbook.Interval(0, 0.5)),
    noise_law=(noise_law, ("uniform", "normal")),
    seed=(seed, range(1, 1_000_001)),
    population=(population, range(10, 1001)),
    runs=(runs, range(1, 101)),
)
plt.rcParams.update(teeth.STYLE)
_ = plt.ion()

# %% [markdown]
# ## Result
#
# ### The teeth in the gap
#
# One turn of the load. Above, the load on its arm, and the teeth: blue is the motor's tooth, orange
# the flank of the load that is pressed. Below, the motor speed. Time passes five times slower while
# the gap is open.
#
# The joint was identified from the published signals (notebook 9); `simulate` integrates its
# equations of motion (notebook 1). It is compiled when it is first called: five seconds.

# %%
delta_rad, joint = 1e-3 * backlash_mrad, identified_joint()
joint = replace(joint, load_coulomb_nm=friction_share * joint.gravity_torque_nm)
v_t, T_f = joint.commanded_speed_rps, joint.turn_period_s
run = simulate(joint, delta_rad, duration_s=1.6, sample_s=1e-4, step_s=5e-5)
animation = workbook.plain_animation(
    teeth.animate_teeth(run, joint), words="arm, teeth and motor speed"
)
HTML(animation + teeth.JOINT)

# %% [markdown]
# A motor turns a load through a gear of ratio $N$. The encoder measures the motor's angle
# $\theta_m$ [rad]; nothing measures the load's angle $\theta_l$ [rad]. The *displacement*
# $\Delta\theta = \theta_m / N - \theta_l$ [rad] is the place of the centre of the motor's tooth
# between the flanks of the load. The tooth is free while $|\Delta\theta| \le \delta$: the backlash
# $\delta$ is *half* of the play. Beyond $\pm\delta$ it presses on a flank. Springs stand for the
# elasticity of shaft and teeth. The paper's figures 1, 2, 3 and 8 are sketches of the same.

# %% [markdown]
# ### Turn up the backlash
#
# Drag the slider: the gap opens from nothing to 2.1 mrad, and the ring grows with it. Its largest
# value (dots) moves along a curve. Equation 10 is the paper's formula for that curve: it makes the
# ring a sensor.

# %%
coefficients = [published.value(f"equation10.A{power}") for power in range(4)]


def equation_10(A_rps):  # backlash [rad]
    return 1e-6 * sum(c * (60 * A_rps) ** power for power, c in enumerate(coefficients))


def settled_peak(run):  # after the first turn, before it is sampled
    return (run.motor_speed_rps - v_t)[run.time_s >= T_f].max()


# %%
gaps_rad = 1e-4 * np.arange(22)
joints = [simulate(joint, gap_rad, duration_s=0.8, sample_s=1e-4) for gap_rad in gaps_rad]
peaks = np.array([settled_peak(each) for each in joints])
turns_rps = [each.motor_speed_rps[4000::10] - v_t for each in joints]
HTML(teeth.gap_slider(turns_rps, peaks, equation_10(peaks), round(10 * backlash_mrad)))

# %% [markdown]
# ### 1. The log
#
# Twelve turns, sampled every `sample_ms`, with noise: as the authors' logs are. The true backlash
# is `backlash_mrad`; from here on only the log is used.

# %%
log = simulate(joint, delta_rad, sample_s=1e-3 * sample_ms, step_s=5e-5)
rng = np.random.default_rng(int(seed))
t, clean = log.time_s, log.motor_speed_rps
law = {"uniform": (-noise_rps, noise_rps), "normal": (0, noise_rps / np.sqrt(3))}
v = clean + getattr(rng, noise_law)(*law[noise_law], t.size)

_, axis = plt.subplots(figsize=(7, 3))
axis.plot(t, v, ".", markersize=3, label="log, second and third turn")
axis.plot(t, clean, label="without noise")
axis.set(xlim=(T_f, 3 * T_f), xlabel="time [s]", ylabel="motor speed $v$ [rps]")
_ = axis.legend()

# %% [markdown]
# ### 2. The fit
#
# The signature repeats in every turn, so the parameters that fit the mean of the twelve turns best
# also fit the log best: the fit takes the mean turn.


# %%
T_f, T_d = turn_period_s, turn_period_s / 2
turn = round(T_f / t[1])  # samples


def average_turns(v):
    return v[: (v.size - 1) // turn * turn].reshape(-1, turn).mean(axis=0)


mean_turn = average_turns(v)


def signature(t, A, t0, tau, omega, T1, T2):
    phase = (t - t0) % T_f  # equation 7: all turns are alike
    second = phase >= T_d
    phase = phase - T_d * second  # equation 6: half a turn later the same, with the opposite sign
    gate = (phase >= T1) & (phase <= T2)
    d_b = A * np.exp(-(phase - T1) * tau) * np.sin(omega * phase) * gate  # equation 5
    return np.where(second, -d_b, d_b)


# %%
def rmse(X):  # of each row of X
    *shape, v_t = X.T[..., None]
    h = signature(t[:turn], *shape)
    return np.sqrt(np.mean((mean_turn - v_t - h) ** 2, axis=1))


# %% [markdown]
# The paper's search is CMA-ES (covariance matrix adaptation evolution strategy), which is random: a
# generation of points is drawn from a normal distribution, and the better half of them moves the
# distribution ([notebook 7](07_search_table1.ipynb)). It looks within the bounds of Table 1. Here
# a run has 90 generations.

# %%
box = {"A": (-np.ptp(v) / 2, np.ptp(v) / 2), "t0": (0, T_f)}
for name in ("tau", "omega", "T1", "T2"):
    box[name] = [published.value(f"table1.{name}.{end}") for end in ("min", "max")]
box["T2"] = (0, T_d)  # Table 1 has half of its T_f too, which is longer
box["v_t"] = (v.min(), v.max())
bounds = Box(*np.array([*box.values()]).T)


def best_of_run(run_seed):
    normals = cmaes.random_normals(run_seed)
    steps = islice(cmaes.generations(rmse, bounds, normals, population), 90)
    return min((step.misfits.min(), *step.members[step.misfits.argmin()]) for step in steps)


# %%
ends = np.array([best_of_run(k) for k in tqdm(range(1, runs + 1), desc="runs")])
misfits, found = ends[:, 0], ends[:, 1:]
best = found[misfits.argmin()]
A = abs(best[0])  # (A, t0) and (-A, t0 + T_d) are the same signature

# %% [markdown]
# The best [run](glossary.md#run) of all, over the mean turn and over the log.

# %%
*shape, best_v_t = best
fit = signature(t, *shape)
_, axis = plt.subplots(figsize=(7, 3))
one = slice(5 * turn, 6 * turn)
axis.plot(t[one], (v - best_v_t)[one], ".", color="0.75", label="log, sixth turn")
axis.plot(t[one], mean_turn - best_v_t, ".", label="mean of twelve turns")
axis.plot(t[one], fit[one], label="signature $h$")
axis.axhline(A, color="C1", linestyle=":", label=f"$A$ = {A:.3f} rps = {60 * A:.1f} rpm")
axis.set(xlabel="time [s]", ylabel="$v - v_t$ [rps]")
_ = axis.legend(loc="upper center", ncols=4, bbox_to_anchor=(0.5, 1.2))

# %% [markdown]
# ### 3. From the amplitude to the backlash
#
# Above, equation 10. Its $A$ is the [theoretical](glossary.md#theoretical-a) one: in our reading
# the peak of the noise-free speed before it is sampled. Below, the amplitudes and misfits of all
# runs. A run may end in a wrong local minimum, so we take the lowest misfit. The paper takes the
# mean of 30 single runs, wrong ones included ([notebook 8](08_noise_table2.ipynb)). Even right ones
# differ in $A$ by up to 3 %: $A$ is the envelope where the gate opens, and opening up to one sample
# of 2 ms earlier gives the same samples.

# %%
theoretical_A, found_rad = settled_peak(run), equation_10(A)
amplitudes = np.linspace(0, 1.2)
_, (upper, lower) = plt.subplots(2, sharex=True, figsize=(7, 4.5), height_ratios=(2, 1))
upper.plot(amplitudes, 1e3 * equation_10(amplitudes), "k", label="equation 10")
upper.plot([A, A, 0], [0, 1e3 * found_rad, 1e3 * found_rad], "C1", label="found")
upper.axhline(backlash_mrad, color="C2", linestyle=":", label="true backlash")
upper.axvline(theoretical_A, color="C2", linestyle="--", label="theoretical $A$")
lower.plot(abs(found[:, 0]), misfits, "x", color="C0", label=f"{runs} runs")
lower.plot(A, misfits.min(), "o", color="C1", label="best")
lower.axvline(abs(found[:, 0]).mean(), color="C0", linestyle=":", label="mean of all runs")
upper.set(ylabel="backlash $\\delta$ [mrad]")
lower.set(xlabel="amplitude $A$ [rps]", ylabel="RMSE [rps]")
for axis in (upper, lower):
    axis.legend(loc="center right")

# %% [markdown]
# ### Where to go on
#
# - To learn the paper: notebooks 1 to 9, in this order. To measure a joint of your own, with an
#   interval: [12](beyond/12_your_own_joint.ipynb). To review the replication: the
#   [report](../results/report.md).
# - `make lab` opens copies of the notebooks, in `lab/`. Change the cell under *Parameters* and run
#   all cells; the verdict shows your numbers beside the committed ones. The
#   [glossary](glossary.md) has the terms.

# %% [markdown]
# ## Verdict

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
off_percent = 100 * (abs(found[:, 0]) / theoretical_A - 1)
strays = (abs(off_percent) > 15).sum()
error_rad = found_rad - delta_rad
error = f"{100 * error_rad / delta_rad:+.1f} %" if delta_rad else f"{1e3 * error_rad:+.3f} mrad"
workbook.verdict(
    f"From the motor speed alone: {1e3 * found_rad:.3f} mrad by the best of {runs} searches and equation 10, for a "
    f"true backlash of {backlash_mrad:g} mrad ({error}). {strays} of the runs miss the theoretical $A$ "
    f"by more than 15 %; the mean of all runs is {off_percent.mean():+.1f} % off, the best run "
    f"{100 * (A / theoretical_A - 1):+.1f} %."
)

# %% [markdown]
# ## Try changing
#
# 1. `sample_ms = 4.0`: the best run's $A$ comes out 2 % larger, nearer to the truth, by luck: the
#    gate may open up to 4 ms earlier on the same samples, which makes $A$ up to 6 % larger, not 3
#    %. Two errors cancel.
# 2. `turn_period_s = 0.408`, the value that Table 1 prints: the mean turn is that of turns that
#    slip past each other, and the backlash comes out at a quarter.
# 3. `friction_share = 0.05`: the impacts are no longer half a turn apart, and the backlash comes
#    out 44 % too small.
#
# And `backlash_mrad = 0.0`: equation 10 gives 0.034 mrad at $A$ = 0, and noise and gravity leave an
# $A$ above 0; `population = 300`: hardly a run ends in a wrong minimum; `noise_rps = 0.0`: the best
# run errs nearly as much.
#
# ## Exercises
#
# **1.** Why is $A$ too small even without noise? Fit the mean turn of the noise-free speed. Split
# the error of $A$ into the signature's own and what the noise adds. Which share of the turn's SD
# does the best signature leave? (Notebook [8](08_noise_table2.ipynb) shows what it leaves.)

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
noisy_turn, mean_turn = mean_turn, average_turns(clean)
without_noise = min(best_of_run(k) for k in range(1, 4))
left_over, mean_turn = without_noise[0] / mean_turn.std(), noisy_turn
own_A = abs(without_noise[1])
assert left_over > 0.2  # it has not the turn's shape
print(
    f"the signature's own error {100 * (own_A / theoretical_A - 1):+.1f} %, of the noise "
    f"{100 * (A - own_A) / theoretical_A:+.1f} %; the best signature leaves {100 * left_over:.0f} % of the SD"
)

# %% [markdown]
# **2.** Every table of the paper has $A$ in rps. Which backlash does equation 10 give for every log
# of the paper if you forget to turn rps into rpm?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
forgotten_mrad = 1e3 * equation_10(amplitudes / 60)
assert forgotten_mrad.max() - forgotten_mrad.min() < 0.02
print(f"{forgotten_mrad.min():.3f} to {forgotten_mrad.max():.3f} mrad, whatever A is")

# %% [markdown]
# **3.** Why not read the largest sample instead of a fit? Compare the largest $r(t)$ after the
# first turn, of the log and without noise, with the theoretical $A$.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
largest, largest_clean = ((each - v_t)[t >= 0.4].max() for each in (v, clean))
assert largest_clean <= theoretical_A
assert largest <= largest_clean + np.abs(v - clean).max()
print(
    f"theoretical A {theoretical_A:.3f}, largest sample {largest_clean:.3f} without noise, {largest:.3f} rps with it"
)

# %% [markdown]
# **What you have learnt**: an impact rings, a fit gives $A$, equation 10 gives the backlash, and
# single searches go astray. *Next:* [the joint](01_the_joint.ipynb).
