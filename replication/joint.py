"""The robotic joint (equations 8 and 9, figures 7 and 8): two inertias, backlash, gravity and a digital drive.

Equations 8 and 9 are the paper's; the form of the drive and all values are ours, identified from the public records
(`data/joint.json`), because the paper prints none. `njit` is numba's compiler, without fast-math.

SI units. The motor drives the load through a gear of ratio N and an elastic coupling, written on the load's side:
delta_theta = theta_m / N - theta_l, and the teeth are free over the gap 2 delta. The joint turns at its commanded
speed Omega; its state is integrated as deviations from that motion, so that the small signal keeps its digits.

In the gap, equations 8 and 9 do not do what the text says of them (errata E8, E9). K_BL is K_s / 2 at the edge, and
in the middle of the gap it leaves 2 K_s / (pi alpha delta), which pulls the teeth towards the nearer edge; the torque
jumps from 2 K_s / (pi alpha) to minus that at delta_theta = 0; the term of D_s may pull when the teeth part. The
clamped dead zone has none of these.
"""

import json
import math
from collections.abc import Mapping
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from replication.compilation import njit
from replication.files import read_committed
from replication.signature import TURN, FloatArray

GRAVITY = 9.80665
LOAD_KG = 5.0  # the text's; a motor's speed tells ratios only: the load sets the scale of torques


class Wave(NamedTuple):
    """A sinusoidal disturbance: torque ripple on the motor, another joint's torque on the load."""

    order: float  # periods in a motor turn
    phase: float
    on_motor: float = 0.0  # amplitude [N m]; it follows the motor's angle since t = 0
    on_load: float = 0.0  # amplitude [N m]; it follows the commanded motion


class Joint(NamedTuple):
    """A joint but for its backlash.

    Every `period` the drive computes the torque K_p e + K_i integral(e) - K_d domega_m/dt + K_w w, where
    e = K_pos (N start_angle + Omega t - theta_m) + Omega - omega_m, and w is the integral of Omega - omega_m that
    forgets at `w_rate`.
    """

    N: float  # gear ratio
    J_m: float  # inertias, each on its own side
    J_l: float
    G: float  # largest torque of gravity on the load, m g r
    K_s: float  # stiffness of the coupling
    K_pos: float  # gains of the drive, on the motor's side
    K_p: float
    K_i: float
    K_d: float
    K_w: float
    w_rate: float
    torque_lag: float  # time constant of the torque (current) loop
    start_angle: float  # of the load at t = 0, from hanging straight down
    lead: float  # how long before t = 0 it starts
    D_s: float = 0.0  # damping of the coupling
    alpha: float = 1e6  # sharpness of the edge in equation 8
    clamped: bool = False  # the clamped dead zone, of a sharp edge, in place of equations 8 and 9
    period: float = 5e-4  # of the drive
    delay: int = 1  # of its periods, until a torque acts
    Omega: float = TURN * 100  # commanded motor speed
    motor_viscous: float = 0.0  # friction, each on its own side
    motor_coulomb: float = 0.0
    load_viscous: float = 0.0
    load_coulomb: float = 0.0
    # Of the position that the drive reads and differences; 0: exact position and speed.
    encoder_step: float = 0.0
    waves: tuple[Wave, ...] = ()

    @property
    def turn_period(self) -> float:
        """Duration of a load turn [s]."""
        return TURN * self.N / self.Omega


def numbers_of(joint: Joint) -> dict[str, float]:
    """Fields of a joint that are real numbers."""
    fields = joint._asdict()
    return {name: fields[name] for name in fields if name not in ("clamped", "delay", "waves")}


POSITIVE = ("N", "J_m", "J_l", "K_s", "alpha", "period", "Omega")
ANY_SIGN = ("K_pos", "K_p", "K_i", "K_d", "K_w", "start_angle")

# ------------------------------------------------------------ what a record of the motor's speed can tell

GAINS = ("K_p", "K_i", "K_d", "K_w")
# Rates, times and an angle, which the scale of torques leaves as they are.
PLAIN = ("K_pos", "w_rate", "torque_lag", "start_angle", "lead")


