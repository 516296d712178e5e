"""The robotic joint: two inertias, backlash after equations 8 and 9, gravity, and a digital drive.

The motor (inertia J_m) drives the load (J_l) through a gear of ratio N and an elastic coupling with backlash, all
written on the load side: delta_theta = theta_m / N - theta_l, gap 2 * delta. A digital drive with a position gain
around a speed loop holds a constant commanded speed while gravity turns with the load, so that the gap opens and
closes twice a turn.

Near zero, equations 8 and 9 do not do what the text says of them:

* K_BL is K_s / 2 at the edge, and inside the gap it leaks: 2 K_s / (pi alpha delta) in the middle. The leak
  multiplies delta_theta - delta * sign(delta_theta), which points the wrong way inside the gap, so it pulls the teeth
  towards the nearer edge.
* sign() makes the torque jump by 2 K_s / (pi alpha) on either side of delta_theta = 0: the model has a discontinuity.
* The D_s term steps up at the edge and may pull on separation.

All three vanish as alpha grows. The clamped dead zone has none of them: nothing inside the gap, K_s and D_s
outside, and a torque that never pulls.
"""

import json
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from importlib.resources import files

import numba as nb
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

GRAVITY = 9.80665
TURN = 2 * math.pi

# Beyond this multiple of the commanded speed no joint of this kind is running any more.
DIVERGED = 1e3


class DivergenceError(ArithmeticError):
    """A simulated joint left every plausible speed; the message says when and at which backlash."""


@dataclass(frozen=True)
class JointParameters:
    """Everything about the joint but its backlash.

    Only ratios show in the motor speed: scaling every inertia, stiffness, torque and gain by one factor changes
    nothing. ``joint_from_ratios`` makes physical values out of the ratios, for a point load of 5 kg.

    Attributes
    ----------
    gear_ratio : float
        N, motor turns per load turn.
    motor_inertia_kgm2, load_inertia_kgm2 : float
        J_m (motor side) and J_l (load side).
    load_mass_kg, gravity_arm_m : float
        m and r of the gravity torque m g r sin(theta_l).
    stiffness_nm_per_rad, damping_nms_per_rad : float
        K_s and D_s of the coupling, load side.
    alpha_per_rad : float
        Sharpness of the edge in equation 8.
    clamped : bool
        Use the clamped dead zone instead of equations 8 and 9.
    motor_viscous_nms_per_rad, load_viscous_nms_per_rad : float
        Viscous friction, each on its own side.
    motor_coulomb_nm, load_coulomb_nm : float
        Coulomb friction, each on its own side.
    commanded_speed_rps : float
        Commanded motor speed [turns/s].
    start_angle_rad : float
        Load angle at t = 0, from the upright position where gravity has no torque.
    lead_s : float
        How long before t = 0 the joint starts, at the commanded speed and with the teeth in contact.
    position_gain_per_s : float
        Speed correction per position error.
    speed_gain_nms_per_rad, integral_gain_nm_per_rad, derivative_gain_nms2_per_rad : float
        K_p, K_i, K_d of the speed loop, motor side. K_d acts on the measured speed only.
    leaky_gain_nm_per_rad, leaky_rate_per_s : float
        A second integral of the speed error that forgets at this rate.
    control_period_s, control_delay_periods : float, int
        The drive samples, computes, and applies the torque this many periods later, held for a period.
    torque_lag_s : float
        Time constant of the torque (current) loop; 0 for none.
    torque_limit_nm : float
        Largest commanded motor torque; the integrals stop while it binds.
    encoder_bits : int
        Resolution of the position that the drive sees; 0 for the true position.
    speed_by_differencing : bool
        The drive differences its position over one period instead of knowing the true speed.
    """

    gear_ratio: float
    motor_inertia_kgm2: float
    load_inertia_kgm2: float
    load_mass_kg: float
    gravity_arm_m: float
    stiffness_nm_per_rad: float
    position_gain_per_s: float
    speed_gain_nms_per_rad: float
    integral_gain_nm_per_rad: float
    derivative_gain_nms2_per_rad: float = 0.0
    leaky_gain_nm_per_rad: float = 0.0
    leaky_rate_per_s: float = 0.0
    torque_lag_s: float = 0.0
    control_period_s: float = 5e-4
    control_delay_periods: int = 1
    start_angle_rad: float = 0.0
    lead_s: float = 0.0
    damping_nms_per_rad: float = 0.0
    alpha_per_rad: float = 1e6
    clamped: bool = False
    motor_viscous_nms_per_rad: float = 0.0
    load_viscous_nms_per_rad: float = 0.0
    motor_coulomb_nm: float = 0.0
    load_coulomb_nm: float = 0.0
    commanded_speed_rps: float = 100.0
    torque_limit_nm: float = math.inf
    encoder_bits: int = 0
    speed_by_differencing: bool = False

    @property
    def commanded_speed_rad_per_s(self) -> float:
        """Commanded motor speed [rad/s]."""
        return TURN * self.commanded_speed_rps

    @property
    def turn_period_s(self) -> float:
        """Duration of a load turn [s]."""
        return self.gear_ratio / self.commanded_speed_rps

    @property
    def gravity_torque_nm(self) -> float:
        """Largest gravity torque m g r on the load [N m]."""
        return self.load_mass_kg * GRAVITY * self.gravity_arm_m

    @property
    def ratios(self) -> dict[str, float]:
        """What a motor-speed record can tell: the arguments of ``joint_from_ratios``."""
        jm, jl = self.motor_inertia_kgm2, self.load_inertia_kgm2
        return {
            "stiffness_per_s2": self.stiffness_nm_per_rad / jl,
            "gravity_per_s2": self.gravity_torque_nm / jl,
            "inertia_ratio": jl / (self.gear_ratio**2 * jm),
            "position_gain_per_s": self.position_gain_per_s,
            "speed_gain_per_s": self.speed_gain_nms_per_rad / jm,
            "integral_gain_per_s2": self.integral_gain_nm_per_rad / jm,
            "derivative_gain": self.derivative_gain_nms2_per_rad / jm,
            "leaky_gain_per_s2": self.leaky_gain_nm_per_rad / jm,
            "leaky_rate_per_s": self.leaky_rate_per_s,
            "torque_lag_s": self.torque_lag_s,
            "start_angle_rad": self.start_angle_rad,
            "lead_s": self.lead_s,
        }


