"""Compiled core of the joint simulator: the equations of motion, the drive, and the integrator.

Units are SI; the state is (motor position, motor speed, load position, load speed, motor torque), positions
and speeds as deviations from the commanded motion, which keeps every digit for the small signal.
"""

import numba as nb
import numpy as np

# Beyond this multiple of the commanded speed no joint of this kind is running any more.
DIVERGED = 1e3


@nb.njit(cache=True)
def stiffness(x, delta, ks, alpha):
    """K_BL of equation 8, its two arctangents written as the one angle they make."""
    return ks / np.pi * (np.pi - np.arctan2(2 * alpha * delta, 1 + alpha**2 * (x - delta) * (x + delta)))


@nb.njit(cache=True)
def torque(x, v, region, delta, ks, ds, alpha, clamped):
    """tau_l of equation 9 or of the clamped dead zone; the region (0 to 3 from the left) replaces sign()."""
    if not clamped:
        edge = delta if region >= 2 else -delta
        return (x - edge + ds / ks * v) * stiffness(x, delta, ks, alpha)
    if region == 3:
        return max(0.0, ks * (x - delta) + ds * v)
    if region == 0:
        return min(0.0, ks * (x + delta) + ds * v)
    return 0.0


@nb.njit(cache=True)
def disturbance(t, motor, omega, waves):
    """Sum of the disturbances: torque on the motor, acceleration of the load's side, transmission error.

    The motor's follow the motor's own angle, the load's the commanded motion. None compiles to nothing.
    """
    if waves is None:
        return 0.0, 0.0, 0.0
    ripple, push, error = 0.0, 0.0, 0.0
    for k in range(waves.shape[0]):
        if waves[k, 1] != 0:
            ripple += waves[k, 1] * np.sin(waves[k, 0] * (omega * t + motor) + waves[k, 4])
        if waves[k, 2] != 0:
            wave = np.sin(waves[k, 0] * omega * t + waves[k, 4])
            push += waves[k, 2] * wave
            error += waves[k, 3] * wave
    return ripple, push, error


@nb.njit(cache=True)
def derivative(t, y, command, region, c):
    """Rates of the state; within a region they are smooth.

    y[2] is the load's position plus the transmission error, so that the displacement is y[0] / n - y[2] with or
    without one, and the error acts as an acceleration.
    """
    n, omega, theta0, jm, jl, ks, ds, alpha, delta, clamped, mgr, bm, bl, cm, cl, lag, waves = c
    ripple, push, error = disturbance(t, y[0], omega, waves)
    tau = torque(y[0] / n - y[2], y[1] / n - y[3], region, delta, ks, ds, alpha, clamped > 0)
    motor_speed, load_speed = omega + y[1], omega / n + y[3]
    gravity = mgr * np.sin(theta0 + omega / n * t + y[2] - error)
    motor_torque = (y[4] if lag > 0 else command) - tau / n - bm * motor_speed - cm * np.sign(motor_speed) + ripple
    load_torque = tau - gravity - bl * load_speed - cl * np.sign(load_speed)
    torque_rate = (command - y[4]) / lag if lag > 0 else 0.0
    return y[1], motor_torque / jm, y[3], load_torque / jl + push, torque_rate


@nb.njit(cache=True)
def _along(y, h, k):
    return y[0] + h * k[0], y[1] + h * k[1], y[2] + h * k[2], y[3] + h * k[3], y[4] + h * k[4]


@nb.njit(cache=True)
def _runge_kutta(t, y, h, command, region, c):
    k1 = derivative(t, y, command, region, c)
    k2 = derivative(t + h / 2, _along(y, h / 2, k1), command, region, c)
    k3 = derivative(t + h / 2, _along(y, h / 2, k2), command, region, c)
    k4 = derivative(t + h, _along(y, h, k3), command, region, c)
    return _along(_along(_along(_along(y, h / 6, k1), h / 3, k2), h / 3, k3), h / 6, k4)


