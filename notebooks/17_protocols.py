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
#     quick: {checked_runs: 4, tables: 200}
# ---

# %% [markdown]
# # 17 · Which protocol printed Table 2?
#
# ## Claim
#
# Table 2's means and SDs are those of 30 runs of "the proposed approach" on a record (section "Testing noise sensitivity
# on simulated data"). Which settings that was is not said: the authors' notebook says of itself that it was changed
# afterwards (population, iterations, box of $A$, unit), and the noise realisation is unknown.
#
# ## Method
#
# Candidates are data (`studies.pools.GRID`): each differs from one of two poles in one respect. The poles are the
# authors' notebook, and what its comments say came before: speed about its mean in rpm, as equation 10 has it, in the box
# of $A$ as printed. Every candidate was run many times on the authors' records R = 1 and R = 2 by the search of 2021
# (`make protocols`; the pools are in `results/protocols`). From a pool follows what 30 runs on another realisation would
# print, and so how likely the printed table is.
#
# The criteria were written down before any pool was computed (the head of `studies/protocols.py`): the summary, the
# kernel, the prior, when a candidate is dropped, the regions, and who chooses and who judges.

# %%
import numpy as np
import pandas as pd

from replication import workbook
from replication.studies import plots, protocols
from replication.studies.pools import AUTHORS, GRID, ROWS, pool
from replication.studies.predictive import LEAST_SD_WIDTH, best_basins, widths

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
checked_runs = 12  # runs of the pools that are run again
check_seed = 1  # which ones
tables = 1000  # predicted tables that a p-value counts
quiet_share = 0.01  # a row whose SD is below this share of its mean is called quiet: no run strayed far

# %% [markdown]
# ## Result
#
# ### The pools
#
# A few runs, drawn at random, run again: the same to the digits that are kept.

# %%
again = protocols.recomputed(list(GRID), checked_runs, np.random.default_rng(check_seed))
assert again["same"].all(), "the pools are not what this code computes: run `make protocols` anew"
again

# %% [markdown]
# How far the two realisations are apart in the best basin, over all rows: the kernel's widths.

# %%
width = widths(pool(AUTHORS))
pd.Series({"ln mean": width[0], "ln SD": width[1]}).round(4)

# %% [markdown]
# ### How likely each candidate makes the printed table
#
# `share` is the posterior share when every candidate is as probable as any other before.

# %%
likelihoods = protocols.likelihood_table()
ranking = protocols.ranking(likelihoods)
workbook.save_table(ranking, "protocols")
ranking.drop(columns=["amplitude_factor", "iterations", "restarts", "start", "T_d_s"]).head(20).round(3)

# %%
figure = plots.protocol_ranking(ranking, shown=30)
workbook.save_figure(figure, "protocols_ranking")
