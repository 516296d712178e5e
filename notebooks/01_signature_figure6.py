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
# found. The authors' notebook stores 30 runs on their clean record 12, with parameters and final RMSE. Then the
# *search*: with the stored seeds it must go through the stored generations.

# %%
import numpy as np
import pandas as pd

from replication import datasets, published, workbook
from replication.figures import paper, searching
from replication.identify import paper_search
from replication.replay import inspection, replay
from replication.replay.bounds import turns_by_replay
from replication.search import search
from replication.signature import Timing, signature
from replication.table2 import AUTHORS, BASIN_GAP

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
run = 8  # which of the 30 stored runs to draw
turns = 2  # turns in figure 6
turn_period_s = 0.4  # T_f of the picture
criteria = {}  # limits to try in place of those of claims.csv, such as {"half_turn": 0.03}

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
# The same with sliders for $A$, $\tau$ and $\omega$, where the notebook is run by hand with `make lab`.


# %%
def draw(A_rps, tau_per_s, omega_rad_per_s):
    moved = np.array([A_rps, X[1], tau_per_s, omega_rad_per_s, *X[4:]])
    model = X[4] + signature(record.t, moved, Timing(stored["T_d_s"], stored["T_f_s"], 12))
    paper.record_with_fit(record.t, record.v, model, ("authors' record 12", "signature"), seconds=1.6)


workbook.sliders(draw, A_rps=(X[0], -2.0, 2.0), tau_per_s=(X[2], 5.0, 30.0), omega_rad_per_s=(X[3], 6.0, 260.0))

# %% [markdown]
# ### The test in two stages, on this run
#
# The model at the stored parameters, then the search with the stored seed: both must end at the stored misfit.

# %%
model_rmse = np.sqrt(np.mean((record.v - fitted) ** 2))  # equation 11 and the cost function after it
ran = search(paper_search(record, AUTHORS, int(stored["cma_seed"])), AUTHORS.iterations)
pd.Series(
    {
        "stored RMSE [rps]": stored["final_rmse_rps"],
        "model at the stored parameters": model_rmse,
        "search with the stored seed": ran.misfit,
        "its A [rps]": ran.best[0],
        "stored A [rps]": X[0],
    }
).to_frame("")

# %% [markdown]
# ### The 30 stored runs
#
# `rmse_rps` is the transcription at the stored parameters, to be compared with `stored_rmse_rps`. `first_today_rps` is
# the first generation as today's `cma` would make it under the stored seed, beside the stored one.

# %%
stored_runs = inspection.stored_runs(record)
workbook.save_table(stored_runs, "stored_runs")
stored_runs

# %%
misfit = (stored_runs["rmse_rps"] - stored_runs["stored_rmse_rps"]).abs()
today = (stored_runs["first_today_rps"] - stored_runs["stored_first_rps"]).abs()
pd.Series(
    {
        "largest |RMSE at stored parameters - stored RMSE| [rps]": misfit.max(),
        "first generations of today's cma equal to 1e-12": (today < 1e-12).sum(),
    }
).to_frame("")

# %% [markdown]
# ### The stored runs, replayed
#
# A search draws random numbers, so a run with the stored seed should be the stored run: every generation of it. It is,
# with the search written out in `search.py` (equations 12 to 17, notebook 7), which has what the authors' library had.
# Their notebook prints some 17 generations of each of the runs 1 to 20, to 16 digits, and the end of all 30.

# %%
generations = replay.replay_stored_runs(record)
to_16_digits = {name: generations[name].map("{:.15e}".format) for name in ("best_rmse_rps", "sigma")}
kept = generations[["run", "cma_seed", "generation", "best_rmse_rps", "sigma"]]
workbook.save_table(kept.assign(**to_16_digits), "replay")
compared, ended = replay.compare_generations(generations), replay.compare_ends(generations)
workbook.save_table(ended, "replay_ends")
figure = searching.replay(compared, ended, replay.AGREE_RPS)
workbook.save_figure(
    figure,
    "replay_differences",
    caption="The replayed runs against the stored ones: all printed generations agree within 1e-10 rps, but for "
    "three runs that part for a while and come back; one of the thirty, which is printed without generations, ends "
    "elsewhere.",
)

