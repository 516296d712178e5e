# %% [markdown]
# # 12 · Measure your own joint
#
# *You will calibrate the sensor for a joint, estimate the backlash from logs with it, and see when
# it refuses; then measure a log of your own. Run time: 11 s. Before this: notebook
# [0](../00_the_sensor.ipynb).*
#
# **A guide to the virtual sensor. A simulated joint replaces yours; nothing of the paper is judged
# here.**
#
# ## Claim
#
# The [backlash](../glossary.md#backlash) of a joint can be read off its motor encoder alone,
# without taking it apart.

# %%
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib import pyplot as plt

import backlash
import workbook
from backlash import calibration, fleet, plots, trend_line
from backlash.examine import examine_recording
from backlash.reading.columns import LogFormat
from backlash.settings import settings_for
from replication import standins
from workbook import Interval

# %%
example = standins.encoder_log(
    standins.draw_bench(np.random.default_rng(3)), 1.1e-3, np.random.default_rng(1)
)
two_turns = example.t < 2 * example.turn_period_s
_, axis = plt.subplots(figsize=(7, 2.6), layout="constrained")
axis.plot(example.t[two_turns], example.v[two_turns], ".", markersize=3)
axis.set(xlabel="time [s]", ylabel="motor speed [rps]")
_ = axis.set_title(
    "two turns of a log: two impacts in each, and the ring that each leaves", fontsize=9
)

# %% [markdown]
# ## Method
#
# *The movement*: a horizontal axis and an off-centre load, whose gravity is above its friction, so
# that gravity swings the load through the gap twice a turn; constant motor speed; twelve load turns
# in one direction, four at least. *The log*: time and the encoder's position or speed, at 500 Hz if
# you can; the joint rings near 21 Hz. Below 84 Hz (four samples a ring period) the sensor does not
# answer. *The backlash* $\delta$ is half of the total play.
#
# *The calibration*: logs of the same movement at six or more known backlashes of your joint. Method
# `waveform` makes of them the settled motor speed $w(\varphi; \delta)$ [rps], less its mean, at
# each phase $\varphi$ of a load turn, a polynomial in $\delta$. A log of speeds $v_i$ [rps] at
# times $t_i$ [s], with the turn period $T_f$ [s], has the backlash and the phase that fit best,
#
# $$\hat\delta, \hat\varphi = \arg\min_{\delta, \varphi} \sum_i
# \left[v_i - \bar v - w\left(\frac{t_i}{T_f} - \varphi; \delta\right)\right]^2.$$
#
# Methods `amplitude` and `energy` read one number off the fitted signature instead. The 95 %
# interval is $\hat\delta \pm 1.96 \sqrt{\sigma_n^2 + \sigma_c^2}$ with the SD $\sigma_n$ (standard
# deviation) that the log's noise gives $\hat\delta$, and the calibration's own uncertainty
# $\sigma_c$, from the errors at levels that were left out.
#
# Calibrate first if you can: it holds for any drive. Without a calibration, method `self` finds the
# joint from the log (notebook 14). It assumes the paper's drive, with gains known to 2 to 3 %, and
# mechanics known to 20 %, and says `cannot tell` for others.
#
# *By the torque*: where the motor's torque or current is logged too, method `torque` needs no
# calibration and no model of the drive, but what you know of the load: mass, arm, inertias and gear
# ratio, or $J_l/(N^2 J_m)$ and $m g r/J_l$ [1/s²] themselves. The estimate is proportional to
# $m g r/J_l$. The [datasheet](../../results/pages/datasheet.html) says how often it answers and how
# often the interval holds the true backlash. A note compares the motor's inertia that the log tells
# of with yours: if it is not what you know, an input is wrong. Where a joint can't turn four times,
# six or more *strokes* across the vertical, with the torque and the gear ratio, serve too; they
# can't tell that there is no backlash.
#
# *Which side*: speed, position and torque are the motor's, and the backlash is the joint's. Most
# robots log the joint's side: then $N = 1$, and the load is said by its two ratios
# (`--gear-ratio 1 --inertia-ratio RHO --gravity PER_S2`). Gear makers state the *lost motion*: the
# total play $2 \delta$ and the wind-up of the teeth at a few per cent of the rated torque. So
# $2 \delta$ is less than the lost motion of the data sheet.
#
# ```
# backlash calibrate table.csv --out joint.json --turn-period 0.4
# backlash estimate log.csv --turn-period 0.4 --calibration joint.json --plot log.png
# backlash estimate log.csv --torque COLUMN --gear-ratio 50 --motor-inertia 6.5e-5 --load-mass 5 --load-arm 0.33
# backlash trend logs/ --turn-period 0.4 --calibration joint.json --limit 0.001 --plot trend.png
# ```
#
# and from Python `backlash.calibrate`, `backlash.estimate` and `backlash.trend`, on files, tables
# or arrays. The first call on a machine may compile first, and says so. Many logs, a cluster, costs
# and other formats: the [guide](../guide.md). Here your joint is a simulated bench of notebook 10:
# other stiffness, gravity and gains than the paper's, some friction, an encoder of 19 bits, and a
# log that starts anywhere.

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
my_log = ""  # path of a log of your own (CSV, XLSX, Parquet and others), which is measured first
my_turn_period_s = 0.4  # time of a load turn in it
bench_seed = 3  # which joint is drawn
backlash_mrad = 1.1  # of the log that is looked at closely
method = "waveform"  # of your own calibration: "amplitude", "energy" or "waveform"
calibration_levels = 9  # logs of known backlash
log_turns = 12  # load turns of the logs that are measured
limit_mrad = 1.0  # backlash that calls for maintenance

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.check_parameters(
    my_log=(my_log, (my_log,)),  # reading it says what is wrong with a path
    my_turn_period_s=(my_turn_period_s, Interval(1e-3, 1e3)),
    bench_seed=(bench_seed, range(0, 10**6)),
    backlash_mrad=(backlash_mrad, Interval(0.3, 1.9)),
    method=(method, ("amplitude", "energy", "waveform")),
    calibration_levels=(calibration_levels, range(6, 101)),
    log_turns=(log_turns, range(4, 13)),
    limit_mrad=(limit_mrad, Interval(0.01, 10)),
)

