# %% [markdown]
# # 7 · The search: Table 1's box and the protocol
#
# *You will take one generation of CMA-ES apart, and see what population, first step size and box do
# to a run. Run time: 10 s. Before this: notebook [5](05_signature_figure6.ipynb).*
#
# ## Claim
#
# The signature is fitted by CMA-ES (covariance matrix adaptation evolution strategy) inside the box
# of Table 1, 30 times, on a record that begins at one of its first 100 samples, drawn at random
# (sections "Stochastic optimization algorithm", "Experimental evaluation"). Table 1 fixes $T_d$ =
# 0.204 s and $T_f$ = 0.408 s.
#
# ## Method
#
# A search looks for the seven parameters $X = [A, t_0, \tau, \omega, v_t, T_2, T_1]$ of the
# [signature](glossary.md#signature) that have the lowest RMSE (equations 7 and 11, notebook 5).
# CMA-ES (N. Hansen's [tutorial](https://doi.org/10.48550/arXiv.1604.00772)) draws $\lambda$
# *members* in a *generation*, ranks them by their RMSE, the [misfit](glossary.md#misfit), and moves
# and reshapes the normal distribution that the next generation is drawn from. Equations 12 to 17
# stand below, each beside its cell. `cmaes.py` has the same with the constants of the authors'
# library, and reproduces their stored runs (notebook 18).
#
# The authors' notebook stores their [runs](glossary.md#run): the whole record, the box of $A$
# widened by 1.3, $T_d$ = 0.2 s and $T_f$ = 0.4 s, a population of 300 and at most 200 generations.
# That is `SearchSettings()`.

# %%
import math
from dataclasses import replace
from itertools import islice

import numpy as np
import pandas as pd

import workbook
from replication import cmaes, sources, stopping, table2
from studies import search_plots
from studies.replay import replay, table1
from studies.replay.eigen import symmetric_eigen

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
population = 300  # members of a generation, in the run that is taken apart
sigma = 0.25  # its first standard deviations, as a share of the box
box = {}  # other bounds for it, such as {"frequency_hz": (1.0, 15.0)} or {"start_s": (0.0, 0.2)}; see `SearchSettings`
generation = 5  # which generation is shown
seed = 823840  # of the run: that of the stored run 4

# %% jupyter={"source_hidden": true} tags=["hide-input"]
settings = {
    "amplitude_factor": workbook.Interval(0.01, 100),
    "longest_window_s": workbook.Interval(0.01, 4.8),
    "damping_per_s": [workbook.Interval(0)],
    "frequency_hz": [workbook.Interval(0)],
    "start_s": [workbook.Interval(0, 4.8)],
}
workbook.check_parameters(
    population=(population, workbook.Interval(4, 100000)),
    sigma=(sigma, workbook.Interval(1e-6, 10)),
    box=(box, [tuple(settings)]),
    generation=(generation, workbook.Interval(1, 200)),
    seed=(seed, range(1, 2**32)),
)
workbook.check_parameters(**{name: (value, settings[name]) for name, value in box.items()})

# %% [markdown]
# ## Result
#
# ### One generation, step by step
#
# The record is the authors' clean record 12. `cmaes.generations` is the search, one generation at a
# time, with the signs that eigenvectors had in 2021.

# %%
clean = sources.load_clean(12)
protocol = replace(table2.SearchSettings(), population=population, **box)
bounds = table2.search_box(clean, protocol)
cost = table2.cost(clean, protocol)
names = ["A [rps]", "t0 [s]", "tau [1/s]", "omega [rad/s]", "v_t [rps]", "T2 [s]", "T1 [s]"]


def start():  # sigma is counted in quarters of the box
    normals = cmaes.random_normals(seed)
    return cmaes.generations(cost, bounds, normals, population, 4 * sigma, symmetric_eigen)


drawn = next(islice(start(), generation - 1, None))
before, after, c = drawn.before, drawn.after, drawn.constants

