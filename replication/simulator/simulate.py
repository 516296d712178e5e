"""The robotic joint: two inertias, backlash after equations 8 and 9, gravity, and a digital drive.

The motor (inertia J_m) drives the load (J_l) through a gear of ratio N and an elastic coupling with
backlash, all written on the load side: delta_theta = theta_m / N - theta_l, gap 2 * delta. A
digital drive with a position gain around a speed loop holds a constant commanded speed while
gravity turns with the load, so that the gap opens and closes twice a turn.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from replication.arrays import FloatArray, IntArray
from replication.simulator import checks, core
from replication.simulator.parameters import TURN, JointParameters


class DivergenceError(ArithmeticError):
    """A simulated joint left every plausible speed; the message says when and at which backlash."""


def encoder_position(position_rad: ArrayLike, bits: int = 19) -> FloatArray:
    """Position [rad] as an absolute encoder of `bits` bits a turn reports it, rounded down."""
    step = TURN / 2**bits
    return np.floor(np.asarray(position_rad, dtype=float) / step) * step


def encoder_speed_rps(position_rad: ArrayLike, bits: int, sample_s: float) -> FloatArray:
    """Speed [rps] as a controller differences it from an encoder's positions; a sample shorter."""
    return np.diff(encoder_position(position_rad, bits)) / sample_s / TURN


@dataclass(frozen=True, eq=False)
class SimulatedJoint:
    """What the joint did: the true state at n samples from t = 0, and its contacts."""

    delta_rad: float  # half the gap
    time_s: FloatArray
    motor_position_rad: FloatArray  # the commanded one is N times the start angle at t = 0
    motor_speed_rad_per_s: FloatArray
    motor_torque_nm: FloatArray
    load_position_rad: FloatArray
    load_speed_rad_per_s: FloatArray
    # 1: the motor drives the load, -1: the load drives the motor, 0: inside the gap.
    gap_state: IntArray
    impact_time_s: FloatArray  # when the teeth met, located to far less than a step
    impact_side: IntArray  # the gap state after each impact
    separation_time_s: FloatArray

    @property
    def motor_speed_rps(self) -> FloatArray:
        """Motor speed [turns/s]."""
        return self.motor_speed_rad_per_s / TURN


def simulate(
    parameters: JointParameters,
    delta_rad: float,
    *,
    duration_s: float = 4.8,
    sample_s: float = 2e-3,
    step_s: float = 1e-4,
) -> SimulatedJoint:
    """Simulate the joint at a constant commanded speed.

    A classical Runge-Kutta method of fixed step; a step that crosses an edge of the gap (or its
    middle, where equation 9 jumps) is split where it does, so the order of convergence survives the
    contact.

    Parameters
    ----------
    delta_rad : float
        Half the gap [rad], load side.
    duration_s, sample_s, step_s : float
        Length of the record, its sampling, and the step; with ``sample_s=step_s`` nothing is missed between samples.

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
    (found,) = simulate_many(
        parameters, [delta_rad], duration_s=duration_s, sample_s=sample_s, step_s=step_s, threads=1
    )
    return found


def _simulate_checked(
    p: JointParameters, delta: float, duration: float, sample: float, step: float
) -> SimulatedJoint:
    y, region = core.start_state(p, delta)
    every = round(sample / step)
    skip = round(p.lead_s / step)
    samples = round(duration / sample) + 1
    steps = skip + (samples - 1) * every
    per_period = round(p.control_period_s / step)
    schedule = core.Schedule(steps, step, skip, every, per_period, int(p.control_delay_periods))
    record = np.empty((samples, 5))
    gap = np.empty(samples, dtype=np.int64)
    events = np.empty((steps + 1, 2))
    log = core.Log(record, gap, events)
    c = core.constants_of(p, delta)
    status, used = core.run(y, region, schedule, c, core.drive_of(p), log)
    if status >= 0:
        at = f"t = {(status - skip) * step:.4f} s with delta_rad = {delta}"
        raise DivergenceError(f"simulate: the joint diverged at {at}; lower the gains or the step")
    time = np.arange(samples, dtype=float) * sample
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


def _transmission_error(p: JointParameters, time: FloatArray) -> tuple[FloatArray, ...]:
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
    deltas_rad: Sequence[float],
    *,
    duration_s: float = 4.8,
    sample_s: float = 2e-3,
    step_s: float = 1e-4,
    threads: int = 2,
) -> list[SimulatedJoint]:
    """Simulate several backlashes, each as `simulate` does.

    The same bytes for any number of threads.
    """

    def run(delta_rad: float) -> SimulatedJoint:
        return _simulate_checked(parameters, float(delta_rad), duration_s, sample_s, step_s)

    checks.check_values(parameters)
    for delta_rad in deltas_rad:
        checks.check_run(parameters, delta_rad, duration_s, sample_s, step_s)
    checks.check_stability(parameters)
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(run, deltas_rad))


def settled_peak_rps(record: SimulatedJoint, parameters: JointParameters) -> float:
    """Largest motor speed above the commanded one after the first turn [rps]: the theoretical A."""
    settled = record.time_s >= parameters.turn_period_s
    return float(record.motor_speed_rps[settled].max() - parameters.commanded_speed_rps)
