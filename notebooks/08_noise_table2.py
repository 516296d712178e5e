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
#     quick: {fresh: 1, public: [1]}
# ---

# %% [markdown]
# # 8 · Noise sensitivity (Table 2)
#
# *You will see what thirty runs on one noisy record say about $A$, and how a printed number is judged by the numbers
# that hundreds of other noises give. Run time: 3 min.*
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
# The paper calls $A_n$ the amplitude of the noise; $A_{min}$ and $\Delta A$ are not given. No values of them give the
# noise amplitudes that Table 2 prints (erratum E4). The public records have uniform noise between $-a_K$ and $a_K$,
# which is linear in the [level](glossary.md#level) K and not in $A$: $a_K = 0.1 + (K - 1) \cdot 0.15/19$ rps.
#
# **Realisations.** The authors published the clean records of K = 3 to 11, and five noisy
# [realisations](glossary.md#realisation) of each level. Which noise Table 2 was computed from is not said. But the law
# of the noise is known, so as many realisations can be made as are wanted: the clean record plus our uniform noise of
# the printed amplitude, and 30 runs with seeds of their own. Row 1's clean record (K = 2) is not public: the identified
# joint (notebook 3) takes its place. The last row is constant speed plus noise. The sign of $A$ is dropped, because
# $(A, t_0)$ and $(-A, t_0 \pm T_d)$ are the same signal; only pure noise keeps it.
#
# **Protocols.** Which settings printed Table 2 is not known either. [Notebook 17](beyond/17_protocols.ipynb) judges
# candidate protocols, each by its own realisations, which take an hour or more (`make studies NAME=protocols`) and
# are kept in `table2_realisations.csv`. Here a fresh sample of the leading candidate (rpm about the mean, Table 1's
# box, a population of 600) is made and compared with these numbers.
#
# **Region.** Of a candidate's $N$ means (or SDs) in a row, sorted, let $x_{(k)}$ be the $k$-th. One more realisation
# lies in the [predictive region](glossary.md#predictive-region)
#
# $$[x_{(k)},\; x_{(N + 1 - k)}] \quad\text{with the probability}\quad 1 - \frac{2k}{N + 1},$$
#
# whatever their law. $k$ is the largest that gives 95 %: 1 of 40, 5 of 200. Table 2 is one more realisation, if it was
# computed like this. A printed mean is reproduced if it lies in the region of every candidate that the other numbers of
# the table leave, and if these regions hold neither a neighbouring printed mean nor the theoretical $A$. It differs if
# it lies outside all of them. Too close to an end, where other noises would move it to the other side, it is undecided.
# The rules are at the head of `workbook/judging.py` and of `replication/replay/protocols.py`.
#
# **Best basin.** The [best basin](glossary.md#best-basin) holds the runs whose RMSE follows the lowest one without a
# gap above 0.2 %. The others, [off-basin runs](glossary.md#off-basin-run), end in local minima.

# %%
from dataclasses import fields, replace
from itertools import product

import numpy as np
import pandas as pd

import workbook
from replication import published, table2
from replication.authors import LOW_NOISE
from replication.figures import paper
from replication.identify import Protocol
from replication.parallel import in_parallel
from replication.replay import inspection, protocols
from replication.statistics import LEVEL, predictive_region, rate_columns
from workbook import Interval
from workbook.judging import compare_candidates, judge_cells

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
fresh = 12  # own realisations of each row with the leading candidate
noise_factor = 1.0  # multiplies their noise
public = [1, 2, 3, 4, 5]  # the authors' noise realisations R that it also runs on
settings = {}  # of the search, in place of the leading candidate's, such as {"population": 30}; see `identify.Protocol`
shown_row = 5  # of Table 2, whose runs are condensed cell by cell
criteria = {}  # limits to try instead of those of claims.csv, such as {"local_minima": 0.7}

