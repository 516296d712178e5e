"""The 30 runs that the authors' notebook stores, run again with their seeds and compared generation by generation."""

from base64 import b64encode
from itertools import islice

import numpy as np
import pandas as pd

from replication import published
from replication.compiled.eigen import symmetric_eigen
from replication.identify import paper_run, paper_search, protocol_box
from replication.recording import Recording
from replication.replay import AGREE_RPS
from replication.search import HISTORY, Generation
from replication.table2 import AUTHORS

ROUNDINGS = 20  # times that a covariance matrix is rounded otherwise


def replay_stored_runs(recording: Recording) -> pd.DataFrame:
    """Run the authors' search with every stored seed on their clean record 12; a row for each generation of a run.

    Columns `run, cma_seed, generation, best_rmse_rps, sigma, axis_ratio, smallest_std, largest_std`; the standard
    deviations are those of the next generation, in each parameter's own unit.
    """
    parts = []
    for run in published.authors_notebook_runs().to_dict("records"):
        history = paper_run(recording, AUTHORS, run["cma_seed"]).history
        table = pd.DataFrame(history, columns=HISTORY).drop(columns=["median", "upper_quartile"])
        head = {"run": run["run"], "cma_seed": run["cma_seed"], "generation": np.arange(1, len(history) + 1)}
        parts.append(pd.concat([pd.DataFrame(head), table.rename(columns={"best": "best_rmse_rps"})], axis=1))
    return pd.concat(parts, ignore_index=True)


def replay_frames(recording: Recording, ours: pd.DataFrame) -> pd.DataFrame:
    """Keep generations of `replay_stored_runs`: 1 to 30, every fifth after, those that the notebook prints, the last.

    The columns are `run, cma_seed, generation, frame`. A frame is base64 of the lowest misfit and sigma (f8), of the
    mean and standard deviations of the samples (f4, in widths of the box), of their axes B D (i1, in 1/127 standard
    deviation), and of a bit for each member, set in the better half. With the seed's random numbers it gives all
    samples.
    """
    stored, box, rows = published.authors_notebook_generations(), protocol_box(recording, AUTHORS), []
    width = box.upper - box.lower
    for (run, seed), part in ours.groupby(["run", "cma_seed"]):
        last, printed = len(part), stored.loc[stored["run"] == run, "generation"]
        kept = {*range(1, 31), *range(30, last, 5), *printed, last}
        generations = islice(paper_search(recording, AUTHORS, seed), last)
        for now in (each for each in generations if each.after.g in kept):
            state, better = now.before, np.isin(np.arange(AUTHORS.population), now.ranking[: AUTHORS.population // 2])
            shares = np.array([(state.m - box.lower) / width, state.std / width], "<f4")
            axes = np.rint(127 * state.B * state.D / np.sqrt(np.diag(state.C))[:, None]).astype("i1")
            parts = np.array([now.misfits.min(), state.sigma], "<f8"), shares, axes, np.packbits(better)
            rows.append((run, seed, now.after.g, b64encode(b"".join(each.tobytes() for each in parts)).decode()))
    return pd.DataFrame(rows, columns=["run", "cma_seed", "generation", "frame"])


def compare_generations(ours: pd.DataFrame) -> pd.DataFrame:
    """Compare the generations that the notebook prints of runs 1 to 20 with ours; nan after the end of our run."""
    stored = published.authors_notebook_generations()[["run", "generation", "best_rmse_of_generation_rps"]]
    stored = stored.rename(columns={"best_rmse_of_generation_rps": "stored_rps"})
    ours = ours[["run", "generation", "best_rmse_rps"]].rename(columns={"best_rmse_rps": "ours_rps"})
    table = stored.merge(ours, on=["run", "generation"], how="left")
    return table.assign(difference_rps=(table["ours_rps"] - table["stored_rps"]).abs())


def compare_ends(ours: pd.DataFrame) -> pd.DataFrame:
    """Compare how the stored runs end with how ours do, a row a run.

    `agrees_until` is the last printed generation of the part that agrees, `parts_by` the first that does not: nan if
    there is none.
    """
    stored, of_runs = published.authors_notebook_runs(), ours.groupby("run")["best_rmse_rps"]
    compared = compare_generations(ours).dropna()
    parts_by = compared[compared["difference_rps"] > AGREE_RPS].groupby("run")["generation"].min()
    agreeing = compared[compared["generation"] < compared["run"].map(parts_by).fillna(np.inf)]
    return pd.DataFrame(
        {
            "run": stored["run"],
            "cma_seed": stored["cma_seed"],
            "stored_rps": stored["final_rmse_rps"],
            "ours_rps": of_runs.min().to_numpy(),
            "difference_rps": (of_runs.min().to_numpy() - stored["final_rmse_rps"]).abs(),
            "stored_generations": stored["iterations"],
            "our_generations": of_runs.size().to_numpy(),
            "agrees_until": stored["run"].map(agreeing.groupby("run")["generation"].max()),
            "parts_by": stored["run"].map(parts_by),
        }
    )


def first_divergences(recording: Recording, ended: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Show what parts runs of `compare_ends` from the stored ones: signs that rounding decides, not ranks.

    In the generation `undecided`, the first after `agrees_until`, an eigenvector changes its sign when C changes by
    rounding, in `flips` of `ROUNDINGS` cases. `closest_ranks_rps` is the smallest difference between the misfits of
    members next in rank until then.
    """
    parted = ended[ended["parts_by"].notna() | (ended["difference_rps"] > AGREE_RPS)]
    rows = []
    for run in parted.to_dict("records"):
        after, closest = np.nan_to_num(run["agrees_until"], nan=1), np.inf
        for generation in paper_search(recording, AUTHORS, run["cma_seed"]):
            flips, g = count_sign_flips(generation, rng), generation.after.g
            if (flips and g > after) or g == run["our_generations"]:
                break
            closest = min(closest, np.diff(generation.misfits[generation.ranking]).min())
        row = {name: run[name] for name in ("run", "cma_seed", "agrees_until", "parts_by")}
        rows.append(row | {"undecided": g, "flips": flips, "closest_ranks_rps": closest})
    return pd.DataFrame(rows)


def count_sign_flips(generation: Generation, rng: np.random.Generator) -> int:
    """In how many of `ROUNDINGS` cases a change of C by 2 units in the last place turns an eigenvector round."""
    C, B = generation.before.C, generation.before.B
    flips = 0
    for _ in range(ROUNDINGS):
        last_bits = np.tril(rng.integers(-2, 3, C.shape))
        otherwise = C * (1 + 2.0**-52 * (last_bits + np.tril(last_bits, -1).T))
        flips += bool(((symmetric_eigen(otherwise)[1] * B).sum(axis=0) < 0).any())
    return flips
