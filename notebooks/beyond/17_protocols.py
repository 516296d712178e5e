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
#     quick: {}
# ---

# %% [markdown]
# # 17 · Which protocol printed Table 2?
#
# *You will see how a published table is tested against candidate protocols when its noise is unknown. Run time: 5 s.*
#
# ## Claim
#
# Table 2's means and SDs are those of 30 [runs](../glossary.md#run) of "the proposed approach" on one record, whose
# analysis begins at a random one of the first 100 samples (sections "Experimental evaluation" and "Testing noise
# sensitivity on simulated data"). The paper does not give the settings of the search. The authors' notebook says that
# it was changed after the paper: population, iterations, the box of $A$ and the unit.
#
# ## Method
#
# The candidates are twelve protocols that could exist before 2022. They differ in the population, the start of the
# record, the box of $A$, the unit (rpm about the mean: $60\,(v - \bar v)$) and the turn period. One is a line of the
# authors' notebook that is switched off: population 2000, a fixed [gate](../glossary.md#gate) from 0 to 0.218 s,
# $T_d$ = 0.204 s, no bounds. The line does not say $T_f$; we take $2 T_d$ = 0.408 s, as Table 1 has it. A turn of the
# data lasts 0.400 s, so the line is also run with $T_d$ = 0.2 s and $T_f$ = 0.4 s.
#
# The noise of the printed table is unknown, so each candidate is run on the authors' $n = 5$ low-noise
# [realisations](../glossary.md#realisation). Let $x_\text{printed}$ [rps] be the printed mean (or SD) of $|A|$ in a
# row, and $m$ and $s$ the mean and SD of the logarithms of the candidate's $n$ numbers. Then
#
# $$t = \frac{\ln x_\text{printed} - m}{s\sqrt{1 + 1/n}}$$
#
# has Student's distribution with $n - 1$ degrees of freedom if the printed table is one more realisation of the
# candidate. Fisher's method makes one $p$ of the ten rows' means, another of their SDs; the candidate's $p$ is twice
# the smaller one. The candidate explains the table if $p \geq 0.05$. This criterion was fixed before any of these
# numbers was computed. No correction is made for the number of candidates.

# %%
import numpy as np
import pandas as pd
from scipy import stats

import workbook
from replication import published
from replication.authors import LOW_NOISE
from replication.figures import paper
from replication.replay import protocols

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
shown = "authors' notebook"  # the candidate whose rows are shown one by one
left_out = []  # realisations to leave out of the five
criteria = {}  # a level to try instead of that of claims.csv, such as {"random_start": 0.001}

# %% tags=["plumbing"]
workbook.check_parameters(
    shown=(shown, protocols.CANDIDATES),
    left_out=(left_out, [tuple(LOW_NOISE)]),
    criteria=(criteria, [{"random_start"}]),
)
if len({*left_out}) > len(LOW_NOISE) - 2:
    raise ValueError(f"left_out = {left_out}: at least two of the five realisations are needed")

# %% [markdown]
# ## Result
#
# ### The candidates
#
# The runs take some 20 minutes (`make studies NAME=protocols`), so means and SDs of $|A|$ are read from
# `protocol_runs.csv`. `judge` computes every candidate's $p$; the largest stands first. The columns "outside" count
# the printed numbers outside their 95 % interval. The last column is the share of runs in the [best
# basin](../glossary.md#best-basin).

# %%
level = published.criterion(
    "random_start", criteria
)  # a candidate with a smaller p does not explain the table
used = pd.read_csv(protocols.PROTOCOL_RUNS).query("realisation not in @left_out")
judged = protocols.judge(used, level)
columns = {
    **{
        "population": "population",
        "start": "start",
        "amplitude_factor": "box of A over Table 1's",
        "T_d_s": "T_d [s]",
    },
    **{
        "T_f_s": "T_f [s]",
        "rpm": "in rpm",
        "bounds": "bounds",
        "runs": "runs",
        "p_means": "p of means",
    },
    **{"p_sds": "p of SDs", "p": "p", "explains": "explains", "means_outside": "means outside"},
    **{"sds_outside": "SDs outside", "best_basin_share": "share in the best basin"},
}
shown_table = judged.set_index("protocol")[[*columns]].rename(columns=columns)
shown_table.map(lambda value: f"{value:.3g}" if isinstance(value, float) else value)

# %%
table = protocols.residuals(used)
residuals = paper.protocol_residuals(
    table, judged, level, degrees=used["realisation"].nunique() - 1
)

# %% [markdown]
# ### One candidate, row by row

# %%
rows = table[table["protocol"] == shown].pivot(index="row", columns="column", values=["t", "p"])
rows.round(3)

