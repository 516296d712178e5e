"""The 30 runs that the authors' notebook stores, run again with their seeds and compared generation by generation."""

from itertools import islice, tee

from pandas import DataFrame

from replication import cmaes, misfit, published
from replication.records import Recording
from replication.table2 import NOTEBOOK, search_box
from studies.eigen import symmetric_eigen

# Misfits closer than this are the same generation of the same run: far above rounding.
AGREE_RPS = 1e-9


def replay_stored_runs(recording: Recording) -> DataFrame:
    """Run the authors' search with every stored seed on their clean record 12, with the eigensolver of 2021.

    Returns
    -------
    DataFrame
        A row for each generation of a run: `run, generation, ours_rps` (the lowest misfit).
    """
    misfits = misfit.cost(recording.t, recording.v, NOTEBOOK.timing)
    box = search_box(recording, NOTEBOOK)
    rows: list[tuple[int, int, float]] = []
    for run, seed in published.table("authors_notebook_runs")[["run", "cma_seed"]].to_numpy():
        steps = cmaes.generations(misfits, box, int(seed), NOTEBOOK.population, symmetric_eigen)
        watched, steps = tee(steps)
        last = cmaes.search(steps, NOTEBOOK.iterations).generations
        rows += [(run, each.state.g + 1, each.misfits.min()) for each in islice(watched, last)]
    return DataFrame(rows, columns=["run", "generation", "ours_rps"])


def compare_generations(ours: DataFrame) -> DataFrame:
    """Compare the generations that the notebook prints with ours; nan after the end of our run."""
    names = {"best_rmse_of_generation_rps": "stored_rps"}
    stored = published.table("authors_notebook_generations").rename(columns=names)
    key = ["run", "generation"]
    table = stored[[*key, "stored_rps"]].merge(ours, on=key, how="left")
    return table.assign(difference_rps=(table["ours_rps"] - table["stored_rps"]).abs())


def compare_ends(ours: DataFrame) -> DataFrame:
    """Compare how the stored runs end with how ours do, a row a run."""
    stored = published.table("authors_notebook_runs").set_index("run")
    of_runs = ours.groupby("run")["ours_rps"]
    table = DataFrame({"stored_rps": stored["final_rmse_rps"], "ours_rps": of_runs.min()})
    table["difference_rps"] = (table["ours_rps"] - table["stored_rps"]).abs()
    table["stored_generations"] = stored["iterations"]
    return table.assign(our_generations=of_runs.size()).reset_index()
