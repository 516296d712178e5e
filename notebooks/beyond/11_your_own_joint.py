# %% [markdown]
# # 11 · Measure your own joint
#
# *You will estimate the backlash of a joint from a log of its speed and torque in thirty lines of your
# own, compare the sensor, and see when it refuses; then measure a log of your own. Before this:
# notebook [0](../00_the_sensor.ipynb).*

# %% jupyter={"source_hidden": true} tags=["hide-input"]
import numpy as np
import pandas as pd

import backlash
import workbook
from backlash import plots
from replication import figures, joint, signature
from studies import datasheet, simulated_joints, standins

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
# gravity and gains than the paper's, some friction, an encoder of 19 bits. First a *clean* log of it.
# The motor of the inertia $J_m$ [kg m²] turns at the speed $\omega_m$ [rad/s] under its torque
# $\tau_m$ [N m]. So the two signals give the torque of the coupling, but for the motor's friction
# $\tau_f$ [N m]:
#
# $$\tau_l = N \left(\tau_m - J_m\, \dot\omega_m - \tau_f\right)$$
#
# *Predict:* what does it look like while the tooth crosses the gap?

# %%
drawn = standins.draw_bench(np.random.default_rng(bench_seed))
gravity_nm = drawn.joint.G
my_joint = drawn.joint._replace(
    load_coulomb=drawn.joint.load_coulomb + friction_share * gravity_nm
)
backlash_rad = 1e-3 * backlash_mrad


# A table as a recorder writes it; `loud` is a factor on its noise.
def log_joint(delta_rad, seed, of=my_joint, loud=1.0):
    rng = np.random.default_rng((bench_seed, seed))
    turning = of._replace(start_angle=rng.uniform(0, signature.TURN))
    run = joint.simulate(turning, delta_rad, log_turns * turning.turn_period)
    step = loud * turning.encoder_step
    read = standins.read_encoder(turning, run.t, run.theta_m, step, "encoder")
    speed = read.v + loud * rng.normal(0, drawn.noise_rps, read.v.size)
    noise = loud * rng.normal(0, 0.01 * gravity_nm / of.N, read.v.size)
    columns = {"time [s]": read.t, "speed [rps]": speed}
    return pd.DataFrame(columns | {"torque": run.torque[:-1] + noise})


