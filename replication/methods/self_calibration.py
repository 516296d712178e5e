"""The backlash of a joint that nobody calibrated: the whole simulated joint fitted to one log.

A maximum a posteriori fit of the joint of notebook 3 to the harmonics of a record's mean turn. The backlash has no
prior; what else is not known has the wide ones below. The posterior is taken as normal around its maximum (Laplace's
approximation) and widened by what the residual says; where the residual says that no such joint made the record,
there is no answer.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from replication.datasets import Recording
from replication.methods.harmonics import TurnHarmonics, turn_harmonics
from replication.simulator.checks import closed_loop_matrix
from replication.simulator.parameters import identified_joint, joint_from_ratios
from replication.simulator.turns import COLUMNS, Movement, settled_turns

FloatArray = NDArray[np.float64]

# Relative SD (log-normal) of the prior of each ratio around the identified joint's. A joint of this kind may be
# 30 % stiffer, heavier or more tightly controlled than the paper's. The drive's inner workings, which a log hardly
# tells, are taken as known up to a few percent, or the error of the backlash would double.
RATIO_PRIOR = {
    "stiffness_per_s2": 0.3,
    "gravity_per_s2": 0.3,
    "inertia_ratio": 0.3,
    "speed_gain_per_s": 0.3,
    "integral_gain_per_s2": 0.3,
    "torque_lag_s": 0.03,
    "derivative_gain": 0.02,
    "leaky_gain_per_s2": 0.02,
    "position_gain_per_s": 0.02,
    "leaky_rate_per_s": 0.02,
}
# Friction of the load over m g r.
FRICTION_PRIOR = 0.1
# Smoothing of the measured speed, in units of what differencing over a sampling period does: mean and SD. A drive's
# speed is differenced (1); a simulated one is not (0).
SMOOTHING_PRIOR = (0.85, 0.2)

# A transmission error in step with the turn (a belt, a gear), in 1e-5 rad on the load's side: SD of its two parts.
ERROR_PRIOR = 2.0

_UNIT_RAD, _ERROR_RAD = 1e-4, 1e-5
_RATIOS = slice(3, 3 + len(RATIO_PRIOR))
_SMOOTHING = _RATIOS.stop
_SIZE = _SMOOTHING + 3
_MEAN = np.array([*np.zeros(_SMOOTHING), SMOOTHING_PRIOR[0], 0.0, 0.0])
_SD = np.array([np.inf, np.inf, FRICTION_PRIOR, *RATIO_PRIOR.values(), SMOOTHING_PRIOR[1], ERROR_PRIOR, ERROR_PRIOR])
# Steps of the differences; phase and smoothing have slopes of their own.
_STEP = np.array([0.01, np.nan, 1e-3, *np.full(len(RATIO_PRIOR), 3e-3), np.nan, 0.05, 0.05])

# Joints among which the fit looks for where to start: backlash evenly in its logarithm [1e-4 rad], friction, and SD of
# the five ratios that a log tells most of.
_LIBRARY, _LIBRARY_BACKLASH, _LIBRARY_FRICTION, _LIBRARY_SPREAD = 1200, (0.8, 48.0), 0.06, 0.2
_STARTS, _SHORT, _LONG = 5, 5, 40
_TOLD = 5
_NEAR_COST = 60.0  # a start that is worse by more than this (in chi squared) after its first steps is left
# Where a better minimum is looked for, in SDs of the backlash along the posterior's longest axis.
_BESIDE, _FEW, _ROUNDS = (-4.0, -2.0, 2.0, 4.0), 3, 2
# Transmission errors up to this frequency are looked for; one must be this improbable in noise
# alone, and the residual without it improbable too.
_FASTEST_ERROR_HZ, _CHANCE_OF_ERROR, _SUSPECT = 60.0, 0.01, 0.3
# A harmonic whose residual alone has this improbable a square (times their number) belongs to the machine, not the joint.
_MOST_DROPPED, _OUTLIER = 3, 1e-3
_LEAST_BACKLASH = 0.01


# Beyond these there is no answer: residual (1 for noise alone), and noise in the ring's band over that above it.
MOST_MISFIT, MOST_UNREST = 1.6, 1.5
# Where the residual is improbable (5 %), what is left over may lie along the backlash too: this share of it is taken to.
_IMPROBABLE, _SHARE_ALONG = 0.05, 0.3
_NORMAL_95 = 1.96
_SLOWEST_RING_HZ = 2.0


@dataclass(frozen=True, eq=False)
class SelfFit:
    """A joint fitted to a record, and what that says of its backlash.

    Attributes
    ----------
    delta_rad, interval_rad : float, tuple of float
        Backlash and its 95 % interval [rad].
    sd_rad : float
        Posterior SD of the backlash, before it was widened for what the residual says [rad].
    ring_hz, damping : float
        Slowest oscillation of the joint with its teeth in contact: frequency, and damping ratio.
    friction : float
        Friction of the load over m g r.
    ratios : dict
        What was found of `JointParameters.ratios`.
    smoothing : float
        Of the measured speed, 1 for differencing over a sampling period.
    covariance : array of shape (unknowns, unknowns)
        Posterior covariance in the order of `UNKNOWNS`: backlash [1e-4 rad], phase [rad], friction, logarithms of the
        ratios, smoothing, transmission error [1e-5 rad].
    misfit : float
        Mean square of the whitened residual, 1 for a joint that is right.
    worst_phase : float
        Where in the turn the joint fits worst [turns, from the load hanging down].
    unrest : float
        See `harmonics.TurnHarmonics`.
    turn_rps : array of shape (phases,)
        Fitted speed less its mean over one turn from the record's first sample [rps].
    doubt : str
        Why this is no answer; empty if it is one.
    """

    delta_rad: float
    interval_rad: tuple[float, float]
    sd_rad: float
    ring_hz: float
    damping: float
    friction: float
    ratios: dict[str, float]
    smoothing: float
    covariance: FloatArray
    misfit: float
    worst_phase: float
    unrest: float
    turn_rps: FloatArray
    doubt: str = ""


UNKNOWNS = ("backlash", "phase", "friction", *RATIO_PRIOR, "smoothing", "error_sine", "error_cosine")


@lru_cache(maxsize=1)
def _centre() -> dict[str, float]:
    return identified_joint().ratios


def _rows(z: FloatArray) -> FloatArray:
    """Rows of `settled_turns` for unknowns of shape (joints, unknowns)."""
    ratios = _centre()
    columns = {"delta_rad": np.maximum(z[:, 0], _LEAST_BACKLASH) * _UNIT_RAD, "friction": z[:, 2]}
    for k, name in enumerate(RATIO_PRIOR, start=3):
        columns[name] = ratios[name] * np.exp(z[:, k])
    columns["error_sine_rad"], columns["error_cosine_rad"] = (_ERROR_RAD * z[:, _SMOOTHING + 1 :]).T
    zero = np.zeros(len(z))
    return np.stack([columns.get(name, zero) for name in COLUMNS], axis=1)


class _Problem:
    """Weighted residuals of a record's harmonics and their slopes."""

    def __init__(self, harmonics: TurnHarmonics, movement: Movement, sample_s: float):
        self.movement, self.order, self.sd = movement, harmonics.order, harmonics.sd
        self.target = harmonics.coefficient
        self.fade = -((2 * np.pi * harmonics.order / movement.turn_period_s) ** 2) * sample_s**2 / 24
        self.error_order = 0
        self.evaluations = 0

    def _spectra(self, z: FloatArray, error_order: int) -> NDArray[np.complex128]:
        turns = settled_turns(_rows(z), self.movement, error_order)
        self.evaluations += len(z)
        return np.fft.rfft(turns, axis=1)[:, self.order] / turns.shape[1]

    def _measured(self, z: FloatArray, error_order: int | None = None) -> NDArray[np.complex128]:
        spectra = self._spectra(z, self.error_order if error_order is None else error_order)
        return spectra * np.exp(1j * self.order * z[:, 1:2] + self.fade * z[:, _SMOOTHING : _SMOOTHING + 1])

    def _whitened(self, spectra: NDArray[np.complex128]) -> FloatArray:
        spectra = spectra / self.sd
        return np.concatenate([spectra.real, spectra.imag], axis=-1)

    def residual(self, z: FloatArray) -> FloatArray:
        """Data's and prior's residuals of one set of unknowns."""
        data = self._whitened(self._measured(z[None])[0] - self.target)
        return np.concatenate([data, ((z - _MEAN) / _SD)[2:]])

    def slopes(self, z: FloatArray, free: int) -> tuple[FloatArray, FloatArray]:
        """Residuals, and their derivative by each unknown, shape (unknowns, residuals); 0 from the one `free` on."""
        last = free if self.error_order else min(free, _SMOOTHING)
        moved = [k for k in range(last) if np.isfinite(_STEP[k])]
        batch = np.repeat(z[None], len(moved) + 1, axis=0)
        batch[np.arange(len(moved)), moved] += _STEP[moved]
        measured = self._measured(batch)
        here = measured[-1]
        out = np.zeros((_SIZE, here.size), dtype=complex)
        out[moved] = (measured[:-1] - here) / _STEP[moved][:, None]
        out[1], out[_SMOOTHING] = 1j * self.order * here, self.fade * here
        residual = np.concatenate([self._whitened(here - self.target), ((z - _MEAN) / _SD)[2:]])
        return residual, np.concatenate([self._whitened(out), np.diag(1 / _SD)[:, 2:]], axis=1)

    def find_error(self, z: FloatArray) -> bool:
        """Take up a transmission error in step with the turn if one explains the residual better; say whether."""
        residual, slopes = self.slopes(z, _SIZE)
        if stats.chi2.sf(residual @ residual, residual.size - _SIZE) > _SUSPECT:
            return False
        tried = np.arange(2, int(_FASTEST_ERROR_HZ * self.movement.turn_period_s) + 1)
        gain = np.zeros(tried.size)
        for k, order in enumerate(tried):
            batch = np.repeat(z[None], 2, axis=0)
            batch[[0, 1], [_SMOOTHING + 1, _SMOOTHING + 2]] += _STEP[-1]
            data = slice(0, 2 * self.order.size)
            moved = self._whitened(self._measured(batch, int(order)) - self.target)
            columns = np.zeros((2, residual.size))
            columns[:, data] = (moved - residual[data]) / _STEP[-1]
            onto = np.linalg.solve(slopes @ slopes.T, slopes @ columns.T)
            columns -= onto.T @ slopes
            along = columns @ residual
            gain[k] = along @ np.linalg.solve(columns @ columns.T + np.eye(2) / ERROR_PRIOR**2, along)
        scale = max(1.0, float(residual @ residual) / residual.size)
        if self.error_order or tried.size * np.exp(-gain.max() / scale / 2) > _CHANCE_OF_ERROR:
            return False
        self.error_order = int(tried[gain.argmax()])
        return True

    def drop_outlier(self, z: FloatArray) -> bool:
        """Leave out the harmonic that fits worst, if noise can't explain it; say whether there was one."""
        data = self.residual(z)[: 2 * self.order.size].reshape(2, -1)
        square = (data**2).sum(axis=0) / 2
        square /= max(1.0, float(np.median(square)) / np.log(2))
        worst = int(square.argmax())
        if self.order.size * np.exp(-square[worst]) > _OUTLIER:
            return False
        kept = np.arange(self.order.size) != worst
        self.order, self.sd, self.target, self.fade = (a[kept] for a in (self.order, self.sd, self.target, self.fade))
        return True


