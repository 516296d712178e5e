from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import workbook
from replication.simulator.identification import third_turn_errors
from replication.simulator.parameters import identified_joint, with_ratios
from replication.simulator.simulate import simulate
from replication.records import load_clean_records
from studies import edge
from studies.reidentify import FIT_LEVELS


def test_plain_fine_steps_give_the_speed_of_located_ones():
    joint = identified_joint()
    plain = edge.plain_steps_speed_rps(joint, 9e-4, 0.8, 1e-5)
    located = simulate(
        joint, 9e-4, duration_s=0.8, sample_s=joint.control_period_s, step_s=5e-5
    ).motor_speed_rps
    np.testing.assert_allclose(plain, located[: plain.size], atol=1e-3)


def test_a_joint_that_runs_away_gives_no_speed():
    joint = identified_joint()
    wild = replace(joint, speed_gain_nms_per_rad=-50 * joint.speed_gain_nms_per_rad)
    assert np.isnan(edge.plain_steps_speed_rps(wild, 9e-4, 0.8, 1e-4)).all()


def test_coarser_plain_steps_are_compared_with_the_located_peak():
    study = edge.stepping_torque_study(identified_joint(), [9e-4], [1e-4, 5e-4])
    assert study["model"].tolist() == ["stepping"] * 2 + ["modified"] * 2
    assert study["reference_rps"].between(0.4, 0.8).all()
    assert study.loc[study["model"] == "modified", "error"].abs().max() < 0.01


@pytest.fixture(scope="module")
def refits():
    """What the joint's refits at soft edges gave, by alpha."""
    path = workbook.ROOT / "results" / "alpha_refit.csv"
    return pd.read_csv(path).set_index("alpha_per_rad", drop=False)


def refitted(row):
    joint = replace(identified_joint(), alpha_per_rad=row["alpha_per_rad"])
    return with_ratios(joint, {name: row[name] for name in joint.ratios})


def third_turn_nrmse(joint):
    return np.sqrt(np.mean(third_turn_errors(joint, load_clean_records(FIT_LEVELS)) ** 2))


def test_a_soft_edge_misses_the_records_even_when_the_joint_is_fitted_anew(authors_data, refits):
    misfit = refits["nrmse"]
    assert misfit[1e4] > 3 * misfit[1e5]
    assert misfit[1e3] > misfit[1e4]
    assert (misfit <= refits["nrmse_kept"] * (1 + 1e-6)).all()
    for row in refits.to_dict("records"):
        assert third_turn_nrmse(refitted(row)) == pytest.approx(row["nrmse"], rel=1e-2)


def test_the_refit_at_a_soft_edge_is_a_minimum_in_every_ratio(authors_data, refits):
    best = refitted(refits.loc[1e4])
    for name, value in best.ratios.items():
        if name == "lead_s":
            continue
        for factor in (0.98, 1.02):
            moved = third_turn_nrmse(with_ratios(best, {name: factor * value}))
            assert moved > refits.loc[1e4, "nrmse"] * (1 - 1e-3), name
