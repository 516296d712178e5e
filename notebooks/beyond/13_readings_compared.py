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
#     quick: {scored: [7], deltas_rad: [0.0011], repeats: 1, healthy: 20, seen_records: 5, loudness_rps: [0.1],
#       changes: [0.2]}
# ---

# %% [markdown]
# # 13 · Estimators compared: on the paper's joint, and on changed ones
#
# *You will see which estimator finds the [backlash](../glossary.md#backlash) in the motor speed most accurately, how
# accurate one can be at all, and what a changed joint does to each. Run time: 130 s.*
#
# ## Claim
#
# The paper estimates the backlash from one number, the amplitude $A$ of the motor speed, and asks how large the
# error of $A$ is (Table 2). It calibrates equation 10 on one simulated joint. It leaves open how accurately the
# backlash can be known at all, whether another estimator is more accurate, how small a backlash can be detected,
# and what happens on a joint that differs from the calibrated one.
#
# ## Method
#
# $v_i$ [rps], $i = 1 \dots n$, is the measured motor speed at the times $t_i$ [s], $T_f$ [s] the load's turn, and
# $h(t)$ [rps] the fitted [signature](../glossary.md#signature). Besides $A$ the signature has its *energy*, here its
# RMS over whole turns, and the *impact time* $t_0$:
#
# $$E = \sqrt{\frac{1}{n} \sum_{i=1}^{n} h(t_i)^2}$$
#
# A polynomial of the reading, fitted to logs of known backlash, turns $A$, $E$ and $t_0$ into $\delta$.
#
# *Waveform matching* uses the whole [settled](../glossary.md#settled) speed. $w(\varphi; \delta)$ [rps] is the settled
# speed at the phase $\varphi$ [turns] for the backlash $\delta$ [rad], less its mean; $\bar v$ is the mean of $v$:
#
# $$(\hat\delta, \hat\varphi) = \arg\min_{\delta, \varphi}
# \sum_{i=1}^{n} \left[v_i - \bar v - w(t_i / T_f - \varphi; \delta)\right]^2$$
#
# For method `waveform`, $w$ is interpolated between simulated waveforms of known backlash. For method `joint` it is
# simulated anew for each $\delta$, with nothing else unknown; the same with the start angle free, and with start angle,
# friction and load free.
#
# *The limit.* Let $\theta = (\delta, \dots)$ be the unknowns and $S_{ki} = \partial w(t_i) / \partial \theta_k$, less
# its mean over $i$. In white noise of the SD $\sigma$ [rps] no unbiased estimator has a smaller SD than the Cramér-Rao
# bound
#
# $$\sigma_\delta \ge \sqrt{\left[F^{-1}\right]_{\delta\delta}}, \qquad F = \frac{S S^\mathsf{T}}{\sigma^2}$$
#
# *A rival: the time in the gap.* Villwock and Pacas (IEEE Transactions on Industrial Electronics 56(2), 2009) integrate
# the speed from the separation of the teeth, $t_1$, to their impact, $t_2$; the paper names them. With the motor's
# speed $\omega_m$ and the load's $\omega_l$ [rad/s], and the gear ratio $N$:
#
# $$2\delta = \left|\int_{t_1}^{t_2} \left(\frac{\omega_m}{N} - \omega_l\right) \mathrm{d}t\right|$$
#
# They let a triangular speed command cross the gap at reversals. Here the speed is constant, and gravity opens the gap.
# Only $\omega_m$ is measured, so that four assumptions are needed:
#
# 1. The teeth part where gravity's torque changes its sign: $t_1$ follows from the load's angle, which is known.
# 2. $t_2$ is the sharpest bend of the mean settled turn (largest second derivative after smoothing).
# 3. At $t_1$ motor and load have the same speed: the contact is rigid.
# 4. In the gap the load falls freely, without friction, and its ratio $\gamma = m g r / J_l$ [1/s²] of gravity's torque
#    to inertia is known: $\omega_l(t) = \omega_m(t_1)/N - \int_{t_1}^{t} \gamma \sin\theta_l\,\mathrm{d}t'$ with the
#    commanded load angle $\theta_l$. The alternative is a load that keeps its speed.
#
# It needs no calibration. Other methods excite the joint otherwise, or measure more: Ruderman, Yamada and Fujimoto
# ([2019](https://doi.org/10.48550/arXiv.1802.06246)) drive the motor in a limit cycle inside the gap with a delayed
# relay; Tantau et al. ([2020](https://www.scitepress.org/Papers/2020/98053/)) add an accelerometer on the load;
# Merzouki et al. (2007) observe the transmitted torque.
#
# *Fairness.* On the authors' noisy logs calibration leaves out the log's [level](../glossary.md#level) and uses the
# other noise [realisation](../glossary.md#realisation). The simulated joint was identified from four clean records (K =
# 3, 6, 9, 12) of the same simulator, never from a noisy one; its structure was chosen with all eleven clean records in
# view. Errors on the levels that it was not identified from stand beside those on all. Methods are compared on logs of
# the joint that they know; what follows under "A changed joint" is for methods that do not know the change.

