"""From a log to its answer: the backlash, none, or why that cannot be told."""

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from backlash import __version__, turns
from backlash.load_data import LoadData
from backlash.reading.prepare import Log, open_log
from backlash.reading.sources import name_of
from backlash.refusals import Reason, Refusal, one_line
from backlash.settings import Settings, settings_for
from backlash.torque import fit_torque
from replication.signature import FloatArray

TORQUE, AMPLITUDE = "torque", "amplitude"
BACKLASH, NONE, CANNOT_TELL = "backlash", "no backlash", "cannot tell"


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
    samples: int = 0  # of the record that was used
    arm_m: float | None = None  # at which the play is wanted, too
    columns: str = ""  # that were read, with their units
    notes: tuple[str, ...] = ()  # what was done and assumed
    sha256: str | None = None  # of the log file's bytes
    trace: Trace | None = field(default=None, compare=False, repr=False)

    def without(self, refusal: Refusal) -> "Estimate":
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
        row = {name: value for name, value in vars(self).items() if name != "trace"}
        half, ends = self.backlash_rad, self.backlash_interval_rad
        return row | {
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
        if self.turn_period_s:
            fit = "" if self.chi_squared is None else f", chi squared {self.chi_squared:.2f}"
            lines.append(
                f"  method {self.method}, {self.samples} samples, turn of {self.turn_period_s:.5g} s{fit}"
            )
        return "\n".join([*lines, *(f"  note: {one_line(note)}" for note in self.notes)])

    @property
    def summary(self) -> str:
        """The answer in a line."""
        if self.backlash_rad is None or self.backlash_interval_rad is None:
            return f"{CANNOT_TELL}: {self.reason}: {self.explanation}"
        low, high = (1e3 * end for end in self.backlash_interval_rad)
        if self.verdict == NONE:
            return f"no backlash (less than {high:.3f} mrad, half of the play)"
        told = f"backlash {1e3 * self.backlash_rad:.3f} mrad"
        also = f"{60 * np.degrees(self.backlash_rad):.2f} arcmin"
        if self.arm_m:
            also += f", {1e3 * self.backlash_rad * self.arm_m:.3f} mm at {self.arm_m:g} m"
        return f"{told} (half of the play; 95 %: {low:.3f} to {high:.3f}; {also})"


def describe_joint(joint: dict[str, tuple[float, float]]) -> list[str]:
    """Quantities that a user may compare with the data sheet."""
    ring_hz = np.sqrt(joint["stiffness_per_s2"][0]) / (2 * np.pi)
    # Fits may end a little below zero, where nothing is.
    filter_ms, soft_mrad = (max(joint[name][0], 0.0) for name in ("torque_filter_ms", "soft_mrad"))
    return [
        f"stiffness {joint['stiffness_per_s2'][0]:.3g} per s^2 of the load's inertia ({ring_hz:.1f} Hz with the motor "
        f"held), gear efficiency {1 / (1 + joint['loss'][0]):.2f}, load friction {joint['friction_share'][0]:.1%} of "
        "gravity: as in the data sheet?",
        f"gravity {joint['gravity_per_s2'][0]:.3g} per s^2, inertia ratio {joint['inertia_ratio'][0]:.3g} (by what was "
        f"given and by the log: right?), motor inertia {joint['motor_inertia'][0]:.3g} torque s^2/rad, torque "
        f"{joint['torque_delay_ms'][0]:.1f} ms late and low-passed by {filter_ms:.1f} ms; teeth softer "
        f"over {soft_mrad:.2f} mrad beyond the gap",
    ]


def read_log(log: object, v: ArrayLike | None = None, **given: Any) -> Log:
    """Read a log's stretch of constant speed; parameters as in `estimate`.

    Returns
    -------
    Log
        Its `recording` has t [s] and v [rps], each of shape (samples,).

    Raises
    ------
    Refusal
        The file is no usable log, or too short or uneven for any answer.

    Examples
    --------
    >>> import backlash
    >>> log = backlash.read_log("log.csv", gear_ratio=40)
    >>> print(log.recording.v.size, round(log.recording.turn_period_s, 4))
    2401 0.4
    """
    form = settings_for(log, given).form
    return open_log(log, form, v, given.get("torque"))


def estimate(log: object, v: ArrayLike | None = None, **given: Any) -> Estimate:
    """Estimate the backlash, which is half of the total play, that a log tells of.

    Parameters
    ----------
    log : str, Path, DataFrame, Log, or array of shape (samples,)
        A file, "-" for the standard input, a table, what `read_log` returned, or the time stamps [s] of `v`.
    v : array of shape (samples,), optional
        Motor speed, in `unit`, which has to be said; with `position=True` its position, in the turns (rps), rad
        (rad/s) or counts that go with `unit`.
    turn_period_s, gear_ratio : float
        Of the load [s], and motor turns in a load turn (1 where the signals are the joint's); one is needed.
    torque : str or array of shape (samples,), optional
        Column, or the motor's torque or current, positive where it drives forward, in any unit. Needs
        `inertia_ratio`, J_l / (N^2 J_m), and `gravity_per_s2`, m g r / J_l, of the load, or `gear_ratio`,
        `motor_inertia_kgm2`, `load_mass_kg`, `load_arm_m`, and `load_inertia_kgm2` about the joint's axis if the load
        is no point; `inertia_sd` (0.1) and `gravity_sd` (0.05) are relative SDs.
        Without a torque there is no backlash, but the paper's index A.
    **given
        `time`, `speed`, `position` (columns), `unit`, `counts_per_turn`, `rate_hz`, `commanded_speed_rps`, `start_s`,
        `end_s`, `trust_period`: as the command line's options.

    Returns
    -------
    Estimate
        `verdict` ("backlash", "no backlash" or "cannot tell" with `reason` and `explanation`), `backlash_rad` with its
        95 % `backlash_interval_rad`, `joint` (quantities with SDs), `chi_squared`, `columns`, `notes`, and `trace` with
        what was measured and the model; None where nothing is known.

    Raises
    ------
    Refusal
        The log or what is given of it cannot be used.

    Examples
    --------
    >>> import backlash
    >>> answer = backlash.estimate(t, v, torque=torque, gear_ratio=100, inertia_ratio=2.0, gravity_per_s2=30.0)
    >>> print(answer.verdict, answer.backlash_rad, answer.backlash_interval_rad)
    backlash 0.001 (0.0009, 0.0011)
    """
    return examine(log, settings_for(log, given), v, given.get("torque"))


def examine(
    log: object, settings: Settings, v: ArrayLike | None = None, torque: ArrayLike | None = None
) -> Estimate:
    """Answer for a log, wherever it comes from."""
    answer = Estimate(
        name_of(log), method=TORQUE if settings.load else AMPLITUDE, arm_m=settings.arm_m
    )
    try:
        read = open_log(log, settings.form, v, torque)
        answer = _with_log(answer, read, settings)
        read = _with_own_period(read)
        answer = _with_log(answer, read, settings)
        if settings.load:
            return _answer_by_torque(read, settings.load, answer)
        return _answer_by_amplitude(read, answer)
    except Refusal as refusal:
        if refusal.is_unusable:
            raise
        return answer.without(refusal)


def _with_log(answer: Estimate, log: Log, settings: Settings) -> Estimate:
    """The answer with what was read."""
    return replace(
        answer,
        file=log.file,
        sha256=log.sha256,
        samples=log.recording.t.size,
        turn_period_s=log.recording.turn_period_s,
        speed_rps=float(log.recording.v.mean()),
        columns=log.columns,
        notes=(*log.notes, *([str(settings.load)] if settings.load else [])),
    )


def examine_or_refuse(log: object, settings: Settings | Refusal) -> Estimate:
    """Examine one log; say why where that fails, in whatever way."""
    try:
        if isinstance(settings, Refusal):
            raise settings
        return examine(log, settings)
    except Refusal as refusal:
        return refused(log, str(refusal))
    except Exception as error:  # one log must not stop a thousand others
        return refused(log, f"{name_of(log)}: {type(error).__name__}: {error}")


def refused(log: object, why: str) -> Estimate:
    """The answer on a log that cannot be used."""
    return Estimate(name_of(log)).without(Refusal(why))


def _with_own_period(log: Log) -> Log:
    """The log with the period that its turns have; of a torque gravity's, which no other line may dominate."""
    recording, given = log.recording, log.recording.turn_period_s
    if log.form.trust_period:
        return log
    if log.torque is None:
        period = turns.period_by_energy(recording, recording.v)
    else:
        other = turns.dominant_period(recording, log.torque)
        period = other or turns.period_by_torque(recording, log.torque)
        if not turns.is_near_period(recording, period):
            instead = f"--turn-period {period:.4g}"
            if log.form.gear_ratio:
                instead = f"--gear-ratio {log.form.gear_ratio * period / given:.4g}"
            raise Refusal(
                f"the torque's strongest line comes every {period:.4g} s, not every {given:.4g} s: if it is gravity's, "
                f"{instead}; if the turn given is right, --trust-period",
                Reason.WRONG_PERIOD,
            )
    if turns.is_same_period(recording, period):
        return log
    note = f"the record repeats itself every {period:.5f} s, not every {given:.5f} s: used that"
    own = replace(recording, turn_period_s=period)
    return replace(log, recording=own, notes=(*log.notes, note))


def _answer_by_torque(log: Log, load: LoadData, answer: Estimate) -> Estimate:
    """Answer by speed and torque."""
    if log.torque is None:
        raise Refusal("the log was read without its torque: give torque to read_log")
    fit = fit_torque(log.recording, log.torque, load)
    if fit.is_none and log.is_links_side:
        raise Refusal(
            "signals of the joint's side hardly show a play, and these show none: log the motor's encoder",
            Reason.JOINTS_SIDE,
        )
    notes = answer.notes
    if load.motor_inertia_kgm2:
        unit = load.motor_inertia_kgm2 / fit.joint["motor_inertia"][0]
        notes += (
            f"the torque's unit is {unit:.3g} N m (of a current: the torque constant): right?",
        )
    return replace(
        answer,
        verdict=NONE if fit.is_none else BACKLASH,
        backlash_rad=0.0 if fit.is_none else fit.delta_rad,
        backlash_interval_rad=(0.0, fit.interval_rad[1]) if fit.is_none else fit.interval_rad,
        chi_squared=fit.chi_squared,
        joint=fit.joint,
        notes=notes,
        trace=Trace(log.recording.t, log.torque, fit.model_torque, "torque [log's unit]"),
    )


def _answer_by_amplitude(log: Log, answer: Estimate) -> Estimate:
    """The paper's index of the speed, where there is no torque to tell the backlash."""
    from backlash.amplitude import measure_amplitude  # with a search that the torque does not need

    recording = log.recording
    if measured := measure_amplitude(recording):
        amplitude, half, model = measured
        answer = replace(
            answer,
            amplitude_rps=amplitude,
            amplitude_interval_rps=(max(amplitude - half, 0.0), amplitude + half),
            trace=Trace(recording.t, recording.v, model, "motor speed [rps]"),
        )
    return answer.without(
        Refusal(
            "the speed alone gives an index of this joint in this movement, no backlash: log the torque",
            Reason.NO_TORQUE,
        )
    )
