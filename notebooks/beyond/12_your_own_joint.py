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
#     quick: {calibration_levels: 7}
# ---

# %% [markdown]
# # 12 · Measure your own joint
#
# *You will calibrate the sensor for a joint, read logs with it, and see when it refuses; then measure a log of your
# own. Run time: 11 s.*
#
# **A guide to the virtual sensor. A simulated joint replaces yours; nothing of the paper is judged here.**
#
# ## Claim
#
# The [backlash](../glossary.md#backlash) of a joint can be read off its motor encoder alone, without taking it apart.
#
# ## Method
#
# *The movement*: a horizontal axis and an off-centre load, whose gravity is above its friction, so that gravity swings
# the load through the gap twice a turn; constant motor speed; twelve load turns in one direction, four at least.
# *The log*: time and the encoder's position or speed, at 500 Hz if you can; the joint rings near 21 Hz, and sampling
# below 84 Hz tells nothing. *The backlash* $\delta$ is half of the total play: the teeth are free over $2 \delta$.
#
# *The calibration*: logs of the same movement at six or more known backlashes of your joint. Method `waveform` makes
# of them the settled motor speed $w(\varphi; \delta)$ [rps], less its mean, at each phase $\varphi$ of a load turn, a
# polynomial in $\delta$. A log of speeds $v_i$ [rps] at times $t_i$ [s], with the turn period $T_f$ [s], has the
# backlash and the phase that fit best,
#
# $$\hat\delta, \hat\varphi = \arg\min_{\delta, \varphi} \sum_i
# \left[v_i - \bar v - w\left(\frac{t_i}{T_f} - \varphi; \delta\right)\right]^2.$$
#
# Methods `amplitude` and `energy` read one number $x$ [rps] off the fitted signature instead, and have
# $\hat\delta = \sum_{k=0}^{3} c_k x^k$, the form of equation 10. The 95 % interval is
#
# $$\hat\delta \pm 1.96 \sqrt{\sigma_n^2 + \sigma_c^2}$$
#
# with the SD $\sigma_n$ [rad] that the log's noise gives $\hat\delta$, and the calibration's own uncertainty
# $\sigma_c$ [rad], from the errors at levels that were left out.
#
# Calibrate first if you can: it holds for any drive. Without a calibration, method `self` finds the joint from the log
# (notebook 14). It knows a joint under a drive of the paper's kind, the drive within 2 to 3 % and the mechanics within
# 20 %, and says `cannot tell` for others.
#
# *By the torque*: where the motor's torque or current is logged too, method `torque` needs no calibration and no model
# of the drive, but what you know of the load: its mass $m$ [kg], the arm $r$ [m] of its centre of mass, its inertia
# $J_l$ about the joint's axis ($m r^2$ of a point, if you leave it out), the motor's inertia $J_m$ [kg m²] and the gear
# ratio $N$; or $J_l/(N^2 J_m)$ and $m g r/J_l$ [1/s²] themselves. The load alone is simulated, driven by the measured
# motion of the motor, and the torque that it asks for is compared with the measured one: friction of the load,
# stiffness and damping are found on the way. The backlash is about proportional to $m g r/J_l$ and hardly depends on
# the inertia ratio. On 100 simulated benches of other code, with a load friction of 0 to 50 % of gravity, 95 were
# answered, 93 of these intervals hold the true backlash, and none was called "no backlash". A note compares the motor's
# inertia that the log tells of with yours: it gives the torque's unit in N m, which for a current is the torque
# constant. If it is not what you know, an input is wrong.
#
# *Which side*: speed, position and torque are the motor's, and the backlash is the joint's, half of the angle by which
# the load can turn while the motor stands. Most robots log the joint's side: then $N = 1$, and the load is said by its
# two ratios (`--gear-ratio 1 --inertia-ratio RHO --gravity PER_S2`). Gear makers state the *lost motion*, measured from
# side to side at a few per cent of the rated torque: the total play $2 \delta$ and the wind-up of the teeth at that
# torque. So $2 \delta$ is less than the lost motion of the data sheet.
#
# *Strokes to and fro*, where a joint can't turn four times: six or more across the vertical at constant speed, with
# the torque and the gear ratio. Two inertias, spring, gap and friction are driven by the logged torque, and a Kalman
# filter corrects them by the speed. Strokes can't tell that there is no backlash.
#
# ```
# backlash estimate log.csv --torque COLUMN --gear-ratio 50 --motor-inertia 6.5e-5 --load-mass 5 --load-arm 0.33
# ```
#
# Here your joint is a simulated bench of notebook 10: other stiffness, gravity and gains than the paper's, some
# friction, an encoder of 19 bits, and a log that starts anywhere. On the command line the steps below are
#
# ```
# backlash calibrate table.csv --out joint.json --turn-period 0.4
# backlash estimate log.csv --turn-period 0.4 --calibration joint.json --plot log.png
# backlash trend logs/ --turn-period 0.4 --calibration joint.json --limit 0.001 --plot trend.png
# ```
#
# and from Python `backlash.calibrate`, `backlash.estimate` and `backlash.trend`, on files, tables or arrays;
# `backlash estimate --help` lists the options. Where the backlash cannot be told, the amplitude is a relative index:
# compare it only between logs of one joint in one movement. The first call on a machine may compile first, and says so.

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

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
my_log = ""  # path of a log of your own (CSV, XLSX, Parquet and others), which is measured first
my_turn_period_s = 0.4  # time of a load turn in it
bench_seed = 3  # which joint is drawn
backlash_rad = 11e-4  # of the log that is looked at closely
method = "waveform"  # of your own calibration: "amplitude", "energy" or "waveform"
calibration_levels = 9  # logs of known backlash
log_turns = 12  # load turns of the logs that are measured
limit_rad = 10e-4  # backlash that calls for maintenance