# %%
import numpy as np
import pandas as pd
from matplotlib import pyplot as plt
from scipy import stats

import workbook
from backlash.fitting.waveform import mean_turn
from replication import published
from replication.authors import level_delta_rad, load_noisy
from replication.recording import add_uniform_noise
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings
from replication.simulator.reidentify import FIT_LEVELS
from replication.simulator.simulate import simulate
from replication.statistics import rate_columns
from studies import accuracy, benchmark, gap_time, plots
from studies.joint_match import PHASES, simulate_turn
from workbook import Interval

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
scored = range(3, 12)  # levels K of the authors' noisy logs, of which 2 to 12 calibrate
deltas_rad = [5e-4, 15e-4]  # backlashes of simulated records
repeats = 3  # simulated records of each setting and backlash
smoothing_s = 0.01  # window in which the impact that ends the time in the gap is located
healthy = 200  # records without backlash that set the threshold, and as many that try it
seen_records = 30  # records of each backlash to be seen
loudness_rps = [0.1, 0.3]  # half-amplitude of their uniform noise
false_alarm_rate = 0.01  # share of records of the healthy joint that may lie above the threshold
power = 0.95  # share of records in which a backlash must be seen
changes = [-0.2, 0.2]  # relative changes of the joint
left_out = []  # parameters, of `accuracy.CHANGES`, that do not change

# %% tags=["plumbing"]
workbook.check_parameters(
    scored=(scored, [range(2, 12)]),
    deltas_rad=(deltas_rad, [Interval(1e-4, 25e-4)]),
    repeats=(repeats, range(1, 31)),
    smoothing_s=(smoothing_s, Interval(4e-3, 0.05)),
    healthy=(healthy, Interval(10, 10000, whole=True)),
    seen_records=(seen_records, Interval(1, 10000)),
    loudness_rps=(loudness_rps, [Interval(1e-3, 10)]),
    false_alarm_rate=(false_alarm_rate, Interval(1e-4, 0.5)),
    power=(power, Interval(0.5, 0.999)),
    changes=(changes, [Interval(-0.5, 0.5)]),
    left_out=(left_out, [list(accuracy.CHANGES)]),
)

# %% [markdown]
# ## Result
#
# ### The authors' noisy logs
#
# Each method reads each log; the calibrated ones are calibrated without its level.

# %%
joint = identified_joint()
records = {(R, K): load_noisy(K, R) for R in (1, 2) for K in range(2, 13)}
errors = accuracy.cross_validation(records, joint, scored, smoothing_s)
summary = benchmark.summarise_errors(errors)
fresh = errors[~errors["level"].isin(FIT_LEVELS)]
summary["mean_abs_error_fresh_levels_rad"] = benchmark.summarise_errors(fresh)["mean_abs_error_rad"]


def in_microradians(table):
    scaled = (1e6 * table.filter(like="_rad")).round(2)
    return table.assign(**scaled).rename(columns=lambda name: name.replace("_rad", "_urad"))


in_microradians(summary)

# %% [markdown]
# The targets are mean errors on these logs, one for the energy and one for the waveform and the joint's methods.

# %%
targets_rad = {"energy": 1.5e-5} | dict.fromkeys(["waveform", *benchmark.JOINT_METHODS], 1e-5)
beyond_features = plots.cross_validation_errors(errors, targets_rad)

