# %% [markdown]
# # 0 · Start here: the sensor
#
# *You will see what backlash is, how it shows in the motor speed, and how to estimate it from a
# log. Reading time: 8 min. Run time: 30 s. Before this: nothing but Python. Symbols and units:
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
# the [backlash](glossary.md#backlash), the larger the ring. The sensor works in three steps: log
# the motor speed, fit a model of the ring, read the backlash from the fitted amplitude.

# %% jupyter={"source_hidden": true} tags=["hide-input"]
import numpy as np
from matplotlib import pyplot as plt

import workbook
from replication import published, signature
from replication.joint import identified_joint, settled_peak, simulate
from replication.records import Recording
from replication.signature import Parameters, Timing
from replication.table2 import BASIN_GAP, SearchSettings, best_fit, fit

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
backlash_mrad = 0.5  # delta, half of the play; equation 10 was fitted from 0.3 to 2.1
friction_share = 0.0  # Coulomb friction on the load, over the largest torque of gravity
sample_ms = 2.0  # sampling period of the log
turn_period_s = 0.4  # T_f of the fit; Table 1 prints 0.408
noise_rps = 0.1  # half-amplitude of the uniform noise on the logged speed
seed = 1  # of the noise
population = 300  # points that the search tries in a generation
runs = 25  # of the search

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.check_parameters(
    backlash_mrad=(backlash_mrad, (0, 2.1)),
    friction_share=(friction_share, (0, 0.5)),
    sample_ms=(sample_ms, (1.0, 2.0, 4.0, 5.0)),
    turn_period_s=(turn_period_s, (0.3, 0.5)),
    noise_rps=(noise_rps, (0, 0.5)),
    seed=(seed, range(1, 1_000_001)),
    population=(population, range(10, 1001)),
    runs=(runs, range(1, 101)),
)

# %% [markdown]
# ## Result
#
# ### The teeth in the gap
#
# One turn of the load. Left, the load on its arm; above, the motor's tooth (blue) between the
# flanks of the load (orange where pressed); below, the motor speed, grey while the gap is open.
# Press *play*, or drag the slider.
#
# A motor turns a load through a gear of ratio $N$. The encoder measures the motor's angle
# $\theta_m$ [rad]; nothing measures the load's angle $\theta_l$ [rad]. The *displacement*
# $\theta_m / N - \theta_l$ [rad] is the place of the motor's tooth between the flanks. The tooth is
# free within $\pm\delta$: the backlash $\delta$ is *half* of the play. `simulate` integrates the
# equations of motion ([notebook 1](01_the_joint.ipynb)) of a joint that was identified from the
# published signals ([notebook 3](03_simulator_figure10.ipynb)).

# %%
delta, joint = 1e-3 * backlash_mrad, identified_joint()
joint = joint._replace(load_coulomb=friction_share * joint.G)
v_t, T_f = 100.0, joint.turn_period
run = simulate(joint, delta, duration=1.2, sample=1e-4, step=5e-5)
A_true = settled_peak(run, joint)  # of the speed before it is sampled


# %% jupyter={"source_hidden": true} tags=["hide-input"]
def draw_arm(axis, angle):  # hanging straight down at 0
    axis.plot([0, np.sin(angle)], [0, -np.cos(angle)], "o-", color="0.4", markevery=[-1], ms=12)
    axis.set(xlim=(-1.2, 1.2), ylim=(-1.2, 1.2), aspect="equal", title="the load")
    axis.axis("off")


def draw_teeth(axis, x, delta):  # in mrad: a tooth at x, flanks that give way when pressed
    give = x - np.clip(x, -delta, delta)
    axis.bar(x, 1, 1.0, color="C0")
    for side in (-1, 1):
        pressed = "C1" if give * side > 0 else "0.6"
        axis.bar(side * (delta + 1) + give, 0.8, 1.0, color=pressed)
    axis.axvspan(-delta - 0.5 + give, delta + 0.5 + give, color="0.92", zorder=0)
    axis.set(xlim=(-5, 5), yticks=[], title="tooth between flanks [mrad]")


def draw_speed(axis, t, r, open_gap):
    axis.plot(1e3 * t, r)
    axis.fill_between(1e3 * t, -1.3, 1.3, where=open_gap, color="0.85")
    axis.set(xlabel="time [ms]", ylabel="speed $- v_t$ [rps]", ylim=(-1.3, 1.3))


