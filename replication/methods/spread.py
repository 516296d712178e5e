"""What a calibration of the paper's joint may err on a joint that is another: measured on benches drawn at large."""

from functools import lru_cache
from importlib.resources import files

import numpy as np
import pandas as pd


@lru_cache(maxsize=1)
def shares() -> dict[str, float]:
    """By method: 95 % of the errors on uncalibrated benches are below this share of the backlash found.

    From `data/spread_of_joints.csv`, which `python -m replication population` makes from benches of its own seed.
    """
    with files("replication").joinpath("data/spread_of_joints.csv").open(encoding="utf-8") as file:
        table = pd.read_csv(file)
    return dict(zip(table["method"], table["share_95"].astype(float), strict=True))


def widened(method: str, delta_rad: float, interval_rad: tuple[float, float]) -> tuple[float, float]:
    """Interval [rad] of a backlash by the paper's joint's calibration, the spread of joints added to the noise."""
    other = shares()[method] * delta_rad
    low, high = interval_rad
    return float(delta_rad - np.hypot(delta_rad - low, other)), float(delta_rad + np.hypot(high - delta_rad, other))