# %% [markdown]
# What the noise alone costs at least on these logs is the Cramér-Rao bound, with the start known or free. `slopes`
# holds the rows of $S$ over one turn, by $\delta$ and by the start angle. The mean size of a normal error is
# $\sqrt{2/\pi}$ times its SD.

# %%
STARTS = {"known": 1, "free": 2}  # unknowns: the backlash, and the start angle


def bound_rad(
    slopes, settings
):  # least SD of the backlash from a log with these settings, its first turn left out
    turn_s, rate = joint.turn_period_s, settings["sampling_hz"]
    t = np.arange(round(max(int(settings["turns"]) - 1, 1) * turn_s * rate)) / rate
    noise_sd, drift = settings["noise_half_amplitude_rps"] / np.sqrt(3), []
    if bits := settings["encoder_bits"]:  # the noise is in the position: rounding, taken for white
        slopes = np.cumsum(slopes - slopes.mean(axis=1, keepdims=True), axis=1) * turn_s / PHASES
        noise_sd, drift = 2.0**-bits / np.sqrt(12), [t - t.mean()]
    phase_s = np.arange(PHASES) * turn_s / PHASES
    S = [np.interp(t, phase_s, slope, period=turn_s) for slope in slopes]
    return accuracy.cramer_rao_sd(np.array([*S, *drift]), noise_sd)


noise = dict(enumerate(published.column("Table 2", "noise"), start=2))  # by level
slopes = {level: accuracy.waveform_slopes(joint, level_delta_rad(level)) for level in scored}
bounds = {
    start: [
        bound_rad(slopes[K][:free], accuracy.USUAL | {"noise_half_amplitude_rps": noise[K]})
        for K in scored
    ]
    for start, free in STARTS.items()
}
bound = pd.DataFrame(
    [(start, np.sqrt(2 / np.pi) * np.mean(sds)) for start, sds in bounds.items()],
    columns=["start", "mean_abs_error_rad"],
)
in_microradians(bound)

# %% [markdown]
# ### The time in the gap
#
# The simulator knows when the teeth part and meet, and where motor and load are. With these instants the integral is
# the gap, by definition. The table shows $\hat\delta / \delta$: first with the true motion of the load, then with each
# assumption in its place, on clean records and on ones with the first of `loudness_rps` as noise (RMS of
# $\hat\delta/\delta - 1$ over `repeats` records).

# %%
rng, turn_s, N = np.random.default_rng(1), joint.turn_period_s, joint.gear_ratio


def first_gap(
    delta_rad,
):  # of the settled turns: the simulated motion, the displacement, separation and impact
    run = simulate(joint, delta_rad, duration_s=3 * turn_s, sample_s=5e-5, step_s=5e-5)
    t1 = next(t for t in run.separation_time_s if t > turn_s)
    t2 = next(t for t in run.impact_time_s if t > t1)
    return run, run.motor_position_rad / N - run.load_position_rad, t1, t2


def mean_crossing_rad(turn, gaps, falls):
    return np.mean([gap_time.crossing_rad(turn, joint, gap, falls) for gap in gaps])


rows = []
for delta_rad in [3e-4, 5e-4, 9e-4, 15e-4, 21e-4]:
    run, displacement, t1, t2 = first_gap(delta_rad)
    start, end = np.interp([t1, t2], run.time_s, displacement)
    (clean,) = simulate_recordings(joint, [delta_rad])
    turn = mean_turn(clean, 200)
    known, found = [(t1 - turn_s, t2 - turn_s)], gap_time.find_gaps(turn, joint, smoothing_s)
    read_rad = {
        "true_motion": abs(end - start) / 2,
        "known_instants_falling": mean_crossing_rad(turn, known, falls=True),
        "known_instants_constant_speed": mean_crossing_rad(turn, known, falls=False),
        "found_instants_falling": mean_crossing_rad(turn, found, falls=True),
        "found_instants_constant_speed": mean_crossing_rad(turn, found, falls=False),
    }
    noisy = [add_uniform_noise(clean, loudness_rps[0], rng) for _ in range(repeats)]
    off = [gap_time.time_in_gap(record, joint, smoothing_s) / delta_rad - 1 for record in noisy]
    shares = {name: value / delta_rad for name, value in read_rad.items()}
    shares["noisy_rms_error"] = np.sqrt(np.mean(np.square(off)))
    rows.append({"delta_rad": delta_rad, "time_in_gap_s": t2 - t1, **shares})
