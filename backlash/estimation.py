"""The virtual sensor on one log: is there backlash, how much, how sure; or why that cannot be told.

A log is read, prepared, searched for a pattern, fitted and judged. Without a pattern in its half turns the verdict is
"no backlash" only where this noise could not have hidden the calibration's least backlash. With one, the method's model
must explain most of it, and the calibration must hold the reading in its range.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from backlash import __version__
from backlash.calibration import Backlash, Calibration, OwnCalibration, default_calibration, read_calibration, widened
from backlash.fitting import SELF, TORQUE
from backlash.fitting.global_fit import GlobalFit, global_fit
from backlash.fitting.readings import Reading, protocol_for, read, reading_of_fit
from backlash.fitting.self_calibration import SelfFit, fit_joint, weak_turn
from backlash.fitting.torque import LoadData, fit_torque
from backlash.fitting.waveform import LEAST_LEVELS
from backlash.logs import hash_file, name_of, open_log
from backlash.reading.columns import LogFormat
from backlash.reading.detect import Presence, band_energy, detect_pattern, explained_share, typical_half_turn
from backlash.refusals import CannotTell, UnusableLog
from replication.arrays import FloatArray
from replication.recording import Recording
from replication.signature import signature

_LEAST_SHARE = 0.8  # of the pattern's energy, for the model to explain; it explains 0.96 or more in the paper's range
# A backlash below this counts as none: 0.015 mm at an arm of 0.3 m, a sixth of Table 2's least.
_NEGLIGIBLE_RAD = 5e-5
_OFF = 0.05  # of the amplitude; searches that all end in the best minimum differ less from the global fit
_FAR_OUTSIDE = 1.2  # times the value at the end of the range; a cubic beyond means nothing
_ADVICE = (
    "method self knows joints under a drive of the paper's kind; for any other, calibrate on the joint itself: "
    f"backlash calibrate, with its logs at {LEAST_LEVELS} or more known backlashes, method waveform, or --torque"
)


@dataclass(frozen=True)
class Settings:
    """How logs are read and measured; the calibration, the user's own or the paper's joint's, holds the method."""

    form: LogFormat
    calibration: Calibration
    is_own: bool  # the user made the calibration; else it is that of the paper's joint
    repeats: int  # searches of method "paper"
    seed: int  # of the first of them, and of what method "torque" draws, above 0
    load: LoadData | None = None  # for method "torque"


@dataclass(frozen=True)
class Estimate:
    """The answer on one log; what is not known is None. The backlash is half of the total play; `print` shows it."""

    file: str
    verdict: str = "cannot tell"  # or "backlash", "no backlash"
    amplitude_rps: float | None = None  # of the oscillation after an impact
    amplitude_interval_rps: tuple[float, float] | None = None  # 95 %
    backlash_rad: float | None = None  # half of the play: the teeth are free over twice that
    backlash_interval_rad: tuple[float, float] | None = None  # 95 %
    rmse_rps: float | None = None  # misfit of the fitted model
    method: str = SELF
    turn_period_s: float | None = None  # of the load
    samples: int = 0  # of the record that was used
    warnings: tuple[str, ...] = ()  # the reason first where the verdict is "cannot tell", then what was assumed
    ring_hz: float | None = None  # by method self: slowest oscillation with the teeth in contact
    damping_ratio: float | None = None  # of that
    friction_share: float | None = None  # of the load, over m g r
    sha256: str | None = None  # of the log file's bytes
    calibration: str = ""  # what it was made from
    backlash_intervals_rad: tuple[tuple[float, float], ...] = ()  # by method self, if separate: likely first

    @property
    def relative_index_rps(self) -> float | None:
        """The amplitude where it is all there is: only comparable between logs of one joint in one movement."""
        return self.amplitude_rps if self.verdict == "cannot tell" else None

    def to_dict(self) -> dict[str, object]:
        """The attributes in order, ready for JSON, then the play, the relative index and the program's version."""
        half, ends = self.backlash_rad, self.backlash_interval_rad
        row = {name: list(value) if isinstance(value, tuple) else value for name, value in vars(self).items()}
        return row | {
            "half_play_rad": half, "half_play_interval_rad": ends and list(ends),
            "total_play_rad": None if half is None else 2 * half,
            "total_play_interval_rad": ends and [2 * end for end in ends],
            "relative_index_rps": self.relative_index_rps, "version": __version__,
        }  # fmt: skip

    def __str__(self) -> str:
        """The answer for people: a line with it, then one for each number and each warning."""
        notes = self.warnings
        if self.backlash_rad is None or self.backlash_interval_rad is None:
            answer, notes = f"cannot tell: {notes[0]}", notes[1:]
        elif self.verdict == "no backlash":
            answer = f"no backlash (less than {1e3 * self.backlash_interval_rad[1]:.3f} mrad, half of the play)"
        else:
            low, high = (1e3 * end for end in self.backlash_interval_rad)
            answer = f"backlash {1e3 * self.backlash_rad:.3f} mrad (half of the play; 95 %: {low:.3f} to {high:.3f})"
        lines = [f"{self.file}: {answer}"]
        if self.amplitude_rps and self.amplitude_interval_rps:
            low, high = self.amplitude_interval_rps
            lines.append(f"  amplitude {self.amplitude_rps:.3f} rps ({low:.3f} to {high:.3f}), method {self.method}")
            if self.relative_index_rps:
                lines[-1] += "; a relative index: compare it only with logs of this joint in this movement"
        if self.ring_hz is not None and self.friction_share is not None:
            lines.append(
                f"  the joint: rings at {self.ring_hz:.1f} Hz, damping ratio {self.damping_ratio:.3f}, "
                f"load friction {max(self.friction_share, 0.0):.1%} of gravity"
            )
        if self.rmse_rps is not None:
            turn = f"turn of {self.turn_period_s:.5g} s"
            lines.append(f"  misfit {self.rmse_rps:.3f} rps, {self.samples} samples, {turn}")
        return "\n".join([*lines, *(f"  note: {note}" for note in notes)])


