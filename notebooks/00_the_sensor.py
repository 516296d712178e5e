# %% [markdown]
# # 0 · Start here: the sensor
#
# *You will see what backlash is, how it shows in the motor speed, and how to estimate it from a
# log. Before this: nothing but Python. Symbols and units: [notation](glossary.md#notation).*

# %% jupyter={"source_hidden": true} tags=["hide-input"]
import numpy as np
import pandas as pd

import workbook
from replication import figures, published
from replication.best_fit import best_fit
from replication.joint import identified_joint, settled_peak, simulate
from replication.records import Recording
from replication.signature import Parameters, Timing
from replication.table2 import BASIN_GAP, SearchSettings, fit
from workbook import Change

workbook.say_times("00_the_sensor")

# %% [markdown]
# The path of this workbook: 0, [1](01_the_joint.ipynb), [4](04_growth_figure11.ipynb),
# [5](05_signature_figure6.ipynb), [6](06_characteristic_figure12.ipynb),
# [7](07_search_table1.ipynb), [8](08_noise_table2.ipynb), [11](beyond/11_your_own_joint.ipynb). The
# others go deeper. Reviewers start at the [report](../results/report.md). Reading times leave out the
# exercises, some five minutes each.
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
#
# ## Parameters

# %% tags=["parameters"]
backlash_mrad = 0.5  # half of the play; equation 10 was fitted from 0.3 to 2.1
friction_share = 0.0  # Coulomb friction on the load, over gravity's largest torque
sample_ms = 2.0  # sampling period of the log
turn_period_s = 0.4  # seconds that a turn takes, as the model believes
noise_rps = 0.1  # half-amplitude of the uniform noise on the logged speed
seed = 1  # of the noise
populations = [60, 300]  # points that a search tries in each generation
runs = 25  # searches with each population

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.check_parameters(
    globals(),
    backlash_mrad=(0, 2.1),
    friction_share=(0, 0.5),
    sample_ms=(1.0, 2.0, 4.0, 5.0),
    turn_period_s=(0.3, 0.5),
    noise_rps=(0, 0.5),
    seed=range(1, 1_000_001),
    populations=[range(10, 1001)],
    runs=range(1, 101),
)

# %% [markdown]
# ## Result
#
# ### The teeth in the gap
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
# In mrad: the tooth's middle at x; pressed flanks give way.
def draw_teeth(axis, x, delta):
    give = x - np.clip(x, -delta, delta)
    title = "motor's tooth between the load's flanks [mrad]"
    axis.set(xlim=(-5, 5), ylim=(0, 1), yticks=[], facecolor="0.95", title=title)
    axis.grid(visible=False)
    for side in (-1, 1):
        pressed = figures.ORANGE if give * side > 0 else "0.6"
        axis.barh(0.4, side * 9, 0.8, left=side * delta + give, color=pressed)
    axis.plot([x, x], [0, 1], linewidth=3)


def draw_speed(axis, t, r, open_gap):
    axis.plot(1e3 * t, r)
    axis.fill_between(1e3 * t, -1.3, 1.3, where=open_gap, color="0.85")
    axis.set(xlabel="time [ms]", ylabel="speed $- v_t$ [rps]", ylim=(-1.3, 1.3))


# %% [markdown]
# *Predict:* at which two angles of the load (0°: it hangs straight down) does the tooth (blue) change
# its flank (orange where pressed)? Press *play*, or drag the slider; the speed is grey while the gap
# is open.

# %% jupyter={"source_hidden": true} tags=["hide-input"]
turn = (run.t >= T_f) & (run.t <= 2 * T_f)
t_turn, r_turn, free = run.t[turn] - T_f, run.v[turn] - v_t, run.gap[turn] == 0
x_mrad = 1e3 * (run.theta_m / joint.N - run.theta_l)[turn]
# More pictures while the gap is open.
shown = np.flatnonzero(np.arange(turn.sum()) % np.where(free, 40, 160) == 0)


