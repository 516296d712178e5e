"""What a joint that is not quite the calibrated one does to each method's backlash."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import pandas as pd

from replication.methods.calibration import default_calibration
from replication.methods.joint_match import changed, match_joint
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import JointParameters
from replication.studies.benchmark import (
    JOINT_ALL_FREE,
    JOINT_METHODS,
    Log,
    calibrated_answers,
    logs_by_methods,
    summarise_errors,
)

Change = Callable[[JointParameters, float], JointParameters]


def _scaled(*names: str) -> Change:
    """Multiply fields by 1 + change."""

    def change(joint: JointParameters, share: float) -> JointParameters:
        return replace(joint, **{name: (1 + share) * getattr(joint, name) for name in names})

    return change


def _friction(field: str, per_unit: Callable[[JointParameters], float]) -> Change:
    """Add friction where the identified joint has none: a share of the torque that `per_unit` gives it."""

    def change(joint: JointParameters, share: float) -> JointParameters:
        return replace(joint, **{field: share * per_unit(joint)})

    return change


def _load_speed(joint: JointParameters) -> float:
    return joint.commanded_speed_rad_per_s / joint.gear_ratio


# What changes, by name. The identified joint has no friction, so it only grows, to a share of the gravity torque.
CHANGES = {
    "load mass": lambda joint, share: changed(joint, {"load": 1 + share}),
    "commanded speed": _scaled("commanded_speed_rps"),
    "stiffness": _scaled("stiffness_nm_per_rad"),
    "position gain": _scaled("position_gain_per_s"),
    "speed gain": _scaled("speed_gain_nms_per_rad"),
    "integral gain": _scaled("integral_gain_nm_per_rad"),
    "derivative gain": _scaled("derivative_gain_nms2_per_rad"),
    "leaky gain": _scaled("leaky_gain_nm_per_rad"),
    "torque lag": _scaled("torque_lag_s"),
    "load Coulomb friction": _friction("load_coulomb_nm", lambda j: j.gravity_torque_nm),
    "load viscous friction": _friction("load_viscous_nms_per_rad", lambda j: j.gravity_torque_nm / _load_speed(j)),
}
GROWS_ONLY = tuple(name for name in CHANGES if "friction" in name)


def _draw_log(joint: JointParameters, name: str, share: float, delta_rad: float) -> Log:
    record = simulate_recordings(CHANGES[name](joint, share), [delta_rad])[0]
    return Log({"parameter": name if share else "nothing", "change": share}, delta_rad, record)


def robustness(
    joint: JointParameters, deltas_rad: Sequence[float], shares: Sequence[float], names: Sequence[str] = tuple(CHANGES)
) -> pd.DataFrame:
    """Errors on noise-free records of methods that are calibrated on the joint before one thing about it changed."""
    calibrations = {"equation 10": default_calibration("paper")}
    calibrations |= {method: default_calibration(method) for method in ("amplitude", "energy", "waveform")}

    def answers(log: Log) -> dict[str, float]:
        # The commanded speed is known; the sensor refuses a log of another one, here it is measured all the same.
        known = replace(joint, commanded_speed_rps=log.recording.commanded_speed_rps)
        by_joint = match_joint(log.recording, known, JOINT_METHODS[JOINT_ALL_FREE]).delta_rad
        return calibrated_answers(log.recording, calibrations) | {JOINT_ALL_FREE: by_joint}

    changes = [(name, share) for name in names for share in shares if share > 0 or name not in GROWS_ONLY]
    logs = [partial(_draw_log, joint, *change, d) for change in (*changes, ("stiffness", 0.0)) for d in deltas_rad]
    return logs_by_methods(logs, answers)


def mean_errors(table: pd.DataFrame) -> pd.DataFrame:
    """Mean and largest error of each method at each change of `robustness`, over the backlashes."""
    groups = table.groupby(["parameter", "method", "change"], sort=False)["error_rad"]
    summary = groups.agg(mean_error_rad="mean", max_abs_error_rad=lambda error: error.abs().max())
    return summary.reset_index()


def ranking(table: pd.DataFrame) -> pd.DataFrame:
    """Rank the methods by their RMS error over all changes of `robustness`, beside that on the joint as it was."""
    moved, still = table[table["change"] != 0], table[table["change"] == 0]
    ranked = summarise_errors(moved)[["method", "rmse_rad", "max_abs_error_rad"]]
    worst = moved["error_rad"].abs().groupby(moved["method"]).idxmax()
    ranked["worst_parameter"] = moved["parameter"].loc[worst.loc[ranked["method"]]].to_numpy()
    ranked["unchanged_rmse_rad"] = summarise_errors(still)["rmse_rad"]
    return ranked.sort_values("rmse_rad", ignore_index=True)
