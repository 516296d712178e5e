# %% [markdown]
# # 14 · The sensor that calibrates itself
#
# *You will see how a whole simulated joint is fitted to one log, and what its posterior says of the
# backlash. Run time: 30 s. Before this: notebooks [9](../09_identification_of_the_joint.ipynb) and
# [13](13_readings_compared.ipynb).*
#
# **All joints here are simulated [stand-ins](../glossary.md#stand-in). Nothing printed is judged.**
#
# ## Claim
#
# Equation 10 was calibrated on one joint. On another the same amplitude means another
# [backlash](../glossary.md#backlash). We test whether a log needs a calibration at all, because
# *the waveform also says which joint it is*: the ring tells of stiffness, inertia and gains, the
# impacts of friction, and the gap is left.
#
# ## Method
#
# *Two unknowns* come first: the backlash and the coupling's stiffness of the paper's joint, from
# one measured turn with white noise of the SD $\sigma$ [rps] (standard deviation). Then the whole
# joint; its theory follows that picture.

# %%
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib import pyplot as plt
from scipy import stats

import workbook
from backlash import plots as log_plots
from backlash.examine import examine_recording
from backlash.fitting import joint_posterior, joint_search, self_calibration
from backlash.reading.columns import LogFormat
from backlash.settings import settings_for
from replication import standins
from studies import benchmark, datasheet, joint_match, plots, population

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
bench_seed = 3  # which joint is drawn
backlash_mrad = 1.1  # of the log that is looked at closely
friction_share = 0.0  # Coulomb friction added to its load, over gravity

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.check_parameters(
    bench_seed=(bench_seed, range(0, 2**31)),
    backlash_mrad=(backlash_mrad, workbook.Interval(0.1, 10)),
    friction_share=(friction_share, workbook.Interval(0, 1)),
)

# %% [markdown]
# ## Result
#
# ### Two unknowns
#
# Unknown are the backlash and the stiffness, as a factor of the paper's. *Predict:* a stiffer joint
# rings faster. Does not knowing the stiffness make the backlash less certain?

# %%
sigma, backlash_rad = 0.02, 1e-3 * backlash_mrad  # the noise of a mean turn [rps]


def turn_rps(delta_rad, stiffness):
    joint = standins.changed_joint(standins.identified_joint(), {"stiffness_per_s2": stiffness})
    return joint_match.simulate_turn(joint, delta_rad, 200)


truth, steps = np.array([backlash_rad, 1.0]), np.diag([1e-6, 1e-3])
measured_rps = turn_rps(*truth) + sigma * np.random.default_rng(1).standard_normal(200)
slopes = [(turn_rps(*(truth + h)) - turn_rps(*(truth - h))) / (2 * h.sum()) for h in steps]
J = np.array(slopes).T / sigma
Sigma = np.linalg.inv(J.T @ J)

# %%
grid = truth[:, None] + np.sqrt(np.diag(Sigma))[:, None] * np.linspace(-4, 4, 25)
chi2 = np.array(
    [[np.sum((turn_rps(d, k) - measured_rps) ** 2) / sigma**2 for d in grid[0]] for k in grid[1]]
)
posterior = np.exp(-(chi2 - chi2.min()) / 2)
_, axis = plt.subplots(figsize=(4.5, 3), layout="constrained")
axis.contourf(1e3 * grid[0], grid[1], posterior, cmap="Blues")
axis.plot(1e3 * truth[0], truth[1], "x", color="C1", label="truth")
axis.set(xlabel="backlash $\\delta$ [mrad]", ylabel="stiffness over the paper's [-]")
_ = axis.legend()


# %%
def sd_rad(weights):  # of the backlash
    mean = np.average(grid[0], weights=weights)
    return np.sqrt(np.average((grid[0] - mean) ** 2, weights=weights))


sds_rad = {
    "grid": [sd_rad(posterior[12]), sd_rad(posterior.sum(axis=0))],
    "Laplace": [1 / np.linalg.norm(J[:, 0]), np.sqrt(Sigma[0, 0])],
}
pd.DataFrame(sds_rad, index=["stiffness known", "stiffness unknown"]).map("{:.2g}".format)

