"""What a log says of a joint: unknowns, their priors, and the whitened residuals of the mean turn's harmonics."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from backlash.fitting.harmonics import TurnHarmonics
from backlash.fitting.turns import (
    COLUMNS,
    DELTA,
    Movement,
    simulate_turns,
    turn_and_slopes,
    turns_to_settle,
)
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
_PRIOR_MEDIANS = identified_joint().ratios


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


class Unknown(NamedTuple):
    """An unknown of the fit, the SD of its prior, and what it sets in a joint's row, if anything."""

    name: str
    sd: float
    column: str = ""
    unit: float = 0.0  # there; 0 for a ratio, which is relative to the identified joint's


_UNKNOWNS = (
    Unknown("backlash", np.inf, "delta_rad", UNIT_RAD),
    Unknown("phase", np.inf),
    Unknown("friction", 0.1, "friction", 1.0),
    *(Unknown(name, sd, name) for name, sd in RATIO_PRIOR.items()),
    Unknown("smoothing", _SEARCHED.smoothing_sd),
    # Squared time constant [ms^2] of a low-pass between encoder and log, its delay taken out: zero
    # unless let free.
    Unknown("low_pass", _SEARCHED.low_pass_sd),
)
NAMES = tuple(unknown.name for unknown in _UNKNOWNS)
SIZE = len(NAMES)
PHASE, SMOOTHING_INDEX, LOW_PASS_INDEX = (
    NAMES.index(name) for name in ("phase", "smoothing", "low_pass")
)
SD = np.array([unknown.sd for unknown in _UNKNOWNS])
MEAN = np.where(np.arange(SIZE) == SMOOTHING_INDEX, _SEARCHED.smoothing, 0.0)
_SIMULATED = [k for k, unknown in enumerate(_UNKNOWNS) if unknown.column]
_COLUMN = [COLUMNS.index(_UNKNOWNS[k].column) for k in _SIMULATED]
_UNIT = np.array([_UNKNOWNS[k].unit for k in _SIMULATED])

# More starts are tried where noise alone leaves so large a residual in one log of a thousand: they
# cost a second.
_IMPROBABLE = 1e-3
# Samples and turns are in step if a sample's phase in the turn moves by less than this over the log
# [samples].
_IN_STEP = 0.25
# How well a turn has settled: to a hundredth of the noise of a mean turn, and to a tenth while
# starts are compared.
_SETTLED_RPS = 2e-4
_NEARLY_RPS = 2e-3


