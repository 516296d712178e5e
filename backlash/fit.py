"""Fit: what a method makes of a log in which there is a pattern."""

from dataclasses import dataclass, replace

import numpy as np

from backlash.detection.pattern import Detected
from backlash.fitting import SELF
from backlash.fitting.global_fit import GlobalFit, global_fit
from backlash.fitting.readings import (
    NO_READING,
    Reading,
    amplitude_of_mean_turn,
    protocol_for,
    read,
    reading_of_fit,
)
from backlash.fitting.self_calibration import SelfFit, fit_joint
from backlash.fitting.torque import LoadData, TorqueFit, fit_torque
from backlash.fitting.waveform import mean_turn, samples_a_turn
from backlash.reading.prepare import Log
from backlash.refusals import Reason, Refusal
from backlash.settings import Settings
from replication.arrays import FloatArray
from replication.signature import h as signature
from replication.simulator.parameters import TURN

_FINER = 32  # phases between which a straight line is good enough, for one of a turn


@dataclass(frozen=True, eq=False, kw_only=True)
class Fitted(Detected):
    """A log with what was fitted to it."""

    model_rps: FloatArray  # the method's model at the samples
    # Of the calibration's method where that knows the movement, else the amplitude.
    reading: Reading
    best_rps: float = np.nan  # the amplitude by the global fit to the whole record
    joint: SelfFit | None = None
    torque_fit: TorqueFit | None = None
    refusal: Refusal | None = None  # why the fit is no answer


def fit_log(detected: Detected, settings: Settings) -> Detected:
    """Fit the method's model; a log without a pattern stays as it is."""
    presence, calibration = detected.presence, settings.calibration
    if settings.load is not None:
        return _fit_by_torque(detected, settings.load)
    # Friction makes a pattern of the same sign in both halves of a turn, and these methods know it.
    knows_friction = calibration.bank is not None or calibration.method == SELF
    if not presence.found and not (knows_friction and presence.has_same_sign):
        return detected
    recording = detected.recording
    try:
        if calibration.method == SELF:
            return _fit_joint(detected)
        fit = global_fit(recording, protocol_for(recording))
    except ValueError as error:
        raise Refusal(str(error), Reason.TOO_SHORT) from error
    fitted = Fitted(
        **vars(detected),
        model_rps=signature(recording.t, fit.X, protocol_for(recording).timing),
        reading=reading_of_fit(recording, "amplitude", fit),
        best_rps=fit.amplitude_rps,
    )
    return fitted if calibration.other_movement(recording) else _with_reading(fitted, fit, settings)


def _turns(detected: Detected) -> FloatArray:
    """Instants of the samples in load turns from the first one."""
    recording = detected.recording
    return (recording.t - recording.t[0]) / recording.turn_period_s


def _fit_joint(detected: Detected) -> Fitted:
    """Fit the joint that the log itself tells of; its amplitude, which is only printed, is that of the mean turn."""
    reading = amplitude_of_mean_turn(detected.recording)
    joint = fit_joint(detected.recording)
    runs_away = not np.isfinite(joint.turn_rps).all()  # no joint fits, and the best of them does
    fitted = _with_turn(detected, None if runs_away else joint.turn_rps, reading)
    why = joint.refusal_reason
    return replace(fitted, joint=joint, refusal=Refusal(why, Reason.NO_SUCH_JOINT) if why else None)


def _with_turn(detected: Detected, turn: FloatArray | None, reading: Reading) -> Fitted:
    """A turn [rps] as the model of the speed, without one the mean turn."""
    if turn is None:
        turn = mean_turn(detected.recording, samples_a_turn(detected.recording))
    # Its Fourier series at many phases; scipy.interpolate is slow to import.
    fine = _FINER * np.fft.irfft(np.fft.rfft(turn), _FINER * turn.size)
    phases = np.arange(fine.size) / fine.size
    model = np.interp(_turns(detected), phases, fine, period=1.0)
    return Fitted(**vars(detected), model_rps=model, reading=reading)


def _fit_by_torque(detected: Detected, load: LoadData) -> Fitted:
    """Fit the speed and the torque, without a model of the drive; the model of the speed is its mean turn."""
    torque = np.asarray(detected.torque, dtype=float)  # not a number, of a log read without one
    try:
        fit = fit_torque(detected.recording, torque, load)
    except ValueError as error:
        raise _no_fit(error, load) from error
    return replace(_with_turn(detected, None, NO_READING), torque_fit=fit)


def _no_fit(error: ValueError, load: LoadData) -> Refusal:
    """Why there is no fit by the torque; what a library says of its numbers is no reason."""
    trace = error.__traceback__
    while trace and trace.tb_next:
        trace = trace.tb_next
    is_said_here = trace is not None and trace.tb_frame.f_globals["__name__"].startswith("backlash")
    why = str(error) if is_said_here else "no joint with this load makes such a speed and torque"
    return Refusal(why, Reason.NO_FIT, notes=(str(load),))


def fit_to_and_fro(log: Log, load: LoadData | None) -> TorqueFit:
    """Fit the speed and the torque of strokes to and fro."""
    from backlash.fitting.strokes import fit_strokes  # slow to import

    recording, gear_ratio = log.recording, log.form.gear_ratio
    if log.torque is None or load is None or gear_ratio is None:
        raise Refusal(
            "strokes to and fro need --torque and --gear-ratio", Reason.NOT_CONSTANT_SPEED
        )
    speed = TURN * recording.v
    try:
        return fit_strokes(speed, log.torque, recording.sample_s, gear_ratio, load)
    except ValueError as error:
        raise _no_fit(error, load) from error


def _with_reading(fitted: Fitted, fit: GlobalFit, settings: Settings) -> Fitted:
    """Read off what the calibration knows: the signature's amplitude or energy, the searches' mean, the waveform."""
    recording, calibration = fitted.recording, settings.calibration
    if calibration.method == "paper":
        reading = read(recording, "paper", None, settings.repeats, settings.seed)
    else:
        reading = reading_of_fit(
            recording, calibration.method, fit, calibration.bank, settings.is_own
        )
    if calibration.bank is None:
        return replace(fitted, reading=reading)
    waveform = calibration.bank.at(reading.value)
    model = waveform((_turns(fitted) - reading.shift_turns) % 1.0)
    return replace(fitted, reading=reading, model_rps=model)
