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
# # 4 · The simulator against the published signals (figure 10)
#
# *You will see how far a simulated joint agrees with the published speed, and what friction, inertia and gear ratio
# change. Run time: 8 s.*
#
# ## Claim
#
# The simulator reproduces the behaviour of the joint with [backlash](glossary.md#backlash): position, speed and current
# of the bench and of the simulator, superimposed (section "Matlab/Simulink model of the robotic joint", figure 10).
#
# ## Method
#
# The simulated joint has notebook 3's equations of motion and drive, and equations 8 and 9 for the torque in the
# coupling. The bench's signals are not public. What can be compared is the motor speed $v$ [rps], with the records that
# the authors' own simulator made; position and torque (the current times a constant) are shown as our simulator has
# them. Per [level](glossary.md#level) K, two numbers say how well they agree, over the [settled](glossary.md#settled)
# turns, after the first turn of the duration $T_f = N / v_t$ [s] with the gear ratio $N$ and the commanded motor speed
# $v_t$ [rps]. The misfit is over the $n$ samples of 2 ms, in units of the record's SD $s_K$ [rps]:
#
# $$\text{NRMSE} = \frac{1}{s_K} \sqrt{\frac{1}{n} \sum_{t_i \ge T_f}
# \left[v_\text{simulated}(t_i) - v_K(t_i)\right]^2}$$
#
# The settled peak, before sampling, is our reading of the [theoretical $A$](glossary.md#theoretical-a) [rps]:
#
# $$A = \max_{t \ge T_f} v(t) - v_t$$
#
# The limits for both are set under *Verdict*. The model's structure was chosen with these records and peaks in
# view (notebook 3), so this shows how well it fits, and is no independent validation. The verdicts on the printed $A$
# therefore rest on the clean records alone where these are public: their settled turns, interpolated.
#
# Coulomb friction $\tau_c$ [N m] adds to gravity on the load, whose speed $\omega_l$ [rad/s] does not change its sign:
#
# $$J_l \dot\omega_l = \tau_l - m g r \sin\theta_l - \tau_c, \qquad \tau_c = \text{friction share} \cdot m g r$$

# %%
from dataclasses import replace

import numpy as np
import pandas as pd

import workbook
from replication import table2
from replication.authors import CLEAN_LEVELS, level_delta_rad, load_clean_records
from replication.figures import paper
from replication.recording import COMMANDED_SPEED_RPS, TURN_PERIOD_S, Recording
from replication.replay.inspection import interpolated_peak_rps
from replication.simulator.identification import FINE_S
from replication.simulator.parameters import (
    changeable,
    changed_joint,
    identified_joint,
    joint_from_ratios,
)
from replication.simulator.recordings import SIMULATION_STEP_S, simulate_recordings
from replication.simulator.reidentify import FIT_LEVELS
from replication.simulator.simulate import simulate, simulate_many
from workbook import Interval

# %% [markdown]
# ## Parameters
#
# `changes` multiplies by factors. A *ratio* of notebook 3 (such as `stiffness_per_s2`, `inertia_ratio`,
# `speed_gain_per_s`) is changed with the other ratios kept: half the `inertia_ratio` doubles the motor's inertia *and*
# all gains. A *physical quantity* (such as `motor_inertia_kgm2`, `gear_ratio`, `load_mass_kg` or
# `speed_gain_nms_per_rad`) is changed alone; `load_mass_kg` changes gravity, and not `load_inertia_kgm2`.

# %% tags=["parameters"]
level = 8  # the authors' record K that is drawn
friction_share = 0.0  # Coulomb friction on the load as a share of m g r
changes = {}  # factors for ratios or physical quantities, such as {"motor_inertia_kgm2": 2.0}

# %% tags=["plumbing"]
workbook.check_parameters(
    level=(level, CLEAN_LEVELS),
    friction_share=(friction_share, Interval(0, 0.5)),
    changes=(changes, [changeable(identified_joint())]),
)
workbook.check_parameters(factors=(list(changes.values()), [Interval(0, 100)]))

# %% [markdown]
# ## Result
#
# ### The joint

