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
# *You will see what thirty runs on one noisy record say about $A$, what they leave out, and how a region for a printed
# number follows from several noises. Run time: 2 min.*
#
# ## Claim
#
# On ten simulated records with uniform noise, 30 [runs](glossary.md#run) each, the mean of $A$ lies within 10 % of its
# theoretical value, and a record that is only noise gives an $A$ close to zero (section "Testing noise sensitivity on
# simulated data", Table 2).
#
# ## Method
#
# **Noise.** The noisy speed $v_n$ [rps] is the clean speed $v$ [rps] plus a noise $n$ [rps]:
#
# $$v_n(t) = v(t) + n(t) \tag{18}$$
#
# $$n(t) \sim \frac{A_n - A_{min}}{\Delta A} \cdot \mathcal{U}(-0.5, 0.5) \tag{19}$$
#
# $A_n$ is the expected amplitude of the record; $A_{min}$ and $\Delta A$ are not given. No values of them give the
# noise amplitudes that Table 2 prints (erratum E4). The records have uniform noise between $-a_K$ and $a_K$, which is
# linear in the [level](glossary.md#level) K and not in $A$: $a_K = 0.1 + (K - 1) \cdot 0.15/19$ rps.
#
# **Records.** The authors published the [realisations](glossary.md#realisation) R = 1 to 5 of the low noise, and 11 to
# 20 of a noise 1.5 times as large, each at the ten levels of Table 2 (K = 2 to 11). Which realisation Table 2 was
# computed from is not said. A record without backlash is not public (their level 1 has 10⁻⁴ rad), so the last row's is
# made: constant speed and uniform noise of the printed amplitude. Beside them stand our own: the identified joint
# (notebook 3) at the ten levels, with five noises of the printed amplitude.
#
# **Runs.** The protocol of the authors' notebook, 30 runs on each record. The sign of $A$ is dropped, because
# $(A, t_0)$ and $(-A, t_0 \pm T_d)$ are the same signal; only pure noise keeps it.
#
# **Region.** Let $x_1, \dots, x_n$ be the logarithms of the mean (or SD) that the runs on each of $n$ realisations
# give, $\bar x$ and $s$ their mean and SD. The number that one more realisation would give lies with 95 % in the
# [predictive region](glossary.md#predictive-region)
#
# $$\exp\left(\bar x \pm t_{0.975}(n - 1)\; s \sqrt{1 + 1/n}\right),$$
#
# where $t_{0.975}(n - 1)$ is the quantile of Student's distribution with $n - 1$ degrees of freedom. Table 2 is such a
# number, if it was computed as here. So its printed number should lie in this region, and a region that also holds a
# neighbouring printed number, or the theoretical $A$, is too wide to decide. The whole rule is at the head of
# `workbook/judging.py`.
#
# **Best basin.** The [best basin](glossary.md#best-basin) holds the runs whose RMSE follows the lowest one without a
# gap above 0.2 %. The others, [off-basin runs](glossary.md#off-basin-run), end in local minima.

# %%
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy import stats

import workbook
from replication import published, table2
from replication.authors import HIGH_NOISE, LOW_NOISE
from replication.figures import paper
from replication.replay import inspection
from replication.simulator.parameters import identified_joint
from replication.statistics import LEVEL
from workbook import Interval
from workbook.judging import judge_cells, region

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
repeats = 30  # runs on each record
realisations = [
    1,
    2,
    3,
    4,
    5,
]  # the authors' noise realisations R: of 1 to 5 (low noise) or of 11 to 20 (high)
noise_seeds = [1, 2, 3, 4, 5]  # of our noises: the simulated records' and the noise-only ones
noise_factor = 1.0  # multiplies the noise of our records; the authors' stay as they are
population = 300  # members of a generation of the search
shown_row = 5  # of Table 2, whose runs are condensed cell by cell
criteria = {}  # limits to try instead of those of claims.csv, such as {"local_minima": 0.7}

# %% tags=["plumbing"]
workbook.check_parameters(
    repeats=(repeats, Interval(2, 1000, whole=True)),
    realisations=(realisations, [(*LOW_NOISE, *HIGH_NOISE)]),
    noise_seeds=(noise_seeds, [Interval(1, 1e6, whole=True)]),
    noise_factor=(noise_factor, Interval(0.01, 100)),
    population=(population, Interval(4, 10000, whole=True)),
    shown_row=(shown_row, range(1, 11)),
    criteria=(criteria, [("error_below_10", "local_minima")]),
)
for name, given in (("realisations", realisations), ("noise_seeds", noise_seeds)):
    if len(set(given)) < 2 or len(set(given)) < len(given):
        raise ValueError(f"{name} = {given!r}: a region needs at least two, and each only once")