# %%
shown, labels = [2, 3], ("$\\tau$ [1/s]", "$\\omega$ [rad/s]")
workbook.show_figure(
    "search_one_generation",
    search_plots.one_generation(drawn, c.weights, bounds, shown, labels),
    f"Generation {generation} in two of seven dimensions: (a) its {population} samples, (b) the new mean, to which "
    "each of the better half adds by its weight, (c) the distribution of the next samples. Ellipses show 2 SD.",
)

# %% [markdown]
# **Sampling.** The members $\mathbf x_k$ of the generation $g + 1$ are drawn from a normal
# distribution about the mean $\mathbf m^{(g)}$; $\sigma^{(g)}$ is the step size, $\mathbf C^{(g)}$
# the covariance matrix:
#
# $$\mathbf x_k^{(g+1)} \sim \mathcal N\left(\mathbf m^{(g)}, (\sigma^{(g)})^2\,\mathbf C^{(g)}\right), \quad
# k = 1, \ldots, \lambda \tag{12}$$
#
# The eigenvectors $\mathbf B$ and lengths $\mathbf D$ of
# $\mathbf C = \mathbf B \mathbf D^2 \mathbf B^T$ turn standard normal numbers $\mathbf z$ into such
# samples: $\mathbf x = \mathbf m + \sigma\,\mathbf B \mathbf D\,\mathbf z$. The parameters have
# different units, so each is counted in a quarter of its box's width (`unit`). A sample beyond the
# box is reflected into it; $\mathbf x_{i:\lambda}$ is the sample of rank $i$.

# %%
normals = np.random.RandomState(seed).randn  # in the order of the stored runs
z = [normals(population, c.n) for _ in range(generation)][-1]
x = before.m + before.sigma * before.unit * (z * before.D @ before.B.T)  # equation 12
ranked = x[drawn.ranking]
off = np.abs((x - drawn.x) / before.unit).max()
print(f"largest difference from cmaes.py, in units: {off:.1g}")
members = pd.DataFrame(drawn.members, columns=names).assign(misfit_rps=drawn.misfits)
members.loc[drawn.ranking].head()

# %% [markdown]
# **The mean.** The new mean is the weighted mean of the $\mu$ best; the best has the largest weight
# $w_1$:
#
# $$\mathbf m^{(g+1)} = \sum_{i=1}^{\mu} w_i\,\mathbf x_{i:\lambda}^{(g+1)}, \quad w_1 \ge \ldots \ge w_\mu > 0, \quad
# \sum_{i=1}^{\mu} w_i = 1 \tag{13}$$

# %%
w = c.weights[: c.mu]
m = w @ ranked[: c.mu]  # equation 13
c.mu, c.mu_eff  # so many members make the mean, with weights worth so many equal ones

# %% [markdown]
# **The step size.** The path $\mathbf p_\sigma$ sums the steps of the mean, whitened by
# $\mathbf C^{-1/2}$ and with $c_\sigma$ as the rate of forgetting;
# $\mu_\text{eff} = 1 / \sum w_i^2$:
#
# $$\mathbf p_\sigma^{(g+1)} = (1 - c_\sigma)\,\mathbf p_\sigma^{(g)} + \sqrt{c_\sigma (2 - c_\sigma)\,\mu_\text{eff}}
# \;\mathbf C^{(g)\,-\frac 12}\,\frac{\mathbf m^{(g+1)} - \mathbf m^{(g)}}{\sigma^{(g)}} \tag{14}$$
#
# If the path is longer than that of a random walk, $\sigma$ grows; else it shrinks. $d_\sigma$
# damps it, and the quotient of Gamma functions (`chi_n`) is the mean length of
# a standard normal vector in $n$ = 7 dimensions:
#
# $$\sigma^{(g+1)} = \sigma^{(g)} \exp\left(\frac{c_\sigma}{d_\sigma} \left(\frac{\|\mathbf p_\sigma^{(g+1)}\|}
# {\sqrt 2\,\Gamma(\frac{n+1}{2}) / \Gamma(\frac n2)} - 1\right)\right) \tag{15}$$

