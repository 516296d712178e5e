"""The backlash of a joint that nobody calibrated: the whole simulated joint fitted to one log.

A maximum a posteriori fit of the joint of notebook 9 to the harmonics of a record's mean turn. The
posterior is taken as normal around its maximum (Laplace's approximation), mixed over how the speed
was measured, and widened by what the residual says.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, chdtri, softmax

from backlash.fitting import joint_posterior
from backlash.fitting.harmonics import MODEL_ERROR, RING_HZ, TurnHarmonics, turn_harmonics
from backlash.fitting.joint_posterior import (
    LOW_PASS_INDEX,
    PHASE,
    SMOOTHING_INDEX,
    UNIT_RAD,
    Problem,
    rows_of,
)
from backlash.fitting.joint_search import Peak, find_joint, find_peak
from backlash.fitting.turns import Movement, simulate_turns
from backlash.fitting.waveform import delayed, low_passed
from replication.arrays import FloatArray
from replication.records import Recording
from replication.simulator.parameters import TURN

# Noise in the ring's band over that above it, beyond which there is no answer.
MOST_RING_NOISE = 1.5
# Noise alone leaves a residual as large as that of a joint of another kind in one log of so many.
# Intervals are widened long before, so that a right joint with small causes of its own still gets
# an answer.
_IMPOSSIBLE_RESIDUAL = 1e-8
# A record with hardly any noise shows the model's own error, up to this many times
# `harmonics.MODEL_ERROR`: the identified joint itself leaves 1 to 3 % of the authors' noise-free
# records.
MOST_MODEL_ERROR = 3.0
# A joint, or a drive's inner workings, that stray from what is known of them as this share of
# joints of the paper's kind do are of another kind: one right joint in a hundred gets no answer for
# it.
_IMPROBABLE_JOINT = 0.01
_IMPROBABLE_DRIVE = 1e-3
_JOINT = slice(2, SMOOTHING_INDEX)
_DRIVE = slice(SMOOTHING_INDEX - joint_posterior.DRIVE_UNKNOWNS, SMOOTHING_INDEX)
# Directions of which a log takes less than this from the prior's variance say nothing.
_LEAST_INFORMATION = 0.05
# What is left over beyond the residual that noise alone exceeds in one log of ten may lie along the
# backlash too.
_LARGE_RESIDUAL = 0.1
NORMAL_95 = 1.96
# Low-passes that the noise is compared with, and what that may count: the drive's loops colour
# noise too.
_TIME_CONSTANTS_MS = (0.5, 0.8, 1.2, 1.8, 2.7, 4.0)
_MOST_LOG_ODDS = 5.0
# Log-odds of a refusal: white noise says as much in one log of a thousand. A filter takes more of
# the impacts than the joint's other unknowns leave it, and the backlash comes out too large.
_REFUSED_LOG_ODDS = 4.0
_LOW_PASSED = (
    "the speed was low-passed, or something else moves (its noise rolls off): log it unfiltered, nothing else moving, "
    "or calibrate on such logs"
)


@dataclass(frozen=True, eq=False)
class SelfFit:
    """A joint fitted to a record, and what that says of its backlash."""

    delta_rad: float
    interval_rad: tuple[float, float]  # 95 %
    sd_rad: float  # of the posterior, before it was widened for what the residual says
    friction: float  # of the load over m g r
    unknowns: FloatArray  # the posterior's maximum, in the order of `joint_posterior.NAMES`
    covariance: FloatArray  # about it
    misfit: float  # mean square of the whitened residual, 1 if right; of a quiet record, beyond the model's error
    ring_noise_ratio: float  # see `harmonics.TurnHarmonics`
    # Fitted speed less its mean, at even phases from the record's first sample.
    turn_rps: FloatArray
    refusal_reason: str = ""  # why this is no answer; empty if it is one


def fit_joint(recording: Recording) -> SelfFit:
    """Find the backlash, and the joint besides, from one log; ValueError where it is too short or too coarse."""
    problem, harmonics = pose_problem(recording)
    z, converged = find_joint(problem, harmonics)
    peak, covariance = mix_peaks(_measurements(problem, harmonics, z))
    fit = _goodness_of(peak, harmonics)
    refusal = "the search for the joint does not end"
    delta, sd = (float(UNIT_RAD * value) for value in (peak.z[0], np.sqrt(covariance[0, 0])))
    half = NORMAL_95 * widening_factor(fit.chi2, fit.freedom) * sd
    if (
        harmonics.is_quiet
    ):  # the speed's part from backlash grows with it; so does the model's error
        half = float(np.hypot(half, MOST_MODEL_ERROR * MODEL_ERROR * delta))
    if converged and peak.converged and np.isfinite(fit.misfit) and np.isfinite(sd):
        odds = _low_pass_log_odds(harmonics, problem.movement.turn_period_s, RING_HZ[1])
        refusal = _refusal_reason(fit, peak, harmonics.ring_noise_ratio, odds)
    return SelfFit(
        delta_rad=delta,
        interval_rad=(max(delta - half, 0.0), delta + half),
        sd_rad=sd,
        friction=float(peak.z[2]),
        unknowns=peak.z,
        covariance=covariance,
        misfit=fit.misfit,
        ring_noise_ratio=harmonics.ring_noise_ratio,
        turn_rps=_turn_of(problem, peak),
        refusal_reason=refusal,
    )


def _measurements(
    problem: Problem, harmonics: TurnHarmonics, z: FloatArray
) -> list[tuple[float, Peak]]:
    """Peaks near a joint for every way in which the speed may have been measured, each with its log-odds."""
    residual, _ = problem.slopes(z)
    chi2 = float(residual @ residual) if np.isfinite(residual).all() else np.inf
    measured = []
    for name, measurement in joint_posterior.MEASURED_AS.items():
        peak = find_peak(problem, z, measurement, chi2)
        odds = np.log(measurement.probability)
        if name == "filtered":
            odds += _low_pass_log_odds(harmonics, problem.movement.turn_period_s)
        measured.append((odds, peak))
    return measured


def weak_turn(recording: Recording, delta_rad: float) -> FloatArray:
    """Settled turn [rps] of a joint like the paper's in a record's movement, half as loud as the paper's joint.

    Joints drawn around it, drives a third slower among them, are louder than this.
    """
    z = joint_posterior.MEAN.copy()
    z[0] = delta_rad / UNIT_RAD
    turn = simulate_turns(rows_of(z[None]), _movement(recording))[0]
    return 0.5 * turn[: turn.size // 2 * 2]


def _movement(recording: Recording) -> Movement:
    return Movement(
        float(recording.commanded_speed_rps * recording.turn_period_s), recording.turn_period_s
    )


def pose_problem(recording: Recording) -> tuple[Problem, TurnHarmonics]:
    """What a log asks of a joint, and the harmonics that it is made of."""
    movement, harmonics = _movement(recording), turn_harmonics(recording)
    if harmonics.order.size < joint_posterior.SIZE:
        raise ValueError(
            f"{recording.source}: sampled too coarsely, {harmonics.order.size} harmonics of the turn"
        )
    return Problem(harmonics, movement, recording.sample_s), harmonics


def mix_peaks(found: Sequence[tuple[float, Peak]]) -> tuple[Peak, FloatArray]:
    """Most probable peak, moved to the mean of all, and the covariance about it; each has its prior log-odds."""
    finite = [(odds, peak) for odds, peak in found if np.isfinite(peak.evidence)]
    if not finite:
        return found[0][1], found[0][1].covariance
    share = softmax([odds + peak.evidence for odds, peak in finite])
    weighted = [(part, peak) for part, (_, peak) in zip(share, finite, strict=True)]
    mean = sum(part * peak.z for part, peak in weighted)
    covariance = sum(
        part * (peak.covariance + np.outer(peak.z - mean, peak.z - mean)) for part, peak in weighted
    )
    return replace(weighted[int(share.argmax())][1], z=mean), covariance


class _Goodness(NamedTuple):
    """How well a joint fits a record: chi squared, its degrees of freedom, and the model's own error over noise."""

    chi2: float
    freedom: int
    model_error: float

    @property
    def misfit(self) -> float:
        return self.chi2 / self.freedom / self.model_error


