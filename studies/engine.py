"""Logs by a physics engine that nobody here wrote, MuJoCo: the paper's joint, drawn joints, and a six-axis arm.

Drawn joints turn round, or move to and fro as those of `simulated_joints` do.

A joint is a rotor and a link on hinges. Its gear is a tendon of the length theta_m / N - theta_l, whose spring is slack
over the gap; MuJoCo integrates that, friction, gravity, and how the links move each other. The digital drive, which is
arithmetic, is written here once more, and so is the dampers' torque, because a tendon's own damper acts in the gap too.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator
from pandas import DataFrame

from replication.compilation import njit
from replication.joint import GRAVITY, Joint, identified_joint, simulate
from replication.published import Measured
from replication.signature import TURN, FloatArray
from studies.datasheet import ask_sensor, describe_answer, summarise
from studies.simulated_joints import JointLog, draw_strokes, path_from

SEED = 520617
STEP_S = 1e-4
TWIN_STEPS_S = (2.5e-5, 1e-5, 2.5e-6)
TWIN_DELTA_RAD = 1.2e-3
TWIN = "twin"
TURNS = "turns"
HEALTHY = "turns, healthy"
DRAG = "drag in the gap"
ARM = "arm"
STROKES = "strokes"
# Before the first log of strokes was made, these limits were fixed: the interval holds the truth in at least 80 % of
# the joints with backlash, no answer is wrong, and no healthy joint is called.
LOGS = {TURNS: 60, HEALTHY: 20, DRAG: 40, ARM: 20, STROKES: 10}
# Half plays [rad] of an arm's turning joint, and of its shoulder and elbow: each arm is asked with all four.
ARM_PLAYS_RAD = ((0.0, 0.0), (6e-4, 0.0), (1.2e-3, 0.0), (0.0, 1.2e-3))
_ENCODER_RAD = TURN / 2**17
_UPRIGHT, _FORWARD = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)  # axes of hinges


class Link(NamedTuple):
    """What a joint carries, in the frame of its hinge; its place is in the link before."""

    axis: tuple[float, float, float]
    mass_kg: float
    centre_m: tuple[float, float, float]  # of mass
    inertia_kgm2: tuple[float, float, float]  # about it
    place_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    is_turned: bool = False  # by 90 degrees about y


# Universal Robots' UR5e without its last link, as published in MuJoCo Menagerie, universal_robots_ur5e/ur5e.xml
# (https://github.com/google-deepmind/mujoco_menagerie, BSD-3-Clause).
_WRIST = (2.5599e-3, 2.5599e-3, 2.1942e-3)
UR5E = (
    Link(_UPRIGHT, 3.7, (0, 0, 0), (0.0102675, 0.0102675, 0.00666), (0, 0, 0.163)),
    Link(_FORWARD, 8.393, (0, 0, 0.2125), (0.133886, 0.133886, 0.0151074), (0, 0.138, 0), True),
    Link(_FORWARD, 2.275, (0, 0, 0.196), (0.0311796, 0.0311796, 0.004095), (0, -0.131, 0.425)),
    Link(_FORWARD, 1.219, (0, 0.127, 0), _WRIST, (0, 0, 0.392), True),
    Link(_UPRIGHT, 1.219, (0, 0, 0.1), _WRIST, (0, 0.127, 0)),
)
_FLANGE_M = (0.0, 0.0, 0.1)  # of wrist 3, in the link before
# Rotor's inertia, inertia of what lies beyond, roughly, and stiffness of the gear: those of strain wave gears of the
# sizes; no maker publishes all of them.
_HELD = ((2e-4, 2.0, 2e4), (2e-4, 2.0, 2e4), (2e-4, 0.8, 1e4), (5e-5, 0.2, 4e3), (5e-5, 0.2, 4e3))


class Machine(NamedTuple):
    """Joints, each with rotor, elastic gear and drive, one on the other; the last one turns, the others hold."""

    joints: tuple[Joint, ...]  # `Omega` is 0 of those that hold
    links: tuple[Link, ...]
    deltas_rad: tuple[float, ...]
    drag: float = 0.0  # share of the dampers that acts in the gap, too

    @property
    def each(self) -> Any:
        """The joints' fields, an array each."""
        return DataFrame(self.joints).to_records()


