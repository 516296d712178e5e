"""The period with which a record repeats itself."""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import next_fast_len
from scipy.special import gammaincc

from replication.arrays import FloatArray
from replication.records import Recording

FALSE_ALARMS = 0.01  # how often noise alone may pass for a pattern
SLOWEST_HZ = 5.0
FASTEST_HZ = 60.0
LEAST_HARMONICS = 3
PERIOD_TOLERANCE = 0.005

# The search for the record's own period: from an eighth of the given one to eight times it.
_OCTAVES = 3.0
_LEAST_REPEATS = 3.0
_MOST_OF_A_LINE = 8.0  # times the background
_GAIN_OF_PERIOD = 10.0  # in power over the background, what another period nearby must have more
_DRIFT_S = 2.5e-3  # over the record; a twentieth of an oscillation, no harm to its amplitude
_BACKGROUND_HZ = 7.0  # width over which a line's background is taken
_LEAST_BACKGROUND = 1e-4  # of the loudest line, whose skirts in a quiet record are no lines
_SAME_PATTERN = 0.7
_PEAK_STEPS = 12
_LOG_OF_NOISE = 0.596  # mean of log(1 + x) for an exponential x of mean 1: a bin without a line


class _Spectrum(NamedTuple):
    """A record's power over its local background, 1 on average where there are no lines."""

    power: FloatArray
    spacing_hz: float  # of the bins
    fastest_hz: float  # of the band that counts
    lasts_s: float  # the record

    def at(self, hz: FloatArray) -> FloatArray:
        return self.power[np.rint(hz / self.spacing_hz).astype(np.int64)]


def fastest_hz(recording: Recording) -> float:
    """End of the band that a record's sampling leaves."""
    return min(FASTEST_HZ, 0.4 / recording.sample_s)


