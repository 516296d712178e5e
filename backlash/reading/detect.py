"""Whether a record repeats itself from turn to turn as backlash makes it, and with which period.

Backlash disturbs the speed once in each half of a load turn, with the opposite sign in the next half (equation 6): the
halves, each second one taken negative, add up; noise does not. Odd harmonics of the turn count from the third, because
gravity alone moves the speed once a turn, and from 5 Hz to one and a half times Table 1's fastest oscillation.

The permutation test compares the energy of the sum with that under random signs of the half turns. It holds whatever
the noise's spectrum and distribution, as long as half turns are independent and their noise is symmetric.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.ndimage import median_filter
from scipy.special import gammaincc, gammaincinv

from backlash.reading.columns import LogFormat
from backlash.refusals import CannotTell
from replication.arrays import FloatArray
from replication.recording import Recording

# Orders of the motor's turn at which torque ripples and encoders err: once and twice a turn, and with the phases.
MOTOR_ORDERS = (1, 2, 6)

ComplexArray = NDArray[np.complex128]

FALSE_ALARMS = 0.01  # how often noise alone may pass for a pattern
POWER = 0.95  # how often a pattern of the detectable energy is found
_NORMAL_POWER = 1.645  # its quantile
_PERMUTATIONS = 1999
_SLOWEST_HZ, _FASTEST_HZ = 5.0, 60.0
_LEAST_HARMONICS = 3

# The search for the record's own period: from an eighth of the given one to eight times it.
_OCTAVES = 3.0
_LEAST_REPEATS = 3.0
_MOST_OF_A_LINE = 8.0  # times the background
_PERIOD_TOLERANCE = 0.005
_GAIN_OF_PERIOD = 10.0  # in power over the background, what another period nearby must have more
_DRIFT_S = 2.5e-3  # over the record; a twentieth of an oscillation, no harm to its amplitude
_BACKGROUND_HZ = 7.0  # width over which a line's background is taken
_LEAST_BACKGROUND = 1e-4  # of the loudest line, whose skirts in a quiet record are no lines
_SAME_PATTERN = 0.7
_PEAK_STEPS = 12
_LOG_OF_NOISE = 0.596  # mean of log(1 + x) for an exponential x of mean 1: a bin without a line

# Damping [1/s] and angular frequency [rad/s] like those of the authors' records, for what noise would hide.
_TYPICAL_RING = (15.0, 134.0)


@dataclass(frozen=True)
class Presence:
    """What the half turns of a record have in common; `pattern` has shape (2, harmonics)."""

    p_value: float  # how often random signs give as much energy
    has_same_sign: bool  # whether there is one with the same sign in both halves of a turn, as no signature has
    noise_rps: float  # RMS noise of a sample in the band, from the scatter between half turns
    detectable_rps2: float  # energy, as `band_energy` counts it, that is found with probability `POWER`
    pattern: ComplexArray  # of the mean first and second half of a turn, the second negated [rps]

    @property
    def found(self) -> bool:
        """Whether there is a pattern, at the level `FALSE_ALARMS`."""
        return self.p_value <= FALSE_ALARMS


def _odd_harmonics(recording: Recording) -> NDArray[np.int64]:
    """Odd harmonics of a turn that the test looks at: those in the band that are not next to the motor's own."""
    period, gear_ratio = recording.turn_period_s, recording.commanded_speed_rps * recording.turn_period_s
    fastest = min(_FASTEST_HZ, 0.4 / recording.sample_s)
    odd = np.arange(3, max(int(fastest * period) + 1, 4), 2)
    beside_motor = np.abs(odd[:, None] - gear_ratio * np.array(MOTOR_ORDERS)) < 1
    return odd[(odd >= _SLOWEST_HZ * period) & (odd <= fastest * period) & ~beside_motor.any(axis=1)]