# %%
TURN = 200  # samples
s = 2j * np.pi * np.arange(1, TURN // 2 + 1) / my_joint.turn_period  # i omega_k


def harmonics(log, J_m=my_joint.J_m):  # of omega_m and of tau_l
    turns = log[: len(log) // TURN * TURN].to_numpy().reshape(-1, TURN, 3)
    _, speed, torque = turns[1:].mean(axis=0).T  # the mean turn has less noise
    omega = np.fft.rfft(2 * np.pi * speed)[1:]
    return omega, my_joint.N * (np.fft.rfft(torque)[1:] - J_m * s * omega)


def in_time(harmonics):  # less the mean
    return np.fft.irfft(np.r_[0, harmonics], TURN)


clean = log_joint(backlash_rad, 0, loud=0.0)
tau_l = in_time(harmonics(clean)[1])

# %% jupyter={"source_hidden": true} tags=["hide-input"]
amplitude = np.abs(2 * np.fft.rfft(tau_l)[1] / TURN)
small = np.abs(tau_l) < 0.1 * amplitude
t_ms = 1e3 * my_joint.turn_period / TURN * np.arange(TURN)
figure, axis = figures.panel(2.6)
axis.plot(t_ms, tau_l, label="$\\tau_l$", **figures.FIT)
axis.fill_between(
    t_ms,
    -amplitude,
    amplitude,
    where=small,
    color="0.9",
    label="$\\tau_l$ below 10 %",
)
axis.set(xlabel="time in the mean turn [ms]", ylabel="torque less its mean [N m]")
of_sine_ms = t_ms[1] * TURN * 2 * np.arcsin(0.1) / np.pi
open_ms = t_ms[1] * small.sum()
workbook.show(
    figures.finish(figure, 3),
    f"$\\tau_l$ stays below a tenth of its first harmonic, {amplitude:.1f} N m, "
    f"for {open_ms:.0f} ms of the turn; gravity's sine alone would for "
    f"{of_sine_ms:.0f} ms. Longer is the time in which nothing holds the load, in "
    f"the gap; half of the play is {backlash_mrad:g} mrad. An impact ends it, and "
    "rings.",
)

# %% [markdown]
# ### Gravity, two springs, and least squares
#
# The torque moves the load, of the inertia $J_l$ [kg m²], against gravity $m g r \sin\theta_l$ [N m].
# It turns evenly but for some mrad, so gravity is a sine in time, and all the rest follows: with $s_k =
# i k\, 2\pi / T$ for the harmonic $k$ of a turn of $T$ seconds, the displacement of the teeth is
#
# $$\left(\frac{\theta_m}{N} - \theta_l\right)_k = \frac{\omega_{m,k}}{s_k N} - \frac{\tau_{l,k}}{s_k^2 J_l}
# \quad\text{but for gravity, in } k = 1$$
#
# While the teeth touch, a spring of the stiffness $K_s$ [N m/rad] on either flank gives
#
# $$\frac{\theta_m}{N} - \theta_l = \delta\,\text{sign}(\tau_l) + \frac{\tau_l}{K_s}$$
#
# So each sample outside the gap is a linear equation of five unknowns: the mean, gravity's cosine and
# sine, $1/K_s$ and $\delta$. *Predict:* what does the torque look like over the displacement?


# %%
def fit_turn(log, J_m=my_joint.J_m, J_l=my_joint.J_l):
    omega, torque = harmonics(log, J_m)
    tau_l = in_time(torque)
    moved = in_time(omega / (s * my_joint.N) - torque / (s**2 * J_l))
    angle = 2 * np.pi * np.arange(TURN) / TURN
    of_gravity = np.c_[np.ones(TURN), np.cos(angle), np.sin(angle)]
    unknowns = np.c_[of_gravity, tau_l, np.sign(tau_l)]
    touching = np.abs(tau_l) > 0.1 * np.abs(2 * torque[0] / TURN)
    solved, *_ = np.linalg.lstsq(unknowns[touching], moved[touching])
    gravity = np.hypot(*solved[1:3]) * J_l * abs(s[0]) ** 2
    x = moved - of_gravity @ solved[:3]
    return {"K_s": 1 / solved[3], "m g r": gravity, "delta": solved[4]}, x, tau_l


log = log_joint(backlash_rad, 0)
of_clean, x, tau_x = fit_turn(clean)
of_log, *_ = fit_turn(log)
true = {"K_s": my_joint.K_s, "m g r": gravity_nm, "delta": backlash_rad}
springs = pd.DataFrame({"true": true, "clean log": of_clean, "noisy log": of_log})
springs.map("{:.4g}".format)

# %% jupyter={"source_hidden": true} tags=["hide-input"]
line = np.linspace(x.min(), x.max(), 200)
delta = of_clean["delta"]
two_springs = of_clean["K_s"] * (line - np.clip(line, -delta, delta))
lines = {
    "a turn of the clean log": (1e3 * x, tau_x, figures.LOG),
    "two springs": (1e3 * line, two_springs, figures.FIT),
}
off_percent = 100 * (springs["clean log"] / springs["true"] - 1)
workbook.show(
    figures.curves(lines, "displacement of the teeth [mrad]", "$\\tau_l$ [N m]"),
    "Two lines of the slope $K_s$, and between them the gap, $2\\delta$ wide. "
    f"From the clean log $K_s$ is {off_percent['K_s']:+.1f} %, gravity "
    f"{off_percent['m g r']:+.1f} % and $\\delta$ "
    f"{1e3 * delta - backlash_mrad:+.3f} mrad off; from the noisy one $\\delta$ "
    f"is {1e3 * of_log['delta'] - backlash_mrad:+.3f} mrad off.",
)

# %% [markdown]
# ### The sensor
#
# The sensor fits the same load in full, not only where the teeth touch: the measured motor angle
# $\theta_m$ [rad] drives it,
#
# $$\begin{aligned} J_l\, \ddot\theta_l &= \tau_l - m g r \left[\sin\theta_l + s\,\text{sign}(\dot\theta_l)\right] \\
# \tau_l &= K_s\, p_\delta\!\left(\frac{\theta_m}{N} - \theta_l\right) + \text{damping} \end{aligned}$$
#
# with friction $s$ over gravity, and $p_\delta$ [rad], what the displacement exceeds $\pm\delta$ by.
# This gives the torque that the motor should need; the sensor fits it, harmonic by harmonic, to the
# measured one, weighs the noise, and says how sure it is. Two numbers of the load are given, $J_l/(N^2
# J_m)$ and $m g r/J_l$ [1/s²]; stiffness, damping, friction, losses and $\delta$ are fitted, and the two
# corrected as far as the log says more than what was known of them. *Predict:* how wide is the
# interval, if gravity is known to 5 % and inertia to 10 %?

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
def holds_truth(answer, truth_mrad):
    low, high = 1e3 * np.array(answer.backlash_interval_rad)
    return low <= truth_mrad <= high


if by_torque.backlash_interval_rad:
    low, high = 1e3 * np.array(by_torque.backlash_interval_rad)
    finding = (
        f"{by_torque.verdict}, {1e3 * by_torque.backlash_rad:.3f} mrad, whose "
        f"interval of {low:.3f} to {high:.3f} mrad "
        f"{'holds' if holds_truth(by_torque, backlash_mrad) else 'does not hold'} "
        "the true "
        f"{backlash_mrad:g} mrad"
    )
    of_gravity = by_torque.joint["gravity_per_s2"][0] / ratios["G/J_l"]
    workbook.say(
        f"The sensor says: {finding}. The two springs made "
        f"{1e3 * of_log['delta']:.3f} mrad of this log. Gravity was given as "
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
# ### An axis with end stops
#
# An axis that cannot turn round moves to and fro, through the position in which its load hangs down.
# A stroke back, mirrored, is one forth; so the same model holds in a window of each direction, from
# before the teeth part to where the load has rung out. *Predict:* which of the two movements tells the
# backlash of the same joint better?

# %%
healthy = simulated_joints.Fault()
rng = np.random.default_rng((bench_seed, 5))
off_speed = np.nan
while not off_speed < 0.1:  # its drive is drawn, too, and may run away
    swung = simulated_joints.draw_joint(rng, backlash_rad, 1.5, 100, 0.1, 0.05)
    turned = simulated_joints.run_turns(swung, healthy)
    off_speed = np.abs(turned[:, 0] / swung.speed - 1).max()
ends_rad = np.radians([-75, 70])  # of the load, from where it hangs
wanted = simulated_joints.stroke_speeds(swung.speed, ends_rad)
moved = simulated_joints.follow_path(swung, healthy, ends_rad[0], wanted)
by_movement = {}
for name, seen in {"turns": turned, "strokes": moved}.items():
    rng = np.random.default_rng((bench_seed, 6))
    recorded = simulated_joints.log_joint(rng, swung, healthy, seen)
    by_movement[name] = datasheet.ask_sensor(recorded)
    print(f"{name}: {by_movement[name].summary}")

# %% jupyter={"source_hidden": true} tags=["hide-input"]
step_s = simulated_joints.CONTROL_S
angle_deg = np.degrees(ends_rad[0] + np.cumsum(wanted) * step_s)
trace = by_movement["strokes"].trace
figure, above, below = figures.stack(2, 4.4, sharex=False)
above.plot(step_s * np.arange(wanted.size), angle_deg, **figures.FIT)
above.axhline(0, color="0.6")
above.set(xlabel="time [s]", ylabel="angle from hanging [deg]")
if trace:
    below.plot(trace.t, trace.measured, label="measured", **figures.LOG)
    below.plot(trace.t, trace.model, label="model", **figures.FIT)
below.set(xlabel="time in the mean strokes [s]", ylabel="torque [log's unit]")
workbook.show_figure(
    "own_joint_strokes",
    figures.finish(figure, 2),
    "(a) Strokes of a joint with end stops through the hanging position. (b) The "
    "torque in the windows of the mean stroke forth and, behind it, back, "
    "mirrored: while nothing holds the load it stays level. The truth is "
    f"{backlash_mrad:g} mrad.",
)

# %% [markdown]
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
too_loud = log.assign(**{"speed [rps]": log["speed [rps]"] + noise_rps})
odd = {
    "without backlash": (log_joint(0.0, 1), load),
    "friction above gravity": (log_joint(backlash_rad, 2, rubbed), load),
    "noise of 5 rps": (too_loud, load),
    "a torque of the wrong sign": (log.assign(torque=-log["torque"]), load),
    "half of the gear ratio": (log, load | {"gear_ratio": my_joint.N / 2}),
}
answers = {
    name: backlash.estimate(record, **given)
    for name, (record, given) in odd.items()
}
for name, answer in answers.items():
    print(f"{name}: {answer.summary}\n")

# %% jupyter={"source_hidden": true} tags=["hide-input"]
answered, refused, wrong = [], [], []
for name, answer in answers.items():
    (refused if answer.verdict == "cannot tell" else answered).append(name)
    truth_mrad = backlash_mrad * (name != "without backlash")
    if answer.backlash_interval_rad and not holds_truth(answer, truth_mrad):
        wrong.append(name)
workbook.say(
    f"Answered: {'; '.join(answered) or 'none'}. Refused, each for its reason: "
    f"{'; '.join(refused) or 'none'}. Answers that do not hold the truth: "
    f"{'; '.join(wrong) or 'none'}."
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
    + (f", and answers: {'; '.join(answered)}" if answered else "")
    + (f"; the truth is not in: {'; '.join(wrong)}." if wrong else ".")
)

# %% [markdown]
# ## Try changing
#
# `my_log = "log.csv"`, with what you know of it in `my_settings`, measures a log of your own; many
# logs, and the command line: the [guide](../guide.md).

# %% jupyter={"source_hidden": true} tags=["hide-input", "promises"]
workbook.try_changing(
    (
        "backlash_mrad = 0.5",
        "a smaller gap is crossed sooner, so that the torque is near zero for a "
        "shorter time; the interval still holds the truth",
        lambda now, was: (
            now.small.sum() < was.small.sum()
            and now.low <= now.backlash_mrad <= now.high
        ),
    ),
    (
        "gravity_given = 1.1",
        "the fit ends at less than 1.1 times the true gravity, for the log says "
        "that it is smaller, and the estimate grows with it",
        lambda now, was: (
            was.of_gravity < now.of_gravity < 1.1
            and now.by_torque.backlash_rad > was.by_torque.backlash_rad
        ),
    ),
    (
        "friction_share = 1.2",
        "friction above gravity holds the load on one flank, it never crosses the "
        "gap, and the sensor refuses",
        lambda now, was: now.by_torque.verdict == "cannot tell",
    ),
)

# %% [markdown]
# ## Exercises
#
# Answer by the `name`; the cell below says *right* or *not yet*. Solutions are folded in the
# committed notebooks.

# %%
inertia_percent = wind_up_mrad = lost_mrad = np.nan  # your answers

# %% [markdown]
# **1.** The load's inertia is given 10 % too small. By how much does the $\delta$ of the two springs
# change (`inertia_percent` [%], with its sign, to 0.5), on the clean log? Why?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
of_lighter, *_ = fit_turn(clean, J_l=0.9 * my_joint.J_l)
inertia_percent = 100 * (of_lighter["delta"] / of_clean["delta"] - 1)
print(f"{inertia_percent:+.1f} %: the load moves by the torque over its inertia")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
lighter, *_ = fit_turn(clean, J_l=0.9 * my_joint.J_l)
percent = 100 * lighter["delta"] / of_clean["delta"] - 100
workbook.check_answer(inertia_percent, percent, to=0.5)

# %% [markdown]
# **2.** By how much do the teeth and the coupling wind up at the largest $|\tau_l|$ of the clean turn
# (`wind_up_mrad` [mrad], to 0.02), by the fitted stiffness? Compare it with $\delta$.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
wind_up_mrad = 1e3 * np.abs(tau_l).max() / of_clean["K_s"]
print(f"{wind_up_mrad:.2f} mrad, {wind_up_mrad / backlash_mrad:.1f} times delta")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
most = 1e3 * np.abs(tau_l).max()
workbook.check_answer(wind_up_mrad, most / of_clean["K_s"], to=0.02)

# %% [markdown]
# **3.** A data sheet states the lost motion between +2 and -2 N m at the joint. What would it be here
# (`lost_mrad` [mrad], to 0.02), by the fit to the clean log?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
lost_mrad = 1e3 * (2 * of_clean["delta"] + 4 / of_clean["K_s"])
print(f"{lost_mrad:.2f} mrad: the play, and the wind-up on both flanks")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
one_side = of_clean["delta"] + 2 / of_clean["K_s"]
workbook.check_answer(lost_mrad, 2e3 * one_side, to=0.02)

# %% [markdown]
# **What you have learnt**: the torque tells when no tooth carries the load, a model of the load makes
# a backlash of that, and a sensor must refuse. *Next:* [what a log tells](12_what_a_log_tells.ipynb).
