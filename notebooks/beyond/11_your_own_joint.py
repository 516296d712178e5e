# %% [markdown]
# # 11 · Measure your own joint
#
# *You will estimate the backlash of a joint from a log of its speed and torque, and see when the
# sensor refuses; then measure a log of your own. Before this: notebook
# [0](../00_the_sensor.ipynb).*

# %% jupyter={"source_hidden": true} tags=["hide-input"]
import numpy as np
import pandas as pd

import backlash
import workbook
from backlash import plots
from replication import figures, joint, signature
from studies import standins
from workbook import Change

workbook.say_times("11_your_own_joint")

# %% [markdown]
# **A guide to the virtual sensor. A simulated joint replaces yours; nothing of the paper is judged
# here.**
#
# ## Claim
#
# The paper: the [backlash](../glossary.md#backlash) of a joint can be estimated from its motor
# encoder alone. For a joint that nobody has measured before that is not enough: another stiffness
# or drive gives another amplitude at the same backlash. With the motor's torque the sensor estimates
# it without taking the joint apart.
#
# ## Method
#
# *The movement*: a horizontal axis and an off-centre load whose gravity is above its friction, so
# that gravity moves the load through the gap twice a [turn](../glossary.md#turn); constant motor
# speed; twelve turns in one direction, four at least. *The log*: time, encoder position or speed,
# and torque or motor current, at 500 Hz if you can. The backlash $\delta$ is half of the total play.
#
# *Which side*: speed, position and torque are the motor's, and the backlash is the joint's. If a
# robot logs the joint's side, then the gear ratio $N$ = 1. Gear makers state the *lost motion*: the
# total play $2 \delta$ and the wind-up of the teeth. So $2 \delta$ is less than that.

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
my_log = ""  # path of a log of your own (CSV, XLSX or Parquet)
# What you know of it, as `backlash.estimate` takes it; with torque also "torque"
# (its column), "gear_ratio", "inertia_ratio" and "gravity_per_s2", as below.
my_settings = {"turn_period_s": 0.4}
bench_seed = 3  # which joint is drawn
backlash_mrad = 1.1  # of the log that is looked at closely
friction_share = (
    0.0  # Coulomb friction of the load beyond the drawn one, over gravity
)
gravity_given = 1.0  # m g r / J_l that the sensor is given, over the true one
log_turns = 12  # of each log

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.check_parameters(
    globals(),
    my_log=(my_log,),  # reading it says what is wrong with it
    my_settings=(my_settings,),
    bench_seed=range(0, 10**6),
    backlash_mrad=(0, 5),
    friction_share=(0, 2),
    gravity_given=(0.1, 10),
    log_turns=range(4, 41),
)

# %% [markdown]
# ## Result
#
# ### Your log
#
# With `my_log` the first answer is yours. A `note` says what was assumed or left out.

# %%
if my_log:
    with workbook.explain("my_log", my_log):
        print(backlash.estimate(my_log, **my_settings))

# %% [markdown]
# ### The coupling's torque
#
# The joint is here a stand-in of notebook [9](../09_stand_ins_tables3_4.ipynb): other stiffness,
# gravity and gains than the paper's, some friction, an encoder of 19 bits. The motor of the inertia
# $J_m$ [kg m²] turns at the speed $\omega_m$ [rad/s] under its torque $\tau_m$ [N m]. So the two
# signals give the torque of the coupling, but for the motor's friction $\tau_f$ [N m]:
#
# $$\tau_l = N \left(\tau_m - J_m\, \dot\omega_m - \tau_f\right)$$
#
# *Predict:* what does it look like while the tooth crosses the gap?

# %%
drawn = standins.draw_bench(np.random.default_rng(bench_seed))
gravity_nm = drawn.joint.G
friction_nm = drawn.joint.load_coulomb + friction_share * gravity_nm
my_joint = drawn.joint._replace(load_coulomb=friction_nm)
backlash_rad = 1e-3 * backlash_mrad