def joint_from_ratios(
    ratios: Mapping[str, float], *, gear_ratio: float = 40.0, load_mass_kg: float = 5.0, **others: float
) -> JointParameters:
    """Physical parameters of a point load that has these ratios.

    A point mass has J_l = m r**2, so the gravity ratio g / r gives the arm and the mass gives the torque scale.

    Parameters
    ----------
    ratios : mapping
        The keys of ``JointParameters.ratios``.
    gear_ratio, load_mass_kg : float
        N, and m [kg].
    **others
        Further fields of `JointParameters`, as they are.

    Returns
    -------
    JointParameters

    Raises
    ------
    ValueError
        If a ratio is missing, unknown, or without a physical meaning.
    """
    known = {f.name for f in fields(JointParameters)}
    r = dict(ratios)
    try:
        arm = GRAVITY / r.pop("gravity_per_s2")
        jl = load_mass_kg * arm**2
        jm = jl / (gear_ratio**2 * r.pop("inertia_ratio"))
        physical = {
            "stiffness_nm_per_rad": jl * r.pop("stiffness_per_s2"),
            "speed_gain_nms_per_rad": jm * r.pop("speed_gain_per_s"),
            "integral_gain_nm_per_rad": jm * r.pop("integral_gain_per_s2"),
            "derivative_gain_nms2_per_rad": jm * r.pop("derivative_gain", 0.0),
            "leaky_gain_nm_per_rad": jm * r.pop("leaky_gain_per_s2", 0.0),
        }
    except (KeyError, ZeroDivisionError) as error:
        raise ValueError(f"joint_from_ratios: missing or zero ratio ({error}); see JointParameters.ratios") from None
    if unknown := set(r) - known:
        raise ValueError(f"joint_from_ratios: unknown ratios {sorted(unknown)}; see JointParameters.ratios")
    return JointParameters(
        gear_ratio=gear_ratio,
        motor_inertia_kgm2=jm,
        load_inertia_kgm2=jl,
        load_mass_kg=load_mass_kg,
        gravity_arm_m=arm,
        **physical,
        **r,
        **others,
    )


