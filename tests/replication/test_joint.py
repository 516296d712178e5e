import numpy as np
import pytest
from scipy.integrate import solve_ivp

from replication.joint import K_BL, TURN, Wave, change, identified_joint, simulate, tau_l

DELTA = 15e-4
JOINT = identified_joint()
FREE = JOINT._replace(K_pos=0.0, K_p=0.0, K_i=0.0, K_d=0.0, K_w=0.0, start_angle=0.0, lead=0.0)


def test_the_stiffness_is_half_at_the_edge_and_whole_outside():
    assert K_BL(DELTA, DELTA, 2e4, 1e6) == pytest.approx(1e4, rel=1e-3)
    np.testing.assert_allclose(K_BL(np.array([-1.0, 1.0]), DELTA, 2e4, 1e6), 2e4, rtol=1e-6)


def test_the_stiffness_leaks_in_the_middle_of_the_gap():
    for alpha in (1e4, 1e5, 1e6):
        leak = 2 * 2e4 / (np.pi * alpha * DELTA)
        assert K_BL(0.0, DELTA, 2e4, alpha) == pytest.approx(leak, rel=0.01)


DAMPED = JOINT._replace(K_s=2e4, D_s=10.0)


def test_the_printed_torque_jumps_at_zero_displacement():
    jump = 2 * 2e4 / (np.pi * 1e6)
    assert tau_l(1e-12, 0.0, DELTA, 1, DAMPED) == pytest.approx(-jump, rel=1e-3)
    assert tau_l(-1e-12, 0.0, DELTA, -1, DAMPED) == pytest.approx(jump, rel=1e-3)


def test_the_printed_torque_pulls_when_the_teeth_part_and_the_clamped_one_does_not():
    assert tau_l(DELTA + 1e-5, -1.0, DELTA, 1, DAMPED) < 0
    clamped = DAMPED._replace(clamped=True)
    assert tau_l(DELTA + 1e-5, -1.0, DELTA, 1, clamped) == 0
    assert tau_l(-2 * DELTA, 0.0, DELTA, -1, clamped) == pytest.approx(-2e4 * DELTA)


def scipy_speeds(j, duration):
    """Motor speed at the drive's periods [rad/s]: the paper's equations, written anew, between them by SciPy."""

    def field(t, y, command):
        theta_m, omega_m, theta_l, omega_l, torque = y
        x, rate = theta_m / j.N - theta_l, omega_m / j.N - omega_l
        arcs = np.arctan(j.alpha * (x - DELTA)) - np.arctan(j.alpha * (x + DELTA))
        stiffness = j.K_s * (1 + arcs / np.pi)
        tau = (x - DELTA * np.sign(x) + j.D_s / j.K_s * rate) * stiffness
        load = j.G * np.sin(theta_l) + j.load_coulomb + j.load_viscous * omega_l
        return (
            omega_m,
            (torque - tau / j.N) / j.J_m,
            omega_l,
            (tau - load) / j.J_l,
            (command - torque) / j.torque_lag,
        )

    t = -j.lead + j.period * np.arange(round((j.lead + duration) / j.period) + 1)
    angle = j.start_angle + j.Omega / j.N * t[0]
    carried = j.G * np.sin(angle) + j.load_coulomb + j.load_viscous * j.Omega / j.N
    twist = np.sign(carried) * DELTA + carried / j.K_s
    y = np.array([j.N * angle, j.Omega, angle - twist, j.Omega / j.N, carried / j.N])
    command = integral = carried / j.N
    w, last, speeds = 0.0, j.Omega, []
    for now in t:
        speeds.append(y[1])
        held = command  # computed a period ago
        error = j.K_pos * (j.N * j.start_angle + j.Omega * now - y[0]) + j.Omega - y[1]
        integral += j.K_i * j.period * error
        w += j.period * (j.Omega - y[1] - j.w_rate * w)
        command = j.K_p * error + integral + j.K_w * w - j.K_d * (y[1] - last) / j.period
        last = y[1]
        y = solve_ivp(
            field, (0, j.period), y, "LSODA", args=(held,), rtol=1e-10, atol=1e-11, max_step=5e-5
        ).y[:, -1]
    return t, np.array(speeds)


def test_the_simulated_speed_is_the_one_that_scipy_integrates():
    joint = JOINT._replace(lead=0.02, load_coulomb=0.3, load_viscous=0.02, D_s=1.0)
    t, speeds = scipy_speeds(joint, 0.04)
    run = simulate(joint, DELTA, 0.04, joint.period)
    assert run.impacts.size == 1
    assert np.ptp(run.v) > 0.2
    np.testing.assert_allclose(run.omega_m, speeds[t > -1e-9], atol=1e-4)


def test_located_contacts_keep_the_fourth_order():
    joint = JOINT._replace(clamped=True)
    speeds = [simulate(joint, DELTA, 0.4, step=joint.period / k).v for k in (2, 4, 8, 64)]
    coarse, middle, fine = (np.abs(v - speeds[-1]).max() for v in speeds[:3])
    assert coarse / middle > 10
    assert middle / fine > 10


