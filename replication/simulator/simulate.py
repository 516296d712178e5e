"""The robotic joint: two inertias, backlash after equations 8 and 9, gravity, and a digital drive.

The motor (inertia J_m) drives the load (J_l) through a gear of ratio N and an elastic coupling with backlash,
all written on the load side: delta_theta = theta_m / N - theta_l, gap 2 * delta. A digital drive with a
position gain around a speed loop holds a constant commanded speed while gravity turns with the load, so that
the gap opens and closes twice a turn.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass, fields
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

from replication.simulator import core
from replication.simulator.parameters import (
    TURN,
    Disturbance,
    JointParameters,
    identified_joint,
    joint_from_ratios,
    with_ratios,
)

__all__ = [
    "Disturbance",
    "DivergenceError",
    "JointParameters",
    "SimulatedJoint",
    "closed_loop_matrix",
    "encoder_position",
    "identified_joint",
    "joint_from_ratios",
    "settled_peak_rps",
    "simulate",
    "simulate_many",
    "with_ratios",
]


class DivergenceError(ArithmeticError):
    """A simulated joint left every plausible speed; the message says when and at which backlash."""


def encoder_position(position_rad: ArrayLike, bits: int = 19) -> NDArray[np.float64]:
    """Position as an absolute encoder of `bits` bits per turn reports it [rad], rounded down to its grid."""
    step = TURN / 2**bits
    return np.floor(np.asarray(position_rad, dtype=float) / step) * step


@dataclass(frozen=True, eq=False)
class SimulatedJoint:
    """What the joint did; n samples from t = 0.

    Attributes
    ----------
    delta_rad : float
        Half the gap.
    time_s, motor_position_rad, motor_speed_rad_per_s, motor_torque_nm : ndarray, shape (n,)
    load_position_rad, load_speed_rad_per_s : ndarray, shape (n,)
        The true state. The commanded motor position is N times the start angle at t = 0.
    gap_state : ndarray of int, shape (n,)
        1 when the motor drives the load, -1 when the load drives the motor, 0 inside the gap.
    impact_time_s, separation_time_s : ndarray
        When the teeth met and parted, located to far less than a step.
    impact_side : ndarray of int
        The gap state after each impact.
    """

    delta_rad: float
    time_s: NDArray[np.float64]
    motor_position_rad: NDArray[np.float64]
    motor_speed_rad_per_s: NDArray[np.float64]
    motor_torque_nm: NDArray[np.float64]
    load_position_rad: NDArray[np.float64]
    load_speed_rad_per_s: NDArray[np.float64]
    gap_state: NDArray[np.int64]
    impact_time_s: NDArray[np.float64]
    impact_side: NDArray[np.int64]
    separation_time_s: NDArray[np.float64]

    @property
    def motor_speed_rps(self) -> NDArray[np.float64]:
        """Motor speed [turns/s]."""
        return self.motor_speed_rad_per_s / TURN


def core_constants(p: JointParameters, delta: float) -> tuple:
    """Parameters of the joint in the order that `joint_core` takes them."""
    return (
        p.gear_ratio,
        p.commanded_speed_rad_per_s,
        p.start_angle_rad,
        p.motor_inertia_kgm2,
        p.load_inertia_kgm2,
        p.stiffness_nm_per_rad,
        p.damping_nms_per_rad,
        p.alpha_per_rad,
        delta,
        float(p.clamped),
        p.gravity_torque_nm,
        p.motor_viscous_nms_per_rad,
        p.load_viscous_nms_per_rad,
        p.motor_coulomb_nm,
        p.load_coulomb_nm,
        p.torque_lag_s,
        _waves(p) if p.disturbances else None,
    )


def _waves(p: JointParameters) -> NDArray[np.float64]:
    """Disturbances as `joint_core.disturbance` takes them, a row each.

    A transmission error e shakes the load's side of the coupling with its second derivative.
    """
    rows = [
        (
            d.order,
            d.motor_torque_nm,
            d.load_torque_nm / p.load_inertia_kgm2
            - d.transmission_error_rad * (d.order * p.commanded_speed_rad_per_s) ** 2,
            d.transmission_error_rad,
            d.phase_rad,
        )
        for d in p.disturbances
    ]
    return np.array(rows, dtype=float).reshape(-1, 5)


def core_drive(p: JointParameters) -> tuple:
    """Parameters of the drive in the order that `joint_core` takes them."""
    return (
        p.position_gain_per_s,
        p.speed_gain_nms_per_rad,
        p.integral_gain_nm_per_rad,
        p.derivative_gain_nms2_per_rad,
        p.leaky_gain_nm_per_rad,
        p.leaky_rate_per_s,
        p.control_period_s,
        p.torque_limit_nm,
        TURN / 2**p.encoder_bits if p.encoder_bits else 0.0,
        float(p.speed_by_differencing),
    )


def closed_loop_matrix(parameters: JointParameters, *, in_contact: bool = True) -> NDArray[np.float64]:
    """One control period of the linear joint without gravity, as a matrix.

    The state is motor position, motor speed, load position, load speed and torque, as deviations, then the
    drive's memory. Its eigenvalues are exp(s * control_period_s) of the joint's modes s.

    Parameters
    ----------
    parameters : JointParameters
    in_contact : bool
        Couple the inertias by K_s and D_s (teeth in contact), or not at all (inside the gap).

    Returns
    -------
    ndarray, shape (9 + delay, 9 + delay)
    """
    p = parameters
    n, period, delay = p.gear_ratio, p.control_period_s, p.control_delay_periods
    ks, ds = (p.stiffness_nm_per_rad, p.damping_nms_per_rad) if in_contact else (0.0, 0.0)
    coupling = np.array([ks / n, ds / n, -ks, -ds])
    a = np.zeros((6, 6))
    a[0, 1] = a[2, 3] = 1.0
    a[1, :4], a[3, :4] = -coupling / n / p.motor_inertia_kgm2, coupling / p.load_inertia_kgm2
    a[1, 1] -= p.motor_viscous_nms_per_rad / p.motor_inertia_kgm2
    a[3, 3] -= p.load_viscous_nms_per_rad / p.load_inertia_kgm2
    a[1, 4 if p.torque_lag_s > 0 else 5] = 1 / p.motor_inertia_kgm2
    if p.torque_lag_s > 0:
        a[4, 4:] = np.array([-1.0, 1.0]) / p.torque_lag_s
    flow = expm(a * period)
    if p.torque_lag_s == 0:
        flow[4] = np.eye(6)[5]
    # Without the encoder's grid and the torque limit the drive is linear.
    drive = (*core_drive(p)[:7], math.inf, 0.0, float(p.speed_by_differencing))
    rows = core.control_matrix(delay, drive, core_constants(p, 0.0))
    held = np.vstack([np.eye(5, 9 + delay), rows[:1]])
    return np.vstack([(flow @ held)[:5], rows[1:]])


def _refuse(what: str, advice: str) -> None:
    raise ValueError(f"simulate: {what}; {advice}")


def _whole(ratio: float) -> bool:
    return ratio > 0.5 and abs(ratio - round(ratio)) < 1e-6


def _check_values(p: JointParameters) -> None:
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
        _refuse(f"lead_s {p.lead_s} is no multiple of control_period_s {p.control_period_s}", "round it")


def _check_run(p: JointParameters, delta: float, duration: float, sample: float, step: float) -> None:
    if not 0 <= delta < TURN / 2:
        _refuse(f"delta_rad is {delta}", "the gap 2 * delta must be between nothing and a turn")
    for name, time in (("duration_s", duration), ("sample_s", sample), ("step_s", step)):
        if not 0 < time < math.inf:
            _refuse(f"{name} is {time}", "give a positive time")
    for name, time in (("control_period_s", p.control_period_s), ("sample_s", sample)):
        if not _whole(time / step):
            _refuse(f"{name} {time} is no multiple of step_s {step}", "choose a step that divides it")
    compliance = 1 / p.load_inertia_kgm2 + 1 / p.gear_ratio**2 / p.motor_inertia_kgm2
    contact = math.sqrt(p.stiffness_nm_per_rad * compliance)
    shaking = p.commanded_speed_rad_per_s * max((wave.order for wave in p.disturbances), default=0.0)
    fastest = max(contact, shaking, 1 / p.torque_lag_s if p.torque_lag_s > 0 else 0.0)
    if step * fastest > 0.5:
        _refuse(
            f"step_s {step} is too large for stiffness, torque lag or disturbances, {fastest:.4g} rad/s at the fastest",
            f"take at most {0.5 / fastest:.2g} s",
        )


# One joint is simulated many times; the matrix exponentials are slow where BLAS threads compete.
@lru_cache(maxsize=16)
def _check_stability(p: JointParameters) -> None:
    for in_contact, where in ((True, "with the teeth in contact"), (False, "of the motor inside the gap")):
        growth = np.abs(np.linalg.eigvals(closed_loop_matrix(p, in_contact=in_contact))).max()
        # Free positions and speeds are repeated modes of 1, which rounding spreads a little.
        if growth > 1 + 1e-4:
            _refuse(
                f"the speed loop {where} is unstable (grows {growth:.4f} times each control period)",
                "lower the gains, control_period_s or control_delay_periods",
            )


def start_state(p: JointParameters, delta: float) -> tuple[tuple[float, ...], int]:
    """State and region at -lead_s: commanded speed, teeth in contact, torques in balance."""
    load_speed = p.commanded_speed_rad_per_s / p.gear_ratio
    angle = p.start_angle_rad - load_speed * p.lead_s
    torque = p.gravity_torque_nm * math.sin(angle) + p.load_viscous_nms_per_rad * load_speed + p.load_coulomb_nm
    motor = p.motor_viscous_nms_per_rad * p.commanded_speed_rad_per_s + p.motor_coulomb_nm
    side = -1 if torque < 0 else 1
    twist = side * delta + torque / p.stiffness_nm_per_rad
    return (0.0, 0.0, -twist, 0.0, torque / p.gear_ratio + motor), 3 if side > 0 else 0


def simulate(
    parameters: JointParameters,
    delta_rad: float,
    *,
    duration_s: float = 4.8,
    sample_s: float = 2e-3,
    step_s: float = 1e-4,
) -> SimulatedJoint:
    """Simulate the joint at a constant commanded speed.

    A classical Runge-Kutta method of fixed step; a step that crosses an edge of the gap (or its middle, where
    equation 9 jumps) is split where it does, so the order of convergence survives the contact.

    Parameters
    ----------
    parameters : JointParameters
    delta_rad : float
        Half the gap [rad], load side.
    duration_s, sample_s, step_s : float
        Length of the record, its sampling, and the step. With ``sample_s=step_s`` nothing is missed between
        samples.

    Returns
    -------
    SimulatedJoint
        ``round(duration_s / sample_s) + 1`` samples.

    Raises
    ------
    ValueError
        If a parameter has no physical meaning, the drive is unstable, or the step is too large.
    DivergenceError
        If the joint runs away all the same.
    """
    return simulate_many(parameters, [delta_rad], duration_s=duration_s, sample_s=sample_s, step_s=step_s, threads=1)[0]


def _simulate_checked(p: JointParameters, delta: float, duration: float, sample: float, step: float) -> SimulatedJoint:
    y, region = start_state(p, delta)
    every, skip = round(sample / step), round(p.lead_s / step)
    samples = round(duration / sample) + 1
    record, gap = np.empty((samples, 5)), np.empty(samples, dtype=np.int64)
    steps = skip + (samples - 1) * every
    events = np.empty((steps + 1, 2))
    per_period, delay = round(p.control_period_s / step), int(p.control_delay_periods)
    status, used = core.run(
        y,
        region,
        steps,
        step,
        skip,
        every,
        per_period,
        delay,
        core_constants(p, delta),
        core_drive(p),
        record,
        gap,
        events,
    )
    if status >= 0:
        raise DivergenceError(
            f"simulate: the joint diverged at t = {(status - skip) * step:.4f} s with delta_rad = {delta}; "
            "lower the gains or the step"
        )
    time = np.arange(samples) * sample
    commanded = p.commanded_speed_rad_per_s * time
    error, error_rate = _transmission_error(p, time)
    events = events[:used][events[:used, 0] >= 0]
    impact = events[:, 1] != 0
    return SimulatedJoint(
        delta_rad=delta,
        time_s=time,
        motor_position_rad=p.gear_ratio * p.start_angle_rad + commanded + record[:, 0],
        motor_speed_rad_per_s=p.commanded_speed_rad_per_s + record[:, 1],
        motor_torque_nm=record[:, 4].copy(),
        load_position_rad=p.start_angle_rad + commanded / p.gear_ratio + record[:, 2] - error,
        load_speed_rad_per_s=p.commanded_speed_rad_per_s / p.gear_ratio + record[:, 3] - error_rate,
        gap_state=gap,
        impact_time_s=events[impact, 0],
        impact_side=events[impact, 1].astype(np.int64),
        separation_time_s=events[~impact, 0],
    )


def _transmission_error(p: JointParameters, time: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Transmission error [rad] and its rate [rad/s], which the core keeps in the load's position and speed."""
    error, rate = np.zeros_like(time), np.zeros_like(time)
    for wave in p.disturbances:
        frequency = wave.order * p.commanded_speed_rad_per_s
        angle = frequency * time + wave.phase_rad
        error += wave.transmission_error_rad * np.sin(angle)
        rate += wave.transmission_error_rad * frequency * np.cos(angle)
    return error, rate


