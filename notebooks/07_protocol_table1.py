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
#     quick: {repeats: 2, rows: [1, 9]}
# ---

# %% [markdown]
# # 7 · The search: Table 1's box and the protocol
#
# ## Claim
#
# The signature is fitted by CMA-ES inside the box of Table 1, on a record that begins at a sample drawn among its
# first 100, 30 times (sections "Stochastic optimization algorithm" and "Experimental evaluation"). Table 1 fixes
# $T_d$ = 0.204 s and $T_f$ = 0.408 s.
#
# ## Method
#
# The authors' notebook stores what their runs really did: the whole record, the box of $A$ widened by 1.3,
# $T_d$ = 0.2 s and $T_f$ = 0.4 s, a population of 300 and at most 200 generations. That is `Protocol()`; every
# variant is a line of `experiments.VARIANTS`. Each is run on the same ten noisy records (realisation R = 1) with
# the same seeds, and its means and SDs are laid beside the printed ones of Table 2.

# %%

from replication import datasets, inspection, published, table2, workbook
from replication.figures import paper

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
repeats = 3  # runs of each variant on each record
realisation = 1  # the authors' noise realisation R
rows = list(range(1, 11))  # rows of Table 2 whose records are fitted
variants = "all"  # or a list of names

# %% [markdown]
# ## Result
#
# ### Table 1, printed and as the program builds it
#
# The bounds of $A$, $t_0$ and $v_t$ depend on the record; they are given as fractions of its range.

# %%
clean = datasets.load_clean(12)
found_table1 = inspection.table1_cells(clean, table2.AUTHORS)
printed = published.cells("Table 1")[["row", "column", "printed", "unit", "value"]]
printed.assign(reproduced=found_table1)

# %% [markdown]
# ### The turn period in the data
#
# The turn period is where the record correlates best with itself, one turn later.

# %%
turn_period_s = inspection.turn_period(clean)
turn_period_s

# %% [markdown]
# ### The variants

# %%
seeds = range(1, repeats + 1)
chosen = [p for p in table2.VARIANTS if variants == "all" or p.name in variants]
records = [(key, record) for key, record in table2.authors_table2_records([realisation]) if key["row"] in rows]
runs = table2.repeated_fits(records, chosen, seeds, label="protocol variants")
scores = table2.variant_scores(runs)
workbook.save_table(scores, "protocol_variants")
ranking = table2.rank_variants(scores)
workbook.save_table(ranking, "protocol_ranking")
ranking

# %%
figure = paper.protocol_variants(scores)
workbook.save_figure(
    figure,
    "table2_protocols",
    caption="Variants of the protocol against Table 2: with the printed turn period every mean falls far short, "
    "a start drawn at random is worse than the whole record, and no variant follows the printed SDs.",
)

# %% [markdown]
# Read it so. The larger the population, the more runs end in the best basin, and the closer the means come to the
# printed ones. The SD over repeated runs is a lottery: it says how many runs left the best basin and how far out they
# ended. With the notebook's population of 300 a third of the runs or more do, and our SDs are several times the printed
# ones; with 1000 hardly any do, and our SDs fall below most printed ones, to what the window's gate leaves. The printed
# SDs (0.0009 to 0.0570 rps) are those of a search that almost always finds the best basin and strays now and then:
# that is neither what the text says nor what the authors' notebook does.
#
# A start sample drawn anew for each run, as the text says, makes many runs end in other basins and pulls the means far
# below the printed ones; drawn once for a record it does so on some records. The turn period of Table 1 fails outright.

# %% [markdown]
# ## Verdict

# %%
claims = {}
if variants == "all":
    error = ranking.set_index("protocol")["mean_abs_error_percent"]
    drawn, whole = error["start drawn per run"], error[table2.AUTHORS.name]
    claims["random_start"] = (bool(drawn <= whole), f"means {drawn:.1f} % off, with the whole record {whole:.1f} %")
cells = found_table1.to_dict() | {"text.latest_start": table2.AUTHORS.latest_start}
workbook.verdict({"authors": cells}, claims)

# %% [markdown]
# ## Try changing
#
# 1. `variants = ["authors' notebook", "T_d and T_f as printed"]`: two lines in the figure, and the second lies 30 %
#    and more below the printed means.
# 2. `realisation = 2`: another noise; the means of the authors' protocol move by a few percent, the SDs by factors.
# 3. `rows = [1, 5, 10]`: three records instead of ten, in a third of the time; the printed turn period stays the worst.