# %% [markdown]
# ## Result
#
# ### The noise that was added
#
# Half its range [rps], over R = 1 to 5, where the clean record is public; for row 1 from its variance. `line in A` is
# the best straight line in the theoretical $A$, which is all that equation 19 can give.

# %%
noise = inspection.noise_amplitudes()
printed_noise, theoretical = (
    published.column("Table 2", name)[:10] for name in ("noise", "theoretical")
)
amplitudes = pd.DataFrame(
    {
        "printed": printed_noise,
        "measured": noise,
        "0.1 + (K - 1) 0.15/19": 0.1 + (np.arange(2, 12) - 1) * 0.15 / 19,
        "line in A": np.polyval(np.polyfit(theoretical, printed_noise, 1), theoretical),
    },
    index=pd.Index(range(1, 11), name="row"),
)
amplitudes.round(4)

# %% [markdown]
# Kolmogorov and Smirnov's test of the added noise, R = 1: the probability of so large a deviation from a uniform and
# from a normal distribution. The mean is in standard errors; the correlation is that of neighbouring samples.

# %%
added = {f"K = {level}": inspection.added_noise(level, 1) for level in range(3, 12)}
noise_law = pd.DataFrame(
    {level: inspection.uniform_noise_test(noise_rps) for level, noise_rps in added.items()}
).T
noise_law.round(3)

# %% [markdown]
# ### One record
#
# Thirty fits, their mean and SD, and the best basin. `table2.repeated_fits` runs the search of notebook 7 on every
# record with every seed, on all cores.

# %%
protocol = replace(table2.AUTHORS_PROTOCOL, population=population)
seeds = range(1, repeats + 1)
of_authors = table2.authors_table2_records(realisations)
shown = table2.repeated_fits([of_authors[shown_row - 1]], [protocol], seeds, label="one record")
A = shown["A_rps"].abs()
in_best = table2.basin_labels(shown["rmse_rps"].to_numpy()) == 1
printed_A = (
    published.column("Table 2", "mean")[shown_row - 1],
    published.column("Table 2", "sd")[shown_row - 1],
)
pd.DataFrame(
    {
        "all runs": [A.mean(), A.std()],
        "best basin": [A[in_best].mean(), A[in_best].std()],
        "printed": printed_A,
    },
    index=["mean of A [rps]", "SD of A [rps]"],
).round(4)

# %% [markdown]
# ### All records
#
# `table2.table2` condenses the runs on every record in the same way.

# %%
joint = identified_joint()
of_ours = [
    record
    for seed in noise_seeds
    for record in table2.simulated_table2_records(joint, seed, noise_factor)
]
of_ours += [table2.noise_only_record(seed, noise_factor) for seed in noise_seeds]
fits = table2.repeated_fits([*of_authors, *of_ours], [protocol], seeds, label="Table 2")
table = table2.table2(fits)

# %% [markdown]
# The mean of $A$ [rps] of the runs on each of the authors' realisations, and the region that they give.

# %%
backlash = table[table["delta_rad"] > 0]
regions = pd.DataFrame(
    {"mean": published.column("Table 2", "mean")[:10], "sd": published.column("Table 2", "sd")[:10]}
)
regions.index = pd.Index(range(1, 11), name="row")
each = {}
for name in ("mean", "sd"):
    by_row = backlash[backlash["source"] == "authors"].pivot(
        index="row", columns="realisation", values=f"{name}_A_rps"
    )
    bounds = [region(list(numbers), signed=False) for numbers in by_row.to_numpy()]
    regions[[f"{name}_low", f"{name}_high"]] = bounds
    each[name] = by_row.rename(columns=lambda R: f"R = {R}")
beside = regions.rename(
    columns=lambda name: f"printed {name}" if "_" not in name else name.replace("_", " region, ")
)
beside["theoretical A"] = theoretical
mean_columns = ["mean region, low", "mean region, high", "printed mean", "theoretical A"]
pd.concat([each["mean"], beside[mean_columns]], axis=1).round(4)

# %% [markdown]
# The SD of $A$ [rps] over the runs. It depends on which few runs leave the best basin, so its region is wide.