def _coefficients(halves: FloatArray, harmonics: NDArray[np.int64]) -> ComplexArray:
    """Fourier coefficients of half turns (rows) at odd harmonics, without mean, slope and first harmonic."""
    phases = np.arange(halves.shape[1]) / halves.shape[1]
    slow = np.stack([np.ones_like(phases), phases, np.cos(np.pi * phases), np.sin(np.pi * phases)], axis=1)
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
    v = recording.v - recording.v.mean()
    if 0.4 / dt > 1.3 * _FASTEST_HZ:  # else what is above the band would leak into it with the slow part
        from scipy import signal  # slow to import, and not needed to refuse a file

        v = signal.sosfiltfilt(signal.butter(6, 1.3 * _FASTEST_HZ, output="sos", fs=1 / dt), v)
    v = np.interp(instants, recording.t, v - _motor_lines(recording, v))
    return v * np.where(np.arange(count) % 2, -1.0, 1.0)[:, None]


def _motor_lines(recording: Recording, v: FloatArray) -> FloatArray:
    """What the motor's own orders in the band leave in a speed: it would leak into the load's harmonics."""
    hz = np.array([order * recording.commanded_speed_rps for order in MOTOR_ORDERS])
    waves = np.exp(2j * np.pi * np.outer(recording.t, hz[hz < 1.3 * _FASTEST_HZ]))
    basis = np.hstack([waves.real, waves.imag])
    return basis @ np.linalg.lstsq(basis, v)[0] if basis.size else np.zeros_like(v)


def band_energy(half_turn: FloatArray, recording: Recording) -> float:
    """Energy of one half turn's pattern [rps^2] as the test of a record counts it: its squared coefficients' sum."""
    return float((np.abs(_coefficients(half_turn[None, :], _odd_harmonics(recording))) ** 2).sum())


def typical_half_turn(recording: Recording) -> FloatArray:
    """Half a turn of an oscillation of amplitude 1 rps, like those of the authors' records, at a record's sampling."""
    since = recording.sample_s * np.arange(int(recording.turn_period_s / 2 / recording.sample_s + 1e-6))
    tau, omega = _TYPICAL_RING
    return np.exp(-tau * since) * np.sin(omega * since)


def _signs(count: int, rng: np.random.Generator) -> FloatArray:
    """Rows of signs for the permutation test, the first all alike: every pattern if they are few, else random ones."""
    if 2 ** (count - 1) <= _PERMUTATIONS:
        bits = np.arange(2 ** (count - 1))[:, None] >> np.arange(count) & 1
        return np.where(bits, -1.0, 1.0)
    signs = np.ones((_PERMUTATIONS + 1, count))
    signs[1:] = rng.choice([-1.0, 1.0], size=(_PERMUTATIONS, count))
    return signs


def detect_pattern(recording: Recording, form: LogFormat, seed: int) -> tuple[Recording, Presence, tuple[str, ...]]:
    """Test for a pattern, after correcting the turn period, with a note, to the record's own where they are near."""
    given = recording.turn_period_s
    period = given if form.trust_period else own_period(recording)
    if period is None or period == given:
        return recording, find_pattern(recording, seed), ()
    if abs(period / given - 1) > _PERIOD_TOLERANCE:
        ratio = form.gear_ratio
        instead = f"--gear-ratio {ratio * period / given:.4g}" if ratio else f"--turn-period {period:.4f}"
        repeats = f"the record repeats itself every {period:.4f} s, not every {given:.4f} s"
        detail = f"{repeats}; is it {instead}? if the one given is right, --trust-period"
        raise CannotTell("wrong period", detail)
    recording = replace(recording, turn_period_s=period)
    note = f"the record repeats itself every {period:.5f} s, not every {given:.5f} s: used that"
    return recording, find_pattern(recording, seed), (note,)