# %% jupyter={"source_hidden": true} tags=["hide-input"]
turn = (run.t >= T_f) & (run.t <= 2 * T_f)
t_turn, r_turn, free = run.t[turn] - T_f, run.v[turn] - v_t, run.gap[turn] == 0
x_mrad = 1e3 * (run.theta_m / joint.N - run.theta_l)[turn]
# More pictures while the gap is open.
shown = np.flatnonzero(np.arange(turn.sum()) % np.where(free, 40, 160) == 0)


def draw(figure, k):
    i = shown[k]
    draw_arm(figure.add_axes((0.02, 0.5, 0.25, 0.4)), run.theta_l[turn][i])
    draw_teeth(figure.add_axes((0.36, 0.6, 0.6, 0.28)), x_mrad[i], backlash_mrad)
    speed = figure.add_axes((0.12, 0.15, 0.84, 0.3))
    draw_speed(speed, t_turn, r_turn, free)
    speed.plot(1e3 * t_turn[i], r_turn[i], "ko")


workbook.flipbook(draw, len(shown), "arm, teeth and motor speed during a turn")

# %% [markdown]
# ### Turn up the backlash
#
# Drag the slider: the gap opens from nothing to 2.1 mrad, and the ring grows with it. Its largest
# value moves along a curve. That makes the ring a sensor.

# %% jupyter={"source_hidden": true} tags=["hide-input"]
gaps_mrad = 0.1 * np.arange(22)
swept = [simulate(joint, 1e-3 * gap, duration=0.8, sample=1e-4) for gap in gaps_mrad]
peaks = [settled_peak(each, joint) for each in swept]


def draw_gap(figure, k):
    draw_teeth(figure.add_axes((0.08, 0.6, 0.42, 0.28)), 0.0, gaps_mrad[k])
    settled = swept[k].t >= T_f
    r, open_gap = swept[k].v[settled] - v_t, swept[k].gap[settled] == 0
    draw_speed(figure.add_axes((0.1, 0.15, 0.4, 0.3)), swept[k].t[settled] - T_f, r, open_gap)
    curve = figure.add_axes((0.62, 0.15, 0.35, 0.73))
    curve.plot(peaks, gaps_mrad, ".-")
    curve.plot(peaks[k], gaps_mrad[k], "ko")
    curve.set(xlabel="largest $v - v_t$ [rps]", ylabel="backlash $\\delta$ [mrad]")


workbook.flipbook(draw_gap, len(gaps_mrad), "gap, motor speed and curve", round(10 * backlash_mrad))

# %% [markdown]
# ### 1. The log
#
# The encoder gives the motor speed $v(t)$ in rps, revolutions per second. Subtracting the commanded
# speed $v_t$ [rps] gives the disturbance
#
# $$r(t) = v(t) - v_t \tag{11}$$
#
# Ours has twelve turns, with noise, as the authors' logs have. From here on only the log is used.

# %%
sampled = simulate(joint, delta, sample=1e-3 * sample_ms, step=5e-5)
t, clean = sampled.t, sampled.v
v = clean + np.random.default_rng(seed).uniform(-noise_rps, noise_rps, t.size)
log = Recording(t, v, v_t, T_f, "our log")

# %%
_, axis = plt.subplots(figsize=(7, 2.5), layout="constrained")
axis.plot(t, v - v_t, ".", markersize=3, label="log, second and third turn")
axis.plot(t, clean - v_t, label="without noise")
axis.set(xlim=(T_f, 3 * T_f), xlabel="time [s]", ylabel="$r$ [rps]")
_ = axis.legend()

# %% [markdown]
# ### 2. The model
#
# An impact leaves a damped oscillation with the amplitude $A$ [rps], the damping $\tau$ [1/s] and
# the angular frequency $\omega$ [rad/s]. It lasts from $T_1$ to $T_2$ [s] after the instant $t_0$
# [s], its *gate*, and is zero outside:
#
# $$d_b(t - t_0) = A\,e^{-(t - (t_0 + T_1))\tau} \sin\omega(t - t_0)
# \quad\text{for}\quad t_0 + T_1 \le t \le t_0 + T_2, \text{ else } 0 \tag{5}$$