# ----------------------------------------------------------------------------------------------------- the engine


def build_model(machine: Machine, step_s: float) -> Any:
    """The machine in MuJoCo: the rotors' hinges, then the links'."""
    import mujoco  # which only those who run the engine need

    spec = mujoco.MjSpec()
    spec.option.timestep = step_s
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = [0, 0, -GRAVITY]
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT
    body = spec.worldbody
    for k, joint in enumerate(machine.joints):
        rotor = Link(_FORWARD, 1.0, (0, 0, 0), (joint.J_m,) * 3)
        _add_link(body, f"rotor {k}", rotor, joint.motor_coulomb, joint.motor_viscous)
    each = zip(machine.joints, machine.links, machine.deltas_rad, strict=True)
    for k, (joint, link, delta) in enumerate(each):
        body = _add_link(body, f"link {k}", link, joint.load_coulomb, joint.load_viscous)
        gear = spec.add_tendon(stiffness=joint.K_s, springlength=[-delta, delta])
        gear.wrap_joint(f"rotor {k}", 1 / joint.N)
        gear.wrap_joint(f"link {k}", -1)
        motor = spec.add_actuator(
            target=f"rotor {k}",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            dyntype=mujoco.mjtDyn.mjDYN_FILTEREXACT,
        )
        motor.dynprm[0] = joint.torque_lag
    return spec.compile()


def _add_link(parent: Any, name: str, link: Link, coulomb: float, viscous: float) -> Any:
    """Put a link on a body, by a hinge that rubs."""
    body = parent.add_body(
        pos=link.place_m,
        quat=[1, 0, int(link.is_turned), 0],
        explicitinertial=True,
        mass=link.mass_kg,
        ipos=link.centre_m,
        inertia=link.inertia_kgm2,
    )
    body.add_joint(name=name, axis=link.axis, frictionloss=coulomb, damping=viscous)
    return body


@njit
def damp_gears(position, speed, gears, applied):
    """Apply the dampers' torques to rotors and links; the teeth pull by no more than drags in the gap.

    Rows of `gears` are N, K_s, D_s, delta [rad], and the share that acts in the gap, too.
    """
    joints = gears.shape[1]
    for k in range(joints):
        N, K_s, D_s, delta, drag = gears[:, k]
        x = position[k] / N - position[joints + k]
        rate = speed[k] / N - speed[joints + k]
        torque = drag * D_s * rate
        push = K_s * (abs(x) - delta)  # of the tendon's spring
        if push > 0:
            side = np.sign(x)
            torque = side * max(side * D_s * rate, side * torque - push)
        applied[k] = -torque / N
        applied[joints + k] = torque


def _balance(machine: Machine, model: Any, Omega: FloatArray) -> Any:
    """The machine's state `lead` before t = 0: at these speeds, teeth in contact, torques in balance."""
    import mujoco

    joint = machine.each
    angle = joint.start_angle - Omega / joint.N * joint.lead[-1]
    data = mujoco.MjData(model)
    data.qpos[:] = [*joint.N * angle, *angle]
    data.qvel[:] = [*Omega, *Omega / joint.N]
    mujoco.mj_forward(model, data)
    links = slice(len(machine.joints), None)
    holding = data.qfrc_bias[links] - data.qfrc_passive[links]  # gravity, less viscous friction
    holding += joint.load_coulomb * np.sign(Omega)
    data.qpos[links] -= machine.deltas_rad * np.sign(holding) + holding / joint.K_s
    rubbing = joint.motor_viscous * Omega + joint.motor_coulomb * np.sign(Omega)
    data.act[:] = holding / joint.N + rubbing
    return data


def turn_round(joint: Joint, periods: int) -> FloatArray:
    """The motor's angle [rad], from its start, and speed [rad/s] in each period of a drive that turns it round."""
    angle = joint.Omega * (joint.period * np.arange(periods))
    return np.column_stack([angle, np.full(periods, joint.Omega)])