def _goodness_of(peak: Peak, harmonics: TurnHarmonics) -> _Goodness:
    chi2 = float(peak.residual @ peak.residual)
    freedom = peak.residual.size - joint_posterior.SIZE
    scatter = max(chi2 / freedom, 1.0)
    return _Goodness(
        chi2, freedom, float(min(scatter, MOST_MODEL_ERROR**2)) if harmonics.is_quiet else 1.0
    )


def _turn_of(problem: Problem, peak: Peak) -> FloatArray:
    """Fitted speed less its mean [rps], at even phases from the record's first sample."""
    problem.differencing = peak.differencing
    turn = problem.turns(peak.z[None])[0]
    low_pass = (
        max(float(peak.z[LOW_PASS_INDEX]), 0.0) * (1e-3 / problem.movement.turn_period_s) ** 2
    )
    return low_passed(delayed(turn - turn.mean(), -peak.z[PHASE] / TURN), low_pass)


def widening_factor(chi2: float, freedom: int) -> float:
    """By how much an interval is wider for a residual that noise alone hardly leaves; without a jump."""
    return float(np.sqrt(1 + max(chi2 - float(chdtri(freedom, _LARGE_RESIDUAL)), 0.0)))


def _refusal_reason(fit: _Goodness, peak: Peak, ring_noise_ratio: float, low_pass: float) -> str:
    """Why a fit that has ended is no answer; empty if it is one. `low_pass` is the log-odds of one."""
    if low_pass >= _REFUSED_LOG_ODDS:
        return _LOW_PASSED
    if ring_noise_ratio > MOST_RING_NOISE:
        return (
            f"turns do not repeat themselves (noise in the ring's band {ring_noise_ratio:.1f} times that above it): "
            "the drive hardly damps, something else moves, or the speed was low-passed"
        )
    residual_p = float(chdtrc(fit.freedom, fit.chi2 / fit.model_error))
    if residual_p < _IMPOSSIBLE_RESIDUAL:
        return f"no joint of the paper's kind makes this record (a residual like its one: p = {residual_p:.0e})"
    scatter = max(fit.chi2 / fit.freedom, 1.0)
    if (p := _prior_p(peak, scatter, _DRIVE)) < _IMPROBABLE_DRIVE:
        return f"the drive is not of the paper's kind (its inner workings stray from what is known: p = {p:.0e})"
    if (p := _prior_p(peak, scatter, _JOINT)) < _IMPROBABLE_JOINT:
        return f"the joint is not of the paper's kind (stiffness, inertias, gains stray from it: p = {p:.0e})"
    return ""