def simulate_many(
    parameters: JointParameters,
    delta_rad: Sequence[float],
    *,
    duration_s: float = 4.8,
    sample_s: float = 2e-3,
    step_s: float = 1e-4,
    threads: int = 2,
) -> list[SimulatedJoint]:
    """Simulate several backlashes at once, each as `simulate` does.

    Parameters
    ----------
    parameters : JointParameters
    delta_rad : sequence of float
        Half the gap of each run [rad].
    duration_s, sample_s, step_s : float
        As for `simulate`.
    threads : int
        Runs at the same time; the results are the same bytes for any number.

    Returns
    -------
    list of SimulatedJoint
        In the order of `delta_rad`.

    Raises
    ------
    ValueError, DivergenceError
        As `simulate` does.
    """
    _check_values(parameters)
    for delta in delta_rad:
        _check_run(parameters, delta, duration_s, sample_s, step_s)
    _check_stability(parameters)
    with ThreadPoolExecutor(threads) as pool:
        jobs = [
            pool.submit(_simulate_checked, parameters, float(delta), duration_s, sample_s, step_s)
            for delta in delta_rad
        ]
        return [job.result() for job in jobs]


def settled_peak_rps(record: SimulatedJoint, parameters: JointParameters) -> float:
    """Largest motor speed above the commanded one after the first turn [turns/s]: the theoretical A."""
    settled = record.time_s >= parameters.turn_period_s
    return float(record.motor_speed_rps[settled].max() - parameters.commanded_speed_rps)
