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
from replication.signature import Timing, h
from replication.table2 import SearchSettings

workbook.say_times("00_the_sensor")

# %% [markdown]
# The path of this workbook: 0 (the idea), [5](05_signature_figure6.ipynb) and
# [7](07_search_table1.ipynb) (the model and the search), [8](08_noise_table2.ipynb) (noise, Table 2),
# [11](beyond/11_your_own_joint.ipynb) (a joint of your own). *Deeper* go [1](01_the_joint.ipynb) (the
# joint), [4](04_growth_figure11.ipynb) (growth), [6](06_characteristic_figure12.ipynb) (equation 10)
# and the others; there is no 2 and no 10. Reviewers start at the
# [report](../results/report.md).

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.say_path(
    "00_the_sensor",
    "05_signature_figure6",
    "07_search_table1",
    "08_noise_table2",
    "11_your_own_joint",
)

# %% [markdown]
# ## What it sees
#
# A motor turns an arm through a gear whose teeth have some play. The arm turns about a horizontal
# axis, at constant speed. Without Python: <a href="explore.html">the same to play with</a>. Press
# *play*, or drag the slider. *Predict:* at which two angles of the arm (0°: it hangs straight down)
# does the motor's tooth change the flank on which it presses (orange)?


# %% jupyter={"source_hidden": true} tags=["hide-input"]
# In mrad, the gap of 1 mrad enlarged: the motor's teeth at x, the arm's at 0.
def draw_teeth(axis, x):
    out = np.linspace(-1, 1, 21)  # from the root of a tooth to its tip
    back = 0.9 * out + 0.5 * out * np.abs(out) + 0.4 * np.maximum(out, 0) ** 6
    middle = np.clip(x, -1, 1)
    for turned, half, way, color in (
        (middle, 2.2, -1, figures.BLUE),
        (6, 2.8, 1, "0.7"),
    ):
        for tooth in turned + 12 * np.arange(-2, 2):
            sides = np.r_[back - half, half - back[::-1]]
            axis.fill(tooth + sides, way * np.r_[out, out[::-1]], color=color)
        axis.axhspan(-way, -1.8 * way, color=color)
    if side := np.sign(x - middle):
        pressed = middle + side * (2.2 - back[5:16])
        axis.plot(pressed, -out[5:16], color=figures.VERMILION, linewidth=4)
    axis.set(
        xlim=(-10, 10),
        ylim=(-1.8, 1.8),
        xticks=[],
        yticks=[],
        title="motor's teeth (blue) and arm's (grey)",
    )


identified = identified_joint()
v_t, T_f = 100.0, identified.turn_period
run = simulate(identified, 1e-3, 2 * T_f, sample=1e-4, step=5e-5)
# More pictures while the gap is open.
frames = np.arange(run.t.size) % np.where(run.gap == 0, 40, 160) == 0
frames = np.flatnonzero(frames & (run.t >= T_f))
t_ms, r = 1e3 * (run.t - T_f), run.v - v_t
x_mrad = 1e3 * (run.theta_m / identified.N - run.theta_l)


def draw_turn(figure, k):
    now = frames[k]
    angle = run.theta_l[now]
    arm = figure.add_axes((0.02, 0.5, 0.25, 0.4))
    ends = [0, np.sin(angle)], [0, -np.cos(angle)]
    arm.plot(*ends, "o-", color="0.4", markevery=[-1], markersize=12)
    arm.set(xlim=(-1.2, 1.2), ylim=(-1.2, 1.2), aspect="equal", title="the arm")
    arm.axis("off")
    draw_teeth(figure.add_axes((0.36, 0.52, 0.6, 0.38)), x_mrad[now])
    speed = figure.add_axes((0.13, 0.15, 0.83, 0.28))
    speed.plot(t_ms, r)
    speed.fill_between(t_ms, -1.3, 1.3, where=run.gap == 0, color="0.85")
    speed.plot(t_ms[now], r[now], "ko")
    speed.set(
        xlabel="time [ms] (grey: gap open)",
        xlim=(0, 1e3 * T_f),
        ylabel="speed less\nits mean [rps]",
        ylim=(-1.3, 1.3),
    )