def run_engine(machine: Machine, path: FloatArray, step_s: float = STEP_S) -> FloatArray:
    """Motor position [rad], speed [rad/s] and torque [N m] of the joint that moves on a path, a row a period."""
    import mujoco

    joint = machine.each
    count = len(joint)
    period = joint.period[-1]
    drag = np.full(count, machine.drag)
    gears = np.vstack([joint.N, joint.K_s, joint.D_s, machine.deltas_rad, drag])
    model = build_model(machine, step_s)
    angle, speed = np.zeros((2, count))  # that are commanded; the other joints hold
    speed[-1] = path[0, 1]
    data = _balance(machine, model, speed)
    motor, start = data.qpos[:count], data.qpos[:count].copy()  # the first is a view
    leaky, last = np.zeros((2, count))
    integral = data.act.copy()
    pending = [integral] * joint.delay[-1]
    rows = np.empty((len(path), 3))
    for i in range(len(path)):
        rows[i] = motor[-1], data.qvel[count - 1], data.act[-1]
        angle[-1], speed[-1] = path[i]
        # The drives, as `replication.joint` describes them.
        slow = speed - data.qvel[:count]
        error = joint.K_pos * (start + angle - motor) + slow
        integral = integral + joint.K_i * period * error
        leaky = leaky + period * (slow - joint.w_rate * leaky)
        damping = joint.K_d * (last - slow) / period
        last = slow
        pending.append(joint.K_p * error + integral + joint.K_w * leaky - damping)
        data.ctrl[:] = pending.pop(0)
        for _ in range(round(period / step_s)):
            damp_gears(data.qpos, data.qvel, gears, data.qfrc_applied)
            mujoco.mj_step(model, data)
    return rows


def measure_twin(step_s: float) -> float:
    """NRMSE of the paper's joint in MuJoCo against ours with the clamped dead zone."""
    joint = identified_joint()
    own = simulate(joint._replace(clamped=True), TWIN_DELTA_RAD, step=5e-5).v
    lead, every = round(joint.lead / joint.period), round(2e-3 / joint.period)
    path = turn_round(joint, lead + every * (own.size - 1) + 1)
    rows = run_engine(mount_joint(joint, TWIN_DELTA_RAD), path, step_s)
    return float(np.sqrt(np.mean((rows[lead::every, 1] / TURN - own) ** 2)) / own.std())


# ------------------------------------------------------------------------------------------------ what is drawn


def mount_joint(joint: Joint, delta_rad: float, drag: float = 0.0) -> Machine:
    """A joint on stiff ground, and a body that hangs from it with its J_l and G, half of J_l as a point's."""
    arm, own = GRAVITY * joint.J_l / (2 * joint.G), joint.J_l / 2
    load = Link(_FORWARD, joint.G / (GRAVITY * arm), (0, 0, -arm), (own, own, own))
    return Machine((joint,), (load,), (delta_rad,), drag)


def draw_joint(rng: Generator, delta_rad: float, drag: float = 0.0) -> Machine:
    """Draw a joint that turns round a load of 4 to 25 kg, and whose drive is tuned to it."""
    mass, arm = rng.uniform(4, 25), rng.uniform(0.15, 0.5)
    J_l = mass * arm**2 * rng.uniform(1.02, 1.5)
    joint = _draw_turning(rng, rng.uniform(50, 160), J_l, GRAVITY * mass * arm, (12, 40))
    return mount_joint(joint, delta_rad, drag)