def ratios(joint: Joint) -> dict[str, float]:
    """Ratios on which the motion depends, where nothing damps or disturbs it.

    One factor on all inertias, torques and gains changes nothing.
    """
    return {
        "K_s/J_l": joint.K_s / joint.J_l,
        "G/J_l": joint.G / joint.J_l,
        "J_l/(N^2 J_m)": joint.J_l / (joint.N**2 * joint.J_m),
        **{f"{gain}/J_m": getattr(joint, gain) / joint.J_m for gain in GAINS},
        **{name: getattr(joint, name) for name in PLAIN},
    }


def from_ratios(values: Mapping[str, float], N: float = 40.0, **others: Any) -> Joint:
    """Make the joint of these ratios whose load is a point of 5 kg.

    Parameters
    ----------
    values : mapping
        All of `ratios`.
    N : float
        Gear ratio: at 100 rps of the motor, 40 makes the load's turn of 0.4 s.
    **others
        Further fields of `Joint`.

    Raises
    ------
    ValueError
        If a ratio is missing or unknown, or one that sets the inertias is not positive.
    """
    names = ("K_s/J_l", "G/J_l", "J_l/(N^2 J_m)", *(f"{gain}/J_m" for gain in GAINS), *PLAIN)
    if wrong := set(values) ^ set(names):
        raise ValueError(f"missing or unknown ratios: {sorted(wrong)}; there are {list(names)}")
    if not (values["G/J_l"] > 0 and values["J_l/(N^2 J_m)"] > 0):
        raise ValueError("the ratios G/J_l and J_l/(N^2 J_m) must be positive: inertias follow")
    arm = GRAVITY / values["G/J_l"]  # as G = m g r and J_l = m r^2
    J_l = LOAD_KG * arm**2
    J_m = J_l / (N**2 * values["J_l/(N^2 J_m)"])
    drive: dict[str, Any] = {gain: J_m * values[f"{gain}/J_m"] for gain in GAINS}
    drive |= {name: values[name] for name in PLAIN}
    return Joint(N, J_m, J_l, J_l * values["G/J_l"], J_l * values["K_s/J_l"], **drive, **others)


def change(joint: Joint, factors: Mapping[str, float]) -> Joint:
    """Multiply ratios of a joint, its other ratios kept, then fields, each alone.

    With another ratio the load is a point of 5 kg again; damping, frictions and waves keep their torques in N m.

    Raises
    ------
    ValueError
        If a name is neither one of `ratios` nor a number of `Joint`, or a field is zero, which no factor changes.
    """
    old = ratios(joint)
    numbers = set(numbers_of(joint))
    if unknown := set(factors) - set(old) - numbers:
        raise ValueError(f"cannot change {sorted(unknown)}; there are {sorted({*old, *numbers})}")
    new = old | {name: factors[name] * old[name] for name in factors if name in old}
    if new != old:
        point = from_ratios(new, joint.N)
        fields = ("J_m", "J_l", "G", "K_s", *GAINS, *PLAIN)
        joint = joint._replace(**{name: getattr(point, name) for name in fields})
    alone: dict[str, Any] = {name: factors[name] for name in factors if name not in old}
    if zero := [name for name in alone if getattr(joint, name) == 0]:
        raise ValueError(f"{', '.join(zero)}: zero, which no factor changes: leave it out")
    return joint._replace(**{name: alone[name] * getattr(joint, name) for name in alone})


def identified_joint() -> Joint:
    """Read the joint that was identified from the published signals (``data/joint.json``)."""
    file = files("replication") / "data" / "joint.json"
    return read_committed(file, lambda text: from_ratios(json.loads(text)["ratios"]))


# ------------------------------------------------------------------------------------ equations of motion


@njit
def K_BL(x, delta, K_s, alpha):
    """Stiffness of the coupling at a displacement, equation 8.

    Parameters
    ----------
    x : float or ndarray
        Displacement delta_theta [rad].
    delta, K_s, alpha : float
        Half the gap [rad], stiffness [N m/rad] outside it, and the edge's sharpness [1/rad].

    Returns
    -------
    float or ndarray
        Stiffness [N m/rad].
    """
    # equation 8
    return K_s / np.pi * (np.pi + np.arctan(alpha * (x - delta)) - np.arctan(alpha * (x + delta)))


