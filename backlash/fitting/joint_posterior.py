"""What a log says of a joint: unknowns, their priors, and the whitened residuals of the mean turn's harmonics."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from backlash.fitting.harmonics import TurnHarmonics
from backlash.fitting.turns import COLUMNS, DELTA, GRAVITY, Movement, simulate_turns, turn_and_slopes, turns_to_settle
from replication.arrays import FloatArray
from replication.simulator.parameters import TURN, identified_joint

# Relative SD (log-normal) of the prior of each ratio around the identified joint's. The drive's inner workings, the
# last five, are taken as known up to a few percent, or the error of the backlash would double: a log hardly tells them.
RATIO_PRIOR = {
    **dict.fromkeys(("stiffness_per_s2", "gravity_per_s2", "inertia_ratio"), 0.2),
    **dict.fromkeys(("speed_gain_per_s", "integral_gain_per_s2"), 0.2),
    "torque_lag_s": 0.03,
    **dict.fromkeys(("derivative_gain", "leaky_gain_per_s2", "position_gain_per_s", "leaky_rate_per_s"), 0.02),
}
DRIVE_UNKNOWNS = 5
# How a speed may have been measured: probability, mean and SD of its smoothing in units of what differencing over a
# sampling period does, SD of a low-pass's squared time constant [ms^2]. Drives difference their encoder (1), and some
# filter it; a tachometer or a simulation does not (0), and then its drive does not either. While the joint is looked
# for, the smoothing is between the two.
_NO_FILTER, _FILTER_MS2 = 1e-3, 8.0
MEASURED_AS = {
    "differenced": (0.8, 1.0, 0.03, _NO_FILTER),
    "filtered": (0.1, 1.0, 0.03, _FILTER_MS2),
    "direct": (0.1, 0.0, 0.03, _NO_FILTER),
}
_SEARCHED_SMOOTHING = (0.85, 0.2)

ComplexArray = NDArray[np.complex128]

UNIT_RAD, LEAST_BACKLASH = 1e-4, 0.01
# Of each unknown: the prior's SD, the column of `simulate_turns` that it sets, and its unit there (0: relative).
_UNKNOWNS = {
    "backlash": (np.inf, "delta_rad", UNIT_RAD),
    "phase": (np.inf, "", 0.0),
    "friction": (0.1, "friction", 1.0),
    **{name: (sd, name, 0.0) for name, sd in RATIO_PRIOR.items()},
    "smoothing": (_SEARCHED_SMOOTHING[1], "", 0.0),
    # A transmission error in step with the turn (a belt, a gear), on the load's side.
    "error_sine": (2.0, "error_sine_rad", 1e-5),
    "error_cosine": (2.0, "error_cosine_rad", 1e-5),
    # A torque ripple once a motor turn, in percent of m g r / N. Its own harmonic is left out, for an encoder errs
    # there too; what it does to the teeth shows in the others.
    "ripple_sine": (2.0, "ripple_sine", 0.01),
    "ripple_cosine": (2.0, "ripple_cosine", 0.01),
    # Squared time constant [ms^2] of a low-pass between encoder and log, its delay taken out: zero unless let free.
    "low_pass": (_NO_FILTER, "", 0.0),
}
UNKNOWNS, SIZE = tuple(_UNKNOWNS), len(_UNKNOWNS)
LOW_PASS_INDEX = SIZE - 1
SMOOTHING_INDEX, _ERROR_SINE, _ERROR_COSINE = map(UNKNOWNS.index, ("smoothing", "error_sine", "error_cosine"))
SD = np.array([sd for sd, _, _ in _UNKNOWNS.values()])
MEAN = np.where(np.arange(SIZE) == SMOOTHING_INDEX, _SEARCHED_SMOOTHING[0], 0.0)
_SIMULATED = [k for k, (_, column, _) in enumerate(_UNKNOWNS.values()) if column]
_COLUMN = [COLUMNS.index(column) for _, column, _ in _UNKNOWNS.values() if column]
_UNIT = np.array([unit for _, column, unit in _UNKNOWNS.values() if column])

# Transmission errors up to this frequency are looked for; one must be this improbable in noise alone, and
# the residual without it improbable too. Its difference's step.
_FASTEST_ERROR_HZ, _CHANCE_OF_ERROR, _SUSPECT, _ERROR_STEP = 60.0, 0.01, 0.3, 0.05
# A harmonic whose residual has a square this improbable, times their number, belongs to the machine, not the joint.
_OUTLIER = 1e-3
# More starts are tried where noise alone leaves so large a residual in one log of a thousand: they cost a second.
_IMPROBABLE = 1e-3
# Samples and turns are in step if a sample's phase in the turn moves by less than this over the log [samples].
_IN_STEP = 0.25
# How well a turn has settled: to a hundredth of the noise of a mean turn, and to a tenth while starts are compared.
_SETTLED_RPS, _NEARLY_RPS = 2e-4, 2e-3
_PRIOR_MEDIANS = identified_joint().ratios


def rows_of(z: FloatArray) -> FloatArray:
    """Rows of `simulate_turns` for unknowns of shape (joints, unknowns)."""
    rows = np.zeros((len(z), len(COLUMNS)))
    rows[:, _COLUMN] = _UNIT * z[:, _SIMULATED]
    rows[:, DELTA] = np.maximum(z[:, 0], LEAST_BACKLASH) * UNIT_RAD
    for k, name in enumerate(RATIO_PRIOR, start=3):
        rows[:, COLUMNS.index(name)] = _PRIOR_MEDIANS[name] * np.exp(z[:, k])
    return rows


def ratios_of(z: FloatArray) -> dict[str, float]:
    """Ratios of a joint with these unknowns."""
    own = {name: float(_PRIOR_MEDIANS[name] * np.exp(z[k])) for k, name in enumerate(RATIO_PRIOR, start=3)}
    return _PRIOR_MEDIANS | own


class Problem:
    """Whitened residuals of a record's harmonics and their slopes; searches of a joint also change what it asks."""

    def __init__(self, harmonics: TurnHarmonics, movement: Movement, sample_s: float):
        self.movement, self.order, self.sd = movement, harmonics.order, harmonics.sd
        self.target = harmonics.coefficient
        self.samples = movement.turn_period_s / sample_s
        self._rad_per_ms = 1e-3 * TURN / movement.turn_period_s  # of the first harmonic
        self.folded = abs(self.samples - round(self.samples)) * harmonics.turns < _IN_STEP
        self.mean, self.spread = MEAN, SD  # of the unknowns' priors
        self.error_order = 0  # of the transmission error, periods a turn; 0 for none
        self.lead = turns_to_settle(movement)  # turns that the last joint took to settle
        self.differencing = True  # what the drive does to its encoder

    def measured_as(self, smoothing: float, smoothing_sd: float, low_pass_sd: float) -> None:
        """Take another prior of how the speed was measured; see `MEASURED_AS`."""
        self.mean, self.spread = MEAN.copy(), SD.copy()
        self.mean[SMOOTHING_INDEX] = smoothing
        self.spread[[SMOOTHING_INDEX, LOW_PASS_INDEX]] = smoothing_sd, low_pass_sd
        self.differencing = smoothing > 0.5

    def settled(self, z: FloatArray, error_order: float | None = None) -> FloatArray:
        """Settled turns [rps] of joints, shape (joints, periods)."""
        order = self.error_order if error_order is None else error_order
        return simulate_turns(rows_of(z), self.movement, order, self.lead, self.differencing)

    def _whitened(self, spectra: ComplexArray) -> FloatArray:
        spectra = spectra / self.sd
        return np.concatenate([spectra.real, spectra.imag], axis=-1)

    def _misfit(self, turns: FloatArray, z: FloatArray) -> FloatArray:
        """Whitened difference of turns from the data, all with the phase and smoothing of one set of unknowns."""
        return self._whitened(self._logged(turns, z) - self.target)

    def _of_prior(self, z: FloatArray) -> FloatArray:
        return ((z - self.mean) / self.spread)[2:]

    def residual(self, z: FloatArray) -> FloatArray:
        """Data's and prior's residuals of one set of unknowns."""
        return np.concatenate([self._misfit(self.settled(z[None]), z)[0], self._of_prior(z)])

    def slopes(self, z: FloatArray, free: int = SIZE) -> tuple[FloatArray, FloatArray]:
        """Residuals, and their derivative by each unknown, shape (unknowns, residuals); 0 from the one `free` on."""
        row, whole = rows_of(z[None])[0], free == SIZE
        turn = turn_and_slopes(
            row, self.movement, self.error_order, self.differencing, whole, _SETTLED_RPS if whole else _NEARLY_RPS
        )
        self.lead = turn.turns_before
        by_unknown = np.where(_UNIT > 0, _UNIT, row[_COLUMN])[:, None] * turn.slopes[_COLUMN]
        order, parts, fade, lag = self._folded(np.vstack([turn.motor_rps[None], by_unknown]), z)
        here, seen = parts[:, 0].sum(axis=0), parts[:, 0]
        out = np.zeros((SIZE, self.order.size), dtype=complex)
        out[_SIMULATED] = parts[:, 1:].sum(axis=0)
        out[1], out[SMOOTHING_INDEX] = (1j * order * seen).sum(axis=0), (fade * seen).sum(axis=0)
        out[LOW_PASS_INDEX] = (-0.5 * (self._rad_per_ms * order) ** 2 / (1 + lag) * seen).sum(axis=0)
        out[free:] = 0
        residual = np.concatenate([self._whitened(here - self.target), self._of_prior(z)])
        return residual, np.concatenate([self._whitened(out), np.diag(1 / self.spread)[:, 2:]], axis=1)

    def push_slopes(self, z: FloatArray, pushes: Callable[[FloatArray, float, Movement], FloatArray]) -> FloatArray:
        """Derivative of the residuals by pushes on the load, which follow from its speed; shape (pushes, residuals)."""
        row = rows_of(z[None])[0]
        rest = self.movement, self.error_order, self.differencing, True, _SETTLED_RPS
        load_speed = turn_and_slopes(row, *rest).load_rad_per_s
        pushed = turn_and_slopes(row, *rest, pushes(load_speed, row[GRAVITY], self.movement))
        data = self._whitened(self._logged(pushed.slopes[len(COLUMNS) :], z))
        return np.pad(data, ((0, 0), (0, SIZE - 2)))

    def _logged(self, turns: FloatArray, z: FloatArray) -> ComplexArray:
        """Harmonics of turns as the log has them."""
        return self._folded(turns, z)[1].sum(axis=0)

    def _folded(
        self, turns: FloatArray, z: FloatArray
    ) -> tuple[NDArray[np.int64], ComplexArray, FloatArray, ComplexArray]:
        """Harmonics of turns that a log shows at one, later by its phase, smoothed and low-passed.

        Also their orders, what smoothing does to their logarithm, and i times the low-pass's phase.
        Where a turn has a whole number of samples, what is faster than half the sampling rate comes back at harmonics.
        """
        spectra = np.fft.rfft(turns, axis=1) / turns.shape[1]
        order = self.order + round(self.samples) * np.array([[0], [-1], [1]][: 3 if self.folded else 1])
        there = np.abs(order) < spectra.shape[1]
        seen = np.moveaxis(spectra[:, np.where(there, np.abs(order), 0)], 1, 0)
        seen = np.where(order[:, None] < 0, seen.conj(), seen) * there[:, None]
        smoothed = np.sinc(order / self.samples)
        lag = 1j * self._rad_per_ms * order * np.sqrt(max(z[LOW_PASS_INDEX], 0.0))
        fade = np.log(np.maximum(np.abs(smoothed), 1e-3))
        sign = np.sign(smoothed) if z[SMOOTHING_INDEX] > 0.5 else 1.0
        seen = seen * (sign * np.exp(1j * order * z[1] + fade * z[SMOOTHING_INDEX] + lag) / (1 + lag))[:, None]
        return order, seen, fade, lag

    def is_improbable(self, chi2: float) -> bool:
        """Whether noise alone hardly leaves so large a sum of squares."""
        return not chdtrc(2 * self.order.size - SMOOTHING_INDEX, chi2) > _IMPROBABLE

    def find_error(self, z: FloatArray) -> bool:
        """Take up an error in step with the load's turn, if the residual shows one; say whether it did."""
        residual = self.residual(z)
        if self.error_order or chdtrc(residual.size - SIZE, residual @ residual) > _SUSPECT:
            return False
        residual, slopes = self.slopes(z)
        tried = range(2, int(_FASTEST_ERROR_HZ * self.movement.turn_period_s) + 1)
        gain = {order: self._gain(z, residual, slopes, order) for order in tried}
        scale = max(1.0, float(residual @ residual) / residual.size)
        best = max(gain, key=lambda order: gain[order], default=0)
        if not best or len(gain) * np.exp(-gain[best] / scale / 2) > _CHANCE_OF_ERROR:
            return False
        self.error_order = best
        return True

    def _gain(self, z: FloatArray, residual: FloatArray, slopes: FloatArray, order: int) -> float:
        """By how much chi squared falls if the two parts of an error are let free."""
        batch = np.repeat(z[None], 2, axis=0)
        batch[[0, 1], [_ERROR_SINE, _ERROR_COSINE]] += _ERROR_STEP
        columns = np.zeros((2, residual.size))
        data = slice(0, 2 * self.order.size)
        columns[:, data] = (self._misfit(self.settled(batch, order), z) - residual[data]) / _ERROR_STEP
        onto = np.linalg.solve(slopes @ slopes.T, slopes @ columns.T)
        columns -= onto.T @ slopes
        along = columns @ residual
        prior = np.diag(SD[[_ERROR_SINE, _ERROR_COSINE]] ** -2.0)
        return float(along @ np.linalg.solve(columns @ columns.T + prior, along))

    def subtract_belt_bias(self, z: FloatArray, lines: Sequence[tuple[float, float]]) -> bool:
        """Take off what errors out of step with the turn (a belt's) do to the mean turn; say whether there are any.

        It grows with the square of their size, which the sinusoids tell that they leave in the speed.
        """
        subtracted = False
        for order, amplitude in lines:
            batch = np.repeat(z[None], 5, axis=0)
            batch[:4, [_ERROR_SINE, _ERROR_COSINE]] += np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
            turns = self.settled(batch, order)
            wave = np.exp(-2j * np.pi * order * np.arange(turns.shape[1]) / turns.shape[1])
            response = ((turns[2] - turns[3]) + 1j * (turns[0] - turns[1])) / 2
            size = amplitude / max(abs((response * wave).mean()), 1e-9)
            if size < SD[_ERROR_SINE]:
                mean = size**2 * (turns[:4].mean(axis=0) - turns[4])
                self.target = self.target - self._logged(mean[None], z)[0]
                subtracted = True
        return subtracted

    def drop_outlier(self, z: FloatArray) -> bool:
        """Leave out the harmonic that fits worst, if noise can't explain it; say whether there was one."""
        data = self.residual(z)[: 2 * self.order.size].reshape(2, -1)
        square = (data**2).sum(axis=0) / 2
        square /= max(1.0, float(np.median(square)) / np.log(2))
        worst = int(square.argmax())
        if self.order.size * np.exp(-square[worst]) > _OUTLIER:
            return False
        self.order, self.sd = np.delete(self.order, worst), np.delete(self.sd, worst)
        self.target = np.delete(self.target, worst)
        return True