# %%
pd.concat([each["sd"], beside[["sd region, low", "sd region, high", "printed sd"]]], axis=1).map(
    "{:.3g}".format
)

# %%
table2_amplitudes = paper.table2(backlash, regions)

# %% [markdown]
# ### Our records and the authors'
#
# Over the rows with backlash and over all noises: the error of the means of $A$ against the theoretical $A$, the SD
# over the runs, and the share of runs that end in the best basin.

# %%
by_source = backlash.groupby("source", sort=False)
spread = pd.DataFrame(
    {
        "mean error of a mean [%]": by_source["relative_error_percent"].mean(),
        "largest error of a mean [%]": by_source["relative_error_percent"].max(),
        "median SD [rps]": by_source["sd_A_rps"].median(),
        "runs in the best basin [%]": 100
        * by_source["best_basin_runs"].sum()
        / by_source["runs"].sum(),
        "median lowest RMSE [rps]": by_source["best_rmse_rps"].median(),
    }
)
display(spread.round(3))
error, share = spread["mean error of a mean [%]"], spread["runs in the best basin [%]"]
times = "" if noise_factor == 1 else f"{noise_factor:g} times "
noise_only = table.loc[table["delta_rad"] == 0, "mean_A_rps"]
print(
    f"With {times}the printed noise the means on our simulated records are on average "
    f"{error['simulated']:.1f} % off the theoretical A, and {share['simulated']:.0f} % of the runs end in the best "
    f"basin. On the authors' records, whose noise is as published, it is {error['authors']:.1f} % and "
    f"{share['authors']:.0f} %. On our noise alone the means of A are {noise_only.min():.3f} to "
    f"{noise_only.max():.3f} rps."
)

# %% [markdown]
# ### The best basin against the printed means
#
# In percent of the printed mean, for every realisation; `worst` and `rms` are over the ten rows.

# %%
best = backlash.assign(error=table2.error_percent(backlash, "best_A_rps")).pivot(
    index="row", columns=["source", "realisation"], values="error"
)
over_rows = pd.DataFrame({"worst": best.abs().max(), "rms": np.sqrt((best**2).mean())}).T
pd.concat([best, over_rows]).round(1)

# %% [markdown]
# ### Where the runs end
#
# How many of the runs on each record end in its best basin.

# %%
in_best_basin = backlash.pivot(
    index="row", columns=["source", "realisation"], values="best_basin_runs"
)
in_best_basin

# %% [markdown]
# The record with the widest spread. Some basins are the same oscillation half a turn or more off, with nearly the same
# $A$: they hardly move the mean. Others, stuck at $t_0 = 0$ with a wrong frequency, do.

# %%
first = backlash[(backlash["source"] == "authors") & (backlash["realisation"] == realisations[0])]
widest = int(first.loc[first["sd_A_rps"].idxmax(), "row"])
of_widest = fits[
    (fits["source"] == "authors")
    & (fits["realisation"] == realisations[0])
    & (fits["row"] == widest)
]
labels = table2.basin_labels(of_widest["rmse_rps"].to_numpy())
table2_basins = paper.basins(
    of_widest, labels, f"row {widest} of Table 2, $R$ = {realisations[0]}, {repeats} runs"
)

# %% [markdown]
# ### Other seeds
#
# The seeds are a choice. With as many others on the authors' records the numbers and their regions change, and with
# them the verdicts on these cells:

# %%
other_fits = table2.repeated_fits(
    of_authors, [protocol], range(repeats + 1, 2 * repeats + 1), label="other seeds"
)
of_seeds = {"": table[table["source"] == "authors"], "_other_seeds": table2.table2(other_fits)}
judged = {
    name: judge_cells(table2.table2_cells(part), "authors").set_index("id")
    for name, part in of_seeds.items()
}
columns = ["reproduced", "low", "high", "verdict"]
by_seeds = judged[""][["printed", *columns]].join(
    judged["_other_seeds"][columns], rsuffix="_other_seeds"
)
flipped = by_seeds[by_seeds["verdict"] != by_seeds["verdict_other_seeds"]]
flipped.round(4)

# %% [markdown]
# ## Verdict
#
# Each cell has one number a realisation, and is judged by the region that these give. The printed number and ours must
# both lie in it, and it must not be too wide. Table 2 has twenty such cells in rows 1 to 10: by chance alone, one of
# twenty 95 % regions misses its number. A verdict that other seeds change (above) is worth less than one that they
# keep.

