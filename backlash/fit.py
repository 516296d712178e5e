"""Fit: what a method makes of a log in which there is a pattern."""

from dataclasses import dataclass, replace

import numpy as np

from backlash.detection.pattern import Detected
from backlash.fitting import SELF
from backlash.fitting.global_fit import GlobalFit, global_fit
from backlash.fitting.readings import Reading, protocol_for, read, reading_of_fit
from backlash.fitting.self_calibration import SelfFit, fit_joint
from backlash.fitting.torque import LoadData, TorqueFit, fit_torque
from backlash.reading.refusals import CannotTell
from backlash.settings import Settings
from replication.arrays import FloatArray
from replication.signature import signature


@dataclass(frozen=True, eq=False, kw_only=True)
class Fitted(Detected):
    """A log with what was fitted to it."""

    signature: GlobalFit
    # Of the calibration's method where that knows the movement, else the amplitude.
    reading: Reading
    model_rps: FloatArray  # the method's model at the samples, less its mean
    joint: SelfFit | None = None
    torque_fit: TorqueFit | None = None
    refusal: CannotTell | None = None  # why the fit is no answer


def fit_log(detected: Detected, settings: Settings) -> Detected:
    """Fit the method's model; a log without a pattern stays as it is."""
    presence, calibration = detected.presence, settings.calibration
    # Friction makes a pattern of the same sign in both halves of a turn, and these methods know it.
    knows_friction = calibration.bank is not None or calibration.method == SELF
    if not presence.found and not (knows_friction and presence.has_same_sign):
        return detected
    recording = detected.recording
    protocol = protocol_for(recording)
    try:
        fit = global_fit(recording, protocol)
        fitted = Fitted(
            **vars(detected),
            signature=fit,
            reading=reading_of_fit(recording, "amplitude", fit),
            model_rps=signature(recording.t, fit.X, protocol.timing),
        )
        if calibration.method == SELF:
            return _with_joint(fitted)
    except ValueError as error:
        raise CannotTell("too short", str(error)) from error
    if settings.load is not None:
        return _with_torque(fitted, settings.load, settings.seed)
    return fitted if calibration.other_movement(recording) else _with_reading(fitted, settings)


def _turns(fitted: Fitted) -> FloatArray:
    """Instants of the samples in load turns from the first one."""
    recording = fitted.recording
    return (recording.t - recording.t[0]) / recording.turn_period_s


def _with_joint(fitted: Fitted) -> Fitted:
    """Fit the joint that the log itself tells of."""
    joint = fit_joint(fitted.recording)
    phases = np.arange(joint.turn_rps.size + 1) / joint.turn_rps.size
    model = np.interp(_turns(fitted) % 1.0, phases, np.append(joint.turn_rps, joint.turn_rps[0]))
    where = f"worst at {joint.worst_phase:.2f} turns from the load hanging down"
    refusal = (
        CannotTell("no such joint", f"{joint.refusal_reason}, {where}")
        if joint.refusal_reason
        else None
    )
    return replace(fitted, joint=joint, model_rps=model, refusal=refusal)


def _with_torque(fitted: Fitted, load: LoadData, seed: int) -> Fitted:
    """Fit the speed and the torque, without a model of the drive."""
    torque = np.empty(0) if fitted.torque is None else fitted.torque
    try:
        fit = fit_torque(fitted.recording, torque, load, np.random.default_rng(seed))
    except ValueError as error:
        return replace(fitted, refusal=CannotTell("wrong torque", str(error), (str(load),)))
    refusal = (
        CannotTell("too noisy", fit.refusal_reason, (str(load),)) if fit.refusal_reason else None
    )
    return replace(fitted, torque_fit=fit, refusal=refusal)


def _with_reading(fitted: Fitted, settings: Settings) -> Fitted:
    """Read off what the calibration knows: the signature's amplitude or energy, the searches' mean, the waveform."""
    recording, calibration = fitted.recording, settings.calibration
    if calibration.method == "paper":
        reading = read(recording, "paper", None, settings.repeats, settings.seed)
    else:
        reading = reading_of_fit(
            recording, calibration.method, fitted.signature, calibration.bank, settings.is_own
        )
    if calibration.bank is None:
        return replace(fitted, reading=reading)
    waveform = calibration.bank.at(reading.value)
    return replace(
        fitted, reading=reading, model_rps=waveform((_turns(fitted) - reading.shift_turns) % 1.0)
    )
