"""Parameters of the robotic joint, the ratios that a record shows, and the identified set."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Any

GRAVITY = 9.80665
TURN = 2 * math.pi

# Ratios of the drive's gains to the motor's inertia, and the gains.
GAINS = {
    "speed_gain_per_s": "speed_gain_nms_per_rad",
    "integral_gain_per_s2": "integral_gain_nm_per_rad",
    "derivative_gain": "derivative_gain_nms2_per_rad",
    "leaky_gain_per_s2": "leaky_gain_nm_per_rad",
}
# Parameters that are ratios by themselves: rates, times and angles need no scale.
PLAIN_RATIOS = (
    "position_gain_per_s",
    "leaky_rate_per_s",
    "torque_lag_s",
    "start_angle_rad",
    "lead_s",
)


@dataclass(frozen=True)
class Disturbance:
    """A sinusoidal disturbance inside the joint."""

    order: float  # periods per motor turn: the frequency over the commanded motor speed
    # Of a torque on the motor (cogging, ripple), in step with the motor's own angle.
    motor_torque_nm: float = 0.0
    # Of a torque on the load (another joint's), in step with the commanded motion.
    load_torque_nm: float = 0.0
    # What an eccentric belt pulley or gear adds to theta_l in the displacement theta_m / N -
    # theta_l, load side.
    transmission_error_rad: float = 0.0
    phase_rad: float = 0.0  # at t = 0


@dataclass(frozen=True)
class JointParameters:
    """Everything about the joint but its backlash.

    Only ratios show in the motor speed: scaling every inertia, stiffness, torque and gain by one
    factor changes nothing. ``joint_from_ratios`` makes physical values out of the ratios, for a
    point load of 5 kg.

    The drive commands the torque K_p e + K_i integral(e) - K_d domega_m/dt + K_w w, where Omega is
    the commanded speed, e = K_pos (Omega t - theta_m) + Omega - omega_m, and w the leaky integral
    of Omega - omega_m.
    """

    gear_ratio: float  # N, motor turns per load turn
    motor_inertia_kgm2: float  # J_m, motor side
    load_inertia_kgm2: float  # J_l, load side
    load_mass_kg: float  # m and r of the gravity torque m g r sin(theta_l)
    gravity_arm_m: float
    stiffness_nm_per_rad: float  # K_s of the coupling, load side
    position_gain_per_s: float  # K_pos, speed correction per position error
    speed_gain_nms_per_rad: float  # K_p, K_i, K_d of the speed loop, motor side
    integral_gain_nm_per_rad: float
    derivative_gain_nms2_per_rad: float = 0.0  # acts on the measured speed only
    leaky_gain_nm_per_rad: float = 0.0  # K_w, which may be negative
    leaky_rate_per_s: float = 0.0  # at which w forgets
    torque_lag_s: float = 0.0  # time constant of the torque (current) loop; 0 for none
    control_period_s: float = 5e-4  # the drive samples and computes once a period,
    control_delay_periods: int = 1  # and applies the torque so many later, held for a period
    start_angle_rad: float = 0.0  # load angle at t = 0, from hanging straight down
    lead_s: float = 0.0  # how long before t = 0 the joint starts, at the commanded speed and with teeth in contact
    damping_nms_per_rad: float = 0.0  # D_s of the coupling, load side
    alpha_per_rad: float = 1e6  # sharpness of the edge in equation 8
    clamped: bool = False  # the clamped dead zone in place of equations 8 and 9
    motor_viscous_nms_per_rad: float = 0.0  # friction, each on its own side
    load_viscous_nms_per_rad: float = 0.0
    motor_coulomb_nm: float = 0.0
    load_coulomb_nm: float = 0.0
    commanded_speed_rps: float = 100.0  # of the motor
    torque_limit_nm: float = math.inf  # of the motor; the integrals stop while it binds
    encoder_bits: int = 0  # of the position that the drive sees; 0 for the true position
    # The drive differences its position instead of knowing the true speed.
    speed_by_differencing: bool = False
    disturbances: tuple[Disturbance, ...] = ()  # added up

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
            **{ratio: getattr(self, gain) / jm for ratio, gain in GAINS.items()},
            **{name: getattr(self, name) for name in PLAIN_RATIOS},
        }


def _physical(
    ratios: Mapping[str, float], gear_ratio: float, load_mass_kg: float
) -> dict[str, Any]:
    """Fields of a joint with a point load: J_l = m r**2, so g / r gives the arm and the mass the scale."""
    r = dict(ratios)
    try:
        arm = GRAVITY / r.pop("gravity_per_s2")
        jl = load_mass_kg * arm**2
        jm = jl / (gear_ratio**2 * r.pop("inertia_ratio"))
        scaled = {
            "motor_inertia_kgm2": jm,
            "load_inertia_kgm2": jl,
            "gravity_arm_m": arm,
            "stiffness_nm_per_rad": jl * r.pop("stiffness_per_s2"),
            **{gain: jm * r.pop(ratio) for ratio, gain in GAINS.items()},
            **{name: r.pop(name) for name in PLAIN_RATIOS},
        }
    except (KeyError, ZeroDivisionError) as error:
        raise ValueError(
            f"missing or zero ratio ({error}); JointParameters.ratios has them all"
        ) from None
    if r:
        raise ValueError(f"unknown ratios {sorted(r)}; JointParameters.ratios has them all")
    return scaled


def joint_from_ratios(
    ratios: Mapping[str, float],
    *,
    gear_ratio: float = 40.0,
    load_mass_kg: float = 5.0,
    **others: Any,
) -> JointParameters:
    """Physical parameters of a joint with a point load that has all ratios of ``JointParameters.ratios``.

    The load's mass sets the scale of all torques; `others` are further fields of `JointParameters`.
    """
    physical = _physical(ratios, gear_ratio, load_mass_kg)
    return JointParameters(gear_ratio=gear_ratio, load_mass_kg=load_mass_kg, **physical, **others)


def with_ratios(parameters: JointParameters, ratios: Mapping[str, float]) -> JointParameters:
    """Return the joint with some of its ratios replaced and the rest kept.

    Its load becomes a point load.
    """
    merged = parameters.ratios | dict(ratios)
    return replace(parameters, **_physical(merged, parameters.gear_ratio, parameters.load_mass_kg))


def changeable(joint: JointParameters) -> tuple[str, ...]:
    """Names of what `changed_joint` takes: a joint's ratios, and its physical quantities that are not zero."""
    numbers = {name: value for name, value in vars(joint).items() if isinstance(value, float)}
    physical = {name for name, value in numbers.items() if 0 < abs(value) < math.inf}
    return tuple(sorted(physical | set(joint.ratios)))


def changed_joint(joint: JointParameters, factors: Mapping[str, float]) -> JointParameters:
    """Multiply some of a joint's ratios, the other ratios kept, then physical quantities, all others kept."""
    if unknown := set(factors) - set(changeable(joint)):
        raise ValueError(
            f"cannot change {', '.join(sorted(unknown))}; there are {', '.join(changeable(joint))}"
        )
    before = joint.ratios
    if ratios := {
        name: factor * before[name] for name, factor in factors.items() if name in before
    }:
        joint = with_ratios(joint, ratios)
    return replace(
        joint,
        **{name: factors[name] * getattr(joint, name) for name in factors if name not in ratios},
    )


def identified_joint() -> JointParameters:
    """Return the joint identified from the published signals (``data/joint.json``)."""
    data = json.loads(files("replication").joinpath("data/joint.json").read_text(encoding="utf-8"))
    names = ("stiffness_per_s2", "gravity_per_s2", "inertia_ratio", *GAINS, *PLAIN_RATIOS)
    return joint_from_ratios(dict(zip(names, data["ratios"].values(), strict=True)))