@njit
def tau_l(x, rate, delta, side, joint):
    """Torque on the load, equation 9.

    Parameters
    ----------
    x, rate : float
        Displacement delta_theta [rad] and its rate delta_omega [rad/s].
    delta : float
        Half the gap [rad].
    side : int
        sign(x). The integrator takes each step on one side.
    joint : Joint
        Gives K_s, D_s and alpha.

    Returns
    -------
    float
        Torque [N m].
    """
    stiffness = K_BL(x, delta, joint.K_s, joint.alpha)
    return (x - delta * side + joint.D_s / joint.K_s * rate) * stiffness  # equation 9


@njit
def clamped_torque(x, rate, delta, side, joint):
    """Torque of the clamped dead zone, which never pulls: as `tau_l`, but `side` is 0 inside the gap."""
    push = side * (joint.K_s * (x - side * delta) + joint.D_s * rate)
    return side * max(push, 0.0)


@njit
def disturb(t, theta_m, Omega, waves):
    """Sum of the disturbing torques on motor and load; without `waves` it compiles to nothing."""
    if waves is None:
        return 0.0, 0.0
    on_motor = on_load = 0.0
    for k in range(len(waves)):
        order, phase, motor, load = waves[k]
        if motor != 0:
            on_motor += motor * np.sin(order * (Omega * t + theta_m) + phase)
        if load != 0:
            on_load += load * np.sin(order * Omega * t + phase)
    return on_motor, on_load


class Held(NamedTuple):
    """What stays in a step of the integrator."""

    command: float  # the drive's torque
    delta: float  # half the gap
    side: int  # of the contact, see `tau_l`


@njit
def coupling_torque(x, rate, held, j):
    """Torque on the load: of the clamped dead zone, or equation 9."""
    if j.clamped:
        return clamped_torque(x, rate, held.delta, held.side, j)
    return tau_l(x, rate, held.delta, held.side, j)


@njit
def rates(t, y, held, j):
    """Rates of y: position and speed of motor and load, as deviations from the commanded motion; motor torque."""
    theta_m, omega_m, theta_l, omega_l, torque = y
    driving = torque if j.torque_lag > 0 else held.command
    motor = j.Omega + omega_m
    load = j.Omega / j.N + omega_l
    x = theta_m / j.N - theta_l
    rate = omega_m / j.N - omega_l
    tau = coupling_torque(x, rate, held, j)
    gravity = j.G * np.sin(j.start_angle + j.Omega / j.N * t + theta_l)
    motor_friction = j.motor_viscous * motor + j.motor_coulomb * np.sign(motor)
    load_friction = j.load_viscous * load + j.load_coulomb * np.sign(load)
    ripple, push = disturb(t, theta_m, j.Omega, j.waves)
    return (
        omega_m,
        (driving - tau / j.N - motor_friction + ripple) / j.J_m,
        omega_l,
        (tau - gravity - load_friction + push) / j.J_l,
        (held.command - torque) / j.torque_lag if j.torque_lag > 0 else 0.0,
    )


@njit
def drive(t, y, memory, pending, k, j):
    """Queue the torque that the drive computes in its period k, and return the one to hold.

    `memory` is K_i times the integral, the leaky integral, and the last speed and position.
    """
    position, speed = y[0], y[1]
    if j.encoder_step > 0:
        commanded = j.N * j.start_angle + j.Omega * t
        position = np.floor((commanded + position) / j.encoder_step) * j.encoder_step - commanded
        speed = (position - memory[3]) / j.period
    error = -j.K_pos * position - speed
    memory[0] += j.K_i * j.period * error
    memory[1] -= j.period * (speed + j.w_rate * memory[1])
    damping = j.K_d * (speed - memory[2]) / j.period
    memory[2], memory[3] = speed, position
    pending[k % len(pending)] = j.K_p * error + memory[0] + j.K_w * memory[1] - damping
    return pending[(k + 1) % len(pending)]


# --------------------------------------------------------------------------------------------- integrator

MOST_CROSSINGS = 16  # of edges, in one step


@njit
def advance(y, h, k):
    """The state y + h k."""
    return y[0] + h * k[0], y[1] + h * k[1], y[2] + h * k[2], y[3] + h * k[3], y[4] + h * k[4]