gap_table = pd.DataFrame(rows)
gap_table.round(4)

# %% [markdown]
# The motor hardly moves against the commanded speed in the gap: the load falls through it. A load that keeps its speed
# leaves most of the gap unexplained. A rigid contact makes $\hat\delta$ too small: at the separation the coupling still
# untwists, so that the load is already faster or slower than the motor (exercise 3). The sharpest bend follows the
# impact by some milliseconds, which makes $\hat\delta$ larger: the two errors partly cancel. In noise the found bend
# jumps between samples, and 2 ms are about a tenth of the gap (exercise 2). The window of 10 ms was chosen with these
# errors in view.

# %%
run, displacement, t1, t2 = first_gap(15e-4)
turn = mean_turn(simulate_recordings(joint, [run.delta_rad])[0], 200)
guess = min(
    gap_time.find_gaps(turn, joint, smoothing_s), key=lambda gap: abs(gap[0] - (t1 - turn_s))
)
near = (run.time_s > t1 - 0.02) & (run.time_s < t2 + 0.03)
since_ms = 1e3 * (run.time_s[near] - t1)
_, (top, bottom) = plt.subplots(2, 1, figsize=(5.3, 4.4), sharex=True, layout="constrained")
top.plot(since_ms, run.motor_speed_rps[near], label="motor")
top.plot(since_ms, N * run.load_speed_rad_per_s[near] / (2 * np.pi), label="load, times N")
bottom.plot(since_ms, displacement[near] / run.delta_rad, label="displacement")
for axis in (top, bottom):
    for instants, style, name in (
        (np.array([t1, t2]), "-", "true instants"),
        (turn_s + np.array(guess), ":", "found instants"),
    ):
        at, across = 1e3 * (instants - t1), axis.get_xaxis_transform()
        axis.vlines(at, 0, 1, "0.3", style, label=name, transform=across)
    axis.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4)
top.set(ylabel="speed [rps]")
_ = bottom.set(xlabel="time since the separation [ms]", ylabel="displacement / $\\delta$ [-]")
# %% [markdown]
# ### The limit, and what the methods reach
#
# One thing changes at a time around the authors' records; each method reads `repeats` records of each backlash.

# %%
sweeps = {
    "noise_half_amplitude_rps": [0.02, 0.05, 0.1, 0.2, 0.5],
    "sampling_hz": [100, 200, 500, 1000, 2000],
    "turns": [2, 4, 12, 36],
    "encoder_bits": [8, 10, 12, 14, 16, 19],
}
found = accuracy.measured_errors(joint, deltas_rad, sweeps, repeats, seed=1)
slopes = [accuracy.waveform_slopes(joint, delta_rad) for delta_rad in deltas_rad]
limit = [
    {"axis": axis, "value": value, "method": f"bound, start {start}", "error_rad": sd}
    for start, free in STARTS.items()
    for axis, values in sweeps.items()
    for value in values
    for sd in [bound_rad(each[:free], accuracy.USUAL | {axis: value}) for each in slopes]
]
measured = benchmark.summarise_errors(
    pd.concat([found, pd.DataFrame(limit)]), ("axis", "value", "method")
)
measured = measured[["axis", "value", "method", "rmse_rad"]]
(1e6 * measured.pivot(index=["axis", "value"], columns="method", values="rmse_rad")).round(
    2
)  # RMS errors, 1e-6 rad

# %%
labels = {
    "noise_half_amplitude_rps": "half-amplitude of the noise [rps]",
    "sampling_hz": "sampling rate [Hz]",
    "turns": "load turns, the first left out [-]",
    "encoder_bits": "motor encoder alone [bits]",
}
beyond_limits = plots.error_limits(measured, labels)

# %% [markdown]
# With an encoder there is no other noise, and the methods are calibrated with a fine one whose positions are
# differenced alike: the bits limit them, until their own simplification does.
#
# ### The smallest backlash to be seen
#
# The threshold on the energy $E$ is set by records of the healthy joint for the allowed rate of false alarms, and tried
# on as many fresh ones. `smallest_seen_rad` (the table has it in 10⁻⁶ rad, as `_urad`) is the backlash from which on
# the share of records above the threshold stays at the asked power.