def find_pattern(recording: Recording, seed: int = 1) -> Presence:
    """Test whether half turns share a pattern in the band of a backlash's ring."""
    harmonics = _odd_harmonics(recording)
    if harmonics.size < _LEAST_HARMONICS:
        raise CannotTell("too short", f"a turn of {recording.turn_period_s:.3g} s has no room for an oscillation")
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
        float(np.mean(energy >= energy[0] * (1 - 1e-12))),
        bool(np.mean(energy >= same_sign * (1 - 1e-12)) <= FALSE_ALARMS),
        float(np.sqrt(scatter * halves.shape[1] / (4 * harmonics.size))),
        _detectable(threshold - a_mean, deviation, len(rows)),
        pattern,
    )


def _detectable(above: float, deviation: float, count: int) -> float:
    """Energy that is found with probability `POWER` [rps^2], from the threshold's height above the mean noise."""
    # Random signs leave some of a pattern in the threshold: at most its energy over `count`, times this quantile.
    left = 1 - 2 * gammaincinv(0.5, 1 - FALSE_ALARMS) / count
    if left <= 0:
        return np.inf
    root = (_NORMAL_POWER * deviation + np.sqrt((_NORMAL_POWER * deviation) ** 2 + left * above)) / left
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


def _line_spectrum(recording: Recording) -> tuple[FloatArray, float]:
    """Power over its local background, 1 on average where there are no lines, and the spacing of the bins [Hz]."""
    dt = recording.sample_s
    samples = recording.v.size
    line = np.column_stack([np.arange(1, samples + 1) / samples, np.ones(samples)])
    window = 0.5 + 0.5 * np.cos(np.linspace(-np.pi, np.pi, samples + 1)[:-1])
    v = (recording.v - line @ np.linalg.lstsq(line, recording.v)[0]) * window
    size = next_fast_len(4 * samples, real=True)
    spacing = 1 / (size * dt)
    power = np.abs(np.fft.rfft(v, size)) ** 2
    every = size // v.size
    around = max(int(_BACKGROUND_HZ / (every * spacing)) | 1, 9)
    background = median_filter(power[::every], around, mode="nearest") / np.log(2)
    background = np.interp(np.arange(power.size), every * np.arange(background.size), background)
    band = power[int(_SLOWEST_HZ / spacing) : int(_FASTEST_HZ / spacing)]
    return power / np.maximum(background, max(_LEAST_BACKGROUND * band.max(initial=0.0), 1e-300)), spacing


def _line_sums(
    power: FloatArray, spacing: float, periods: FloatArray, dt: float, orders: int
) -> tuple[FloatArray, FloatArray]:
    """Sum over harmonics in the band but for the loudest, and how many these are, for each turn period.

    They are the odd harmonics, each second one, or from the third all: `orders` is 2 or 1.
    """
    fastest = min(_FASTEST_HZ, 0.4 / dt)
    total, loudest, count = np.zeros(periods.size), np.zeros(periods.size), np.zeros(periods.size)
    for order in range(3, int(fastest * periods.max()) + 1, orders):
        frequency = order / periods
        inside = (frequency >= _SLOWEST_HZ) & (frequency <= fastest)
        line = power[np.rint(frequency[inside] / spacing).astype(np.int64)]
        total[inside] += line
        loudest[inside] = np.maximum(loudest[inside], line)
        count += inside
    return total - loudest, np.maximum(count - 1, 0)


