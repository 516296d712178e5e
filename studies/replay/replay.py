"""The 30 runs that the authors' notebook stores, run again with their seeds and compared generation by generation."""

from base64 import b64encode
from collections.abc import Iterator
from itertools import islice

import numpy as np
import pandas as pd

from replication import published
from replication.bounds import margins_of
from replication.cmaes import Generation, generations, random_normals
from replication.records import Recording
from replication.signature import FREE_PARAMETERS, Box
from replication.stopping import HISTORY, search
from replication.table2 import AUTHORS_SETTINGS, BASIN_GAP, cost, search_box
from studies.replay import AGREE_RPS
from studies.replay.eigen import symmetric_eigen
from studies.replay.inspection import STORED_NAMES

ROUNDINGS = 20  # times that a covariance matrix is rounded otherwise


def authors_search(recording: Recording, seed: int) -> Iterator[Generation]:
    """The authors' search with a seed, with the eigenvectors' signs of its time."""
    return generations(
        cost(recording, AUTHORS_SETTINGS),
        search_box(recording, AUTHORS_SETTINGS),
        random_normals(seed),
        AUTHORS_SETTINGS.population,
        eigen=symmetric_eigen,
    )


def replay_stored_runs(recording: Recording) -> pd.DataFrame:
    """Run the authors' search with every stored seed on their clean record 12; a row for each generation of a run.

    Columns `run, cma_seed, generation, best_rmse_rps, sigma, axis_ratio, smallest_std,
    largest_std`; the standard deviations are those of the next generation, in each parameter's own
    unit.
    """
    parts = []
    for run in published.table("authors_notebook_runs").to_dict("records"):
        steps = authors_search(recording, run["cma_seed"])
        history = search(steps, AUTHORS_SETTINGS.iterations).history
        key = {"run": run["run"], "cma_seed": run["cma_seed"]}
        numbered = pd.DataFrame({"generation": range(1, len(history) + 1)} | key)
        parts.append(numbered.join(pd.DataFrame(history, columns=HISTORY)))
    columns = ["run", "cma_seed", "generation", "best_rmse_rps", *HISTORY[3:]]
    return pd.concat(parts, ignore_index=True).rename(columns={"best": "best_rmse_rps"})[columns]


def replay_frames(recording: Recording, ours: pd.DataFrame) -> pd.DataFrame:
    """Keep generations of `replay_stored_runs`: 1 to 30, every fifth after, those that the notebook prints, the last.

    The columns are `run, cma_seed, generation, frame`. A frame is base64 of the lowest misfit and
    sigma (f8), of the mean and standard deviations of the samples (f4, in widths of the box), of
    their axes B D (i1, in 1/127 standard deviation), and of a bit for each member, set in the
    better half. With the seed's random numbers it gives all samples.
    """
    stored = published.table("authors_notebook_generations")
    box = search_box(recording, AUTHORS_SETTINGS)
    rows = []
    for (run, seed), part in ours.groupby(["run", "cma_seed"]):
        last = len(part)
        printed = stored.loc[stored["run"] == run, "generation"]
        kept = {*range(1, 31), *range(30, last, 5), *printed, last}
        for now in islice(authors_search(recording, seed), last):
            if now.after.g in kept:
                rows.append((run, seed, now.after.g, b64encode(_frame(now, box)).decode()))
    return pd.DataFrame(rows, columns=["run", "cma_seed", "generation", "frame"])


def explorer_page(
    recording: Recording, ours: pd.DataFrame, stored: pd.DataFrame, basins: pd.DataFrame
) -> dict[str, object]:
    """What the replay explorer draws, from our runs, the stored ones with their basin, and the basins."""
    frames = replay_frames(recording, ours).groupby("run")[["generation", "frame"]].agg(list)
    printed = published.table("authors_notebook_generations")
    box = search_box(recording, AUTHORS_SETTINGS)
    low_margin, high_margin = margins_of(box) / (box.upper - box.lower)
    of_parameters = pd.DataFrame(vars(box)).assign(
        parameter=FREE_PARAMETERS,
        column=STORED_NAMES,
        low_margin=low_margin,
        high_margin=high_margin,
    )
    settings = {"gap": BASIN_GAP, "agree": AGREE_RPS, "members": AUTHORS_SETTINGS.population}
    return {
        "runs": stored.merge(frames, on="run").to_dict("records"),
        "printed": printed[["run", "generation", "best_rmse_of_generation_rps"]]
        .to_numpy()
        .tolist(),
        "box": of_parameters.to_dict("records"),
        "basins": basins["rmse_rps"].tolist(),
        "settings": settings,
    }