# %%
small_rad = [2e-5, 5e-5, 8e-5, 1.2e-4, 1.6e-4, 2e-4, 3e-4]
clean = simulate_recordings(joint, [0.0, *small_rad])
rows = []
for loudness in loudness_rps:
    rng = np.random.default_rng(round(1000 * loudness))
    threshold = np.quantile(
        accuracy.noisy_energy(clean[0], loudness, rng, healthy), 1 - false_alarm_rate
    )
    for delta_rad, record in zip([0.0, *small_rad], clean, strict=True):
        above = (
            accuracy.noisy_energy(record, loudness, rng, seen_records if delta_rad else healthy)
            > threshold
        )
        rate = rate_columns(int(above.sum()), above.size, "seen")
        rows.append({"noise_half_amplitude_rps": loudness, "delta_rad": delta_rad, **rate})
seen = pd.DataFrame(rows)
in_microradians(seen)

# %% [markdown]
# A matched filter detects a smaller backlash. Its output has the SD 1 in the noise, and the mean $d(\delta) =
# \sqrt{n}\,\mathrm{SD}_i\left[w_i(\delta) - w_i(0)\right]/\sigma$. With the quantiles $z$ of the normal distribution it
# sees $\delta$ if $d(\delta) \ge z_{1 - \alpha} + z_p$ for the false alarm rate $\alpha$ and the power $p$.

# %%
needed = stats.norm.isf(false_alarm_rate) + stats.norm.ppf(power)
tried_rad = np.geomspace(1e-6, 1e-3, 25)
w0 = simulate_turn(joint, 0.0, PHASES)
distance_rps = np.sqrt(11 * 200) * np.array(
    [np.std(simulate_turn(joint, d, PHASES) - w0) for d in tried_rad]
)
filtered_rad = [
    float(np.interp(needed, distance_rps / (half / np.sqrt(3)), tried_rad, right=np.nan))
    for half in loudness_rps
]


def smallest_seen_rad(part):  # interpolated; NaN if the share does not stay at the power
    last = max(np.flatnonzero(part["seen"] < power), default=0)
    pair = part.iloc[last : last + 2]
    return float(np.interp(power, pair["seen"], pair["delta_rad"])) if len(pair) == 2 else np.nan


columns = ["noise_half_amplitude_rps", "seen", "seen_low", "seen_high"]
detected = seen[seen["delta_rad"] == 0][columns].reset_index(drop=True)
detected = detected.rename(columns=lambda name: name.replace("seen", "false_alarms")).assign(
    smallest_seen_rad=[
        smallest_seen_rad(part) for _, part in seen.groupby("noise_half_amplitude_rps", sort=False)
    ],
    matched_filter_rad=filtered_rad,
)
beyond_detection = plots.detection_curves(seen, filtered_rad)
in_microradians(detected)

# %% [markdown]
# ### A changed joint
#
# Noise-free records of a joint of which one thing has changed, read by methods that do not know it: equation 10 as
# printed; amplitude, energy and waveform, calibrated on the joint as it was; and the joint simulated anew with start
# angle, friction and load unknown. The identified joint has no friction, so that friction grows from nothing to a share
# of gravity's torque.

# %%
changed = [
    (name, share)
    for name in accuracy.CHANGES
    for share in changes
    if name not in left_out and (share > 0 or "friction" not in name)
]
logs = []
for name, share in [*changed, ("nothing", 0.0)]:
    changed_joint = accuracy.CHANGES[name](joint, share) if share else joint
    for delta_rad, record in zip(
        deltas_rad, simulate_recordings(changed_joint, deltas_rad), strict=True
    ):
        logs.append(benchmark.KnownLog({"parameter": name, "change": share}, delta_rad, record))
moved = accuracy.errors_after_changes(logs, joint)
ends = moved.groupby(["parameter", "method", "change"], sort=False)["error_rad"]
ends = ends.agg(
    mean_error_rad="mean", max_abs_error_rad=lambda error: error.abs().max()
).reset_index()
(1e6 * ends.pivot(index=["parameter", "change"], columns="method", values="mean_error_rad")).round(
    1
)  # 1e-6 rad

