"""The virtual sensor on one log: is there backlash, how much, how sure; or why that cannot be told.

The verdict comes in this order. The record's own period must be the given one (`presence.own_period`). Half turns must
have a pattern in common (`presence.find_pattern`, a permutation test at a false-alarm rate of 1 %). If they have none,
the verdict is "no backlash" only where the calibration's least backlash would have been seen in this noise with a
probability of 95 %; else noise could hide it. If they have one, the method's model must explain most of it; backlash
then is what the calibration makes of the reading, unless that lies outside its range.
"""

from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from replication.characteristic import first_rise
from replication.datasets import FloatArray, Recording
from replication.global_fit.fit import GlobalFit, global_fit
from replication.methods.calibration import PERIOD_MISMATCH, Backlash, Calibration, default_calibration
from replication.methods.readings import Reading, protocol_for, read, reading_of_fit
from replication.methods.self_calibration import SelfFit, fit_joint
from replication.methods.spread import widened
from replication.sensor import SELF
from replication.sensor.columns import LogFormat
from replication.sensor.prepare import CannotTell, read_log
from replication.sensor.presence import (
    PERIOD_TOLERANCE,
    Presence,
    band_energy,
    explained_share,
    find_pattern,
    own_period,
    typical_half_turn,
)
from replication.signature import signature

DEFAULT_METHOD = SELF  # best on a log from nowhere: results/population.csv
_LEAST_SHARE = 0.8  # of the pattern's energy, for the model to explain; it explains 0.96 or more in the paper's range
_OFF = 0.05  # of the amplitude; searches that all end in the best minimum differ less from the global fit
_FAR_OUTSIDE = 1.2  # times the value at the end of the range; a cubic beyond means nothing


@dataclass(frozen=True)
class Settings:
    """How logs are read and measured; the calibration, the user's own or the paper's joint's, holds the method."""

    form: LogFormat
    calibration: Calibration
    is_own: bool = False  # the user made the calibration; else it is that of the paper's joint
    repeats: int = 30  # searches of method "paper"
    seed: int = 1  # of the first of them, above 0


@dataclass(frozen=True)
class Estimate:
    """The answer on one log; what is not known is None. The attributes are the keys of the JSON output.

    Method "self" finds the last three: the slowest oscillation with the teeth in contact, and the load's friction over
    m g r.
    """

    file: str
    verdict: str = "cannot tell"
    amplitude_rps: float | None = None
    amplitude_interval_rps: tuple[float, float] | None = None
    backlash_rad: float | None = None
    backlash_interval_rad: tuple[float, float] | None = None
    rmse_rps: float | None = None
    method: str = DEFAULT_METHOD
    turn_period_s: float | None = None
    samples: int = 0
    warnings: tuple[str, ...] = ()
    ring_hz: float | None = None
    damping_ratio: float | None = None
    friction_share: float | None = None


@dataclass(frozen=True)
class Examined:
    """An estimate with what it was made from, for a plot: the record and the fitted model at its samples [rps]."""

    estimate: Estimate
    recording: Recording | None = None
    model_rps: FloatArray | None = None


# An answer, the model's curve at the record's samples [rps], and why the answer is none.
Measured = tuple[Estimate, FloatArray, CannotTell | None]


def settings_for(
    form: LogFormat, calibration: Calibration | None = None, method: str | None = None, repeats: int = 30, seed: int = 1
) -> Settings:
    """Put settings together: without a calibration the log's own joint, or for another method the paper's.

    Parameters
    ----------
    form : LogFormat
        What is known of the logs.
    calibration : Calibration, optional
        Of the user's joint; it holds the method.
    method : str, optional
        One of `SENSOR_METHODS`.
    repeats, seed : int
        Searches of method "paper", and the first seed, above 0.

    Raises ------ ValueError The calibration is of another method, or a number is out of its range.
    """
    if calibration is not None and method not in (None, calibration.method):
        raise ValueError(f"--method {method}: the calibration is of method {calibration.method}")
    if repeats < 1 or seed < 1:
        raise ValueError("--repeats and --seed must be 1 or more")
    used = calibration or _without_calibration(method or DEFAULT_METHOD)
    return Settings(
        replace(form, usual_speed_rps=used.commanded_speed_rps), used, calibration is not None, repeats, seed
    )