# %%
step = (m - before.m) / before.unit / before.sigma
white = before.B @ (before.B.T @ step / before.D)  # C^(-1/2) = B D^-1 B^T
rate = np.sqrt(c.c_sigma * (2 - c.c_sigma) * c.mu_eff)
p_sigma = (1 - c.c_sigma) * before.p_sigma + rate * white  # equation 14
length = np.linalg.norm(p_sigma)
growth = min(1, c.c_sigma / c.d_sigma * (length / c.chi_n - 1))  # the library's limit: a factor e
new_sigma = before.sigma * np.exp(growth)  # equation 15
print(
    f"path {length:.3f} long, a random walk's is {c.chi_n:.3f}; sigma from {before.sigma:.3f} to {new_sigma:.3f}"
)

# %% [markdown]
# **The covariance matrix.** A second path $\mathbf p_c$, of rate $c_c$, sums the plain steps:
#
# $$\mathbf p_c^{(g+1)} = (1 - c_c)\,\mathbf p_c^{(g)} + \sqrt{c_c (2 - c_c)\,\mu_\text{eff}}
# \;\frac{\mathbf m^{(g+1)} - \mathbf m^{(g)}}{\sigma^{(g)}} \tag{16}$$
#
# $\mathbf C$ becomes a weighted mean of itself and two updates, with
# $\text{OP}(\mathbf y) = \mathbf y \mathbf y^T$:
#
# $$\mathbf C^{(g+1)} = (1 - c_\text{cov})\,\mathbf C^{(g)} + \frac{c_\text{cov}}{\mu_\text{cov}} \left(
# \mathbf p_c^{(g+1)} \mathbf p_c^{(g+1)\,T} + \delta(h_\sigma^{(g+1)})\,\mathbf C^{(g)}\right) + c_\text{cov}
# \left(1 - \frac{1}{\mu_\text{cov}}\right) \sum_{i=1}^{\mu} w_i\,\text{OP}\left(\frac{\mathbf x_{i:\lambda}^{(g+1)} -
# \mathbf m^{(g)}}{\sigma^{(g)}}\right) \tag{17}$$
#
# The path stretches $\mathbf C$ along the direction in which the mean keeps moving, at the rate
# $c_1 = c_\text{cov} / \mu_\text{cov}$, the better half of the samples towards themselves, at
# $c_\mu = c_\text{cov} (1 - 1/\mu_\text{cov})$. In their library the sum runs over all $\lambda$
# members: the worse half has negative weights and shrinks $\mathbf C$. $h_\sigma$ is 0, and
# $\mathbf p_c$ stalls, while $\mathbf p_\sigma$ is much too long; $\delta(h_\sigma)$ makes up for
# what is lost by that.

# %%
fresh = 1 - (1 - c.c_sigma) ** (2 * (before.g + 1))
h_sigma = p_sigma @ p_sigma / fresh / c.n < 2 + 4 / (c.n + 1)
rate = h_sigma * np.sqrt(c.c_c * (2 - c.c_c) * c.mu_eff)
p_c = (1 - c.c_c) * before.p_c + rate * step  # equation 16
y = (ranked - before.m) / before.unit / before.sigma
length = np.linalg.norm(y @ before.B / before.D, axis=1)
w = c.weights * np.where(c.weights < 0, c.n / length**2, 1)  # a negative one at the mean length
lost = c.c_1 * (1 - h_sigma) * c.c_c * (2 - c.c_c)
kept = 1 - c.c_1 + lost - c.c_mu * c.weights.sum()
C = kept * before.C + c.c_1 * np.outer(p_c, p_c) + c.c_mu * (w * y.T) @ y  # equation 17

