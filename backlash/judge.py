"""Judge: is there backlash, how much, how sure; or why that cannot be told.

Without a pattern in its half turns the verdict is "no backlash" only where this noise could not
have hidden the calibration's least backlash. With one, the method's model must explain most of it,
and the calibration must hold the reading in its range.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from backlash.answers import Estimate
from backlash.calibration import Backlash, Calibration, widened
from backlash.detection.pattern import Detected, band_energy, explained_share, find_pattern
from backlash.fit import Fitted
from backlash.fitting import SELF
from backlash.fitting.harmonics import turn_harmonics
from backlash.fitting.readings import Reading
from backlash.fitting.self_calibration import SelfFit, weak_turn
from backlash.fitting.torque import TorqueFit
from backlash.fitting.waveform import LEAST_LEVELS
from backlash.reading.prepare import Log
from backlash.reading.sources import Source
from backlash.refusals import NO_REVERSAL, Reason, Refusal
from backlash.settings import Settings
from replication.records import Recording

_LEAST_SHARE = 0.8  # of the pattern's energy, for the model to explain; it explains 0.96 or more in the paper's range
# A backlash below this counts as none: 0.015 mm at an arm of 0.3 m, a sixth of Table 2's least.
_NEGLIGIBLE_RAD = 5e-5
_OFF = 0.05  # of the amplitude; searches that all end in the best minimum differ less from the global fit
_FAR_OUTSIDE = 1.2  # times the value at the end of the range; a cubic beyond means nothing
_IF_IT_REVERSES = (
    "valid only if the load's friction is below gravity: above, the teeth never part, and only the "
    "torque shows that"
)
_ADVICE = (
    "method self knows joints under a drive of the paper's kind alone; for any other, log the torque too (--torque), "
    f"or calibrate on the joint itself: backlash calibrate, with its logs at {LEAST_LEVELS} or more known backlashes"
)


def judge(known: Detected, settings: Settings) -> Estimate:
    """Answer by what is known of a log: by its fit, else by what its noise could have hidden."""
    answer = what_is_known(known, settings)
    least_rad = settings.calibration.range_rad[0]
    if not isinstance(known, Fitted):
        answer = _judge_absence(known, least_rad, answer)
    elif known.torque_fit is not None:
        return _finite(_judge_torque(known.torque_fit, settings, answer))
    elif known.refusal is not None:
        raise known.refusal
    elif known.joint is not None:
        answer = _judge_joint(known, known.joint, least_rad, answer)
    else:
        answer = _judge_reading(known, settings, answer)
    if answer.verdict == "no backlash":
        answer = _earned(answer, known)
    return _finite(answer)


def refuse(known: Source, refusal: Refusal, settings: Settings) -> Estimate:
    """Answer why that cannot be told, with what is known all the same."""
    answer = what_is_known(known, settings)
    other_joint = answer.method == SELF and refusal.reason in (
        Reason.NO_SUCH_JOINT,
        Reason.NO_SIGNATURE,
    )
    advice = (_ADVICE,) if other_joint else ()
    return _finite(
        replace(answer, warnings=(str(refusal), *advice, *answer.warnings, *refusal.notes))
    )


def what_is_known(known: Source, settings: Settings) -> Estimate:
    """An answer without a verdict, however far a log has come."""
    calibration = settings.calibration
    found: dict[str, Any] = {"sha256": known.sha256}
    if isinstance(known, Log):
        recording = known.recording
        found |= {
            "samples": recording.t.size,
            "turn_period_s": recording.turn_period_s,
            "warnings": known.notes,
        }
    if isinstance(known, Fitted):
        found["rmse_rps"] = np.std(known.recording.v - known.model_rps)
        found["amplitude_rps"] = known.reading.amplitude_rps
        found["amplitude_interval_rps"] = known.reading.amplitude_interval_rps
    return Estimate(
        known.file, method=calibration.method, calibration=calibration.provenance, **found
    )


def _finite(found: Estimate) -> Estimate:
    """An estimate with None for what is not finite."""

    def is_finite(value: object) -> bool:
        numbers = value if isinstance(value, tuple) else (value,)
        return all(math.isfinite(number) for number in numbers if isinstance(number, float))

    unknown: dict[str, Any] = {
        name: None for name, value in vars(found).items() if not is_finite(value)
    }
    return replace(found, **unknown)


def _check_movement(recording: Recording, calibration: Calibration) -> None:
    if difference := calibration.other_movement(recording):
        raise Refusal(f"{difference}; calibrate at the speed of the logs", Reason.EXTRAPOLATED)


def _least_energy(recording: Recording, least_rad: float) -> float:
    """Energy [rps^2] that the least backlash puts into a record's pattern, on the joint of `weak_turn`."""
    halves = weak_turn(recording, least_rad).reshape(2, -1)
    return band_energy((halves[0] - halves[1]) / 2, recording)


