"""Values that no motor has or no logger measured: zeros between, stray, frozen, clipped and held ones."""

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from backlash.reading import limits
from backlash.reading.movement import usual_speed
from backlash.reading.samples import Samples, runs_of
from backlash.refusals import Reason, Refusal
from replication.signature import FloatArray

Mask = NDArray[np.bool_]
# Samples, and what is wrong with them.
Found: TypeAlias = Iterator[tuple[NDArray[np.int64], str]]
_NEARLY_ALL = (0.01, 0.99)  # quantiles of a signal, beyond which single values may be any


def finest_step(signal: FloatArray) -> float:
    """The smallest step that comes often, of a coarse signal its resolution; 0 where nothing changes.

    Single values may be filled in between two of it.
    """
    steps = np.abs(np.diff(signal))
    steps = steps[steps > 1e-9 * np.ptp(signal)]
    return float(np.quantile(steps, limits.RARE)) if steps.size else 0.0


def find_zeros(name: str, signal: FloatArray) -> Found:
    """Zeros between values of a motor that turns."""
    if name == "torque":
        return
    starts, lengths, values = runs_of(signal)
    is_far = np.abs(values) > 0.5 * np.median(np.abs(signal[signal != 0]))
    is_zero = (values == 0) & (lengths < limits.LEAST_FROZEN)
    zeros = starts[1:-1][is_zero[1:-1] & is_far[:-2] & is_far[2:]]
    if zeros.size > limits.MOST_SINGLE * signal.size:
        yield (
            zeros,
            f"the {name} is 0 at {zeros.size:,} places between rows that are not; leave out the rows without a "
            "measurement",
        )


def _single_strays(name: str, signal: FloatArray, limit: float) -> Found:
    """Samples that are too far from their neighbours and beyond the noise, if few enough to be single ones."""
    usual = median_filter(signal, 5, mode="nearest")
    away = np.abs(signal - usual)
    is_far = away > limit
    strays = np.flatnonzero(is_far & (away > limits.STRAY_DEVIATIONS * np.median(away)))
    if strays.size and is_far.mean() <= limits.MOST_SINGLE:
        first, beside = signal[strays[0]], usual[strays[0]]
        yield (
            strays,
            f"{strays.size} single samples of the {name} stray, the first is {first:.4g} beside {beside:.4g}",
        )


def find_strays(name: str, signal: FloatArray) -> Found:
    """Single samples of the torque that stand out of all others."""
    if name == "torque":
        reach = limits.STRAY * np.ptp(np.quantile(signal, _NEARLY_ALL))
        for strays, words in _single_strays(name, signal, reach):
            yield strays, f"{words}; mend them, or leave their cells empty"


def find_frozen(name: str, signal: FloatArray) -> Found:
    """Values that stand too long: a frozen signal, or a stand-in for what is missing."""
    starts, lengths, values = runs_of(signal)
    # A coarse signal stands for all lengths up to its longest; a freeze has hardly any beneath it.
    by_length = np.sort(lengths)
    beneath = np.searchsorted(by_length, lengths) - np.searchsorted(by_length, lengths / 2)
    apart = lengths[(lengths >= limits.LEAST_FROZEN) & (beneath < limits.LEAST_BENEATH)]
    # A coarse signal that turns slowly goes on by one step.
    jumps = np.abs(np.diff(values, prepend=values[0], append=values[-1]))
    leap = np.maximum(jumps[:-1], jumps[1:])
    is_leap = leap >= limits.LEAST_LEAP * finest_step(signal)
    # At a limit a signal is clipped, unless it gets there at once.
    at_end = (values == values.max()) | (values == values.min())
    is_leap &= ~at_end | (leap > 0.5 * np.ptp(np.quantile(signal, _NEARLY_ALL)))
    if name == "speed":  # a motor at rest has one
        is_leap &= np.abs(values) > 0.05 * np.abs(values).max()
    is_frozen = is_leap & (lengths >= apart.min(initial=signal.size))
    for start, length in zip(starts[is_frozen], lengths[is_frozen], strict=True):
        yield (
            np.arange(start, start + length),
            f"the {name} stands at {signal[start]:.6g} in {length} samples one after another: frozen, or a "
            "stand-in for missing values; cut the log there",
        )


