import numpy as np
import pandas as pd
import pytest

from backlash.studies.accuracy import CHANGES, cross_validation, errors_after_changes, ranking
from backlash.studies.benchmark import JOINT_ALL_FREE, summarise_errors
from replication import workbook
from replication.datasets import load_noisy
from replication.simulator.simulate import identified_joint

RESULTS = workbook.ROOT / "results"


@pytest.fixture(scope="module")
def summary():
    return pd.read_csv(RESULTS / "features.csv").set_index("method")


@pytest.mark.slow
def test_the_committed_errors_are_what_the_authors_noisy_logs_give(authors_data, summary):
    records = {(R, K): load_noisy(K, R) for R in (1, 2) for K in range(2, 13)}
    found = cross_validation(records, identified_joint(), [7])
    committed = pd.read_csv(RESULTS / "features_logs.csv")
    pd.testing.assert_frame_equal(
        found.reset_index(drop=True), committed[committed["level"] == 7].reset_index(drop=True), rtol=1e-4, atol=1e-8
    )
    both = summarise_errors(committed).set_index("method")["mean_abs_error_rad"]
    pd.testing.assert_series_equal(both, summary["mean_abs_error_rad"], rtol=1e-5)


@pytest.mark.parametrize(("method", "target_rad"), [("energy", 1.5e-5), ("joint", 1e-5)])
def test_the_mean_error_on_the_authors_noisy_logs_is_within_its_target(summary, method, target_rad):
    assert summary["logs"][method] == 18
    assert summary["mean_abs_error_rad"][method] <= target_rad


def test_every_feature_beats_equation_10_on_the_authors_noisy_logs(summary):
    others = summary["mean_abs_error_rad"].drop("equation 10")
    assert (others < summary["mean_abs_error_rad"]["equation 10"]).all()


def test_nuisances_besides_the_start_angle_cost_next_to_nothing(summary):
    start, everything = summary["mean_abs_error_rad"][["joint, start angle free", "joint, all nuisances free"]]
    assert everything < 1.1 * start


def test_a_summary_has_the_mean_the_largest_and_the_root_mean_square():
    table = pd.DataFrame({"method": ["a", "a", "b"], "error_rad": [3.0, -4.0, 1.0]})
    found = summarise_errors(table).set_index("method")
    assert found.loc["a"].tolist() == [2, 3.5, 4.0, np.sqrt(12.5)]


@pytest.fixture(scope="module")
def moved():
    return errors_after_changes(identified_joint(), [11e-4], [0.2])


@pytest.mark.slow
def test_every_change_moves_the_joint_and_friction_only_grows(moved):
    assert set(moved["parameter"]) == {*CHANGES, "nothing"}
    assert (moved.loc[moved["parameter"].str.contains("friction"), "change"] > 0).all()
    at = moved.set_index(["parameter", "change", "method"])["error_rad"]
    for name in CHANGES:
        assert at[name, 0.2, "waveform"] != at["nothing", 0.0, "waveform"], name


@pytest.mark.slow
def test_friction_ruins_the_half_turn_symmetry_and_only_the_joint_with_nuisances_survives_it(moved):
    friction = moved[moved["parameter"] == "load Coulomb friction"].set_index("method")["error_rad"].abs()
    assert friction[JOINT_ALL_FREE] < 1e-6
    assert (friction.drop(JOINT_ALL_FREE) > 2e-4).all()


@pytest.mark.slow
def test_load_and_speed_do_not_matter_to_the_joint_with_nuisances(moved):
    known = moved[moved["parameter"].isin(["load mass", "commanded speed"]) & (moved["method"] == JOINT_ALL_FREE)]
    assert known["error_rad"].abs().max() < 1e-6


@pytest.mark.slow
def test_the_ranking_s_first_has_the_least_error_over_all_changes(moved):
    table = ranking(moved)
    assert table["rmse_rad"].is_monotonic_increasing
    assert table["method"][0] == JOINT_ALL_FREE
