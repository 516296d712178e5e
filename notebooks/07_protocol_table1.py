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
#     quick: {repeats: 2, rows: [1, 9], seed_runs: 2, today_runs: 2}
# ---

# %% [markdown]
# # 7 · The search: Table 1's box and the protocol
#
# ## Claim
#
# The signature is fitted by CMA-ES inside the box of Table 1, on a record that begins at a sample drawn among its
# first 100, 30 times (sections "Stochastic optimization algorithm" and "Experimental evaluation"). Table 1 fixes
# $T_d$ = 0.204 s and $T_f$ = 0.408 s. CMA-ES is equations 12 to 17.
#
# ## Method
#
# The authors' notebook stores what their runs really did: the whole record, the box of $A$ widened by 1.3,
# $T_d$ = 0.2 s and $T_f$ = 0.4 s, a population of 300 and at most 200 generations. That is `Protocol()`; every
# variant changes a setting or two of it (`variants.VARIANTS`). Each is run on the same ten noisy records (realisation
# R = 1) with the same seeds, and its means and SDs are compared with the printed ones of Table 2.
#
# Equations 12 to 17 are `search.py`, a page of array code with the constants of the authors' library; notebook 1 shows
# that it reproduces their stored runs. Here one of its generations is shown step by step.

# %%
from dataclasses import replace
from itertools import islice

import numpy as np
import pandas as pd

from backlash.studies import basins
from replication import datasets, published, search, table2, workbook
from replication.figures import paper, searching
from replication.identify import paper_search, protocol_box
from replication.replay import inspection
from replication.replay.bounds import bounds_by_replay, table1_cells
from replication.replay.variants import VARIANTS, rank_variants, variant_scores
from replication.signature import FREE_PARAMETERS

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
repeats = 3  # runs of each variant on each record
realisation = 1  # the authors' noise realisation R
rows = list(range(1, 11))  # rows of Table 2 whose records are fitted
variants = [  # what is compared, of `VARIANTS`
    "authors' notebook",
    "start drawn per run",
    "start drawn per record",
    "A bound as printed",
    "T_d and T_f as printed",
    "population 1000",
]
your_variant = {}  # settings of one more, over the authors', such as {"population": 100}; see `identify.Protocol`
seed_runs = 30  # runs on each record with one set of seeds, and as many with another set
today_runs = 12  # runs of today's cma, a second each, on every third record
population = 300  # members of the generation that is shown
generation = 5  # which one
seed = 823840  # of the run it belongs to: run 4 of the stored ones

# %% [markdown]
# ## Result
#
# ### Table 1, read from the stored runs
#
# Every sample depends on every bound: the first members are drawn about the middle of the box with a quarter of its
# width as SD, and reflected at its ends. So each bound is tried where Table 1 prints it and beside it. The table counts
# how many of the 30 stored runs then give their stored first generation. Columns: shift divided by the width of the
# bound.

# %%
clean = datasets.load_clean(12)
tried = bounds_by_replay(clean)
workbook.save_table(tried, "table1_replay")
tried.pivot(index="cell", columns="shift", values="replayed")

# %% [markdown]
# Twelve bounds are where they are printed: there all 30 stored runs replay, and a hundredth of the range beside it
# fewer do, mostly none or one. The two of $A$ are not: the stored runs had 1.3 times the printed box, which their
# notebook's own comment calls a later change. Which box printed Table 2 cannot be determined (notebook 17). The bounds
# of $A$, $t_0$ and $v_t$ are given as fractions of the record's range.

# %%
found_table1 = table1_cells(clean, tried)
printed = published.cells("Table 1")[["row", "column", "printed", "unit", "value"]]
printed.assign(reproduced=found_table1)

# %% [markdown]
# ### The turn period in the data
#
# The turn period is the lag at which the record correlates best with itself. It is that of the public data. Whether the
# printed 0.408 s is a misprint is not proved: a switched-off line of the authors' notebook has $T_d$ = 0.204 s too.

# %%
turn_period_s = inspection.turn_period(clean)
turn_period_s

# %% [markdown]
# ### One generation, step by step
#
# The record is the authors' clean record 12, the seed that of a stored run. Equation 12: the $\lambda$ members are
# drawn from a normal distribution about the mean $\mathbf m$ with the covariance $\sigma^2 \mathbf C$. The
# eigenvectors $\mathbf B$ and lengths $\mathbf D$ of $\mathbf C$ turn standard normal numbers $\mathbf z$ into such
# samples: $\mathbf x = \mathbf m + \sigma\,\mathbf B \mathbf D\,\mathbf z$. Each is put into the box, its misfit
# is computed, and all are ranked. Only the ranks are used from here on.