def draw(figure, k):
    i = shown[k]
    angle = run.theta_l[turn][i]  # 0: hanging straight down
    arm = figure.add_axes((0.02, 0.5, 0.25, 0.4))
    ends = [0, np.sin(angle)], [0, -np.cos(angle)]
    arm.plot(*ends, "o-", color="0.4", markevery=[-1], markersize=12)
    arm.set(xlim=(-1.2, 1.2), ylim=(-1.2, 1.2), aspect="equal", title="the load")
    arm.axis("off")
    draw_teeth(figure.add_axes((0.36, 0.6, 0.6, 0.28)), x_mrad[i], backlash_mrad)
    speed = figure.add_axes((0.12, 0.15, 0.84, 0.3))
    draw_speed(speed, t_turn, r_turn, free)
    speed.plot(1e3 * t_turn[i], r_turn[i], "ko")


workbook.flipbook(draw, len(shown), "arm, teeth and motor speed during a turn")
impacts = run.impacts[(run.impacts >= T_f) & (run.impacts < 2 * T_f)]
places = np.degrees(np.interp(impacts, run.t, run.theta_l)) % 360
workbook.say(
    f"The teeth met at {' and '.join(f'{place:.0f}°' for place in places)} of the "
    "load's turn, where 180° is the top and 360° the bottom: "
    f"{'gravity with friction' if friction_share else 'gravity'} has to change its "
    "direction first, then the tooth crosses the gap."
    if backlash_mrad
    else "There is no gap, so the teeth never meet and nothing rings."
)

# %% [markdown]
# ### Turn up the backlash
#
# *Predict:* at twice the gap, is the ring twice as high?

# %% jupyter={"source_hidden": true} tags=["hide-input"]
gaps_mrad = 0.1 * np.arange(22)
swept = [simulate(joint, 1e-3 * gap, 2 * T_f, sample=1e-4) for gap in gaps_mrad]
peaks = np.array([settled_peak(each, joint) for each in swept])


def draw_gap(figure, k):
    draw_teeth(figure.add_axes((0.08, 0.6, 0.42, 0.28)), 0.0, gaps_mrad[k])
    speed, run = figure.add_axes((0.1, 0.15, 0.4, 0.3)), swept[k]
    draw_speed(speed, run.t - T_f, run.v - v_t, run.gap == 0)
    speed.set(xlim=(0, 1e3 * T_f))
    curve = figure.add_axes((0.62, 0.15, 0.35, 0.73))
    curve.plot(peaks, gaps_mrad, ".-")
    curve.plot(peaks[k], gaps_mrad[k], "ko")
    curve.set(xlabel="largest $v - v_t$ [rps]", ylabel="backlash $\\delta$ [mrad]")


workbook.flipbook(
    draw_gap,
    len(gaps_mrad),
    "gap, motor speed and curve",
    round(10 * backlash_mrad),
)
times = peaks[20] / peaks[10]
measures = "Each gap has its own value, so the ring can measure it."
if np.any(np.diff(peaks) <= 0):
    measures = "Some gaps share a value, so here it cannot measure them."
workbook.say(
    f"{'No' if times < 1.95 else 'Nearly'}: from 1 to 2 mrad the largest value "
    f"grows {times:.2f} times, from {peaks[10]:.2f} to {peaks[20]:.2f} rps, as the "
    "teeth meet faster after a wider gap ([notebook 4](04_growth_figure11.ipynb)). "
    f"{measures}"
)

# %% [markdown]
# ### 1. The log
#
# The encoder gives the motor speed $v(t)$ in rps, revolutions per second. Subtracting the commanded
# speed $v_t$ [rps] gives the disturbance
#
# $$r(t) = v(t) - v_t \tag{11}$$
#
# Ours has twelve turns, with noise, as the authors' logs have. From here on only the log is used.
# *Predict:* can $A$, the height of the ring, be read as the log's largest sample?

# %%
sampled = simulate(joint, delta, sample=1e-3 * sample_ms, step=5e-5)
t, clean = sampled.t, sampled.v
v = clean + np.random.default_rng(seed).uniform(-noise_rps, noise_rps, t.size)
log = Recording(t, v, v_t, T_f, "our log")

