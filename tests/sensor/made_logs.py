"""Logs of the simulated joint, for the tests of the sensor."""

from functools import lru_cache

import numpy as np
import pandas as pd

from backlash.reading.columns import LogFormat
from replication.recording import Recording, add_uniform_noise, constant_speed
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import identified_joint

TURN = LogFormat(turn_period_s=0.4)


@lru_cache
def clean(delta_rad: float = 9e-4) -> Recording:
    return simulate_recordings(identified_joint(), [delta_rad])[0]


def noisy(delta_rad: float = 9e-4, noise_rps: float = 0.1, seed: int = 1) -> Recording:
    return add_uniform_noise(clean(delta_rad), noise_rps, np.random.default_rng(seed))


def silent(noise_rps: float = 0.1, seed: int = 1) -> Recording:
    """A record of a constant speed and noise."""
    return add_uniform_noise(constant_speed(2401, 2e-3), noise_rps, np.random.default_rng(seed))


def table(recording: Recording) -> pd.DataFrame:
    frame = pd.DataFrame({"time": recording.t, "speed [rps]": recording.v})
    frame.index = frame.index + 2
    return frame


def write(recording: Recording, path, digits: int = 6):
    """Write a log with a header; returns its path."""
    rows = "\n".join(f"{t:.6f},{v:.{digits}f}" for t, v in zip(recording.t, recording.v, strict=True))
    path.write_text(f"time [s],speed [rps]\n{rows}\n", encoding="utf-8")
    return path
