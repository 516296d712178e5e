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
# # 0 · Start here: the sensor
#
# *You will see what backlash is, how it shows in the motor speed, and how a log gives it. Run time: 10 s.*
#
# ## Claim
#
# The backlash of a robot's joint can be known from the motor's encoder alone: the method "only relies on data gathered
# from the motor encoder, which is always present in a robotic joint" (abstract).
#
# ## Method
#
# The arm turns about a horizontal axis, at constant speed. Gravity presses the teeth of the gear on one flank while the
# load rises, on the other while it falls. So the teeth cross the gap twice in each turn of the load. Each time they
# meet with an impact, and the motor speed rings. The larger the [backlash](glossary.md#backlash), the larger the ring.
#
# **1. The log.** The encoder gives the motor speed $v(t)$ [rps]. Less the commanded speed $v_t$ [rps] it is
#
# $$r(t) = v(t) - v_t \tag{11}$$
#
# **2. The fit.** The [signature](glossary.md#signature) is a model of $r(t)$. An impact leaves a damped oscillation of
# the amplitude $A$ [rps], the damping $\tau$ [1/s] and the frequency $\omega$ [rad/s], from $T_1$ to $T_2$ [s] after
# the instant $t_0$ [s]:
#
# $$d_b(t - t_0) = A\,e^{-(t - (t_0 + T_1))\tau} \sin\omega(t - t_0)
# \quad\text{for}\quad t_0 + T_1 \le t \le t_0 + T_2, \text{ else } 0 \tag{5}$$
#
# The second impact of a turn comes $T_d$ [s], half a turn, later and has the opposite sign. The next turn comes $T_f$
# [s] later:
#
# $$f(t - t_0) = d_b(t - t_0) - d_b(t - (t_0 + T_d)) \tag{6}$$
#
# $$h(t) = \sum_{i=1}^{n} f(t - (t_0 + (i - 1)\,T_f)) \tag{7}$$
#
# The search looks for the parameters with the smallest root mean square (RMSE) of $r(t) - h(t)$.
#
# **3. The backlash.** A cubic turns the fitted $A$ into the backlash $\delta$ [rad]:
#
# $$\delta = 10^{-6} \left(-0.0018\, A^3 + 0.4323\, A^2 + 9.2524\, A + 34.0313\right)
# \quad\text{with } A \text{ in rpm} \tag{10}$$
#
# Other methods measure the time in the gap or the speed there: Villwock and Pacas (IEEE Transactions on Industrial
# Electronics, 2009) integrate the motor's speed over the time in the gap. Nordin and Gutman
# ([2002](https://doi.org/10.1016/S0005-1098(02)00047-X)) survey models and control of systems with backlash.

# %%
import json
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
noise_rps = 0.1  # half-amplitude of the uniform noise on the logged speed
noise_law = "uniform"  # or "normal", with the same SD
seed = 1  # of the noise
population = 60  # points that the search tries in a generation
runs = 25  # of the search

# %% tags=["plumbing"]
workbook.check_parameters(
    backlash_mrad=(backlash_mrad, workbook.Interval(0, 2.1)),
    noise_rps=(noise_rps, workbook.Interval(0, 0.5)),
    noise_law=(noise_law, ("uniform", "normal")),
    seed=(seed, workbook.Interval(1, 1e6)),
    population=(population, range(10, 1001)),
    runs=(runs, range(1, 101)),
)
plt.rcParams.update(teeth.STYLE)
plt.ion()