as_row, as_text = Estimate.to_dict, Estimate.__str__


@dataclass(frozen=True)
class Examined:
    """An estimate with what it was made from, for a plot: the record and the fitted model at its samples [rps]."""

    estimate: Estimate
    recording: Recording | None = None
    model_rps: FloatArray | None = None


def settings_for(
    form: LogFormat, calibration: OwnCalibration = None, method: str | None = None, repeats: int = 30, seed: int = 1,
    inertia_ratio: float | None = None, gravity_per_s2: float | None = None, inertia_sd: float = 0.1,
    gravity_sd: float = 0.05,
) -> Settings:  # fmt: skip
    """Put settings together: without a calibration the log's own joint, or for another method the paper's."""
    calibration, load = read_calibration(calibration), None
    given = {"--torque": form.torque, "--inertia-ratio": inertia_ratio, "--gravity": gravity_per_s2}
    missing = [option for option, value in given.items() if value is None]
    if method == TORQUE or len(missing) < len(given):
        if calibration is not None or method not in (None, TORQUE):
            raise UnusableLog("method torque goes without a calibration or another method: leave out one of them")
        if inertia_ratio is None or gravity_per_s2 is None or missing:
            raise UnusableLog(f"method torque needs the torque and the load's data: give {' and '.join(missing)} too")
        method, load = TORQUE, LoadData(inertia_ratio, gravity_per_s2, inertia_sd, gravity_sd)
    if calibration is not None and method not in (None, calibration.method):
        raise UnusableLog(f"--method {method}: the calibration is of method {calibration.method}")
    if repeats < 1 or seed < 1:
        raise UnusableLog("--repeats and --seed must be 1 or more")
    if calibration is not None:
        used = calibration
    elif method in (None, SELF, TORQUE):  # needed only to say which backlash would have been seen
        used = replace(default_calibration("amplitude"), method=method or SELF, provenance="none: the log's own joint")
    else:
        used = default_calibration(method)
    form = replace(form, usual_speed_rps=used.commanded_speed_rps)
    return Settings(form, used, calibration is not None, repeats, seed, load)


def examine(source: object, settings: Settings, *arrays: ArrayLike | None) -> Examined:
    """Estimate the backlash that a log tells of (see `open_log`), and keep the record and the fit."""
    try:
        log = open_log(source, settings.form, *arrays)
    except CannotTell as refusal:
        used = settings.calibration
        known = Estimate(name_of(source), method=used.method, calibration=used.provenance, sha256=hash_file(source))
        return Examined(_refused(known, refusal))
    found = examine_recording(log.recording, settings, log.file, log.notes)
    return replace(found, estimate=replace(found.estimate, sha256=log.sha256))