# %% tags=["plumbing"]
workbook.check_parameters(
    fresh=(fresh, Interval(1, 1000, whole=True)),
    noise_factor=(noise_factor, Interval(0.01, 100)),
    public=(public, [tuple(LOW_NOISE)]),
    settings=(settings, [tuple(field.name for field in fields(Protocol))]),
    shown_row=(shown_row, range(1, 11)),
    criteria=(criteria, [("error_below_10", "local_minima")]),
)
workbook.check_parameters(
    population=(settings.get("population", 300), Interval(4, 10000, whole=True))
)
if not public or len(set(public)) < len(public):
    raise ValueError(f"public = {public!r}: at least one realisation is needed, and each only once")

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
leader = replace(protocols.CANDIDATES[protocols.LEADER], **settings)
of_authors = table2.authors_table2_records(public)
fits = table2.repeated_fits(of_authors, [leader], range(1, protocols.RUNS + 1), "public records")
shown = fits[(fits["row"] == shown_row) & (fits["realisation"] == public[0])]
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
# ### A fresh sample
#
# `protocols.realise` makes one realisation of a row: noise, thirty runs, their mean and SD. Are those made here of the
# same law as the kept ones? `same_law_p` takes the smallest p of Kolmogorov's and Smirnov's tests of the twenty means
# and SDs, times twenty. Below 1 % the kept numbers are not what this code gives, and they judge nothing here.

# %%
jobs = product([leader], protocols.ROWS, range(1, fresh + 1), [8], [noise_factor])
own = pd.DataFrame(in_parallel(protocols.realise, jobs, "own realisations"))
study = pd.read_csv(protocols.REALISATIONS)
kept = study[study["protocol"] == protocols.LEADER]
same_law = protocols.same_law_p(own, kept)
holds_here = same_law >= 0.01
print(
    f"p = {same_law:.2g}: the kept numbers are {'' if holds_here else 'not '}those of these settings and records."
)

# %% [markdown]
# ### Regions
#
# The region of each mean of $A$ [rps] from the realisations of the leading candidate, its half-width, and the printed
# numbers from which on a verdict by this candidate would be `differs`, as deviations from the printed one.

# %%
judges = protocols.judges_of_cells(study)
if not holds_here:
    judges = {
        f"table2.row{row:02d}.{of}": {leader.name: part[f"{of}_A_rps"].tolist()}
        for of, (row, part) in product(protocols.NUMBERS, own.groupby("row"))
    }
theoretical = published.column("Table 2", "theoretical")[:10]
regions = pd.DataFrame(index=pd.Index(protocols.ROWS, name="row"))
of_leader = protocols.numbers_of(study, protocols.LEADER)
for k, of in enumerate(protocols.NUMBERS):
    regions[of] = protocols.printed()[k]
    ends = np.array([predictive_region(numbers) for numbers in of_leader[k]])
    regions[[f"{of}_low", f"{of}_high"]] = ends
half_width = 100 * ((regions["mean_high"] / regions["mean_low"]) ** 0.5 - 1)
beside = regions[["mean_low", "mean_high"]].rename(
    columns={"mean_low": "region, low", "mean_high": "region, high"}
)
beside["half-width [%]"] = half_width
beside["printed"], beside["theoretical A"] = regions["mean"], theoretical
beside.round(4)

# %% [markdown]
# The SD of $A$ [rps] over the runs. It depends on which few runs leave the best basin, so its region is wide.

# %%
regions[["sd_low", "sd_high", "sd"]].map("{:.3g}".format)

# %%
table = table2.table2(fits)
table2_amplitudes = paper.table2(table, own, regions)

# %% [markdown]
# ### Coverage
#
# The five public realisations have the authors' noise, not ours. How many of their means and SDs lie in the regions?