# %% [markdown]
# The methods in the order of their RMS error over all changes; `unchanged_rmse_rad` (in the table `_urad`) is that on
# the joint as it was.

# %%
of_changed = moved[moved["change"] != 0].reset_index(drop=True)
ranked = benchmark.summarise_errors(of_changed)[["method", "rmse_rad", "max_abs_error_rad"]]
worst = of_changed["error_rad"].abs().groupby(of_changed["method"]).idxmax()
ranked["worst_parameter"] = of_changed["parameter"].loc[worst[ranked["method"]]].to_numpy()
ranked["unchanged_rmse_rad"] = benchmark.summarise_errors(moved[moved["change"] == 0])["rmse_rad"]
ranked = ranked.sort_values("rmse_rad", ignore_index=True)
in_microradians(ranked)

# %%
shown = ["equation 10", *accuracy.CALIBRATED_METHODS, benchmark.JOINT_ALL_FREE]
beyond_robustness = plots.tornado(ends[ends["change"] != 0], shown)

# %% [markdown]
# Friction moves the two impacts of a turn in opposite directions, so that the second no longer comes half a turn after
# the first. The signature has that built in ($T_d = T_f/2$), and so has any waveform of the joint without friction:
# all of them fail when friction is 20 % of the gravity torque. The joint model with friction unknown does not. All of
# this is on simulated logs of the identified joint, which that model describes exactly but for the change; on joints
# of another structure it is not known. A change of the drive's gains shifts every method.

# %% [markdown]
# ## Verdict
#
# No number of the paper is judged here. The answers:

# %%
mean_error = summary.set_index("method")["mean_abs_error_rad"]
for method, target in targets_rad.items():
    verdict = "meets" if mean_error[method] <= target else "misses"
    print(f"{method}: mean error {mean_error[method]:.2e} rad, {verdict} {target:g}")
best, rival = mean_error.idxmin(), mean_error["time in the gap"]
print(
    f"On the authors' noisy logs the method '{best}' errs least, by {mean_error[best]:.1e} rad on average; equation 10 "
    f"errs by {mean_error['equation 10']:.1e} rad, the time in the gap by {rival:.1e} rad."
)
for row in detected.itertuples():
    print(
        f"In noise of {row.noise_half_amplitude_rps:g} rps backlash is seen from {row.smallest_seen_rad:.1e} rad on; a "
        f"matched filter would see it from {row.matched_filter_rad:.1e} rad on."
    )
first, last = ranked.iloc[0], ranked.iloc[-1]
print(
    f"Over all changes of the joint the method '{first.method}' errs least (RMS {first.rmse_rad:.1e} rad, at most "
    f"{first.max_abs_error_rad:.1e} rad, when the {first.worst_parameter} changes); the method '{last.method}' errs "
    f"most (RMS {last.rmse_rad:.1e} rad)."
)

# %% tags=["plumbing"]
workbook.export(
    supplement={
        "features_logs": (errors, "Error of each estimator on each of the authors' noisy logs."),
        "features": (summary, "The errors of each estimator, summarised."),
        "limits": (
            measured,
            "Errors against noise, sampling rate, turns and encoder bits, with their bound.",
        ),
        "detection": (detected, "The smallest backlash that shows, by noise."),
        "robustness": (ends, "Errors after one parameter of the joint has changed."),
        "robustness_ranking": (ranked, "The estimators by their errors over all changes."),
    },
    facts={
        "eq10_error": (mean_error["equation 10"], ".1e"),
        "joint_error": (mean_error["joint, all nuisances free"], ".1e"),
    },
    figures={
        "beyond_features": (
            beyond_features,
            f"Size of each method's error on {len(errors) // len(summary)} simulated noisy logs of the authors "
            f"({len(scored)} backlashes, two noises), one marker per log. Bars are mean sizes; dotted bars are the "
            "targets that some methods had. Of the calibrated methods the amplitude errs most; the whole waveform and "
            "the joint model err least. The time in the gap needs no calibration, and errs as much as the amplitude "
            "or more.",
        ),
        "beyond_limits": (
            beyond_limits,
            f"RMS error of four methods (markers) over {repeats * len(deltas_rad)} simulated records, against (a) "
            "noise, (b) sampling rate, (c) turns and (d) encoder bits, with the Cramér-Rao bound (lines). The joint "
            "model stays close to the bound, the amplitude far above it. In (d), on a scale of its own, the encoder's "
            "rounding is the only noise, and the joint model, which is fitted to speeds, is not applied.",
        ),
        "beyond_detection": (
            beyond_detection,
            f"Share of records in which the energy of the fitted signature shows backlash, of {seen_records} records a "
            f"point and {healthy} without backlash, with 95 % intervals. Vertical lines: the smallest backlash that a "
            "filter matched to the waveform would see. It is far smaller.",
        ),
        "beyond_robustness": (
            beyond_robustness,
            f"Mean error on {len(deltas_rad)} noise-free records of a joint in which one parameter has changed, "
            f"without recalibration, {len(shown)} methods. Friction grows from zero to the given share of gravity's "
            "torque. It misleads every method but the joint model.",
        ),
    },
)

