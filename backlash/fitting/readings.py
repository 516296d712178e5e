"""What a record tells of the backlash: amplitude, energy, impact time and waveform."""

from dataclasses import dataclass, replace

import numpy as np

from backlash.fitting import METHODS
from backlash.fitting.global_fit import GlobalFit, global_fit
from backlash.fitting.waveform import WaveformBank, match, mean_turn, samples_a_turn
from replication import table2
from replication.records import Recording
from replication.signature import Timing
from replication.signature import h as signature
from replication.table2 import Settings


@dataclass(frozen=True)
class Reading:
    """What one method read off a record."""

    value: float  # |A| or RMS [rps], for "impact" t0 [s], for "waveform" the backlash [rad]
    interval: tuple[
        float, float
    ]  # 95 %, from the record's noise; for "paper" the spread of the searches
    amplitude_rps: float
    amplitude_interval_rps: tuple[float, float]
    at_end: bool = False  # for "waveform", the backlash is the bank's first or last
    shift_turns: float = 0.0  # for "waveform", the phase of the record against the bank


_REPEATED = 4
_UNKNOWN = (np.nan, np.nan)
NO_READING = Reading(np.nan, _UNKNOWN, np.nan, _UNKNOWN)


def protocol_for(recording: Recording) -> Settings:
    """Scale the paper's protocol to a record: its turn period, as many turns as it lasts, windows in proportion."""
    period = recording.turn_period_s
    turns = max(1, int(np.ceil((recording.t[-1] - recording.t[0]) / period - 1e-6)))
    timing = Timing(period / 2, period, turns)
    return Settings(
        timing=timing, longest_window_s=Settings().longest_window_s * period / Timing().T_f
    )


def _energy(recording: Recording, fit: GlobalFit) -> tuple[float, tuple[float, float]]:
    """RMS of the fitted signature over the whole turns from t0 on, and its 95 % interval [rps].

    White noise of SD s in n samples moves it by s / sqrt(n), because only its part along the
    signature counts.
    """
    since = (recording.t - fit.X[1]) / recording.turn_period_s
    whole = (since >= 0) & (since < max(np.floor(since[-1] + 1 / recording.t.size), 1.0))
    h = signature(recording.t, fit.X, protocol_for(recording).timing)[whole]
    rms, half_width = float(np.sqrt(np.mean(h**2))), 1.96 * fit.rmse / np.sqrt(h.size)
    return rms, (max(rms - half_width, 0.0), rms + half_width)


def read(
    recording: Recording,
    method: str,
    bank: WaveformBank | None = None,
    repeats: int = 30,
    seed: int = 1,
) -> Reading:
    """Value that a method reads off a record; "waveform" needs a bank, "paper" runs `repeats` searches from `seed` on.

    "impact", the first instant of the oscillation within half a turn, needs records that all start
    at the same angle of the load; it has no interval.
    """
    if method not in (*METHODS, "impact"):
        raise ValueError(f"method {method!r}: there are {', '.join(METHODS)}")
    protocol = protocol_for(recording)
    if method != "paper":
        return reading_of_fit(recording, method, global_fit(recording, protocol), bank)
    fits = [table2.fit(recording, protocol, seed + run) for run in range(repeats)]
    amplitude = np.array([fit.amplitude_rps for fit in fits])
    mean, spread = (
        float(amplitude.mean()),
        1.96 * float(amplitude.std(ddof=1)) if repeats > 1 else 0.0,
    )
    interval = max(mean - spread, 0.0), mean + spread
    return Reading(mean, interval, mean, interval)


def amplitude_of_mean_turn(recording: Recording) -> Reading:
    """Amplitude by the signature's fit to the mean turn, much faster than to a long record.

    The turn is repeated, for the first window begins somewhere in it; that tells nothing new, so
    the interval is as wide as by one.
    """
    phases, period = samples_a_turn(recording), recording.turn_period_s
    t = np.arange(_REPEATED * phases) * period / phases
    repeated = replace(recording, t=t, v=np.tile(mean_turn(recording, phases), _REPEATED))
    found = reading_of_fit(repeated, "amplitude", global_fit(repeated, protocol_for(repeated)))
    ends = found.value + np.sqrt(_REPEATED) * np.subtract(found.interval, found.value)
    interval = max(float(ends[0]), 0.0), float(ends[1])
    return replace(found, interval=interval, amplitude_interval_rps=interval)


def reading_of_fit(
    recording: Recording,
    method: str,
    fit: GlobalFit,
    bank: WaveformBank | None = None,
    is_own: bool = False,
) -> Reading:
    """Reading of a record whose global fit is there; "paper" takes its amplitude, which the searches look for.

    Where the bank `is_own`, of the record's joint, a low-pass is looked for too.
    """
    amplitude, interval = fit.amplitude_rps, fit.amplitude_interval_rps
    found = Reading(amplitude, interval, amplitude, interval)
    if method == "energy":
        value, interval = _energy(recording, fit)
        return replace(found, value=value, interval=interval)
    if method == "impact":
        value = float(fit.X[1] % (recording.turn_period_s / 2))
        return replace(found, value=value, interval=(value, value))
    if method == "waveform":
        if bank is None:
            raise ValueError("waveform needs a bank")
        best = match(recording, bank, is_own)
        return replace(
            found,
            value=best.delta_rad,
            interval=best.interval_rad,
            at_end=best.at_end,
            shift_turns=best.shift_turns,
        )
    return found
