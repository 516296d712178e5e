"""The mean turn of a record: its harmonics, the noise beside each of them, and the turn's period.

What repeats itself from turn to turn lies at the harmonics of the turn; between them lies noise alone, of whatever
colour.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import next_fast_len
from scipy.interpolate import CubicSpline
from scipy.ndimage import uniform_filter1d

from replication.records import Recording
from replication.signature import FloatArray

TURN = 2 * np.pi
ComplexArray = NDArray[np.complex128]

_BESIDE = 3  # harmonics to either side whose surroundings tell a harmonic's noise: some 70 numbers for 12 turns
_PERIOD_TOLERANCE = 0.005  # a gear ratio is exact; a load's turn that is given is read off a clock
_DRIFT_S = 2.5e-3  # over the record: a twentieth of a ring's period (21 Hz), which does not blur it
_OCTAVES = 3  # a wrong gear ratio is off by less than eight
# Amplitude over that of gravity's line; other lines of a torque are smaller than gravity's.
_DOMINATES = 3.0
LEAST_GRAVITY = 10.0  # in SDs of its line, once a turn, in the torque
_GRAVITYS_SHARE = 0.5  # of the torque's variance; a joint that turns round has more
_COMPARED_LINES = 6  # of odd and even turns
_PHASES = 512
_PARTS = 16  # of a turn, at one of which a record ends
# By which rounded periods, of sampling and of the turn, drift over a record at most: a twelfth of what blurs a ring.
_ROUNDED_S = 2e-4
_BETTER = 1.05  # energy of the mean turn by another period, over that by the one given


class Harmonics(NamedTuple):
    """Fourier coefficients of exp(i k angle) of the mean turn, k = 1, 2, ...; the angle is 0 where the turns begin."""

    order: NDArray[np.int64]
    omega: FloatArray  # [rad/s]
    coefficient: ComplexArray
    sd: FloatArray  # of the noise in the real and in the imaginary part


def is_to_and_fro(speed: FloatArray) -> bool:
    """Whether a motor moves one way and the other, rather than round."""
    return bool(-2 * speed.min() > speed.max() > -0.5 * speed.min())


def settled_turns(recording: Recording, signal: FloatArray) -> FloatArray:
    """Whole turns up to the record's end, without half a turn or more, in which a drive settles; (turns, phases).

    They are resampled, so that each has the same whole number of phases.
    """
    samples = recording.turn_period_s / recording.sample_s
    turns = int(signal.size / samples - 0.5)
    if turns < 1 or samples < 16:
        raise ValueError(
            f"{turns} settled turns of {samples:.0f} samples; one turn of 16 is needed"
        )
    phases = int(np.ceil(samples - 1e-3))
    places = signal.size - turns * samples + np.arange(turns * phases) * samples / phases
    # The last sample stands for the time to the next one, too.
    resampled = CubicSpline(np.arange(signal.size), signal)(np.minimum(places, signal.size - 1))
    return resampled.reshape(turns, phases)


def harmonics(recording: Recording, signal: FloatArray, fastest_hz: float) -> Harmonics:
    """Harmonics of the mean of two settled turns or more up to a frequency, or to 0.45 of the sampling rate."""
    rows = settled_turns(recording, signal)
    turns, y = len(rows), rows.ravel()
    drift = (rows[-1].mean() - rows[0].mean()) / (y.size - rows.shape[1])
    y = y - drift * np.arange(y.size)
    bins = np.fft.rfft(y) / y.size
    last = int(min(fastest_hz, 0.45 / recording.sample_s) * recording.turn_period_s)
    order = np.arange(1, last + 1)
    power = np.abs(bins[: bins.size // turns * turns].reshape(-1, turns)[:, 1:]) ** 2 / 2
    # Row k lies between harmonics k and k + 1.
    beside = uniform_filter1d(power.mean(axis=1), 2 * _BESIDE, mode="nearest")
    omega = np.asarray(TURN / recording.turn_period_s * order, dtype=float)
    return Harmonics(order, omega, bins[turns * order], np.sqrt(beside[order]))


def turn_phases(recording: Recording, end: int) -> FloatArray:
    """Phase of each sample in turns, 0 where the settled turns of a record that ends before one of them begin."""
    samples = recording.turn_period_s / recording.sample_s
    return (np.arange(recording.t.size) - end) / samples % 1.0


def end_by_gravity(recording: Recording, torque: FloatArray) -> tuple[Recording, FloatArray]:
    """The record up to where gravity's line last passes a sixteenth of a turn, with rounded periods; and the torque.

    So a log that begins or ends a sample later has the same mean turn.
    """
    drift = _ROUNDED_S / recording.t[-1]
    sample_s = float(round_to(recording.sample_s, drift * recording.sample_s))
    period = float(round_to(recording.turn_period_s, drift * recording.turn_period_s))
    t = np.arange(torque.size, dtype=float) * sample_s
    rounded = replace(recording, t=t, turn_period_s=period)
    turned = t[-1] / period + np.angle(gravity_by_turn(rounded, torque).mean()) / TURN
    end = torque.size - round(turned * _PARTS % 1.0 / _PARTS * period / sample_s)
    return replace(rounded, t=t[:end], v=recording.v[:end]), torque[:end]


def round_to(number: ArrayLike, error: ArrayLike) -> NDArray[Any]:
    """A number, to the power of two below an error."""
    unit = np.exp2(np.floor(np.log2(np.maximum(error, np.finfo(float).tiny))))
    return np.asarray(unit * np.round(number / unit))


def periodic(coefficient: ComplexArray, order: NDArray[np.int64], phase: FloatArray) -> FloatArray:
    """Sum of some harmonics at phases in turns."""
    wave = sum_harmonics(coefficient, order, 32 * int(order.max()))
    return np.interp(phase, np.arange(wave.size) / wave.size, wave, period=1.0)


def sum_harmonics(coefficient: ComplexArray, order: NDArray[np.int64], size: int) -> FloatArray:
    """Sum of some harmonics at even times."""
    grid = np.zeros(size // 2 + 1, dtype=complex)
    grid[order] = coefficient
    return np.asarray(np.fft.irfft(grid, size) * size)


def gravity_by_turn(recording: Recording, torque: FloatArray) -> ComplexArray:
    """Gravity's line of each whole turn, as the Fourier coefficient at once a turn."""
    angle = recording.t / recording.turn_period_s
    turn = angle.astype(np.int64)
    whole = turn < int(angle[-1] + 1e-3)
    wave = (torque - torque.mean()) * np.exp(-1j * TURN * angle)
    parts = [np.bincount(turn[whole], part[whole]) for part in (wave.real, wave.imag)]
    return np.asarray((parts[0] + 1j * parts[1]) / np.bincount(turn[whole]))


