"""A record as the Fourier coefficients of its mean turn, with the noise that the record itself shows in each.

What repeats itself from turn to turn lies at the harmonics of the turn; between them lies noise alone, of whatever
colour. Nothing is lost against the samples, and a few dozen numbers are left of thousands.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.signal import czt

from replication.datasets import FloatArray, Recording
from replication.methods.waveform import settled

# Harmonics above this share of half the sampling rate, or above this frequency, are left out.
_OF_NYQUIST, _FASTEST_HZ = 0.9, 225.0

# Orders of the motor's turn at which torque ripples and encoders err: once and twice a turn, and with the phases.
MOTOR_ORDERS = (1, 2, 6)

# Sinusoids that are taken off, and how far above the noise around them they must be: in noise alone, one log in a
# thousand has one.
_MOST_LINES, _HIGH_LINE = 3, 14.0

# No joint is simulated better than to this share of its signal; only records without noise come near it.
MODEL_ERROR = 0.01

# Where joints of this kind ring.
_RING_HZ = (5.0, 60.0)

# Phases at which turns are compared, and how improbable in noise alone the ring of a turn is that is left out.
_PHASES, _CHANCE_OF_TRANSIENT = 256, 1e-3

# Harmonics to either side of one whose surroundings tell its noise.
_NEIGHBOURS = 3


@dataclass(frozen=True, eq=False)
class TurnHarmonics:
    """The mean settled turn of a record: arrays of shape (harmonics,), without the first order and the motor's own."""

    order: NDArray[np.int64]  # periods a turn
    coefficient: NDArray[np.complex128]  # of exp(i order angle), the angle 0 where the record begins [rps]
    sd: FloatArray  # noise in each of its parts, or the model's error where that is larger [rps]
    sample_rms_rps: float  # of a sample's noise in the band of the harmonics
    turns: int  # settled turns averaged
    ring_noise_ratio: (
        float  # noise in the ring's band over that above it, about 1 where turns repeat or nothing is noisy
    )
    is_quiet: bool  # there is hardly any noise: `sd` is mostly the model's error
    lines: tuple[tuple[float, float], ...]  # sinusoids taken off: periods a turn, and amplitude [rps]


def turn_harmonics(recording: Recording) -> TurnHarmonics:
    """Average a record's settled turns in the frequency domain; refuse it where too short, coarse or still."""
    dt, period = recording.sample_s, recording.turn_period_s
    phase, v = _without_transient(*settled(recording), period)
    turns = int((phase[-1] - phase[0]) + dt / period + 1e-6)
    if turns < 2 or period < 16 * dt:
        raise ValueError(
            f"{recording.source}: {turns} settled turns at {period / dt:.0f} samples a turn; two turns and 16 samples "
            "in each are needed"
        )
    count = int(turns * period / dt + 0.5)
    phase, v = phase[:count], v[:count]
    v = v - v.mean()
    if not v.any():
        raise ValueError(f"{recording.source}: the speed does not vary")
    last = int(min(_OF_NYQUIST * 0.5 / dt, _FASTEST_HZ) * period)
    order = np.arange(2, last + 1)
    bins, between = _spectrum(v, turns, last, turns * period / dt)
    lines = []
    for _ in range(_MOST_LINES):
        line = _clearest_sinusoid(v, bins, between, turns, dt / period)
        if line is None:
            break
        wave, *found = line
        v = v - wave
        lines.append(tuple(found))
        bins, between = _spectrum(v, turns, last, turns * period / dt)
    variance = np.array([_noise_near(between, k, turns) for k in order])
    order_kept = ~np.isin(order, _motor_harmonics(recording, last))
    noise, model = np.sqrt(variance)[order_kept], MODEL_ERROR * v.std() / (2 * np.sqrt(order.size))
    quiet = bool(np.median(noise) < model)
    start = np.exp(-2j * np.pi * order * phase[0])
    return TurnHarmonics(
        order[order_kept],
        (bins[turns * order] * start)[order_kept],
        np.maximum(noise, model),
        float(np.sqrt(2 * count * _noise_floor(between, turns, last))),
        turns,
        1.0 if quiet else _ring_noise_ratio(between, turns, period),
        quiet,
        tuple(lines),
    )