def _search(problem: _Problem, z: FloatArray, iterations: int, free: int = _SIZE) -> tuple[FloatArray, float, bool]:
    """Levenberg-Marquardt; unstable joints have no finite residual, and a step into one is not taken."""
    damping, converged = 1e-2, False
    for _ in range(iterations):
        residual, slopes = problem.slopes(z, free)
        cost = residual @ residual
        if not np.isfinite(slopes).all():
            return z, np.inf, False
        normal, gradient = slopes @ slopes.T, slopes @ residual
        for _ in range(8):
            step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
            step *= min(1.0, 0.5 / np.abs(step[1:_SMOOTHING]).max())
            trial = z + step
            trial[0] = max(trial[0], 0.3 * z[0], _LEAST_BACKLASH)
            found = problem.residual(trial)
            there = found @ found
            if there < cost:
                break
            damping *= 5
        else:
            return z, cost, there - cost < 0.01 * max(cost, 1.0)
        z, damping = trial, damping * 0.2
        converged = cost - there < 1e-3 * max(1.0, cost / residual.size)
        if converged:
            break
    return z, there, converged


def _best(problem: _Problem, starts: list[FloatArray]) -> tuple[FloatArray, float, bool]:
    """Lowest minimum: a few steps from every start, and from the best two to the end."""
    tried = sorted((_search(problem, start, _SHORT, 3 + _TOLD) for start in starts), key=lambda found: found[1])
    first = _search(problem, tried[0][0], _LONG)
    others = [z for z, cost, _ in tried[1:] if cost < tried[0][1] + _NEAR_COST and _apart(z, tried[0][0])]
    second = [_search(problem, z, _LONG) for z in others[:1]]
    return min([first, *second], key=lambda found: found[1])


