"""What a log says of a joint: unknowns, their priors, and the whitened residuals of the mean turn's harmonics."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from replication.methods.harmonics import TurnHarmonics
from replication.simulator.checks import closed_loop_matrix
from replication.simulator.parameters import identified_joint, joint_from_ratios
from replication.simulator.turns import COLUMNS, Movement, settled_turns, settling_turns

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
# A torque ripple once a motor turn, over m g r / N in percent: SD of its two parts.
RIPPLE_PRIOR = 2.0

UNIT_RAD, _ERROR_RAD, _RIPPLE = 1e-4, 1e-5, 0.01
_RATIOS = slice(3, 3 + len(RATIO_PRIOR))
SMOOTHING = _RATIOS.stop
SIZE = SMOOTHING + 5
_ERROR, _RIPPLES = slice(SMOOTHING + 1, SMOOTHING + 3), slice(SMOOTHING + 3, SIZE)
MEAN = np.array([*np.zeros(SMOOTHING), _SEARCHED[0], *np.zeros(4)])
SD = np.array(
    [np.inf, np.inf, FRICTION_PRIOR, *RATIO_PRIOR.values(), _SEARCHED[1], *[ERROR_PRIOR] * 2, *[RIPPLE_PRIOR] * 2]
)
# Steps of the differences; phase and smoothing have slopes of their own.
_STEP = np.array([0.01, np.nan, 1e-3, *np.full(len(RATIO_PRIOR), 3e-3), np.nan, 0.05, 0.05, 0.1, 0.1])

UNKNOWNS = (
    "backlash", "phase", "friction", *RATIO_PRIOR, "smoothing", "error_sine", "error_cosine", "ripple_sine",
    "ripple_cosine",
)  # fmt: skip

# Transmission errors up to this frequency are looked for; one must be this improbable in noise alone, and
# the residual without it improbable too.
_FASTEST_ERROR_HZ, _CHANCE_OF_ERROR, _SUSPECT = 60.0, 0.01, 0.3
# A harmonic whose residual has a square this improbable, times their number, belongs to the machine, not the joint.
_OUTLIER = 1e-3
_IMPROBABLE = 1e-3
LEAST_BACKLASH = 0.01
# A simulated turn is settled where the ring of the start has decayed to exp(-5), after so many turns at most.
_SLOWEST_RING_HZ = 2.0
_DECAY, _MOST_TURNS = 5.0, 8


@lru_cache(maxsize=1)
def centre() -> dict[str, float]:
    """Ratios of the identified joint, the priors' medians."""
    return identified_joint().ratios


def rows_of(z: FloatArray) -> FloatArray:
    """Rows of `settled_turns` for unknowns of shape (joints, unknowns)."""
    ratios = centre()
    columns = {"delta_rad": np.maximum(z[:, 0], LEAST_BACKLASH) * UNIT_RAD, "friction": z[:, 2]}
    for k, name in enumerate(RATIO_PRIOR, start=3):
        columns[name] = ratios[name] * np.exp(z[:, k])
    columns["error_sine_rad"], columns["error_cosine_rad"] = (_ERROR_RAD * z[:, _ERROR]).T
    columns["ripple_sine"], columns["ripple_cosine"] = (_RIPPLE * z[:, _RIPPLES]).T
    zero = np.zeros(len(z))
    return np.stack([columns.get(name, zero) for name in COLUMNS], axis=1)


def ratios_of(z: FloatArray) -> dict[str, float]:
    """Ratios of a joint with these unknowns."""
    return centre() | {name: float(centre()[name] * np.exp(z[k])) for k, name in enumerate(RATIO_PRIOR, start=3)}


def contact_modes(ratios: dict[str, float], movement: Movement) -> NDArray[np.complex128]:
    """Oscillations of a joint with its teeth in contact [1/s], those above 2 Hz with a positive frequency."""
    joint = joint_from_ratios(ratios | {"lead_s": 0.0}, gear_ratio=movement.gear_ratio, speed_by_differencing=True)
    values = np.linalg.eigvals(closed_loop_matrix(joint)).astype(complex)
    modes = np.log(values[np.abs(values) > 0]) / joint.control_period_s
    return modes[modes.imag > 2 * np.pi * _SLOWEST_RING_HZ]