def examine_recording(recording: Recording, settings: Settings, name: str, notes: tuple[str, ...] = ()) -> Examined:
    """Answer for a prepared record: detect a pattern, fit it, judge the fit; `notes` are those of its preparation."""
    calibration = settings.calibration
    answer = Estimate(
        name, method=calibration.method, samples=recording.t.size, turn_period_s=recording.turn_period_s,
        warnings=notes, calibration=calibration.provenance,
    )  # fmt: skip
    model = None
    try:
        recording, presence, note = detect_pattern(recording, settings.form, settings.seed)
        answer = replace(answer, turn_period_s=recording.turn_period_s, warnings=notes + note)
        by_joint = calibration.bank is not None or calibration.method == SELF
        if not presence.found and not (by_joint and presence.has_same_sign):
            answer = _judge_absence(recording, presence, calibration, answer)
        else:
            fit, reading, joint, model = _fit_models(recording, settings)
            answer = replace(
                answer, amplitude_rps=reading.amplitude_rps, amplitude_interval_rps=reading.amplitude_interval_rps,
                rmse_rps=reading.rmse_rps,
            )  # fmt: skip
            if joint is not None:
                answer = replace(
                    answer, rmse_rps=float(np.std(recording.v - model)), ring_hz=joint.ring_hz,
                    damping_ratio=joint.damping, friction_share=joint.friction,
                )  # fmt: skip
                answer = _judge_joint(recording, presence, reading, joint, model, calibration.range_rad[0], answer)
            elif settings.load is not None:
                answer = _judge_torque(recording, settings.load, settings.seed, answer)
            else:
                answer = _judge_reading(recording, presence, fit, reading, model, settings, answer)
    except CannotTell as refusal:
        answer = _refused(answer, refusal)
    return Examined(_finite(answer), recording, model)


def _refused(answer: Estimate, refusal: CannotTell) -> Estimate:
    other_joint = answer.method == SELF and str(refusal).startswith(("no such joint", "no signature"))
    advice = (_ADVICE,) if other_joint else ()
    return replace(answer, warnings=(str(refusal), *advice, *answer.warnings, *refusal.notes))


def _finite(found: Estimate) -> Estimate:
    """An estimate with None for what is not finite."""

    def is_finite(value: object) -> bool:
        numbers = value if isinstance(value, tuple) else (value,)
        return all(math.isfinite(number) for number in numbers if isinstance(number, float))

    kept: dict[str, Any] = {name: value if is_finite(value) else None for name, value in vars(found).items()}
    return Estimate(**kept)


def _fit_models(recording: Recording, settings: Settings) -> tuple[GlobalFit, Reading, SelfFit | None, FloatArray]:
    """The signature, a reading, the joint by method self, and the method's model at the samples, less its mean [rps].

    The reading is of the calibration's method where that knows the movement, else the amplitude.
    """
    calibration, protocol, joint = settings.calibration, protocol_for(recording), None
    try:
        fit = global_fit(recording, protocol)
        if calibration.method == SELF:
            joint = fit_joint(recording)
    except ValueError as error:
        raise CannotTell("too short", str(error)) from error
    reading = reading_of_fit(recording, "amplitude", fit)
    model = signature(recording.t, fit.X, protocol.timing)
    turns = (recording.t - recording.t[0]) / recording.turn_period_s
    if joint is not None:
        phases = np.arange(joint.turn_rps.size + 1) / joint.turn_rps.size
        model = np.interp(turns % 1.0, phases, np.append(joint.turn_rps, joint.turn_rps[0]))
    elif settings.load is None and not calibration.other_movement(recording):
        if calibration.method == "paper":
            reading = read(recording, "paper", None, settings.repeats, settings.seed)
        else:
            reading = reading_of_fit(recording, calibration.method, fit, calibration.bank, settings.is_own)
        if calibration.bank is not None:
            model = calibration.bank.at(reading.value)((turns - reading.shift_turns) % 1.0)
    return fit, reading, joint, model


