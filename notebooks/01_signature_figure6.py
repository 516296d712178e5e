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
# # 1 · The signature of backlash (figure 6)
#
# ## Claim
#
# A joint with backlash, driven at constant speed with its axis horizontal, is hit twice in every turn of the load,
# and each impact leaves a damped oscillation on the motor speed (section "Backlash signature and its mathematical
# model"). Equations 1 to 7 describe it with the parameters $X = [A, t_0, \tau, \omega, v_t, T_2, T_1]$ and the
# fixed $T_d = T_f/2$; figure 6 shows them.
#
# ## Method
#
# `signature.signature` is a direct transcription of equations 5 to 7. It is tested in two stages, as certified
# regression data sets are: here the *model* at parameters that somebody else found must give the misfit that they
# found. The authors' notebook stores 30 runs on their clean record 12, with parameters and final RMSE; whether a
# *search* finds them is another question (notebook 7). A third check needs no search at all: the lowest RMSE of a
# run's first generation depends only on the seed, the box and the order of the parameters.

# %%
import numpy as np
import pandas as pd

from replication import datasets, inspection, published, workbook
from replication.figures import paper
from replication.signature import Timing, signature

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
run = 8  # which of the 30 stored runs to draw
turns = 2  # turns in figure 6
turn_period_s = 0.4  # T_f of the picture
largest_mismatch = 0.05  # of half turns a turn's half apart, over the record's SD, for the claim to hold

# %% [markdown]
# ## Result
#
# ### Figure 6

# %%
stored = published.authors_notebook_runs().set_index("run").loc[run]
names = ["A_rps", "t0_s", "tau_per_s", "omega_rad_per_s", "c_rps", "window_end_s", "window_start_s"]
X = stored[names].to_numpy(float)
timing = Timing(T_d=turn_period_s / 2, T_f=turn_period_s, n=turns)
t = np.arange(0, turns * turn_period_s + 0.1, 1e-4)
T2, T1 = X[5], X[6]
figure = paper.signature_parameters(t, signature(t, X, timing), X[1], T1, T2, timing.T_d, timing.T_f)
workbook.save_figure(
    figure,
    "figure06_signature",
    caption="The signature of two turns at a stored run's parameters: two damped oscillations a turn, opposite "
    "in sign, each in its window from t_0 + T_1 to t_0 + T_2.",
)

# %% [markdown]
# ### The signature on a record
#
# The authors' clean record 12 (a backlash of 23e-4 rad) with the stored run drawn over it.

# %%
record = datasets.load_clean(12)
fitted = X[4] + signature(record.t, X, Timing(stored["T_d_s"], stored["T_f_s"], 12))
figure = paper.record_with_fit(record.t, record.v, fitted, ("authors' record 12", f"stored run {run}"), seconds=1.6)
workbook.save_figure(
    figure,
    "figure05_record12_with_signature",
    caption="The authors' record 12 and the signature that one of their stored runs fitted to it lie on each "
    "other; the residual peaks at the impacts, most at the start-up transient, which no signature has.",
)

# %% [markdown]
# ### The 30 stored runs
#
# `rmse_rps` is the transcription at the stored parameters, to be compared with `stored_rmse_rps`. `first_rps` is
# our first generation under the stored seed, with the bound transformation of `cma` before 3.4, and
# `first_cma4_rps` with that of later versions.

# %%
replay = inspection.replay_stored_runs(record)
workbook.save_table(replay, "stored_runs")
replay

# %%
first = (replay["first_rps"] - replay["stored_first_rps"]).abs()
first_cma4 = (replay["first_cma4_rps"] - replay["stored_first_rps"]).abs()
pd.Series(
    {
        "largest |RMSE at stored parameters - stored RMSE| [rps]": (replay["rmse_rps"] - replay["stored_rmse_rps"])
        .abs()
        .max(),
        "first generations equal to 1e-12, margins of cma before 3.4": (first < 1e-12).sum(),
        "first generations equal to 1e-12, margins of cma from 3.4 on": (first_cma4 < 1e-12).sum(),
    }
).to_frame("")

# %% [markdown]
# Why some first generations differ with a recent `cma`: its bound handling bends the last bit of the way to each
# bound, over a margin of (1 + |bound|)/20 in old versions and of max(1, |bound|)/20 since 3.4. Seeds whose best
# sample lies in no margin, or near a bound where the two agree (a bound of 0), do not notice. With the old margin
# all 30 seeds give their stored value. Later generations are compared as distributions only.
#
# ### The basins of the stored runs
#
# The 30 runs end in different basins; a mean over them hides that. Basin 0 has the lowest RMSE.

# %%
basins = replay.groupby("basin").agg(
    runs=("run", "size"),
    rmse_rps=("stored_rmse_rps", "min"),
    smallest_A_rps=("A_rps", lambda a: a.abs().min()),
    largest_A_rps=("A_rps", lambda a: a.abs().max()),
)
workbook.save_table(basins.reset_index(), "stored_basins")
basins

# %% [markdown]
# ## Verdict

# %%
best = int(basins.loc[0, "runs"])
mismatch = inspection.half_turn_mismatch(record)
claims = {
    "two_impacts": (
        inspection.impacts_alternate(record),
        "record 12: the largest excursion changes its sign from each settled half turn to the next",
    ),
    "half_turn": (
        mismatch < largest_mismatch,
        f"record 12, inverted and half a turn later, differs by {100 * mismatch:.1f} % of its SD",
    ),
    "local_minima": (best > len(replay) / 2, f"{best} of the authors' {len(replay)} stored runs end in the best basin"),
}
cells = {
    "text.turns": inspection.whole_turns(record),
    "text.commanded_speed": float(np.median(record.v)),
}
workbook.verdict({"authors": cells}, claims)

# %% [markdown]
# ## Try changing
#
# 1. `run = 1`: a run in the basin with RMSE 0.159, the commonest of the 30. Its $t_0$ is stuck at 0 and its window
#    closes after 0.1 s: the second half of every oscillation is left standing in the residual.
# 2. `turn_period_s = 0.408`, the value that Table 1 prints: figure 6 barely changes; notebook 7 shows what it does
#    to a fit over twelve turns.
# 3. `turns = 3`: a third pair of oscillations in figure 6, one $T_f$ after the second.
