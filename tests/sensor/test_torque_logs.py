import io
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import backlash
from backlash.main import main
from backlash.reading.columns import LogFormat
from backlash.reading.prepare import record_of
from backlash.reading.tables import UnusableLog
from backlash.studies.odd_joints import draw_cascade, log_with_torque

DELTA = 1e-3


def logged(number: int, delta: float = DELTA, sample_s: float = 2e-3):
    """A table of a joint under a cascade, and what is known of its load."""
    bench = draw_cascade(np.random.default_rng((11, number)))
    recording, torque = log_with_torque(bench, delta, np.random.default_rng(1), sample_s)
    frame = pd.DataFrame({"time [s]": recording.t, "speed [rps]": recording.v, "torque [Nm]": torque})
    ratios = bench.joint.ratios
    known = {"turn_period_s": recording.turn_period_s, "commanded_speed_rps": recording.commanded_speed_rps}
    return frame, known | {name: ratios[name] for name in ("inertia_ratio", "gravity_per_s2")}
