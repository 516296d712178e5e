"""The bounds of the search as `cma` had them before 3.4: a map from unbounded samples into the box.

The paper names bounds (Table 1) and no method; this is that of the library it used.
"""

import numpy as np

from replication.arrays import FloatArray
from replication.compiling import njit
from replication.signature import Box


def margins_of(box: Box) -> tuple[FloatArray, FloatArray]:
    """Widths of the margins at the lower and upper bounds, never more than half the box."""
    half = (box.upper - box.lower) / 2
    at_lower = np.minimum(half, (1 + np.abs(box.lower)) / 20)
    at_upper = np.minimum(half, (1 + np.abs(box.upper)) / 20)
    return at_lower, at_upper


def into_box(samples: FloatArray, box: Box) -> FloatArray:
    """Map unbounded samples, shape (population, n), into the box, as `cma` did before 3.4."""
    return _into_box(samples, box.lower, box.upper, *margins_of(box))


@njit
def _into_box(samples, lower, upper, at_lower, at_upper):
    """The identity inside, bent to a half-parabola in a margin at each bound; beyond it back and forth."""
    members = np.empty_like(samples)
    for i in range(lower.size):
        first = lower[i] - 2 * at_lower[i] - (upper[i] - lower[i]) / 2
        last = upper[i] + 2 * at_upper[i] + (upper[i] - lower[i]) / 2
        period = 2 * (upper[i] - lower[i] + at_lower[i] + at_upper[i])
        for k in range(len(samples)):
            y = samples[k, i]
            if y < first or y > last:
                y -= period * ((y - first) // period)
            if y > upper[i] + at_upper[i]:
                y -= 2 * (y - upper[i] - at_upper[i])
            if y < lower[i] - at_lower[i]:
                y += 2 * (lower[i] - at_lower[i] - y)
            if y < lower[i] + at_lower[i]:
                y = lower[i] + (y - (lower[i] - at_lower[i])) ** 2 / 4 / at_lower[i]
            if y > upper[i] - at_upper[i]:
                y = upper[i] - (y - (upper[i] + at_upper[i])) ** 2 / 4 / at_upper[i]
            members[k, i] = y
    return members


def from_box(point: FloatArray, box: Box) -> FloatArray:
    """Sample whose image under `into_box` is a point of the box."""
    at_lower, at_upper = margins_of(box)
    near_lower = (box.lower - at_lower) + 2 * (at_lower * (point - box.lower)) ** 0.5
    near_upper = (box.upper + at_upper) - 2 * (at_upper * (box.upper - point)) ** 0.5
    inner = np.where(point < box.upper - at_upper, point, near_upper)
    return np.where(point < box.lower + at_lower, near_lower, inner)
