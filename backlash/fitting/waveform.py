"""The whole settled waveform of a turn as a measure of backlash, matched against waveforms of known backlash."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from replication.arrays import FloatArray
from replication.records import Recording

if TYPE_CHECKING:  # slow to import, and most logs need neither
    from scipy.interpolate import CubicSpline
    from scipy.optimize import OptimizeResult

# Each phase of aligned waveforms is a polynomial of the backlash. The fourth degree leaves 1e-6 rad
# on noise-free waveforms of Table 2's range, and averages the noise of logs that an interpolation
# would keep.
_MOST_DEGREE = 4
# Time constants [s] from which a low-pass is looked for, and by how many variances of the noise the
# sum of squares must fall for one: without a low-pass it does in one log of four hundred. It takes
# the noise of the bank's waveforms too.
_LOW_PASSES_S = (1e-3, 4e-3)
_LEAST_GAIN = 8.0
LEAST_LEVELS = 6


def periodic(turn: NDArray[np.floating]) -> "CubicSpline":
    """Interpolate a turn at even phases from 0, as a function of the phase in turns from 0 to 1."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(
        np.linspace(0.0, 1.0, turn.size + 1), np.append(turn, turn[0]), bc_type="periodic"
    )


@dataclass(frozen=True, eq=False)
class WaveformBank:
    """Settled waveforms of one joint at known backlashes, aligned with one another.

    The degree of the polynomials grows with the levels, so that leaving one out tells how good they
    are: 2 for six, 3 for seven or eight, 4 from nine on.
    """

    delta_rad: FloatArray  # increasing, shape (levels,)
    waveform_rps: FloatArray  # less its mean, at even phases from 0, shape (levels, phases)
    left_out: int = 0  # levels, which count for the degree

    @property
    def _degree(self) -> int:
        return min(_MOST_DEGREE, (self.delta_rad.size + self.left_out - 1) // 2)

    @cached_property
    def _coefficients(self) -> FloatArray:
        return np.asarray(
            chebyshev.chebfit(self._position(self.delta_rad), self.waveform_rps, self._degree),
            dtype=float,
        )

    @cached_property
    def noise_rps2(self) -> float:
        """Variance of the noise that is left of the waveforms in the polynomials."""
        fitted = chebyshev.chebval(self._position(self.delta_rad), self._coefficients)
        levels, used = self.delta_rad.size, self._degree + 1
        return float(
            ((self.waveform_rps - fitted.T) ** 2).mean() * levels / (levels - used) * used / levels
        )

    def _position(self, delta_rad: ArrayLike) -> FloatArray:
        """Backlash on the scale of -1 to 1 over the bank."""
        return 2 * (np.asarray(delta_rad) - self.delta_rad[0]) / self.span_rad - 1

    @property
    def span_rad(self) -> float:
        """From the first to the last backlash [rad]."""
        return float(self.delta_rad[-1] - self.delta_rad[0])

    def at(self, delta_rad: float, low_pass: float = 0.0) -> "CubicSpline":
        """Waveform [rps] at a backlash, as a periodic spline of the phase in turns.

        `low_pass` is the square of its time constant [turns^2].
        """
        values = chebyshev.chebval(self._position(delta_rad), self._coefficients)
        return periodic(low_passed(np.asarray(values, dtype=float), low_pass))

    def without(self, level: int) -> "WaveformBank":
        """Return the bank without one of its levels, by position."""
        delta_rad, waveform_rps = (
            np.delete(self.delta_rad, level),
            np.delete(self.waveform_rps, level, axis=0),
        )
        return WaveformBank(delta_rad, waveform_rps, self.left_out + 1)


@dataclass(frozen=True)
class WaveformMatch:
    """A record matched against a bank; the 95 % interval holds if the bank is right and the noise white."""

    delta_rad: float
    interval_rad: tuple[float, float]
    shift_turns: float  # phase of the record against the bank, 0 to 1
    at_end: bool  # the backlash is the bank's first or last
    low_pass_s: float  # time constant of a low-pass that the bank's logs did not have; 0 for none


def drop_first_turn(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """Return phase [turns] and speed [rps] of a record without its first turn, if it has three or more."""
    t, v = recording.t - recording.t[0], recording.v
    turns = t / recording.turn_period_s
    kept = turns > 1 - 1e-9 if turns[-1] > 3 - 2 / t.size else turns >= 0
    return turns[kept], v[kept]


def samples_a_turn(recording: Recording) -> int:
    """Whole samples in a turn of a record."""
    return int(
        (recording.t.size - 1) * recording.turn_period_s / (recording.t[-1] - recording.t[0]) + 1e-6
    )


def mean_turn(recording: Recording, phases: int) -> FloatArray:
    """Mean settled turn of a record less its mean [rps], at `phases` even phases from 0; empty ones interpolated."""
    turns, v = drop_first_turn(recording)
    dt = (turns[-1] - turns[0]) / (turns.size - 1)
    if turns[-1] - turns[0] < 1 - 1.5 * dt or dt * phases > 1 + 1e-6:
        raise ValueError(
            f"{recording.source}: {turns[-1] - turns[0]:.2f} turns at {1 / dt:.0f} samples a turn; "
            f"one turn and {phases} samples in it are needed"
        )
    bins = np.rint(turns * phases).astype(np.int64) % phases
    count = np.bincount(bins, minlength=phases)
    filled = np.flatnonzero(count)
    mean = np.bincount(bins, v, minlength=phases)[filled] / count[filled]
    turn = np.interp(np.arange(phases), filled, mean, period=phases)
    return turn - turn.mean()


def delayed(waveform: FloatArray, turns: float) -> FloatArray:
    """Delay a periodic waveform by a part of a turn, band-limited."""
    harmonics = np.arange(waveform.size // 2 + 1)
    return np.fft.irfft(
        np.fft.rfft(waveform) * np.exp(-2j * np.pi * harmonics * turns), waveform.size
    )


def low_passed(waveform: FloatArray, low_pass: float) -> FloatArray:
    """Take a periodic waveform through a first-order low-pass, its delay taken out; see `WaveformBank.at`."""
    if low_pass <= 0:
        return waveform
    lag = 2j * np.pi * np.sqrt(low_pass) * np.arange(waveform.size // 2 + 1)
    return np.fft.irfft(np.fft.rfft(waveform) * np.exp(lag) / (1 + lag), waveform.size)


def _best_shift(waveforms: FloatArray, turn: FloatArray) -> tuple[int, float]:
    """Row of `waveforms` and delay [turns] that come nearest to a turn; between phases by a parabola."""
    spectrum = np.fft.rfft(turn) * np.conj(np.fft.rfft(waveforms, axis=-1))
    misfit = (waveforms**2).sum(axis=-1)[:, None] - 2 * np.fft.irfft(spectrum, turn.size, axis=-1)
    row, shift = np.unravel_index(misfit.argmin(), misfit.shape)
    before, here, after = misfit[row, [shift - 1, shift, (shift + 1) % turn.size]]
    curvature = before - 2 * here + after
    between = (before - after) / (2 * curvature) if curvature > 0 else 0.0
    return int(row), float((shift + between) / turn.size)


def make_bank(delta_rad: Sequence[float], turns_rps: Sequence[FloatArray]) -> WaveformBank:
    """Align waveforms (from `mean_turn`, at any phase) of known backlash; those of one backlash are averaged."""
    order = np.argsort(delta_rad, kind="stable")
    aligned: dict[float, list[FloatArray]] = {}
    for k in order:
        turn = np.asarray(turns_rps[k])
        if aligned:
            last = np.mean(next(reversed(aligned.values())), axis=0)
            turn = delayed(turn, -_best_shift(last[None, :], turn)[1])
        aligned.setdefault(float(delta_rad[k]), []).append(turn)
    return WaveformBank(
        np.array(list(aligned)), np.array([np.mean(turns, axis=0) for turns in aligned.values()])
    )


def match(recording: Recording, bank: WaveformBank, low_pass: bool = False) -> WaveformMatch:
    """Find the backlash and the phase at which a bank's waveform comes nearest to a record's settled turns.

    With `low_pass` one that the bank's logs did not have is looked for, and taken where the misfit
    falls by more than it makes of noise alone. That is for a bank of the log's own joint: another
    joint's misfit would pass for one.
    """
    turns, _ = drop_first_turn(recording)
    plain = found = _match_from(recording, bank, 0.0)
    if low_pass:
        starts = [(time_constant / recording.turn_period_s) ** 2 for time_constant in _LOW_PASSES_S]
        best = min(
            (_match_from(recording, bank, start) for start in starts), key=lambda each: each.cost
        )
        gain = 2 * (plain.cost - best.cost) - turns.size * bank.noise_rps2
        if gain > _LEAST_GAIN * 2 * best.cost / turns.size:
            found = best
    variance = (
        2
        * found.cost
        / max(turns.size - 1 - found.x.size, 1)
        * np.linalg.pinv(found.jac.T @ found.jac)[0, 0]
    )
    delta = bank.delta_rad[0] + bank.span_rad * found.x[0]
    half_width = 1.96 * bank.span_rad * np.sqrt(variance)
    return WaveformMatch(
        delta_rad=float(delta),
        interval_rad=(float(delta - half_width), float(delta + half_width)),
        shift_turns=float(found.x[1] % 1.0),
        at_end=bool(min(found.x[0], 1 - found.x[0]) < 1e-6),
        low_pass_s=float(recording.turn_period_s * np.sqrt(found.x[2:].sum())),
    )


def _match_from(recording: Recording, bank: WaveformBank, low_pass: float) -> "OptimizeResult":
    """Least squares in the place in the bank, the phase and, unless it is 0, the low-pass to start from."""
    from scipy.optimize import least_squares

    turns, v = drop_first_turn(recording)
    phases = min(max(samples_a_turn(recording), 16), bank.waveform_rps.shape[1])
    grid = np.linspace(0.0, 1.0, phases, endpoint=False)
    fine = np.linspace(bank.delta_rad[0], bank.delta_rad[-1], 4 * bank.delta_rad.size)
    candidates = np.array([bank.at(delta, low_pass)(grid) for delta in fine])
    row, shift = _best_shift(candidates, mean_turn(recording, phases))
    place = np.clip((fine[row] - bank.delta_rad[0]) / bank.span_rad, 1e-9, 1 - 1e-9)
    start = [place, shift]
    least = [0.0, -1.0]
    most = [1.0, 2.0]
    scale = [1.0, 0.1]
    if low_pass > 0:
        start.append(low_pass)
        least.append(0.0)
        most.append(4 * _LOW_PASSES_S[-1] ** 2 / recording.turn_period_s**2)
        scale.append(max(low_pass, 1.0))
    centred = v - v.mean()

    def residual(x: FloatArray) -> FloatArray:
        place, shift, *filtered = x
        delta = bank.delta_rad[0] + bank.span_rad * place
        wave = bank.at(delta, *filtered)((turns - shift) % 1.0)
        return wave - wave.mean() - centred

    return least_squares(
        residual, start, jac="3-point", bounds=(least, most), x_scale=scale, xtol=1e-12
    )
