"""Compiled core of the joint simulator: the equations of motion, the drive, and the integrator.

Units are SI; the state is (motor position, motor speed, load position, load speed, motor torque),
positions and speeds as deviations from the commanded motion, which keeps every digit for the small
signal.
"""

import math
from typing import NamedTuple

import numpy as np

from replication.arrays import FloatArray, IntArray
from replication.compiling import njit
from replication.simulator.parameters import TURN, JointParameters

# Beyond this multiple of the commanded speed no joint of this kind is running any more.
DIVERGED = 1e3


class Constants(NamedTuple):
    """The joint as the equations of motion take it.

    `waves` has one row per disturbance, or is None.
    """

    gear_ratio: float
    omega: float
    start_angle: float
    motor_inertia: float
    load_inertia: float
    ks: float
    ds: float
    alpha: float
    delta: float
    clamped: float
    gravity: float
    motor_viscous: float
    load_viscous: float
    motor_coulomb: float
    load_coulomb: float
    torque_lag: float
    waves: FloatArray | None


class Drive(NamedTuple):
    """The drive's gains, its period, and what bounds its torque and its encoder (0: no encoder)."""

    position_gain: float
    speed_gain: float
    integral_gain: float
    derivative_gain: float
    leaky_gain: float
    leaky_rate: float
    period: float
    torque_limit: float
    resolution: float
    differencing: float


class Schedule(NamedTuple):
    """The steps of a run, the first `skip` of them before t = 0, and how many make a sample and a control period."""

    steps: int
    step: float
    skip: int
    every: int
    per_period: int
    delay: int  # control periods until a torque acts


class Log(NamedTuple):
    """What a run writes: states and gap states at the samples; times of contacts, and the side met or 0 when parted."""

    states: FloatArray
    gap: IntArray
    events: FloatArray


def constants_of(p: JointParameters, delta_rad: float) -> Constants:
    """Constants of a joint with a backlash."""
    return Constants(
        p.gear_ratio,
        p.commanded_speed_rad_per_s,
        p.start_angle_rad,
        p.motor_inertia_kgm2,
        p.load_inertia_kgm2,
        p.stiffness_nm_per_rad,
        p.damping_nms_per_rad,
        p.alpha_per_rad,
        delta_rad,
        float(p.clamped),
        p.gravity_torque_nm,
        p.motor_viscous_nms_per_rad,
        p.load_viscous_nms_per_rad,
        p.motor_coulomb_nm,
        p.load_coulomb_nm,
        p.torque_lag_s,
        _waves(p) if p.disturbances else None,
    )


