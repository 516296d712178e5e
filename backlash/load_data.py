"""What must be known of the load: by its two ratios, or by its masses."""

from dataclasses import dataclass
from numbers import Real

from backlash.refusals import Refusal, check_positive
from replication.joint import GRAVITY

_MOST_BELOW = 0.1  # of an inertia that was measured, below the least that its mass has


@dataclass(frozen=True)
class LoadData:
    """The load, by its data sheet or the drive's autotune, each number with a relative SD."""

    inertia_ratio: (
        float  # rho = J_l / (N^2 J_m): of the load, seen from the motor, to the motor's own
    )
    gravity_per_s2: float  # m g r / J_l: 9.81 / r for a point load
    inertia_sd: float = 0.1
    gravity_sd: float = 0.05
    motor_inertia_kgm2: float | None = None  # tells the torque's unit
    note: str = ""  # what was made of what was given

    def __post_init__(self):
        """Refuse what no load has."""
        check_positive(
            inertia_ratio=self.inertia_ratio,
            gravity=self.gravity_per_s2,
            motor_inertia=self.motor_inertia_kgm2,
        )
        for sd in (self.inertia_sd, self.gravity_sd):
            if not (isinstance(sd, Real) and 0 <= sd <= 0.5):
                raise Refusal(f"a relative SD of {sd!r}: give 0, or a share above 0 up to 0.5")

    def __str__(self) -> str:
        ratio = f"an inertia ratio of {self.inertia_ratio:g} (SD {self.inertia_sd:.0%})"
        gravity = f"m g r / J_l of {self.gravity_per_s2:g} per s^2 (SD {self.gravity_sd:.0%})"
        return f"by the torque, {ratio} and {gravity}{self.note}"


def load_from_masses(
    gear_ratio: float,
    motor_inertia_kgm2: float,
    load_mass_kg: float,
    load_arm_m: float,
    load_inertia_kgm2: float | None = None,
    **sds: float,
) -> LoadData:
    """Find both ratios from the mass of all that the joint moves and the arm of its centre of mass.

    Its inertia is about the joint's axis; without one the load is a point.
    """
    check_positive(
        motor_inertia_kgm2=motor_inertia_kgm2,
        load_mass_kg=load_mass_kg,
        load_arm_m=load_arm_m,
        load_inertia_kgm2=load_inertia_kgm2,
    )
    point = load_mass_kg * load_arm_m**2
    inertia = load_inertia_kgm2 or point
    note = ""
    if inertia < (1 - _MOST_BELOW) * point:
        raise Refusal(
            f"--load-inertia {inertia:g}: its mass at its arm alone has {point:.4g} kg m^2; "
            "give the inertia about the joint's axis, not about the centre of mass"
        )
    if inertia < point:
        note = (
            f"; the load's inertia {inertia:g} is below m r^2 = {point:.4g} kg m^2: that was taken"
        )
        inertia = point
    return LoadData(
        inertia / (gear_ratio**2 * motor_inertia_kgm2),
        GRAVITY * load_mass_kg * load_arm_m / inertia,
        motor_inertia_kgm2=motor_inertia_kgm2,
        note=note,
        **sds,
    )
