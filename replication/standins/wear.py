"""Stand-ins for the wear of the bench: backlash that grows over eight months under stress."""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from replication.arrays import FloatArray


@dataclass(frozen=True)
class Wear:
    """Backlash over the months under stress, delta(t) = first + (last - first) (t / duration)^exponent."""

    first_rad: float
    last_rad: float
    exponent: float
    duration_days: float = 240.0
    interval_days: float = 21.0

    @property
    def test_days(self) -> FloatArray:
        """Days of the tests, the first on day 0."""
        return np.arange(0.0, self.duration_days + 1e-9, self.interval_days)

    def backlash_rad(self, day: FloatArray | float) -> FloatArray | float:
        """Backlash on a day [rad]."""
        growth = (np.asarray(day) / self.duration_days) ** self.exponent
        return self.first_rad + (self.last_rad - self.first_rad) * growth

    def crossing_day(self, limit_rad: float) -> float:
        """Day on which the backlash reaches a limit between its first and last value."""
        share = (limit_rad - self.first_rad) / (self.last_rad - self.first_rad)
        return float(self.duration_days * share ** (1 / self.exponent))


def draw_wear(rng: Generator, limit_rad: float) -> Wear:
    """Draw a wear that starts well below a limit and passes it within the eight months."""
    first = limit_rad * rng.uniform(0.2, 0.5)
    last = limit_rad * rng.uniform(1.2, 1.6)
    return Wear(first, last, rng.uniform(1.0, 3.0))