def _waves(p: JointParameters) -> FloatArray:
    """Disturbances as `disturbance` takes them, one row each.

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


def drive_of(p: JointParameters) -> Drive:
    """Drive of a joint."""
    return Drive(
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


def start_state(p: JointParameters, delta_rad: float) -> tuple[tuple[float, ...], int]:
    """State and region at -lead_s: commanded speed, teeth in contact, torques in balance."""
    load_speed = p.commanded_speed_rad_per_s / p.gear_ratio
    angle = p.start_angle_rad - load_speed * p.lead_s
    torque = (
        p.gravity_torque_nm * math.sin(angle)
        + p.load_viscous_nms_per_rad * load_speed
        + p.load_coulomb_nm
    )
    motor = p.motor_viscous_nms_per_rad * p.commanded_speed_rad_per_s + p.motor_coulomb_nm
    side = -1 if torque < 0 else 1
    twist = side * delta_rad + torque / p.stiffness_nm_per_rad
    return (0.0, 0.0, -twist, 0.0, torque / p.gear_ratio + motor), 3 if side > 0 else 0


@njit
def stiffness(x, delta, ks, alpha):
    """K_BL of equation 8, its two arctangents written as the one angle they make."""
    return (
        ks
        / np.pi
        * (np.pi - np.arctan2(2 * alpha * delta, 1 + alpha**2 * (x - delta) * (x + delta)))
    )


@njit
def torque(x, v, region, c):
    """tau_l of equation 9 or of the clamped dead zone.

    The region (0 to 3 from the left) replaces sign().
    """
    if not c.clamped > 0:
        edge = c.delta if region >= 2 else -c.delta
        return (x - edge + c.ds / c.ks * v) * stiffness(x, c.delta, c.ks, c.alpha)
    if region == 3:
        return max(0.0, c.ks * (x - c.delta) + c.ds * v)
    if region == 0:
        return min(0.0, c.ks * (x + c.delta) + c.ds * v)
    return 0.0


@njit(inner=True)
def disturbance(t, motor, omega, waves):
    """Sum of the disturbances: torque on the motor, acceleration of the load's side, transmission error.

    The motor's follow the motor's own angle, the load's the commanded motion. None compiles to
    nothing.
    """
    if waves is None:
        return 0.0, 0.0, 0.0
    ripple = push = error = 0.0
    for k in range(waves.shape[0]):
        if waves[k, 1] != 0:
            ripple += waves[k, 1] * np.sin(waves[k, 0] * (omega * t + motor) + waves[k, 4])
        if waves[k, 2] != 0:
            wave = np.sin(waves[k, 0] * omega * t + waves[k, 4])
            push += waves[k, 2] * wave
            error += waves[k, 3] * wave
    return ripple, push, error


@njit
def derivative(t, y, command, region, c):
    """Rates of the state; within a region they are smooth.

    y[2] is the load's position plus the transmission error, so that the displacement is y[0] / n -
    y[2] with or without one, and the error acts as an acceleration.
    """
    n, omega = c.gear_ratio, c.omega
    ripple, push, error = disturbance(t, y[0], omega, c.waves)
    x, v = y[0] / n - y[2], y[1] / n - y[3]
    tau = torque(x, v, region, c)
    motor_speed, load_speed = omega + y[1], omega / n + y[3]
    gravity = c.gravity * np.sin(c.start_angle + omega / n * t + y[2] - error)
    motor_friction = c.motor_viscous * motor_speed, c.motor_coulomb * np.sign(motor_speed)
    load_friction = c.load_viscous * load_speed, c.load_coulomb * np.sign(load_speed)
    motor_torque = (
        (y[4] if c.torque_lag > 0 else command)
        - tau / n
        - motor_friction[0]
        - motor_friction[1]
        + ripple
    )
    load_torque = tau - gravity - load_friction[0] - load_friction[1]
    torque_rate = (command - y[4]) / c.torque_lag if c.torque_lag > 0 else 0.0
    return (
        y[1],
        motor_torque / c.motor_inertia,
        y[3],
        load_torque / c.load_inertia + push,
        torque_rate,
    )


@njit(inner=True)
def along(y, h, k):
    """State after a time h at the rates k."""
    return y[0] + h * k[0], y[1] + h * k[1], y[2] + h * k[2], y[3] + h * k[3], y[4] + h * k[4]


@njit(inner=True)
def _runge_kutta(t, y, h, command, region, c):
    k1 = derivative(t, y, command, region, c)
    k2 = derivative(t + h / 2, along(y, h / 2, k1), command, region, c)
    k3 = derivative(t + h / 2, along(y, h / 2, k2), command, region, c)
    k4 = derivative(t + h, along(y, h, k3), command, region, c)
    return along(along(along(along(y, h / 6, k1), h / 3, k2), h / 3, k3), h / 6, k4)


@njit(inner=True)
def locate(t, y, h, end, edge, command, region, c):
    """Part of the step after which the displacement meets the edge, and the state there (Illinois method)."""
    lo, hi = 0.0, h
    side = 0
    g_lo = y[0] / c.gear_ratio - y[2] - edge
    g_hi = end[0] / c.gear_ratio - end[2] - edge
    if g_lo * g_hi >= 0:
        return 0.0, y
    s = h
    for _ in range(60):
        s = (lo * g_hi - hi * g_lo) / (g_hi - g_lo)
        end = _runge_kutta(t, y, s, command, region, c)
        g = end[0] / c.gear_ratio - end[2] - edge
        if abs(g) < 1e-14:
            break
        if g * g_hi > 0:
            hi, g_hi = s, g
            g_lo *= 0.5 if side == -1 else 1.0
            side = -1
        else:
            lo, g_lo = s, g
            g_hi *= 0.5 if side == 1 else 1.0
            side = 1
    return s, end


@njit
def control(t, y, memory, ring, count, drive, c):
    """Sample the drive: read the encoder, queue a torque, return the one to hold."""
    commanded = c.gear_ratio * c.start_angle + c.omega * t
    position, speed = y[0], y[1]
    if drive.resolution > 0:
        position = (
            np.floor((commanded + position) / drive.resolution) * drive.resolution - commanded
        )
    if drive.differencing > 0 and count > 0:
        speed = (position - memory[3]) / drive.period
    error = -drive.position_gain * position - speed
    integral = memory[0] + drive.integral_gain * drive.period * error
    leaky = memory[1] - drive.period * (speed + drive.leaky_rate * memory[1])
    damping = drive.derivative_gain * (speed - memory[2]) / drive.period
    command = drive.speed_gain * error + integral + drive.leaky_gain * leaky - damping
    if abs(command) > drive.torque_limit:
        command = np.sign(command) * drive.torque_limit
    else:
        memory[0], memory[1] = integral, leaky
    memory[2], memory[3] = speed, position
    ring[count % ring.size] = command
    return ring[(count + 1) % ring.size]


def control_matrix(delay: int, drive: Drive, c: Constants) -> FloatArray:
    """Return a linear drive as a matrix, from all states to the torque to hold and the next memory.

    `control` is called here as it is written, not compiled.
    """
    size = 9 + delay
    rows = np.zeros((5 + delay, size))
    for j in range(size):
        unit = np.zeros(size + 1)
        unit[j] = 1.0
        memory, ring = unit[5:9].copy(), unit[9:].copy()
        y = (unit[0], unit[1], unit[2], unit[3], unit[4])
        rows[0, j] = control.py_func(0.0, y, memory, ring, max(delay, 1), drive, c)
        rows[1:5, j] = memory
        rows[5:, j] = ring[1:]
    return rows


@njit(nogil=True)
def run(y, region, schedule, c, drive, log):
    """Integrate into the log.

    Returns the step at which the run diverged, or -1, and the number of events.
    """
    ring, memory = np.full(schedule.delay + 1, y[4]), np.array([y[4], 0.0, 0.0, y[0]])
    edges = (-np.inf, -c.delta, 0.0, c.delta, np.inf)
    used = row = 0
    command = y[4]
    for i in range(schedule.steps + 1):
        t = (i - schedule.skip) * schedule.step
        left = schedule.step
        if i >= schedule.skip and (i - schedule.skip) % schedule.every == 0:
            for j in range(5):
                log.states[row, j] = y[j]
            log.gap[row] = gap_state(region)
            row += 1
        if i % schedule.per_period == 0:
            command = control(t, y, memory, ring, i // schedule.per_period, drive, c)
            if c.torque_lag == 0:
                y = (y[0], y[1], y[2], y[3], command)
        end = _runge_kutta(t, y, left, command, region, c)
        for _ in range(16):
            x = end[0] / c.gear_ratio - end[2]
            up = x > edges[region + 1]
            if not up and x >= edges[region]:
                break
            edge = edges[region + 1] if up else edges[region]
            s, y = locate(t, y, left, end, edge, command, region, c)
            before = region
            region += 1 if up else -1
            t += s
            left -= s
            touches = before in (0, 3) or region in (0, 3)
            if c.delta > 0 and touches and used < len(log.events):
                log.events[used, 0] = t
                log.events[used, 1] = gap_state(region)
                used += 1
            end = _runge_kutta(t, y, left, command, region, c)
        y = end
        if not abs(y[1]) < DIVERGED * c.omega:
            return i, used
    return -1, used


@njit(inner=True)
def gap_state(region):
    """1 where the motor drives the load, -1 where the load drives the motor, 0 inside the gap."""
    return 1 if region == 3 else (-1 if region == 0 else 0)