# %%
committed = identified_joint()
joint = changed_joint(committed, changes)
joint = replace(
    joint, load_coulomb_nm=joint.load_coulomb_nm + friction_share * joint.gravity_torque_nm
)
records = load_clean_records(CLEAN_LEVELS)
compared = np.isclose(
    [joint.commanded_speed_rps, joint.turn_period_s], [COMMANDED_SPEED_RPS, TURN_PERIOD_S]
).all()
if not compared:
    print(
        f"This joint turns in {joint.turn_period_s:g} s at {joint.commanded_speed_rps:g} rps, that of the records in "
        f"{TURN_PERIOD_S:g} s at {COMMANDED_SPEED_RPS:g} rps: it is not compared with the records."
    )
changed = [f"{name} times {factor:g}" for name, factor in changes.items()]
changed += [f"friction of {100 * friction_share:g} % of m g r"] * (friction_share > 0)
fields = [
    "motor_inertia_kgm2",
    "load_inertia_kgm2",
    "gear_ratio",
    "load_mass_kg",
    "stiffness_nm_per_rad",
    "speed_gain_nms_per_rad",
    "integral_gain_nm_per_rad",
    "load_coulomb_nm",
    "turn_period_s",
]
of_joint = {name: [getattr(committed, name), getattr(joint, name)] for name in fields}
pd.DataFrame(of_joint, index=["committed", "simulated here"]).T.map("{:.4g}".format)

# %% [markdown]
# ### Figure 10
#
# Two settled turns.

# %%
delta_rad = level_delta_rad(level)
run = simulate(joint, delta_rad, duration_s=12 * joint.turn_period_s, step_s=SIMULATION_STEP_S)
shown = (run.time_s >= 2 * joint.turn_period_s) & (run.time_s <= 4 * joint.turn_period_s)
start_rad = joint.gear_ratio * joint.start_angle_rad
motion = run.motor_position_rad - start_rad - joint.commanded_speed_rad_per_s * run.time_s
displacement = run.motor_position_rad / joint.gear_ratio - run.load_position_rad
recorded = records[delta_rad].v if compared else None
signals = [
    ("$\\theta_m - N \\theta_0 - \\Omega t$\n[rad]", motion[shown], None),
    ("motor speed\n[rps]", run.motor_speed_rps[shown], recorded[shown] if compared else None),
    ("motor torque\n[N m]", run.motor_torque_nm[shown], None),
    ("$\\theta_m / N - \\theta_l$\n[$10^{-4}$ rad]", 1e4 * displacement[shown], None),
]
if compared:
    signals.insert(
        2, ("simulated $-$\nrecord [rps]", (run.motor_speed_rps - recorded)[shown], None)
    )
figure10 = paper.simulated_joint(run.time_s[shown], signals)
for edge in (-1e4, 1e4):
    figure10.axes[-1].axhline(edge * delta_rad, color="0.5", linestyle=":")

# %% [markdown]
# ### Level by level
#
# Misfit and peak of a run. 40 fine samples are 2 ms, and 200 samples of 2 ms the first turn of a record.

# %%
levels = {level_delta_rad(k): k for k in range(2, CLEAN_LEVELS.stop)}  # K = 2 has a printed A alone


def nrmse(run, record):
    error = (run.motor_speed_rps[::40] - record.v)[200:]
    return np.sqrt(np.mean(error**2)) / record.v[200:].std()


def peak_rps(run, joint):
    return run.motor_speed_rps[run.time_s >= joint.turn_period_s].max() - joint.commanded_speed_rps


def finely(joint, deltas_rad=tuple(levels)):
    return simulate_many(
        joint, deltas_rad, duration_s=12 * joint.turn_period_s, sample_s=FINE_S, step_s=FINE_S
    )


# %% [markdown]
# For every level, with the change of the peak from that of the committed joint:

# %%
printed = table2.theoretical_amplitudes()
rows = [
    {
        "dataset": f"Speeddata{k}",
        "delta_rad": delta,
        "used_in_fit": k in FIT_LEVELS,
        "nrmse": nrmse(run_k, records[delta]) if compared and delta in records else np.nan,
        "peak_rps": peak_rps(run_k, joint),
        "printed_A_rps": printed.get(delta, np.nan),
    }
    for (delta, k), run_k in zip(levels.items(), finely(joint), strict=True)
]
table = pd.DataFrame(rows)
table["peak_error_percent"] = (
    100 * (table["peak_rps"] / table["printed_A_rps"] - 1) if compared else np.nan
)
peak_change_percent = 100 * (
    table["peak_rps"] / [peak_rps(run_k, committed) for run_k in finely(committed)] - 1
)
table.assign(peak_change_percent=peak_change_percent.round(2))

# %%
validation = paper.validation(table)

# %% [markdown]
# ### The peaks without a simulator
#
# The settled turns of a record are periodic and have $n$ samples $v_j$ of $\Delta t$ = 2 ms. Between the samples we
# take their Fourier series, the band-limited interpolation. It has no parameter to choose and no model of the joint:
#
# $$v(t) = \sum_{k=-n/2}^{n/2} c_k\, e^{2\pi i k t / (n \Delta t)}, \qquad
# c_k = \frac{1}{n} \sum_{j=0}^{n-1} v_j\, e^{-2\pi i k j / n}$$
#
# (the two coefficients at $k = \pm n/2$ are halved). Simulated signals, whose peak before sampling is known, tell how
# well this finds it. They are sampled at each of 40 phases within 2 ms, and rounded to 0.01 rps like the records.


# %%
def sampled(run, phase):
    t, v = run.time_s[phase::40], run.motor_speed_rps[phase::40]
    return Recording(
        t - t[0],
        np.round(v, 2),
        committed.commanded_speed_rps,
        committed.turn_period_s,
        "simulated",
    )


of_interpolation = 100 * np.array(
    [
        interpolated_peak_rps(sampled(run, phase)) / peak_rps(run, committed) - 1
        for run in finely(committed, list(printed)[1:])
        for phase in range(40)
    ]
)
pd.Series(
    {
        "rms error [%]": np.sqrt(np.mean(of_interpolation**2)),
        "mean [%]": of_interpolation.mean(),
        "lowest [%]": of_interpolation.min(),
        "highest [%]": of_interpolation.max(),
        "beyond 2.5 % [% of cases]": 100 * np.mean(np.abs(of_interpolation) > 2.5),
    }
).to_frame("interpolated peak, simulated signals").round(1)

# %% [markdown]
# The authors' clean records, at the levels of Table 2 that are public (K = 3 to 11; row 1 has none). We kept the
# tolerance of 2.5 % that our simulator's peaks had. When we did, it was known that the interpolated peaks agree within
# 2.3 %, so their agreement was no surprise.

# %%
traced = pd.DataFrame(
    [
        {
            "dataset": f"Speeddata{levels[delta]}",
            "largest_sample_rps": records[delta].v[200:].max() - COMMANDED_SPEED_RPS,
            "interpolated_rps": interpolated_peak_rps(records[delta]),
            "printed_A_rps": A,
        }
        for delta, A in printed.items()
        if delta in records
    ],
    index=pd.Index(
        [row for row, delta in enumerate(printed, start=1) if delta in records], name="row"
    ),
)
traced["error_percent"] = 100 * (traced["interpolated_rps"] / traced["printed_A_rps"] - 1)
traced.round(4)

# %% [markdown]
# ### How late the positive impact comes
#
# The two impacts are half a turn apart only in the paper's model of the [signature](glossary.md#signature). In the
# records the positive one is late, the more the wider the gap, because gravity turns with the load, and the load lags
# by the gap. The simulated joint shows it too.
#
# The delay $\Delta t$ [s] is the slope of a phase: of the cross spectrum $X$ between the half turn $v_-$ after the
# negative impact, with its sign changed, and the half turn $v_+$ after the positive one. The fit takes the frequencies
# $f$ below 100 Hz and weighs each phase by $|X|$.
#
# $$X(f) = \overline{\mathcal{F}\{-v_-\}(f)}\; \mathcal{F}\{v_+\}(f), \qquad \arg X(f) = -2\pi f \Delta t, \qquad
# \Delta t = -\frac{\sum |X| f \arg X}{2\pi \sum |X| f^2}$$