# %% jupyter={"source_hidden": true} tags=["hide-input"]
DOTS = {"color": figures.ORANGE, "marker": ".", "linestyle": "", "markersize": 3}
lines = {
    "log, second and third turn": (t, v - v_t, DOTS),
    "without noise": (t, clean - v_t, figures.FIT),
}
largest = (v - v_t)[t >= T_f].max()
workbook.show(
    figures.curves(lines, "time [s]", "$r$ [rps]", xlim=(T_f, 3 * T_f)),
    f"No sample is sure: the largest is {largest:.3f} rps, the true $A$ (the "
    f"settled peak without noise, before sampling) {A_true:.3f} rps. Noise and the "
    "time between samples move a single sample, so we fit a model to all.",
)

# %% [markdown]
# ### 2. The model
#
# An impact leaves a damped oscillation with the amplitude $A$ [rps], the damping $\tau$ [1/s] and
# the angular frequency $\omega$ [rad/s]. It lasts from $T_1$ to $T_2$ [s] after the instant $t_0$
# [s], its *gate*, and is zero outside. The second impact of a turn comes $T_d$ [s], half a turn,
# later and has the opposite sign; the next turn comes $T_f$ [s] later. The sum over $n$ turns is
# the [signature](glossary.md#signature) $h$ [rps]:
#
# $$d_b(t - t_0) = A\,e^{-(t - (t_0 + T_1))\tau} \sin\omega(t - t_0)
# \quad\text{for}\quad t_0 + T_1 \le t \le t_0 + T_2 \tag{5}$$
#
# $$f(t - t_0) = d_b(t - t_0) - d_b(t - (t_0 + T_d)) \tag{6}$$
#
# $$h(t) = \sum_{i=1}^{n} f(t - (t_0 + (i - 1)\,T_f)) \tag{7}$$

# %%
timing = Timing(T_d=turn_period_s / 2, T_f=turn_period_s, n=12)


def d_b(t, X, start):  # equation 5, with `start` in place of t_0
    since = t - start
    gate = (since >= X.T1) & (since <= X.T2)
    return gate * X.A * np.exp(-(since - X.T1) * X.tau) * np.sin(X.omega * since)


def f(t, X, start):  # equation 6
    return d_b(t, X, start) - d_b(t, X, start + timing.T_d)


def h(t, X):  # equation 7
    return sum(f(t, X, X.t0 + i * timing.T_f) for i in range(timing.n))


# %% jupyter={"source_hidden": true} tags=["hide-input"]
example = Parameters(A=0.5, t0=0.05, tau=15, omega=132, v_t=v_t, T2=0.18, T1=0.01)
first = t[t < 1]
workbook.show(
    figures.signature_parameters(first, h(first, example), example, timing),
    "(a) The signature: each turn has two oscillations of opposite sign. (b) The "
    "first one, $d_b$, while its gate is open; its envelope (dashed) decays.",
)

# %% [markdown]
# ### The fit
#
# The paper's search, CMA-ES (covariance matrix adaptation evolution strategy), looks for the
# parameters with the smallest misfit, the root mean square (RMSE) of $r - h$, within the bounds of
# Table 1 ([notebook 7](07_search_table1.ipynb)). It tries a population of random points, generation
# after generation; each search has a seed. As a reference, `best_fit` finds the lowest misfit without
# depending on chance ([notebook 8](08_noise_table2.ipynb)). *Predict:* do searches of one log end at
# one $A$?

# %%
settings = [
    SearchSettings(population=each, amplitude_factor=1.0, timing=timing)
    for each in populations
]
with workbook.explain("turn_period_s", turn_period_s):
    reference = best_fit(log, settings[0])
fits = {
    each.population: [fit(log, each, k) for k in range(1, runs + 1)]
    for each in settings
}
ends = [reference, *(end for searches in fits.values() for end in searches)]
best = min(ends, key=lambda end: round(end.rmse, 4))  # the first of equal ones


# %% jupyter={"source_hidden": true} tags=["hide-input"]
def off_percent(amplitude):
    return 100 * (amplitude / A_true - 1)