# %%
print(
    f"c_1 = {c.c_1:.3f}, c_mu = {c.c_mu:.3f}: the samples of one generation make up {100 * c.c_mu:.0f} % of C"
)
moved = pd.DataFrame({"mean before": before.m, "mean after": m, "SD before": before.std}, names)
moved["SD after"] = new_sigma * before.unit * np.sqrt(np.diag(C))
moved.assign(by_search_py=after.std)

# %% [markdown]
# ### The whole run
#
# `stopping.search` follows the generations until a stop rule holds: `tolfun` says that all members
# have the same misfit within 10⁻¹¹ rps, `tolconditioncov` that the ellipse is 10⁷ times as long as
# wide, `maxiter` that 200 generations are made. Beside it: the authors' settings, same seed.
# *Predict:* does the misfit fall at a steady rate?

# %%
steps = list(islice(start(), protocol.iterations))
found = stopping.search(iter(steps), protocol.iterations)
best = found.history[:, 0]
picked = [steps[g - 1].after for g in (1, 10, 20, 40, 60) if g <= best.size]
workbook.show_figure(
    "search_run",
    search_plots.run(picked, best, bounds, shown, labels),
    f"(a) Mean and distribution (2 SD) after some of {best.size} generations, (b) their lowest misfit above the run's.",
)

# %%
authors_protocol = table2.SearchSettings()
stored = stopping.search(replay.authors_search(clean, seed), authors_protocol.iterations)
boxes = {"authors' settings": table2.search_box(clean, authors_protocol), "this run": bounds}
ends = {}
for name, end in zip(boxes, (stored, found), strict=True):
    lower, upper = boxes[name].lower, boxes[name].upper
    edge = np.minimum(end.best - lower, upper - end.best) < 1e-4 * (upper - lower)
    ends[name] = dict(zip(names, end.best, strict=True)) | {
        "RMSE [rps]": end.misfit,
        "generations": len(end.history),
        "ended by": end.stop,
        "at a bound": ", ".join(np.array(names)[edge]),
    }
pd.DataFrame(ends, dtype=object)

# %% [markdown]
# ### Table 1, read from the stored runs
#
# Every sample depends on every bound: the first are drawn about the middle of the box with a
# quarter of its width as SD, and reflected at its ends. So `bounds_by_replay` tries each bound
# where Table 1 prints it and beside it, and counts how many of the 30 stored runs then give their
# stored first generation. Columns: shift divided by the width of the bound.

# %%
tried = table1.bounds_by_replay(clean)
tried.pivot(index="cell", columns="shift", values="replayed").loc[tried["cell"].unique()]

# %% [markdown]
# Twelve bounds are where they are printed: there all 30 stored runs replay; with a shift of 0.01
# hardly any do. The two of $A$ are not: the stored runs had 1.3 times the printed box, which their
# notebook's own comment calls a later change. Which box printed Table 2 cannot be determined
# (notebook 15). The turn period is the lag at which the record differs least from itself; that the
# printed 0.408 s is a misprint is not proved, because a switched-off line of the authors' notebook
# has $T_d$ = 0.204 s too. `table1_cells` takes the bound at which most runs replay.

# %%
found_table1 = table1.table1_cells(clean, tried)
judged = workbook.judge(found_table1.to_dict())