# %% tags=["plumbing"]
workbook.check_parameters(
    my_log=(my_log, (my_log,)),  # reading it says what is wrong with a path
    my_turn_period_s=(my_turn_period_s, Interval(1e-3, 1e3)),
    bench_seed=(bench_seed, range(0, 10**6)),
    backlash_rad=(backlash_rad, Interval(3e-4, 19e-4)),
    method=(method, ("amplitude", "energy", "waveform")),
    calibration_levels=(calibration_levels, range(6, 101)),
    log_turns=(log_turns, Interval(4, 12, whole=True)),
    limit_rad=(limit_rad, Interval(1e-5, 1e-2)),
)

# %% [markdown]
# ## Result
#
# ### Your log, or the simulated joint's
#
# With `my_log` the first answer is yours, by method `self`, which needs no calibration. A `note` says what was assumed
# or left out. Then come logs of the simulated joint, and its own calibration: the same estimator reads the logs of
# known backlash and the one to be measured, so that what it gets wrong each time cancels. The calibration's
# uncertainty is the RMS error at levels that were left out, times Student's factor for so few of them.

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
log_figure = plots.estimate_figure(
    calibrated.fitted.recording,
    calibrated.fitted.model_rps,
    "your joint, the waveform of its backlash",
)

# %% [markdown]
# ### One log, without a calibration
#
# The first line is the answer; the joint's line gives what else the log shows of the joint; a `note` says what was
# assumed. For a log that no joint of this kind could have made, the answer is `cannot tell`.

# %%
uncalibrated = settings_for(form)
papers = settings_for(form, method="amplitude")
first = answer(log(backlash_rad, 0), uncalibrated)
print(str(first.estimate))

# %% [markdown]
# ### How much the calibration matters
#
# The same five logs read without a calibration (method `self`), with the paper's joint's, and with your own.

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
table.sort_values(["calibration", "true_rad"])

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
trend_figure = plots.trend_figure(line)

