# %% [markdown]
# # 14 · Claims without a figure or table
#
# *You will see how a sentence becomes a claim that a measurement can refute. Reading time: 14 min.
# Run time: 60 s. Before this: notebooks [4](../04_growth_figure11.ipynb) and
# [8](../08_noise_table2.ipynb).*
#
# ## Claim
#
# The text makes many statements that belong to no figure and no table: on the noise, on the growth of the error, on the
# impacts, on friction, on the encoder, on the dead zone and on CMA-ES. Each is paraphrased in the section that decides
# it; quotation marks enclose the paper's own words.
#
# ## Method
#
# For each claim `claims.csv` holds the check, the rule, the limit that decides it, and its reason. A
# claim *holds*, *does not hold*, or is *undecided*: where a rate or an error is estimated from
# repeats, it is decided only if its 95 % interval lies on one side of the limit.

# %%
import numpy as np
import pandas as pd
from scipy import stats

import workbook
from replication import characteristic, published
from replication.bench import Bench, fit_logs
from replication.joint import change, identified_joint, settled_peak, simulate
from replication.records import (
    CLEAN_LEVELS,
    authors_checksums,
    level_delta_rad,
    load_clean_records,
    load_noisy,
)
from studies import claims as studies
from studies import edge, optimizers

# %% [markdown]
# ## Parameters
#
# The limits are those of `claims.csv`; try another one here to see which verdict flips.

# %% tags=["parameters"]
noises = 100  # noises without backlash, one run of the search on each
noise_seeds = 40  # noises for each number of turns
turns = [1, 12]  # turns in the model that are compared
mountings = 3  # angles at which the encoder is mounted
bits = [12, 14, 16, 19]  # encoders
steps_s = [5e-5, 1e-4, 2.5e-4, 5e-4]  # plain integration steps
frictions = [0.005, 0.02, 0.05, 0.1]  # Coulomb friction on the load, over m g r
criteria = {}  # limits to try in place of those of claims.csv, such as {"quality_decreases": 0.2}

# %% jupyter={"source_hidden": true} tags=["hide-input"]
encoder_bits = int(published.value("text.encoder_bits"))
workbook.check_parameters(
    noises=(noises, range(2, 2**31)),
    noise_seeds=(noise_seeds, range(2, 2**31)),
    turns=(turns, [range(1, 25)]),
    mountings=(mountings, range(1, 1001)),
    bits=(bits, [range(8, 33)]),
    frictions=(frictions, [(1e-4, 0.9)]),
    steps_s=(steps_s, [(1e-6, 5e-4)]),
    criteria=(criteria, dict.fromkeys(published.table("claims").index, (0, np.inf))),
)
workbook.check_parameters(**{"different turns": (len(set(turns)), range(2, 25))})

# %% [markdown]
# ## Result
#
# The claims one by one; the rules and limits that decide them stand together at the end.

# %%
claims = {}
joint = identified_joint()
of_table2 = ("noise", "theoretical", "mean")
noise, theoretical, mean = (published.column("Table 2", name)[:10] for name in of_table2)
delta_rad = characteristic.printed_levels_rad()

# %% [markdown]
# ### The disturbance: growth and repetition
#
# The disturbance grows regularly as the backlash gap enlarges, and in a record "all the
# oscillations have the same amplitude": peak and RMS of the [settled](../glossary.md#settled)
# disturbance by [level](../glossary.md#level), and the RMS of a record's half turns, largest over
# smallest, less one.


# %%
def settled_disturbance(record):
    return record.v[record.t >= record.turn_period_s - 1e-9] - record.commanded_speed_rps