# %% [markdown]
# ### Calibration of the test
#
# Each realisation in turn takes the place of the printed table and is judged by the others. The logarithm of an SD is
# not normal: an SD is either that of one [basin](../glossary.md#basin) (some 0.002 rps) or, with one
# [off-basin run](../glossary.md#off-basin-run), ten times as large or more. So the SDs' $p$ rejects more often than it
# says.

# %%
tests = len(judged) * used["realisation"].nunique()
rejected = judged[["left_out_means_rejected", "left_out_sds_rejected"]].sum() / tests
rejected.set_axis(["means", "SDs"]).rename(
    "share of realisations rejected at 5 %"
).to_frame().round(3)

# %% [markdown]
# ## Verdict
#
# A $p$ near the level decides little: other seeds move it. With a population of 2000 there are 10 runs, in which
# off-basin runs are rarer than in the 30 of the printed table, and of the switched-off line there are 3, as one takes
# 20 times as long as a run of the notebook: enough for their means, not for their SDs.

# %%
claims = {"random_start": protocols.random_start(judged, criteria)}
display(workbook.judge(claims=claims))
explaining = judged[judged["explains"]]
named = ", ".join(
    f"{name} (p = {p:.2g})" for name, p in zip(explaining["protocol"], explaining["p"], strict=True)
)
drawn = (explaining["start"] != "whole").sum()
print(
    f"At the level {level:g}, {len(explaining)} of {len(judged)} candidates are compatible with Table 2: "
    f"{named or 'none'}. Of these, {drawn} analyse the record from a random start. "
    f"The closest of the others has p = {judged.loc[~judged['explains'], 'p'].max():.2g}; no correction is made for "
    "the number of candidates."
    + " The table cannot tell the compatible ones apart."
    * (len(explaining) > 1)
)

# %% tags=["plumbing"]
best = judged.loc[judged["p"].idxmax()]
workbook.export(
    supplement={"protocols": (judged, "Every candidate protocol with its p.")},
    facts={
        "protocol_finding": protocols.describe_candidates(judged),
        "p_criterion": (level, ".2g"),
        "notebook_p": (judged.set_index("protocol").loc["authors' notebook", "p"], ".2g"),
        "best_protocol": best["protocol"],
        "best_protocol_sds": best["sds_outside"],
    },
    figures={
        "protocols_residuals": (
            residuals,
            "Deviation t of Table 2's ten printed means (a) and ten SDs (b) from the mean of "
            f"{used['realisation'].nunique()} realisations, for {len(judged)} candidates. Points in the grey band lie "
            "inside the 95 % interval; p is that of all ten. Candidates below the dashed line are rejected: one of "
            f"their two p lies below {level / 2:g}.",
        )
    },
    claims=claims,
)

# %% [markdown]
# ## Try changing
#
# 1. `shown = "switched-off line, T_d = 0.2 s"`: every printed mean lies above this line's, most outside the 95 %.
# 2. `criteria = {"random_start": 0.001}`: the authors' notebook and a population of 1000 then explain the table too.
# 3. `left_out = [1, 2]`: three noises leave wider intervals; the same two candidates are no longer rejected.
#
# ## Exercises
#
# **1.** The interval of one more realisation is $m \pm t_{0.975}(n - 1)\, s \sqrt{1 + 1/n}$. How much narrower would it
# be, in units of $s$, with infinitely many realisations in place of five?

# %% tags=["solution"]
half_width_5 = stats.t.ppf(0.975, 4) * np.sqrt(1 + 1 / 5)
half_width_many = stats.norm.ppf(0.975)
assert 1.5 < half_width_5 / half_width_many < 1.6
print(
    f"{half_width_5:.2f} s against {half_width_many:.2f} s: by a factor {half_width_5 / half_width_many:.2f}"
)

# %% [markdown]
# **2.** Fisher's method adds $-2 \ln p$ over the rows, which has a $\chi^2$ distribution with two degrees of freedom a
# row. Ten rows have $p$ = 0.2 each. Is the table rejected at 5 %?

# %% tags=["solution"]
fisher_p = stats.chi2.sf(-2 * 10 * np.log(0.2), 2 * 10)
assert np.isclose(fisher_p, stats.combine_pvalues([0.2] * 10, "fisher").pvalue)
assert fisher_p < 0.05
print(f"yes: p = {fisher_p:.3f}, although no row is rejected by itself")

# %% [markdown]
# **3.** Twelve right candidates are tested at 5 % each. How probable is it that at least one is rejected? Which
# candidates explain the table if the level is divided by twelve (Bonferroni)?

# %% tags=["solution"]
one_rejected = 1 - 0.95 ** len(judged)
corrected = set(judged.loc[judged["p"] >= 0.05 / len(judged), "protocol"])
assert np.isclose(one_rejected, stats.binom.sf(0, len(judged), 0.05))
assert corrected >= set(judged.loc[judged["p"] >= 0.05, "protocol"])
print(f"{one_rejected:.2f}; {', '.join(sorted(corrected))}")
