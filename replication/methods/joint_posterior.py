"""What a log says of a joint: unknowns, their priors, and the whitened residuals of the mean turn's harmonics."""

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from replication.datasets import FloatArray
from replication.methods.harmonics import TurnHarmonics
from replication.simulator.checks import closed_loop_matrix
from replication.simulator.parameters import identified_joint, joint_from_ratios
from replication.simulator.turn_slopes import turn_and_slopes
from replication.simulator.turns import COLUMNS, Movement, settled_turns, settling_turns

# Relative SD (log-normal) of the prior of each ratio around the identified joint's. A joint of this kind may be
# 20 % stiffer, heavier or more tightly controlled than the paper's. The drive's inner workings, which a log hardly
# tells, are taken as known up to a few percent, or the error of the backlash would double.
RATIO_PRIOR = {
    "stiffness_per_s2": 0.2,
    "gravity_per_s2": 0.2,
    "inertia_ratio": 0.2,
    "speed_gain_per_s": 0.2,
    "integral_gain_per_s2": 0.2,
    "torque_lag_s": 0.03,
    "derivative_gain": 0.02,
    "leaky_gain_per_s2": 0.02,
    "position_gain_per_s": 0.02,
    "leaky_rate_per_s": 0.02,
}
# The last of them are the drive's inner workings.
DRIVE_UNKNOWNS = 5
# Friction of the load over m g r.
FRICTION_PRIOR = 0.1
# How a speed may have been measured: probability, mean and SD of its smoothing in units of what differencing over a
# sampling period does. Drives difference their encoder (1); a tachometer or a simulation does not (0), and then its
# drive does not either.
MEASURED_AS = {"differenced": (0.9, 1.0, 0.03), "direct": (0.1, 0.0, 0.03)}
# While the joint is looked for, between the two.
_SEARCHED = (0.85, 0.2)

# A transmission error in step with the turn (a belt, a gear), in 1e-5 rad on the load's side: SD of its two parts.
ERROR_PRIOR = 2.0
# A torque ripple once a motor turn, over m g r / N in percent: SD of its two parts. Its own harmonic is left out, for
# an encoder errs there too; what it does to the teeth shows in the others.
RIPPLE_PRIOR = 2.0

UNIT_RAD, _ERROR_RAD, _RIPPLE = 1e-4, 1e-5, 0.01
_RATIOS = slice(3, 3 + len(RATIO_PRIOR))
SMOOTHING_INDEX = _RATIOS.stop
SIZE = SMOOTHING_INDEX + 5
_ERROR, _RIPPLES = slice(SMOOTHING_INDEX + 1, SMOOTHING_INDEX + 3), slice(SMOOTHING_INDEX + 3, SIZE)
MEAN = np.array([*np.zeros(SMOOTHING_INDEX), _SEARCHED[0], *np.zeros(4)])
SD = np.array(
    [np.inf, np.inf, FRICTION_PRIOR, *RATIO_PRIOR.values(), _SEARCHED[1], *[ERROR_PRIOR] * 2, *[RIPPLE_PRIOR] * 2]
)
# Step of an error's difference.
_ERROR_STEP = 0.05

UNKNOWNS = (
    "backlash", "phase", "friction", *RATIO_PRIOR, "smoothing", "error_sine", "error_cosine", "ripple_sine",
    "ripple_cosine",
)  # fmt: skip

# What the simulation takes: the column of each unknown, and what a unit of it is there (0: a ratio's is its own size).
_TAKEN = {
    "backlash": ("delta_rad", UNIT_RAD),
    "friction": ("friction", 1.0),
    **{name: (name, 0.0) for name in RATIO_PRIOR},
    "error_sine": ("error_sine_rad", _ERROR_RAD),
    "error_cosine": ("error_cosine_rad", _ERROR_RAD),
    "ripple_sine": ("ripple_sine", _RIPPLE),
    "ripple_cosine": ("ripple_cosine", _RIPPLE),
}
_SIMULATED = [UNKNOWNS.index(name) for name in _TAKEN]
_COLUMN = [COLUMNS.index(column) for column, _ in _TAKEN.values()]
_UNIT = np.array([unit for _, unit in _TAKEN.values()])