def identified_joint() -> JointParameters:
    """Return the joint identified from the published signals (``data/joint.json``)."""
    data = json.loads(files("replication").joinpath("data/joint.json").read_text(encoding="utf-8"))
    return joint_from_ratios(data["ratios"])


@nb.njit(cache=True)
def _stiffness(x, delta, ks, alpha):
    return ks / np.pi * (np.pi + np.arctan(alpha * (x - delta)) - np.arctan(alpha * (x + delta)))


@nb.njit(cache=True)
def _torque(x, v, delta, ks, ds, alpha, clamped):
    if not clamped:
        return (x - delta * np.sign(x) + ds / ks * v) * _stiffness(x, delta, ks, alpha)
    if x > delta:
        return max(0.0, ks * (x - delta) + ds * v)
    if x < -delta:
        return min(0.0, ks * (x + delta) + ds * v)
    return 0.0


_stiffness_ufunc = np.vectorize(_stiffness, otypes=[float])
_torque_ufunc = np.vectorize(_torque, otypes=[float])


def stiffness(
    delta_theta_rad: ArrayLike, delta_rad: ArrayLike, stiffness_nm_per_rad: float, alpha_per_rad: float
) -> NDArray[np.float64]:
    """Variable coupling stiffness K_BL, equation 8 as printed.

    Parameters
    ----------
    delta_theta_rad : array_like
        theta_m / N - theta_l [rad].
    delta_rad : array_like
        Half the gap [rad], broadcast against the first argument.
    stiffness_nm_per_rad, alpha_per_rad : float
        K_s [N m/rad] and the sharpness of the edge [1/rad].

    Returns
    -------
    ndarray
        K_BL [N m/rad]: K_s far outside the gap, K_s / 2 at its edge, 2 K_s / (pi alpha delta) in its middle.
    """
    return _stiffness_ufunc(delta_theta_rad, delta_rad, stiffness_nm_per_rad, alpha_per_rad)


def transmitted_torque(
    delta_theta_rad: ArrayLike,
    delta_omega_rad_per_s: ArrayLike,
    delta_rad: ArrayLike,
    stiffness_nm_per_rad: float,
    damping_nms_per_rad: float = 0.0,
    alpha_per_rad: float = 1e6,
    clamped: bool = False,
) -> NDArray[np.float64]:
    """Torque on the load tau_l, equation 9 as printed, or that of the clamped dead zone.

    Parameters
    ----------
    delta_theta_rad, delta_omega_rad_per_s, delta_rad : array_like
        Displacement, its rate and half the gap; broadcast together.
    stiffness_nm_per_rad, damping_nms_per_rad, alpha_per_rad : float
        K_s, D_s and the sharpness of the edge.
    clamped : bool
        No torque inside the gap, K_s and D_s outside, never pulling.

    Returns
    -------
    ndarray
        tau_l [N m]. As printed it jumps by 2 K_s / (pi alpha) to either side of zero.
    """
    return _torque_ufunc(
        delta_theta_rad,
        delta_omega_rad_per_s,
        delta_rad,
        stiffness_nm_per_rad,
        damping_nms_per_rad,
        alpha_per_rad,
        clamped,
    )


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
    time_s, motor_position_rad, motor_speed_rad_per_s, motor_torque_nm, load_position_rad : ndarray, shape (n,)
        The true state; the motor position is N times the start angle at t = 0 and without errors.
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
    gap_state: NDArray[np.int64]
    impact_time_s: NDArray[np.float64]
    impact_side: NDArray[np.int64]
    separation_time_s: NDArray[np.float64]

    @property
    def motor_speed_rps(self) -> NDArray[np.float64]:
        """Motor speed [turns/s]."""
        return self.motor_speed_rad_per_s / TURN


