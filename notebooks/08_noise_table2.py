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
#     quick: {repeats: 2, realisations: [1]}
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
# The authors' own noisy records, levels K = 2 to 11, of two noise realisations R = 1 and R = 2; the protocol of their
# notebook, seeds 1 to 30. A record without backlash is not public (their level 1 has 1e-4 rad), so the last row's is
# made: constant speed and uniform noise of the printed amplitude. Beside the authors' records stand our own: the
# identified joint (notebook 3) at the ten levels, with noise of the printed amplitude.
#
# Beside mean and SD stands the *best basin*: the runs whose RMSE is within 0.2 % of the lowest. The SD over runs mixes
# two things that are not measurement noise: which basin a run ended in, and where inside a 2 ms sample the window's
# start came to rest, which the data cannot tell and which moves $A$ by up to 3 %. The sign of $A$ is dropped, because
# $(A, t_0)$ and $(-A, t_0 \pm T_d)$ are the same signal; only pure noise keeps it.

# %%
from dataclasses import replace

import pandas as pd

from replication import published, table2, workbook
from replication.figures import paper
from replication.simulator.simulate import identified_joint
from replication.studies import inspection, protocols

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
repeats = 30  # runs on each record
realisations = [1, 2]  # the authors' noise realisations R
noise_seed = 1  # of our noise: the simulated records' and the noise-only one
population = 300  # members of a generation of the search
shown_row = 5  # of Table 2, whose runs are condensed in plain sight
limit_percent = 10  # which no row's error reaches, says the paper

# %% [markdown]
# ## Result
#
# ### The noise that was added
#
# Half its range, where the clean record is public.

# %%
noise = inspection.noise_amplitudes()
noise_rows = pd.DataFrame({"printed": published.column("Table 2", "noise")[: len(noise)], "measured": noise})
noise_rows

# %%
noise_law = pd.DataFrame({f"K = {level}": inspection.uniform_noise_test(level, 1) for level in range(3, 12)}).T
noise_law

# %% [markdown]
# ### Table 2
#
# One record in plain sight: the fits, their mean and SD, and the best basin.

# %%
protocol = replace(table2.AUTHORS, population=population)
seeds = range(1, repeats + 1)
of_authors = table2.authors_table2_records(realisations)
shown_record = of_authors[shown_row - 1]  # what it is, and the record
shown = table2.repeated_fits([shown_record], [protocol], seeds, label="one record")
A = shown["A_rps"].abs()  # (A, t0) and (-A, t0 plus or minus T_d) are the same signal: the sign says nothing
in_best = shown["rmse_rps"] <= shown["rmse_rps"].min() * (1 + table2.BASIN_GAP)
printed_A = published.column("Table 2", "mean")[shown_row - 1], published.column("Table 2", "sd")[shown_row - 1]
pd.DataFrame(
    {"all runs": [A.mean(), A.std()], "best basin": [A[in_best].mean(), A[in_best].std()], "printed": printed_A},
    index=["mean of A [rps]", "SD of A [rps]"],
).round(4)

# %% [markdown]
# So for every record; `table2.summarise_runs` condenses the runs in the same four lines.

# %%
of_ours = [
    *table2.simulated_table2_records(identified_joint(), noise_seed),
    table2.noise_only_record(noise_seed),
]
fits_of_authors = table2.repeated_fits(of_authors, [protocol], seeds, label="Table 2, authors' records")
fits_of_ours = table2.repeated_fits(of_ours, [protocol], seeds, label="Table 2, simulated records")
workbook.save_table(fits_of_authors, "table2_runs_authors")
workbook.save_table(fits_of_ours, "table2_runs_simulated")

# %%
printed_noise = published.column("Table 2", "noise")
table = pd.concat(
    [
        table2.table2(fits_of_authors, "authors", noise),
        table2.table2(fits_of_ours, "simulated", printed_noise),
    ],
    ignore_index=True,
)
workbook.save_table(table, "table2")
table.drop(columns=["delta_rad", "noise_amplitude_rps"])