# %%
example = Parameters(A=0.5, t0=0.05, tau=15, omega=132, v_t=v_t, T2=0.18, T1=0.01)
timing = Timing(T_d=turn_period_s / 2, T_f=turn_period_s, n=12)


def plot_turns(curve):
    _, axis = plt.subplots(figsize=(7, 1.5), layout="constrained")
    axis.plot(t, curve)
    axis.set(xlim=(0, 1), xlabel="time [s]", ylabel="[rps]")


plot_turns(signature.d_b(t, example, example.t0))

# %% [markdown]
# The second impact of a turn comes $T_d$ [s], half a turn, later and has the opposite sign:
#
# $$f(t - t_0) = d_b(t - t_0) - d_b(t - (t_0 + T_d)) \tag{6}$$

# %%
plot_turns(signature.f(t, example, example.t0, timing.T_d))

# %% [markdown]
# The next turn comes $T_f$ [s] later. This is the [signature](glossary.md#signature) of $n$ turns:
#
# $$h(t) = \sum_{i=1}^{n} f(t - (t_0 + (i - 1)\,T_f)) \tag{7}$$

# %%
plot_turns(signature.h(t, example, timing))

# %% [markdown]
# ### The fit
#
# The paper's search, CMA-ES (covariance matrix adaptation evolution strategy), looks for the
# parameters with the smallest root mean square (RMSE) of $r - h$ within the bounds of Table 1
# ([notebook 7](07_search_table1.ipynb)). It is random, and a run may end in a wrong local minimum.
# As a reference, `best_fit` solves for $A$ and $v_t$ by least squares, searches the other five
# parameters, and compares what it finds with the same oscillation some half periods earlier or later.

# %%
settings = SearchSettings(population=population, amplitude_factor=1.0, timing=timing)
with workbook.explain("turn_period_s", turn_period_s):
    reference = best_fit(log, settings)
fits = [fit(log, settings, run_seed) for run_seed in range(1, runs + 1)]
best = min(reference, *fits, key=lambda each: round(each.rmse, 4))  # the first of equal ones

# %%
_, axis = plt.subplots(figsize=(7, 3), layout="constrained")
axis.plot(t, v - best.X.v_t, ".", markersize=3, color="0.7", label="log, sixth turn")
axis.plot(t, clean - best.X.v_t, linewidth=3, color="0.8", label="without noise")
axis.plot(t, signature.h(t, best.X, timing), label="best signature $h$")
axis.set(xlim=(5 * T_f, 6 * T_f), xlabel="time [s]", ylabel="$v - v_t$ [rps]")
_ = axis.legend(ncols=3)

# %% [markdown]
# ### 3. From the amplitude to the backlash
#
# A cubic turns $A$, in rpm (revolutions per minute), into the backlash [rad]:
#
# $$\delta = 10^{-6} \left(-0.0018\, A^3 + 0.4323\, A^2 + 9.2524\, A + 34.0313\right) \tag{10}$$

# %%
coefficients = [1e-6 * published.value(f"equation10.A{power}") for power in (3, 2, 1, 0)]


def equation_10(A_rps):  # backlash [mrad]
    return 1e3 * np.polyval(coefficients, 60 * A_rps)


A, amplitudes = best.amplitude_rps, np.array([each.amplitude_rps for each in fits])
estimate_mrad = equation_10(A)

# %%
_, (upper, lower) = plt.subplots(2, sharex=True, figsize=(7, 4.5), layout="constrained")
upper.plot(peaks, equation_10(np.array(peaks)), "k", label="equation 10")
upper.plot([A, A, 0], [0, estimate_mrad, estimate_mrad], "C1", label="estimate")
upper.plot(A_true, backlash_mrad, "o", color="C2", label="truth")
lower.plot(amplitudes, [each.rmse for each in fits], "x", label=f"{runs} runs")
lower.plot(A, best.rmse, "o", color="C1", label="best")
upper.set(ylabel="backlash $\\delta$ [mrad]")
lower.set(xlabel="amplitude $A$ [rps]", ylabel="RMSE [rps]")
for axis in (upper, lower):
    axis.legend()