searched = pd.DataFrame(
    [(size, end.amplitude_rps, end.rmse) for size in fits for end in fits[size]],
    columns=["points", "A", "rmse"],
)
searched["lowest"] = searched["rmse"] <= best.rmse * (1 + BASIN_GAP)
by_points = searched.groupby("points", sort=False)
reached, means = by_points["lowest"].sum(), by_points["A"].mean()
figure, axis = figures.panel(2.8)
for k, (size, part) in enumerate(by_points):
    axis.plot(part["A"], part["rmse"], "x+sd"[k % 4], label=f"{size} points")
axis.plot(best.amplitude_rps, best.rmse, "ko", mfc="none", label="best fit")
axis.set(xlabel="amplitude $|A|$ [rps]", ylabel="RMSE [rps]")
counts = "; ".join(
    f"with {size} points a generation {reached[size]} of {runs} at the lowest "
    f"misfit, and the mean $A$ of all {off_percent(means[size]):+.0f} % off"
    for size in fits
)
wrong = searched[~searched["lowest"]]
near = (wrong["A"] / best.amplitude_rps).between(0.97, 1.03).sum()
answer = f"Here they do: {counts} the true one."
if len(wrong):
    answer = (
        f"No: {counts} the true one. In wrong minima: {len(wrong)}, with an $A$ "
        f"within 3 % of the best fit's: {near}. Only the misfit tells which."
    )
elif searched["A"].max() > 1.03 * searched["A"].min():
    answer = (
        f"No: {counts} the true one. All have the lowest misfit, which here hardly "
        "depends on $A$."
    )
workbook.show(figures.finish(figure, 3), answer)

# %% jupyter={"source_hidden": true} tags=["hide-input"]
lines = {
    "log, sixth turn": (t, v - best.X.v_t, DOTS),
    "without noise": (t, clean - best.X.v_t, figures.WIDE),
    "best signature $h$": (t, h(t, best.X), figures.FIT),
}
noise_sd, apart_s = (v - clean).std(), np.diff(impacts[:2]).sum()
left_rps = np.sqrt(np.mean((v - best.X.v_t - h(t, best.X)) ** 2))
if not np.isclose(left_rps, best.rmse, rtol=1e-3):
    rest = "The search fits equations 5 to 7 as printed, not the code above."
elif best.rmse < 1.02 * noise_sd:
    rest = "So the signature follows the log as well as the noise allows."
elif not np.isclose(turn_period_s, T_f, atol=1e-4):
    rest = f"A turn takes {T_f:g} s, and in the model {turn_period_s:g} s."
elif abs(apart_s - T_f / 2) > 2e-3:
    rest = f"Two impacts are {apart_s:.3f} s apart, and not half a turn."
else:
    rest = "Between the impacts gravity bends the speed, and no damped sine does."
workbook.show(
    figures.curves(
        lines, "time [s]", "$r$ [rps]", columns=3, xlim=(5 * T_f, 6 * T_f)
    ),
    f"The best signature leaves {left_rps:.3f} rps; the noise alone has the SD "
    f"(standard deviation) {noise_sd:.3f} rps. {rest}",
)

# %% [markdown]
# ### 3. From the amplitude to the backlash
#
# A cubic turns $A$, in rpm (revolutions per minute), into the backlash [rad]. *Predict:* which error
# of the backlash does that of $A$ make?
#
# $$\delta = 10^{-6} \left(-0.0018\, A^3 + 0.4323\, A^2 + 9.2524\, A + 34.0313\right) \tag{10}$$

# %%
coefficients = [
    1e-6 * published.value(f"equation10.A{power}") for power in (3, 2, 1, 0)
]


def equation_10(A_rps):  # backlash [mrad]
    return 1e3 * np.polyval(coefficients, 60 * A_rps)


A = best.amplitude_rps
estimate_mrad = equation_10(A)

# %% jupyter={"source_hidden": true} tags=["hide-input"]
lines = {
    "equation 10": (peaks, equation_10(peaks), figures.FIT),
    "estimate": ([A, A, 0], [0, estimate_mrad, estimate_mrad]),
    "truth": (A_true, backlash_mrad, figures.MARKS),
}
workbook.show(
    figures.curves(lines, "amplitude $A$ [rps]", figures.BACKLASH_LABEL, columns=3),
    f"$A$ is {off_percent(A):+.1f} % off, so the backlash is "
    f"{estimate_mrad - backlash_mrad:+.3f} mrad off; equation 10 itself gives "
    f"{equation_10(A_true):.3f} mrad at the true $A$.",
)

