import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from replication.dead_zone import transmitted_torque
from replication.simulator import checks, core
from replication.simulator.parameters import JointParameters, identified_joint, joint_from_ratios
from replication.simulator.simulate import (
    DivergenceError,
    encoder_position,
    simulate,
    simulate_many,
)
from tests.reference import solve_ivp_speed_rps

DELTA = 15e-4
NO_DRIVE = {
    "position_gain_per_s": 0.0,
    "speed_gain_nms_per_rad": 0.0,
    "integral_gain_nm_per_rad": 0.0,
    "derivative_gain_nms2_per_rad": 0.0,
    "leaky_gain_nm_per_rad": 0.0,
}


@pytest.fixture(scope="module")
def joint() -> JointParameters:
    return identified_joint()


@settings(max_examples=60)
@given(
    x=st.floats(-5e-3, 5e-3), v=st.floats(-1, 1), delta=st.floats(1e-5, 4e-3), clamped=st.booleans()
)
def test_the_compiled_torque_is_the_printed_one(x, v, delta, clamped):
    # At the edges themselves the side is a matter of convention.
    if min(abs(x), abs(abs(x) - delta)) < 1e-12:
        return
    region = int(np.searchsorted([-delta, 0.0, delta], x))
    c = core.constants_of(identified_joint(), delta)
    c = c._replace(ks=2e4, ds=5.0, alpha=1e6, clamped=float(clamped))
    compiled = core.torque(x, v, region, c)
    printed = float(transmitted_torque(x, v, delta, 2e4, 5.0, 1e6, clamped))
    assert compiled == pytest.approx(printed, rel=1e-6, abs=1e-8)


# Accuracy of the integration


@pytest.mark.slow
@pytest.mark.parametrize("method", ["Radau", "LSODA"])
def test_the_simulation_agrees_with_solve_ivp(joint, method):
    p = replace(joint, lead_s=0.02)
    reference = solve_ivp_speed_rps(p, DELTA, 0.04, method, rtol=1e-9, atol=1e-12, max_step=2.5e-5)
    simulated = simulate(p, DELTA, duration_s=0.04, sample_s=p.control_period_s)
    assert simulated.impact_time_s.size == 1
    assert simulated.motor_speed_rps == pytest.approx(reference, abs=1e-5)


def test_located_contacts_keep_the_fourth_order(joint):
    p = replace(joint, clamped=True)
    speeds = [
        simulate(p, DELTA, duration_s=0.4, step_s=p.control_period_s / k).motor_speed_rps
        for k in (2, 4, 8, 64)
    ]
    coarse, middle, fine = (np.abs(v - speeds[-1]).max() for v in speeds[:3])
    assert coarse / middle > 10
    assert middle / fine > 10


def test_the_default_step_keeps_the_error_far_below_a_thousandth_of_a_turn_per_second(joint):
    for delta in (3e-4, 21e-4, 39e-4):
        default = simulate(joint, delta, duration_s=1.0)
        converged = simulate(joint, delta, duration_s=1.0, step_s=2.5e-6)
        assert default.motor_speed_rps == pytest.approx(converged.motor_speed_rps, abs=5e-5)


# Limits


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"torque_lag_s": 0.0, "control_delay_periods": 0, "derivative_gain_nms2_per_rad": 0.0},
        {
            "damping_nms_per_rad": 5.0,
            "motor_viscous_nms_per_rad": 1e-4,
            "load_viscous_nms_per_rad": 0.1,
        },
    ],
    ids=["identified", "no lag or delay", "damped"],
)
def test_without_backlash_the_joint_is_its_linear_two_mass_system(joint, changes):
    p = replace(joint, **changes, gravity_arm_m=0.0, lead_s=0.0)
    # Friction is measured from the commanded speed in the matrix, so the simulation starts with it balanced.
    y0 = np.array(core.start_state(p, 0.0)[0])
    kick = np.array([0.02, 1.0, 0.0, -0.01, 0.0])
    record, gap = np.empty((201, 5)), np.empty(201, dtype=np.int64)
    schedule = core.Schedule(200 * 50, p.control_period_s / 50, 0, 50, 50, p.control_delay_periods)
    log = core.Log(record, gap, np.empty((0, 2)))
    core.run(tuple(y0 + kick), 3, schedule, core.constants_of(p, 0.0), core.drive_of(p), log)
    matrix, state = checks.closed_loop_matrix(p), np.zeros(9 + p.control_delay_periods)
    state[:5], state[8] = kick, kick[0]
    state[9:] = kick[4]
    for found in record[1:]:
        state = matrix @ state
        assert (found - y0)[:4] == pytest.approx(state[:4], abs=1e-7)


