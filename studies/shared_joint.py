"""Several logs of one joint: what belongs to the joint is shared, the backlash is each log's own.

Each log's posterior is normal; its prior taken out, it says what that log alone tells of the joint.
What all logs tell of the joint then corrects each log's backlash. The joint's ratios may drift a
little.
"""

from collections.abc import Sequence

import numpy as np

from backlash.fitting.joint_posterior import MEAN, RATIO_PRIOR, SD, UNIT_RAD
from backlash.fitting.self_calibration import NORMAL_95, SelfFit
from replication.arrays import FloatArray

# What belongs to the joint and its drive: friction changes with temperature, so it stays each log's
# own; how the speed is measured, each log knows well enough.
_SHARED = np.arange(3, 3 + len(RATIO_PRIOR))
# Relative SD by which a ratio strays from log to log: other loads of the drive, temperature,
# months.
_DRIFT = 0.005


def share_joint(fits: Sequence[SelfFit]) -> list[tuple[float, tuple[float, float]]]:
    """Backlash and 95 % interval [rad] of each log of one joint in one movement, the joint told by all of them."""
    prior = np.diag(SD[_SHARED] ** -2.0)
    drift = _DRIFT**2 * np.eye(_SHARED.size)
    own = [_own_information(fit, prior, drift) for fit in fits]
    precision = prior + sum(weight for weight, _ in own)
    total = prior @ MEAN[_SHARED] + sum(pull for _, pull in own)
    common = np.asarray(np.linalg.solve(precision, total), dtype=float)
    spread = np.asarray(np.linalg.inv(precision) + drift, dtype=float)
    return [_corrected(fit, common, spread) for fit in fits]


def _own_information(
    fit: SelfFit, prior: FloatArray, drift: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Precision with which one log alone tells the common joint, and that times what it says."""
    here = np.linalg.inv(fit.covariance[np.ix_(_SHARED, _SHARED)])
    alone = here - prior
    pull = here @ fit.unknowns[_SHARED] - prior @ MEAN[_SHARED]
    # Drift comes on top of what the log does not know: (alone^-1 + drift)^-1 without inverting
    # `alone`.
    damp = np.linalg.inv(np.eye(len(_SHARED)) + alone @ drift)
    return damp @ alone, damp @ pull


def _corrected(
    fit: SelfFit, common: FloatArray, spread: FloatArray
) -> tuple[float, tuple[float, float]]:
    """Backlash of a log whose own posterior of the joint is replaced by that of all logs."""
    here = fit.covariance[np.ix_(_SHARED, _SHARED)]
    lean = np.linalg.solve(here, fit.covariance[_SHARED, 0])
    delta = fit.unknowns[0] + lean @ (common - fit.unknowns[_SHARED])
    variance = fit.covariance[0, 0] - lean @ (here - spread) @ lean
    # An interval that was widened for its residual stays wider by the same factor.
    widened = (fit.interval_rad[1] - fit.delta_rad) / (NORMAL_95 * fit.sd_rad)
    half = NORMAL_95 * UNIT_RAD * float(np.sqrt(min(variance, fit.covariance[0, 0]))) * widened
    delta_rad = float(delta * UNIT_RAD)
    return delta_rad, (max(delta_rad - half, 0.0), delta_rad + half)
