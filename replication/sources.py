"""Where a notebook's records come from: the authors' files, or our joint's records where these cannot be had.

Whoever runs notebooks chooses, by the environment variable BACKLASH_RECORDS, because the choice has
to reach a notebook's kernel and the processes that it starts.
"""

import os
from collections.abc import Iterable

import numpy as np

from replication.records import (
    Recording,
    add_uniform_noise,
    check_noisy,
    level_delta_rad,
    read_clean,
    read_noisy,
)
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings


def records_are_simulated() -> bool:
    """Whether our joint's records take the place of the authors'."""
    return os.environ.get("BACKLASH_RECORDS") == "simulated"


def load_clean(level: int) -> Recording:
    """Load the noise-free record of level K; the authors' K = 3 to 13 are public."""
    if records_are_simulated():
        return simulate_recordings(identified_joint(), [level_delta_rad(level)])[0]
    return read_clean(level)


def load_clean_records(levels: Iterable[int]) -> dict[float, Recording]:
    """Load the clean records of some levels K, by backlash [rad]."""
    return {level_delta_rad(level): load_clean(level) for level in levels}


def load_noisy(level: int, realisation: int) -> Recording:
    """Load the noisy record of a level K, 1 to 20, and a realisation R of the low noise, 1 to 5."""
    if not records_are_simulated():
        return read_noisy(level, realisation)
    check_noisy(level, realisation)
    half = 0.1 + (level - 1) * 0.15 / 19  # the law of the authors' noise, which Table 2's rows obey
    rng = np.random.default_rng((realisation, level))
    return add_uniform_noise(load_clean(level), half, rng)