# %% [markdown]
# ### A plant
#
# A table (CSV or Parquet) names many logs, with what is said of each: `file`, `joint`, `date`, and any of
# `turn_period_s`, `gear_ratio`, `torque` (its column), `inertia_ratio`, `gravity_per_s2` (or `motor_inertia_kgm2`,
# `load_mass_kg`, `load_arm_m`, `load_inertia_kgm2`), `calibration`, `method` and others. What a row leaves empty is
# taken from the options.
#
# ```
# backlash estimate --batch plant.csv --out 2026-11-23.parquet  # one row per log, with its joint and date
# ```
#
# In Python, `backlash.estimate_many("plant.csv")` returns the table of answers, by joint and date, and
# `backlash.trend_many` makes of such tables, one below the other, a trend for each joint. An interrupted run goes on
# from what it kept beside the table, in lines of JSON. If the disk is full, it stops and prints the answers.
#
# *On a cluster*: `pip install .[dask]` on each machine, and `--dask tcp://scheduler:8786`, or
# `joblib.parallel_config(backend="dask")` around `estimate_many`. The workers need this version of the package, and the
# logs under the same absolute paths; start them with one thread each. A worker that dies is replaced by its nanny, and
# its logs are sent again (a test kills one of two in a run of 200 logs). A log that kills every worker holds the run
# up: leave it out. Dask opens ports without a password by itself: keep it in a network that you trust, or use its TLS.
#
# *What it takes*, measured on 2026-11-23 on two cores of a shared x86-64 machine (Python 3.11), with files in the
# page cache; time is CPU time, including the processes' start in the first line:
#
# | logs | CPU a log | memory | file |
# | - | - | - | - |
# | 500 of 4.8 s at 500 Hz, `amplitude`, two processes | 0.11 s | 455 MiB in all | 47 kB of CSV |
# | one of 60 s at 500 Hz, `torque` (later ones in a process) | 0.54 s | 249 MiB | 717 kB of CSV |
#
# From these, in proportion, and with an assumed price of 0.05 EUR for an hour of one core:
#
# | logs a day | CPU [h] | logs [GB] | price [EUR] |
# | - | - | - | - |
# | 10,000 by `amplitude`, 4.8 s | 0.31 | 0.47 | 0.016 |
# | 10,000 by `torque`, 60 s | 1.5 | 7.2 | 0.075 |
# | 1,000,000 by `amplitude`, 4.8 s | 31 | 47 | 1.6 |
# | 1,000,000 by `torque`, 60 s | 150 | 720 | 7.5 |
#
# A core has 24 h a day. A million answers take 200 MB of Parquet.
#
# Memory grows by about 150 MiB with each process, and by 3 kB with each answer, which the parent holds until the end:
# split a day's million logs into tables of 100,000 at most. Reading from a network may take longer than the fit; price
# and time of storage and network are not included.

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
# ### Logs in other formats
#
# Files are read as text, XLSX or Parquet. From other recorders' files hand over the columns; `time`, `speed` and
# `/joint_states` are names in your file. These lines need libraries that the sensor does not install, and `make test`
# does not run them.
#
# ```python
# file = h5py.File("log.h5")  # HDF5, and MATLAB from 7.3 on
# t, v = file["time"][:], file["speed"][:]
#
# file = scipy.io.loadmat("log.mat")  # MATLAB before 7.3
# t, v = file["time"].ravel(), file["speed"].ravel()
#
# signal = asammdf.MDF("log.mf4").get("speed")  # MDF
# t, v = signal.timestamps, signal.samples
#
# with rosbags.highlevel.AnyReader([Path("bag")]) as bag:  # ROS bags, also of MCAP; here the first joint, in rad/s
#     joints = [topic for topic in bag.connections if topic.topic == "/joint_states"]
#     read = [(stamp, bag.deserialize(raw, topic.msgtype)) for topic, stamp, raw in bag.messages(joints)]
#     t, v = [1e-9 * stamp for stamp, _ in read], [joint.velocity[0] for _, joint in read]
#
# table = pd.read_csv("long.csv").pivot(index="time", columns="signal", values="value")  # a row for each value
# t, v = table.index, table["speed"]
#
# backlash.estimate(t, v, turn_period_s=0.4, unit="rps")
# ```

