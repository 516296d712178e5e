"""The answer on a log, for people and as rows of a table."""

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from backlash import __version__
from backlash.refusals import Reason, Refusal, one_line
from replication.signature import FloatArray

TORQUE, AMPLITUDE = "torque", "amplitude"
TORQUE_SIGNAL = "torque [log's unit]"
BACKLASH, NONE = "backlash", "no backlash"
CANNOT_TELL = "cannot tell"


class Trace(NamedTuple):
    """What was fitted: time [s], the measured signal and the model's, both at the samples, and the signal's name."""

    t: FloatArray
    measured: FloatArray
    model: FloatArray
    signal: str


@dataclass(frozen=True)
class Estimate:
    """The answer on one log; what is not known is None. The backlash is half of the total play; `print` shows it."""

    file: str
    verdict: str = CANNOT_TELL  # or "backlash", "no backlash"
    reason: str | None = None  # of "cannot tell", a value of `Reason`
    explanation: str = ""  # a sentence
    backlash_rad: float | None = None  # half of the play: the teeth are free over twice that
    backlash_interval_rad: tuple[float, float] | None = None  # 95 %
    amplitude_rps: float | None = None  # A of the signature, of method amplitude
    amplitude_interval_rps: tuple[float, float] | None = None  # 95 %
    method: str = AMPLITUDE  # or "torque"
    chi_squared: float | None = None  # per compared number; about 1 where model and noise are right
    # By the torque: stiffness K_s / J_l, damping ratio, the soft part beyond the gap, load friction over
    # gravity, loss, gravity m g r / J_l, inertia ratio, motor inertia in the torque's unit, the torque's delay and
    # low-pass, the speed's lag; each with its SD.
    joint: dict[str, tuple[float, float]] | None = None
    turn_period_s: float | None = None  # of the load
    speed_rps: float | None = None  # of the signal's side, in the mean
    # Which, where the joint moves to and fro: the backlash is that at the hanging position.
    strokes: str = ""
    samples: int = 0  # of the record that was used
    arm_m: float | None = None  # at which the play is wanted, too
    columns: str = ""  # that were read, with their units
    notes: tuple[str, ...] = ()  # what was done and assumed
    sha256: str | None = None  # of the log file's bytes
    trace: Trace | None = field(default=None, compare=False, repr=False)

    def with_refusal(self, refusal: Refusal) -> "Estimate":
        """The answer with the reason why there is none."""
        return replace(
            self,
            reason=refusal.reason.value,
            explanation=refusal.sentence,
            columns=self.columns or refusal.columns,
            notes=(*self.notes, *refusal.notes),
        )

    @property
    def is_unusable(self) -> bool:
        """Whether the log could not be used."""
        return self.reason == Reason.UNUSABLE.value

    def to_dict(self) -> dict[str, Any]:
        """The attributes but the trace, in order, ready for JSON, then the total play and the version."""
        half, ends = self.backlash_rad, self.backlash_interval_rad
        attributes = {name: value for name, value in vars(self).items() if name != "trace"}
        return attributes | {
            "total_play_rad": None if half is None else 2 * half,
            "total_play_interval_rad": ends and (2 * ends[0], 2 * ends[1]),
            "version": __version__,
        }

    def __str__(self) -> str:
        """The answer for people: a line with it, then one for each number and each note."""
        lines = [one_line(f"{self.file}: {self.summary}")]
        if self.amplitude_rps and self.amplitude_interval_rps:
            low, high = self.amplitude_interval_rps
            lines.append(
                f"  amplitude {self.amplitude_rps:.3f} rps ({low:.3f} to {high:.3f}), an index: compare it only with "
                "logs of this joint in this movement"
            )
        if self.joint:
            lines += [f"  {line}" for line in describe_joint(self.joint)]
        if self.columns:
            lines.append(f"  columns: {one_line(self.columns)}")
        movement = self.strokes
        if self.turn_period_s:
            movement = f"turn of {self.turn_period_s:.5g} s"
        if movement:
            fit = "" if self.chi_squared is None else f", chi squared {self.chi_squared:.2f}"
            lines.append(f"  method {self.method}, {self.samples} samples, {movement}{fit}")
        return "\n".join([*lines, *(f"  note: {one_line(note)}" for note in self.notes)])

    @property
    def summary(self) -> str:
        """The answer in a line."""
        if self.backlash_rad is None or self.backlash_interval_rad is None:
            return f"{CANNOT_TELL}: {self.reason}: {self.explanation}"
        low, high = (1e3 * end for end in self.backlash_interval_rad)
        place = " at the hanging position" if self.strokes else ""
        if self.verdict == NONE:
            return f"no backlash{place} (less than {high:.3f} mrad, half of the play)"
        whole = 2 * self.backlash_rad
        at_arm = f", {1e3 * whole * self.arm_m:.3g} mm at {self.arm_m:g} m" if self.arm_m else ""
        return (
            f"backlash {1e3 * self.backlash_rad:.3f} mrad{place}, half of the play (95 %: {low:.3f} to {high:.3f}); "
            f"the whole play {1e3 * whole:.3g} mrad, {60 * np.degrees(whole):.3g} arcmin{at_arm}"
        )


def describe_joint(joint: dict[str, tuple[float, float]]) -> list[str]:
    """Quantities that a user may compare with the data sheet."""
    stiffness = ""
    if "stiffness_per_s2" in joint:
        value = joint["stiffness_per_s2"][0]
        ring_hz = np.sqrt(value) / (2 * np.pi)
        stiffness = f"stiffness {value:.3g} per s^2 of the load's inertia ({ring_hz:.1f} Hz with the motor held), "
    # Fits may end a little below zero, where nothing is.
    filter_ms, soft_mrad = (max(joint[name][0], 0.0) for name in ("torque_filter_ms", "soft_mrad"))
    friction = ""
    if "friction_share" in joint:
        friction = f", load friction {joint['friction_share'][0]:.1%} of gravity"
    return [
        f"{stiffness}gear efficiency {1 / (1 + joint['loss'][0]):.2f}{friction}: as in the data sheet?",
        f"gravity {joint['gravity_per_s2'][0]:.3g} per s^2, inertia ratio {joint['inertia_ratio'][0]:.3g} (by what was "
        f"given and by the log: right?), motor inertia {joint['motor_inertia'][0]:.3g} torque s^2/rad, torque "
        f"{joint['torque_delay_ms'][0]:.1f} ms late and low-passed by {filter_ms:.1f} ms; teeth softer "
        f"over {soft_mrad:.2f} mrad beyond the gap",
    ]