# %% [markdown]
# ## Result
#
# ### Your log, or the simulated joint's
#
# With `my_log` the first answer is yours, by method `self`, which needs no calibration. A `note`
# says what was assumed or left out. Then come logs of the simulated joint, and its own calibration:
# the same estimator reads the logs of known backlash and the one to be measured, so that what it
# gets wrong each time cancels. The calibration's uncertainty is the RMS error at levels that were
# left out, times Student's factor for so few of them.

# %%
my_answer = None
if my_log:
    my_record = backlash.read_log(my_log, turn_period_s=my_turn_period_s)
    my_answer = backlash.estimate(my_record)
    print(my_answer)
    print(
        f"assumed: a load turn of {my_turn_period_s:g} s, gravity and backlash alone, a drive of the paper's kind; "
        f"calibration {my_answer.calibration}"
    )
    part = my_record.recording.t < my_record.recording.t[0] + 3 * my_turn_period_s
    plt.plot(my_record.recording.t[part], my_record.recording.v[part], lw=0.8)
    plt.show()

# %%
backlash_rad, limit_rad = 1e-3 * backlash_mrad, 1e-3 * limit_mrad
bench = standins.draw_bench(np.random.default_rng(bench_seed))
form = LogFormat(turn_period_s=bench.joint.turn_period_s, unit="rps")


def log(delta_rad, seed, of=bench, turns=log_turns):
    """A log of your joint, cut to the turns that are wanted."""
    record = standins.encoder_log(of, delta_rad, np.random.default_rng((bench_seed, seed)))
    samples = round(turns * record.turn_period_s / standins.SAMPLE_S)
    return replace(record, t=record.t[:samples], v=record.v[:samples])


def answer(record, settings, name="log"):
    return examine_recording(record, settings, name)


# %%
known_rad = np.linspace(3e-4, 19e-4, calibration_levels)
known_logs = [log(delta, 100 + k, turns=12) for k, delta in enumerate(known_rad)]
own = calibration.fit_calibration(known_logs, known_rad, method)
ours = settings_for(form, own)
calibrated = answer(log(backlash_rad, 0), ours)
print(str(calibrated.estimate))
workbook.show_figure(
    "own_joint_log",
    plots.estimate_figure(
        calibrated.fitted.recording,
        calibrated.fitted.model_rps,
        "your joint, the waveform of its backlash",
    ),
    f"(a) Three of the {log_turns} turns of one log of a simulated joint, with the model that its own "
    "calibration fits. (b) Residual of the whole log.",
)

# %% [markdown]
# ### One log, without a calibration
#
# The first line is the answer; the joint's line gives what else the log shows of the joint; a
# `note` says what was assumed. For a log that no joint of this kind could have made, the answer is
# `cannot tell`.

# %%
uncalibrated = settings_for(form)
papers = settings_for(form, method="amplitude")
first = answer(log(backlash_rad, 0), uncalibrated)
print(str(first.estimate))

# %% [markdown]
# ### How much the calibration matters
#
# The same five logs read without a calibration (method `self`), with the paper's joint's, and with
# your own.

# %%
true_rad = [5e-4, 8e-4, 11e-4, 14e-4, 17e-4]
calibrations = {"none": uncalibrated, "the paper's joint": papers, "your own": ours}
rows = [
    answer(log(delta, 200 + k), settings).estimate.to_dict()
    | {"calibration": name, "true_rad": delta}
    for k, delta in enumerate(true_rad)
    for name, settings in calibrations.items()
]
table = pd.DataFrame(rows)[["calibration", "true_rad", "verdict", "backlash_rad", "method"]]
table["error_rad"] = table["backlash_rad"].astype(float) - table["true_rad"]
in_mrad = table.assign(**{"error [mrad]": (1e3 * table["error_rad"]).round(3)})
in_mrad.pivot(index="true_rad", columns="calibration", values="error [mrad]")

