"""What is given of logs, and how they are measured by it."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from backlash.load_data import LoadData, load_from_masses
from backlash.reading.columns import LogFormat
from backlash.reading.prepare import Log
from backlash.refusals import Refusal, check_positive, option_of

_FORM = tuple(field.name for field in fields(LogFormat))
_RATIOS = ("inertia_ratio", "gravity_per_s2")
_MASSES = ("load_mass_kg", "load_arm_m", "load_inertia_kgm2")
_LOAD = (*_RATIOS, "inertia_sd", "gravity_sd", "motor_inertia_kgm2", *_MASSES)
# Keywords of `estimate`: the log's columns and movement, and its load.
GIVEN = (*_FORM, *_LOAD, "arm_m")


@dataclass(frozen=True)
class Settings:
    """How a log is read and measured."""

    form: LogFormat
    load: LoadData | None = None  # by which the torque tells the backlash
    arm_m: float | None = None  # at which the play is wanted in mm, too


def settings_for(log: object, given: Mapping[str, Any]) -> Settings:
    """Settings of a log by the keywords of `estimate`."""
    if unknown := sorted(set(given) - set(GIVEN)):
        raise TypeError(f"no parameter {unknown[0]!r}; there are {', '.join(GIVEN)}")
    given = {name: value for name, value in given.items() if value is not None}
    arm_m = given.get("arm_m")
    check_positive(arm_m=arm_m)
    form = _form_of(log, given)
    is_by_torque = form.torque or not given.keys().isdisjoint(_RATIOS + _MASSES)
    return Settings(form, _load_of(form, given) if is_by_torque else None, arm_m)


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