# %% [markdown]
# ## Try changing
#
# 1. `smoothing_s = 0.02`: the impact is found later, and the time in the gap reads every log's backlash too large.
# 2. `false_alarm_rate = 0.1`: more false alarms allowed; the threshold falls, and a smaller backlash is seen.
# 3. `left_out = ["load Coulomb friction", "load viscous friction"]`: without friction all methods but the joint's match
#    err at least a third less; that one gains nothing, and leads by little.
#
# ## Exercises
#
# **1.** The amplitude $a$ of $a \sin(2\pi f t)$ is to be estimated from $n$ samples over whole periods, in white noise
# of SD $\sigma$. Which SD does the Cramér-Rao bound leave? Check it with `accuracy.cramer_rao_sd`.

# %% tags=["solution"]
n, sigma = 2000, 0.1
sine = np.sin(2 * np.pi * 5 * np.arange(n) / n)  # the slope by a; the sum of its squares is n / 2
by_hand = sigma / np.sqrt(sine @ sine)
assert np.isclose(by_hand, sigma * np.sqrt(2 / n))
assert np.isclose(by_hand, accuracy.cramer_rao_sd(sine[None, :], sigma))
print(f"sigma sqrt(2 / n) = {by_hand:.2g}")

# %% [markdown]
# **2.** Neglect the motor's motion and start the load at the motor's speed where $\sin\theta_l$ changes its sign:
# $\ddot{x} = \gamma \Omega t$ with the load's commanded speed $\Omega$ [rad/s]. How long is the time in the gap
# $2\delta$, and by how much does $\hat\delta$ change if the impact is found 2 ms late?

# %% tags=["solution"]
gamma, omega, delta_rad = joint.ratios["gravity_per_s2"], 2 * np.pi / turn_s, 15e-4
time_s = (12 * delta_rad / (gamma * omega)) ** (1 / 3)  # from 2 delta = gamma omega t^3 / 6
late = ((time_s + 2e-3) / time_s) ** 3 - 1  # nearly 3 dt / t
simulated_s = gap_table.set_index("delta_rad")["time_in_gap_s"][delta_rad]
assert abs(time_s / simulated_s - 1) < 0.1
print(f"{1e3 * time_s:.1f} ms (simulated {1e3 * simulated_s:.1f} ms); {100 * late:.0f} % more")

# %% [markdown]
# **3.** Before it parts, the coupling carries the torque $m g r \sin\theta_l$ with the stiffness $K_s$. How fast does
# its twist change at the separation, and which share of $2\delta$ does that add over the time in the gap?

# %% tags=["solution"]
twist_rate = (
    joint.gravity_torque_nm * omega / joint.stiffness_nm_per_rad
)  # rad/s, where cos(theta_l) is 1
row = gap_table.set_index("delta_rad").loc[delta_rad]
added = twist_rate * row["time_in_gap_s"] / (2 * delta_rad)
assert abs(row["known_instants_falling"] + added - 1) < abs(row["known_instants_falling"] - 1) / 2
print(
    f"{twist_rate:.3g} rad/s: {row['known_instants_falling']:.2f} becomes {row['known_instants_falling'] + added:.2f}"
)
