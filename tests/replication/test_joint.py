"""Equations 8 and 9, the joint against SciPy, and what its record tells."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from replication import published
from replication.joint import (
    K_BL,
    TURN,
    Wave,
    change,
    check,
    clamped_torque,
    from_ratios,
    identified_joint,
    ratios,
    simulate,
    tau_l,
)

DELTA = 15e-4
JOINT = identified_joint()


def scipy_states(j, duration):
    """States at the drive's periods, shape (5, periods): the equations, written anew, between them by SciPy."""

    def contact(x, rate):
        if j.clamped:
            depth = abs(x) - DELTA
            push = j.K_s * depth + j.D_s * rate * np.sign(x)
            return np.sign(x) * max(push, 0) if depth > 0 else 0.0
        arcs = np.arctan(j.alpha * (x - DELTA)) - np.arctan(j.alpha * (x + DELTA))
        return (x - DELTA * np.sign(x) + j.D_s / j.K_s * rate) * j.K_s * (1 + arcs / np.pi)

    def field(t, y, now, command):
        theta_m, omega_m, theta_l, omega_l, torque = y
        tau = contact(theta_m / j.N - theta_l, omega_m / j.N - omega_l)
        load = j.G * np.sin(theta_l) + j.load_coulomb + j.load_viscous * omega_l
        motor = j.motor_coulomb + j.motor_viscous * omega_m
        for order, phase, on_motor, on_load in j.waves:
            motor -= on_motor * np.sin(order * (theta_m - j.N * j.start_angle) + phase)
            load -= on_load * np.sin(order * j.Omega * (now + t) + phase)
        return (
            omega_m,
            (torque - tau / j.N - motor) / j.J_m,
            omega_l,
            (tau - load) / j.J_l,
            (command - torque) / j.torque_lag if j.torque_lag else 0.0,
        )

    t = -j.lead + j.period * np.arange(round((j.lead + duration) / j.period) + 1)
    angle = j.start_angle + j.Omega / j.N * t[0]
    carried = j.G * np.sin(angle) + j.load_coulomb + j.load_viscous * j.Omega / j.N
    twist = np.sign(carried) * DELTA + carried / j.K_s
    torque = carried / j.N + j.motor_coulomb + j.motor_viscous * j.Omega
    y = np.array([j.N * angle, j.Omega, angle - twist, j.Omega / j.N, torque])
    queue, integral, w = [torque] * j.delay, torque, 0.0
    last_speed, last_position, states = j.Omega, j.N * angle - j.Omega * j.period, []
    for now in t:
        position, speed = y[0], y[1]
        if j.encoder_step:
            position = np.floor(position / j.encoder_step) * j.encoder_step
            speed = (position - last_position) / j.period
        error = j.K_pos * (j.N * j.start_angle + j.Omega * now - position) + j.Omega - speed
        integral += j.K_i * j.period * error
        w += j.period * (j.Omega - speed - j.w_rate * w)
        damping = j.K_d * (speed - last_speed) / j.period
        queue.append(j.K_p * error + integral + j.K_w * w - damping)
        last_speed, last_position = speed, position
        command = queue.pop(0)
        states.append(y.copy())
        y[4] = y[4] if j.torque_lag else command
        limits = {"rtol": 1e-10, "atol": 1e-11, "max_step": 2.5e-5}
        y = solve_ivp(field, (0, j.period), y, "LSODA", args=(now, command), **limits).y[:, -1]
    return t, np.transpose(states)


WAVES = (Wave(0.3, 0.4, on_motor=0.02, on_load=0.5), Wave(1.5, 1.0, on_motor=-0.01))
FRICTION = {"load_coulomb": 0.3, "load_viscous": 0.02, "motor_coulomb": 0.02, "motor_viscous": 1e-4}
ENCODER = {"encoder_step": TURN / 2**19, "start_angle": np.pi + 0.15}


@pytest.mark.parametrize(
    "fields",
    [
        {"lead": 0.02, "D_s": 1.0, **FRICTION},
        {"lead": 0.0135, "clamped": True, "delay": 2, **ENCODER},
        {"torque_lag": 0.0, "delay": 0, "K_d": 0.3 * JOINT.K_d, "waves": WAVES, **FRICTION},
    ],
    ids=["printed dead zone", "clamped dead zone and encoder", "waves"],
)
def test_the_simulated_motion_is_the_one_that_scipy_integrates(fields):
    joint = JOINT._replace(**fields)
    t, states = scipy_states(joint, 0.04)
    run = simulate(joint, DELTA, 0.04, joint.period, 2.5e-5)
    assert run.impacts.size == 1
    for ours, theirs in zip(run[1:6], states[:, t > -1e-9], strict=True):
        uneven = np.ptp(theirs - np.linspace(theirs[0], theirs[-1], theirs.size))
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=5e-6 * uneven)


def test_the_stiffness_leaks_in_the_middle_of_the_gap():
    effect = published.table("errata")["effect"]["E8"]
    for delta in (3e-4, 21e-4):
        percent = 100 * K_BL(0.0, delta, 1.0, 1e5)
        assert percent == pytest.approx(200 / (np.pi * 1e5 * delta), rel=0.01)
        assert f"{percent:.2g} %" in effect or f"{percent:.2f} %" in effect
        assert K_BL(0.0, delta, 1.0, 1e6) == pytest.approx(percent / 1000, rel=0.01)


def test_the_printed_torque_jumps_at_zero_displacement():
    for alpha in (1e5, 1e6):
        j = JOINT._replace(alpha=alpha)
        before, after = (tau_l(side * 1e-12, 0.0, DELTA, side, j) for side in (-1, 1))
        assert before == pytest.approx(-after) == pytest.approx(2 * j.K_s / np.pi / alpha, rel=1e-3)
        assert f"{before - after:.2g} N m" in published.table("errata")["effect"]["E9"]