def test_a_rigid_coupling_moves_both_inertias_as_one(joint):
    rigid = replace(joint, stiffness_nm_per_rad=1e9 * joint.stiffness_nm_per_rad)
    one = joint.motor_inertia_kgm2 + joint.load_inertia_kgm2 / joint.gear_ratio**2
    single = replace(joint, motor_inertia_kgm2=one)
    modes = np.linalg.eigvals(checks.closed_loop_matrix(rigid))
    for mode in np.linalg.eigvals(checks.closed_loop_matrix(single, in_contact=False)):
        # The load's free motion (1) and the drive's unused memory (0) are no modes of the single mass.
        if 1e-6 < abs(mode) < 1 - 1e-9:
            assert np.abs(modes - mode).min() < 1e-4


def test_without_drive_and_damping_the_energy_is_kept(joint):
    # It starts hanging down, where no torque is needed and none stays in the drive.
    p = replace(joint, clamped=True, start_angle_rad=0.0, lead_s=0.0, **NO_DRIVE)
    run = simulate(p, DELTA, duration_s=0.8, sample_s=1e-3, step_s=1e-5)
    twist = np.abs(run.motor_position_rad / p.gear_ratio - run.load_position_rad) - DELTA
    energy = (
        p.motor_inertia_kgm2 * run.motor_speed_rad_per_s**2 / 2
        + p.load_inertia_kgm2 * run.load_speed_rad_per_s**2 / 2
        - p.gravity_torque_nm * np.cos(run.load_position_rad)
        + p.stiffness_nm_per_rad * np.maximum(twist, 0) ** 2 / 2
    )
    assert run.impact_time_s.size > 0
    assert energy == pytest.approx(np.full(energy.size, energy[0]), abs=1e-6 * p.gravity_torque_nm)


def test_impacts_come_twice_a_turn_on_alternating_sides(joint):
    run = simulate(joint, DELTA, duration_s=1.6)
    assert run.impact_time_s.size == 8
    assert (np.diff(run.impact_side) != 0).all()
    parted = run.separation_time_s[run.separation_time_s > run.impact_time_s[0]]
    assert (parted[:3] > run.impact_time_s[:3]).all()
    assert (parted[:3] < run.impact_time_s[1:4]).all()


def test_the_gap_state_and_an_impact_say_which_side_drives(joint):
    run = simulate(joint, DELTA, duration_s=0.8, sample_s=1e-3)
    twist = run.motor_position_rad / joint.gear_ratio - run.load_position_rad
    assert (run.gap_state == np.where(np.abs(twist) < DELTA, 0, np.sign(twist))).all()
    after = np.searchsorted(run.time_s, run.impact_time_s)
    assert (run.gap_state[after] == run.impact_side).all()


# Parameters


def test_only_ratios_show_in_the_motor_speed(joint):
    heavy = joint_from_ratios(joint.ratios, load_mass_kg=50.0)
    assert heavy.motor_inertia_kgm2 == pytest.approx(10 * joint.motor_inertia_kgm2)
    light_run, heavy_run = (simulate(p, DELTA, duration_s=0.8) for p in (joint, heavy))
    assert heavy_run.motor_speed_rps == pytest.approx(light_run.motor_speed_rps, abs=1e-7)