# %%
there = regions.loc[table["row"]].reset_index(drop=True)
covered = {
    of: table[f"{of}_A_rps"].between(there[f"{of}_low"], there[f"{of}_high"])
    for of in protocols.NUMBERS
}
coverage = pd.DataFrame(
    {
        of: {"inside": inside.sum(), "of": inside.size}
        | rate_columns(int(inside.sum()), inside.size, "share")
        for of, inside in covered.items()
    }
).T
coverage.round(3)

# %% [markdown]
# ### Pooled bias
#
# The mean over ten rows of mean $A$ over theoretical $A$, less 1. Each realisation of the table gives one such number.
# Rank p of the printed table's, and of zero, among them.

# %%
kept_bias = protocols.pooled_bias(of_leader[0])
printed_bias = float(protocols.pooled_bias(regions["mean"].to_numpy()))
public_bias = [
    float(protocols.pooled_bias(part.sort_values("row")["mean_A_rps"].to_numpy()))
    for _, part in table.groupby("realisation")
]
bias_p = {
    name: protocols.rank_p(kept_bias, x) for name, x in (("printed", printed_bias), ("none", 0.0))
}
print(
    f"Printed {printed_bias:.1f} %; ours {np.median(kept_bias):.1f} % ({kept_bias.min():.1f} to "
    f"{kept_bias.max():.1f} %, {kept_bias.size} tables), on the public records {min(public_bias):.1f} to "
    f"{max(public_bias):.1f} %. p of the printed bias {bias_p['printed']:.2g}, of none {bias_p['none']:.2g}."
)

# %% [markdown]
# ### The best basin against the printed means
#
# In percent of the printed mean, for every public realisation; `worst` and `rms` are over the ten rows.

# %%
best = table.assign(error=table2.error_percent(table, "best_A_rps")).pivot(
    index="row", columns="realisation", values="error"
)
over_rows = pd.DataFrame({"worst": best.abs().max(), "rms": np.sqrt((best**2).mean())}).T
pd.concat([best, over_rows]).round(1)

# %% [markdown]
# ### Where the runs end
#
# How many of the runs on each record end in its best basin.

# %%
in_best_basin = table.pivot(index="row", columns="realisation", values="best_basin_runs")
in_best_basin

# %% [markdown]
# The record with the widest spread. Some basins are the same oscillation half a turn or more off, with nearly the same
# $A$: they hardly move the mean. Others, stuck at $t_0 = 0$ with a wrong frequency, do.

# %%
first = table[table["realisation"] == public[0]]
widest = int(first.loc[first["sd_A_rps"].idxmax(), "row"])
of_widest = fits[(fits["realisation"] == public[0]) & (fits["row"] == widest)]
labels = table2.basin_labels(of_widest["rmse_rps"].to_numpy())
table2_basins = paper.basins(
    of_widest, labels, f"row {widest} of Table 2, $R$ = {public[0]}, {protocols.RUNS} runs"
)

# %% [markdown]
# ### Other seeds
#
# The seeds are a choice. The realisations of the leading candidate fall into sets with noises and seeds of their own;
# each set takes the place of all. How many verdicts change?


# %%
def judged_with(realisations):
    """Verdicts on the means and SDs from some realisations of the leading candidate, and the others' all."""
    others = study[study["protocol"] != protocols.LEADER]
    chosen = kept[kept["realisation"].isin(realisations)]
    cells = protocols.judges_of_cells(pd.concat([chosen, others]))
    return judge_cells(
        {cell: of for cell, of in cells.items() if "row11" not in cell}, "authors"
    ).set_index("id")["verdict"]


size = 40
by_seeds = pd.DataFrame({"all": judged_with(kept["realisation"])})
for begin in range(1, int(kept["realisation"].max()) - size + 2, size):
    by_seeds[f"{begin} to {begin + size - 1}"] = judged_with(range(begin, begin + size))
