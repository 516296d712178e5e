"""The paper's index of a record: the amplitude A of the signature that fits its mean turn best."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from backlash.turns import settled_turns, turn_phases
from replication.best_fit import best_fit
from replication.records import Recording
from replication.signature import FloatArray, Timing, h
from replication.table2 import NOTEBOOK

_REPEATED = 3  # turns that the fit sees: the window begins anywhere in the first
_LONGEST_WINDOW = 0.51  # of the turn: 0.204 s of 0.4 s, Table 1


class Amplitude(NamedTuple):
    """A with half the width of its 95 % interval, and the signature at the record's samples [rps]."""

    amplitude_rps: float
    half_width_rps: float
    model_rps: FloatArray


def measure_amplitude(recording: Recording) -> Amplitude | None:
    """Fit equation 7 to the mean turn, by the paper's cost; None where a turn is too short or has no variation."""
    period = recording.turn_period_s
    turns = settled_turns(recording, recording.v)
    # An even number of phases, for a window repeats itself after half a turn.
    phases = turns.shape[1] // 2 * 2
    places = np.arange(phases) / phases
    grid = np.arange(turns.shape[1]) / turns.shape[1]
    mean = np.interp(places, grid, turns.mean(axis=0), period=1.0)
    if np.ptp(mean) == 0:
        return None
    t = np.arange(_REPEATED * phases) * period / phases
    repeated = replace(recording, t=t, v=np.tile(mean, _REPEATED))
    timing = Timing(period / 2, period, _REPEATED)
    settings = replace(NOTEBOOK, timing=timing, longest_window_s=_LONGEST_WINDOW * period)
    fit = best_fit(repeated, settings)
    # Least squares of one turn in A, t0, tau, omega and v_t, which the window leaves free.
    turn = t[phases : 2 * phases]
    steps = np.array([1e-4, 1e-7, 1e-3, 1e-3, 1e-4, 0, 0])
    X = np.array(fit.X)
    slopes = [
        (h(turn, X + s, timing) - h(turn, X - s, timing)) / (2 * s.sum())
        for s in np.diag(steps)[:5]
    ]
    covariance = fit.rmse**2 * np.linalg.pinv(np.array(slopes) @ np.array(slopes).T)
    model = np.interp(
        turn_phases(recording, recording.t.size), places, h(turn, X, timing), period=1.0
    )
    return Amplitude(fit.amplitude_rps, float(1.96 * np.sqrt(covariance[0, 0])), model)