# %% [markdown]
# The SD of the backlash [rad] grows where another unknown changes the waveform alike: the ellipse
# is oblique. Laplace's approximation needs a slope for each unknown, and no grid: it works for a
# whole joint, too.
#
# ### The whole joint
#
# *The data* are the harmonics of the log's mean [turn](../glossary.md#turn). With the motor speed
# $v(t)$ [rps] over $n$ [settled](../glossary.md#settled) turns of the period $T_f$ [s], and the
# order $k$ [periods a turn],
#
# $$c_k = \frac{1}{n T_f} \int_0^{n T_f} v(t)\, e^{-2\pi i k t / T_f}\, dt.$$
#
# The noise $\sigma_k$ [rps] of each of its two parts comes from what lies between the harmonics.
# The first order and the motor's harmonics are excluded, and so are first turns that still ring.
#
# *The model* is the joint of notebook 9 with its differencing drive, simulated until its turn has
# settled. Its unknowns $z$ are the backlash $\delta$ [rad] and the phase $\varphi$ [rad] of the
# log's first sample, without a prior, and the $z_j$ with a normal prior of mean $m_j$ and SD $s_j$:
# the load's friction over gravity (SD 0.1), the logarithms of stiffness, gravity, inertia ratio,
# speed and integral gain over those of the paper's joint (SD 0.2), those of the rest of the drive
# (0.02 to 0.03), and the smoothing $q$ (1: the speed is differenced over a sampling period, 0: it
# is not smoothed). With the settled turn's harmonics $V_k(z)$ [rps] and the sampling period $T_s$
# [s], and $\text{sinc}\, x = \sin(\pi x)/(\pi x)$, a log has
#
# $$h_k(z) = \text{sinc}\left(k T_s / T_f\right)^q\, e^{i k \varphi}\, V_k(z).$$
#
# *The posterior* is the likelihood of the harmonics times the prior:
#
# $$-2 \ln p(z \mid c) + \text{const} = \chi^2(z) = \sum_k \frac{|h_k(z) - c_k|^2}{\sigma_k^2}
# + \sum_j \frac{(z_j - m_j)^2}{s_j^2} = r(z)^\top r(z).$$
#
# $r$ holds the real and imaginary parts of the first sum's terms, then those of the second. A
# search from many joints finds the maximum $\hat z$. *Laplace's approximation* takes the posterior
# as normal about it, with the covariance
#
# $$\Sigma = (J^\top J)^{-1}, \quad J = \left.\frac{\partial r}{\partial z}\right|_{\hat z}.$$
#
# *Alternatives.* The speed may be differenced over a sampling period ($q \approx 1$, prior
# probability 0.8), also low-passed with an unknown time constant (0.1), or not smoothed
# ($q \approx 0$, 0.1). The answer is the mixture of all alternatives $a$ with the weights $w_a$,
# their prior probability times their evidence $Z_a$, normalised:
#
# $$\ln Z_a = -\tfrac12 \chi^2(\hat z_a) + \tfrac12 \ln\det\Sigma_a - \sum_j \ln s_j + \text{const}, \quad
# \bar z = \sum_a w_a \hat z_a, \quad
# \bar\Sigma = \sum_a w_a \left[\Sigma_a + (\hat z_a - \bar z)(\hat z_a - \bar z)^\top\right].$$
#
# *The interval.* With $\sigma_\delta$ [rad], the root of the backlash's variance in $\bar\Sigma$,
# and $\nu$, the number of residuals less that of unknowns,
#
# $$\bar\delta \pm 1.96\, \sigma_\delta \sqrt{1 + \Delta}, \qquad
# \Delta = \max\left(0,\, \chi^2 - \chi^2_{\nu,\,0.9}\right).$$
#
# If $\chi^2$ exceeds that of nine noise-only logs in ten, $\chi^2_{\nu,\,0.9}$, the model lacks
# something. A shift of the backlash by $k$ of its SDs changes $\chi^2$ by $k^2$. So an unknown
# cause that left $\Delta$ in the residual, and as much along the backlash, moves it by
# $\sqrt\Delta$ SDs; the variances 1 and $\Delta$ add. *Birge's ratio*, $\sqrt{\chi^2/\nu}$, takes
# the cause for more noise. We take the wider one, because a wrong model is no noise.
#
# *No answer* (`cannot tell`) is given where the residual is impossible ($p < 10^{-8}$), turns do
# not repeat, or the unknowns stray from what is known of them.

# %% [markdown]
# ### One log of a joint that nobody calibrated
#
# A log of a joint near the paper's. `self` fits the whole joint; `amplitude` uses the paper's
# calibration.

