# %% [markdown]
# # 11 · Measure your own joint
#
# *You will estimate the backlash of a joint from a log of its speed and torque, and see when the
# sensor refuses; then measure a log of your own. Reading time: 8 min. Run time: 30 s. Before this:
# notebook [0](../00_the_sensor.ipynb).*
#
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
# **By the torque** (method `torque`). The motor of the inertia $J_m$ [kg m²] turns at the speed
# $\omega_m$ [rad/s] under its torque $\tau_m$ [N m]. So the two signals give the torque of the
# coupling at the gear ratio $N$,
#
# $$\tau_l = N \left(\tau_m - J_m\, \dot\omega_m - \text{friction}\right),$$
#
# and no model of the drive is needed. While $\tau_l$ changes its sign, the load passes the gap of
# $2 \delta$ [rad]. It moves there under gravity $m g r$ [N m] and its own inertia $J_l$ [kg m²]. From
# two numbers of the load, $J_l/(N^2 J_m)$ and $m g r/J_l$ [1/s²], the sensor fits the rest:
# stiffness, damping, friction, losses, and $\delta$, and corrects the two as far as the log says
# more than what was known of them. The estimate is proportional to the $m g r/J_l$ that it ends at.
#
# **By the speed alone** (method `amplitude`) the sensor gives the paper's amplitude $A$ [rps] as an
# index, and no backlash.
#
# *Which side*: speed, position and torque are the motor's, and the backlash is the joint's. If a
# robot logs the joint's side, then $N = 1$. Gear makers state the *lost motion*: the total play
# $2 \delta$ and the wind-up of the teeth at a few per cent of the rated torque. So $2 \delta$ is less
# than the lost motion of the data sheet.
#
# ```
# backlash estimate log.csv --torque COLUMN --gear-ratio 50 --motor-inertia 6.5e-5 --load-mass 5 --load-arm 0.33
# backlash estimate log.csv --turn-period 0.4
# ```
#
# Many logs, costs and other formats: the [guide](../guide.md). Your joint is here a simulated bench
# of notebook [9](../09_bench_table3.ipynb): other stiffness, gravity and gains than the paper's,
# some friction, an encoder of 19 bits, and a log that starts anywhere.

# %%
import numpy as np
import pandas as pd

import backlash
import workbook
from backlash import plots
from replication import bench, joint

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
my_log = ""  # path of a log of your own (CSV, XLSX or Parquet)
# What you know of it, as `backlash.estimate` takes it; for a log with torque also "torque" (its column),
# "gear_ratio", "inertia_ratio" and "gravity_per_s2", as in the second cell of the result.
my_settings = {"turn_period_s": 0.4}
bench_seed = 3  # which joint is drawn
backlash_mrad = 1.1  # of the log that is looked at closely
friction_share = 0.0  # Coulomb friction of the load beyond the drawn joint's, over gravity
gravity_given = 1.0  # m g r / J_l that the sensor is given, over the true one
log_turns = 12  # of each log

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.check_parameters(
    my_log=(my_log, (my_log,)),  # reading it says what is wrong with it
    my_settings=(my_settings, (my_settings,)),
    bench_seed=(bench_seed, range(0, 10**6)),
    backlash_mrad=(backlash_mrad, (0, 5)),
    friction_share=(friction_share, (0, 2)),
    gravity_given=(gravity_given, (0.1, 10)),
    log_turns=(log_turns, range(4, 41)),
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
# ### By the torque
#
# A log of the joint is a table as a recorder writes it. *Predict:* how wide is the interval, if the
# load's gravity is known to 5 % and its inertia to 10 %?

# %%
drawn = bench.draw_bench(np.random.default_rng(bench_seed))
gravity_nm = drawn.joint.G
my_joint = drawn.joint._replace(load_coulomb=drawn.joint.load_coulomb + friction_share * gravity_nm)
backlash_rad = 1e-3 * backlash_mrad


def log_joint(delta_rad, seed, of=my_joint):
    """A log of twelve turns: time, speed by the encoder, torque, with noise."""
    rng = np.random.default_rng((bench_seed, seed))
    turning = of._replace(start_angle=rng.uniform(0, joint.TURN))
    run = joint.simulate(turning, delta_rad, log_turns * turning.turn_period)
    read = bench.read_encoder(turning, run.t, run.theta_m, turning.encoder_step, "encoder")
    speed = read.v + rng.normal(0, drawn.noise_rps, read.v.size)
    torque = run.torque[:-1] + rng.normal(0, 0.01 * gravity_nm / of.N, read.v.size)
    return pd.DataFrame({"time [s]": read.t, "speed [rps]": speed, "torque": torque})


# %%
log = log_joint(backlash_rad, 0)
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
        f"(a) Three of the {log_turns} turns of the torque of a simulated joint, measured and by the model that is "
        "fitted to it. (b) Residual of the whole log.",
    )

