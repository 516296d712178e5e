import pytest

from studies import replay


@pytest.fixture(scope="module")
def ours(record_12):
    return replay.replay_stored_runs(record_12)


def test_every_stored_generation_up_to_the_twentieth_replays(ours):
    early = replay.compare_generations(ours).query("generation <= 20")
    assert early["run"].nunique() == 20
    assert early["difference_rps"].max() < 1e-9


def test_29_of_the_30_stored_runs_end_at_the_stored_misfit_most_in_the_very_generation(ours):
    ends = replay.compare_ends(ours)
    assert (ends["difference_rps"] < replay.AGREE_RPS).sum() >= 29
    assert (ends["our_generations"] == ends["stored_generations"]).sum() >= 20
    changed = ours.copy()
    changed.loc[changed["run"] == 2, "ours_rps"] += 1e-6
    two = replay.compare_ends(changed).set_index("run").loc[2]
    assert two["difference_rps"] == pytest.approx(1e-6, rel=1e-3)
