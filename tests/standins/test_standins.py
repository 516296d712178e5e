from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backlash.fitting.global_fit import global_fit
from replication import characteristic, published, standins
from replication.simulator.parameters import Disturbance, JointParameters, identified_joint
from replication.simulator.simulate import simulate
from tests.simulator.test_simulate import NO_DRIVE

DELTA = 10e-4


@pytest.fixture(scope="module")
def joint() -> JointParameters:
    return identified_joint()


@pytest.fixture(scope="module")
def bench() -> standins.Bench:
    return standins.draw_bench(np.random.default_rng(1))


# Disturbances in the joint


@pytest.mark.parametrize(
    "wave",
    [
        Disturbance(1.0, motor_torque_nm=0.01, phase_rad=0.3),
        Disturbance(0.21, load_torque_nm=0.5, phase_rad=1.0),
        Disturbance(0.21, transmission_error_rad=5e-5, phase_rad=2.0),
    ],
)
def test_a_disturbed_joint_is_the_one_that_scipy_integrates_from_the_undisturbed_coordinates(
    joint, wave
):
    p = replace(joint, **NO_DRIVE, lead_s=0.0, gravity_arm_m=1e-9, disturbances=(wave,))
    run = simulate(p, 0.0, duration_s=0.1, step_s=2.5e-5)
    n, omega = p.gear_ratio, p.commanded_speed_rad_per_s
    frequency = wave.order * omega

    def rates(t, y):
        error = wave.transmission_error_rad * np.sin(frequency * t + wave.phase_rad)
        torque = p.stiffness_nm_per_rad * (y[0] / n - y[2] - error)
        ripple = wave.motor_torque_nm * np.sin(wave.order * (omega * t + y[0]) + wave.phase_rad)
        load = wave.load_torque_nm * np.sin(frequency * t + wave.phase_rad)
        return (
            y[1],
            (ripple - torque / n) / p.motor_inertia_kgm2,
            y[3],
            (torque + load) / p.load_inertia_kgm2,
        )

    first = [
        0.0,
        0.0,
        run.load_position_rad[0] - p.start_angle_rad,
        run.load_speed_rad_per_s[0] - omega / n,
    ]
    exact = solve_ivp(
        rates, (0, 0.1), first, t_eval=run.time_s, method="DOP853", rtol=1e-10, atol=1e-12
    ).y
    speed, load = (
        run.motor_speed_rad_per_s - omega,
        run.load_position_rad - p.start_angle_rad - omega / n * run.time_s,
    )
    np.testing.assert_allclose(speed, exact[1], atol=1e-3 * np.abs(exact[1]).max())
    np.testing.assert_allclose(load, exact[2], atol=1e-3 * np.abs(exact[2]).max())


# Benches and their logs


def test_a_bench_without_spread_is_the_identified_joint_with_an_encoder(joint):
    none = standins.Spread(**dict.fromkeys(standins.Spread.__dataclass_fields__, 0.0))
    drawn = standins.draw_bench(np.random.default_rng(1), none)
    for name, value in joint.ratios.items():
        if name != "lead_s":
            assert drawn.joint.ratios[name] == pytest.approx(value, rel=1e-9)
    assert drawn.joint.encoder_bits == published.value("text.encoder_bits")
    assert drawn.noise_rps == 0


def test_a_noise_free_log_lies_on_the_encoders_grid(bench):
    quiet = replace(bench, noise_rps=0.0)
    log = standins.encoder_log(quiet, DELTA, np.random.default_rng(2))
    counts = log.v * standins.SAMPLE_S * 2**bench.joint.encoder_bits
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-3)
    assert log.t.size == log.v.size == 2400


# Table 3


def test_the_printed_known_amplitudes_are_table_2_interpolated_and_not_equation_10():
    printed = published.column("Table 3", "known")
    deltas_rad = 1e-4 * np.round(1e4 * characteristic.equation_10().backlash_rad(printed))
    np.testing.assert_allclose(1e4 * deltas_rad, [9, 10, 11])
    half_digit = published.half_last_digit(published.cells().loc["table3.row02.known", "printed"])
    for delta, known in zip(deltas_rad, printed, strict=True):
        assert abs(characteristic.known_amplitude_rps(delta) - known) <= half_digit * (1 + 1e-6)
        assert abs(characteristic.equation_10().amplitude_rps(delta) - known) > half_digit


def test_friction_on_the_load_takes_amplitude_away(joint):
    rubbing = [
        replace(joint, load_coulomb_nm=share * joint.gravity_torque_nm)
        for share in (0.0, 0.02, 0.05)
    ]
    cases = [(standins.Bench(each, 0.0, 0.0), DELTA) for each in rubbing]
    amplitude = standins.fitted_logs(global_fit, cases, [(1, 0)] * len(cases))["A_rps"]
    assert amplitude.is_monotonic_decreasing
    assert amplitude.iloc[-1] < 0.8 * amplitude.iloc[0]


# Robots


def test_robots_a_and_b_are_the_first_of_the_population():
    spread = standins.RobotSpread()
    population = standins.robot_population(global_fit, 1, spread, seed=3)
    records = standins.table4_records(spread, seed=3)
    assert [key["delta_rad"] for key, _ in records] == population["delta_rad"].tolist()
    assert population["kind"].tolist() == list(standins.KINDS)
    low, high = population["delta_rad"]
    assert low <= spread.healthy_rad[1] < spread.excessive_rad[0] <= high


def test_a_joint_without_backlash_is_called_backlash_in_step_with_the_turns_odd_multiple_only():
    sweep = standins.disturbed_healthy_joint(
        global_fit, [20.0, 22.5], [0.05], gravity=0.5, noise_rps=0.02, seed=1
    )
    out_of_step, in_step = sweep["A_rps"]
    assert in_step > 2.5 * out_of_step
    assert sweep["turns_used"].iloc[1] > 10