# %% [markdown]
# ### Over the months
#
# Dated answers, and the line through them, weighed by their intervals.

# %%
dates = pd.date_range("2026-01-05", periods=8, freq="28D")
worn_rad = np.linspace(5e-4, 9.2e-4, dates.size)
logs = [answer(log(delta, 300 + k), ours).estimate for k, delta in enumerate(worn_rad)]
line = trend_line.fit_trend(fleet.as_table(logs), dates, limit_rad)
print(line)
workbook.show_figure(
    "own_joint_trend",
    plots.trend_figure(line),
    f"Estimates of {len(logs)} dated logs of one simulated joint, the line through them, and the time at which "
    "it crosses the limit, each with its 95 % interval.",
)

# %% [markdown]
# ### What it refuses
#
# A sensor must refuse logs that it cannot judge. Its answers on five unusual logs:

# %%
good = log(backlash_rad, 0)
friction_nm = 0.2 * bench.joint.gravity_torque_nm
rubbed = replace(bench, joint=replace(bench.joint, load_coulomb_nm=friction_nm))
noise = np.random.default_rng(bench_seed).normal(0, 5.0, good.v.size)
wrong_turn = replace(good, turn_period_s=1.5 * good.turn_period_s)
odd = {
    "no backlash at all": log(0.0, 1),
    "the turn's period taken wrong by a half": wrong_turn,
    "noise of 5 rps": replace(good, v=good.v + noise),
    "friction of 20 % of gravity, not there in the calibration": log(backlash_rad, 0, rubbed),
    "twice the largest backlash of the calibration": log(2 * own.range_rad[1], 2),
}
answers = [answer(record, ours, name).estimate for name, record in odd.items()]
print("\n".join(str(found) for found in answers))

# %% [markdown]
# ## Verdict
#
# No number of the paper is judged here.

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
errors = table.groupby("calibration", sort=False)["error_rad"]
summary = 1e3 * errors.agg(lambda error: error.abs().mean())
answered = errors.count()
others = [found.verdict for found in answers if found.verdict != "cannot tell"]
one = calibrated.estimate
workbook.verdict(
    f"The mean error is {summary['your own']:.3f} mrad with your own calibration by `{method}` ({answered['your own']} "
    f"of {len(true_rad)} logs answered), {summary.iloc[1]:.3f} mrad with that of the "
    f"paper's joint ({answered.iloc[1]}), and {summary['none']:.3f} mrad without any ({answered['none']}). The log of "
    f"{backlash_mrad:g} mrad is answered: {one.verdict}. Of {len(answers)} odd logs the sensor refuses "
    f"{len(answers) - len(others)}; of the others it says: {', '.join(others) or 'nothing'}."
)

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.export(
    supplement={"own_joint": (table, "Estimates with its own and the paper's calibration.")}
)

# %% [markdown]
# ## Try changing
#
# 1. `method = "amplitude"`: the paper's feature with your own calibration; it errs more than the
#    waveform.
# 2. `log_turns = 4`: a third of the log; there are still answers, with wider intervals.
# 3. `bench_seed = 4`: another joint; your own calibration still beats the paper's.
#
# `my_log = "log.csv"`, with its `my_turn_period_s`, measures a log of your own.
#
# ## Exercises
#
# **1.** Which share of the variance of $\hat\delta$ in the calibrated answer above comes from the
# log's noise, which from the calibration (to 1 %)? Which of the two would a longer log reduce?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
estimate = calibrated.estimate
total_sd = max(np.abs(np.array(estimate.backlash_interval_rad) - estimate.backlash_rad)) / 1.96
noise_share = 1 - (own.uncertainty_rad / total_sd) ** 2  # a longer log reduces this part only
assert 0 <= noise_share < 1
print(f"noise {100 * noise_share:.0f} %, calibration {100 * (1 - noise_share):.0f} %")

# %% [markdown]
# **2.** A pure sine of 21 Hz is sampled at $f_s$. How much of its peak can the largest sample miss
# (to 0.1 %), at 500 and 84 Hz?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
most_missed = {
    rate: 1 - np.cos(np.pi * 21 / rate) for rate in (500, 84)
}  # half a sampling period from the peak
assert np.isclose(most_missed[84], 1 - np.sqrt(0.5))
assert most_missed[500] < 0.01
print({rate: f"{100 * share:.1f} %" for rate, share in most_missed.items()})

# %% [markdown]
# **3.** The trend's line is $\delta(t) = a + b t$, $t$ in days from its origin. Find the day on
# which it reaches the limit (a date). Why is its interval wider on the late side than on the early
# one?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
level, growth = line.line
crossing = line.origin + pd.Timedelta(days=(limit_rad - level) / growth)
assert line.crossing is None or abs(crossing - line.crossing) < pd.Timedelta(minutes=1)
print(
    crossing.date(), line.crossing_interval
)  # a slope that is a little smaller moves the crossing further

# %% [markdown]
# **What you have learnt**: a calibration of your own cancels what an estimator gets wrong each
# time, and a sensor must refuse. *Next:* [estimators compared](13_readings_compared.ipynb).