@njit
def runge_kutta(t, y, h, held, j):
    """One classical step of fourth order."""
    k1 = rates(t, y, held, j)
    k2 = rates(t + h / 2, advance(y, h / 2, k1), held, j)
    k3 = rates(t + h / 2, advance(y, h / 2, k2), held, j)
    k4 = rates(t + h, advance(y, h, k3), held, j)
    return advance(advance(advance(advance(y, h / 6, k1), h / 3, k2), h / 3, k3), h / 6, k4)


@njit
def reach_edge(t, y, h, end, edge, held, j):
    """Time into a step after which the displacement meets an edge, and the state there.

    Regula falsi; an end that stays twice counts half (the Illinois method).
    """
    low, high = 0.0, h
    g_low = y[0] / j.N - y[2] - edge
    g_high = end[0] / j.N - end[2] - edge
    last = 0  # the end that moved: 1 the high one, -1 the low one
    if g_low * g_high >= 0:
        return 0.0, y
    while True:
        elapsed = (low * g_high - high * g_low) / (g_high - g_low)
        at = runge_kutta(t, y, elapsed, held, j)
        g = at[0] / j.N - at[2] - edge
        if not abs(g) > 1e-14:
            return elapsed, at
        if g * g_high > 0:
            high, g_high = elapsed, g
            g_low *= 0.5 if last == 1 else 1.0
            last = 1
        else:
            low, g_low = elapsed, g
            g_high *= 0.5 if last == -1 else 1.0
            last = -1