# %% tags=["plumbing"]
of_source = dict(list(table.groupby("source", sort=False)))
largest = of_source["authors"].groupby("realisation")["relative_error_percent"].max()
measured_noise = {f"table2.row{row:02d}.noise": value for row, value in enumerate(noise, start=1)}
cells = {
    "authors": table2.table2_cells(of_source["authors"])
    | measured_noise
    | {"text.error_limit_percent": list(largest)},
    "simulated": table2.table2_cells(of_source["simulated"]),
}
claims = {
    "error_below_10": table2.decide_error_below_10(fits[fits["source"] == "authors"], criteria),
    "local_minima": table2.decide_local_minima(backlash[backlash["source"] == "authors"], criteria),
}

# %%
verdicts = workbook.judge(cells, claims)
of_table2 = verdicts[verdicts["id"].str.startswith("table2")]
parts = of_table2["id"].str.extract(r"row(?P<row>\d+)\.(?P<column>\w+)").astype({"row": int})
verdict_by_row = (
    of_table2.join(parts)
    .pivot(index="row", columns=["source", "column"], values="verdict")
    .fillna("")
)
display(verdict_by_row)
display(verdicts[~verdicts["id"].str.startswith("table2")])

means, sds = (
    [(verdict_by_row["authors", name] == word).sum() for word in ("reproduced", "differs")]
    for name in ("mean", "sd")
)
inside = regions["mean"].between(regions["mean_low"], regions["mean_high"]).sum()
widths = 100 * ((regions["mean_high"] / regions["mean_low"]) ** 0.5 - 1)
print(
    f"{inside} of Table 2's {len(regions)} means lie in the regions that {len(realisations)} realisations give, "
    f"with half-widths of {widths.min():.1f} to {widths.max():.0f} %: {means[0]} are reproduced and "
    f"{means[1]} differ, the others are undecided. Of the SDs {sds[0]} are reproduced and "
    f"{sds[1]} differ: an SD depends on where the off-basin runs end, which are {100 - share['authors']:.0f} % of all "
    f"runs. Other seeds change {len(flipped)} of these {len(by_seeds)} verdicts."
)


# %% tags=["plumbing"]
def from_to(numbers, digits=3):
    return f"{min(numbers):.{digits}f} to {max(numbers):.{digits}f}".replace("-", "−")


judged_means, ranges = verdicts.set_index(["id", "source"])[["low", "high"]], {}
for row, part in table[(table["source"] == "authors") | (table["row"] == 11)].groupby("row"):
    ranges[str(row)] = {
        "means": from_to(part["mean_A_rps"]),
        "region": from_to(judged_means.loc[f"table2.row{row:02d}.mean", part["source"].iloc[0]]),
        "best": from_to(part["best_A_rps"]),
        "sds": from_to(part["sd_A_rps"], 4),
        "in_best": int(part["best_basin_runs"].sum()),
        "runs": int(part["runs"].sum()),
    }
runs_of_means = {f"table2.row{row:02d}.mean": {} for row in regions.index}
for (row, R), part in fits[fits["source"] == "authors"].groupby(["row", "realisation"]):
    in_six_digits = [float(f"{A_rps:.6g}") for A_rps in part["A_rps"].abs()]
    runs_of_means[f"table2.row{row:02d}.mean"][str(R)] = in_six_digits
