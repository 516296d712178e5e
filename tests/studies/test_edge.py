import numpy as np
import pandas as pd

from replication.files import ROOT
from replication.joint import identified_joint, simulate
from studies import edge

JOINT = identified_joint()


def test_plain_fine_steps_give_the_speed_of_located_ones():
    plain = edge.plain_steps_speed(JOINT, 9e-4, 0.8, 1e-5)
    located = simulate(JOINT, 9e-4, 0.8, JOINT.period, 5e-5).v
    np.testing.assert_allclose(plain, located[: plain.size], atol=1e-3)


def test_coarser_plain_steps_are_compared_with_the_located_peak():
    study = edge.stepping_torque_study(JOINT, [9e-4], [1e-4, 5e-4])
    assert study["model"].tolist() == ["stepping"] * 2 + ["modified"] * 2
    assert study.loc[study["model"] == "modified", "error"].abs().max() < 0.01


def test_a_soft_edge_misses_the_records_even_when_the_joint_is_fitted_anew():
    nrmse = pd.read_csv(ROOT / "results" / "alpha_refit.csv", index_col="alpha")["nrmse"]
    assert 3 * nrmse[1e5] < nrmse[1e4] < nrmse[1e3]
