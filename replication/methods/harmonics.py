"""A record as the Fourier coefficients of its mean turn, with the noise that the record itself shows in each.

What repeats itself from turn to turn lies at the harmonics of the turn; between them lies noise alone, of whatever
colour. Nothing is lost against the samples, and a few dozen numbers are left of thousands.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import czt

from replication.datasets import Recording
from replication.methods.waveform import settled

FloatArray = NDArray[np.float64]

# Harmonics above this share of half the sampling rate, or above this frequency, are left out.
_OF_NYQUIST, _FASTEST_HZ = 0.9, 225.0

# Orders of the motor's turn at which torque ripples and encoders err: once and twice a turn, and with the phases.
MOTOR_ORDERS = (1, 2, 6)

# Harmonics to either side of one whose surroundings tell its noise.
_NEIGHBOURS = 3


@dataclass(frozen=True, eq=False)
class TurnHarmonics:
    """The mean settled turn of a record.

    Attributes
    ----------
    order : array of shape (harmonics,)
        Periods a turn; once a turn and the motor's own orders are left out.
    coefficient : complex array of shape (harmonics,)
        Of exp(i order angle), the angle being 0 where the record begins [rps].
    sd : array of shape (harmonics,)
        SD of the noise in the real and in the imaginary part [rps].
    sample_rms_rps : float
        RMS of a sample's noise, in the band of the harmonics [rps].
    turns : int
        Settled turns averaged.
    """

    order: NDArray[np.int64]
    coefficient: NDArray[np.complex128]
    sd: FloatArray
    sample_rms_rps: float
    turns: int


def turn_harmonics(recording: Recording) -> TurnHarmonics:
    """Average a record's settled turns in the frequency domain.

    Parameters
    ----------
    recording : Recording
        Three turns or more; the first is left out.

    Returns
    -------
    TurnHarmonics

    Raises
    ------
    ValueError
        Fewer than three turns, or fewer than 16 samples in one.
    """
    dt, period = recording.sample_s, recording.turn_period_s
    phase, v = settled(recording)
    turns = int((phase[-1] - phase[0]) + dt / period + 1e-6)
    if turns < 2 or period < 16 * dt:
        raise ValueError(
            f"{recording.source}: {turns} settled turns at {period / dt:.0f} samples a turn; two turns and 16 samples "
            "in each are needed"
        )
    count = int(turns * period / dt + 0.5)
    phase, v = phase[:count], v[:count]
    v = v - v.mean()
    last = int(min(_OF_NYQUIST * 0.5 / dt, _FASTEST_HZ) * period)
    bins = czt(v, (last + 1) * turns, np.exp(-2j * np.pi * dt / (turns * period))) / v.size
    order = np.arange(2, last + 1)
    between = np.abs(bins) ** 2 / 2
    between[::turns] = np.nan
    variance = np.array([_noise(between, k, turns) for k in order])
    order_kept = ~np.isin(order, _motor_harmonics(recording, last))
    start = np.exp(-2j * np.pi * order * phase[0])
    return TurnHarmonics(
        order[order_kept],
        (bins[turns * order] * start)[order_kept],
        np.sqrt(variance)[order_kept],
        float(np.sqrt(2 * count * np.median(variance))),
        turns,
    )


def _noise(between: FloatArray, order: int, turns: int) -> float:
    """Variance of the noise in each part of a harmonic: the mean between the harmonics around it."""
    near = between[max((order - _NEIGHBOURS) * turns, turns) : (order + _NEIGHBOURS) * turns + 1]
    return float(np.nanmean(near))


def _motor_harmonics(recording: Recording, last: int) -> NDArray[np.int64]:
    """Harmonics of the turn at which the motor's orders appear, those above half the sampling rate folded down."""
    rate, period = 1 / recording.sample_s, recording.turn_period_s
    frequency = np.array(MOTOR_ORDERS) * recording.commanded_speed_rps
    seen = np.abs(frequency - rate * np.round(frequency / rate)) * period
    return np.rint(seen[seen <= last + 0.5]).astype(np.int64)