changed = by_seeds[by_seeds.nunique(axis=1) > 1]
flips = ((by_seeds == "reproduced").any(axis=1) & (by_seeds == "differs").any(axis=1)).sum()
display(changed)
print(
    f"{len(changed)} of {len(by_seeds)} verdicts change in at least one of {by_seeds.shape[1] - 1} sets of {size}; "
    f"{flips} change between reproduced and differs."
)

# %% [markdown]
# ## Verdict
#
# Each cell is judged by every candidate that the other numbers of the table leave. Table 2 has twenty such cells in
# rows 1 to 10: by chance alone, one of twenty 95 % regions misses its number.

# %% tags=["plumbing"]
of_last_row = [*judges.get("table2.row11.mean", {leader.name: []})]
cells = judges | {f"table2.row{row:02d}.noise": value for row, value in enumerate(noise, start=1)}
if holds_here:
    cells["text.error_limit_percent"] = protocols.largest_errors(study, of_last_row)
claims = {
    "error_below_10": table2.decide_error_below_10(fits, criteria),
    "local_minima": table2.decide_local_minima(table, criteria),
}

# %%
verdicts = workbook.judge({"authors": cells}, claims)
of_table2 = verdicts[verdicts["id"].str.startswith("table2")]
parts = of_table2["id"].str.extract(r"row(?P<row>\d+)\.(?P<column>\w+)").astype({"row": int})
verdict_by_row = (
    of_table2.join(parts).pivot(index="row", columns="column", values="verdict").fillna("")
)
display(verdict_by_row)
display(verdicts[~verdicts["id"].str.startswith("table2")])

counted = {
    f"{of}_{word}": int((verdict_by_row.loc[regions.index, of] == word).sum())
    for of in protocols.NUMBERS
    for word in ("reproduced", "differs", "undecided")
}
inside = regions["mean"].between(regions["mean_low"], regions["mean_high"]).sum()
sds_inside = regions["sd"].between(regions["sd_low"], regions["sd_high"]).sum()
print(
    f"With the leading candidate {inside} of Table 2's {len(regions)} means and {sds_inside} SDs lie in the regions of "
    f"{kept['realisation'].nunique()} realisations (half-widths of the means' {half_width.min():.1f} to "
    f"{half_width.max():.0f} %). By all candidates that are left {counted['mean_reproduced']} means are reproduced, "
    f"{counted['mean_differs']} differ and {counted['mean_undecided']} are undecided; of the SDs "
    f"{counted['sd_reproduced']}, {counted['sd_differs']} and {counted['sd_undecided']}."
)


# %% tags=["plumbing"]
def from_to(numbers, digits=3):
    return f"{min(numbers):.{digits}f} to {max(numbers):.{digits}f}".replace("-", "−")


ranges = {}
for row, part in table.groupby("row"):
    ranges[str(row)] = {
        "means": from_to(part["mean_A_rps"]),
        "region": from_to(regions.loc[row, ["mean_low", "mean_high"]]),
        "best": from_to(part["best_A_rps"]),
        "sds": from_to(regions.loc[row, ["sd_low", "sd_high"]], 4),
        "in_best": int(part["best_basin_runs"].sum()),
        "runs": int(part["runs"].sum()),
    }
runs_of_means = {f"table2.row{row:02d}.mean": {} for row in regions.index}
for (row, R), part in fits.groupby(["row", "realisation"]):
    in_six_digits = [float(f"{A_rps:.6g}") for A_rps in part["A_rps"].abs()]
    runs_of_means[f"table2.row{row:02d}.mean"][str(R)] = in_six_digits
