"""What is given of logs, and how they are measured by it."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from os import PathLike
from typing import Any, TypedDict

from numpy.typing import ArrayLike

from backlash.calibration import Calibration, example_calibration, read_calibration
from backlash.load_data import LoadData, load_from_masses
from backlash.reading.columns import LogFormat, is_positive
from backlash.reading.prepare import Log
from backlash.refusals import Refusal

TORQUE, WAVEFORM, AMPLITUDE = METHODS = ("torque", "waveform", "amplitude")
_FORM = tuple(field.name for field in fields(LogFormat))
_RATIOS = ("inertia_ratio", "gravity_per_s2")
_SDS = ("inertia_sd", "gravity_sd")
_MASSES = ("load_mass_kg", "load_arm_m", "load_inertia_kgm2")
_LOAD = (*_RATIOS, *_SDS, "motor_inertia_kgm2", *_MASSES)
GIVEN = (*_FORM, *_LOAD, "calibration", "method", "arm_m")
_OPTIONS = {
    "torque": "--torque",
    "gear_ratio": "--gear-ratio",
    "inertia_ratio": "--inertia-ratio",
    "gravity_per_s2": "--gravity",
    "motor_inertia_kgm2": "--motor-inertia",
    "load_mass_kg": "--load-mass",
    "load_arm_m": "--load-arm",
}


class Given(TypedDict, total=False):
    """Keywords of `estimate`: the log's columns and movement, its load, the method."""

    time: str | None
    rate_hz: float | None
    speed: str | None
    position: str | bool | None
    unit: str | None
    time_unit: str | None
    counts_per_turn: float | None
    commanded_speed_rps: float | None
    turn_period_s: float | None
    trust_period: bool
    gear_ratio: float | None
    start_s: float | None
    end_s: float | None
    torque: str | ArrayLike | None
    ring_hz: float | None
    inertia_ratio: float | None
    gravity_per_s2: float | None
    inertia_sd: float | None
    gravity_sd: float | None
    motor_inertia_kgm2: float | None
    load_mass_kg: float | None
    load_arm_m: float | None
    load_inertia_kgm2: float | None
    calibration: Calibration | str | PathLike[str] | None
    method: str | None
    arm_m: float | None


@dataclass(frozen=True)
class Settings:
    """How a log is read and measured."""

    form: LogFormat
    method: str = AMPLITUDE
    load: LoadData | None = None  # of method "torque"
    calibration: Calibration | None = None  # of method "waveform"
    is_own: bool = True  # whether the calibration is of the log's own joint
    arm_m: float | None = None  # at which the play is wanted in mm, too


def settings_for(log: object, given: Mapping[str, Any]) -> Settings:
    """Settings of a log by the keywords of `estimate`; by default the best method that these allow."""
    arm_m = given.get("arm_m")
    if arm_m is not None and not is_positive(arm_m):
        raise Refusal(f"--arm {arm_m!r}: give a length above 0 [m]")
    return replace(_settings_for(log, given), arm_m=arm_m)


def _settings_for(log: object, given: Mapping[str, Any]) -> Settings:
    if unknown := sorted(set(given) - set(GIVEN)):
        raise TypeError(f"no parameter {unknown[0]!r}; there are {', '.join(GIVEN)}")
    given = {name: value for name, value in given.items() if value is not None}
    form = _form_of(log, given)
    calibration, method = read_calibration(given.get("calibration")), given.get("method")
    if method not in (None, *METHODS):
        raise Refusal(f"--method {method}: there are {', '.join(METHODS)}")
    if method == TORQUE or form.torque or not given.keys().isdisjoint(_RATIOS + _MASSES):
        if calibration or method not in (None, TORQUE):
            raise Refusal(
                "a torque needs no calibration and no other method: leave out one of them"
            )
        return Settings(form, TORQUE, load=_load_of(form, given))
    if calibration or method == WAVEFORM:
        if method not in (None, WAVEFORM):
            raise Refusal(f"--method {method}: the calibration is of method {WAVEFORM}")
        used = calibration or example_calibration()
        return Settings(form, WAVEFORM, calibration=used, is_own=calibration is not None)
    return Settings(form)


def _form_of(log: object, given: Mapping[str, Any]) -> LogFormat:
    """What is given of a log's columns and movement; a log that was read has it all."""
    form = {name: given[name] for name in _FORM if name in given}
    if isinstance(log, Log):
        if form:
            raise Refusal(f"{log.file} was read already: give {', '.join(form)} to read_log")
        return log.form
    if form.get("position") is True:
        form["position"] = "position"
    if not isinstance(form.get("torque", ""), str | int):
        form["torque"] = "torque array"
    return LogFormat(**form)


def _load_of(form: LogFormat, given: Mapping[str, Any]) -> LoadData:
    """The load by its ratios or by its masses; refuse what is missing, or given twice."""
    known = {**given, "torque": form.torque, "gear_ratio": form.gear_ratio}
    by_masses = not given.keys().isdisjoint(_MASSES)
    needed: tuple[str, ...] = ("torque", *_RATIOS)
    if by_masses:
        needed = ("torque", "gear_ratio", "motor_inertia_kgm2", "load_mass_kg", "load_arm_m")
    if missing := " and ".join(_OPTIONS[name] for name in needed if known.get(name) is None):
        raise Refusal(
            f"the torque and the load's data, by its ratios or its masses, are needed: give {missing} too"
        )
    load = {name: given[name] for name in _LOAD if name in given}
    if not by_masses:
        return LoadData(**load)
    if not load.keys().isdisjoint(_RATIOS):
        raise Refusal(
            "--load-mass beside --inertia-ratio or --gravity: give the load by its ratios or by its masses"
        )
    return load_from_masses(known["gear_ratio"], **load)
