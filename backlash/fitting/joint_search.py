"""Where the joint that made a log is looked for, so that no local minimum is taken for it."""

import hashlib
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from backlash.fitting.harmonics import FASTEST_HZ, TurnHarmonics
from backlash.fitting.joint_posterior import (
    LEAST_BACKLASH,
    LOW_PASS_INDEX,
    MEAN,
    SMOOTHING_INDEX,
    Measurement,
    Problem,
    rows_of,
)
from backlash.fitting.turns import Movement, simulate_turns
from replication.arrays import FloatArray
from replication.compiling import cache_folder, processor
from replication.files import write_bytes

# What bounds the search; chi squared is the sum of squares of the whitened residuals.
# Joints among which the fit looks for where to start: how many, their backlashes [1e-4 rad], evenly
# in the logarithm, and the SD of the logarithms of the ratios that a log tells most of; the other
# ratios wait until the last steps.
_LIBRARY_SIZE = 1200
_LIBRARY_BACKLASH = (0.8, 48.0)
_LIBRARY_FRICTION = 0.06
_LIBRARY_RATIOS = 5
_LIBRARY_RATIO_SD = 0.2
_SEARCHED = 3 + _LIBRARY_RATIOS  # unknowns free in the first steps
# Starts, those tried where the first ones end in an improbable residual, and how far apart they are
# in the logarithm of the backlash.
_STARTS = 5
_MORE_STARTS = 4
_START_APART = 0.2
_FIRST_STEPS = 5
_LAST_STEPS = 40
_FAR_CHI2 = 60.0  # a start that is worse by more than this after its first steps is left
# Of chi squared; a smaller step is the last: a tenth of an SD along any direction.
_LEAST_FALL = 0.01


@dataclass(frozen=True, eq=False)
class Peak:
    """A maximum of the posterior: `evidence` is a logarithm, `differencing` says what the drive does."""

    z: FloatArray
    covariance: FloatArray
    residual: FloatArray
    evidence: float
    converged: bool
    differencing: bool


class Found(NamedTuple):
    """Where a search ended: unknowns, chi squared, and whether in a minimum."""

    z: FloatArray
    chi2: float
    converged: bool


_chi2 = attrgetter("chi2")


def find_peak(
    problem: Problem, z: FloatArray, measurement: Measurement, chi2: float = np.inf
) -> Peak:
    """Maximum of the posterior near `z` for a speed measured in a way.

    Without evidence, and not looked for to the end, where a few steps leave it far above `chi2`.
    """
    covariance = _covariance(problem.slopes(z)[1])
    shift = (measurement.smoothing - z[SMOOTHING_INDEX]) / covariance[
        SMOOTHING_INDEX, SMOOTHING_INDEX
    ]
    start = z + shift * covariance[:, SMOOTHING_INDEX]
    start[0] = max(start[0], 0.5 * z[0], LEAST_BACKLASH)
    problem.measured_as(measurement)
    limit = chi2 + _FAR_CHI2
    found = _search(problem, start, _FIRST_STEPS)
    if found.chi2 < limit and not found.converged:
        found = _search(problem, found.z)
    residual, slopes = problem.slopes(found.z)
    normal = slopes @ slopes.T
    if not (np.isfinite(normal).all() and found.chi2 < limit):
        return Peak(start, covariance, residual, -np.inf, False, problem.differencing)
    widths = np.log([measurement.smoothing_sd, measurement.low_pass_sd]).sum()
    evidence = -0.5 * found.chi2 - 0.5 * np.linalg.slogdet(normal)[1] - widths
    return Peak(
        found.z,
        _covariance(slopes),
        residual,
        float(evidence),
        found.converged,
        problem.differencing,
    )


def find_joint(problem: Problem, harmonics: TurnHarmonics) -> tuple[FloatArray, bool]:
    """Unknowns of the joint that most probably made a record, and whether the search ended in a minimum."""
    starts = _choose_starts(harmonics, problem.movement)
    found = _search_best(problem, starts[:_STARTS])
    if problem.is_improbable(found.chi2) and len(starts) > _STARTS:
        found = min(found, _search_best(problem, starts[_STARTS:]), key=_chi2)
    return found.z, found.converged


def _covariance(slopes: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(slopes @ slopes.T), dtype=float)