def _check_movement(recording: Recording, calibration: Calibration) -> None:
    if difference := calibration.other_movement(recording):
        raise CannotTell("extrapolated calibration", f"{difference}; calibrate at the speed of the logs")


def _least_energy(recording: Recording, calibration: Calibration) -> float:
    """Energy [rps^2] that the calibration's least backlash puts into a record's pattern; else see `weak_turn`."""
    if calibration.method in (SELF, TORQUE):
        halves = weak_turn(recording, calibration.range_rad[0]).reshape(2, -1)
        return band_energy((halves[0] - halves[1]) / 2, recording)
    ring, least = typical_half_turn(recording), calibration.range_rad[0]
    if calibration.bank is not None:
        phases = np.arange(ring.size) / (2 * ring.size)
        return band_energy(calibration.bank.at(least)(phases), recording)
    amplitude = calibration.value_at(least)
    if calibration.method == "energy":
        amplitude /= float(np.sqrt(np.mean(ring**2)))
    return amplitude**2 * band_energy(ring, recording)


def _judge_absence(recording: Recording, presence: Presence, calibration: Calibration, answer: Estimate) -> Estimate:
    """Answer where half turns have nothing in common: no backlash, or too much noise to say so."""
    if calibration.method not in (SELF, TORQUE):
        _check_movement(recording, calibration)
    if presence.has_same_sign:
        what = "something repeats itself every turn, but not with the opposite sign half a turn later, as backlash"
        cause = "is there much friction, another axis moving, or mains hum in step with the turn?"
        raise CannotTell("no signature", f"{what} under gravity alone does; {cause}")
    typical = band_energy(typical_half_turn(recording), recording)
    hidden = float(np.sqrt(presence.detectable_rps2 / typical))
    least, rmse = calibration.range_rad[0], float(recording.v.std())
    if presence.detectable_rps2 > _least_energy(recording, calibration):
        noise = f"in this noise ({presence.noise_rps:.3g} rps) an oscillation of up to {hidden:.3g} rps stays hidden"
        backlash = f"more than a backlash of {least:.3g} rad makes"
        raise CannotTell("too noisy", f"nothing found, but {noise}, {backlash}; log more turns, or quieter")
    return replace(
        answer, verdict="no backlash", amplitude_rps=0.0, amplitude_interval_rps=(0.0, hidden), backlash_rad=0.0,
        backlash_interval_rad=(0.0, least), rmse_rps=rmse,
    )  # fmt: skip


def _judge_reading(
    recording: Recording, presence: Presence, fit: GlobalFit, reading: Reading, model: FloatArray, settings: Settings,
    answer: Estimate,
) -> Estimate:  # fmt: skip
    """Answer by what the calibration makes of the method's reading."""
    calibration = settings.calibration
    _check_movement(recording, calibration)
    share = explained_share(recording, model, presence)
    if share < _LEAST_SHARE:
        what = f"a pattern repeats itself every turn, but the model explains {max(share, 0.0):.0%} of it"
        raise CannotTell("no signature", f"{what}; a faint backlash, much friction, or another cause")
    notes: tuple[str, ...] = ()
    if abs(reading.amplitude_rps - fit.amplitude_rps) > _OFF * fit.amplitude_rps:
        means = f"their mean is {reading.amplitude_rps:.3f} rps, the best fit has {fit.amplitude_rps:.3f} rps"
        notes += (f"searches ended in other minima: {means}; method amplitude is not prone to this",)
    found = calibration.backlash(reading)
    if _is_outside(reading, found, calibration):
        low, high = calibration.range_rad
        is_match = reading.method == "waveform"
        what = f"the best match, {found.delta_rad:.3g} rad," if is_match else f"its reading, {reading.value:.3g} rps,"
        ends = f", {low:.3g} to {high:.3g} rad" if is_match else ""
        detail = f"a signature is there, but {what} lies past the end of the calibration's range{ends}"
        raise CannotTell("extrapolated calibration", detail, notes)
    if found.extrapolated:
        notes += ("at the edge of the calibration's range",)
    low, high = found.interval_rad
    if not settings.is_own:
        low, high = widened(calibration.method, found.delta_rad, found.interval_rad)
        notes += ("calibrated for the paper's joint, not for yours: give --calibration, or take method self",)
    return replace(
        answer, verdict="backlash", backlash_rad=found.delta_rad, backlash_interval_rad=(max(low, 0.0), high),
        warnings=answer.warnings + notes,
    )  # fmt: skip


