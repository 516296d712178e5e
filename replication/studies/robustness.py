"""What a joint that is not quite the calibrated one does to each method's backlash."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from replication.global_fit.fit import global_fit
from replication.methods.calibration import Calibration, backlashes, default_calibration
from replication.methods.joint_match import NUISANCES, changed, match_joint
from replication.methods.readings import protocol_for
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import JointParameters


def _scaled(*names: str) -> Callable[[JointParameters, float], JointParameters]:
    """Multiply fields by 1 + change."""

    def change(joint: JointParameters, share: float) -> JointParameters:
        return replace(joint, **{name: (1 + share) * getattr(joint, name) for name in names})

    return change


def _friction(field: str, per_unit: Callable[[JointParameters], float]):
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
# Methods, and the one that simulates with start angle, friction and load unknown.
JOINT = "joint, all nuisances free"
GROWS_ONLY = tuple(name for name in CHANGES if "friction" in name)


def _errors(
    joint: JointParameters, name: str, share: float, delta: float, calibrations: Mapping[str, Calibration]
) -> dict[str, float]:
    """Error [rad] of each method on a record of the changed joint."""
    record = simulate_recordings(CHANGES[name](joint, share), [delta])[0]
    fit = global_fit(record, protocol_for(record))
    found = {method: backlash.delta_rad for method, backlash in backlashes(record, fit, calibrations).items()}
    known = replace(joint, commanded_speed_rps=record.commanded_speed_rps)
    found[JOINT] = match_joint(record, known, tuple(NUISANCES)).delta_rad
    return {method: value - delta for method, value in found.items()}


def robustness(
    joint: JointParameters, deltas_rad: Sequence[float], shares: Sequence[float], names: Sequence[str] = tuple(CHANGES)
) -> pd.DataFrame:
    """Errors of the methods, calibrated on the joint as it is, when one thing about it has changed.

    Records are noise-free. "equation 10" is printed, of the global fit's amplitude. A changed speed changes the turn
    period; the sensor refuses such a log, here it is measured all the same. The joint with free nuisances is simulated
    at the speed that was commanded.
    """
    calibrations = {"equation 10": default_calibration("paper")}
    calibrations |= {method: default_calibration(method) for method in ("amplitude", "energy", "waveform")}
    jobs = [
        (name, share, delta)
        for name in names
        for share in shares
        if share > 0 or name not in GROWS_ONLY
        for delta in deltas_rad
    ]
    jobs += [("stiffness", 0.0, delta) for delta in deltas_rad]
    found = Parallel(n_jobs=-1, batch_size=4)(delayed(_errors)(joint, *job, calibrations) for job in jobs)
    return pd.DataFrame(
        [
            {"parameter": name if share else "nothing", "change": share, "delta_rad": delta}
            | {"method": method, "error_rad": error}
            for (name, share, delta), errors in zip(jobs, found, strict=True)
            for method, error in errors.items()
        ]
    )


def mean_errors(table: pd.DataFrame) -> pd.DataFrame:
    """Average `robustness` over the backlashes."""
    groups = table.groupby(["parameter", "method", "change"], sort=False)["error_rad"]
    summary = groups.agg(mean_error_rad="mean", max_abs_error_rad=lambda error: error.abs().max())
    return summary.reset_index()


def ranking(table: pd.DataFrame) -> pd.DataFrame:
    """Rank the methods by their RMS error over all changes of `robustness`."""
    rows = []
    for method, part in table.groupby("method", sort=False):
        moved, still = part[part["change"] != 0], part[part["change"] == 0]
        worst = moved.loc[moved["error_rad"].abs().idxmax()]
        rms, unchanged = (float(np.sqrt(np.mean(p["error_rad"] ** 2))) for p in (moved, still))
        rows.append((method, rms, abs(worst["error_rad"]), worst["parameter"], unchanged))
    columns = ["method", "rmse_rad", "max_abs_error_rad", "worst_parameter", "unchanged_rmse_rad"]
    return pd.DataFrame(rows, columns=columns).sort_values("rmse_rad", ignore_index=True)