def _frame(now: Generation, box: Box) -> bytes:
    """One generation as `replay_frames` keeps it."""
    state = now.before
    width = box.upper - box.lower
    misfit_and_sigma = np.array([now.misfits.min(), state.sigma], "<f8")
    shares = np.array([(state.m - box.lower) / width, state.std / width], "<f4")
    axes = np.rint(127 * state.B * state.D / np.sqrt(np.diag(state.C))[:, None]).astype("i1")
    size = now.ranking.size
    better = np.packbits(np.isin(np.arange(size), now.ranking[: size // 2]))
    return b"".join(part.tobytes() for part in (misfit_and_sigma, shares, axes, better))


def compare_generations(ours: pd.DataFrame) -> pd.DataFrame:
    """Compare the generations that the notebook prints with ours; nan after the end of our run."""
    key = ["run", "generation"]
    stored = published.table("authors_notebook_generations").rename(
        columns={"best_rmse_of_generation_rps": "stored_rps"}
    )
    ours = ours.rename(columns={"best_rmse_rps": "ours_rps"})
    table = stored[[*key, "stored_rps"]].merge(ours[[*key, "ours_rps"]], on=key, how="left")
    return table.assign(difference_rps=(table["ours_rps"] - table["stored_rps"]).abs())


def compare_ends(ours: pd.DataFrame) -> pd.DataFrame:
    """Compare how the stored runs end with how ours do, a row a run.

    `agrees_until` is the last printed generation of the part that agrees, `parts_by` the first that
    does not: nan if there is none.
    """
    stored = published.table("authors_notebook_runs")
    of_runs = ours.groupby("run")["best_rmse_rps"]
    end_rps = of_runs.min().to_numpy()
    compared = compare_generations(ours).dropna()
    parts_by = compared[compared["difference_rps"] > AGREE_RPS].groupby("run")["generation"].min()
    agreeing = compared[compared["generation"] < compared["run"].map(parts_by).fillna(np.inf)]
    return stored[["run", "cma_seed"]].assign(
        stored_rps=stored["final_rmse_rps"],
        ours_rps=end_rps,
        difference_rps=(end_rps - stored["final_rmse_rps"]).abs(),
        stored_generations=stored["iterations"],
        our_generations=of_runs.size().to_numpy(),
        agrees_until=stored["run"].map(agreeing.groupby("run")["generation"].max()),
        parts_by=stored["run"].map(parts_by),
    )


def first_divergences(
    recording: Recording, ended: pd.DataFrame, rng: np.random.Generator
) -> pd.DataFrame:
    """Show what parts runs of `compare_ends` from the stored ones: signs that rounding decides, not ranks.

    In the generation `undecided`, the first after `agrees_until`, an eigenvector changes its sign
    when C changes by rounding, in `flips` of `ROUNDINGS` cases. `closest_ranks_rps` is the smallest
    difference between the misfits of members next in rank until then.
    """
    parted = ended[ended["parts_by"].notna() | (ended["difference_rps"] > AGREE_RPS)]
    rows = []
    for run in parted.to_dict("records"):
        after, closest = np.nan_to_num(run["agrees_until"], nan=1), np.inf
        for generation in authors_search(recording, run["cma_seed"]):
            flips = count_sign_flips(generation, rng)
            g = generation.after.g
            if (flips and g > after) or g == run["our_generations"]:
                break
            closest = min(closest, np.diff(generation.misfits[generation.ranking]).min())
        row = {name: run[name] for name in ("run", "cma_seed", "agrees_until", "parts_by")}
        rows.append(row | {"undecided": g, "flips": flips, "closest_ranks_rps": closest})
    return pd.DataFrame(rows)


def count_sign_flips(generation: Generation, rng: np.random.Generator) -> int:
    """In how many of `ROUNDINGS` cases a change of C by 2 units in the last place turns an eigenvector round."""
    before = generation.before
    flips = 0
    for _ in range(ROUNDINGS):
        last_bits = np.tril(rng.integers(-2, 3, before.C.shape))
        rounding = 2.0**-52 * (last_bits + np.tril(last_bits, -1).T)
        _, vectors = symmetric_eigen(before.C * (1 + rounding))
        flips += bool(((vectors * before.B).sum(axis=0) < 0).any())
    return flips
