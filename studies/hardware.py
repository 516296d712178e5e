"""Logs of real joints, from public repositories: the sensor's answers, and what it could have seen.

`hardware.csv` names each log's file, and what is known of its load; the files are downloaded or found in the folder
that `HARDWARE_LOGS` names, `OWNER+REPOSITORY/` and then the path. A gravity of 0 is a load without any.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np
import pandas as pd
from numpy.random import Generator
from scipy import stats
from scipy.ndimage import gaussian_filter1d

from backlash.answers import Estimate
from backlash.interface import estimate
from replication.arrays import FloatArray
from replication.joint import TURN
from replication.parallel import in_parallel
from replication.records import public_file
from studies.strokes import CONTROL_S, draw_joint, run_joint

DELTAS_RAD = (0.0, 5e-4, 1e-3, 2e-3, 3e-3)
DRAWS = 20
SEED = 17
_SEEN = 0.9  # share of the draws that are answered, from the detection limit on
_SMOOTHING_S = 0.02  # of the speed that a twin is to follow
_REST_RAD_S = 0.02
_MOST_RATIO = 5.0  # of inertias: with more the drawn drives are unstable
_SETTLED = 0.02  # of the fastest speed; a joint that strays more from its path is not tuned
_GEAR_RATIO = 100  # of the twin's encoder
_ASSUMED_GRAVITY = 10.0  # 1/s^2, said of a load without any
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


def load_log(row: Mapping[str, Any]) -> JointLog:
    """Read the log of a row of `list_logs`; DataUnavailable where it cannot be had."""
    import pooch  # slow to import

    address = f"https://raw.githubusercontent.com/{row['repository']}/{row['commit']}/"
    name = f"{row['repository'].replace('/', '+')}/{row['path']}"
    cache = Path(pooch.os_cache("backlash-hardware"))
    file = public_file(address + quote(row["path"]), name, row["sha256"], "HARDWARE_LOGS", cache)
    log = _READERS[row["make"]](file, row["axis"])
    return log._replace(t=log.t - log.t[0])


def _read_ur10e(file: Path, axis: int) -> JointLog:
    columns = np.loadtxt(file, delimiter=",").T
    return JointLog(columns[0], *columns[[axis, axis + 6, axis + 12]])


def _read_printed_gear(file: Path, _: int) -> JointLog:
    table = pd.read_csv(file, sep=";")
    t = 1e-9 * (table["TIME"] - table["TIME"].iloc[0])
    turns, speed_rps = table["POSITION"], table["VELOCITY"]
    return JointLog(*np.array([t, TURN * turns, TURN * speed_rps, table["TORQUE"]]))


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


def answer(log: JointLog, row: Mapping[str, Any], **words: Any) -> Estimate:
    """Estimate by the torque, from what is known of the load, or by what else is said."""
    if not words:
        gravity = row["gravity_per_s2"] or _ASSUMED_GRAVITY
        words = {"inertia_ratio": row["inertia_ratio"], "gravity_per_s2": gravity}
        words["torque"] = log.torque
    ratio = row["gear_ratio"]
    return estimate(log.t, ratio * log.speed, gear_ratio=ratio, unit="rad/s", **words)


def turn_period_s(log: JointLog) -> float:
    """Mean turn [s] of the second half of a log, by its angle."""
    late = log.t > log.t[-1] / 2
    return float(TURN * np.ptp(log.t[late]) / np.ptp(log.angle[late]))


class Twin(NamedTuple):
    """What a joint is simulated from: angle and speed at each control period, its load, and the torque's unit."""

    path: FloatArray
    load: dict[str, float]  # of a `DrivenJoint`
    unit: float
    noise: FloatArray  # of speed and torque, at the samples


def find_twin(log: JointLog, row: Mapping[str, Any]) -> Twin:
    """Fit a rigid load under gravity and friction to a log; what is left is noise."""
    t = np.arange(0.0, log.t[-1], CONTROL_S)
    speed = gaussian_filter1d(np.interp(t, log.t, log.speed), _SMOOTHING_S / CONTROL_S)
    angle = log.angle[0] + CONTROL_S * np.cumsum(speed)
    rubbing, acceleration = np.tanh(speed / _REST_RAD_S), np.gradient(speed, CONTROL_S)
    terms = [np.sin(angle), np.cos(angle), rubbing, speed, acceleration]
    at_samples = np.array([np.interp(log.t, t, term) for term in terms])
    found = np.linalg.lstsq(at_samples.T, log.torque, rcond=None)[0]
    sine, cosine, friction, viscosity, inertia = found
    unit = abs(inertia) / (1 + 1 / row["inertia_ratio"])
    if row["gravity_per_s2"]:
        unit = np.hypot(sine, cosine) / row["gravity_per_s2"]
    load = {
        "inertia_ratio": min(row["inertia_ratio"], _MOST_RATIO),
        "gravity": row["gravity_per_s2"],
        "vertical_rad": np.arctan2(cosine, sine),
        "load_friction": 0.0,
        "load_viscous": 0.0,
        "motor_friction": max(friction, 0) / unit,
        "motor_viscous": max(viscosity, 0) / unit,
    }
    noise = np.array([log.speed - at_samples[3], log.torque - found @ at_samples])
    return Twin(np.column_stack([angle, speed]), load, unit, noise)


