"""What a log says of a joint: unknowns, their priors, and the whitened residuals of the mean turn's harmonics."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from backlash.fitting.harmonics import TurnHarmonics
from backlash.fitting.turns import COLUMNS, DELTA, FRICTION, SETTLING_S, Movement, simulate_turns
from replication.arrays import FloatArray
from replication.simulator.parameters import TURN, identified_joint

ComplexArray = NDArray[np.complex128]

# Relative SD (log-normal) of the prior of each ratio around the identified joint's. The drive's
# inner workings, the last five, are taken as known up to a few percent, or the error of the
# backlash would double: a log hardly tells them.
RATIO_PRIOR = {
    **dict.fromkeys(("stiffness_per_s2", "gravity_per_s2", "inertia_ratio"), 0.2),
    **dict.fromkeys(("speed_gain_per_s", "integral_gain_per_s2"), 0.2),
    "torque_lag_s": 0.03,
    **dict.fromkeys(
        ("derivative_gain", "leaky_gain_per_s2", "position_gain_per_s", "leaky_rate_per_s"), 0.02
    ),
}
DRIVE_UNKNOWNS = 5
_IDENTIFIED = identified_joint().ratios
_PRIOR_MEDIANS = np.array([_IDENTIFIED[name] for name in RATIO_PRIOR])


class Measurement(NamedTuple):
    """How a speed may have been measured.

    Drives difference their encoder, and some filter it; a tachometer or a simulation does not, and
    then its drive does not either.
    """

    probability: float
    smoothing: float  # mean and SD, in units of what differencing over a sampling period does
    smoothing_sd: float
    low_pass_sd: float  # of a low-pass's squared time constant [ms^2]


_NO_FILTER = 1e-3
_FILTER_MS2 = 8.0
MEASURED_AS = {
    "differenced": Measurement(0.8, 1.0, 0.03, _NO_FILTER),
    "filtered": Measurement(0.1, 1.0, 0.03, _FILTER_MS2),
    "direct": Measurement(0.1, 0.0, 0.03, _NO_FILTER),
}
# While the joint is looked for, the smoothing is between the two.
_SEARCHED = Measurement(1.0, 0.85, 0.2, _NO_FILTER)

UNIT_RAD = 1e-4
LEAST_BACKLASH = 0.01


NAMES = ("backlash", "phase", "friction", *RATIO_PRIOR, "smoothing", "low_pass")
SIZE = len(NAMES)
PHASE, SMOOTHING_INDEX, LOW_PASS_INDEX = (
    NAMES.index(name) for name in ("phase", "smoothing", "low_pass")
)
_FRICTION_SD = 0.1
# Of the priors: what a log itself has to tell, friction over m g r, ratios, smoothing, and the
# squared time constant [ms^2] of a low-pass between encoder and log, its delay taken out: zero
# unless let free.
SD = np.array(
    [
        np.inf,
        np.inf,
        _FRICTION_SD,
        *RATIO_PRIOR.values(),
        _SEARCHED.smoothing_sd,
        _SEARCHED.low_pass_sd,
    ]
)
MEAN = np.where(np.arange(SIZE) == SMOOTHING_INDEX, _SEARCHED.smoothing, 0.0)
_RATIO_COLUMNS = [COLUMNS.index(name) for name in RATIO_PRIOR]

# More starts are tried where noise alone leaves so large a residual in one log of a thousand: they
# cost a second.
_IMPROBABLE = 1e-3
# Samples and turns are in step if a sample's phase in the turn moves by less than this over the log
# [samples].
_IN_STEP = 0.25
# A drive slower than the paper's takes longer to settle; so long in the last steps.
_LONG_SETTLING_S = 2 * SETTLING_S
# Of the unknowns in a difference: far below an SD, far above rounding.
_STEP = 1e-4


def rows_of(z: FloatArray) -> FloatArray:
    """Rows of `simulate_turns` for unknowns of shape (joints, unknowns)."""
    rows = np.zeros((len(z), len(COLUMNS)))
    rows[:, DELTA] = np.maximum(z[:, 0], LEAST_BACKLASH) * UNIT_RAD
    rows[:, FRICTION] = z[:, 2]
    rows[:, _RATIO_COLUMNS] = _PRIOR_MEDIANS * np.exp(z[:, 3:SMOOTHING_INDEX])
    return rows


class Problem:
    """Whitened residuals of a record's harmonics and their slopes; searches of a joint also change what it asks."""

    def __init__(self, harmonics: TurnHarmonics, movement: Movement, sample_s: float):
        self.movement = movement
        self.order = harmonics.order
        self.sd = harmonics.sd
        self.target = harmonics.coefficient
        self.samples = movement.turn_period_s / sample_s
        self._rad_per_ms = 1e-3 * TURN / movement.turn_period_s  # of the first harmonic
        self.folded = abs(self.samples - round(self.samples)) * harmonics.turns < _IN_STEP
        self.mean, self.spread = MEAN, SD  # of the unknowns' priors
        self.differencing = True  # what the drive does to its encoder

    def measured_as(self, measurement: Measurement) -> None:
        """Take another prior of how the speed was measured."""
        self.mean, self.spread = MEAN.copy(), SD.copy()
        self.mean[SMOOTHING_INDEX] = measurement.smoothing
        self.spread[SMOOTHING_INDEX] = measurement.smoothing_sd
        self.spread[LOW_PASS_INDEX] = measurement.low_pass_sd
        self.differencing = measurement.smoothing > 0.5

    def turns(self, z: FloatArray, settling_s: float = _LONG_SETTLING_S) -> FloatArray:
        """Settled turns [rps] of joints, shape (joints, periods)."""
        rows, place = np.unique(rows_of(z), axis=0, return_inverse=True)
        return simulate_turns(rows, self.movement, settling_s, self.differencing)[place]

    def residual(self, z: FloatArray, free: int = SIZE) -> FloatArray:
        """Of the harmonics, then of the unknowns' priors, over their SDs."""
        return self._with_priors(self._misfits(z[None], free)[0], z)

    def slopes(self, z: FloatArray, free: int = SIZE) -> tuple[FloatArray, FloatArray]:
        """Residuals, and their derivative by each unknown, shape (unknowns, residuals); 0 from the one `free` on."""
        moved = z + _STEP * np.eye(SIZE + 1, SIZE, -1)[: free + 1]
        here, *there = self._misfits(moved, free)
        by_unknown = np.zeros((SIZE, here.size))
        by_unknown[:free] = (np.array(there) - here) / _STEP
        by_prior = np.diag(1 / self.spread)[:, 2:]
        return self._with_priors(here, z), np.hstack([by_unknown, by_prior])

    def _with_priors(self, misfit: FloatArray, z: FloatArray) -> FloatArray:
        """A misfit, then how far unknowns lie from their priors' means, over the SDs."""
        return np.concatenate([misfit, ((z - self.mean) / self.spread)[2:]])

    def _misfits(self, z: FloatArray, free: int) -> FloatArray:
        """Harmonics of joints less the log's, over their SDs; settled less well while not all unknowns are free."""
        settling_s = _LONG_SETTLING_S if free == SIZE else SETTLING_S
        return self._whitened(self._logged(self.turns(z, settling_s), z) - self.target)

    def _whitened(self, spectra: ComplexArray) -> FloatArray:
        spectra = spectra / self.sd
        return np.concatenate([spectra.real, spectra.imag], axis=-1)

    def _logged(self, turns: FloatArray, z: FloatArray) -> ComplexArray:
        """Harmonics that the log shows of turns: aliased, later by the phase, smoothed and low-passed.

        Where a turn has a whole number of samples, what is faster than half the sampling rate comes
        back at harmonics.
        """
        phase, smoothing, low_pass = z[:, [PHASE, SMOOTHING_INDEX, LOW_PASS_INDEX]].T[..., None]
        spectra = np.fft.rfft(turns, axis=1) / turns.shape[1]
        logged = np.zeros((len(z), self.order.size), dtype=complex)
        for fold in (0, -1, 1)[: 3 if self.folded else 1]:
            order = self.order + fold * round(self.samples)
            there = np.abs(order) < spectra.shape[1]
            seen = spectra[:, np.where(there, np.abs(order), 0)] * there
            passed = np.sinc(order / self.samples)
            fade = np.log(np.maximum(np.abs(passed), 1e-3))
            sign = np.where(smoothing > 0.5, np.sign(passed), 1.0)
            lag = 1j * self._rad_per_ms * order * np.sqrt(np.maximum(low_pass, 0.0))
            shown = sign * np.exp(1j * order * phase + fade * smoothing + lag) / (1 + lag)
            logged += np.where(order < 0, seen.conj(), seen) * shown
        return logged

    def is_improbable(self, chi2: float) -> bool:
        """Whether noise alone hardly leaves so large a sum of squares."""
        return not chdtrc(2 * self.order.size - SMOOTHING_INDEX, chi2) > _IMPROBABLE