# %%
protocol = replace(table2.AUTHORS, population=population)
box = protocol_box(clean, protocol)
drawn = next(islice(paper_search(clean, protocol, seed), generation - 1, None))
before, after, c = drawn.before, drawn.after, search.constants(population, len(FREE_PARAMETERS))
ranked = drawn.x[drawn.ranking]
members = pd.DataFrame(drawn.members[drawn.ranking], columns=FREE_PARAMETERS)
members.assign(misfit_rps=drawn.misfits[drawn.ranking]).head()

# %% [markdown]
# Equation 13: the new mean is the weighted mean of the better half; the best has the largest weight. Its step, in units
# of $\sigma$ and whitened by $\mathbf C^{-1/2}$, is added to the path $\mathbf p_\sigma$ (equation 14). If the path is
# longer than that of a random walk, successive steps agree, and $\sigma$ grows; if it is shorter, they cancel, and
# $\sigma$ shrinks (equation 15).

# %%
m = (c.weights[: c.mu, None] * ranked[: c.mu]).sum(axis=0)  # equation 13
shift = (m - before.m) / before.unit / before.sigma
white = before.B @ (before.B.T @ shift / before.D)  # C^(-1/2) of equation 14
p_sigma = (1 - c.c_sigma) * before.p_sigma + np.sqrt(c.c_sigma * (2 - c.c_sigma) * c.mu_eff) * white
sigma = before.sigma * np.exp(c.c_sigma / c.d_sigma * (np.linalg.norm(p_sigma) / c.chi_n - 1))  # equation 15
pd.Series(
    {
        "members that make the mean": c.mu,
        "effective number of members (mu_eff)": c.mu_eff,
        "length of the path p_sigma": np.linalg.norm(p_sigma),
        "length of a random walk's (chi_n)": c.chi_n,
        "sigma before": before.sigma,
        "sigma after": sigma,
    }
).round(3).to_frame("")

# %% [markdown]
# Equations 16 and 17: $\mathbf C$ is a weighted mean of itself and of two updates. The path $\mathbf p_c$ stretches it
# along the direction in which the mean keeps moving. The better half of the samples stretches it towards themselves;
# the worse half, with negative weights, shrinks it. With a population of 300 the samples dominate: $c_\mu$ is close
# to 1, and $\mathbf C$ is nearly replaced in every generation.

# %%
p_c = (1 - c.c_c) * before.p_c + np.sqrt(c.c_c * (2 - c.c_c) * c.mu_eff) * shift  # equation 16, path not stalled
y = (ranked - before.m) / (before.sigma * before.unit)
length = np.linalg.norm(y @ before.B / before.D, axis=1)
w = np.where(c.weights < 0, c.weights * c.n / length**2, c.weights)
C = (1 - c.c_1 - c.c_mu * c.weights.sum()) * before.C + c.c_1 * np.outer(p_c, p_c) + c.c_mu * (w * y.T) @ y
pd.DataFrame(
    {
        "mean before": before.m,
        "mean after": m,
        "SD before": before.std,
        "SD after": sigma * before.unit * np.sqrt(np.diag(C)),
        "SD after, by search.py": after.std,
    },
    index=list(FREE_PARAMETERS),
)

# %%
shown = [FREE_PARAMETERS.index(name) for name in ("tau_per_s", "omega_rad_per_s")]
labels = ("$\\tau$ [1/s]", "$\\omega$ [rad/s]")
figure = searching.one_generation(drawn, c.weights, box, shown, labels)
workbook.save_figure(
    figure,
    "search_one_generation",
    caption="One generation in two of its seven dimensions: samples and their better half, the new mean, and the "
    "distribution of the next samples, narrower where the good ones agree. The frame is the box of Table 1; samples "
    "beyond it are reflected.",
)

# %% [markdown]
# The whole run: the ellipse turns and shrinks until all members have the same misfit within 1e-11 rps.

# %%
steps = list(islice(paper_search(clean, protocol, seed), protocol.iterations))
found = search.search(iter(steps), protocol.iterations)
best = found.history[:, search.HISTORY.index("best")]
picked = [g for g in (1, 10, 20, 40, 60) if g <= best.size]
figure = searching.run([steps[g - 1].after for g in picked], best, box, shown, labels)
workbook.save_figure(
    figure,
    "search_run",
    caption="A run: mean and distribution in two dimensions after some generations, and how the lowest misfit "
    "comes down to the run's best, slowly while the search explores, then exponentially.",
)
pd.Series({"ended by": found.stop, "generations": best.size, "misfit [rps]": found.misfit}).to_frame("")