def _without_calibration(method: str) -> Calibration:
    """Calibration of the paper's joint; "self" needs it only to say which backlash would have been seen."""
    if method != SELF:
        return default_calibration(method)
    return replace(default_calibration("amplitude"), method=SELF, provenance="none: the log's own joint")


def estimate(path: Path, settings: Settings) -> Estimate:
    """Estimate the backlash that a log tells of; the first warning is the reason where the verdict is "cannot tell".

    Raises
    ------
    UnusableLog
        The file is no usable log.
    """
    return examine(path, settings).estimate


def examine(path: Path, settings: Settings) -> Examined:
    """Do what `estimate` does, and keep the record and the fit."""
    notes: list[str] = []
    try:
        recording = read_log(path, settings.form, notes)
    except CannotTell as refusal:
        return Examined(Estimate(str(path), method=settings.calibration.method, warnings=(str(refusal), *notes)))
    return examine_recording(recording, settings, str(path), notes)


def examine_recording(recording: Recording, settings: Settings, name: str, notes: list[str]) -> Examined:
    """Answer for a prepared record: detect a pattern, fit it, judge the fit; `notes` follow the reason."""
    answer = Estimate(
        name, method=settings.calibration.method, samples=recording.t.size, turn_period_s=recording.turn_period_s
    )
    model, refusal = None, None
    try:
        recording, presence = with_its_period(recording, settings.form, settings.seed, notes)
        answer = replace(answer, turn_period_s=recording.turn_period_s)
        by_joint = settings.calibration.bank is not None or settings.calibration.method == SELF
        if not presence.found and not (by_joint and presence.has_same_sign):
            answer = _absent(recording, presence, settings.calibration, answer)
        else:
            fit = _signature_fit(recording)
            measured = _by_joint if settings.calibration.method == SELF else _by_calibration
            answer, model, refusal = measured(recording, presence, fit, settings, answer, notes)
    except CannotTell as found:
        refusal = found
    reason = () if refusal is None else (str(refusal),)
    return Examined(_finite(replace(answer, warnings=(*reason, *notes))), recording, model)


def prepared(path: Path, form: LogFormat, seed: int, notes: list[str]) -> tuple[Recording, Presence]:
    """Read a log as `estimate` does, up to the pattern found in it."""
    return with_its_period(read_log(path, form, notes), form, seed, notes)


def with_its_period(recording: Recording, form: LogFormat, seed: int, notes: list[str]) -> tuple[Recording, Presence]:
    """Check the turn period against the record's own, and take that where the two differ by little."""
    period, given = own_period(recording), recording.turn_period_s
    if period is not None and abs(period / given - 1) > PERIOD_TOLERANCE:
        instead = f"--turn-period {period:.4f}"
        if form.gear_ratio:
            instead = f"--gear-ratio {form.gear_ratio * period / given:.4g}"
        raise CannotTell(
            "wrong period",
            f"the record repeats itself every {period:.4f} s, not every {given:.4f} s; is it {instead}?",
        )
    if period is not None and period != given:
        notes.append(f"the record repeats itself every {period:.5f} s, not every {given:.5f} s: used that")
        recording = replace(recording, turn_period_s=period)
    presence = find_pattern(recording, seed)
    if presence is None:
        raise CannotTell("too short", f"a turn of {given:.3g} s has no room for an oscillation")
    return recording, presence


