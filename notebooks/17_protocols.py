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
#     quick: {checked_runs: 3}
# ---

# %% [markdown]
# # 17 · Which protocol printed Table 2?
#
# ## Claim
#
# Table 2's means and SDs are those of 30 runs of "the proposed approach" on a record, whose analysis begins at a random
# one of the first 100 samples (sections "Experimental evaluation" and "Testing noise sensitivity on simulated data").
# The settings are not said. The authors' notebook says of itself that it was changed afterwards: population,
# iterations, the box of $A$, the unit. The noise realisation is unknown.
#
# ## Method
#
# Candidates are data (`studies.pools.GRID`). Each differs from one of two poles in one respect. The poles are the
# authors' notebook, and what its comments say came before: speed about its mean in rpm, as equation 10 has it, in the
# box of $A$ as printed. Every candidate has a pool of runs on the authors' records R = 1 and R = 2, by the search of
# 2021 (`make protocols`, kept in `results/protocols`). A pool tells what means and SDs 30 runs on another realisation
# would print, and so how likely it makes the printed table.
#
# The criteria were written down before any pool was computed (the head of `studies/protocols.py`): the summary, the
# kernel, the prior, when a candidate is dropped, the regions, who chooses and who judges.
#
# Left out: no bounds at all (a line in the authors' notebook that is switched off has that, but where the search would
# start is not said), other stop rules than the library's, and combinations of changes.

# %%
import numpy as np
import pandas as pd

from replication import workbook
from replication.studies import plots, protocols
from replication.studies.pools import AUTHORS, GRID, ROWS, pool
from replication.studies.predictive import widths

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
checked_runs = 12  # runs of the pools that are run again
check_seed = 1  # which ones
sd_width = None  # the kernel's width along ln SD; None takes the one that the pools give
compared = "authors' notebook"  # the candidate whose regions are shown beside the chosen ones
quiet_share = 0.01  # a row with an SD below this share of its mean is quiet: no run ended far away

# %% [markdown]
# ## Result
#
# ### The pools
#
# A few runs, drawn at random, run again: the same to the digits that are kept.

# %%
again = protocols.recomputed(list(GRID), checked_runs, np.random.default_rng(check_seed))
assert again["same"].all(), "the pools are not what this code computes: run `make protocols`"
again.drop(columns=["again"])

# %% [markdown]
# How far the two realisations are apart in the best basin, rms over all rows: the kernel's widths.

# %%
width = widths(pool(AUTHORS))
width = (width[0], sd_width or width[1])
pd.Series({"ln mean": width[0], "ln SD": width[1]}).round(4)

# %% [markdown]
# ### How likely each candidate makes the printed table
#
# `share` is the posterior share; before, every candidate is as probable as any other. All candidates are in
# `results/protocols.csv`.

# %%
likelihoods = protocols.likelihood_table(width)
ranking = protocols.ranking(likelihoods, width)
workbook.save_table(ranking, "protocols")
shown = ["protocol", "runs_a_row", "log_likelihood", "log_likelihood_R1", "log_likelihood_R2", "share"]
ranking[[*shown, "best_basin_share", "dropped"]].head(24).round(3)

# %%
figure = plots.protocol_ranking(ranking, shown=32)
workbook.save_figure(
    figure,
    "protocols_ranking",
    caption="How likely each candidate protocol makes the printed Table 2, the likeliest at the top.",
)

# %% [markdown]
# ### Five rows choose, the other five judge
#
# All 252 choices of five rows: how often each candidate is chosen, and the p-values that the other five rows give it.

# %%
kept = likelihoods.loc[protocols.contenders()]
named = {protocols.chosen_by(kept, five) for five in protocols.fives()} | {AUTHORS, compared}
simulated = {name: protocols.simulated_likelihoods(name, pool(name), width) for name in sorted(named)}
splits = protocols.choices(kept, simulated)
workbook.save_table(splits, "protocols_splits")
by_choice = splits.groupby("protocol")["p"].agg(["size", "median", "min", lambda p: (p < 0.05).mean()])
by_choice.columns = ["choices", "median p", "smallest p", "share of p below 0.05"]
by_choice.sort_values("choices", ascending=False).round(3)

# %% [markdown]
# Odd rows choose for even rows and conversely: these candidates judge the cells.

# %%
chosen = protocols.chosen_by_other_half(kept)
pd.Series(chosen, name="judged by").rename_axis("row").to_frame()