by_protocol = {
    cell: {name: compare_candidates(cell, {name: of})[0] for name, of in candidates.items()}
    for cell, candidates in judges.items()
}
facts = counted | {
    "level": (100 * LEVEL, ".0f"),
    "regions": 2 * len(regions),
    "regions_missed_by_chance": (2 * len(regions) * (1 - LEVEL), ".0f"),
    "means_inside": inside,
    "sds_inside": sds_inside,
    "theory_outside": (
        (theoretical < regions["mean_low"]) | (theoretical > regions["mean_high"])
    ).sum(),
    "region_half_low": (half_width.min(), ".1f"),
    "region_half_high": (half_width.max(), ".0f"),
    "leader": protocols.LEADER,
    "leader_realisations": kept["realisation"].nunique(),
    "fresh": fresh,
    "fresh_p": (same_law, ".2g"),
    "covered_means": int(coverage.loc["mean", "inside"]),
    "covered_sds": int(coverage.loc["sd", "inside"]),
    "covered_of": int(coverage.loc["mean", "of"]),
    "bias_printed": (printed_bias, ".1f"),
    "bias_ours": (np.median(kept_bias), ".1f"),
    "bias_each": (kept_bias, ".1f"),
    "bias_public": (public_bias, ".1f"),
    "bias_p": (bias_p["printed"], ".2g"),
    "bias_p_none": (bias_p["none"], ".2g"),
    "sd_printed": (regions["sd"], ".4f"),
    "seed_sets": by_seeds.shape[1] - 1,
    "seeds_flipped": len(changed),
    "seeds_reversed": flips,
    "runs": protocols.RUNS,
    "runs_all": len(fits) + protocols.RUNS * len(own),
    "realisations": len(public),
    "best_share": (100 * table["best_basin_runs"] / table["runs"], ".0f"),
    "best_worst": (over_rows.loc["worst"], ".1f"),
    "best_rms": (over_rows.loc["rms"], ".1f"),
    "last_sd": (published.value("table2.row11.sd") ** 0.5, ".3f"),
}
workbook.export(
    tables={"table2": table},
    supplement={
        "table2_runs": (fits, "Every run on the public noisy records of Table 2."),
        "table2_fresh": (own, "Own realisations of Table 2's rows with the leading candidate."),
        "table2_seeds": (
            by_seeds.reset_index(),
            "Verdicts on the means and SDs from sets of realisations with other seeds.",
        ),
    },
    pages={
        "report": {"runs": runs_of_means, "by_protocol": by_protocol},
        "article": {"table2": ranges},
    },
    facts=facts,
    figures={
        "table2_amplitudes": (
            table2_amplitudes,
            f"Table 2 under the leading candidate protocol ({protocols.LEADER}): (a) means and (b) SDs over "
            f"{protocols.RUNS} runs. Bands: 95 % regions from {kept['realisation'].nunique()} realisations of the "
            f"noise; circles: {len(public)} public realisations; dots: {fresh} of our own, which the bands do not "
            "count. A printed mean is decided only where the band holds neither the theoretical A nor a neighbouring "
            "printed mean.",
        ),
        "table2_basins": (
            table2_basins,
            f"Where the {protocols.RUNS} runs end on row {widest}, R = {public[0]}, the row of widest spread: "
            f"{(labels == 1).sum()} in the best basin. The area of a marker is in proportion to its number of runs. "
            "Runs at another amplitude make the SD.",
        ),
    },
    cells={"authors": cells},
    claims=claims,
)

# %% [markdown]
# ## Try changing
#
# 1. `settings = {"population": 30}`: the fresh sample is of another law than the kept numbers, so no region judges
#    here, and every mean and SD is undecided.
# 2. `fresh = 3`: three realisations of each row can hardly tell another law; the verdicts stay.
# 3. `criteria = {"local_minima": 0.95}`: if 95 % of the runs had to succeed, the claim would fail.
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
# **3.** How many realisations are needed before a 95 % region by order statistics exists at all? With which probability
# does one more lie between the smallest and the largest of 12?

# %% tags=["solution"]
enough = next(N for N in range(1, 100) if 1 - 2 / (N + 1) >= 0.95)
assert np.isfinite(predictive_region(range(enough))).all()
assert np.isinf(predictive_region(range(enough - 1))).all()
print(enough, round(1 - 2 / 13, 2))