@njit
def integrate(y, side, delta, step, every, samples, j):
    """Fill in the states and the gap state at every so many steps; rows stay NaN from where the joint runs away.

    A step that crosses an edge of the gap, or its middle, where sign() jumps, is split there.
    """
    memory = np.array([y[4], 0.0, 0.0, y[0]])
    pending = np.full(j.delay + 1, y[4])
    per_period = round(j.period / step)
    lead_steps = round(j.lead / step)
    edges = (-np.inf, -delta, 0.0, delta, np.inf)
    sides = (-1, 0, 0, 1) if j.clamped else (-1, -1, 1, 1)
    region = 3 if side > 0 else 0  # between edges[region] and edges[region + 1]
    held = Held(y[4], delta, sides[region])
    for i in range(lead_steps + (len(samples) - 1) * every + 1):
        row, rest = divmod(i - lead_steps, every)
        if row >= 0 and rest == 0:
            for k in range(5):
                samples[row, k] = y[k]
            samples[row, 5] = (region == 3) - (region == 0)
        t = (i - lead_steps) * step
        left = step
        if i % per_period == 0:
            command = drive(t, y, memory, pending, i // per_period, j)
            held = Held(command, delta, sides[region])
            if j.torque_lag == 0:
                y = (y[0], y[1], y[2], y[3], command)
        end = runge_kutta(t, y, left, held, j)
        for _ in range(MOST_CROSSINGS):
            x = end[0] / j.N - end[2]
            if not (x < edges[region] or x > edges[region + 1]):
                break
            way = -1 if x < edges[region] else 1
            edge = edges[region] if way < 0 else edges[region + 1]
            elapsed, y = reach_edge(t, y, left, end, edge, held, j)
            region += way
            held = Held(held.command, delta, sides[region])
            t += elapsed
            left -= elapsed
            end = runge_kutta(t, y, left, held, j)
        y = end
        if not abs(y[1]) < 10 * j.Omega:
            return


# --------------------------------------------------------------------------------------------- simulation


class Run(NamedTuple):
    """What the joint did at the samples; positions and speeds with the commanded motion."""

    t: FloatArray
    theta_m: FloatArray
    omega_m: FloatArray
    theta_l: FloatArray
    omega_l: FloatArray
    torque: FloatArray  # of the motor
    gap: FloatArray  # 1 where the motor drives the load, -1 where the load drives the motor, 0 in the gap

    @property
    def v(self) -> FloatArray:
        """Motor speed [rps]."""
        return self.omega_m / TURN

    @property
    def impacts(self) -> FloatArray:
        """Times of the first sample after each meeting of the teeth [s]; contacts between two samples are not seen."""
        meets = (np.diff(self.gap) != 0) & (self.gap[1:] != 0)
        return self.t[1:][meets]


def check(joint: Joint, delta: float, duration: float, sample: float, step: float) -> None:
    """Raise a ValueError for what has no physical meaning or cannot be integrated at this step."""
    times = {"duration": duration, "sample": sample, "step": step}
    for name, value in (numbers_of(joint) | {"delay": joint.delay} | times).items():
        least = "positive" if name in (*POSITIVE, *times) else "zero or positive"
        if not math.isfinite(value):
            raise ValueError(f"{name} is {value}; it must be finite")
        if name not in ANY_SIGN and (value < 0 or (value == 0 and least == "positive")):
            raise ValueError(f"{name} is {value}; it must be {least}")
    if not 0 <= delta < np.pi:
        raise ValueError(f"delta is {delta}; half the gap must be at least 0 and less than pi rad")
    for name, time in (("sample", sample), ("period", joint.period), ("lead", joint.lead)):
        if abs(time / step - round(time / step)) > 1e-6 or (time > 0 and time < step / 2):
            raise ValueError(f"{name} is {time} s; it must be a multiple of the step of {step} s")
    contact = math.sqrt(joint.K_s * (1 / joint.J_l + 1 / (joint.N**2 * joint.J_m)))
    lag = 1 / joint.torque_lag if joint.torque_lag > 0 else 0.0
    fastest = max(contact, lag, *(abs(wave.order) * joint.Omega for wave in joint.waves))
    if step * fastest > 0.5:
        raise ValueError(
            f"step is {step} s; for this stiffness, torque lag or disturbance it must be at most {0.5 / fastest:.2g} s"
        )


def balance(joint: Joint, delta: float) -> tuple[tuple[float, ...], int]:
    """State at the start, and the side on which the teeth touch.

    The speed is the commanded one, and the torques balance, but for waves and for K_s in place of equation 8's K_BL.
    """
    load = joint.Omega / joint.N
    angle = joint.start_angle - load * joint.lead
    torque = joint.G * np.sin(angle) + joint.load_viscous * load + joint.load_coulomb
    driving = torque / joint.N + joint.motor_viscous * joint.Omega + joint.motor_coulomb
    side = -1 if torque < 0 else 1
    return (0.0, 0.0, -side * float(delta) - torque / joint.K_s, 0.0, driving), side


def compilable(joint: Joint) -> Joint:
    """The same joint with numbers of one type, so that one compiled function serves all joints without waves."""
    fields: dict[str, Any] = {name: float(value) for name, value in numbers_of(joint).items()}
    waves = np.array(joint.waves, dtype=float) if joint.waves else None
    fields |= {"delay": int(joint.delay), "waves": waves}
    return joint._replace(**fields)


def simulate(
    joint: Joint, delta: float, duration: float = 4.8, sample: float = 2e-3, step: float = 1e-4
) -> Run:
    """Run a joint at its commanded speed, from teeth in contact and torques in balance.

    Parameters
    ----------
    joint : Joint
    delta : float
        Half the gap [rad], on the load's side.
    duration, sample, step : float
        Length of the record, its sampling, and the step of the integration [s].

    Returns
    -------
    Run
        ``round(duration / sample) + 1`` samples from t = 0.

    Raises
    ------
    ValueError
        If a value has no physical meaning, the step does not divide the sampling, the drive's period and the lead, or
        is too long, or the joint runs away.
    """
    check(joint, delta, duration, sample, step)
    start, side = balance(joint, delta)
    samples = np.full((round(duration / sample) + 1, 6), np.nan)
    every = round(sample / step)
    integrate(start, side, float(delta), step, every, samples, compilable(joint))
    if np.isnan(samples).any():
        raise ValueError(
            f"the joint runs away with a backlash of {delta} rad: with this drive, or this step, it is unstable"
        )
    t = np.arange(len(samples), dtype=float) * sample
    # The motion commanded, to which the states are deviations.
    theta = joint.N * joint.start_angle + joint.Omega * t
    samples[:, 0] += theta
    samples[:, 1] += joint.Omega
    samples[:, 2] += theta / joint.N
    samples[:, 3] += joint.Omega / joint.N
    return Run(t, *samples.T)


def settled_peak(run: Run, joint: Joint) -> float:
    """Largest motor speed above the commanded one after the first turn [rps]: what we read the theoretical A as."""
    settled = run.t >= joint.turn_period
    return float(run.v[settled].max() - joint.Omega / TURN)
