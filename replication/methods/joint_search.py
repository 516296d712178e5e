"""Where the joint that made a log is looked for, so that no local minimum is taken for it."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from replication.methods.harmonics import TurnHarmonics
from replication.methods.joint_posterior import LEAST_BACKLASH, MEAN, SIZE, SMOOTHING, Problem, rows_of
from replication.simulator.turns import Movement, settled_turns

FloatArray = NDArray[np.float64]

# Joints among which the fit looks for where to start: backlash evenly in its logarithm [1e-4 rad], friction, and SD of
# the five ratios that a log tells most of.
_LIBRARY, _LIBRARY_BACKLASH, _LIBRARY_FRICTION, _LIBRARY_SPREAD = 1200, (0.8, 48.0), 0.06, 0.2
# How many of them, and how many more where these end in a residual that is improbable.
_STARTS, _MORE_STARTS, _SHORT, _LONG = 5, 4, 5, 40
# Nothing but another joint explains a residual that is as large as this, in squares a harmonic (2 for noise alone).
_HOPELESS = 12.0
_TOLD = 5
# A step that lowers chi squared by less than this is the last: a tenth of an SD along any direction.
_ENOUGH = 0.01
_NEAR_COST = 60.0  # a start that is worse by more than this (in chi squared) after its first steps is left
# Where a better minimum is looked for, in SDs of the backlash along the posterior's longest axis.
_BESIDE, _FEW, _ROUNDS = (-4.0, -2.0, 2.0, 4.0), 3, 2
# A place that is worse by less than this after a few steps, and still this many SDs away, gets a few more.
_HOPEFUL, _ELSEWHERE = 25.0, 1.0
# Harmonics that may be left out.
_MOST_DROPPED = 3


@dataclass(frozen=True, eq=False)
class Peak:
    """A maximum of the posterior: `evidence` is a logarithm, `differencing` says what the drive does."""

    z: FloatArray
    covariance: FloatArray
    residual: FloatArray
    evidence: float
    converged: bool
    differencing: bool


def find_peak(problem: Problem, z: FloatArray, smoothing: tuple[float, float], cost: float = np.inf) -> Peak:
    """Maximum of the posterior near `z` under another prior of the smoothing, mean and SD.

    Without evidence, and not looked for to the end, where a few steps leave it far above `cost`.
    """
    _, slopes = problem.slopes(z, SIZE)
    covariance = np.linalg.inv(slopes @ slopes.T)
    shift = (smoothing[0] - z[SMOOTHING]) / covariance[SMOOTHING, SMOOTHING]
    start = z + shift * covariance[:, SMOOTHING]
    start[0] = max(start[0], 0.5 * z[0], LEAST_BACKLASH)
    problem.measured_as(smoothing)
    z, there, converged = _search(problem, start, _SHORT)
    if there < cost + _NEAR_COST and not converged:
        z, there, converged = _search(problem, z, _LONG)
    residual, slopes = problem.slopes(z)
    normal = slopes @ slopes.T
    if not (np.isfinite(normal).all() and there < cost + _NEAR_COST):
        return Peak(start, covariance, residual, -np.inf, False, problem.differencing)
    evidence = -0.5 * there - 0.5 * np.linalg.slogdet(normal)[1] - np.log(smoothing[1])
    return Peak(z, np.linalg.inv(normal), residual, float(evidence), converged, problem.differencing)


def find_joint(problem: Problem, harmonics: TurnHarmonics) -> tuple[FloatArray, bool]:
    """Unknowns of the joint that most probably made a record, and whether the search ended in a minimum."""
    starts = _starts(harmonics, problem.movement)
    z, cost, converged = _best(problem, starts[:_STARTS])
    if problem.is_improbable(cost) and len(starts) > _STARTS:
        z, cost, converged = min((z, cost, converged), _best(problem, starts[_STARTS:]), key=lambda found: found[1])
    if cost > _HOPELESS * problem.order.size:
        return z, converged
    z, cost, converged = _explored(problem, z, cost, converged)
    unshaken = problem.target
    if problem.shake(z, harmonics.lines):
        tried = _search(problem, z, _LONG)
        # What was taken for a belt may be one's image by the turn's own frequency: then the joint fits worse.
        if tried[1] < cost:
            z, cost, converged = tried
        else:
            problem.target = unshaken
    if problem.find_error(z):
        z, cost, converged = _search(problem, z, _LONG)
    for _ in range(_MOST_DROPPED):
        if not problem.drop_outlier(z):
            break
        z, cost, converged = _search(problem, z, _LONG)
    return z, converged


def _search(problem: Problem, z: FloatArray, iterations: int, free: int = SIZE) -> tuple[FloatArray, float, bool]:
    """Levenberg-Marquardt; unstable joints have no finite residual, and a step into one is not taken."""
    damping = 1e-2
    residual, slopes = problem.slopes(z, free)
    cost = residual @ residual
    if not np.isfinite(slopes).all():
        return z, np.inf, False
    for _ in range(iterations):
        normal, gradient = slopes @ slopes.T, slopes @ residual
        for _ in range(8):
            step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
            step *= min(1.0, 0.5 / np.abs(step[1:SMOOTHING]).max())
            trial = z + step
            trial[0] = max(trial[0], 0.3 * z[0], LEAST_BACKLASH)
            found = problem.slopes(trial, free)
            there = found[0] @ found[0]
            if there < cost and np.isfinite(found[1]).all():
                break
            damping *= 5
        else:
            return z, cost, there - cost < 0.01 * max(cost, 1.0)
        fallen, z, cost, damping = cost - there, trial, there, damping * 0.2
        residual, slopes = found
        if fallen < _ENOUGH * max(1.0, cost / residual.size):
            return z, cost, True
    return z, cost, False


def _best(problem: Problem, starts: list[FloatArray]) -> tuple[FloatArray, float, bool]:
    """Lowest minimum: a few steps from every start, and from the best two to the end."""
    tried = sorted((_search(problem, start, _SHORT, 3 + _TOLD) for start in starts), key=lambda found: found[1])
    first = _search(problem, tried[0][0], _LONG)
    others = [z for z, cost, _ in tried[1:] if cost < tried[0][1] + _NEAR_COST and _apart(z, tried[0][0])]
    second = [_search(problem, z, _LONG) for z in others[:1]]
    return min([first, *second], key=lambda found: found[1])


def _explored(problem: Problem, z: FloatArray, cost: float, converged: bool) -> tuple[FloatArray, float, bool]:
    """Look for a lower minimum beside one: the teeth bounce once more or less there, and the misfit has a kink."""
    for _ in range(_ROUNDS):
        _, slopes = problem.slopes(z, SIZE)
        covariance = np.linalg.inv(slopes @ slopes.T)
        along = covariance[:, 0] / np.sqrt(covariance[0, 0])
        best = (z, cost, converged)
        for deviations in _BESIDE:
            trial = z + deviations * along
            trial[0] = max(trial[0], LEAST_BACKLASH)
            tried = _search(problem, trial, _FEW, 3 + _TOLD)
            if tried[1] < best[1] + _HOPEFUL and abs(tried[0][0] - z[0]) > _ELSEWHERE * np.sqrt(covariance[0, 0]):
                tried = _search(problem, tried[0], _FEW)
            if tried[1] < best[1] - 0.1:
                best = tried
        if best[1] >= cost - 0.1:
            break
        z, cost, converged = _search(problem, best[0], _LONG)
    return z, cost, converged


def _apart(a: FloatArray, b: FloatArray) -> bool:
    return abs(np.log(a[0] / b[0])) > 0.03


@lru_cache(maxsize=8)
def _library(movement: Movement) -> tuple[FloatArray, FloatArray]:
    """Unknowns to start from, and their turns' spectra."""
    rng = np.random.default_rng(1)
    z = np.tile(MEAN, (_LIBRARY, 1))
    z[:, 0] = np.exp(rng.uniform(*np.log(_LIBRARY_BACKLASH), _LIBRARY))
    z[:, 2] = _LIBRARY_FRICTION * np.abs(rng.standard_normal(_LIBRARY))
    z[:, 3 : 3 + _TOLD] = _LIBRARY_SPREAD * rng.standard_normal((_LIBRARY, _TOLD))
    turns = settled_turns(rows_of(z), movement)
    return z, np.fft.rfft(turns, axis=1) / turns.shape[1]