@nb.njit(cache=True)
def _derivative(t, y, u, region, c, out):
    """Rates of the deviations from the commanded motion; `region` keeps the field smooth within a step."""
    n, omega, theta0, jm, jl, ks, ds, alpha, delta, clamped, mgr, bm, bl, cm, cl, lag = c
    x, v = y[0] / n - y[2], y[1] / n - y[3]
    if clamped > 0:
        torque = 0.0
        if region == 3:
            torque = max(0.0, ks * (x - delta) + ds * v)
        elif region == 0:
            torque = min(0.0, ks * (x + delta) + ds * v)
    else:
        edge = delta if region >= 2 else -delta
        torque = (x - edge + ds / ks * v) * _stiffness(x, delta, ks, alpha)
    motor_speed, load_speed = omega + y[1], omega / n + y[3]
    motor_torque = y[4] if lag > 0 else u
    out[0] = y[1]
    out[1] = (motor_torque - torque / n - bm * motor_speed - cm * np.sign(motor_speed)) / jm
    out[2] = y[3]
    gravity = mgr * np.sin(theta0 + omega / n * t + y[2])
    out[3] = (torque - gravity - bl * load_speed - cl * np.sign(load_speed)) / jl
    out[4] = (u - y[4]) / lag if lag > 0 else 0.0


@nb.njit(cache=True)
def _runge_kutta(t, y, h, u, region, c, k, z, out):
    _derivative(t, y, u, region, c, k[0])
    for stage in range(1, 4):
        a = h if stage == 3 else 0.5 * h
        for i in range(5):
            z[i] = y[i] + a * k[stage - 1, i]
        _derivative(t + a, z, u, region, c, k[stage])
    for i in range(5):
        out[i] = y[i] + h / 6 * (k[0, i] + 2 * (k[1, i] + k[2, i]) + k[3, i])
    return out[0] / c[0] - out[2]


@nb.njit(cache=True)
def _locate(t, y, h, edge, x_end, u, region, c, k, z, out):
    """Part of the step after which x meets the edge, by the Illinois method; `out` is the state there."""
    lo, hi = 0.0, h
    g_lo, g_hi = y[0] / c[0] - y[2] - edge, x_end - edge
    if g_lo * g_hi >= 0:
        out[:] = y
        return 0.0
    s, side = h, 0
    for _ in range(60):
        s = (lo * g_hi - hi * g_lo) / (g_hi - g_lo)
        g = _runge_kutta(t, y, s, u, region, c, k, z, out) - edge
        if abs(g) < 1e-14:
            break
        if g * g_hi > 0:
            hi, g_hi = s, g
            if side == -1:
                g_lo *= 0.5
            side = -1
        else:
            lo, g_lo = s, g
            if side == 1:
                g_hi *= 0.5
            side = 1
    return s


@nb.njit(cache=True)
def _control(t, y, memory, ring, count, drive, c):
    """One sample of the drive: reads the encoder, returns the torque to hold for the next period."""
    kpos, kp, ki, kd, kw, rate, period, limit, resolution, differencing = drive
    offset = c[0] * c[2] + c[1] * t
    position, speed = y[0], y[1]
    if resolution > 0:
        position = np.floor((offset + position) / resolution) * resolution - offset
    if differencing > 0:
        speed = (position - memory[3]) / period if count > 0 else y[1]
    command_speed = -kpos * position
    integral = memory[0] + ki * period * (command_speed - speed)
    leaky = memory[1] - period * (speed + rate * memory[1])
    torque = kp * (command_speed - speed) + integral + kw * leaky - kd * (speed - memory[2]) / period
    if abs(torque) > limit:
        torque = np.sign(torque) * limit
    else:
        memory[0], memory[1] = integral, leaky
    memory[2], memory[3] = speed, position
    ring[count % ring.size] = torque
    return ring[(count + 1) % ring.size]


@nb.njit(cache=True, nogil=True)
def _run(y, region, steps, step, skip, every, per_period, delay, c, drive, record, gap, events):
    """Integrate; return (status, events used): status is -1 when done, else the step at which it diverged."""
    k, z, end = np.empty((4, 5)), np.empty(5), np.empty(5)
    ring, memory = np.full(delay + 1, y[4]), np.array([y[4], 0.0, 0.0, y[0]])
    edges = np.array([-np.inf, -c[8], 0.0, c[8], np.inf])
    used, row, u, limit = 0, 0, y[4], DIVERGED * c[1]
    for i in range(steps + 1):
        t = (i - skip) * step
        if i >= skip and (i - skip) % every == 0:
            record[row, :] = y
            gap[row] = 1 if region == 3 else (-1 if region == 0 else 0)
            row += 1
        if i % per_period == 0:
            u = _control(t, y, memory, ring, i // per_period, drive, c)
            if c[15] == 0:
                y[4] = u
        left = step
        for _ in range(16):
            x = _runge_kutta(t, y, left, u, region, c, k, z, end)
            up = x > edges[region + 1]
            if not up and x >= edges[region]:
                break
            s = _locate(t, y, left, edges[region + up], x, u, region, c, k, z, end)
            region = region + 1 if up else region - 1
            if c[8] > 0 and edges[region + 1 - up] != 0 and used < len(events):
                events[used, 0], events[used, 1] = t + s, (region - 1.5) / 1.5 if region in (0, 3) else 0.0
                used += 1
            y[:] = end
            t, left = t + s, left - s
        y[:] = end
        if not abs(y[1]) < limit:
            return i, used
    return -1, used


def _constants(p: JointParameters, delta: float) -> tuple:
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
    )