# %%
def positive_impact_delay_s(record):
    t = record.turn_period_s * np.arange(200, 1200) / 200  # turns 2 to 6, averaged into one
    turn = (
        np.interp(t, record.t, record.v - record.commanded_speed_rps).reshape(5, 200).mean(axis=0)
    )
    negative, positive = (
        (turn[:100], turn[100:])
        if -turn[:100].min() > turn[:100].max()
        else (turn[100:], turn[:100])
    )
    X = np.conj(np.fft.rfft(-negative)) * np.fft.rfft(positive)
    f = np.fft.rfftfreq(100, record.turn_period_s / 200)
    band = (f > 0) & (f < 100)
    X, f = X[band], f[band]
    return -np.sum(np.abs(X) * f * np.angle(X)) / np.sum(np.abs(X) * f**2) / (2 * np.pi)


every_second = list(records)[::2]
lateness = pd.DataFrame(
    {
        "delta_rad": every_second,
        "record_ms": [
            1e3 * positive_impact_delay_s(records[d]) if compared else np.nan for d in every_second
        ],
        "simulated_ms": [
            1e3 * positive_impact_delay_s(record)
            for record in simulate_recordings(joint, every_second)
        ],
    }
)
lateness.round(4)

# %% [markdown]
# ## Verdict

# %%
peaks = table.dropna(subset="printed_A_rps")["peak_rps"]
by_source = {
    "authors": traced["interpolated_rps"],
    "simulated": pd.Series(peaks.to_numpy(), index=range(1, peaks.size + 1)) if compared else {},
}
cells = {
    source: {f"table2.row{row:02d}.theoretical": peak for row, peak in found.items()}
    for source, found in by_source.items()
}
display(workbook.judge(cells))
name = f"The changed joint ({', '.join(changed)})" if changed else "The identified joint"
mean, worst, off = (
    100 * table["nrmse"].mean(),
    100 * table["nrmse"].max(),
    table["peak_error_percent"].abs().max(),
)
if compared:
    limits = {"mean": 5.0, "worst": 6.5, "peak": 2.5}  # percent
    met = (
        "meets"
        if mean < limits["mean"] and worst < limits["worst"] and off < limits["peak"]
        else "does not meet"
    )
    print(
        f"{name} {met} the limits: it misses the records by {mean:.1f} % of their SD on average ({limits['mean']:g} %) "
        f"and {worst:.1f} % at worst ({limits['worst']:g} %), and its peaks differ from the printed ones by up to "
        f"{off:.2g} % ({limits['peak']:g} %)."
    )
else:
    print(
        f"{name} turns in {joint.turn_period_s:g} s at {joint.commanded_speed_rps:g} rps and is not compared with the "
        f"records of {TURN_PERIOD_S:g} s at {COMMANDED_SPEED_RPS:g} rps."
    )
print(
    f"Read from the authors' clean records without a simulator, the peaks of {traced['error_percent'].size} levels lie "
    f"within {traced['error_percent'].abs().max():.1f} % of the printed A: traced, not computed anew. The smallest "
    "level has no public clean record."
)
print(
    f"Against the committed joint its peaks change by {peak_change_percent.min():+.1f} to "
    f"{peak_change_percent.max():+.1f} %, on average {peak_change_percent.mean():+.1f} %."
    if changed
    else "The peaks helped to choose the model's structure: the agreement is a fit, not a validation."
)

# %% tags=["plumbing"]
panels = [
    "motor position less the commanded one",
    "motor speed",
    "motor torque (the current times a constant)",
    "motor position over N less the load's position, with the edges of the gap (dotted)",
]
if compared:
    panels.insert(
        2, f"simulated less recorded speed, at most {np.abs(signals[2][1]).max():.2g} rps"
    )