def _judge_torque(recording: Recording, load: LoadData, seed: int, answer: Estimate) -> Estimate:
    """Answer by the speed and torque of a log, and name what was said of the load."""
    ratio = f"an inertia ratio of {load.inertia_ratio:g} (SD {load.sd_inertia:.0%})"
    said = f"by the torque, {ratio} and m g r / J_l of {load.gravity_per_s2:g} per s^2 (SD {load.sd_gravity:.0%})"
    try:
        fit = fit_torque(recording, getattr(recording, "torque", np.empty(0)), load, np.random.default_rng(seed))
    except ValueError as error:
        raise CannotTell("wrong torque", str(error), (said,)) from error
    if fit.refusal_reason:
        raise CannotTell("too noisy", fit.refusal_reason, (said,))
    inertia = f"the motor's inertia is then {fit.motor_inertia:.3g}, in the torque's unit over rad/s^2: is that right?"
    answer = replace(answer, verdict="backlash", warnings=(*answer.warnings, said, inertia))
    return replace(answer, backlash_rad=fit.delta_rad, backlash_interval_rad=fit.interval_rad)


def _is_outside(reading: Reading, backlash: Backlash, calibration: Calibration) -> bool:
    """Whether a reading lies outside the calibration's range by more than its standard deviation."""
    low, high = calibration.range_rad
    if calibration.bank is not None:
        return backlash.extrapolated
    one_sigma = (backlash.interval_rad[1] - backlash.interval_rad[0]) / 4
    beyond = reading.value > _FAR_OUTSIDE * calibration.value_at(high)
    return beyond or not low - one_sigma <= backlash.delta_rad <= high + one_sigma


def _judge_joint(
    recording: Recording, presence: Presence, amplitude: Reading, joint: SelfFit, model: FloatArray, least_rad: float,
    answer: Estimate,
) -> Estimate:  # fmt: skip
    """Answer by the joint that the log itself tells of; a backlash that may be zero is none, or not known."""
    if joint.refusal_reason:
        where = f"worst at {joint.worst_phase:.2f} turns from the load hanging down"
        raise CannotTell("no such joint", f"{joint.refusal_reason}, {where}")
    separate = (joint.interval_rad, *joint.other_intervals_rad)
    low, high = min(ends[0] for ends in separate), max(ends[1] for ends in separate)
    if low <= 0 and high > least_rad:
        raise CannotTell("too noisy", f"none fits as well as up to {high:.3g} rad; log more turns, or quieter")
    if high <= _NEGLIGIBLE_RAD or (high <= least_rad and not presence.found):  # such a pattern has another cause
        low = 0.0
    if presence.found and explained_share(recording, model, presence) < _LEAST_SHARE:
        raise CannotTell("no signature", "a pattern repeats itself every turn, but no backlash that explains it")
    ranges = " or ".join(f"{1e3 * first:.3f} to {1e3 * last:.3f} mrad" for first, last in separate)
    notes = (f"separate backlashes fit: {ranges}",) if joint.other_intervals_rad else ()
    return replace(
        answer, verdict="backlash" if low > 0 else "no backlash", backlash_rad=joint.delta_rad if low > 0 else 0.0,
        backlash_interval_rad=(low, high), backlash_intervals_rad=separate if joint.other_intervals_rad else (),
        warnings=answer.warnings + notes + _disagreement(recording, amplitude, joint),
    )  # fmt: skip


def _disagreement(recording: Recording, amplitude: Reading, joint: SelfFit) -> tuple[str, ...]:
    """A note where the amplitude, with what it may err on any joint, is another backlash than the joint's."""
    calibration = default_calibration("amplitude")
    if calibration.other_movement(recording):
        return ()
    other = calibration.backlash(amplitude)
    low, high = widened("amplitude", other.delta_rad, other.interval_rad)
    agree = low <= joint.interval_rad[1] and joint.interval_rad[0] <= high
    if agree or _is_outside(amplitude, other, calibration):
        return ()
    says = f"the amplitude alone says {low:.3g} to {high:.3g} rad on joints like the paper's"
    return (f"{says}: yours is another, or one of the two is wrong",)