# The drawing of a joint, and the picture with a slider: SVG, which needs no network.
JOINT = """
<svg viewBox="0 0 640 215" style="max-width: 50rem; background: white" font-family="sans-serif" font-size="13"
 text-anchor="middle" role="img" aria-label="Left: encoder, motor, gear and load. Right: the motor's tooth between the
 flanks of the load; its centre moves freely between minus delta and delta.">
<path d="M60 110H260" stroke="black" stroke-width="4"/>
<g fill="white" stroke="black"><path d="M10 92H70V128H10ZM92 80H172V140H92Z"/></g>
<g fill="none" stroke="#0072B2" stroke-width="3" stroke-dasharray="3 3"><circle cx="210" cy="110" r="10"/>
<circle cx="250" cy="110" r="30"/></g>
<path d="M250 110L300 150" stroke="#777" stroke-width="6"/><path d="M250 110V195" stroke="#777" stroke-dasharray="2 4"/>
<circle cx="300" cy="150" r="11"/><path d="M300 160V198M295 190L300 200L305 190" stroke="black" fill="none"/>
<text x="40" y="114">encoder</text><text x="132" y="107">motor</text><text x="132" y="126">angle θₘ</text>
<text x="225" y="68">gear N : 1</text><text x="297" y="130">load</text><text x="266" y="172">θₗ</text>
<text x="334" y="190">gravity</text>
<g fill="#777"><path d="M362 75H413L427 140H362ZM618 75H567L553 140H618ZM336 60H344V164H336ZM636 60H644V164H636Z"/>
<path d="M336 152H644V166H336Z"/></g>
<path d="M344 110l3 -7 4 14 4 -14 4 14 3 -7M618 110l3 -7 4 14 4 -14 4 14 3 -7" stroke="black" fill="none"/>
<path d="M400 40H580V60H540L525 130H455L440 60H400Z" fill="#0072B2"/>
<path d="M460 44V192M490 44V192M520 44V192" stroke="black" stroke-dasharray="2 3"/>
<path d="M421 110H451M427 106L421 110L427 114M445 106L451 110L445 114" stroke="black" fill="none"/>
<path d="M529 110H559M535 106L529 110L535 114M553 106L559 110L553 114" stroke="black" fill="none"/>
<g font-style="italic"><text x="436" y="102">δ</text><text x="544" y="102">δ</text></g>
<text x="458" y="206">−δ</text><text x="490" y="206">centre</text><text x="522" y="206">δ</text>
<text x="490" y="32">motor's tooth</text><text x="590" y="182">flanks of the load</text></svg>
"""
GAP = """
<div id="gap"><label>backlash δ <input type="range" min="0" max="21" value="VALUE" style="width: 20rem"
 aria-label="backlash in tenths of a mrad"></label> <output></output>
<svg viewBox="0 0 740 225" style="max-width: 60rem; background: white" font-family="sans-serif" font-size="12"
 role="img" aria-label="the gap between the teeth, the motor speed over a turn, and equation 10">
<path d="M30 30H200V55H160L147 125H83L70 55H30Z" fill="#0072B2"/><path d="M0 160H230V175H0Z" fill="#777"/>
<path class="left" d="M10 70H73L86 135V160H10Z" fill="#777"/>
<path class="right" d="M220 70H157L144 135V160H220Z" fill="#777"/>
<path d="M115 20V195" stroke="black" stroke-dasharray="2 3"/>
<path class="left" d="M115 20V195" stroke="#E69F00"/><path class="right" d="M115 20V195" stroke="#E69F00"/>
<text x="72" y="212">tooth's centre, ±δ</text>
<path d="M290 20V195H490M530 20V195H730M290 107H490" fill="none" stroke="#999"/>
<text x="290" y="14">r [rps], −1.3 to 1.3</text><text x="300" y="212">one turn of the load, 0.4 s</text>
<text x="530" y="14">δ [mrad], 0 to 2.2</text><text x="580" y="212">largest r [rps], 0 to 1.3</text>
<path id="gap-speed" fill="none" stroke="#0072B2"/><path id="gap-curve" fill="none" stroke="black"/>
<g id="gap-dots" fill="#0072B2"></g><path id="gap-at" fill="none" stroke="#E69F00" stroke-width="2"/>
<text x="640" y="180">equation 10</text><path d="M610 176H635" stroke="black"/></svg></div>
<script>{
const data = DATA, gap = document.getElementById("gap"), part = name => document.getElementById("gap-" + name);
const x = A => 530 + 200 * A / 1.3, y = delta => 195 - 175 * delta / 2.2;
const line = points => "M" + points.map(point => point.map(each => each.toFixed(1)).join(" ")).join("L");
part("curve").setAttribute("d", line(data.peak.map((A, k) => [x(A), y(data.equation_10[k])])));
part("dots").innerHTML = data.peak.map((A, k) => `<circle cx="${x(A)}" cy="${y(k / 10)}" r="2"/>`).join("");
const show = k => {
  for (const [side, sign] of [["left", -1], ["right", 1]])
    gap.querySelectorAll("." + side).forEach(each => each.setAttribute("transform", `translate(${1.8 * sign * k})`));
  part("speed").setAttribute("d", line(data.r[k].map((r, i) => [290 + 200 * i / data.r[k].length, 107 - 67 * r])));
  part("at").setAttribute("d", line([[530, y(k / 10)], [x(data.peak[k]), y(k / 10)], [x(data.peak[k]), 195]]));
  gap.querySelector("output").textContent = `${(k / 10).toFixed(1)} mrad: largest r ${data.peak[k].toFixed(2)} rps`;
};
const slider = gap.querySelector("input");
slider.addEventListener("input", () => show(+slider.value));
show(+slider.value);
}</script>
"""


