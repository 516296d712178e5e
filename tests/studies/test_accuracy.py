import pandas as pd
import pytest

import workbook
from replication.simulator.parameters import identified_joint
from replication.records import load_noisy
from studies.accuracy import cross_validation
from studies.benchmark import summarise_errors

SUPPLEMENT = workbook.ROOT / "results" / "supplement"


@pytest.fixture(scope="module")
def summary():
    return pd.read_csv(SUPPLEMENT / "features.csv").set_index("method")


@pytest.mark.slow
def test_the_committed_errors_are_what_the_authors_noisy_logs_give(authors_data, summary):
    records = {(R, K): load_noisy(K, R) for R in (1, 2) for K in range(2, 13)}
    found = cross_validation(records, identified_joint(), [7])
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
    calibrated = ["amplitude", "energy", "impact", "waveform", "waveform, noisy logs"]
    others = summary.loc[calibrated, "mean_abs_error_rad"]
    assert (others < summary["mean_abs_error_rad"]["equation 10"]).all()
