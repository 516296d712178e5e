"""Whether half turns of a record share a pattern as backlash makes it.

Backlash disturbs the speed once in each half of a load turn, with the opposite sign in the next
half (equation 6): the halves, each second one taken negative, add up; noise does not. Odd harmonics
of the turn count from the third, because gravity alone moves the speed once a turn, and from 5 Hz
to one and a half times Table 1's fastest oscillation.

The permutation test compares the energy of the sum with that under random signs of the half turns.
It holds whatever the noise's spectrum and distribution, as long as half turns are independent and
their noise is symmetric.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dst, idst
from scipy.special import gammaincinv

from backlash.detection.period import (
    FALSE_ALARMS,
    FASTEST_HZ,
    LEAST_HARMONICS,
    PERIOD_TOLERANCE,
    SLOWEST_HZ,
    fastest_hz,
    own_period,
)
from backlash.reading.prepare import Log
from backlash.refusals import Reason, Refusal
from replication.arrays import FloatArray
from replication.records import Recording

# Orders of the motor's turn at which torque ripples and encoders err: once and twice a turn, and
# with the phases.
MOTOR_ORDERS = (1, 2, 6)

ComplexArray = NDArray[np.complex128]

POWER = 0.95  # how often a pattern of the detectable energy is found
_NORMAL_POWER = 1.645  # its quantile
_PERMUTATIONS = 1999
_FILTERED_HZ = 1.3 * FASTEST_HZ  # what is above the band would leak into it with the slow part


@dataclass(frozen=True)
class Presence:
    """What the half turns of a record have in common; `pattern` has shape (2, harmonics)."""

    p_value: float  # how often random signs give as much energy
    has_same_sign: bool  # whether there is one with the same sign in both halves of a turn, as no signature has
    noise_rps: float  # RMS noise of a sample in the band, from the scatter between half turns
    # Energy, as `band_energy` counts it, that is found with probability `POWER`.
    detectable_rps2: float
    pattern: ComplexArray  # of the mean first and second half of a turn, the second negated [rps]

    @property
    def found(self) -> bool:
        """Whether there is a pattern, at the level `FALSE_ALARMS`."""
        return self.p_value <= FALSE_ALARMS


@dataclass(frozen=True, eq=False, kw_only=True)
class Detected(Log):
    """A log with what its half turns have in common; its turn period is the record's own."""

    presence: Presence


def _odd_harmonics(recording: Recording) -> NDArray[np.int64]:
    """Odd harmonics of a turn that the test looks at: those in the band that are not next to the motor's own."""
    period = recording.turn_period_s
    gear_ratio = recording.commanded_speed_rps * period
    last = fastest_hz(recording) * period
    odd = np.arange(3, max(int(last) + 1, 4), 2)
    beside_motor = np.abs(odd[:, None] - gear_ratio * np.array(MOTOR_ORDERS)) < 1
    return odd[(odd >= SLOWEST_HZ * period) & (odd <= last) & ~beside_motor.any(axis=1)]


def _coefficients(halves: FloatArray, harmonics: NDArray[np.int64]) -> ComplexArray:
    """Fourier coefficients of half turns (rows) at odd harmonics, without mean, slope and first harmonic."""
    phases = np.arange(halves.shape[1]) / halves.shape[1]
    slow = np.stack(
        [np.ones_like(phases), phases, np.cos(np.pi * phases), np.sin(np.pi * phases)], axis=1
    )
    basis, _ = np.linalg.qr(slow)
    quick = halves - (halves @ basis) @ basis.T
    return quick @ np.exp(-1j * np.pi * np.outer(phases, harmonics)) * (2 / phases.size)


def _mean_halves(rows: ComplexArray) -> ComplexArray:
    """Mean coefficients of the first halves of the turns, and of the second ones, one row each."""
    return np.stack([rows[::2].mean(axis=0), rows[1::2].mean(axis=0)])


def _half_turns(recording: Recording) -> FloatArray:
    """Whole half turns of a record less its mean [rps], each second one negated, shape (half turns, samples)."""
    dt = recording.sample_s
    half = recording.turn_period_s / 2
    phases = int(half / dt + 1e-6)
    count = int((recording.t[-1] - recording.t[0] + dt) / half + 1e-6)
    instants = recording.t[0] + half * (np.arange(count)[:, None] + np.arange(phases) / phases)
    v = _low_passed(recording.v - recording.v.mean(), dt)
    v = np.interp(instants, recording.t, v - _motor_lines(recording, v))
    return v * np.where(np.arange(count) % 2, -1.0, 1.0)[:, None]


def _low_passed(v: FloatArray, dt: float) -> FloatArray:
    """A speed after a Butterworth filter of sixth order, forward and backward; odd about its ends.

    By sines, for `scipy.signal` takes half a second to import.
    """
    line = np.linspace(v[0], v[-1], v.size)
    hz = np.arange(1, v.size - 1) / (2 * dt * (v.size - 1))
    slow = idst(dst((v - line)[1:-1], 1) / (1 + (hz / _FILTERED_HZ) ** 12), 1)
    return line + np.pad(slow, 1)