# %% [markdown]
# ### The regions of Table 2's cells
#
# The middle 95 % of what 30 runs on another realisation would print, and one p-value for each whole table.

# %%
tables = {
    compared: protocols.table2_regions(dict.fromkeys(ROWS, compared)),
    "chosen by the other five rows": protocols.table2_regions(chosen),
}
regions = pd.concat(tables, names=["source"]).reset_index(0)
workbook.save_table(regions, "table2_regions")
outside = regions[~regions["inside"]]
outside.round(4)

# %%
joint_p = pd.Series(
    {
        compared: protocols.joint_p(dict.fromkeys(ROWS, compared), likelihoods, simulated),
        "chosen by the other five rows": protocols.joint_p(chosen, likelihoods, simulated),
    },
    name="p of the whole table",
)
joint_p.to_frame().round(3)

# %%
figure = plots.predicted_regions(tables)
workbook.save_figure(
    figure,
    "table2_regions",
    caption="Where 95 % of tables of 30 runs would print each row's mean and SD, with the printed numbers: a mark "
    "outside its bar is a cell that this protocol does not explain.",
)

# %% [markdown]
# ### What is left unexplained
#
# Rows 1, 2 and 7 are printed with the SD of runs that all end in one basin; the others with that of a run or two far
# away. How often each candidate predicts that, row by row:

# %%
patterns = {
    name: protocols.stray_pattern(name, width, quiet_share) for name in (compared, *dict.fromkeys(chosen.values()))
}
quiet = pd.DataFrame({name: table["predicted_quiet"] for name, table in patterns.items()})
quiet.insert(0, "printed quiet", patterns[compared]["printed_quiet"])
quiet.index = pd.Index(ROWS, name="row")
quiet.round(3)

# %% [markdown]
# The best that any contender does for each row, of mean and SD together (log-likelihood; a row from elsewhere has -5):

# %%
best_of_row = pd.DataFrame(
    {"log-likelihood": kept.max(), "candidate": kept.idxmax(), "spread": kept.max() - kept.min()}
)
best_of_row.round(2)

# %% [markdown]
# ### What a mean may be off by
#
# In another realisation: how far R = 1 and R = 2 are apart in the best basin, how far noises over our joint scatter it,
# and half the region of the mean of 30 runs, strays included.

# %%
tolerances = protocols.mean_tolerances(AUTHORS)
workbook.save_table(tolerances, "protocols_mean_tolerances")
tolerances.round(3)

# %% [markdown]
# ### The row without backlash
#
# Its mean is as often positive as negative; the RMS of $A$ over the runs is what can be compared.

# %%
noise_only = protocols.noise_only_regions(AUTHORS)
workbook.save_table(noise_only, "protocols_noise_only")
noise_only.round(4)

# %% [markdown]
# ### Table 3's SDs
#
# Stand-ins of the bench: our joint at Table 3's backlashes, with other noise and with friction. How often 30 runs have
# an SD as small as 0.0010 and as large as 0.0879 rps. Table 4's SDs lie between these.

# %%
benches = protocols.bench_sds(AUTHORS)
workbook.save_table(benches, "protocols_benches")
benches.drop(columns="protocol").round(4)

# %% [markdown]
# ## Verdict
#
# The cells are judged by the regions of the candidate that the other rows chose; the number beside the printed one is
# what that candidate gives on the authors' records R = 1. Notebook 8 judges its own runs by the regions of the authors'
# notebook.

# %%
odds, drawn, whole = protocols.odds_of_starts(likelihoods.sum(axis=1))
claims = {
    "random_start": (
        None if 1 / 20 < odds < 20 else odds >= 20,
        f"odds of {odds:.2g} for a drawn start: {drawn}, against {whole}",
    )
}
of_chosen = protocols.cells_of(tables["chosen by the other five rows"])
cells = protocols.chosen_cells(chosen)
workbook.verdict({"chosen": cells}, claims, {"chosen": of_chosen})

# %% [markdown]
# ## Try changing
#
# 1. `compared = "authors' notebook, T_d and T_f printed"`: with Table 1's turn period no printed mean lies inside.
# 2. `sd_width = 0.13`: a kernel as narrow as 30 normal runs allow; the shares move, the printed turn period stays last.
# 3. `check_seed = 2`: other runs of the pools are run again, and are the same.