def own_period(recording: Recording) -> float | None:
    """Period [s] that a record repeats itself with: the given one if nothing speaks against it, None if none is found.

    Power at the odd harmonics of each period of a grid, or at all of them (friction), is summed, each line clipped and
    the loudest left out, so that mains hum is no period. Under noise the sum is at most Gamma distributed. Multiples of
    the right period repeat too, so the shortest one with nearly as much power is taken. The given period stands if
    its harmonics, of either parity, explain what speaks for the one found.
    """
    dt = recording.sample_s
    lasts, given = recording.t[-1] - recording.t[0] + dt, recording.turn_period_s
    power, spacing = _line_spectrum(recording)
    clipped = np.minimum(power, _MOST_OF_A_LINE)
    step = 0.25 / (_FASTEST_HZ / 2 * lasts)
    most = min(given * 2**_OCTAVES, lasts / _LEAST_REPEATS)
    least = max(given / 2**_OCTAVES, (2 * _LEAST_HARMONICS + 1) / _FASTEST_HZ)
    if most <= least:
        return given
    periods = np.exp(np.arange(np.log(least), np.log(most), step))
    by_odd, by_all = (_chance(*_line_sums(clipped, spacing, periods, dt, orders)) for orders in (2, 1))
    orders, chance = (2, by_odd) if by_odd.min() <= by_all.min() else (1, by_all)
    best = int(chance.argmin())
    if chance[best] + np.log(2 * periods.size) > np.log(FALSE_ALARMS):
        return None
    excess = _line_sums(np.log1p(power) - _LOG_OF_NOISE, spacing, periods, dt, orders)[0]
    excess[chance > chance[best] / 2] = 0.0
    enough = _SAME_PATTERN * excess.max()
    shortest = np.flatnonzero(excess >= enough)[0]
    peak = shortest + int(excess[shortest : shortest + _PEAK_STEPS].argmax())
    found = _refined(power, spacing, periods[peak], 2 * step, dt)
    if abs(found / given - 1) <= _PERIOD_TOLERANCE:
        gain = _line_sums(power, spacing, np.array([found, given]), dt, orders)[0]
        is_as_good = gain[0] - gain[1] < _GAIN_OF_PERIOD or abs(found / given - 1) * lasts < _DRIFT_S
        return given if is_as_good else found
    if given > found and not _has_lines_beside(power, spacing, given, found, recording, 1):
        return found
    return found if _has_lines_beside(power, spacing, found, given, recording, 2 * periods.size) else given


def _chance(total: FloatArray, count: FloatArray) -> FloatArray:
    """Logarithm of the probability that noise alone has so much power at so many harmonics."""
    with np.errstate(divide="ignore"):  # far out the probability is zero
        return np.where(count >= _LEAST_HARMONICS, np.log(gammaincc(np.maximum(count, 1), total)), 0.0)


def _has_lines_beside(
    power: FloatArray, spacing: float, period: float, other: float, recording: Recording, tried: int
) -> bool:
    """Whether there is power at odd harmonics of a period that are no harmonics, of either parity, of the other one.

    The loudest does not count; `tried` is the number of periods among which this one was chosen. A line's skirts are
    three bins wide: where they meet, the higher one is the line.
    """
    lasts, fastest = recording.t[-1] - recording.t[0], min(_FASTEST_HZ, 0.4 / recording.sample_s)
    frequency = np.arange(3, int(fastest * period) + 1, 2) / period
    frequency = frequency[frequency >= _SLOWEST_HZ]
    nearest = np.rint(frequency * other) / other
    here, there = (power[np.rint(hz / spacing).astype(np.int64)] for hz in (frequency, nearest))
    bins = np.abs(frequency - nearest) * lasts
    line = np.minimum(here[(bins > 1) & ((here > there) | (bins > 3))], _MOST_OF_A_LINE)
    count = line.size - 1
    return count >= 2 and bool(gammaincc(count, line.sum() - line.max()) * tried < FALSE_ALARMS)


def _refined(power: FloatArray, spacing: float, period: float, reach: float, dt: float) -> float:
    """The period with the most power at its odd harmonics within a relative reach of the one given."""
    periods = period * (1 + np.linspace(-reach, reach, 81))
    total, _ = _line_sums(np.log1p(power), spacing, periods, dt, 2)
    weight = np.maximum(total - total.max() + 0.1 * np.ptp(total), 0.0)
    return float(periods @ weight / weight.sum()) if weight.sum() > 0 else float(period)