workbook.flipbook(
    draw_turn, frames.size, "arm, teeth and motor speed during a turn", name="teeth"
)
met = np.interp(run.impacts[run.impacts >= T_f], run.t, run.theta_l)
workbook.say(
    "The teeth meet at "
    f"{' and '.join(f'{place:.0f}°' for place in np.degrees(met) % 360)} of the "
    "arm's turn; 180° is the top, 360° the bottom. While the arm falls, gravity "
    "presses the teeth on one flank, while it rises on the other; in between the "
    "tooth crosses the gap. Each time the teeth meet with an impact, and the "
    "motor speed rings."
)

# %% [markdown]
# Half of the play is the *backlash* $\delta$ [rad] ([why half](glossary.md#backlash)): here 1 mrad,
# and the teeth are free within $\pm\delta$ (<a href="explore.html">change it</a>). *Predict:* at twice
# the gap, is the ring twice as high?

# %% jupyter={"source_hidden": true} tags=["hide-input"]
gaps_mrad = 0.1 * np.arange(22)
swept = [
    simulate(identified, 1e-3 * gap, 2 * T_f, sample=1e-4) for gap in gaps_mrad
]
peaks = np.array([settled_peak(each, identified) for each in swept])
lines = {f"{gaps_mrad[k]:g} mrad": (t_ms, swept[k].v - v_t) for k in (20, 10, 5)}
times = peaks[20] / peaks[10]
workbook.show(
    figures.curves(
        lines, "time [ms]", "$v - v_t$ [rps]", columns=3, xlim=(0, 1e3 * T_f)
    ),
    f"{'No' if times < 1.95 else 'Nearly'}: from 1 to 2 mrad the largest value "
    f"grows {times:.2f} times, from {peaks[10]:.2f} to {peaks[20]:.2f} rps "
    "([notebook 4](04_growth_figure11.ipynb)). Each gap has its own value, so the "
    "ring can measure it.",
)

# %% [markdown]
# ## Claim
#
# The paper: the backlash can be known from this ring, and the method "only relies on data gathered
# from the motor encoder, which is always present in a robotic joint" (abstract).
#
# ## Method
#
# Three steps: log the motor speed, fit a model of the ring, read the backlash from the fitted height.
# Here the log comes from `simulate`, which solves the equations of motion ([notebook
# 1](01_the_joint.ipynb)) of a joint that was identified from the published signals ([notebook
# 3](03_simulator_figure10.ipynb)). So the truth is known.
#
# ## Parameters

# %% tags=["parameters"]
backlash_mrad = 0.5  # half of the play; equation 10 was fitted from 0.3 to 2.1
friction_share = 0.0  # Coulomb friction on the load, over gravity's largest torque
sample_ms = 2.0  # sampling period of the log
turn_period_s = 0.4  # seconds that a turn takes, as the model believes
noise_rps = 0.1  # half-amplitude of the uniform noise on the logged speed
seed = 1  # of the noise

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.check_parameters(
    globals(),
    backlash_mrad=(0, 2.1),
    friction_share=(0, 0.5),
    sample_ms=(1.0, 2.0, 4.0, 5.0),
    turn_period_s=(0.3, 0.5),
    noise_rps=(0, 2),
    seed=range(1, 1_000_001),
)

# %% [markdown]
# ## Result
#
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
delta = 1e-3 * backlash_mrad
joint = identified._replace(load_coulomb=friction_share * identified.G)
fine = simulate(joint, delta, duration=1.2, sample=1e-4, step=5e-5)
A_true = settled_peak(fine, joint)  # of the speed before it is sampled
sampled = simulate(joint, delta, sample=1e-3 * sample_ms, step=5e-5)
t, clean = sampled.t, sampled.v


def add_noise(half_amplitude, seed):
    noise = np.random.default_rng(seed).uniform(
        -half_amplitude, half_amplitude, t.size
    )
    return Recording(t, clean + noise, v_t, T_f, "our log")


log = add_noise(noise_rps, seed)
v = log.v

