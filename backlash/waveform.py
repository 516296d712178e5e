"""Method "waveform": the mean turn of a record matched against mean turns of the same joint at known backlashes.

Each harmonic of the aligned calibration turns is a polynomial of the backlash. Backlash, phase and, for a joint's own
calibration, a low-pass that its logs did not have are fitted to the harmonics of the record's mean turn.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from backlash.turns import TURN, ComplexArray, Harmonics, harmonics
from replication.records import Recording
from replication.signature import FloatArray

LEAST_LEVELS = 6
FASTEST_HZ = 100.0  # of the harmonics that are matched: five times the paper's ring
# A fourth degree leaves 1e-6 rad on noise-free waveforms of Table 2's range.
_MOST_DEGREE = 4
_MODEL_ERROR = 0.01  # of the turn's RMS: what the identified joint leaves of the authors' records
_LOW_PASSES_S = (1e-3, 4e-3)  # time constants from which one is looked for
# Of chi squared, for a low-pass to be taken: by chance in one log of four hundred.
_LEAST_GAIN = 8.0


@dataclass(frozen=True, eq=False)
class WaveformBank:
    """Harmonics of the mean turn of one joint at known backlashes, in phase with one another.

    The degree of the polynomials grows with the levels, so that leaving one out tells how good they are: 2 for six, 3
    for seven or eight, 4 from nine on.
    """

    delta_rad: FloatArray  # increasing, shape (levels,)
    harmonics_rps: ComplexArray  # from order 1, shape (levels, orders)
    left_out: int = 0  # levels, which count for the degree

    @cached_property
    def _coefficients(self) -> ComplexArray:
        degree = min(_MOST_DEGREE, (self.delta_rad.size + self.left_out - 1) // 2)
        fit = chebyshev.chebfit(self._place(self.delta_rad), self.harmonics_rps, degree)
        return np.asarray(fit, dtype=complex)

    def _place(self, delta_rad: ArrayLike) -> FloatArray:
        """Backlash on the scale of -1 to 1 over the bank."""
        low, high = self.delta_rad[[0, -1]]
        return (2 * np.asarray(delta_rad) - low - high) / (high - low)

    def at(self, delta_rad: float) -> ComplexArray:
        """Harmonics of the turn at a backlash."""
        return np.asarray(chebyshev.chebval(self._place(delta_rad), self._coefficients))

    def without(self, level: int) -> "WaveformBank":
        """The bank without one of its levels, by position."""
        delta = np.delete(self.delta_rad, level)
        return WaveformBank(delta, np.delete(self.harmonics_rps, level, axis=0), self.left_out + 1)


@dataclass(frozen=True)
class WaveformMatch:
    """A record matched against a bank."""

    delta_rad: float
    sd_rad: float  # by the record's noise and the misfit
    at_end: bool  # the backlash is the bank's first or last
    explained: float  # share of the turn's energy, gravity's line apart, that the bank explains
    chi_squared: float  # per number
    model: Harmonics  # of the bank at that backlash


def low_passed(order: ArrayLike, low_pass: float) -> ComplexArray:
    """Response of a first-order low-pass at some orders without its delay; `low_pass` is its time constant squared."""
    lag = 1j * TURN * np.sqrt(max(low_pass, 0.0)) * np.asarray(order)
    return np.asarray(np.exp(lag) / (1 + lag))


def make_bank(delta_rad: Sequence[float], turns_rps: Sequence[ComplexArray]) -> WaveformBank:
    """Align harmonics of mean turns of known backlash, at any phase; those of one backlash are averaged."""
    orders = min(turn.size for turn in turns_rps)
    aligned: dict[float, list[ComplexArray]] = {}
    for k in np.argsort(delta_rad, kind="stable"):
        turn = turns_rps[k][:orders]
        if aligned:
            last = np.mean(next(reversed(aligned.values())), axis=0)
            turn = _delayed(turn, -_best_delay(last, turn))
        aligned.setdefault(float(delta_rad[k]), []).append(turn)
    levels = [np.mean(turns, axis=0) for turns in aligned.values()]
    return WaveformBank(np.array(list(aligned)), np.array(levels))


def _delayed(turn: ComplexArray, delay: float) -> ComplexArray:
    """Harmonics of a turn later by a share of it."""
    return turn * np.exp(-1j * TURN * delay * np.arange(1, turn.size + 1))


def _best_delay(model: ComplexArray, seen: ComplexArray) -> float:
    """By how many turns a turn is later than a model, from their harmonics, by the largest correlation."""
    correlation = np.fft.irfft(np.append(0, seen * np.conj(model)), 4096)
    k = int(correlation.argmax())
    before, here, after = correlation[[k - 1, k, (k + 1) % correlation.size]]
    bend = 2 * here - before - after
    return float((k + (after - before) / (2 * bend if bend > 0 else np.inf)) / correlation.size)


def match(recording: Recording, bank: WaveformBank, is_own: bool = False) -> WaveformMatch:
    """Find the backlash at which a bank comes nearest to a record's mean turn.

    Where the bank `is_own`, of the record's joint, a low-pass is looked for too; another joint's misfit would pass for
    one.
    """
    seen = harmonics(recording, recording.v, FASTEST_HZ)
    used = min(seen.order.size, bank.harmonics_rps.shape[1])
    seen = Harmonics._make(part[:used] for part in seen)
    size = np.linalg.norm(seen.coefficient)
    # The mean turn's noise, and what no model of a joint explains.
    sd = np.hypot(seen.sd, _MODEL_ERROR * size / np.sqrt(2 * used))
    low, high = bank.delta_rad[[0, -1]]

    def model(place: float, delay: float, low_pass: float = 0.0) -> ComplexArray:
        wave = _delayed(bank.at(low + place * (high - low))[:used], delay)
        return wave * low_passed(seen.order, low_pass)

    def residuals(unknowns: FloatArray) -> FloatArray:
        left = (model(*unknowns) - seen.coefficient) / sd
        return np.concatenate([left.real, left.imag])

    places = np.linspace(0.01, 0.99, 4 * bank.delta_rad.size)
    starts = [(place, _best_delay(model(place, 0.0), seen.coefficient)) for place in places]
    start = min(starts, key=lambda each: float(np.square(residuals(np.array(each))).sum()))
    fits = [least_squares(residuals, start, bounds=([0, -1], [1, 2]), x_scale=[1.0, 0.1])]
    for seconds in _LOW_PASSES_S if is_own else ():
        first = (seconds / recording.turn_period_s) ** 2
        bounds = ([0, -1, 0], [1, 2, 64 * first])
        begin, scale = (*fits[0].x, first), [1.0, 0.1, first]
        fits.append(least_squares(residuals, begin, bounds=bounds, x_scale=scale))
    fit = min(fits, key=lambda each: float(each.cost) + (each.x.size > 2) * _LEAST_GAIN / 2)
    chi_squared = 2 * fit.cost / (2 * used - fit.x.size)
    variance = max(chi_squared, 1.0) * np.linalg.pinv(fit.jac.T @ fit.jac)[0, 0]
    best = model(*fit.x)
    ring = slice(1, None)  # gravity moves the speed once a turn, with or without backlash
    noise = 2 * np.square(seen.sd[ring]).sum()
    left = np.square(np.abs(best - seen.coefficient)[ring]).sum() - noise
    energy = np.square(np.abs(seen.coefficient)[ring]).sum() - noise
    return WaveformMatch(
        delta_rad=float(low + fit.x[0] * (high - low)),
        sd_rad=float((high - low) * np.sqrt(variance)),
        at_end=bool(min(fit.x[0], 1 - fit.x[0]) < 1e-6),
        explained=float(1 - max(left, 0.0) / energy) if energy > 0 else 0.0,
        chi_squared=float(chi_squared),
        model=seen._replace(coefficient=best),
    )
