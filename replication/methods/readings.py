"""What a record tells of the backlash: amplitude, energy, impact time and waveform."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from replication.datasets import Recording
from replication.global_fit.fit import GlobalFit, global_fit
from replication.identify import Protocol, paper_fit
from replication.methods.waveform import WaveformBank, match
from replication.signature import signature

FloatArray = NDArray[np.float64]

# The methods of the virtual sensor. "impact" comes besides: it needs records that all start at one angle of the load.
METHODS = ("paper", "amplitude", "energy", "waveform")

_AUTHORS = Protocol()


@dataclass(frozen=True)
class Reading:
    """What one method read off a record.

    Attributes
    ----------
    method : str
        One of `METHODS`, or "impact".
    value : float
        |A| [rps] for "paper" and "amplitude", the signature's RMS [rps] for "energy", the oscillation's first
        instant t0 [s] for "impact", the backlash itself [rad] for "waveform".
    interval : tuple of float
        95 % interval of the value from the record's noise; for "paper" the spread of the searches instead.
    amplitude_rps, amplitude_interval_rps : float, tuple of float
        |A| and its interval [rps].
    rmse_rps : float
        Misfit of the signature; of the waveform for that method [rps].
    turn_period_s : float
        T_f of the record [s].
    at_bound : tuple of str
        What lies at a bound of its search.
    shift_turns : float
        For "waveform", the phase of the record against the bank [turns].
    """

    method: str
    value: float
    interval: tuple[float, float]
    amplitude_rps: float
    amplitude_interval_rps: tuple[float, float]
    rmse_rps: float
    turn_period_s: float
    at_bound: tuple[str, ...] = ()
    shift_turns: float = 0.0


def protocol_for(recording: Recording) -> Protocol:
    """Scale the paper's protocol to a record: its turn period, as many turns as it lasts, windows in proportion."""
    period = recording.turn_period_s
    turns = max(1, int(np.ceil((recording.t[-1] - recording.t[0]) / period - 1e-6)))
    return Protocol(
        T_d=period / 2, T_f=period, turns=turns, longest_window_s=_AUTHORS.longest_window_s * period / _AUTHORS.T_f
    )


def signature_rms(recording: Recording, fit: GlobalFit, protocol: Protocol) -> tuple[float, tuple[float, float]]:
    """RMS of the fitted signature, root of its mean power, over the whole turns from t0 on [rps].

    Returns
    -------
    float, tuple of float
        The RMS and its 95 % interval: white noise of SD s in n samples moves it by s / sqrt(n), because only its part
        along the signature counts.
    """
    timing = replace(protocol, T_f=fit.turn_period_s, T_d=fit.turn_period_s / 2).timing
    since = (recording.t - fit.X[1]) / fit.turn_period_s
    whole = (since >= 0) & (since < max(np.floor(since[-1] + 1 / recording.t.size), 1.0))
    h = signature(recording.t, fit.X, timing)[whole]
    rms, half_width = float(np.sqrt(np.mean(h**2))), 1.96 * fit.rmse / np.sqrt(h.size)
    return rms, (max(rms - half_width, 0.0), rms + half_width)


def _impact(recording: Recording, fit: GlobalFit) -> tuple[float, tuple[float, float]]:
    """First instant t0 of the oscillation within half a turn, as far as the box's bound lets it [s].

    Its interval is that of a sine of this amplitude and damping in white noise, half a turn long.
    """
    A, t0, tau, omega = fit.X[:4]
    oscillations = 2 * (recording.t[-1] - recording.t[0]) / fit.turn_period_s
    deviation = fit.rmse * np.sqrt(4 * tau * recording.sample_s / oscillations) / (abs(A) * omega)
    value = float(t0 % (fit.turn_period_s / 2))
    return value, (value - 1.96 * deviation, value + 1.96 * deviation)


def _paper_reading(recording: Recording, protocol: Protocol, repeats: int, seed: int) -> Reading:
    fits = [paper_fit(recording, protocol, seed + run) for run in range(repeats)]
    amplitude = np.array([fit.amplitude_rps for fit in fits])
    mean, spread = float(amplitude.mean()), 1.96 * float(amplitude.std(ddof=1)) if repeats > 1 else 0.0
    interval = (max(mean - spread, 0.0), mean + spread)
    rmse = float(min(fit.rmse for fit in fits))
    return Reading("paper", mean, interval, mean, interval, rmse, recording.turn_period_s)


def read(
    recording: Recording,
    method: str,
    bank: WaveformBank | None = None,
    repeats: int = 30,
    seed: int = 1,
) -> Reading:
    """Read a method's value off a record.

    Parameters
    ----------
    recording : Recording
        The record; its turn period scales the protocol.
    method : str
        One of `METHODS`, or "impact", which needs records that all start at the same angle of the load.
    bank : WaveformBank, optional
        For "waveform".
    repeats, seed : int
        CMA-ES runs of "paper", and the seed of the first.

    Returns
    -------
    Reading

    Raises
    ------
    ValueError
        The record is too short or constant; no such method; no bank for "waveform".
    """
    if method not in (*METHODS, "impact") or (method == "waveform") != (bank is not None):
        raise ValueError(f"method {method!r}: there are {', '.join(METHODS)}, and waveform alone needs a bank")
    if method == "paper":
        return _paper_reading(recording, protocol_for(recording), repeats, seed)
    return reading_of_fit(recording, method, global_fit(recording, protocol_for(recording)), bank)


def reading_of_fit(recording: Recording, method: str, fit: GlobalFit, bank: WaveformBank | None = None) -> Reading:
    """Read a method's value off a record whose global fit is there, as in `read`.

    "paper" takes the fit's amplitude here: the searches are for the same one.
    """
    rmse, at_bound, shift = fit.rmse, fit.at_bound, 0.0
    if method in ("paper", "amplitude"):
        value, interval = fit.amplitude_rps, fit.amplitude_interval_rps
    elif method == "energy":
        value, interval = signature_rms(recording, fit, protocol_for(recording))
    elif method == "impact":
        value, interval = _impact(recording, fit)
    else:
        found = match(replace(recording, turn_period_s=fit.turn_period_s), bank)
        value, interval, rmse, shift = found.delta_rad, found.interval_rad, found.rmse_rps, found.shift_turns
        at_bound = ("backlash",) if found.at_end else ()
    return Reading(
        method, value, interval, fit.amplitude_rps, fit.amplitude_interval_rps, rmse, fit.turn_period_s, at_bound, shift
    )