def _gravity_share(recording: Recording) -> float:
    """The speed's part once a turn, as gravity makes it, over that of `weak_turn`; 0 if noise may make as much.

    A joint whose gravity, or whose drive's answer to it, is less than that of `weak_turn` shows the
    least backlash less, too. That of a vertical axis is of noise and eccentricity alone.
    """
    found, weak = turn_harmonics(recording), weak_turn(recording, 0.0)
    once, by_chance = abs(found.first.coefficient), found.first.by_chance
    return once * weak.size / abs(np.fft.rfft(weak)[1]) if once > by_chance else 0.0


def _is_none(high_rad: float, least_rad: float, detected: Detected) -> bool:
    """Whether a backlash up to there is none: negligible, or below the least one and without a pattern."""
    return high_rad <= _NEGLIGIBLE_RAD or (high_rad <= least_rad and not detected.presence.found)


def _earned(answer: Estimate, detected: Detected) -> Estimate:
    """An absence by speed alone, unless nothing tells that the load reversed; it has no amplitude.

    A reversal is gravity's part once a turn. It says nothing of constant friction, which moves the
    speed in no way.
    """
    interval = answer.backlash_interval_rad or (0.0, np.inf)
    if detected.presence.found and interval[1] > _NEGLIGIBLE_RAD:
        what = f"no backlash fits, but an oscillation of {answer.amplitude_rps:.3g} rps repeats itself every turn"
        raise Refusal(what, Reason.NO_SIGNATURE)
    if _gravity_share(detected.recording) == 0:
        raise Refusal(NO_REVERSAL, Reason.NO_REVERSAL)
    return replace(
        answer,
        amplitude_rps=None,
        amplitude_interval_rps=None,
        warnings=(_IF_IT_REVERSES, *answer.warnings),
    )


def _judge_absence(detected: Detected, least_rad: float, answer: Estimate) -> Estimate:
    """Answer where half turns have nothing in common: no backlash, or too much noise to say so."""
    recording, presence = detected.recording, detected.presence
    if presence.has_same_sign:
        what = "something repeats itself every turn, but not with the opposite sign half a turn later, as backlash"
        cause = "is there much friction, another axis moving, or mains hum in step with the turn?"
        raise Refusal(f"{what} under gravity alone does; {cause}", Reason.NO_SIGNATURE)
    share = min(_gravity_share(recording) or 1.0, 1.0)
    if presence.detectable_rps2 > share**2 * _least_energy(recording, least_rad):
        noise = f"this noise ({presence.noise_rps:.3g} rps) may hide"
        backlash = f"what a backlash of {least_rad:.3g} rad makes"
        raise Refusal(
            f"nothing found, but {noise} {backlash}; log more turns, or quieter", Reason.TOO_NOISY
        )
    return replace(
        answer,
        verdict="no backlash",
        backlash_rad=0.0,
        backlash_interval_rad=(0.0, least_rad),
        rmse_rps=recording.v.std(),
    )


def _judge_reading(fitted: Fitted, settings: Settings, answer: Estimate) -> Estimate:
    """Answer by what the calibration makes of the method's reading."""
    calibration = settings.calibration
    reading = fitted.reading
    best_rps = fitted.best_rps
    _check_movement(fitted.recording, calibration)
    share = explained_share(fitted.recording, fitted.model_rps, fitted.presence)
    if share < _LEAST_SHARE:
        what = f"a pattern repeats itself every turn, but the model explains {max(share, 0.0):.0%} of it"
        raise Refusal(
            f"{what}; a faint backlash, much friction, or another cause", Reason.NO_SIGNATURE
        )
    notes: tuple[str, ...] = ()
    if abs(reading.amplitude_rps - best_rps) > _OFF * best_rps:
        means = (
            f"their mean is {reading.amplitude_rps:.3f} rps, the best fit has {best_rps:.3f} rps"
        )
        notes += (
            f"searches ended in other minima: {means}; method amplitude is not prone to this",
        )
    found = calibration.backlash(reading)
    if _is_outside(reading, found, calibration):
        raise Refusal(_beyond(reading, found, calibration), Reason.EXTRAPOLATED, notes=notes)
    if found.extrapolated:
        notes += ("at the edge of the calibration's range",)
    low, high = found.interval_rad
    if not settings.is_own:
        low, high = widened(calibration.method, found.delta_rad, found.interval_rad)
        notes += (
            "calibrated for the paper's joint, not for yours: give --calibration, or take method self",
        )
    return replace(
        answer,
        verdict="backlash",
        backlash_rad=found.delta_rad,
        backlash_interval_rad=(max(low, 0.0), high),
        warnings=answer.warnings + notes,
    )


