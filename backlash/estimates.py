"""From a log to its answer: the backlash, none, or why that cannot be told."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from backlash import turns
from backlash.answer import AMPLITUDE, BACKLASH, NONE, TORQUE, Estimate, Trace
from backlash.load_data import LoadData, load_from_masses
from backlash.reading.columns import LogOptions
from backlash.reading.prepare import Log, open_log
from backlash.reading.sources import name_of
from backlash.reading.values import finest_step
from backlash.refusals import Reason, Refusal, check_positive, option_of
from backlash.torque import fit_torque
from backlash.torque.answer import refuse_averaged

_OPTIONS = tuple(field.name for field in fields(LogOptions))
_COARSE = 1 / 128  # of a torque's range; with finer steps rounding is below the noise
_RATIOS = ("inertia_ratio", "gravity_per_s2")
_MASSES = ("load_mass_kg", "load_arm_m", "load_inertia_kgm2")
_LOAD = (*_RATIOS, "inertia_sd", "gravity_sd", "motor_inertia_kgm2", *_MASSES)
# Keywords of `estimate`: the log's columns and movement, and its load.
GIVEN = (*_OPTIONS, *_LOAD, "arm_m")


@dataclass(frozen=True)
class Request:
    """What is asked of a log: how it is read, and of which load."""

    options: LogOptions
    load: LoadData | None = None  # by which the torque tells the backlash
    arm_m: float | None = None  # at which the play is wanted in mm, too


def estimate(log: object, v: ArrayLike | None = None, **given: Any) -> Estimate:
    """Estimate the backlash, which is half of the total play, that a log tells of.

    Parameters
    ----------
    log : str, Path, DataFrame, or array of shape (samples,)
        A file, "-" for the standard input, a table, or the time stamps [s] of `v`.
    v : array of shape (samples,), optional
        Motor speed, in `unit`, which has to be said; with `position=True` its position, in turns, rad, deg or counts.
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
    return examine(log, request_for(given), v, given.get("torque"))


def examine(
    log: object, request: Request, v: ArrayLike | None = None, torque: ArrayLike | None = None
) -> Estimate:
    """Answer for a log, wherever it comes from."""
    answer = Estimate(
        name_of(log), method=TORQUE if request.load else AMPLITUDE, arm_m=request.arm_m
    )
    try:
        read = open_log(log, request.options, v, torque)
        answer = _with_log(answer, read, request)
        read = _with_own_period(read)
        answer = _with_log(answer, read, request)
        if request.load:
            return _answer_by_torque(read, request.load, answer)
        return _answer_by_amplitude(read, answer)
    except Refusal as refusal:
        if refusal.is_unusable:
            raise
        return answer.with_refusal(refusal)


def _with_log(answer: Estimate, log: Log, request: Request) -> Estimate:
    """The answer with what was read."""
    recording = log.recording
    is_stroke = turns.is_to_and_fro(recording.v)
    return replace(
        answer,
        sha256=log.sha256,
        samples=recording.t.size,
        turn_period_s=None if is_stroke else recording.turn_period_s,
        speed_rps=recording.commanded_speed_rps,
        columns=str(log.columns),
        notes=(*log.notes, *([str(request.load)] if request.load else [])),
    )


def _with_own_period(log: Log) -> Log:
    """The log with the period that its turns have; of a torque gravity's, which no other line may dominate."""
    recording, options = log.recording, log.options
    given = recording.turn_period_s
    if options.trust_period or turns.is_to_and_fro(recording.v):
        return log
    if log.torque is None:
        period = turns.period_by_energy(recording, recording.v)
    else:
        other = turns.dominant_period(recording, log.torque)
        period = other or turns.period_by_torque(recording, log.torque)
        if not turns.is_near_period(recording, period):
            instead = f"--turn-period {period:.4g}"
            if options.gear_ratio:
                instead = f"--gear-ratio {options.gear_ratio * period / given:.4g}"
            raise Refusal(
                f"the torque's strongest line comes every {period:.4g} s, not every {given:.4g} s: if it is gravity's, "
                f"{instead}; if the turn given is right, --trust-period",
                Reason.WRONG_PERIOD,
            )
    if turns.is_same_period(recording, period):
        return log
    note = f"the record repeats itself every {period:.5f} s, not every {given:.5f} s: used that"
    return replace(log, recording=replace(recording, turn_period_s=period)).noting(note)


def _answer_by_torque(log: Log, load: LoadData, answer: Estimate) -> Estimate:
    """Answer by speed and torque."""
    assert log.torque is not None  # without one no load is asked for
    if not turns.is_to_and_fro(log.recording.v):
        refuse_averaged(log.recording, log.signals[-1])  # of a position the torque as it was logged
    try:
        fit = fit_torque(log.recording, log.torque, load)
    except Refusal as refusal:
        if (step := finest_step(log.torque)) > _COARSE * np.ptp(log.torque):
            refusal.add(f"the torque comes in steps of {step:.3g}: log it finer")
        raise
    if fit.is_none and log.columns.is_load_side:
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
        backlash_rad=fit.delta_rad,
        backlash_interval_rad=fit.interval_rad,
        chi_squared=fit.chi_squared,
        joint=fit.joint,
        notes=notes,
        strokes=fit.strokes,
        trace=fit.trace,
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
    return answer.with_refusal(
        Refusal(
            "the speed alone gives an index of this joint in this movement, no backlash: log the torque",
            Reason.NO_TORQUE,
        )
    )


def check_names(given: Iterable[str]) -> None:
    """Raise TypeError at what is no keyword of `estimate`."""
    if unknown := sorted({*given}.difference(GIVEN)):
        raise TypeError(f"no parameter {unknown[0]!r}; there are {', '.join(GIVEN)}")


def request_for(given: Mapping[str, Any]) -> Request:
    """What is asked of a log, by the keywords of `estimate`."""
    check_names(given)
    given = {name: value for name, value in given.items() if value is not None}
    if given.get("position") is True:
        given["position"] = "position"
    if not isinstance(given.get("torque", ""), str | int):
        given["torque"] = "torque array"
    if not given.get("torque"):
        given.pop("torque", None)
    arm_m = given.get("arm_m")
    check_positive(arm_m=arm_m)
    options = LogOptions(**{name: given[name] for name in _OPTIONS if name in given})
    is_by_torque = not given.keys().isdisjoint(("torque", *_RATIOS, *_MASSES))
    return Request(options, _load_of(given) if is_by_torque else None, arm_m)


def _load_of(given: Mapping[str, Any]) -> LoadData:
    """The load by its ratios or by its masses; refuse what is missing, or given twice."""
    load = {name: given[name] for name in _LOAD if name in given}
    needed: tuple[str, ...] = ("torque", *_RATIOS)
    has_masses = not given.keys().isdisjoint(_MASSES)
    if has_masses:
        needed = ("torque", "gear_ratio", "motor_inertia_kgm2", "load_mass_kg", "load_arm_m")
    if has_masses and given.get("gear_ratio") == 1:
        raise Refusal(
            "--gear-ratio 1, a log of the joint's side: give the load by --inertia-ratio and --gravity, not by masses"
        )
    if missing := " and ".join(option_of(name) for name in needed if name not in given):
        raise Refusal(
            f"the torque and the load's data, by its ratios or its masses, are needed: give {missing} too"
        )
    if not has_masses:
        return LoadData(**load)
    if not given.keys().isdisjoint(_RATIOS):
        raise Refusal(
            "--load-mass beside --inertia-ratio or --gravity: give the load by its ratios or by its masses"
        )
    return load_from_masses(given["gear_ratio"], **load)