# %% [markdown]
# The true $A$ is the [theoretical](glossary.md#theoretical-a) one: in our reading the peak of the
# noise-free speed before it is sampled. The paper takes the mean of 30 single runs, wrong ones
# included ([notebook 8](08_noise_table2.ipynb)).
#
# ### Where to go on
#
# - To learn the paper: notebooks 1 to 8, in this order. To measure a joint of your own, with an
#   interval: [11](beyond/11_your_own_joint.ipynb). To review the replication: the
#   [report](../results/report.md).
# - `make lab` opens copies of the notebooks, in `lab/`. Change the cell under *Parameters* and run
#   all cells.

# %% [markdown]
# ## Verdict


# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
def off_percent(amplitude):
    return 100 * (amplitude / A_true - 1)


reached = sum(each.rmse <= best.rmse * (1 + BASIN_GAP) for each in fits)
error = f"{100 * (estimate_mrad / backlash_mrad - 1):+.1f} %" if backlash_mrad else "not defined"
workbook.verdict(
    f"From the motor speed alone the best fit and equation 10 give {estimate_mrad:.3f} mrad for a true backlash of "
    f"{backlash_mrad:g} mrad (relative error: {error}). {reached} of the {runs} single searches reached the lowest "
    f"misfit, {best.rmse:.4f} rps, within {100 * BASIN_GAP:g} %. The theoretical $A$ is {A_true:.3f} rps; the best "
    f"fit's is {off_percent(A):+.1f} % off, the mean of all runs {off_percent(amplitudes.mean()):+.1f} %."
)

# %% [markdown]
# ## Try changing
#
# 1. `population = 60`: fewer points a generation, and more of the runs end in a wrong minimum.
# 2. `turn_period_s = 0.408`, the value that Table 1 prints: turns of the model and of the log slip
#    past each other, and the backlash comes out far too small.
# 3. `friction_share = 0.05`: the impacts are no longer half a turn apart, and the backlash comes
#    out too small.
#
# And `backlash_mrad = 0.0`: equation 10 gives 0.034 mrad at $A$ = 0, and noise and gravity leave an
# $A$ above 0.
#
# ## Exercises
#
# Each asks for a number by its `name`. The cell below your answer says *right* or *not yet*.

# %%
own_percent = forgotten_mrad = missed_percent = np.nan  # your answers

# %% [markdown]
# **1.** Why is $A$ too small even without noise? Fit the noise-free speed by `best_fit`: by how much
# (`own_percent`, with its sign) is its $A$ off the theoretical one? What does the noise add?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
quiet = best_fit(Recording(t, clean, v_t, T_f, "without noise"), settings)
own_percent = off_percent(quiet.amplitude_rps)
print(
    f"the signature's own error {own_percent:+.1f} %, of the noise {off_percent(A) - own_percent:+.1f} % "
    f"(as the window may open a sample earlier, A is free within some 3 % besides). A damped sine is not the shape of "
    f"the speed: the best signature leaves {100 * quiet.rmse / clean.std():.0f} % of the SD"
)

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
noise_free = best_fit(Recording(t, clean, v_t, T_f, "without noise"), settings)
of_signature = off_percent(noise_free.amplitude_rps)
workbook.check_answer(own_percent, of_signature, atol=0.2)

# %% [markdown]
# **2.** Every table of the paper has $A$ in rps. Which backlash (`forgotten_mrad`) does equation 10
# give for any log of the paper if you forget to turn rps into rpm?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
forgotten_mrad = equation_10(0.6 / 60)  # between 0.034 at 0 rps and 0.046 at 1.2 rps

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(
    forgotten_mrad, lambda mrad: equation_10(0.0) <= mrad <= equation_10(1.2 / 60)
)

# %% [markdown]
# **3.** Why not read the largest sample instead of a fit? How much of the theoretical $A$ does the
# largest noise-free $r(t)$ after the first turn miss (`missed_percent`)? How large is it with noise?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
missed_percent, noisy_percent = (-off_percent(each[t >= T_f].max() - v_t) for each in (clean, v))
print(f"it misses {missed_percent:.1f} % of A; with noise it is {-noisy_percent:+.1f} % off")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
missed = -off_percent(clean[t >= T_f].max() - v_t)
workbook.check_answer(missed_percent, missed, atol=0.1)

# %% [markdown]
# **What you have learnt**: an impact rings, a fit gives $A$, equation 10 gives the backlash, and
# single searches go astray. *Next:* [the joint](01_the_joint.ipynb).
