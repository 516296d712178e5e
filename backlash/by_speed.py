"""Answers by the speed alone: by a calibration of the joint, or the paper's index of it."""

from dataclasses import replace

import numpy as np

from backlash import turns
from backlash.amplitude import measure_amplitude
from backlash.calibration import example_calibration
from backlash.estimates import BACKLASH, Estimate, Trace
from backlash.reading.prepare import Log
from backlash.refusals import Reason, Refusal
from backlash.settings import AMPLITUDE, WAVEFORM, Settings
from backlash.torque import NORMAL_95
from backlash.waveform import match
from replication.records import Recording

# Of the turn's energy, gravity's part aside, that a calibration has to explain; within the paper's range it explains
# 0.96 or more.
_LEAST_EXPLAINED = 0.8
_SIGNAL = "motor speed [rps]"
_NO_TORQUE = "the speed alone gives an index of this joint in this movement, no backlash: log the torque, or calibrate"
_HOLDS_FOR = "holds for the stiffness and the drive of the calibration's logs: after a change of either, calibrate anew"


def _answer_by_waveform(log: Log, settings: Settings, answer: Estimate) -> Estimate:
    """Answer by a calibration."""
    calibration, recording = settings.calibration or example_calibration(), log.recording
    if difference := calibration.other_movement(recording):
        raise Refusal(f"{difference}; calibrate at the speed of the logs", Reason.OTHER_MOVEMENT)
    best = match(recording, calibration.bank, settings.is_own)
    model = turns.periodic(best.model.coefficient, best.model.order, turns.turn_phases(recording))
    answer = replace(
        with_amplitude(answer, recording),
        chi_squared=best.chi_squared,
        notes=(*answer.notes, _HOLDS_FOR if settings.is_own else calibration.provenance),
        trace=Trace(recording.t, recording.v, recording.v.mean() + model, _SIGNAL),
    )
    if best.explained < _LEAST_EXPLAINED:
        why = (
            f"the calibration explains {max(best.explained, 0.0):.0%} of what repeats itself every turn; another "
            "stiffness or drive, much friction, or another cause"
        )
        return answer.without(Refusal(why, Reason.NO_SIGNATURE))
    if best.at_end:
        low, high = (1e3 * end for end in calibration.range_rad)
        why = (
            f"the best match, {1e3 * best.delta_rad:.3g} mrad, is the end of the calibration's range, {low:.3g} to "
            f"{high:.3g} mrad"
        )
        return answer.without(Refusal(why, Reason.EXTRAPOLATED))
    half = NORMAL_95 * float(np.hypot(best.sd_rad, calibration.uncertainty_rad))
    return replace(
        answer,
        verdict=BACKLASH,
        backlash_rad=best.delta_rad,
        backlash_interval_rad=(max(best.delta_rad - half, 0.0), best.delta_rad + half),
    )


def _answer_by_amplitude(log: Log, settings: Settings, answer: Estimate) -> Estimate:
    """The paper's index, where nothing tells the backlash."""
    return with_amplitude(answer, log.recording).without(Refusal(_NO_TORQUE, Reason.NO_TORQUE))


def with_amplitude(answer: Estimate, recording: Recording) -> Estimate:
    """The answer with the signature's amplitude, if the mean turn has one."""
    measured = measure_amplitude(recording)
    if measured is None:
        return answer
    amplitude, half, model = measured
    return replace(
        answer,
        amplitude_rps=amplitude,
        amplitude_interval_rps=(max(amplitude - half, 0.0), amplitude + half),
        trace=Trace(recording.t, recording.v, model, _SIGNAL),
    )


ANSWERS = {WAVEFORM: _answer_by_waveform, AMPLITUDE: _answer_by_amplitude}