def _drive(p: JointParameters) -> tuple:
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
    """One control period of the linear joint without gravity: teeth in contact, or motor alone inside the gap.

    The state is motor position, motor speed, load position, load speed, torque (physical, as deviations), then
    the drive's memory. Its eigenvalues are exp(s * control_period_s) of the joint's modes s.

    Parameters
    ----------
    parameters : JointParameters
    in_contact : bool
        Couple the inertias by K_s and D_s, or not at all.

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
    c, drive = _constants(p, 0.0), _drive(p)
    # Without the command's offset, the encoder's grid and the torque limit the drive is linear, so unit vectors do.
    c, drive = (n, 0.0, 0.0, *c[3:]), (*drive[:7], math.inf, 0.0, drive[9])
    matrix = np.zeros((9 + delay, 9 + delay))
    for j, unit in enumerate(np.eye(9 + delay)):
        y, memory, ring = unit[:5].copy(), unit[5:9].copy(), np.append(unit[9:], 0.0)
        u = _control(0.0, y, memory, ring, max(delay, 1), drive, c)
        matrix[:5, j] = (flow @ np.append(y, u))[:5]
        matrix[5:, j] = np.concatenate([memory, ring[1:]])
    return matrix


def _refuse(what: str, advice: str) -> None:
    raise ValueError(f"simulate: {what}; {advice}")


def _whole(ratio: float) -> bool:
    return abs(ratio - round(ratio)) < 1e-6 and ratio > 0.5


def _check_parameters(p: JointParameters) -> None:
    positive = ("gear_ratio", "motor_inertia_kgm2", "load_inertia_kgm2", "stiffness_nm_per_rad", "alpha_per_rad")
    positive += ("control_period_s", "commanded_speed_rps", "torque_limit_nm")
    free = {"start_angle_rad", "leaky_gain_nm_per_rad"}
    for name in (f.name for f in fields(p)):
        value = getattr(p, name)
        if math.isnan(value) or (math.isinf(value) and name != "torque_limit_nm"):
            _refuse(f"{name} is {value}", "give a finite number")
        if name in positive and value <= 0:
            _refuse(f"{name} is {value}", "give a positive number")
        if name not in free and value < 0:
            _refuse(f"{name} is {value}", "give zero or a positive number")
    if p.lead_s > 0 and not _whole(p.lead_s / p.control_period_s):
        _refuse(f"lead_s {p.lead_s} is no multiple of control_period_s {p.control_period_s}", "round it")
    for in_contact in (True, False):
        growth = np.abs(np.linalg.eigvals(closed_loop_matrix(p, in_contact=in_contact))).max()
        if growth > 1 + 1e-4:
            where = "with the teeth in contact" if in_contact else "of the motor inside the gap"
            _refuse(
                f"the speed loop {where} is unstable (grows {growth:.4f} times each control period)",
                "lower the gains, control_period_s or control_delay_periods",
            )


def _check_run(p: JointParameters, delta: float, duration: float, sample: float, step: float) -> None:
    if not 0 <= delta < TURN / 2:
        _refuse(f"delta_rad is {delta}: the gap 2 * delta must be between nothing and a turn", "give it in rad")
    if not (0 < step < math.inf and 0 < sample < math.inf and 0 < duration < math.inf):
        _refuse(f"duration_s {duration}, sample_s {sample}, step_s {step}", "give positive times")
    for name, time in (("control_period_s", p.control_period_s), ("sample_s", sample)):
        if not _whole(time / step):
            _refuse(f"{name} {time} is no multiple of step_s {step}", "choose a step that divides it")
    contact = math.sqrt(p.stiffness_nm_per_rad * (1 / p.load_inertia_kgm2 + 1 / p.gear_ratio**2 / p.motor_inertia_kgm2))
    fastest = max(contact, 1 / p.torque_lag_s if p.torque_lag_s > 0 else 0.0)
    if step * fastest > 0.5:
        _refuse(
            f"step_s {step} is too large for the fastest mode of {fastest:.4g} rad/s (stiffness or torque lag)",
            f"take at most {0.5 / fastest:.2g} s",
        )


def _start(p: JointParameters, delta: float) -> tuple[NDArray[np.float64], int]:
    """State and region at -lead_s: commanded speed, teeth in contact, torques in balance."""
    load_speed = p.commanded_speed_rad_per_s / p.gear_ratio
    angle = p.start_angle_rad - load_speed * p.lead_s
    torque = p.gravity_torque_nm * math.sin(angle) + p.load_viscous_nms_per_rad * load_speed + p.load_coulomb_nm
    motor = p.motor_viscous_nms_per_rad * p.commanded_speed_rad_per_s + p.motor_coulomb_nm
    side = -1 if torque < 0 else 1
    twist = side * delta + torque / p.stiffness_nm_per_rad
    return np.array([0.0, 0.0, -twist, 0.0, torque / p.gear_ratio + motor]), 3 if side > 0 else 0


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
        Length of the record, its sampling, and the step. With ``sample_s=step_s`` nothing is missed between samples.

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
    _check_parameters(parameters)
    return _simulate_checked(parameters, delta_rad, duration_s, sample_s, step_s)


def _simulate_checked(p: JointParameters, delta: float, duration: float, sample: float, step: float) -> SimulatedJoint:
    _check_run(p, delta, duration, sample, step)
    y, region = _start(p, delta)
    every, skip = round(sample / step), round(p.lead_s / step)
    samples = round(duration / sample) + 1
    record, gap = np.empty((samples, 5)), np.empty(samples, dtype=np.int64)
    steps = skip + (samples - 1) * every
    events = np.empty((steps + 1, 2))
    per_period, delay = round(p.control_period_s / step), int(p.control_delay_periods)
    status, used = _run(
        y, region, steps, step, skip, every, per_period, delay, _constants(p, delta), _drive(p), record, gap, events
    )
    if status >= 0:
        raise DivergenceError(
            f"simulate: the joint diverged at t = {(status - skip) * step:.4f} s with delta_rad = {delta}; "
            "lower the gains or the step"
        )
    time = np.arange(samples) * sample
    commanded = p.commanded_speed_rad_per_s * time
    events = events[:used][events[:used, 0] >= 0]
    impact = events[:, 1] != 0
    return SimulatedJoint(
        delta_rad=delta,
        time_s=time,
        motor_position_rad=p.gear_ratio * p.start_angle_rad + commanded + record[:, 0],
        motor_speed_rad_per_s=p.commanded_speed_rad_per_s + record[:, 1],
        motor_torque_nm=record[:, 4].copy(),
        load_position_rad=p.start_angle_rad + commanded / p.gear_ratio + record[:, 2],
        gap_state=gap,
        impact_time_s=events[impact, 0],
        impact_side=events[impact, 1].astype(np.int64),
        separation_time_s=events[~impact, 0],
    )


def simulate_many(
    parameters: JointParameters,
    delta_rad: Sequence[float],
    *,
    duration_s: float = 4.8,
    sample_s: float = 2e-3,
    step_s: float = 1e-4,
    threads: int = 2,
) -> list[SimulatedJoint]:
    """Simulate several backlashes at once, each as `simulate` does; the results do not depend on `threads`."""
    _check_parameters(parameters)
    with ThreadPoolExecutor(threads) as pool:
        jobs = [
            pool.submit(_simulate_checked, parameters, float(delta), duration_s, sample_s, step_s)
            for delta in delta_rad
        ]
        return [job.result() for job in jobs]


def settled_peak_rps(record: SimulatedJoint, parameters: JointParameters) -> float:
    """Largest motor speed above the commanded one after the first turn [turns/s], the paper's theoretical A."""
    settled = record.time_s >= parameters.turn_period_s
    return float(record.motor_speed_rps[settled].max() - parameters.commanded_speed_rps)
