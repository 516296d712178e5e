import numpy as np
import pytest

from replication import bench, published
from replication.joint import TURN, Wave, change, identified_joint, ratios, simulate

DELTA = 10e-4
JOINT = identified_joint()


def test_a_bench_without_spread_is_the_identified_joint_with_an_encoder():
    none = bench.Spread(**dict.fromkeys(bench.Spread.__dataclass_fields__, 0.0))
    drawn, noise_rps = bench.draw_bench(np.random.default_rng(1), none)
    expected = ratios(JOINT) | {"lead": JOINT.turn_period}
    assert ratios(drawn) == pytest.approx(expected)
    assert TURN / drawn.encoder_step == 2 ** published.value("text.encoder_bits")
    assert noise_rps == 0


def test_a_noise_free_log_lies_on_the_encoders_grid():
    drawn = bench.draw_bench(np.random.default_rng(1))
    log = bench.encoder_log(drawn._replace(noise_rps=0.0), DELTA, np.random.default_rng(2))
    counts = log.v * TURN * bench.SAMPLE / drawn.joint.encoder_step
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-3)
    assert log.t.size == log.v.size == 2400


def test_an_eccentric_gear_moves_the_load_and_no_momentum_comes_from_it():
    error, order, phase = 1e-4, 0.2, 0.3
    free = JOINT._replace(G=0.0, K_pos=0.0, K_p=0.0, K_i=0.0, K_d=0.0, K_w=0.0)
    j = free._replace(waves=(bench.transmission_error(free, order, phase, error),))
    run = simulate(j, DELTA, 0.5, 1e-3)
    # The simulated load's position is the true one plus the error.
    moved = error * order * j.Omega * np.cos(order * j.Omega * run.t + phase)
    momentum = j.N * j.J_m * run.omega_m + j.J_l * (run.omega_l - moved)
    assert np.ptp(momentum) < 1e-6 * j.J_l * np.ptp(moved)
    assert np.ptp(run.omega_m) > 1e-3


def test_friction_on_the_load_takes_amplitude_away():
    rubbing = (JOINT._replace(load_coulomb=share * JOINT.G) for share in (0.0, 0.02, 0.05))
    amplitude = bench.fit_logs([(bench.Bench(each, 0.0), DELTA) for each in rubbing], 1)["A_rps"]
    assert amplitude.is_monotonic_decreasing
    assert amplitude.iloc[-1] < 0.8 * amplitude.iloc[0]


def test_a_torque_at_an_odd_harmonic_of_the_turn_looks_like_backlash():
    # 9 times 2.5 Hz, and 8 times, in a joint without backlash.
    joint = change(JOINT, {"G": 0.5})
    shaken = (
        joint._replace(waves=(Wave(frequency / 100, 0.0, on_load=0.05 * joint.G),))
        for frequency in (22.5, 20.0)
    )
    odd, even = bench.fit_logs([(bench.Bench(each, 0.02), 0.0) for each in shaken], 1)["A_rps"]
    assert odd > 2.5 * even


def test_tables_3_and_4_stand_beside_the_printed_ones():
    drawn = bench.draw_bench(np.random.default_rng(1))
    table = bench.table3(drawn, [9e-4, 10e-4, 11e-4], 1, 2)
    assert table["printed_known"].tolist() == published.column("Table 3", "known").tolist()
    robots = [
        bench.draw_robot(np.random.default_rng(k), kind) for k, kind in enumerate(bench.ROBOTS)
    ]
    (_, healthy), (_, excessive) = robots
    assert healthy <= 1e-4 < 2e-4 <= excessive
    assert (bench.table4(robots, 1, 2)["mean_A_rps"] > 0).all()
