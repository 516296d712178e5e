import numpy as np
import pandas as pd
import pytest

from replication.files import ROOT
from replication.joint import from_ratios, identified_joint, ratios, simulate
from replication.records import load_clean_records
from studies import edge
from studies.identification import FIT_LEVELS, errors_in_turn

JOINT = identified_joint()


def test_plain_fine_steps_give_the_speed_of_located_ones():
    plain = edge.plain_steps_speed(JOINT, 9e-4, 0.8, 1e-5)
    located = simulate(JOINT, 9e-4, 0.8, JOINT.period, 5e-5).v
    np.testing.assert_allclose(plain, located[: plain.size], atol=1e-3)


def test_coarser_plain_steps_are_compared_with_the_located_peak():
    study = edge.stepping_torque_study(JOINT, [9e-4], [1e-4, 5e-4])
    assert study["model"].tolist() == ["stepping"] * 2 + ["modified"] * 2
    assert study.loc[study["model"] == "modified", "error"].abs().max() < 0.01


def test_a_soft_edge_misses_the_records_even_when_the_joint_is_fitted_anew(authors_data):
    table = pd.read_csv(ROOT / "results" / "alpha_refit.csv", index_col="alpha")
    sharp, soft, softest = table.loc[[1e5, 1e4, 1e3], "nrmse"]
    assert 3 * sharp < soft < softest
    records = load_clean_records(FIT_LEVELS)
    for alpha, row in table.iterrows():
        joint = from_ratios(dict(row[[*ratios(JOINT)]]), alpha=alpha)
        errors = np.concatenate(errors_in_turn(joint, records, 3))
        assert np.sqrt(np.mean(errors**2)) == pytest.approx(row["nrmse"], rel=1e-2)