# %% [markdown]
# ## Result
#
# ### The teeth in the gap
#
# One turn of the load. Above, the load on its arm, and the teeth: blue is the motor's tooth, orange the flank of the
# load that is pressed. Below, the motor speed. Time passes five times slower while the gap is open.
#
# The joint was identified from the published signals ([notebook 9](09_identification_of_the_joint.ipynb)). `simulate`
# integrates its equations of motion ([notebook 1](01_the_joint.ipynb)). It is compiled when it is first called: five
# seconds.

# %%
delta_rad, joint = 1e-3 * backlash_mrad, identified_joint()
v_t, T_f = joint.commanded_speed_rps, joint.turn_period_s
run = simulate(joint, delta_rad, duration_s=1.6, sample_s=1e-4, step_s=5e-5)
animation = workbook.plain_animation(
    teeth.animate_teeth(run, joint), words="arm, teeth and motor speed"
)
HTML(animation + JOINT)

# %% [markdown]
# A motor turns a load through a gear of ratio $N$. The encoder measures the motor's angle $\theta_m$ [rad]; nothing
# measures the load's angle $\theta_l$ [rad]. The *displacement* $\Delta\theta = \theta_m / N - \theta_l$ [rad] is the
# place of the centre of the motor's tooth between the flanks of the load. The tooth is free while $|\Delta\theta| \le
# \delta$: the backlash $\delta$ is *half* of the play. Beyond $\pm\delta$ it presses on a flank. Springs stand for the
# elasticity of shaft and teeth. The paper's figures 1, 2, 3 and 8 are sketches of the same.

# %% [markdown]
# ### Turn up the backlash
#
# Drag the slider: the gap opens from nothing to 2.1 mrad, and the ring grows with it. Its largest value (dots) moves
# along a curve. Equation 10 is the paper's formula for that curve: it makes the ring a sensor.

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
shown = {
    "r": [np.round(each.motor_speed_rps[4000::10] - v_t, 2).tolist() for each in joints],
    "peak": np.round(peaks, 4).tolist(),
    "equation_10": np.round(1e3 * equation_10(peaks), 4).tolist(),
}
HTML(GAP.replace("DATA", json.dumps(shown)).replace("VALUE", f"{10 * backlash_mrad:.0f}"))

# %% [markdown]
# ### 1. The log
#
# Twelve turns, sampled every 2 ms, with noise: as the authors' logs are. The true backlash is `backlash_mrad`; from
# here on only the log is used.

# %%
log = simulate(joint, delta_rad, step_s=5e-5)
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
# The signature repeats in every turn, so the parameters that fit the mean of the twelve turns best also fit the log
# best: the fit takes the mean turn.


# %%
T_d = T_f / 2
mean_turn = v[:-1].reshape(12, -1).mean(axis=0)


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
    h = signature(t[: mean_turn.size], *shape)
    return np.sqrt(np.mean((mean_turn - v_t - h) ** 2, axis=1))


# %% [markdown]
# The paper's search is CMA-ES, which is random: a generation of points is drawn from a normal distribution, and the
# better half of them moves the distribution ([notebook 7](07_protocol_table1.ipynb)). It looks within the bounds of
# Table 1. Here a run has 90 generations.

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
one = slice(5 * mean_turn.size, 6 * mean_turn.size)
axis.plot(t[one], (v - best_v_t)[one], ".", color="0.75", label="log, sixth turn")
axis.plot(t[one], mean_turn - best_v_t, ".", label="mean of twelve turns")
axis.plot(t[one], fit[one], label="signature $h$")
axis.axhline(A, color="C1", linestyle=":", label=f"$A$ = {A:.3f} rps = {60 * A:.1f} rpm")
axis.set(xlabel="time [s]", ylabel="$v - v_t$ [rps]")
_ = axis.legend(loc="upper center", ncols=4, bbox_to_anchor=(0.5, 1.2))