def _explored(problem: _Problem, z: FloatArray, cost: float, converged: bool) -> tuple[FloatArray, float, bool]:
    """Look for a lower minimum beside one: the teeth bounce once more or less there, and the misfit has a kink."""
    for _ in range(_ROUNDS):
        _, slopes = problem.slopes(z, _SIZE)
        covariance = np.linalg.inv(slopes @ slopes.T)
        along = covariance[:, 0] / np.sqrt(covariance[0, 0])
        best = (z, cost, converged)
        for deviations in _BESIDE:
            trial = z + deviations * along
            trial[0] = max(trial[0], _LEAST_BACKLASH)
            tried = _search(problem, trial, _FEW, 3 + _TOLD)
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
    z = np.tile(_MEAN, (_LIBRARY, 1))
    z[:, 0] = np.exp(rng.uniform(*np.log(_LIBRARY_BACKLASH), _LIBRARY))
    z[:, 2] = _LIBRARY_FRICTION * np.abs(rng.standard_normal(_LIBRARY))
    z[:, 3 : 3 + _TOLD] = _LIBRARY_SPREAD * rng.standard_normal((_LIBRARY, _TOLD))
    turns = settled_turns(_rows(z), movement)
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
        if len(starts) == _STARTS:
            break
    return starts


def fit_joint(recording: Recording) -> SelfFit:
    """Find the backlash, and the joint besides, from one log.

    Parameters
    ----------
    recording : Recording
        Three turns or more at constant speed.

    Returns
    -------
    SelfFit
        Its `doubt` says whether it may be believed.

    Raises
    ------
    ValueError
        The record is too short or too coarse.
    """
    movement = Movement(float(recording.commanded_speed_rps * recording.turn_period_s), recording.turn_period_s)
    harmonics = turn_harmonics(recording)
    if harmonics.order.size < _SIZE:
        raise ValueError(f"{recording.source}: sampled too coarsely, {harmonics.order.size} harmonics of the turn")
    problem = _Problem(harmonics, movement, recording.sample_s)
    z, cost, converged = _best(problem, _starts(harmonics, movement))
    if problem.find_error(z):
        z, cost, converged = _search(problem, z, _LONG)
    z, cost, converged = _explored(problem, z, cost, converged)
    for _ in range(_MOST_DROPPED):
        if not problem.drop_outlier(z):
            break
        z, cost, converged = _search(problem, z, _LONG)
    return _result(problem, z, converged, harmonics.unrest)