def test_an_incomplete_or_unknown_ratio_is_named(joint):
    with pytest.raises(ValueError, match="gravity_per_s2"):
        joint_from_ratios({k: v for k, v in joint.ratios.items() if k != "gravity_per_s2"})
    with pytest.raises(ValueError, match="colour"):
        joint_from_ratios(joint.ratios | {"colour": 1.0})


def test_several_levels_at_once_give_the_same_bytes_on_any_number_of_threads(joint):
    levels = [3e-4, 11e-4, 21e-4]
    one, two = (simulate_many(joint, levels, duration_s=0.8, threads=n) for n in (1, 2))
    for delta, a, b in zip(levels, one, two, strict=True):
        alone = simulate(joint, delta, duration_s=0.8)
        for name in ("motor_speed_rad_per_s", "motor_torque_nm", "impact_time_s", "gap_state"):
            assert (
                getattr(a, name).tobytes()
                == getattr(b, name).tobytes()
                == getattr(alone, name).tobytes()
            )


def test_the_encoder_rounds_down_to_its_grid_and_hardly_disturbs_the_drive(joint):
    grid = 2 * math.pi / 2**19
    assert encoder_position([0.0, 1.4 * grid, -0.1 * grid]) == pytest.approx([0.0, grid, -grid])
    real = replace(joint, encoder_bits=19)
    ideal_run, real_run = (simulate(p, DELTA, duration_s=0.8) for p in (joint, real))
    error = np.abs(real_run.motor_speed_rps - ideal_run.motor_speed_rps).max()
    assert 0 < error < 0.01


def test_the_torque_limit_holds(joint):
    limit = (
        0.8 * np.abs(simulate(joint, DELTA, duration_s=0.8, sample_s=1e-4).motor_torque_nm).max()
    )
    run = simulate(replace(joint, torque_limit_nm=limit), DELTA, duration_s=0.8, sample_s=1e-4)
    assert np.abs(run.motor_torque_nm).max() <= limit


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"motor_inertia_kgm2": -1e-5}, "motor_inertia_kgm2"),
        ({"stiffness_nm_per_rad": math.nan}, "stiffness_nm_per_rad"),
        ({"alpha_per_rad": math.inf}, "clamped"),
        ({"control_delay_periods": 0.5}, "control_delay_periods"),
        ({"torque_limit_nm": 0.0}, "torque_limit_nm"),
        ({"lead_s": 1.23e-4}, "lead_s"),
        ({"speed_gain_nms_per_rad": 1.0}, "unstable"),
        ({"stiffness_nm_per_rad": 1e8}, "step_s"),
    ],
)
def test_a_bad_parameter_is_refused_by_name(joint, changes, word):
    with pytest.raises(ValueError, match=word):
        simulate(replace(joint, **changes), DELTA)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"delta_rad": 4.0}, "turn"),
        ({"delta_rad": math.nan}, "delta_rad"),
        ({"step_s": 5e-4}, "step_s"),
        ({"step_s": 3e-5}, "control_period_s"),
        ({"sample_s": 2.05e-3}, "sample_s"),
        ({"duration_s": -1.0}, "duration_s"),
    ],
)
def test_a_bad_run_is_refused_by_name(joint, arguments, word):
    stiff = replace(joint, stiffness_nm_per_rad=1e6)
    with pytest.raises(ValueError, match=word):
        simulate(
            stiff if arguments == {"step_s": 5e-4} else joint, **({"delta_rad": DELTA} | arguments)
        )


def test_a_diverging_run_is_named_and_never_returned(joint, monkeypatch):
    monkeypatch.setattr(checks, "check_stability", lambda p: None)
    wild = replace(joint, speed_gain_nms_per_rad=20 * joint.speed_gain_nms_per_rad)
    with pytest.raises(DivergenceError, match=r"diverged at t = .* delta_rad = 0.0015"):
        simulate(wild, DELTA)