own, is_sd = backlash[backlash["source"] == "authors"], by_seeds.index.str.endswith(".sd")
differed = by_seeds["verdict"] == "differs"
decided = verdict_by_row["authors"].loc[regions.index]
counted = {
    f"{name}_{word}": (decided[name] == word).sum()
    for name in ("mean", "sd")
    for word in ("reproduced", "differs", "undecided")
}
facts = counted | {
    "level": (100 * LEVEL, ".0f"),
    "regions": 2 * len(regions),
    "regions_missed_by_chance": (2 * len(regions) * (1 - LEVEL), ".0f"),
    "means_inside": inside,
    "theory_outside": (
        (theoretical < regions["mean_low"]) | (theoretical > regions["mean_high"])
    ).sum(),
    "region_half_low": (widths.min(), ".1f"),
    "region_half_high": (widths.max(), ".0f"),
    "sd_printed": (regions["sd"], ".4f"),
    "sd_factor": (
        [float(f"{factor:.1g}") for factor in regions["sd_high"] / regions["sd_low"]],
        ".0f",
    ),
    "seeds_flipped": len(flipped),
    "sd_differ_still": (by_seeds.loc[is_sd & differed, "verdict_other_seeds"] == "differs").sum(),
    "seeds_sd_undecided": (
        by_seeds.loc[is_sd & differed, "verdict_other_seeds"] == "undecided"
    ).sum(),
    "seeds_new_differs": (by_seeds.loc[~differed, "verdict_other_seeds"] == "differs").sum(),
    "runs": repeats,
    "runs_all": len(fits),
    "realisations": len(realisations),
    "best_share": (100 * own["best_basin_runs"] / own["runs"], ".0f"),
    "sd": (own["sd_A_rps"], ".4f"),
    "sd_best": (own["best_sd_A_rps"], ".4f"),
    "best_worst": (over_rows.loc["worst", "authors"], ".1f"),
    "best_rms": (over_rows.loc["rms", "authors"], ".1f"),
    "simulated_worst": (over_rows.loc["worst", "simulated"], ".1f"),
    "last_sd": (published.value("table2.row11.sd") ** 0.5, ".3f"),
}
workbook.export(
    tables={"table2": table},
    supplement={
        "table2_runs": (fits, "Every run on the records of Table 2, the authors' and ours."),
        "table2_other_seeds": (
            by_seeds.reset_index(),
            "Verdicts on the means and SDs, and those that other seeds give.",
        ),
    },
    pages={
        "report": {"runs": runs_of_means, "other_seeds": flipped["verdict_other_seeds"].to_dict()},
        "article": {"table2": ranges},
    },
    facts=facts,
    figures={
        "table2_amplitudes": (
            table2_amplitudes,
            f"Table 2 against the runs, {repeats} on each record; a marker is one noise realisation. (a) Means of all "
            f"runs and of those in the best basin on the authors' records, {len(realisations)} realisations, with the "
            f"95 % region for one more; (b) the same on our simulated records, {len(noise_seeds)} realisations; (c) "
            "the SDs. A printed mean is decided only where its region holds neither the theoretical A nor a "
            "neighbouring printed mean.",
        ),
        "table2_basins": (
            table2_basins,
            f"Where the {repeats} runs end on row {widest}, R = {realisations[0]}, the row of widest spread: "
            f"{(labels == 1).sum()} in the best basin. The area of a marker is in proportion to its number of runs. "
            "Runs at another amplitude make the SD.",
        ),
    },
    cells=cells,
    claims=claims,
)

# %% [markdown]
# ## Try changing
#
# 1. `realisations = [1, 2]`: from two realisations the regions are wide. Means that were `reproduced` become
#    `undecided`, but for row 5, where the two happen to agree; so do the SDs that differed.
# 2. `population = 30`: many more off-basin runs. More than half of the means fall so far below the printed ones that
#    they differ.
# 3. `criteria = {"local_minima": 0.7}`: if 70 % of the runs had to succeed, the claim would fail.
#
# ## Exercises
#
# **1.** Which SD has uniform noise between $-a$ and $a$? Check it on the noise that was added to the record of level
# K = 5, R = 1.

# %% tags=["solution"]
a = 0.1 + (5 - 1) * 0.15 / 19
sd = np.sqrt(2 * a**3 / 3 / (2 * a))  # the integral of n^2 over the density 1/(2 a), which is a^2/3
assert np.isclose(sd, a / np.sqrt(3))
assert np.isclose(added["K = 5"].std(), sd, rtol=0.03)
print(f"{sd:.4f} rps")

# %% [markdown]
# **2.** Of 30 runs 29 end at the same $A$ and one at a distance $d$. Which SD do they have? How far off is the one run
# that would give the SD printed in row 10?

# %% tags=["solution"]
d = 0.3
assert np.isclose(np.std([1.0] * 29 + [1.0 - d], ddof=1), d / np.sqrt(30))
distance = regions["sd"].loc[10] * np.sqrt(30)
assert 0.1 < distance < 0.11
print(f"{distance:.3f} rps, {100 * distance / regions['mean'].loc[10]:.0f} % of the printed mean")

# %% [markdown]
# **3.** By which factor of $s$ does the predictive region extend to each side of the mean, for 2, 3, 5, and very many
# realisations? What is gained from two to five?

# %% tags=["solution"]
n = np.array([2, 3, 5, 100000])
factor = stats.t.ppf(0.975, n - 1) * np.sqrt(1 + 1 / n)
assert np.isclose(factor[-1], 1.96, atol=0.01)
assert factor[0] > 5 * factor[2]
print(dict(zip(n.tolist(), factor.round(2).tolist(), strict=True)))
