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
# **A guide to the virtual sensor. The joint is a simulated one that plays yours; nothing of the paper is judged here.**
#
# ## Claim
#
# The backlash of a joint can be read off its motor encoder alone, without taking it apart.
#
# ## Method
#
# *The movement*: a horizontal axis, so that gravity swings the load through the gap twice a turn; constant motor speed;
# twelve load turns, four at least. *The log*: time and the encoder's position or speed, at 500 Hz if you can; the ring
# after each impact lies near 21 Hz, and below 84 Hz nothing can be said. *The backlash* $\delta$ is half of the total
# play: the teeth are free over $2 \delta$.
#
# *The calibration*: logs of the same movement at six or more known backlashes of your joint. Calibrate first if you
# can: it holds for any drive. Without one, method `self` finds the joint from the log (notebook 14). It knows a joint
# under a drive of the paper's kind, the drive within 2 to 3 % and the mechanics within 20 %, and says `cannot tell` for
# others. Where the motor's torque is logged too, `backlash.fitting.torque` needs no model of the drive.
#
# Here your joint is a simulated bench of notebook 10: other stiffness, gravity and gains than the paper's, some
# friction, an encoder of 19 bits, and a log that starts anywhere. On the command line the steps below are
#
# ```
# backlash calibrate table.csv --out joint.json --turn-period 0.4
# backlash estimate log.csv --turn-period 0.4 --calibration joint.json --plot log.png
# backlash estimate logs/ --turn-period 0.4 --calibration joint.json --out backlash.csv
# backlash trend logs/ --turn-period 0.4 --calibration joint.json --limit 0.001 --plot trend.png
# ```
#
# and from Python `backlash.calibrate`, `backlash.estimate(t, v, turn_period_s=0.4)` and `backlash.trend`, on files,
# tables or arrays. `--from 2 --to 9` uses a part of a log; `--trust-period` says that the given turn is right;
# `--batch logs.csv` reads each log with its own period, gear ratio and speed; `-` is the standard input.
# `--fail-on "cannot-tell,backlash>0.5mrad"` ends with exit status 3 for scripts. Where the backlash cannot be told, the
# amplitude is a relative index: compare it only between logs of one joint in one movement; `backlash trend --relative`
# follows it. The first call on a machine compiles for about a minute, and says so.

# %%
from dataclasses import replace

import numpy as np
import pandas as pd

from backlash import calibration, plots, trend_line
from backlash import estimation as verdict
from backlash.reading.columns import LogFormat
from replication import workbook
from replication.standins import joints

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
bench_seed = 3  # which joint is drawn
backlash_rad = 11e-4  # of the log that is looked at closely
method = "waveform"  # of your own calibration: "amplitude", "energy" or "waveform"
calibration_levels = 9  # logs of known backlash
log_turns = 12  # load turns of the logs that are measured
limit_rad = 10e-4  # backlash that calls for maintenance

# %% [markdown]
# ## Result
#
# ### The logs

# %%
bench = joints.draw_bench(np.random.default_rng(bench_seed))
form = LogFormat(turn_period_s=bench.joint.turn_period_s, unit="rps")


def log(delta_rad, seed, of=bench, turns=log_turns):
    """A log of your joint, cut to the turns that are wanted."""
    record = joints.encoder_log(of, delta_rad, np.random.default_rng((bench_seed, seed)))
    samples = round(turns * record.turn_period_s / joints.SAMPLE_S)
    return replace(record, t=record.t[:samples], v=record.v[:samples])


def answer(record, settings, name="log"):
    return verdict.examine_recording(record, settings, name)


# %% [markdown]
# ### Your own calibration
#
# The same estimator reads the logs of known backlash and the one to be measured, so that what it gets wrong each time
# cancels. The uncertainty is the RMS error at levels that were left out.