def log_joint(delta_rad, seed, of=my_joint):  # a table as a recorder writes it
    rng = np.random.default_rng((bench_seed, seed))
    turning = of._replace(start_angle=rng.uniform(0, signature.TURN))
    run = joint.simulate(turning, delta_rad, log_turns * turning.turn_period)
    step = turning.encoder_step
    read = standins.read_encoder(turning, run.t, run.theta_m, step, "encoder")
    speed = read.v + rng.normal(0, drawn.noise_rps, read.v.size)
    noise = rng.normal(0, 0.01 * gravity_nm / of.N, read.v.size)
    torque = run.torque[:-1] + noise
    columns = {"time [s]": read.t, "speed [rps]": speed, "torque": torque}
    return pd.DataFrame(columns)


# %%
log = log_joint(backlash_rad, 0)
TURN = 200  # samples; the mean turn has less noise
whole = log[: len(log) // TURN * TURN].to_numpy().reshape(-1, TURN, 3)
_, speed, torque = whole[1:].mean(axis=0).T
omega = 2 * np.pi * np.r_[speed[-1], speed, speed[0]]
acceleration = (omega[2:] - omega[:-2]) / (2 * 2e-3)
tau_l = my_joint.N * (torque - torque.mean() - my_joint.J_m * acceleration)

# %% jupyter={"source_hidden": true} tags=["hide-input"]
amplitude = np.abs(2 * np.fft.rfft(tau_l)[1] / TURN)
small = np.abs(tau_l) < 0.1 * amplitude
t_ms = 2 * np.arange(TURN)
figure, axis = figures.panel(2.6)
of_motor = my_joint.N * (torque - torque.mean())
axis.plot(t_ms, of_motor, label="$N \\tau_m$", **figures.LOG)
axis.plot(t_ms, tau_l, label="$\\tau_l$", **figures.FIT)
shade = {"where": small, "color": "0.9", "label": "$\\tau_l$ below 10 %"}
axis.fill_between(t_ms, -amplitude, amplitude, **shade)
axis.set(xlabel="time in the mean turn [ms]", ylabel="torque less its mean [N m]")
of_sine_ms = 2 * TURN * 2 * np.arcsin(0.1) / np.pi
seen = 2 * small.sum() > 1.2 * of_sine_ms
workbook.show(
    figures.finish(figure, 3),
    f"$\\tau_l$ stays below a tenth of its first harmonic, {amplitude:.1f} N m, "
    f"for {2 * small.sum()} ms of the turn; gravity's sine alone would for "
    f"{of_sine_ms:.0f} ms. "
    + (
        "Nothing holds the load in the gap; then it rings, because the teeth meet "
        "with an impact."
        if seen
        else "So no gap is to be seen."
    )
    + f" Half of the play is {backlash_mrad:g} mrad.",
)

# %% [markdown]
# ### The model of the load
#
# No model of the drive is needed: the measured motor angle $\theta_m$ [rad] drives the load. Its
# angle $\theta_l$ [rad] moves by
#
# $$\begin{aligned} J_l\, \ddot\theta_l &= \tau_l - m g r \left[\sin\theta_l + s\,\text{sign}(\dot\theta_l)\right] \\
# \tau_l &= K_s\, p_\delta\!\left(\frac{\theta_m}{N} - \theta_l\right) + \text{damping} \end{aligned}$$
#
# with the inertia $J_l$ [kg m²], gravity $m g r$ [N m], friction $s$ over gravity, stiffness $K_s$ [N
# m/rad], and $p_\delta$ [rad], what the displacement exceeds $\pm\delta$ by. This gives the torque
# that the motor should need; the sensor fits it, harmonic by harmonic, to the measured one. Two
# numbers of the load are given, $J_l/(N^2 J_m)$ and $m g r/J_l$ [1/s²]; stiffness, damping, friction,
# losses and $\delta$ are fitted, and the two corrected as far as the log says more than what was
# known of them. $\delta$ is proportional to the $m g r/J_l$ that the fit ends at. *Predict:* how wide
# is the interval, if gravity is known to 5 % and inertia to 10 %?

# %%
ratios = joint.ratios(my_joint)
load = {
    "torque": "torque",
    "gear_ratio": my_joint.N,
    "inertia_ratio": ratios["J_l/(N^2 J_m)"],
    "gravity_per_s2": gravity_given * ratios["G/J_l"],
}
by_torque = backlash.estimate(log, **load)
print(by_torque)
if by_torque.trace:
    workbook.show_figure(
        "own_joint_log",
        plots.estimate_figure(by_torque),
        f"(a) Three of the {log_turns} turns of the torque of a simulated joint, "
        "measured and by the model that is fitted to it. (b) Residual of the "
        "whole log.",
    )


# %% jupyter={"source_hidden": true} tags=["hide-input"]
if by_torque.backlash_interval_rad:
    low, high = 1e3 * np.array(by_torque.backlash_interval_rad)
    holds = "holds" if low <= backlash_mrad <= high else "does not hold"
    finding = (
        f"{by_torque.verdict}, {1e3 * by_torque.backlash_rad:.3f} mrad, whose "
        f"interval of {low:.3f} to {high:.3f} mrad {holds} the true "
        f"{backlash_mrad:g} mrad"
    )
    of_gravity = by_torque.joint["gravity_per_s2"][0] / ratios["G/J_l"]
    workbook.say(
        f"The sensor says: {finding}. Gravity's 5 % alone would make it "
        f"±{50 * by_torque.backlash_rad:.3f} mrad; stiffness, damping, friction "
        "and losses are fitted to the same log. Gravity was given as "
        f"{gravity_given:g} times the true one, the fit ends at {of_gravity:.3f} "
        "times."
    )
else:
    finding = f"no answer ({by_torque.reason})"
    workbook.say(f"No interval. The sensor says: {by_torque.summary}")

# %% [markdown]
# Compare the printed lines with the joint's data sheet: a stiffness or an inertia that is not the
# joint's says that an input is wrong.
#
# ### By the speed alone
#
# The same log without its torque has the paper's amplitude $A$ [rps] as an index, and no backlash.

# %%
by_speed = backlash.estimate(log, turn_period_s=my_joint.turn_period)
print(by_speed)

# %% [markdown]
# ### What it refuses
#
# A sensor must refuse what it cannot judge. *Predict:* which of these logs are answered?

# %%
rubbed = drawn.joint._replace(load_coulomb=1.2 * gravity_nm)
noise_rps = np.random.default_rng(bench_seed).normal(0, 5, len(log))
loud = log.assign(**{"speed [rps]": log["speed [rps]"] + noise_rps})
odd = {
    "without backlash": (log_joint(0.0, 1), load),
    "friction above gravity": (log_joint(backlash_rad, 2, rubbed), load),
    "noise of 5 rps": (loud, load),
    "a torque of the wrong sign": (log.assign(torque=-log["torque"]), load),
    "half of the gear ratio": (log, load | {"gear_ratio": my_joint.N / 2}),
}
answers = {
    name: backlash.estimate(record, **given)
    for name, (record, given) in odd.items()
}
said = {name: answer.summary for name, answer in answers.items()}
pd.DataFrame({"answer": said})

# %% jupyter={"source_hidden": true} tags=["hide-input"]
refused = [
    name for name, answer in answers.items() if answer.verdict == "cannot tell"
]
answered = [name for name in answers if name not in refused]
workbook.say(
    f"Answered: {'; '.join(answered) or 'none'}. Refused: "
    f"{'; '.join(refused) or 'none'}, each for its reason: an answer would be a "
    "guess."
)

# %% [markdown]
# ## Verdict
#
# No number of the paper is judged here.

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
workbook.verdict(
    f"What the sensor says of the log of {backlash_mrad:g} mrad by the torque: "
    f"{finding}; by the speed alone: no answer ({by_speed.reason}). Of "
    f"{len(answers)} odd logs the sensor refuses {len(refused)}"
    + (f", and answers: {'; '.join(answered)}." if answered else ".")
)

# %% [markdown]
# ## Try changing
#
# `my_log = "log.csv"`, with what you know of it in `my_settings`, measures a log of your own; many
# logs, and the command line: the [guide](../guide.md).

# %% jupyter={"source_hidden": true} tags=["hide-input", "promises"]
workbook.try_changing(
    Change(
        "backlash_mrad = 0.5",
        "a smaller gap is crossed sooner, so that the torque is near zero for a "
        "shorter time; the interval still holds the truth",
        lambda now, was: (
            now.small.sum() < was.small.sum()
            and now.low <= now.backlash_mrad <= now.high
        ),
    ),
    Change(
        "gravity_given = 1.1",
        "the fit ends at less than 1.1 times the true gravity, for the log says "
        "that it is smaller, and the estimate grows with it",
        lambda now, was: (
            was.of_gravity < now.of_gravity < 1.1
            and now.by_torque.backlash_rad > was.by_torque.backlash_rad
        ),
    ),
    Change(
        "friction_share = 1.2",
        "friction above gravity holds the load on one flank, it never crosses the "
        "gap, and the sensor refuses",
        lambda now, was: (
            now.by_torque.backlash_rad is None
            and now.by_torque.verdict == "cannot tell" != was.by_torque.verdict
        ),
    ),
)

# %% [markdown]
# ## Exercises
#
# Answer by the `name`; the cell below says *right* or *not yet*. Solutions are folded in the
# committed notebooks.

# %%
gravity_percent = most_missed_percent = growth = np.nan  # your answers

# %% [markdown]
# **1.** The load is a point at the arm $r$, which is given 4 % too short. By how much is the given
# $m g r/J_l$ too large (`gravity_percent` [%], to 0.1)? Ask the sensor again: by how much does the
# estimate change?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
gravity_percent = 100 * (1 / 0.96 - 1)  # m g r / (m r^2) = g / r
shorter = load | {"gravity_per_s2": load["gravity_per_s2"] / 0.96}
again = backlash.estimate(log, **shorter)
print(f"{gravity_percent:.1f} %; before: {by_torque.summary}; now: {again.summary}")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(gravity_percent, 100 * 0.04 / 0.96, to=0.1)

# %% [markdown]
# **2.** A pure sine of 21 Hz is sampled at 84 Hz. How much of its peak can the largest sample miss
# at most (`most_missed_percent` [%], to 0.5)? And at 500 Hz?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
# Half a sampling period from the peak.
most_missed_percent = 100 * (1 - np.cos(np.pi * 21 / 84))
at_500_hz = 100 * (1 - np.cos(np.pi * 21 / 500))
print(f"{most_missed_percent:.1f} %; at 500 Hz {at_500_hz:.1f} %")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
nearest = np.cos(np.pi / (84 / 21))  # 84 / 21 samples a period
workbook.check_answer(most_missed_percent, 100 * (1 - nearest), to=0.5)

# %% [markdown]
# **3.** Four tests, 90 days apart, gave 0.50, 0.58, 0.69 and 0.75 mrad. By how much does the line of
# least squares through them grow (`growth` [mrad a year], to 0.01)?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
tests_mrad = [0.50, 0.58, 0.69, 0.75]
growth = 365.25 * np.polyfit(90 * np.arange(4), tests_mrad, 1)[0]
print(f"{growth:.2f} mrad a year; the intervals of the tests say how sure that is")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
# The slope of four points, each a test apart: the outer pair weighs thrice.
slope = (3 * (0.75 - 0.50) + (0.69 - 0.58)) / 10  # mrad a test
workbook.check_answer(growth, slope / 90 * 365.25, to=0.01)

# %% [markdown]
# **What you have learnt**: the torque tells when no tooth carries the load, a model of the load makes
# a backlash of that, and a sensor must refuse. *Next:* [what a log tells](12_what_a_log_tells.ipynb).