# %% [markdown]
# ### 3. From the amplitude to the backlash
#
# Above, equation 10. Its $A$ is the [theoretical](glossary.md#theoretical-a) one: in our reading the peak of the
# noise-free speed before it is sampled. Below, the amplitudes and misfits of all runs. A run may end in a wrong local
# minimum, so we take the lowest misfit. The paper takes the mean of 30 single runs, wrong ones included
# ([notebook 8](08_noise_table2.ipynb)). Even right ones differ in $A$ by up to 3 %: within one sample of 2 ms the
# instant $T_1$ does not change the fit, but it changes $A$.

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
# - To learn the paper: [1](01_the_joint.ipynb) the joint, [2](02_dead_zone_figure9.ipynb) the gap,
#   [3](03_simulator_figure10.ipynb) the simulator, [4](04_growth_figure11.ipynb) how the disturbance grows,
#   [5](05_signature_figure6.ipynb) the signature, [6](06_characteristic_figure12.ipynb) equation 10,
#   [7](07_protocol_table1.ipynb) CMA-ES step by step, [8](08_noise_table2.ipynb) noise.
# - To measure a joint of your own, with an interval: [12](beyond/12_your_own_joint.ipynb).
# - To review the replication: the [report](../results/report.html).
#
# How to work: `make lab` opens copies of the notebooks, in `lab/`. Change the cell under *Parameters* and run all
# cells; a wrong value is refused; the message lists valid ones. The exercises' solutions are folded. `python -m
# workbook diff --lab` lists the verdicts that a change moved. The [glossary](glossary.md) has the terms.

# %% [markdown]
# ## Verdict

# %%
off_percent = 100 * (abs(found[:, 0]) / theoretical_A - 1)
strays = (abs(off_percent) > 15).sum()
error_rad = found_rad - delta_rad
error = f"{100 * error_rad / delta_rad:+.1f} %" if delta_rad else f"{1e3 * error_rad:+.3f} mrad"
print(
    f"From the motor speed alone: {1e3 * found_rad:.3f} mrad by the best of {runs} searches and equation 10, for a "
    f"true backlash of {backlash_mrad:g} mrad ({error}). {strays} of the runs miss the theoretical A "
    f"by more than 15 %; the mean of all runs is {off_percent.mean():+.1f} % off, the best run "
    f"{100 * (A / theoretical_A - 1):+.1f} %."
)

# %% tags=["plumbing"]
fitted = dict(zip(box, best, strict=True)) | {"T_f": T_f}
while fitted["t0"] + fitted["T1"] > T_d:  # the same signature, from its first impact on
    fitted |= {"t0": fitted["t0"] - T_d, "A": -fitted["A"]}
explorer = {
    "record": np.round(v, 4).tolist(),
    "dt": round(t[1], 9),
    "fitted": {
        name: round(fitted[name], 4 if name in ("tau", "omega") else 6)  # as the sliders have it
        for name in ("A", "t0", "tau", "omega", "v_t", "T2", "T1", "T_f")
    },
    "bounds": box | {"A": (-1.5, 1.5), "t0": (-0.2, 0.6), "T_f": (0.392, 0.412)},
    "turns": 12,
    "population": population,
    "printed_T_f": published.value("table1.T_f.max"),
    "backlash_rad": delta_rad,
}
del explorer["bounds"]["v_t"]
workbook.export(pages={"signature_explorer": explorer})

# %% [markdown]
# ## Try changing
#
# 1. `backlash_mrad = 0.0`: a joint without backlash. The sensor does not say 0: equation 10 gives 0.034 mrad at $A$ =
#    0, and noise and gravity leave an $A$ above 0.
# 2. `population = 300`: hardly a run ends in a wrong minimum; the best run stays where it was.
# 3. `noise_rps = 0.0`: a run still ends in a wrong minimum, and the best run errs as much: search and model make these
#    errors, not the noise.
#
# ## Exercises
#
# **1.** How much of the error comes from equation 10, and how much from $A$?

# %% tags=["solution"]
of_equation = equation_10(theoretical_A) - delta_rad
of_amplitude = found_rad - equation_10(theoretical_A)
assert np.isclose(of_equation + of_amplitude, found_rad - delta_rad)
print(f"equation 10: {1e6 * of_equation:+.1f} urad, the fitted A: {1e6 * of_amplitude:+.1f} urad")

# %% [markdown]
# **2.** Every table of the paper has $A$ in rps. Which backlash does equation 10 give for every log of the paper if
# you forget to turn rps into rpm?

# %% tags=["solution"]
forgotten_mrad = 1e3 * equation_10(amplitudes / 60)
assert forgotten_mrad.max() - forgotten_mrad.min() < 0.02
print(f"{forgotten_mrad.min():.3f} to {forgotten_mrad.max():.3f} mrad, whatever A is")

# %% [markdown]
# **3.** Why not read the largest sample instead of a fit? Compare the largest $r(t)$ after the first turn, of the
# log and without noise, with the theoretical $A$.

# %% tags=["solution"]
largest, largest_clean = ((each - v_t)[t >= T_f].max() for each in (v, clean))
assert largest_clean <= theoretical_A
assert largest <= largest_clean + np.abs(v - clean).max()
print(
    f"theoretical A {theoretical_A:.3f}, largest sample {largest_clean:.3f} without noise, {largest:.3f} rps with it"
)
