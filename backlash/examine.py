"""A log's way to its answer: read, prepare, detect, fit, judge."""

from dataclasses import dataclass

from numpy.typing import ArrayLike

from backlash.answers import Estimate
from backlash.detection.pattern import detect_pattern
from backlash.fit import Fitted, fit_log, fit_to_and_fro
from backlash.judge import judge, judge_strokes, refuse
from backlash.reading.prepare import Log, prepare
from backlash.reading.sources import read_source
from backlash.refusals import Refusal
from backlash.settings import Settings
from replication.records import Recording


@dataclass(frozen=True)
class Examined:
    """An estimate with what it was made from: the log, as far as it came."""

    estimate: Estimate
    log: Log | None = None

    @property
    def fitted(self) -> Fitted | None:
        """The log's fit, if there is one."""
        return self.log if isinstance(self.log, Fitted) else None


def examine(
    source: object, settings: Settings, v: ArrayLike | None = None, torque: ArrayLike | None = None
) -> Examined:
    """Answer for a log, wherever it comes from; see `read_source`."""
    if isinstance(source, Log):
        return examine_log(source, settings)
    table = read_source(source, settings.form, v, torque)
    try:
        log = prepare(table, settings.form)
    except Refusal as refusal:
        if refusal.is_unusable:
            raise
        return Examined(refuse(table, refusal, settings))
    return examine_log(log, settings)


def examine_log(log: Log, settings: Settings) -> Examined:
    """Answer for a log that was prepared."""
    known: Log = log
    try:
        if log.makes_strokes:
            return Examined(judge_strokes(log, fit_to_and_fro(log, settings.load), settings), log)
        known = detected = detect_pattern(log, settings.seed)
        known = fitted = fit_log(detected, settings)
        return Examined(judge(fitted, settings), fitted)
    except Refusal as refusal:
        if refusal.is_unusable:
            raise
        return Examined(refuse(known, refusal, settings), known)


def examine_recording(recording: Recording, settings: Settings, name: str) -> Examined:
    """Answer for a record as it is."""
    return examine_log(Log(file=name, recording=recording, form=settings.form), settings)
