"""What a joint must be for its simulation to mean something: parameters, run, and stability of its speed loop."""

import math
from dataclasses import astuple, fields
from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from replication.arrays import FloatArray
from replication.simulator import core
from replication.simulator.parameters import TURN, JointParameters


def closed_loop_matrix(parameters: JointParameters, *, in_contact: bool = True) -> FloatArray:
    """One control period of the linear joint without gravity, as a matrix.

    The state is motor position, motor speed, load position, load speed and torque, as deviations,
    then the drive's memory. Its eigenvalues are exp(s * control_period_s) of the joint's modes s.
    """
    p = parameters
    n = p.gear_ratio
    delay = p.control_delay_periods
    ks, ds = (p.stiffness_nm_per_rad, p.damping_nms_per_rad) if in_contact else (0.0, 0.0)
    coupling = np.array([ks / n, ds / n, -ks, -ds])
    a = np.zeros((6, 6))
    a[0, 1] = a[2, 3] = 1.0
    a[1, :4] = -coupling / n / p.motor_inertia_kgm2
    a[3, :4] = coupling / p.load_inertia_kgm2
    a[1, 1] -= p.motor_viscous_nms_per_rad / p.motor_inertia_kgm2
    a[3, 3] -= p.load_viscous_nms_per_rad / p.load_inertia_kgm2
    a[1, 4 if p.torque_lag_s > 0 else 5] = 1 / p.motor_inertia_kgm2
    if p.torque_lag_s > 0:
        a[4, 4:] = np.array([-1.0, 1.0]) / p.torque_lag_s
    flow = expm(a * p.control_period_s)
    if p.torque_lag_s == 0:
        flow[4] = np.eye(6)[5]
    # Without the encoder's grid and the torque limit the drive is linear.
    drive = core.drive_of(p)._replace(torque_limit=math.inf, resolution=0.0)
    rows = core.control_matrix(delay, drive, core.constants_of(p, 0.0))
    held = np.vstack([np.eye(5, 9 + delay), rows[:1]])
    return np.vstack([(flow @ held)[:5], rows[1:]])


def _refuse(what: str, advice: str) -> None:
    raise ValueError(f"simulate: {what}; {advice}")


def _whole(ratio: float) -> bool:
    return ratio > 0.5 and abs(ratio - round(ratio)) < 1e-6


def check_values(p: JointParameters) -> None:
    """Refuse parameters without physical meaning."""
    positive = {"gear_ratio", "motor_inertia_kgm2", "load_inertia_kgm2", "stiffness_nm_per_rad"}
    positive |= {"alpha_per_rad", "control_period_s", "commanded_speed_rps", "torque_limit_nm"}
    any_sign = {"start_angle_rad", "leaky_gain_nm_per_rad"}
    for name in (f.name for f in fields(p) if f.name != "disturbances"):
        value = getattr(p, name)
        if not math.isfinite(value) and not (name == "torque_limit_nm" and value > 0):
            hint = " (clamped=True has the sharp edge)" if name == "alpha_per_rad" else ""
            _refuse(f"{name} is {value}", f"give a finite number{hint}")
        if name in positive and value <= 0:
            _refuse(f"{name} is {value}", "give a positive number")
        if name not in any_sign and value < 0:
            _refuse(f"{name} is {value}", "give zero or a positive number")
    for wave in p.disturbances:
        if not (wave.order > 0 and all(math.isfinite(value) for value in astuple(wave))):
            _refuse(f"{wave}", "give finite numbers and an order above zero")
    for name in ("control_delay_periods", "encoder_bits"):
        if getattr(p, name) != int(getattr(p, name)):
            _refuse(f"{name} is {getattr(p, name)}", "give a whole number")
    if p.lead_s > 0 and not _whole(p.lead_s / p.control_period_s):
        _refuse(
            f"lead_s {p.lead_s} is no multiple of control_period_s {p.control_period_s}", "round it"
        )


def check_run(
    p: JointParameters, delta: float, duration: float, sample: float, step: float
) -> None:
    """Refuse a backlash, a duration, a sampling or a step that cannot be simulated."""
    if not 0 <= delta < TURN / 2:
        _refuse(f"delta_rad is {delta}", "the gap 2 * delta must be between nothing and a turn")
    for name, time in (("duration_s", duration), ("sample_s", sample), ("step_s", step)):
        if not 0 < time < math.inf:
            _refuse(f"{name} is {time}", "give a positive time")
    for name, time in (("control_period_s", p.control_period_s), ("sample_s", sample)):
        if not _whole(time / step):
            _refuse(
                f"{name} {time} is no multiple of step_s {step}", "choose a step that divides it"
            )
    compliance = 1 / p.load_inertia_kgm2 + 1 / p.gear_ratio**2 / p.motor_inertia_kgm2
    contact = math.sqrt(p.stiffness_nm_per_rad * compliance)
    shaking = p.commanded_speed_rad_per_s * max(
        (wave.order for wave in p.disturbances), default=0.0
    )
    fastest = max(contact, shaking, 1 / p.torque_lag_s if p.torque_lag_s > 0 else 0.0)
    if step * fastest > 0.5:
        what = f"stiffness, torque lag or disturbances, {fastest:.4g} rad/s at the fastest"
        _refuse(f"step_s {step} is too large for {what}", f"take at most {0.5 / fastest:.2g} s")


# One joint is simulated many times; the matrix exponentials are slow where BLAS threads compete.
@lru_cache(maxsize=16)
def check_stability(p: JointParameters) -> None:
    """Refuse an unstable speed loop, with the teeth in contact or inside the gap."""
    for in_contact, where in (
        (True, "with the teeth in contact"),
        (False, "of the motor inside the gap"),
    ):
        growth = np.abs(np.linalg.eigvals(closed_loop_matrix(p, in_contact=in_contact))).max()
        # Free positions and speeds are repeated modes of 1, which rounding spreads a little.
        if growth > 1 + 1e-4:
            _refuse(
                f"the speed loop {where} is unstable (grows {growth:.4f} times each control period)",
                "lower the gains, control_period_s or control_delay_periods",
            )