def _without_transient(phase: FloatArray, v: FloatArray, period: float) -> tuple[FloatArray, FloatArray]:
    """Leave out first turns that ring as the later half of them does not, up to half of them."""
    turns = int(phase[-1] - phase[0] + 1e-6)
    later = turns // 2
    if later < 2:
        return phase, v
    even = np.arange(turns)[:, None] + np.arange(_PHASES) / _PHASES
    low, high = (max(int(edge * period), 1) for edge in _RING_HZ)
    ring = np.fft.rfft(np.interp(phase[0] + even, phase, v), axis=1)[:, low : min(high, _PHASES // 2) + 1]
    power = (np.abs(ring - ring[-later:].mean(axis=0)) ** 2).sum(axis=1)
    # Two degrees of freedom a harmonic; the later turns' own mean takes one turn's.
    expected = power[-later:].sum() / (later - 1)
    limit = expected * stats.f.isf(_CHANCE_OF_TRANSIENT, 2 * ring.shape[1], 2 * ring.shape[1] * (later - 1))
    loud = np.flatnonzero(power[: turns - later] > limit)
    first = loud[-1] + 1 if loud.size else 0
    kept = phase >= phase[0] + first - 1e-9
    return phase[kept], v[kept]


def _spectrum(v: FloatArray, turns: int, last: int, samples: float) -> tuple[NDArray[np.complex128], FloatArray]:
    """Fourier coefficients `turns` to a harmonic, and half their squares between the harmonics (NaN at them)."""
    bins = czt(v, (last + 1) * turns, np.exp(-2j * np.pi / samples)) / v.size
    between = np.abs(bins) ** 2 / 2
    between[::turns] = np.nan
    return bins, between


def _clearest_sinusoid(
    v: FloatArray, bins, between: FloatArray, turns: int, step: float
) -> tuple[FloatArray, float, float] | None:
    """The clearest sinusoid that is no harmonic of the turn, its order and amplitude; None if there is none.

    A belt or a fan: it leaks into the harmonics beside it.
    """
    floor = np.nanmedian(between) / np.log(2)
    around = np.convolve(np.nan_to_num(between), np.ones(6 * turns + 1), mode="same") / (6 * (turns - 1))
    height = between / np.maximum(around, floor)
    peak = int(np.nanargmax(height))
    if height[peak] < _HIGH_LINE:
        return None
    phase = 2 * np.pi * step * np.arange(v.size)
    order = np.arange(1, bins.size // turns)
    beside = np.abs(order - peak / turns) < 1.5  # not told from the line by the coefficients alone
    others = order[~beside]
    rest = v - 2 * np.real(np.exp(1j * np.outer(phase, others)) @ bins[turns * others])
    fixed = np.exp(1j * np.outer(phase, order[beside]))
    best = (np.inf, np.zeros_like(v), 0.0, 0.0)
    for tried in (peak + np.linspace(-0.9, 0.9, 19)) / turns:
        wave = np.exp(1j * tried * phase)
        basis = np.column_stack([wave.real, wave.imag, fixed.real, fixed.imag])
        found, *_ = np.linalg.lstsq(basis, rest, rcond=None)
        misfit = float(((rest - basis @ found) ** 2).sum())
        sine = basis[:, :2] @ found[:2], float(tried), float(np.hypot(*found[:2]))
        best = min(best, (misfit, *sine), key=lambda one: one[0])
    return best[1:]


def _noise_near(between: FloatArray, order: int, turns: int) -> float:
    """Variance of the noise in each part of a harmonic: the mean between the harmonics around it."""
    near = between[max((order - _NEIGHBOURS) * turns, turns) : (order + _NEIGHBOURS) * turns + 1]
    return float(np.nanmean(near))


def _noise_floor(between: FloatArray, turns: int, last: int) -> float:
    """Variance of the noise in each part of a coefficient in the upper half of the band: median, so free of lines."""
    return float(np.nanmedian(between[last * turns // 2 :]) / np.log(2))


def _ring_noise_ratio(between: FloatArray, turns: int, period: float) -> float:
    first, end = (int(edge * period) * turns for edge in _RING_HZ)
    if end >= between.size:
        return 1.0  # sampled so coarsely that there is nothing above the ring to compare with
    return float(np.nanmedian(between[max(first, turns) : end]) / np.nanmedian(between[end:]))


def _motor_harmonics(recording: Recording, last: int) -> NDArray[np.int64]:
    """Harmonics of the turn at which the motor's orders appear, those above half the sampling rate folded down."""
    rate, period = 1 / recording.sample_s, recording.turn_period_s
    frequency = np.array(MOTOR_ORDERS) * recording.commanded_speed_rps
    seen = np.abs(frequency - rate * np.round(frequency / rate)) * period
    return np.rint(seen[seen <= last + 0.5]).astype(np.int64)
