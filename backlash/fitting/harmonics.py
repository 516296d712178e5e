"""A record as the Fourier coefficients of its mean turn, with the noise that the record itself shows in each.

What repeats itself from turn to turn lies at the harmonics of the turn; between them lies noise
alone, of whatever colour.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import fft, ifft, next_fast_len
from scipy.special import fdtri

from backlash.detection.pattern import MOTOR_ORDERS
from backlash.fitting.waveform import drop_first_turn
from replication.arrays import FloatArray
from replication.records import Recording

# Harmonics above this share of half the sampling rate, or above this frequency, are left out.
_OF_NYQUIST = 0.9
FASTEST_HZ = 225.0
# The ripple of the phases is modulated by the speed: so far to either side, above the ring,
# harmonics say more of it.
_SIDEBANDS_HZ = 40.0
# Sinusoids that are taken off, and how far above the noise around them they must be: in noise
# alone, one log in a thousand has one.
_MOST_LINES = 3
_HIGH_LINE = 14.0
# No joint is simulated better than to this share of its signal; only records without noise come
# near it.
MODEL_ERROR = 0.01
# Where joints of this kind ring.
RING_HZ = (5.0, 60.0)
# Phases at which turns are compared, and how improbable in noise alone the ring of a turn is that
# is left out.
_PHASES = 256
_CHANCE_OF_TRANSIENT = 1e-3
# How often noise alone may pass for gravity, whose part once a turn is evidence of a load that
# reverses: seldom enough for a plant of a thousand vertical axes.
CHANCE_OF_GRAVITY = 1e-4
# Harmonics to either side of one whose surroundings tell its noise.
_NEIGHBOURS = 3


class FirstOrder(NamedTuple):
    """What a record does once a turn, as gravity makes it [rps]."""

    coefficient: complex
    sd: float  # noise in each of its parts
    by_chance: float  # size that noise alone exceeds with the probability `CHANCE_OF_GRAVITY`


@dataclass(frozen=True, eq=False)
class TurnHarmonics:
    """The mean settled turn of a record: arrays of shape (harmonics,), without the first order and the motor's own."""

    first: FirstOrder

    order: NDArray[np.int64]  # periods a turn
    coefficient: NDArray[
        np.complex128
    ]  # of exp(i order angle), the angle 0 where the record begins [rps]
    sd: FloatArray  # noise in each of its parts, or the model's error where that is larger [rps]
    turns: int  # settled turns averaged
    # Noise in the ring's band over that above it, about 1 where turns repeat.
    ring_noise_ratio: float
    is_quiet: bool  # there is hardly any noise: `sd` is mostly the model's error


def turn_harmonics(recording: Recording) -> TurnHarmonics:
    """Average a record's settled turns in the frequency domain; refuse it where too short, coarse or still."""
    dt, period = recording.sample_s, recording.turn_period_s
    whole = drop_first_turn(recording)
    phase, v = _without_transient(*whole, period)
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
    last = int(min(_OF_NYQUIST * 0.5 / dt, FASTEST_HZ) * period)
    order = np.arange(2, last + 1)
    bins, between = spectrum(v, turns, last, turns * period / dt)
    for _ in range(_MOST_LINES):
        wave = _clearest_sinusoid(v, bins, between, turns, dt / period)
        if wave is None:
            break
        v = v - wave
        bins, between = spectrum(v, turns, last, turns * period / dt)
    model = MODEL_ERROR * v.std() / (2 * np.sqrt(order.size))
    hz, sixth_hz = order / period, MOTOR_ORDERS[-1] * recording.commanded_speed_rps
    modulated = (np.abs(hz - sixth_hz) < _SIDEBANDS_HZ) & (hz > RING_HZ[1])
    order = order[~np.isin(order, _motor_harmonics(recording, last)) & ~modulated]
    first = np.maximum((order - _NEIGHBOURS) * turns, turns)
    end = (order + _NEIGHBOURS) * turns + 1
    noise = np.sqrt([np.nanmean(between[low:high]) for low, high in zip(first, end, strict=True)])
    quiet = bool(np.median(noise) < model)
    return TurnHarmonics(
        first=_first_order(*whole, dt / period),
        order=order,
        coefficient=bins[turns * order] * np.exp(-2j * np.pi * order * phase[0]),
        sd=np.maximum(noise, model),
        turns=turns,
        ring_noise_ratio=1.0 if quiet else _ring_noise_ratio(between, turns, period),
        is_quiet=quiet,
    )