# %%
bench = standins.draw_bench(np.random.default_rng(bench_seed))
friction_nm = bench.joint.load_coulomb_nm + friction_share * bench.joint.gravity_torque_nm
bench = replace(bench, joint=replace(bench.joint, load_coulomb_nm=friction_nm))
log = standins.encoder_log(bench, backlash_rad, np.random.default_rng((bench_seed, 0)))
form = LogFormat(turn_period_s=log.turn_period_s, unit="rps")
answers = {
    method: examine_recording(log, settings_for(form, method=method), method)
    for method in ("self", "amplitude")
}
print("\n".join(str(answer.estimate) for answer in answers.values()))

# %%
workbook.show_figure(
    "self_log",
    log_plots.estimate_figure(
        log, answers["self"].fitted.model_rps, "a joint that nobody calibrated, and the one fitted"
    ),
    "(a) Three of twelve turns of the log, with the speed of the fitted joint. (b) Residual of the whole log.",
)

# %% [markdown]
# ### Laplace's SD
#
# `problem.slopes` returns $r$ and $J^\top$ at any $z$. `fit_joint` computes the mixture over all
# alternatives.

# %%
problem, harmonics = self_calibration.pose_problem(log)
z_found, _ = joint_search.find_joint(problem, harmonics)
peak = joint_search.find_peak(problem, z_found, joint_posterior.MEASURED_AS["differenced"])
residual, slopes = problem.slopes(peak.z)
covariance = np.linalg.inv(slopes @ slopes.T)
laplace_sd_rad = joint_posterior.UNIT_RAD * np.sqrt(covariance[0, 0])

fit = self_calibration.fit_joint(log)
pd.Series({"Laplace": laplace_sd_rad, "mixture": fit.sd_rad}, name="SD [mrad]").mul(1e3).round(5)

# %% [markdown]
# What the log says of the joint: the SD of each unknown before (prior) and after it, and its
# correlation with the backlash. An unknown that keeps its prior SD cannot be estimated from the
# log.

# %%
sd = np.sqrt(np.diag(fit.covariance))
unknowns = pd.DataFrame(
    {
        "unknown": joint_posterior.NAMES,
        "prior_sd": joint_posterior.SD,
        "posterior_sd": sd,
        "correlation_with_backlash": fit.covariance[0] / sd / sd[0],
    }
)
# without backlash, phase and low-pass
unknowns = unknowns.iloc[2 : joint_posterior.SMOOTHING_INDEX + 1]
unknowns.round(4)

# %% [markdown]
# ### Is the interval wide enough?
#
# The share of answered logs whose interval holds the truth: with the posterior's SD alone, with
# Birge's ratio, and with our factor, on hundreds of drawn joints. *Predict:* which differ from 95 %
# by more than chance (1 %)?

# %%
measured = pd.read_csv(workbook.ROOT / "results" / "population_logs.csv")
own = measured[(measured["method"] == "self") & ~measured["refused"]]
error = (own["found_rad"] - own["delta_rad"]).abs()
half_width = own["high_rad"] - own["found_rad"]
plain = population.NORMAL_95 * own["sd_rad"]
held = {
    "widened": half_width > 1.01 * plain,
    "posterior": error <= plain,
    "Birge": error <= plain * np.sqrt(own["misfit"].clip(lower=1)),
    "ours": error <= half_width,
}
of_population = pd.DataFrame(held).groupby(own["population"], sort=False)
widening = of_population.mean().assign(logs=of_population.size()).loc[[*population.SPREADS]]
widening.round(3)

# %% [markdown]
# Near the paper's joint few logs are widened.

# %% [markdown]
# ## Verdict
#
# The [datasheet](../../results/pages/datasheet.html) lists populations of joints, refusals and
# misses.

# %% jupyter={"source_hidden": true} tags=["hide-input"]
near, far = population.SPREADS
titles = {near: "default spread", far: "20 % spread, 5 % friction, double ripple"}
authors = population.measure_population(population.AUTHORS, range(18), 0, ("self",))
summary = benchmark.summarise_intervals(pd.concat([measured, authors]).astype({"refused": bool}))
sheet = pd.read_csv(workbook.ROOT / "results" / "datasheet.csv")
rounds = pd.read_csv(workbook.ROOT / "results" / "datasheet_rounds.csv")
bars, sheet_bars = population.against_criteria(summary), datasheet.against_criteria(sheet)