def _other_movement(recording: Recording, calibration: Calibration) -> CannotTell | None:
    """Say how a record's movement differs from the calibration's; None if it does not."""
    pairs = (
        ("a load turn takes", recording.turn_period_s, calibration.turn_period_s, "s"),
        ("the motor makes", float(recording.v.mean()), calibration.commanded_speed_rps, "rps"),
    )
    for what, here, there, unit in pairs:
        if abs(here / there - 1) > PERIOD_MISMATCH:
            detail = (
                f"{what} {here:.4g} {unit}, in the calibration {there:.4g} {unit}; calibrate at the speed of the logs"
            )
            return CannotTell("extrapolated calibration", detail)
    return None


# ---------------------------------------------------------------------------------------------------------------
# Nothing found


def value_at(calibration: Calibration, delta_rad: float) -> float:
    """Value that a polynomial calibration gives a backlash: the smallest positive one where it grows."""
    return first_rise(calibration.coefficients, delta_rad) or 0.0


def _least_energy(recording: Recording, calibration: Calibration) -> float:
    """Energy [rps^2] that the calibration's least backlash puts into a record's pattern."""
    period = recording.turn_period_s
    ring = typical_half_turn(recording)
    least = calibration.range_rad[0]
    if calibration.bank is not None:
        phases = np.arange(ring.size) / (2 * ring.size)
        return band_energy(calibration.bank.at(least)(phases), period)
    amplitude = value_at(calibration, least)
    if calibration.method == "energy":
        amplitude /= float(np.sqrt(np.mean(ring**2)))
    return amplitude**2 * band_energy(ring, period)


def _absent(recording: Recording, presence: Presence, calibration: Calibration, answer: Estimate) -> Estimate:
    """Answer where half turns have nothing in common: no backlash, or too much noise to say so."""
    if refusal := _other_movement(recording, calibration):
        raise refusal
    if presence.has_same_sign:
        raise CannotTell(
            "no signature",
            "something repeats itself every turn, but not with the opposite sign half a turn later, as backlash under "
            "gravity alone does; is there much friction, another axis moving, or mains hum in step with the turn?",
        )
    typical = band_energy(typical_half_turn(recording), recording.turn_period_s)
    hidden = float(np.sqrt(presence.detectable_rps2 / typical))
    least, rmse = calibration.range_rad[0], float(recording.v.std())
    if presence.detectable_rps2 > _least_energy(recording, calibration):
        raise CannotTell(
            "too noisy",
            f"nothing found, but in this noise ({presence.noise_rps:.3g} rps) an oscillation of up to {hidden:.3g} rps "
            f"stays hidden, more than a backlash of {least:.3g} rad makes; log more turns, or quieter",
        )
    return replace(
        answer, verdict="no backlash", amplitude_rps=0.0, amplitude_interval_rps=(0.0, hidden), backlash_rad=0.0,
        backlash_interval_rad=(0.0, least), rmse_rps=rmse,
    )  # fmt: skip


# ---------------------------------------------------------------------------------------------------------------
# A pattern found


def _signature_fit(recording: Recording) -> GlobalFit:
    try:
        return global_fit(recording, protocol_for(recording))
    except ValueError as error:
        raise CannotTell("too short", str(error)) from error