# %%
known_rad = np.linspace(3e-4, 19e-4, calibration_levels)
own = calibration.calibrate([log(delta, 100 + k, turns=12) for k, delta in enumerate(known_rad)], known_rad, method)
ours = verdict.settings_for(form, own)
print(f"{own.method}: {own.range_rad[0]:.1e} to {own.range_rad[1]:.1e} rad, uncertainty {own.uncertainty_rad:.1e} rad")
calibrated = answer(log(backlash_rad, 0), ours)
print(verdict.as_text(calibrated.estimate))
figure = plots.estimate_figure(calibrated.recording, calibrated.model_rps, "your joint, the waveform of its backlash")
workbook.save_figure(
    figure,
    "own_joint_log",
    caption="The waveform of the estimate over the log: the residual is the log's noise.",
)

# %% [markdown]
# ### One log, without a calibration
#
# The first line is the answer; the joint's line gives what else the log shows of the joint; a `note` says what was
# assumed. For a log that no joint of this kind could have made, the answer is `cannot tell`.

# %%
uncalibrated = verdict.settings_for(form)
papers = verdict.settings_for(form, method="amplitude")
first = answer(log(backlash_rad, 0), uncalibrated)
print(verdict.as_text(first.estimate))

# %% [markdown]
# ### How much the calibration matters

# %%
true_rad = [5e-4, 8e-4, 11e-4, 14e-4, 17e-4]
rows = [
    {"calibration": name, "true_rad": delta} | verdict.as_row(answer(log(delta, 200 + k), settings).estimate)
    for k, delta in enumerate(true_rad)
    for name, settings in (("none", uncalibrated), ("the paper's joint", papers), ("your own", ours))
]
table = pd.DataFrame(rows)[["calibration", "true_rad", "verdict", "backlash_rad", "method"]]
table["error_rad"] = table["backlash_rad"].astype(float) - table["true_rad"]
workbook.save_table(table, "own_joint")
table.sort_values(["calibration", "true_rad"])

# %% [markdown]
# ### Over the months

# %%
dates = pd.date_range("2026-01-05", periods=8, freq="28D")
worn_rad = np.linspace(5e-4, 9.2e-4, dates.size)
logs = [answer(log(delta, 300 + k), ours).estimate for k, delta in enumerate(worn_rad)]
line = trend_line.fit_trend(logs, dates, limit_rad)
print(line)
figure = plots.trend_figure(line)
workbook.save_figure(
    figure,
    "own_joint_trend",
    caption="Dated answers, the line through them and the time at which it crosses the limit, with their intervals.",
)

# %% [markdown]
# ### What it refuses
#
# A sensor must refuse logs that it cannot judge. Its answers on five such logs:

# %%
good = log(backlash_rad, 0)
rubbed = replace(bench, joint=replace(bench.joint, load_coulomb_nm=0.2 * bench.joint.gravity_torque_nm))
noise = np.random.default_rng(bench_seed).normal(0, 5.0, good.v.size)
odd = {
    "no backlash at all": log(0.0, 1),
    "the turn's period taken wrong by a half": replace(good, turn_period_s=1.5 * good.turn_period_s),
    "noise of 5 rps": replace(good, v=good.v + noise),
    "friction of 20 % of gravity, not there in the calibration": log(backlash_rad, 0, rubbed),
    "twice the largest backlash of the calibration": log(2 * own.range_rad[1], 2),
}
answers = [answer(record, ours, name).estimate for name, record in odd.items()]
print("\n".join(verdict.as_text(found) for found in answers))
workbook.save_table(pd.DataFrame([(a.file, a.verdict) for a in answers], columns=["log", "verdict"]), "own_joint_odd")

# %% [markdown]
# ## Verdict
#
# No number of the paper is judged here.

# %%
errors = table.groupby("calibration", sort=False)["error_rad"]
pd.DataFrame({"answers": errors.count(), "mean_abs_error_rad": errors.agg(lambda error: error.abs().mean())})

# %% [markdown]
# ## Try changing
#
# 1. `method = "amplitude"`: the paper's feature with your own calibration; it errs more than the waveform.
# 2. `log_turns = 4`: a third of the log; there are still answers, with wider intervals.
# 3. `bench_seed = 4`: another joint; your own calibration still beats the paper's.
