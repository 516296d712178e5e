"""The 30 runs that the authors' notebook stores, run again with their seeds and compared generation by generation."""

import numpy as np
import pandas as pd

from replication import published
from replication.compiled.eigen import symmetric_eigen
from replication.datasets import Recording
from replication.identify import Protocol, paper_run, paper_search
from replication.search import HISTORY, Generation

AGREE_RPS = 1e-9  # misfits closer than this are the same generation of the same run
ROUNDINGS = 20  # times that a covariance matrix is rounded otherwise


def replay(recording: Recording, protocol: Protocol) -> pd.DataFrame:
    """Run the search with every stored seed.

    Parameters
    ----------
    recording : Recording
        The authors' clean record 12.
    protocol : Protocol
        Their settings.

    Returns
    -------
    DataFrame
        A row a generation of each run: `run, cma_seed, generation, best_rmse_rps, sigma, axis_ratio, smallest_std,
        largest_std`; the standard deviations are those of the next generation, in each parameter's own unit.
    """
    parts = []
    for run in published.authors_notebook_runs().to_dict("records"):
        history = paper_run(recording, protocol, run["cma_seed"]).history
        table = pd.DataFrame(history, columns=HISTORY).rename(columns={"best": "best_rmse_rps"})
        table = table.drop(columns=["median", "upper_quartile"])
        table.insert(0, "generation", np.arange(1, len(history) + 1))
        parts.append(table.assign(run=run["run"], cma_seed=run["cma_seed"]))
    table = pd.concat(parts, ignore_index=True)
    return table[["run", "cma_seed", *table.columns[:-2]]]


def differences(ours: pd.DataFrame) -> pd.DataFrame:
    """Compare the generations that the authors' notebook prints of runs 1 to 20.

    Parameters
    ----------
    ours : DataFrame
        From `replay`.

    Returns
    -------
    DataFrame
        A row a printed generation: `run, generation, stored_rps, ours_rps, difference_rps` (nan after our run's end).
    """
    stored = published.authors_notebook_generations()[["run", "generation", "best_rmse_of_generation_rps"]]
    stored = stored.rename(columns={"best_rmse_of_generation_rps": "stored_rps"})
    table = stored.merge(ours[["run", "generation", "best_rmse_rps"]], on=["run", "generation"], how="left")
    table = table.rename(columns={"best_rmse_rps": "ours_rps"})
    return table.assign(difference_rps=(table["ours_rps"] - table["stored_rps"]).abs())


def ends(ours: pd.DataFrame) -> pd.DataFrame:
    """Compare how the runs end.

    Parameters
    ----------
    ours : DataFrame
        From `replay`.

    Returns
    -------
    DataFrame
        A row a run: `run, cma_seed, stored_rps, ours_rps, difference_rps` (lowest misfits), `stored_generations,
        our_generations`, `agrees_until` and `parts_by` (the last printed generation of the part that agrees, and the
        first that does not: nan if there is none).
    """
    table = published.authors_notebook_runs()[["run", "cma_seed", "final_rmse_rps", "iterations"]]
    table = table.rename(columns={"final_rmse_rps": "stored_rps", "iterations": "stored_generations"})
    grouped = ours.groupby("run")
    table["ours_rps"] = grouped["best_rmse_rps"].min().to_numpy()
    table["difference_rps"] = (table["ours_rps"] - table["stored_rps"]).abs()
    table["our_generations"] = grouped.size().to_numpy()
    compared = differences(ours).dropna()
    for run, part in compared.groupby("run"):
        off = part[part["difference_rps"] > AGREE_RPS]
        agreeing = part[part["generation"] < off["generation"].min()] if len(off) else part
        table.loc[table["run"] == run, ["agrees_until", "parts_by"]] = (
            agreeing["generation"].max(),
            off["generation"].min(),
        )
    names = ["run", "cma_seed", "stored_rps", "ours_rps", "difference_rps", "stored_generations", "our_generations"]
    return table[[*names, "agrees_until", "parts_by"]]


def partings(recording: Recording, protocol: Protocol, ended: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Show what parts the runs that part: signs of eigenvectors that rounding decides, not ranks.

    Parameters
    ----------
    recording, protocol
        As for `replay`.
    ended : DataFrame
        From `ends`; the runs that part at a printed generation, or end elsewhere, are looked at.
    rng : numpy.random.Generator
        Draws how the covariance matrices are rounded.

    Returns
    -------
    DataFrame
        A row a run: `run, cma_seed, agrees_until, parts_by`, `undecided` (the first generation after `agrees_until`
        in which an eigenvector changes its sign when C changes by rounding), `flips` (in how many of `ROUNDINGS`
        cases), `closest_ranks_rps` (the smallest difference between the misfits of members next in rank until then).
    """
    parted = ended[ended["parts_by"].notna() | (ended["difference_rps"] > AGREE_RPS)]
    rows = []
    for run in parted.to_dict("records"):
        after, closest = np.nan_to_num(run["agrees_until"], nan=1), np.inf
        for now in paper_search(recording, protocol, run["cma_seed"]):
            flips = sign_flips(now, rng)
            if (flips and now.after.g > after) or now.after.g == run["our_generations"]:
                break
            closest = min(closest, np.diff(now.misfits[now.ranking]).min())
        row = {name: run[name] for name in ("run", "cma_seed", "agrees_until", "parts_by")}
        rows.append(row | {"undecided": now.after.g, "flips": flips, "closest_ranks_rps": closest})
    return pd.DataFrame(rows)


def sign_flips(now: Generation, rng: np.random.Generator) -> int:
    """In how many of `ROUNDINGS` cases a change of C by 2 units in the last place turns an eigenvector round."""
    C, B = now.before.C, now.before.B
    flips = 0
    for _ in range(ROUNDINGS):
        last_bits = np.tril(rng.integers(-2, 3, C.shape))
        otherwise = C * (1 + 2.0**-52 * (last_bits + np.tril(last_bits, -1).T))
        flips += bool(((symmetric_eigen(otherwise)[1] * B).sum(axis=0) < 0).any())
    return flips