def _by_calibration(
    recording: Recording, presence: Presence, fit: GlobalFit, settings: Settings, answer: Estimate, notes: list[str]
) -> Measured:
    """Answer by what the calibration makes of the method's reading."""
    calibration = settings.calibration
    if refusal := _other_movement(recording, calibration):
        amplitude = reading_of_fit(recording, "amplitude", fit)
        return _with_amplitude(answer, amplitude), _signature_curve(recording, fit), refusal
    reading = _reading(recording, settings, fit)
    answer = _with_amplitude(answer, reading)
    model = _model_curve(recording, calibration, fit, reading)
    share = explained_share(recording, model, presence)
    if share < _LEAST_SHARE:
        refusal = CannotTell(
            "no signature",
            f"a pattern repeats itself every turn, but the model explains {max(share, 0.0):.0%} of it; a faint "
            "backlash, much friction, or another cause",
        )
        return answer, model, refusal
    if abs(reading.amplitude_rps - fit.amplitude_rps) > _OFF * fit.amplitude_rps:
        notes.append(
            f"searches ended in other minima: their mean is {reading.amplitude_rps:.3f} rps, the best fit has "
            f"{fit.amplitude_rps:.3f} rps; method amplitude is not prone to this"
        )
    backlash = calibration.backlash(reading)
    if _outside(reading, backlash, calibration):
        low, high = calibration.range_rad
        refusal = CannotTell(
            "extrapolated calibration",
            f"a signature is there, but {_value_text(reading, backlash)} lies outside {low:.3g} to {high:.3g} rad",
        )
        return answer, model, refusal
    if backlash.extrapolated:
        notes.append("at the edge of the calibration's range")
    low, high = backlash.interval_rad
    if not settings.is_own:
        low, high = widened(calibration.method, backlash.delta_rad, backlash.interval_rad)
        notes.append("calibrated for the paper's joint, not for yours: give --calibration, or take method self")
    return _with_backlash(answer, backlash.delta_rad, (max(low, 0.0), high)), model, None


def _by_joint(
    recording: Recording, presence: Presence, fit: GlobalFit, _: Settings, answer: Estimate, notes: list[str]
) -> Measured:
    """Answer from the joint that the log itself tells of."""
    amplitude = reading_of_fit(recording, "amplitude", fit)
    try:
        joint = fit_joint(replace(recording, turn_period_s=fit.turn_period_s))
    except ValueError as error:
        raise CannotTell("too short", str(error)) from error
    phases = np.arange(joint.turn_rps.size + 1) / joint.turn_rps.size
    turns = (recording.t - recording.t[0]) / recording.turn_period_s
    model = np.interp(turns % 1.0, phases, np.append(joint.turn_rps, joint.turn_rps[0]))
    answer = replace(
        _with_amplitude(answer, amplitude), rmse_rps=float(np.std(recording.v - model)), ring_hz=joint.ring_hz,
        damping_ratio=joint.damping, friction_share=joint.friction,
    )  # fmt: skip
    if joint.refusal_reason:
        where = f"worst at {joint.worst_phase:.2f} turns from the load hanging down"
        return answer, model, CannotTell("no such joint", f"{joint.refusal_reason}, {where}")
    if explained_share(recording, model, presence) < _LEAST_SHARE:
        refusal = CannotTell("no signature", "a pattern repeats itself every turn, but no backlash that explains it")
        return answer, model, refusal
    _note_disagreement(recording, amplitude, joint, notes)
    return _with_backlash(answer, joint.delta_rad, joint.interval_rad), model, None


def _note_disagreement(recording: Recording, amplitude: Reading, joint: SelfFit, notes: list[str]) -> None:
    """Say so where the amplitude, with what it may err on any joint, is another backlash than the joint's."""
    calibration = default_calibration("amplitude")
    if _other_movement(recording, calibration):
        return
    other = calibration.backlash(amplitude)
    low, high = widened("amplitude", other.delta_rad, other.interval_rad)
    if _outside(amplitude, other, calibration) or (low <= joint.interval_rad[1] and joint.interval_rad[0] <= high):
        return
    notes.append(
        f"the amplitude alone says {low:.3g} to {high:.3g} rad on joints like the paper's: yours is another, or one of "
        "the two is wrong"
    )


def _reading(recording: Recording, settings: Settings, fit: GlobalFit) -> Reading:
    calibration = settings.calibration
    if calibration.method == "paper":
        return read(recording, "paper", None, settings.repeats, settings.seed)
    return reading_of_fit(recording, calibration.method, fit, calibration.bank)


def _with_amplitude(answer: Estimate, reading: Reading) -> Estimate:
    return replace(
        answer, amplitude_rps=reading.amplitude_rps, amplitude_interval_rps=reading.amplitude_interval_rps,
        rmse_rps=reading.rmse_rps, turn_period_s=reading.turn_period_s,
    )  # fmt: skip