def odd_against_even(recording: Recording, torque: FloatArray) -> float:
    """By how much odd and even turns differ, in their first lines, over gravity's: what comes again in two turns."""
    lines = np.fft.rfft(settled_turns(recording, torque), axis=1)[:, 1 : _COMPARED_LINES + 1]
    # The last turns, an even number of them: a start that is not settled yet is in one of the two halves.
    lines = lines[len(lines) % 2 :]
    difference = lines[1::2].mean(axis=0) - lines[::2].mean(axis=0)
    return float(np.abs(difference).max() / np.abs(lines[:, 0].mean()))


def scatter_of_phase(recording: Recording, torque: FloatArray) -> float:
    """SD [s] of the times at which gravity's line comes, from turn to turn, a drift aside: of a clock that wanders."""
    phase = np.unwrap(np.angle(gravity_by_turn(recording, torque)[1:]))
    turn = np.arange(phase.size)
    residuals = phase - np.polyval(np.polyfit(turn, phase, 1), turn)
    return float(residuals.std() * recording.turn_period_s / TURN)


def period_by_torque(recording: Recording, torque: FloatArray) -> float:
    """The turn's period [s] near the one given, by the drift of the phase of gravity's line, if the torque has one."""
    lines = gravity_by_turn(recording, torque)
    turn = np.arange(lines.size)
    slope = np.polyfit(turn, np.unwrap(np.angle(lines)), 1)[0]
    aligned = lines * np.exp(-1j * slope * turn)
    if abs(aligned.mean()) < LEAST_GRAVITY * aligned.std() / np.sqrt(turn.size):
        return recording.turn_period_s
    return recording.turn_period_s / (1 + slope / TURN)


def dominant_period(recording: Recording, torque: FloatArray) -> float | None:
    """The period [s] of a line in the torque that is gravity's rather than the given turn's own; None without one."""
    given, window = recording.turn_period_s, np.hanning(torque.size)
    wave = (torque - torque.mean()) * window
    size = next_fast_len(8 * torque.size, real=True)
    hz = np.fft.rfftfreq(size, recording.sample_s)
    amplitude = 2 * np.abs(np.fft.rfft(wave, size)) / window.sum()
    lasts = torque.size * recording.sample_s
    own = amplitude[np.abs(hz - 1 / given) < 0.5 / lasts].max(initial=0.0)
    tried = (hz > max(2**-_OCTAVES / given, 2 / lasts)) & (hz < 2**_OCTAVES / given)
    best = np.flatnonzero(tried)[amplitude[tried].argmax()]
    least = max(_DOMINATES * own, np.sqrt(2 * _GRAVITYS_SHARE) * torque.std())
    if amplitude[best] <= least:
        return None
    return period_by_torque(replace(recording, turn_period_s=float(1 / hz[best])), torque)


def period_by_energy(recording: Recording, signal: FloatArray) -> float:
    """The turn's period [s] near the one given by which the mean turn has the most energy."""
    given = recording.turn_period_s
    reach = min(_PERIOD_TOLERANCE, 0.5 * given / recording.t[-1])
    tried = given * (1 + np.linspace(-reach, reach, 81))
    turns = int(recording.t[-1] / given)
    phases = np.arange(_PHASES) / _PHASES + np.arange(turns)[:, None]
    mean_turns = (np.interp(period * phases, recording.t, signal).mean(axis=0) for period in tried)
    energy = np.array([turn.var() for turn in mean_turns])
    best = int(energy.argmax())
    return float(tried[best]) if energy[best] > _BETTER * energy[tried.size // 2] else given


def is_same_period(recording: Recording, period_s: float) -> bool:
    """Whether turns of a period drift by too little to blur the record's own."""
    return abs(period_s / recording.turn_period_s - 1) * recording.t[-1] < _DRIFT_S


def is_near_period(recording: Recording, period_s: float) -> bool:
    """Whether a period may be the one given, read off a clock."""
    return abs(period_s / recording.turn_period_s - 1) < _PERIOD_TOLERANCE