# %% [markdown]
# ### The variants
#
# `variant_scores` sets the mean and the SD of the runs on each record beside the printed ones. With few runs a record
# and one noise realisation, the table ranks clear failures; it does not choose between similar variants.

# %%
seeds = range(1, repeats + 1)
chosen = [protocol for protocol in VARIANTS if protocol.name in variants]
if your_variant:
    chosen.append(replace(table2.AUTHORS, name="your variant", **your_variant))
records = [(key, record) for key, record in table2.authors_table2_records([realisation]) if key["row"] in rows]
runs = table2.repeated_fits(records, chosen, seeds, label="protocol variants")
scores = variant_scores(runs)
workbook.save_table(scores, "protocol_variants")
ranking = rank_variants(scores)
workbook.save_table(ranking, "protocol_ranking")
ranking

# %%
figure = paper.protocol_variants(scores)
workbook.save_figure(
    figure,
    "table2_protocols",
    caption="Variants of the protocol against Table 2: with the printed turn period every mean falls far short, "
    "a start drawn at random is worse than the whole record, and no variant gives the printed SDs.",
)

# %% [markdown]
# With a larger population more runs end in the best basin, and the means lie closer to the printed ones. The SD over
# repeated runs depends on which few runs leave the best basin and where they end. With 300 members a third of
# the runs or more leave it, and our SDs lie on both sides of the printed ones, by factors. With 1000 members hardly
# any run leaves it, and nearly all of our SDs lie below: what the window's gate leaves free.
#
# A start sample drawn anew for each run, as the text says, makes many runs end in other basins and pulls the means far
# below the printed ones; drawn once for a record it does so on some records. The turn period of Table 1 fails outright.

# %% [markdown]
# ### Other seeds, another version of the library
#
# How far do the means of such a table move with the seeds, and how far with the version of the library? The 2021
# search runs with two sets of seeds on every record; today's `cma`, which is slow, on every third record.
#
# `shift_percent` is the average shift of the means against the first set, with a 95 % interval (bootstrap over the
# runs); `best_shift_percent` is that of the runs in the best basin. `apart_percent` is the rms shift, and
# `chance_percent`, with its interval, the rms shift that chance alone gives to sets of these sizes.

# %%
todays_cma = next(p for p in VARIANTS if p.engine == "cma")
every_third = [(key, record) for key, record in records if key["row"] in (rows[1::3] or rows)]
all_seeds = range(1, 2 * seed_runs + 1)
of_2021 = table2.repeated_fits(records, [table2.AUTHORS], all_seeds, label="the search of 2021")
sets = {
    "the search of 2021": of_2021[of_2021["seed"] <= seed_runs],
    "the same, other seeds": of_2021[of_2021["seed"] > seed_runs],
    "today's cma": table2.repeated_fits(every_third, [todays_cma], range(1, today_runs + 1), label="today's cma"),
}
versions = basins.compare_searches(sets)
workbook.save_table(versions, "library_versions")
versions.set_index("search").round(2).T

# %% [markdown]
# What the table can tell: how far other seeds alone move means over 30 runs, and that in the best basin both versions
# find the same $A$ within the interval of `best_shift_percent`. What it cannot: with so few runs of today's `cma`, a
# shift of the means smaller than the interval of `shift_percent`, or a rate that differs by less than its interval.
# A table of such means can be reproduced to some percent with any version and any seeds; to its printed digits only
# with the seeds, the library, its BLAS and its LAPACK, which the paper does not print.

# %% [markdown]
# ## Verdict

# %%
workbook.record_verdicts({"authors": found_table1.to_dict()})

# %% [markdown]
# ## Try changing
#
# 1. `variants = ["authors' notebook", "T_d and T_f as printed"]`: two lines in the figure; the second lies 30 % or
#    more below the printed means.
# 2. `realisation = 2`: another noise; the means of the authors' protocol move by a few percent, the SDs by factors.
# 3. `population = 20`: ten members make the mean, and $c_\mu$ is 0.1 instead of 0.96, so that the ellipse changes
#    little from one generation to the next; the run settles early, at six times the misfit of the stored run.
