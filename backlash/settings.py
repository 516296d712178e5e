"""How logs are read and measured."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from numbers import Integral
from typing import Any

from backlash.calibration import Calibration, OwnCalibration, default_calibration, read_calibration
from backlash.fitting import SELF, TORQUE
from backlash.fitting.torque import LoadData
from backlash.reading.columns import LogFormat
from backlash.refusals import Refusal


@dataclass(frozen=True)
class Settings:
    """How logs are read and measured; the calibration, the user's own or the paper's joint's, holds the method."""

    form: LogFormat
    calibration: Calibration
    is_own: bool = False  # the user made the calibration; else it is that of the paper's joint
    repeats: int = 30  # searches of method "paper"
    seed: int = 1  # of the first of them, and of what method "torque" draws, above 0
    load: LoadData | None = None  # for method "torque"


# What method "torque" needs, and the options that say it: of the load's two ratios, or of its masses.
_BY_RATIOS = {
    "torque": "--torque",
    "inertia_ratio": "--inertia-ratio",
    "gravity_per_s2": "--gravity",
}
_BY_MASSES = {
    "torque": "--torque",
    "gear_ratio": "--gear-ratio",
    "motor_inertia_kgm2": "--motor-inertia",
    "load_mass_kg": "--load-mass",
    "load_arm_m": "--load-arm",
}
_MASSES = ("load_mass_kg", "load_arm_m", "load_inertia_kgm2")
# What `settings_for` takes: how logs are measured, and for method "torque" what its load is known by.
MEASURING = (
    *("calibration", "method", "repeats", "seed", *_MASSES),
    *(each.name for each in fields(LoadData) if each.name != "note"),
)


def settings_for(
    form: LogFormat,
    calibration: OwnCalibration = None,
    method: str | None = None,
    repeats: int = 30,
    seed: int = 1,
    **load: Any,
) -> Settings:
    """Put settings together: without a calibration the log's own joint, or for another method the paper's."""
    own = read_calibration(calibration)
    load = {name: value for name, value in load.items() if value is not None}
    data = None
    if method == TORQUE or form.torque or any(not name.endswith("_sd") for name in load):
        if own is not None or method not in (None, TORQUE):
            raise Refusal(
                "method torque goes without a calibration or another method: leave out one of them"
            )
        method, data = TORQUE, _load_data(form, load)
    if own is not None and method not in (None, own.method):
        raise Refusal(f"--method {method}: the calibration is of method {own.method}")
    if not all(isinstance(each, Integral) and each > 0 for each in (repeats, seed)):
        raise Refusal("--repeats and --seed must be whole numbers, 1 or more")
    method = method or SELF
    is_alone = method in (SELF, TORQUE)  # needs only the least backlash that another would see
    used = own or default_calibration("amplitude" if is_alone else method)
    if own is None and is_alone:
        used = replace(used, method=method, provenance="none: the log's own joint")
    return Settings(form, used, own is not None, repeats, seed, data)


def _load_data(form: LogFormat, load: Mapping[str, Any]) -> LoadData:
    """What is known of the load; refuse what is missing, or said twice."""
    by_masses = not load.keys().isdisjoint(_MASSES)
    needed = _BY_MASSES if by_masses else _BY_RATIOS
    known = {**load, "torque": form.torque, "gear_ratio": form.gear_ratio}
    if missing := " and ".join(needed[name] for name in needed if known.get(name) is None):
        what = "the load's data, by its ratios or its masses"
        raise Refusal(f"method torque needs the torque and {what}: give {missing} too")
    if not by_masses:
        return LoadData(**load)
    if not load.keys().isdisjoint(_BY_RATIOS):
        raise Refusal(
            "--load-mass beside --inertia-ratio or --gravity: give the load by its ratios or by its masses"
        )
    return LoadData.from_masses(known["gear_ratio"], **load)