def _result(problem: _Problem, z: FloatArray, converged: bool, unrest: float) -> SelfFit:
    residual, slopes = problem.slopes(z, _SIZE)
    covariance = np.linalg.inv(slopes @ slopes.T)
    chi2, freedom = float(residual @ residual), residual.size - _SIZE
    sd = float(np.sqrt(covariance[0, 0]) * _UNIT_RAD)
    left_over = chi2 - freedom if stats.chi2.sf(chi2, freedom) < _IMPROBABLE else 0.0
    half = _NORMAL_95 * sd * float(np.sqrt(1 + _SHARE_ALONG * left_over))
    delta = float(z[0] * _UNIT_RAD)
    turn = settled_turns(_rows(z[None]), problem.movement, problem.error_order)[0]
    ratios = _centre() | {name: float(_centre()[name] * np.exp(z[k])) for k, name in enumerate(RATIO_PRIOR, start=3)}
    ring, damping = _ring(ratios, problem.movement)
    phase = z[1] / (2 * np.pi)
    return SelfFit(
        delta, (max(delta - half, 0.0), delta + half), sd, ring, damping, float(z[2]), ratios,
        float(z[_SMOOTHING]), covariance, chi2 / freedom, _worst_phase(problem, residual, phase), unrest,
        _shifted(turn - turn.mean(), phase), _doubt(chi2 / freedom, unrest, converged, sd),
    )  # fmt: skip