# %% [markdown]
# The next lines are there to be compared with the joint's data sheet: a stiffness or an inertia that
# is not the joint's says that an input is wrong. What was given of the load is exact here; the sensor does not know
# that, weighs it against the log, and may move it away from the truth: by this much the backlash errs, too.
#
# ### By the speed alone
#
# The same log without its torque has the paper's index, and no backlash.

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
odd = {
    "no backlash": (log_joint(0.0, 1), load),
    "friction above gravity": (log_joint(backlash_rad, 2, rubbed), load),
    "noise of 5 rps": (log.assign(**{"speed [rps]": log["speed [rps]"] + noise_rps}), load),
    "a torque of the wrong sign": (log.assign(torque=-log["torque"]), load),
    "half of the gear ratio": (log, load | {"gear_ratio": my_joint.N / 2}),
}
answers = {name: backlash.estimate(record, **given) for name, (record, given) in odd.items()}
pd.Series({name: answer.summary for name, answer in answers.items()}, name="answer").to_frame()

# %% [markdown]
# ## Verdict
#
# No number of the paper is judged here.


# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
def in_words(answer):
    if answer.backlash_rad is None:
        return f"no answer ({answer.reason})"
    low, high = answer.backlash_interval_rad
    holds = "holds" if low <= backlash_rad <= high else "does not hold"
    return (
        f"{answer.verdict}, {1e3 * answer.backlash_rad:.3f} mrad, whose interval of {1e3 * low:.3f} to "
        f"{1e3 * high:.3f} mrad {holds} the true one"
    )


refused = [name for name, answer in answers.items() if answer.backlash_rad is None]
answered = [name for name in answers if name not in refused]
workbook.verdict(
    f"What the sensor says of the log of {backlash_mrad:g} mrad by the torque: {in_words(by_torque)}; by the speed "
    f"alone: {in_words(by_speed)}. Of {len(answers)} odd logs the sensor refuses {len(refused)}"
    + (f", and answers: {'; '.join(answered)}." if answered else ".")
)

# %% [markdown]
# ## Try changing
#
# 1. `friction_share = 0.3`: the torque's answer stays right, with a wider interval.
# 2. `gravity_given = 1.3`: the estimate grows, but by less, for the log says that gravity is smaller.
# 3. `friction_share = 1.2`: friction above gravity holds the load on one flank, and it never crosses
#    the gap.
#
# `my_log = "log.csv"`, with what you know of it in `my_settings`, measures a log of your own.
#
# ## Exercises
#
# Each asks for a number by its `name`. The cell below your answer says *right* or *not yet*.

# %%
gravity_percent = most_missed_percent = growth = np.nan  # your answers

# %% [markdown]
# **1.** The load is a point at the arm $r$, which is given 4 % too short. By how much
# (`gravity_percent`) is the given $m g r/J_l$ too large? Ask the sensor again: why does the estimate
# change by less?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
gravity_percent = 100 * (1 / 0.96 - 1)  # m g r / (m r^2) = g / r
too_large = load | {"gravity_per_s2": (1 + gravity_percent / 100) * load["gravity_per_s2"]}
again = backlash.estimate(log, **too_large)
if by_torque.backlash_rad and again.backlash_rad:
    print(
        f"the estimate changes by {100 * (again.backlash_rad / by_torque.backlash_rad - 1):+.1f} %:"
    )
print("with the inertia ratio the log tells gravity, too")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(
    gravity_percent, lambda percent: np.isclose(0.96 * (1 + percent / 100), 1, atol=1e-3)
)

# %% [markdown]
# **2.** A pure sine of 21 Hz is sampled at 84 Hz. How much of its peak can the largest sample miss
# at most (`most_missed_percent`, to 0.1)? And at 500 Hz?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
most_missed_percent = 100 * (1 - np.cos(np.pi * 21 / 84))  # half a sampling period from the peak
print(f"{most_missed_percent:.1f} %; at 500 Hz {100 * (1 - np.cos(np.pi * 21 / 500)):.1f} %")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
nearest = np.cos(np.pi / 4)  # four samples a period
workbook.check_answer(most_missed_percent, 100 * (1 - nearest), atol=0.1)

# %% [markdown]
# **3.** Four tests, 90 days apart, gave 0.50, 0.58, 0.69 and 0.75 mrad. By how many mrad a year does
# the line of least squares through them grow (`growth`, to 0.01)?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
growth = 365.25 * np.polyfit(90 * np.arange(4), [0.50, 0.58, 0.69, 0.75], 1)[0]
print(f"{growth:.2f} mrad a year; the intervals of the tests say how sure that is")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
steps = np.array([-1.5, -0.5, 0.5, 1.5])  # the slope is a mean weighted by these
per_test = steps @ [0.50, 0.58, 0.69, 0.75] / (steps @ steps)
workbook.check_answer(growth, per_test * 365.25 / 90, atol=0.005)

# %% [markdown]
# **What you have learnt**: the torque makes a backlash of the index, and a sensor must refuse.
# *Next:* [what a log tells](12_what_a_log_tells.ipynb).