def _line_spectrum(recording: Recording) -> _Spectrum:
    dt = recording.sample_s
    samples = recording.v.size
    line = np.column_stack([np.arange(1, samples + 1) / samples, np.ones(samples)])
    window = 0.5 + 0.5 * np.cos(np.linspace(-np.pi, np.pi, samples + 1)[:-1])
    v = (recording.v - line @ np.linalg.lstsq(line, recording.v)[0]) * window
    size = next_fast_len(4 * samples, real=True)
    spacing = 1 / (size * dt)
    power = np.abs(np.fft.rfft(v, size)[: int(2 * FASTEST_HZ / spacing)]) ** 2
    every = size // v.size
    around = max(int(_BACKGROUND_HZ / (every * spacing)) | 1, 9)
    padded = np.pad(power[::every], around // 2, mode="edge")
    background = np.median(sliding_window_view(padded, around), axis=1) / np.log(2)
    background = np.interp(np.arange(power.size), every * np.arange(background.size), background)
    loudest = power[int(SLOWEST_HZ / spacing) : int(FASTEST_HZ / spacing)].max(initial=0.0)
    over = power / np.maximum(background, max(_LEAST_BACKGROUND * loudest, 1e-300))
    return _Spectrum(over, spacing, fastest_hz(recording), recording.t[-1] - recording.t[0])


def _line_sums(
    spectrum: _Spectrum, periods: FloatArray, orders: int
) -> tuple[FloatArray, FloatArray]:
    """Sum over harmonics in the band but for the loudest, and how many these are, for each turn period, in order.

    They are the odd harmonics, each second one, or from the third all: `orders` is 2 or 1.
    """
    total = np.zeros(periods.size)
    loudest = np.zeros(periods.size)
    count = np.zeros(periods.size)
    for order in range(3, int(spectrum.fastest_hz * periods.max()) + 1, orders):
        ends = order / np.array([spectrum.fastest_hz, SLOWEST_HZ])
        inside = slice(*np.searchsorted(periods, ends))
        line = spectrum.at(order / periods[inside])
        total[inside] += line
        loudest[inside] = np.maximum(loudest[inside], line)
        count[inside] += 1
    return total - loudest, np.maximum(count - 1, 0)


def own_period(recording: Recording) -> float | None:
    """Period [s] that a record repeats itself with: the given one if nothing speaks against it, None if none is found.

    Power at the odd harmonics of each period of a grid, or at all of them (friction), is summed,
    each line clipped and the loudest left out, so that mains hum is no period. Under noise the sum
    is at most Gamma distributed. Multiples of the right period repeat too, so the shortest one with
    nearly as much power is taken. The given period stands if its harmonics, of either parity,
    explain what speaks for the one found, or if gravity's line is the given one's alone.
    """
    given = recording.turn_period_s
    spectrum = _line_spectrum(recording)
    lasts = spectrum.lasts_s + recording.sample_s
    step = 0.25 / (FASTEST_HZ / 2 * lasts)
    most = min(given * 2**_OCTAVES, lasts / _LEAST_REPEATS)
    least = max(given / 2**_OCTAVES, (2 * LEAST_HARMONICS + 1) / FASTEST_HZ)
    if most <= least:
        return given
    periods = np.exp(np.arange(np.log(least), np.log(most), step))
    clipped = spectrum._replace(power=np.minimum(spectrum.power, _MOST_OF_A_LINE))
    by_odd, by_all = (_chance(*_line_sums(clipped, periods, orders)) for orders in (2, 1))
    orders, chance = (2, by_odd) if by_odd.min() <= by_all.min() else (1, by_all)
    best = int(chance.argmin())
    if chance[best] + np.log(2 * periods.size) > np.log(FALSE_ALARMS):
        return None
    logarithms = np.log1p(spectrum.power)
    excess, _ = _line_sums(spectrum._replace(power=logarithms - _LOG_OF_NOISE), periods, orders)
    excess[chance > chance[best] / 2] = 0.0
    shortest = np.flatnonzero(excess >= _SAME_PATTERN * excess.max())[0]
    peak = shortest + int(excess[shortest : shortest + _PEAK_STEPS].argmax())
    found = _refined(spectrum._replace(power=logarithms), periods[peak], 2 * step)
    if abs(found / given - 1) <= PERIOD_TOLERANCE:
        own, others = (
            _line_sums(spectrum, np.array([period]), orders)[0].item() for period in (found, given)
        )
        is_as_good = own - others < _GAIN_OF_PERIOD or abs(found / given - 1) * lasts < _DRIFT_S
        return given if is_as_good else found
    # Gravity swings the load once a turn, not once in the two or three turns after which a large
    # backlash may repeat itself.
    once, by_found = spectrum.at(1 / np.array([given, found]))
    if once > _MOST_OF_A_LINE * max(by_found, 1.0):
        return given
    if given > found and not _has_lines_beside(spectrum, given, found, 1):
        return found
    return found if _has_lines_beside(spectrum, found, given, 2 * periods.size) else given


def _chance(total: FloatArray, count: FloatArray) -> FloatArray:
    """Logarithm of the probability that noise alone has so much power at so many harmonics."""
    with np.errstate(divide="ignore"):  # far out the probability is zero
        return np.where(
            count >= LEAST_HARMONICS, np.log(gammaincc(np.maximum(count, 1), total)), 0.0
        )


def _has_lines_beside(spectrum: _Spectrum, period: float, other: float, tried: int) -> bool:
    """Whether there is power at odd harmonics of a period that are no harmonics, of either parity, of the other one.

    The loudest does not count; `tried` is the number of periods among which this one was chosen. A
    line's skirts are three bins wide: where they meet, the higher one is the line.
    """
    hz = np.arange(3, int(spectrum.fastest_hz * period) + 1, 2) / period
    hz = hz[hz >= SLOWEST_HZ]
    nearest_hz = np.rint(hz * other) / other
    here, there = spectrum.at(hz), spectrum.at(nearest_hz)
    bins = np.abs(hz - nearest_hz) * spectrum.lasts_s
    line = np.minimum(here[(bins > 1) & ((here > there) | (bins > 3))], _MOST_OF_A_LINE)
    count = line.size - 1
    return count >= 2 and bool(gammaincc(count, line.sum() - line.max()) * tried < FALSE_ALARMS)


def _refined(logarithms: _Spectrum, period: float, reach: float) -> float:
    """The period with the most power at its odd harmonics within a relative reach of the one given."""
    periods = period * (1 + np.linspace(-reach, reach, 81))
    total, _ = _line_sums(logarithms, periods, 2)
    weight = np.maximum(total - total.max() + 0.1 * np.ptp(total), 0.0)
    return float(periods @ weight / weight.sum()) if weight.sum() > 0 else float(period)