# %% [markdown]
# The true $A$ is the [theoretical](glossary.md#theoretical-a) one. The paper takes the mean of 30
# single runs, wrong ones included ([notebook 8](08_noise_table2.ipynb)).
#
# ## Verdict

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
workbook.verdict(
    "From the motor speed alone the best fit and equation 10 give "
    f"{estimate_mrad:.3f} mrad for a true backlash of {backlash_mrad:g} mrad. The "
    f"best fit's $A$ is {off_percent(A):+.1f} % off the theoretical {A_true:.3f} "
    f"rps; of single searches, {counts}."
)

# %% [markdown]
# ## Try changing
#
# `make lab` opens copies of the notebooks, in `lab/`. Change a cell and run all.

# %% jupyter={"source_hidden": true} tags=["hide-input", "promises"]
workbook.try_changing(
    Change(
        "populations = [30, 100]",
        "fewer points a generation, and fewer searches find the lowest misfit",
        lambda now, was: now.reached.sum() < was.reached.sum(),
    ),
    Change(
        "turn_period_s = 0.408",
        "the value that Table 1 prints: turns of the model and of the log are "
        "misaligned, and the backlash comes out far too small",
        lambda now, was: now.estimate_mrad < 0.7 * was.estimate_mrad,
    ),
    Change(
        "friction_share = 0.05",
        "the impacts are no longer half a turn apart, and the backlash comes out "
        "too small",
        lambda now, was: (
            now.estimate_mrad < 0.9 * was.estimate_mrad
            and abs(now.apart_s - 0.2) > 2 * abs(was.apart_s - 0.2)
        ),
    ),
)

# %% [markdown]
# ## Exercises
#
# Answer by the `name`; the cell below says *right* or *not yet*. Solutions are folded in the
# committed notebooks.

# %%
own_percent = forgotten_mrad = missed_percent = np.nan  # your answers

# %% [markdown]
# **1.** Why is $A$ too small even without noise? Fit the noise-free speed by `best_fit`: by how much
# (`own_percent` [%], with its sign, to 0.5) is its $A$ off the theoretical one?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
quiet = best_fit(Recording(t, clean, v_t, T_f, "without noise"), settings[0])
own_percent = off_percent(quiet.amplitude_rps)
print(
    f"the signature's own error {own_percent:+.1f} %, of the noise "
    f"{off_percent(A) - own_percent:+.1f} % (as the window may open a sample "
    "earlier, A is free within some 3 % besides). A damped sine is not the shape "
    f"of the speed: the best signature leaves {100 * quiet.rmse / clean.std():.0f} "
    "% of the SD"
)

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
noise_free = best_fit(Recording(t, clean, v_t, T_f, "without noise"), settings[0])
workbook.check_answer(own_percent, off_percent(noise_free.amplitude_rps), to=0.5)

# %% [markdown]
# **2.** Every table of the paper has $A$ in rps. Which backlash (`forgotten_mrad` [mrad], to 0.001)
# does equation 10 give for $A$ = 0.6 rps if you forget to turn rps into rpm?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
forgotten_mrad = equation_10(0.6 / 60)
print(f"{forgotten_mrad:.3f} mrad, in place of {equation_10(0.6):.3f}")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(forgotten_mrad, 1e3 * np.polyval(coefficients, 0.6), to=0.001)

# %% [markdown]
# **3.** How much of the theoretical $A$ does the largest sample of the noise-free $r(t)$ after the
# first turn miss (`missed_percent` [%], to 0.05)?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
missed_percent = 100 * (1 - (clean[t >= T_f].max() - v_t) / A_true)
print(f"it misses {missed_percent:.1f} % of A: the peak lies between two samples")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(
    missed_percent, -off_percent(clean[t >= T_f].max() - v_t), to=0.05
)

# %% [markdown]
# **What you have learnt**: an impact rings, a fit gives $A$, equation 10 gives the backlash, and
# single searches go astray. *Next:* [the joint](01_the_joint.ipynb).