# %%
workbook.show_figure(
    "self_errors",
    plots.population_errors(measured, titles),
    "(a), (c) Error of method self, one marker per bench, a cross where the interval misses the truth. Steps: RMS "
    "error and median half-width of intervals. (b), (d) Errors over the stated SDs, and a normal distribution.",
)

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
near_rmse = 1e3 * summary.set_index(["population", "method"]).loc[near, "rmse_rad"]
low, high = 1e3 * (fit.delta_rad + population.NORMAL_95 * fit.sd_rad * np.array([-1, 1]))
workbook.verdict(
    f"From this log alone (bench {bench_seed}, friction of {100 * friction_share:g} % added) `self` finds "
    f"{1e3 * fit.delta_rad:.4f} mrad for the drawn {backlash_mrad:g} mrad, and its interval of {low:.4f} to {high:.4f} "
    f"mrad {'holds' if low <= backlash_mrad <= high else 'does not hold'} it. On kept populations of joints near the "
    f"paper's its RMS error is {near_rmse['self']:.4f} mrad, that of `amplitude` with the paper's calibration "
    f"{near_rmse['amplitude']:.3f} mrad. It meets {bars['met'].sum()} of {len(bars)} criteria, and the whole sensor "
    f"{sheet_bars['met'].sum()} of {len(sheet_bars)}."
)

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.export(
    supplement={
        "population": (summary, "Errors and coverage of every method on uncalibrated joints."),
        "self_unknowns": (unknowns, "What the method fits, with its priors."),
        "self_bars": (bars, "The criteria of the method, and what was measured."),
        "datasheet_bars": (sheet_bars, "The criteria of the whole sensor, and what was measured."),
    },
    facts=datasheet.datasheet_facts(sheet, rounds) | population.criteria_facts(bars),
)

# %% [markdown]
# ## Try changing
#
# 1. `bench_seed = 4`: another joint; the interval of `self` still covers the true backlash.
# 2. `backlash_mrad = 0.5`: a smaller gap is estimated with a smaller error.
# 3. `friction_share = 0.05`: the fit finds the friction, and the backlash stays right.
#
# ## Exercises
#
# **1.** If everything but the backlash were known, its SD would be $1/\sqrt{(J^\top J)_{11}}$. By
# what factor does not knowing the joint widen it?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
known_sd_rad = joint_posterior.UNIT_RAD / np.sqrt((slopes @ slopes.T)[0, 0])
assert known_sd_rad < laplace_sd_rad
print(f"by a factor {laplace_sd_rad / known_sd_rad:.1f}")

# %% [markdown]
# **2.** A log has $\nu$ = 150 and $\chi^2$ = 190. How probable is so large a residual by noise
# alone? Compare Birge's ratio with our factor.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
nu, large_chi2 = 150, 190
chance = stats.chi2.sf(large_chi2, nu)
birge = np.sqrt(large_chi2 / nu)
factor = np.sqrt(1 + max(0, large_chi2 - stats.chi2.isf(0.1, nu)))
assert 0.01 < chance < 0.02
assert np.isclose(factor, self_calibration.widening_factor(large_chi2, nu))
print(f"p = {chance:.2g}; Birge {birge:.2f}, ours {factor:.1f}")

# %% [markdown]
# **3.** Two alternatives of equal weight have backlashes of 1.0 and 1.1 mrad, each with an SD of
# 0.03 mrad. What is the SD of their mixture, and how often would an interval of ±1.96 such SDs
# cover?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
mixture_sd = np.sqrt(0.3**2 + 0.5**2)  # in 0.1 mrad
draws = np.random.default_rng(1).normal([10.0, 11.0], 0.3, (100_000, 2)).ravel()
beyond = stats.norm(0.5, 0.3).cdf(1.96 * mixture_sd * np.array([-1, 1]))
assert np.isclose(draws.std(), mixture_sd, rtol=0.01)
assert np.isclose((np.abs(draws - 10.5) < 1.96 * mixture_sd).mean(), np.diff(beyond), atol=0.005)
print(f"{0.1 * mixture_sd:.3f} mrad; {100 * np.diff(beyond).item():.1f} %")

# %% [markdown]
# **What you have learnt**: unknowns that act alike widen an interval; a posterior says by how much.
# *Next:* [which settings produced Table 2](15_protocols.ipynb).
