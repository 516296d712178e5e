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
#     quick: {repeats: 2, realisations: [1, 2, 3], noise_seeds: [1, 2]}
# ---

# %% [markdown]
# # 8 · Noise sensitivity (Table 2)
#
# ## Claim
#
# On ten simulated records with uniform noise, 30 runs each, the mean of $A$ lies within 10 % of its theoretical value,
# and a record that is only noise gives an $A$ close to zero (section "Testing noise sensitivity on simulated data",
# Table 2).
#
# ## Method
#
# **Records.** The authors published five realisations R = 1 to 5 of the low noise, each at the ten levels of Table 2
# (K = 2 to 11). Which realisation Table 2 was computed from is not said. A record without backlash is not public (their
# level 1 has 1e-4 rad), so the last row's is made: constant speed and uniform noise of the printed amplitude. Beside
# them stand our own: the identified joint (notebook 3) at the ten levels, with five noises of the printed amplitude.
#
# **Runs.** The protocol of the authors' notebook, 30 runs on each record. The sign of $A$ is dropped, because
# $(A, t_0)$ and $(-A, t_0 \pm T_d)$ are the same signal; only pure noise keeps it.
#
# **Region.** Let $x_1, \dots, x_n$ be the logarithms of the mean (or SD) that the runs on each of $n$ realisations
# give, $\bar x$ and $s$ their mean and SD. The number that one more realisation would give lies with 95 % in
#
# $$\exp\left(\bar x \pm t_{0.975}(n - 1)\; s \sqrt{1 + 1/n}\right).$$
#
# Table 2 is such a number, if it was computed as here. So its printed number should lie in this region, and a region
# that also holds a neighbouring printed number, or the theoretical $A$, is too wide to decide. The whole rule is at the
# head of `workbook/judging.py`.
#
# **Best basin.** The runs whose RMSE is within 0.2 % of the lowest. The others, off-basin runs, end in local minima.

# %%
from dataclasses import replace

import numpy as np
import pandas as pd

from replication import published, table2, workbook
from replication.figures import paper
from replication.replay import inspection
from replication.simulator.simulate import identified_joint
from replication.workbook.judging import judge_cells, region

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
repeats = 30  # runs on each record
realisations = [1, 2, 3, 4, 5]  # the authors' noise realisations R
noise_seeds = [1, 2, 3, 4, 5]  # of our noises: the simulated records' and the noise-only ones
population = 300  # members of a generation of the search
shown_row = 5  # of Table 2, whose runs are condensed cell by cell
criteria = {}  # limits to try instead of those of claims.csv, such as {"local_minima": 0.7}

# %% [markdown]
# ## Result
#
# ### The noise that was added
#
# Half its range, over the five realisations, where the clean record is public; for row 1 from its variance.

# %%
noise = inspection.noise_amplitudes()
pd.DataFrame({"printed": published.column("Table 2", "noise")[: len(noise)], "measured": noise}).round(4)

# %%
added = {f"K = {level}": inspection.added_noise(level, 1) for level in range(3, 12)}
noise_law = pd.DataFrame({level: inspection.uniform_noise_test(noise_rps) for level, noise_rps in added.items()}).T
noise_law.round(3)

# %% [markdown]
# ### One record
#
# Thirty fits, their mean and SD, and the best basin.

# %%
protocol = replace(table2.AUTHORS, population=population)
seeds = range(1, repeats + 1)
of_authors = table2.authors_table2_records(realisations)
shown = table2.repeated_fits([of_authors[shown_row - 1]], [protocol], seeds, label="one record")
A = shown["A_rps"].abs()
in_best = shown["rmse_rps"] <= shown["rmse_rps"].min() * (1 + table2.BASIN_GAP)
printed_A = published.column("Table 2", "mean")[shown_row - 1], published.column("Table 2", "sd")[shown_row - 1]
pd.DataFrame(
    {"all runs": [A.mean(), A.std()], "best basin": [A[in_best].mean(), A[in_best].std()], "printed": printed_A},
    index=["mean of A [rps]", "SD of A [rps]"],
).round(4)

# %% [markdown]
# ### All records
#
# `table2.table2` condenses the runs on every record in the same four lines.

# %%
joint = identified_joint()
of_ours = [record for seed in noise_seeds for record in table2.simulated_table2_records(joint, seed)]
of_ours += [table2.noise_only_record(seed) for seed in noise_seeds]
fits = table2.repeated_fits([*of_authors, *of_ours], [protocol], seeds, label="Table 2")
table = table2.table2(fits)

# %% [markdown]
# The mean of $A$ [rps] of the runs on each of the authors' realisations, and the region that they give.

# %%
backlash = table[table["delta_rad"] > 0]
regions = pd.DataFrame({"mean": published.column("Table 2", "mean")[:10], "sd": published.column("Table 2", "sd")[:10]})
regions.index = pd.Index(range(1, 11), name="row")
each = {}
for name in ("mean", "sd"):
    by_row = backlash[backlash["source"] == "authors"].pivot(index="row", columns="realisation", values=f"{name}_A_rps")
    bounds = [region(list(numbers), signed=False) for numbers in by_row.to_numpy()]
    regions[[f"{name}_low", f"{name}_high"]] = bounds
    each[name] = by_row.rename(columns=lambda R: f"R = {R}")