def _first_order(phase: FloatArray, v: FloatArray, step: float) -> FirstOrder:
    turns = int(phase[-1] - phase[0] + step + 1e-6)
    v = v[: int(turns / step + 0.5)]
    # A drift is no noise: its rate is that from the first turn's mean to the last one's.
    turn = int(1 / step + 0.5)
    drift = (v[-turn:].mean() - v[:turn].mean()) / (v.size - turn) * np.arange(v.size)
    bins, between = spectrum(v - drift - (v - drift).mean(), turns, 2, turns / step)
    around = between[turns // 2 :]
    freedom = 2 * np.count_nonzero(np.isfinite(around))
    sd = np.sqrt(np.nanmean(around))
    most = sd * np.sqrt(2 * fdtri(2, freedom, 1 - CHANCE_OF_GRAVITY))
    return FirstOrder(bins[turns] * np.exp(-2j * np.pi * phase[0]), float(sd), float(most))


def _without_transient(
    phase: FloatArray, v: FloatArray, period: float
) -> tuple[FloatArray, FloatArray]:
    """Leave out first turns that ring as the later half of them does not, up to half of them."""
    turns = int(phase[-1] - phase[0] + 1e-6)
    later = turns // 2
    if later < 2:
        return phase, v
    even = np.arange(turns)[:, None] + np.arange(_PHASES) / _PHASES
    low, high = (max(int(edge * period), 1) for edge in RING_HZ)
    ring = np.fft.rfft(np.interp(phase[0] + even, phase, v), axis=1)[
        :, low : min(high, _PHASES // 2) + 1
    ]
    power = (np.abs(ring - ring[-later:].mean(axis=0)) ** 2).sum(axis=1)
    # Two degrees of freedom a harmonic; the later turns' own mean takes one turn's.
    expected = power[-later:].sum() / (later - 1)
    limit = expected * fdtri(
        2 * ring.shape[1], 2 * ring.shape[1] * (later - 1), 1 - _CHANCE_OF_TRANSIENT
    )
    loud = np.flatnonzero(power[: turns - later] > limit)
    first = loud[-1] + 1 if loud.size else 0
    kept = phase >= phase[0] + first - 1e-9
    return phase[kept], v[kept]


def spectrum(
    v: FloatArray, turns: int, last: int, samples: float
) -> tuple[NDArray[np.complex128], FloatArray]:
    """Fourier coefficients `turns` to a harmonic, and half their squares between the harmonics (NaN at them)."""
    bins = _chirp_z(v, (last + 1) * turns, samples) / v.size
    between = np.abs(bins) ** 2 / 2
    between[::turns] = np.nan
    return bins, between


def _chirp_z(v: NDArray[np.inexact], count: int, period: float) -> NDArray[np.complex128]:
    """Sums of v_n exp(-2 pi i k n / period) for the first k, by Bluestein's algorithm.

    `scipy.signal`, which has it too, takes half a second to import.
    """
    chirp = np.exp(1j * np.pi / period * np.arange(max(count, v.size)) ** 2)
    size = next_fast_len(count + v.size)
    kernel = np.zeros(size, dtype=complex)
    kernel[:count] = chirp[:count]
    kernel[1 - v.size :] = chirp[v.size - 1 : 0 : -1]
    product = fft(v / chirp[: v.size], size) * fft(kernel)
    return np.asarray(ifft(product)[:count] / chirp[:count])


def _clearest_sinusoid(
    v: FloatArray, bins: NDArray[np.complex128], between: FloatArray, turns: int, step: float
) -> FloatArray | None:
    """The clearest sinusoid (a belt, a fan) that is no harmonic of the turn, if any."""
    floor = np.nanmedian(between) / np.log(2)
    around = np.convolve(np.nan_to_num(between), np.ones(6 * turns + 1), mode="same") / (
        6 * (turns - 1)
    )
    height = between / np.maximum(around, floor)
    peak = int(np.nanargmax(height))
    if height[peak] < _HIGH_LINE:
        return None
    phase = 2 * np.pi * step * np.arange(v.size)
    order = np.arange(1, bins.size // turns)
    beside = np.abs(order - peak / turns) < 1.5  # not told from the line by the coefficients alone
    others = order[~beside]
    harmonics = np.zeros(order.size + 1, dtype=complex)
    harmonics[others] = bins[turns * others]
    rest = v - 2 * _chirp_z(harmonics.conj(), v.size, 1 / step).real
    fixed = np.exp(1j * np.outer(order[beside], phase))
    most, best = 0.0, None
    for tried in (peak + np.linspace(-0.9, 0.9, 19)) / turns:
        wave = np.exp(1j * tried * phase)
        basis = np.vstack([wave.real, wave.imag, fixed.real, fixed.imag])
        product = basis @ rest
        found = np.linalg.solve(basis @ basis.T, product)
        explained = float(found @ product)
        if explained > most:
            most = explained
            best = found[:2] @ basis[:2]
    return best


def _ring_noise_ratio(between: FloatArray, turns: int, period: float) -> float:
    first, end = (int(edge * period) * turns for edge in RING_HZ)
    if end >= between.size:
        return 1.0  # sampled so coarsely that there is nothing above the ring to compare with
    return float(np.nanmedian(between[max(first, turns) : end]) / np.nanmedian(between[end:]))


def _motor_harmonics(recording: Recording, last: int) -> NDArray[np.int64]:
    """Harmonics of the turn at which the motor's orders appear, those above half the sampling rate folded down."""
    rate, period = 1 / recording.sample_s, recording.turn_period_s
    frequency = np.array(MOTOR_ORDERS) * recording.commanded_speed_rps
    seen = np.abs(frequency - rate * np.round(frequency / rate)) * period
    return np.rint(seen[seen <= last + 0.5]).astype(np.int64)