# %% [markdown]
# ## Verdict
#
# No number of the paper is judged here.

# %%
errors = table.groupby("calibration", sort=False)["error_rad"]
summary = pd.DataFrame(
    {"answers": errors.count(), "mean_abs_error_rad": errors.agg(lambda error: error.abs().mean())}
)
display(summary)
none, of_the_papers, yours = 1e6 * summary["mean_abs_error_rad"]
others = [found.verdict for found in answers if found.verdict != "cannot tell"]
print(
    f"The mean error is {yours:.0f}e-6 rad with your own calibration, {of_the_papers:.0f}e-6 rad with that of the "
    f"paper's joint, and {none:.0f}e-6 rad without any. Of {len(answers)} odd logs the sensor refuses "
    f"{len(answers) - len(others)}; of the others it says: {', '.join(others) or 'nothing'}."
)

# %% tags=["plumbing"]
workbook.export(
    supplement={
        "own_joint": (
            table,
            "Estimates of one joint's logs with its own and the paper's calibration.",
        )
    },
    figures={
        "own_joint_log": (
            log_figure,
            f"(a) Three of the {log_turns} turns of one log of a simulated joint, with the model that its own "
            "calibration fits. (b) Residual of the whole log.",
        ),
        "own_joint_trend": (
            trend_figure,
            f"Estimates of {len(logs)} dated logs of one simulated joint, the line through them, and the time at which "
            "it crosses the limit, each with its 95 % interval.",
        ),
    },
)

# %% [markdown]
# ## Try changing
#
# 1. `method = "amplitude"`: the paper's feature with your own calibration; it errs more than the waveform.
# 2. `log_turns = 4`: a third of the log; there are still answers, with wider intervals.
# 3. `bench_seed = 4`: another joint; your own calibration still beats the paper's.
#
# `my_log = "log.csv"`, with its `my_turn_period_s`, measures a log of your own.
#
# ## Exercises
#
# **1.** Which share of the variance of $\hat\delta$ in the calibrated answer above comes from the log's noise, which
# from the calibration (to 1 %)? Which of the two would a longer log reduce?

# %% tags=["solution"]
estimate = calibrated.estimate
total_sd = max(np.abs(np.array(estimate.backlash_interval_rad) - estimate.backlash_rad)) / 1.96
noise_share = 1 - (own.uncertainty_rad / total_sd) ** 2  # a longer log reduces this part only
assert 0 <= noise_share < 1
print(f"noise {100 * noise_share:.0f} %, calibration {100 * (1 - noise_share):.0f} %")

# %% [markdown]
# **2.** A pure sine of 21 Hz is sampled at $f_s$. How much of its peak can the largest sample miss
# (to 0.1 %), at 500 and 84 Hz?

# %% tags=["solution"]
most_missed = {
    rate: 1 - np.cos(np.pi * 21 / rate) for rate in (500, 84)
}  # half a sampling period from the peak
assert np.isclose(most_missed[84], 1 - np.sqrt(0.5))
assert most_missed[500] < 0.01
print({rate: f"{100 * share:.1f} %" for rate, share in most_missed.items()})

# %% [markdown]
# **3.** The trend's line is $\delta(t) = a + b t$, $t$ in days from its origin. Find the day on which it reaches the
# limit (a date). Why is its interval wider on the late side than on the early one?

# %% tags=["solution"]
level, growth = line.line
crossing = line.origin + pd.Timedelta(days=(limit_rad - level) / growth)
assert line.crossing is None or abs(crossing - line.crossing) < pd.Timedelta(minutes=1)
print(
    crossing.date(), line.crossing_interval
)  # a slope that is a little smaller moves the crossing further
