import numpy as np
import pandas as pd
import pytest

import workbook
from replication.authors import load_noisy
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings
from studies.accuracy import CHANGES, cross_validation, errors_after_changes
from studies.benchmark import JOINT_ALL_FREE, KnownLog, summarise_errors

SUPPLEMENT = workbook.ROOT / "results" / "supplement"


@pytest.fixture(scope="module")
def summary():
    return pd.read_csv(SUPPLEMENT / "features.csv").set_index("method")


@pytest.mark.slow
def test_the_committed_errors_are_what_the_authors_noisy_logs_give(authors_data, summary):
    records = {(R, K): load_noisy(K, R) for R in (1, 2) for K in range(2, 13)}
    found = cross_validation(records, identified_joint(), [7], smoothing_s=0.01)
    committed = pd.read_csv(SUPPLEMENT / "features_logs.csv")
    pd.testing.assert_frame_equal(
        found.reset_index(drop=True),
        committed[committed["level"] == 7].reset_index(drop=True),
        rtol=1e-4,
        atol=1e-8,
    )
    both = summarise_errors(committed).set_index("method")["mean_abs_error_rad"]
    pd.testing.assert_series_equal(both, summary["mean_abs_error_rad"], rtol=1e-5)


@pytest.mark.parametrize(("method", "target_rad"), [("energy", 1.5e-5), ("joint", 1e-5)])
def test_the_mean_error_on_the_authors_noisy_logs_is_within_its_target(summary, method, target_rad):
    assert summary["logs"][method] == 18
    assert summary["mean_abs_error_rad"][method] <= target_rad


def test_every_calibrated_feature_beats_equation_10_on_the_authors_noisy_logs(summary):
    others = summary["mean_abs_error_rad"].drop(["equation 10", "time in the gap"])
    assert (others < summary["mean_abs_error_rad"]["equation 10"]).all()


def test_nuisances_besides_the_start_angle_cost_next_to_nothing(summary):
    start, everything = summary["mean_abs_error_rad"][
        ["joint, start angle free", "joint, all nuisances free"]
    ]
    assert everything < 1.1 * start


def test_a_summary_has_the_mean_the_largest_and_the_root_mean_square():
    table = pd.DataFrame({"method": ["a", "a", "b"], "error_rad": [3.0, -4.0, 1.0]})
    found = summarise_errors(table).set_index("method")
    assert found.loc["a"].tolist() == [2, 3.5, 4.0, np.sqrt(12.5)]


@pytest.fixture(scope="module")
def moved():
    joint, delta_rad = identified_joint(), 11e-4
    changed = {name: change(joint, 0.2) for name, change in CHANGES.items()} | {"nothing": joint}
    logs = [
        KnownLog({"parameter": name}, delta_rad, simulate_recordings(other, [delta_rad])[0])
        for name, other in changed.items()
    ]
    return errors_after_changes(logs, joint).set_index(["parameter", "method"])["error_rad"]


@pytest.mark.slow
def test_every_change_moves_the_joint(moved):
    for name in CHANGES:
        assert moved[name, "waveform"] != moved["nothing", "waveform"], name


@pytest.mark.slow
def test_friction_ruins_the_half_turn_symmetry_and_only_the_joint_with_nuisances_survives_it(moved):
    friction = moved["load Coulomb friction"].abs()
    assert friction[JOINT_ALL_FREE] < 1e-6
    assert (friction.drop(JOINT_ALL_FREE) > 2e-4).all()


@pytest.mark.slow
def test_load_and_speed_do_not_matter_to_the_joint_with_nuisances(moved):
    assert abs(moved["load mass", JOINT_ALL_FREE]) < 1e-6
    assert abs(moved["commanded speed", JOINT_ALL_FREE]) < 1e-6


def test_the_committed_ranking_is_of_the_committed_errors_and_the_joint_with_nuisances_leads():
    ranked, ends = (
        pd.read_csv(SUPPLEMENT / f"{name}.csv") for name in ("robustness_ranking", "robustness")
    )
    assert ranked["rmse_rad"].is_monotonic_increasing
    assert ranked["method"][0] == JOINT_ALL_FREE
    assert (ends.loc[ends["parameter"].str.contains("friction"), "change"] > 0).all()
    largest = ends[ends["change"] != 0].groupby("method")["max_abs_error_rad"].max()
    assert largest[ranked["method"]].tolist() == ranked["max_abs_error_rad"].tolist()
