import numpy as np
import pandas as pd
import pytest

from replication import published
from studies.replay import replay
from workbook import ROOT

UNTIL = 20  # generation up to which no run may part
CONVERGED_RPS = 1e-11  # the search's own tolerance: closer to the end, the last bits of the misfits decide the ranks


@pytest.fixture(scope="module")
def ours(record_12):
    return replay.replay_stored_runs(record_12)


def test_every_stored_generation_up_to_the_twentieth_replays(ours):
    table = replay.compare_generations(ours)
    early = table[table["generation"] <= UNTIL]
    assert early["run"].nunique() == 20
    assert early["difference_rps"].max() < 1e-9


def test_until_a_run_has_converged_or_parts_every_printed_digit_replays(ours):
    digits = {"sigma": 3, "axis_ratio": 2, "smallest_std": 1, "largest_std": 1}
    ends = replay.compare_ends(ours).set_index("run")
    stored = published.table("authors_notebook_generations").merge(
        ours, on=["run", "generation"], suffixes=("_stored", "")
    )
    beyond = stored["best_rmse_of_generation_rps"] - stored["run"].map(ends["stored_rps"])
    open_still = (beyond > CONVERGED_RPS) & (
        stored["generation"] <= stored["run"].map(ends["agrees_until"])
    )
    assert open_still.sum() > 260
    for row in stored[open_still].to_dict("records"):
        for name, count in digits.items():
            printed = row[f"{name}_stored"]
            assert float(f"{row[name]:.{count}g}") == printed, (row["run"], row["generation"], name)


def test_most_runs_end_in_the_very_generation_in_which_the_stored_ones_end(ours):
    ends = replay.compare_ends(ours)
    assert (ends["our_generations"] == ends["stored_generations"]).sum() >= 23


def test_at_least_29_of_the_30_stored_runs_end_at_the_stored_misfit(ours):
    assert (replay.compare_ends(ours)["difference_rps"] < 1e-9).sum() >= 29


def test_runs_part_where_rounding_decides_the_sign_of_an_eigenvector_and_not_by_ranks(
    ours, record_12
):
    parted = replay.first_divergences(
        record_12, replay.compare_ends(ours), np.random.default_rng(1)
    )
    assert 1 <= len(parted) <= 6
    assert (parted["flips"] > 0).all()
    known = parted.dropna(subset="parts_by")
    assert (known["agrees_until"] < known["undecided"]).all()
    assert (known["undecided"] <= known["parts_by"]).all()
    assert (parted["closest_ranks_rps"] > 1e-12).all()


def test_the_committed_generations_are_those_that_the_search_gives(ours):
    committed = pd.read_csv(ROOT / "results" / "supplement" / "replay.csv")
    assert committed.columns.tolist() == ["run", "cma_seed", "generation", "best_rmse_rps", "sigma"]
    early = committed["generation"] <= UNTIL
    again = ours[ours["generation"] <= UNTIL].reset_index(drop=True)
    pd.testing.assert_frame_equal(
        committed[early].reset_index(drop=True),
        again[committed.columns],
        rtol=1e-8,
        check_exact=False,
    )


def test_a_difference_and_a_run_that_parts_are_seen(ours):
    changed = ours.copy()
    changed.loc[(changed["run"] == 2) & (changed["generation"] >= 44), "best_rmse_rps"] += 1e-6
    two = replay.compare_ends(changed).set_index("run").loc[2]
    assert (two["agrees_until"], two["parts_by"]) == (36, 44)
    assert two["difference_rps"] == pytest.approx(1e-6, rel=1e-3)