# %% [markdown]
# ## Verdict

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
counts = judged["verdict"].value_counts()
wider = 2 * found_table1["table1.A.max"]  # of the range of v, of which half is printed
printed_T_f, T_f = judged.loc["table1.T_f.max", "printed"], found_table1["table1.T_f.max"]
ratio = found.misfit / stored.misfit
where = "the same basin" if abs(ratio - 1) < 0.002 else "another minimum"
workbook.verdict(
    f"With {population} members, first SDs of {sigma:g} of the box and {box or 'the bounds of the stored runs'}, the "
    f"run ends after {best.size} generations ({found.stop}) at {ratio:.3f} times the RMSE of the run with the authors' "
    f"settings: {where}. $|A|$ = {abs(found.best[0]):.3f} rps, there {abs(stored.best[0]):.3f} rps. "
    f"Of Table 1's {len(judged)} bounds {counts.get('agrees', 0)} are those of the stored runs, "
    f"{counts.get('not tested', 0)} cannot be tested and {counts.get('differs', 0)} differ. The stored runs had a box "
    f"of $A$ {wider:.2g} times as wide as printed; which one printed Table 2 is unknown. The records turn in {T_f:.4f} "
    f"s, not in the printed {printed_T_f} s.",
    found_table1.to_dict(),
)

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.export(
    supplement={"table1_replay": (tried, "First generations that replay with a bound moved.")},
    facts={
        "population": authors_protocol.population,
        "iterations": authors_protocol.iterations,
        "T_f": (T_f, ".3f"),
        "printed_T_f": printed_T_f,
    },
    cells=found_table1.to_dict(),
)

# %% [markdown]
# ## Try changing
#
# 1. `sigma = 0.02`: the first members lie about the middle of the box, $t_0$ = 2.4 s, and later
#    ones stay near it. The run ends with a signature that begins in the middle of the record, at
#    4.6 times the stored RMSE.
# 2. `population = 20`: ten members make the mean, and $c_\mu$ is 0.1 instead of 0.96, so that the
#    ellipse changes little from one generation to the next; the run settles early, at six times the
#    misfit of the stored run.
# 3. `box = {"start_s": (0.0, 0.2)}`: the search need not find the turn in which the signature
#    begins; it ends at the stored run's misfit.
#
# ## Exercises
#
# **1.** Equation 15 compares $\|\mathbf p_\sigma\|$ with the mean length of a standard normal
# vector. Compute it for $n$ = 7 from the Gamma functions and from random vectors (to 0.5 %), and
# compare it with $\sqrt n$.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
exact = np.sqrt(2) * math.gamma((c.n + 1) / 2) / math.gamma(c.n / 2)
drawn_lengths = np.linalg.norm(np.random.default_rng(1).standard_normal((100000, c.n)), axis=1)
assert np.isclose(exact, drawn_lengths.mean(), rtol=0.005)
assert np.isclose(exact, c.chi_n, rtol=1e-3)
print(
    f"{exact:.4f}, {drawn_lengths.mean():.3f} drawn; sqrt(n) = {np.sqrt(c.n):.4f} is the rms length, which is larger"
)

# %% [markdown]
# **2.** If the misfits told nothing, the ranks would be random. How long is the step of the mean
# then, in units of $\sigma$, with $\mathbf C = \mathbf I$? Check $\chi_n / \sqrt{\mu_\text{eff}}$
# by drawing; it is what the factor $\sqrt{\mu_\text{eff}}$ in equation 14 is for.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
samples = np.random.default_rng(2).standard_normal((2000, c.mu, c.n))
random_steps = np.linalg.norm(np.einsum("i,kij->kj", c.weights[: c.mu], samples), axis=1)
assert np.isclose(random_steps.mean(), c.chi_n / np.sqrt(c.mu_eff), rtol=0.05)
print(f"{random_steps.mean():.4f}, expected {c.chi_n / np.sqrt(c.mu_eff):.4f}")

# %% [markdown]
# **3.** From which population on do the samples of a single generation make up more than half of
# $\mathbf C$?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
c_mu = {}
for size in range(4, 301):
    c_mu[size] = cmaes.constants(size, c.n).c_mu
smallest = next(size for size, rate in c_mu.items() if rate > 0.5)
assert c_mu[smallest - 1] <= 0.5 < c_mu[smallest]
print(f"from {smallest} members on")

# %% [markdown]
# **What you have learnt**: CMA-ES moves and reshapes a normal distribution by ranks alone. *Next:*
# [noise sensitivity](08_noise_table2.ipynb).