def simulate_twin(
    log: JointLog, row: Mapping[str, Any], delta_rad: float, rng: Generator
) -> JointLog:
    """A log of a drawn joint with the movement, clock, load and noise of a log, and a backlash.

    Stiffness, damping and drive are drawn as those of `strokes`, again if the joint does not follow the movement; the
    noise starts at a random sample.
    """
    twin = find_twin(log, row)
    fastest = float(np.abs(log.speed).max())
    while True:
        drawn = draw_joint(rng, delta_rad, fastest, _GEAR_RATIO)
        joint = drawn._replace(**twin.load)
        heavier = (1 + 1 / joint.inertia_ratio) / (1 + 1 / drawn.inertia_ratio)
        gains = heavier * drawn.speed_gain, heavier * drawn.integral_gain
        tuned = joint._replace(speed_gain=gains[0], integral_gain=gains[1])
        seen = run_joint(tuned, twin.path)
        if np.abs(seen[:, 0] - twin.path[:, 1]).mean() < _SETTLED * fastest:
            break
    t = CONTROL_S * np.arange(len(seen))
    noise = np.roll(twin.noise, rng.integers(log.t.size), axis=1)
    speed, torque = (np.interp(log.t, t, column) for column in seen.T)
    return log._replace(speed=speed + noise[0], torque=twin.unit * torque + noise[1])


def measure_twins(name: str, row: Mapping[str, Any]) -> pd.DataFrame:
    """Answers on the twins of a log: of how many draws at each backlash, and how many of them cover it."""
    log = load_log(row)
    table = []
    for delta_rad in DELTAS_RAD:
        rngs = [np.random.default_rng((SEED, draw)) for draw in range(DRAWS)]
        twins = [simulate_twin(log, row, delta_rad, rng) for rng in rngs]
        found = [answer(twin, row).backlash_interval_rad for twin in twins]
        covered = [low <= delta_rad <= high for low, high in filter(None, found)]
        table.append((name, delta_rad, DRAWS, len(covered), sum(covered)))
    return pd.DataFrame(table, columns=["log", "delta_rad", "draws", "answered", "covered"])


def measure_all() -> pd.DataFrame:
    """Answers on the twins of every log."""
    calls = [(str(name), row) for name, row in list_logs().iterrows()]
    return pd.concat(in_parallel(measure_twins, calls, "logs"))


def detection_limits(twins: pd.DataFrame) -> pd.DataFrame:
    """The smallest backlash of each log whose twins are answered in 90 % of the draws; nan: none is.

    And the answered share of the twins with the largest backlash, with its exact 95 % interval.
    """
    rows = {}
    for name, of_log in twins[twins["delta_rad"] > 0].groupby("log", sort=False):
        seen = of_log[of_log["answered"] >= _SEEN * of_log["draws"]]
        last = of_log.iloc[-1]
        share = stats.binomtest(int(last["answered"]), int(last["draws"])).proportion_ci()
        rows[name] = (seen["delta_rad"].min(), last["answered"] / last["draws"], *share)
    columns = ["limit_rad", "answered", "low", "high"]
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns)


def lost_motion(logs: Sequence[JointLog]) -> pd.DataFrame:
    """By how much motor and load part [rad] with the sign of torque and speed, if that changes, with 95 % intervals.

    Regressed beside torque, speed, acceleration and angle; residuals of half a second count as one.
    """
    blocks = np.concatenate([_block_motion(log) for log in logs])
    X, parted = blocks[..., :-1], blocks[..., -1]
    terms = X.reshape(-1, X.shape[-1])
    bread = np.linalg.inv(terms.T @ terms)
    found = bread @ terms.T @ parted.ravel()
    scores = np.einsum("ijk,ij->ik", X, parted - X @ found)
    deviation = np.sqrt(np.diag(bread @ scores.T @ scores @ bread))
    half = stats.t.ppf(0.975, len(scores) - 1) * deviation
    table = {"coefficient_rad": found, "low_rad": found - half, "high_rad": found + half}
    by_sign = pd.DataFrame(table)[:2].set_axis(["sign of torque", "sign of speed"])
    return by_sign[terms[:, :2].var(axis=0) > _LEAST_VARIANCE]


def facts(answers: pd.DataFrame, twins: pd.DataFrame, lost: pd.DataFrame) -> dict[str, Any]:
    """What texts say of the logs, of what their twins would have shown, and of the lost motion."""
    robots = answers[answers["make"] == "Universal Robots"]
    by_torque = lost[lost.index.get_level_values(-1) == "sign of torque"]
    return {
        "hardware_logs": len(answers),
        "hardware_joints": answers["joint"].nunique(),
        "hardware_makes": answers["make"].nunique(),
        "hardware_twins": twins["draws"].sum(),
        "hardware_twins_answered": twins["answered"].sum(),
        "hardware_twins_right": twins["covered"].sum(),
        "hardware_largest": (1e3 * twins["delta_rad"].max(), "g"),
        "hardware_no_gravity": int(robots["reason"].str.contains("shows no gravity").sum()),
        "hardware_lost_mrad": (1e3 * by_torque.abs().max(axis=1).to_numpy(), ".2g"),
    }


def _block_motion(log: JointLog) -> FloatArray:
    """Terms of a log's lost motion and, last, by how much motor and load part, less their means, by block."""
    acceleration = np.gradient(gaussian_filter1d(log.speed, 3), log.t)
    signs = np.sign(log.torque), np.sign(log.speed)
    parted = log.angle - log.load_angle
    z = np.array([*signs, log.torque, log.speed, acceleration, log.angle, parted]).T
    size = round(_BLOCK_S / (log.t[1] - log.t[0]))
    whole = len(z) // size * size
    return (z - z.mean(axis=0))[:whole].reshape(-1, size, z.shape[1])