def _beyond(reading: Reading, found: Backlash, calibration: Calibration) -> str:
    """What lies past the end of a calibration's range."""
    low, high = calibration.range_rad
    what, ends = f"its reading, {reading.value:.3g} rps,", ""
    if calibration.bank is not None:
        what, ends = f"the best match, {found.delta_rad:.3g} rad,", f", {low:.3g} to {high:.3g} rad"
    return f"a signature is there, but {what} lies past the end of the calibration's range{ends}"


def _judge_torque(fit: TorqueFit, settings: Settings, answer: Estimate) -> Estimate:
    """Answer by the speed and torque of a log, and name what was said of the load."""
    said = str(settings.load)
    if not fit.reverses:
        raise Refusal(NO_REVERSAL, Reason.NO_REVERSAL, notes=(said,))
    if fit.refusal_reason:
        raise Refusal(fit.refusal_reason, Reason.TOO_NOISY, notes=(said,))
    found = _told_by_torque(fit, settings, answer)
    if not fit.is_none:
        return found
    high = fit.interval_rad[1]
    return replace(
        found, verdict="no backlash", backlash_rad=0.0, backlash_interval_rad=(0.0, high)
    )


def judge_strokes(log: Log, fit: TorqueFit, settings: Settings) -> Estimate:
    """Answer by strokes to and fro; that there is no backlash they cannot tell, for a search may end there."""
    if fit.refusal_reason:
        raise Refusal(fit.refusal_reason, Reason.TOO_NOISY, notes=(str(settings.load),))
    return _finite(_told_by_torque(fit, settings, what_is_known(log, settings)))


def _told_by_torque(fit: TorqueFit, settings: Settings, answer: Estimate) -> Estimate:
    """The backlash that speed and torque tell, with what was said of the load."""
    inertia = (
        f"it goes with m g r / J_l; the motor's inertia is {fit.motor_inertia:.3g} torque s^2/rad"
    )
    if settings.load and settings.load.motor_inertia_kgm2:
        unit = settings.load.motor_inertia_kgm2 / fit.motor_inertia
        inertia += f", so the torque's unit is {unit:.3g} N m (of a current: the torque constant)"
    notes: tuple[str, ...] = (str(settings.load), f"{inertia}: right?")
    if fit.friction_share is not None and fit.stiffness_per_s2 is not None:
        rubbing = f"the load's friction is {fit.friction_share:.1%} of its gravity"
        stiffness = (
            f"the joint's stiffness {fit.stiffness_per_s2:.3g} per s^2 of the load's inertia"
        )
        notes += (f"{rubbing}, {stiffness}: as in the data sheet?",)
    return replace(
        answer,
        verdict="backlash",
        backlash_rad=fit.delta_rad,
        backlash_interval_rad=fit.interval_rad,
        warnings=(*answer.warnings, *notes),
    )


def _is_outside(reading: Reading, backlash: Backlash, calibration: Calibration) -> bool:
    """Whether a reading lies outside the calibration's range by more than its standard deviation."""
    low, high = calibration.range_rad
    if calibration.bank is not None:
        return backlash.extrapolated
    one_sigma = (backlash.interval_rad[1] - backlash.interval_rad[0]) / 4
    beyond = reading.value > _FAR_OUTSIDE * calibration.value_at(high)
    return beyond or not low - one_sigma <= backlash.delta_rad <= high + one_sigma


def _explains(fitted: Fitted, is_none: bool) -> bool:
    """Whether the model explains the pattern; one of a negligible backlash, near the noise, if it leaves no pattern."""
    recording, model = fitted.recording, fitted.model_rps
    if explained_share(recording, model, fitted.presence) >= _LEAST_SHARE:
        return True
    return is_none and not find_pattern(replace(recording, v=recording.v - model)).found


def _judge_joint(fitted: Fitted, joint: SelfFit, least_rad: float, answer: Estimate) -> Estimate:
    """Answer by the joint that the log itself tells of; a backlash that may be zero is none, or not known."""
    low, high = joint.interval_rad
    if low <= 0 and high > least_rad:
        raise Refusal(
            f"none fits as well as up to {high:.3g} rad; log more turns, or quieter",
            Reason.TOO_NOISY,
        )
    is_none = _is_none(high, least_rad, fitted)
    if is_none:  # such a pattern has another cause
        low = 0.0
    if fitted.presence.found and not _explains(fitted, is_none):
        raise Refusal(
            "a pattern repeats itself every turn, but no backlash that explains it",
            Reason.NO_SIGNATURE,
        )
    return replace(
        answer,
        verdict="backlash" if low > 0 else "no backlash",
        backlash_rad=joint.delta_rad if low > 0 else 0.0,
        backlash_interval_rad=(low, high),
    )