@nb.njit(cache=True)
def _locate(t, y, h, end, edge, command, region, c):
    """Part of the step after which the displacement meets the edge, and the state there (Illinois method)."""
    lo, hi, side = 0.0, h, 0
    g_lo, g_hi = y[0] / c[0] - y[2] - edge, end[0] / c[0] - end[2] - edge
    if g_lo * g_hi >= 0:
        return 0.0, y
    s = h
    for _ in range(60):
        s = (lo * g_hi - hi * g_lo) / (g_hi - g_lo)
        end = _runge_kutta(t, y, s, command, region, c)
        g = end[0] / c[0] - end[2] - edge
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


@nb.njit(cache=True)
def control(t, y, memory, ring, count, drive, c):
    """Sample the drive: read the encoder, queue a torque, return the one to hold for the next period."""
    kpos, kp, ki, kd, kw, rate, period, limit, resolution, differencing = drive
    commanded = c[0] * c[2] + c[1] * t
    position, speed = y[0], y[1]
    if resolution > 0:
        position = np.floor((commanded + position) / resolution) * resolution - commanded
    if differencing > 0 and count > 0:
        speed = (position - memory[3]) / period
    error = -kpos * position - speed
    integral = memory[0] + ki * period * error
    leaky = memory[1] - period * (speed + rate * memory[1])
    command = kp * error + integral + kw * leaky - kd * (speed - memory[2]) / period
    if abs(command) > limit:
        command = np.sign(command) * limit
    else:
        memory[0], memory[1] = integral, leaky
    memory[2], memory[3] = speed, position
    ring[count % ring.size] = command
    return ring[(count + 1) % ring.size]


@nb.njit(cache=True)
def control_matrix(delay, drive, c):
    """Return a linear drive as a matrix, from all states to the torque to hold and the next memory."""
    size = 9 + delay
    rows = np.zeros((5 + delay, size))
    for j in range(size):
        unit = np.zeros(size + 1)
        unit[j] = 1.0
        memory, ring = unit[5:9].copy(), unit[9:].copy()
        y = (unit[0], unit[1], unit[2], unit[3], unit[4])
        rows[0, j] = control(0.0, y, memory, ring, max(delay, 1), drive, c)
        rows[1:5, j] = memory
        rows[5:, j] = ring[1:]
    return rows


@nb.njit(cache=True, nogil=True)
def run(y, region, steps, step, skip, every, per_period, delay, c, drive, record, gap, events):
    """Integrate into `record`, `gap`, `events` (time, side met or 0 when parted).

    Returns the step at which the run diverged, or -1, and the number of events.
    """
    ring, memory = np.full(delay + 1, y[4]), np.array([y[4], 0.0, 0.0, y[0]])
    edges = (-np.inf, -c[8], 0.0, c[8], np.inf)
    used, row, command = 0, 0, y[4]
    for i in range(steps + 1):
        t, left = (i - skip) * step, step
        if i >= skip and (i - skip) % every == 0:
            for j in range(5):
                record[row, j] = y[j]
            gap[row] = 1 if region == 3 else (-1 if region == 0 else 0)
            row += 1
        if i % per_period == 0:
            command = control(t, y, memory, ring, i // per_period, drive, c)
            if c[15] == 0:
                y = (y[0], y[1], y[2], y[3], command)
        end = _runge_kutta(t, y, left, command, region, c)
        for _ in range(16):
            x = end[0] / c[0] - end[2]
            up = x > edges[region + 1]
            if not up and x >= edges[region]:
                break
            s, y = _locate(t, y, left, end, edges[region + 1] if up else edges[region], command, region, c)
            before, region = region, (region + 1 if up else region - 1)
            t, left = t + s, left - s
            if c[8] > 0 and (before in (0, 3) or region in (0, 3)) and used < len(events):
                events[used, 0], events[used, 1] = t, 1.0 if region == 3 else (-1.0 if region == 0 else 0.0)
                used += 1
            end = _runge_kutta(t, y, left, command, region, c)
        y = end
        if not abs(y[1]) < DIVERGED * c[1]:
            return i, used
    return -1, used