# Transmission errors up to this frequency are looked for; one must be this improbable in noise alone, and
# the residual without it improbable too.
_FASTEST_ERROR_HZ, _CHANCE_OF_ERROR, _SUSPECT = 60.0, 0.01, 0.3
# A harmonic whose residual has a square this improbable, times their number, belongs to the machine, not the joint.
_OUTLIER = 1e-3
# More starts are tried where noise alone leaves so large a residual in one log of a thousand: they cost a second.
_IMPROBABLE = 1e-3
LEAST_BACKLASH = 0.01
# Samples and turns are in step if a sample's phase in the turn moves by less than this over the log [samples].
_IN_STEP = 0.25
# How well a turn has settled: to a hundredth of the noise of a mean turn, and to a tenth while starts are compared.
_SETTLED_RPS, _NEARLY_RPS = 2e-4, 2e-3
# An oscillation slower than this is the drive's, no ring.
_SLOWEST_RING_HZ = 2.0


@lru_cache(maxsize=1)
def prior_medians() -> dict[str, float]:
    """Ratios of the identified joint, the priors' medians."""
    return identified_joint().ratios


def rows_of(z: FloatArray) -> FloatArray:
    """Rows of `settled_turns` for unknowns of shape (joints, unknowns)."""
    ratios = prior_medians()
    columns = {"delta_rad": np.maximum(z[:, 0], LEAST_BACKLASH) * UNIT_RAD, "friction": z[:, 2]}
    for k, name in enumerate(RATIO_PRIOR, start=3):
        columns[name] = ratios[name] * np.exp(z[:, k])
    columns["error_sine_rad"], columns["error_cosine_rad"] = (_ERROR_RAD * z[:, _ERROR]).T
    columns["ripple_sine"], columns["ripple_cosine"] = (_RIPPLE * z[:, _RIPPLES]).T
    zero = np.zeros(len(z))
    return np.stack([columns.get(name, zero) for name in COLUMNS], axis=1)


def ratios_of(z: FloatArray) -> dict[str, float]:
    """Ratios of a joint with these unknowns."""
    return prior_medians() | {
        name: float(prior_medians()[name] * np.exp(z[k])) for k, name in enumerate(RATIO_PRIOR, start=3)
    }


def contact_modes(ratios: dict[str, float], movement: Movement) -> NDArray[np.complex128]:
    """Oscillations of a joint with its teeth in contact [1/s], those above 2 Hz with a positive frequency."""
    joint = joint_from_ratios(ratios | {"lead_s": 0.0}, gear_ratio=movement.gear_ratio, speed_by_differencing=True)
    values = np.linalg.eigvals(closed_loop_matrix(joint)).astype(complex)
    modes = np.log(values[np.abs(values) > 0]) / joint.control_period_s
    return modes[modes.imag > 2 * np.pi * _SLOWEST_RING_HZ]