def _low_pass_log_odds(
    harmonics: TurnHarmonics, turn_period_s: float, above_hz: float = 0.0
) -> float:
    """How much the noise speaks for a low-pass: its log-likelihood above that of white noise, up to a limit.

    Above the ring's band no joint colours it.
    """
    hz = harmonics.order / turn_period_s
    power, hz = harmonics.sd[hz > above_hz] ** 2, hz[hz > above_hz]
    if harmonics.is_quiet or not hz.size:
        return 0.0
    shapes = 1 / (1 + (1e-3 * TURN * hz * np.array(_TIME_CONSTANTS_MS)[:, None]) ** 2)
    level = (power / shapes).mean(axis=1)
    gain = (harmonics.turns - 1) * np.log(power.mean() / (level[:, None] * shapes)).sum(axis=1)
    return float(np.clip(gain.max(), 0.0, _MOST_LOG_ODDS))


def _prior_p(peak: Peak, scatter: float, known: slice) -> float:
    """Probability that unknowns, as the log tells them, stray so far from what was known of them."""
    if not (np.isfinite(peak.covariance).all() and np.isfinite(scatter)):
        return 0.0
    prior_sd = joint_posterior.SD[known]
    # In units of the prior's SD, the posterior's centre has the variance that the log takes from
    # the prior's.
    centre, relative = (
        peak.z[known] / prior_sd,
        peak.covariance[known, known] / np.outer(prior_sd, prior_sd),
    )
    information, axes = np.linalg.eigh(np.eye(prior_sd.size) - relative)
    seen = information > _LEAST_INFORMATION
    square = float(((axes.T @ centre)[seen] ** 2 / information[seen]).sum()) / scatter
    return float(chdtrc(max(int(seen.sum()), 1), square))
