"""Joints are drawn as said, their logs come from encoders, and Tables 3 and 4 are made of such logs."""

import numpy as np
import pandas as pd
import pytest

from replication.files import ROOT
from replication.joint import Wave, change, identified_joint, simulate
from replication.signature import TURN
from studies import standins

DELTA = 10e-4
JOINT = identified_joint()


def test_tables_3_and_4_are_made_as_they_are_kept_but_for_the_number_of_runs():
    """All spreads are assumptions; a log's SD shows them."""
    rng = np.random.default_rng(1)
    robots = [standins.draw_robot(rng, kind) for kind in standins.ROBOTS]
    logs = [standins.encoder_log(*robot, np.random.default_rng(1)) for robot in robots]
    np.testing.assert_allclose([log.v.std() for log in logs], [0.07528228, 0.12125027], rtol=1e-5)
    stand_in = standins.draw_bench(np.random.default_rng(1))
    tables = standins.table3(stand_in, [9e-4, 10e-4, 11e-4], 1, 2), standins.table4(robots, 1, 2)
    for number, made in zip((3, 4), tables, strict=True):
        kept = pd.read_csv(ROOT / "results" / f"table{number}.csv")
        assert list(made) == list(kept)
        same = kept.filter(regex="row|robot|delta|measure|known|printed").columns
        pd.testing.assert_frame_equal(made[same], kept[same], rtol=1e-5)
        assert (made["runs"] == 2).all()
        assert (made["best_rmse_rps"] > 0.99 * kept["best_rmse_rps"]).all()  # of 30 runs


def test_a_clean_record_is_the_motors_true_speed():
    record = standins.clean_record(JOINT, DELTA, turns=2)
    np.testing.assert_allclose(record.v, simulate(JOINT, DELTA, 0.8).v, atol=1e-5)
    assert (record.commanded_speed_rps, record.turn_period_s) == pytest.approx((100, 0.4))


def test_a_log_is_its_encoders_position_rounded_down_and_differenced():
    t = 0.01 * np.arange(4)
    log = standins.read_encoder(JOINT, t, np.array([0.29, 0.51, 0.99, 2.0]) * TURN, TURN / 10, "")
    np.testing.assert_allclose(log.v, np.array([0.3, 0.4, 1.1]) / 0.01)
    np.testing.assert_array_equal(log.t, t[:-1])
    assert (log.commanded_speed_rps, log.turn_period_s) == pytest.approx((100, 0.4))


def test_an_eccentric_gear_moves_the_load_and_no_momentum_comes_from_it():
    error, order, phase = 1e-4, 0.2, 0.3
    free = JOINT._replace(G=0.0, K_pos=0.0, K_p=0.0, K_i=0.0, K_d=0.0, K_w=0.0)
    j = free._replace(waves=(standins.transmission_error(free, order, phase, error),))
    run = simulate(j, DELTA, 0.5, 1e-3)
    # The simulated load's position is the true one plus the error.
    moved = error * order * j.Omega * np.cos(order * j.Omega * run.t + phase)
    momentum = j.N * j.J_m * run.omega_m + j.J_l * (run.omega_l - moved)
    assert np.ptp(momentum) < 1e-6 * j.J_l * np.ptp(moved)
    assert np.ptp(run.omega_m) > 1e-3


def test_a_torque_at_an_odd_harmonic_of_the_turn_looks_like_backlash():
    # 9 times 2.5 Hz, and 8 times, in a joint without backlash.
    joint = change(JOINT, {"G": 0.5})
    shaken = (
        joint._replace(waves=(Wave(frequency / 100, 0.0, on_load=0.05 * joint.G),))
        for frequency in (22.5, 20.0)
    )
    odd, even = standins.fit_logs([(standins.Bench(each, 0.02), 0.0) for each in shaken], 1)[
        "A_rps"
    ]
    assert odd > 2.5 * even