def _search(
    problem: Problem, z: FloatArray, steps: int = _LAST_STEPS, free: int = MEAN.size
) -> Found:
    """Levenberg-Marquardt of the first `free` unknowns.

    Unlike SciPy's, it takes no step into a joint that runs away.
    """
    damping, chi2 = 1e-2, np.inf
    for _ in range(steps):
        residual, slopes = problem.slopes(z, free)
        if not np.isfinite(slopes).all():
            return Found(z, np.inf, False)
        chi2 = float(residual @ residual)
        normal, gradient = slopes @ slopes.T, slopes @ residual
        for _ in range(8):
            step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
            step *= min(1.0, 0.5 / np.abs(step[1:SMOOTHING_INDEX]).max())
            trial = z + step
            trial[0] = max(trial[0], 0.3 * z[0], LEAST_BACKLASH)
            trial[LOW_PASS_INDEX] = max(trial[LOW_PASS_INDEX], 0.0)
            tried_residual = problem.residual(trial, free)
            tried = float(tried_residual @ tried_residual)
            if tried < chi2:
                break
            damping *= 5
        else:
            return Found(z, chi2, tried - chi2 < 0.01 * max(chi2, 1.0))
        fallen = chi2 - tried
        z, chi2 = trial, tried
        damping *= 0.2
        if fallen < _LEAST_FALL * max(1.0, chi2 / residual.size):
            return Found(z, chi2, True)
    return Found(z, chi2, False)


def _search_best(problem: Problem, starts: list[FloatArray]) -> Found:
    """Lowest minimum: a few steps from every start, and from the best two of different backlash to the end."""
    first, *rest = sorted(
        (_search(problem, start, _FIRST_STEPS, _SEARCHED) for start in starts), key=_chi2
    )
    limit = first.chi2 + _FAR_CHI2
    others = [
        other.z
        for other in rest
        if other.chi2 < limit and abs(np.log(other.z[0] / first.z[0])) > 0.03
    ]
    return min((_search(problem, z) for z in [first.z, *others[:1]]), key=_chi2)


@lru_cache(maxsize=8)
def _draw_library(movement: Movement) -> tuple[FloatArray, NDArray[np.complex128]]:
    """Unknowns to start from, and their turns' spectra."""
    rng, size = np.random.default_rng(1), _LIBRARY_SIZE
    z = np.tile(MEAN, (size, 1))
    low, high = np.log(_LIBRARY_BACKLASH)
    z[:, 0] = np.exp(rng.uniform(low, high, size))
    z[:, 2] = _LIBRARY_FRICTION * np.abs(rng.standard_normal(size))
    z[:, 3:_SEARCHED] = _LIBRARY_RATIO_SD * rng.standard_normal((size, _LIBRARY_RATIOS))
    folder = cache_folder()
    if folder is None:
        return z, _spectra(z, movement)
    # It takes a second, so it is kept beside the code that made it; the last bits are the processor's.
    told = hashlib.sha256(repr((movement, processor())).encode()).hexdigest()[:16]
    file = folder / f"turns-{told}.npy"
    with suppress(OSError, ValueError, EOFError):  # there is none, or a broken one
        return z, np.load(file, allow_pickle=False)
    spectra, content = _spectra(z, movement), BytesIO()
    np.save(content, spectra)
    with suppress(OSError):  # a full disk
        write_bytes(file, content.getvalue())
    return z, spectra


def _spectra(z: FloatArray, movement: Movement) -> NDArray[np.complex128]:
    """Spectra of simulated turns."""
    turns = simulate_turns(rows_of(z), movement)
    highest = int(FASTEST_HZ * movement.turn_period_s) + 2
    return np.fft.rfft(turns, axis=1)[:, :highest] / turns.shape[1]


def _choose_starts(harmonics: TurnHarmonics, movement: Movement) -> list[FloatArray]:
    """Best starts of different backlash: the library's turns at their best phase."""
    rounded = Movement(float(f"{movement.gear_ratio:.3g}"), float(f"{movement.turn_period_s:.3g}"))
    z, spectra = _draw_library(rounded)
    phases = max(512, next_fast_len(2 * int(harmonics.order[-1]) + 2))
    spectra, weight = spectra[:, harmonics.order], harmonics.sd**-2
    product = np.zeros((len(z), phases), dtype=complex)
    product[:, harmonics.order] = np.conj(spectra) * harmonics.coefficient * weight
    overlap = np.fft.ifft(product, axis=1).real * phases  # at the phase -2 pi k / phases
    best = overlap.argmax(axis=1)
    misfit = (np.abs(spectra) ** 2 * weight).sum(axis=1) - 2 * overlap[np.arange(len(z)), best]
    starts: list[FloatArray] = []
    for k in np.argsort(misfit):
        if np.isfinite(misfit[k]) and all(
            abs(np.log(z[k, 0] / other[0])) > _START_APART for other in starts
        ):
            starts.append(z[k].copy())
            starts[-1][1] = -2 * np.pi * best[k] / phases
        if len(starts) == _STARTS + _MORE_STARTS:
            break
    return starts
