"""Logs of real joints, from public repositories: the sensor's answers, and the loss that their torque shows.

`hardware.csv` names each log's file, and what is known of its load; the files are downloaded or found in the folder
that `HARDWARE_LOGS` names, `OWNER+REPOSITORY/` and then the path. A gravity of 0 is a load without any.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np
import pandas as pd
from scipy import stats
from scipy.ndimage import gaussian_filter1d

from backlash.estimates import Estimate
from replication.records import public_file
from replication.signature import TURN, FloatArray
from studies import simulated_joints
from studies.datasheet import ask_sensor

_SMOOTHING_S = 0.02  # of the speed that a rigid load follows
_REST_RAD_S = 0.02
_LONGEST_S = 1e6  # of a log; longer ones are in ns
_ASSUMED_GRAVITY = 10.0  # 1/s^2, given of a load without any
_LEAST_VARIANCE = 0.04  # of a sign: below, it hardly changes
_BLOCK_S = 0.5  # within which residuals are not independent


class JointLog(NamedTuple):
    """A log of a joint: time [s], angle [rad] and speed [rad/s] of the load's side, and the motor's torque."""

    t: FloatArray
    angle: FloatArray
    speed: FloatArray
    torque: FloatArray
    load_angle: FloatArray = np.empty(0)  # by a second encoder


def list_logs() -> pd.DataFrame:
    """The logs, by name."""
    return pd.read_csv(Path(__file__).with_name("hardware.csv"), index_col="log")


# Why the sensor refuses a log, as the end of a sentence.
BECAUSE = {
    "not constant speed": "the speed is not constant",
    "no gravity in the torque": "the torque shows no gravity",
    "turns differ": "the turns differ",
}


def describe_answers(answers: pd.DataFrame) -> dict[str, Any]:
    """How many logs the sensor refuses, and how many for the usual reason: from verdicts and reasons, a row a log."""
    reasons = answers.loc[answers["verdict"] == "cannot tell", "reason"]
    usual, count = next(iter(reasons.value_counts().items()), ("", 0))
    because = BECAUSE.get(usual, usual)
    return {"logs": len(answers), "refused": len(reasons), "usual": count, "because": because}


def load_log(row: Mapping[str, Any]) -> JointLog:
    """Read the log of a row of `list_logs`; DataUnavailable where it cannot be had."""
    address = f"https://raw.githubusercontent.com/{row['repository']}/{row['commit']}/"
    name = f"{row['repository'].replace('/', '+')}/{row['path']}"
    file = public_file(address + quote(row["path"]), name, row["sha256"], "HARDWARE_LOGS")
    log = _READERS[row["make"]](file, row["axis"])
    return log._replace(t=log.t - log.t[0])


def _read_ur10e(file: Path, axis: int) -> JointLog:
    columns = np.loadtxt(file, delimiter=",").T
    return JointLog(columns[0], *columns[[axis, axis + 6, axis + 12]])


def _read_printed_gear(file: Path, _: int) -> JointLog:
    # Run-ins with ; and ns, trajectories with , and s.
    table = pd.read_csv(file, sep=None, engine="python")
    table = table.drop_duplicates("TIME", ignore_index=True)  # of a logger that polls
    t = table["TIME"] - table["TIME"].iloc[0]
    t *= 1e-9 if t.iloc[-1] > _LONGEST_S else 1.0
    moved = TURN * table[["POSITION", "VELOCITY"]]
    return JointLog(*np.column_stack([t, moved, table["TORQUE"]]).T)


def _read_kr300(file: Path, axis: int) -> JointLog:
    from scipy.io import loadmat  # slow to import

    record = loadmat(file, squeeze_me=True, struct_as_record=False)["rec"]
    k = axis - 1
    angle, load_angle, speed = np.deg2rad(
        [record.act_pos_mot_deg[k], record.act_pos_se_deg[k], record.act_vel_mot_deg_per_s[k]]
    )
    return JointLog(record.time_cont, angle, speed, record.act_torque_abs_nm[k], load_angle)


def _read_pendulum(file: Path, _: int) -> JointLog:
    table = pd.read_csv(file).rename(columns={"pos": "position", "vel": "velocity"})
    return JointLog(*table[["time", "position", "velocity", "torque"]].to_numpy().T)


_READERS: dict[str, Callable[[Path, int], JointLog]] = {
    "Universal Robots": _read_ur10e,
    "printed": _read_printed_gear,
    "KUKA": _read_kr300,
    "T-Motor": _read_pendulum,
}


def answer(log: JointLog, row: Mapping[str, Any]) -> Estimate:
    """Estimate by the torque, from what is known of the load."""
    ratio = row["gear_ratio"]
    load = ratio, row["inertia_ratio"], row["gravity_per_s2"] or _ASSUMED_GRAVITY
    asked = simulated_joints.JointLog(log.t, ratio * log.speed, log.torque, *load, {})
    return ask_sensor(asked, unit="rad/s")


def smooth_speed(log: JointLog) -> FloatArray:
    """The speed that a rigid load follows."""
    speed: FloatArray = gaussian_filter1d(log.speed, _SMOOTHING_S / np.median(np.diff(log.t)))
    return speed


def regress(terms: FloatArray, y: FloatArray, block: int) -> tuple[Any, Any]:
    """Coefficients of a linear regression, and SDs for which the residuals of a block count as one."""
    coefficients = np.linalg.lstsq(terms, y, rcond=None)[0]
    whole = len(y) // block * block
    scores = (y - terms @ coefficients)[:, None] * terms
    scores = scores[:whole].reshape(-1, block, terms.shape[1]).sum(axis=1)
    bread = np.linalg.pinv(terms.T @ terms)
    return coefficients, np.sqrt(np.diag(bread @ scores.T @ scores @ bread))


def fit_rigid_load(log: JointLog) -> dict[str, float]:
    """Regress the torque on a rigid load under gravity, friction and a loss in the gear; with the loss's SD.

    `gravity` is in the torque's unit, with the angle `zero` at which it has none; `friction`, and what is `left` with
    and without a loss, are over gravity.
    """
    speed = smooth_speed(log)
    moving, acceleration = np.tanh(speed / _REST_RAD_S), np.gradient(speed, log.t)
    sine, cosine = np.sin(log.angle), np.cos(log.angle)
    terms = np.array([sine, cosine, acceleration, moving, speed, np.ones_like(speed)]).T
    block = max(int(_BLOCK_S / np.median(np.diff(log.t))), 1)
    lossless, _ = regress(terms, log.torque, block)
    gravity = np.hypot(*lossless[:2])
    # A share of the torque that the gear carries, against the movement.
    carried = np.abs(terms[:, :2] @ lossless[:2]) * moving
    design = np.column_stack([terms, carried])
    unknowns, sds = regress(design, log.torque, block)
    return {
        "gravity": gravity,
        "friction": unknowns[3] / gravity,
        "zero": np.arctan2(-lossless[1], lossless[0]),
        "loss": unknowns[-1],
        "loss_sd": sds[-1],
        "left": (log.torque - design @ unknowns).std() / gravity,
        "left_lossless": (log.torque - terms @ lossless).std() / gravity,
    }


def measure_log(log: str) -> dict[str, Any]:
    """What the sensor says of a log, by its name."""
    row = list_logs().loc[log]
    told = answer(load_log(row), row)
    return {"log": log, "verdict": told.verdict, "reason": told.reason}


def lost_motion(logs: Sequence[JointLog]) -> pd.DataFrame:
    """By how much motor and load part [rad] with the sign of torque and speed, if that changes, with 95 % intervals.

    Regressed beside torque, speed, acceleration and angle; residuals of half a second count as one.
    """
    block = round(_BLOCK_S / (logs[0].t[1] - logs[0].t[0]))
    terms, parted = np.split(np.vstack([_list_motion(log, block) for log in logs]), [-1], axis=1)
    by_sign, sds = (each[:2] for each in regress(terms, parted[:, 0], block))
    half = stats.t.ppf(0.975, len(terms) // block - 1) * sds
    ends = {"low_rad": by_sign - half, "high_rad": by_sign + half}
    signs = ["sign of torque", "sign of speed"]
    table = pd.DataFrame({"coefficient_rad": by_sign, **ends}, index=signs)
    return table[terms[:, :2].var(axis=0) > _LEAST_VARIANCE]


def _list_motion(log: JointLog, block: int) -> FloatArray:
    """Terms of a log's lost motion and, last, by how much motor and load part, less their means, in whole blocks."""
    acceleration = np.gradient(gaussian_filter1d(log.speed, 3), log.t)
    signs = np.sign(log.torque), np.sign(log.speed)
    parted = log.angle - log.load_angle
    z = np.array([*signs, log.torque, log.speed, acceleration, log.angle, parted]).T
    return (z - z.mean(axis=0))[: len(z) // block * block]