# %% jupyter={"source_hidden": true} tags=["hide-input"]
DOTS = {"color": figures.ORANGE, "marker": ".", "linestyle": "", "markersize": 3}
lines = {
    "log, second and third turn": (t, v - v_t, DOTS),
    "without noise": (t, clean - v_t, figures.FIT),
}
largest = (v - v_t)[t >= T_f].max()
workbook.show(
    figures.curves(lines, "time [s]", "$r$ [rps]", xlim=(T_f, 3 * T_f)),
    f"The largest sample is {largest:.3f} rps, the true $A$ (the settled peak "
    f"without noise, before sampling) {A_true:.3f} rps: "
    f"{100 * (largest / A_true - 1):+.0f} %. Noise and the time between samples "
    "move a single sample, so we fit a model to all.",
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
#
# `replication.signature` has these equations; [notebook 5](05_signature_figure6.ipynb) writes and draws
# them.
#
# The fit: `best_fit` looks for the seven parameters, $v_t$ among them, with which the root mean
# square (RMSE) of $r - h$ is the smallest. How the paper searches for them, and how such a search
# may fail: notebooks [7](07_search_table1.ipynb) and [8](08_noise_table2.ipynb). *Predict:* how much
# will it leave?

# %%
timing = Timing(T_d=turn_period_s / 2, T_f=turn_period_s)
settings = SearchSettings(amplitude_factor=1.0, timing=timing)
with workbook.explain("turn_period_s", turn_period_s):
    best = best_fit(log, settings)
A = best.amplitude_rps

# %% jupyter={"source_hidden": true} tags=["hide-input"]
lines = {
    "log, sixth turn": (t, v - best.X.v_t, DOTS),
    "without noise": (t, clean - best.X.v_t, figures.WIDE),
    "best signature $h$": (t, h(t, best.X, timing), figures.FIT),
}
noise_sd = (v - clean).std()
apart_s = np.diff(fine.impacts[fine.impacts >= T_f][:2]).sum()
if best.rmse < 1.02 * noise_sd:
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
    f"The best signature leaves {best.rmse:.3f} rps; the noise alone has the SD "
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


estimate_mrad = equation_10(A)

# %% jupyter={"source_hidden": true} tags=["hide-input"]
off_percent = 100 * (A / A_true - 1)
lines = {
    "equation 10": (peaks, equation_10(peaks), figures.FIT),
    "estimate": ([A, A, 0], [0, estimate_mrad, estimate_mrad]),
    "truth": (A_true, backlash_mrad, figures.MARKS),
}
workbook.show(
    figures.curves(lines, "amplitude $A$ [rps]", figures.BACKLASH_LABEL, columns=3),
    f"$A$ is {off_percent:+.1f} % off the true one ([how it is defined]"
    "(glossary.md#theoretical-a)), so the backlash is "
    f"{estimate_mrad - backlash_mrad:+.3f} mrad off; equation 10 itself gives "
    f"{equation_10(A_true):.3f} mrad at the true $A$.",
)

# %% [markdown]
# ### Does the estimate survive the noise?
#
# One log cannot tell: another noise of the same size gives another estimate. So here are eight logs at
# each of five half-amplitudes. *Predict:* at which one do the estimates scatter by more than a tenth?

# %%
A_clean = best_fit(add_noise(0, 1), settings).amplitude_rps
sweep = pd.DataFrame(
    [
        (size, equation_10(best_fit(add_noise(size, k), settings).amplitude_rps))
        for size in (0.1, 0.2, 0.5, 1.0, 2.0)
        for k in range(1, 9)
    ],
    columns=["noise [rps]", "mrad"],
)
by_noise = sweep.groupby("noise [rps]")["mrad"].agg(["mean", "std", "min", "max"])
by_noise.round(3)

# %% jupyter={"source_hidden": true} tags=["hide-input"]
scatter = by_noise["std"] / by_noise["mean"]
broken = scatter.index[scatter > 0.1]
lines = {
    "eight logs each": (sweep["noise [rps]"], sweep["mrad"], DOTS),
    "without noise": ([0, 2], [equation_10(A_clean)] * 2, figures.DOTTED),
    "truth": ([0, 2], [backlash_mrad] * 2, figures.THIN),
    "the log above": (noise_rps, estimate_mrad, figures.MARKS),
}
workbook.show(
    figures.curves(lines, "noise's half-amplitude [rps]", figures.BACKLASH_LABEL),
    (
        f"From ±{broken[0]:g} rps on, where the SD of the eight is "
        f"{100 * scatter[broken[0]]:.0f} % of their mean"
        if broken.size
        else "At none of these"
    )
    + f"; at ±{scatter.index[-1]:g} rps they go from "
    f"{by_noise['min'].iloc[-1]:.2f} "
    f"to {by_noise['max'].iloc[-1]:.2f} mrad, for a true {backlash_mrad:g}. "
    f"Without noise the estimate is {equation_10(A_clean):.3f} mrad: that error "
    "is the model's.",
)

# %% [markdown]
# ## Verdict

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
quiet = by_noise.iloc[0]
workbook.verdict(
    "From the motor speed alone the best fit and equation 10 give "
    f"{estimate_mrad:.3f} mrad for a true backlash of {backlash_mrad:g} mrad; on "
    f"eight logs with a noise of ±{by_noise.index[0]:g} rps {quiet['mean']:.3f} ± "
    f"{quiet['std']:.3f} mrad (mean and SD). The best fit's $A$ is "
    f"{off_percent:+.1f} % off the theoretical {A_true:.3f} rps."
)

# %% [markdown]
# ## Try changing
#
# `make lab` opens copies of the notebooks, in `lab/`. Change a cell and run all.

# %% jupyter={"source_hidden": true} tags=["hide-input", "promises"]
workbook.try_changing(
    (
        "noise_rps = 1.0",
        "the ring of the log above can hardly be seen, yet the fit averages over "
        "twelve turns and still ends within a half of the truth",
        lambda now, was: (
            now.noise_sd > 0.9 * now.clean.std()
            and abs(now.estimate_mrad / now.backlash_mrad - 1) < 0.5
        ),
    ),
    (
        "turn_period_s = 0.408",
        "the value that Table 1 prints: turns of the model and of the log are "
        "misaligned, and the backlash comes out far too small",
        lambda now, was: now.estimate_mrad < 0.7 * was.estimate_mrad,
    ),
    (
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
hidden_rps = forgotten_mrad = missed_percent = np.nan  # your answers

# %% [markdown]
# **1.** At which half-amplitude of the uniform noise (`hidden_rps` [rps], to 0.01) is its SD as large
# as the true $A$? Why does the fit still find the ring there?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
# A uniform law's SD is its half-amplitude over sqrt(3).
hidden_rps = np.sqrt(3) * A_true
print(f"±{hidden_rps:.2f} rps; the fit averages over {t.size} samples")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(hidden_rps, 3**0.5 * A_true, to=0.01)

# %% [markdown]
# **2.** Every table of the paper has $A$ in rps. Which backlash (`forgotten_mrad` [mrad], to 0.001)
# does equation 10 give for $A$ = 0.6 rps if you forget to turn rps into rpm?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
forgotten_mrad = equation_10(0.6 / 60)
print(f"{forgotten_mrad:.3f} mrad, in place of {equation_10(0.6):.3f}")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(forgotten_mrad, equation_10(0.01), to=0.001)

# %% [markdown]
# **3.** How much of the theoretical $A$ does the largest sample of the noise-free $r(t)$ after the
# first turn miss (`missed_percent` [%], to 0.05)?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
missed_percent = 100 * (1 - (clean[t >= T_f].max() - v_t) / A_true)
print(f"it misses {missed_percent:.1f} % of A: the peak lies between two samples")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
highest = max(clean[t >= T_f])
workbook.check_answer(missed_percent, 100 - 100 * (highest - v_t) / A_true, to=0.05)

# %% [markdown]
# **What you have learnt**: an impact rings, a fit gives $A$, equation 10 gives the backlash, and one
# log does not tell how sure it is. *Next:* [the signature](05_signature_figure6.ipynb).