def _draw_turning(
    rng: Generator, N: float, J_l: float, G: float, rings_hz: tuple[float, float]
) -> Joint:
    """Draw rotor, gear, friction and drive of a joint that turns round."""
    ratio, ring = rng.uniform(0.6, 4), TURN * rng.uniform(*rings_hz)
    J_m = J_l / (N**2 * ratio)
    Omega = TURN * N / rng.uniform(0.8, 2.2)
    bandwidth = TURN * rng.uniform(8, 30)
    K_p = J_m * bandwidth * (1 + 0.3 * ratio)
    return Joint(
        N=N,
        J_m=J_m,
        J_l=J_l,
        G=G,
        K_s=J_l * ring**2,
        Omega=Omega,
        K_d=0.0,
        K_w=0.0,
        w_rate=0.0,
        lead=0.0,
        delay=0,
        K_p=K_p,
        K_pos=rng.uniform(0, 0.2) * bandwidth,
        K_i=K_p * bandwidth / rng.uniform(4, 10),
        torque_lag=rng.uniform(3e-4, 1e-3),
        start_angle=rng.uniform(0, TURN),
        D_s=2 * rng.uniform(0.01, 0.06) * ring * J_l,
        motor_viscous=rng.uniform(0, 0.2) * G / N / Omega,
        motor_coulomb=rng.uniform(0.05, 0.5) * G / N,
        load_coulomb=rng.uniform(0.02, 0.3) * G,
    )


def draw_arm(rng: Generator, turning_rad: float, others_rad: float) -> Machine:
    """Draw an arm of 5 kg whose last joint turns an off-centre payload round a horizontal axis.

    Half plays are those of that joint, and of shoulder and elbow.
    """
    mass, arm = rng.uniform(2, 4.5), rng.uniform(0.1, 0.25)
    own = mass * arm**2 * rng.uniform(0.05, 0.3)
    payload = Link(_FORWARD, mass, (arm, 0.1, 0.0), (own, own, own), _FLANGE_M)
    last = _draw_turning(rng, 101.0, mass * arm**2 + own, GRAVITY * mass * arm, (14, 35))
    shoulder, elbow = rng.uniform(-1.4, -1.0), rng.uniform(0.8, 1.2)
    pose = rng.uniform(-1, 1), shoulder, elbow, -shoulder - elbow, rng.uniform(-0.8, 0.8)
    held = [
        last._replace(
            K_pos=20.0,
            Omega=0.0,
            motor_viscous=0.0,
            motor_coulomb=0.02,
            load_coulomb=0.0,
            start_angle=angle,
            J_m=J_m,
            J_l=J_l,
            K_s=K_s,
            D_s=0.06 * math.sqrt(K_s * J_l),
            K_p=J_m * last.K_p / last.J_m,
            K_i=J_m * last.K_i / last.J_m,
        )
        for angle, (J_m, J_l, K_s) in zip(pose, _HELD, strict=True)
    ]
    return Machine((*held, last), (*UR5E, payload), (0, others_rad, others_rad, 0, 0, turning_rad))


def draw_machine(population: str, number: int) -> Machine:
    """Draw the machine of a log; every fifth joint with drag or strokes has no backlash."""
    if population == ARM:
        arm, plays = divmod(number, len(ARM_PLAYS_RAD))
        return draw_arm(_generator(population, arm), *ARM_PLAYS_RAD[plays])
    rng = _generator(population, number)
    delta = rng.uniform(2e-4, 1.8e-3)
    if population == HEALTHY or (population in (DRAG, STROKES) and number % 5 == 4):
        delta = 0.0
    drag = np.linspace(0.1, 1.0, LOGS[DRAG])[number] if population == DRAG else 0.0
    return draw_joint(rng, delta, drag)


def _generator(population: str, *numbers: int) -> Generator:
    return np.random.default_rng((SEED, [*LOGS].index(population), *numbers))


def run_turns(machine: Machine) -> FloatArray:
    """What `run_engine` gives of 10.5 turns."""
    joint = machine.joints[-1]
    before, during = (round(turns * joint.turn_period / joint.period) for turns in (1.5, 10.5))
    return run_engine(machine, turn_round(joint, before + during))[before:]


def run_strokes(machine: Machine, rng: Generator) -> FloatArray:
    """What `run_engine` gives of strokes of a joint, drawn as those of `simulated_joints`."""
    joint = machine.joints[-1]
    start_rad, speed = draw_strokes(rng, rng.uniform(1.0, 2.0))
    at_start = machine._replace(joints=(joint._replace(start_angle=start_rad),))
    return run_engine(at_start, path_from(0.0, joint.N * speed))