# %%
same = compared["difference_rps"] < replay.AGREE_RPS
pd.Series(
    {
        "printed generations": len(compared),
        "of them equal to 1e-9 rps": same.sum(),
        "largest difference up to generation 20 [rps]": compared.loc[
            compared["generation"] <= 20, "difference_rps"
        ].max(),
        "runs that end at the stored misfit, to 1e-9 rps": (ended["difference_rps"] < replay.AGREE_RPS).sum(),
        "runs that end in the very generation in which the stored ones end": (
            ended["our_generations"] == ended["stored_generations"]
        ).sum(),
    }
).to_frame("")

# %% [markdown]
# What parts the others: in the generation `undecided`, the sign of an eigenvector of $C$ hangs on its last bit. A
# change of $C$ by rounding turns it round in `flips` of 20 cases, and with it every sample along that axis. The ranks
# decide nothing: no two members next in rank are closer than `closest_ranks_rps`. From there on, the run is another
# one of the same distribution.

# %%
parted = replay.first_divergences(record, ended, np.random.default_rng(1))
workbook.save_table(parted, "replay_partings")
parted

# %% [markdown]
# Three things had to be right for this. The *bound handling*: samples are bent to a half-parabola in a margin at each
# bound, (1 + |bound|)/20 wide until `cma` 3.3 and max(1, |bound|)/20 since 3.4, which is why today's first generation
# agrees only for seeds whose best sample lies in no margin. The *constants*: the step size was damped otherwise until
# 3.2, and until 2.6 a very uneven $C$ was left as it is. And the *signs of eigenvectors*: LAPACK 3.10 changed the
# plane rotation they come from, so that the same library with a newer NumPy is another search from the second
# generation on; `compiled/eigen.py` keeps the older rotation, and the same last bits on every processor.
#
# ### The basins of the stored runs
#
# The 30 runs end in different basins; a mean over them hides that. Basin 0 has the lowest RMSE. `replayed_runs` are
# ours with the same seeds: the same basins, run by run, but for the one run that ends elsewhere.

# %%
basins = stored_runs.groupby("basin").agg(
    runs=("run", "size"),
    rmse_rps=("stored_rmse_rps", "min"),
    smallest_A_rps=("A_rps", lambda a: a.abs().min()),
    largest_A_rps=("A_rps", lambda a: a.abs().max()),
)
for misfit, name in zip(basins["rmse_rps"], basins.index, strict=True):
    basins.loc[name, "replayed_runs"] = (ended["ours_rps"] / misfit - 1).abs().lt(BASIN_GAP).sum()
basins = basins.astype({"replayed_runs": int})
workbook.save_table(basins.reset_index(), "stored_basins")
basins

# %% [markdown]
# ## Verdict
#
# Whether the search avoids local minima is decided on the noisy records of Table 2 (notebook 8), not on these 30 runs:
# record 12 has no noise, and its backlash is larger than any in the paper's tables.

# %%
mismatch = inspection.half_turn_mismatch(record)
claims = {
    "two_impacts": (
        published.decide("two_impacts", float(inspection.impacts_alternate(record)), criteria),
        "record 12: the largest excursion changes its sign from each settled half turn to the next",
    ),
    "half_turn": (
        published.decide("half_turn", mismatch, criteria),
        f"record 12, inverted and half a turn later, differs by {100 * mismatch:.1f} % of its SD",
    ),
}
replayed_turns = turns_by_replay(record)
cells = {
    "text.turns": replayed_turns.idxmax(),  # the fewest turns that give every stored misfit; the record ends after 12
    "text.commanded_speed": float(np.median(record.v)),
}
workbook.record_verdicts({"authors": cells}, claims)

# %% [markdown]
# ## Try changing
#
# 1. `run = 1`: a run in the basin with RMSE 0.159, the commonest of the 30. Its $t_0$ is stuck at 0 and its window
#    closes after 0.1 s: the second half of every oscillation is left standing in the residual.
# 2. `turn_period_s = 0.408`, the value that Table 1 prints: figure 6 barely changes; notebook 7 shows what it does
#    to a fit over twelve turns.
# 3. `turns = 3`: a third pair of oscillations in figure 6, one $T_f$ after the second.