class Problem:
    """Weighted residuals of a record's harmonics and their slopes.

    `order`, `target` and `sd` are the harmonics, what the log has at them and its noise; `mean` and `spread` are the
    unknowns' priors; `error_order` is that of the transmission error (0: none), and `lead` the turns that the last
    joint took to settle.
    """

    def __init__(self, harmonics: TurnHarmonics, movement: Movement, sample_s: float):
        self.movement, self.order, self.sd = movement, harmonics.order, harmonics.sd
        self.target = harmonics.coefficient
        self.samples = movement.turn_period_s / sample_s
        self.folded = abs(self.samples - round(self.samples)) * harmonics.turns < _IN_STEP
        self.mean, self.spread = MEAN, SD
        self.error_order, self.lead = 0, settling_turns(movement)
        self.differencing = True

    def measured_as(self, smoothing: tuple[float, float]) -> None:
        """Take another prior of the smoothing, mean and SD."""
        self.mean, self.spread = MEAN.copy(), SD.copy()
        self.mean[SMOOTHING_INDEX], self.spread[SMOOTHING_INDEX] = smoothing
        self.differencing = smoothing[0] > 0.5

    def _measured(self, z: FloatArray, error_order: int | None = None) -> NDArray[np.complex128]:
        """Harmonics of joints, shape (joints, harmonics); all share the first one's phase and smoothing."""
        order = self.error_order if error_order is None else error_order
        return self._logged(settled_turns(rows_of(z), self.movement, order, self.lead, self.differencing), z[0])

    def _whitened(self, spectra: NDArray[np.complex128]) -> FloatArray:
        spectra = spectra / self.sd
        return np.concatenate([spectra.real, spectra.imag], axis=-1)

    def residual(self, z: FloatArray) -> FloatArray:
        """Data's and prior's residuals of one set of unknowns."""
        data = self._whitened(self._measured(z[None])[0] - self.target)
        return np.concatenate([data, ((z - self.mean) / self.spread)[2:]])

    def slopes(self, z: FloatArray, free: int = SIZE) -> tuple[FloatArray, FloatArray]:
        """Residuals, and their derivative by each unknown, shape (unknowns, residuals); 0 from the one `free` on."""
        row, whole = rows_of(z[None])[0], free == SIZE
        (turn, _), by_column, self.lead = turn_and_slopes(
            row, self.movement, self.error_order, self.differencing, whole, _SETTLED_RPS if whole else _NEARLY_RPS
        )
        by_unknown = np.where(_UNIT > 0, _UNIT, row[_COLUMN])[:, None] * by_column[_COLUMN]
        order, parts, fade = self._folded(np.vstack([turn[None], by_unknown]), z)
        here = parts[:, 0].sum(axis=0)
        out = np.zeros((SIZE, self.order.size), dtype=complex)
        out[_SIMULATED] = parts[:, 1:].sum(axis=0)
        out[1], out[SMOOTHING_INDEX] = (1j * order * parts[:, 0]).sum(axis=0), (fade * parts[:, 0]).sum(axis=0)
        out[free:] = 0
        residual = np.concatenate([self._whitened(here - self.target), ((z - self.mean) / self.spread)[2:]])
        return residual, np.concatenate([self._whitened(out), np.diag(1 / self.spread)[:, 2:]], axis=1)

    def push_slopes(self, z: FloatArray, pushes: Callable[[FloatArray, float, Movement], FloatArray]) -> FloatArray:
        """Derivative of the residuals by pushes on the load, which follow from its speed; shape (pushes, residuals)."""
        row = rows_of(z[None])[0]
        rest = self.movement, self.error_order, self.differencing, True, _SETTLED_RPS
        (_, load_speed), _, _ = turn_and_slopes(row, *rest)
        gravity = row[COLUMNS.index("gravity_per_s2")]
        _, slopes, _ = turn_and_slopes(row, *rest, pushes(load_speed, gravity, self.movement))
        data = self._whitened(self._logged(slopes[len(COLUMNS) :], z))
        return np.pad(data, ((0, 0), (0, SIZE - 2)))

    def _logged(self, turns: FloatArray, z: FloatArray) -> NDArray[np.complex128]:
        """Harmonics of turns as the log has them."""
        return self._folded(turns, z)[1].sum(axis=0)

    def _folded(self, turns: FloatArray, z: FloatArray):
        """Harmonics of turns that a log shows at one, later by its phase, and smoothed; their orders and fading.

        Where a turn has a whole number of samples, what is faster than half the sampling rate comes back at harmonics.
        """
        spectra = np.fft.rfft(turns, axis=1) / turns.shape[1]
        order = self.order + round(self.samples) * np.array([[0], [-1], [1]][: 3 if self.folded else 1])
        there = np.abs(order) < spectra.shape[1]
        seen = np.moveaxis(spectra[:, np.where(there, np.abs(order), 0)], 1, 0)
        seen = np.where(order[:, None] < 0, seen.conj(), seen) * there[:, None]
        smoothed = np.sinc(order / self.samples)
        fade = np.log(np.maximum(np.abs(smoothed), 1e-3))
        sign = np.sign(smoothed) if z[SMOOTHING_INDEX] > 0.5 else 1.0
        seen = seen * (sign * np.exp(1j * order * z[1] + fade * z[SMOOTHING_INDEX]))[:, None]
        return order, seen, fade

    def is_improbable(self, cost: float) -> bool:
        """Whether noise alone hardly leaves so large a sum of squares."""
        return not stats.chi2.sf(cost, 2 * self.order.size - SMOOTHING_INDEX) > _IMPROBABLE

    def find_error(self, z: FloatArray) -> bool:
        """Take up an error in step with the load's turn, if the residual shows one; say whether it did."""
        residual = self.residual(z)
        if self.error_order or stats.chi2.sf(residual @ residual, residual.size - SIZE) > _SUSPECT:
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

    def subtract_belt_bias(self, z: FloatArray, lines: Sequence[tuple[float, float]]) -> bool:
        """Take off what errors out of step with the turn (a belt's) do to the mean turn; say whether there are any.

        They pull the teeth apart sooner here and later there: on average that is no zero, but grows with their square.
        How large they are, the sinusoids tell that they leave in the speed.
        """
        subtracted = False
        for order, amplitude in lines:
            batch = np.repeat(z[None], 5, axis=0)
            batch[range(4), [_ERROR.start] * 2 + [_ERROR.start + 1] * 2] += np.array([1.0, -1.0, 1.0, -1.0])
            turns = settled_turns(rows_of(batch), self.movement, order, self.lead, self.differencing)
            wave = np.exp(-2j * np.pi * order * np.arange(turns.shape[1]) / turns.shape[1])
            response = ((turns[2] - turns[3]) + 1j * (turns[0] - turns[1])) / 2
            size = amplitude / max(abs((response * wave).mean()), 1e-9)
            if size < ERROR_PRIOR:
                mean = size**2 * (turns[:4].mean(axis=0) - turns[4])
                self.target = self.target - self._logged(mean[None], z)[0]
                subtracted = True
        return subtracted

    def _gain(self, z: FloatArray, residual: FloatArray, slopes: FloatArray, order: int) -> float:
        """By how much chi squared falls if the two parts of an error are let free."""
        batch = np.repeat(z[None], 2, axis=0)
        batch[[0, 1], [_ERROR.start, _ERROR.start + 1]] += _ERROR_STEP
        data = slice(0, 2 * self.order.size)
        moved = self._whitened(self._measured(batch, order) - self.target)
        columns = np.zeros((2, residual.size))
        columns[:, data] = (moved - residual[data]) / _ERROR_STEP
        onto = np.linalg.solve(slopes @ slopes.T, slopes @ columns.T)
        columns -= onto.T @ slopes
        along = columns @ residual
        return float(along @ np.linalg.solve(columns @ columns.T + np.diag(SD[_ERROR] ** -2.0), along))

    def drop_outlier(self, z: FloatArray) -> bool:
        """Leave out the harmonic that fits worst, if noise can't explain it; say whether there was one."""
        data = self.residual(z)[: 2 * self.order.size].reshape(2, -1)
        square = (data**2).sum(axis=0) / 2
        square /= max(1.0, float(np.median(square)) / np.log(2))
        worst = int(square.argmax())
        if self.order.size * np.exp(-square[worst]) > _OUTLIER:
            return False
        kept = np.arange(self.order.size) != worst
        self.order, self.sd, self.target = (a[kept] for a in (self.order, self.sd, self.target))
        return True