def find_clipped(name: str, signal: FloatArray) -> Found:
    """Speed or torque that stops at a limit; one of coarse steps has as many samples at the next ones."""
    for way in (1, -1):
        levels, counts = np.unique(way * signal, return_counts=True)
        if levels.size < limits.LEAST_VALUES or name == "position":
            return
        at = way * signal == levels[-1]
        if name == "speed":  # a motor at rest has one
            at &= np.abs(signal) > 0.05 * np.abs(levels).max()
        is_held = at[2:] & at[1:-1] & at[:-2]
        is_piled = counts[-1] > limits.LEAST_PILED * counts[-4:-1].max()
        if is_piled and is_held.sum() > limits.MOST_CLIPPED * signal.size:
            yield (
                np.flatnonzero(at),
                f"the {name} is clipped at {way * levels[-1]:.6g} in {at.sum()} samples; log it with a wider range, or "
                "move slower",
            )


def keep_new_values(samples: Samples) -> Samples:
    """Keep the rows that have new values, where a logger repeats the last one."""
    news = {name: _is_not_held(signal) for name, signal in samples.named_signals()}
    name = min(news, key=lambda name: news[name].sum())
    slowest = news[name]
    if slowest.all():
        return samples
    thinned = samples.at(slowest)
    steps = np.diff(thinned.t) / np.median(np.diff(thinned.t))
    rate = thinned.rate_hz
    note = f"the {name} stands for {1 / slowest.mean():.2g} samples in the mean: {rate:.0f} new values a second"
    if np.mean(np.abs(steps - 1) > 0.5) > limits.MOST_INVENTED:
        raise Refusal(
            f"{note}, at uneven instants; log each value when it is new, or at a fixed rate"
        )
    least_hz = limits.GOOD_RATE * samples.options.ring_hz
    if rate < least_hz:
        raise Refusal(
            f"{note}, {least_hz:.0f} are needed; log each value when it is new",
            Reason.TOO_SLOWLY_SAMPLED,
        )
    return thinned.noting(f"{note}, which were used")


def _is_not_held(signal: FloatArray) -> Mask:
    """Samples that do not repeat the one before, if that is no matter of coarse steps."""
    _, lengths, values = runs_of(signal)
    usual = lengths[lengths < limits.LONGEST_HOLD]
    if usual.size < limits.LEAST_SAMPLES or values.size < 2:
        return np.ones(signal.size, dtype=bool)
    # A coarse signal stands where it turns slowly, and goes there by one step.
    steps = np.abs(np.diff(values))[lengths[1:] > 1]
    is_coarse = np.sum(steps < limits.LEAST_LEAP * finest_step(signal)) > 0.5 * steps.size
    # Of coarse steps nearly all stand for a multiple of what is commonest, which is above one.
    commonest = np.bincount(usual).argmax()
    is_regular = commonest > 1 and np.mean(usual % commonest == 0) > limits.MOST_REGULAR
    is_held = np.mean(usual > 1) > limits.LEAST_HELD and (is_regular or not is_coarse)
    return (np.diff(signal, prepend=np.nan) != 0) | (not is_held)


def refuse_speed_spikes(samples: Samples) -> Samples:
    """Refuse single samples of the speed that no motor could follow."""
    level = usual_speed(samples.v, samples.options.expected_speed_rps)
    for strays, words in _single_strays("speed", samples.v, limits.SPIKE * level):
        raise Refusal(
            f"{words} rps, {samples.t[strays[0]]:.6g} s after the first; mend or cut the log; of a speed "
            "differentiated by uneven stamps log the position"
        )
    return samples


def refuse_unmeasured(logged: Samples, first_s: float, last_s: float) -> None:
    """Refuse what was hardly measured of the samples that are used; outside these it does not matter."""
    for find in (find_zeros, find_strays, find_frozen, find_clipped):
        for name, signal in logged.named_signals():
            for chosen, words in find(name, signal):
                t = logged.t[chosen]
                if ((t >= first_s) & (t <= last_s)).any():
                    raise Refusal(words, row=logged.rows[chosen[0]])