class Problem:
    """Weighted residuals of a record's harmonics and their slopes."""

    def __init__(self, harmonics: TurnHarmonics, movement: Movement, sample_s: float):
        self.movement, self.order, self.sd = movement, harmonics.order, harmonics.sd
        self.target = harmonics.coefficient
        self.fade = np.log(np.sinc(harmonics.order * sample_s / movement.turn_period_s))
        self.mean, self.spread = MEAN, SD
        self.error_order, self.lead = 0, settling_turns(movement)
        self.ripple, self.differencing = False, True
        self.evaluations = 0

    def settle(self, z: FloatArray) -> None:
        """Simulate as many turns from now on as this joint needs to ring no more."""
        least = settling_turns(self.movement)
        rates = -contact_modes(ratios_of(z), self.movement).real
        slowest = rates.min(initial=np.inf)
        needed = _DECAY / max(slowest, 1e-9) / self.movement.turn_period_s
        self.lead = int(np.clip(np.ceil(min(needed, _MOST_TURNS)), least, max(least, _MOST_TURNS)))

    def measured_as(self, smoothing: tuple[float, float]) -> None:
        """Take another prior of the smoothing, mean and SD."""
        self.mean, self.spread = MEAN.copy(), SD.copy()
        self.mean[SMOOTHING], self.spread[SMOOTHING] = smoothing
        self.differencing = smoothing[0] > 0.5

    def _spectra(self, z: FloatArray, error_order: int) -> NDArray[np.complex128]:
        turns = settled_turns(rows_of(z), self.movement, error_order, self.lead, self.differencing)
        self.evaluations += len(z)
        return np.fft.rfft(turns, axis=1)[:, self.order] / turns.shape[1]

    def _measured(self, z: FloatArray, error_order: int | None = None) -> NDArray[np.complex128]:
        spectra = self._spectra(z, self.error_order if error_order is None else error_order)
        return spectra * np.exp(1j * self.order * z[:, 1:2] + self.fade * z[:, SMOOTHING : SMOOTHING + 1])

    def _whitened(self, spectra: NDArray[np.complex128]) -> FloatArray:
        spectra = spectra / self.sd
        return np.concatenate([spectra.real, spectra.imag], axis=-1)

    def residual(self, z: FloatArray) -> FloatArray:
        """Data's and prior's residuals of one set of unknowns."""
        data = self._whitened(self._measured(z[None])[0] - self.target)
        return np.concatenate([data, ((z - self.mean) / self.spread)[2:]])

    def slopes(self, z: FloatArray, free: int) -> tuple[FloatArray, FloatArray]:
        """Residuals, and their derivative by each unknown, shape (unknowns, residuals); 0 from the one `free` on."""
        moved = [k for k in range(min(free, SMOOTHING)) if np.isfinite(_STEP[k])]
        if free == SIZE:
            moved += range(_ERROR.start, _ERROR.stop) if self.error_order else ()
            moved += range(_RIPPLES.start, _RIPPLES.stop) if self.ripple else ()
        batch = np.repeat(z[None], len(moved) + 1, axis=0)
        batch[np.arange(len(moved)), moved] += _STEP[moved]
        measured = self._measured(batch)
        here = measured[-1]
        out = np.zeros((SIZE, here.size), dtype=complex)
        out[moved] = (measured[:-1] - here) / _STEP[moved][:, None]
        out[1], out[SMOOTHING] = 1j * self.order * here, self.fade * here
        residual = np.concatenate([self._whitened(here - self.target), ((z - self.mean) / self.spread)[2:]])
        return residual, np.concatenate([self._whitened(out), np.diag(1 / self.spread)[:, 2:]], axis=1)

    def is_improbable(self, cost: float) -> bool:
        """Whether noise alone hardly leaves so large a sum of squares."""
        return not stats.chi2.sf(cost, 2 * self.order.size - SMOOTHING) > _IMPROBABLE

    def find_waves(self, z: FloatArray) -> bool:
        """Take up a ripple of the motor's turn or an error in step with the load's; say whether one was found."""
        residual, slopes = self.slopes(z, SIZE)
        if stats.chi2.sf(residual @ residual, residual.size - SIZE) > _SUSPECT:
            return False
        last = int(_FASTEST_ERROR_HZ * self.movement.turn_period_s)
        tried = {} if self.error_order else dict.fromkeys(range(2, last + 1), _ERROR)
        if not self.ripple:
            tried[0] = _RIPPLES
        gain = {order: self._gain(z, residual, slopes, order, part) for order, part in tried.items()}
        scale = max(1.0, float(residual @ residual) / residual.size)
        best = max(gain, key=lambda order: gain[order], default=-1)
        if best < 0 or len(tried) * np.exp(-gain[best] / scale / 2) > _CHANCE_OF_ERROR:
            return False
        if best == 0:
            self.ripple = True
        else:
            self.error_order = best
        return True

    def _gain(self, z: FloatArray, residual: FloatArray, slopes: FloatArray, order: int, part: slice) -> float:
        """By how much chi squared falls if the two parts of a wave are let free."""
        batch = np.repeat(z[None], 2, axis=0)
        batch[[0, 1], [part.start, part.start + 1]] += _STEP[part]
        data = slice(0, 2 * self.order.size)
        moved = self._whitened(self._measured(batch, order or None) - self.target)
        columns = np.zeros((2, residual.size))
        columns[:, data] = (moved - residual[data]) / _STEP[part][:, None]
        onto = np.linalg.solve(slopes @ slopes.T, slopes @ columns.T)
        columns -= onto.T @ slopes
        along = columns @ residual
        return float(along @ np.linalg.solve(columns @ columns.T + np.diag(SD[part] ** -2.0), along))

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