def test_without_drive_and_damping_the_energy_is_kept():
    j = FREE._replace(clamped=True)
    run = simulate(j, DELTA, 0.8, 1e-3, 1e-5)
    twist = np.maximum(np.abs(run.theta_m / j.N - run.theta_l) - DELTA, 0)
    kinetic = (j.J_m * run.omega_m**2 + j.J_l * run.omega_l**2) / 2
    energy = kinetic - j.G * np.cos(run.theta_l) + j.K_s * twist**2 / 2
    assert run.impacts.size > 0
    np.testing.assert_allclose(energy, energy[0], atol=1e-6 * j.G)


def test_a_disturbance_and_friction_change_the_momentum_by_their_impulse():
    order, phase, ripple, push, rub = 0.3, 0.4, 0.02, 0.5, 0.05
    waves = (Wave(order, phase, on_motor=ripple), Wave(order, phase, on_load=push))
    j = FREE._replace(G=0.0, waves=waves, load_viscous=rub)
    run = simulate(j, DELTA, 0.11, 1e-4)
    momentum = j.J_m * j.N * run.omega_m + j.J_l * run.omega_l
    on_motor = j.N * (ripple * np.sin(order * run.theta_m + phase) + run.torque)
    on_load = push * np.sin(order * j.Omega * run.t + phase) - rub * run.omega_l
    impulse = np.trapezoid(on_motor + on_load, run.t)
    assert momentum[-1] - momentum[0] == pytest.approx(impulse, rel=1e-3)
    assert abs(impulse) > 2e-3


def test_the_teeth_meet_twice_a_turn_on_alternating_sides():
    run = simulate(JOINT, DELTA, 1.6, 1e-3)
    assert run.impacts.size == 8
    sides = run.gap[np.searchsorted(run.t, run.impacts)]
    assert (np.diff(sides) != 0).all()
    twist = run.theta_m / JOINT.N - run.theta_l
    np.testing.assert_array_equal(run.gap, np.where(np.abs(twist) < DELTA, 0, np.sign(twist)))


def test_only_ratios_show_in_the_motor_speed():
    scaled = {"J_m": 10, "J_l": 10, "G": 10, "K_s": 10, "K_p": 10, "K_i": 10, "K_d": 10, "K_w": 10}
    heavy = JOINT._replace(
        **{name: factor * getattr(JOINT, name) for name, factor in scaled.items()}
    )
    np.testing.assert_allclose(
        simulate(heavy, DELTA, 0.8).v, simulate(JOINT, DELTA, 0.8).v, atol=1e-7
    )


def test_the_encoders_grid_hardly_disturbs_the_drive():
    coarse, fine = (
        simulate(JOINT._replace(encoder_step=TURN / 2**bits), DELTA, 0.8).v for bits in (19, 40)
    )
    assert 0 < np.abs(coarse - fine).max() < 0.02


@pytest.mark.parametrize(
    ("factors", "arguments", "words"),
    [
        ({"J_m": -1}, {}, "J_m is .* positive"),
        ({"K_s": np.nan}, {}, "K_s is nan"),
        ({"N": 0}, {}, "N is 0"),
        ({"G/J_l": 0}, {}, "G/J_l"),
        ({"colour": 2}, {}, "colour.*K_s/J_l"),
        ({"K_s": 1e4}, {}, "step is .* at most"),
        ({"J_m": 1e-5}, {}, "step is .* at most"),
        ({"K_p": 20}, {}, "runs away"),
        ({}, {"delta": 4.0}, "gap"),
        ({}, {"sample": 2.05e-3}, "sample is .* multiple"),
        ({}, {"step": 3e-5}, "multiple of the step"),
        ({}, {"duration": -1}, "duration is -1"),
    ],
)
def test_what_cannot_be_simulated_is_named_in_one_line(factors, arguments, words):
    with pytest.raises(ValueError, match=words) as refusal:
        simulate(change(JOINT, factors), **({"delta": DELTA} | arguments))
    assert "\n" not in str(refusal.value)


def test_a_stiff_joint_and_one_without_gravity_run():
    assert simulate(change(JOINT, {"K_s": 10}), DELTA).impacts.size >= 24
    assert np.abs(simulate(change(JOINT, {"G": 0}), DELTA).v - 100).max() < 1e-6


def test_a_changed_ratio_keeps_the_other_ratios_and_a_changed_field_all_other_fields():
    doubled = change(JOINT, {"J_l/(N^2 J_m)": 0.5})
    assert doubled.J_m == pytest.approx(2 * JOINT.J_m)
    assert doubled.K_p == pytest.approx(2 * JOINT.K_p)
    assert change(JOINT, {"J_m": 2.0}) == JOINT._replace(J_m=2 * JOINT.J_m)