listed = ", ".join(f"({letter}) {panel}" for letter, panel in zip("abcde", panels, strict=False))
used = table["used_in_fit"]
workbook.export(
    supplement={
        "simulator_validation": (
            table,
            "The simulator against every clean record and every printed amplitude.",
        )
    },
    facts={
        "nrmse_records": table["nrmse"].count(),
        "nrmse_used": table.loc[used, "nrmse"].count(),
        "nrmse_mean": (mean, ".1f"),
        "nrmse_largest": (worst, ".1f"),
        "nrmse_left_out": (100 * table.loc[~used, "nrmse"].max(), ".1f"),
        "peak_error": (off, ".1f"),
        "interpolated_error": (traced["error_percent"].abs().max(), ".1f"),
    },
    figures={
        "figure10_simulator": (
            figure10,
            f"Two settled turns of our joint at level {level}, a backlash of {1e4 * delta_rad:g}·10⁻⁴ rad: {listed}. "
            + (
                "Only the speed is published."
                if compared
                else "It turns at another speed than the published records."
            ),
        ),
        "figure10_validation": (
            validation,
            f"{name} (a) against the {len(records)} published clean records and (b) against the {len(peaks)} printed "
            "amplitudes. The levels that the fit of the ratios does not use (circles) show errors of the same size as "
            "those that it uses (squares). The model's structure was chosen with all of these in view.",
        ),
    },
    cells=cells,
)

# %% [markdown]
# ## Try changing
#
# 1. `changes = {"stiffness_per_s2": 1.05}`: 5 % more stiffness, a faster ring, and nearly six times the misfit.
# 2. `changes = {"start_angle_rad": 0.5}`: the impacts come at another time; three quarters of the signal are missed.
# 3. `level = 13`: the widest gap that is public; the speed still lies within the line's width.
#
# ## Exercises
#
# **1.** Double the motor's inertia in two ways: `{"inertia_ratio": 0.5}` and `{"motor_inertia_kgm2": 2.0}`. How do the
# peaks at $\delta$ = 15·10⁻⁴ rad change, and what else differs between the two joints?

# %% tags=["solution"]
ways = {
    "committed": {},
    "inertia_ratio": {"inertia_ratio": 0.5},
    "motor_inertia_kgm2": {"motor_inertia_kgm2": 2.0},
}
joints = {way: changed_joint(committed, factors) for way, factors in ways.items()}
A = {way: peak_rps(finely(each, [15e-4])[0], each) for way, each in joints.items()}
for way, each in joints.items():
    print(
        f"{way}: A {100 * (A[way] / A['committed'] - 1):+.0f} %, K_p = {each.speed_gain_nms_per_rad:.3f} N m s/rad"
    )
assert A["inertia_ratio"] < 0.7 * A["committed"] < 0.7 * A["motor_inertia_kgm2"]
assert np.isclose(
    joints["inertia_ratio"].speed_gain_nms_per_rad, 2 * committed.speed_gain_nms_per_rad
)

# %% [markdown]
# **2.** At constant speed the teeth separate where $\tau_l = 0$. Where is that with friction of 10 % of $m g r$, and
# how far from half a turn apart are two separations then?

# %% tags=["solution"]
rubbing = replace(committed, load_coulomb_nm=0.1 * committed.gravity_torque_nm)
separations = simulate(rubbing, 5e-4, step_s=SIMULATION_STEP_S).separation_time_s
apart_s = np.diff(separations[separations > committed.turn_period_s])[:2]
# sin(theta_l) = -0.1: at theta_l = pi + asin(0.1) and at 2 pi - asin(0.1)
expected_s = committed.turn_period_s * (0.5 + np.array([-1, 1]) * np.arcsin(0.1) / np.pi)
assert np.allclose(np.sort(apart_s), expected_s, atol=2e-3)
print(f"{1e3 * np.sort(apart_s).round(4)} ms apart; {1e3 * expected_s.round(4)} ms from the angles")

# %% [markdown]
# **3.** A joint with all ratios as committed has the gear ratio 80 and is commanded to 200 rps. How does its load turn,
# and how high are its peaks? What do the records tell of $N$?

# %% tags=["solution"]
geared = joint_from_ratios(committed.ratios, gear_ratio=80.0, commanded_speed_rps=200.0)
assert geared.turn_period_s == committed.turn_period_s
twice = peak_rps(finely(geared, [15e-4])[0], geared) / peak_rps(
    finely(committed, [15e-4])[0], committed
)
assert np.isclose(twice, 2, rtol=1e-6)
print(
    f"peaks {twice:.4f} times as high: theta_m / N moves as before, so the records tell N only as v_t times T_f"
)
