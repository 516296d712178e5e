"""What is given of logs, and how they are measured by it."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from backlash.calibration import Calibration, example_calibration, read_calibration
from backlash.load_data import LoadData, load_from_masses
from backlash.reading.columns import LogFormat
from backlash.reading.prepare import Log
from backlash.refusals import Refusal, check_positive, option_of

TORQUE, WAVEFORM, AMPLITUDE = METHODS = ("torque", "waveform", "amplitude")
_FORM = tuple(field.name for field in fields(LogFormat))
_RATIOS = ("inertia_ratio", "gravity_per_s2")
_MASSES = ("load_mass_kg", "load_arm_m", "load_inertia_kgm2")
_LOAD = (*_RATIOS, "inertia_sd", "gravity_sd", "motor_inertia_kgm2", *_MASSES)
# Keywords of `estimate`: the log's columns and movement, its load, the method.
GIVEN = (*_FORM, *_LOAD, "calibration", "method", "arm_m")


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
    if unknown := sorted(set(given) - set(GIVEN)):
        raise TypeError(f"no parameter {unknown[0]!r}; there are {', '.join(GIVEN)}")
    given = {name: value for name, value in given.items() if value is not None}
    arm_m = given.get("arm_m")
    check_positive(arm_m=arm_m)
    form = _form_of(log, given)
    own = read_calibration(given.get("calibration"))
    asked = []
    if form.torque or not given.keys().isdisjoint(_RATIOS + _MASSES):
        asked.append(TORQUE)
    if own:
        asked.append(WAVEFORM)
    method = given.get("method", (asked or [AMPLITUDE])[0])
    if method not in METHODS:
        raise Refusal(f"--method {method}: there are {', '.join(METHODS)}")
    if set(asked) - {method}:
        raise Refusal(
            "the torque and its load are of method torque, a calibration of method waveform: "
            "leave out all but one"
        )
    if method == TORQUE:
        return Settings(form, method, load=_load_of(form, given), arm_m=arm_m)
    if method == WAVEFORM:
        used = own or example_calibration()
        return Settings(form, method, calibration=used, is_own=bool(own), arm_m=arm_m)
    return Settings(form, arm_m=arm_m)


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
    load = {name: given[name] for name in _LOAD if name in given}
    there = {*load, *(name for name in ("torque", "gear_ratio") if getattr(form, name))}
    needed: tuple[str, ...] = ("torque", *_RATIOS)
    by_masses = not there.isdisjoint(_MASSES)
    if by_masses:
        needed = ("torque", "gear_ratio", "motor_inertia_kgm2", "load_mass_kg", "load_arm_m")
    if missing := " and ".join(option_of(name) for name in needed if name not in there):
        raise Refusal(
            f"the torque and the load's data, by its ratios or its masses, are needed: give {missing} too"
        )
    if not by_masses:
        return LoadData(**load)
    if not there.isdisjoint(_RATIOS):
        raise Refusal(
            "--load-mass beside --inertia-ratio or --gravity: give the load by its ratios or by its masses"
        )
    return load_from_masses(form.gear_ratio or 0.0, **load)