theoretical = pd.Series(published.column("Table 2", "theoretical")[:10], regions.index, name="theoretical")
pd.concat([each["mean"], regions[["mean_low", "mean_high", "mean"]], theoretical], axis=1).round(4)

# %% [markdown]
# The SD of $A$ [rps] over the runs. It depends on which few runs leave the best basin, so its region is wide.

# %%
pd.concat([each["sd"], regions[["sd_low", "sd_high", "sd"]]], axis=1).round(4)

# %%
figure = paper.table2(backlash, regions)

# %% [markdown]
# ### The best basin against the printed means
#
# In percent of the printed mean, for every realisation; `worst` and `rms` are over the ten rows.

# %%
best = backlash.assign(error=table2.error_percent(backlash, "best_A_rps")).pivot(
    index="row", columns=["source", "realisation"], values="error"
)
spread = pd.DataFrame({"worst": best.abs().max(), "rms": np.sqrt((best**2).mean())}).T
pd.concat([best, spread]).round(1)

# %% [markdown]
# ### Where the runs end
#
# How many of the runs on each record end in its best basin.

# %%
in_best_basin = backlash.pivot(index="row", columns=["source", "realisation"], values="best_basin_runs")
in_best_basin

# %% [markdown]
# The record with the widest spread. Some basins are the same oscillation half a turn or more off, with nearly the same
# $A$: they hardly move the mean. Others, stuck at $t_0 = 0$ with a wrong frequency, do.

# %%
first = backlash[(backlash["source"] == "authors") & (backlash["realisation"] == realisations[0])]
widest = int(first.loc[first["sd_A_rps"].idxmax(), "row"])
of_widest = fits[(fits["source"] == "authors") & (fits["realisation"] == realisations[0]) & (fits["row"] == widest)]
labels = table2.basin_labels(of_widest["rmse_rps"].to_numpy())
basins_figure = paper.basins(of_widest, labels, f"row {widest} of Table 2, R = {realisations[0]}, {repeats} runs")

# %% [markdown]
# ### Other seeds
#
# Seeds 1 to 30 are a choice. With the next 30 on the authors' records the numbers and their regions change, and with
# them the verdicts on these cells:

# %%
other_fits = table2.repeated_fits(of_authors, [protocol], range(repeats + 1, 2 * repeats + 1), label="other seeds")
of_seeds = {"": table[table["source"] == "authors"], "_other_seeds": table2.table2(other_fits)}
judged = {name: judge_cells(table2.table2_cells(part), "authors").set_index("id") for name, part in of_seeds.items()}
columns = ["reproduced", "low", "high", "verdict"]
by_seeds = judged[""][["printed", *columns]].join(judged["_other_seeds"][columns], rsuffix="_other_seeds")
by_seeds[by_seeds["verdict"] != by_seeds["verdict_other_seeds"]].round(4)

# %% [markdown]
# ## Verdict
#
# Each cell has one number a realisation, and is judged by the region that these give. The printed number and ours must
# both lie in it, and it must not be too wide. Table 2 has twenty such cells in rows 1 to 10: by chance alone, one of
# twenty 95 % regions misses its number. A verdict that other seeds change (above) is worth less than one that they
# keep.

# %%
of_source = dict(list(table.groupby("source", sort=False)))
largest = of_source["authors"].groupby("realisation")["relative_error_percent"].max()
measured_noise = {f"table2.row{row:02d}.noise": value for row, value in enumerate(noise, start=1)}
cells = {
    "authors": table2.table2_cells(of_source["authors"]) | measured_noise | {"text.error_limit_percent": list(largest)},
    "simulated": table2.table2_cells(of_source["simulated"]),
}
claims = {
    "error_below_10": table2.decide_error_below_10(fits[fits["source"] == "authors"], criteria),
    "local_minima": table2.decide_local_minima(backlash[backlash["source"] == "authors"], criteria),
}
verdicts = workbook.record_verdicts(cells, claims)
verdicts

# %% tags=["export"]
workbook.save_table(fits, "table2_runs")
workbook.save_table(table, "table2")
workbook.save_table(regions.reset_index(), "table2_regions")
workbook.save_table(by_seeds.reset_index(), "table2_other_seeds")
workbook.save_figure(
    figure,
    "table2_amplitudes",
    caption="Table 2 against the runs on five noise realisations: (a) means of 30 runs and best basins on the authors' "
    "records, with the region for one more realisation, (b) the same on our simulated records, (c) the SDs. A printed "
    "mean is decided only where its region holds neither the theoretical A nor a neighbouring printed mean.",
)
workbook.save_figure(
    basins_figure,
    "table2_basins",
    caption=f"Where the {repeats} runs end on row {widest}, R = {realisations[0]}, the row of widest spread: the area "
    "of a marker shows how many runs share it. Runs at another amplitude make the SD.",
)

# %% [markdown]
# ## Try changing
#
# 1. `realisations = [1, 2]`: from two realisations the regions are wide. Means that were `reproduced` become
#    `undecided`, but for row 5, where the two happen to agree; so do the SDs that differed.
# 2. `population = 30`: many more off-basin runs. More than half of the means fall so far below the printed ones that
#    they differ.
# 3. `criteria = {"local_minima": 0.7}`: who calls it avoiding only if 70 % of the runs succeed, sees the claim fail.
