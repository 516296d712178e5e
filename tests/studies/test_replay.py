import pytest

from studies import replay

UNTIL = 20  # generation up to which no run may part


@pytest.fixture(scope="module")
def ours(record_12):
    return replay.replay_stored_runs(record_12)


def test_every_stored_generation_up_to_the_twentieth_replays(ours):
    table = replay.compare_generations(ours)
    early = table[table["generation"] <= UNTIL]
    assert early["run"].nunique() == 20
    assert early["difference_rps"].max() < 1e-9


def test_at_least_29_of_the_30_stored_runs_end_at_the_stored_misfit(ours):
    assert (replay.compare_ends(ours)["difference_rps"] < replay.AGREE_RPS).sum() >= 29


def test_most_runs_end_in_the_very_generation_in_which_the_stored_ones_end(ours):
    ends = replay.compare_ends(ours)
    assert (ends["our_generations"] == ends["stored_generations"]).sum() >= 20


def test_a_run_that_ends_elsewhere_is_seen(ours):
    changed = ours.copy()
    changed.loc[changed["run"] == 2, "ours_rps"] += 1e-6
    two = replay.compare_ends(changed).set_index("run").loc[2]
    assert two["difference_rps"] == pytest.approx(1e-6, rel=1e-3)