def half_turn_spread(record):
    half = round(record.turn_period_s / 2 / record.sample_s)
    disturbance = record.v - record.commanded_speed_rps
    settled_halves = disturbance[2 * half : disturbance.size // half * half].reshape(-1, half)
    rms = np.sqrt((settled_halves**2).mean(axis=1))
    return rms.max() / rms.min() - 1


# %%
clean = load_clean_records(CLEAN_LEVELS)
settled = {delta: settled_disturbance(clean[delta]) for delta in sorted(clean)}
growth = pd.DataFrame({"delta_rad": [*settled], "peak_rps": [v.max() for v in settled.values()]})
growth["rms_rps"] = [np.sqrt((v**2).mean()) for v in settled.values()]
growth["half_turn_spread"] = [half_turn_spread(clean[delta]) for delta in settled]
growth

# %%
increase = {
    "peak of the samples": growth["peak_rps"].diff().min(),
    "RMS": growth["rms_rps"].diff().min(),
    "printed A": np.diff(theoretical).min(),
}
smallest = ", ".join(f"{name} {step:.3f}" for name, step in increase.items())
claims["amplitude_grows"] = (
    published.decide("amplitude_grows", (min(increase.values()), max(increase.values())), criteria),
    f"smallest increase from level to level [rps]: {smallest}",
)

# %%
largest = growth.loc[growth["half_turn_spread"].idxmax()]
claims["same_amplitude"] = (
    published.decide("same_amplitude", largest["half_turn_spread"], criteria),
    f"settled half turns differ by up to {100 * largest['half_turn_spread']:.1f} % in RMS "
    f"({1e3 * largest['delta_rad']:.1f} mrad), {100 * growth['half_turn_spread'].min():.1f} % in the best record",
)

# %% [markdown]
# ### The joint
#
# "The amplitude of A, in fact, depends on the mechanical characteristics of the system under test":
# the settled peak of the identified joint, and of one whose stiffness ratio $K_s/J_l$ is a fifth
# lower.

# %%
softer = change(joint, {"K_s/J_l": 0.8})
middle = delta_rad[delta_rad.size // 2]
fine = {"sample": 5e-5, "step": 5e-5}
peaks = [settled_peak(simulate(each, middle, **fine), each) for each in (joint, softer)]
changed = 100 * abs(peaks[1] / peaks[0] - 1)
claims["depends_on_joint"] = (
    published.decide("depends_on_joint", changed, criteria),
    f"a stiffness a fifth lower changes the settled peak by {changed:.2g} %",
)
pd.Series(peaks, ["identified joint", "softer joint"], name="settled peak [rps]")

# %% [markdown]
# ### The disturbance: when the teeth meet
#
# One impact comes at the beginning of the load's descent, one at the beginning of its ascent: the
# share of the phase that has passed at the impact, in the simulated joint. The gap takes time to
# cross, the longer the wider it is.

# %%
phases = studies.impact_phases(joint, delta_rad)
claims["impacts_at_phase_start"] = studies.impacts_at_phase_start(phases, criteria)
passed = phases.groupby(["delta_rad", "phase"])["share_passed"].mean().unstack().reset_index()
passed

# %% [markdown]
# ### The noise: printed numbers
#
# The amplitude of the noise is proportional to the disturbance's expected amplitude: then the ratio
# of Table 2's noise to its theoretical $A$ is one number.

# %%
ratio = noise / theoretical
fall = ratio.max() / ratio.min()
claims["noise_proportional"] = (
    published.decide("noise_proportional", fall, criteria),
    f"noise over A falls from {ratio[0]:.2f} to {ratio[-1]:.3f}, a factor {fall:.2f}",
)
estimated_rad = characteristic.equation_10().backlash_rad(mean)
errors = pd.DataFrame({"delta_rad": delta_rad, "error_rad": np.abs(estimated_rad - delta_rad)})
errors["error_percent"] = 100 * np.abs(mean / theoretical - 1)
errors["noise_over_A"] = ratio

# %%
errors

# %% [markdown]
# "The quality of the estimate decreases with the increase of backlash": then the errors of the
# printed means, converted by equation 10, are correlated with the backlash. Kendall's $\tau$ of $n$
# pairs $(x_i, y_i)$ compares the orders of all pairs; its $p$ is exact:
#
# $$\tau = \frac{2}{n(n-1)} \sum_{i<j} \text{sign}(x_i - x_j)\, \text{sign}(y_i - y_j).$$

# %%
growing, falling, percent = (
    stats.kendalltau(delta_rad, errors[name], method="exact", alternative=side)
    for name, side in (("error_rad", "greater"), ("error_rad", "less"), ("error_percent", "less"))
)
claims["quality_decreases"] = (
    published.decide("quality_decreases", (growing.pvalue, falling.pvalue), criteria),
    f"rank correlation with the error in rad {growing.statistic:+.2f}, p of an increase {growing.pvalue:.2f}, of a "
    f"decrease {falling.pvalue:.2f}; with that in percent {percent.statistic:+.2f}, p of a "
    f"decrease {percent.pvalue:.2f}",
)

# %% [markdown]
# ### The noise: its law
#
# The noise is uniform and white with zero mean: what the authors added to nine records in two
# [realisations](../glossary.md#realisation), tested for its law, its mean and the correlation of
# neighbours. That the simulator reproduces the behaviour of the joint with backlash cannot be
# tested: the signals of the bench are not public. "Both the source code of the tools and the data"
# are said to be public: those of the bench and of the robots are not.

# %%
added = {
    (level, realisation): load_noisy(level, realisation).v - clean[level_delta_rad(level)].v
    for realisation in (1, 2)
    for level in range(3, 12)
}
tests = studies.noise_tests(added)
claims["uniform_noise"] = studies.uniform_noise(tests, criteria)
not_public = "the bench's signals of figure 10 are not public"
claims["simulator_agrees"] = (published.decide("simulator_agrees", np.nan, criteria), not_public)
logs = [path for path in authors_checksums() if "bench" in path.lower() or "robot" in path.lower()]
claims["code_and_data_public"] = (
    published.decide("code_and_data_public", len(logs), criteria),
    f"of {len(authors_checksums())} public files {len(logs)} are logs of the bench or of the robots",
)
tests.describe().loc[["min", "50%", "max"]].drop(columns=["level", "realisation"])

# %% [markdown]
# ### The noise: without backlash
#
# The absence of backlash is correctly recognised: $|A|$ that the authors' search finds in noise
# alone, against Table 2's smallest mean. The mean of a signed $A$ would say little, because the
# signs cancel. Of $n$ sorted values $x_{(1)} \leq \dots \leq x_{(n)}$ the percentile $q$ of the
# population lies between two of them with a binomial probability, whatever the law of $x$:
#
# $$P\left(x_{(l)} \leq x_q \leq x_{(u)}\right) = \sum_{i=l}^{u-1} \binom{n}{i} q^i (1-q)^{n-i} \geq 0.95.$$

# %%
half_amplitude_rps = published.value("table2.row11.noise")
amplitudes = studies.amplitudes_without_backlash(range(1, noises + 1), half_amplitude_rps)
claims["no_backlash"] = studies.no_backlash(
    amplitudes, published.value("table2.row01.mean"), criteria
)
pd.Series(amplitudes, name="|A| [rps]").describe().drop("count").to_frame()

# %% [markdown]
# ### The noise: more turns
#
# More than one turn in the model avoids errors due to noise: the RMS error of $A$ due to noise.
# White noise averaged over twelve turns would leave $1/\sqrt{12} = 0.29$ of the error. Where
# little is gained, another [gate](../glossary.md#gate), not the noise
# itself, changes $A$. The squared ratio of two RMS errors $e_1$, $e_2$, each from $n$ repeats, over
# its true value has the distribution $F_{n,n}$; so the true ratio lies with 95 % between
#
# $$\frac{e_2}{e_1} / \sqrt{F_{0.975}(n, n)} \quad\text{and}\quad \frac{e_2}{e_1} \sqrt{F_{0.975}(n, n)}.$$

# %%
three_levels = [0, 4, 9]
by_turns = studies.noise_errors_by_turns(
    joint, delta_rad[three_levels], noise[three_levels], sorted(set(turns)), noise_seeds
)
claims["turns_reduce_noise"] = studies.turns_reduce_noise(by_turns, noise_seeds, criteria)
by_turns.pivot(index="delta_rad", columns="turns", values="rms_error_rps")

# %% [markdown]
# ### The encoder: how many bits
#
# The method needs no more than a standard 19 bit motor encoder: how much $A$ changes when the
# motor's position is rounded.

# %%
by_bits = studies.bits_study(joint, delta_rad, sorted({*bits, encoder_bits}), mountings)
claims["bits_suffice"] = studies.bits_suffice(by_bits, encoder_bits, criteria)
by_bits.groupby("bits")["change_rps"].max().to_frame()

# %% [markdown]
# ### The dead zone: a torque that steps
#
# "Discontinuities typically cause instabilities": the clamped dead zone with damping lets the
# torque step at the edge; the modified one does not. Both are integrated by plain steps that do not
# look for the contact. The numbers are errors of the settled peak. More error with a stepping
# torque has the claim's direction; whether a simulation is stable is another question, which these
# runs of one joint with one solver do not answer.

# %%
stepping = edge.stepping_torque_study(joint, delta_rad[three_levels], sorted(set(steps_s)))
claims["discontinuities_destabilise"] = studies.discontinuities_destabilise(stepping, criteria)
stepping.pivot(index=["delta_rad", "step_s"], columns="model", values="error")

# %% [markdown]
# How sharp must the edge be? The joint is identified anew for each $\alpha$ of equation 8
# (`make studies NAME=claims`, kept). The misfit (RMSE over the SD) is that of the records it is identified from.

# %%
alphas = workbook.read_kept("alpha_refit")
alphas[["alpha", "nrmse", "K_s/J_l", "J_l/(N^2 J_m)", "K_p/J_m"]]

# %% [markdown]
# ### Friction on the load
#
# Friction may be disregarded. The coupling's torque works against gravity, of the largest torque $m g r$ [N m], and
# Coulomb friction $\tau_c$ [N m]; at constant speed the teeth part where it changes its sign. With
# $s = \tau_c / (m g r)$ this is at the load's angle $\pi + \arcsin s$, later than without friction, and at
# $2\pi - \arcsin s$, earlier: the two impacts of a turn are no longer half a turn apart, but the
# [signature](../glossary.md#signature) has them so. $A$ of the best fit to four logs without noise at each friction.
# *Predict:* does $A$ rise or fall?

# %%
shares = [0.0, *sorted(set(frictions))]
benches = [Bench(joint._replace(load_coulomb=share * joint.G), 0.0) for share in shares]
rubbed = fit_logs([(bench, 1e-3) for bench in benches for _ in range(4)], seed=1)
friction = rubbed.groupby(np.repeat(shares, 4))["A_rps"].mean().to_frame()
friction["change_percent"] = 100 * (friction["A_rps"] / friction["A_rps"].loc[0.0] - 1)
changes = friction["change_percent"].drop(0.0).abs()
claims["friction_disregarded"] = (
    published.decide("friction_disregarded", (changes.min(), changes.max()), criteria),
    f"on simulated logs frictions of {100 * changes.index.min():.2g} to {100 * changes.index.max():.2g} % of gravity "
    f"change A by {changes.min():.1f} to {changes.max():.0f} %; the friction of the test's joint is not published",
)
friction.rename_axis("friction over m g r")

# %% [markdown]
# ### Other optimisers
#
# CMA-ES outperforms four swarm algorithms, classical methods cannot be applied, and CMA-ES needs little tuning. Kept
# runs on noisy records (`make studies NAME=claims`): how often each method finds the best basin within 60 000
# evaluations, with the 95 % interval of Clopper and Pearson. CMA-ES against each swarm by Fisher's exact test.

# %%
success = optimizers.success_table(workbook.read_kept("optimizers"))
compared = optimizers.against_swarms(success)
claims["cma_beats_swarms"] = studies.cma_beats_swarms(compared, criteria)
claims["classical_cannot"] = studies.classical_cannot(success, criteria)
claims["little_tuning"] = studies.little_tuning(success, criteria)
success.drop(columns="kind").round(3)

# %% [markdown]
# ### Rules and limits
#
# What was checked of each claim, by which rule and limit.

# %%
rules = published.table("claims").loc[[*claims], ["claim", "check", "rule"]]
rules["limit"] = [published.criterion(claim, criteria) for claim in claims]
rules

# %% [markdown]
# ## Verdict

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
counts = dict.fromkeys(("holds", "does not hold", "undecided"), 0)
counts |= workbook.judge(claims=claims)["verdict"].value_counts()
refuted = rules.loc[[name for name, (holds, _) in claims.items() if holds is False], "claim"]
workbook.verdict(
    f"Of {len(claims)} claims {counts['holds']} hold, {counts['does not hold']} do not hold "
    f"({'; '.join(refuted) or 'none'}), and {counts['undecided']} are undecided: our repeats, or what is published, "
    "neither support nor refute them.",
    claims=claims,
)

# %% [markdown]
# ## Try changing
#
# 1. `criteria = {"quality_decreases": 0.2}`: a laxer test, and the paper's sentence on the quality
#    would hold.
# 2. `criteria = {"same_amplitude": 0.005}`: half a percent tells the half turns of ten records
#    apart.
# 3. `turns = [1, 3]`: three turns instead of twelve; the error still falls, by less.
#
# ## Exercises
#
# Each asks for a number by its `name`. The cell below your answer says *right* or *not yet*.

# %%
noises_needed = records_needed = bits_needed = np.nan  # your answers

# %% [markdown]
# **1.** At how many noises per number of turns (`noises_needed`, the least) would an error ratio of
# 0.73 be told from 1?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
repeats = np.arange(2, 200)
factor = np.sqrt(stats.f.ppf(0.975, repeats, repeats))
noises_needed = repeats[0.73 * factor < 1][0]
print(f"{noises_needed}")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]


def is_told(n):
    return 0.73 * np.sqrt(stats.f.ppf(0.975, n, n)) < 1


workbook.check_answer(noises_needed, lambda n: is_told(n) and not is_told(n - 1))

# %% [markdown]
# **2.** Suppose that every noise record gave an $|A|$ below the limit. How many records
# (`records_needed`, the least) would show with 95 % confidence (2.5 % on this side) that the 95th
# percentile lies below it?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
records_needed = int(np.ceil(np.log(0.025) / np.log(0.95)))
print(f"{records_needed}: 0.95^{records_needed} = {0.95**records_needed:.4f}")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(records_needed, lambda n: 0.95**n <= 0.025 < 0.95 ** (n - 1))

# %% [markdown]
# **3.** A position of $b$ bits, differenced over 2 ms, gives a speed in steps of
# $1/(2^b \cdot 0.002\,\text{s})$. How many bits (`bits_needed`, the least) would make the step
# smaller than Table 2's smallest SD (0.0009 rps)? Why do 19 suffice for $A$?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
bits_needed = int(np.ceil(np.log2(1 / (0.002 * 0.0009))))
change_rps = by_bits.query("bits == 19")["change_rps"].max()
print(
    f"{bits_needed}. The fit averages over samples: at 19 bits steps of {1 / (2**19 * 0.002):.5f} rps change A by "
    f"{change_rps:.5f} rps"
)

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(bits_needed, lambda b: 2.0**-b < 0.0009 * 0.002 < 2.0 ** (1 - b))

# %% [markdown]
# **What you have learnt**: a sentence becomes a claim by a check, a limit, and an answer that would
# refute it. *Next:* [real joints](15_real_joints.ipynb).