# %%
printed = pd.DataFrame({name: published.column("Table 2", name)[:10] for name in ("theoretical", "mean", "sd")})
backlash = table[table["theoretical_A_rps"] > 0]
by_source = {
    f"{source}, {noise_level}": part
    for (source, noise_level), part in backlash.groupby(["source", "noise_level"], sort=False)
}
figure = paper.table2(by_source, printed)
workbook.save_figure(
    figure,
    "table2_amplitudes",
    caption="Means over all runs carry wide bars where runs stray into other basins; the best basins beneath "
    "stay close to the printed means, whichever record it is.",
)

# %% [markdown]
# ### The best basin against the printed means
#
# The bar is 2 %: what the window's gate and another noise realisation move.

# %%
best = pd.DataFrame({label: table2.best_basin_error_percent(part) for label, part in by_source.items()})
best.index = pd.Index(range(1, len(best) + 1), name="row")
best.round(2)

# %% [markdown]
# ### Where the runs end
#
# The row with the widest spread. Some basins are the same oscillation half a turn or more off, with nearly the same
# $A$: that is why the mean survives them. Others, stuck at $t_0 = 0$ with a wrong frequency, pull it away.

# %%
first_level = f"low, R = {realisations[0]}"
of_first = table[table["noise_level"] == first_level]
widest = int(of_first.loc[of_first["sd_A_rps"].idxmax(), "row"])
of_widest = fits_of_authors[(fits_of_authors["row"] == widest) & (fits_of_authors["noise_level"] == first_level)]
labels = table2.basin_labels(of_widest["rmse_rps"].to_numpy())
figure = paper.basins(of_widest, labels, f"row {widest} of Table 2, {first_level}")
workbook.save_figure(
    figure,
    "table2_basins",
    caption="Where the runs on the row of widest spread end: many in the best basin, others at a higher RMSE, "
    "some with nearly the same amplitude and some with another altogether. The latter make the SD.",
)

# %% [markdown]
# ## Verdict
#
# The authors' cells are judged on R = 1, the simulated ones on our own records. A mean and an SD of 30 runs depend on
# which runs stray, and on the noise realisation, which is not known. So the region of each cell is the one that holds
# 95 % of the tables which this protocol would print (`low` to `high`, from the pools of notebook 17), and the printed
# number has to lie in it. A region that holds half of its column's other numbers decides nothing.

# %%
of_simulated = table[table["source"] == "simulated"]
of_authors_table = table[table["source"] == "authors"]
theory, best_A = of_authors_table["theoretical_A_rps"], of_authors_table["best_A_rps"]
largest, largest_best = of_authors_table["relative_error_percent"].max(), (100 * (best_A - theory).abs() / theory).max()
claims = {
    "error_below_10": (
        max(largest, largest_best) < limit_percent,
        f"largest error of a row: mean of all runs {largest:.1f} %, best basin {largest_best:.1f} %",
    ),
}
noise_cells = [f"table2.row{row:02d}.noise" for row in of_simulated["row"]]  # taken from the paper, not measured
cells = {
    "authors": table2.table2_cells(of_first).to_dict() | {"text.error_limit_percent": largest},
    "simulated": table2.table2_cells(of_simulated).drop(noise_cells).to_dict(),
}
# What 30 runs of this protocol would print, from the pools of notebook 17; the printed number should lie between.
regions = {"authors": protocols.regions(), "simulated": protocols.regions(kind="S")}
workbook.verdict(cells, claims, regions)

# %% [markdown]
# ## Try changing
#
# 1. `repeats = 3`: the best basin stays within 2 % of the printed means in most rows; the SDs are arbitrary.
# 2. `realisations = [2]`: the verdicts now come from another noise; best basins move by a percent.
# 3. `noise_seed = 2`: another record of pure noise; its mean $A$ changes altogether and stays far below 0.26 rps.
