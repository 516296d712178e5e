"""How logs are read and measured."""

from dataclasses import dataclass, fields, replace
from numbers import Integral
from typing import Any

from backlash.calibration import Calibration, OwnCalibration, default_calibration, read_calibration
from backlash.fitting import SELF, TORQUE
from backlash.fitting.torque import LoadData
from backlash.reading.columns import LogFormat
from backlash.reading.refusals import UnusableLog


@dataclass(frozen=True)
class Settings:
    """How logs are read and measured; the calibration, the user's own or the paper's joint's, holds the method."""

    form: LogFormat
    calibration: Calibration
    is_own: bool = False  # the user made the calibration; else it is that of the paper's joint
    repeats: int = 30  # searches of method "paper"
    seed: int = 1  # of the first of them, and of what method "torque" draws, above 0
    load: LoadData | None = None  # for method "torque"


# What `settings_for` takes: how logs are measured, and for method "torque" the fields of `LoadData`.
MEASURING = ("calibration", "method", "repeats", "seed", *(each.name for each in fields(LoadData)))


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
    given = (form.torque, load.get("inertia_ratio"), load.get("gravity_per_s2"))
    data = None
    if method == TORQUE or any(value is not None for value in given):
        if own is not None or method not in (None, TORQUE):
            raise UnusableLog(
                "method torque goes without a calibration or another method: leave out one of them"
            )
        options = zip(("--torque", "--inertia-ratio", "--gravity"), given, strict=True)
        if missing := " and ".join(option for option, value in options if value is None):
            raise UnusableLog(
                f"method torque needs the torque and the load's data: give {missing} too"
            )
        method, data = TORQUE, LoadData(**load)
    if own is not None and method not in (None, own.method):
        raise UnusableLog(f"--method {method}: the calibration is of method {own.method}")
    if not all(isinstance(each, Integral) and each > 0 for each in (repeats, seed)):
        raise UnusableLog("--repeats and --seed must be whole numbers, 1 or more")
    method = method or SELF
    is_alone = method in (SELF, TORQUE)  # needs only the least backlash that another would see
    used = own or default_calibration("amplitude" if is_alone else method)
    if own is None and is_alone:
        used = replace(used, method=method, provenance="none: the log's own joint")
    form = replace(form, usual_speed_rps=used.commanded_speed_rps)
    return Settings(form, used, own is not None, repeats, seed, data)