def _doubt(misfit: float, unrest: float, converged: bool, sd: float) -> str:
    if not (converged and np.isfinite(misfit) and np.isfinite(sd)):
        return "the search for the joint does not end"
    if unrest > MOST_UNREST:
        return (
            f"turns do not repeat themselves (noise in the ring's band {unrest:.1f} times that above it): the drive "
            "hardly damps, or something else moves"
        )
    if misfit > MOST_MISFIT:
        return f"no joint of the paper's kind makes this record (residual {misfit:.1f} times the noise's)"
    return ""


def _shifted(turn: FloatArray, phase: float) -> FloatArray:
    """A turn from another phase on."""
    spectrum = np.fft.rfft(turn)
    return np.fft.irfft(spectrum * np.exp(2j * np.pi * phase * np.arange(spectrum.size)), turn.size)


def _worst_phase(problem: _Problem, residual: FloatArray, phase: float) -> float:
    """Phase of the turn at which the residual is largest."""
    real, imaginary = residual[: 2 * problem.order.size].reshape(2, -1)
    spectrum = np.zeros(257, dtype=complex)
    inside = problem.order < spectrum.size
    spectrum[problem.order[inside]] = ((real + 1j * imaginary) * problem.sd)[inside]
    return float((np.abs(np.fft.irfft(spectrum)).argmax() / 512 + phase) % 1.0)


def _ring(ratios: dict[str, float], movement: Movement) -> tuple[float, float]:
    """Frequency [Hz] and damping ratio of the slowest oscillation in contact; NaN if there is none."""
    joint = joint_from_ratios(ratios | {"lead_s": 0.0}, gear_ratio=movement.gear_ratio, speed_by_differencing=True)
    values = np.linalg.eigvals(closed_loop_matrix(joint)).astype(complex)
    modes = np.log(values[np.abs(values) > 0]) / joint.control_period_s
    rings = modes[(modes.imag > 2 * np.pi * _SLOWEST_RING_HZ) & (modes.real < 0)]
    if rings.size == 0:
        return float("nan"), float("nan")
    slowest = rings[np.abs(rings.imag).argmin()]
    return float(slowest.imag / (2 * np.pi)), float(-slowest.real / np.abs(slowest))