def _starts(harmonics: TurnHarmonics, movement: Movement) -> list[FloatArray]:
    """Best starts of different backlash: the library's turns at their best phase."""
    rounded = Movement(float(f"{movement.gear_ratio:.3g}"), float(f"{movement.turn_period_s:.3g}"))
    z, spectra = _library(rounded)
    spectra = spectra[:, harmonics.order]
    phases = 512
    product = np.zeros((len(z), phases), dtype=complex)
    weight = harmonics.sd**-2
    product[:, harmonics.order] = np.conj(spectra) * harmonics.coefficient * weight
    overlap = np.fft.ifft(product, axis=1).real * phases  # at the phase -2 pi k / phases
    # The sign convention of ifft: sum over orders of product * exp(+2 pi i k m / phases).
    best = overlap.argmax(axis=1)
    misfit = (np.abs(spectra) ** 2 * weight).sum(axis=1) - 2 * overlap[np.arange(len(z)), best]
    order, starts = np.argsort(misfit), []
    for k in order:
        if np.isfinite(misfit[k]) and all(abs(np.log(z[k, 0] / other[0])) > 0.2 for other in starts):
            start = z[k].copy()
            start[1] = -2 * np.pi * best[k] / phases
            starts.append(start)
        if len(starts) == _STARTS + _MORE_STARTS:
            break
    return starts