def rows_of(z: FloatArray) -> FloatArray:
    """Rows of `simulate_turns` for unknowns of shape (joints, unknowns)."""
    rows = np.zeros((len(z), len(COLUMNS)))
    for k, column, unit in zip(_SIMULATED, _COLUMN, _UNIT, strict=True):
        rows[:, column] = (
            unit * z[:, k] if unit else _PRIOR_MEDIANS[_UNKNOWNS[k].column] * np.exp(z[:, k])
        )
    rows[:, DELTA] = np.maximum(z[:, 0], LEAST_BACKLASH) * UNIT_RAD
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
        self.lead = turns_to_settle(movement)  # turns that the last joint took to settle
        self.differencing = True  # what the drive does to its encoder

    def measured_as(self, measurement: Measurement) -> None:
        """Take another prior of how the speed was measured."""
        self.mean, self.spread = MEAN.copy(), SD.copy()
        self.mean[SMOOTHING_INDEX] = measurement.smoothing
        self.spread[SMOOTHING_INDEX] = measurement.smoothing_sd
        self.spread[LOW_PASS_INDEX] = measurement.low_pass_sd
        self.differencing = measurement.smoothing > 0.5

    def turns(self, z: FloatArray) -> FloatArray:
        """Settled turns [rps] of joints, shape (joints, periods)."""
        return simulate_turns(rows_of(z), self.movement, self.lead, self.differencing)

    def slopes(self, z: FloatArray, free: int = SIZE) -> tuple[FloatArray, FloatArray]:
        """Residuals, and their derivative by each unknown, shape (unknowns, residuals); 0 from the one `free` on."""
        row = rows_of(z[None])[0]
        settled_rps = _SETTLED_RPS if free == SIZE else _NEARLY_RPS
        turn = turn_and_slopes(row, self.movement, self.differencing, settled_rps)
        self.lead = turn.turns_before
        by_unknown = np.where(_UNIT > 0, _UNIT, row[_COLUMN])[:, None] * turn.slopes[_COLUMN]
        parts = self._logged_parts(np.vstack([turn.motor_rps[None], by_unknown]), z)
        seen = parts[:, 0]
        order = self._aliases()
        fade = self._fade()
        lag = self._lag(z)
        out = np.zeros((SIZE, self.order.size), dtype=complex)
        out[_SIMULATED] = parts[:, 1:].sum(axis=0)
        out[PHASE] = (1j * order * seen).sum(axis=0)
        out[SMOOTHING_INDEX] = (fade * seen).sum(axis=0)
        out[LOW_PASS_INDEX] = (-0.5 * (self._rad_per_ms * order) ** 2 / (1 + lag) * seen).sum(
            axis=0
        )
        out[free:] = 0
        misfit = self._whitened(seen.sum(axis=0) - self.target)
        residual = np.concatenate([misfit, ((z - self.mean) / self.spread)[2:]])
        return residual, np.hstack([self._whitened(out), np.diag(1 / self.spread)[:, 2:]])

    def _whitened(self, spectra: ComplexArray) -> FloatArray:
        spectra = spectra / self.sd
        return np.concatenate([spectra.real, spectra.imag], axis=-1)

    def _logged_parts(self, turns: FloatArray, z: FloatArray) -> ComplexArray:
        """Harmonics of turns that the log shows at one: aliased, later by the phase, smoothed and low-passed."""
        order, lag = self._aliases(), self._lag(z)
        sign = np.sign(np.sinc(order / self.samples)) if z[SMOOTHING_INDEX] > 0.5 else 1.0
        passed = (
            sign
            * np.exp(1j * order * z[PHASE] + self._fade() * z[SMOOTHING_INDEX] + lag)
            / (1 + lag)
        )
        return self._aliased(turns) * passed[:, None]

    def _aliases(self) -> NDArray[np.int64]:
        """Orders that a log shows at each of its own, a row each.

        Where a turn has a whole number of samples, what is faster than half the sampling rate comes
        back at harmonics.
        """
        return self.order + round(self.samples) * np.array(
            [[0], [-1], [1]][: 3 if self.folded else 1]
        )

    def _aliased(self, turns: FloatArray) -> ComplexArray:
        """Harmonics of turns at the aliases, shape (aliases, turns, orders)."""
        spectra = np.fft.rfft(turns, axis=1) / turns.shape[1]
        order = self._aliases()
        there = np.abs(order) < spectra.shape[1]
        seen = np.moveaxis(spectra[:, np.where(there, np.abs(order), 0)], 1, 0)
        return np.where(order[:, None] < 0, seen.conj(), seen) * there[:, None]

    def _fade(self) -> FloatArray:
        """What smoothing over a sampling period does to the harmonics' logarithms."""
        return np.log(np.maximum(np.abs(np.sinc(self._aliases() / self.samples)), 1e-3))

    def _lag(self, z: FloatArray) -> ComplexArray:
        """Times i, the angle by which a low-pass lags."""
        return 1j * self._rad_per_ms * self._aliases() * np.sqrt(max(z[LOW_PASS_INDEX], 0.0))

    def is_improbable(self, chi2: float) -> bool:
        """Whether noise alone hardly leaves so large a sum of squares."""
        return not chdtrc(2 * self.order.size - SMOOTHING_INDEX, chi2) > _IMPROBABLE