def _motor_lines(recording: Recording, v: FloatArray) -> FloatArray:
    """What the motor's own orders in the band leave in a speed: it would leak into the load's harmonics."""
    hz = np.array([order * recording.commanded_speed_rps for order in MOTOR_ORDERS])
    waves = np.exp(2j * np.pi * np.outer(recording.t, hz[hz < _FILTERED_HZ]))
    basis = np.hstack([waves.real, waves.imag])
    return basis @ np.linalg.lstsq(basis, v)[0] if basis.size else np.zeros_like(v)


def band_energy(half_turn: FloatArray, recording: Recording) -> float:
    """Energy of one half turn's pattern [rps^2] as the test of a record counts it: its squared coefficients' sum."""
    return float((np.abs(_coefficients(half_turn[None, :], _odd_harmonics(recording))) ** 2).sum())


def _signs(count: int, rng: np.random.Generator) -> FloatArray:
    """Rows of signs for the permutation test, the first all alike: every pattern if they are few, else random ones."""
    if 2 ** (count - 1) <= _PERMUTATIONS:
        bits = np.arange(2 ** (count - 1))[:, None] >> np.arange(count) & 1
        return np.where(bits, -1.0, 1.0)
    signs = np.ones((_PERMUTATIONS + 1, count))
    signs[1:] = rng.choice([-1.0, 1.0], size=(_PERMUTATIONS, count))
    return signs


def detect_pattern(log: Log, seed: int) -> Detected:
    """Test for a pattern, after correcting the turn period, with a note, to the record's own where they are near."""
    recording, notes = log.recording, log.notes
    given = recording.turn_period_s
    period = given if log.form.trust_period else own_period(recording)
    if period is not None and period != given:
        if abs(period / given - 1) > PERIOD_TOLERANCE:
            ratio = log.form.gear_ratio
            instead = (
                f"--gear-ratio {ratio * period / given:.4g}"
                if ratio
                else f"--turn-period {period:.4f}"
            )
            cure = f"is it {instead}? if the one given is right, --trust-period"
            raise Refusal(f"{_repeats(period, given, 4)}; {cure}", Reason.WRONG_PERIOD)
        notes += (f"{_repeats(period, given, 5)}: used that",)
        recording = replace(recording, turn_period_s=period)
    known = vars(log) | {"recording": recording, "notes": notes}
    return Detected(**known, presence=find_pattern(recording, seed))


def _repeats(period: float, given: float, digits: int) -> str:
    return f"the record repeats itself every {period:.{digits}f} s, not every {given:.{digits}f} s"


def find_pattern(recording: Recording, seed: int = 1) -> Presence:
    """Test whether half turns share a pattern in the band of a backlash's ring."""
    harmonics = _odd_harmonics(recording)
    if harmonics.size < LEAST_HARMONICS:
        raise Refusal(
            f"a turn of {recording.turn_period_s:.3g} s has no room for an oscillation",
            Reason.TOO_SHORT,
        )
    halves = _half_turns(recording)
    rows = _coefficients(halves, harmonics)
    signs = _signs(len(rows), np.random.default_rng(seed))
    energy = (np.abs(signs @ rows) ** 2).sum(axis=1) / len(rows) ** 2
    same_sign = (np.abs(rows[::2].sum(axis=0) - rows[1::2].sum(axis=0)) ** 2).sum() / len(rows) ** 2
    pattern = _mean_halves(rows)
    scatter = float((np.abs(rows - pattern[np.arange(len(rows)) % 2]) ** 2).sum()) / (len(rows) - 2)
    a_mean = scatter / len(rows)
    deviation = np.sqrt(a_mean / (2 * harmonics.size))
    threshold = max(float(np.quantile(energy, 1 - FALSE_ALARMS)), a_mean)
    return Presence(
        p_value=float(np.mean(energy >= energy[0] * (1 - 1e-12))),
        has_same_sign=bool(np.mean(energy >= same_sign * (1 - 1e-12)) <= FALSE_ALARMS),
        noise_rps=float(np.sqrt(scatter * halves.shape[1] / (4 * harmonics.size))),
        detectable_rps2=_detectable(threshold - a_mean, deviation, len(rows)),
        pattern=pattern,
    )


def _detectable(above: float, deviation: float, count: int) -> float:
    """Energy that is found with probability `POWER` [rps^2], from the threshold's height above the mean noise."""
    # Random signs leave some of a pattern in the threshold: at most its energy over `count`, times
    # this quantile.
    left = 1 - 2 * gammaincinv(0.5, 1 - FALSE_ALARMS) / count
    if left <= 0:
        return np.inf
    root = (
        _NORMAL_POWER * deviation + np.sqrt((_NORMAL_POWER * deviation) ** 2 + left * above)
    ) / left
    return float(root**2)


def explained_share(recording: Recording, model_rps: FloatArray, presence: Presence) -> float:
    """Share of the pattern's energy that a model [rps, at the samples] explains: 1 if all, 0 or less if none."""
    harmonics = _odd_harmonics(recording)
    halves = _half_turns(replace(recording, v=model_rps))
    fitted = _mean_halves(_coefficients(halves, harmonics))
    noise = 16 * harmonics.size / halves.size * presence.noise_rps**2
    whole = float((np.abs(presence.pattern) ** 2).sum()) - noise
    left = float((np.abs(presence.pattern - fitted) ** 2).sum()) - noise
    return 1 - max(left, 0.0) / whole if whole > 0 else 0.0