def _with_backlash(answer: Estimate, delta_rad: float, interval_rad: tuple[float, float]) -> Estimate:
    return replace(answer, verdict="backlash", backlash_rad=delta_rad, backlash_interval_rad=interval_rad)


def _value_text(reading: Reading, backlash: Backlash) -> str:
    if reading.method == "waveform":
        return f"the best match, {backlash.delta_rad:.3g} rad,"
    return f"its reading, {reading.value:.3g} rps,"


def _outside(reading: Reading, backlash: Backlash, calibration: Calibration) -> bool:
    """Whether a reading lies outside the calibration's range by more than its standard deviation."""
    low, high = calibration.range_rad
    if calibration.bank is not None:
        return backlash.extrapolated
    one_sigma = (backlash.interval_rad[1] - backlash.interval_rad[0]) / 4
    beyond = reading.value > _FAR_OUTSIDE * value_at(calibration, high)
    return beyond or not low - one_sigma <= backlash.delta_rad <= high + one_sigma


def _signature_curve(recording: Recording, fit: GlobalFit) -> FloatArray:
    return signature(recording.t, fit.X, protocol_for(recording).timing)


def _model_curve(recording: Recording, calibration: Calibration, fit: GlobalFit, reading: Reading) -> FloatArray:
    """What the method fits, at a record's samples, less its mean [rps]."""
    if calibration.bank is None:
        return _signature_curve(recording, fit)
    turns = (recording.t - recording.t[0]) / recording.turn_period_s
    return calibration.bank.at(reading.value)((turns - reading.shift_turns) % 1.0)


# ---------------------------------------------------------------------------------------------------------------
# Output


def _finite(found: Estimate) -> Estimate:
    """An estimate of plain Python numbers, None for what is not finite."""

    def plain(value):
        if isinstance(value, tuple) and not all(isinstance(part, str) for part in value):
            parts = tuple(plain(part) for part in value)
            return None if None in parts else parts
        if isinstance(value, float | np.floating):
            return float(value) if np.isfinite(value) else None
        return value

    return replace(found, **{field.name: plain(getattr(found, field.name)) for field in fields(found)})


def as_row(found: Estimate) -> dict:
    """An estimate as an object for JSON: the attributes in order, tuples as lists."""
    pairs = ((field.name, getattr(found, field.name)) for field in fields(found))
    return {name: list(value) if isinstance(value, tuple) else value for name, value in pairs}


def as_text(found: Estimate) -> str:
    """An estimate for people: a line with the answer, then one for each number and each warning."""
    if found.verdict == "backlash":
        low, high = (1e3 * end for end in found.backlash_interval_rad)
        answer = f"backlash {1e3 * found.backlash_rad:.3f} mrad (95 %: {low:.3f} to {high:.3f})"
    elif found.verdict == "no backlash":
        answer = f"no backlash (less than {1e3 * found.backlash_interval_rad[1]:.3f} mrad)"
    else:
        answer = f"cannot tell: {found.warnings[0]}"
    lines = [f"{found.file}: {answer}"]
    if found.amplitude_rps:
        low, high = found.amplitude_interval_rps
        lines.append(f"  amplitude {found.amplitude_rps:.3f} rps ({low:.3f} to {high:.3f}), method {found.method}")
    if found.ring_hz is not None:
        lines.append(
            f"  the joint: rings at {found.ring_hz:.1f} Hz, damping ratio {found.damping_ratio:.3f}, "
            f"load friction {max(found.friction_share, 0.0):.1%} of gravity"
        )
    if found.rmse_rps is not None:
        lines.append(f"  misfit {found.rmse_rps:.3f} rps, {found.samples} samples, turn of {found.turn_period_s:.5g} s")
    notes = found.warnings[1:] if found.verdict == "cannot tell" else found.warnings
    return "\n".join([*lines, *(f"  note: {note}" for note in notes)])