def test_the_printed_torque_pulls_when_the_teeth_part_and_the_clamped_one_does_not():
    damped = JOINT._replace(D_s=10.0)
    assert tau_l(DELTA + 1e-5, -1.0, DELTA, 1, damped) < 0
    assert clamped_torque(DELTA + 1e-5, -1.0, DELTA, 1, damped) == 0
    pushed = clamped_torque(-2 * DELTA, -0.5, DELTA, -1, damped)
    assert pushed == pytest.approx(-JOINT.K_s * DELTA - 10 * 0.5)


def test_the_teeth_meet_twice_a_turn_on_alternating_sides():
    run = simulate(JOINT, DELTA, 1.6, 1e-3)
    assert run.impacts.size == 8
    sides = run.gap[np.searchsorted(run.t, run.impacts)]
    assert (np.diff(sides) != 0).all()
    twist = run.theta_m / JOINT.N - run.theta_l
    np.testing.assert_array_equal(run.gap, np.where(np.abs(twist) < DELTA, 0, np.sign(twist)))
    for start_angle, side in ((0.1, 1), (-0.1, -1)):
        start = simulate(JOINT._replace(lead=0.0, start_angle=start_angle), DELTA, 0.01)
        assert start.gap[0] == side


def test_the_load_is_a_point_of_5_kg():
    assert pytest.approx(14, abs=0.5) == JOINT.G
    values = ratios(JOINT) | {"J_l/(N^2 J_m)": 3.0, "lead": 0.1}
    joint = from_ratios(values, 50.0)
    assert ratios(joint) == pytest.approx(values, rel=1e-12)
    arm_m = joint.G / (5 * 9.80665)
    assert joint.J_l == pytest.approx(5 * arm_m**2, rel=1e-12)
    assert arm_m == pytest.approx(9.80665 / values["G/J_l"], rel=1e-12)
    # What the ratios do not tell: equation 8's edge [1/rad], the drive's period [s] and its delay, 100 turns a second.
    assert (joint.alpha, joint.period, joint.delay) == (1e6, 5e-4, 1)
    assert joint.turn_period == pytest.approx(0.5)


CONTACT = JOINT.K_s * (
    1 / JOINT.J_l + 1 / (JOINT.N**2 * JOINT.J_m)
)  # rad^2/s^2 of the fastest mode


@pytest.mark.parametrize(
    "at",
    [
        lambda x: {"joint": JOINT._replace(K_s=JOINT.K_s * x * 5000**2 / CONTACT)},
        lambda x: {"joint": JOINT._replace(torque_lag=2e-4 / x)},
        lambda x: {"joint": JOINT._replace(waves=(Wave(-5000 * x / JOINT.Omega, 0.0),))},
        lambda x: {"delta": np.pi * x},
        lambda x: {"sample": 2e-3 + 1e-10 * x},  # a millionth of a step
    ],
    ids=["contact", "lag", "wave", "delta", "multiple"],
)
def test_what_can_be_integrated_ends_at_its_limit(at):
    sound = {"joint": JOINT, "delta": DELTA, "duration": 4.8, "sample": 2e-3, "step": 1e-4}
    check(**sound | at(0.99))
    with pytest.raises(ValueError, match=" must be "):
        check(**sound | at(1.01))


@pytest.mark.parametrize(
    ("factors", "arguments", "words"),
    [
        ({"J_m": -1}, {}, "J_m is .* positive"),
        ({"K_s": np.nan}, {}, "K_s is nan"),
        ({"N": 0}, {}, "N is 0"),
        ({"G/J_l": 0}, {}, "G/J_l"),
        ({"colour": 2}, {}, "colour.*K_s/J_l"),
        ({"D_s": 2}, {}, "D_s: zero"),
        ({"K_p": 20}, {}, "runs away"),
        ({"lead": 1e-10}, {}, "lead is .* multiple"),
        ({"w_rate": -1}, {}, "w_rate is .* zero or positive"),
        ({}, {"delta": -1e-9}, "gap"),
        ({}, {"step": 3e-5}, "multiple of the step"),
        ({}, {"duration": -1}, "duration is -1"),
    ],
)
def test_what_cannot_be_simulated_is_named_in_one_line(factors, arguments, words):
    with pytest.raises(ValueError, match=words) as refusal:
        simulate(change(JOINT, factors), **({"delta": DELTA} | arguments))
    assert "\n" not in str(refusal.value)


def test_a_stiff_joint_one_without_gravity_and_one_without_backlash_run():
    assert simulate(change(JOINT, {"K_s": 10}), DELTA).impacts.size >= 24
    assert np.abs(simulate(change(JOINT, {"G": 0}), DELTA, 0.8).v - 100).max() < 1e-6
    tight, loose = (simulate(JOINT, delta, 0.8).v for delta in (0.0, DELTA))
    assert np.ptp(tight) < 0.2 * np.ptp(loose)


def test_a_changed_ratio_keeps_the_other_ratios_and_a_changed_field_all_other_fields():
    changed = change(JOINT, {"J_l/(N^2 J_m)": 0.5, "N": 2.0})
    doubled = change(JOINT, {"J_l/(N^2 J_m)": 0.5})
    assert changed == doubled._replace(N=80.0)
    expected = ratios(JOINT)
    expected["J_l/(N^2 J_m)"] /= 2
    assert ratios(doubled) == pytest.approx(expected)
    assert change(JOINT, {"J_m": 2.0}) == JOINT._replace(J_m=2 * JOINT.J_m)
