"""The joint that made the published signals, identified from four of the authors' noise-free records.

A record of the motor's speed tells ratios only (`joint.ratios`); the 5 kg of the load set the scale. Friction and the
coupling's damping stay zero: the records do not need them, and with much friction on the load the impacts would not
be evenly spaced. Other levels' records, and the peaks before sampling, are not used; the form of the drive, though,
was chosen with all of them in view.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from pandas import DataFrame
from scipy.optimize import least_squares
from scipy.special import stdtrit

from replication.joint import Joint, change, from_ratios, ratios, simulate
from replication.records import Recording, load_clean_records
from replication.signature import FloatArray

Records = Mapping[float, Recording]  # by backlash [rad]

FIT_LEVELS = (3, 6, 9, 12)  # levels K whose records identify the joint
STEP = 5e-5

# Rough values from which the fit reaches the identified ones. It keeps the signs: without the leaky
# integral, which has a negative gain, it would end in a worse minimum.
ROUGH_RATIOS = {
    "K_s/J_l": 4.5e4,
    "G/J_l": 33.0,
    "J_l/(N^2 J_m)": 5.0,
    "K_p/J_m": 850.0,
    "K_i/J_m": 1.5e5,
    "K_d/J_m": 1.0,
    "K_w/J_m": -4e4,
    "K_pos": 25.0,
    "w_rate": 30.0,
    "torque_lag": 1.5e-3,
    "start_angle": 0.149,
    "lead": 0.0455,
}


class Identification(NamedTuple):
    """An identified joint and how well the records fix it."""

    joint: Joint
    interval_95: dict[str, list[float]]  # of each ratio, from the linearised least squares
    correlation: DataFrame  # of the ratios' estimates
    nrmse: float  # root of the mean over the levels of the squared normalised RMSE


def errors_in_turn(joint: Joint, records: Records, turn: int) -> list[FloatArray]:
    """Simulated less recorded speed in one turn (1: the first) of each record, in SDs.

    The SD is that of the record's speed after its first turn. Records are evenly sampled from t = 0 and no shorter than
    the turn's end. A ValueError: see `joint.simulate`.
    """
    errors = []
    for delta, record in records.items():
        sample = round(record.sample_s, 9)
        start, end = (round(k * joint.turn_period / sample) for k in (turn - 1, turn))
        run = simulate(joint, delta, end * sample, sample, STEP)
        settled = record.v[record.t >= record.turn_period_s - 1e-9]
        errors.append((run.v[start:end] - record.v[start:end]) / settled.std())
    return errors


def identify_joint(records: Records, start: Joint) -> Identification:
    """Fit the ratios of a joint, but for its `lead`, to the third turn of clean records by least squares.

    All turns from the second on repeat. Every level weighs the same.

    Parameters
    ----------
    records : mapping of float to Recording
        By backlash [rad].
    start : Joint
        Where the fit starts; no ratio changes its sign.

    Raises
    ------
    ValueError
        See `errors_in_turn`.
    """
    names = [name for name in ratios(start) if name != "lead"]
    values = np.array([ratios(start)[name] for name in names])
    size = np.concatenate(errors_in_turn(start, records, 3)).size

    def scaled(factors: FloatArray) -> Joint:
        return change(start, dict(zip(names, factors.tolist(), strict=True)))

    def residual(factors: FloatArray) -> FloatArray:
        try:
            return np.concatenate(errors_in_turn(scaled(factors), records, 3))
        except ValueError:  # the joint runs away
            return np.full(size, 10.0)

    fit = least_squares(
        residual, np.ones(len(names)), "3-point", bounds=(0.1, 10.0), diff_step=1e-3, x_scale="jac"
    )
    # Covariance of the factors: sigma^2 (J^T J)^-1, sigma^2 = 2 C / (n - 11).
    inverse = np.linalg.inv(fit.jac.T @ fit.jac)
    sd = np.sqrt(np.diag(inverse))
    degrees = size - len(names)
    half = stdtrit(degrees, 0.975) * np.sqrt(2 * fit.cost / degrees) * sd
    ends = np.sort(values * [fit.x - half, fit.x + half], axis=0)
    intervals = dict(zip(names, ends.T.tolist(), strict=True))
    correlation = DataFrame(inverse / np.outer(sd, sd), index=names, columns=names)
    return Identification(scaled(fit.x), intervals, correlation, np.sqrt(2 * fit.cost / size))


def identify_lead(records: Records, joint: Joint, leads: Iterable[float]) -> float:
    """Choose how long before the records the joint started: its first turn shows it; the worst record decides."""

    def worst_first_turn(lead: float) -> float:
        errors = errors_in_turn(joint._replace(lead=lead), records, 1)
        return max(float(np.mean(error**2)) for error in errors)

    return min(leads, key=worst_first_turn)


def reidentify_joint() -> dict[str, object]:
    """Identify the joint from the authors' records and `ROUGH_RATIOS`: the content of ``data/joint.json``."""
    records = load_clean_records(FIT_LEVELS)
    fit = identify_joint(records, from_ratios(ROUGH_RATIOS))
    # Of up to 160 periods of the drive.
    lead = identify_lead(records, fit.joint, (fit.joint.period * np.arange(161)).round(9).tolist())
    values = ratios(fit.joint._replace(lead=lead))
    return {
        "ratios": {name: float(f"{value:.7g}") for name, value in values.items()},
        "interval_95": {
            name: [float(f"{end:.4g}") for end in ends] for name, ends in fit.interval_95.items()
        },
        "nrmse": float(f"{fit.nrmse:.4g}"),  # of the fitted turns
    }