def log_machine(machine: Machine, rng: Generator, is_stroke: bool) -> JointLog:
    """What a drive with an encoder of 17 bits logs of a machine, by its position [rad]; and what is said of its load.

    The torque's noise is 0.5 % of gravity's torque; inertia ratio and gravity are misjudged by 3 and 2 % (SD).
    """
    joint = machine.joints[-1]
    every = int(rng.choice([2, 4]))  # periods between samples
    rows = run_strokes(machine, rng) if is_stroke else run_turns(machine)
    position, _, torque = rows[::every].T
    inertia, gravity = np.exp(rng.standard_normal(2) * (0.03, 0.02))
    return JointLog(
        every * joint.period * np.arange(position.size),
        np.floor(position / _ENCODER_RAD) * _ENCODER_RAD,
        torque + 0.005 * joint.G / joint.N * rng.standard_normal(torque.size),
        joint.N,
        inertia * joint.J_l / (joint.N**2 * joint.J_m),
        gravity * joint.G / joint.J_l,
        {},
    )


# ------------------------------------------------------------------------------------------------ what is asked


def measure_log(population: str, number: int) -> dict[str, object]:
    """Ask the sensor of a log: by the torque, and of an arm for the index A, too; or measure a step of the twin.

    The logs of an arm have the same noise.
    """
    row: dict[str, object] = {"population": population, "number": number}
    if population == TWIN:
        step_s = TWIN_STEPS_S[number]
        return row | {"delta_rad": TWIN_DELTA_RAD, "step_s": step_s, "nrmse": measure_twin(step_s)}
    machine = draw_machine(population, number)
    drawn = number // len(ARM_PLAYS_RAD) if population == ARM else number
    log = log_machine(machine, _generator(population, drawn, 1), population == STROKES)
    by_position = {"position": True, "unit": "rad"}
    row |= {
        "delta_rad": machine.deltas_rad[-1],
        "others_rad": max(machine.deltas_rad[:-1], default=0.0),
        "drag": machine.drag,
        **describe_answer(ask_sensor(log, **by_position)),
    }
    if population == ARM:
        without = dict.fromkeys(("torque", "inertia_ratio", "gravity_per_s2"))
        row["amplitude_rps"] = ask_sensor(log, **by_position, **without).amplitude_rps
    return row


def planned_logs() -> list[tuple[str, int]]:
    """The paper's joint at each step, then every log: population and number."""
    numbers = {TWIN: len(TWIN_STEPS_S)} | LOGS
    return [(name, number) for name in numbers for number in range(numbers[name])]


def compare_arms(rows: DataFrame) -> DataFrame:
    """The index A [rps] of each arm: without play, with the turning joint's, twice as much, and with others' alone."""
    arms = rows[rows["population"] == ARM].sort_values("number")
    A = arms["amplitude_rps"].to_numpy().reshape(-1, len(ARM_PLAYS_RAD))
    return DataFrame(A, columns=["none", "turning", "twice", "others"])


def measure_arms(rows: DataFrame) -> Measured:
    """No number, because no robot's log is public; beside it what the paper's index and the torque say of the arms."""
    A, arms = compare_arms(rows), rows[rows["population"] == ARM]
    rises = (A["turning"] > A["none"]) & (A["twice"] > A["turning"])
    gain, other = A["twice"] - A["none"], (A["others"] - A["none"]).abs().max()
    largest, sheet = A["none"].max(), summarise(arms).iloc[0]
    return (math.nan, math.nan), (
        "the robots' logs were never published, and their backlash was not measured. Simulated arm: A rises with each "
        f"step of the turning joint's play on {rises.sum()} of {len(A)} arms, by {gain.min():.2f} to {gain.max():.2f} "
        f"rps at {1e3 * max(ARM_PLAYS_RAD)[0]:g} mrad; the play of shoulder and elbow moves it by {other:.1g} rps at "
        f"most; without play it is {A['none'].min():.1f} to {largest:.1f} rps, the largest above that of "
        f"{(A['twice'] < largest).sum()} arms with play. By torque {sheet['answered']} of {sheet['joints']} logs with "
        f"play are answered, {sheet['wrong']} of {len(arms)} wrong"
    )
